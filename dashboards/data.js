"use strict";
// What a page was given: as JSON from a server, which packs what it sends, or packed in a file.
const Data = (() => {
  // The JSON of gzipped text that was written in base64.
  async function unpacked(text) {
    const letters = atob(text);
    const bytes = new Uint8Array(letters.length);
    for (let k = 0; k < bytes.length; k += 1) bytes[k] = letters.charCodeAt(k);
    return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).json();
  }

  // What is wrong, in place of a page that cannot be shown.
  function showError(text) {
    document.querySelector("main").replaceChildren(Dom.element("p", { className: "note", role: "alert", textContent: text }));
  }

  async function read() {
    const { type, textContent } = document.getElementById("data");
    try {
      return type === "application/json" ? JSON.parse(textContent) : await unpacked(textContent);
    } catch (error) {
      showError(typeof DecompressionStream === "undefined"
        ? "This browser cannot decompress the page. Use Chrome or Edge 80, Firefox 113, Safari 16.4, or a later version."
        : "The data of this page cannot be read; the file may be truncated. Write or copy it again.");
      throw error;
    }
  }

  // The least and the largest of some numbers.
  const ends = (values) => values.reduce(([low, high], v) => [Math.min(low, v), Math.max(high, v)], [Infinity, -Infinity]);

  return { read, unpacked, ends };
})();
