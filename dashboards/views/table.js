"use strict";
// The front, or every design, as a table: sorted by any column, searched, chosen from by keyboard, marked where another
// view points.
Views.table = (() => {
  const ROWS = 50; // before all are asked for
  const [COLUMNS_ON_PAPER, ROWS_ON_PAPER] = [8, 5]; // of a report, with a row per trial
  const SETTINGS = ["phi", "theta", "read_out_ms", "weight_bits", "pruned_after"]; // in which points of a trial differ

  const { element, button } = Dom;

  function view(root, app) {
    const { clip, title, withInterval } = app;
    const part = (name) => root.querySelector(name);
    const table = part("table");
    let shown = null;

    // Parameters in which none of some rows has a value, or all have the same, say nothing of them.
    const columnsShown = Data.remembering((page, rows, expert) => {
      const { columns, objectives } = shown;
      const defined = page.definition.table ?? [];
      const isTold = (column) => expert === "1" || !SETTINGS.includes(column);
      const parameters = page.design.filter(isTold).filter((column) => column === "trial" || (column !== "hardware" && new Set(rows.map((row) => columns[column].values[row])).size > 1));
      const several = ["study"].filter((column) => columns[column] && app.distinct(column).length > 1);
      const first = parameters.filter((column) => column === "trial");
      return [...new Set([...first, ...several, ...(defined.length ? app.beside(defined, false) : [...app.beside(objectives, false),
        ...SETTINGS.filter((column) => parameters.includes(column)), ...parameters])])];
    });

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
      const isUp = sorted ? state.order === "descending" : page.objectives[column] !== "max";
      const sort = () => app.change({ sort: column, order: isUp ? "ascending" : "descending" });
      return element("th", { scope: "col", className: app.isNumeric(column) ? "" : "text", "aria-sort": sorted ? state.order : "none" },
        button(clip(title(column), 40), sort, { title: column }));
    }

    function lineFor(row, named) {
      return element("tr", { tabIndex: 0, "aria-selected": String(row === shown.subject.row), data: { key: app.keyOf(row) } }, ...named.map((column) => element("td", {
        textContent: column === "trial" ? app.number(shown.columns.trial.values[row]) : withInterval(column, row), className: app.isNumeric(column) ? "" : "text",
        title: String(shown.columns[column].values[row] ?? "not measured"),
      })));
    }

    const isWhole = () => shown.state.show === "all";

    // What holds every word that is searched for, in any of the columns that are shown.
    function found(some, named) {
      const words = shown.state.find.toLowerCase().split(/\s+/).filter(Boolean);
      if (!words.length) return some;
      return some.filter((row) => {
        const text = named.map((column) => `${column} ${shown.columns[column].values[row] ?? ""}`).join(" ").toLowerCase();
        return words.every((word) => text.includes(word));
      });
    }

    const render = Dom.settled((next) => {
      shown = next;
      const { state, columns, budgeted, objectives } = shown;
      const every = listed();
      const isPaper = app.style().paper === true;
      const named = columnsShown(shown.page, isWhole() ? shown.rows : budgeted.front, state.expert).slice(0, isPaper ? COLUMNS_ON_PAPER : undefined);
      const all = found(every, named);
      const isOnce = (isPaper || (state.once === "" ? isWhole() : state.once === "1")) && Boolean(columns.trial);
      const front = isOnce ? firstOfTrials(all) : all;
      const visible = state.rows === "all" && !isPaper ? front : front.slice(0, isPaper ? ROWS_ON_PAPER : ROWS);
      Dom.keepFocus(table, (node) => node.dataset.key ?? node.title, () => {
        table.tHead.replaceChildren(element("tr", {}, ...named.map(head)));
        table.tBodies[0].replaceChildren(...visible.map((row) => lineFor(row, named)));
      });
      part("#once").checked = isOnce;
      part("label").hidden = !columns.trial || firstOfTrials(all).length === all.length;
      part("h2 span").textContent = isWhole() ? "All designs" : "The best designs";
      part("#front-count").textContent = isWhole() ? `${app.many(all.length)} of ${app.plural(every.length, "setting")}`
        : `${app.plural(all.length, "setting")} that no other beats in ${objectives.map((c) => columns[c].label).join(", ")}`;
      if (document.activeElement !== part("#find")) part("#find").value = state.find;
      Object.assign(part("#all-rows"), { hidden: visible.length === front.length, textContent: `Show all ${app.many(front.length)}` });
    });

    // The first row of each trial and task, in the order of the table.
    function firstOfTrials(some) {
      const [trials, seen] = [shown.columns.trial.values, new Set()];
      return some.filter((row) => !seen.has(trials[row]) && seen.add(trials[row]));
    }

    function hover(key) {
      table.querySelector("tr.pointed")?.classList.remove("pointed");
      [...table.tBodies[0].rows].find((line) => line.dataset.key === key)?.classList.add("pointed");
    }

    const keyAt = (event) => event.target.closest("tbody tr")?.dataset.key;
    for (const kind of ["click", "keydown"]) table.addEventListener(kind, (event) => { if (keyAt(event) && (kind === "click" || event.key === "Enter")) app.change({ chosen: keyAt(event) }); });
    table.addEventListener("pointerover", (event) => app.hover(keyAt(event) ?? null));
    table.addEventListener("pointerleave", () => app.hover(null));
    part("#once").addEventListener("change", (event) => app.change({ once: event.target.checked ? "1" : "0" }));
    part("#find").addEventListener("input", (event) => app.change({ find: event.target.value, rows: "" }, true));
    part("#all-rows").addEventListener("click", () => app.change({ rows: "all" }));

    const sorted = Data.remembering((columns, some, column, way) => (columns[column] ? [...some].sort(order(column, way)) : some));

    // What a CSV of the table holds: every row of it, in its order.
    const listed = () => sorted(shown.columns, isWhole() ? shown.rows : shown.budgeted.front, shown.state.sort, shown.state.order);

    return { render, hover, listed };
  }

  return { view, tabs: ["choose", "all"] };
})();
