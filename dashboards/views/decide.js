"use strict";
// What helps to decide: what a cheaper design gives up, and what each chip would make of the budgets.
const Decide = (() => {
  const WINDOW = 0.05; // of accuracy, that a cheaper design may give up
  const Z = 1.645; // of a 90 % interval
  const SETTLED_MS = 150;

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

    // ---- what a cheaper design gives up

    function renderPrice() {
      const { page, columns, budgeted } = shown;
      const gain = page.budgets.maximise;
      const costs = Object.entries(page.budgets.columns).filter(([, way]) => way === "min").map(([column]) => column);
      const isShare = gain !== null && app.numbers(gain).every((value) => Number.isNaN(value) || (value >= 0 && value <= 1));
      const several = budgeted.picks.length > 1;
      const lines = !isShare ? [] : budgeted.picks.filter(({ row }) => row >= 0).flatMap(({ task, row }) => costs.flatMap((column) => {
        const points = pointsOf(budgeted, task, column);
        const pick = points.find((one) => one.row === row);
        const found = pick ? priceOf(points, pick) : null;
        if (!found) return [];
        const { other, less, se, price: each, least, most } = found;
        const unit = columns[column].unit ? `\u202f${columns[column].unit}` : "";
        const per = Number.isFinite(most) && se > 0 ? `${number(each)} (${number(least)}–${number(most)})` : `${se > 0 ? "at least " : ""}${Number.isFinite(least) ? number(least) : "–"}`;
        return [element("tr", {}, element("th", { scope: "row", className: "text", textContent: `${several ? `${clip(task, 24)}: ` : ""}${columns[column].label}` }),
          cell(`${number(other.cost)}${unit}, not ${number(pick.cost)}`, "value"), element("td", {}, choose(other.row)),
          cell(`−${number(less, true)}${se > 0 ? ` ${app.error(se)}` : ""}`), cell(`${per}${unit}`))];
      }));
      price.hidden = lines.length === 0;
      if (price.hidden) return;
      const { label } = columns[gain];
      price.replaceChildren(element("h2", {}, "Could it be cheaper? ", element("small", { textContent: `the cheapest design with at most ${WINDOW} less ${label} than the pick` })),
        table(["of", "costs", "with", label, `0.01 of ${label} costs`], lines));
    }

    function choose(row) {
      const button = element("button", { type: "button", textContent: clip(app.nameOf(row), 40) });
      button.addEventListener("click", () => app.change({ chosen: app.keyOf(row) }));
      return button;
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
        const [{ row: cheapest }] = alike;
        const unit = (column) => (columns[column].unit ? `\u202f${columns[column].unit}` : "");
        return [element("span", {}, `${lead}; least ${columns[cost].label}: `, choose(cheapest), ` ${app.withInterval(gain, cheapest)}, ${app.withInterval(cost, cheapest)}${unit(cost)}. `)];
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
      const headline = app.beside([gain])[0];
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
          const open = element("button", { type: "button", textContent: clip(name, 32), title: "show this chip" });
          open.setAttribute("aria-pressed", String(state.hardware === name));
          open.addEventListener("click", () => app.change({ hardware: name }));
          const note = budgeted.noneFits ? "none fits" : "";
          const value = least[k] && Number.isFinite(least[k].cost) ? app.withInterval(cost, least[k].row) : "–";
          return element("tr", {}, element("th", { scope: "row", className: "text" }, open), ...(tasks.length > 1 ? [cell(clip(task, 24), "text")] : []),
            cell(note || `${app.many(budgeted.count)}${pick >= 0 && budgeted.isMisfit(pick) ? ", larger chip" : ""}`), cell(pick >= 0 ? app.withInterval(headline, pick) : "–"), ...(cost ? [cell(pick >= 0 ? app.withInterval(cost, pick) : "–"),
              element("td", {}, element(best && least[k] === best && wins ? "strong" : "span", { textContent: value }))] : []));
        });
      });
      const headings = ["chip", ...(tasks.length > 1 ? ["task"] : []), "feasible", `pick: ${title(headline)}`, ...(cost ? [`pick: ${title(cost)}`, `${title(cost)} at what all reach`] : [])];
      chips.replaceChildren(element("h2", {}, "Chips ", element("small", { textContent: "under these budgets; strong: less than every other beyond both intervals" })), table(headings, lines));
    }

    function draw() {
      isStale = false;
      const focused = root.contains(document.activeElement) ? document.activeElement.textContent : null;
      renderPrice();
      renderEquals();
      renderChips();
      root.hidden = price.hidden && equals.hidden && chips.hidden;
      if (focused !== null) [...root.querySelectorAll("button")].find((one) => one.textContent === focused)?.focus({ preventScroll: true });
    }

    // While a budget moves, what nobody sees waits until it is seen.
    let [isSeen, isStale] = [true, false];
    new IntersectionObserver(([{ isIntersecting }]) => {
      isSeen = isIntersecting || root.hidden;
      if (isSeen && isStale) draw();
    }).observe(root);

    function render(next) {
      shown = next;
      clearTimeout(waiting);
      isStale = true;
      if (!next.moving) draw();
      else waiting = setTimeout(() => { if (isSeen) draw(); }, SETTLED_MS);
    }

    return { render };
  }

  return { view, priceOf };
})();
Views.decide = Decide;
