"use strict";
// A served page asks its server every few seconds for the data that changed, and hands the whole page on as
// event "live". Nothing here knows what a page holds.
(async () => {
  const EVERY_MS = 2000;
  const PATIENCE_MS = 60000;
  let page = await Data.read();
  let updated = new Date();
  const line = Dom.element("p", { id: "live", role: "status" });
  document.querySelector("header").append(line);

  function setStatus(text, kind) {
    if (line.textContent !== text) line.textContent = text;
    line.className = kind;
  }

  // A part of the page and its tag, or null where it is as before.
  async function part(name) {
    const headers = { "If-None-Match": page.tags[name] };
    const answer = await fetch(Details.address(name, {}), { headers, cache: "no-store", signal: AbortSignal.timeout(PATIENCE_MS) });
    if (answer.status === 304) return null;
    if (!answer.ok) throw new Error(`the server answered ${answer.status}`);
    return { ...await answer.json(), tags: { [name]: answer.headers.get("ETag") } };
  }

  async function ask() {
    try {
      const parts = (await Promise.all(Object.keys(page.tags).map(part))).filter((one) => one !== null);
      for (const one of parts) page = { ...page, ...one, tags: { ...page.tags, ...one.tags } };
      // Once a connection is back, what was asked for meanwhile can be asked for again.
      if (parts.length || line.className === "note") dispatchEvent(new CustomEvent("live", { detail: page }));
      updated = new Date();
      setStatus("", "");
    } catch {
      setStatus(`Connection lost. The page shows the study as of ${updated.toLocaleTimeString()}; it keeps trying to reconnect.`, "note");
    }
    setTimeout(ask, EVERY_MS);
  }

  setTimeout(ask, EVERY_MS);
})();
