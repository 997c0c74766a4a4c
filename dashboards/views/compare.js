"use strict";
// Up to four designs side by side: what was measured of them, to the first one, and the parameters in which they differ.
const Compare = (() => {
  const { element, button } = Dom;

  function view(root, app) {
    const { clip, number } = app;

    // What a number is to the first design's: shares differ by so much, costs by a factor.
    function difference(value, first, way) {
      if (typeof value !== "number" || typeof first !== "number") return "";
      if (value === first) return "same";
      if (way !== "min" || value <= 0 || first <= 0) return `${value > first ? "+" : "−"}${number(Math.abs(value - first))}`;
      const factor = number(value / first);
      return factor === "1" ? "about the same" : `×${factor}`;
    }

    function render(shown) {
      const { page, columns, compared, objectives } = shown;
      root.hidden = compared.length === 0;
      if (root.hidden || shown.moving) return;
      const known = (column) => columns[column] && compared.some(({ value }) => value(column) !== null);
      const differs = (column) => new Set(compared.map(({ value }) => String(value(column)))).size > 1;
      const ways = { ...page.objectives, ...page.budgets.columns };
      const worded = (at, column) => (at.value(column) === null ? "–" : clip(Design.worded(app, shown, at, column), 60));
      const apart = (at, column, k) => (k ? difference(at.value(column), compared[0].value(column), ways[column.replace(/_(corrected|test)$/, "")] ?? "max") : "");
      const measured = app.beside([...objectives, ...Object.keys(page.budgets.columns)]).filter(known);
      const parameters = ["hardware", ...page.design].filter((column) => !measured.includes(column) && column !== "trial" && known(column) && differs(column));
      const line = (column, isMeasured) => [Dom.rowHead(app.title(column)), ...compared.map((at, k) => [worded(at, column), ...(isMeasured && k ? [element("small", { className: "apart", textContent: apart(at, column, k) })] : [])])];
      const nameOf = ({ key, row }) => (row >= 0 ? app.nameOf(row) : `Trial ${key.split(".")[0]}`);
      const head = compared.map((at, k) => element("td", { data: { key: at.key } }, button(clip(nameOf(at), 40), () => app.change({ chosen: at.key }), { title: "choose this design" }),
        " ", button("×", () => app.toggleCompared(at.key), { "aria-label": `remove ${nameOf(at)} from the comparison` })));
      const table = Dom.table("Designs side by side", [["of", "text"], ...compared.map((_, k) => [`${k + 1}`])],
        [[Dom.rowHead("design"), ...head], ...measured.map((column) => line(column, true)), ...parameters.map((column) => line(column, false))]);
      Dom.keepFocus(root, (node) => node.ariaLabel ?? node.textContent, () => root.replaceChildren(element("h2", { textContent: "Side by side" }), table));
    }

    return { render };
  }

  return { view, tabs: ["choose", "inside", "all"] };
})();
Views.compare = Compare;
