"""The page in a real browser: what is drawn, what a click does, and that nothing in a study can run."""

from __future__ import annotations

import itertools
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest

from tests.dashboard.designs import table
from tests.dashboard.page import HOSTILE, SPOT
from tests.page_data import OBJECTIVES, failed, points, write_page

# Where a point lies in space is plotly's to say; what follows from pointing at it and pressing is ours.
PRESSED_IN_SPACE = """(row) => {
  const plot = document.getElementById("plot");
  plot.emit("plotly_hover", { points: [{ customdata: row }] });
  const pointed = document.querySelector("#front tr.pointed td").textContent;
  const { x, y } = plot.getBoundingClientRect();
  const at = { clientX: x + 50, clientY: y + 50, bubbles: true };
  plot.dispatchEvent(new PointerEvent("pointerdown", at));
  plot.emit("plotly_unhover", {});
  plot.dispatchEvent(new PointerEvent("pointerup", at));
  return pointed;
}"""


@pytest.fixture
def opened(shown, page_path):
    """Return a function that writes a page of a table and opens it."""

    def open_page(frame, *, name="fabric", fragment="", size=(1280, 720)):
        write_page(frame, page_path, name=name, objectives=OBJECTIVES)
        return shown(fragment, size=size)

    return open_page


def test_front_is_drawn_with_bars_and_listed(opened):
    page = opened(pd.concat([points(), failed()], ignore_index=True))
    reach, line, joined = page.traces()
    assert reach["x"] == [5, 50]
    assert page.cloud(21, 0.85)[3] > page.cloud(30, 0.88)[3] > page.cloud(30, 0.7)[3] == 0
    assert line["mode"] == "lines"
    assert joined["x"] == line["x"] == [5, 20, 50]
    assert joined["bars"] == [0.02] * 3
    assert page.cells(1) == ["0", "1", "2", "3"]
    assert page.tab.inner_text("#counts") == "5 trials · 1 failed · 5 points"
    assert page.tab.inner_text("#failures summary") == "1 failed trial"


def test_axes_change_and_the_link_restores_the_view(opened):
    page = opened(points())
    page.tab.select_option("#x", "n_weights")
    page.tab.click("#front tbody tr:nth-child(2)")
    assert page.traces()[2]["x"] == [10_000, 40_000, 90_000]
    page.open(page.link())
    assert page.tab.input_value("#x") == "n_weights"
    assert page.tab.inner_text("#design h2") == "Trial 1"


def test_design_panel_names_what_was_clicked_in_the_figure(opened):
    page = opened(points())
    page.tab.mouse.click(*page.point_at(21, 0.85))
    text = page.tab.inner_text("#design")
    assert "Trial 2" in text
    assert "on the front" in text
    assert "0.850 ± 0.02" in text
    assert "21 (16.8–31.5)\u00a0µJ" in text
    page.tab.wait_for_function(
        "document.getElementById('plot').data.some((t) => t.marker?.symbol === 'circle-open')"
    )
    assert page.marked("circle-open") == [(21, 0.85)]


def test_pointing_shows_the_design_and_marks_it_in_the_table(opened):
    page = opened(points())
    page.point_at(20, 0.9)
    page.tab.wait_for_selector("#tip", state="visible")
    text = page.tab.text_content("#tip")
    assert "model.hidden  50" in text
    assert "energy (µJ)  20" in text
    assert page.tab.inner_text("#front tr.pointed td:first-child") == "1"
    page.point_at(45, 0.65)
    page.tab.wait_for_selector("#tip", state="hidden")
    assert page.tab.locator("#front tr.pointed").count() == 0
    page.tab.hover("#front tbody tr:nth-child(4)")
    ring = page.tab.locator("#ring").bounding_box()
    left, top = page.tab.evaluate(SPOT, [5, 0.6])
    assert abs(ring["x"] + ring["width"] / 2 - left) < 1.5
    assert abs(ring["y"] + ring["height"] / 2 - top) < 1.5


def test_table_sorts_by_any_column_and_by_keyboard(opened):
    page = opened(points())
    page.tab.click("#front th button[title=energy_uj]")
    assert page.cells(1) == ["3", "1", "2", "0"]
    page.tab.click("#front th button[title=energy_uj]")
    assert page.cells(1) == ["0", "2", "1", "3"]
    assert page.tab.get_attribute("#front th:nth-child(3)", "aria-sort") == "descending"
    page.tab.focus("#front tbody tr:nth-child(4)")
    page.tab.keyboard.press("Enter")
    assert page.tab.inner_text("#design h2") == "Trial 3"


