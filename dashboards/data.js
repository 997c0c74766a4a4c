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

  async function read() {
    const { type, textContent } = document.getElementById("data");
    return type === "application/json" ? JSON.parse(textContent) : unpacked(textContent);
  }

  return { read, unpacked };
})();
