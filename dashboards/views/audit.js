"use strict";
// What could pass for skill in the recordings and the split: a row per probe of `dse audit`.
const Audit = (() => {
  const COLUMNS = ["task", "probe", "accuracy", "chance", "without", "test", "verdict"];
  const ERRORS = { accuracy: "se", chance: null, without: "without_se", test: "test_se" }; // of the columns of numbers
  const BELOW = { probe: "reader", verdict: "remedy" }; // in the same cell
  const { element } = Dom;

  function view(root, app) {
    const line = element("summary");
    const place = element("div");
    root.append(element("details", {}, line, place));
    let drawn = null;

    const isNumber = (column) => Object.hasOwn(ERRORS, column);

    function value(row, column) {
      if (row[column] === null || !isNumber(column)) return row[column] ?? "–";
      const error = row[ERRORS[column]] ?? null;
      return app.number(row[column], true) + (error === null ? "" : ` ${app.error(error)}`);
    }

    const cell = (row, column) => [String(value(row, column)), ...(row[BELOW[column]] ? [element("small", { textContent: row[BELOW[column]] })] : [])];

    function render({ page }) {
      const rows = page.audit ?? [];
      root.hidden = rows.length === 0;
      if (rows === drawn || rows.length === 0) return;
      drawn = rows;
      const several = new Set(rows.map(({ task }) => task)).size > 1;
      const columns = COLUMNS.filter((column) =>
        column === "task" ? several : column !== "test" || rows.some((row) => (row.test ?? null) !== null));
      const shortcuts = rows.filter(({ shortcut }) => shortcut);
      const named = [...new Set(shortcuts.map(({ probe, task }) => (several ? `${probe} (${task})` : probe)))];
      line.textContent = named.length ? `Audit: could pass for skill: ${named.join(", ")}`
        : "Audit: no probe found a shortcut in the recordings";
      place.replaceChildren(Dom.table("Probes", columns.map((column) => [column, isNumber(column) ? "" : `text ${column}`]),
        rows.map((row) => ({ className: row.shortcut ? "shortcut" : "", cells: columns.map((column) => cell(row, column)) }))));
    }

    return { render };
  }

  return { view, tabs: ["run"], has: (page) => (page.audit ?? []).length > 0 };
})();
Views.audit = Audit;
