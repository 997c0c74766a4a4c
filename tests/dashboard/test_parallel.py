"""The parallel coordinates in a real browser: a brush is a budget, a line is a design."""

import struct
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest

from dse.dashboard.definition import Definition
from dse.figures.labels import OKABE_ITO_LIGHT
from tests.page_data import ACCURACY, ENERGY, OBJECTIVES, points
from tests.waiting import until

AXES = ["↑ accuracy", "↓ energy (µJ)", "↓ weights", "model.hidden", "φ"]
SVG = "{http://www.w3.org/2000/svg}"
SLIDERS = {"accuracy": "#slider-0", "energy_uj": "#slider-1", "n_weights": "#slider-2"}

AXIS_BOX = """(k) => {
  const box = document.querySelectorAll("#parallel .ticks")[k].getBoundingClientRect();
  return [box.left, box.top, box.height];
}"""

# How opaque a canvas is at a place, within a pixel of it.
INK = """([canvas, x, y]) => {
  const node = document.querySelector(`#parallel canvas.${canvas}`);
  const { left, top } = node.getBoundingClientRect();
  const { data } = node.getContext("2d").getImageData(x - left - 1, y - top - 1, 3, 3);
  return Math.max(...data.filter((_, k) => k % 4 === 3));
}"""


class View:
    """The parallel coordinates of an opened page."""

    def __init__(self, page):
        self.page, self.tab = page, page.tab

    def again(self):
        """Open the page anew with its own link, once that tells of the last budget."""
        self.tab.wait_for_timeout(150)
        self.page.open(self.page.link())
        return self.in_sight()

    def in_sight(self):
        self.tab.wait_for_selector("#parallel .axis")
        self.tab.evaluate("document.querySelector('#parallel').scrollIntoView({block: 'center'})")
        return self

    def handle(self, column):
        return self.tab.locator(f'#parallel .handle[data-column="{column}"]')

    def names(self):
        return self.tab.locator("#parallel .name").all_text_contents()

    def ticks(self, k):
        return self.tab.locator("#parallel .ticks").nth(k).locator("span").all_text_contents()

    def spot(self, k, share):
        """Return where a share of the k-th axis lies in the window."""
        left, top, height = self.tab.evaluate(AXIS_BOX, k)
        return left, top + (1 - share) * height

    def between(self, k, first, second):
        """Return the middle of a line from a share of the k-th axis to one of the next."""
        (x, y), (x_next, y_next) = self.spot(k, first), self.spot(k + 1, second)
        return (x + x_next) / 2, (y + y_next) / 2

    def ink(self, canvas, at):
        return self.tab.evaluate(INK, [canvas, *at])

    def brush(self, column, share):
        """Drag a handle to a share of its axis."""
        box = self.handle(column).bounding_box()
        k = list(OBJECTIVES).index(column)
        self.tab.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        self.tab.mouse.down()
        x, y = self.spot(k, share)
        self.tab.mouse.move(x, (y + box["y"]) / 2, steps=3)
        self.tab.mouse.move(x, y, steps=3)
        self.tab.mouse.up()

    def budget(self, column):
        """Return the text of a budget, which its slider, its box and its brush share."""
        low, high = RANGES[column]
        box, brush, apart = self.tab.evaluate(
            """([slider, column, range, way]) => {
              const at = document.querySelector(slider);
              const box = document.querySelector(slider.replace("slider", "budget")).value;
              const rail = document.querySelector(`#parallel .handle[data-column=${column}]`).parentNode;
              const apart = Math.abs(Number(at.value) - Budgets.scale(range, way).step(box));
              return [box, rail.querySelector(".limit").textContent.slice(2), apart];
            }""",
            [SLIDERS[column], column, [low, high], OBJECTIVES[column]],
        )
        assert box == brush
        assert apart == 0
        return box

    def tally(self):
        feasible, front = (self.tab.inner_text(at) for at in ("#feasible", "#n-front"))
        return int(feasible.split()[0]), int(front.split()[0])

    def picture(self):
        return ElementTree.fromstring(self.page.saved("#parallel", "svg")[1])


RANGES = {
    column: (float(points()[column].min()), float(points()[column].max()))
    for column in ("accuracy", "energy_uj", "n_weights")
}


def share(column, value):
    low, high = RANGES[column]
    return (value - low) / (high - low)


@pytest.fixture
def seen(opened):
    """Return a function that opens the parallel coordinates of a table's page."""

    def open_view(frame, fragment="", **options):
        return View(opened(frame, fragment, **options)).in_sight()

    return open_view


