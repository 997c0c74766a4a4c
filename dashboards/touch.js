"use strict";
// A touch, played: the design's own module (target wasm) takes the input spikes of a recording that was held back, or samples of
// the reader's own, step by step in their time, and answers when it decides. Nothing here computes a network.
const Touch = (() => {
  const [WIDTH, HEIGHT] = [240, 96]; // px of what goes in
  const UNDECIDED = -1;
  const BAUD = 115200; // of the exported sketch, too; page.html names it
  const PAGE = 65536; // bytes of a module's memory
  const { element } = Dom;

  // A design beside its recordings: `run(source)` begins one and returns what takes its steps.
  async function machine(design, inputs) {
    const { exports } = (await WebAssembly.instantiate(Data.array(design.module, Uint8Array))).instance;
    const call = (name, ...values) => exports[`${design.prefix}${name}`](exports[`${design.prefix}net`].value, ...values);
    const { n = 0, whole = false, at = "start", onset = 0, cut = 0, every = 0 } = design.samples ?? {};
    const recordings = inputs[design.input].map((one, k) => {
      const channels = Data.array(one.channels, Uint16Array);
      let from = 0;
      return { ...one, energy: design.energy[k], ends: [design.n_channels - 1, 0], steps: Array.from(Data.array(one.counts, Uint16Array), (count) => channels.subarray(from, from += count)) };
    });
    const { memory, __heap_base: { value: free } } = exports; // a sample lies where the module has nothing
    memory.grow(Math.ceil((4 * n) / PAGE));
    const sample = new (whole ? Int32Array : Float32Array)(memory.buffer, free, n);

    function push(values, isOwn) {
      if (!isOwn) return values.forEach((channel) => call("push_spike", channel));
      sample.set(values);
      return call("push", free);
    }

    // Windows begin as in the exported program and sketch: at a step of a recording or at contacts. A live source goes on, in
    // recordings of `cut` steps, or in one; any other ends with its first answer.
    function run(source) {
      const { steps, isOwn = false, isLive = false } = source;
      const length = isLive ? cut : steps.length;
      const first = isOwn && at === "middle" ? Math.max(0, Math.floor((length - design.n_steps) / 2)) : 0;
      const isAtContact = isOwn && at === "contact_onset";
      const now = { source, step: 0, begins: false, isOpen: false, isOver: false, answer: null, steps: 0, evidence: [] };
      let [rest, wasTouched, isAnswered] = [null, false, false];
      return Object.assign(now, {
        due: (elapsed) => (isLive ? steps.length : elapsed - now.step), // steps to take now
        advance() {
          const values = isLive ? steps.shift() : steps[now.step];
          if (now.step === 0) {
            call("init");
            [rest, wasTouched, isAnswered, now.isOpen] = [values, false, false, false];
          }
          push(values, isOwn);
          call("step");
          const isTouched = isAtContact && values.some((value, k) => Math.abs(Math.fround(value - rest[k])) >= onset);
          now.begins = !now.isOpen && !isAnswered && now.step >= first && (isTouched || !isAtContact) && !wasTouched;
          now.isOpen ||= now.begins;
          [wasTouched, now.step] = [isTouched, now.step + 1];
          if (now.isOpen) {
            now.steps = call("steps");
            now.evidence = design.first === null ? [] : design.classes.map((_, label) => call("count", design.first + label));
            const label = call("decision");
            if (label !== UNDECIDED) [now.answer, now.isOpen, isAnswered] = [{ label, steps: now.steps }, false, length > 0];
          }
          if (now.step === length) [now.isOpen, isAnswered] = [false, true];
          if (!now.isOpen) call("reset");
          if (isLive && now.step === every) now.step = 0;
          now.isOver = !isLive && isAnswered;
          return values;
        },
      });
    }
    return { design, recordings, run };
  }

  function player(app) {
    const { number, clip } = app;
    let shown = null;
    let [key, known, asked] = ["", null, 0]; // the design that is played: {why} or a machine, null until it is asked for
    let [run, note, listening] = [null, "", null]; // listening: what ends it, while a port is open
    let [painted, scale] = [0, ""]; // steps on the canvas, and the ends of what is drawn
    const node = document.getElementById("player").content.firstElementChild;
    const [ask, own, port, body, select, canvas] = Dom.parts(node, "#touch", "#touch-own", "#touch-port", "#touch-body", "select", "canvas");
    const [bars, meter, said, why] = Dom.parts(node, "ul", ".meter", "p[role]", "small");
    const [file, choose, next, toEnd] = Dom.parts(node, "input", "#touch-choose", "#touch-next", "#touch-end");
    ask.onclick = () => load().then(() => (known?.design ? begin(known.recordings[0]) : told()));
    select.onchange = () => begin(known.recordings[Number(select.value)]);
    next.onclick = () => begin(known.recordings[(known.recordings.indexOf(run.source) + 1) % known.recordings.length]);
    toEnd.onclick = () => take(run.due(Infinity));
    choose.onclick = () => file.click();
    file.onchange = () => read(file.files);
    port.onclick = () => (listening ? hush() : listen());
    node.ondragover = (event) => event.preventDefault();
    node.ondrop = (event) => {
      event.preventDefault();
      read(event.dataTransfer.files);
    };

    async function load() {
      if (known?.design) return;
      const [of, turn] = [key, asked += 1];
      const [trial, point] = of.split(".");
      const found = shown.page.touches ?? await Details.ask("touch.json", { trial, point });
      const design = found.designs?.[of] ?? found;
      const made = design.why ? design : await machine(design, found.inputs).catch(() => ({ why: "This browser runs no WebAssembly." }));
      if (turn === asked) known = made;
    }

    // ---- samples of the reader's own

    async function taking() {
      await load();
      if (!known?.design) throw new Error(known?.why ?? "another design was chosen meanwhile");
      if (!known.design.samples) throw new Error("this design takes spikes, which are made of samples elsewhere");
      return known;
    }

    async function read([chosen]) {
      if (!chosen) return;
      try {
        const taken = await taking();
        const { found, left } = await Samples.ofFile(chosen, taken.design.samples);
        if (taken !== known) return;
        known.recordings = [...known.recordings.filter(({ isOwn }) => !isOwn), ...found];
        begin(found[0]);
        note = left;
      } catch ({ message }) {
        note = `${clip(chosen.name, 40)}: ${message}`;
      }
      file.value = ""; // it can be chosen again
      told();
    }

    async function listen() {
      const { signal } = listening = new AbortController();
      let device = null;
      try {
        device = await navigator.serial.requestPort(); // first of all: a browser asks only right after a click
        const { design } = await taking();
        await device.open({ baudRate: BAUD });
        if (signal.aborted) return;
        const source = { ...Samples.recording("serial port"), isLive: true };
        begin(source);
        for await (const row of Samples.rows(device.readable, design.samples, signal)) {
          if (row) Samples.add(source, row);
          if (document.hidden && run?.source === source) take(run.due(Infinity)); // frames wait until the page is seen
        }
      } catch ({ message }) {
        note = message;
      } finally {
        if (!signal.aborted) hush();
        device?.close().catch(() => {}); // it may be lost, or was never open
      }
    }

    function hush() {
      listening?.abort();
      listening = null;
      if (run?.source.isLive) run.isOver = true;
      told();
    }

    // ---- playing

    function begin(source) {
      if (!source.isLive) hush();
      const [mine, start] = [known.run(source), performance.now()];
      [run, note, painted] = [mine, "", Infinity];
      Dom.fill(select, known.recordings.map(({ name }, at) => [at, clip(name, 40)]));
      select.value = known.recordings.indexOf(source);
      told();
      const tick = (now) => {
        if (run !== mine || run.isOver) return;
        take(run.due((now - start) / known.design.step_ms));
        requestAnimationFrame(tick);
      };
      if (!source.isLive && matchMedia("(prefers-reduced-motion: reduce)").matches) take(run.due(Infinity));
      else requestAnimationFrame(tick);
    }

    function take(most) {
      const before = run.answer;
      for (let k = 0; k < most && !run.isOver; k += 1) paint(run.advance());
      if (most > 0) draw();
      if (run.answer !== before || run.isOver) told();
    }

    // A step of what goes in; the canvas is emptied where a window begins, where it is full, and where values leave its scale.
    function paint(values) {
      const { source: { ends, isOwn }, begins } = run;
      const { n_steps: most, n_channels: n } = known.design;
      if (begins || painted >= most || scale !== String(ends)) {
        [painted, scale] = [0, String(ends)];
        Figure.brush(canvas, [WIDTH, HEIGHT]).fillStyle = app.style().text;
      }
      const [wide, high] = isOwn ? [Math.max(1, WIDTH / most), 1] : [1, Math.max(1, HEIGHT / n)];
      const share = (value) => (ends[1] - value) / (ends[1] - ends[0] || 1);
      for (const value of values) canvas.getContext("2d").fillRect((painted / most) * WIDTH, share(value) * (HEIGHT - high), wide, high);
      painted += 1;
    }

    function draw() {
      const { design } = known;
      const { evidence, steps, source } = run;
      const most = Math.max(1, ...evidence);
      bars.replaceChildren(...evidence.map((count, label) => element("li", {}, element("span", { textContent: clip(design.classes[label], 24) }),
        element("i", { style: { width: `${(50 * count) / most}%` } }), number(count))));
      const energy = source.energy?.[shown.state.hardware]?.[shown.state.pace]?.[steps - 1];
      meter.textContent = `${number(steps * design.network_ms)}\u00a0ms${energy === undefined ? "" : ` · ${app.sized("energy_uj", energy)} by counted operations`}`;
    }

    // What stands beside the controls, and which of them there are.
    function told() {
      const { touches } = shown.page;
      const design = known?.design ?? touches?.designs[key];
      ask.hidden = Boolean(touches && !design);
      ask.textContent = run ? "play it again" : "play a touch";
      own.hidden = ask.hidden || design?.samples === null;
      Object.assign(port, { hidden: !navigator.serial, textContent: listening ? "stop" : "serial port" });
      why.textContent = ask.hidden ? "This file plays the designs that its cards showed first." : note || known?.why || "";
      body.hidden = !run;
      said.textContent = run ? verdict(run) : "";
    }

    function verdict({ answer, isOver, steps, source }) {
      const { classes, n_steps: most, network_ms: ms } = known.design;
      if (!answer) return !isOver || source.isLive ? "" : steps ? `no answer: the samples end before the window, of ${number(most)} steps, does` : "no contact, so that no window begins";
      const [name, truth] = [answer.label, source.true].map((label) => (label < 0 ? "no class" : clip(classes[label], 40)));
      const time = answer.steps * ms;
      Object.assign(node.dataset, { recording: known.recordings.indexOf(source), label: answer.label, time }); // for other scripts
      return `${name} after ${number(time)}\u00a0ms${source.true < 0 ? "" : answer.label === source.true ? ": right" : `: wrong, it is ${truth}`}`;
    }

    // The player of the design that the page is about, for its card; null where the page plays nothing.
    return (next) => {
      shown = next;
      const { page, subject } = next;
      if (!(page.touches || Details.isServed(page)) || !/^\d+\.\d+$/.test(subject.key)) return null;
      if (subject.key !== key) {
        hush();
        [key, known, run, note, asked] = [subject.key, null, null, "", asked + 1];
        told();
      }
      return node;
    };
  }

  return { player };
})();
