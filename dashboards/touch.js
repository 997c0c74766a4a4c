"use strict";
// A touch, played: the design's own module (target wasm) takes the input spikes of a recording that was held back, step by
// step in the recording's time, and answers when it decides. Nothing here computes a network.
const Touch = (() => {
  const [WIDTH, HEIGHT] = [240, 96]; // px of the input spikes
  const UNDECIDED = -1;
  const { element, button } = Dom;

  // A design beside its recordings: `run(k)` begins recording k and returns what takes its steps.
  async function machine(design, inputs) {
    const { exports } = (await WebAssembly.instantiate(Data.array(design.module, Uint8Array))).instance;
    const call = (name, ...values) => exports[`${design.prefix}${name}`](exports[`${design.prefix}net`].value, ...values);
    const recordings = inputs[design.input].map((one) => ({ ...one, counts: Data.array(one.counts, Uint16Array), channels: Data.array(one.channels, Uint16Array) }));
    function run(k) {
      const { counts, channels } = recordings[k];
      const now = { step: 0, label: UNDECIDED, isOver: false };
      let at = 0;
      call("init");
      call("reset");
      return Object.assign(now, {
        share: () => now.step / counts.length,
        advance() {
          const fired = channels.subarray(at, at += counts[now.step]);
          for (const channel of fired) call("push_spike", channel);
          call("step");
          now.step += 1;
          now.label = call("decision");
          now.isOver = now.label !== UNDECIDED || now.step >= counts.length;
          return fired;
        },
        steps: () => call("steps"), // of the network, until the answer
        evidence: () => (design.first === null ? [] : design.classes.map((_, label) => call("count", design.first + label))),
      });
    }
    return { design, recordings, run };
  }

  function player(app) {
    const { number, clip } = app;
    let shown = null;
    let [key, known, asked] = ["", null, 0]; // the design that is played: {why} or a machine, null until it is asked for
    let [run, chosen, start] = [null, 0, 0]; // start: of the clock
    const select = Dom.choice("recording", (k) => play(Number(k)), { id: "touch-recording" });
    const canvas = element("canvas", { role: "img", "aria-label": "input spikes: a line per channel, time to the right" });
    const [bars, meter] = [element("ul", { className: "evidence", "aria-label": "evidence" }), element("p")];
    const [said, why] = [element("p", { role: "status" }), element("small", { role: "status" })];
    const ask = button("play a touch", () => load().then(() => play(0)), { id: "touch" });
    const body = element("div", { hidden: true }, select, " ", button("next", () => play((chosen + 1) % known.recordings.length), { id: "touch-next" }), " ",
      button("to the end", end, { id: "touch-end" }), canvas, bars, meter, said);
    const node = element("div", { className: "touch" }, ask, body, why);

    async function load() {
      const [of, turn] = [key, asked += 1];
      const [trial, point] = of.split(".");
      const found = shown.page.touches ?? await Details.ask("touch.json", { trial, point });
      const design = found.designs?.[of] ?? found;
      const made = design.why ? design : await machine(design, found.inputs).catch(() => ({ why: "This browser runs no WebAssembly." }));
      if (turn === asked) known = made;
    }

    function play(k) {
      if (!known || known.why) return told();
      [chosen, run, start] = [k, known.run(k), performance.now()];
      Dom.fill(select, known.recordings.map(({ name }, at) => [at, clip(name, 40)]), k);
      told();
      Figure.brush(canvas, [WIDTH, HEIGHT]);
      if (matchMedia("(prefers-reduced-motion: reduce)").matches) end();
      else requestAnimationFrame(tick);
    }
    function tick(now) {
      if (!run || run.isOver) return;
      upTo((now - start) / known.design.step_ms);
      requestAnimationFrame(tick);
    }
    function end() {
      if (run) upTo(Infinity);
    }

    function upTo(until) {
      const brush = canvas.getContext("2d");
      brush.fillStyle = app.style().text;
      const line = HEIGHT / known.design.n_channels;
      while (run.step < until && !run.isOver) {
        const x = run.share() * WIDTH;
        for (const channel of run.advance()) brush.fillRect(x, channel * line, 1, Math.max(1, line));
      }
      draw();
      if (run.isOver) told();
    }

    function draw() {
      const { design } = known;
      const evidence = run.evidence();
      const most = Math.max(1, ...evidence);
      bars.replaceChildren(...evidence.map((count, label) => {
        const bar = element("i");
        bar.style.width = `${(50 * count) / most}%`;
        return element("li", {}, element("span", { textContent: clip(design.classes[label], 24) }), bar, number(count));
      }));
      const steps = run.isOver ? run.steps() : Math.round((run.step * design.step_ms) / design.network_ms);
      const { hardware, pace } = shown.state;
      const energy = design.energy[chosen]?.[hardware]?.[pace]?.[steps - 1];
      meter.textContent = `${number(steps * design.network_ms)}\u00a0ms${energy === undefined ? "" : ` · ${app.sized("energy_uj", energy)} by counted operations`}`;
    }

    function told() {
      const isKnown = Boolean(known && !known.why);
      body.hidden = !isKnown;
      ask.textContent = isKnown ? "play it again" : "play a touch";
      why.textContent = known?.why ?? "";
      said.textContent = "";
      if (!isKnown || !run?.isOver) return;
      const { true: meant } = known.recordings[chosen];
      const [name, truth] = [run.label, meant].map((label) => (label < 0 ? "no class" : clip(known.design.classes[label], 40)));
      const time = run.steps() * known.design.network_ms;
      said.textContent = `${name} after ${number(time)}\u00a0ms${meant < 0 ? "" : run.label === meant ? ": right" : `: wrong, it is ${truth}`}`;
      Object.assign(node.dataset, { recording: chosen, label: run.label, time }); // for other scripts
    }

    // The player of the design that the page is about, for its card; null where the page plays nothing.
    return (next) => {
      shown = next;
      const { page, subject } = next;
      if (!(page.touches || Details.isServed(page)) || !/^\d+\.\d+$/.test(subject.key)) return null;
      if (subject.key !== key) {
        [key, known, run, asked] = [subject.key, null, null, asked + 1];
        told();
      }
      ask.hidden = Boolean(page.touches) && !Object.hasOwn(page.touches.designs, key);
      if (ask.hidden) why.textContent = "This file plays the designs that its cards showed first.";
      return node;
    };
  }

  return { player };
})();
