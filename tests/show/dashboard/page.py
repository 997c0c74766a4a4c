"""The page of a study in a browser, as tests read it and point at it."""

import itertools
import re
import shlex
from pathlib import Path

import pytest

HOSTILE = (
    '<img src=x onerror="window.hacked=1">',
    "</script><script>window.hacked=1</script>",
    '"><svg onload=window.hacked=1>',
    "'; window.hacked=1; //",
    '<a href="javascript:window.hacked=1">click</a>',
    "%{text} ${window.hacked=1} {{script}}",
    "🦔 émoji \u202e rtl \u2028 line",
    "x" * 500,
)


SPOT = """([x, y]) => {
  const box = document.getElementById("plane").getBoundingClientRect();
  const axes = document.getElementById("plot").drawn.axes;
  return [box.left + axes[0].to(x), box.top + axes[1].to(y)];
}"""


CLOUD = """([x, y]) => {
  const { axes } = document.getElementById("plot").drawn;
  const brush = document.getElementById("cloud").getContext("2d");
  return [...brush.getImageData(Math.round(axes[0].to(x)), Math.round(axes[1].to(y)), 1, 1).data];
}"""


READY = "document.querySelector('#plot')?.drawn || !document.querySelector('#state').hidden"

SENTENCE = """() => {
  const told = (node) => node.nodeType === 3 ? node.data
    : node.matches("select") ? node.selectedOptions[0].textContent
    : node.matches("input") ? node.value || "any" : [...node.childNodes].map(told).join("");
  return told(document.getElementById("sentence"));
}"""


FOLLOW = """(fragment) => new Promise((done) => {
  addEventListener("hashchange", () => requestAnimationFrame(() => setTimeout(done)), { once: true });
  location.hash = fragment;
})"""


class Page:
    """A page opened from disk, and every complaint of the browser about it."""

    def __init__(self, tab, path):
        self.tab, self.path, self.faults = tab, path, []
        tab.on("pageerror", lambda error: self.faults.append(str(error)))
        tab.on("console", lambda line: self.faults.append(line.text) if line.type == "error" else None)
        tab.on("request", lambda request: self._requested(request.url))

    def _requested(self, url):
        if not url.startswith(("file:", "data:", "blob:")):
            self.faults.append(f"fetched {url}")

    def open(self, fragment=""):
        """Open the page, and then follow a link of it: at one address Chromium keeps what it has compiled."""
        self.tab.goto(self.path.as_uri())
        self.tab.wait_for_function(READY)
        if fragment:
            self.tab.evaluate(FOLLOW, fragment)
        return self

    def link(self):
        """Return what follows the # in the page's own link."""
        return self.tab.evaluate("location.hash.slice(1)")

    def cells(self, column):
        return self.tab.eval_on_selector_all(
            f"#front tbody tr td:nth-child({column})", "cells => cells.map((cell) => cell.textContent)"
        )

    def line(self):
        """Return the rows of the front that is drawn, from the left."""
        return self.tab.evaluate("document.getElementById('plot').drawn.line")

    def marked(self, name):
        """Return where a mark is drawn, x first."""
        found = self.tab.evaluate("document.getElementById('plot').drawn.marks")
        return [tuple(one["value"]) for one in found if one["name"] == name]

    def cloud(self, x, y):
        """Return the colour that the canvas has at a value: red, green, blue and how opaque."""
        return self.tab.evaluate(CLOUD, [x, y])

    def point_at(self, x, y):
        """Move the pointer to a value of the plane."""
        self.tab.locator("#plot").scroll_into_view_if_needed()
        left, top = self.tab.evaluate(SPOT, [x, y])
        self.tab.mouse.move(left, top)
        return left, top

    def ask(self, what):
        """Ask one of the three questions, and return what is told."""
        button = self.tab.locator(f"#asks [data-ask={what}]")
        if button.get_attribute("aria-expanded") != "true":
            button.click()
        return self.tab.inner_text("#told").replace("\u00a0", " ")

    def saved(self, name, form):
        """Return the name and the content of what was saved of a view: a picture, or rows for 'csv'."""
        self.ask("take")
        with self.tab.expect_download() as started:
            self.tab.click(f"#saves [data-saves='{name}.{form}']")
        return started.value.suggested_filename, started.value.path().read_bytes()

    def command(self):
        self.ask("take")
        return shlex.split(self.tab.text_content("#command"))

    def budgets(self):
        """Return the conditions of the command that exports the pick."""
        return [word for flag, word in itertools.pairwise(self.command()) if flag == "--budget"]

    def sentence(self):
        """Return the answer with the words that its controls have, in plain spaces."""
        text = self.tab.evaluate(SENTENCE)
        return re.sub(r"\s+", " ", text.replace("\u202f", " "))

    def cards(self):
        """Return the texts of the cards by their titles."""
        found = self.tab.locator("#cards article").all_inner_texts()
        lines = [re.sub(r"\n+", "\n", text.replace("\u202f", " ")) for text in found]
        return {title: rest for title, _, rest in (text.partition("\n") for text in lines)}

    def violations(self):
        """Return what axe-core finds: rule and nodes."""
        axe = pytest.importorskip("axe_playwright_python", reason="no axe-core")
        self.tab.evaluate((Path(axe.__file__).parent / "axe.min.js").read_text(encoding="utf-8"))
        found = self.tab.evaluate("async () => (await axe.run()).violations")
        return [(one["id"], [node["html"][:120] for node in one["nodes"]]) for one in found]

    def fits(self):
        """Return whether the page holds no more than its width."""
        return self.tab.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0

    def is_clean(self):
        """Return whether nothing of a study ran, or became a link or a picture."""
        found = self.tab.locator("img, main a[href]:not(#bundle), main svg[onload]").count()
        return self.tab.evaluate("window.hacked") is None and found == 0
