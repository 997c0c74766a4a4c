"use strict";
// What helps to decide: what a cheaper design gives up, and what each chip would make of the budgets.
const Decide = (() => {
  const WINDOW = 0.05; // of accuracy, that a cheaper design may give up
  const Z = 1.645; // of a 90 % interval
  const { element, button, table, rowHead } = Dom;

  // A pick against the cheapest of some designs {gain, cost, se}, by rising cost, that gains at most WINDOW less: the
  // cost of 0.01 of the gain between these two, over the 90 % interval of their difference. Without an upper end where
  // they cannot be told apart. No design is chosen anew within the interval: noise would always find a cheaper one.
  function priceOf(points, pick) {
    const other = points.find(({ gain }) => gain >= pick.gain - WINDOW - 1e-9);
    if (!other || other.cost >= pick.cost) return null;
    const [less, se] = [pick.gain - other.gain, Math.hypot(pick.se, other.se)];
    const per = (gain) => (gain > 0 ? (pick.cost - other.cost) / (100 * gain) : Infinity);
    return { other, less, se, price: per(less), least: per(less + Z * se), most: per(less - Z * se) };
  }

  function view(root, app) {
    const { number, clip, title } = app;
    const [price, equals, chips] = [element("div", { className: "price" }), element("p", { className: "equals" }), element("div", { className: "chips" })];
    root.append(price, equals, chips);
    let shown = null;
    let [engine, engineOf] = [null, null];

    const unitOf = (column) => (shown.columns[column].unit ? `\u202f${shown.columns[column].unit}` : "");
    const ofTask = (task) => (task ? `${clip(task, 24)}: ` : "");
    const chooser = (row) => button(clip(app.nameOf(row), 40), () => app.change({ chosen: app.keyOf(row) }));
    const costOf = (page) => ["energy_uj", page.period?.instead].find((name) => Object.hasOwn(page.objectives, name)) ?? Object.keys(page.objectives).find((name) => page.objectives[name] === "min");

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

    // Each pick with the points by one cost, its own among them.
    const picksBy = (column) => shown.budgeted.picks.filter(({ row }) => row >= 0).flatMap(({ task, row }) => {
      const points = pointsOf(shown.budgeted, task, column);
      const pick = points.find((one) => one.row === row);
      return pick ? [{ task, points, pick }] : [];
    });

    // ---- what a cheaper design gives up

    function renderPrice() {
      const { page, columns, budgeted } = shown;
      const gain = page.budgets.maximise;
      const costs = Object.entries(page.budgets.columns).filter(([, way]) => way === "min").map(([column]) => column);
      const isShare = gain !== null && app.numbers(gain).every((value) => Number.isNaN(value) || (value >= 0 && value <= 1));
      const several = budgeted.picks.length > 1;
      const byTask = (one, other) => budgeted.picks.findIndex(({ task }) => task === one.task) - budgeted.picks.findIndex(({ task }) => task === other.task);
      const priced = !isShare ? [] : costs.flatMap((column) => picksBy(column).map(({ task, points, pick }) => ({ column, task, pick, found: priceOf(points, pick) })));
      const lines = priced.filter(({ found }) => found).sort(byTask).map(({ column, task, pick, found: { other, less, se, price: each, least, most } }) => {
        const unit = unitOf(column);
        const per = Number.isFinite(most) && se > 0 ? `${number(each)} (${number(least)}–${number(most)})` : `${se > 0 ? "at least " : ""}${Number.isFinite(least) ? number(least) : "–"}`;
        return [rowHead(`${several ? ofTask(task) : ""}${columns[column].label}`), `${number(other.cost)}${unit}, not ${number(pick.cost)}`,
          chooser(other.row), `−${number(less, true)}${se > 0 ? ` ${app.error(se)}` : ""}`, `${per}${unit}`];
      });
      price.hidden = lines.length === 0;
      if (price.hidden) return;
      const { label } = columns[gain];
      price.replaceChildren(element("h2", {}, "Could it be cheaper? ", element("small", { textContent: `the cheapest design with at most ${WINDOW} less ${label} than the pick` })),
        table("of", [["of", "text"], ["costs", "value"], ["with"], [label], [`0.01 of ${label} costs`]], lines));
    }

    // ---- what is as good as the pick

    // How sure the ranking is: designs whose gain is within one standard error of the difference, and the cheapest.
    function renderEquals() {
      const { page, columns } = shown;
      const [gain, cost] = [page.budgets.maximise, costOf(page)];
      const lines = !gain || !cost || !columns.trial ? [] : picksBy(cost).filter(({ pick }) => pick.se).map(({ task, points, pick }) => {
        const alike = points.filter((one) => one.trial !== pick.trial && pick.gain - one.gain <= Math.hypot(pick.se, one.se));
        const lead = `${ofTask(task)}${app.plural(new Set(alike.map(({ trial }) => trial)).size, "other design")} as good as the pick within its error`;
        if (!alike.length) return element("span", { textContent: `${lead}.` });
        const [{ row: cheapest }] = alike;
        return element("span", {}, `${lead}; least ${columns[cost].label}: `, chooser(cheapest), ` ${app.withInterval(gain, cheapest)}, ${app.withInterval(cost, cheapest)}${unitOf(cost)}. `);
      });
      equals.hidden = lines.length === 0;
      equals.replaceChildren(...lines);
    }

    // ---- chips

    function renderChips() {
      const { page, columns, state } = shown;
      const names = app.distinct("hardware");
      chips.hidden = names.length < 2 || !page.budgets.maximise;
      if (chips.hidden) return;
      if (engineOf !== page) [engine, engineOf] = [Budgets.over(page), page];
      const [gain, cost] = [page.budgets.maximise, costOf(page)];
      const headline = app.beside([gain])[0];
      const found = names.map((name) => ({ name, budgeted: engine.evaluate({ ...state, hardware: name }) }));
      const tasks = found[0].budgeted.chosen.task === null && columns.task ? app.distinct("task") : [""];
      const lines = tasks.flatMap((task) => {
        const there = found.map(({ name, budgeted }) => {
          const pick = task ? budgeted.picks.find((one) => one.task === task)?.row ?? -1 : budgeted.pick;
          return { name, budgeted, pick, points: pick >= 0 && cost ? pointsOf(budgeted, task, cost) : [] };
        });
        const level = Math.min(...there.filter(({ pick }) => pick >= 0).map(({ pick }) => columns[gain].values[pick]));
        const least = there.map(({ points }) => points.find((one) => one.gain >= level) ?? null);
        const known = least.filter((one) => one && Number.isFinite(one.cost));
        const best = known.length > 1 ? known.reduce((a, b) => (b.cost < a.cost ? b : a)) : null;
        const ends = page.intervals[cost];
        const top = (one) => one.cost + (ends?.high[one.row] ?? 0);
        const bottom = (one) => one.cost - (ends?.low[one.row] ?? 0);
        const wins = best && known.every((one) => one === best || bottom(one) > top(best));
        return there.map(({ name, budgeted, pick }, k) => {
          const open = button(clip(name, 32), () => app.change({ hardware: name }), { title: "show this chip", "aria-pressed": state.hardware === name });
          const count = budgeted.noneFits ? "none fits" : `${app.many(budgeted.count)}${pick >= 0 && budgeted.isMisfit(pick) ? ", larger chip" : ""}`;
          const textContent = least[k] && Number.isFinite(least[k].cost) ? app.withInterval(cost, least[k].row) : "–";
          const ofPick = (column) => (pick >= 0 ? app.withInterval(column, pick) : "–");
          return [rowHead(open), ...(tasks.length > 1 ? [clip(task, 24)] : []), count, ofPick(headline),
            ...(cost ? [ofPick(cost), element(best && least[k] === best && wins ? "strong" : "span", { textContent })] : [])];
        });
      });
      const columnsOf = [["chip", "text"], ...(tasks.length > 1 ? [["task", "text"]] : []), ["feasible"], [`pick: ${title(headline)}`], ...(cost ? [[`pick: ${title(cost)}`], [`${title(cost)} at what all reach`]] : [])];
      chips.replaceChildren(element("h2", {}, "Chips ", element("small", { textContent: "under these budgets; strong: less than every other beyond both intervals" })), table("chip", columnsOf, lines));
    }

    function draw() {
      isStale = false;
      Dom.keepFocus(root, ({ textContent }) => textContent, () => {
        renderPrice();
        renderEquals();
        renderChips();
        root.hidden = price.hidden && equals.hidden && chips.hidden;
      });
    }

    // While a budget moves, what nobody sees waits until it is seen.
    let [isSeen, isStale] = [true, false];
    new IntersectionObserver(([{ isIntersecting }]) => {
      isSeen = isIntersecting || root.hidden;
      if (isSeen && isStale) draw();
    }).observe(root);
    const soon = Dom.settled(({ moving }) => { if (!moving || isSeen) draw(); });

    function render(next) {
      shown = next;
      isStale = true;
      soon(next);
    }

    return { render };
  }

  return { view, priceOf };
})();
Views.decide = Decide;
