"use strict";
// What a first look does not need: axes and colours, filters of any column, how certain a front must be, what is left out.
Views.expert = (() => {
  const { element, button } = Dom;

  function view(root, app) {
    const { clip, number, title, change, plural } = app;
    const part = (id) => root.querySelector(`#${id}`);
    let [shown, opened] = [null, []]; // columns whose filter is shown, though it may not exclude anything yet

    function renderControls() {
      const { state } = shown;
      const { axes, families, allowed } = app.lists();
      const fill = (id, options, nameOf) => Dom.fill(part(id), options.map((value) => [value, clip(nameOf(value), 40)]), state[id]);
      for (const axis of ["x", "y"]) {
        fill(axis, axes, title);
        Object.assign(part(`l${axis}`), { checked: state[`l${axis}`] === "1", disabled: !app.canBeLog(state[axis]) });
      }
      fill("colour", allowed.colour, (column) => (column === "" ? `auto: ${app.ownColour() || "none"}` : title(column)));
      fill("family", allowed.family, String);
      part("family").parentElement.hidden = families.length < 2;
    }

    function renderSure() {
      part("sure-label").hidden = !shown.columns.front_probability?.values.some((value) => value !== null);
      const share = Math.round(100 * Number(shown.state.sure || 0));
      if (Number(part("sure").value) !== share) part("sure").value = share;
      part("sure-text").textContent = `${share}\u202f% of the samples`;
    }

    const severally = (reason) => reason.replace(/^does /, "do ").replace(/^has seen /, "have seen ");
    function renderLeftOut() {
      const { rows, isShown } = app.lists();
      const reasons = new Map();
      part("oversize").checked = shown.state.oversize === "1";
      part("larger").hidden = !rows.some((row) => isShown(row) && shown.columns.fits?.values[row] === false);
      for (const row of rows) {
        const reason = isShown(row) && shown.budgeted.matches(row) ? shown.leftOut(row) : "";
        if (reason) reasons.set(reason, (reasons.get(reason) ?? 0) + 1);
      }
      part("left").hidden = reasons.size === 0;
      part("left-out").checked = shown.state.left === "1";
      const sampled = shown.budgeted.exact ? "" : " of those shown";
      part("left").querySelector("span").textContent = `draw ${[...reasons].map(([reason, n]) => `${plural(n, "setting")}${sampled} that ${n === 1 ? reason : severally(reason)}`).join(", ")}`;
    }

    // ---- filters: two ends of any column of numbers, or some values of any other

    const filterOf = (column) => part("filters").querySelector(`fieldset[data-column="${CSS.escape(column)}"]`);
    function newFilter(column) {
      const { label } = shown.columns[column];
      const node = element("fieldset", { data: { column } }, element("legend", { textContent: clip(title(column), 40), title: column }));
      const set = (text) => change({ [`f.${column}`]: text });
      const inputs = () => [...node.querySelectorAll("input")];
      if (app.isNumeric(column)) {
        const moved = () => set(inputs().every(({ value }) => value === "") ? "" : inputs().map(({ value }) => value).join("~"));
        const [from, to] = ["from", "to"].map((end) => element("input", { type: "number", step: "any", "aria-label": `${label} ${end}`, oninput: moved }));
        node.append(from, " to ", to);
      } else {
        const moved = () => {
          const taken = inputs().filter(({ checked }) => checked).map(({ value }) => value);
          set(taken.length === app.categories(column).length ? "" : Budgets.oneOf(taken));
        };
        node.append(...app.categories(column).map((value) => element("label", {}, element("input", { type: "checkbox", value, onchange: moved }), ` ${clip(value, 24)}`)));
      }
      const remove = () => {
        opened = opened.filter((other) => other !== column);
        set("");
        part("add-filter").focus();
      };
      node.append(" ", button("×", remove, { title: "remove this filter", "aria-label": `remove the filter of ${label}` }));
      return node;
    }

    function renderFilters() {
      const { filterable } = app.lists();
      const place = part("filters").querySelector("div");
      opened = filterable.filter((column) => opened.includes(column) || shown.state[`f.${column}`]);
      for (const node of [...place.children]) if (!opened.includes(node.dataset.column)) node.remove();
      for (const column of opened) {
        const node = filterOf(column) ?? place.appendChild(newFilter(column));
        const text = shown.state[`f.${column}`];
        const inputs = [...node.querySelectorAll("input")];
        if (app.isNumeric(column)) {
          const range = Data.ends([...app.numbers(column)].filter(Number.isFinite));
          text.split("~").concat("").slice(0, 2).forEach((end, k) => {
            if (inputs[k].value !== end && document.activeElement !== inputs[k]) inputs[k].value = end;
            inputs[k].placeholder = number(range[k]);
          });
        } else {
          const { values } = Budgets.filter(text);
          for (const box of inputs) box.checked = !values || values.has(box.value);
        }
      }
      const left = filterable.filter((column) => !opened.includes(column));
      part("filters").hidden = filterable.length === 0;
      const select = part("add-filter");
      select.replaceChildren(element("option", { value: "", textContent: "add …" }), ...left.map((value) => element("option", { value, textContent: clip(title(value), 40) })));
      select.disabled = left.length === 0;
    }

    for (const id of ["x", "y", "colour", "family"]) part(id).addEventListener("change", (event) => change({ [id]: event.target.value }));
    for (const [id, key] of [["lx", "lx"], ["ly", "ly"], ["oversize", "oversize"], ["left-out", "left"]]) part(id).addEventListener("change",
      (event) => change({ [key]: event.target.checked ? "1" : "0" }));
    part("sure").addEventListener("input", (event) => change({ sure: Number(event.target.value) ? String(Number(event.target.value) / 100) : "" }));
    part("add-filter").addEventListener("change", (event) => {
      const column = event.target.value;
      opened.push(column);
      renderFilters();
      filterOf(column).querySelector("input").focus();
    });

    const box = root.querySelector("details");
    box.querySelector("summary").addEventListener("click", (event) => {
      event.preventDefault();
      change({ expert: box.open ? "0" : "1" });
    });
    function draw(next) {
      shown = next;
      // What is set is seen.
      box.open = next.state.expert === "1" || Object.entries(next.state).some(([key, value]) => key.startsWith("f.")
        && value !== "") || next.state.sure !== "" || next.state.left === "1" || next.state.oversize === "1";
      if (!box.open) return;
      renderControls();
      renderSure();
      renderLeftOut();
      renderFilters();
    }

    return { render: (next) => { if (next.moving) shown = next; else draw(next); } };
  }

  return { view, tabs: ["choose", "inside", "all"] };
})();