def test_space_is_drawn(opened):
    page = opened(points())
    page.tab.click("#view-3")
    page.tab.wait_for_selector("#plot canvas")
    assert {trace["type"] for trace in page.traces()} <= {"scatter3d", "mesh3d"}
    assert sum(len(trace["x"]) for trace in page.traces() if trace["type"] == "scatter3d") == 5
    page.tab.mouse.move(0, 0)
    assert page.tab.is_visible("#z")
    page.tab.hover("#front tbody tr:nth-child(4)")
    page.tab.wait_for_function("document.getElementById('plot').data.at(-1).x.length === 1")
    assert page.traces()[-1]["x"] == [5], "pointed at in the table, marked in space"
    assert page.tab.evaluate(PRESSED_IN_SPACE, 2) == "2"
    assert page.tab.inner_text("#design h2") == "Trial 2"
    page.tab.click("#view-2")
    assert not page.tab.is_visible("#z")


def test_many_points_are_drawn(opened):
    many = pd.concat(
        [points(energy_uj=10.0 + k, trial=range(5 * k, 5 * k + 5)) for k in range(500)], ignore_index=True
    )
    page = opened(many)
    assert sum(len(trace["x"]) for trace in page.traces()) < 50
    assert page.cloud(300, 0.95)[3] > 0
    page.tab.mouse.click(*page.point_at(300, 0.95))
    trial = page.tab.inner_text("#design h2").removeprefix("Trial ")
    assert abs(10 + int(trial.replace("\u202f", "")) // 5 - 300) <= 4, "of the trials on nearly the same spot"


def test_a_picture_has_every_point(opened):
    page = opened(points(), name='a/b"<c>')
    with page.tab.expect_download() as saved:
        page.tab.click("#figure .save button >> nth=0")
    assert saved.value.suggested_filename == "a_b_c_-front.svg"
    drawn = ElementTree.parse(saved.value.path()).getroot()
    assert sum(1 for path in drawn.iter() if "point" in path.get("class", "").split()) == 2 + 3 + 2
    with page.tab.expect_download() as saved:
        page.tab.click("#figure .save button >> nth=1")
    assert saved.value.path().read_bytes().startswith(b"\x89PNG")


def test_no_button_covers_a_figure_or_sends_it_away(opened):
    page = opened(points())
    assert page.tab.locator("#plot .modebar-btn").count() == 0
    assert "sendChartToCloud" in page.tab.evaluate("Figure.config.modeBarButtonsToRemove")
    assert page.tab.evaluate("Figure.config.plotlyServerURL") == ""


def test_failed_trials_are_listed_after_the_views(opened):
    page = opened(pd.concat([points(), failed()], ignore_index=True), fragment="chosen=1")
    places = "ids => ids.map((id) => document.getElementById(id).getBoundingClientRect())"
    budgets, side, views, failures = page.tab.evaluate(places, ["budgets", "side", "views", "failures"])
    assert side["top"] == budgets["top"]
    assert failures["top"] > views["bottom"]
    page.tab.set_viewport_size({"width": 390, "height": 844})
    last, failures = page.tab.evaluate(places, ["front", "failures"])
    assert failures["top"] > last["bottom"]


@pytest.mark.parametrize(
    ("before", "said"),
    [
        ("delete window.DecompressionStream", "This browser cannot decompress the page"),
        ("const read = atob; window.atob = (text) => read(text).slice(0, -9)", "the file may be truncated"),
    ],
)
def test_a_page_that_cannot_be_read_says_so(new_tab, tmp_path, before, said):
    path = write_page(points(), tmp_path / "page.html", name="fabric", objectives=OBJECTIVES)
    new_tab()
    tab = new_tab()
    tab.add_init_script(before)
    tab.goto(path.as_uri())
    tab.wait_for_selector("main [role=alert]")
    assert said in tab.inner_text("main")
    assert tab.locator("main section").count() == 0


def test_a_pick_that_stays_is_not_read_aloud_again(opened):
    page = opened(points())
    page.tab.evaluate(
        """() => {
          window.heard = 0;
          const ears = new MutationObserver((records) => { window.heard += records.length; });
          for (const id of ["pick", "tally"]) {
            ears.observe(document.getElementById(id), {childList: true, subtree: true, characterData: true});
          }
        }"""
    )
    page.tab.click("#front tbody tr:nth-child(2)")
    assert page.tab.evaluate("new Promise((next) => setTimeout(() => next(window.heard)))") == 0
    page.tab.fill("#budget-1", "30")
    assert page.tab.evaluate("new Promise((next) => setTimeout(() => next(window.heard)))") > 0
    page.tab.click("#pick button >> nth=0")
    assert page.tab.inner_text("#design h2") == "Trial 1"


def test_before_a_choice_the_panel_shows_the_pick_and_families_have_colours(opened):
    parts = {"latency_ms": 12.0, "decision_latency_ms": 10.0, "hardware_latency_ms": 5.0}
    page = opened(points(family=["snn", "knn", "snn", "knn", "snn"], **parts))
    assert page.tab.inner_text("#design h2") == "Trial 0"
    text = page.tab.inner_text("#design").replace("\u00a0", " ")
    assert "The pick. " in text and "decision 10 ms, then 2 ms of computing (5 ms in all)" in text
    assert page.link() == ""
    names = "document.getElementById('plot').data.filter((t) => t.showlegend).map((t) => t.name)"
    assert page.tab.evaluate(names) == ["knn", "snn"]
    assert page.tab.inner_text("#colour option:checked") == "auto: family"
    page.tab.fill("#budget-1", "30")
    page.tab.wait_for_function("document.querySelector('#design h2').textContent === 'Trial 1'")


def test_tasks_stand_side_by_side_when_asked(opened):
    both = pd.concat([points(), points(task="velocity", trial=range(5, 10))], ignore_index=True)
    page = opened(both)
    page.tab.click("#view-s")
    page.tab.wait_for_function("document.getElementById('plot').layout.xaxis2")
    axes = page.tab.evaluate("document.getElementById('plot').data.map((t) => t.xaxis)")
    assert axes.count("x") == axes.count("x2") == 3
    notes = page.tab.evaluate("document.getElementById('plot').layout.annotations.map((note) => note.text)")
    assert notes == ["texture", "velocity"]
    page.tab.click("#view-2")
    page.tab.wait_for_function("!document.getElementById('plot').layout.xaxis2")


def test_many_tasks_side_by_side_have_room_on_a_phone(opened):
    tasks = [
        points(task=f"a task with a long name, the {k}th", trial=range(5 * k, 5 * k + 5)) for k in range(5)
    ]
    page = opened(pd.concat(tasks, ignore_index=True))
    page.tab.set_viewport_size({"width": 390, "height": 844})
    page.tab.click("#view-s")
    page.tab.wait_for_selector("#plot .annotation >> nth=4")
    boxes = page.tab.eval_on_selector_all(
        "#plot .annotation-text", "texts => texts.map((text) => text.getBoundingClientRect())"
    )
    assert all(left["right"] <= right["left"] for left, right in itertools.pairwise(boxes))
    assert page.tab.locator("#plot .xtitle, #plot .x2title").count() == 1, "the first says it for all"


def test_on_a_phone_budgets_stay_at_the_foot_beside_what_they_change(opened):
    page = opened(points(), size=(390, 844))
    ids = ["plot", "budgets"]
    boxes = f"() => {ids}.map((id) => document.getElementById(id).getBoundingClientRect())"
    plot, budgets = page.tab.evaluate(boxes)
    assert plot["bottom"] <= budgets["top"] + 8 and budgets["bottom"] <= 844
    assert not page.tab.evaluate("document.getElementById('shown-as').open"), "what it shows is one line"
    assert "accuracy over energy" in page.tab.inner_text("#shown-as summary")
    page.tab.evaluate("scrollTo(0, document.documentElement.scrollHeight / 2)")
    assert page.tab.locator("#slider-1").is_visible() and page.tab.evaluate(boxes)[1]["bottom"] == 844
    page.tab.click("#drawer")
    assert not page.tab.locator("#slider-1").is_visible() and page.tab.evaluate(boxes)[1]["height"] < 100
    assert "5 of 5 points feasible" in page.tab.inner_text("#budgets")
    page.tab.set_viewport_size({"width": 1280, "height": 720})
    page.tab.locator("#controls").wait_for(state="visible")
    page.tab.locator("#drawer").wait_for(state="hidden")


def test_on_a_small_screen_the_pick_follows_the_figure_and_budgets_stay_beside_both(opened):
    page = opened(points(), size=(1024, 768))
    ids = ["figure", "choice", "design", "view-decide", "budgets"]
    boxes = f"() => {ids}.map((id) => document.getElementById(id).getBoundingClientRect())"
    figure, choice, design, decide, _ = page.tab.evaluate(boxes)
    assert figure["bottom"] <= choice["top"] == design["top"] and choice["right"] <= design["left"]
    assert design["bottom"] <= decide["top"]
    page.tab.evaluate("scrollTo(0, document.documentElement.scrollHeight / 2)")
    assert 0 <= page.tab.evaluate(boxes)[4]["top"] < 16, "budgets stay in sight"
    assert page.overflow() <= 0


def test_colours_have_their_key_in_space_too(opened):
    page = opened(points(family=list("aabbc")), fragment="view=3")
    named = "document.getElementById('plot').data.filter((t) => t.showlegend).map((t) => t.name)"
    assert page.tab.evaluate(named) == ["a", "b", "c"]


def test_a_page_of_a_sample_counts_no_sample_as_the_study(opened):
    many = pd.concat([points(trial=range(5 * k, 5 * k + 5)) for k in range(3000)], ignore_index=True)
    rng = np.random.default_rng(0)
    columns = {name: rng.random(len(many)) for name in OBJECTIVES}
    page = opened(many.assign(hardware="chip", fits=many["trial"] % 5 != 4, **columns))
    assert page.tab.inner_text("#counts") == "15\u202f000 trials"
    assert "points of those shown do not fit chip" in page.tab.inner_text("#left")


def test_keys_are_listed_and_work(opened):
    page = opened(points())
    page.tab.keyboard.press("?")
    assert "chooses its design" in page.tab.inner_text("#keys")
    page.tab.click("#keys button")
    assert not page.tab.is_visible("#keys")
    page.tab.focus("#front tbody tr:nth-child(2)")
    page.tab.keyboard.press("Enter")
    assert page.tab.text_content("#front tr:focus td") == "1"
    page.tab.keyboard.press("c")
    assert "compare=1" in page.tab.evaluate("location.hash")
    page.tab.keyboard.press("Escape")
    assert "chosen=" not in page.tab.evaluate("location.hash")
    page.tab.focus("#budget-0")
    page.tab.keyboard.press("3")
    assert page.tab.input_value("#budget-0") == "3", "a number is typed, not the view changed"


def test_two_tasks_are_told_apart(opened):
    both = pd.concat([points(), points(task="velocity", accuracy=0.5)], ignore_index=True)
    page = opened(both)
    assert page.tab.eval_on_selector_all("#task option", "o => o.map((x) => x.textContent)") == [
        "all",
        "texture",
        "velocity",
    ]
    page.tab.select_option("#task", "velocity")
    assert set(page.cells(2)) == {"velocity"}


INK = "getComputedStyle(document.querySelector('#plot .ytitle')).fill"

FITS = """() => {
  const [drawing, place] = ["#plot .main-svg", "#plot"].map((at) => document.querySelector(at));
  return drawing.clientWidth <= place.clientWidth;
}"""

CONTRAST = """() => {
  const linear = (v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  const light = (css) => {
    const [r, g, b] = css.match(/\\d+/g).map((v) => linear(v / 255));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const back = light(getComputedStyle(document.body).backgroundColor);
  return ["h1", "#counts", "#caption", "#notes li", "#design dt"].map((at) => {
    const fore = light(getComputedStyle(document.querySelector(at)).color);
    return (Math.max(fore, back) + 0.05) / (Math.min(fore, back) + 0.05);
  });
}"""


def test_readable_at_any_size_in_light_and_dark(opened):
    page = opened(points(n_weights=7), fragment="chosen=1")
    for width, height in ((1280, 720), (390, 844), (320, 568)):
        page.tab.set_viewport_size({"width": width, "height": height})
        assert page.overflow() <= 0
        assert page.tab.locator("#plot").bounding_box()["height"] >= 320
        page.tab.wait_for_function(FITS)
    for theme, background in (("light", "rgb(255, 255, 255)"), ("dark", "rgb(21, 24, 28)")):
        page.tab.emulate_media(color_scheme=theme)
        assert page.tab.evaluate("getComputedStyle(document.body).backgroundColor") == background
        assert min(page.tab.evaluate(CONTRAST)) >= 4.5
        ink = "rgb(232, 234, 237)" if theme == "dark" else "rgb(27, 30, 34)"
        page.tab.wait_for_function(
            "(ink) => getComputedStyle(document.querySelector('#plot .ytitle')).fill === ink", arg=ink
        )
    page.tab.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert page.tab.evaluate(INK) == "rgb(27, 30, 34)", "on paper, also of a dark screen"
    page.tab.evaluate("dispatchEvent(new Event('afterprint'))")
    assert page.tab.evaluate(INK) == "rgb(232, 234, 237)"


def test_paper_holds_whole_figures_and_no_buttons(opened):
    frame = points(**{f"model.parameter_{k}": range(k, k + 5) for k in range(8)})
    page = opened(frame, fragment="chosen=1", size=(1440, 900))
    inside = """() => {
      const { left, right } = document.body.getBoundingClientRect();
      const out = [...document.querySelectorAll("#plot .main-svg, #parallel svg, table, #design")]
        .map((node) => node.getBoundingClientRect())
        .filter((box) => box.width && (box.right > right + 1 || box.left < left - 1));
      const plot = document.querySelector("#plot").getBoundingClientRect();
      const axis = document.querySelector("#plot .xtitle").getBoundingClientRect();
      return { width: right - left, out: out.length, isWhole: axis.bottom <= plot.bottom };
    }"""
    page.tab.evaluate("dispatchEvent(new Event('beforeprint'))")
    paper = page.tab.evaluate(inside)
    assert paper == {"width": 700, "out": 0, "isWhole": True}
    assert page.tab.locator("#parallel svg g.front polyline").count() == 4
    acting = "#undo, #clear, #drawer, #help, #copy, .save button, #design .head button"
    assert page.tab.locator(f":is({acting}):visible").count() == 0
    page.tab.evaluate("dispatchEvent(new Event('afterprint'))")
    assert page.tab.locator("#parallel svg").count() == 0 and page.tab.is_visible("#copy")
    page.tab.wait_for_function(FITS)
    assert page.tab.evaluate(inside)["width"] == 1440
    wide = "document.querySelector('#plot .main-svg').clientWidth > 600"
    page.tab.wait_for_function(wide)


@pytest.mark.parametrize(
    ("frame", "text"),
    [
        (pd.DataFrame(), "No design yet"),
        (failed("out of memory"), "out of memory"),
    ],
)
def test_nothing_to_draw_has_a_face(opened, frame, text):
    page = opened(frame)
    assert text in page.tab.inner_text("main")
    assert not page.tab.is_visible("#plot")


@pytest.mark.parametrize(
    ("frame", "note", "n_front"),
    [
        (points().iloc[:1], "There is one design point so far", 1),
        (points().drop(columns="energy_uj"), "Column energy_uj is missing", 3),
        (points(accuracy=0.5, energy_uj=1.0, n_weights=7), "does not distinguish them", 5),
    ],
)
def test_poor_tables_are_drawn_with_a_note(opened, frame, note, n_front):
    page = opened(frame)
    assert note in page.tab.inner_text("#notes")
    assert len(page.cells(1)) == n_front
    assert page.tab.is_visible("#plot .plot-container")


@pytest.mark.parametrize("fragment", ["view=3", "x=%3Cimg%3E&chosen=%22&task=__proto__&toString=1&rows=99"])
def test_hostile_study_never_runs(opened, fragment):
    frame = points(
        **{
            "model.kind": list(HOSTILE[:5]),
            f"model.{HOSTILE[0]}": list(HOSTILE[3:8]),
            HOSTILE[2]: [1.0, 2.0, 3.0, 4.0, 5.0],
            "task": HOSTILE[0],
            "hardware": HOSTILE[1],
        }
    )
    frame = pd.concat([frame, failed(HOSTILE[0] + HOSTILE[1])], ignore_index=True)
    page = opened(frame, name="".join(HOSTILE), fragment=fragment)
    page.tab.click("#front tbody tr:first-child")
    page.tab.click("#failures summary")
    if fragment != "view=3":
        page.tab.select_option("#x", HOSTILE[2])
        page.tab.wait_for_function("document.getElementById('plot').data[0].x[1] === 5")
        page.point_at(2.0, 0.9)
        page.tab.wait_for_selector("#tip", state="visible")
    assert page.tab.evaluate("window.hacked") is None
    assert page.tab.locator("img, main a[href], main svg[onload]").count() == 0
    assert page.tab.locator("h1").text_content() == "".join(HOSTILE)
    assert page.overflow() <= 0


def test_costs_on_another_chip_are_not_those_of_the_chosen_design(opened):
    chips = [
        points(hardware="small", point=0),
        points(hardware="large", point=0, energy_uj=[500.0, 200.0, 210.0, 50.0, 300.0]).iloc[1:],
    ]
    page = opened(pd.concat(chips, ignore_index=True), fragment="chosen=1.0")
    assert "20 (16–30)" in page.tab.inner_text("#design")
    page.tab.select_option("#hardware", "large")
    assert "200" in page.tab.inner_text("#design")
    page.open("chosen=0.0&hardware=large")
    assert "50" not in page.tab.inner_text("#design"), "this design has no row there"
    assert page.marked("circle-open") == []


def test_a_fraction_below_one_is_not_rounded_to_one(opened):
    frame = table()
    frame.loc[0, "accuracy"] = 0.9996
    page = opened(frame=frame)
    cells = page.tab.locator("#front tbody tr").all_inner_texts()
    assert any(">\u202f0.999" in cells_of for cells_of in cells)
