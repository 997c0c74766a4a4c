"use strict";
// Budgets: what is within them, the front that is left, the pick, and the panel that moves them.
// The rules are those of dse.skyline, so that the page and the commands give the same rows.
const Budgets = (() => {
  const STEPS = 200; // of a slider
  const { element, button } = Dom;

  // ---- pure: rows and numbers in, rows and numbers out

  const numbers = (values) => Float64Array.from(values, (v) => (typeof v === "number" ? v : NaN));

  // Rows that no other row beats; costs are minimised and finite, equal rows are kept together.
  function front(costs, rows) {
    const order = [...rows].sort((a, b) => {
      for (const cost of costs) if (cost[a] !== cost[b]) return cost[a] - cost[b];
      return a - b;
    });
    const best = [];
    const beats = (a, b) => {
      let better = false;
      for (const cost of costs) {
        if (cost[a] > cost[b]) return false;
        better ||= cost[a] < cost[b];
      }
      return better;
    };
    for (const row of order) { // only rows before it can beat a row
      const at = best.findIndex((other) => beats(other, row));
      if (at < 0) best.push(row);
      else if (at > 0) [best[0], best[at]] = [best[at], best[0]]; // who beats one beats many
    }
    return best.sort((a, b) => a - b);
  }

  // Least row by a list of keys, each an array of numbers; what is not finite comes last, ties go to the first row.
  function least(rows, keys) {
    let best = -1;
    const worse = (x) => (Number.isFinite(x) ? x : Infinity);
    for (const row of rows) {
      if (best >= 0) {
        const key = keys.find((one) => worse(one[row]) !== worse(one[best]));
        if (!key || worse(key[row]) > worse(key[best])) continue;
      }
      best = row;
    }
    return best;
  }

  // What a POSIX shell reads as one word.
  const quoted = (text) => (/^[\w@%+=:,./-]+$/.test(text) ? text : `'${text.replace(/'/g, `'"'"'`)}'`);

  // ---- a slider's steps

  function scale([low, high], way) {
    const log = low > 0 && high / low > 100;
    const at = (step) => (log ? low * (high / low) ** (step / STEPS) : low + ((high - low) * step) / STEPS);
    const loose = way === "min" ? STEPS : 0;
    const limit = (step) => {
      if (step === loose) return "";
      const value = at(step);
      const quantum = log ? 10 ** (Math.floor(Math.log10(value)) - 2) : 10 ** Math.floor(Math.log10((high - low) / STEPS));
      const rounded = (way === "min" ? Math.ceil : Math.floor)(value / quantum) * quantum; // never tighter than drawn
      return String(Number(rounded.toPrecision(12)));
    };
    const step = (text) => {
      if (text === "") return loose;
      const value = Number(text);
      const share = log ? Math.log(Math.max(value, low) / low) / Math.log(high / low) : (value - low) / (high - low);
      const near = Math.round(STEPS * Math.min(1, Math.max(0, share)));
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
    const whole = new Uint8Array(nRows); // rows of any front or budget: all of the table's are here
    for (const row of budgets.contenders) whole[row] = 1;
    const weight = (row) => (whole[row] ? 1 : budgets.stands_for); // how many points a row stands for
    const text = (column) => columns[column]?.values.map(String);
    const [task, family, hardware] = ["task", "family", "hardware"].map(text);
    const tasks = task ? [...new Set(task)] : [""];
    const several = (names) => names !== undefined && new Set(names).size > 1;
    const results = new Map();

    // The last result of each kind; a slider at work asks for the same selection again and again.
    function remembered(kind, key, make) {
      const last = results.get(kind);
      if (last?.key === key) return last.value;
      const value = make();
      results.set(kind, { key, value });
      return value;
    }

    const chosenOnly = (names, value) => (names && names.includes(value) ? value : null);
    const filters = (state) => ({
      task: chosenOnly(task, state.task), family: chosenOnly(family, state.family), hardware: chosenOnly(hardware, state.hardware), oversize: state.oversize === "1",
    });

    // The filters of a state: {column, low, high}, where null is no end, or {column, values: Set of texts}.
    function conditionsOf(state) {
      return Object.entries(state).filter(([key, text]) => key.startsWith("f.") && text !== "" && columns[key.slice(2)]).map(([key, text]) => {
        const column = key.slice(2);
        if (text.startsWith("in:")) return { column, text, values: new Set(text.slice(3).split("|").map(decodeURIComponent)) };
        const [low, high] = text.split("~").map((end) => (end === "" ? null : Number(end)));
        return { column, text, low, high };
      });
    }

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

    function limitsOf(state) {
      return limited.filter(([column]) => state[`b.${column}`]).map(([column, way]) =>
        ({ column, way, limit: Number(state[`b.${column}`]), text: state[`b.${column}`] }));
    }
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
      const within = new Uint8Array(nRows);
      const alone = limits.map(() => 0); // weight of rows that only this budget excludes
      let [count, total] = [0, 0];
      const numbered = values[budgets.maximise];
      for (const row of selected) {
        if (numbered && !Number.isFinite(numbered[row])) continue;
        total += weight(row);
        let [missed, which] = [0, -1];
        for (let k = 0; k < limits.length && missed < 2; k += 1) {
          if (!meets(limits[k], row)) { missed += 1; which = k; }
        }
        if (missed === 0) { within[row] = 1; count += weight(row); } else if (missed === 1) alone[which] += weight(row);
      }
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
      const isWithin = (row) => within[row] === 1;
      const result = {
        key: JSON.stringify([key, limits.map(({ column, text }) => [column, text]), sure]), page, chosen, limits, within, count, total, admitted, conditions, rivals,
        matches: (row) => conditions.every((one) => passes(one, row)),
        misfits, weight, isUnable, isMisfit: (row) => isLarge(row) || isUnable(row), noneFits: admissible.length === 0 && misfits.length > 0, front: base.filter((row) => limits.every((limit) => meets(limit, row)) && isSure(sure, row)), sure,
        cost: Object.fromEntries(limits.map(({ column }, k) => [column, alone[k]])),
        ranges: remembered("ranges", key, () => rangesOf(chosen)), exact: budgets.stands_for <= 1, pick: -1, second: -1, nearest: [], relaxed: [], picks: [],
        command: command(state, chosen, limits, conditions),
      };
      if (!budgets.maximise) return result;
      const ranking = [costOf(budgets.maximise, "max"), ...budgets.ties.filter(([c]) => values[c]).map(([c, way]) => costOf(c, way))];
      const sameDesign = (a, b) => (columns.trial ? columns.trial.values[a] === columns.trial.values[b] : a === b);
      const feasible = rivals.filter(isWithin);
      result.pick = least(feasible, ranking);
      if (result.pick >= 0) {
        // Accuracies of different tasks are not compared: each has a pick.
        result.picks = chosen.task !== null || tasks.length < 2 ? [{ task: "", row: result.pick }]
          : tasks.map((name) => ({ task: name, row: least(feasible.filter((row) => task[row] === name), ranking) }));
        result.second = least(selected.filter((row) => isWithin(row) && !sameDesign(row, result.pick)), ranking);
        return result;
      }
      const known = (row) => [numbered, ...limits.map(({ column }) => values[column])].every((x) => Number.isFinite(x[row]));
      const miss = ({ column, way, limit }, row) => Math.max(way === "max" ? limit - values[column][row] : values[column][row] - limit, 0);
      // For each budget, what it must be if the others stay: nothing beats this row in its column within them.
      const isMet = (row) => limits.map((one) => meets(one, row));
      const met = new Map(rivals.filter(known).map((row) => [row, isMet(row)]));
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

    // The literal of a value in the language of conditions.
    function literal(column, text) {
      const value = columns[column].values.find((one) => String(one) === text);
      return typeof value === "boolean" ? (value ? "True" : "False") : JSON.stringify(text);
    }

    function command(state, chosen, limits, filtered) {
      const conditions = Object.entries({ task: several(task), family: several(family), hardware: several(hardware) })
        .filter(([name, needed]) => needed && chosen[name] !== null).map(([name]) => `${name} == ${JSON.stringify(chosen[name])}`);
      for (const { column, low, high, values: names } of filtered) {
        if (names) conditions.push(`${column} in [${[...names].map((name) => literal(column, name)).join(", ")}]`);
        else conditions.push(...(low !== null ? [`${column} >= ${low}`] : []), ...(high !== null ? [`${column} <= ${high}`] : []));
      }
      const expressions = [...conditions, ...limits.map(({ column, way, text }) => `${column} ${way === "max" ? ">=" : "<="} ${Number(text)}`)];
      const priced = budgets.hardware.map((name) => `--hardware ${quoted(name)}`);
      return ["dse pick", quoted(budgets.results), ...priced, ...(chosen.oversize ? ["--oversize"] : []), ...expressions.map((one) => `--budget ${quoted(one)}`),
        ...(budgets.maximise === (objectives.find(([, way]) => way === "max")?.[0] ?? "accuracy") ? [] : [`--maximise ${quoted(budgets.maximise ?? "")}`]), "--export bundle"].join(" ");
    }

    // The front over some objectives alone, among what is within the budgets.
    const joined = (result, named) => remembered("joined", `${result.key}${named}`, () => byTask(
      result.rivals.filter((row) => result.within[row] && isSure(result.sure, row) && named.every((c) => Number.isFinite(values[c][row]))),
      named.map((c) => costOf(c, page.objectives[c]))));

    // Each budget alone, at half of its slider.
    const halfway = (state) => Object.entries(rangesOf(filters(state))).filter(([column, range]) => range && budgets.columns[column])
      .map(([column, range]) => ({ [`b.${column}`]: scale(range, budgets.columns[column]).limit(STEPS / 2) }));

    return { evaluate, joined, leftOut, halfway };
  }

  // ---- the panel

  const isLimit = { includes: (text) => text === "" || (text.trim() !== "" && Number.isFinite(Number(text))) };
  const plain = (page) => Object.fromEntries(Object.keys(page.budgets.columns).map((column) =>
    [`b.${column}`, String(page.definition.budgets[column] ?? "")]));
  const allowed = (page) => Object.fromEntries(Object.keys(page.budgets.columns).map((column) => [`b.${column}`, isLimit]));

  // Returns what shows a result of `evaluate`. Inputs last as long as the columns with a budget do, so that a drag
  // or the focus survives new points.
  function panel(root, { clip, number, many, withInterval, beside, nameOf, change, keyOf }) {
    let [inputs, built] = [[], ""];
    const build = ({ columns, budgets }) => Object.entries(budgets.columns).map(([column, way], k) => {
      const { label, unit } = columns[column];
      const sign = way === "max" ? "≥" : "≤";
      const words = `${label} ${way === "max" ? "at least" : "at most"}${unit ? `, ${unit}` : ""}`;
      const set = (text) => change({ [`b.${column}`]: text });
      const box = element("input", { type: "number", step: "any", id: `budget-${k}`, placeholder: "any", "aria-label": words,
        oninput: () => set(box.validity.badInput ? "" : box.value) });
      const cost = element("small", { id: `cost-${k}` });
      const slider = element("input", { type: "range", min: 0, max: STEPS, step: 1, id: `slider-${k}`, "aria-label": words, "aria-describedby": cost.id,
        oninput: () => set(one.steps.limit(Number(slider.value))) });
      const one = { column, words, box, slider, cost, steps: null };
      root.querySelector("#sliders").append(element("div", { className: "budget" },
        element("label", { htmlFor: box.id, textContent: `${clip(label, 40)} ${sign}`, title: column }), box,
        element("span", { textContent: unit }), slider, cost));
      return one;
    });
    const part = (name) => root.querySelector(name) ?? document.querySelector(name); // the pick has a column of its own
    part("#clear").onclick = () => change(Object.fromEntries(inputs.map(({ column }) => [`b.${column}`, ""])));
    part("#copy").onclick = () => copy(part("#command"), part("#copied"));

    // A pick as a card: first what it gains, corrected for having been chosen as the best, then what it costs.
    function design(page, row, missed = []) {
      const { columns, objectives, budgets } = page;
      const key = keyOf(row);
      const choose = button(clip(nameOf(row), 40), () => change({ chosen: key }), { data: { key } });
      const whole = (c) => element("span", { className: "whole", textContent: `${withInterval(c, row)}\u00a0${columns[c].unit}`.trim() });
      const named = (c) => element("span", {}, `${clip(columns[c].label, 40)} `, whole(c));
      const line = (nodes) => element("span", { className: "line" }, ...nodes.flatMap((node, k) => (k ? [" · ", node] : [node])));
      const gain = budgets.maximise;
      const known = (c) => Object.hasOwn(columns, c) && columns[c].values[row] !== null;
      const [corrected, test] = [`${gain}_corrected`, `${gain}_test`];
      const gains = !gain ? [] : [
        element("strong", {}, `${clip(columns[gain].label, 40)} `, whole(known(corrected) ? corrected : gain)),
        line([
          ...(known(corrected) ? ["corrected for being the best of many", element("span", {}, whole(gain), " on validation")]
            : ["on validation", element("span", { className: "note", textContent: "not corrected for being the best of many" })]),
          known(test) ? element("span", {}, whole(test), " on test") : "not tested",
        ]),
      ];
      const costs = beside(Object.keys(objectives).filter((c) => c !== gain)).map(named);
      return element("p", {}, choose, " ", ...gains, line(costs), ...missed.map(({ column, by }) =>
        element("span", { className: "note missed", textContent: `misses ${clip(columns[column].label, 40)} by ${number(by, true)}\u00a0${columns[column].unit}`.trim() })));
    }

    function show(state, result) {
      const { page } = result;
      const { budgets } = page;
      if (built !== JSON.stringify(budgets.columns)) {
        built = JSON.stringify(budgets.columns);
        part("#sliders").replaceChildren();
        inputs = build(page);
      }
      for (const one of inputs) {
        const { column, words, box, slider, cost } = one;
        const limit = state[`b.${column}`];
        const range = result.ranges[column];
        slider.disabled = !range || range[0] === range[1];
        if (!slider.disabled) {
          one.steps = scale(range, budgets.columns[column]);
          if (one.steps.limit(Number(slider.value)) !== limit) slider.value = one.steps.step(limit);
        }
        if (box.value !== limit && document.activeElement !== box) box.value = limit;
        slider.setAttribute("aria-valuetext", limit === "" ? "no limit" : `${words} ${limit}`);
        const easier = result.relaxed.find((other) => other.column === column);
        cost.title = limit === "" ? "" : result.count ? "points that would be feasible without this budget" : "what this budget must be if the others stay";
        cost.textContent = !range ? "no numbers" : slider.disabled ? "the same for all designs"
          : limit === "" ? "no limit" : result.count ? `costs ${result.exact ? "" : "~"}${many(result.cost[column])}`
            : easier ? `from ${number(page.columns[column].values[easier.row])}` : "not alone";
      }
      const total = result.noneFits ? result.misfits.reduce((sum, row) => sum + result.weight(row), 0) : result.total;
      write("#feasible", `${result.exact || result.count === 0 ? "" : "about "}${many(result.count)} of ${many(total)} points feasible`);
      write("#n-front", `${many(result.front.length)} on the front${result.sure ? `, in at least ${Math.round(100 * result.sure)}\u202f% of the samples` : ""}`);
      write("#fit", fitOf(page, result));
      part("#clear").disabled = result.limits.length === 0;
      const several = result.picks.length > 1;
      const [heading, ...nodes] = !budgets.maximise ? ["Pick", element("p", { textContent: "No objective is maximised, so no design can be picked." })]
        : several ? ["Picks", ...result.picks.flatMap(({ task, row }) => [element("h3", { textContent: clip(task, 40) }),
          row >= 0 ? design(page, row) : element("p", { textContent: "nothing is feasible" })])]
          : result.pick >= 0
            ? ["Pick", design(page, result.pick), ...(result.second >= 0 ? [element("h3", { textContent: "Runner-up" }), design(page, result.second)] : [])]
            : ["Nothing is feasible", ...(result.noneFits || !result.nearest.length ? [element("p", { textContent: fitOf(page, result) || "No design has values for all budgets." })] : []),
              ...offered("relax one budget", result.relaxed, page), ...offered(result.noneFits ? "nearest, on a larger chip" : "nearest in all", result.nearest, page)];
      write("#pick h2", heading);
      writePick(nodes);
      part("#export").hidden = result.pick < 0 || !budgets.results; // two studies have no command
      part("#command").hidden = part("#copy").hidden = several;
      part("#which").hidden = !several;
      part("#command").textContent = result.command;
    }

    const offered = (words, designs, page) => (designs.length ? [element("h3", { textContent: words }), ...designs.map(({ row, missed }) => design(page, row, missed))] : []);

    // What the chip that is shown does with the designs that are shown.
    function fitOf({ budgets }, { misfits, isUnable, isMisfit, noneFits, chosen, conditions, admitted }) {
      const chip = chosen.hardware ?? "the chip";
      if (noneFits) {
        const large = misfits.some((row) => !isUnable(row));
        const unable = misfits.some(isUnable);
        return !large ? `${chip} cannot run ${chosen.family ?? "these designs"}.`
          : `No design fits ${chip}: ${unable ? "it cannot run some, and the others are" : "all are"} too large.`;
      }
      const larger = chosen.oversize && admitted.some((is, row) => is && isMisfit(row)) ? `What does not fit ${chip} is priced as if on a larger chip. ` : "";
      return conditions.length && budgets.stands_for > 1 ? `${larger}With filters, the front and the pick are the best of the points that this page holds.` : larger;
    }

    // What is read aloud when it changes is not written again as it was.
    function write(name, text) {
      if (part(name).textContent !== text) part(name).textContent = text;
    }

    function writePick(nodes) {
      const place = part("#pick > div");
      if (place.innerHTML === nodes.map((node) => node.outerHTML).join("")) return;
      const focused = [...place.querySelectorAll("button")].indexOf(document.activeElement);
      place.replaceChildren(...nodes);
      place.querySelectorAll("button")[focused]?.focus();
    }

    return show;
  }

  // A page from disk may have no clipboard of its own; the selection always works.
  async function copy(from, status) {
    try {
      await navigator.clipboard.writeText(from.textContent);
      status.textContent = "copied";
    } catch {
      getSelection().selectAllChildren(from);
      status.textContent = document.execCommand("copy") ? "copied" : "selected; copy it with the keyboard";
    }
  }

  return { over, front, least, quoted, scale, plain, allowed, panel };
})();
