"use strict";
// What a page knows of one trial beyond its points: carried by the page, or requested from its server.
const Details = (() => {
  const documentsOf = Data.remembering(() => new Map()); // by the columns of a page: live.js keeps them while no point changes

  // The token of a server on the network is part of the page's address.
  const address = (route, fields) => `${route}?${new URLSearchParams({ ...Object.fromEntries(new URLSearchParams(location.search)), ...fields })}`;

  // What a server tells, or in words `why` it does not.
  async function ask(route, fields) {
    try {
      const answer = await fetch(address(route, fields), { cache: "no-store" });
      return answer.ok ? await answer.json() : { why: await answer.text() };
    } catch {
      return { why: "The connection was lost." };
    }
  }

  const isServed = (page) => page.tags !== undefined;

  // Resolves to the document of a trial, or to null where a file has none; `why` it has none is asked for again.
  function of(page, trial) {
    const documents = documentsOf(page.columns);
    const key = String(trial);
    const carried = page.details?.[key];
    if (!documents.has(key)) {
      documents.set(key, isServed(page) ? ask("design.json", { trial }) : carried ? Data.unpacked(carried).catch(() => ({ why: "The details of this design cannot be read." })) : Promise.resolve(null));
      documents.get(key).then((found) => { if (found?.why) documents.delete(key); });
    }
    return documents.get(key);
  }

  return { of, ask, isServed, address };
})();
