"use strict";
// A served page asks every few seconds for what changed since the version that it shows, and hands the whole
// page on as event "live". Nothing here knows what a page holds; dse/dashboard/changes.py says what a change is.
(async () => {
  const EVERY_MS = 2000;
  const PATIENCE_MS = 60000;
  let page = await Data.read();
  let heard = new Date();
  const line = document.createElement("p");
  line.id = "live";
  line.setAttribute("role", "status");
  document.querySelector("header").append(line);

  // Objects are made from entries: a column named __proto__ stays a column.
  function changed(old, change) {
    if ("set" in change) return change.set;
    if ("splice" in change) {
      const [start, removed, items] = change.splice;
      return [...old.slice(0, start), ...items, ...old.slice(start + removed)];
    }
    const parts = Object.entries(change.keys);
    const kept = Object.entries(old).filter(([key]) => !change.gone.includes(key)).map(([key, value]) =>
      [key, Object.hasOwn(change.keys, key) ? changed(value, change.keys[key]) : value]);
    const added = parts.filter(([key]) => !Object.hasOwn(old, key)).map(([key, part]) => [key, part.set]);
    return Object.fromEntries([...kept, ...added]);
  }

  // The token of a server on the network is part of the page's address.
  function address() {
    const query = new URLSearchParams(location.search);
    query.set("since", page.version);
    return `data.json?${query}`;
  }

  function say(text, kind) {
    if (line.textContent !== text) line.textContent = text;
    line.className = kind;
  }

  async function ask() {
    try {
      const answer = await fetch(address(), { cache: "no-store", signal: AbortSignal.timeout(PATIENCE_MS) });
      if (answer.status === 200) {
        const { version, change, page: whole } = await answer.json();
        page = { ...(whole ?? changed(page, change)), version };
      } else if (answer.status !== 204) {
        throw new Error(`the server answered ${answer.status}`);
      }
      // Once a connection is back, what was asked for meanwhile can be asked for again.
      if (answer.status === 200 || line.className === "note") dispatchEvent(new CustomEvent("live", { detail: page }));
      heard = new Date();
      say("live", "");
    } catch {
      say(`Connection lost. This is the study as it was at ${heard.toLocaleTimeString()}; the page goes on trying.`, "note");
    }
    setTimeout(ask, EVERY_MS);
  }

  say("live", "");
  setTimeout(ask, EVERY_MS);
})();
