"use strict";
// The chart: designs over two columns, the front that joins the best, the pick, and limits that are dragged on it. A canvas
// has the points, of which twenty thousand follow a limit; what is written and what is dragged lies over it.
Views.front = (() => {
  const [LEFT, RIGHT, TOP, BELOW] = Figure.EDGES; // px beside the axes
  const ROOM = 0.03; // share of an axis beside its outermost values
  const NEAR_PX = 16; // how far from a point a pointer means it
  const FLY_MS = 450; // from one chip to another
  const HOVER_CHARACTERS = 60;
  const LEVELS = 32; // of colour
  const { element, svg } = Dom;
  const [OUTSIDE, LEFT_OUT, WITHIN, JOINED] = [0, 1, 2, 3]; // points: beyond a limit, left out, within, on the front

  function view(root, app) {
    const { number, clip, title, sized } = app;
    const [plane, plot, canvas, ring, tip, dial, caption] = Dom.parts(root, "#plane", "#plot", "#cloud", "#ring", "#tip", "#dial", "#caption");
    const [overlay, picture, walker, reached] = Dom.parts(root, "svg", "[role=img]", ".walker", ".unseen");
    let shown = null;
    let drawn = null; // {axes, points: rows, x, y: pixels, size, kinds, line: rows of the front}
    let look = null;

    // ---- places

    const names = () => [shown.state.x, shown.state.y];
    function axesOf(points, size) {
      return names().map((column, k) => {
        const values = app.numbers(column);
        const [low, high] = points.length ? Data.ends(points.map((row) => values[row])) : [0, 1];
        const log = shown.state[`l${"xy"[k]}`] === "1" && low > 0;
        const words = app.isNumeric(column) ? [] : app.categories(column).map((name) => clip(name, 24));
        return { ...Figure.placed((most) => Data.axis(low, high, { log, names: words, number, room: ROOM, most }), k, size), column };
      });
    }

    const placed = Data.remembering((rows, xs, ys, _x, _y, _lx, _ly, ...size) => {
      const points = rows.filter((row) => !Number.isNaN(xs[row]) && !Number.isNaN(ys[row]));
      const axes = axesOf(points, size);
      const [x, y] = [xs, ys].map((values, k) => Float32Array.from(points, (row) => axes[k].to(values[row])));
      return { size, points, axes, x, y };
    });
    function place(size) {
      const [xs, ys] = names().map(app.numbers);
      drawn = placed(shown.rows, xs, ys, ...names(), shown.state.lx, shown.state.ly, ...size);
      const line = new Set(shown.joined(names()) ?? []);
      drawn.kinds = Uint8Array.from(drawn.points, (row) => (shown.leftOut(row) ? LEFT_OUT : !shown.within(row) ? OUTSIDE : line.has(row) ? JOINED : WITHIN));
      drawn.line = drawn.points.filter((row) => line.has(row)).sort((a, b) => xs[a] - xs[b] || ys[a] - ys[b]);
      drawn.shape = app.shape(climbed(), drawn.axes, () => drawn.points.filter((_, k) => drawn.kinds[k] !== LEFT_OUT));
    }

    // ---- colours

    // What paints points: {of(row), names: [[name, colour]]}, or {of(row), scale} of a column of numbers.
    let tint = null;
    const tinted = Data.remembering((column, rows, _dark) => {
      if (!column) return { of: () => look.palette[0], names: [] };
      const values = app.numbers(column);
      const words = app.categories(column);
      if (words.length) {
        const most = look.palette.length - (words.length > look.palette.length ? 1 : 0);
        const of = (row) => (values[row] < most ? look.palette[values[row]] : look.quiet);
        return { of, names: [...words.slice(0, most).map((name, k) => [column === "family" ? app.familyName(name) : name, look.palette[k]]), ...(words.length > most
          ? [["others", look.quiet]] : [])] };
      }
      const stops = look.dark ? Figure.STOPS.slice(2) : Figure.STOPS.slice(0, -1); // the ends vanish on dark and on white
      const known = rows.map((row) => values[row]).filter(Number.isFinite);
      if (!known.length) return { of: () => look.quiet, names: [] };
      const [low, high] = Data.ends(known);
      const { share } = Data.axis(low, high, { log: Data.spansDecades(low, high) });
      const levels = Array.from({ length: LEVELS + 1 }, (_, k) => Figure.shade(k / LEVELS, stops));
      const of = (row) => (Number.isFinite(values[row]) ? levels[Math.round(LEVELS * share(values[row]))] : look.quiet);
      return { of, names: [], scale: { low, high, levels } };
    });

    // ---- the canvas

    let flight = null; // {from: places by key, at}: of the points of another chip
    function flown(k, share) {
      const before = flight?.from.get(app.keyOf(drawn.points[k]));
      return before ? [before[0] + share * (drawn.x[k] - before[0]), before[1] + share * (drawn.y[k] - before[1])] : [drawn.x[k], drawn.y[k]];
    }

    function paint() {
      if (!drawn) return;
      const { points, kinds, size } = drawn;
      const brush = Figure.brush(canvas, size);
      const share = flight ? Math.min(1, (performance.now() - flight.at) / FLY_MS) : 1;
      if (share === 1) flight = null;
      const ofKind = [[], [], [], []];
      for (let k = 0; k < points.length; k += 1) ofKind[kinds[k]].push(k);
      const thin = (kind, alpha) => Math.max(0.08, alpha * Math.min(1, Math.sqrt(1000 / ofKind[kind].length)));
      for (const [kind, half, alpha] of [[OUTSIDE, 2, thin(OUTSIDE, 0.25)], [LEFT_OUT, 3, thin(LEFT_OUT, 0.5)], [WITHIN, 2.5, thin(WITHIN, 0.45)], [JOINED, 4.5, 1]]) {
        brush.fillStyle = brush.strokeStyle = look.quiet;
        brush.globalAlpha = alpha;
        for (const k of ofKind[kind]) {
          const [x, y] = flight ? flown(k, share) : [drawn.x[k], drawn.y[k]];
          if (kind >= WITHIN) brush.fillStyle = tint.of(points[k]);
          if (kind === JOINED) {
            brush.globalAlpha = certainty(points[k]);
            brush.beginPath();
            brush.arc(x, y, half, 0, 7);
            brush.fill();
          } else if (kind === LEFT_OUT) brush.strokeRect(x - half, y - half, 2 * half, 2 * half);
          else brush.fillRect(x - half, y - half, 2 * half, 2 * half);
        }
      }
      if (flight) requestAnimationFrame(paint);
    }

    // A point that stays on the front in few samples looks less certain.
    function certainty(row) {
      const share = (shown.columns.front_probability ?? shown.columns.front_share)?.values[row];
      return typeof share === "number" ? 0.25 + 0.75 * share : 1;
    }

    // ---- what lies over it

    // {name, at, symbol}: what is marked, the pick last.
    function marks() {
      const { budgeted, chosen, subject, ghost } = shown;
      const at = (row) => app.point(app.keyOf(row));
      return [
        ...(ghost >= 0 && ghost !== subject.row ? [{ name: "before", at: at(ghost), symbol: "ghost" }] : []),
        ...(chosen && budgeted.pick >= 0 && budgeted.pick !== chosen.row ? [{ name: "pick", at: at(budgeted.pick), symbol: "diamond" }] : []),
        ...(subject.key ? [{ name: chosen ? "your choice" : budgeted.pick >= 0 ? "your pick" : "nearest", at: subject, symbol: chosen ? "circle" : "diamond" }] : []),
      ].map((one) => ({ ...one, value: names().map((column) => app.placed(column, one.at.value(column))) })).filter(({ value }) => value.every(Number.isFinite));
    }

    const SHAPES = { diamond: "M0 -11L11 0L0 11L-11 0Z", circle: "M9 0A9 9 0 1 1 -9 0A9 9 0 1 1 9 0Z", ghost: "M0 -11L11 0L0 11L-11 0Z" };
    function markNode({ name, value, symbol }, words = name) {
      const [x, y] = value.map((one, k) => drawn.axes[k].to(one));
      const isRight = x > drawn.size[0] * 0.7;
      return svg("g", { class: `mark ${symbol}`, transform: `translate(${x.toFixed(1)} ${y.toFixed(1)})` },
        svg("path", { d: SHAPES[symbol], fill: "none", stroke: look.text, "stroke-width": 2, "stroke-dasharray": symbol === "ghost" ? "3 3" : undefined }),
        svg("text", { x: isRight ? -14 : 14, y: symbol === "ghost" ? 18 : -8, "text-anchor": isRight ? "end" : "start", fill: look.text, stroke: look.page, "stroke-width": 3,
          "paint-order": "stroke", "font-weight": symbol === "ghost" ? 400 : 600, text: words }));
    }

    // The error of what the pick is compared with: a band, in which all are as good.
    function band() {
      const { budgeted: { best }, page, state } = shown;
      const gain = page.budgets.maximise;
      const se = app.known(gain, best)?.below;
      const value = best >= 0 && app.trusts(gain).includes(state.y) ? shown.columns[state.y].values[best] : null;
      if (!se || value === null) return [];
      const [top, foot] = [value, value - se].map(drawn.axes[1].to);
      return [svg("rect", { class: "band", x: LEFT, width: drawn.size[0] - LEFT - RIGHT, y: top, height: Math.max(1, foot - top), fill: look.quiet, opacity: 0.13 },
        svg("title", { text: "as good within the error of the best" }))];
    }

    // Published designs, on data of their own.
    function cited() {
      const known = shown.page.marks.map((one) => ({ ...one, value: names().map((column) => one.values[app.measuredOf(column)]) }))
        .filter(({ task, value }) => (!task || task === shown.state.task) && value.every(Number.isFinite));
      return known.map(({ name, caption, value }) => svg("g", { class: "cited", transform: `translate(${value.map((one, k) => drawn.axes[k].to(one).toFixed(1)).join(" ")})` },
        svg("path", { d: "M-5 -5L5 5M-5 5L5 -5", stroke: look.quiet, "stroke-width": 2 }), svg("title", { text: `${clip(name, 60)}: ${clip(caption, 120)}` })));
    }

    function spotOf({ clientX, clientY }) {
      const { left, top } = plane.getBoundingClientRect();
      return [clientX - left, clientY - top];
    }
    const spot = (row) => names().map((column, k) => drawn.axes[k].to(app.numbers(column)[row]));
    // The front from its cheap end, as x has it.
    const climbed = () => (app.wayOf(shown.state.x) === "min" ? drawn.line : [...drawn.line].reverse());

    function staircase() {
      const d = Figure.stairs(climbed().map(spot));
      return d ? [svg("path", { class: "joined", d, fill: "none", stroke: shown.colour ? look.text : look.palette[0], "stroke-width": 1.5 })] : [];
    }

    // ---- limits: lines that are dragged, with a handle for the keyboard

    const limited = () => names().map((column, k) => ({ column, k, way: shown.page.budgets.columns[column], range: shown.budgeted.ranges[column] }))
      .filter(({ column, way, range }) => way && range && range[0] < range[1] && app.isNumeric(column))
      .map((one) => ({ ...one, steps: Budgets.scale(one.range, one.way) }));
    const handles = new Map(); // by column: a drag or the focus survives what is drawn anew
    function handle({ column, k, way, range, steps }) {
      const [width, height] = drawn.size;
      const axis = drawn.axes[k];
      const text = shown.state[`b.${column}`];
      const loose = way === "min" ? range[1] : range[0];
      const value = text === "" ? loose : Math.min(Math.max(Number(text), axis.value(0)), axis.value(1));
      const at = axis.to(value);
      if (!handles.has(column)) {
        handles.set(column, svg("g", { tabindex: 0, role: "slider", "data-column": column, on: { pointerdown: (event) => grab(event, column), pointermove: (event) => drag(event, column), keydown: (event) => step(event, column) } }));
      }
      const node = handles.get(column);
      const { label, unit } = shown.columns[column];
      const said = `${label} ${way === "max" ? "at least" : "at most"}`;
      for (const [name, value_] of Object.entries({
        class: `limit ${text === "" ? "free" : "set"} ${k ? "across" : "upright"}`, "aria-label": `${said}${unit ? `, ${unit}` : ""}`, "aria-valuemin": 0, "aria-valuemax": Budgets.STEPS,
        "aria-valuenow": steps.step(text), "aria-valuetext": text === "" ? "no limit" : sized(column, Number(text)),
      })) node.setAttribute(name, value_);
      const beyond = k ? { x: LEFT, width: width - LEFT - RIGHT, ...(way === "max" ? { y: at, height: Math.max(0, height - BELOW - at) } : { y: TOP, height: Math.max(0, at - TOP) }) }
        : { y: TOP, height: height - TOP - BELOW, ...(way === "min" ? { x: at, width: Math.max(0, width - RIGHT - at) } : { x: LEFT, width: Math.max(0, at - LEFT) }) };
      const grip = k ? { x: LEFT + 2, y: at - 12 } : { x: at - 12, y: height - BELOW - 25 }; // the ticks stay free
      node.replaceChildren(svg("rect", { class: "beyond", ...beyond, fill: look.quiet, opacity: text === "" ? 0 : 0.1 }),
        svg("path", { d: k ? `M${LEFT} ${at}H${width - RIGHT}` : `M${at} ${TOP}V${height - BELOW}`, stroke: look.focus, "stroke-width": text === "" ? 1 : 2,
          "stroke-dasharray": text === "" ? "2 4" : undefined }),
        svg("rect", { class: "grip", ...grip, width: 24, height: 24, rx: 12, fill: look.page, stroke: look.focus, "stroke-width": 2 }),
        svg("text", { x: grip.x + 12, y: grip.y + 17, "text-anchor": "middle", fill: look.focus, "aria-hidden": "true", text: k ? "↕" : "↔" }),
        ...(text === "" ? [] : [svg("text", { x: k ? width - RIGHT - 32 : at < width / 2 ? at + 8 : at - 8, y: k ? at - 6 : TOP + 14, "text-anchor": !k && at < width / 2
          ? "start" : "end", fill: look.text, stroke: look.page, "stroke-width": 3, "paint-order": "stroke", "font-weight": 600, text: `${said} ${sized(column, Number(text))}` })]));
      return node;
    }

    const find = (column) => limited().find((one) => one.column === column);
    const put = (column, text) => { if (text !== shown.state[`b.${column}`]) app.change({ [`b.${column}`]: text }); };
    function grab(event, column) {
      if (event.button !== 0) return;
      event.preventDefault();
      handles.get(column).focus({ preventScroll: true });
      handles.get(column).setPointerCapture(event.pointerId);
    }
    function drag(event, column) {
      if (!handles.get(column).hasPointerCapture(event.pointerId)) return;
      const { k, steps } = find(column);
      put(column, steps.limit(steps.step(String(drawn.axes[k].from(spotOf(event)[k])))));
    }
    function step(event, column) {
      const by = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1, PageUp: 10, PageDown: -10, Home: -Budgets.STEPS, End: Budgets.STEPS }[event.key];
      if (by === undefined) return;
      event.preventDefault();
      const { steps } = find(column);
      put(column, steps.limit(Math.min(Budgets.STEPS, Math.max(0, steps.step(shown.state[`b.${column}`]) + by))));
    }

    // ---- the trust dial: what is drawn of an accuracy

    const TRUST = [["", "as validated"], ["_corrected", "corrected for luck"], ["_test", "on the test recordings"], ["_shifted", "where a touch has moved"], ["_unseen", "of unseen groups"]];
    function renderDial() {
      const gain = shown.page.budgets.maximise ?? "";
      const known = app.trusts(gain);
      dial.hidden = known.length < 2;
      const slider = dial.querySelector("input");
      slider.max = known.length - 1;
      slider.value = Math.max(0, known.indexOf(shown.state.y));
      const words = known.includes(shown.state.y) ? TRUST.find(([end]) => `${gain}${end}` === shown.state.y)[1] : "not drawn";
      dial.querySelector("output").textContent = words;
      slider.setAttribute("aria-valuetext", words);
      slider.oninput = () => app.change({ y: known[Number(slider.value)] });
    }

    // ---- pointing

    function hoverText(row) {
      const { columns, objectives, page } = shown;
      const reason = shown.leftOut(row);
      const lines = page.design.filter((column) => columns[column].values[row] !== null).map((column) => `${title(column)}  ${number(columns[column].values[row])}`);
      const measured = app.beside([...objectives, ...names()]).filter((column) => !page.design.includes(column));
      return [...(reason ? [reason] : []), ...lines, ...measured.map((column) => `${title(column)}  ${app.withInterval(column, row)}`)].map((line) => clip(line, HOVER_CHARACTERS));
    }

    function nearest(event) {
      const [px, py] = spotOf(event);
      let [best, least] = [-1, NEAR_PX ** 2];
      for (let k = 0; k < drawn.points.length; k += 1) {
        // Of points on the same spot, one on the front is meant.
        const distance = (drawn.x[k] - px) ** 2 + (drawn.y[k] - py) ** 2 + (drawn.kinds[k] === JOINED ? 0 : 4);
        if (distance < least) [best, least] = [k, distance];
      }
      return best;
    }

    function showTip(k, lines) {
      tip.hidden = k < 0;
      if (k < 0) return;
      tip.replaceChildren(...(lines ?? hoverText(drawn.points[k])).map((text) => element("div", { textContent: text })));
      const [[width, height], x] = [drawn.size, drawn.x[k]];
      const top = Math.max(0, Math.min(drawn.y[k] - 16, height - tip.offsetHeight));
      Object.assign(tip.style, { top: `${top}px`, left: x > width / 2 ? "" : `${x + 12}px`, right: x > width / 2 ? `${width - x + 12}px` : "" });
    }

    let [pointed, pressed] = [-1, null];
    plane.addEventListener("pointermove", (event) => {
      if (!drawn || event.buttons || event.target.closest?.(".limit")) return;
      const k = nearest(event);
      if (k === pointed) return;
      pointed = k;
      showTip(k);
      app.hover(k < 0 ? null : app.keyOf(drawn.points[k]));
    });
    plane.addEventListener("pointerleave", leave);
    plane.addEventListener("pointerdown", (event) => { pressed = event.target.closest(".limit") ? null : [event.clientX, event.clientY]; });
    plane.addEventListener("click", (event) => {
      if (!drawn || !pressed || Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) > 4) return;
      const k = nearest(event);
      if (k >= 0) app.change({ chosen: app.keyOf(drawn.points[k]) });
    });

    // ---- walking: arrow keys go along the front, and what is reached is read out

    for (const [event, heard] of Object.entries({ keydown: walk, focus: () => reach(walked), blur: leave })) walker.addEventListener(event, heard);
    let walked = null; // the key of the point that was reached
    const path = () => (drawn.line.length ? drawn.line : drawn.points.filter((row) => shown.onFront.has(row)));

    // Goes to a point of the front, or, where there is none of this key, to that which the page is about, or to the first.
    function reach(key) {
      const rows = path();
      const row = [key, shown.subject.key].filter((one) => one !== null).map(app.rowOf).find((one) => rows.includes(one)) ?? rows[0];
      if (row === undefined) return;
      walked = app.keyOf(row);
      const told = [...new Set([app.headline(), shown.state.y, shown.state.x])].filter(Boolean).map((column) =>
        `${shown.columns[column].label} ${app.withInterval(column, row)} ${shown.columns[column].unit}`.trim());
      const name = clip(app.nameOf(row), 40);
      showTip(drawn.points.indexOf(row), [name, ...told]); // few lines: more would hide the front
      app.hover(walked);
      reached.textContent = `${name}: ${told.join(", ")}; ${rows.indexOf(row) + 1} of ${rows.length}`;
    }

    function walk(event) {
      const rows = path();
      const at = rows.indexOf(app.rowOf(walked));
      const to = { ArrowLeft: Math.max(0, at - 1), ArrowRight: Math.min(rows.length - 1, at + 1), Home: 0, End: rows.length - 1 }[event.key];
      if (event.key === "Enter" && at >= 0) app.change(shown.state.chosen === walked ? { show: "inside" } : { chosen: walked });
      else if (to !== undefined && rows.length) reach(app.keyOf(rows[to]));
      else return;
      event.preventDefault();
    }

    function leave() {
      pointed = -1;
      tip.hidden = true;
      app.hover(null);
    }

    function hover(key) {
      const k = key === null || !drawn ? -1 : drawn.points.indexOf(app.rowOf(key));
      ring.hidden = k < 0;
      if (k >= 0) ring.style.transform = `translate(${drawn.x[k] - 9}px, ${drawn.y[k] - 9}px)`;
    }

    // ---- drawing

    // Points as nodes: of a picture that is kept, and on paper, where canvases stay empty.
    function pointNodes() {
      return drawn.points.map((row, k) => {
        const kind = drawn.kinds[k];
        const fill = kind >= WITHIN ? tint.of(row) : look.quiet;
        return svg("circle", { class: "point", cx: drawn.x[k].toFixed(1), cy: drawn.y[k].toFixed(1), r: kind === JOINED ? 4.5 : 2.5, fill, opacity: kind === JOINED ? 1
          : kind === WITHIN ? 0.35 : 0.15 });
      });
    }

    function nodes(whole) {
      const { subject, ghost } = shown;
      const words = ({ name, symbol }) => (symbol === "ghost" ? ["before; now", ...app.differences(subject, app.point(app.keyOf(ghost)), [app.costOf()])].join(" ") : name);
      const empty = drawn.points.length ? [] : [svg("text", { x: drawn.size[0] / 2, y: drawn.size[1] / 2, "text-anchor": "middle", fill: look.quiet, "font-size": 16,
        text: shown.budgeted.noneFits ? `No design fits ${clip(shown.state.hardware ? app.chipName(shown.state.hardware) : "the chip", 40)}` : "No point has both numbers" })];
      return [...Figure.frame(drawn.axes, names().map((column) => clip(title(column), 60)), drawn.size, look), ...band(), ...(whole ? pointNodes() : []), ...staircase(), ...Figure.shaped(drawn.shape, spot, look), ...cited(), ...marks().map((one) => markNode(one, words(one))), ...empty];
    }

    function describe() {
      const labels = names().map((column) => shown.columns[column].label);
      const ranges = drawn.line.length ? names().map((column) => {
        const [low, high] = Data.ends(drawn.line.map((row) => app.numbers(column)[row]));
        return `${title(column)} ${number(low)} to ${number(high)}`;
      }).join(", ") : "nothing is within the limits";
      picture.setAttribute("aria-label", `${labels.join(" against ")}: ${app.many(drawn.line.length)} points on the front, ${ranges}. The tables below hold the numbers.`);
      const { names: words, scale } = tint;
      const square = (background) => element("span", { className: "key", style: { background } });
      const { budgeted } = shown;
      const reason = budgeted.misfits.length ? `${app.many(budgeted.misfits.reduce((sum, row) => sum + budgeted.weight(row), 0))} settings ${budgeted.isUnable(budgeted.misfits[0]) ? "cannot run on" : "do not fit"} ${clip(shown.state.hardware ? app.chipName(shown.state.hardware) : "the chip", 40)}` : "";
      caption.replaceChildren(...words.map(([name, colour]) => element("span", {}, square(colour), ` ${clip(name, 32)}`)),
        ...(scale ? [element("span", {}, `${title(shown.colour)}: ${number(scale.low)} `, ...scale.levels.filter((_, k) => k % 4 === 0).map(square), ` ${number(scale.high)}`)] : []),
        ...(cited().length ? [element("span", { textContent: "× published, on its own data" })] : []), ...(reason ? [element("span", { id: "misfits", textContent: reason })] : []));
    }

    function draw() {
      const size = [plane.clientWidth, plane.clientHeight];
      if (!shown || !size[0]) return;
      look = app.style();
      tint = tinted(shown.colour, shown.rows, look.dark);
      place(size);
      for (const [name, value] of [["width", size[0]], ["height", size[1]], ["viewBox", `0 0 ${size.join(" ")}`]]) overlay.setAttribute(name, value);
      paint();
      picture.replaceChildren(...nodes(look.paper));
      for (const [name, value] of [["x", LEFT], ["y", TOP], ["width", size[0] - LEFT - RIGHT], ["height", size[1] - TOP - BELOW]]) walker.firstChild.setAttribute(name, value);
      const held = look.paper ? [] : [walker, ...limited().map(handle)];
      if (overlay.children.length - 1 !== held.length || held.some((node, k) => overlay.children[k + 1] !== node)) overlay.replaceChildren(picture, ...held);
      if (!shown.moving) describe();
      plot.drawn = { axes: drawn.axes, line: drawn.line, marks: marks(), points: drawn.points }; // for other scripts
    }
    new ResizeObserver(() => { if (shown && String(drawn?.size) !== String([plane.clientWidth, plane.clientHeight])) draw(); }).observe(plane);

    function render(next) {
      // From one chip to another the same designs fly to their other prices.
      if (shown && shown.page === next.page && shown.state.hardware !== next.state.hardware && drawn && !matchMedia("(prefers-reduced-motion: reduce)").matches) {
        flight = { from: new Map(drawn.points.map((row, k) => [app.keyOf(row), [drawn.x[k], drawn.y[k]]])), at: performance.now() };
      }
      shown = next;
      ring.hidden = tip.hidden = true;
      pointed = -1;
      renderDial();
      draw();
      if (document.activeElement === walker) reach(walked);
    }

    async function image(format) {
      look = Figure.print(shown.page.palette);
      tint = tinted(shown.colour, shown.rows, look.dark);
      const [width, height] = drawn.size;
      const whole = svg("svg", { xmlns: "http://www.w3.org/2000/svg", width, height, viewBox: `0 0 ${width} ${height}`, "font-family": "sans-serif", "font-size": 12 },
        svg("rect", { width, height, fill: look.page }), ...nodes(true));
      const text = new XMLSerializer().serializeToString(whole);
      draw();
      return Figure.saved(text, [width, height], format);
    }

    const listed = () => shown.rows.filter(shown.within);

    return { render, hover, image, listed };
  }

  return { view, tabs: ["always"] };
})();