def test_a_brush_is_the_budget_of_its_slider_and_box(seen):
    view = seen(points())
    assert view.names() == AXES
    view.brush("energy_uj", 0.5)
    assert 26 < float(view.budget("energy_uj")) < 29
    assert view.tally() == (3, 3)
    view.brush("accuracy", 0.9)
    limit = view.budget("accuracy")
    assert 0.9 < float(limit) < 0.95 and view.tally() == (0, 0)  # the handle is a few pixels wide
    view.brush("energy_uj", 1.2)
    assert view.budget("energy_uj") == "" and view.tally() == (1, 1)
    view.again()
    assert view.budget("accuracy") == limit
    view.tab.click("#clear")
    view.tab.fill("#budget-1", "21")
    handle, energy = view.handle("energy_uj"), share("energy_uj", 21)
    box = handle.bounding_box()
    assert box["y"] + box["height"] / 2 == pytest.approx(view.spot(1, energy)[1], abs=1)
    assert handle.get_attribute("aria-valuetext") == "at most 21 µJ"
    outside = view.tab.locator("#parallel .outside").nth(1)
    assert outside.bounding_box()["height"] == pytest.approx(240 * (1 - energy), abs=1)
    view.tab.focus("#slider-1")
    view.tab.keyboard.press("End")
    assert handle.get_attribute("aria-valuetext") == "no limit" and outside.bounding_box()["height"] == 0
    words = view.tab.locator("#parallel canvas.lines")
    for limit, caption, said in (
        ("", "4 on the", ("4 of 5 designs on the front", "energy (µJ) 5 to 50")),
        ("1", "Nothing is within the budgets", ("nothing is within the budgets",)),
    ):
        view.tab.fill("#budget-1", limit)
        view.tab.wait_for_function(
            f"document.querySelector('#parallel .caption').textContent.includes('{caption}')"
        )
        assert all(text in words.get_attribute("aria-label") for text in said)


def test_every_brush_moves_by_keyboard_as_its_slider_does(seen):
    view = seen(points())
    for column, way in OBJECTIVES.items():
        handle, cost = view.handle(column), way == "min"
        step = (RANGES[column][1] - RANGES[column][0]) / 200
        assert handle.get_attribute("role") == "slider"
        handle.focus()
        keys = ("ArrowDown", "PageDown", "Home", "End") if cost else ("ArrowUp", "PageUp", "End", "Home")
        tighter, page, tightest, loosest = keys
        limits = []
        for key in (tighter, tighter, page, tighter):
            view.tab.keyboard.press(key)
            limits.append(float(view.budget(column)))
        assert limits == sorted(set(limits), reverse=cost)
        assert abs(limits[-1] - RANGES[column][1 if cost else 0]) == pytest.approx(13 * step, abs=step)
        view.tab.keyboard.press(tightest)
        assert float(view.budget(column)) == pytest.approx(RANGES[column][0 if cost else 1], abs=step)
        view.tab.keyboard.press(loosest)
        assert view.budget(column) == ""
        assert view.tab.evaluate("document.activeElement.dataset.column") == column


def test_lines_are_pointed_at_and_chosen_and_a_drag_chooses_none(seen):
    view = seen(points(point=range(5)))
    third, first = (
        view.between(0, share("accuracy", ACCURACY[k]), share("energy_uj", ENERGY[k])) for k in (3, 0)
    )
    view.tab.mouse.move(*third)
    assert view.tab.get_attribute("#front tr.pointed", "data-key") == "3.3"
    values = view.tab.locator("#parallel .value")
    assert values.all_text_contents() == ["0.6", "5", "20\u202f000", "25", "6"]
    view.tab.hover("#parallel h2")
    assert view.tab.locator("#front tr.pointed").count() == 0 and not values.first.is_visible()
    assert view.ink("marks", first) == 0
    view.tab.hover("#front tbody tr[data-key='0.0']")
    assert view.ink("marks", first) == 255 and values.nth(1).text_content() == "50"
    view.in_sight().tab.mouse.click(*third)
    assert "Trial 3" in view.tab.inner_text("#design h2") and view.ink("marks", third) == 255
    view.brush("energy_uj", 0.02)
    assert "Trial 3" in view.tab.inner_text("#design h2")
    view.again()
    assert view.ink("marks", third) == 255
    # A link to a point that the page does not hold draws no line.
    view.page.open("chosen=77.3&compare=78.1,0.0")
    assert view.in_sight().ink("marks", first) == 255
    assert len(view.picture().findall(f".//{SVG}path[@stroke-dasharray]")) == 1


def test_missing_constant_and_unordered_values_have_their_places(seen):
    frame = points(
        **{
            "model.kind": ["snn", "knn", None, "snn", "elm"],
            "model.bias": [True, False, True, False, True],
            "n_weights": 7,
        }
    )
    frame.loc[4, "energy_uj"] = np.nan
    axes = ("n_weights", "energy_uj", "model.kind", "model.bias", "fits")
    view = seen(frame.assign(fits=[None] * 5), definition=Definition(parallel=axes))
    assert view.names() == ["↓ weights", "↓ energy (µJ)", "model.kind", "model.bias", "fits"]
    assert view.ticks(0) == ["7"]
    assert view.ticks(1)[-1] == "none"
    assert view.ticks(2) == ["elm", "knn", "snn", "none"]
    assert view.ticks(3) == ["no", "yes"]
    assert view.ticks(4) == ["none"]
    assert not view.handle("n_weights").is_visible()
    assert view.ink("lines", view.between(0, 0.5, 1.0)) > 100
    assert view.ink("lines", view.between(0, 0.5, -0.1)) > 0  # the missing energy, below its axis
    assert view.ink("lines", view.between(2, 0.0, 1.0)) > 0


