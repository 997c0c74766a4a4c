"use strict";
// Nodes of a page: how views make them, and what stays when they are made anew.
const Dom = (() => {
  // A node with properties; `role` and names with a dash are attributes, `data` is its data set, `style` its own style, on... are listeners.
  function element(tag, properties = {}, ...children) {
    const node = document.createElement(tag);
    for (const [name, value] of Object.entries(properties)) {
      if (name === "data") Object.assign(node.dataset, value);
      else if (name === "style") Object.assign(node.style, value);
      else if (name === "role" || name.includes("-")) node.setAttribute(name, value);
      else node[name] = value;
    }
    node.append(...children);
    return node;
  }

  // A node of a drawing; `text` is its text, `on` its listeners by event.
  function svg(tag, { text, on = {}, ...attributes } = {}, ...children) {
    const node = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [name, value] of Object.entries(attributes)) if (value !== undefined) node.setAttribute(name, value);
    for (const [event, heard] of Object.entries(on)) node.addEventListener(event, heard);
    node.append(...(text === undefined ? [] : [text]), ...children);
    return node;
  }

  const button = (textContent, onclick, more = {}) => element("button", { type: "button", textContent, onclick, ...more });

  // What scrolls sideways inside the page, by keyboard too.
  const scroll = (label, ...children) => element("div", { className: "scroll", tabIndex: 0, role: "group", "aria-label": label }, ...children);

  // A table that scrolls. Columns are [heading, class]; a row is its cells, or {cells, className}; a cell is a text,
  // a node, several of them, or a finished <td> or <th>.
  function table(label, columns, rows) {
    const finished = (cell) => cell instanceof HTMLTableCellElement;
    const line = (row) => {
      const { cells = row, className = "" } = row;
      return element("tr", { className }, ...cells.map((cell, k) =>
        (finished(cell) ? cell : element("td", { className: columns[k][1] ?? "" }, ...[cell].flat()))));
    };
    const head = columns.map(([textContent, className = ""]) => element("th", { scope: "col", className, textContent }));
    return scroll(label, element("table", {}, element("thead", {}, element("tr", {}, ...head)), element("tbody", {}, ...rows.map(line))));
  }

  // Nodes inside another, by selectors.
  const parts = (root, ...selectors) => selectors.map((selector) => root.querySelector(selector));

  const rowHead = (...content) => element("th", { scope: "row", className: "text" }, ...content);

  // A list of options [value, text].
  const choice = (label, onchange, more = {}) => element("select", { "aria-label": label, onchange: (event) => onchange(event.target.value), ...more });

  // Options [value, text] of a list; the one that was chosen stays, or else `value` is.
  function fill(select, options, value = select.value) {
    const content = JSON.stringify(options);
    if (select.dataset.content !== content) {
      select.dataset.content = content;
      select.replaceChildren(...options.map(([one, textContent]) => element("option", { value: one, textContent })));
    }
    if (options.some(([one]) => String(one) === String(value))) select.value = value;
  }

  // Replaces nodes; if one inside had the focus, the one of the same name gets it.
  function keepFocus(root, nameOf, replace) {
    const name = root.contains(document.activeElement) ? nameOf(document.activeElement) : undefined;
    replace();
    if (name === undefined) return;
    [...root.querySelectorAll("button, input, select, [tabindex]")].find((node) => nameOf(node) === name)?.focus({ preventScroll: true });
  }

  // A strip of tabs, of which one is open and through which the arrow keys go. `words` are their texts by name,
  // `properties` those of the button of a tab; `render` shows some of them.
  function strip(node, words, opened, properties) {
    function render(names, open) {
      const made = (tab) => button(words[tab], () => opened(tab), { role: "tab", data: { tab }, ...properties(tab) });
      if ([...node.children].map(({ dataset }) => dataset.tab).join() !== names.join()) keepFocus(node, ({ dataset }) => dataset.tab, () => node.replaceChildren(...names.map(made)));
      for (const tab of node.children) {
        const isOpen = tab.dataset.tab === open;
        tab.setAttribute("aria-selected", String(isOpen));
        tab.tabIndex = isOpen ? 0 : -1;
      }
    }
    node.addEventListener("keydown", (event) => {
      const tabs = [...node.children];
      const at = tabs.indexOf(document.activeElement);
      const to = { ArrowLeft: at - 1 + tabs.length, ArrowRight: at + 1, Home: 0, End: tabs.length - 1 }[event.key];
      if (to === undefined || at < 0) return;
      event.preventDefault();
      const next = tabs[to % tabs.length];
      opened(next.dataset.tab);
      next.focus({ preventScroll: true });
    });
    return { render };
  }

  // What draws a selection: at once, or, while a budget moves, when it rests.
  function settled(draw, ms = 150) {
    let waiting = 0;
    return (shown) => {
      clearTimeout(waiting);
      if (shown.moving) waiting = setTimeout(() => draw(shown), ms);
      else draw(shown);
    };
  }

  return { element, svg, button, scroll, table, parts, rowHead, choice, fill, keepFocus, strip, settled };
})();
