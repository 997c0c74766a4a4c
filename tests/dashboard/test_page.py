"""The page in a real browser: what is drawn, what a click does, and that nothing in a study can run."""

import dataclasses
import itertools
import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest

from dse.audit import AuditRow
from dse.dashboard import gather
from tests.dashboard.designs import confusion_of, details, example, progress_of, table
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
NAMED = "document.getElementById('plot').data.filter((t) => t.showlegend).map((t) => t.name)"
BOXES = "ids => ids.map((id) => document.getElementById(id).getBoundingClientRect())"
HEARD = """() => {
  window.heard = 0;
  const ears = new MutationObserver((records) => { window.heard += records.length; });
  for (const id of ["pick", "tally"]) {
    ears.observe(document.getElementById(id), {childList: true, subtree: true, characterData: true});
  }
}"""
AGAIN = "new Promise((next) => setTimeout(() => next(window.heard)))"


def trial(page):
    return page.tab.inner_text("#design h2")


def test_front_is_drawn_pointed_at_chosen_and_listed(opened):
    page = opened(pd.concat([points(), failed()], ignore_index=True))
    reach, line, joined = page.traces()
    assert reach["x"] == [5, 50]
    assert page.cloud(21, 0.85)[3] > page.cloud(30, 0.88)[3] > page.cloud(30, 0.7)[3] == 0
    assert line["mode"] == "lines"
    assert joined["x"] == line["x"] == [5, 20, 50] and joined["bars"] == [0.02] * 3
    assert page.cells(1) == ["0", "1", "2", "3"]
    assert page.tab.inner_text("#counts") == "5 trials · 1 failed · 5 points"
    assert page.tab.inner_text("#failures summary") == "1 failed trial"
    assert page.tab.locator("#plot .modebar-btn").count() == 0, "no button covers it or sends it away"
    assert "sendChartToCloud" in page.tab.evaluate("Figure.config.modeBarButtonsToRemove")
    assert page.tab.evaluate("Figure.config.plotlyServerURL") == ""
    page.point_at(20, 0.9)
    page.tab.wait_for_selector("#tip", state="visible")
    text = page.tab.text_content("#tip")
    assert "model.hidden  50" in text and "energy (µJ)  20" in text
    assert page.tab.inner_text("#front tr.pointed td:first-child") == "1"
    page.point_at(45, 0.65)
    page.tab.wait_for_selector("#tip", state="hidden")
    assert page.tab.locator("#front tr.pointed").count() == 0
    page.tab.hover("#front tbody tr:nth-child(4)")
    ring = page.tab.locator("#ring").bounding_box()
    left, top = page.tab.evaluate(SPOT, [5, 0.6])
    assert abs(ring["x"] + ring["width"] / 2 - left) < 1.5
    assert abs(ring["y"] + ring["height"] / 2 - top) < 1.5
    page.tab.mouse.click(*page.point_at(21, 0.85))
    text = page.tab.inner_text("#design")
    for words in ("Trial 2", "on the front", "0.850 ± 0.02", "21 (16.8–31.5)\u00a0µJ"):
        assert words in text
    page.tab.wait_for_function(
        "document.getElementById('plot').data.some((t) => t.marker?.symbol === 'circle-open')"
    )
    assert page.marked("circle-open") == [(21, 0.85)]
    page.tab.click("#front th button[title=energy_uj]")
    assert page.cells(1) == ["3", "1", "2", "0"]
    page.tab.click("#front th button[title=energy_uj]")
    assert page.cells(1) == ["0", "2", "1", "3"]
    assert page.tab.get_attribute("#front th:nth-child(3)", "aria-sort") == "descending"
    page.tab.select_option("#x", "n_weights")
    assert page.traces()[2]["x"] == [10_000, 40_000, 90_000]
    page.tab.focus("#front tbody tr:nth-child(4)")
    page.tab.keyboard.press("Enter")
    assert trial(page) == "Trial 3"
    page.open(page.link())
    assert page.tab.input_value("#x") == "n_weights" and trial(page) == "Trial 3"


