"use strict";
// The page's two figures were drawn in Python; this script gives them the reader's colours and moves the first
// through time. Text only ever enters the page through textContent or as the figures carry it, escaped.
(async () => {
  const page = await Data.read();
  const byId = (id) => document.getElementById(id);
  const ON = 1;

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
    for (let pin = 0; pin < nPins; pin++) {
      const [x0, y0] = [place(0, pin, 0), place(0, pin, 1)];
      const x = x0 + state.exaggeration * (place(state.moment, pin, 0) - x0);
      const y = y0 + state.exaggeration * (place(state.moment, pin, 1) - y0);
      for (const [cos, sin] of page.outline) {
        discs.x.push(x + page.radius_px * cos);
        discs.y.push(y + page.radius_px * sin);
      }
      discs.x.push(null); discs.y.push(null);
      moves.x.push(x0, x, null); moves.y.push(y0, y, null);
    }
    const now = state.moment * page.step_ms * 1000;
    const end = after(now);
    for (let i = after(now - 1000 * page.recent_ms); i < end; i++) {
      const dots = events.polarity[i] === ON ? on : off;
      dots.x.push(events.x[i] + 0.5);
      dots.y.push(events.y[i] + 0.5);
    }
    return [discs, moves, off, on];
  }

  // ---- views

  const seconds = () => (state.moment * page.step_ms) / 1000;

  function cursor(style) {
    return {
      type: "line", xref: "x", yref: "paper", x0: seconds(), x1: seconds(), y0: 0, y1: 1,
      line: { color: style.text, width: 1, dash: "dot" },
    };
  }

  let busy = Promise.resolve();

  function renderAll() {
    const style = Figure.style(page.palette);
    const now = traces();
    const pins = { ...page.pins, data: page.pins.data.map((trace, k) => ({ ...trace, ...now[k] })) };
    const margin = { l: 48, r: 8, t: 32, b: 36 };
    busy = Promise.all([
      Figure.draw(byId("pins"), pins, style, (layout) => ({ legend: { ...layout.legend, x: 0, y: 1, yanchor: "bottom" }, margin })),
      Figure.draw(byId("course"), page.course, style, () => ({ shapes: [cursor(style)], margin })).then((plot) => {
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
    const steps = Math.floor(elapsed / page.step_ms);
    if (!steps) {
      requestAnimationFrame(tick);
      return;
    }
    elapsed -= steps * page.step_ms;
    const next = state.moment + steps;
    show(next < page.n_moments ? { moment: next } : { moment: page.n_moments - 1, playing: false });
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
  byId("course-caption").textContent =
    "From top to bottom: events, counted for the nearest pin, with pins in order along the motion; " +
    "thousand ON and OFF events per second; speed v of the tip; shear s of its skin. Select a point to show its time.";
  byId("pins").setAttribute("aria-label", `Image of ${nPins} pins with the events around them; the slider below sets the time.`);
  byId("course").setAttribute("aria-label", "Events of each pin, event rate, speed and shear over time.");
  byId("moment").max = page.n_moments - 1;
  byId("controls").addEventListener("submit", (event) => event.preventDefault());
  byId("moment").addEventListener("input", (event) => show({ moment: Number(event.target.value), playing: false }));
  for (const id of ["slower", "exaggeration"]) byId(id).addEventListener("change", (e) => show({ [id]: Number(e.target.value) }));
  byId("play").addEventListener("click", () => play(!state.playing));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", renderAll);
  renderAll();
})();
