"use strict";
// The model card of the design, as its bundle holds it: what a file carries, or what a server tells once it is opened.
Views.card = (() => {
  const { element } = Dom;
  const row = ([name, ...cells]) => element("tr", {}, Dom.rowHead(name), ...cells.map((textContent) => element("td", { className: "text", textContent })));
  const lists = { ul: (items) => items.map((textContent) => element("li", { textContent })), table: (rows) => [element("tbody", {}, ...rows.map(row))] };

  function view(root, app) {
    const [box, body] = Dom.parts(root, "details", "div");
    box.ontoggle = () => { if (box.open) load(shown); };
    let [shown, drawn, loading] = [null, "", null];

    const fill = (parts) => body.replaceChildren(...parts.map(([tag, content]) => element(tag, {}, ...(lists[tag] ?? ((text) => [text]))(content))));

    function load({ page, subject, columns, state }) {
      const [trial, point, hardware] = [subject.value("trial"), subject.value("point"), columns.hardware ? state.hardware : ""];
      const key = `${trial}.${point}@${hardware}`;
      if (key === drawn) return loading;
      drawn = key;
      const carried = page.cards?.[key];
      fill(carried ?? [["p", Details.isServed(page) ? "…" : "This file carries the model cards of its picks; a served page has all."]]);
      loading = carried || !Details.isServed(page) ? null : Details.ask("card.json", { trial, point, hardware }).then(({ why, parts = [["p", why]] }) => { if (key === drawn) fill(parts); });
      return loading;
    }

    function render(next) {
      shown = next;
      if (app.style().paper) box.open = true;
      if (box.open) load(shown);
    }

    return { render: Dom.settled(render), load };
  }

  return { view, tabs: ["inside"], has: (page) => Boolean(page.cards || Details.isServed(page)) };
})();
