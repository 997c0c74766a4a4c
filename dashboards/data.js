"use strict";
// What a page was given: as JSON from a server, which packs what it sends, or packed in a file.
const Data = (() => {
  // The numbers of some kind that base64 holds.
  function array(text, Kind) {
    const letters = atob(text);
    const bytes = new Uint8Array(letters.length);
    for (let k = 0; k < bytes.length; k += 1) bytes[k] = letters.charCodeAt(k);
    return new Kind(bytes.buffer);
  }

  // The JSON of gzipped text that was written in base64.
  const unpacked = async (text) => new Response(new Blob([array(text, Uint8Array)]).stream().pipeThrough(new DecompressionStream("gzip"))).json();

  async function read() {
    const { type, textContent } = document.getElementById("data");
    try {
      return type === "application/json" ? JSON.parse(textContent) : await unpacked(textContent);
    } catch (error) {
      const textContent = typeof DecompressionStream === "undefined"
        ? "This browser cannot decompress the page. Use Chrome or Edge 80, Firefox 113, Safari 16.4, or a later version."
        : "The data of this page cannot be read; the file may be truncated. Write or copy it again.";
      document.querySelector("main").replaceChildren(Dom.element("p", { className: "note", role: "alert", textContent }));
      throw error;
    }
  }

  // The least and the largest of some numbers.
  const ends = (values) => values.reduce(([low, high], v) => [Math.min(low, v), Math.max(high, v)], [Infinity, -Infinity]);

  // More than two of them read better in logarithms.
  const spansDecades = (low, high) => low > 0 && high / low > 100;

  // A whole number, with a narrow space between thousands.
  const many = (n) => Math.round(n).toLocaleString("en").replace(/,/g, "\u202f");
  const plural = (n, word) => `${many(n)} ${word}${n === 1 ? "" : "s"}`;

  function rounds(low, high, most) {
    const rough = (high - low) / most;
    const unit = 10 ** Math.floor(Math.log10(rough));
    const step = unit * [1, 2, 5, 10].find((n) => n * unit >= rough * 0.999);
    const first = Math.ceil(low / step - 1e-9);
    return Array.from({ length: Math.floor(high / step + 1e-9) - first + 1 }, (_, k) => Number(((first + k) * step).toPrecision(12)));
  }

  function decades(low, high, most) {
    const [first, last] = [Math.ceil(Math.log10(low) - 1e-9), Math.floor(Math.log10(high) + 1e-9)];
    const step = Math.max(1, Math.ceil((last - first + 1) / most));
    const whole = Array.from({ length: Math.max(0, Math.floor((last - first) / step) + 1) }, (_, k) => Number(`1e${first + k * step}`));
    if (whole.length > 2 || step > 1) return whole;
    const between = (digits) => digits.flatMap((n) => Array.from({ length: last - first + 3 }, (_, k) => n * Number(`1e${first - 1 + k}`))).filter((value) => value >= low && value <= high).sort((a, b) => a - b);
    return [[1, 2, 5], [1, 3]].map(between).find((ticks) => ticks.length <= 1.5 * most) ?? whole;
  }

  // An axis over numbers, or over the places of `names`: where a value lies as a share of it, the value at a share, and
  // ticks [value, text], at most `most`. `room` is a share beside the outermost values.
  function axis(low, high, { log = false, names = [], number = String, most = 6, room = 0 }) {
    if (names.length) [low, high] = [-0.5, names.length - 0.5];
    const [from, to] = log ? [Math.log(low), Math.log(high)] : [low, high];
    const span = to - from || 1;
    const [start, length] = from === to ? [from - 0.5, 1] : [from - room * span, span * (1 + 2 * room)];
    const share = (value) => ((log ? Math.log(value) : value) - start) / length;
    const value = (at) => (log ? Math.exp(start + at * length) : start + at * length);
    const ticks = names.length ? names.map((name, k) => [k, name]) : (low === high ? [low] : log ? decades(value(0), value(1), most) : rounds(value(0), value(1),
      most)).map((one) => [one, number(one)]);
    return { share, value, ticks };
  }

  // A function that remembers its last answer, for as long as it is asked the same.
  const remembering = (make, of = [], made = null) => (...asked) => {
    if (asked.length !== of.length || asked.some((one, k) => one !== of[k])) [of, made] = [asked, make(...asked)];
    return made;
  };

  // Remembers the last of each kind of result, for as long as its key is the same.
  function memory() {
    const last = new Map();
    return (kind, key, make) => {
      if (!last.has(kind) || last.get(kind).key !== key) last.set(kind, { key, value: make() });
      return last.get(kind).value;
    };
  }

  return { read, remembering, memory, array, unpacked, ends, spansDecades, many, plural, axis };
})();
