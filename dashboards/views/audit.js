"use strict";
// What could pass for skill in the recordings and the split: a row per probe of `dse audit`.
Views.audit = (() => {
  const { element } = Dom;

  function view(root, app) {
    const [line, place] = Dom.parts(root, "summary", "div");
    const cell = (value, error = null) => (typeof value === "number" ? `${app.number(value, true)}${error === null ? "" : ` ${app.error(error)}`}` : "–");
    const below = (text, more) => [text, ...(more ? [element("small", { textContent: more })] : [])];

    function render({ page: { audit: rows } }) {
      const several = new Set(rows.map(({ task }) => task)).size > 1;
      const tested = rows.some(({ test }) => typeof test === "number");
      const heads = [...(several ? [["task", "text"]] : []), ["probe", "text"], ["accuracy"], ["chance"], ["without"], ...(tested ? [["test"]] : []), ["verdict", "text verdict"]];
      const cells = (row) => [...(several ? [row.task] : []), below(row.probe, row.reader), cell(row.accuracy, row.se), cell(row.chance), cell(row.without, row.without_se),
        ...(tested ? [cell(row.test, row.test_se)] : []), below(row.verdict, row.remedy)];
      const shortcuts = rows.filter(({ shortcut }) => shortcut);
      const named = [...new Set(shortcuts.map(({ probe, task }) => (several ? `${probe} (${task})` : probe)))];
      line.textContent = named.length ? `Audit: could pass for skill: ${named.join(", ")}`
        : "Audit: no probe found a shortcut in the recordings";
      place.replaceChildren(Dom.table("Probes", heads, rows.map((row) => ({ className: row.shortcut ? "shortcut" : "", cells: cells(row) }))));
    }

    return { render };
  }

  return { view, tabs: ["run"], has: (page) => (page.audit ?? []).length > 0 };
})();
