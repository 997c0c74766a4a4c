"use strict";
// Parallel coordinates: an axis per limit, objective and parameter, a line per design. What is brushed on an axis is a
// limit or a filter of its column, which the sentence and the filters hold too.
Views.parallel = (() => {
  const MAX_AXES = 24; // that the page chooses itself
  const DIM_LINES = 2000; // beside the front's: more would hide it
  const DRAG_PX = 4; // what is pressed and let go nearer than this is a click
  const [TOP, HEIGHT, BELOW, FOOT, LEFT, RIGHT] = [56, 240, 24, 16, 16, 120]; // px: titles, axes, to the tick of missing values, the rest
  const LEAST = 72; // px between axes
  const { element } = Dom;

  const isKnown = (value) => value !== null && value !== undefined;
  const heightOf = (share) => TOP + (Number.isNaN(share) ? HEIGHT + BELOW : HEIGHT * (1 - Math.min(1, Math.max(0, share))));

  // Rows are drawn in an order that repeats and has no rhythm: the first n are an even sample of them.
  const rank = (row) => Math.imul(row + 1, 0x9e3779b1) >>> 0;

  function view(root, app) {
    const { number, clip, title, many, change } = app;
    const [count, scroll, plane, lines] = Dom.parts(root, "h2 small", ".scroll", ".plane", "canvas");
    const [strong, marks, frame] = Dom.parts(root, ".strong", ".marks", ".axes");
    let shown = null;
    let axes = [];
    let [look, width, gap] = [null, 0, 0];

    const across = (k) => LEFT + k * gap;
    const wayOf = (column) => shown.page.objectives[column] ?? shown.page.budgets.columns[column];

    function columnsShown({ page, columns, objectives, rows }) {
      const defined = (page.definition?.parallel ?? []).filter((column) => columns[column]);
      if (defined.length) return defined;
      const differs = (column) => new Set(rows.map((row) => columns[column].values[row])).size > 1;
      // An axis that whole families lack says little of the others: such a column is an axis where one family is shown.
      const families = [...new Set(rows.map((row) => columns.family?.values[row]))];
      const isGeneral = (column) => families.length < 2 || families.every((family) => rows.some((row) => columns.family.values[row] === family && isKnown(columns[column].values[row])));
      const parameters = page.design.filter((column) => column !== "trial" && differs(column) && isGeneral(column));
      return [...new Set([...Object.keys(page.budgets.columns), ...objectives, ...parameters])].filter((column) => rows.some((row) => isKnown(columns[column].values[row]))).slice(0, MAX_AXES);
    }

    function axisOf(column, { columns, rows }) {
      const { values } = columns[column];
      const numeric = app.isNumeric(column);
      const words = numeric ? [] : [...new Set(rows.map((row) => values[row]).filter(isKnown).map(String))].sort((a, b) => a.localeCompare(b, "en", { numeric: true }));
      const [low, high] = numeric ? Data.ends(rows.map((row) => values[row]).filter((value) => typeof value === "number")) : [0, 1];
      const axis = Data.axis(low, high, { log: numeric && Data.spansDecades(low, high), names: words, number, most: 6 });
      const places = new Map(words.map((word, k) => [word, k]));
      const share = (value) => (!isKnown(value) ? NaN : axis.share(numeric ? value : places.get(String(value)) ?? NaN));
      return { ...axis, column, numeric, words, share, lacks: rows.some((row) => !isKnown(values[row])) };
    }

    const axesOf = Data.remembering(() => columnsShown(shown).map((column) => axisOf(column, shown)));

    // ---- brushes

    // The part of an axis that is kept, as shares from foot to top, or null for all.
    function keptOn({ column, numeric, words, share }) {
      const { state } = shown;
      const way = shown.page.budgets.columns[column];
      const limit = state[`b.${column}`];
      if (way && limit) return way === "min" ? [0, share(Number(limit))] : [share(Number(limit)), 1];
      const text = state[`f.${column}`] ?? "";
      if (text === "") return null;
      const { low, high, values } = Budgets.filter(text);
      if (numeric) return [low === null ? 0 : share(low), high === null ? 1 : share(high)];
      const at = words.filter((word) => values.has(word)).map(share);
      return at.length ? [Math.min(...at) - 0.04, Math.max(...at) + 0.04] : null;
    }

    function keep({ column, numeric, words, share, value }, ends) {
      const way = shown.page.budgets.columns[column];
      const written = (at) => String(Number(value(at).toPrecision(4)));
      if (way) return change({ [`b.${column}`]: ends === null ? "" : written(way === "min" ? ends[1] : ends[0]) });
      if (!Object.hasOwn(shown.state, `f.${column}`)) return undefined;
      const kept = ends && words.filter((word) => share(word) >= ends[0] && share(word) <= ends[1]);
      return change({ [`f.${column}`]: ends === null || (!numeric && !kept.length) ? "" : numeric ? ends.map(written).join("~") : Budgets.oneOf(kept) });
    }

    function brushed(axis, rail) {
      rail.addEventListener("pointerdown", (event) => {
        if (event.button !== 0) return;
        event.preventDefault();
        // The page may draw its axes anew meanwhile: the plane stays.
        const shareAt = ({ clientY }) => Math.min(1, Math.max(0, 1 - (clientY - plane.getBoundingClientRect().top - TOP) / HEIGHT));
        const from = shareAt(event);
        addEventListener("pointerup", (last) => {
          const ends = [from, shareAt(last)].sort((a, b) => a - b);
          keep(axis, (ends[1] - ends[0]) * HEIGHT < DRAG_PX ? null : ends);
        }, { once: true });
      });
    }

    function arrange() {
      gap = Math.max(LEAST, axes.length > 1 ? Math.floor((width - LEFT - RIGHT) / (axes.length - 1)) : width);
      for (const node of [plane, lines, strong, marks]) node.style.width = `${wide()}px`;
      frame.replaceChildren(...axes.map((axis, k) => {
        const { column, lacks } = axis;
        const labels = [...axis.ticks.map(([value, text]) => [axis.words.length ? axis.share(text) : axis.share(value), text]), ...(lacks ? [[NaN, "none"]] : [])];
        const ticks = element("div", { className: "ticks" }, ...labels.filter(([share]) => Number.isNaN(share) || (share > -0.01 && share < 1.01)).map(([share, text]) =>
          element("span", { textContent: clip(text, 40), style: { top: `${heightOf(share) - TOP}px` } })));
        const kept = keptOn(axis);
        const style = kept && { top: `${(1 - Math.min(1, kept[1])) * HEIGHT}px`, height: `${Math.max(2, (Math.min(1, kept[1]) - Math.max(0, kept[0])) * HEIGHT)}px` };
        const part = element("div", { className: "kept", hidden: kept === null, style });
        const rail = element("div", { className: "rail", data: { column } }, part);
        brushed(axis, rail);
        const arrow = { max: "↑ ", min: "↓ " }[wayOf(column)] ?? "";
        return element("div", { className: "axis", style: { left: `${across(k)}px`, width: `${(k + 1 < axes.length ? gap : RIGHT) - 8}px` } },
          element("div", { className: "head" }, element("span", { className: "name", textContent: clip(`${arrow}${title(column)}`, 80), title: column })), ticks, rail);
      }));
    }

    // ---- lines

    const wide = () => across(Math.max(0, axes.length - 1)) + RIGHT;
    const size = () => [wide(), TOP + HEIGHT + BELOW + FOOT];

    function path(brush, value) {
      const heights = axes.map(({ column, share }) => heightOf(share(value(column))));
      heights.forEach((y, k) => (k ? brush.lineTo(across(k), y) : brush.moveTo(across(k), y)));
      if (heights.length === 1) brush.lineTo(across(0) + 16, heights[0]);
    }

    function stroke(brush, look, values) {
      Object.assign(brush, look).beginPath();
      for (const value of values) path(brush, value);
      brush.stroke();
    }

    const valuesOf = (rows) => rows.map((row) => (column) => shown.columns[column].values[row]);
    const thin = (n, most, least, at) => ({ lineWidth: 1 / (devicePixelRatio || 1), globalAlpha: Math.max(least, Math.min(most, at / Math.sqrt(n))) });

    // A sample of all lines, which stays where limits move: to draw it takes longest.
    const paintSample = Data.remembering((_axes, rows, _gap, _ratio, strokeStyle) => {
      const some = [...rows].sort((a, b) => rank(a) - rank(b)).slice(0, DIM_LINES);
      stroke(Figure.brush(lines, size()), { ...thin(some.length, 0.25, 0.05, 1.5), strokeStyle }, valuesOf(some));
      return some;
    });

    function paint() {
      const onFront = (row) => shown.onFront.has(row) && !shown.leftOut(row) && shown.within(row);
      const front = shown.rows.filter(onFront);
      const others = paintSample(axes, shown.rows, gap, devicePixelRatio, look.quiet).filter((row) => !onFront(row));
      stroke(Figure.brush(strong, size()), { ...thin(front.length, 0.9, 0.2, 7), strokeStyle: look.palette[0] }, valuesOf(front));
      count.textContent = `${many(front.length + others.length)} of ${many(shown.rows.length)} lines`;
      lines.setAttribute("aria-label", `Parallel coordinates over ${many(axes.length)} axes: ${many(front.length)} of ${app.plural(shown.rows.length, "design")} on the front. The table holds the numbers.`);
    }

    function paintMarks(key = null) {
      const brush = Figure.brush(marks, size());
      const { subject } = shown;
      for (const one of [...(subject.key ? [subject] : []), ...(key === null ? [] : [app.point(key)])]) {
        stroke(brush, { strokeStyle: look.page, lineWidth: 4.5 }, [one.value]);
        stroke(brush, { strokeStyle: one.key === key ? look.palette[0] : look.text, lineWidth: 2.5 }, [one.value]);
      }
    }

    const hover = (key) => { if (shown && !root.hidden) paintMarks(key); };

    // ---- drawing

    function draw(next) {
      shown = next;
      look = app.style();
      width = scroll.clientWidth || width;
      axes = axesOf(shown.page, shown.rows);
      arrange();
      paint();
      paintMarks();
    }
    new ResizeObserver(() => { if (shown && scroll.clientWidth && scroll.clientWidth !== width) draw(shown); }).observe(scroll);

    return { render: Dom.settled(draw), hover };
  }

  return { view, tabs: ["all"] };
})();
