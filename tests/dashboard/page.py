"""The page of a study in a browser, as tests read it and point at it."""

import itertools
import shlex

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
  const plot = document.getElementById("plot");
  const box = plot.getBoundingClientRect();
  const { xaxis, yaxis } = plot._fullLayout;
  return [box.left + xaxis._offset + xaxis.d2p(x), box.top + yaxis._offset + yaxis.d2p(y)];
}"""


CLOUD = """([x, y]) => {
  const { xaxis, yaxis } = document.getElementById("plot")._fullLayout;
  const brush = document.getElementById("cloud").getContext("2d");
  return [...brush.getImageData(xaxis._offset + xaxis.d2p(x), yaxis._offset + yaxis.d2p(y), 1, 1).data];
}"""


READY = "document.querySelector('#plot')?.data || !document.querySelector('#state').hidden"

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

    def traces(self):
        return self.tab.evaluate(
            "document.getElementById('plot').data"
            ".map((t) => ({type: t.type, mode: t.mode, x: t.x, y: t.y, bars: t.error_y?.array,"
            " symbol: t.marker?.symbol}))"
        )

    def marked(self, symbol):
        """Return where a mark is drawn, x first."""
        found = [trace for trace in self.traces() if trace["symbol"] == symbol]
        return [(trace["x"][0], trace["y"][0]) for trace in found]

    def cloud(self, x, y):
        """Return the colour that the canvas has at a value: red, green, blue and how opaque."""
        return self.tab.evaluate(CLOUD, [x, y])

    def point_at(self, x, y):
        """Move the pointer to a value of the plane."""
        self.tab.locator("#plot").scroll_into_view_if_needed()
        left, top = self.tab.evaluate(SPOT, [x, y])
        self.tab.mouse.move(left, top)
        return left, top

    def saved(self, section, form):
        """Return the name and the content of a figure that was saved as `form`, of rows for 'csv'."""
        with self.tab.expect_download() as started:
            self.tab.click(f"{section} .save button:text-is('{form.upper()}')")
        return started.value.suggested_filename, started.value.path().read_bytes()

    def budgets(self):
        """Return the conditions of the command that exports the pick."""
        words = shlex.split(self.tab.text_content("#command"))
        return [word for flag, word in itertools.pairwise(words) if flag == "--budget"]

    def fits(self):
        """Return whether the page holds no more than its width."""
        return self.tab.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0

    def is_clean(self):
        """Return whether nothing of a study ran, or became a link or a picture."""
        found = self.tab.locator("img, main a[href], main svg[onload]").count()
        return self.tab.evaluate("window.hacked") is None and found == 0
