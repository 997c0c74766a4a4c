"""The picture of README.md: the first screen of the page of results/example, as a browser draws it.

    python -m benchmarks.picture

The picture holds, as text, what the page said when it was drawn; a test compares that with the page of today.
"""

import json
import os
import shutil
import struct
import tempfile
import zlib
from pathlib import Path

from dse.dashboard.study import write_page
from dse.study import results

ROOT = Path(__file__).resolve().parent.parent
PICTURE = ROOT / "results" / "page.png"
SIZE = 1440, 900
_KEY = b"Description\0"
_READY = "document.querySelector('#plot')?.drawn"
_STRUCTURE = """() => ({
  sentence: document.getElementById("sentence").textContent,
  cards: [...document.querySelectorAll("#cards article")].map((card) => card.textContent),
  tabs: [...document.querySelectorAll("#tabs button")].map((tab) => tab.textContent),
  chart: document.querySelector("#plot [role=img]").getAttribute("aria-label"),
})"""


def opened(tab, folder):
    """Write the page of results/example into a folder, open it, and return what it says."""
    path = write_page(results.open(ROOT / "results" / "example"), Path(folder) / "page.html")
    tab.set_viewport_size({"width": SIZE[0], "height": SIZE[1]})
    tab.goto(path.as_uri())
    tab.wait_for_function(_READY)
    return tab.evaluate(_STRUCTURE)


def with_text(png, text):
    """Return a PNG file that holds a text before its end."""
    body = b"tEXt" + _KEY + text.encode("ascii")
    chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
    return png[:-12] + chunk + png[-12:]


def text_of(png):
    """Return the text that a PNG file holds; '' without one."""
    _, found, rest = png.rpartition(b"tEXt" + _KEY)
    return rest[: -12 - 4].decode("ascii") if found else ""


def main():
    from playwright.sync_api import sync_playwright

    names = ("chromium", "chromium-browser", "google-chrome")
    program = os.environ.get("DSE_CHROMIUM") or next(filter(None, map(shutil.which, names)))
    with sync_playwright() as driver, tempfile.TemporaryDirectory() as folder:
        tab = driver.chromium.launch(executable_path=program, args=["--no-sandbox"]).new_page()
        said = opened(tab, folder)
        PICTURE.write_bytes(with_text(tab.screenshot(), json.dumps(said, sort_keys=True)))
    print(PICTURE)


if __name__ == "__main__":
    main()
