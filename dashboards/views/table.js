"use strict";
// The front as a table: sorted by any column, chosen from by keyboard, marked where another view points.
const Table = (() => {
  const ROWS = 50; // before all are asked for

  function view(root, app) {
    const { element, clip, title, withInterval } = app;
    const part = (name) => root.querySelector(name);
    const table = part("table");
    let shown = null;
    let made = { page: null, key: "", lines: new Map() }; // lines of rows: a slider at work shows most of them again

    function columnsShown() {
      const { page, columns, objectives } = shown;
      const defined = page.definition.table ?? [];
      const parameters = page.design.filter((column) => column === "trial" || (column !== "hardware" && app.varies(column)));
      const several = columns.task && app.distinct("task").length > 1 ? ["task"] : [];
      const first = parameters.filter((column) => column === "trial");
      return [...new Set([...first, ...several, ...(defined.length ? defined : [...objectives, ...parameters])])];
    }

    function order(column, way) {
      const sign = way === "ascending" ? 1 : -1;
      const { values } = shown.columns[column];
      return (a, b) => {
        const [left, right] = [values[a], values[b]];
        if (left === null || right === null) return (left === null) - (right === null) || a - b;
        const both = typeof left === "number" && typeof right === "number";
        return sign * (both ? left - right : String(left).localeCompare(String(right))) || a - b;
      };
    }

    function head(column) {
      const { state, page } = shown;
      const sorted = state.sort === column;
      const button = element("button", { type: "button", textContent: clip(title(column), 40), title: column });
      button.addEventListener("click", () => app.change({
        sort: column,
        order: sorted ? (state.order === "ascending" ? "descending" : "ascending")
          : page.objectives[column] === "max" ? "descending" : "ascending",
      }));
      const cell = element("th", { scope: "col", className: app.isNumeric(column) ? "" : "text" }, button);
      cell.setAttribute("aria-sort", sorted ? state.order : "none");
      return cell;
    }

    function lineFor(row, named) {
      const line = element("tr", { tabIndex: 0 }, ...named.map((column) => element("td", {
        textContent: withInterval(column, row), className: app.isNumeric(column) ? "" : "text",
        title: String(shown.columns[column].values[row] ?? "not measured"),
      })));
      line.dataset.key = app.keyOf(row);
      return line;
    }

    function render(next) {
      shown = next;
      const { state, columns, budgeted, objectives } = shown;
      const named = columnsShown();
      const front = [...budgeted.front];
      if (columns[state.sort]) front.sort(order(state.sort, state.order));
      const visible = state.rows === "all" ? front : front.slice(0, ROWS);
      const chosen = shown.chosen?.row;
      const columnsKey = JSON.stringify(named);
      if (made.page !== shown.page || made.key !== columnsKey) made = { page: shown.page, key: columnsKey, lines: new Map() };
      const body = visible.map((row) => {
        if (!made.lines.has(row)) made.lines.set(row, lineFor(row, named));
        const line = made.lines.get(row);
        line.classList.remove("pointed");
        line.setAttribute("aria-selected", String(row === chosen));
        return line;
      });
      const focused = table.contains(document.activeElement) ? document.activeElement.closest("tr[data-key], th") : null;
      const [key, column] = [focused?.dataset.key, focused?.querySelector("button")?.title];
      table.tHead.replaceChildren(element("tr", {}, ...named.map(head)));
      table.tBodies[0].replaceChildren(...body);
      const again = key !== undefined ? lineOf(key) : column === undefined ? null
        : [...table.tHead.querySelectorAll("button")].find((button) => button.title === column);
      again?.focus({ preventScroll: true });
      part("#front-count").textContent = `${app.plural(front.length, "design")} that nothing beats over ${objectives.map((c) => columns[c].label).join(", ")}`;
      part("#more").hidden = visible.length === front.length;
      part("#more").textContent = `Show all ${app.many(front.length)}`;
    }

    const lineOf = (key) => [...table.tBodies[0].rows].find((line) => line.dataset.key === key);

    function hover(key) {
      table.querySelector("tr.pointed")?.classList.remove("pointed");
      if (key !== null) lineOf(key)?.classList.add("pointed");
    }

    const keyAt = (event) => event.target.closest("tbody tr")?.dataset.key;
    table.addEventListener("click", (event) => { if (keyAt(event)) app.change({ chosen: keyAt(event) }); });
    table.addEventListener("keydown", (event) => {
      if (event.key === "Enter" && keyAt(event)) app.change({ chosen: keyAt(event) });
    });
    table.addEventListener("pointerover", (event) => app.hover(keyAt(event) ?? null));
    table.addEventListener("pointerleave", () => app.hover(null));
    part("#more").addEventListener("click", () => app.change({ rows: "all" }));

    return { render, hover };
  }

  return { view };
})();
Views.table = Table;
