"use strict";
// Which parameter matters for which objective: bars of a random forest's permutation importance, with how far to
// trust it, and the mean of the objective at each value of the parameter that is chosen.
const Importance = (() => {
  const MOST = 10; // parameters with a bar
  const LITTLE = 0.3; // explained variance below which a ranking says nothing

  function view(root, app) {
    const { element, number, clip, title } = app;
    const select = element("select");
    const words = element("p", { className: "quiet" });
    const bars = element("div", { className: "bars" });
    const slices = element("div", { className: "scroll", tabIndex: 0 });
    slices.setAttribute("role", "group");
    slices.setAttribute("aria-label", "Means");
    root.append(element("h2", { textContent: "What matters" }), element("label", {}, "for ", select), words, element("div", { className: "halves" }, bars, slices));
    let [shown, parameter] = [null, null];

    const isOf = ({ task, hardware }, { state, columns }) =>
      (!task || !columns.task || state.task === "all" || state.task === task) && (!hardware || hardware === state.hardware);
    const nameOf = ({ task, objective }, several) => `${title(objective)}${several ? ` · ${task}` : ""}`;

    function bar(one, most) {
      const label = shown.columns[one.column]?.label ?? one.column;
      const button = element("button", { type: "button", textContent: clip(label, 48), title: `means of ${one.column}` });
      button.setAttribute("aria-pressed", String(one.column === parameter));
      button.addEventListener("click", () => {
        parameter = one.column;
        render(shown);
        [...bars.querySelectorAll("button")].find((other) => other.textContent === button.textContent)?.focus({ preventScroll: true });
      });
      const fill = element("span", { className: "fill" });
      fill.style.width = `${(100 * one.importance) / most}%`;
      return element("div", { className: "bar" }, button, element("span", { className: "track" }, fill),
        element("span", { className: "number", textContent: `${one.importance.toFixed(2)} ± ${one.se.toFixed(2)}` }));
    }

    function meanTable({ column, slices: found }, objective) {
      const { unit } = shown.columns[objective];
      const cell = (text) => element("td", { textContent: text });
      const rows = found.map(({ value, n, mean, se }) => element("tr", {}, element("th", { scope: "row", className: "text", textContent: clip(value, 48) }),
        cell(`${number(mean, objective === "accuracy")}${se === null ? "" : ` ${app.error(se)}`}${unit ? `\u202f${unit}` : ""}`), cell(app.many(n))));
      const label = shown.columns[column]?.label ?? column;
      return element("table", {}, element("thead", {}, element("tr", {}, ...[clip(label, 40), `mean ${shown.columns[objective].label}`, "designs"].map((text, k) =>
        element("th", { scope: "col", className: k ? "" : "text", textContent: text })))), element("tbody", {}, ...rows));
    }

    function render(next) {
      shown = next;
      const { page } = shown;
      const offered = (page.importance ?? []).filter((one) => shown.page.objectives[one.objective] && isOf(one, shown));
      root.hidden = offered.length === 0;
      if (root.hidden || shown.moving) return;
      const several = new Set(offered.map(({ task }) => task)).size > 1;
      const names = offered.map((one) => nameOf(one, several));
      if ([...select.options].map(({ textContent }) => textContent).join("|") !== names.join("|")) {
        const before = select.selectedOptions[0]?.textContent;
        select.replaceChildren(...names.map((name, k) => element("option", { value: k, textContent: clip(name, 60) })));
        if (names.includes(before)) select.value = names.indexOf(before);
      }
      const { objective, n, r2, parameters: all } = offered[Number(select.value)] ?? offered[0];
      const parameters = all.slice(0, MOST);
      if (!parameters.some(({ column }) => column === parameter)) parameter = parameters[0].column;
      const share = `${Math.round(100 * Math.max(0, r2))}\u202f%`;
      words.textContent = r2 < LITTLE ? `The parameters explain ${share} of designs left out (${app.many(n)} designs): too little for a ranking. Read the means.`
        : `By how much of the explained variance is lost without it; all explain ${share} of designs left out (${app.many(n)} designs).`;
      const most = Math.max(...parameters.map(({ importance }) => importance), 1e-9);
      bars.replaceChildren(...parameters.map((one) => bar(one, most)));
      bars.classList.toggle("weak", r2 < LITTLE);
      slices.replaceChildren(meanTable(parameters.find(({ column }) => column === parameter), objective));
    }
    select.addEventListener("change", () => render(shown));

    return { render };
  }

  return { view };
})();
Views.importance = Importance;