def test_keys_are_listed_and_work_and_a_pick_that_stays_is_not_read_aloud_again(opened):
    page = opened(points())
    page.tab.keyboard.press("?")
    assert "chooses its design" in page.tab.inner_text("#keys")
    page.tab.click("#keys button")
    assert not page.tab.is_visible("#keys")
    page.tab.evaluate(HEARD)
    page.tab.focus("#front tbody tr:nth-child(2)")
    page.tab.keyboard.press("Enter")
    assert page.tab.evaluate(AGAIN) == 0
    assert page.tab.text_content("#front tr:focus td") == "1"
    page.tab.keyboard.press("c")
    assert "compare=1" in page.tab.evaluate("location.hash")
    page.tab.keyboard.press("Escape")
    assert "chosen=" not in page.tab.evaluate("location.hash")
    page.tab.focus("#budget-1")
    page.tab.keyboard.type("30")
    assert page.tab.input_value("#budget-1") == "30", "a number is typed, not the view changed"
    assert page.tab.evaluate(AGAIN) > 0
    page.tab.click("#pick button >> nth=0")
    assert trial(page) == "Trial 1"


def test_space_is_drawn(opened):
    page = opened(points())
    page.tab.click("#view-3")
    page.tab.wait_for_selector("#plot canvas")
    assert {trace["type"] for trace in page.traces()} <= {"scatter3d", "mesh3d"}
    assert sum(len(trace["x"]) for trace in page.traces()) == 5
    page.tab.mouse.move(0, 0)
    assert page.tab.is_visible("#z")
    page.tab.hover("#front tbody tr:nth-child(4)")
    page.tab.wait_for_function("document.getElementById('plot').data.at(-1).x.length === 1")
    assert page.traces()[-1]["x"] == [5], "pointed at in the table, marked in space"
    assert page.tab.evaluate(PRESSED_IN_SPACE, 2) == "2" and trial(page) == "Trial 2"
    page.tab.click("#view-2")
    assert not page.tab.is_visible("#z")
    page = opened(points(family=list("aabbc")), "view=3")
    assert page.tab.evaluate(NAMED) == ["a", "b", "c"], "colours have their key"


