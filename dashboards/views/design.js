"use strict";
// Inside one design: what it is, what was measured, and what its runs recorded. Moving φ and θ chooses another
// point of the same trial; its numbers come from the trial's decision surface, so that no server is asked.
const Design = (() => {
  const TABS = {
    confusion: "confusion", surface: "φ/θ", raster: "raster", recognition: "over time", first_spike: "first spike",
    histograms: "prototypes", energy: "energy", power: "power", cores: "cores", learning: "learning", bits: "bits",
  };
  const EXPERT = ["surface", "bits", "histograms", "cores"]; // tabs that a first look does not need
  const { element, svg } = Dom;

  // ---- pure: a trial's document in, numbers and words out

  const entryOf = (object, name) => (object && Object.hasOwn(object, name) ? object[name] : undefined);

  // What output spikes answer under a setting, the rule of dse.decision: the first step with more than phi spikes, a
  // share theta or more of them of one class. Undecided: the leading class at the last step. Ties: the lowest class.
  function decide(spikes, nSteps, nClasses, phi, theta) {
    const counts = new Array(nClasses).fill(0);
    let [read, most, leading] = [0, 0, 0];
    for (let step = 0; step < nSteps; step += 1) {
      const before = read;
      while (read < spikes.length && spikes[read][0] <= step) {
        counts[spikes[read][1]] += 1;
        read += 1;
      }
      if (read === before) continue;
      most = Math.max(...counts);
      leading = counts.indexOf(most);
      if (read > phi && most / read >= theta) return { label: leading, step, decided: true };
    }
    return { label: leading, step: nSteps - 1, decided: false };
  }

  // Where a point lies on a surface, as i * len(theta) + j; -1 where it does not.
  function placeOn(surface, point) {
    const place = point === null ? -1 : point - surface.first_point;
    return place >= 0 && place < surface.phi.length * surface.theta.length ? place : -1;
  }

  const partOf = (details, task) => entryOf(details.tasks, String(task)) ?? Object.values(details.tasks)[0] ?? {};

  // A file may carry the surface of the weights as trained alone.
  const isOf = (surface, precision) => ["weight_bits", "pruned_after"].every((name) => (surface[name] ?? null) === precision(name));

  // The surface that a point is on, or else that of its precision, or else the first: of the weights as trained.
  function surfaceOf(part, point, precision, hardware) {
    const all = (part.surfaces ?? []).filter((one) => columnsOn(one, hardware));
    return all.find((one) => placeOn(one, point) >= 0)
      ?? all.find((one) => isOf(one, precision)) ?? all[0] ?? null;
  }

  const columnsOn = (surface, hardware) => entryOf(surface.hardware, hardware) ?? entryOf(surface.hardware, "") ?? null;

  // A point's trial and number, where it is named by them.
  function named({ columns }, key) {
    return columns.trial && columns.point ? key.split(".").map(Number) : [null, null];
  }

  // The numbers of a point of a surface on the hardware shown, with what its design has on the page; null if there is none.
  function valuesOf(shown, details, key) {
    const [trial, point] = named(shown, key);
    const { columns, page, state } = shown;
    for (const [task, part] of Object.entries(details.tasks)) {
      const surface = (part.surfaces ?? []).find((one) => placeOn(one, point) >= 0);
      const known = surface && columnsOn(surface, state.hardware);
      if (!known) continue;
      const place = placeOn(surface, point);
      const sibling = columns.trial.values.findIndex((other, row) => other === trial && (!columns.task || String(columns.task.values[row]) === task));
      return {
        ...Object.fromEntries(sibling < 0 ? [] : page.design.map((column) => [column, columns[column].values[sibling]])),
        read_out_ms: null, weight_bits: surface.weight_bits ?? null, pruned_after: surface.pruned_after ?? null,
        ...Object.fromEntries(Object.entries(known).map(([column, values]) => [column, values[place]])),
        trial, point, task, hardware: state.hardware,
        phi: surface.phi[Math.floor(place / surface.theta.length)], theta: surface.theta[place % surface.theta.length],
      };
    }
    return null;
  }

  // The figure of one tab of a design, on the hardware shown; undefined where the study recorded none. That of its own
  // precision, or else that of the network as trained: `isOwn` tells which.
  function figureOf(part, tab, hardware, pace = "flat", precision = () => null) {
    const on = (figures) => {
      const figure = (tab === "energy" && pace === "period" ? entryOf(figures, "energy_at_period") : undefined) ?? entryOf(figures, tab);
      return tab === "energy" || tab === "cores" ? entryOf(figure, hardware) : figure;
    };
    return on(ownPrecision(part, precision)?.figures) ?? on(part.figures);
  }
  const ownPrecision = (part, precision) => (part.precisions ?? []).find((one) => isOf(one, precision));

  function tabsOf(part, hardware, order) {
    const has = { surface: () => (part.surfaces ?? []).some((one) => columnsOn(one, hardware)), raster: () => (part.examples ?? []).length > 0 };
    return (order ?? Object.keys(TABS)).filter((tab) => Object.hasOwn(TABS, tab) && (has[tab]?.() ?? figureOf(part, tab, hardware) !== undefined));
  }

  // ---- the panel

  function view(root, app) {
    const { clip, number, change } = app;
    const [heading, body, strip, owner, pane] = Dom.parts(root, "h2", ".body", ".tabs", ".owner", ".pane");
    const [notes, standing, misfit] = Dom.parts(root, ".notes", ".standing", ".misfit");
    const [objectives, parameters, others] = root.querySelectorAll("dl");
    const tabs = Dom.strip(strip, TABS, (tab) => change({ tab }), (tab) => ({ id: `tab-${tab}`, "aria-controls": "design-pane" }));

    let shown = null;
    let loaded = { trial: null, page: null, details: undefined, text: "" }; // details: undefined while they are awaited
    let drawn = null; // what is in the pane: {key, draw(), move()}

    // ---- the head

    function list(node, columns) {
      node.hidden = columns.length === 0;
      node.replaceChildren(...columns.flatMap((column) => [
        element("dt", { textContent: shown.columns[column].label, title: column }),
        element("dd", { textContent: `${clip(app.withInterval(column, shown.chosen), 120)}\u00a0${shown.columns[column].unit}`.trim(), title: String(shown.chosen.value(column)) }),
      ]));
    }

    // A point that is no row of the page is on no front: those are carried whole.
    function standingOf({ chosen, budgeted, onFront, within }) {
      const isLarge = chosen.value("fits") === false;
      const isHere = chosen.row >= 0;
      const reason = isHere ? shown.leftOut(chosen.row) : isLarge && !budgeted.chosen.oversize ? `does not fit ${chosen.value("hardware")}` : "";
      if (reason) return reason;
      const meets = ({ column, way, limit }) => (way === "max" ? chosen.value(column) >= limit : chosen.value(column) <= limit);
      if (!(isHere ? within(chosen.row) : budgeted.limits.every(meets))) return "outside the limits";
      return isHere && onFront.has(chosen.row) ? `on the front${isLarge ? " of a larger chip" : ""}` : "another is better in everything";
    }

    function renderHead() {
      const { chosen, columns, page, state, objectives: aims } = shown;
      const has = (column) => chosen.value(column) !== null;
      const trial = chosen.value("trial") ?? named(shown, chosen.key)[0];
      heading.textContent = clip(trial === null ? `Point ${chosen.key}` : app.trialName(trial), 60);
      const where = ["task", "hardware"].filter(has).map((column) => ` · ${clip(String(chosen.value(column)), 40)}`);
      standing.replaceChildren(element("strong", { textContent: standingOf(shown) }), ...where);
      const measured = app.beside([...aims, ...Object.keys(page.budgets.columns)]);
      list(objectives, measured.filter(has));
      const inHead = ["trial", "task", "hardware"];
      list(parameters, page.design.filter((column) => !inHead.includes(column) && has(column)));
      list(others, Object.keys(columns).filter((column) => ![...measured, ...page.design, ...inHead].includes(column) && has(column)));
    }

    // ---- its document

    function load() {
      const { page, columns, chosen } = shown;
      const trial = named(shown, chosen.key)[0] ?? (columns.trial ? chosen.value("trial") : null);
      if (trial !== loaded.trial) loaded = { trial, page: null, details: trial === null ? null : undefined, text: "" };
      if (trial === null || (loaded.page === page && loaded.details?.tasks)) return;
      const entry = loaded = { ...loaded, page };
      Details.of(page, trial).then((details) => {
        if (entry !== loaded) return; // another design was chosen meanwhile
        // What a running study says again is not drawn again.
        const text = JSON.stringify(details);
        if (entry.details === undefined || text !== entry.text) Object.assign(loaded, { details, text });
        renderParts();
      });
    }

    // ---- tabs

    function showText(text) {
      drawn = null;
      owner.textContent = "";
      Figure.replace(pane, element("p", { className: "quiet", textContent: text }));
    }

    function renderParts() {
      const { page, state, chosen } = shown;
      const { details } = loaded;
      const part = details?.tasks ? partOf(details, chosen.value("task")) : {};
      misfit.replaceChildren();
      const names = details?.tasks ? tabsOf(part, state.hardware, page.definition?.design).filter((name) => state.expert === "1" || state.tab === name || !EXPERT.includes(name)) : [];
      const open = names.includes(state.tab) ? state.tab : names[0];
      strip.hidden = names.length === 0;
      tabs.render(names, open);
      if (open) pane.setAttribute("aria-labelledby", `tab-${open}`);
      else pane.removeAttribute("aria-labelledby");
      notes.replaceChildren(...(details?.notes ?? []).map((text) => element("p", { textContent: text })));
      pane.setAttribute("aria-busy", String(details === undefined));
      if (details === undefined) return showText("…");
      if (!details?.tasks) return showText(details?.why ?? absent(page));
      if (!open) return showText("Its runs recorded nothing to draw.");
      const surface = surfaceOf(part, named(shown, chosen.key)[1], chosen.value, state.hardware);
      const misfits = entryOf(part.misfits, state.hardware) ?? [];
      misfit.replaceChildren(...misfits.map((text) => element("p", { className: "note", textContent: `Does not fit: ${text}.` })));
      owner.textContent = ownerOf(part, surface, open);
      const key = JSON.stringify([open, chosen.value("task"), state.hardware, open === "energy" && state.pace, surface?.first_point, owner.textContent, app.style().dark, app.style().paper]);
      if (drawn?.key === key && drawn.details === details) {
        drawn.move();
        return;
      }
      const selected = new Map([...pane.querySelectorAll("select")].map((select) => [select.dataset.name, select.value]));
      const built = { surface: surfacePane, raster: rasterPane }[open] ?? figurePane;
      drawn = { key, details, ...built(part, surface, open) };
      Dom.keepFocus(pane, ({ dataset }) => dataset.name, () => Figure.replace(pane, ...drawn.nodes));
      for (const select of pane.querySelectorAll("select")) for (const option of select.options) option.selected ||= option.value === selected.get(select.dataset.name);
      drawn.move();
      drawn.draw();
    }

    // Which network a tab is of, where the design is another than the one that was trained.
    function ownerOf(part, surface, tab) {
      const trained = part.surfaces?.[0];
      const { value } = shown.chosen;
      if (!trained || isOf(trained, value) || tab === "bits") return "";
      const isOwn = tab === "surface" ? isOf(surface, value) : ownPrecision(part, value)?.figures[tab] !== undefined;
      return isOwn ? `This design: ${inBits(value)}` : `The parent network, as trained: ${inBits((name) => trained[name])}`;
    }
    const inBits = (value) => `${number(value("weight_bits"))} bits per weight${value("pruned_after") ? `, ${number(100 * value("pruned_after"))}\u00a0% of them removed` : ""}`;

    function absent(page) {
      if (!page.budgets.results) return "This page has no details of designs.";
      const n = Object.keys(page.details ?? {}).length;
      return `This file carries ${n ? `the details of ${app.plural(n, "design")}` : "no details of designs"}; dse dashboard ${Budgets.quoted(page.budgets.results)} shows all.`;
    }

    // ---- figures

    function figurePane(part, surface, tab) {
      const figure = figureOf(part, tab, shown.state.hardware, shown.state.pace, shown.chosen.value);
      const { words = "", note = "" } = figure.layout.meta ?? {};
      const node = Figure.node(tab, Figure.heightOf(figure), words);
      return {
        nodes: [node, element("p", { className: "quiet", textContent: note })],
        draw: () => Figure.draw(node, figure, app.style(), Figure.fitted), move() {},
      };
    }

    // ---- φ and θ

    // Two sliders that move a setting over a surface. `place` is the setting chosen, -1 for an answer without one.
    function settings(surface, known, follow) {
      const { theta, best } = surface;
      let place = -1;
      const sliders = ["phi", "theta"].map((name) => {
        const [symbol, words] = name === "phi" ? ["φ", "φ: spikes before any decision"] : ["θ", "θ: share of spikes that decides"];
        const slider = element("input", {
          type: "range", min: 0, max: surface[name].length - 1, step: 1, disabled: surface[name].length < 2, "aria-label": words, data: { name },
          oninput: () => aim(Number(sliders[0].slider.value) * theta.length + Number(sliders[1].slider.value), true), onchange: () => aim(place, false),
        });
        const out = element("output");
        return { name, slider, out, node: element("label", { title: words }, element("span", { textContent: symbol }), slider, out) };
      });
      const summary = element("p", { className: "summary", role: "status" });

      function show() {
        const at = place < 0 ? best : place;
        const index = { phi: Math.floor(at / theta.length), theta: at % theta.length };
        for (const { name, slider, out } of sliders) {
          const value = number(surface[name][index[name]]);
          if (Number(slider.value) !== index[name]) slider.value = index[name];
          out.textContent = value;
          slider.setAttribute("aria-valuetext", name === "phi" ? `${value} spikes` : value);
        }
        summary.textContent = place < 0 ? unset(shown.chosen.value) : summed(place);
        follow(place);
      }

      function unset(value) {
        if (!isOf(surface, value)) return `This surface is of the weights as trained, at ${number(surface.weight_bits)} bits; φ and θ choose among its points.`;
        const after = value("read_out_ms");
        return `This design answers ${after === null ? "at the end of the recording" : `after ${number(after)}\u00a0ms`}. Move φ or θ to let it decide; they start at the best setting.`;
      }

      function summed(at) {
        const phrase = (column, value) => (column === "undecided" ? `${number(100 * value)}\u00a0% undecided`
          : `${words(column)} ${number(value, column === "accuracy")}\u00a0${unit(column)}`.trim());
        return ["accuracy", "decision_latency_ms", "energy_uj", "undecided"].filter((column) => typeof known[column]?.[at] === "number").map((column) => phrase(column, known[column][at])).join(" · ");
      }

      function aim(at, moving) {
        place = at;
        show();
        const key = `${loaded.trial}.${surface.first_point + place}`;
        if (app.rowOf(key) < 0) app.setPoint(key, valuesOf(shown, loaded.details, key));
        change({ chosen: key }, moving);
      }

      return {
        nodes: [element("div", { className: "setting" }, ...sliders.map(({ node }) => node)), summary], aim,
        move() {
          place = placeOn(surface, named(shown, shown.chosen.key)[1]);
          show();
        },
      };
    }

    const words = (column) => (shown.columns[column]?.label ?? column.replace(/_ms$/, "").replace(/_/g, " "));
    const unit = (column) => shown.columns[column]?.unit ?? (column.endsWith("_ms") ? "ms" : "");

    // One number of every setting as a map; the setting that is chosen is ringed, the best is crossed.
    function surfacePane(part, surface) {
      const known = columnsOn(surface, shown.state.hardware);
      const { phi, theta } = surface;
      const offered = Object.keys(known).filter((column) => !/_(se|low|high)$/.test(column) && new Set(known[column]).size > 1);
      const select = Dom.choice("What the map shows", draw, { data: { name: "quantity" } });
      Dom.fill(select, (offered.length ? offered : ["accuracy"]).map((column) => [column, clip(titled(column), 40)]));
      const [wide, high] = [Math.max(8, Math.min(40, 560 / theta.length)), Math.max(8, Math.min(28, 320 / phi.length))];
      const [left, top] = [56, 8];
      const size = [left + theta.length * wide + 8, top + phi.length * high + 40];
      const spot = (place) => [left + (place % theta.length) * wide, top + (phi.length - 1 - Math.floor(place / theta.length)) * high];
      const node = element("div", { role: "img", className: "map", data: { figure: "surface" } });
      const caption = element("p", { className: "quiet" });
      let at = -1;
      const sliders = settings(surface, known, (place) => {
        at = place;
        draw();
      });
      const setting = (place) => `φ ${number(phi[Math.floor(place / theta.length)])}, θ ${number(theta[place % theta.length])}`;
      const phrase = (place) => `${setting(place)}: ${[...new Set(["accuracy", select.value])].map((column) => `${words(column)} ${number(known[column][place])} ${unit(column)}`.trim()).join(", ")}`;

      function draw() {
        const values = known[select.value];
        const [low, most] = Data.ends(values.filter(Number.isFinite));
        const cells = values.map((value, place) => {
          const [x, y] = spot(place);
          const choose = () => { if (isMovable()) sliders.aim(place, false); };
          return svg("rect", { x, y, width: wide - 1, height: high - 1, fill: Figure.shade(low === most ? 0.5 : (value - low) / (most - low)), on: { click: choose } },
            svg("title", { text: phrase(place) }));
        });
        const label = (text, x, y, anchor = "middle") => svg("text", { x, y, "text-anchor": anchor, fill: "currentColor", text });
        const each = (some, room) => some.map((value, k) => [value, k]).filter(([, k]) => k % Math.ceil(some.length / room) === 0);
        const mark = (place, path, name) => {
          const [x, y] = spot(place);
          return ["#000000", "#ffffff"].map((stroke, k) => svg("path", { class: name, d: path, transform: `translate(${x + wide / 2} ${y + high / 2})`, fill: "none", stroke,
            "stroke-width": k ? 1.5 : 4, "pointer-events": "none" }));
        };
        const [width, height] = size;
        node.replaceChildren(svg("svg", { width, height, viewBox: `0 0 ${width} ${height}` }, ...cells, ...each(theta, 10).map(([value, k]) => label(number(value),
          left + (k + 0.5) * wide, height - 24)),
          ...each(phi, 8).map(([value, k]) => label(number(value), left - 6, spot(k * theta.length)[1] + high / 2 + 4, "end")), label("θ (share of the spikes)",
            left + (theta.length * wide) / 2, height - 6), label("φ", 12, top + (phi.length * high) / 2),
          ...mark(surface.best, "M-4 -4L4 4M-4 4L4 -4", "best"), ...(at < 0 ? [] : mark(at, "M8 0A8 8 0 1 1 -8 0A8 8 0 1 1 8 0Z", "ring"))));
        node.setAttribute("aria-label", `${titled(select.value)} over ${phi.length} φ and ${theta.length} θ. Best, at the cross: ${phrase(surface.best)}.${at < 0 ? "" : ` Chosen, at the ring: ${phrase(at)}.`}`);
        caption.textContent = `${(part.surfaces ?? []).length > 1 ? `${inBits((name) => surface[name])}. ` : ""}Dark ${number(low)}, bright ${number(most)}. Ring: chosen. Cross: the fastest of the most accurate settings.`;
      }
      return { nodes: [...(isMovable() ? sliders.nodes : []), element("label", {}, "map of ", select), node, caption], draw, move: sliders.move };
    }

    const titled = (column) => `${words(column)}${unit(column) ? ` (${unit(column)})` : ""}`;
    // Without numbers of its points a table cannot say which one a setting is.
    const isMovable = () => Boolean(shown.columns.trial && shown.columns.point);

    // ---- an example recording

    function rasterPane(part, surface) {
      const { examples } = part;
      const select = Dom.choice("Recording", draw, { data: { name: "example" } });
      Dom.fill(select, examples.map(({ title }, k) => [k, clip(title, 60)]));
      const node = Figure.node("raster", Figure.heightOf(examples[0].figure));
      const summary = element("p", { className: "summary", role: "status" });
      const known = surface && columnsOn(surface, shown.state.hardware);
      const sliders = known && isMovable() ? settings(surface, known, follow) : null;
      let rule = { phi: null, theta: null, after: null };
      const example = () => examples[Number(select.value)];

      function answer() {
        const { spikes, n_steps: nSteps, classes, step_ms: stepMs } = example();
        if (rule.phi !== null) return decide(spikes, nSteps, classes.length, rule.phi, rule.theta);
        const steps = rule.after === null ? nSteps : Math.min(nSteps, Math.max(1, Math.round(rule.after / stepMs)));
        return decide(spikes, steps, classes.length, Infinity, 0);
      }

      function sentence() {
        const { classes, step_ms: stepMs, true: meant } = example();
        const { label, step, decided } = answer();
        const name = clip(String(classes[label]), 40);
        const verdict = meant === classes[label] ? " (right)" : ` (wrong: it is ${clip(meant, 40)})`;
        const time = `${number((step + 1) * stepMs)}\u00a0ms`;
        if (rule.phi === null) return `answers ${name} after ${time}${verdict}`;
        return decided ? `decides ${name} after ${time}${verdict}` : `undecided: the largest count says ${name} after ${time}${verdict}`;
      }

      // The lines of the decision and of theta, where the setting puts them.
      function marks() {
        const { layout } = example().figure;
        const { step, decided } = answer();
        const x = (step + 1) * example().step_ms;
        const visible = rule.theta !== null;
        const y = rule.theta ?? 0;
        const moved = {
          decision: ({ line }) => ({ x0: x, x1: x, line: { ...line, dash: decided || !visible ? "solid" : "dot" } }),
          theta: ({ y0 }) => ({ visible, ...(y0 === undefined ? { y } : { y0: y, y1: y }) }),
        };
        const placed = (all = []) => all.map((one) => ({ ...one, ...moved[one.name]?.(one) }));
        return { shapes: placed(layout.shapes), annotations: placed(layout.annotations) };
      }
      function draw() {
        summary.textContent = sentence();
        const { title, figure: { data, layout }, spikes, classes, n_steps: nSteps, step_ms: stepMs } = example();
        const counted = `${app.plural(spikes.length, "output spike")} of ${number(classes.length)} classes in ${number(nSteps * stepMs)} ms`;
        node.setAttribute("aria-label", `${title}: ${counted}; ${sentence()}.`);
        node.style.height = `${Figure.heightOf({ layout })}px`;
        Figure.draw(node, { data, layout: { ...layout, ...marks() } }, app.style(), Figure.fitted);
      }

      function follow(place) {
        const { value } = shown.chosen;
        rule = place < 0 ? { phi: value("phi"), theta: value("theta"), after: value("read_out_ms") }
          : { phi: surface.phi[Math.floor(place / surface.theta.length)], theta: surface.theta[place % surface.theta.length], after: null };
        draw();
      }

      return {
        nodes: [
          select, ...(sliders?.nodes ?? []), summary, node,
          element("p", { className: "quiet", textContent: "Output spikes, share of the leading class, spikes per layer; first repeat." }),
        ],
        draw, move: () => (sliders ? sliders.move() : follow(-1)),
      };
    }

    // ---- the view

    // What is chosen is shown at once; while a limit moves, the pick may change with every step.
    const soon = Dom.settled(show);
    const render = (next) => soon({ ...next, chosen: next.subject, moving: next.moving && !next.chosen });

    function show(next) {
      shown = next;
      body.hidden = !shown.chosen.key;
      heading.textContent = "No design";
      if (body.hidden) return;
      renderHead();
      load();
      renderParts();
    }

    return { render };
  }

  return { view, decide, valuesOf, tabs: ["inside"] };
})();
Views.design = Design;
