"use strict";
// Parallel coordinates: an axis per budget, objective and parameter, a line per design; a brush on an axis is the
// budget of its column. Drawn here: plotly's parcoords takes 10 s for 10 000 lines in software, and its brush has two ends.
const Parallel = (() => {
  const MAX_AXES = 24; // that the page chooses itself
  const DIM_LINES = 2000; // beside the front's: more would hide it
  const MOVING_PIECES = 4000; // of lines between two axes, of the front and of the others each, while a budget moves
  const SETTLE_MS = 120; // after a budget moved, until every line is drawn again
  const FEW = 6; // values that are all written beside their axis
  const NEAR_PX = 8; // how far from a line a pointer means it
  const DRAG_PX = 4; // what is pressed and let go nearer than this is a click
  const [TOP, HEIGHT, BELOW, FOOT] = [56, 240, 24, 16]; // px: titles, axes, to the tick of missing values, below that
  const LEFT = 16; // px beside the first axis
  const [CHARACTER_PX, LEAST_RIGHT, MOST_RIGHT] = [6.4, 72, 168]; // of a label, and px beside the last axis, by its labels
  const GRID = 24; // values of an axis, at most, whose lines are spread around each
  const SPREAD_PX = 16; // over which they are
  const DASH = 16; // px: a line where there is one axis
  const LABEL_PX = 14; // height of a line of text
  const STEPS = Budgets.scale([0, 1], "min").step(""); // of a slider: a cost is free at the last
  const MOVES = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1, PageUp: 10, PageDown: -10, Home: -STEPS, End: STEPS };

  const { element } = Dom;

  // ---- pure: values in, places out; a share is 0 at the foot of an axis, 1 at its top and NaN where there is no value

  const isKnown = (value) => value !== null && value !== undefined;
  const inside = (share) => Math.min(1, Math.max(0, share));
  const { ends } = Data;
  const heightOf = (share) => TOP + (Number.isNaN(share) ? HEIGHT + BELOW : HEIGHT * (1 - share));

  // An axis over the values of some rows; what a slider reaches (`range`, or null) is on it too.
  function axisOf(values, range, number) {
    const distinct = [...new Set(values)];
    const known = distinct.filter(isKnown);
    const lacks = known.length < distinct.length;
    const numeric = known.length > 0 && known.every((value) => typeof value === "number");
    return { lacks, ...(numeric ? numericAxis(known, range ?? [], number) : wordAxis(known)) };
  }

  function numericAxis(known, range, number) {
    const [low, high] = ends([...known, ...range]);
    const log = low > 0 && high / low > 100;
    const along = (value) => (log ? Math.log(Math.max(value, low) / low) / Math.log(high / low) : (value - low) / (high - low));
    const share = (value) => (typeof value !== "number" ? NaN : low === high ? 0.5 : inside(along(value)));
    const value = (at) => (log ? low * (high / low) ** at : low + (high - low) * at);
    const sorted = [...known].sort((a, b) => a - b);
    const apart = sorted.every((v, k) => k === 0 || (share(v) - share(sorted[k - 1])) * HEIGHT >= LABEL_PX);
    const ticks = sorted.length <= FEW && apart ? sorted : log ? decades(low, high) : rounds(low, high);
    return { numeric: true, share, value, places: sorted.length > GRID ? null : sorted.map(share), ticks: ticks.map((at) => ({ share: share(at), text: number(at) })) };
  }

  function rounds(low, high) {
    const rough = (high - low) / 5;
    const unit = 10 ** Math.floor(Math.log10(rough));
    const step = unit * [1, 2, 5, 10].find((n) => n * unit >= rough * 0.999);
    const first = Math.ceil(low / step - 1e-9);
    const count = Math.floor(high / step + 1e-9) - first + 1;
    return Array.from({ length: count }, (_, k) => Number(((first + k) * step).toPrecision(12)));
  }

  function decades(low, high) {
    const [first, last] = [Math.ceil(Math.log10(low) - 1e-9), Math.floor(Math.log10(high) + 1e-9)];
    const step = Math.ceil((last - first + 1) / 8);
    return Array.from({ length: Math.floor((last - first) / step) + 1 }, (_, k) => Number(`1e${first + k * step}`));
  }

  function wordAxis(known) {
    const sorted = [...known].sort((a, b) => String(a).localeCompare(String(b), "en", { numeric: true }));
    const places = new Map(sorted.map((value, k) => [value, sorted.length > 1 ? k / (sorted.length - 1) : 0.5]));
    const step = Math.ceil((sorted.length * LABEL_PX) / HEIGHT);
    const words = (value) => (typeof value === "boolean" ? (value ? "yes" : "no") : String(value));
    const ticks = sorted.filter((_, k) => k % step === 0).map((value) => ({ share: places.get(value), text: words(value) }));
    return { numeric: false, share: (value) => places.get(value) ?? NaN, value: null, places: sorted.length > GRID ? null : [...places.values()], ticks };
  }

  // By how many px lines move off their places on a grid, so that where many meet they lie side by side, in the order
  // of `rank`, instead of in one knot. Shares in, offsets out.
  function spread(shares, places, rank) {
    const offsets = new Float32Array(shares.length);
    const apart = places.map((at, k) => (k ? (at - places[k - 1]) * HEIGHT : Infinity));
    const room = Math.min(SPREAD_PX, 0.6 * Math.min(...apart));
    const groups = new Map();
    shares.forEach((share, i) => {
      if (!groups.has(share)) groups.set(share, []); // NaN is a key like any other
      groups.get(share).push(i);
    });
    for (const members of groups.values()) {
      if (members.length < 2) continue;
      members.sort((a, b) => rank[a] - rank[b] || a - b).forEach((i, k) => { offsets[i] = room * (0.5 - k / (members.length - 1)); });
    }
    return offsets;
  }

  // Rows in an order that repeats and has no rhythm, so that its first n are an even sample of them, whatever grid
  // they come from, and a line that is drawn stays while budgets move.
  function shuffled(rows) {
    const rank = (row) => Math.imul(row + 1, 0x9e3779b1) >>> 0;
    return [...rows].sort((a, b) => rank(a) - rank(b));
  }

  // Where a name may break: after a space, a dot or a dash below.
  const pieces = (text) => text.split(/(?<=[\s._])/);

  // At most `lines` lines of n characters; what is longer ends in an ellipsis.
  function wrapped(text, n, lines) {
    const result = [""];
    for (const piece of pieces(text)) {
      for (let letters = [...piece]; letters.length; letters = letters.slice(n)) {
        const next = letters.slice(0, n).join("");
        const longer = result.at(-1) + next;
        if ([...longer.trimEnd()].length <= n) result[result.length - 1] = longer;
        else result.push(next);
      }
    }
    return result.length <= lines ? result : [...result.slice(0, lines - 1), `${[...result[lines - 1]].slice(0, n - 1).join("")}…`];
  }

  // What XML cannot hold, such as control characters, is shown as such.
  const inXML = (text) => text.replace(/[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\u{10000}-\u{10ffff}]/gu, "\ufffd");

  function view(root, app) {
    const { number, clip, title, many, plural, taskOf, colourOf } = app;
    const count = element("small");
    const [lines, marks] = [element("canvas", { className: "lines", role: "img" }), element("canvas", { className: "marks", "aria-hidden": "true" })];
    const frame = element("div", { className: "axes" });
    const plane = element("div", { className: "plane" }, lines, marks, frame);
    const scroll = Dom.scroll("Axes, which scroll sideways", plane);
    const caption = element("p", { className: "caption" });
    const onPaper = element("div");
    root.append(element("h2", { textContent: "Parallel coordinates " }, count), scroll, onPaper, caption);

    let shown = null;
    // Of the points and the filters: {page, key, turn, axes, unplaced: columns without one, order: rows, heights: px, tasks}.
    let made = null;
    let drawn = { front: [], dominated: [], outside: [], others: 0 }; // places in `made.order`
    let [look, painted, marking] = [null, "", []]; // colours, what the lines on the canvas stand for, marked designs
    let [width, gap, left] = [0, 0, 0]; // px: of the section, between axes, scrolled
    let pointed = -1;
    const nodes = new Map(); // of each column's axis: a drag or the focus survives new points

    // ---- what is drawn

    const directionOf = (column) => shown.page.objectives[column] ?? shown.page.budgets.columns[column];
    const named = (column) => `${{ max: "↑ ", min: "↓ " }[directionOf(column)] ?? ""}${title(column)}`;
    const across = (k) => LEFT + k * gap;

    function columnsShown() {
      const { page, columns, objectives, rows } = shown;
      const defined = (page.definition?.parallel ?? []).filter((column) => columns[column]);
      if (defined.length) return defined;
      const differs = (column) => new Set(rows.map((row) => columns[column].values[row])).size > 1;
      // An axis that whole families lack says little of the others: such a column is an axis where one family is shown.
      const families = [...new Set(rows.map((row) => columns.family?.values[row]))];
      const isGeneral = (column) => families.length < 2 || families.every((family) => rows.some((row) => columns.family.values[row] === family && isKnown(columns[column].values[row])));
      const parameters = page.design.filter((column) => column !== "trial" && differs(column) && isGeneral(column));
      const isMeasured = (column) => rows.some((row) => isKnown(columns[column].values[row]));
      return [...new Set([...Object.keys(page.budgets.columns).filter(isMeasured), ...objectives, ...parameters])];
    }

    // What the labels of the last axis need.
    function rightOf(axes) {
      const longest = Math.max(0, ...[...axes.at(-1)?.ticks ?? []].map(({ text }) => [...text].length));
      return Math.min(MOST_RIGHT, width / 3, Math.max(LEAST_RIGHT, Math.ceil(longest * CHARACTER_PX) + 20));
    }

    // Axes and the heights of lines on them last as long as the points and the filters do.
    function prepare() {
      const { page, state, columns, rows, budgeted } = shown;
      const key = JSON.stringify([state.task, state.family, state.hardware, state.left, budgeted.conditions]);
      if (made?.page === page && made.key === key) return false;
      const candidates = columnsShown();
      const limited = page.budgets.columns;
      const taken = page.definition?.parallel ? candidates : candidates.slice(0, MAX_AXES);
      const axes = taken.map((column) => {
        const range = Object.hasOwn(limited, column) ? budgeted.ranges[column] : null;
        const axis = axisOf(rows.map((row) => columns[column].values[row]), range, number);
        const steps = axis.numeric && range && range[0] < range[1] ? Budgets.scale(range, limited[column]) : null;
        return { column, way: limited[column], steps, ...axis };
      });
      const order = shuffled(rows);
      const heights = new Float32Array(order.length * axes.length);
      const first = shown.objectives[0];
      const rank = order.map((row) => (Number.isNaN(app.numbers(first)[row]) ? -Infinity : app.numbers(first)[row]));
      axes.forEach(({ column, share, places, lacks }, k) => {
        const { values } = columns[column];
        const shares = order.map((row) => share(values[row]));
        const offsets = places && column !== first && (places.length > 1 || lacks) ? spread(shares, places, rank) : null;
        shares.forEach((at, i) => { heights[i * axes.length + k] = heightOf(at) + (offsets?.[i] ?? 0); });
      });
      const placeOf = new Map(order.map((row, i) => [row, i]));
      const [turn, unplaced, tasks] = [(made?.turn ?? 0) + 1, candidates.length - axes.length, [...new Set(rows.map(taskOf))]];
      made = { page, key, turn, axes, unplaced, order, placeOf, heights, tasks, right: rightOf(axes) };
      return true;
    }

    function sample(most) {
      const places = { front: [], dominated: [], outside: [] };
      const kindOf = (row) => (shown.leftOut(row) || !shown.within(row) ? "outside" : shown.onFront.has(row) ? "front" : "dominated");
      made.order.forEach((row, i) => places[kindOf(row)].push(i));
      const others = places.dominated.length + places.outside.length;
      const share = Math.min(1, most / others);
      for (const kind of ["dominated", "outside"]) places[kind] = places[kind].slice(0, Math.round(places[kind].length * share));
      return { ...places, others };
    }

    // A few lines are drawn strong, many so that where they meet can be seen.
    const strength = (n, most, least, at) => Math.max(least, Math.min(most, at / Math.sqrt(n)));

    // Lines of one colour, from the back to the front: {kind, colour, alpha, places}.
    function layers(colours, { front, dominated, outside }) {
      const groups = [{ kind: "outside", colour: colours.quiet, alpha: strength(outside.length, 0.25, 0.05, 1.5), places: outside }];
      for (const [kind, places, alpha] of [
        ["dominated", dominated, strength(dominated.length, 0.3, 0.04, 1.5)], ["front", front, strength(front.length, 0.9, 0.2, 7)],
      ]) {
        for (const task of made.tasks) {
          const ofTask = made.tasks.length === 1 ? places : places.filter((i) => taskOf(made.order[i]) === task);
          groups.push({ kind, colour: colourOf(task, colours), alpha, places: ofTask });
        }
      }
      return groups;
    }

    // Heights of one point; of one that is no row of the page, null where nothing is known.
    function heightsOf({ row, value }) {
      const [place, n] = [made.placeOf.get(row), made.axes.length];
      if (place !== undefined) return [...made.heights.subarray(place * n, (place + 1) * n)];
      return made.axes.map(({ column, share }) => (row < 0 && !isKnown(value(column)) ? null : heightOf(share(value(column)))));
    }
    const pointAt = (row) => ({ row, value: (column) => shown.columns[column].values[row] });

    function marked(colours) {
      const { budgeted, chosen, compared } = shown;
      const best = budgeted.pick >= 0 ? budgeted.picks.map(({ row }) => row) : [budgeted.relaxed[0]?.row ?? budgeted.nearest[0]?.row ?? -1];
      const marks = compared.map((at, k) => ({ at, width: 1.5, dash: [], name: String(k + 1) }));
      const name = budgeted.pick >= 0 ? "pick" : "nearest";
      for (const row of budgeted.limits.length ? best.filter((one) => one >= 0) : []) marks.push({ at: pointAt(row), width: 2, dash: [6, 4], name });
      if (chosen) marks.push({ at: chosen, width: 2.5, dash: [], name: "chosen" });
      return marks.map((one) => ({ ...one, colour: colours.text, heights: heightsOf(one.at) }))
        .filter(({ heights }) => heights.some((y) => y !== null));
    }

    // ---- the canvases

    const wide = () => (made.axes.length > 1 ? across(made.axes.length - 1) : across(0)) + made.right;
    const sized = (canvas) => Object.assign(Figure.brush(canvas, [wide(), TOP + HEIGHT + BELOW + FOOT]), { lineJoin: "round" });

    // One path per colour; on a single axis a line is a dash. While a budget moves, only what is in sight is drawn.
    function paint() {
      const { moving, budgeted } = shown;
      const now = JSON.stringify([made.turn, moving, gap, moving && left, budgeted.limits, look.text, devicePixelRatio]);
      if (now === painted) return;
      painted = now;
      const n = made.axes.length;
      const inSight = [Math.max(0, Math.floor((left - LEFT) / gap)), Math.min(n - 1, Math.ceil((left + width) / gap))];
      const [first, last] = moving ? inSight : [0, n - 1];
      const most = moving ? Math.ceil(MOVING_PIECES / Math.max(1, last - first)) : Infinity;
      drawn = sample(Math.min(DIM_LINES, most));
      const brush = sized(lines);
      const { heights } = made;
      for (const { colour, alpha, places } of layers(look, drawn)) {
        brush.strokeStyle = colour;
        brush.globalAlpha = alpha;
        brush.lineWidth = 1 / (devicePixelRatio || 1); // hairs are drawn much faster than broad lines, and overlaps add up
        brush.beginPath();
        for (const i of places.length > most ? places.slice(0, most) : places) {
          brush.moveTo(LEFT + first * gap, heights[i * n + first]);
          for (let k = first + 1; k <= last; k += 1) brush.lineTo(LEFT + k * gap, heights[i * n + k]);
          if (n === 1) brush.lineTo(LEFT + DASH, heights[i]);
        }
        brush.stroke();
      }
    }

    // What is looked at lies on a canvas of its own, so that pointing costs a few lines.
    function paintMarks(key = null) {
      const brush = sized(marks);
      brush.font = `11px ${look.font}`;
      for (const { heights, colour, width: thick, dash, name } of marking) {
        trace(brush, heights, colour, thick, dash);
        write(brush, name, besideFirst(), middle(heights) - 4);
      }
      const row = key === null ? -1 : app.rowOf(key);
      const heights = row < 0 ? null : heightsOf(pointAt(row));
      if (heights) trace(brush, heights, colourOf(taskOf(row), look), 2.5, []);
      made.axes.forEach(({ column }, k) => {
        const { value } = nodes.get(column);
        value.hidden = heights === null;
        if (value.hidden) return;
        const known = shown.columns[column].values[row];
        value.textContent = isKnown(known) ? clip(number(known), 40) : "none";
        value.style.top = `${heights[k]}px`;
      });
    }

    // Where a mark's name stands: half way to the second axis, or wherever its line begins.
    const besideFirst = () => LEFT + (made.axes.length > 1 ? gap : made.right) / 2;
    const middle = ([first, second]) => (first !== null && isKnown(second) ? (first + second) / 2 : first ?? second ?? TOP);

    function trace(brush, heights, colour, thick, dash) {
      for (const [stroke, size, pattern] of [[look.page, thick + 2, []], [colour, thick, dash]]) {
        brush.strokeStyle = stroke;
        brush.lineWidth = size;
        brush.setLineDash(pattern);
        brush.beginPath();
        heights.forEach((y, k) => {
          if (y === null) return;
          if (k === 0 || heights[k - 1] === null) brush.moveTo(across(k), y);
          if (k > 0) brush.lineTo(across(k), y);
          if (heights.length === 1) brush.lineTo(across(k) + DASH, y);
        });
        brush.stroke();
      }
      brush.setLineDash([]);
    }

    function write(brush, text, x, y) {
      const size = brush.measureText(text).width;
      brush.textAlign = "center";
      brush.fillStyle = look.page;
      brush.fillRect(x - size / 2 - 2, y - 11, size + 4, LABEL_PX);
      brush.fillStyle = look.text;
      brush.fillText(text, x, y);
    }

    // ---- axes and brushes

    function axisNode(column) {
      const name = element("span", { className: "name" });
      const [ticks, outside, limit] = ["ticks", "outside", "limit"].map((className) => element("div", { className }));
      const handle = element("div", {
        className: "handle", tabIndex: 0, role: "slider", "aria-orientation": "vertical", "aria-valuemin": 0, "aria-valuemax": STEPS, data: { column },
      });
      const rail = element("div", { className: "rail" }, outside, limit, handle);
      const value = element("span", { className: "value", hidden: true }); // of the line that is pointed at
      const node = element("div", { className: "axis" }, element("div", { className: "head" }, name), ticks, rail, value);
      brushed(column, rail, handle);
      return { node, name, rail, ticks, outside, handle, limit, value };
    }

    const axisNamed = (column) => made.axes.find((axis) => axis.column === column);

    function put(column, step) {
      const text = axisNamed(column).steps.limit(Math.min(STEPS, Math.max(0, step)));
      if (text !== shown.state[`b.${column}`]) app.change({ [`b.${column}`]: text });
    }

    let dragged = false;
    function brushed(column, rail, handle) {
      let grip = null;
      rail.addEventListener("pointerdown", (event) => {
        const held = event.target === handle;
        dragged = held;
        if (event.button !== 0 || !axisNamed(column).steps) return;
        const { top, bottom } = handle.getBoundingClientRect();
        const offset = held ? event.clientY - (top + bottom) / 2 : 0;
        // Words above the axes may grow with a budget: the place of the rail as it was grabbed is what counts.
        grip = { from: event.clientY, foot: rail.getBoundingClientRect().bottom + offset };
        rail.setPointerCapture(event.pointerId);
        if (held) {
          event.preventDefault();
          handle.focus({ preventScroll: true });
        }
      });
      rail.addEventListener("pointermove", (event) => {
        if (!grip || (!dragged && Math.abs(event.clientY - grip.from) < DRAG_PX)) return;
        dragged = true;
        const { value, steps } = axisNamed(column);
        put(column, steps.step(String(value(inside((grip.foot - event.clientY) / HEIGHT)))));
      });
      for (const end of ["pointerup", "pointercancel"]) rail.addEventListener(end, () => { grip = null; });
      handle.addEventListener("keydown", (event) => {
        if (!Object.hasOwn(MOVES, event.key)) return;
        event.preventDefault();
        put(column, Number(handle.getAttribute("aria-valuenow")) + MOVES[event.key]);
      });
    }

    function arrange() {
      const { axes } = made;
      const least = width < 480 ? 72 : 64;
      const room = width - LEFT - made.right;
      gap = Math.max(least, axes.length > 1 ? Math.floor(room / (axes.length - 1)) : room);
      const total = `${wide()}px`;
      for (const node of [plane, lines, marks]) node.style.width = total;
      const columns = axes.map(({ column }) => column);
      for (const column of columns) if (!nodes.has(column)) nodes.set(column, axisNode(column));
      for (const column of [...nodes.keys()]) if (!columns.includes(column)) nodes.delete(column);
      const axisNodes = columns.map((column) => nodes.get(column).node);
      const isSame = axisNodes.length === frame.children.length && axisNodes.every((node, k) => node === frame.children[k]);
      if (!isSame) frame.replaceChildren(...axisNodes); // which takes the focus
      axes.forEach((axis, k) => {
        const { node, name, ticks, rail } = nodes.get(axis.column);
        node.style.left = `${across(k)}px`;
        node.style.width = `${(k + 1 < axes.length ? gap : made.right) - 8}px`;
        name.replaceChildren(...pieces(clip(named(axis.column), 80)).flatMap((piece) => [piece, element("wbr")]));
        name.title = `${axis.column}${{ max: ": more is better", min: ": less is better" }[directionOf(axis.column)] ?? ""}`;
        rail.classList.toggle("free", axis.steps === null);
        const labels = [...axis.ticks, ...(axis.lacks ? [{ share: NaN, text: "none" }] : [])];
        ticks.replaceChildren(...labels.map(({ share, text }) => {
          const label = element("span", { textContent: clip(text, 60), title: text });
          label.style.top = `${heightOf(share) - TOP}px`;
          return label;
        }));
      });
    }

    // Where the limit of an axis lies, and the part that it leaves out, as shares.
    function limitOn({ column, way, steps, share }) {
      const text = shown.state[`b.${column}`] ?? "";
      if (!steps) return null;
      const loose = way === "min" ? 1 : 0;
      const at = text === "" ? loose : share(Number(text));
      const words = text === "" ? "" : `${way === "max" ? "≥" : "≤"} ${text}`;
      return { text, at, low: Math.min(at, loose), high: Math.max(at, loose), words };
    }

    function moveHandles() {
      const { columns } = shown;
      for (const axis of made.axes) {
        const bound = limitOn(axis);
        const { outside, handle, limit } = nodes.get(axis.column);
        handle.hidden = outside.hidden = limit.hidden = bound === null;
        if (bound === null) continue;
        const { text, at, low, high, words } = bound;
        const { label, unit } = columns[axis.column];
        const side = axis.way === "max" ? "at least" : "at most";
        const now = Number(handle.getAttribute("aria-valuenow") ?? -1);
        if (axis.steps.limit(now) !== text) handle.setAttribute("aria-valuenow", axis.steps.step(text));
        handle.setAttribute("aria-label", `${label} ${side}${unit ? `, ${unit}` : ""}`);
        handle.setAttribute("aria-valuetext", text === "" ? "no limit" : `${side} ${text} ${unit}`.trim());
        handle.classList.toggle("set", text !== "");
        handle.style.top = limit.style.top = `${(1 - at) * HEIGHT}px`;
        outside.style.top = `${(1 - high) * HEIGHT}px`;
        outside.style.height = `${(high - low) * HEIGHT}px`;
        limit.textContent = words;
        limit.title = words;
      }
    }

    // ---- words

    function rangeOf({ column, numeric }, rows) {
      const values = rows.map((row) => shown.columns[column].values[row]).filter(isKnown);
      const name = clip(title(column), 60);
      if (!values.length) return `${name}: none`;
      if (numeric) return `${name} ${ends(values).map((value) => number(value)).join(" to ")}`;
      const names = [...new Set(values)];
      const some = names.slice(0, 4).map((value) => clip(number(value), 24)).join(", ");
      return `${name}: ${some}${names.length > 4 ? ` and ${names.length - 4} more` : ""}`;
    }

    const nAxes = () => `${many(made.axes.length)} ${made.axes.length === 1 ? "axis" : "axes"}`;
    const summary = () => {
      const rows = drawn.front.map((i) => made.order[i]);
      const ranges = rows.length ? made.axes.map((axis) => rangeOf(axis, rows)).join("; ") : "nothing is within the budgets";
      return `Parallel coordinates over ${nAxes()}: ` +
        `${many(rows.length)} of ${plural(made.order.length, "design")} on the front. ${ranges}. The table of the front holds the numbers.`;
    };

    function describe() {
      const { budgeted } = shown;
      const { front, dominated, outside, others } = drawn;
      const dim = dominated.length + outside.length;
      const grey = budgeted.limits.length ? ", grey outside the budgets" : "";
      count.textContent = `${nAxes()}${wide() > width ? " (scroll)" : ""}, ${many(front.length + dim)} of ${many(made.order.length)} lines drawn`;
      caption.textContent = [
        front.length ? `Strong: ${many(front.length)} on the front.` : "Nothing is within the budgets.",
        others ? `Dim: ${dim < others ? "an even sample of " : ""}${many(others)} others${grey}.` : "",
        made.axes.some(({ steps }) => steps) ? "Drag a handle to move its budget." : "",
        made.axes.some(({ column }) => directionOf(column)) ? "↑ ↓: which way is better." : "",
        budgeted.limits.length ? `Dashed: the ${budgeted.pick >= 0 ? "pick" : "nearest"}.` : "",
        made.unplaced ? `Without an axis here: ${plural(made.unplaced, "more parameter")}.` : "",
      ].filter(Boolean).join(" ");
      lines.setAttribute("aria-label", summary());
    }

    // ---- pointing

    function nearest(event) {
      const box = plane.getBoundingClientRect();
      const [x, y] = [event.clientX - box.left, event.clientY - box.top];
      const n = made.axes.length;
      if (y < TOP - NEAR_PX || x < LEFT - NEAR_PX || x > across(n - 1) + (n > 1 ? NEAR_PX : DASH)) return -1;
      const k = Math.max(0, Math.min(n - 2, Math.floor((x - LEFT) / gap)));
      const along = inside((x - across(k)) / gap);
      let [best, least] = [-1, NEAR_PX];
      const weigh = (first, second, row, extra) => {
        if (first === null || second === null) return;
        const distance = (Math.abs(first + (second - first) * along - y) * gap) / Math.hypot(gap, second - first) + extra;
        if (distance < least) [best, least] = [row, distance];
      };
      for (const { at, heights } of marking) if (at.row >= 0) weigh(heights[k], heights[Math.min(k + 1, n - 1)], at.row, -1);
      for (const [places, extra] of [[drawn.front, 0], [drawn.dominated, 2], [drawn.outside, 2]]) {
        for (const i of places) weigh(made.heights[i * n + k], made.heights[i * n + Math.min(k + 1, n - 1)], made.order[i], extra);
      }
      return best;
    }

    plane.addEventListener("pointermove", (event) => {
      if (!made || event.buttons) return;
      const row = nearest(event);
      if (row === pointed) return;
      pointed = row;
      plane.classList.toggle("near", row >= 0);
      app.hover(row < 0 ? null : app.keyOf(row));
    });
    plane.addEventListener("pointerleave", () => {
      pointed = -1;
      app.hover(null);
    });
    plane.addEventListener("pointerdown", (event) => { if (!event.target.closest(".rail")) dragged = false; });
    plane.addEventListener("click", (event) => {
      if (!made || dragged) return;
      const row = nearest(event);
      if (row >= 0) app.change({ chosen: app.keyOf(row) });
    });

    scroll.addEventListener("scroll", () => { left = scroll.scrollLeft; });

    function hover(key) {
      if (made) paintMarks(key);
    }

    // ---- drawing

    function draw() {
      look = app.style();
      // Printers leave canvases empty.
      onPaper.replaceChildren(...(look.paper ? [new DOMParser().parseFromString(svg(), "image/svg+xml").documentElement] : []));
      scroll.hidden = look.paper === true;
      if (look.paper) return describe();
      marking = marked(look);
      paint();
      paintMarks();
      if (!shown.moving) describe();
    }

    // While a budget moves, some lines are drawn at once, and all of them when it rests.
    const soon = Dom.settled((next) => {
      shown = { ...next, moving: false };
      draw();
    }, SETTLE_MS);

    function render(next) {
      shown = next;
      const before = width;
      scroll.hidden = false;
      if (!next.moving || !width) width = scroll.clientWidth || width; // the observer is late for paper
      if (prepare() || width !== before) arrange();
      pointed = -1;
      moveHandles();
      if (next.moving) draw();
      soon(next);
    }

    new ResizeObserver(() => {
      const now = scroll.clientWidth;
      if (!made || now === 0 || now === width) return;
      width = now;
      arrange();
      moveHandles();
      draw();
    }).observe(scroll);

    // ---- a picture that is kept

    function svg() {
      const colours = Figure.print(shown.page.palette);
      const [w, h] = [wide(), TOP + HEIGHT + BELOW + FOOT];
      const text = (x, y, words, more = "") => `<text x="${x}" y="${y.toFixed(1)}" ${more}>${app.escaped(inXML(words))}</text>`;
      const n = made.axes.length;
      const y = (i, k) => made.heights[i * n + k].toFixed(1);
      const places = (i) => [...made.axes.map((_, k) => `${across(k)},${y(i, k)}`), ...(n === 1 ? [`${LEFT + DASH},${y(i, 0)}`] : [])];
      const polyline = (i) => `<polyline points="${places(i).join(" ")}"/>`;
      const groups = layers(colours, sample(DIM_LINES)).map((layer) =>
        `<g class="${layer.kind}" fill="none" stroke="${layer.colour}" stroke-opacity="${layer.alpha.toFixed(3)}">` +
        `${layer.places.map(polyline).join("")}</g>`);
      const halo = `fill="${colours.quiet}" stroke="${colours.page}" stroke-width="3" paint-order="stroke"`;
      const drawnMarks = marked(colours).map(({ heights, colour, width: thick, dash, name }) => {
        const begins = (k) => k === 0 || heights[k - 1] === null;
        const path = heights.map((at, k) => (at === null ? "" : `${begins(k) ? "M" : "L"}${across(k)} ${at.toFixed(1)}`)).join("");
        return `<path d="${path}" fill="none" stroke="${colour}" stroke-width="${thick}" stroke-dasharray="${dash.join(" ")}"/>` +
          text(besideFirst(), middle(heights) - 4, name, `text-anchor="middle"`);
      });
      const axes = made.axes.map((axis, k) => {
        const x = across(k);
        const room = Math.floor(((k + 1 < n ? gap : made.right) - 8) / 6);
        const heading = wrapped(named(axis.column), room, 3);
        const limit = limitOn(axis);
        const ticks = [...axis.ticks, ...(axis.lacks ? [{ share: NaN, text: "none" }] : [])];
        return [
          `<path d="M${x} ${TOP}V${TOP + HEIGHT}" stroke="${colours.quiet}"/>`,
          limit?.text ? `<path d="M${x} ${heightOf(limit.high).toFixed(1)}V${heightOf(limit.low).toFixed(1)}" ` +
            `stroke="${colours.quiet}" stroke-opacity="0.3" stroke-width="12"/>` +
            `<path d="M${x - 10} ${heightOf(limit.at).toFixed(1)}h20" stroke="${colours.text}" stroke-width="3"/>` : "",
          ...heading.map((line, i) => text(x - 4, TOP - 10 - (heading.length - 1 - i) * LABEL_PX, line)),
          ...ticks.map(({ share, text: words }) => `<path d="M${x - 3} ${heightOf(share).toFixed(1)}h6" stroke="${colours.quiet}"/>` +
            text(x + 6, heightOf(share) + 4, clip(words, room), halo)),
        ].join("");
      });
      return `<svg xmlns="http://www.w3.org/2000/svg" width="${w}" height="${h}" viewBox="0 0 ${w} ${h}" ` +
        `font-family="sans-serif" font-size="11" fill="${colours.text}"><title>${app.escaped(inXML(summary()))}</title>` +
        `<rect width="${w}" height="${h}" fill="${colours.page}"/>${[...groups, ...drawnMarks, ...axes].join("")}</svg>`;
    }

    async function image(format) {
      const address = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(svg())}`;
      if (format === "svg") return address;
      const picture = new Image();
      picture.src = address;
      await picture.decode();
      const canvas = element("canvas", { width: 2 * picture.naturalWidth, height: 2 * picture.naturalHeight });
      canvas.getContext("2d").drawImage(picture, 0, 0, canvas.width, canvas.height);
      return canvas.toDataURL("image/png");
    }

    return { render, hover, image };
  }

  return { view };
})();
Views.parallel = Parallel;
