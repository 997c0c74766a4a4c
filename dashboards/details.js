"use strict";
// What a page knows of one trial beyond its points: carried by the page, or asked of its server.
const Details = (() => {
  const kept = new Map();
  const lost = new Set(); // trials that were asked for in vain
  let columns; // of the page that they belong to: live.js keeps the same object while no point changes

  // The token of a server on the network is part of the page's address.
  function address(route, fields) {
    const query = new URLSearchParams(location.search);
    for (const [name, value] of Object.entries(fields)) query.set(name, value);
    return `${route}?${query}`;
  }

  async function asked(trial) {
    const answer = await fetch(address("design.json", { trial }), { cache: "no-store" });
    return answer.ok ? answer.json() : null;
  }

  const isServed = (page) => page.tags !== undefined;

  // Resolves to the document of a trial, or to null where there is none.
  function of(page, trial) {
    if (page.columns !== columns) kept.clear();
    columns = page.columns;
    const key = String(trial);
    if (!kept.has(key)) {
      const carried = page.details?.[key];
      lost.delete(key);
      kept.set(key, (isServed(page) ? asked(key) : carried ? Data.unpacked(carried) : Promise.resolve(null)).catch(() => {
        kept.delete(key); // a lost connection may come back
        lost.add(key);
        return null;
      }));
    }
    return kept.get(key);
  }

  // Why a trial has no document, in a sentence.
  function absent(page, trial) {
    if (lost.has(String(trial))) return isServed(page) ? "The connection was lost before the details of this design arrived." : "The details of this design cannot be read.";
    return isServed(page) ? "Nothing was recorded." : "This file does not contain the details of this design.";
  }

  return { of, absent, isServed, address };
})();
