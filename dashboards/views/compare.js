"use strict";
// Up to four designs side by side: their numbers, what differs between them, and one of their figures each.
const Compare = (() => {
  const TABS = ["confusion", "recognition", "first_spike", "energy", "learning", "bits", "cores"]; // what is compared as a figure
  const SCALED = ["recognition", "first_spike", "energy", "learning", "bits"]; // those whose axes follow their numbers
  const UNKNOWN = "–";
  const NARROW = 1.35; // how much longer the axis of bars is beside the panel's
  const PLACES = ["trial", "task", "hardware"]; // named by the head of the table and its first rows
  const { element, button } = Dom;

  // ---- pure

  // The least or largest of several numbers; null where none is better than another.
  function best(values, way) {
    const known = values.filter((value) => typeof value === "number");
    if (new Set(known).size < 2) return null;
    return way === "max" ? Math.max(...known) : Math.min(...known);
  }

  // What a number is to the first design's: shares differ by so much, costs by a factor.
  function difference(value, first, way, number) {
    if (typeof value !== "number" || typeof first !== "number") return "";
    if (value === first) return "same";
    if (way === "min" && value > 0 && first > 0) {
      const factor = number(value / first);
      return factor === "1" ? "about the same" : `×${factor}`;
    }
    return `${value > first ? "+" : "−"}${number(Math.abs(value - first))}`;
  }

  const axesOf = (layout) => Object.keys(layout).filter((name) => /^[xy]axis\d*$/.test(name));
  const nameOf = (layout, axis) => `${axis[0]} ${Design.plain(layout[axis].title?.text)}`;

  // What an axis must reach over: what it says itself, or else its numbers.
  function reach({ data, layout }, axis) {
    const range = layout[axis].range;
    if (range) return range;
    const letter = axis[0];
    const traces = data.filter((trace) => (trace[`${letter}axis`] ?? letter) === axis.replace("axis", ""));
    const values = traces.flatMap((trace) => Design.listed(trace[letter])).filter(Number.isFinite);
    if (!values.length) return null;
    const log = layout[axis].type === "log";
    const ends = [Math.min(...values), Math.max(...values)].map((value) => (log ? Math.log10(Math.max(value, Number.MIN_VALUE)) : value));
    if (layout[axis].rangemode === "tozero" && !log) ends[0] = Math.min(0, ends[0]);
    const room = 0.05 * (ends[1] - ends[0] || 1);
    return [layout[axis].rangemode === "tozero" ? ends[0] : ends[0] - room, ends[1] + room];
  }

  // The figures with axes of one name reaching over the same numbers.
  function scaled(figures) {
    const common = new Map();
    for (const figure of figures) {
      for (const axis of axesOf(figure.layout)) {
        const ends = reach(figure, axis);
        const [name, before] = [nameOf(figure.layout, axis), common.get(nameOf(figure.layout, axis))];
        if (ends) common.set(name, before ? [Math.min(before[0], ends[0]), Math.max(before[1], ends[1])] : ends);
      }
    }
    const beside = ({ layout }) => (layout.annotations ?? []).some(({ xref }) => xref === "paper");
    for (const { layout } of figures.filter(beside)) {
      const ends = layout.xaxis.range;
      if (ends) common.set(nameOf(layout, "xaxis"), [ends[0], NARROW * Math.max(...figures.map((one) => one.layout.xaxis.range[1]))]);
    }
    return figures.map((figure) => {
      const { layout } = figure;
      const wide = (axis) => common.has(nameOf(layout, axis)) && !(layout[axis].autorange === "reversed");
      const axes = Object.fromEntries(axesOf(layout).filter(wide).map((axis) => [axis, { ...layout[axis], range: common.get(nameOf(layout, axis)) }]));
      // Numbers beside bars stand at a share of the axis, and need as much room where it is shorter.
      const shrunk = layout.xaxis?.range && axes.xaxis ? layout.xaxis.range[1] / axes.xaxis.range[1] : 1;
      const annotations = (layout.annotations ?? []).map((one) => (one.xref === "paper" ? { ...one, x: one.x * shrunk } : one));
      return { ...figure, layout: { ...layout, ...axes, annotations } };
    });
  }

  // ---- the view

  function view(root, app) {
    const { clip, number } = app;
    root.classList.add("compare");
    const table = element("table", {}, element("thead"), element("tbody"));
    const same = element("p", { className: "quiet" });
    const select = element("select", { "aria-label": "Figure of each design", onchange: renderFigures });
    const figures = element("div", { className: "multiples" });
    const choice = element("label", {}, "figure ", select);
    root.append(element("h2", {}, "Compare ", element("small")), Dom.scroll("Designs side by side", table), same, choice, figures);
    let shown = null;
    let drawn = { key: "", details: [] };
    const loaded = new Map(); // trial -> {page, text, details}

    const trialOf = (at) => Design.named(shown, at.key)[0] ?? at.value("trial");
    const nameAt = (at) => {
      const trial = trialOf(at);
      return trial === null ? `Point ${at.key}` : app.trialName(trial);
    };

    // ---- the table

    const square = (k) => element("span", { className: "square", textContent: String(k + 1) });

    function head() {
      return element("tr", {}, element("td"), ...shown.compared.map((at, k) => {
        const choose = button(clip(nameAt(at), 40), () => app.change({ chosen: at.key }),
          { title: "choose this design", "aria-pressed": shown.chosen?.key === at.key, data: { does: "choose" } });
        const remove = button("×", () => app.toggleCompared(at.key),
          { title: "remove from the comparison", "aria-label": `remove ${nameAt(at)} from the comparison`, data: { does: "remove" } });
        return element("th", { scope: "col", data: { key: at.key } }, square(k), " ", choose, " ", remove);
      }));
    }

    function row(title, cells) {
      // Long names break after a dot or an underscore.
      const parts = clip(title, 48).split(/(?<=[._])/).flatMap((part, k) => (k ? [element("wbr"), part] : [part]));
      return element("tr", {}, element("th", { scope: "row", title }, ...parts), ...cells);
    }

    const words = (at, column) => {
      const value = at.value(column);
      return value === null ? UNKNOWN : clip(Design.worded(app, shown, at, column), 60);
    };

    // A number and its interval each stay on a line.
    const whole = (text) => text.split(/ (?=[(±])/).flatMap((part, k) => [k ? " " : "", element("span", { className: "whole", textContent: part })]);

    // Whether the first two of some measurements differ by less than their standard errors: then none is best.
    function isWithinError(column, values) {
      const interval = Object.hasOwn(shown.page.intervals, column) ? shown.page.intervals[column] : undefined;
      const known = shown.compared.map(({ row }, k) => ({ value: values[k], se: row >= 0 && interval && interval.low[row] === interval.high[row] ? interval.low[row] : 0 }))
        .filter(({ value }) => typeof value === "number").sort((a, b) => b.value - a.value);
      if (known.length < 2 || shown.page.objectives[column] !== "max") return false;
      return known[0].value - known[1].value <= Math.hypot(known[0].se, known[1].se);
    }

    function measured(column, way) {
      const values = shown.compared.map((at) => at.value(column));
      const leading = isWithinError(column, values) ? null : best(values, way);
      return row(app.title(column), shown.compared.map((at, k) => {
        const isBest = leading !== null && values[k] === leading;
        const cell = element("td", { title: String(values[k] ?? "not measured") }, element(isBest ? "strong" : "span", {}, ...whole(words(at, column))));
        if (isBest) cell.append(element("span", { className: "spoken", textContent: " (best)" }));
        const apart = k ? difference(values[k], values[0], way, number) : "";
        if (apart) cell.append(element("small", { className: "apart", textContent: apart, title: "to the first design" }));
        return cell;
      }));
    }

    function renderTable() {
      const { page, columns, compared, objectives } = shown;
      const focused = table.contains(document.activeElement) ? document.activeElement : null;
      const [does, place] = [focused?.dataset.does, focused?.closest("th")?.cellIndex];
      const cell = (at, column) => element("td", { textContent: words(at, column), title: String(at.value(column) ?? "") });
      const plainRow = (column) => row(app.title(column), compared.map((at) => cell(at, column)));
      const known = (column) => compared.some((at) => at.value(column) !== null);
      const ways = { ...page.objectives, ...page.budgets.columns };
      const numbered = app.beside([...objectives, ...Object.keys(page.budgets.columns)]).filter(known);
      const parameters = page.design.filter((column) => !PLACES.includes(column) && known(column));
      const differs = (column) => new Set(compared.map((at) => String(at.value(column)))).size > 1;
      table.tHead.replaceChildren(head());
      table.tBodies[0].replaceChildren(
        ...PLACES.slice(1).filter((column) => columns[column] && app.varies(column)).map(plainRow),
        ...numbered.map((column) => measured(column, ways[column.replace(/_(corrected|test)$/, "")] ?? "min")),
        ...parameters.filter(differs).map(plainRow),
      );
      const equal = compared.length > 1 ? parameters.filter((column) => !differs(column)) : [];
      same.hidden = equal.length === 0;
      const shared = (column) => `${columns[column].label} ${words(compared[0], column)}\u00a0${columns[column].unit}`.trim();
      same.textContent = `same: ${equal.map(shared).join(", ")}`;
      if (does) table.tHead.rows[0].cells[Math.min(place, compared.length)].querySelector(`[data-does=${does}]`).focus({ preventScroll: true });
    }

    table.addEventListener("pointerover", (event) => app.hover(event.target.closest("th[data-key]")?.dataset.key ?? null));
    table.addEventListener("pointerleave", () => app.hover(null));

    // ---- figures

    function load() {
      const { page, compared } = shown;
      for (const trial of new Set(compared.map(trialOf))) {
        if (trial === null || (loaded.get(trial)?.page === page && loaded.get(trial).details)) continue;
        const entry = { ...loaded.get(trial), page };
        loaded.set(trial, entry);
        Details.of(page, trial).then((details) => {
          if (loaded.get(trial) !== entry) return;
          const text = JSON.stringify(details);
          if (text !== entry.text) Object.assign(entry, { text, details });
          // A link may name points that are no rows of the page.
          const news = shown.compared.filter((at) => trialOf(at) === trial && Design.restore(app, shown, at, details));
          if (news.length) app.change({});
          else renderFigures();
        });
      }
    }

    const detailsOf = (at) => loaded.get(trialOf(at))?.details;
    const partAt = (at) => (detailsOf(at) ? Design.partOf(detailsOf(at), at.value("task")) : {});

    function renderFigures() {
      const { state, compared } = shown;
      const offered = TABS.filter((tab) => compared.some((at) => Design.figureOf(partAt(at), tab, state.hardware, state.pace, at.value)));
      Dom.fill(select, offered.map((tab) => [tab, tab]));
      choice.hidden = figures.hidden = offered.length === 0;
      const details = compared.map(detailsOf);
      const key = JSON.stringify([select.value, state.hardware, app.style().dark, state.pace, compared.map((at) => [trialOf(at), ...["task", "weight_bits", "pruned_after"].map(at.value)])]);
      if (!offered.length || (drawn.key === key && details.every((one, k) => one === drawn.details[k]))) return;
      drawn = { key, details };
      const drawings = compared.map((at) => Design.figureOf(partAt(at), select.value, state.hardware, state.pace, at.value));
      const wide = SCALED.includes(select.value) ? scaled(drawings.filter(Boolean)) : drawings.filter(Boolean);
      const high = Math.max(...wide.map(Figure.heightOf));
      const nodes = compared.map((at, k) => {
        const caption = element("figcaption", {}, square(k), ` ${clip(nameAt(at), 40)}`);
        if (drawings[k]) return element("figure", {}, caption, Figure.node(select.value, high, `${k + 1}, ${nameAt(at)}. ${Design.told(select.value, drawings[k], number)}`));
        const text = details[k] === undefined ? "…" : details[k] === null ? Details.absent(shown.page, trialOf(at))
          : ["energy", "cores"].includes(select.value) ? "No numbers on this hardware." : "Nothing was recorded.";
        return element("figure", {}, caption, element("p", { className: "quiet", textContent: text }));
      });
      Figure.replace(figures, ...nodes);
      figures.querySelectorAll(".plot").forEach((node, k) => Figure.draw(node, wide[k], app.style(), Figure.fitted));
    }

    function render(next) {
      shown = next;
      root.hidden = shown.compared.length === 0;
      if (root.hidden) return;
      root.querySelector("small").textContent = app.plural(shown.compared.length, "design");
      renderTable();
      load();
      renderFigures();
    }

    function hover(key) {
      table.querySelectorAll("th.pointed").forEach((cell) => cell.classList.remove("pointed"));
      if (key !== null) table.querySelectorAll("th[data-key]").forEach((cell) => cell.classList.toggle("pointed", cell.dataset.key === key));
    }

    return { render, hover };
  }

  return { view };
})();
Views.compare = Compare;
