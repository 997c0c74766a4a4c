"use strict";
// One state object; every view (views.js) is a function of it, and the URL's fragment carries it.
// Text from the study only ever enters the page through textContent.
(async () => {
  const byId = (id) => document.getElementById(id);
  let given, page, columns, objectives, nRows, rows, axes, tasks, hardware, families, filterable, allowed, engine, plain, remembered; // set by take()
  const BOTH = "all";
  const MAX_CATEGORIES = 40; // of a column that can be an axis, a colour or a filter
  const SURE = ["", ...Array.from({ length: 19 }, (_, k) => String((k + 1) / 20))]; // shares of the samples
  const OPEN = 100; // of an interval's ends: beyond it the upper one says nothing
  const ONE_MS = 1000; // steps of a drag nearer than this are one change, which Back undoes
  const TABS = { choose: "Choose", chips: "Chips", inside: "Inside", matters: "What matters", all: "All designs", run: "Run" };
  const FAMILIES = { snn: "spiking network", mlp: "plain network", naive_bayes: "naive Bayes", elm: "random network", kernel: "random kernels" };
  const AGE_MS = 5000;
  const SIZES = { "µJ": [[1e6, "J"], [1e3, "mJ"], [1, "µJ"], [0, "nJ", 1e-3]], ms: [[1e3, "s"], [1, "ms"], [0, "µs", 1e-3]] };
  const { element } = Dom;

  // ---- words and numbers

  // What follows from the values of a column, which is asked for at every step of a slider.
  const ofColumn = (make, known = Data.memory()) => (column) => known(column, columns[column]?.values, () => make(columns[column]?.values ?? [], column));
  const distinct = ofColumn((values) => [...new Set(values.map(String))]);
  const isNumeric = ofColumn((values) => values.some((v) => typeof v === "number"));
  // The values of a column of words in their order; none of a column of numbers, or of one whose words hardly repeat.
  const categories = ofColumn((values) => {
    const known = [...new Set(values.filter((value) => value !== null && value !== undefined))];
    if (known.length === 0 || known.length > MAX_CATEGORIES || known.some((value) => typeof value === "number")) return [];
    return known.map(String).sort((a, b) => a.localeCompare(b, "en", { numeric: true }));
  });
  // A column as numbers, NaN where it has none; of words, their places among the categories.
  const numbers = ofColumn((values, column) => {
    if (isNumeric(column)) return Float64Array.from(values, (v) => (typeof v === "number" ? v : NaN));
    const places = new Map(categories(column).map((name, k) => [name, k]));
    return Float64Array.from(values, (v) => places.get(String(v)) ?? NaN);
  });
  const placed = (column, value) => (typeof value === "number" || !columns[column] || value === null ? value : numbers(column)[columns[column].values.indexOf(value)]);
  const title = (column) => columns[column].label + (columns[column].unit ? ` (${columns[column].unit})` : "");
  const clip = (text, n) => ([...text].length <= n ? text : [...text].slice(0, n - 1).join("") + "…");

  const { many, plural } = Data;

  const digits = new Intl.NumberFormat("en", { maximumSignificantDigits: 3 });

  // At most three significant digits; a measured fraction keeps its zeros so that a column lines up.
  function number(value, measured = false) {
    if (typeof value === "boolean") return value ? "yes" : "no";
    if (typeof value !== "number") return value === null || value === undefined ? "–" : String(value);
    const rounded = Number(value.toPrecision(3));
    if (measured && rounded === 1 && value < 1) return ">\u202f0.999";
    if (measured && Math.abs(rounded) >= 0.01 && Math.abs(rounded) < 1) return rounded.toFixed(3);
    const size = Math.abs(rounded);
    if (size !== 0 && (size < 1e-6 || size >= 1e10)) return powerOfTen(rounded);
    return digits.format(rounded).replace(/,/g, "\u202f");
  }

  // One notation everywhere: decimals, and beyond them a power of ten.
  function powerOfTen(value) {
    const [mantissa, exponent] = value.toExponential().split("e");
    const raised = [...exponent.replace("+", "")].map((letter) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[letter] ?? "⁻").join("");
    return `${mantissa === "1" ? "" : `${mantissa}\u202f·\u202f`}10${raised}`;
  }

  // A number with its unit in the unit that suits its size.
  function sized(column, value) {
    const { unit } = columns[column];
    const [from, name, by = from] = (SIZES[unit] ?? []).find(([least]) => Math.abs(value) >= least) ?? [1, unit];
    return `${number(typeof value === "number" && name !== unit ? value / by : value)}\u202f${value === 0 ? unit : name}`.trim();
  }

  const error = (value) => `± ${number(Number(value.toPrecision(1)))}`;

  // The objective that a column is the correction of. The correction keeps the order of a task's points: a front of the
  // one is a front of the other.
  const measuredOf = (column) => (column.endsWith("_corrected") && objectives.includes(column.slice(0, -10)) ? column.slice(0, -10) : column);
  const wayOf = (column) => page.objectives[measuredOf(column)];

  // Fractions whose zeros are written.
  const measuredAs = (column) => column.replace(/_(corrected|test|shifted|unseen)$/, "");
  const isShare = (column) => objectives.includes(measuredAs(column));

  // Those that lie between 0 and 1, and are more as they are better: they are said as percentages.
  function isFraction(column) {
    const name = measuredAs(column);
    return page.objectives[name] === "max" && numbers(name).every((value) => Number.isNaN(value) || (value >= 0 && value <= 1));
  }

  // What is known of a number of a row or of a point: its ends, and how far they are from it; null of one without an error.
  function known(column, of) {
    const { row, value } = typeof of === "number" ? { row: of, value: (name) => columns[name]?.values[of] ?? null } : of;
    const [at, se, low, high] = ["", "_se", "_low", "_high"].map((end) => value(`${column}${end}`)); // ends: of a point off the page
    const ends = Object.hasOwn(page.intervals, column) ? page.intervals[column] : null; // a column may be called __proto__
    const [below, above] = row >= 0 ? [ends?.low[row], ends?.high[row]] : [se ?? (low === null ? 0 : at - low), se ?? (high === null ? 0 : high - at)];
    return at === null || !(below || above) ? null : { low: at - below, high: at + above, below, above };
  }

  // Whether all that is known of a number is its lower end: the upper one is more than a hundred times that.
  function isOpen(column, of) {
    const { low = 0, high = 0 } = known(column, of) ?? {};
    return low > 0 && high > OPEN * low;
  }

  // What is known of a gain: as measured, as expected on other recordings, as tested, where a touch has moved, of unseen groups.
  const trusts = (gain) => ["", "_corrected", "_test", "_shifted", "_unseen"].map((end) => `${gain}${end}`).filter((name) => Object.hasOwn(columns, name) && columns[name].values.some((value) => value !== null));

  // What is believed of a gain first, and what is drawn, if that is one of these.
  function headline() {
    const known = trusts(page.budgets.maximise ?? "");
    return known.includes(state.y) ? state.y : known.find((name) => name.endsWith("_corrected")) ?? known[0];
  }
  const costsOf = () => Object.keys(page.budgets.columns).filter((column) => page.budgets.columns[column] === "min");

  // A design beside another: shares in points, costs as factors.
  function differences(at, base, costs = costsOf().filter((column) => objectives.includes(column) || /latency/.test(column))) {
    return [headline(), ...costs].filter(Boolean).map((column) => {
      const [label, value, from] = [clip(columns[column].label, 40), at.value(column), base.value(column)];
      if (typeof value !== "number" || typeof from !== "number") return "";
      if (value === from) return `same ${label}`;
      if (isFraction(column)) return `${value > from ? "+" : "−"}${number(100 * Math.abs(value - from))} points`;
      const factor = value > 0 && from > 0 ? number(Math.max(value / from, from / value)) : "";
      return factor === "" ? `${label} ${sized(column, value)}` : factor === "1" ? `about the same ${label}` : `${value < from ? "÷" : "×"}${factor} ${label}`;
    }).filter(Boolean);
  }

  // Columns with what is read beside them: a gain corrected for the choice before it and as tested after it, and
  // an energy at the other pace.
  function beside(names, paces = true) {
    const pair = paces && given.period && columns[given.period.energy] ? [given.period.energy, given.period.instead] : [];
    const all = names.flatMap((name) => [`${name}_corrected`, name, `${name}_test`, ...(pair.includes(name) ? pair : [])]);
    return [...new Set(all)].filter((name) => Object.hasOwn(columns, name));
  }

  function withInterval(column, of) {
    const ends = known(column, of);
    const [text, low, high] = [typeof of === "number" ? columns[column].values[of] : of.value(column), ends?.low, ends?.high].map((value) => number(value, isShare(column)));
    if (!ends) return text;
    if (Math.abs(ends.below - ends.above) <= 1e-3 * ends.above) return `${text} ${error(ends.above)}`;
    return isOpen(column, of) ? `at least ${number(ends.low)}` : `${text} (${low}–${high})`;
  }

  const trialName = (trial) => `Trial ${number(trial)}`;
  const nameOf = (row) => (columns.trial ? trialName(columns.trial.values[row]) : `Point ${row}`);

  const chipName = (name) => page.chips?.[name] ?? String(name);
  const familyName = (family) => FAMILIES[family] ?? String(family);

  // ---- state

  // A point's name in a link: its trial and its number there, so that it stays when trials are added; a table
  // without these numbers has names of its trials, or of its rows.
  const isNamed = () => columns.trial !== undefined && columns.point !== undefined;
  const keyOf = (row) => (isNamed() ? `${columns.trial.values[row]}.${columns.point.values[row]}`
    : String(distinct("trial").length === nRows ? columns.trial.values[row] : row));
  function rowsByKey() {
    const found = new Map();
    for (const row of rows) found.set(keyOf(row), [...(found.get(keyOf(row)) ?? []), row]);
    return found;
  }
  const onChip = (row) => !columns.hardware || String(columns.hardware.values[row]) === state.hardware;
  const rowOf = (key) => remembered("keys", "", rowsByKey).get(key)?.find(onChip) ?? -1; // costs on another chip would mislead

  const isKey = { includes: (text) => text === "" || /^-?\d+(\.\d+)?$/.test(text) };
  const isEnd = (text) => text === "" || Number.isFinite(Number(text));
  const isFilter = { includes: (text) => text === "" || text.startsWith("in:") || (text.split("~").length === 2 && text.split("~").every(isEnd)) };
  const isWord = { includes: (text) => /^[a-z]*$/.test(text) };

  // A page whose energies are those at the sensor's period: one switch for every number of it.
  function atPeriod(data) {
    const { energy, instead } = data.period;
    const renamed = (value) => (value === energy ? instead : Array.isArray(value) ? value.map(renamed) : value && typeof value === "object"
      ? Object.fromEntries(Object.entries(value).map(([name, inner]) => [renamed(name), renamed(inner)])) : value);
    const { [energy]: flat, [instead]: paced, ...rest } = data.columns;
    return {
      ...data, objectives: renamed(data.objectives), definition: renamed(data.definition), budgets: { ...data.budgets, columns: renamed(data.budgets.columns) },
      columns: { ...rest, [instead]: { ...paced, label: flat.label }, [energy]: { ...flat, label: `${flat.label} flat out` } },
    };
  }

  const paceOf = (fragment) => (new URLSearchParams(fragment).get("pace") === "period" ? "period" : "flat");

  function take(data, pace) {
    given = data;
    page = pace === "period" && data.period ? atPeriod(data) : data;
    columns = page.columns;
    objectives = Object.keys(page.objectives);
    nRows = Object.values(columns)[0]?.values.length ?? 0;
    rows = Array.from({ length: nRows }, (_, row) => row);
    remembered = Data.memory();
    const first = beside(objectives);
    axes = [...objectives, ...first.filter((c) => !objectives.includes(c) && isNumeric(c)), ...Object.keys(columns).filter((c) => !first.includes(c) && (isNumeric(c) || categories(c).length > 1))];
    filterable = Object.keys(columns).filter((c) => /^[A-Za-z_]\w*(\.[A-Za-z_]\w*)*$/.test(c) && !Object.hasOwn(page.budgets.columns, c)
      && !["task", "family", "hardware"].includes(c) && varies(c) && (isNumeric(c) || categories(c).length > 1));
    tasks = distinct("task");
    hardware = distinct("hardware");
    families = [...new Set((columns.family?.values ?? []).filter((name) => name !== null))];
    engine = Budgets.over(page);
    allowed = {
      x: axes, y: axes, lx: ["0", "1"], ly: ["0", "1"], task: tasks, hardware, order: ["ascending", "descending"], show: Object.keys(TABS), ask: isWord, give: ["",
        ...Object.keys(columns)], improve: ["", ...Object.keys(columns)], find: { includes: () => true },
      sort: Object.keys(columns), chosen: isKey, tab: isWord, rows: ["", "all"],
      family: [BOTH, ...families], pace: page.period ? ["flat", "period"] : ["flat"], left: ["0", "1"], oversize: ["0", "1"], once: ["", "0", "1"], expert: ["0", "1"],
        colour: ["", ...axes], sure: SURE, ...Budgets.allowed(page),
      ...Object.fromEntries(filterable.map((column) => [`f.${column}`, isFilter])),
    };
    plain = initialState();
  }

  const varies = (column) => distinct(column).length > 1;

  const log = (column) => (column && (page.definition.front.log.includes(column) || Data.spansDecades(...Data.ends(columns[column].values.filter((v) => typeof v === "number")))) ? "1" : "0");

  function initialState() {
    const definition = page.definition;
    const fixed = ["y", "x"].map((axis) => (axes.includes(definition.front[axis]) ? definition.front[axis] : null));
    // What is known of a gain, where that is known of every point.
    const corrected = (name) => columns[`${name}_corrected`]?.values;
    const leading = (name) => (corrected(name) && columns[name].values.every((value, row) => value === null || corrected(name)[row] !== null) ? `${name}_corrected` : name);
    const preferred = [...objectives.slice(0, 1).map(leading), ...objectives.filter((c) => ["energy_uj", page.period?.instead].includes(c)), ...objectives.slice(1)];
    const left = [...new Set([...preferred.filter(varies), ...objectives, ...axes])].filter((column) => !fixed.includes(column));
    const [y, x] = fixed.map((column) => column ?? left.shift() ?? axes[0]);
    const sort = definition.sort ?? objectives[0] ?? "";
    return {
      y, x, lx: log(x), ly: log(y), task: tasks[0] ?? BOTH, hardware: hardware[0] ?? "", show: "choose", ask: "", find: "", give: "", improve: "",
      sort, order: page.objectives[sort] === "max" ? "descending" : "ascending",
      chosen: "", tab: definition.design[0] ?? "", rows: "", family: BOTH, pace: "flat", left: "0", oversize: "0", once: "", expert: "0", colour: axes.includes(page.colour)
        ? page.colour : "", sure: "",
      ...Object.fromEntries(filterable.map((column) => [`f.${column}`, ""])), ...Budgets.plain(page),
    };
  }

  const canBeLog = (column) => axes.includes(column) && !numbers(column).some((value) => value <= 0);

  // A state of what may be kept of some [key, value].
  function stateOf(entries) {
    const read = { ...plain, ...Object.fromEntries([...entries].filter(([key, value]) => Object.hasOwn(allowed, key) && allowed[key].includes(value))) };
    for (const axis of ["x", "y"]) if (!canBeLog(read[axis])) read[`l${axis}`] = "0";
    return read;
  }
  const readState = () => stateOf(new URLSearchParams(location.hash.slice(1)));

  take(await Data.read(), paceOf(location.hash.slice(1)));
  let [state, writing] = [readState(), 0];

  let [last, ghost] = [{ keys: "", at: -Infinity }, -1]; // the last change; the pick before it

  // `moving`: more of the same follows at once, as when a slider is dragged.
  function change(part, moving = Object.keys(part).some((key) => key.startsWith("b.") || key === "sure")) {
    const keys = Object.keys(part).join();
    const goesOn = moving && keys === last.keys && performance.now() - last.at < ONE_MS;
    last = { keys, at: performance.now() };
    const before = goesOn ? null : subjectOf(engine.evaluate(state)).row;
    for (const axis of ["x", "y"]) {
      if (axis in part) part[`l${axis}`] = log(part[axis]);
    }
    if (part.pace !== undefined && part.pace !== state.pace) setPace(part.pace);
    state = { ...state, ...part };
    if ("hardware" in part || "task" in part || "pace" in part) ghost = -1;
    else if (before !== null && before >= 0) ghost = before;
    writeState(moving, goesOn);
    render(moving);
  }

  // What is looked at of one energy is looked at of the other; limits on energy are gone.
  function setPace(pace) {
    const { energy, instead } = given.period;
    const renamed = (name) => (pace === "period" ? (name === energy ? instead : name) : name === instead ? energy : name);
    take(given, pace);
    state = stateOf(Object.entries({ ...state, ...Object.fromEntries(["x", "y", "sort"].map((key) => [key, renamed(state[key])])) }));
  }

  // What was before stays in the browser's history, so that Back undoes a change.
  function writeState(later = false, replaces = false) {
    const moved = Object.entries(state).filter(([key, value]) => value !== plain[key]);
    const to = "#" + new URLSearchParams(moved);
    if (!replaces && to !== (location.hash || "#")) history.pushState(null, "", to);
    clearTimeout(writing);
    // A drag is many changes, and browsers limit how often a link may change.
    if (later) writing = setTimeout(() => history.replaceState(null, "", to), 100);
    else if (replaces) history.replaceState(null, "", to);
  }

  // ---- new data of a served page (live.js)

  function show(data) {
    const before = { state, plain, empty: page.state !== null };
    take(data, before.empty ? paceOf(location.hash.slice(1)) : before.state.pace);
    // What is looked at stays; only a choice of task that nobody made follows the tasks that there are.
    const kept = Object.entries(before.state).filter(([key, value]) => key !== "task" || value !== before.plain.task);
    state = before.empty ? readState() : stateOf(kept);
    ghost = -1;
    if (page.state === null) writeState(false, true);
    render();
  }

  // ---- what the state selects

  const isShown = (row) =>
    (!columns.task || String(columns.task.values[row]) === state.task) &&
    (!columns.hardware || String(columns.hardware.values[row]) === state.hardware) &&
    (state.family === BOTH || columns.family.values[row] === state.family);

  // Whether what names a task and a chip, or neither, is of those that are shown.
  const concerns = (of) => ["task", "hardware"].every((name) => !of[name] || !columns[name] || of[name] === state[name]);

  // A point by its key; its numbers come from its row, or, off the page, from what its surface says (design.js).
  function point(key) {
    const values = surfaces.get(`${key}@${state.hardware}`);
    const row = values ? -1 : rowOf(key);
    return { key, row, value: (column) => (values ? values[column] : columns[column]?.values[row]) ?? null };
  }
  const surfaces = new Map(); // of points that are no row of the page: {column: value}
  const setPoint = (key, values) => surfaces.set(`${key}@${state.hardware}`, values);

  // What points are told apart by, where the reader has not chosen.
  const ownColour = () => (state.family !== BOTH || families.length < 2 ? "" : "family");

  // The rows that are shown stay one list while budgets move, so that views recognise it.
  function shownRows(budgeted) {
    const key = JSON.stringify([state.task, state.hardware, state.family, state.left, state.oversize, budgeted.conditions.map(({ column, text }) => [column, text])]);
    return remembered("rows", key, () => rows.filter((row) => isShown(row) && budgeted.matches(row) && (state.left === "1" || budgeted.admitted[row])));
  }

  // The design that the page is about: the chosen one, or else the pick, or else the nearest to it.
  function subjectOf({ pick, relaxed, nearest }) {
    if (state.chosen) return point(state.chosen);
    const row = pick >= 0 ? pick : relaxed[0]?.row ?? nearest[0]?.row ?? -1;
    return row < 0 ? { key: "", row, value: () => null } : point(keyOf(row));
  }

  // What every view is a function of.
  function selection(moving) {
    const budgeted = engine.evaluate(state);
    return {
      page, columns, objectives, state, budgeted, moving, onFront: new Set(budgeted.front),
      colour: state.colour || ownColour(), rows: shownRows(budgeted), leftOut: (row) => engine.leftOut(budgeted, row),
      within: (row) => budgeted.limits.length === 0 || budgeted.within[row] === 1,
      // The front over some columns alone, if each has a direction and no two are the same.
      joined: (drawn) => {
        const named = drawn.map(measuredOf);
        const known = new Set(named).size === named.length && named.every((column) => Object.hasOwn(page.objectives, column));
        return known ? engine.joined(budgeted, named) : null;
      },
      chosen: state.chosen ? point(state.chosen) : null, subject: subjectOf(budgeted), ghost: ghost >= 0 && ghost < nRows ? ghost : -1,
    };
  }

  // The knee and the gaps of a front over two axes, of cost and of gain (budgets.js).
  function shapeOf(line, axes, tried) {
    const [cost, gain] = axes.map(({ column, share }, k) => {
      const sign = (wayOf(column) ?? page.budgets.columns[column] ?? "max") === ["min", "max"][k] ? 1 : -1;
      return (row) => sign * share(numbers(column)[row]);
    });
    const [, { column, share }] = axes;
    const error = (row) => Math.abs(share(numbers(column)[row]) - share(numbers(column)[row] - (known(column, row)?.below ?? 0)));
    return Budgets.shape(line, cost, gain, error, tried);
  }

  // ---- what the page is made of

  const download = (name, address) => element("a", { href: address, download: name }).click();

  // Some rows with all their columns, as a spreadsheet reads them.
  function csv(name, some) {
    const quoted = (value) => (/[",\r\n]/.test(String(value)) ? `"${String(value).replace(/"/g, '""')}"` : String(value));
    // An error is a column, and so is each end of an interval.
    const spread = Object.entries(page.intervals).flatMap(([column, { low, high }]) => (low.every((end, row) => end === high[row]) ? [[`${column}_se`, (row) => high[row]]]
      : [["low", -1, low], ["high", 1, high]].map(([end, sign, by]) => [`${column}_${end}`, (row) => (columns[column].values[row] === null ? null
        : Number((columns[column].values[row] + sign * by[row]).toPrecision(6)))])));
    const written = [...Object.entries(columns).map(([name, { values }]) => [name, (row) => values[row]]), ...spread];
    const cells = (row) => written.map(([, value]) => quoted(value(row) ?? ""));
    const lines = [written.map(([name]) => quoted(name)), ...some.map(cells)].map((line) => `${line.join(",")}\r\n`);
    const address = URL.createObjectURL(new Blob(lines, { type: "text/csv" }));
    download(`${fileName()}-${name}.csv`, address);
    setTimeout(() => URL.revokeObjectURL(address), 60000);
  }
  // A report has what a view must ask its server for first.
  const report = () => Promise.all(views.map(({ view }) => view.load?.(selection(false)))).then(() => print());
  const save = async ({ name, view }, format) => (format === "csv" ? csv(name, view.listed()) : download(`${fileName()}-${name}.${format}`, await view.image(format)));
  const fileName = () => clip(page.name, 80).replace(/[^\p{L}\p{N}_-]+/gu, "_");

  const app = {
    element, clip, number, error, known, withInterval, isOpen, beside, measuredOf, wayOf, nameOf, trialName, title, sized, trusts, concerns, isShare, isFraction, familyName, chipName,
      report, saves: () => views.filter(({ root, view }) => !root.hidden && (view.image || view.listed)), save, canBeLog, change, ownColour, many, plural, keyOf, rowOf, isNumeric,
      distinct, numbers, categories, placed, setPoint,
    headline, costsOf, shape: shapeOf, bought: (column) => engine.bought(state, column), costOf: () => engine.cost, exported: (trial, point) => engine.exported(state, trial, point), differences, lists: () => ({ axes, tasks, hardware, families, filterable, allowed, rows, isShown }), point, style: () => Figure.style(page.palette),
    hover: (key) => views.forEach(({ view }) => view.hover?.(key)),
  };
  const views = [...document.querySelectorAll("[data-view]")].map((root) => {
    const { view: name } = root.dataset;
    const { whenEmpty = false, tabs = ["choose"], has = () => true } = Views[name];
    return { name, root, whenEmpty, tabs, has, view: Views[name].view(root, app) };
  });
  const showAnswer = Answer.panel(byId("answer"), byId("cards"), app);

  // ---- views of the page itself

  function renderHeader() {
    // Trials are counted by the progress, which is newer than the table of points; a table alone has no other count.
    const counts = page.progress ? [] : Object.entries(page.counts).map(([status, n]) => (status === "finished" ? plural(n, "trial") : `${number(n)} ${status}`));
    const n = columns.hardware ? rows.filter((row) => String(columns.hardware.values[row]) === state.hardware).length : nRows;
    const age = page.points_at && Details.isServed(page) ? ` as of ${new Date(page.points_at).toLocaleTimeString()}` : "";
    const isSample = page.budgets.stands_for > 1; // of how many points, a note says
    if (nRows && !isSample) counts.push(`${plural(n, "setting")}${age}`);
    byId("counts").textContent = [page.progress ? Progress.said(page) : "", ...counts].filter(Boolean).join(" · ");
    byId("title").textContent = page.definition.title;
    const notes = byId("notes");
    notes.hidden = page.notes.length === 0;
    notes.open ||= page.state !== null;
    notes.querySelector("summary").textContent = plural(page.notes.length, "note");
    notes.querySelector("ul").replaceChildren(...page.notes.map((text) => element("li", { textContent: text })));
  }

  const strip = Dom.strip(byId("tabs"), TABS, (show) => change({ show }), (tab) => ({ id: `show-${tab}` }));
  // Tabs of what this study has.
  function renderTabs(names) {
    const offered = Object.keys(TABS).filter((tab) => views.some(({ name, tabs, has }) => names.includes(name) && tabs.includes(tab) && has(page)));
    const open = offered.includes(state.show) ? state.show : offered[0];
    strip.render(offered, open);
    return open;
  }

  // What stands where a figure will be. Trials end before the table of points is written.
  function insteadOf({ state: given, progress }) {
    if (given.title !== "No design yet" || !progress) return given;
    const { done, running } = progress.trials;
    if (done > progress.trials.failed) return { title: `${plural(done, "trial")} done`, text: "The points of the first trials are being computed; they are shown as they come." };
    return running && progress.is_running ? { title: "Training has begun", text: `${plural(running, "design")} in training or waiting; the first point is shown when the first has ended.` } : given;
  }

  function render(moving = false) {
    const empty = page.state !== null;
    const names = page.definition.views;
    byId("state").hidden = !empty;
    byId("answer").hidden = byId("cards").hidden = byId("tabs").hidden = empty;
    const tab = renderTabs(names);
    const seen = ["always", ...(Figure.style(page.palette).paper ? ["choose", "chips", "inside"] : [tab])]; // on paper a report
    for (const { name, root, tabs, has } of views) {
      root.hidden = empty || !names.includes(name) || !has(page) || !tabs.some((one) => seen.includes(one));
      root.style.order = names.indexOf(name);
    }
    const shown = selection(moving);
    renderHeader();
    if (empty) {
      for (const { name, root, view, whenEmpty } of views.filter((one) => one.whenEmpty && names.includes(one.name))) {
        root.hidden = false;
        view.render(shown);
      }
      const { title: heading, text } = insteadOf(page);
      byId("state").querySelector("h2").textContent = heading;
      byId("state").querySelector("p").textContent = text;
      return;
    }
    showAnswer(shown);
    if (parent !== window) parent.postMessage({ chosen: { trial: shown.subject.value("trial"), point: shown.subject.value("point"), task: columns.task ? state.task : "", hardware: state.hardware } }, "*"); // a notebook listens
    // A link may name a point that is no row of the page: its trial knows it.
    const at = shown.chosen;
    if (at && at.row < 0 && isNamed() && !surfaces.has(`${at.key}@${state.hardware}`)) {
      Details.of(page, at.key.split(".")[0]).then((details) => {
        const values = details?.tasks && Design.valuesOf(shown, details, at.key);
        if (!values || shown.state.hardware !== state.hardware) return;
        setPoint(at.key, values);
        change({});
      });
    }
    // What nobody sees is computed when its tab is opened.
    for (const { root, view } of views) if (!root.hidden) view.render(shown);
  }

  // ---- what a reader does

  const does = {
    "?": () => byId("keys").showModal(), Escape: () => change({ chosen: "", ask: "" }), u: () => history.back(),
  };
  addEventListener("keydown", (event) => {
    const typed = event.target.matches("input:not([type=range]), select, textarea") || document.querySelector("dialog[open]");
    if (typed || event.ctrlKey || event.altKey || event.metaKey || page.state !== null || !Object.hasOwn(does, event.key)) return;
    does[event.key]();
  });
  byId("help").addEventListener("click", does["?"]);
  addEventListener("live", (event) => show(event.detail));
  addEventListener("hashchange", () => {
    clearTimeout(writing);
    const pace = paceOf(location.hash.slice(1));
    if (pace !== state.pace) take(given, pace);
    state = readState();
    ghost = -1;
    render();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => render());
  for (const event of ["beforeprint", "afterprint"]) addEventListener(event, () => render());
  // How long ago a running study was heard of.
  setInterval(() => { if (page.progress && Details.isServed(page)) renderHeader(); }, AGE_MS);
  render();
})();
