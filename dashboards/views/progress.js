"use strict";
// How the study goes: how its front grew, and what is under way, failed or stopped early.
const Progress = (() => {
  const FAR = "\u202f"; // between a number and its unit
  const { element } = Dom;
  const { many } = Data;

  function duration(seconds) {
    if (seconds < 60) return `${Math.ceil(seconds)}${FAR}s`;
    const minutes = Math.round(seconds / 60);
    if (minutes < 60) return `${minutes}${FAR}min`;
    const hours = Math.round(seconds / 360) / 10;
    return hours < 10 ? `${hours}${FAR}h` : `${many(seconds / 3600)}${FAR}h`;
  }

  const share = (done, total) => (total === null ? many(done) : `${many(done)}/${many(total)}`);

  // What a study does as its server sees it, with the last that was heard of it in the reader's time.
  function stateOf({ trials, is_running: isRunning, sign }, now) {
    const isDone = trials.total !== null && trials.done >= trials.total && !trials.running;
    const heard = sign ? `last sign of life ${duration(Math.max(0, now - Date.parse(sign)) / 1000)} ago` : "";
    if (isRunning) return heard ? `running, ${heard}` : "running";
    const at = sign ? ` at ${new Date(sign).toLocaleString()}` : "";
    if (isDone) return `finished${at}`;
    return isRunning === false && sign ? `stopped, last sign of life${at}` : isRunning === false ? "not running" : heard;
  }

  // A study that nobody runs has begun what it has not finished.
  function summary({ trials, runs, hours, time_left_s: left }, isLive) {
    const repeated = runs.total === null ? runs.done > trials.done : runs.total > trials.total;
    return [
      `${share(trials.done, trials.total)} done`,
      repeated ? `${share(runs.done, runs.total)} runs` : "",
      trials.running ? `${many(trials.running)} ${isLive ? "running or waiting" : "begun"}` : "",
      trials.failed ? `${many(trials.failed)} failed` : "",
      trials.stopped ? `${many(trials.stopped)} stopped early` : "",
      hours ? `${duration(3600 * hours)} spent` : "",
      left === null || !isLive ? "" : `${duration(left)} left`,
    ].filter(Boolean).join(" · ");
  }

  const isLive = (page) => Details.isServed(page) && page.progress.is_running !== false;

  // How the study goes, in a line.
  function said(page) {
    const state = Details.isServed(page) ? stateOf(page.progress, Date.now()) : "";
    return [state, summary(page.progress, isLive(page))].filter(Boolean).join(" · ");
  }

  function view(root, app) {
    const { clip, number, plural } = app;
    const [figure, plot, caption, lists] = Dom.parts(root, ".growth", ".plot", ".caption span", ".lists");
    let [shown, drawn] = [null, ""];

    // The curves of the task and the chip that the page shows.
    function chosen() {
      const { figure: whole } = shown.page.progress;
      const traces = whole.data.filter(({ meta }) => app.concerns(meta));
      const several = new Set(traces.map(({ name }) => name)).size > 1;
      const data = traces.map((trace) => ({ ...trace, showlegend: several && trace.showlegend }));
      return { data, layout: { ...whole.layout, margin: { ...whole.layout.margin, t: several ? 32 : 8 } } };
    }

    function words() {
      return shown.page.progress.hypervolume.filter(app.concerns).map(({ task, hardware, hypervolume, trials, hours }) =>
        `${[task, hardware].filter(Boolean).map((text) => clip(text, 40)).join(" on ") || "all designs"}: hypervolume ` +
        `${number(hypervolume, true)} after ${plural(trials, "trial")}${hours === null ? "" : ` and ${duration(3600 * hours)}`}`);
    }

    function draw() {
      const { progress } = shown.page;
      figure.hidden = !progress.figure || chosen().data.length === 0;
      if (figure.hidden) return;
      const look = app.style();
      const key = JSON.stringify([progress.hypervolume, progress.trials.done, words(), look.dark]);
      if (key === drawn) return;
      drawn = key;
      plot.setAttribute("aria-label", `How the front grew. ${words().join("; ")}.`);
      caption.textContent = words().join("; ");
      Figure.draw(plot, chosen(), look);
    }

    // A heading with a number, its items, and how many more there are.
    const listOf = (n, words, items, rest, of = "") => (n ? [element("h2", { textContent: `${many(n)} ${words}` }),
      element("ul", {}, ...items, ...(rest > 0 ? [element("li", { textContent: `${many(rest)} more${of}` })] : []))] : []);

    // Trials that ended alike, with their reasons; a list that was opened stays so.
    function reasons(word, count, groups) {
      const item = ({ reason, count: n, trials }) => element("li", {}, element("details", {},
        element("summary", { title: reason }, element("b", { textContent: `${many(n)} × ` }), clip(reason, 120),
          element("small", { textContent: ` trial ${trials[0]}${n > 1 ? " first" : ""}` })),
        element("p", { textContent: `${n > 1 ? "trials" : "trial"} ${trials.join(", ")}${n > trials.length ? `, and ${many(n - trials.length)} more` : ""}` })));
      return listOf(count, word, groups.map(item), count - groups.reduce((sum, group) => sum + group.count, 0), " for other reasons");
    }

    const setting = (value) => (typeof value === "object" ? JSON.stringify(value) : number(value));

    function running({ trials, running: begun }) {
      const item = ({ trial, design }) => {
        const text = Object.entries(design).map(([key, value]) => `${key} ${setting(value)}`).join(", ");
        return element("li", { title: text }, element("b", { textContent: `trial ${trial} ` }), clip(text, 160));
      };
      return listOf(trials.running, isLive(shown.page) ? "running, or waiting for a worker" : "begun and not finished", begun.map(item), trials.running - begun.length);
    }

    function list(progress) {
      const open = new Set([...lists.querySelectorAll("details[open] > summary")].map((node) => node.title));
      lists.replaceChildren(
        ...reasons("failed", progress.trials.failed, progress.failed),
        ...reasons("stopped early", progress.trials.stopped, progress.stopped),
        ...running(progress),
      );
      for (const node of lists.querySelectorAll("details > summary")) node.parentElement.open = open.has(node.title);
    }

    function render(now) {
      shown = now;
      const { progress } = shown.page;
      if (!progress || shown.moving) return;
      list(progress);
      draw();
    }

    return { render };
  }

  return { view, duration, summary, stateOf, said };
})();
Views.progress = { ...Progress, whenEmpty: true, tabs: ["run"], has: (page) => Boolean(page.progress) };
