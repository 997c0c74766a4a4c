"use strict";
// What could pass for skill in the recordings and the split: a row per probe of `dse audit`.
const Audit = (() => {
  const COLUMNS = ["task", "probe", "accuracy", "chance", "without", "test", "verdict"];
  const ERRORS = { accuracy: "se", chance: null, without: "without_se", test: "test_se" }; // of the columns of numbers
  const BELOW = { probe: "reader", verdict: "remedy" }; // in the same cell

  function view(root, app) {
    const { element, number } = app;
    const line = element("summary");
    const table = element("table", {}, element("thead"), element("tbody"));
    root.append(element("details", {}, line, element("div", { className: "scroll" }, table)));
    let drawn = null;

    const isNumber = (column) => Object.hasOwn(ERRORS, column);

    function value(row, column) {
      if (row[column] === null || !isNumber(column)) return row[column] ?? "–";
      const error = row[ERRORS[column]] ?? null;
      return number(row[column], true) + (error === null ? "" : ` ${app.error(error)}`);
    }

    function cell(row, column) {
      const below = row[BELOW[column]] ? [element("small", { textContent: row[BELOW[column]] })] : [];
      const className = isNumber(column) ? "" : `text ${column}`;
      return element("td", { className }, String(value(row, column)), ...below);
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
        element("th", { scope: "col", className: isNumber(column) ? "" : "text", textContent: column }))));
      table.tBodies[0].replaceChildren(...rows.map((row) =>
        element("tr", { className: row.shortcut ? "shortcut" : "" }, ...columns.map((column) => cell(row, column)))));
    }

    return { render };
  }

  return { view };
})();
Views.audit = Audit;
