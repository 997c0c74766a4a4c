"use strict";
// The page's two figures were drawn in Python; this script gives them the reader's colours and moves the first
// through time. Text only ever enters the page through textContent or as the figures carry it, escaped.
(async () => {
  const page = await Data.read();
  const byId = (id) => document.getElementById(id);

  // ---- numbers

  const px = Data.array(page.px, Int16Array);
  const nPins = px.length / 2 / page.n_moments;
  const place = (moment, pin, axis) => px[(moment * nPins + pin) * 2 + axis] * page.px_unit;
  const events = {
    t: Data.array(page.t_us, Int32Array), x: Data.array(page.x, Int16Array), y: Data.array(page.y, Int16Array),
    polarity: Data.array(page.polarity, Uint8Array),
  };

  // The first event after a time.
  const after = (t) => events.t.findLastIndex((one) => one <= t) + 1;

  let state = { moment: page.moment, playing: false, slower: 10, exaggeration: 1 };

  // ---- what is at a moment, as the traces of figures.draw_pins

  function traces() {
    const [discs, moves, off, on] = [0, 1, 2, 3].map(() => ({ x: [], y: [] }));
    const now = state.moment * page.step_ms * 1000;
    const [begin, end] = [now - 1000 * page.recent_ms, now].map(after);
    ["x", "y"].forEach((name, axis) => {
      for (let pin = 0; pin < nPins; pin++) {
        const rest = place(0, pin, axis);
        const at = rest + state.exaggeration * (place(state.moment, pin, axis) - rest);
        discs[name].push(...page.outline.map((way) => at + page.radius_px * way[axis]), null);
        moves[name].push(rest, at, null);
      }
      for (let i = begin; i < end; i++) (events.polarity[i] ? on : off)[name].push(events[name][i] + 0.5);
    });
    return [discs, moves, off, on];
  }

  // ---- views

  const seconds = () => (state.moment * page.step_ms) / 1000;

  let busy = Promise.resolve();

  function renderAll() {
    const style = Figure.style(page.palette);
    const now = traces();
    const pins = { ...page.pins, data: page.pins.data.map((trace, k) => ({ ...trace, ...now[k] })) };
    const margin = { l: 48, r: 8, t: 32, b: 36 };
    const cursor = { type: "line", xref: "x", yref: "paper", x0: seconds(), x1: seconds(), y0: 0, y1: 1, line: { color: style.text, width: 1, dash: "dot" } };
    busy = Promise.all([
      Figure.draw(byId("pins"), pins, style, (layout) => ({ legend: { ...layout.legend, x: 0, y: 1, yanchor: "bottom" }, margin })),
      Figure.draw(byId("course"), page.course, style, () => ({ shapes: [cursor], margin })).then((plot) => {
        plot?.removeAllListeners("plotly_click");
        plot?.on("plotly_click", (event) => show({ moment: Math.round((1000 * event.points[0].x) / page.step_ms) }));
      }),
    ]);
    renderWords();
  }

  function renderMoment() {
    // After the first drawing, which starts the library.
    busy = busy.then(() => {
      const now = traces();
      return Promise.all([
        Plotly.restyle("pins", { x: now.map((trace) => trace.x), y: now.map((trace) => trace.y) }, [0, 1, 2, 3]),
        Plotly.relayout("course", { "shapes[0].x0": seconds(), "shapes[0].x1": seconds() }),
      ]);
    });
    renderWords();
  }

  function renderWords() {
    byId("moment").value = state.moment;
    byId("now").textContent = `${seconds().toFixed(3)} s`;
    byId("moment").setAttribute("aria-valuetext", byId("now").textContent);
    byId("play").textContent = state.playing ? "Pause" : "Play";
    byId("play").setAttribute("aria-pressed", String(state.playing));
    const scale = state.exaggeration === 1
      ? "Pins are drawn where the camera sees them"
      : `Displacements of pins are drawn ${state.exaggeration} × larger; events are drawn where they were sent`;
    byId("caption").textContent =
      `${scale}; thin lines start at the rest position. Dots: events of the last ${Number(page.recent_ms.toPrecision(3))} ms.`;
  }

  function show(part) {
    state = { ...state, ...part };
    state.moment = Math.min(Math.max(state.moment, 0), page.n_moments - 1);
    renderMoment();
  }

  // ---- time

  let last = 0, elapsed = 0;
  function tick(now) {
    if (!state.playing) return;
    elapsed += (now - last) / state.slower;
    last = now;
    const next = state.moment + Math.floor(elapsed / page.step_ms);
    elapsed %= page.step_ms;
    if (next > state.moment) show({ moment: next, playing: next < page.n_moments });
    busy.then(() => requestAnimationFrame(tick));
  }

  function play(playing) {
    const fromStart = playing && state.moment === page.n_moments - 1;
    show({ playing, ...(fromStart ? { moment: 0 } : {}) });
    [last, elapsed] = [performance.now(), 0];
    requestAnimationFrame(tick);
  }

  // ---- what a reader does

  byId("counts").textContent = page.facts;
  byId("notes").replaceChildren(...page.notes.map((textContent) => Dom.element("li", { textContent })));
  byId("pins").setAttribute("aria-label", `Image of ${nPins} pins with the events around them; the slider below sets the time.`);
  byId("moment").max = page.n_moments - 1;
  byId("moment").addEventListener("input", (event) => show({ moment: Number(event.target.value), playing: false }));
  for (const id of ["slower", "exaggeration"]) byId(id).addEventListener("change", (e) => show({ [id]: Number(e.target.value) }));
  byId("play").addEventListener("click", () => play(!state.playing));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", renderAll);
  renderAll();
})();
