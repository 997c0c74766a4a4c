"use strict";
// What helps to decide: what one point of accuracy costs at the pick, and what each chip would make of the budgets.
const Decide = (() => {
  const WINDOW = 0.05; // of accuracy, over which a price is a mean: single steps of a front are noise
  const DRAWS = 400;
  const QUANTILES = [0.05, 0.95];
  const SETTLED_MS = 150;

  // ---- pure

  function* normals(seed) {
    let state = seed >>> 0;
    const uniform = () => { // mulberry32
      state = (state + 0x6d2b79f5) >>> 0;
      let t = Math.imul(state ^ (state >>> 15), state | 1);
      t ^= t + Math.imul(t ^ (t >>> 7), t | 61);
      return (((t ^ (t >>> 14)) >>> 0) + 0.5) / 4294967296;
    };
    for (;;) yield Math.sqrt(-2 * Math.log(uniform())) * Math.cos(2 * Math.PI * uniform());
  }

  // The least cost of points {gain, cost, se, trial} that gain a level; Infinity where none does.
  const leastCost = (points, level, shift = () => 0) => points.find((one) => one.gain + shift(one) >= level)?.cost ?? Infinity;

  // What a hundredth more of the gain costs below a point, and its 90 % interval: errors of the gain are drawn anew,
  // alike for the points of a trial. `points` by rising cost. Null where nothing lies below.
  function priceOf(points, pick, draws = DRAWS) {
    const [level, low] = [pick.gain, pick.gain - WINDOW - 1e-9];
    const per = (from, to) => (to - from) / (100 * WINDOW);
    const [from, to] = [leastCost(points, low), leastCost(points, level)];
    if (!Number.isFinite(to) || !points.some(({ gain }) => gain < low)) return null;
    const [normal, sampled] = [normals(1), []];
    for (let k = 0; k < draws; k += 1) {
      const unit = new Map();
      const shift = ({ trial, se }) => {
        if (!unit.has(trial)) unit.set(trial, normal.next().value);
        return se * unit.get(trial);
      };
      const own = shift(pick);
      sampled.push(per(leastCost(points, low + own, shift), leastCost(points, level + own, shift)));
    }
    const sorted = sampled.sort((a, b) => a - b);
    const [least, most] = QUANTILES.map((q) => sorted[Math.min(draws - 1, Math.floor(q * draws))]);
    return { from, to, price: per(from, to), least, most };
  }

  function view(root, app) {
    const { element, number, clip, title } = app;
    const price = element("div", { className: "price" });
    const equals = element("p", { className: "equals" });
    const chips = element("div", { className: "chips" });
    root.append(price, equals, chips);
    let shown = null;
    let [waiting, engine, engineOf] = [0, null, null];

    // Points that can be chosen, by rising cost.
    function pointsOf(budgeted, task, column) {
      const { page, columns } = shown;
      const gain = page.budgets.maximise;
      const [gains, costs] = [app.numbers(gain), app.numbers(column)];
      const se = page.intervals[gain]?.low;
      return budgeted.rivals.filter((row) => budgeted.within[row] && (!task || app.taskOf(row) === task) && Number.isFinite(gains[row]) && Number.isFinite(costs[row]))
        .map((row) => ({ row, gain: gains[row], cost: costs[row], se: se?.[row] ?? 0, trial: columns.trial?.values[row] ?? row }))
        .sort((a, b) => a.cost - b.cost || b.gain - a.gain);
    }

    const cell = (text, className = "") => element("td", { textContent: text, className });
    const head = (...names) => element("tr", {}, ...names.map((text, k) => element("th", { scope: "col", textContent: text, className: k && text !== "task" ? "" : "text" })));
    function table(headings, rows) {
      const scroll = element("div", { className: "scroll", tabIndex: 0 }, element("table", {}, element("thead", {}, head(...headings)), element("tbody", {}, ...rows)));
      scroll.setAttribute("role", "group");
      scroll.setAttribute("aria-label", headings[0]);
      return scroll;
    }

    // ---- the price of a point

    function renderPrice() {
      const { page, columns, budgeted } = shown;
      const gain = page.budgets.maximise;
      const costs = Object.entries(page.budgets.columns).filter(([, way]) => way === "min").map(([column]) => column);
      const isShare = gain !== null && app.numbers(gain).every((value) => Number.isNaN(value) || (value >= 0 && value <= 1));
      const several = budgeted.picks.length > 1;
      const lines = !isShare ? [] : budgeted.picks.filter(({ row }) => row >= 0).flatMap(({ task, row }) => {
        return costs.flatMap((column) => {
          const points = pointsOf(budgeted, task, column);
          const pick = points.find((one) => one.row === row);
          const found = pick ? priceOf(points, pick) : null;
          if (!found) return [];
          const unit = columns[column].unit ? `\u202f${columns[column].unit}` : "";
          return [element("tr", {}, element("th", { scope: "row", className: "text", textContent: `${several ? `${clip(task, 24)}: ` : ""}${columns[column].label}` }),
            cell(`${number(found.price)}${unit}`, "value"), cell(`${number(found.least)} to ${number(found.most)}`), cell(`${number(found.from)} → ${number(found.to)}${unit}`))];
        });
      });
      price.hidden = lines.length === 0;
      if (price.hidden) return;
      const label = columns[gain].label;
      price.replaceChildren(element("h2", {}, `What a point of ${label} costs `, element("small", { textContent: `mean from ${WINDOW} below the pick up to it` })),
        table(["of", "a point costs", "90 % interval", "in all"], lines));
    }

    // ---- what is as good as the pick

    // How sure the ranking is: designs whose gain is within one standard error of the difference, and the cheapest.
    function renderEquals() {
      const { page, columns, budgeted } = shown;
      const gain = page.budgets.maximise;
      const cost = costOf(page);
      const lines = !gain || !cost || !columns.trial ? [] : budgeted.picks.filter(({ row }) => row >= 0).flatMap(({ task, row }) => {
        const points = pointsOf(budgeted, task, cost);
        const pick = points.find((one) => one.row === row);
        if (!pick || !pick.se) return [];
        const alike = points.filter((one) => one.trial !== pick.trial && pick.gain - one.gain <= Math.hypot(pick.se, one.se));
        const lead = `${task ? `${clip(task, 24)}: ` : ""}${app.plural(new Set(alike.map(({ trial }) => trial)).size, "other design")} as good as the pick within its error`;
        if (!alike.length) return [element("span", { textContent: `${lead}.` })];
        const [{ row: cheapest, trial }] = alike;
        const button = element("button", { type: "button", textContent: `Trial ${number(trial)}` });
        button.addEventListener("click", () => app.change({ chosen: app.keyOf(cheapest) }));
        const unit = (column) => (columns[column].unit ? `\u202f${columns[column].unit}` : "");
        return [element("span", {}, `${lead}; least ${columns[cost].label}: `, button, ` ${app.withInterval(gain, cheapest)}, ${app.withInterval(cost, cheapest)}${unit(cost)}. `)];
      });
      equals.hidden = lines.length === 0;
      equals.replaceChildren(...lines);
    }

    const costOf = (page) => ["energy_uj", page.period?.instead].find((name) => Object.hasOwn(page.objectives, name)) ?? Object.keys(page.objectives).find((name) => page.objectives[name] === "min");

    // ---- chips

    function renderChips() {
      const { page, columns, state } = shown;
      const names = app.distinct("hardware");
      chips.hidden = names.length < 2 || !page.budgets.maximise;
      if (chips.hidden) return;
      if (engineOf !== page) [engine, engineOf] = [Budgets.over(page), page];
      const gain = page.budgets.maximise;
      const cost = costOf(page);
      const found = names.map((name) => ({ name, budgeted: engine.evaluate({ ...state, hardware: name }) }));
      const tasks = found[0].budgeted.chosen.task === null && columns.task ? app.distinct("task") : [""];
      const lines = tasks.flatMap((task) => {
        const ofTask = found.map(({ name, budgeted }) => {
          const pick = task ? budgeted.picks.find((one) => one.task === task)?.row ?? -1 : budgeted.pick;
          return { name, budgeted, pick, points: pick >= 0 && cost ? pointsOf(budgeted, task, cost) : [] };
        });
        const level = Math.min(...ofTask.filter(({ pick }) => pick >= 0).map(({ pick }) => columns[gain].values[pick]));
        const least = ofTask.map(({ points }) => points.find((one) => one.gain >= level) ?? null);
        const known = least.filter((one) => one && Number.isFinite(one.cost));
        const best = known.length > 1 ? known.reduce((a, b) => (b.cost < a.cost ? b : a)) : null;
        const ends = page.intervals[cost];
        const top = (one) => one.cost + (ends?.high[one.row] ?? 0);
        const bottom = (one) => one.cost - (ends?.low[one.row] ?? 0);
        const wins = best && known.every((one) => one === best || bottom(one) > top(best));
        return ofTask.map(({ name, budgeted, pick }, k) => {
          const choose = element("button", { type: "button", textContent: clip(name, 32), title: "show this chip" });
          choose.setAttribute("aria-pressed", String(state.hardware === name));
          choose.addEventListener("click", () => app.change({ hardware: name }));
          const note = budgeted.lacking.length ? "cannot run these" : budgeted.oversized ? "none fits" : "";
          const value = least[k] && Number.isFinite(least[k].cost) ? app.withInterval(cost, least[k].row) : "–";
          return element("tr", {}, element("th", { scope: "row", className: "text" }, choose), ...(tasks.length > 1 ? [cell(clip(task, 24), "text")] : []),
            cell(note || app.many(budgeted.count)), cell(pick >= 0 ? app.withInterval(gain, pick) : "–"), ...(cost ? [cell(pick >= 0 ? app.withInterval(cost, pick) : "–"),
              element("td", {}, element(best && least[k] === best && wins && !note ? "strong" : "span", { textContent: value }))] : []));
        });
      });
      const chosen = title(gain);
      const headings = ["chip", ...(tasks.length > 1 ? ["task"] : []), "feasible", `pick: ${chosen}`, ...(cost ? [`pick: ${title(cost)}`, `${title(cost)} at what all reach`] : [])];
      chips.replaceChildren(element("h2", {}, "Chips ", element("small", { textContent: "under these budgets; strong: less than every other beyond both intervals" })), table(headings, lines));
    }

    function draw() {
      waiting = 0;
      const focused = root.contains(document.activeElement) ? document.activeElement.textContent : null;
      renderPrice();
      renderEquals();
      renderChips();
      root.hidden = price.hidden && equals.hidden && chips.hidden;
      if (focused !== null) [...root.querySelectorAll("button")].find((one) => one.textContent === focused)?.focus({ preventScroll: true });
    }

    function render(next) {
      shown = next;
      clearTimeout(waiting);
      if (next.moving) waiting = setTimeout(draw, SETTLED_MS);
      else draw();
    }

    return { render };
  }

  return { view, priceOf };
})();
Views.decide = Decide;
