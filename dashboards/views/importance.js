"use strict";
// Which parameter matters for which objective: bars of a random forest's permutation importance, with how far to
// trust it, and the mean of the objective at each value of the parameter that is chosen.
const Importance = (() => {
  const MOST = 10; // parameters with a bar
  const LITTLE = 0.3; // explained variance below which a ranking says nothing
  const { element, button } = Dom;

  function view(root, app) {
    const { number, clip, title } = app;
    const select = element("select", { onchange: () => render(shown) });
    const words = element("p", { className: "quiet" });
    const [bars, slices] = [element("div", { className: "bars" }), element("div")];
    root.append(element("h2", { textContent: "What matters" }), element("label", {}, "for ", select), words, element("div", { className: "halves" }, bars, slices));
    let [shown, parameter] = [null, null];

    const isOf = ({ task, hardware }, { state, columns }) =>
      (!task || !columns.task || state.task === "all" || state.task === task) && (!hardware || hardware === state.hardware);
    const labelOf = (column, n) => clip(shown.columns[column]?.label ?? column, n);

    function bar(one, most) {
      const choose = () => {
        parameter = one.column;
        render(shown);
      };
      const fill = element("span", { className: "fill" });
      fill.style.width = `${(100 * one.importance) / most}%`;
      return element("div", { className: "bar" }, button(labelOf(one.column, 48), choose, { title: `means of ${one.column}`, "aria-pressed": one.column === parameter }),
        element("span", { className: "track" }, fill), element("span", { className: "number", textContent: `${one.importance.toFixed(2)} ± ${one.se.toFixed(2)}` }));
    }

    function meanTable({ column, slices: found }, objective) {
      const { unit, label } = shown.columns[objective];
      const rows = found.map(({ value, n, mean, se }) => [Dom.rowHead(clip(value, 48)),
        `${number(mean, objective === "accuracy")}${se === null ? "" : ` ${app.error(se)}`}${unit ? `\u202f${unit}` : ""}`, app.many(n)]);
      return Dom.table("Means", [[labelOf(column, 40), "text"], [`mean ${label}`], ["designs"]], rows);
    }

    function render(next) {
      shown = next;
      const { page } = shown;
      const offered = (page.importance ?? []).filter((one) => page.objectives[one.objective] && isOf(one, shown));
      root.hidden = offered.length === 0;
      if (root.hidden || shown.moving) return;
      const several = new Set(offered.map(({ task }) => task)).size > 1;
      const names = offered.map(({ task, objective }) => `${title(objective)}${several ? ` · ${task}` : ""}`);
      Dom.fill(select, names.map((name) => [name, clip(name, 60)]));
      const { objective, n, r2, parameters: all } = offered[Math.max(0, names.indexOf(select.value))];
      const parameters = all.slice(0, MOST);
      if (!parameters.some(({ column }) => column === parameter)) parameter = parameters[0].column;
      const share = `${Math.round(100 * Math.max(0, r2))}\u202f%`;
      words.textContent = r2 < LITTLE ? `The parameters explain ${share} of designs left out (${app.many(n)} designs): too little for a ranking. Read the means.`
        : `By how much of the explained variance is lost without it; all explain ${share} of designs left out (${app.many(n)} designs).`;
      const most = Math.max(...parameters.map(({ importance }) => importance), 1e-9);
      Dom.keepFocus(bars, ({ title: of }) => of, () => bars.replaceChildren(...parameters.map((one) => bar(one, most))));
      bars.classList.toggle("weak", r2 < LITTLE);
      slices.replaceChildren(meanTable(parameters.find(({ column }) => column === parameter), objective));
    }

    return { render };
  }

  return { view };
})();
Views.importance = Importance;
