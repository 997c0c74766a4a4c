"use strict";
// Budgets: what is within them, the front that is left, and the pick.
// The rules are those of dse.skyline, so that the page and the commands give the same rows.
const Budgets = (() => {
  const STEPS = 200; // of a slider
  const LEAST = 4; // points of a front of whose shape anything is said
  const GAP = 0.1; // of a front's width

  // ---- pure: rows and numbers in, rows and numbers out

  const numbers = (values) => Float64Array.from(values, (v) => (typeof v === "number" ? v : NaN));

  // Rows that no other row beats; costs are minimised and finite, equal rows are kept together.
  function front(costs, rows) {
    const order = [...rows].sort((a, b) => {
      for (const cost of costs) if (cost[a] !== cost[b]) return cost[a] - cost[b];
      return a - b;
    });
    const best = [];
    const beats = (a, b) => costs.every((cost) => cost[a] <= cost[b]) && costs.some((cost) => cost[a] < cost[b]);
    for (const row of order) { // only rows before it can beat a row
      const at = best.findIndex((other) => beats(other, row));
      if (at < 0) best.push(row);
      else if (at > 0) [best[0], best[at]] = [best[at], best[0]]; // who beats one beats many
    }
    return best.sort((a, b) => a - b);
  }

  // Least row by a list of keys, each an array of numbers; what is not finite comes last, ties go to the first row.
  function least(rows, keys) {
    const worse = (x) => (Number.isFinite(x) ? x : Infinity);
    return rows.reduce((best, row) => {
      const key = keys.find((one) => worse(one[row]) !== worse(one[best]));
      return best < 0 || (key && worse(key[row]) < worse(key[best])) ? row : best;
    }, -1);
  }

  // What the shape of a front tells, from its cheap end; `cost`, `gain` and `error` of a row are shares of the drawn axes. The knee lies
  // highest above the line between the ends, by more than its error: beyond it a step costs more per gain than the whole front does
  // (Das 1999; Satopää et al. 2011). A gap: a tenth of the front or more that gains more than the error, at costs that nobody tried.
  function shape(line, cost, gain, error, tried) {
    const [first, last] = [line[0], line.at(-1)];
    const [wide, high] = line.length < LEAST ? [0, 0] : [cost, gain].map((of) => of(last) - of(first));
    if (!(wide > 0)) return { knee: -1, gaps: [] };
    const above = line.map((row) => gain(row) - gain(first) - (high * (cost(row) - cost(first))) / wide);
    const top = above.indexOf(Math.max(...above));
    const steps = line.slice(1).map((row, k) => [line[k], row]).filter(([from, to]) => cost(to) - cost(from) >= GAP * wide && gain(to) - gain(from) > error(to));
    return { knee: above[top] > error(line[top]) ? line[top] : -1, gaps: steps.filter(([from, to]) => !tried().some((row) => cost(row) > cost(from) && cost(row) < cost(to))) };
  }

  // A filter of its text: {low, high}, where null is no end, or {values: Set of texts}; and the text of some values.
  function filter(text) {
    if (text.startsWith("in:")) return { values: new Set(text.slice(3).split("|").map(decodeURIComponent)) };
    const [low = null, high = null] = text.split("~").map((end) => (end === "" ? null : Number(end)));
    return { low, high };
  }
  const oneOf = (values) => `in:${values.map(encodeURIComponent).join("|")}`;

  // What a POSIX shell reads as one word.
  const quoted = (text) => (/^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replace(/'/g, `'"'"'`)}'`);

  // ---- a slider's steps

  function scale([low, high], way) {
    const log = Data.spansDecades(low, high);
    const axis = Data.axis(low, high, { log });
    const loose = way === "min" ? STEPS : 0;
    const limit = (step) => {
      if (step === loose) return "";
      const value = axis.value(step / STEPS);
      const quantum = log ? 10 ** (Math.floor(Math.log10(value)) - 2) : 10 ** Math.floor(Math.log10((high - low) / STEPS));
      const rounded = (way === "min" ? Math.ceil : Math.floor)(value / quantum) * quantum; // never tighter than drawn
      return String(Number(rounded.toPrecision(12)));
    };
    const step = (text) => {
      if (text === "") return loose;
      const near = Math.round(STEPS * Math.min(1, Math.max(0, axis.share(Math.max(Number(text), low)))));
      return [near, near - 1, near + 1].find((k) => k >= 0 && k <= STEPS && limit(k) === text) ?? near;
    };
    return { limit, step };
  }

  // ---- the points of a page under a state {task, family, hardware, "b.<column>"}

  function over(page) {
    const { columns, budgets } = page;
    const limited = Object.entries(budgets.columns);
    const objectives = Object.entries(page.objectives);
    const nRows = Object.values(columns)[0]?.values.length ?? 0;
    const values = Object.fromEntries(
      [...new Set([...limited.map(([c]) => c), ...Object.keys(page.objectives), budgets.maximise, ...budgets.ties.map(([c]) => c)])]
        .filter((c) => c && columns[c]).map((c) => [c, numbers(columns[c].values)]));
    const costOf = (column, way) => (way === "max" ? values[column].map((v) => -v) : values[column]);
    const costs = objectives.map(([column, way]) => costOf(column, way));
    // What decides between rows: the most of what is maximised, then the ties.
    const ranking = budgets.maximise ? [costOf(budgets.maximise, "max"), ...budgets.ties.filter(([c]) => values[c]).map(([c, way]) => costOf(c, way))] : [];
    const whole = maskOf(budgets.contenders); // rows of any front or budget: all of the table's are here
    const weight = (row) => (whole[row] ? 1 : budgets.stands_for); // how many points a row stands for
    const weigh = (rows) => rows.reduce((sum, row) => sum + weight(row), 0);
    const text = (column) => columns[column]?.values.map(String);
    const [task, family, hardware] = ["task", "family", "hardware"].map(text);
    const tasks = task ? [...new Set(task)] : [""];
    const several = (names) => names !== undefined && new Set(names).size > 1;
    const remembered = Data.memory(); // a slider at work asks for the same selection again and again

    const chosenOnly = (names, value) => (names && names.includes(value) ? value : null);
    const filters = (state) => ({
      task: chosenOnly(task, state.task), family: chosenOnly(family, state.family), hardware: chosenOnly(hardware, state.hardware), oversize: state.oversize === "1",
    });

    // The filters of a state, with their columns and texts.
    const conditionsOf = (state) => Object.entries(state).filter(([key, text]) => key.startsWith("f.") && text !== "" && columns[key.slice(2)])
      .map(([key, text]) => ({ column: key.slice(2), text, ...filter(text) }));

    function passes(condition, row) {
      const value = columns[condition.column].values[row];
      if (condition.values) return value !== null && condition.values.has(String(value));
      return typeof value === "number" && !(value < condition.low && condition.low !== null) && !(condition.high !== null && value > condition.high);
    }

    const unable = new Set(page.unable);
    const isUnable = (row) => unable.has(row);
    const isLarge = (row) => columns.fits?.values[row] === false;

    // Rows of the filters, and apart from them those that do not fit their chip: none of these can be chosen.
    function select(chosen, conditions) {
      const named = conditions.filter((one) => one.values); // as dse pick does: numbers are limits, what fits is judged before them
      const [rows, misfits] = [[], []];
      for (let row = 0; row < nRows; row += 1) {
        if ((chosen.task === null || task[row] === chosen.task) && (chosen.family === null || family[row] === chosen.family)
          && (chosen.hardware === null || hardware[row] === chosen.hardware)
          && columns.transductive?.values[row] !== true && named.every((one) => passes(one, row))) {
          (isUnable(row) || (isLarge(row) && !chosen.oversize) ? misfits : rows).push(row);
        }
      }
      return { rows, misfits };
    }

    function maskOf(rows) {
      const mask = new Uint8Array(nRows);
      for (const row of rows) mask[row] = 1;
      return mask;
    }

    // Why a row is compared with none, or "".
    function leftOut(result, row) {
      if (result.admitted[row]) return "";
      if (columns.transductive?.values[row] === true) return "has seen the labels";
      return `${isUnable(row) ? "cannot run on" : "does not fit"} ${hardware?.[row] ?? "the chip"}`;
    }

    function rangesOf(chosen) {
      const groups = budgets.ranges.filter((group) => ["task", "family", "hardware"].every((k) => chosen[k] === null || group[k] === chosen[k]));
      return Object.fromEntries(Object.keys(values).map((column) => {
        const ends = groups.map((group) => group.ends[column]).filter(Boolean);
        return [column, ends.length ? [Math.min(...ends.map(([low]) => low)), Math.max(...ends.map(([, high]) => high))] : null];
      }));
    }

    const byTask = (rows, chosenCosts) => tasks.flatMap((name) =>
      front(chosenCosts, task ? rows.filter((row) => task[row] === name) : rows)).sort((a, b) => a - b);

    const limitsOf = (state) => limited.map(([column, way]) => ({ column, way, limit: Number(state[`b.${column}`]), text: state[`b.${column}`] })).filter(({ text }) => text);
    const meets = ({ column, way, limit }, row) => (way === "max" ? values[column][row] >= limit : values[column][row] <= limit);

    // Whether a row is on the front in at least a share of the samples.
    const isSure = (share, row) => share === 0 || columns.front_probability?.values[row] >= share;

    function evaluate(state) {
      const chosen = filters(state);
      const conditions = conditionsOf(state);
      const key = JSON.stringify([chosen, conditions.map(({ column, text }) => [column, text])]);
      const { rows: admissible, misfits } = remembered("admissible", key, () => select(chosen, conditions));
      const admitted = remembered("admitted", key, () => maskOf(admissible));
      const selected = remembered("selected", key, () => admissible.filter((row) => conditions.every((one) => passes(one, row))));
      const limits = limitsOf(state);
      const numbered = values[budgets.maximise];
      const measured = remembered("measured", key, () => selected.filter((row) => !numbered || Number.isFinite(numbered[row])));
      const kept = measured.filter((row) => limits.every((one) => meets(one, row)));
      const [within, count, total] = [maskOf(kept), weigh(kept), weigh(measured)];
      const rivals = remembered("rivals", key, () => {
        if (conditions.length) return selected; // who decides under any budget does not under any filter
        const among = new Set(selected);
        return budgets.contenders.filter((row) => among.has(row));
      });
      // A budget on an objective never adds to the front: who beats a row within it is within it too.
      const beside = limits.filter(({ column }) => !Object.hasOwn(page.objectives, column));
      const sure = Number(state.sure || 0);
      const base = remembered("base", `${key}${JSON.stringify(beside)}`, () => byTask(
        rivals.filter((row) => costs.every((cost) => Number.isFinite(cost[row])) && beside.every((limit) => meets(limit, row))), costs));
      const result = {
        key: JSON.stringify([key, limits.map(({ column, text }) => [column, text]), sure]), page, chosen, limits, within, count, total, admitted, conditions, rivals,
        matches: (row) => conditions.every((one) => passes(one, row)),
        misfits, weight, isUnable, noneFits: admissible.length === 0 && misfits.length > 0,
          front: base.filter((row) => limits.every((limit) => meets(limit, row)) && isSure(sure, row)), sure,
        ranges: remembered("ranges", key, () => rangesOf(chosen)), exact: budgets.stands_for <= 1, best: -1, pick: -1, half: -1, alike: [], among: [], atMost: null, nearest: [], relaxed: [],
        command: command(state, chosen, limits, conditions),
      };
      if (!budgets.maximise) return result;
      const sameDesign = (a, b) => (columns.trial ? columns.trial.values[a] === columns.trial.values[b] : a === b);
      const feasible = rivals.filter((row) => within[row] === 1);
      result.best = least(feasible, ranking);
      if (result.best >= 0) {
        Object.assign(result, frugal(feasible, result.best));
        result.among = feasible;
        result.command = command(state, chosen, limits, conditions, result.atMost);
        result.half = cost ? least(feasible.filter((row) => values[cost][row] <= values[cost][result.pick] / 2), ranking) : -1;
        return result;
      }
      const known = (row) => [numbered, ...limits.map(({ column }) => values[column])].every((x) => Number.isFinite(x[row]));
      const miss = ({ column, way, limit }, row) => Math.max(way === "max" ? limit - values[column][row] : values[column][row] - limit, 0);
      // For each budget, what it must be if the others stay: nothing beats this row in its column within them.
      const met = new Map(rivals.filter(known).map((row) => [row, limits.map((one) => meets(one, row))]));
      const last = (k) => Number(limits[k].column === budgets.maximise); // more accuracy is what the others are relaxed for
      [...limits.keys()].sort((a, b) => last(a) - last(b)).forEach((k) => {
        const { column, way } = limits[k];
        const row = least([...met.keys()].filter((one) => met.get(one).every((is, j) => is || j === k)), [costOf(column, way), ...ranking]);
        if (row >= 0) result.relaxed.push({ row, column, missed: [{ ...limits[k], by: miss(limits[k], row) }] });
      });
      const shortfall = new Float64Array(nRows);
      // Where nothing fits, the nearest are those that a larger chip would hold.
      let left = (result.noneFits ? misfits.filter((row) => !isUnable(row) && result.matches(row)) : selected).filter(known);
      const deciding = new Set(budgets.contenders);
      for (const row of left) for (const one of limits) shortfall[row] += miss(one, row) / (Math.abs(one.limit) || 1);
      while (left.length && result.nearest.length < 3) {
        const among = result.nearest.length || conditions.length ? left : left.filter((row) => deciding.has(row));
        const row = least(among, [shortfall, ...ranking]);
        result.nearest.push({ row, missed: limits.map((one) => ({ ...one, by: miss(one, row) })).filter(({ limit, column, way, by }) => by > 0 || !meets({ limit, column, way }, row)) });
        left = left.filter((other) => !sameDesign(other, row));
      }
      return result;
    }

    // The pick: of all that gain as much as the best but for its standard error, the cheapest. No cheaper point gains as
    // much, so that it is the best within a limit of what it costs: the command says this limit.
    const cost = ["energy_uj", page.period?.instead, ...Object.keys(page.objectives)].find((name) => page.objectives[name] === "min" && values[name]);
    const errorOf = (row) => (Object.hasOwn(page.intervals, budgets.maximise) ? page.intervals[budgets.maximise].low[row] : 0);
    function frugal(feasible, best) {
      const enough = values[budgets.maximise][best] - errorOf(best);
      const alike = feasible.filter((row) => values[budgets.maximise][row] >= enough);
      const atMost = cost ? Math.min(...alike.map((row) => values[cost][row]).filter(Number.isFinite)) : Infinity;
      if (!Number.isFinite(atMost)) return { pick: best, alike, atMost: null };
      const pick = least(feasible.filter((row) => values[cost][row] <= atMost), ranking);
      return { pick, alike, atMost: pick === best ? null : atMost };
    }

    // The literal of a value in the language of conditions.
    function literal(column, text) {
      const value = columns[column].values.find((one) => String(one) === text);
      return typeof value === "boolean" ? (value ? "True" : "False") : JSON.stringify(text);
    }

    function command(state, chosen, limits, filtered, atMost = null) {
      const conditions = Object.entries({ task: several(task), family: several(family), hardware: several(hardware) })
        .filter(([name, needed]) => needed && chosen[name] !== null).map(([name]) => `${name} == ${JSON.stringify(chosen[name])}`);
      for (const { column, low, high, values: names } of filtered) {
        if (names) conditions.push(`${column} in [${[...names].map((name) => literal(column, name)).join(", ")}]`);
        else conditions.push(...(low !== null ? [`${column} >= ${low}`] : []), ...(high !== null ? [`${column} <= ${high}`] : []));
      }
      const kept = atMost === null ? limits : [...limits.filter(({ column }) => column !== cost), { column: cost, way: "min", text: String(atMost) }];
      const expressions = [...conditions, ...kept.map(({ column, way, text }) => `${column} ${{ max: ">=", min: "<=", is: "==" }[way]} ${Number(text)}`)];
      const priced = budgets.hardware.map((name) => `--hardware ${quoted(name)}`);
      return ["dse pick", quoted(budgets.results), ...priced, ...(chosen.oversize ? ["--oversize"] : []), ...expressions.map((one) => `--budget ${quoted(one)}`),
        ...(budgets.maximise === (objectives.find(([, way]) => way === "max")?.[0] ?? "accuracy") ? [] : [`--maximise ${quoted(budgets.maximise ?? "")}`]), "--export bundle"].join(" ");
    }

    // The rows that are best in turn as the limit of a column loosens and the others stay: what dse pick takes at each.
    function bought(state, column) {
      const { among } = evaluate({ ...state, [`b.${column}`]: "" });
      const cost = costOf(column, budgets.columns[column]);
      const found = [];
      for (const row of among.filter((one) => Number.isFinite(cost[one])).sort((a, b) => cost[a] - cost[b] || a - b)) {
        if (found.length && least([found.at(-1), row], ranking) !== row) continue;
        if (found.length && cost[found.at(-1)] === cost[row]) found.pop();
        found.push(row);
      }
      return found;
    }

    // The command of one point, on the chip of a state, whether it fits it or not.
    const exported = (state, trial, point) => command(state, { ...filters(state), family: null, oversize: true },
      [{ column: "trial", way: "is", text: trial }, { column: "point", way: "is", text: point }], []);

    // The front over some objectives alone, among what is within the budgets.
    const joined = (result, named) => remembered("joined", `${result.key}${named}`, () => byTask(
      result.rivals.filter((row) => result.within[row] && isSure(result.sure, row) && named.every((c) => Number.isFinite(values[c][row]))),
      named.map((c) => costOf(c, page.objectives[c]))));

    return { evaluate, bought, exported, joined, leftOut, cost };
  }

  // ---- what a link may say of limits

  const isLimit = { includes: (text) => text === "" || (text.trim() !== "" && Number.isFinite(Number(text))) };
  const plain = (page) => Object.fromEntries(Object.keys(page.budgets.columns).map((column) =>
    [`b.${column}`, String(page.definition.budgets[column] ?? "")]));
  const allowed = (page) => Object.fromEntries(Object.keys(page.budgets.columns).map((column) => [`b.${column}`, isLimit]));

  return { over, front, least, shape, LEAST, filter, oneOf, quoted, scale, plain, allowed, STEPS };
})();
