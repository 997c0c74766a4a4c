"""The parallel coordinates in a real browser: a brush is a limit or a filter, a line is a design."""

import numpy as np
import pandas as pd

from dse.show.dashboard.definition import Definition
from tests.page_data import points
from tests.show.dashboard.designs import hash_of

AXIS_BOX = """(k) => {
  const box = document.querySelectorAll("#view-parallel .ticks")[k].getBoundingClientRect();
  return [box.left, box.top, box.height];
}"""

# How opaque a canvas is at a place, within a pixel of it.
INK = """([canvas, x, y]) => {
  const node = document.querySelectorAll("#view-parallel canvas")[canvas];
  const { left, top } = node.getBoundingClientRect();
  const { data } = node.getContext("2d").getImageData(x - left - 1, y - top - 1, 3, 3);
  return Math.max(...data.filter((_, k) => k % 4 === 3));
}"""


class View:
    """The parallel coordinates of an opened page."""

    def __init__(self, page):
        self.page, self.tab = page, page.tab
        self.tab.wait_for_selector("#view-parallel .axis")
        self.tab.evaluate("document.querySelector('#view-parallel').scrollIntoView({block: 'center'})")

    def names(self):
        return self.tab.locator("#view-parallel .name").all_text_contents()

    def ticks(self, k):
        return self.tab.locator("#view-parallel .ticks").nth(k).locator("span").all_text_contents()

    def spot(self, k, share):
        """Return where a share of the k-th axis lies in the window."""
        left, top, height = self.tab.evaluate(AXIS_BOX, k)
        return left, top + (1 - share) * height

    def ink(self, canvas, at):
        """Return the opacity at a place of a canvas: 0 all lines, 1 the front, 2 what is marked."""
        return self.tab.evaluate(INK, [canvas, *at])

    def brush(self, k, *shares):
        """Drag along an axis from a share to another; a single one is a click."""
        self.tab.mouse.move(*self.spot(k, shares[0]))
        self.tab.mouse.down()
        self.tab.mouse.move(*self.spot(k, shares[-1]), steps=3)
        self.tab.mouse.up()


def test_a_brush_is_a_limit_or_a_filter_of_its_column(opened):
    page = opened(points(**{"model.kind": ["snn", "knn", "elm", "snn", "elm"]}), "show=all&expert=1")
    view = View(page)
    assert view.names() == ["↑ accuracy", "↓ energy (µJ)", "↓ weights", "model.hidden", "model.kind", "φ"]
    view.brush(1, 0.02, 0.5)
    page.tab.wait_for_function("location.hash.includes('b.energy_uj')")
    assert 26 < float(hash_of(page)["b.energy_uj"]) < 29
    assert page.tab.input_value("#budget-1") == hash_of(page)["b.energy_uj"]
    view.brush(3, 0.2, 0.7)
    page.tab.wait_for_function("location.hash.includes('f.model.hidden')")
    low, high = map(float, hash_of(page)["f.model.hidden"].split("~"))
    assert 30 < low < 40 and 70 < high < 80
    assert (
        page.tab.input_value("[aria-label='model.hidden from']")
        == hash_of(page)["f.model.hidden"].split("~")[0]
    )
    assert view.tab.locator("#view-parallel .kept").filter(visible=True).count() == 2
    view.brush(3, 0.5)
    page.tab.wait_for_function("!location.hash.includes('f.model.hidden')")  # a click keeps all
    view.brush(4, 0.02, 0.4)
    page.tab.wait_for_function("location.hash.includes('f.model.kind')")
    assert hash_of(page)["f.model.kind"] == "in:elm"


def test_missing_and_unordered_values_have_their_places_and_a_row_marks_its_line(opened):
    kinds = {"model.kind": ["snn", "knn", None, "snn", "elm"], "model.bias": [True, False, True, False, True]}
    frame = points(**kinds, n_weights=7).assign(fits=[None] * 5)
    frame.loc[4, "energy_uj"] = np.nan
    axes = ("n_weights", "energy_uj", "model.kind", "model.bias", "accuracy")
    page = opened(frame, "show=all", definition=Definition(parallel=axes))
    view = View(page)
    assert view.names() == ["↓ weights", "↓ energy (µJ)", "model.kind", "model.bias", "↑ accuracy"]
    assert view.ticks(0) == ["7"] and view.ticks(1)[-1] == "none"
    assert view.ticks(2) == ["elm", "knn", "snn", "none"] and len(view.ticks(3)) == 2
    (x, y), (x_next, y_next) = view.spot(0, 0.5), view.spot(1, 0.0)
    middle = (x + x_next) / 2, (y + y_next) / 2
    assert view.ink(1, middle) > 100 and view.ink(2, middle) == 0
    page.tab.dispatch_event("#front tr[data-key='3'] td", "pointerover")  # a mouse would scroll the page
    assert view.ink(2, middle) == 255


def test_a_crowd_is_thinned_and_a_phone_scrolls(opened):
    n = 5000
    rng = np.random.default_rng(0)
    quality = rng.random(n)
    columns = {"accuracy": np.round(quality, 3), "energy_uj": np.exp(3 * quality + rng.random(n))}
    page = opened(
        pd.DataFrame({"trial": np.arange(n), **columns, "n_weights": rng.integers(1000, 2000, n)}), "show=all"
    )
    view = View(page)
    drawn, whole = page.tab.inner_text("#view-parallel h2 small").replace("\u202f", "").split(" of ")
    assert 2000 < int(drawn) < 2600 and whole == "5000 lines"
    page.tab.set_viewport_size({"width": 390, "height": 844})
    assert page.fits()
    lefts = [view.tab.evaluate(AXIS_BOX, k)[0] for k in range(3)]
    assert min(np.diff(lefts)) >= 72
