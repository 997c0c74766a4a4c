"use strict";
// What a limit buys: the best that designs reach as it moves and the others stay, each step what dse pick takes at that limit,
// corrected for the luck of the best where that is known; and where the curve bends, and where nobody tried.
Views.price = (() => {
  const PARTS = { "a tenth": 0.1, half: 0.5, twice: 2, "ten times": 10 }; // of a limit
  const [LEAST_PX, MOST_PX, HEIGHT_PX] = [260, 440, 240];
  const { element, button, svg } = Dom;

  function view(root, app) {
    const { clip, sized, title, number } = app;
    let [shown, gain] = [null, ""];

    const value = (column, row) => app.numbers(column)[row];
    const spent = (column, of) => `${sized(column, of)}${shown.columns[column].unit ? "" : ` ${clip(shown.columns[column].label, 40)}`}`;
    const gained = (row) => (app.isFraction(gain) ? `${number(100 * value(gain, row))}\u202f%` : sized(gain, value(gain, row)));

    // What parts of a limit would give beside the whole of it.
    function beside(column, rows, now) {
      const within = (most) => rows.findLast((row) => value(column, row) <= most);
      const at = within(now);
      if (at === undefined) return "";
      const error = app.known(shown.page.budgets.maximise, at)?.below ?? 0;
      const told = (row) => (row === undefined ? "nothing" : row === at ? "the same" : Math.abs(value(gain, row) - value(gain, at)) <= error ? "as good within its error"
        : app.differences(app.point(app.keyOf(row)), app.point(app.keyOf(at)), [])[0]);
      return `${spent(column, now)}: ${gained(at)}; ${Object.entries(PARTS).map(([name, part]) => `${name}: ${told(within(part * now))}`).join(", ")}.`;
    }

    function drawing(column, rows, now, look) {
      const size = [Math.min(MOST_PX, Math.max(LEAST_PX, root.clientWidth - 48)), HEIGHT_PX];
      const ends = rows.map((row) => app.known(gain, row) ?? { low: value(gain, row), high: value(gain, row) });
      const ranges = [rows.map((row) => value(column, row)), ends.flatMap(({ low, high }) => [low, high])].map(Data.ends);
      const axes = ranges.map(([low, high], k) => ({ column: [column, gain][k],
        ...Figure.placed((most) => Data.axis(low, high, { log: k === 0 && Data.spansDecades(low, high), number, room: 0.03, most }), k, size) }));
      const spot = (row) => axes.map((axis) => axis.to(value(axis.column, row)));
      const shape = app.shape(rows, axes, () => shown.rows.filter((row) => !shown.leftOut(row)));
      const points = rows.map(spot);
      const edge = axes[0].to(axes[0].value(shown.page.budgets.columns[column] === "min" ? 1 : 0));
      const bands = ends.map(({ low, high }, k) => {
        const [from, to] = [points[k][0], points[k + 1]?.[0] ?? edge].sort((a, b) => a - b);
        return svg("rect", { x: from, width: to - from, y: axes[1].to(high), height: axes[1].to(low) - axes[1].to(high), fill: look.quiet, opacity: 0.15 });
      });
      const said = `${title(gain)} over the limit of ${title(column)}: ${rows.map((row) => `${sized(column, value(column, row))} ${gained(row)}`).join(", ")}.`;
      return { shape, node: svg("svg", { role: "img", width: size[0], height: size[1], viewBox: `0 0 ${size.join(" ")}`, "aria-label": said }, ...Figure.frame(axes, axes.map((axis) => clip(title(axis.column), 40)), size, look), ...bands,
        svg("path", { d: `${Figure.stairs(points)}H${edge}`, fill: "none", stroke: look.palette[0], "stroke-width": 1.5 }), ...points.map(([cx, cy]) => svg("circle", { cx, cy, r: 3, fill: look.palette[0] })),
        svg("path", { d: `M${axes[0].to(now)} ${Figure.EDGES[2]}V${size[1] - Figure.EDGES[3]}`, stroke: look.focus, "stroke-dasharray": "2 4" }), ...Figure.shaped(shape, spot, look)) };
    }

    function curve(column) {
      const { columns, state, subject } = shown;
      const rows = app.bought(column).filter((row) => columns[gain].values[row] !== null);
      const heading = element("h3", {}, button(clip(columns[column].label, 40), () => app.change({ x: column, y: gain }), { title: `draw the chart over ${columns[column].label}` }));
      if (rows.length < Budgets.LEAST) return element("article", {}, heading, element("p", { className: "quiet", textContent: "Too few designs are best in turn to say what this limit buys." }));
      const now = state[`b.${column}`] ? Number(state[`b.${column}`]) : subject.value(column);
      const { node, shape: { knee, gaps } } = drawing(column, rows, now, app.style());
      const choose = (row) => button(`knee: ${gained(row)} at ${spent(column, value(column, row))}`, () => app.change({ chosen: app.keyOf(row) }));
      const untried = ([from, to], k) => element("details", {}, element("summary", { textContent: `untried: ${sized(column, value(column, from))} to ${spent(column, value(column, to))}` }),
        ...Answer.untried(app, shown, to, `${column}-${k}`));
      return element("article", {}, heading, node, element("p", { textContent: beside(column, rows, now) }), ...(knee < 0 ? [] : [choose(knee)]), ...gaps.map(untried));
    }

    function draw(next) {
      [shown, gain] = [next, app.headline()];
      const { page, columns } = shown;
      const curves = Object.keys(page.budgets.columns).filter((column) => column !== page.budgets.maximise && app.isNumeric(column)).map(curve);
      Dom.keepFocus(root, ({ textContent }) => textContent, () => root.replaceChildren(element("h2", { textContent: "What a limit buys" }), element("p", { className: "quiet",
        textContent: `The best ${columns[gain].label} as one limit moves and the others stay, with its interval${gain === page.budgets.maximise ? "; the best of many is partly luck" : ""}.` }),
      element("div", { className: "curves" }, ...curves)));
    }

    return { render: Dom.settled(draw) };
  }

  return { view, tabs: ["matters"], has: ({ budgets }) => budgets.maximise !== null && Object.keys(budgets.columns).length > 1 };
})();
