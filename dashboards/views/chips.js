"use strict";
// What each chip would make of the limits: its pick, and what it takes for an accuracy that all reach.
Views.chips = (() => {
  const { element, button, rowHead } = Dom;

  function view(root, app) {
    const { clip, title } = app;
    const engineOf = Data.remembering(Budgets.over);

    function draw({ page, columns, state }) {
      const [gain, cost] = [page.budgets.maximise, app.costOf()];
      if (!gain) return root.replaceChildren(element("p", { textContent: "No objective is maximised, so that no chip has a pick." }));
      const headline = app.headline();
      const found = app.lists().hardware.map((name) => ({ name, budgeted: engineOf(page).evaluate({ ...state, hardware: name }) }));
      const level = Math.min(...found.filter(({ budgeted }) => budgeted.pick >= 0).map(({ budgeted }) => columns[gain].values[budgeted.best]));
      const least = found.map(({ budgeted }) => (cost ? Budgets.least(budgeted.among.filter((row) => columns[gain].values[row] >= level), [app.numbers(cost)]) : -1));
      const lines = found.map(({ name, budgeted }, k) => {
        const open = button(clip(app.chipName(name), 32), () => app.change({ hardware: name }), { title: "show this chip", "aria-pressed": state.hardware === name });
        const misfits = budgeted.misfits.length ? `${app.plural(budgeted.misfits.length, "setting")} ${budgeted.isUnable(budgeted.misfits[0]) ? "cannot run there" : "too large"}` : "";
        const ofPick = (column) => (column && budgeted.pick >= 0 ? app.withInterval(column, budgeted.pick) : "–");
        return [rowHead(open), budgeted.pick >= 0 ? app.nameOf(budgeted.pick) : budgeted.noneFits ? "none fits" : "none", ofPick(headline),
          ...(cost ? [ofPick(cost), least[k] >= 0 ? app.withInterval(cost, least[k]) : "–"] : []), misfits];
      });
      const heads = [["chip", "text"], ["pick", "text"], [title(headline)], ...(cost ? [[title(cost)], [`${title(cost)} for ${app.number(level, true)} as measured`]] : []), ["left out", "text"]];
      Dom.keepFocus(root, ({ textContent }) => textContent, () => root.replaceChildren(element("h2", {}, "Chips ", element("small",
        { textContent: "under these limits; the same networks at other prices" })), Dom.table("chip", heads, lines)));
    }

    return { render: Dom.settled(draw) };
  }

  return { view, tabs: ["chips"], has: (page) => new Set(page.columns.hardware?.values).size > 1 };
})();
