"use strict";
// Figures that were drawn in Python, in the reader's colours; and the drawing library, started when it is needed.
const Figure = (() => {
  const turns = new WeakMap(); // the last figure asked for on each node: earlier ones are not drawn any more
  const drawings = new WeakMap(); // the last drawing of each node: a promise
  let started;
  let onPaper = false; // while the page is printed: light, whatever the reader's scheme
  for (const [event, is] of [["beforeprint", true], ["afterprint", false]]) {
    addEventListener(event, () => {
      onPaper = is;
      document.documentElement.classList.toggle("paper", is); // style.css: the page is as wide as paper before anything is drawn
    });
  }

  // The library is most of a page, so that it starts once the page's numbers have been seen.
  async function start() {
    if (!document.hidden) await new Promise(requestAnimationFrame);
    await new Promise((done) => setTimeout(done));
    document.head.append(Dom.element("script", { textContent: document.getElementById("plotly").textContent }));
  }
  const library = () => (started ??= start());

  // The reader's colours; `palette` has a list of colours for light pages and what they become on dark ones.
  function style(palette) {
    if (onPaper) return { ...print(palette), paper: true };
    const css = getComputedStyle(document.documentElement);
    const dark = matchMedia("(prefers-color-scheme: dark)").matches;
    const colours = ["text", "page", "panel", "rule", "quiet", "focus", "warn"];
    const named = Object.fromEntries(colours.map((name) => [name, css.getPropertyValue(`--${name}`).trim()]));
    return { ...named, font: css.fontFamily, dark, palette: dark ? palette.dark : palette.light, light: palette.light };
  }

  // The colours of a picture that is kept: a light page, whatever the reader's scheme.
  const print = (palette) => ({
    text: "#1b1e22", page: "#ffffff", panel: "#f5f6f7", rule: "#d5d9de", quiet: "#59616b", focus: "#0072b2", warn: "#8a4500",
    font: getComputedStyle(document.documentElement).fontFamily, dark: false, palette: palette.light, light: palette.light,
  });

  // Colours of a light page, in the reader's scheme.
  function recoloured(value, look) {
    if (Array.isArray(value)) return value.map((inner) => recoloured(inner, look));
    if (value && typeof value === "object" && !ArrayBuffer.isView(value)) {
      return Object.fromEntries(Object.entries(value).map(([key, inner]) => [key, recoloured(inner, look)]));
    }
    const index = look.dark ? look.light.indexOf(value) : -1;
    return index < 0 ? value : look.palette[index];
  }

  // Nothing of a study leaves its page: plotly would offer to upload it.
  const config = {
    responsive: true, displaylogo: false, displayModeBar: false, plotlyServerURL: "",
  };

  // Numbers on axes as in the page's words: decimals, with a narrow space between thousands.
  const NOTATION = { exponentformat: "none", separatethousands: true };

  // What every figure of a page has in common.
  const face = (look, narrow) => ({
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: { family: look.font, size: narrow ? 11 : 12, color: look.text },
    hovermode: "closest", separators: ".\u202f",
    hoverlabel: { align: "left", bgcolor: look.page, bordercolor: look.text, font: { color: look.text } },
  });

  // Draws {data, layout}; `overrides` returns what the page lays out otherwise. Resolves to the plot, or to null when
  // another figure was asked for on the node meanwhile.
  async function draw(node, figure, look, overrides = () => ({})) {
    const turn = {};
    turns.set(node, turn);
    await library();
    if (turns.get(node) !== turn || !node.isConnected) return null;
    const layout = recoloured(figure.layout, look);
    delete layout.title;
    for (const key of Object.keys(layout).filter((name) => /^[xy]axis\d*$/.test(name))) {
      Object.assign(layout[key], { ...NOTATION, gridcolor: look.rule, linecolor: look.rule, color: look.text, zeroline: false, automargin: true });
      layout[key].title = { ...layout[key].title, standoff: 4 };
    }
    Object.assign(layout, face(look, node.clientWidth < 480));
    Object.assign(layout, overrides(layout));
    const drawing = Plotly.react(node, recoloured(figure.data, look), layout, config);
    drawings.set(node, drawing);
    return drawing;
  }

  // Of a figure that follows the width of its panel, and the height of its node.
  const fitted = ({ margin, legend }) => ({
    autosize: true, height: undefined, width: undefined, margin: margin ?? { l: 56, r: 12, t: 28, b: 40 },
    legend: { orientation: "h", y: 1, yanchor: "bottom", x: 0, ...legend },
  });
  const heightOf = ({ layout }) => layout.height ?? 280;

  // Puts nodes where others were: plotly listens to the window for each plot until it is told that one has gone.
  // One that is still being drawn must not lose what it draws with.
  function replace(place, ...nodes) {
    const gone = [...place.querySelectorAll(".js-plotly-plot")];
    place.replaceChildren(...nodes);
    for (const plot of gone) Promise.resolve(drawings.get(plot)).finally(() => Plotly.purge(plot));
  }

  // What draws on a canvas that was emptied, in the pixels of the page.
  function brush(canvas, [width, height]) {
    const ratio = devicePixelRatio || 1;
    const [w, h] = [width, height].map((side) => Math.round(side * ratio));
    if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
    const drawing = canvas.getContext("2d");
    drawing.setTransform(ratio, 0, 0, ratio, 0, 0);
    drawing.clearRect(0, 0, width, height);
    return drawing;
  }

  // A place for a figure, with its text alternative.
  const node = (figure, height, label = "") => Dom.element("div", { className: "plot", role: "img", "aria-label": label, data: { figure }, style: { height: `${height}px` } });

  const STOPS = ["#00224e", "#123570", "#3b496c", "#575d6d", "#707173", "#8a8678", "#a59c74", "#c3b369", "#e1cc55", "#fee838"]; // Cividis
  // The colour of a share of a scale; `stops` are its colours.
  function shade(share, stops = STOPS) {
    const at = Math.min(1, Math.max(0, share)) * (stops.length - 1);
    const k = Math.min(stops.length - 2, Math.floor(at));
    const parts = [stops[k], stops[k + 1]].map((hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16)));
    return `rgb(${parts[0].map((low, i) => Math.round(low + (at - k) * (parts[1][i] - low))).join(",")})`;
  }

  // ---- planes: what is drawn over two axes (Data.axis), x and y

  const [LEFT, RIGHT, TOP, BELOW] = [64, 16, 20, 44]; // px beside the axes

  // An axis, and where its values lie on a drawing of a size.
  function placed(make, k, [width, height]) {
    const [length, foot] = [k ? height - TOP - BELOW : width - LEFT - RIGHT, height - BELOW];
    const axis = make(Math.max(2, Math.min(8, Math.floor(length / (k ? 40 : 96)))));
    const px = (share) => (k ? foot - share * length : LEFT + share * length);
    return { ...axis, to: (value) => px(axis.share(value)), from: (at) => axis.value((k ? foot - at : at - LEFT) / length) };
  }

  // The ticks and the titles of two axes.
  function frame([x, y], titles, [width, height], look) {
    const { svg } = Dom;
    const line = (d) => svg("path", { d, stroke: look.rule, "stroke-width": 1 });
    const word = (text, attributes) => svg("text", { fill: look.text, text, ...attributes });
    const ticks = (axis) => axis.ticks.filter(([value]) => axis.share(value) >= -0.001 && axis.share(value) <= 1.001);
    return [
      ...ticks(x).flatMap(([value, text]) => [line(`M${x.to(value).toFixed(1)} ${TOP}V${height - BELOW}`), word(text, { x: x.to(value), y: height - BELOW + 16,
        "text-anchor": "middle", class: "tick-x" })]),
      ...ticks(y).flatMap(([value, text]) => [line(`M${LEFT} ${y.to(value).toFixed(1)}H${width - RIGHT}`), word(text, { x: LEFT - 6, y: y.to(value) + 4, "text-anchor": "end" })]),
      word(titles[0], { x: (LEFT + width - RIGHT) / 2, y: height - 8, "text-anchor": "middle", class: "x-title" }),
      word(titles[1], { x: -(TOP + height - BELOW) / 2, y: 14, transform: "rotate(-90)", "text-anchor": "middle", class: "y-title" }),
    ];
  }

  // The path of what a front attains, through its points [x, y] in px from the cheap end.
  const stairs = (points) => points.map(([x, y], k) => (k ? `H${x.toFixed(1)}V${y.toFixed(1)}` : `M${x.toFixed(1)} ${y.toFixed(1)}`)).join("");

  // The knee and the gaps of a front (Budgets.shape): a word each, and the front is dashed where nobody tried. `spot` is where a row lies.
  function shaped({ knee, gaps }, spot, look) {
    const word = (text, x, y) => Dom.svg("text", { x, y: y - 7, "text-anchor": "middle", fill: look.text, stroke: look.page, "stroke-width": 3, "paint-order": "stroke", text });
    return [...gaps.flatMap(([from, to]) => {
      const [[left, y], [right]] = [spot(from), spot(to)];
      return [Dom.svg("path", { class: "gap", d: `M${left} ${y}H${right}`, stroke: look.page, "stroke-width": 3, "stroke-dasharray": "5 5" }), word("untried", (left + right) / 2, y)];
    }), ...(knee < 0 ? [] : [word("knee", ...spot(knee))])];
  }

  // A drawing as a picture that is kept: a data address of it, or of its pixels.
  async function saved(text, [width, height], format) {
    const address = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(text)}`;
    if (format === "svg") return address;
    const picture = new Image();
    picture.src = address;
    await picture.decode();
    const canvas = Dom.element("canvas", { width: 2 * width, height: 2 * height });
    canvas.getContext("2d").drawImage(picture, 0, 0, canvas.width, canvas.height);
    return canvas.toDataURL("image/png");
  }

  return { EDGES: [LEFT, RIGHT, TOP, BELOW], placed, frame, stairs, shaped, saved, library, style, print, recoloured, config, face, draw, fitted, heightOf, replace, brush, node, shade, STOPS, NOTATION };
})();
