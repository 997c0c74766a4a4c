"use strict";
// What could pass for skill in the recordings and the split: a row per probe of `dse audit`.
const Audit = (() => {
  const COLUMNS = ["task", "probe", "reader", "accuracy", "chance", "without", "verdict", "remedy"];
  const NUMBERS = ["accuracy", "chance", "without"];

  function view(root, app) {
    const { element, number } = app;
    const line = element("summary");
    const table = element("table", {}, element("thead"), element("tbody"));
    root.append(element("details", {}, line, element("div", { className: "scroll" }, table)));
    let drawn = null;

    function cell(row, column) {
      const className = NUMBERS.includes(column) ? "" : "text";
      const error = column === "accuracy" ? row.se : column === "without" ? row.without_se : null;
      const text = row[column] === null ? "–"
        : NUMBERS.includes(column) ? number(row[column], true) + (error === null ? "" : ` ± ${Number(error.toPrecision(1))}`)
        : String(row[column]);
      return element("td", { className, textContent: text });
    }

    function render({ page }) {
      const rows = page.audit ?? [];
      root.hidden = rows.length === 0;
      if (rows === drawn || rows.length === 0) return;
      drawn = rows;
      const several = new Set(rows.map(({ task }) => task)).size > 1;
      const columns = COLUMNS.filter((column) => column !== "task" || several);
      const shortcuts = rows.filter(({ shortcut }) => shortcut);
      const named = [...new Set(shortcuts.map(({ probe, task }) => (several ? `${probe} (${task})` : probe)))];
      line.textContent = named.length ? `Audit: could pass for skill: ${named.join(", ")}`
        : "Audit: no probe found a shortcut in the recordings";
      table.tHead.replaceChildren(element("tr", {}, ...columns.map((column) =>
        element("th", { scope: "col", className: NUMBERS.includes(column) ? "" : "text", textContent: column }))));
      table.tBodies[0].replaceChildren(...rows.map((row) =>
        element("tr", { className: row.shortcut ? "shortcut" : "" }, ...columns.map((column) => cell(row, column)))));
    }

    return { render };
  }

  return { view };
})();
Views.audit = Audit;