@pytest.mark.parametrize(("frame", "axes"), [(points().iloc[:1], 3), (points(), 1)])
def test_one_design_and_one_axis_are_drawn(seen, frame, axes):
    view = seen(frame, definition=Definition(parallel=("accuracy",)) if axes == 1 else None)
    assert len(view.names()) == axes
    counted = "1 axis" if axes == 1 else f"{axes} axes"
    assert f"{counted}, {len(frame)} of {len(frame)} lines drawn" in view.tab.inner_text("#parallel h2")
    x, y = view.spot(0, 0.5 if len(frame) == 1 else 1.0)
    assert view.ink("lines", (x + 4, y)) > 100


def test_logarithms_and_the_direction_of_a_column_that_spans_decades(seen):
    view = seen(points(energy_uj=[1000.0, 10.0, 100.0, 1.0, 500.0]))
    assert view.ticks(1) == ["1", "10", "100", "500", "1\u202f000"]
    view.tab.fill("#budget-1", "100")

    def handle_is_at_two_thirds():
        handle = view.handle("energy_uj").bounding_box()
        return abs(handle["y"] + handle["height"] / 2 - view.spot(1, 2 / 3)[1]) <= 1

    until(handle_is_at_two_thirds, "the page to be laid out")
    assert view.tab.locator("#parallel .name").nth(1).get_attribute("title") == "energy_uj: less is better"


def test_lines_that_meet_on_a_grid_lie_side_by_side_in_the_order_of_the_first_objective(seen):
    view = seen(points(**{"model.hidden": [20, 20, 20, 50, 50]}))
    lines = [line.get("points").split() for line in view.picture().iter(f"{SVG}polyline")]
    heights = sorted((float(line[0].split(",")[1]), float(line[3].split(",")[1])) for line in lines)
    of_20 = [height for _, height in heights if height > 200]  # by accuracy, the best first
    assert of_20 == [288.0, 296.0, 304.0]


def test_a_crowd_is_thinned_and_the_front_is_whole(seen):
    n = 5000
    rng = np.random.default_rng(0)
    quality = rng.random(n)
    frame = pd.DataFrame(
        {
            "trial": np.arange(n),
            "task": rng.choice(["texture", "velocity"], n),
            "accuracy": np.round(quality, 3),
            "energy_uj": np.exp(3 * quality + rng.random(n)),
            "n_weights": rng.integers(1000, 2000, n),
        }
    )
    view = seen(frame)
    front = view.tally()[1]
    assert f"{2000 + front:,}".replace(",", "\u202f") in view.tab.inner_text("#parallel h2")
    assert f"Strong: {front} on the front" in view.tab.inner_text("#parallel .caption")
    picture = view.picture()
    groups = picture.findall(f"{SVG}g")
    drawn = {kind: [g for g in groups if g.get("class") == kind] for kind in ("front", "dominated")}
    assert [len(groups), len(drawn["front"])] == [5, 2]
    assert sum(len(group) for group in drawn["front"]) == front
    assert sum(len(group) for group in drawn["dominated"]) == pytest.approx(2000, abs=1)
    assert {group.get("stroke") for group in drawn["front"]} == set(OKABE_ITO_LIGHT[:2])
    view.tab.select_option("#task", "velocity")
    (only,) = view.picture().findall(f"{SVG}g[@class='front']")
    assert only.get("stroke") == OKABE_ITO_LIGHT[list(frame["task"].unique()).index("velocity")]


def test_a_saved_picture_has_every_drawn_line_and_its_limits_and_a_phone_scrolls(seen):
    view = seen(points(), fragment="b.energy_uj=25&chosen=1")
    picture = view.picture()
    assert len(picture.findall(f".//{SVG}polyline")) == 5
    counts = {group.get("class"): len(group) for group in picture.findall(f"{SVG}g")}
    assert counts == {"outside": 2, "dominated": 0, "front": 3}
    words = [text.text for text in picture.iter(f"{SVG}text")]
    assert {"↑ accuracy", "↓ weights", "φ", "chosen", "pick"} <= set(words)
    assert "3 of 5 designs on the front" in picture.find(f"{SVG}title").text
    png = view.page.saved("#parallel", "png")[1]
    assert png.startswith(b"\x89PNG")
    assert struct.unpack(">II", png[16:24]) == (2 * int(picture.get("width")), 2 * int(picture.get("height")))
    view.tab.set_viewport_size({"width": 390, "height": 844})
    scrolls = (
        "(() => { const node = document.querySelector('#parallel .scroll');"
        " return (node.scrollWidth > node.clientWidth) === (node.clientWidth < 500); })()"
    )
    view.tab.wait_for_function(scrolls)
    assert view.page.fits()
    lefts = [view.tab.evaluate(AXIS_BOX, k)[0] for k in range(5)]
    assert min(np.diff(lefts)) >= 72
    view.tab.set_viewport_size({"width": 1280, "height": 720})
    view.tab.wait_for_function(scrolls)
