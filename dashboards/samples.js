"use strict";
// Samples of a reader: rows of numbers, one of each sensor, from text that comes in pieces, of a file or of a serial port.
const Samples = (() => {
  const MOST_ROWS = 100000; // of a file
  const LONGEST = 65536; // characters of a line
  const WHOLE_BELOW = 2 ** 24; // in magnitude
  const MOST_SHOWN = 24; // characters of what was found

  async function* lines(stream, signal) {
    const [reader, decoder] = [stream.getReader(), new TextDecoder()];
    const cancel = () => reader.cancel().catch(() => {}); // it may be lost already
    signal?.addEventListener("abort", cancel);
    let [rest, isDone] = ["", false];
    try {
      while (!isDone) {
        const { value, done } = await reader.read();
        if (signal?.aborted) return;
        const found = (rest + decoder.decode(value, { stream: !done })).split("\n");
        if (found.some((line) => line.length > LONGEST)) throw new Error(`a line of more than ${Data.many(LONGEST)} characters found, a sample expected`);
        isDone = done;
        rest = done ? "" : found.pop();
        yield* found;
      }
    } finally {
      await cancel();
      reader.releaseLock();
    }
  }

  function rowOf(line, number, { n, whole }) {
    const cells = line.replace(/[,;]?\s*$/, "").trim().split(/\s*[,;]\s*|\s+/);
    if (cells.length !== n) throw new Error(`line ${number}: ${Data.plural(cells.length, "value")} found, ${Data.many(n)} expected, one of each sensor`);
    const fits = (value) => (whole ? Number.isInteger(value) && Math.abs(value) < WHOLE_BELOW : Number.isFinite(Math.fround(value)));
    const wrong = cells.find((cell) => cell === "" || !fits(Number(cell)));
    if (wrong !== undefined) throw new Error(`line ${number}: “${wrong.slice(0, MOST_SHOWN)}” found, a ${whole ? "whole number below 2^24" : "finite number"} expected`);
    return Float32Array.from(cells, Number);
  }

  // Rows, and null for a blank line, which ends a recording. A first line of words is skipped, and any of a port, which may have begun before.
  async function* rows(stream, samples, signal = null) {
    let number = 0;
    for await (const line of lines(stream, signal)) {
      number += 1;
      if (line.trim() === "") yield null;
      else if (number > 1 || (signal === null && /^\s*[-+.\d]/.test(line))) yield rowOf(line, number, samples);
    }
  }

  // What is played: a recording without an answer, to which rows are added; `ends` are its least and largest value.
  const recording = (name) => ({ name, true: -1, steps: [], ends: [], isOwn: true });
  function add({ ends, steps }, row) {
    ends.splice(0, 2, ...Data.ends([...ends, ...row]));
    steps.push(row);
  }

  // The recordings of a file, and what is left of it where it has more rows than are played.
  async function ofFile(file, samples) {
    const found = [recording(file.name)];
    let n = 0;
    for await (const row of rows(file.stream(), samples)) {
      if (row === null && found.at(-1).steps.length) found.push(recording(`${file.name} ${found.length + 1}`));
      if (row === null) continue;
      if (n === MOST_ROWS) return { found, left: `Of ${file.name} the first ${Data.many(MOST_ROWS)} rows are played.` };
      add(found.at(-1), row);
      n += 1;
    }
    if (!n) throw new Error("no row of numbers found");
    return { found: found.filter(({ steps }) => steps.length), left: "" };
  }

  return { rows, recording, add, ofFile };
})();