def test_many_points_are_drawn_and_a_sample_is_not_counted_as_the_study(opened, monkeypatch):
    several = [points(energy_uj=10.0 + k, trial=range(5 * k, 5 * k + 5)) for k in range(500)]
    page = opened(pd.concat(several, ignore_index=True))
    assert sum(len(trace["x"]) for trace in page.traces()) < 50
    assert page.cloud(300, 0.95)[3] > 0
    page.tab.mouse.click(*page.point_at(300, 0.95))
    number = int(trial(page).removeprefix("Trial ").replace("\u202f", ""))
    assert abs(10 + number // 5 - 300) <= 4, "of the trials on nearly the same spot"
    many, rng = pd.concat(several, ignore_index=True), np.random.default_rng(0)
    monkeypatch.setattr(gather, "MAX_POINTS", 1500)
    columns = {name: rng.random(len(many)) for name in OBJECTIVES}
    page = opened(many.assign(hardware="chip", fits=many["trial"] % 5 != 4, **columns))
    assert page.tab.inner_text("#counts") == "2\u202f500 trials"
    assert "points of those shown do not fit chip" in page.tab.inner_text("#left")


@pytest.mark.parametrize("section", ["#figure", "#progress"])
def test_a_picture_has_every_point(opened, section):
    page = opened(points(), name='a/b"<c>', parts={"progress": progress_of(points())})
    if section == "#progress":
        page.tab.click("#progress > details > summary")
        page.tab.wait_for_function("document.querySelector('#progress .plot')?.data")
    name, content = page.saved(section, "svg")
    assert name == f"a_b_c_-{'front' if section == '#figure' else 'progress'}.svg"
    drawn = ElementTree.fromstring(content)
    if section == "#figure":
        assert sum("point" in path.get("class", "").split() for path in drawn.iter()) == 2 + 3 + 2
    assert page.saved(section, "png")[1].startswith(b"\x89PNG")


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
    assert said in tab.inner_text("main") and tab.locator("main section").count() == 0


def test_before_a_choice_the_panel_shows_the_pick_and_families_have_colours(opened):
    parts = {"latency_ms": 12.0, "decision_latency_ms": 10.0, "hardware_latency_ms": 5.0}
    page = opened(points(family=["snn", "knn", "snn", "knn", "snn"], **parts))
    assert trial(page) == "Trial 0" and page.link() == ""
    text = page.tab.inner_text("#design").replace("\u00a0", " ")
    assert "The pick. " in text and "decision 10 ms, then 2 ms of computing (5 ms in all)" in text
    assert page.tab.evaluate(NAMED) == ["knn", "snn"]
    assert page.tab.inner_text("#colour option:checked") == "auto: family"
    page.tab.fill("#budget-1", "30")
    page.tab.wait_for_function("document.querySelector('#design h2').textContent === 'Trial 1'")


def test_tasks_are_told_apart_and_stand_side_by_side_on_a_phone_too(opened):
    names = ["texture", *(f"a task with a long name, the {k}th" for k in range(4))]
    tasks = [points(task=name, trial=range(5 * k, 5 * k + 5)) for k, name in enumerate(names)]
    page = opened(pd.concat(tasks, ignore_index=True))
    options = page.tab.eval_on_selector_all("#task option", "o => o.map((x) => x.textContent)")
    assert options == ["all", *names]
    page.tab.click("#view-s")
    page.tab.wait_for_function("document.getElementById('plot').layout.xaxis5")
    axes = page.tab.evaluate("document.getElementById('plot').data.map((t) => t.xaxis)")
    assert {axes.count(name) for name in ("x", "x2", "x5")} == {3}
    page.tab.click("#view-2")
    page.tab.wait_for_function("!document.getElementById('plot').layout.xaxis2")
    page.tab.set_viewport_size({"width": 390, "height": 844})
    page.tab.click("#view-s")
    page.tab.wait_for_selector("#plot .annotation >> nth=4")
    boxes = page.tab.eval_on_selector_all(
        "#plot .annotation-text", "texts => texts.map((text) => text.getBoundingClientRect())"
    )
    assert len(boxes) == 5
    assert all(left["right"] <= right["left"] for left, right in itertools.pairwise(boxes))
    assert page.tab.locator("#plot .xtitle, #plot .x2title").count() == 1, "the first says it for all"
    page.tab.set_viewport_size({"width": 1280, "height": 720})
    page.tab.select_option("#task", "texture")
    page.tab.wait_for_function("document.getElementById('plot').data.every((t) => t.xaxis === 'x')")
    assert set(page.cells(2)) == {"texture"}


def test_on_a_phone_budgets_stay_at_the_foot_and_on_a_small_screen_beside_all(opened):
    page = opened(pd.concat([points(), failed()], ignore_index=True), size=(390, 844))
    ids = ["plot", "budgets", "front", "failures"]
    plot, budgets, last, failures = page.tab.evaluate(BOXES, ids)
    assert plot["bottom"] <= budgets["top"] + 8 and budgets["bottom"] <= 844
    assert failures["top"] > last["bottom"], "failed trials are listed after the views"
    assert not page.tab.evaluate("document.getElementById('shown-as').open"), "what it shows is one line"
    assert "accuracy over energy" in page.tab.inner_text("#shown-as summary")
    page.tab.evaluate("scrollTo(0, document.documentElement.scrollHeight / 2)")
    assert page.tab.locator("#slider-1").is_visible()
    assert page.tab.evaluate(BOXES, ids)[1]["bottom"] == 844
    page.tab.click("#drawer")
    assert not page.tab.locator("#slider-1").is_visible()
    assert page.tab.evaluate(BOXES, ids)[1]["height"] < 100
    assert "5 of 5 points feasible" in page.tab.inner_text("#budgets")
    page.tab.set_viewport_size({"width": 1024, "height": 768})
    page.tab.locator("#controls").wait_for(state="visible")
    page.tab.locator("#drawer").wait_for(state="hidden")
    page.open("chosen=1")
    ids = ["figure", "choice", "design", "view-decide", "budgets"]
    figure, choice, design, decide, _ = page.tab.evaluate(BOXES, ids)
    assert figure["bottom"] <= choice["top"] == design["top"] and choice["right"] <= design["left"]
    assert design["bottom"] <= decide["top"]
    page.tab.evaluate("scrollTo(0, document.documentElement.scrollHeight / 2)")
    assert 0 <= page.tab.evaluate(BOXES, ids)[4]["top"] < 16, "budgets stay in sight"
    assert page.fits()


INK = "(plot) => getComputedStyle(document.querySelector(`${plot} .ytitle`)).fill"
FITS = """(plot) => [...document.querySelectorAll(plot)].filter((node) => node.data).every((node) =>
  node.querySelector(".main-svg").clientWidth <= node.clientWidth && node.clientWidth <= innerWidth)"""
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
INSIDE = """() => {
  const { left, right } = document.body.getBoundingClientRect();
  const out = [...document.querySelectorAll("#plot .main-svg, #parallel svg, table, #design")]
    .map((node) => node.getBoundingClientRect())
    .filter((box) => box.width && (box.right > right + 1 || box.left < left - 1));
  const plot = document.querySelector("#plot").getBoundingClientRect();
  const axis = document.querySelector("#plot .xtitle").getBoundingClientRect();
  return { width: right - left, out: out.length, isWhole: axis.bottom <= plot.bottom };
}"""


def test_readable_at_any_size_in_light_and_dark_and_on_paper(opened):
    wide = {f"model.parameter_{k}": range(k, k + len(table())) for k in range(8)}
    frame = table().assign(n_weights=7, **wide)
    parts = {"progress": progress_of(points(hardware="large chip"))}
    page = opened(frame, "chosen=0.1&compare=0.1,1.1", documents={0: details(0), 1: details(1)}, parts=parts)
    page.tab.click("#progress > details > summary")
    page.tab.wait_for_function("document.querySelector('#progress .plot')?.data")
    for width, height in ((1280, 720), (390, 844), (320, 568)):
        page.tab.set_viewport_size({"width": width, "height": height})
        assert page.tab.locator("#plot").bounding_box()["height"] >= 320
        for tab in ("confusion", "surface", "raster", "learning"):
            page.tab.click(f"#tab-{tab}")
            ready = f"document.querySelector('#design-pane [data-figure={tab}]')?.data"
            page.tab.wait_for_function(ready)
            page.tab.wait_for_function(FITS, arg=".js-plotly-plot")
            assert page.fits()
    for theme, background, ink in (
        ("light", "rgb(255, 255, 255)", "rgb(27, 30, 34)"),
        ("dark", "rgb(21, 24, 28)", "rgb(232, 234, 237)"),
    ):
        page.tab.emulate_media(color_scheme=theme)
        assert page.tab.evaluate("getComputedStyle(document.body).backgroundColor") == background
        assert min(page.tab.evaluate(CONTRAST)) >= 4.5
        for plot in ("#plot", "#progress .plot"):
            page.tab.wait_for_function(f"([plot, ink]) => ({INK})(plot) === ink", arg=[plot, ink])
    page.tab.set_viewport_size({"width": 1440, "height": 900})
    page.tab.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert page.tab.evaluate(INK, "#plot") == "rgb(27, 30, 34)", "on paper, also of a dark screen"
    assert page.tab.evaluate(INSIDE) == {"width": 700, "out": 0, "isWhole": True}
    assert page.tab.locator("#parallel svg polyline").count() == len(frame) // 2
    acting = "#undo, #clear, #drawer, #help, #copy, .save button, #design .head button"
    assert page.tab.locator(f":is({acting}):visible").count() == 0
    page.tab.evaluate("dispatchEvent(new Event('afterprint'))")
    assert page.tab.evaluate(INK, "#plot") == "rgb(232, 234, 237)"
    assert page.tab.locator("#parallel svg").count() == 0 and page.tab.is_visible("#copy")
    page.tab.wait_for_function(FITS, arg="#plot")
    assert page.tab.evaluate(INSIDE)["width"] == 1440
    page.tab.wait_for_function("document.querySelector('#plot .main-svg').clientWidth > 600")


@pytest.mark.parametrize(("scheme", "size"), [("light", (1280, 720)), ("dark", (390, 844))])
def test_axe_finds_nothing(opened, scheme, size):
    axe = pytest.importorskip("axe_playwright_python", reason="no axe-core")
    script = (Path(axe.__file__).parent / "axe.min.js").read_text(encoding="utf-8")
    frame = pd.concat([points(hardware=name, trial=range(5)) for name in ("a", "b")], ignore_index=True)
    page = opened(frame, "chosen=4&compare=4,1&f.model.hidden=30~&b.energy_uj=20", size=size, scheme=scheme)
    page.tab.evaluate(script)
    found = page.tab.evaluate("async () => (await axe.run()).violations")
    assert [(one["id"], [node["html"][:120] for node in one["nodes"]]) for one in found] == []
    assert page.fits()


@pytest.mark.parametrize(
    ("frame", "text"), [(pd.DataFrame(), "No design yet"), (failed("out of memory"), "out of memory")]
)
def test_nothing_to_draw_has_a_face(opened, frame, text):
    page = opened(frame)
    assert text in page.tab.inner_text("main") and not page.tab.is_visible("#plot")


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
    assert len(page.cells(1)) == n_front and page.tab.is_visible("#plot .plot-container")


def test_costs_on_another_chip_are_not_those_of_the_chosen_design(opened):
    chips = [
        points(hardware="small", point=0, accuracy=[0.9996, 0.90, 0.85, 0.60, 0.88]),
        points(hardware="large", point=0, energy_uj=[500.0, 200.0, 210.0, 50.0, 300.0]).iloc[1:],
    ]
    page = opened(pd.concat(chips, ignore_index=True), "chosen=1.0")
    assert page.cells(2)[0].startswith(">\u202f0.999"), "a fraction below one is not rounded to one"
    assert "20 (16–30)" in page.tab.inner_text("#design")
    page.tab.select_option("#hardware", "large")
    assert "200" in page.tab.inner_text("#design")
    page.open("chosen=0.0&hardware=large")
    assert "50" not in page.tab.inner_text("#design"), "this design has no row there"
    assert page.marked("circle-open") == []


# ---- the audit

EVIL = HOSTILE[0]
ROW = AuditRow(
    *("speed", "position in time", "nearest", 0.9, 0.0168, 0.17, 0.228, 0.0254, 322, True),
    *("96 % of the accuracy above chance is position", "window.jitter_steps"),
)
CLEAN = AuditRow(
    *("speed", "spike total", EVIL, 0.239, 0.0237, 0.17, None, None, 322, False, "explains 10 %", "")
)
LINES = "[...document.querySelectorAll('#audit tr')].map((line) => [...line.cells].map((c) => c.textContent))"


def test_an_audit_is_a_line_and_a_table(opened):
    known = dataclasses.replace(ROW, probe="counts over time", shortcut=False, test=0.83, test_se=0.02)

    def audited(*rows):
        page = opened(points(), parts={"audit": json.loads(json.dumps([row.columns for row in rows]))})
        return page, page.tab.locator("#audit summary")

    page, summary = audited(ROW, CLEAN)
    assert summary.inner_text() == "Audit: could pass for skill: position in time"
    summary.click()
    assert page.tab.evaluate(LINES) == [
        ["probe", "accuracy", "chance", "without", "verdict"],
        ["position in timenearest", "0.900 ± 0.02", "0.170", "0.228 ± 0.03", ROW.verdict + ROW.remedy],
        [f"spike total{EVIL}", "0.239 ± 0.02", "0.170", "–", "explains 10 %"],
    ]
    assert page.tab.locator("#audit tr.shortcut").count() == 1
    page, summary = audited(known, CLEAN)
    summary.click()
    head, first, second = page.tab.evaluate(LINES)
    assert head[-2] == "test" and first[-2] == "0.830 ± 0.02" and second[-2] == "–"
    assert audited()[0].tab.locator("#audit").is_hidden()


# ---- nothing in a study can run


@pytest.mark.parametrize("fragment", ["view=3", "x=%3Cimg%3E&chosen=%22&task=__proto__&toString=1&rows=99"])
def test_hostile_study_never_runs(opened, fragment):
    frame = points(
        **{
            "model.kind": list(HOSTILE[:5]),
            f"model.{HOSTILE[0]}": list(HOSTILE[3:8]),
            f"model.{HOSTILE[7]}\x08": [1.0, 2.0, 3.0, 4.0, 5.0],
            HOSTILE[2]: [1.0, 2.0, 3.0, 4.0, 5.0],
            "task": [HOSTILE[0], *[HOSTILE[1]] * 4],
            "hardware": HOSTILE[1],
            "family": HOSTILE[-3],
        }
    )
    frame = pd.concat([frame, failed(HOSTILE[0] + HOSTILE[1])], ignore_index=True)
    evil = progress_of(points(task=EVIL, hardware=HOSTILE[1]))
    evil |= {"failed": [{"reason": EVIL, "count": 2, "trials": [5]}]}
    evil |= {"running": [{"trial": 9, "design": {EVIL: EVIL}}]}
    page = opened(frame, fragment, name="".join(HOSTILE), parts={"progress": evil})
    page.tab.click("#front tbody tr:first-child")
    page.tab.click("#progress > details > summary")
    assert "trial 9 <img" in page.tab.inner_text("#progress .lists")
    if fragment != "view=3":
        page.tab.select_option("#x", HOSTILE[2])
        page.tab.wait_for_function("document.getElementById('plot').data[0].x[1] === 5")
        page.point_at(2.0, 0.9)
        page.tab.wait_for_selector("#tip", state="visible")
        names = page.tab.locator("#parallel .name").all_text_contents()
        assert any("<img src=x" in name for name in names) and max(map(len, names)) <= 80
        words = ElementTree.fromstring(page.saved("#parallel", "svg")[1]).iter()
        assert any("<img" in (text.text or "") for text in words)
    assert page.is_clean() and page.tab.locator("#parallel :is(img, a)").count() == 0
    assert page.tab.locator("h1").text_content() == "".join(HOSTILE)
    page.tab.set_viewport_size({"width": 390, "height": 844})
    assert page.fits()


def test_nothing_in_a_document_can_run(opened):
    n = len(HOSTILE)
    examples = [example(name, (name, "silk")) for name in HOSTILE]
    document = details(figures={"confusion": confusion_of(np.eye(n, dtype=int), HOSTILE)}, examples=examples)
    document |= {"notes": list(HOSTILE), "targets": [{"point": 0, "text": f"c99: faithful {EVIL}"}]}
    document["tasks"] = {HOSTILE[0]: document["tasks"]["texture"], "__proto__": {}}
    frame = table(4).assign(task=HOSTILE[0], **{HOSTILE[2]: 1.0})
    frame["encoder.kind"] = [HOSTILE[trial] for trial in frame["trial"]]
    frame["model.name"] = [HOSTILE[-1 - trial] for trial in frame["trial"]]
    link = "chosen=0.0&compare=0.0,1.1,2.1,3.1"
    page = opened(frame, link, documents={0: document}, name=HOSTILE[1])
    page.tab.wait_for_function("document.querySelector('#compare .plot')?.data")
    for tab in ("confusion", "surface", "raster"):
        page.tab.click(f"#tab-{tab}")
        page.tab.wait_for_function(f"document.querySelector('#design-pane [data-figure={tab}]')?.data")
    for k, name in enumerate(HOSTILE):
        page.tab.select_option("[data-name=example]", str(k))
        answer = page.tab.inner_text("#design-pane > .summary >> nth=-1")
        assert f"{name[:30]}" in answer or "\u2028" in name
        assert page.tab.get_attribute("#design-pane [role=img]", "aria-label").startswith(name)
    for width, height in ((1280, 720), (390, 844)):
        page.tab.set_viewport_size({"width": width, "height": height})
        assert page.fits()
    assert page.is_clean()
