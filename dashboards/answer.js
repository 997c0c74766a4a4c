"use strict";
// The answer: a sentence whose words are its controls, what can be asked of it, and the designs beside the pick.
const Answer = (() => {
  const NEXT = 3; // ways out, at most
  const SHARES = [0.9, 0.5, 0.1]; // of a cost, in the offers of less
  const { element, button } = Dom;

  // Designs with less of one cost than another has, that are no worse in the rest but for what may be given up: those that
  // give up least for a little less, for half and for a tenth. `costs` are {column: numbers to minimise}.
  function offers(rows, at, costs, improve, give) {
    const kept = Object.keys(costs).filter((column) => column !== improve && column !== give);
    const able = rows.filter((row) => kept.every((column) => !(costs[column][row] > costs[column][at])) && Number.isFinite(costs[give][row]));
    const found = SHARES.map((share) => Budgets.least(able.filter((row) => costs[improve][row] <= share * costs[improve][at]), [costs[give], costs[improve]]));
    return [...new Set(found)].filter((row) => row >= 0);
  }

  // A text to copy.
  function copier(text, name) {
    const code = element("code", { id: name, tabIndex: 0, "aria-label": name, textContent: text });
    const status = element("small", { role: "status" });
    return [code, button("copy", () => copy(code, status), { data: { copies: name } }), status];
  }

  // The designs that would tell: those that nobody measured, with less than one in one parameter, as a file for the search.
  function untried(app, { page, columns }, row, name) {
    if (row < 0 || !page.budgets.results) return [];
    const axes = Object.keys(columns).filter((column) => /^\w+(\.\w+)+$/.test(column) && columns[column].values[row] !== null && app.distinct(column).length > 1);
    const valuesOf = (one) => axes.map((column) => columns[column].values[one]);
    const measured = new Set(app.lists().rows.map((one) => JSON.stringify(valuesOf(one))));
    const less = (k) => [...new Set(columns[axes[k]].values)].filter((value) => typeof value === "number" && value < columns[axes[k]].values[row]).sort((a, b) => b - a)
      .map((value) => Object.assign(valuesOf(row), { [k]: value })).find((one) => !measured.has(JSON.stringify(one)));
    const found = axes.map((_, k) => less(k)).filter(Boolean);
    if (!found.length) return [element("p", { textContent: "Every design with less in one parameter alone was measured." })];
    const yaml = (value) => (typeof value === "string" && value.startsWith("[") ? value : JSON.stringify(value)); // a list is kept as its text
    const lines = found.map((values) => `- {${values.map((value, k) => `${axes[k]}: ${yaml(value)}`).join(", ")}}`);
    const [space, results] = [`${page.budgets.results}/search_space.yaml`, page.budgets.results.replace(/\/?[^/]*\/?$/, "") || "."].map(Budgets.quoted);
    return [element("p", { textContent: "Designs that would tell, since nobody measured them; dse enqueue trains them:" }),
      ...copier(`cat > designs.yaml <<'END'\n${lines.join("\n")}\nEND\ndse enqueue ${space} designs.yaml --results ${results}`, name)];
  }

  function panel(root, cards, app) {
    const { number, clip, sized, change, many, plural, headline, differences, costsOf } = app;
    let shown = null;
    const touch = Touch.player(app);

    // ---- words

    const percent = (value) => `${number(Number((100 * value).toPrecision(3)))}\u202f%`;
    const gained = (column, value) => (value === null ? "–" : app.isFraction(column) ? percent(value) : sized(column, value));
    const label = (column) => clip(shown.columns[column].label, 40);

    function ends(column, at) {
      const known = app.known(column, at);
      const [low, high] = [known?.low, known?.high].map((end) => (app.isFraction(column) ? number(Number((100 * Math.min(1, end)).toPrecision(2))) : number(end)));
      return known ? ` (${low}–${high})` : "";
    }
    const whole = (text) => element("span", { className: "whole", textContent: text });
    function measured(column, at) {
      const isOpen = app.isOpen(column, at);
      const value = isOpen ? app.known(column, at).low : at.value(column);
      return whole(`${isOpen ? "at least " : ""}${sized(column, value)}${shown.columns[column].unit ? "" : `\u00a0${label(column)}`}`);
    }

    // ---- the sentence

    const slot = (id, title, onchange) => Dom.choice(title, onchange, { id, className: "slot" });
    const [task, hardware, pace] = [["task", "task"], ["hardware", "chip"], ["pace", "schedule"]].map(([key, title]) => slot(key, title, (value) => change({ [key]: value })));
    const more = slot("more", "add a limit", (column) => {
      added = [...added, column];
      render(shown);
      boxes.get(column).focus();
    });
    let added = []; // limits that are written, though they may not limit anything yet
    const boxes = new Map(); // by column: a number that is typed survives new points
    function box(column) {
      const { columns, page } = shown;
      if (!boxes.has(column)) {
        const words = `${columns[column].label} ${page.budgets.columns[column] === "max" ? "at least" : "at most"}${columns[column].unit ? `, ${columns[column].unit}` : ""}`;
        const input = element("input", { type: "number", step: "any", className: "slot", id: `budget-${Object.keys(page.budgets.columns).indexOf(column)}`, placeholder: "any", "aria-label": words });
        input.oninput = () => change({ [`b.${column}`]: input.validity.badInput ? "" : input.value });
        boxes.set(column, input);
      }
      return boxes.get(column);
    }

    function fill() {
      const { state, page } = shown;
      const { tasks, hardware: chips, allowed } = app.lists();
      Dom.fill(task, tasks.map((name) => [name, clip(name, 40)]), state.task);
      Dom.fill(hardware, chips.map((name) => [name, clip(app.chipName(name), 40)]), state.hardware);
      Dom.fill(pace, allowed.pace.map((name) => [name, { flat: "as fast as it can", period: "at the sensor's pace" }[name]]), state.pace);
      const left = Object.keys(page.budgets.columns).filter((column) => !limits().includes(column));
      more.replaceChildren(element("option", { value: "", textContent: "+ limit" }), ...left.map((value) => element("option", { value, textContent: label(value) })));
      for (const [column, input] of boxes) {
        const text = state[`b.${column}`] ?? "";
        if (input.value !== text && document.activeElement !== input) input.value = text;
        input.style.width = `${Math.max(3, (text || "any").length) + 2.2}ch`;
      }
    }

    const main = () => Object.keys(shown.page.budgets.columns).find((column) => column === app.costOf());
    const limits = () => Object.keys(shown.page.budgets.columns).filter((column) => column === main() || shown.state[`b.${column}`] || added.includes(column));

    function sentence() {
      const { columns, page } = shown;
      const { tasks, hardware: chips, allowed } = app.lists();
      const family = shown.subject.value("family");
      const words = limits().map((column, k) => {
        const way = page.budgets.columns[column] === "max" ? `${label(column)} at least` : column === main() ? "within" : `${label(column)} at most`;
        return element("span", { className: "whole" }, `${k ? ", " : ""}${way} `, box(column), columns[column].unit ? `\u202f${columns[column].unit}` : "");
      });
      const named = tasks.length > 1 ? task : tasks.length && tasks[0] !== "undefined" ? clip(tasks[0], 40) : "its classes";
      return [...(chips.length > 1 ? ["On ", hardware, " "] : chips.length && chips[0] ? [`On ${clip(app.chipName(chips[0]), 40)} `] : ["Here, "]), ...words, " ",
        ...(page.budgets.columns[main()] === undefined && !more.options.length ? [] : [more]),
        ...(allowed.pace.length > 1 ? [", ", pace] : []), ", ", shown.budgeted.pick < 0 && !shown.chosen ? "no design tells "
          : `this ${family ? app.familyName(family) : "design"} tells `, named, " apart", ...result()];
    }

    function result() {
      const { budgeted, subject, page } = shown;
      if (!page.budgets.maximise) return [". No objective is maximised, so that none is the best."];
      if (budgeted.pick < 0 && !shown.chosen) return [". ", ...because()];
      const [gain, column] = [page.budgets.maximise, headline()];
      const of = column === gain ? "of the validation recordings" : "of unseen recordings";
      const shares = app.isFraction(column) ? [element("strong", { textContent: percent(subject.value(column)) }), ` ${of}`] : [element("strong",
        { textContent: `${label(column)} ${sized(column, subject.value(column))}` })];
      const latency = ["latency_ms", "decision_latency_ms"].filter((name) => shown.columns[name]).slice(0, 1);
      const known = [...new Set([app.costOf(), ...latency, ...app.costsOf().filter((name) => Object.hasOwn(page.objectives, name))])].filter((name) => name && subject.value(name) !== null);
      return subject.value(column) === null ? [": not measured here."] : [": ", ...shares, whole(ends(column, subject)), ...known.flatMap((name) => [", ", measured(name, subject)]), "."];
    }

    // Why nothing can be picked, by what the chip does with the designs.
    function because() {
      const { misfits, isUnable, noneFits, chosen } = shown.budgeted;
      if (!noneFits) return ["One of these limits must give way."];
      const chip = chosen.hardware ? app.chipName(chosen.hardware) : "the chip";
      const unable = misfits.some(isUnable);
      return [misfits.every(isUnable) ? `${chip} cannot run ${chosen.family ?? "these designs"}.`
        : `No design fits ${chip}: ${unable ? "it cannot run some, and the others are" : "all are"} too large.`];
    }

    // ---- what can be asked

    const ASKED = { take, why, cheaper };
    const [line, told] = Dom.parts(root, "#sentence", "#told");
    const asks = [...root.querySelectorAll("[data-ask]")];
    for (const one of asks) one.onclick = () => change({ ask: shown.state.ask === one.dataset.ask ? "" : one.dataset.ask });

    function take() {
      const { page, subject, chosen, columns, budgeted, state } = shown;
      const [trial, point] = ["trial", "point"].map(subject.value);
      const chip = columns.hardware ? { hardware: state.hardware } : {};
      const deploys = page.budgets.results && subject.value("transductive") !== true;
      const command = chosen && budgeted.pick !== subject.row ? app.exported(trial, point) : budgeted.command;
      return [
        ...(!deploys ? [element("p", { textContent: "A design that has seen the labels is not exported." })]
          : point === null && chosen && budgeted.pick !== subject.row ? [] : [element("p", {}, "Its network, its settings and the evidence as a folder:"), ...copier(command, "command")]),
        ...(deploys && Details.isServed(shown.page) && point !== null ? [element("a", { id: "bundle", textContent: "download it", href: Details.address("bundle.zip", { trial, point, ...chip }) })] : []),
        element("p", {}, "A link to what you see:"), ...copier(location.href, "link"),
        element("p", { id: "saves" }, "Save ", ...app.saves().flatMap(({ name, view }) => [`${name}: `, ...[...(view.image ? ["svg", "png"] : []), ...(view.listed ? ["csv"] : [])].map((format) =>
          button(format.toUpperCase(), () => app.save({ name, view }, format), { data: { saves: `${name}.${format}` } })), " "]), button("print", app.report)),
      ];
    }

    function why() {
      const { budgeted, page, subject, chosen } = shown;
      const { best, pick, alike, count, total, exact } = budgeted;
      const gain = page.budgets.maximise;
      if (pick < 0) return because().map((text) => element("p", { textContent: text }));
      const cost = app.costOf();
      const trials = new Set(alike.map((row) => app.nameOf(row))).size;
      const top = app.point(app.keyOf(best));
      const about = exact ? "" : "about ";
      return [
        `${about}${many(count)} of ${many(total)} settings of designs are within the limits, and ${many(budgeted.front.length)} of them are beaten by none in everything.`,
        best === pick ? `${app.nameOf(best)} measured the best ${label(gain)}, ${app.withInterval(gain, best)}${cost ? ", and no cheaper one comes as near as its error" : ""}.`
          : `${app.nameOf(best)} measured the best ${label(gain)}, ${app.withInterval(gain, best)}. ${plural(alike.length, "setting")} of ${plural(trials, "design")} ${alike.length === 1 ? "is" : "are"} as good within its error; ${app.nameOf(pick)} has the least ${label(cost)} of them: ${differences(app.point(app.keyOf(pick)), top).join(", ")}.`,
        ...(chosen && subject.row !== pick ? [`You chose ${subject.row >= 0 ? app.nameOf(subject.row) : "another setting"}: ${differences(subject, app.point(app.keyOf(pick))).join(", ")} beside that.`] : []),
        `This design: ${app.trusts(gain).map((name) => `${label(name)} ${app.withInterval(name, subject)}`).join(", ")}.${app.trusts(gain).length > 1 ? " The best of many is partly luck, which the corrected one leaves out." : ""}`,
      ].map((textContent) => element("p", { textContent }));
    }

    // ---- could it be cheaper: better in this, worse in that, the rest kept

    function cheaper() {
      const { page, state, subject, budgeted } = shown;
      const gain = page.budgets.maximise;
      const ways = { [gain]: "max", ...page.budgets.columns };
      const improve = costsOf().includes(state.improve) ? state.improve : app.costOf() ?? costsOf()[0];
      const give = state.give && state.give !== improve && Object.hasOwn(ways, state.give) ? state.give : gain;
      const choose = (key, title, names, value) => {
        const select = Dom.choice(title, (chosen) => change({ [key]: chosen }), { data: { key } });
        Dom.fill(select, names.map((name) => [name, label(name)]), value);
        return select;
      };
      const costs = Object.fromEntries(Object.entries(ways).map(([column, way]) => [column, way === "max" ? app.numbers(column).map((value) => -value) : app.numbers(column)]));
      const found = subject.row < 0 ? [] : offers(budgeted.among, subject.row, costs, improve, give);
      const head = element("p", {}, "Less ", choose("improve", "what must be less", costsOf(), improve), " for some ", choose("give", "what may be given up",
        Object.keys(ways).filter((name) => name !== improve), give), ", all else as good:");
      return [head, ...(found.length ? [element("div", { className: "offers" },
        ...found.map((row) => card(`÷${number(costs[improve][subject.row] / costs[improve][row])} ${label(improve)}`, app.point(app.keyOf(row)), subject)))] : [element("p", { textContent: `No measured design has less ${label(improve)} and is as good in all but ${label(give)}.` })]),
        ...untried(app, shown, found[0] ?? subject.row, "enqueue")];
    }

    // ---- cards

    function card(title, at, base, more = [], ...nodes) {
      const gain = headline();
      const cost = app.costOf();
      const name = at.row >= 0 ? app.nameOf(at.row) : "this setting";
      const values = [...(gain ? [`${gained(gain, at.value(gain))} ${app.isFraction(gain) ? "right" : label(gain)}`] : []), ...(cost && at.value(cost) !== null ? [sized(cost,
        at.value(cost))] : [])].join(" · ");
      const isBase = base === null;
      const lines = isBase ? costsOf().filter((column) => column !== cost && (Object.hasOwn(shown.page.objectives, column) || /latency/.test(column))
        && at.value(column) !== null).map((column) => `${sized(column, at.value(column))} ${label(column)}`) : differences(at, base);
      return element("article", { title: clip(name, 40), data: { key: at.key } }, element("h2", { textContent: title }), element("p", { className: "big", textContent: values }),
        element("ul", {}, ...[...lines, ...more].map((textContent) => element("li", { textContent }))),
        ...(isBase ? [] : [button("choose it", () => change({ chosen: shown.chosen?.key === at.key ? "" : at.key }), { "aria-label": `choose it: ${clip(name, 40)}` })]), ...nodes);
    }

    function renderCards() {
      const { budgeted, subject } = shown;
      const at = (row) => app.point(app.keyOf(row));
      if (budgeted.pick < 0 && !shown.chosen) {
        const missed = ({ row, missed: all }, title, ...nodes) => card(title, at(row), null, all.map(({ column, by }) => `misses ${label(column)} by ${sized(column, by)}`), ...nodes);
        const relaxed = budgeted.relaxed.map((one) => {
          const value = shown.columns[one.column].values[one.row];
          return missed(one, `${label(one.column)} ${shown.page.budgets.columns[one.column] === "max" ? "down" : "up"} to ${sized(one.column, value)}`,
            button("relax it", () => change({ [`b.${one.column}`]: String(value) })));
        });
        return cards.replaceChildren(...[...relaxed, ...budgeted.nearest.filter(({ row }) => !budgeted.relaxed.some((one) => one.row === row)).map((one) => missed(one, "the nearest"))].slice(0, NEXT));
      }
      if (!subject.key) return cards.replaceChildren();
      const { best, pick, half } = budgeted;
      const cost = app.costOf();
      const isPick = subject.row === pick;
      // As good within its error, and cheaper: what the pick already is.
      const gain = shown.page.budgets.maximise;
      const good = !isPick && cost && pick >= 0 && app.numbers(gain)[pick] >= subject.value(gain) - (app.known(gain, subject)?.below ?? 0)
        && app.numbers(cost)[pick] < subject.value(cost);
      const other = good ? card("as good, cheaper", at(pick), subject) : isPick && best !== pick ? card("the most accurate", at(best), subject)
        : !isPick && pick >= 0 ? card("the pick", at(pick), subject) : null;
      const halved = isPick ? half : least(subject.value(cost) / 2);
      const first = card(isPick ? "your pick" : "your choice", subject, null, [], ...[touch(shown)].filter(Boolean));
      cards.replaceChildren(...[first, other, halved >= 0 && cost ? card(`half the ${label(cost)}`, at(halved), subject) : null].filter(Boolean));
    }
    const least = (most) => Budgets.least(shown.budgeted.among.filter((row) => app.numbers(app.costOf())[row] <= most), [app.numbers(shown.page.budgets.maximise).map((value) => -value)]);

    // ---- the view

    const named = (node) => node.id || node.dataset.key || node.dataset.copies || node.textContent;
    let said = "";
    function render(next) {
      shown = next;
      fill();
      const key = JSON.stringify([limits(), app.lists().tasks, app.lists().hardware, next.state, next.subject.key, next.budgeted.key]);
      if (key !== said) Dom.keepFocus(line, named, () => line.replaceChildren(...sentence()));
      said = key;
      fill();
      for (const ask of asks) ask.setAttribute("aria-expanded", String(ask.dataset.ask === next.state.ask));
      const asked = app.style().paper ? "why" : next.state.ask; // a report has the reasons
      told.hidden = !Object.hasOwn(ASKED, asked);
      for (const ask of asks) ask.hidden = ask.dataset.ask !== "why" && !next.subject.key;
      if (!told.hidden && !next.moving) Dom.keepFocus(told, named, () => told.replaceChildren(...ASKED[asked]()));
      Dom.keepFocus(cards, named, renderCards);
    }

    return render;
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

  return { panel, offers, untried };
})();
