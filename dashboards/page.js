"use strict";
// One state object; every view is a function of it, and the URL's fragment carries it.
// Text from the study only ever enters the page through textContent or escaped() below.
(() => {
  const byId = (id) => document.getElementById(id);
  let page, columns, objectives, nRows, rows, axes, tasks, hardware, families, allowed, engine; // set by take()
  const TABLE_ROWS = 50;
  const BARS = 40;
  const HOVER_CHARACTERS = 60;
  const BOTH = "all";

  // ---- words and numbers

  const isNumeric = (column) => columns[column].values.some((v) => typeof v === "number");
  const known = new WeakMap(); // distinct values of columns: asked for at every step of a slider
  function distinct(column) {
    const values = columns[column]?.values ?? [];
    if (!known.has(values)) known.set(values, [...new Set(values.map(String))]);
    return known.get(values);
  }
  const title = (column) => columns[column].label + (columns[column].unit ? ` (${columns[column].unit})` : "");
  const clip = (text, n) => ([...text].length <= n ? text : [...text].slice(0, n - 1).join("") + "…");
  const escaped = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");

  const plural = (n, word) => `${n.toLocaleString("en")} ${word}${n === 1 ? "" : "s"}`;

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

  // ---- state

  function take(data) {
    page = data;
    columns = page.columns;
    objectives = Object.keys(page.objectives);
    nRows = Object.values(columns)[0]?.values.length ?? 0;
    rows = Array.from({ length: nRows }, (_, row) => row);
    axes = [...objectives, ...Object.keys(columns).filter((c) => !objectives.includes(c) && isNumeric(c))];
    tasks = distinct("task");
    hardware = distinct("hardware");
    families = [...new Set((columns.family?.values ?? []).filter((name) => name !== null))];
    engine = Budgets.over(page);
    allowed = {
      view: ["2", "3"], x: axes, y: axes, z: axes, lx: ["0", "1"], ly: ["0", "1"], lz: ["0", "1"],
      task: [...(tasks.length > 1 ? [BOTH] : []), ...tasks], hardware, order: ["ascending", "descending"],
      sort: Object.keys(columns), chosen: rows.map(String), rows: ["", "all"],
      family: [BOTH, ...families], ...Budgets.allowed(page),
    };
  }

  const varies = (column) => distinct(column).length > 1;

  // A column that spans more than two decades reads better in logarithms.
  function spansDecades(column) {
    const values = columns[column].values.filter((v) => typeof v === "number");
    return values.length > 0 && Math.min(...ends(values)) > 0 && ends(values)[1] / ends(values)[0] > 100;
  }
  function ends(values) {
    return values.reduce(([low, high], v) => [Math.min(low, v), Math.max(high, v)], [Infinity, -Infinity]);
  }

  function initialState() {
    const preferred = [...objectives.slice(0, 1), ...objectives.filter((c) => c === "energy_uj"), ...objectives];
    const [y, x, z] = [...new Set([...preferred.filter(varies), ...objectives, ...axes])];
    const pick = { y, x: x ?? y, z: z ?? x ?? y };
    const log = (column) => (column && spansDecades(column) ? "1" : "0");
    return {
      view: "2", ...pick, lx: log(pick.x), ly: log(pick.y), lz: log(pick.z),
      task: tasks.length > 1 ? BOTH : tasks[0] ?? BOTH, hardware: hardware[0] ?? "",
      sort: objectives[0] ?? "", order: page.objectives[objectives[0]] === "min" ? "ascending" : "descending",
      chosen: "", rows: "", family: BOTH, ...Budgets.plain(page),
    };
  }

  function readState() {
    const state = initialState();
    for (const [key, value] of new URLSearchParams(location.hash.slice(1))) {
      if (Object.hasOwn(allowed, key) && allowed[key].includes(value)) state[key] = value;
    }
    return state;
  }

  take(JSON.parse(byId("data").textContent));
  let state = readState();
  let writing;

  function change(part) {
    for (const axis of ["x", "y", "z"]) {
      if (axis in part) part[`l${axis}`] = spansDecades(part[axis]) ? "1" : "0";
    }
    state = { ...state, ...part };
    const moving = Object.keys(part).some((key) => key.startsWith("b."));
    writeState(moving);
    render(moving);
  }

  function writeState(later = false) {
    const plain = initialState();
    const moved = Object.entries(state).filter(([key, value]) => value !== plain[key]);
    clearTimeout(writing);
    const write = () => history.replaceState(null, "", "#" + new URLSearchParams(moved));
    // A drag is many changes, and browsers limit how often a link may change.
    if (later) writing = setTimeout(write, 100);
    else write();
  }

  // ---- new data of a served page (live.js)

  // Row numbers change when trials are added before a row; what makes its design does not.
  const identity = (row, named) => JSON.stringify(named.map((column) => columns[column]?.values[row] ?? null));

  function show(data) {
    const before = { state, plain: initialState(), empty: page.state !== null };
    const named = [...new Set(["trial", "point", "task", "hardware", ...page.design])];
    const focused = document.activeElement?.closest("#front tr, #front th");
    const head = focused?.querySelector("button")?.title;
    const names = [state.chosen, focused?.dataset.row].map((row) => (row ? identity(Number(row), named) : null));
    take(data);
    const found = names.map((name) => (name === null ? -1 : rows.findIndex((row) => identity(row, named) === name)));
    // What is looked at stays; only a choice of task that nobody made follows the tasks that there are.
    const kept = Object.entries(before.state).filter(([key, value]) => key !== "chosen" && allowed[key]?.includes(value) &&
      !(key === "task" && value === before.plain.task));
    const chosen = found[0] < 0 ? "" : String(found[0]);
    state = before.empty ? readState() : { ...initialState(), ...Object.fromEntries(kept), chosen };
    if (page.state === null) writeState();
    render();
    if (!focused) return;
    const again = head === undefined
      ? [...byId("front").querySelectorAll("tbody tr")].find((line) => line.dataset.row === String(found[1]))
      : [...byId("front").querySelectorAll("th button")].find((button) => button.title === head);
    again?.focus({ preventScroll: true });
  }

  // ---- what the state selects

  const taskOf = (row) => (columns.task ? String(columns.task.values[row]) : "");
  const shown = (row) =>
    (state.task === BOTH || !columns.task || taskOf(row) === state.task) &&
    (!columns.hardware || String(columns.hardware.values[row]) === state.hardware) &&
    (state.family === BOTH || columns.family.values[row] === state.family);
  const shownAxes = () => (state.view === "3" ? ["x", "y", "z"] : ["x", "y"]).map((axis) => state[axis]);

  // What the budgets leave: which rows are within them, the front, the pick. Set by render().
  let budgeted = null;
  let onFront = new Set();
  const within = (row) => budgeted.limits.length === 0 || budgeted.within[row] === 1;

  // The front over just the columns shown, if each has a direction and no two are the same.
  function joined() {
    const key = [...shownAxes()].sort().join("|");
    if (!Object.hasOwn(page.fronts, key)) return null;
    return budgeted.limits.length || state.family !== BOTH ? engine.joined(budgeted, shownAxes()) : page.fronts[key];
  }

  // ---- views

  function element(tag, properties = {}, ...children) {
    const node = Object.assign(document.createElement(tag), properties);
    node.append(...children);
    return node;
  }

  function renderHeader() {
    const counts = Object.entries(page.counts).map(([status, n]) => `${number(n)} ${status}`);
    const visible = rows.filter(shown);
    const best = visible.filter((row) => onFront.has(row)).length;
    if (nRows) counts.push(`${plural(visible.length, "point")}, ${best.toLocaleString("en")} on the front`);
    byId("counts").textContent = counts.join(" · ");
    byId("notes").replaceChildren(...page.notes.map((text) => element("li", { textContent: text })));
  }

  function fillSelect(id, options, names) {
    const select = byId(id);
    select.replaceChildren(...options.map((value, k) =>
      element("option", { value, textContent: clip(names[k], 40), selected: value === state[id] })));
  }

  function renderControls() {
    for (const axis of ["x", "y", "z"]) {
      fillSelect(axis, axes, axes.map(title));
      byId(`l${axis}`).checked = state[`l${axis}`] === "1";
      byId(`l${axis}`).disabled = !(ends(columns[state[axis]].values.filter((v) => v !== null))[0] > 0);
    }
    fillSelect("task", allowed.task, allowed.task.map((t) => (t === BOTH && tasks.length > 1 ? "all" : t)));
    fillSelect("hardware", hardware, hardware);
    fillSelect("family", [BOTH, ...families], ["all", ...families]);
    byId("family-label").hidden = families.length < 2;
    byId("task-label").hidden = tasks.length < 2;
    byId("hardware-label").hidden = hardware.length < 2;
    for (const node of document.querySelectorAll(".third")) node.hidden = state.view !== "3";
    for (const n of ["2", "3"]) byId(`view-${n}`).setAttribute("aria-pressed", String(state.view === n));
  }

  const hasWebGL = (() => {
    try {
      return Boolean(document.createElement("canvas").getContext("webgl"));
    } catch {
      return false;
    }
  })();

  // Thousands of points keep their words while a slider moves; other axes have other words.
  let hovers = { axes: "", of: new Map() };
  function hover(row) {
    const axes = shownAxes().join("|");
    if (hovers.axes !== axes) hovers = { axes, of: new Map() };
    if (!hovers.of.has(row)) hovers.of.set(row, hoverText(row));
    return hovers.of.get(row);
  }

  function hoverText(row) {
    const lines = page.design
      .filter((column) => columns[column].values[row] !== null)
      .map((column) => `${title(column)}  ${number(columns[column].values[row])}`);
    const measured = [...new Set([...objectives, ...shownAxes()])].filter((column) => !page.design.includes(column));
    lines.push(...measured.map((column) => `${title(column)}  ${withInterval(column, row)}`));
    return lines.map((line) => escaped(clip(line, HOVER_CHARACTERS))).join("<br>");
  }

  // In space the vertical is plotly's z; the column chosen as y points up in both views.
  const letters = () => (state.view === "3" ? "xzy" : "xy");

  function coordinates(some) {
    return Object.fromEntries(shownAxes().map((column, k) =>
      [letters()[k], some.map((row) => columns[column].values[row])]));
  }

  // On a crowded front every n-th point carries its interval, or the bars would hide the points.
  function bars(some, colour) {
    const step = Math.ceil(some.length / BARS);
    const thinned = (values) => some.map((row, k) => (k % step === 0 ? values[row] : null));
    const found = {};
    shownAxes().forEach((column, k) => {
      const known = page.intervals[column];
      if (!known) return;
      found[`error_${letters()[k]}`] = {
        type: "data", symmetric: false, color: `${colour}99`, thickness: 1, width: 2,
        array: thinned(known.high), arrayminus: thinned(known.low),
      };
    });
    return found;
  }

  function traces(style) {
    const flat = state.view === "2";
    const drawable = rows.filter((row) => shown(row) && shownAxes().every((c) => columns[c].values[row] !== null));
    const kind = flat ? (drawable.length > 2000 && hasWebGL ? "scattergl" : "scatter") : "scatter3d";
    const front = joined();
    const found = [];
    const names = columns.task ? (state.task === BOTH ? tasks : [state.task]) : [""];
    for (const name of names) {
      const colour = style.palette[Math.max(0, tasks.indexOf(name)) % style.palette.length];
      const mine = drawable.filter((row) => taskOf(row) === name);
      const add = (type, some, more) => found.push({
        type, mode: "markers", ...coordinates(some), customdata: some, text: some.map(hover),
        hovertemplate: "%{text}<extra></extra>", legendgroup: name, showlegend: false, ...more,
      });
      const line = front
        ? front.filter((row) => taskOf(row) === name && shown(row)).sort((a, b) =>
          columns[state.x].values[a] - columns[state.x].values[b] || columns[state.y].values[a] - columns[state.y].values[b])
        : [];
      const inLine = new Set(line);
      const best = mine.filter((row) => onFront.has(row) && !inLine.has(row));
      const outside = mine.filter((row) => !within(row));
      if (outside.length) add(kind, outside, { marker: { color: style.quiet, size: flat ? 4 : 2, opacity: 0.12, line: { width: 0 } } });
      add(kind, mine.filter((row) => within(row) && !onFront.has(row) && !inLine.has(row)),
        { marker: { color: colour, size: flat ? 5 : 3, opacity: 0.22, line: { width: 0 } } });
      add(kind, best, {
        marker: { color: colour, size: flat ? 7 : 4, opacity: 0.75, line: { width: 0 } },
        ...(front ? {} : bars(best, colour)),
      });
      if (flat && line.length) {
        // The staircase is what the front attains: nothing lies beyond it.
        found.push({
          type: "scatter", mode: "lines", ...coordinates(line), hoverinfo: "skip", showlegend: false,
          line: { color: colour, width: 1.5, shape: page.objectives[state.x] === "min" ? "hv" : "vh" },
        });
      } else if (line.length > 3) {
        found.push({
          type: "mesh3d", ...coordinates(line), color: colour, opacity: 0.14, hoverinfo: "skip", delaunayaxis: "z",
        });
      }
      add(flat ? "scatter" : kind, line, {
        marker: { color: colour, size: flat ? 9 : 6, line: { color: style.page, width: 1 } },
        ...bars(line, colour),
        name: escaped(clip(name, 40)), showlegend: names.length > 1,
      });
    }
    const best = budgeted.pick >= 0 ? budgeted.pick : budgeted.nearest[0]?.row;
    const picked = budgeted.limits.length ? drawable.filter((row) => row === best) : [];
    if (picked.length) {
      found.push({
        type: flat ? "scatter" : "scatter3d", mode: "markers", ...coordinates(picked), hoverinfo: "skip", showlegend: false,
        marker: { symbol: "diamond-open", color: style.text, size: flat ? 16 : 10, line: { color: style.text, width: 2 } },
      });
    }
    const chosen = drawable.filter((row) => String(row) === state.chosen);
    if (chosen.length) {
      found.push({
        type: flat ? "scatter" : "scatter3d", mode: "markers", ...coordinates(chosen), hoverinfo: "skip",
        showlegend: false,
        marker: { symbol: "circle-open", color: style.text, size: flat ? 18 : 12, line: { color: style.text, width: 2 } },
      });
    }
    return found;
  }

  // A narrow figure is seen from further away, so that its axes stay inside.
  function camera(narrow) {
    const far = narrow ? 1.5 : 1;
    return { eye: { x: 1.7 * far, y: -1.9 * far, z: 0.6 * far }, center: { x: 0, y: 0, z: -0.25 } };
  }

  function renderPlot() {
    if (state.view === "3" && !hasWebGL) {
      Plotly.purge("plot");
      byId("plot").textContent = "The 3-D view needs WebGL, which this browser does not offer. The 2-D view works.";
      return;
    }
    const css = getComputedStyle(document.documentElement);
    const dark = matchMedia("(prefers-color-scheme: dark)").matches;
    const style = {
      text: css.getPropertyValue("--text").trim(), page: css.getPropertyValue("--page").trim(),
      rule: css.getPropertyValue("--rule").trim(), quiet: css.getPropertyValue("--quiet").trim(), palette: dark ? page.palette.dark : page.palette.light,
    };
    const axis = (letter) => ({
      title: { text: escaped(clip(title(state[letter]), 48)), standoff: 8 }, automargin: true,
      type: state[`l${letter}`] === "1" ? "log" : "linear", gridcolor: style.rule, linecolor: style.rule,
      zeroline: false, exponentformat: "SI", minexponent: 4, showbackground: false, color: style.text,
      ...(state[`l${letter}`] === "1" && state.view === "2" ? { dtick: "D2" } : {}),
    });
    const narrow = byId("plot").clientWidth < 560;
    const layout = {
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { family: css.fontFamily, size: narrow ? 11 : 12, color: style.text },
      margin: state.view === "2" ? { l: 48, r: 8, t: 24, b: 40 } : { l: 0, r: 0, t: 8, b: 0 },
      hovermode: "closest", hoverlabel: { align: "left", bgcolor: style.page, bordercolor: style.text, font: { color: style.text } },
      legend: { orientation: "h", x: 0, y: 1.08, itemclick: false, itemdoubleclick: false, itemsizing: "constant" },
      uirevision: [state.view, state.x, state.y, state.z, state.lx, state.ly, state.lz].join(),
      ...(state.view === "2"
        ? { xaxis: axis("x"), yaxis: axis("y") }
        : {
          scene: {
            xaxis: axis("x"), yaxis: axis("z"), zaxis: axis("y"), aspectmode: "manual",
            aspectratio: { x: 1.5, y: 1.5, z: 1 }, camera: camera(narrow),
          },
        }),
    };
    Plotly.react("plot", traces(style), layout, {
      responsive: true, displaylogo: false, modeBarButtonsToRemove: ["lasso2d", "select2d", "autoScale2d"],
    }).then((plot) => {
      plot.removeAllListeners("plotly_click");
      plot.on("plotly_click", (event) => change({ chosen: String(event.points[0].customdata) }));
    });
    describe();
  }

  function describe() {
    const front = joined();
    const said = shownAxes().map((column) => columns[column].label);
    const every = plural(objectives.length, "objective");
    byId("caption").textContent = front
      ? `${state.view === "2" ? "Joined" : "Large"}: the front of ${said.slice(0, -1).join(", ")} and ${said.at(-1)} alone. ` +
        `Solid: the front over all ${every}. Dim: dominated. Bars: one standard error, or the model's interval.`
      : `Solid: the front over all ${every}. Dim: dominated.`;
    if (budgeted.limits.length) byId("caption").textContent += ` Grey: outside the budgets. Diamond: the ${budgeted.pick >= 0 ? "pick" : "nearest"}.`;
    const marked = (front ?? budgeted.front).filter(shown);
    const ranges = !marked.length ? ["nothing is within the budgets"] : shownAxes().map((column) => {
      const [low, high] = ends(marked.map((row) => columns[column].values[row]).filter((v) => v !== null));
      return `${title(column)} ${number(low)} to ${number(high)}`;
    });
    byId("plot").setAttribute("aria-label", `${said.join(" against ")}: ${marked.length} points on the front, ${ranges.join(", ")}. The table below holds the numbers.`);
  }

  function tableColumns() {
    const parameters = page.design.filter((column) => column === "trial" || varies(column));
    const several = columns.task && tasks.length > 1 ? ["task"] : [];
    return [...new Set([...parameters.filter((c) => c === "trial"), ...several, ...objectives, ...parameters])];
  }

  function compare(column, order) {
    const sign = order === "ascending" ? 1 : -1;
    return (a, b) => {
      const [left, right] = [columns[column].values[a], columns[column].values[b]];
      if (left === null || right === null) return (left === null) - (right === null) || a - b;
      const both = typeof left === "number" && typeof right === "number";
      return sign * (both ? left - right : String(left).localeCompare(String(right))) || a - b;
    };
  }

  function renderTable() {
    const named = tableColumns();
    const head = named.map((column) => {
      const sorted = state.sort === column;
      const button = element("button", { type: "button", textContent: clip(title(column), 40), title: column });
      button.addEventListener("click", () => change({
        sort: column,
        order: sorted ? (state.order === "ascending" ? "descending" : "ascending")
          : page.objectives[column] === "max" ? "descending" : "ascending",
      }));
      const cell = element("th", { scope: "col", className: isNumeric(column) ? "" : "text" }, button);
      cell.setAttribute("aria-sort", sorted ? state.order : "none");
      return cell;
    });
    const front = [...budgeted.front];
    if (columns[state.sort]) front.sort(compare(state.sort, state.order));
    const visible = state.rows === "all" ? front : front.slice(0, TABLE_ROWS);
    const body = visible.map((row) => {
      const line = element("tr", { tabIndex: 0 }, ...named.map((column) => element("td", {
        textContent: withInterval(column, row), className: isNumeric(column) ? "" : "text",
        title: String(columns[column].values[row] ?? "not measured"),
      })));
      line.dataset.row = row;
      line.setAttribute("aria-selected", String(String(row) === state.chosen));
      return line;
    });
    const table = byId("front").querySelector("table");
    table.tHead.replaceChildren(element("tr", {}, ...head));
    table.tBodies[0].replaceChildren(...body);
    byId("front-count").textContent = `${plural(front.length, "design")} that nothing beats over ${objectives.map((c) => columns[c].label).join(", ")}`;
    byId("more").hidden = visible.length === front.length;
    byId("more").textContent = `Show all ${front.length.toLocaleString("en")}`;
  }

  function definitions(named, row) {
    return element("dl", {}, ...named.flatMap((column) => [
      element("dt", { textContent: columns[column].label, title: column }),
      element("dd", {
        textContent: `${clip(withInterval(column, row), 120)}\u00a0${columns[column].unit}`.trim(),
        title: String(columns[column].values[row]),
      }),
    ]));
  }

  function renderDesign() {
    const panel = byId("design");
    if (state.chosen === "") {
      panel.replaceChildren(element("h2", { textContent: "Design" }),
        element("p", { textContent: "Choose a point of the figure or a row of the table." }));
      return;
    }
    const row = Number(state.chosen);
    const has = (column) => columns[column].values[row] !== null;
    const others = Object.keys(columns).filter((c) => !objectives.includes(c) && !page.design.includes(c) && has(c));
    const open = panel.querySelector("details")?.open ?? false;
    const heading = columns.trial ? `Trial ${number(columns.trial.values[row])}` : `Point ${row}`;
    panel.replaceChildren(
      element("h2", { textContent: clip(heading, 60) }),
      element("p", { textContent: !within(row) ? "outside the budgets" : onFront.has(row) ? "on the front" : "dominated" }),
      definitions(objectives.filter(has), row),
      definitions(page.design.filter((column) => column !== "trial" && has(column)), row),
      element("details", { open }, element("summary", { textContent: "everything measured" }), definitions(others, row)),
    );
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

  const showBudgets = Budgets.panel(byId("budgets"), { element, clip, number, withInterval, change });

  let [drawing, drawnMs] = [undefined, 0];
  function drawTimed() {
    const start = performance.now();
    renderPlot();
    drawnMs = performance.now() - start;
  }

  function render(moving = false) {
    budgeted = engine.evaluate(state);
    onFront = new Set(budgeted.front);
    renderHeader();
    renderFailures();
    const empty = page.state !== null;
    byId("state").hidden = !empty;
    for (const id of ["budgets", "figure", "design", "front"]) byId(id).hidden = empty;
    if (empty) {
      byId("state").querySelector("h2").textContent = page.state.title;
      byId("state").querySelector("p").textContent = page.state.text;
      return;
    }
    showBudgets(state, budgeted);
    renderControls();
    clearTimeout(drawing);
    // A slider's numbers come first; a figure that takes long to draw waits for as long for another step.
    if (moving) drawing = setTimeout(drawTimed, drawnMs);
    else drawTimed();
    renderTable();
    renderDesign();
  }

  // ---- what a reader does

  byId("controls").addEventListener("submit", (event) => event.preventDefault());
  for (const id of ["x", "y", "z", "task", "family", "hardware"]) byId(id).addEventListener("change", (e) => change({ [id]: e.target.value }));
  for (const id of ["lx", "ly", "lz"]) byId(id).addEventListener("change", (e) => change({ [id]: e.target.checked ? "1" : "0" }));
  for (const n of ["2", "3"]) byId(`view-${n}`).addEventListener("click", () => { Plotly.purge("plot"); change({ view: n }); });
  byId("more").addEventListener("click", () => change({ rows: "all" }));
  const tableBody = byId("front").querySelector("tbody");
  const choose = (event) => {
    const line = event.target.closest("tr");
    if (line) change({ chosen: line.dataset.row });
  };
  tableBody.addEventListener("click", choose);
  tableBody.addEventListener("keydown", (event) => {
    if (event.key !== "Enter") return;
    const row = event.target.closest("tr")?.dataset.row;
    choose(event);
    tableBody.querySelector(`tr[data-row="${row}"]`)?.focus();
  });
  addEventListener("live", (event) => show(event.detail));
  addEventListener("hashchange", () => { state = readState(); render(); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => render());
  render();
})();
