"use strict";
// Which parameter matters for which objective, all in one chart: bars of a random forest's permutation importance where it
// explains enough to say so, and the means of each objective at the values of the parameter that is chosen.
Views.importance = (() => {
  const MOST = 10; // parameters with a line
  const LITTLE = 0.3; // explained variance below which a ranking says nothing
  const { element, button } = Dom;

  function view(root, app) {
    const { number, clip } = app;
    let parameter = null;

    function draw(shown) {
      const { page, columns } = shown;
      const found = page.importance.filter((one) => page.objectives[one.objective] && app.concerns(one));
      const told = found.filter(({ r2 }) => r2 >= LITTLE);
      const label = (column, n = 40) => clip(columns[column]?.label ?? column, n);
      const ofParameter = (one, column) => one.parameters.find((each) => each.column === column);
      const share = (one, column) => Math.max(0, ofParameter(one, column)?.importance ?? 0) / (one.parameters.reduce((sum, { importance }) => sum + Math.max(0, importance), 0) || 1);
      const names = [...new Set(found.flatMap(({ parameters }) => parameters.map(({ column }) => column)))];
      const weight = (column) => Math.max(0, ...told.map((one) => share(one, column)));
      const ranked = names.sort((a, b) => weight(b) - weight(a)).slice(0, MOST);
      if (!ranked.includes(parameter)) [parameter = null] = ranked;
      const choose = (column) => button(label(column, 48), () => {
        parameter = column;
        draw(shown);
      }, { title: `means of ${column}`, "aria-pressed": column === parameter });
      const bar = (one, column) => [element("span", { className: "track" }, element("span", { className: "fill", style: { width: `${100 * share(one, column)}%` } })),
        element("small", { textContent: ` ${Math.round(100 * share(one, column))}\u202f%` })];
      const chart = Dom.table("Importance", [["parameter", "text"], ...told.map(({ objective }) => [label(objective)])], ranked.map((column) => [Dom.rowHead(choose(column)),
        ...told.map((one) => bar(one, column))]));
      const silent = found.filter((one) => !told.includes(one)).map(({ objective, r2 }) => `${label(objective)} (${Math.round(100 * Math.max(0, r2))}\u202f% explained)`);
      const slicesOf = (one) => ofParameter(one, parameter)?.slices ?? [];
      const mean = (one, value) => {
        const slice = slicesOf(one).find((each) => each.value === value);
        return slice ? `${number(slice.mean, app.isShare(one.objective))}${slice.se === null ? "" : ` ${app.error(slice.se)}`}` : "–";
      };
      const means = Dom.table("Means", [[label(parameter ?? ""), "text"], ...found.map(({ objective }) => [`mean ${app.title(objective)}`])],
        [...new Set(found.flatMap(slicesOf).map(({ value }) => value))].map((value) => [Dom.rowHead(clip(value, 48)), ...found.map((one) => mean(one, value))]));
      Dom.keepFocus(root, ({ title }) => title, () => root.replaceChildren(element("h2", { textContent: "What matters" }),
        element("p", { className: "quiet", textContent: told.length ? "How much of what can be explained is lost without each parameter."
          : "The parameters explain too little of designs left out for a ranking." }),
        ...(told.length ? [chart] : ranked.map(choose)), ...(silent.length ? [element("p", { className: "quiet",
          textContent: `Nothing can be said of ${silent.join(", ")}.` })] : []), ...(parameter === null ? [] : [means])));
    }

    return { render: Dom.settled(draw) };
  }

  return { view, tabs: ["matters"], has: (page) => (page.importance ?? []).length > 0 };
})();
