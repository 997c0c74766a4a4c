"""Pictures of README.md and of the documents: parts of the page of results/example, as a browser draws them.

    python -m benchmarks.picture

A picture holds, as text, what the page said when it was drawn; a test compares that with the page of today.
"""

import json
import os
import shutil
import struct
import tempfile
import zlib
from pathlib import Path
from typing import NamedTuple

from dse.show.dashboard.study import write_page
from dse.study import results

ROOT = Path(__file__).resolve().parent.parent
SIZE = 1440, 900
_KEY = b"Description\0"


class Picture(NamedTuple):
    """A part of the page: the tab in which it is, and what is there once it has been drawn; '': all of it."""

    path: Path
    tab: str = "choose"
    part: str = ""
    drawn: str = "#plot [role=img]"


PICTURES = (
    Picture(ROOT / "results" / "page.png"),
    Picture(ROOT / "docs" / "pictures" / "chips.png", "chips", "[data-view=chips]", "td"),
    Picture(ROOT / "docs" / "pictures" / "matters.png", "matters", "[data-view=price]", "svg"),
    Picture(ROOT / "docs" / "pictures" / "inside.png", "inside", "[data-view=design]", ".main-svg .ytick"),
)
_FIRST = """() => ({
  sentence: document.getElementById("sentence").textContent,
  cards: [...document.querySelectorAll("#cards article")].map((card) => card.textContent),
  tabs: [...document.querySelectorAll("#tabs button")].map((tab) => tab.textContent),
  chart: document.querySelector("#plot [role=img]").getAttribute("aria-label"),
})"""
_PART = """(part) => ({
  text: part.innerText,
  charts: [...part.querySelectorAll("[role=img]")].map((chart) => chart.getAttribute("aria-label")),
})"""


def opened(tab, folder):
    """Write the page of results/example into a folder, and open it."""
    path = write_page(results.open(ROOT / "results" / "example"), Path(folder) / "page.html")
    tab.set_viewport_size({"width": SIZE[0], "height": SIZE[1]})
    tab.goto(path.as_uri())
    tab.wait_for_function("document.querySelector('#plot')?.drawn")


def shown(tab, picture):
    """Show what a picture is of; return its place in the page, and what it says."""
    tab.locator(f"#show-{picture.tab}").click()
    tab.locator(f"{picture.part} {picture.drawn}").first.wait_for(state="attached")
    if not picture.part:
        tab.evaluate("scrollTo(0, 0)")
        return tab, tab.evaluate(_FIRST)
    part = tab.locator(picture.part)
    return part, part.evaluate(_PART)


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
        opened(tab, folder)
        for picture in PICTURES:
            place, said = shown(tab, picture)
            picture.path.parent.mkdir(exist_ok=True)
            picture.path.write_bytes(with_text(place.screenshot(), json.dumps(said, sort_keys=True)))
            print(picture.path)


if __name__ == "__main__":
    main()
