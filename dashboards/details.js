"use strict";
// What a page knows of one trial beyond its points: carried by the page, or requested from its server.
const Details = (() => {
  const documents = new Map();
  const failed = new Set(); // trials whose request failed
  let columns; // of the page that they belong to: live.js keeps the same object while no point changes

  // The token of a server on the network is part of the page's address.
  function address(route, fields) {
    const query = new URLSearchParams(location.search);
    for (const [name, value] of Object.entries(fields)) query.set(name, value);
    return `${route}?${query}`;
  }

  async function request(trial) {
    const answer = await fetch(address("design.json", { trial }), { cache: "no-store" });
    return answer.ok ? answer.json() : null;
  }

  const isServed = (page) => page.tags !== undefined;

  // Resolves to the document of a trial, or to null where there is none.
  function of(page, trial) {
    if (page.columns !== columns) documents.clear();
    columns = page.columns;
    const key = String(trial);
    if (!documents.has(key)) {
      const carried = page.details?.[key];
      failed.delete(key);
      documents.set(key, (isServed(page) ? request(key) : carried ? Data.unpacked(carried) : Promise.resolve(null)).catch(() => {
        documents.delete(key); // a lost connection may come back
        failed.add(key);
        return null;
      }));
    }
    return documents.get(key);
  }

  const hasFailed = (trial) => failed.has(String(trial));

  return { of, hasFailed, isServed, address };
})();
