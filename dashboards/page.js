"use strict";
// One state object; every view (views.js) is a function of it, and the URL's fragment carries it.
// Text from the study only ever enters the page through textContent or escaped() below.
(async () => {
  const byId = (id) => document.getElementById(id);
  let page, columns, objectives, nRows, rows, axes, tasks, hardware, families, allowed, engine, byKey, plain; // set by take()
  const BOTH = "all";
  const COMPARED = 4; // designs side by side, at most
  const NOTES = 2; // that are open to begin with

  // ---- words and numbers

  const known = { distinct: new WeakMap(), numbers: new WeakMap(), numeric: new WeakMap() }; // of columns: asked for at every step of a slider
  function remembered(kind, column, make) {
    const { values } = columns[column];
    if (!known[kind].has(values)) known[kind].set(values, make(values));
    return known[kind].get(values);
  }
  const distinct = (column) => (columns[column] ? remembered("distinct", column, (values) => [...new Set(values.map(String))]) : []);
  const isNumeric = (column) => remembered("numeric", column, (values) => values.some((v) => typeof v === "number"));
  // A column as numbers, NaN where it has none.
  const numbers = (column) => remembered("numbers", column, (values) => Float64Array.from(values, (v) => (typeof v === "number" ? v : NaN)));
  const title = (column) => columns[column].label + (columns[column].unit ? ` (${columns[column].unit})` : "");
  const clip = (text, n) => ([...text].length <= n ? text : [...text].slice(0, n - 1).join("") + "…");
  const escaped = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");

  const many = (n) => Math.round(n).toLocaleString("en").replace(/,/g, "\u202f");
  const plural = (n, word) => `${many(n)} ${word}${n === 1 ? "" : "s"}`;

  const digits = new Intl.NumberFormat("en", { maximumSignificantDigits: 3 });

  // At most three significant digits; a measured fraction keeps its zeros so that a column lines up.
  function number(value, measured = false) {
    if (typeof value === "boolean") return value ? "yes" : "no";
    if (typeof value !== "number") return value === null || value === undefined ? "–" : String(value);
    const rounded = Number(value.toPrecision(3));
    if (measured && Math.abs(rounded) >= 0.01 && Math.abs(rounded) < 1) return rounded.toFixed(3);
    if (rounded !== 0 && Math.abs(rounded) < 1e-3) return rounded.toExponential();
    return digits.format(rounded).replace(/,/g, "\u202f");
  }

  function withInterval(column, row) {
    const value = columns[column].values[row];
    const ends = page.intervals[column];
    const text = number(value, objectives.includes(column));
    if (!ends || value === null || !(ends.low[row] || ends.high[row])) return text;
    if (Math.abs(ends.low[row] - ends.high[row]) <= 1e-3 * ends.high[row]) {
      return `${text} ± ${Number(ends.high[row].toPrecision(1))}`;
    }
    return `${text} (${number(value - ends.low[row])}–${number(value + ends.high[row])})`;
  }

  const taskOf = (row) => (columns.task ? String(columns.task.values[row]) : "");
  const colourOf = (task, { palette }) => palette[Math.max(0, tasks.indexOf(task)) % palette.length];

  // ---- state

  // A point's name in a link: its trial and its number there, so that it stays when trials are added; a table
  // without these numbers has names of its trials, or of its rows.
  const isNamed = () => columns.trial !== undefined && columns.point !== undefined;
  const keyOf = (row) => (isNamed() ? `${columns.trial.values[row]}.${columns.point.values[row]}`
    : String(distinct("trial").length === nRows ? columns.trial.values[row] : row));
  function rowOf(key) {
    if (byKey === null) {
      byKey = new Map();
      for (const row of rows) byKey.set(keyOf(row), [...(byKey.get(keyOf(row)) ?? []), row]);
    }
    const onChip = (row) => !columns.hardware || String(columns.hardware.values[row]) === state.hardware;
    return (byKey.get(key) ?? []).find(onChip) ?? -1; // costs on another chip would mislead
  }

  const isKey = { includes: (text) => text === "" || /^-?\d+(\.\d+)?$/.test(text) };
  const areKeys = { includes: (text) => text === "" || (text.split(",").length <= COMPARED && text.split(",").every((key) => key && isKey.includes(key))) };
  const isWord = { includes: (text) => /^[a-z]*$/.test(text) };

  function take(data) {
    page = data;
    columns = page.columns;
    objectives = Object.keys(page.objectives);
    nRows = Object.values(columns)[0]?.values.length ?? 0;
    rows = Array.from({ length: nRows }, (_, row) => row);
    byKey = null;
    axes = [...objectives, ...Object.keys(columns).filter((c) => !objectives.includes(c) && isNumeric(c))];
    tasks = distinct("task");
    hardware = distinct("hardware");
    families = [...new Set((columns.family?.values ?? []).filter((name) => name !== null))];
    engine = Budgets.over(page);
    allowed = {
      view: ["2", "3", ...(tasks.length > 1 ? ["s"] : [])], x: axes, y: axes, z: axes, lx: ["0", "1"], ly: ["0", "1"], lz: ["0", "1"],
      task: [...(tasks.length > 1 ? [BOTH] : []), ...tasks], hardware, order: ["ascending", "descending"],
      sort: Object.keys(columns), chosen: isKey, compare: areKeys, tab: isWord, rows: ["", "all"],
      family: [BOTH, ...families], ...Budgets.allowed(page),
    };
    plain = initialState();
  }

  const varies = (column) => distinct(column).length > 1;

  // A column that spans more than two decades reads better in logarithms.
  function spansDecades(column) {
    const values = columns[column].values.filter((v) => typeof v === "number");
    const [low, high] = values.reduce(([least, most], v) => [Math.min(least, v), Math.max(most, v)], [Infinity, -Infinity]);
    return values.length > 0 && low > 0 && high / low > 100;
  }

  const log = (column) => (column && (page.definition.front.log.includes(column) || spansDecades(column)) ? "1" : "0");

  function initialState() {
    const definition = page.definition;
    const fixed = ["y", "x", "z"].map((axis) => (axes.includes(definition.front[axis]) ? definition.front[axis] : null));
    const preferred = [...objectives.slice(0, 1), ...objectives.filter((c) => c === "energy_uj"), ...objectives];
    const left = [...new Set([...preferred.filter(varies), ...objectives, ...axes])].filter((column) => !fixed.includes(column));
    const [y, x, z] = fixed.map((column) => column ?? left.shift() ?? axes[0]);
    const sort = definition.sort ?? objectives[0] ?? "";
    return {
      view: String(definition.front.dimensions), y, x, z, lx: log(x), ly: log(y), lz: log(z),
      task: tasks.length > 1 ? BOTH : tasks[0] ?? BOTH, hardware: hardware[0] ?? "",
      sort, order: page.objectives[sort] === "max" ? "descending" : "ascending",
      chosen: "", compare: "", tab: definition.design[0] ?? "", rows: "", family: BOTH, ...Budgets.plain(page),
    };
  }

  function readState() {
    const read = { ...plain };
    for (const [key, value] of new URLSearchParams(location.hash.slice(1))) {
      if (Object.hasOwn(allowed, key) && allowed[key].includes(value)) read[key] = value;
    }
    return read;
  }

  take(await Data.read());
  let state = readState();
  let writing;

  // `moving`: more of the same follows at once, as when a slider is dragged.
  function change(part, moving = Object.keys(part).some((key) => key.startsWith("b."))) {
    for (const axis of ["x", "y", "z"]) {
      if (axis in part) part[`l${axis}`] = log(part[axis]);
    }
    state = { ...state, ...part };
    writeState(moving);
    render(moving);
  }

  function writeState(later = false) {
    const moved = Object.entries(state).filter(([key, value]) => value !== plain[key]);
    clearTimeout(writing);
    const write = () => history.replaceState(null, "", "#" + new URLSearchParams(moved));
    // A drag is many changes, and browsers limit how often a link may change.
    if (later) writing = setTimeout(write, 100);
    else write();
  }

  // ---- new data of a served page (live.js)

  function show(data) {
    const before = { state, plain, empty: page.state !== null };
    take(data);
    // What is looked at stays; only a choice of task that nobody made follows the tasks that there are.
    const valid = Object.entries(before.state).filter(([key, value]) => allowed[key]?.includes(value) &&
      !(key === "task" && value === before.plain.task));
    state = before.empty ? readState() : { ...plain, ...Object.fromEntries(valid) };
    if (page.state === null) writeState();
    render();
  }

  // ---- what the state selects

  const isShown = (row) =>
    (state.task === BOTH || !columns.task || String(columns.task.values[row]) === state.task) &&
    (!columns.hardware || String(columns.hardware.values[row]) === state.hardware) &&
    (state.family === BOTH || columns.family.values[row] === state.family);

  // A point by its key; its numbers come from its row, or, off the page, from what its surface says (design.js).
  function point(key) {
    const values = surfaces.get(`${key}@${state.hardware}`);
    const row = values ? -1 : rowOf(key);
    return { key, row, value: (column) => (values ? values[column] : columns[column]?.values[row]) ?? null };
  }
  const surfaces = new Map();

  // What every view is a function of.
  function selection(moving) {
    const budgeted = engine.evaluate(state);
    const limited = budgeted.limits.length || state.family !== BOTH;
    return {
      page, columns, objectives, state, budgeted, moving, onFront: new Set(budgeted.front), rows: rows.filter(isShown),
      within: (row) => budgeted.limits.length === 0 || budgeted.within[row] === 1,
      // The front over some columns alone, if each has a direction and no two are the same.
      joined: (named) => {
        const key = [...named].sort().join("|");
        if (!Object.hasOwn(page.fronts, key)) return null;
        return (limited ? engine.joined(budgeted, named) : page.fronts[key]).filter(isShown);
      },
      chosen: state.chosen ? point(state.chosen) : null,
      compared: state.compare ? state.compare.split(",").map(point) : [],
    };
  }

  // ---- what the page is made of

  function element(tag, properties = {}, ...children) {
    const node = Object.assign(document.createElement(tag), properties);
    node.append(...children);
    return node;
  }

  function download(name, address) {
    element("a", { href: address, download: name }).click();
  }

  // Values of a point that is no row of the page; `values` is {column: value}.
  function setPoint(key, values) {
    surfaces.set(`${key}@${state.hardware}`, values);
  }

  const toggleCompared = (key) => {
    const now = state.compare ? state.compare.split(",") : [];
    change({ compare: (now.includes(key) ? now.filter((one) => one !== key) : [...now, key].slice(-COMPARED)).join(",") });
  };

  const app = {
    element, clip, number, withInterval, escaped, title, many, plural, change, keyOf, rowOf, isNumeric, distinct, numbers, varies, taskOf, colourOf, setPoint,
    toggleCompared, download, style: () => Figure.style(page.palette),
    hover: (key) => views.forEach(({ view }) => view.hover?.(key)),
  };
  const views = [...document.querySelectorAll("[data-view]")].map((root) => {
    const { view: name, place } = root.dataset;
    if (place === "top") document.querySelector("main").before(root);
    if (place === "side") byId("views").after(root);
    return { name, root, whenEmpty: Views[name].whenEmpty === true, view: Views[name].view(root, app) };
  });
  const showBudgets = Budgets.panel(byId("budgets"), app);

  for (const { name, root, view } of views.filter((one) => one.view.image)) {
    const place = root.querySelector(".save") ?? root.appendChild(element("span", { className: "save" }));
    place.append(...["svg", "png"].map((format) => {
      const button = element("button", { type: "button", textContent: format.toUpperCase(), title: `save this figure as ${format.toUpperCase()}` });
      button.addEventListener("click", async () => download(`${clip(page.name, 80).replace(/[^\p{L}\p{N}_-]+/gu, "_")}-${name}.${format}`, await view.image(format)));
      return button;
    }));
  }

  // ---- views of the page itself

  function renderHeader(shown) {
    const counts = Object.entries(page.counts).map(([status, n]) => `${number(n)} ${status}`);
    const best = shown.rows.filter((row) => shown.onFront.has(row)).length;
    if (nRows) counts.push(`${plural(shown.rows.length, "point")}, ${many(best)} on the front`);
    byId("counts").textContent = counts.join(" · ");
    byId("title").textContent = page.definition.title;
    const open = byId("notes").querySelector("details")?.open ?? false;
    const notes = page.notes.map((text) => element("li", { textContent: text }));
    const rest = notes.splice(NOTES);
    byId("notes").replaceChildren(...notes, ...(rest.length ? [element("li", {},
      element("details", { open }, element("summary", { textContent: plural(rest.length, "more note") }), element("ul", {}, ...rest)))] : []));
  }

  function fillSelect(id, options, names) {
    const select = byId(id);
    const content = JSON.stringify([options, names]);
    if (select.dataset.content !== content) {
      select.dataset.content = content;
      select.replaceChildren(...options.map((value, k) => element("option", { value, textContent: clip(names[k], 40) })));
    }
    select.value = state[id];
  }

  function renderControls() {
    for (const axis of ["x", "y", "z"]) {
      fillSelect(axis, axes, axes.map(title));
      byId(`l${axis}`).checked = state[`l${axis}`] === "1";
      byId(`l${axis}`).disabled = numbers(state[axis]).some((v) => v <= 0);
    }
    fillSelect("task", allowed.task, allowed.task.map((t) => (t === BOTH && tasks.length > 1 ? "all" : t)));
    fillSelect("hardware", hardware, hardware);
    fillSelect("family", [BOTH, ...families], ["all", ...families]);
    byId("family-label").hidden = families.length < 2;
    byId("task-label").hidden = tasks.length < 2;
    byId("hardware-label").hidden = hardware.length < 2;
    byId("view-s").hidden = tasks.length < 2;
    byId("third").hidden = state.view !== "3";
    for (const n of ["2", "3", "s"]) byId(`view-${n}`).setAttribute("aria-pressed", String(state.view === n));
  }

  function renderFailures() {
    const failed = page.failures;
    byId("failures").hidden = failed.length === 0;
    if (!failed.length) return;
    const details = byId("failures").querySelector("details");
    details.open ||= nRows === 0;
    details.querySelector("summary").textContent = plural(failed.length, "failed trial");
    const table = details.querySelector("table");
    table.tHead.replaceChildren(element("tr", {}, ...["trial", "reason", "design"].map((text) => element("th", { scope: "col", textContent: text }))));
    table.tBodies[0].replaceChildren(...failed.map(({ trial, reason, design }) => element("tr", {},
      element("td", { textContent: number(trial) }),
      element("td", { textContent: clip(reason, 600) }),
      element("td", { textContent: Object.entries(design).map(([key, value]) => `${key} ${number(value)}`).join(", ") }),
    )));
  }

  function renderBundle({ budgeted }) {
    const link = byId("bundle");
    link.hidden = !Details.isServed(page) || budgeted.pick < 0 || !isNamed();
    if (link.hidden) return;
    const [trial, number] = keyOf(budgeted.pick).split(".");
    const chip = columns.hardware ? { hardware: columns.hardware.values[budgeted.pick] } : {};
    link.href = Details.address("bundle.zip", { trial, point: number, ...chip });
  }

  function render(moving = false) {
    const empty = page.state !== null;
    const names = page.definition.views;
    byId("state").hidden = !empty;
    byId("budgets").hidden = empty;
    for (const { name, root, whenEmpty } of views) {
      if (!names.includes(name) || !whenEmpty) root.hidden = empty || !names.includes(name);
      root.style.order = names.indexOf(name);
    }
    const shown = selection(moving);
    renderHeader(shown);
    renderFailures();
    for (const { name, view, whenEmpty } of views) if (whenEmpty && names.includes(name)) view.render(shown);
    if (empty) {
      byId("state").querySelector("h2").textContent = page.state.title;
      byId("state").querySelector("p").textContent = page.state.text;
      return;
    }
    showBudgets(state, shown.budgeted);
    renderBundle(shown);
    renderControls();
    for (const { name, view, whenEmpty } of views) if (!whenEmpty && names.includes(name)) view.render(shown);
  }

  // ---- what a reader does

  const KEYS = [
    ["Tab, Shift+Tab", "through budgets, figures and tables"], ["← → on a slider", "moves the budget, φ or θ by a step; ↑ ↓ on a handle of an axis too"],
    ["Enter on a row", "chooses its design"], ["c", "adds the chosen design to the comparison, or removes it"],
    ["2, 3", "the front in the plane, in space"], ["Escape", "chooses nothing"], ["?", "these keys"],
  ];
  byId("keys").querySelector("dl").append(...KEYS.flatMap(([key, does]) =>
    [element("dt", {}, element("kbd", { textContent: key })), element("dd", { textContent: does })]));
  const does = {
    "?": () => byId("keys").showModal(), Escape: () => change({ chosen: "" }), 2: () => change({ view: "2" }), 3: () => change({ view: "3" }),
    c: () => { if (state.chosen) toggleCompared(state.chosen); },
  };
  addEventListener("keydown", (event) => {
    const typed = event.target.matches("input:not([type=range]), select, textarea") || byId("keys").open;
    if (typed || event.ctrlKey || event.altKey || event.metaKey || page.state !== null || !Object.hasOwn(does, event.key)) return;
    does[event.key]();
  });
  byId("help").addEventListener("click", does["?"]);
  byId("controls").addEventListener("submit", (event) => event.preventDefault());
  for (const id of ["x", "y", "z", "task", "family", "hardware"]) byId(id).addEventListener("change", (e) => change({ [id]: e.target.value }));
  for (const id of ["lx", "ly", "lz"]) byId(id).addEventListener("change", (e) => change({ [id]: e.target.checked ? "1" : "0" }));
  for (const n of ["2", "3", "s"]) byId(`view-${n}`).addEventListener("click", () => change({ view: n }));
  addEventListener("live", (event) => show(event.detail));
  addEventListener("hashchange", () => { state = readState(); render(); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => render());
  render();
})();
