"use strict";
// The front over two or three columns. In the plane, plotly draws axes, the joined front and what is marked, and a
// canvas behind it every other point: twenty thousand of them follow a slider, which no chart library's do.
const Front = (() => {
  const BARS = 14; // intervals on a front: more would hide its points
  const SPACE_POINTS = 2000; // dominated points drawn in space
  const ARROW_PX = 20;
  const NEAR_PX = 16; // how far from a point a pointer means it
  const SETTLED_MS = 150; // after a budget's last step: until then the canvas draws what plotly is too slow for
  const FADE_MS = 1200; // of points that a running study adds
  const HOVER_CHARACTERS = 60;
  const CHARACTER_PX = 8; // about the width of one
  const STOPS = ["#00224e", "#123570", "#3b496c", "#575d6d", "#707173", "#8a8678", "#a59c74", "#c3b369", "#e1cc55", "#fee838"]; // Cividis
  const LEVELS = 32; // of colour
  const DASHES = ["solid", "dot", "dash", "dashdot"]; // of tasks whose colour is taken
  const BOTH = "all";
  const POINTED = "pointed";
  const { element } = Dom;
  const [OUTSIDE, DIM, BEST, JOINED, LEFT] = [0, 1, 2, 3, 4]; // points: beyond a budget, dominated, on the front, on the joined one, left out

  const hasWebGL = (() => {
    try {
      return Boolean(document.createElement("canvas").getContext("webgl"));
    } catch {
      return false;
    }
  })();

  // Plotly's own picture would lack the canvas.
  const config = { ...Figure.config, modeBarButtonsToRemove: [...Figure.config.modeBarButtonsToRemove, "toImage"] };

  const { ends } = Data;

  function view(root, app) {
    const { number, escaped, clip, title, taskOf, colourOf } = app;
    const part = (name) => root.querySelector(name);
    const [plot, canvas, ring, tip] = ["#plot", "#cloud", "#ring", "#tip"].map(part);
    let shown = null;
    let panels = []; // of the plane: {tasks, suffix, points: rows, kinds of each, line: the joined front}
    let places = []; // of the canvas: {rows, x, y} in pixels, per panel
    let known = new Set(); // keys of the points drawn before, so that new ones can fade in
    let born = { rows: new Set(), at: -Infinity };

    // ---- what is drawn

    const flat = () => shown.state.view !== "3";
    const axes = () => (flat() ? ["x", "y"] : ["x", "y", "z"]).map((axis) => shown.state[axis]);
    // In space the vertical is plotly's z; the column chosen as y points up in both views.
    const letters = () => (flat() ? "xy" : "xzy");
    const namesShown = () => (!shown.columns.task ? [""] : shown.state.task === BOTH ? app.distinct("task") : [shown.state.task]);
    let drawn = { rows: null, key: "", points: [] }; // one list while budgets move
    function drawable() {
      const key = axes().join("|");
      if (drawn.rows !== shown.rows || drawn.key !== key) {
        const values = axes().map(app.numbers);
        drawn = { rows: shown.rows, key, points: shown.rows.filter((row) => values.every((numbers) => !Number.isNaN(numbers[row]))) };
      }
      return drawn.points;
    }

    function coordinates(some) {
      return Object.fromEntries(axes().map((column, k) => [letters()[k], some.map((row) => app.numbers(column)[row])]));
    }

    // On a crowded front every n-th point carries its interval.
    function bars(some, colour) {
      const step = Math.ceil(some.length / BARS);
      const thinned = (values, column) => some.map((row, k) => (k % step === 0 && !(column && app.isOpen(column, row)) ? values[row] : null));
      return Object.fromEntries(axes().flatMap((column, k) => {
        const interval = Object.hasOwn(shown.page.intervals, column) ? shown.page.intervals[column] : undefined;
        return !interval ? [] : [[`error_${letters()[k]}`, {
          type: "data", symmetric: false, color: `${colour}99`, thickness: 1, width: 2,
          array: thinned(interval.high, column), arrayminus: thinned(interval.low),
        }]];
      }));
    }

    // Of an interval whose upper end says nothing, an arrow.
    function arrows(some, look, suffix) {
      const step = Math.ceil(some.length / BARS);
      return axes().flatMap((column, axis) => some.filter((row, k) => k % step === 0 && app.isOpen(column, row)).map((row) => {
        const at = axes().map((name, k) => (shown.state[`l${"xy"[k]}`] === "1" ? Math.log10(app.numbers(name)[row]) : app.numbers(name)[row]));
        const along = axis === 0 ? { xshift: ARROW_PX, ax: -ARROW_PX, ay: 0 } : { yshift: ARROW_PX, ax: 0, ay: ARROW_PX };
        return { x: at[0], y: at[1], xref: `x${suffix}`, yref: `y${suffix}`, text: "", showarrow: true, arrowhead: 2, arrowwidth: 1, arrowcolor: look.quiet, ...along };
      }));
    }

    // A point that stays on the front in few samples looks less certain.
    function certainty(row) {
      const { front_probability: probability, front_share: sampled } = shown.columns;
      const share = (probability ?? sampled)?.values[row];
      return typeof share === "number" ? 0.25 + 0.75 * share : 1;
    }

    function hoverText(row) {
      const { columns, objectives, page } = shown;
      const reason = shown.leftOut(row);
      const lines = page.design.filter((column) => columns[column].values[row] !== null)
        .map((column) => `${title(column)}  ${number(columns[column].values[row])}`);
      const measured = app.beside([...objectives, ...axes()]).filter((column) => !page.design.includes(column));
      return [...(reason ? [reason] : []), ...lines, ...measured.map((column) => `${title(column)}  ${app.withInterval(column, row)}`)]
        .map((line) => clip(line, HOVER_CHARACTERS));
    }

    // ---- colours

    function blended(stops, share) {
      const at = share * (stops.length - 1);
      const k = Math.min(stops.length - 2, Math.floor(at));
      const parts = [stops[k], stops[k + 1]].map((hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16)));
      return `rgb(${parts[0].map((low, i) => Math.round(low + (at - k) * (parts[1][i] - low))).join(",")})`;
    }

    // A colour nearer to that of the page: plotly has no opacity per point in space.
    function faded(colour, share, look) {
      const [ground, ink] = [look.page, colour].map((name) =>
        (name.startsWith("#") ? [1, 3, 5].map((i) => parseInt(name.slice(i, i + 2), 16)) : name.match(/\d+/g).slice(0, 3).map(Number)));
      return `rgb(${ink.map((part, i) => Math.round(ground[i] + share * (part - ground[i]))).join(",")})`;
    }

    // What a column other than the task paints points with: {of(row), names: [[name, colour]]} or {of(row), scale}.
    function tintOf(look) {
      const column = shown.colour;
      if (!column || column === "task") return null;
      const values = app.numbers(column);
      const names = app.categories(column);
      if (names.length) {
        const counts = names.map((name, k) => [shown.rows.filter((row) => values[row] === k).length, k]).sort((a, b) => b[0] - a[0] || a[1] - b[1]);
        const own = new Map(counts.slice(0, names.length > look.palette.length ? look.palette.length - 1 : names.length).map(([, k]) => k).sort((a, b) => a - b)
          .map((k, place) => [k, look.palette[place]]));
        const listed = [...own].map(([k, colour]) => [names[k], colour]);
        return { of: (row) => own.get(values[row]) ?? look.quiet, names: own.size < names.length ? [...listed, ["others", look.quiet]] : listed };
      }
      const stops = look.dark ? STOPS.slice(2) : STOPS.slice(0, -1); // the ends vanish on dark and on white
      const known = shown.rows.map((row) => values[row]).filter(Number.isFinite);
      const [low, high] = ends(known);
      const log = low > 0 && high / low > 100;
      const along = (value) => (low === high ? 0.5 : log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low));
      const levels = Array.from({ length: LEVELS + 1 }, (_, k) => blended(stops, k / LEVELS));
      const of = (row) => (Number.isFinite(values[row]) ? levels[Math.round(LEVELS * along(values[row]))] : look.quiet);
      const scale = levels.filter((_, k) => k % 4 === 0).map((colour, k, all) => [k / (all.length - 1), colour]);
      return known.length ? { of, names: [], scale: { low, high, log, scale } } : { of, names: [] };
    }

    // The key of a tint, as traces without points.
    function keyTraces(tint) {
      if (!tint) return [];
      const base = { type: "scatter", mode: "markers", x: [null], y: [null], hoverinfo: "skip" };
      const named = tint.names.map(([name, color]) => ({ ...base, name: escaped(clip(name, 32)), showlegend: true, marker: { color, size: 9 } }));
      if (!tint.scale) return named;
      const { low, high, log, scale } = tint.scale;
      const at = log ? Math.log10 : (value) => value;
      const decades = Array.from({ length: 40 }, (_, k) => k - 20).filter((k) => k >= Math.log10(low) && k <= Math.log10(high));
      const ticks = log ? { tickvals: decades, ticktext: decades.map((k) => number(10 ** k)) } : { nticks: 5 };
      const title = { text: escaped(clip(app.title(shown.colour), 32)), side: "right" };
      const colorbar = { thickness: 8, outlinewidth: 0, len: 0.9, title, ...ticks };
      return [{ ...base, showlegend: false, marker: { color: [at(low)], cmin: at(low), cmax: at(high), colorscale: scale, showscale: true, colorbar } }];
    }

    const isOnFront = (row) => shown.onFront.has(row);

    function panelsOf() {
      const names = namesShown();
      const front = shown.joined(axes());
      const points = drawable();
      const groups = shown.state.view === "s" && names.length > 1 ? names.map((name) => [name]) : [names];
      return groups.map((tasks, k) => {
        const ofTasks = tasks.length === names.length ? points : points.filter((row) => tasks.includes(taskOf(row)));
        const line = new Set((front ?? []).filter((row) => !shown.columns.task || tasks.includes(taskOf(row))));
        const kinds = Uint8Array.from(ofTasks, (row) => (shown.leftOut(row) ? LEFT : line.has(row) ? JOINED : !shown.within(row) ? OUTSIDE : isOnFront(row) ? BEST : DIM));
        return { tasks, suffix: k ? String(k + 1) : "", points: ofTasks, kinds, line: [...line] };
      });
    }

    // What the canvas draws of a panel, the least first. Dense clouds are thinner: the front stays what is seen first.
    function layers({ kinds }) {
      const counts = [0, 0, 0, 0, 0];
      for (const kind of kinds) counts[kind] += 1;
      const thin = (kind, alpha) => Math.max(0.08, alpha * Math.min(1, Math.sqrt(1000 / counts[kind])));
      return [
        { kind: LEFT, size: 3, alpha: thin(LEFT, 0.5) }, { kind: OUTSIDE, size: 2, alpha: thin(OUTSIDE, 0.2) }, { kind: DIM, size: 2.5, alpha: thin(DIM, 0.35) },
        { kind: BEST, size: 3.5, alpha: 0.8 },
      ];
    }

    function marked(look) {
      const { budgeted, chosen, compared, columns } = shown;
      const best = budgeted.pick >= 0 ? budgeted.picks.map(({ row }) => row) : [budgeted.relaxed[0]?.row ?? budgeted.nearest[0]?.row];
      const symbol = (kind, size, width, colour) => ({ symbol: kind, color: colour, size, line: { color: colour, width } });
      const inTask = (row) => row < 0 || shown.state.task === BOTH || !columns.task || taskOf(row) === shown.state.task;
      const taskAt = ({ row, value }) => String((row < 0 ? value("task") : columns.task?.values[row]) ?? "");
      const marks = [];
      for (const row of budgeted.limits.length ? best.filter((one) => one >= 0) : []) {
        const at = { row, value: (column) => columns[column].values[row] };
        marks.push({ at, task: taskAt(at), marker: symbol("diamond-open", 16, 2, look.text), name: budgeted.pick >= 0 ? "pick" : "nearest" });
      }
      compared.forEach((at, k) => marks.push({ at, task: taskAt(at), marker: symbol("square-open", 16, 1.5, look.text), name: String(k + 1), words: true }));
      if (chosen) marks.push({ at: chosen, task: taskAt(chosen), marker: symbol("circle-open", 18, 2, look.text), name: "chosen" });
      return marks.filter(({ at }) => inTask(at.row) && axes().every((column) => Number.isFinite(app.placed(column, at.value(column)))));
    }

    const published = () => (shown.page.marks).filter(({ task, values }) =>
      (!task || shown.state.task === BOTH || task === shown.state.task) && axes().every((column) => Number.isFinite(values[app.measuredOf(column)])));

    // Plotly's traces of the plane; `whole` has the canvas's points too, for a picture that is kept.
    function planeTraces(look, whole) {
      const { state } = shown;
      const tint = tintOf(look);
      const traces = shown.rows.length ? keyTraces(tint) : [];
      for (const panel of panels) {
        const on = { xaxis: `x${panel.suffix}`, yaxis: `y${panel.suffix}` };
        const add = (trace) => traces.push({ type: "scatter", mode: "markers", hoverinfo: "skip", showlegend: false, ...on, ...trace });
        if (panel.points.length) {
          const reach = axes().map((column) => ends(panel.points.map((row) => app.numbers(column)[row])));
          add({ x: reach[0], y: reach[1], marker: { opacity: 0 } }); // the axes reach over what the canvas draws
        }
        for (const name of panel.tasks) {
          const colour = colourOf(name, look);
          const ofTask = (rows) => rows.filter((row) => taskOf(row) === name);
          if (whole) {
            for (const { kind, size, alpha } of layers(panel)) {
              const some = ofTask(panel.points.filter((_, k) => panel.kinds[k] === kind));
              const marker = { color: kind === OUTSIDE || kind === LEFT ? look.quiet : colour, size: 2 * size, opacity: alpha, line: { width: 0 } };
              if (kind === LEFT) Object.assign(marker, { symbol: "square-open", line: { width: 1 } });
              else if (tint && kind !== OUTSIDE) marker.color = some.map(tint.of);
              if (some.length) add({ ...coordinates(some), marker });
            }
          }
          const [xs, ys] = [state.x, state.y].map(app.numbers);
          const line = ofTask(panel.line).sort((a, b) => xs[a] - xs[b] || ys[a] - ys[b]);
          if (!line.length) continue;
          // The staircase is what the front attains: nothing lies beyond it.
          add({ mode: "lines", ...coordinates(line), line: {
            color: tint ? look.text : colour, width: 1.5, shape: app.wayOf(state.x) === "min" ? "hv" : "vh", dash: tint ? DASHES[panel.tasks.indexOf(name) % DASHES.length] : "solid",
          } });
          add({
            ...coordinates(line), customdata: line, ...bars(line, tint ? look.quiet : colour), name: escaped(clip(name, 40)), showlegend: panel.tasks.length > 1 && !tint,
            marker: { color: tint ? line.map(tint.of) : colour, size: 9, opacity: line.map(certainty), line: { color: look.page, width: 1 } },
          });
        }
        overlays(look, ({ task }) => panel.tasks.length !== 1 || !task || task === panel.tasks[0]).forEach(add);
      }
      return traces;
    }

    // What lies over the points, in the plane and in space: published designs, and what is marked.
    function overlays(look, here = () => true) {
      const at = (values) => Object.fromEntries(axes().map((column, k) => [letters()[k], values.map((value) => app.placed(column, value(column)))]));
      const cited = published().filter(here);
      const marker = flat() ? { symbol: "x-thin", size: 9, color: look.quiet, line: { color: look.quiet, width: 2 } } : { symbol: "cross", size: 4, color: look.quiet };
      const hovertext = cited.map(({ name, caption }) => `${escaped(clip(name, 60))}<br>${escaped(clip(caption, 120))}`);
      const named = { name: "published", showlegend: true, marker, hoverinfo: "text", hovertext };
      return [
        ...(cited.length ? [{ ...at(cited.map(({ values }) => (column) => values[app.measuredOf(column)])), ...named }] : []),
        ...marked(look).filter(here).map(({ at: { value }, marker: one, name, words }) => ({
          ...at([value]), marker: flat() ? one : { ...one, size: 0.65 * one.size },
          ...(words ? { mode: "markers+text", text: [name], textposition: `top ${flat() ? "right" : "center"}`, textfont: { color: look.text } } : {}),
        })),
      ];
    }

    function spaceTraces(look) {
      const tint = tintOf(look);
      const traces = keyTraces(tint).map((trace) => ({ ...trace, type: "scatter3d", z: [null] }));
      const painted = (rows, colour) => (tint ? rows.map(tint.of) : colour);
      const front = shown.joined(axes());
      const points = drawable();
      for (const name of namesShown()) {
        const colour = colourOf(name, look);
        const ofTask = points.filter((row) => taskOf(row) === name);
        const visible = new Set(ofTask);
        const line = (front ?? []).filter((row) => visible.has(row));
        const inLine = new Set(line);
        const thinned = (rows) => rows.filter((_, k) => k % Math.ceil(rows.length / SPACE_POINTS) === 0);
        const add = (rows, marker, more = {}) => rows.length && traces.push({
          type: "scatter3d", mode: "markers", ...coordinates(rows), customdata: rows, legendgroup: name, showlegend: false,
          text: rows.map((row) => hoverText(row).map(escaped).join("<br>")), hovertemplate: "%{text}<extra></extra>", marker, ...more,
        });
        const cloud = ofTask.filter((row) => !inLine.has(row) && !shown.leftOut(row));
        add(thinned(ofTask.filter(shown.leftOut)), { symbol: "square-open", color: look.quiet, size: 3, opacity: 0.5, line: { width: 1 } });
        add(thinned(cloud.filter((row) => !shown.within(row))), { color: look.quiet, size: 2, opacity: 0.12, line: { width: 0 } });
        const dim = thinned(cloud.filter((row) => shown.within(row) && !isOnFront(row)));
        add(dim, { color: painted(dim, colour), size: 3, opacity: 0.22, line: { width: 0 } });
        const best = cloud.filter((row) => shown.within(row) && isOnFront(row));
        add(best, { color: best.map((row) => faded(tint ? tint.of(row) : colour, certainty(row), look)), size: 3.5, opacity: 0.75, line: { width: 0 } }, front ? {} : bars(best, colour));
        const shaded = line.map((row) => faded(tint ? tint.of(row) : colour, certainty(row), look));
        add(line, { color: shaded, size: 4.5, line: { color: look.page, width: 1 } },
          { ...bars(line, colour), name: escaped(clip(name, 40)), showlegend: namesShown().length > 1 && !tint });
      }
      const pointed = { x: [], y: [], z: [], name: POINTED, marker: { symbol: "circle-open", size: 12, color: look.text, line: { color: look.text, width: 2 } } };
      const plain = { type: "scatter3d", mode: "markers", hoverinfo: "skip", showlegend: false };
      return [...traces, ...[...overlays(look), pointed].map((trace) => ({ ...plain, ...trace }))];
    }

    // ---- its frame

    // Over many decades, ticks between them would run into each other.
    function decadesOf(column) {
      const values = app.numbers(column);
      const [low, high] = ends(shown.rows.map((row) => values[row]).filter((value) => value > 0));
      return { dtick: high / low > 1e7 ? 2 : high / low > 1e3 ? 1 : "D2" };
    }

    // In space an axis is short: few ticks, of a logarithm whole decades.
    function ticksInSpace(column, log) {
      if (!log) return { nticks: 5 };
      const values = app.numbers(column);
      const [low, high] = ends(shown.rows.map((row) => values[row]).filter((value) => value > 0)).map(Math.log10);
      const decades = Array.from({ length: 80 }, (_, k) => k - 40).filter((k) => k > low - 0.5 && k < high + 0.5);
      const tickvals = decades.filter((_, k) => k % Math.ceil(decades.length / 4) === 0).map((k) => 10 ** k);
      return { tickmode: "array", tickvals, ticktext: tickvals.map((value) => number(value)) };
    }

    function axis(letter, look) {
      const { state } = shown;
      const log = state[`l${letter}`] === "1";
      const names = app.categories(state[letter]);
      const words = names.length ? { tickmode: "array", tickvals: names.map((_, k) => k), ticktext: names.map((name) => escaped(clip(name, 24))), range: [-0.5, names.length - 0.5] } : {};
      return {
        title: { text: escaped(clip(title(state[letter]), 48)), standoff: 8 }, automargin: true, type: log ? "log" : "linear",
        ...Figure.NOTATION, showticklabels: shown.rows.length > 0, gridcolor: look.rule, linecolor: look.rule, zeroline: false, showbackground: false, color: look.text,
        ...(!flat() ? ticksInSpace(state[letter], log) : log ? decadesOf(state[letter]) : {}), ...words,
      };
    }

    // A narrow figure is seen from further away, so that its axes stay inside.
    function camera(width) {
      const far = Math.min(1.5, Math.max(1, 720 / width));
      return { eye: { x: 1.7 * far, y: -1.9 * far, z: 0.6 * far }, center: { x: 0, y: 0, z: -0.25 } };
    }

    // `whole` has the grid too, which the canvas else draws below its points.
    function layout(look, whole = false) {
      const { state } = shown;
      const narrow = plot.clientWidth < 560;
      const figureLayout = {
        ...Figure.face(look, narrow),
        margin: flat() ? { l: 48, r: 8, t: 24, b: 40 } : { l: 0, r: 0, t: 8, b: 0 },
        legend: { orientation: "h", x: 0, y: !flat() ? 1.08 : panels.length > 1 ? 1.07 : 1, yanchor: flat() ? "bottom" : "top", itemclick: false, itemdoubleclick: false, itemsizing: "constant" },
        ...(look.paper ? { width: plot.clientWidth, height: plot.clientHeight } : {}),
        uirevision: [state.view, state.x, state.y, state.z, state.lx, state.ly, state.lz].join(),
      };
      if (!flat()) {
        figureLayout.scene = {
          xaxis: axis("x", look), yaxis: axis("z", look), zaxis: axis("y", look), aspectmode: "manual",
          aspectratio: { x: 1.5, y: 1.5, z: 1 }, camera: camera(plot.clientWidth),
        };
        return figureLayout;
      }
      figureLayout.annotations = panels.some(({ points }) => points.length) ? [] : [{
        text: shown.budgeted.noneFits ? escaped(`No design fits ${clip(shown.state.hardware || "the chip", 40)}`) : "No point has both numbers",
        xref: "paper", yref: "paper", x: 0.5, y: 0.5, showarrow: false, font: { size: 16, color: look.quiet },
      }];
      panels.forEach(({ suffix, tasks }, k) => {
        const [low, high] = [k / panels.length, (k + 1) / panels.length - (k + 1 < panels.length ? 0.04 : 0)];
        const room = Math.max(4, Math.floor(plot.clientWidth / panels.length / CHARACTER_PX));
        figureLayout[`xaxis${suffix}`] = { ...axis("x", look), showgrid: whole, domain: [low, high], anchor: `y${suffix}` };
        if (k && clip(title(state.x), 48).length > room) figureLayout[`xaxis${suffix}`].title = { text: "" }; // it is that of the first
        figureLayout[`yaxis${suffix}`] = { ...axis("y", look), showgrid: whole, anchor: `x${suffix}`, ...(k ? { matches: "y", showticklabels: false, title: { text: "" } } : {}) };
        figureLayout.annotations.push(...arrows(panels[k].line, look, suffix));
        if (panels.length > 1) {
          figureLayout.annotations.push({
            text: escaped(clip(tasks[0], Math.min(40, room))), xref: "paper", yref: "paper", x: low, y: 1, xanchor: "left", yanchor: "bottom",
            showarrow: false, font: { color: colourOf(tasks[0], look) },
          });
        }
      });
      return figureLayout;
    }

    // ---- the canvas behind the axes

    // Where a panel's values lie in pixels; what a logarithm cannot show lies nowhere.
    function projected(panel) {
      const frame = plot._fullLayout;
      return ["x", "y"].map((letter) => {
        const along = frame[`${letter}axis${panel.suffix}`];
        const log = along.type === "log";
        return (value) => along._offset + along.l2p(log ? Math.log10(value) : value);
      });
    }

    // Where points lie in pixels, as long as the points and the axes stay.
    const placed = new WeakMap();
    function placesOf(points, alongX, alongY, toX, toY) {
      const key = [alongX, alongY].map(({ type, range, _offset, _length }) => [type, range, _offset, _length].join()).join("|") + axes().join("|");
      if (placed.get(points)?.key !== key) {
        const [xs, ys] = axes().map(app.numbers);
        placed.set(points, { key, rows: points, x: Float32Array.from(points, (row) => toX(xs[row])), y: Float32Array.from(points, (row) => toY(ys[row])) });
      }
      return placed.get(points);
    }

    // Its size is asked for when it changes: to ask at every step would lay the page out twice.
    let size = [plot.clientWidth, plot.clientHeight];
    new ResizeObserver(() => {
      const now = [plot.clientWidth, plot.clientHeight];
      if (String(now) === String(size)) return;
      size = now;
      paint();
    }).observe(plot);

    function paint() {
      const frame = plot._fullLayout;
      const brush = Figure.brush(canvas, size);
      places = [];
      if (!shown || !flat() || !frame?.xaxis || plot.dataset.view !== drawnView()) return;
      const look = app.style();
      const tint = tintOf(look);
      const age = Math.min(1, (performance.now() - born.at) / FADE_MS);
      for (const panel of panels) {
        const [alongX, alongY] = [frame[`xaxis${panel.suffix}`], frame[`yaxis${panel.suffix}`]];
        if (!alongX || !alongY) return;
        const [toX, toY] = projected(panel);
        const { points, kinds } = panel;
        const place = placesOf(points, alongX, alongY, toX, toY);
        places.push(place);
        brush.save();
        brush.beginPath();
        brush.rect(alongX._offset, alongY._offset, alongX._length, alongY._length);
        brush.clip();
        grid(brush, alongX, alongY, look);
        bins(brush, panel, toX, toY, look);
        const fresh = (k) => (age < 1 && born.rows.has(points[k]) ? age : 1);
        const ofKind = [[], [], [], [], []];
        for (let k = 0; k < points.length; k += 1) ofKind[kinds[k]].push(k);
        for (const { kind, size, alpha } of layers(panel)) {
          for (const name of kind === OUTSIDE || kind === LEFT ? panel.tasks.slice(0, 1) : panel.tasks) {
            brush.fillStyle = kind === OUTSIDE ? look.quiet : colourOf(name, look);
            brush.strokeStyle = look.quiet;
            brush.lineWidth = 1;
            brush.globalAlpha = alpha;
            for (const k of ofKind[kind]) {
              if (kind !== OUTSIDE && kind !== LEFT && panel.tasks.length > 1 && taskOf(points[k]) !== name) continue;
              if (tint && kind !== OUTSIDE) brush.fillStyle = tint.of(points[k]);
              if (age < 1) brush.globalAlpha = alpha * fresh(k);
              if (kind === BEST) {
                brush.globalAlpha = alpha * certainty(points[k]) * fresh(k);
                brush.beginPath();
                brush.arc(place.x[k], place.y[k], size, 0, 7);
                brush.fill();
              } else if (kind === LEFT) {
                brush.strokeRect(place.x[k] - size, place.y[k] - size, 2 * size, 2 * size);
              } else {
                brush.fillRect(place.x[k] - size, place.y[k] - size, 2 * size, 2 * size);
              }
            }
          }
        }
        if (isStale()) sketch(brush, panel, toX, toY, look, tint);
        brush.restore();
      }
      if (age < 1) requestAnimationFrame(paint);
    }

    // Lines at the ticks that plotly has written.
    function grid(brush, alongX, alongY, look) {
      Object.assign(brush, { strokeStyle: look.rule, lineWidth: 1, globalAlpha: 0.6 });
      brush.beginPath();
      for (const [along, across, line] of [[alongX, alongY, (at, over) => [at, over]], [alongY, alongX, (at, over) => [over, at]]]) {
        for (const { x } of along._vals ?? []) {
          const at = Math.round(along._offset + along.l2p(x)) + 0.5;
          brush.moveTo(...line(at, across._offset));
          brush.lineTo(...line(at, across._offset + across._length));
        }
      }
      brush.stroke();
    }

    // The joined front and the marks, without intervals.
    const isStale = () => plot.classList.contains("stale");
    function sketch(brush, panel, toX, toY, look, tint) {
      const { state } = shown;
      const [xs, ys] = axes().map(app.numbers);
      brush.globalAlpha = 1;
      for (const name of panel.tasks) {
        const line = panel.line.filter((row) => taskOf(row) === name).sort((a, b) => xs[a] - xs[b] || ys[a] - ys[b]);
        brush.strokeStyle = brush.fillStyle = tint ? look.text : colourOf(name, look);
        brush.lineWidth = 1.5;
        brush.beginPath();
        line.forEach((row, k) => {
          const [x, y] = [toX(xs[row]), toY(ys[row])];
          if (k === 0) brush.moveTo(x, y);
          else if (app.wayOf(state.x) === "min") brush.lineTo(x, toY(ys[line[k - 1]]));
          else brush.lineTo(toX(xs[line[k - 1]]), y);
          brush.lineTo(x, y);
        });
        brush.stroke();
        for (const row of line) {
          if (tint) brush.fillStyle = tint.of(row);
          brush.beginPath();
          brush.arc(toX(xs[row]), toY(ys[row]), 4.5, 0, 7);
          brush.fill();
        }
      }
      brush.strokeStyle = look.text;
      brush.lineWidth = 2;
      for (const { at, task, marker } of marked(look)) {
        if (panel.tasks.length === 1 && task && task !== panel.tasks[0]) continue;
        const [x, y, r] = [toX(app.placed(state.x, at.value(state.x))), toY(app.placed(state.y, at.value(state.y))), marker.size / 2];
        const corners = { "diamond-open": [[0, -1.3], [1.3, 0], [0, 1.3], [-1.3, 0]], "square-open": [[-1, -1], [1, -1], [1, 1], [-1, 1]] }[marker.symbol];
        brush.beginPath();
        if (corners) {
          for (const [right, down] of corners) brush.lineTo(x + r * right, y + r * down);
          brush.closePath();
        } else {
          brush.arc(x, y, r, 0, 7);
        }
        brush.stroke();
      }
    }

    // How many of all points lie where, behind a sample of them.
    function bins(brush, panel, toX, toY, look) {
      const { state, page } = shown;
      for (const { task, hardware, x, y, x_edges, y_edges, counts } of page.bins) {
        const isShown = (!task || panel.tasks.includes(task)) && (!hardware || hardware === state.hardware);
        const turned = x === state.y && y === state.x;
        if (!isShown || state.family !== BOTH || !(turned || (x === state.x && y === state.y))) continue;
        const [right, up] = turned ? [y_edges, x_edges] : [x_edges, y_edges];
        const most = Math.log1p(Math.max(...counts.map(([, , n]) => n)));
        brush.fillStyle = look.quiet;
        for (const [first, second, n] of counts) {
          const [i, j] = turned ? [second, first] : [first, second];
          brush.globalAlpha = (0.25 * Math.log1p(n)) / most;
          const [left, bottom, edge, top] = [toX(right[i]), toY(up[j]), toX(right[i + 1]), toY(up[j + 1])];
          brush.fillRect(left, top, edge - left, bottom - top);
        }
      }
    }

    const drawnView = () => `${shown.state.view}|${panels.length}|${axes().join("|")}|${shown.state.lx}${shown.state.ly}`;

    // ---- pointing

    function nearest(event) {
      const box = plot.getBoundingClientRect();
      const [px, py] = [event.clientX - box.left, event.clientY - box.top];
      let [best, least] = [-1, NEAR_PX ** 2];
      for (const { rows, x, y } of places) {
        for (let k = 0; k < rows.length; k += 1) {
          // Of points on the same spot, one on the front is meant.
          const distance = (x[k] - px) ** 2 + (y[k] - py) ** 2 + (isOnFront(rows[k]) ? 0 : 4);
          if (distance < least) [best, least] = [rows[k], distance];
        }
      }
      return best;
    }

    function spot(row) {
      for (const { rows, x, y } of places) {
        const k = rows.indexOf(row);
        if (k >= 0) return [x[k], y[k]];
      }
      return null;
    }

    function showTip(row) {
      const at = row >= 0 ? spot(row) : null;
      tip.hidden = at === null;
      if (at === null) return;
      tip.replaceChildren(...hoverText(row).map((text) => element("div", { textContent: text })));
      const width = plot.clientWidth;
      tip.style.left = `${at[0] > width / 2 ? "" : at[0] + 12}px`;
      tip.style.right = `${at[0] > width / 2 ? width - at[0] + 12 : ""}px`;
      tip.style.top = `${Math.max(0, Math.min(at[1] - 16, plot.clientHeight - tip.offsetHeight))}px`;
    }

    let [pressed, pointed] = [null, -1]; // where a button went down, on which row; the row under the pointer
    plot.addEventListener("pointermove", (event) => {
      if (!shown || !flat() || event.buttons) return;
      const row = nearest(event);
      if (row === pointed) return;
      pointed = row;
      showTip(row);
      app.hover(row < 0 ? null : app.keyOf(row));
    });
    plot.addEventListener("pointerleave", () => {
      pointed = -1;
      showTip(-1);
      app.hover(null);
    });
    // Plotly covers the page while a button is held: what is pressed and let go on one spot is a choice.
    plot.addEventListener("pointerdown", (event) => { pressed = { x: event.clientX, y: event.clientY, row: pointed }; }, true);
    addEventListener("pointerup", (event) => {
      const { x, y, row: before } = pressed ?? {};
      const still = pressed && Math.hypot(event.clientX - x, event.clientY - y) < 4;
      pressed = null;
      if (!shown || !still) return;
      const row = flat() ? nearest(event) : before; // in space a button that goes down already turns the scene
      if (row >= 0) app.change({ chosen: app.keyOf(row) });
    }, true);

    function pointInSpace(row) {
      if (flat() || row === pointed) return;
      pointed = row;
      app.hover(row < 0 ? null : app.keyOf(row));
    }

    // In space the mark is a trace of its own, the last: it moves at most once a frame.
    let marking = null;
    function markInSpace(row) {
      const waiting = marking !== null;
      marking = row;
      if (waiting) return;
      requestAnimationFrame(() => {
        const at = axes().map((column) => (marking >= 0 ? app.numbers(column)[marking] : NaN));
        marking = null;
        if (flat() || !plot.data?.length || plot.data.at(-1).name !== POINTED) return;
        const values = Object.fromEntries(at.map((value, k) => [letters()[k], [Number.isNaN(value) ? [] : [value]]]));
        Plotly.restyle(plot, values, [plot.data.length - 1]);
      });
    }

    function hover(key) {
      const row = key === null ? -1 : app.rowOf(key);
      if (shown && !flat()) {
        if (row !== pointed) markInSpace(row); // what the pointer is on says so itself
        return;
      }
      const at = row >= 0 && shown ? spot(row) : null;
      ring.hidden = at === null;
      if (at !== null) ring.style.transform = `translate(${at[0] - 9}px, ${at[1] - 9}px)`;
    }

    // ---- drawing

    let listening = null;
    function listen() {
      if (listening === plot._ev) return;
      listening = plot._ev;
      paint(); // from now on with every drawing
      plot.on("plotly_afterplot", paint);
      plot.on("plotly_relayouting", paint);
      plot.on("plotly_hover", (event) => pointInSpace(event.points[0].customdata ?? -1));
      plot.on("plotly_unhover", () => pointInSpace(-1));
    }

    let drawing;
    function draw() {
      if (!flat() && !hasWebGL) {
        if (window.Plotly) Plotly.purge(plot);
        plot.textContent = "The 3-D view needs WebGL, which this browser does not offer. The 2-D view works.";
        return;
      }
      const current = shown;
      Figure.library().then(() => {
        if (current !== shown) return;
        const look = app.style();
        const space = `${!flat()} ${look.paper}`; // as wide as it was drawn
        if (plot.dataset.space !== space) Plotly.purge(plot);
        plot.dataset.space = space;
        plot.dataset.view = drawnView();
        plot.classList.remove("stale");
        Plotly.react(plot, flat() ? planeTraces(look, false) : spaceTraces(look), layout(look), config).then(listen);
      });
    }

    function describe() {
      const { columns, objectives, budgeted, state } = shown;
      const front = shown.joined(axes());
      const labels = axes().map((column) => columns[column].label);
      const every = app.plural(objectives.length, "objective");
      const item = (symbol, text) => element("span", {}, element("span", { className: `key ${symbol}` }), ` ${text}`);
      part("#caption").replaceChildren(...[
        front && item("joined", `front of ${labels.slice(0, -1).join(", ")} and ${labels.at(-1)}`), item("solid", `front of all ${every}`), item("dim", "dominated"),
        (shown.columns.front_probability ?? shown.columns.front_share) && item("faint", `paler: on the front in few samples of ${shown.columns.front_probability ? "recordings, seeds and chip" : "the chip's numbers"}`),
        front && item("whisker", "standard error, or the model's interval"), budgeted.limits.length && item("beyond", "outside the budgets"),
        budgeted.limits.length && item("diamond", budgeted.pick >= 0 ? "pick" : "nearest"), shown.rows.some(shown.leftOut) && item("left", "left out"),
        published().length && item("cross", "published, on its own data"),
      ].filter(Boolean));
      const rows = (front ?? budgeted.front).filter((row) => state.task === BOTH || !columns.task || taskOf(row) === state.task);
      const ranges = !rows.length ? ["nothing is within the budgets"] : axes().map((column) => {
        const [low, high] = ends(rows.map((row) => app.numbers(column)[row]).filter((value) => !Number.isNaN(value)));
        return `${title(column)} ${number(low)} to ${number(high)}`;
      });
      plot.setAttribute("aria-label", `${labels.join(" against ")}: ${rows.length} points on the front, ${ranges.join(", ")}. The table below holds the numbers.`);
    }

    function fresh() {
      const keys = new Set(shown.rows.map(app.keyOf));
      const added = shown.rows.filter((row) => !known.has(app.keyOf(row)));
      const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
      if (known.size && !still) born = { rows: new Set(added), at: added.length ? performance.now() : born.at };
      known = keys;
    }

    function render(next) {
      const isNew = shown?.page !== next.page;
      shown = next;
      if (!next.moving) size = [plot.clientWidth, plot.clientHeight]; // the observer is late for paper
      if (isNew) fresh();
      panels = flat() ? panelsOf() : [];
      ring.hidden = tip.hidden = true;
      pointed = -1;
      clearTimeout(drawing);
      // Axes that stay need no drawing at once.
      const isMoving = next.moving && flat() && plot.dataset.view === drawnView();
      plot.classList.toggle("stale", isMoving);
      paint();
      if (isMoving) drawing = setTimeout(draw, SETTLED_MS);
      else draw();
      describe();
    }

    // The figure as a picture, in the colours of print: a data address.
    async function image(format) {
      await Figure.library();
      const look = Figure.print(shown.page.palette);
      const figure = { data: flat() ? planeTraces(look, true) : spaceTraces(look), layout: { ...layout(look, true), paper_bgcolor: look.page } };
      return Plotly.toImage(figure, { format, width: plot.clientWidth, height: plot.clientHeight, scale: format === "png" ? 2 : 1 });
    }

    // What a CSV of the figure holds: the points within the budgets and filters.
    const listed = () => shown.rows.filter(shown.within);

    return { render, hover, image, listed };
  }

  return { view, hasWebGL };
})();
Views.front = Front;
