"use strict";
// Two studies side by side: whose designs are on the joint front, now and without budgets, and what each gains.
const Studies = (() => {
  const SETTLED_MS = 150;
  const HEADINGS = {
    study: "study", task: "task", hardware: "chip", trials: "trials", points: "points", on_front: "own front", on_joint_front: "on the joint front",
    hypervolume: "hypervolume", hypervolume_joint: "joint",
  };

  function view(root, app) {
    const { element, number, many, clip } = app;
    const [studies, gains] = [element("div"), element("details")];
    root.append(studies, gains);

    const isText = (value) => typeof value === "string" && !/^[\d+−–]/.test(value); // counts are written, and stand right
    function table(label, headings, rows) {
      const cell = (value) => element("td", { className: isText(value) ? "text" : "", textContent: typeof value === "string" ? clip(value, 60) : number(value, true) });
      const head = element("tr", {}, ...headings.map((textContent, k) => element("th", { scope: "col", className: isText(rows[0]?.[k]) ? "text" : "", textContent })));
      const scroll = element("div", { className: "scroll", tabIndex: 0 }, element("table", {}, element("thead", {}, head),
        element("tbody", {}, ...rows.map((row) => element("tr", {}, ...row.map(cell))))));
      scroll.setAttribute("role", "group");
      scroll.setAttribute("aria-label", label);
      return scroll;
    }

    function draw({ page, columns, state, budgeted }) {
      const isOf = ({ task, hardware }) => (!task || state.task === "all" || state.task === task) && (!hardware || state.hardware === hardware);
      const summary = page.studies.filter(isOf);
      const now = (one) => budgeted.front.filter((row) => columns.study.values[row] === one.study && (!one.task || columns.task.values[row] === one.task)).length;
      const keys = Object.keys(HEADINGS).filter((key) => summary.some((one) => one[key] !== undefined) && !(key === "hardware" && app.distinct("hardware").length < 2));
      const counted = (one, key) => (["trials", "points", "on_front", "on_joint_front"].includes(key) ? many(one[key]) : one[key]);
      const limited = budgeted.limits.length + budgeted.conditions.length > 0;
      const rows = summary.map((one) => [...keys.map((key) => counted(one, key)), ...(limited ? [many(now(one))] : [])]);
      studies.replaceChildren(element("h2", { textContent: "Studies" }), table("Studies", [...keys.map((key) => HEADINGS[key]), ...(limited ? ["within these budgets"] : [])], rows));
      const lines = (page.gains ?? []).filter(isOf);
      gains.hidden = lines.length === 0;
      if (gains.hidden) return;
      const [errors, shown] = [lines.some((one) => typeof one.gain_se === "number"), Object.keys(lines[0]).filter((key) => !["hardware", "gain", "gain_se"].includes(key))];
      const beyond = (one) => (errors && typeof one.gain_se === "number" ? ` ${app.error(one.gain_se)}` : "");
      const signed = (one) => (typeof one.gain === "number" ? `${one.gain > 0 ? "+" : one.gain < 0 ? "−" : ""}${number(Math.abs(one.gain), true)}${beyond(one)}` : "–");
      gains.replaceChildren(element("summary", {}, "Best within a budget ", element("small", { textContent: "the second study less the first" })),
        table("Best within a budget", [...shown, "gain"], lines.map((one) => [...shown.map((key) => one[key]), signed(one)])));
    }

    let waiting = 0;
    function render(shown) {
      root.hidden = !shown.page.studies?.length;
      clearTimeout(waiting);
      if (root.hidden) return;
      if (shown.moving) waiting = setTimeout(() => draw(shown), SETTLED_MS);
      else draw(shown);
    }

    return { render };
  }

  return { view };
})();
Views.studies = Studies;
