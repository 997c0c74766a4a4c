"use strict";
// Two studies side by side: whose designs are on the joint front, now and without budgets, and what each gains.
const Studies = (() => {
  const HEADINGS = {
    study: "study", task: "task", hardware: "chip", trials: "trials", points: "points", on_front: "own front", on_joint_front: "on the joint front",
    hypervolume: "hypervolume", hypervolume_joint: "joint",
  };
  const COUNTS = ["trials", "points", "on_front", "on_joint_front"];
  const { element } = Dom;

  function view(root, app) {
    const { number, many, clip } = app;
    const [studies, gains] = [element("div"), element("details")];
    root.append(studies, gains);

    const isText = (value) => typeof value === "string" && !/^[\d+−–]/.test(value); // counts are written, and stand right
    function table(label, headings, rows) {
      const classOf = (value) => (isText(value) ? "text" : "");
      const cell = (value) => element("td", { className: classOf(value), textContent: typeof value === "string" ? clip(value, 60) : number(value, true) });
      return Dom.table(label, headings.map((heading, k) => [heading, classOf(rows[0]?.[k])]), rows.map((row) => row.map(cell)));
    }

    function draw({ page, columns, state, budgeted }) {
      const isOf = ({ task, hardware }) => (!task || state.task === task) && (!hardware || state.hardware === hardware);
      const summary = page.studies.filter(isOf);
      const now = (one) => budgeted.front.filter((row) => columns.study.values[row] === one.study && (!one.task || columns.task.values[row] === one.task)).length;
      const keys = Object.keys(HEADINGS).filter((key) => summary.some((one) => one[key] !== undefined) && !(key === "hardware" && app.distinct("hardware").length < 2));
      const counted = (one, key) => (COUNTS.includes(key) ? many(one[key]) : one[key]);
      const limited = budgeted.limits.length + budgeted.conditions.length > 0;
      const rows = summary.map((one) => [...keys.map((key) => counted(one, key)), ...(limited ? [many(now(one))] : [])]);
      studies.replaceChildren(element("h2", { textContent: "Studies" }), table("Studies", [...keys.map((key) => HEADINGS[key]), ...(limited ? ["within these budgets"] : [])], rows));
      const lines = (page.gains ?? []).filter(isOf);
      gains.hidden = lines.length === 0;
      if (gains.hidden) return;
      const names = Object.keys(lines[0]).filter((key) => !["hardware", "gain", "gain_se"].includes(key));
      const signed = ({ gain, gain_se: se }) => (typeof gain !== "number" ? "–"
        : `${gain > 0 ? "+" : gain < 0 ? "−" : ""}${number(Math.abs(gain), true)}${typeof se === "number" ? ` ${app.error(se)}` : ""}`);
      gains.replaceChildren(element("summary", {}, "Best within a budget ", element("small", { textContent: "the second study less the first" })),
        table("Best within a budget", [...names, "gain"], lines.map((one) => [...names.map((key) => one[key]), signed(one)])));
    }

    return { render: Dom.settled(draw) };
  }

  return { view, tabs: ["choose"], has: (page) => (page.studies ?? []).length > 0 };
})();
Views.studies = Studies;
