"""The page in a real browser: what is drawn, what a click does, and that nothing in a study can run."""

import dataclasses
import json
import re
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest

from dse.show.dashboard import gather
from dse.study.audit import AuditRow
from tests.page_data import OBJECTIVES, failed, points, write_page
from tests.show.dashboard.designs import confusion_of, details, example, progress_of, table
from tests.show.dashboard.page import HOSTILE, SPOT

BOXES = "ids => ids.map((id) => document.getElementById(id).getBoundingClientRect())"
HEARD = """() => {
  window.heard = 0;
  const ears = new MutationObserver((records) => { window.heard += records.length; });
  ears.observe(document.getElementById("sentence"), {childList: true, subtree: true, characterData: true});
}"""
AGAIN = "new Promise((next) => setTimeout(() => next(window.heard)))"
ALL_TABS = ["Choose", "Inside", "What matters", "All designs", "Run"]


def chosen(page):
    """Return the key of the design that is chosen in the page's link, or ''."""
    return page.tab.evaluate("new URLSearchParams(location.hash.slice(1)).get('chosen') ?? ''")


def test_front_is_drawn_pointed_at_chosen_and_listed(opened):
    page = opened(pd.concat([points(), failed()], ignore_index=True), "expert=1")
    assert page.line() == [3, 1, 0]
    assert page.cloud(20, 0.9)[3] == 255 > page.cloud(30, 0.88)[3] > page.cloud(30, 0.7)[3] == 0
    assert page.cells(1) == ["0", "1", "2", "3"]
    assert page.tab.inner_text("#counts") == "5 trials · 1 failed · 5 settings"
    assert page.tab.evaluate("Figure.config.plotlyServerURL") == "", "nothing of a study leaves its page"
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
    assert chosen(page) == "2" and page.marked("your choice") == [(21, 0.85)]
    assert "85 % of the validation recordings" in page.sentence()
    page.tab.click("#front th button[title=energy_uj]")
    assert page.cells(1) == ["3", "1", "2", "0"]
    page.tab.click("#front th button[title=energy_uj]")
    assert page.cells(1) == ["0", "2", "1", "3"]
    assert page.tab.get_attribute("#front th:nth-child(3)", "aria-sort") == "descending"
    page.tab.select_option("#x", "n_weights")
    assert page.line() == [2, 1, 0]
    page.tab.focus("#front tbody tr:nth-child(4)")
    page.tab.keyboard.press("Enter")
    assert chosen(page) == "3"
    page.open(page.link())
    assert page.tab.input_value("#x") == "n_weights" and page.marked("your choice") == [(20_000, 0.6)]
    for before in ("2", ""):
        for _ in range(9):  # every change is one step back
            if chosen(page) == before:
                break
            page.tab.go_back()
        assert chosen(page) == before


def test_keys_are_listed_and_work_and_an_answer_that_stays_is_not_read_aloud_again(opened):
    page = opened(points())
    page.tab.keyboard.press("?")
    assert "chooses its design" in page.tab.inner_text("#keys")
    page.tab.click("#keys button")
    assert not page.tab.is_visible("#keys")
    page.tab.evaluate(HEARD)
    page.tab.focus("#front tbody tr:nth-child(2)")
    page.tab.keyboard.press("Enter")
    assert page.tab.text_content("#front tr:focus td") == "1"
    page.tab.keyboard.press("Escape")
    assert "chosen=" not in page.tab.evaluate("location.hash")
    page.tab.focus("#budget-1")
    page.tab.keyboard.type("30")
    assert page.tab.input_value("#budget-1") == "30", "a number is typed, not the view changed"
    assert page.tab.evaluate(AGAIN) > 0
    page.tab.focus("#show-choose")
    page.tab.keyboard.press("ArrowRight")
    assert page.tab.evaluate("document.activeElement.id") == "show-inside"
    assert page.tab.inner_text("#design h2") == "Trial 1" and "show=inside" in page.link()
    page.tab.keyboard.press("u")
    page.tab.wait_for_function("!location.hash.includes('show=')")


def test_the_arrow_keys_walk_along_the_front_and_what_is_reached_is_read_out(opened):
    page = opened(points(), documents={3: details(3)})
    reached = "#figure > [role=status]"
    for _ in range(40):
        page.tab.keyboard.press("Tab")
        if page.tab.evaluate("document.activeElement.classList.contains('walker')"):
            break
    assert page.tab.text_content(reached) == (
        "Trial 0: accuracy 0.950 ± 0.02, energy 50 (40–75) µJ; 3 of 3"
    ), "begins at the pick"
    page.tab.keyboard.press("ArrowRight")
    assert page.tab.text_content(reached).endswith("; 3 of 3"), "stays at the end"
    page.tab.keyboard.press("ArrowLeft")
    assert page.tab.text_content(reached).startswith("Trial 1: accuracy 0.900 ± 0.02, energy 20 (")
    page.tab.keyboard.press("Home")
    assert page.tab.text_content(reached).startswith("Trial 3: ") and page.tab.is_visible("#ring")
    assert page.tab.text_content("#front tr.pointed td") == "3"
    assert page.violations() == []
    page.tab.keyboard.press("Enter")
    assert chosen(page) == "3" and page.marked("your choice") == [(5, 0.6)]
    assert page.tab.locator("#tip div").count() == 3, "the focus stays, and the tip hides little of the front"
    page.tab.keyboard.press("Enter")
    assert "show=inside" in page.link() and page.tab.inner_text("#design h2") == "Trial 3"
    page.tab.keyboard.press("Shift+Tab")
    assert not page.tab.is_visible("#tip")


def test_many_points_are_drawn_and_a_sample_is_not_counted_as_the_study(opened, monkeypatch):
    several = [points(energy_uj=10.0 + k, trial=range(5 * k, 5 * k + 5)) for k in range(500)]
    many = pd.concat(several, ignore_index=True)
    page = opened(many)
    assert page.cloud(300, 0.95)[3] > 0
    page.tab.mouse.click(*page.point_at(300, 0.95))
    assert abs(10 + int(chosen(page)) // 5 - 300) <= 4, "of the trials on nearly the same spot"
    rng = np.random.default_rng(0)
    monkeypatch.setattr(gather, "MAX_POINTS", 1500)
    columns = {name: rng.random(len(many)) for name in OBJECTIVES}
    page = opened(many.assign(hardware="chip", fits=many["trial"] % 5 != 4, **columns), "expert=1")
    assert page.tab.inner_text("#counts") == "2\u202f500 trials"
    assert "settings of those shown that do not fit chip" in page.tab.inner_text("#left")


def test_a_picture_has_every_point(opened):
    page = opened(points(), name='a/b"<c>')
    name, content = page.saved("front", "svg")
    assert name == "a_b_c_-front.svg"
    drawn = ElementTree.fromstring(content)
    assert sum(node.get("class") == "point" for node in drawn.iter()) == 5
    assert page.saved("front", "png")[1].startswith(b"\x89PNG")


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


def test_every_part_has_a_tab_and_only_what_is_seen_is_made(opened):
    parts = {"progress": progress_of(points())}
    page = opened(points(family=["snn", "knn", "snn", "knn", "snn"]), parts=parts)
    assert page.tab.locator("#tabs [role=tab]").all_inner_texts() == ALL_TABS
    assert page.tab.inner_text("#caption").split() == ["knn", "spiking", "network"]
    assert "12 done" in page.tab.inner_text("#counts")
    assert page.tab.evaluate("window.Plotly") is None, "the drawing library waits until it is asked for"
    page.tab.click("#show-run")
    page.tab.wait_for_function("document.querySelector('#progress .plot')?.data")
    assert page.tab.locator("#front, #design").filter(visible=True).count() == 0
    page.tab.click("#show-all")
    assert len(page.cells(1)) == 5 and page.tab.is_visible("#view-parallel")
    page.tab.fill("#find", "hidden 25")
    page.tab.wait_for_function("document.querySelectorAll('#front tbody tr').length === 1")
    page.open(page.link())
    assert page.cells(1) == ["3"], "the search is in the link"


def test_on_a_phone_the_answer_comes_first_and_all_fits(opened):
    page = opened(points(), size=(390, 844))
    tops = [box["top"] for box in page.tab.evaluate(BOXES, ["sentence", "plane", "cards", "tabs", "front"])]
    assert tops == sorted(tops)
    assert page.tab.evaluate(BOXES, ["plane"])[0]["bottom"] < 844
    for size in ((320, 568), (768, 1024), (1440, 900)):
        page.tab.set_viewport_size({"width": size[0], "height": size[1]})
        assert page.fits()
    plane, cards = page.tab.evaluate(BOXES, ["plane", "cards"])
    assert plane["right"] <= cards["left"] and plane["bottom"] <= 900
    font = "parseFloat(getComputedStyle(document.getElementById('sentence')).fontSize)"
    assert page.tab.evaluate(font) >= 28


def test_a_first_look_has_few_controls(opened):
    """The sentence, the questions, the cards and the chart: what can be pressed or moved before scrolling."""
    chips = [points(hardware=name, accuracy_corrected=[0.93, 0.88, 0.83, 0.6, 0.85]) for name in "ab"]
    tasks = [pd.concat(chips).assign(task=name) for name in ("texture", "speed")]
    frame = pd.concat(tasks, ignore_index=True)
    page = opened(frame.assign(energy_throttled_uj=frame["energy_uj"] * 2), size=(1440, 900))
    controls = page.tab.evaluate(
        "[...document.querySelectorAll('a[href], button, input, select, summary, [tabindex=\"0\"]')]"
        ".filter((node) => node.checkVisibility() && node.getBoundingClientRect().bottom <= innerHeight)"
        ".map((node) => node.id || node.textContent || node.ariaLabel)"
    )
    assert len(controls) <= 12, controls


INK = "getComputedStyle(document.querySelector('#plot .y-title')).fill"
FITS = """(plot) => [...document.querySelectorAll(plot)].filter((node) => node.data).every((node) =>
  node.querySelector(".main-svg").clientWidth <= node.clientWidth && node.clientWidth <= innerWidth)"""
CONTRAST = """() => {
  const linear = (v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  const light = (css) => {
    const [r, g, b] = css.match(/\\d+/g).map((v) => linear(v / 255));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const back = light(getComputedStyle(document.body).backgroundColor);
  return ["h1", "#counts", "#task", "#notes summary", "#design dt"].map((at) => {
    const fore = light(getComputedStyle(document.querySelector(at)).color);
    return (Math.max(fore, back) + 0.05) / (Math.min(fore, back) + 0.05);
  });
}"""
INSIDE = """() => {
  const { left, right } = document.body.getBoundingClientRect();
  const out = [...document.querySelectorAll("#plot svg, .main-svg, table, #design, article")]
    .map((node) => node.getBoundingClientRect())
    .filter((box) => box.width && (box.right > right + 1 || box.left < left - 1));
  const plane = document.querySelector("#plane").getBoundingClientRect();
  const axis = document.querySelector("#plot .x-title").getBoundingClientRect();
  return { width: right - left, out: out.length, isWhole: axis.bottom <= plane.bottom };
}"""


def test_readable_at_any_size_in_light_and_dark_and_on_paper(opened):
    wide = {f"model.parameter_{k}": range(k, k + len(table())) for k in range(8)}
    frame = pd.concat([table().assign(n_weights=7, **wide), table().assign(task="speed", **wide)])
    link = "chosen=0.1&show=inside&expert=1"
    page = opened(frame.reset_index(drop=True), link, documents={0: details(0), 1: details(1)})
    for width, height in ((1280, 720), (390, 844), (320, 568)):
        page.tab.set_viewport_size({"width": width, "height": height})
        assert page.tab.locator("#plane").bounding_box()["height"] >= 320
        for tab in ("confusion", "surface", "raster", "learning"):
            page.tab.click(f"#tab-{tab}")
            page.tab.wait_for_selector(f"#design-pane [data-figure={tab}] svg >> nth=0")
            page.tab.wait_for_function(FITS, arg=".js-plotly-plot")
            assert page.fits()
    for theme, background, ink in (
        ("light", "rgb(255, 255, 255)", "rgb(27, 30, 34)"),
        ("dark", "rgb(21, 24, 28)", "rgb(232, 234, 237)"),
    ):
        page.tab.emulate_media(color_scheme=theme)
        assert page.tab.evaluate("getComputedStyle(document.body).backgroundColor") == background
        assert min(page.tab.evaluate(CONTRAST)) >= 4.5
        page.tab.wait_for_function(f"{INK} === {ink!r}")
    page.tab.set_viewport_size({"width": 1440, "height": 900})
    page.tab.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert page.tab.evaluate(INK) == "rgb(27, 30, 34)", "on paper, also of a dark screen"
    assert page.tab.evaluate(INSIDE) == {"width": 700, "out": 0, "isWhole": True}
    assert page.tab.locator("#plot .point").count() > 0, "printers leave canvases empty"
    assert page.tab.is_visible("#told") and page.tab.is_visible("#design") and page.tab.is_visible("#front")
    acting = "#asks, #tabs, #help, #more, #dial, #find, #once, .limit, .walker"
    assert page.tab.locator(f":is({acting})").filter(visible=True).count() == 0
    page.tab.evaluate("dispatchEvent(new Event('afterprint'))")
    page.tab.wait_for_function(f"{INK} === 'rgb(232, 234, 237)'")
    assert page.tab.locator("#plot .point").count() == 0 and page.tab.is_visible("#asks")
    assert page.tab.evaluate(INSIDE)["width"] == 1440
    sheets = page.tab.pdf(format="A4", margin=dict.fromkeys(("left", "right", "top", "bottom"), "12mm"))
    assert len(re.findall(rb"/Type\s*/Page[^s]", sheets)) == 2, "a report of two pages"


@pytest.mark.parametrize(
    ("link", "scheme", "size"),
    [
        ("chosen=4&f.model.hidden=30~&b.energy_uj=20", "light", (1280, 720)),
        ("ask=take&show=chips", "dark", (390, 844)),
        ("ask=cheaper&show=all&expert=1", "light", (1280, 720)),
        ("ask=why&show=run&b.energy_uj=1", "dark", (1280, 720)),
        ("show=inside&expert=1", "light", (390, 844)),
        ("show=matters", "dark", (390, 844)),
    ],
)
def test_axe_finds_nothing(opened, link, scheme, size):
    parts = {"progress": progress_of(points(hardware="a")), "audit": [ROW.columns]}
    frame = pd.concat([points(hardware=name, trial=range(5)) for name in ("a", "b")], ignore_index=True)
    page = opened(frame, link, parts=json.loads(json.dumps(parts)), size=size, scheme=scheme)
    assert page.violations() == []
    assert page.fits()


@pytest.mark.parametrize(
    ("frame", "text"), [(pd.DataFrame(), "No design yet"), (failed(), "loss is not finite")]
)
def test_nothing_to_draw_has_a_face(opened, frame, text):
    page = opened(frame, parts={"progress": progress_of(pd.DataFrame())} if len(frame) else {})
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
    assert note in page.tab.text_content("#notes")
    assert len(page.cells(1)) == n_front and page.tab.is_visible("#plot svg")


def test_costs_on_another_chip_are_not_those_of_the_chosen_design(opened):
    chips = [
        points(hardware="small", point=0, accuracy=[0.9996, 0.90, 0.85, 0.60, 0.88]),
        points(hardware="large", point=0, energy_uj=[500.0, 200.0, 210.0, 50.0, 300.0]).iloc[1:],
    ]
    page = opened(pd.concat(chips, ignore_index=True), "chosen=1.0")
    assert page.cells(2)[0].startswith(">\u202f0.999"), "a fraction below one is not rounded to one"
    assert "20 µJ" in page.sentence()
    page.tab.select_option("#hardware", "large")
    assert "200 µJ" in page.sentence()
    page.open("chosen=0.0&hardware=large")
    assert "not measured here" in page.sentence(), "this design has no row there"
    assert page.marked("your choice") == []


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
        if page.tab.locator("#show-run").count():
            page.tab.click("#show-run")
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


@pytest.mark.parametrize(
    "fragment", ["expert=1", "x=%3Cimg%3E&chosen=%22&task=__proto__&toString=1&rows=99&expert=1&find=%3C"]
)
def test_hostile_study_never_runs(opened, fragment):
    frame = points(
        **{
            "model.kind": list(HOSTILE[:5]),
            f"model.{HOSTILE[0]}": list(HOSTILE[3:8]),
            f"model.{HOSTILE[7]}\x08": [1.0, 2.0, 3.0, 4.0, 5.0],
            HOSTILE[2]: [1.0, 2.0, 3.0, 4.0, 5.0],
            "task": [*[HOSTILE[1]] * 4, HOSTILE[0]],
            "hardware": HOSTILE[1],
            "family": HOSTILE[-3],
        }
    )
    frame = pd.concat([frame, failed(HOSTILE[0] + HOSTILE[1])], ignore_index=True)
    evil = progress_of(points(task=EVIL, hardware=HOSTILE[1]))
    evil |= {"failed": [{"reason": EVIL, "count": 2, "trials": [5]}]}
    evil |= {"running": [{"trial": 9, "design": {EVIL: EVIL}}]}
    page = opened(frame, fragment, name="".join(HOSTILE), parts={"progress": evil})
    for ask in ("take", "why", "cheaper"):
        page.ask(ask)
    page.tab.select_option("#x", HOSTILE[2])
    at = page.point_at(1.0, 0.95)
    page.tab.wait_for_selector("#tip", state="visible")
    page.tab.mouse.click(*at)
    page.tab.click("#show-run")
    assert "trial 9 <img" in page.tab.inner_text("#progress .lists")
    page.tab.click("#show-all")
    names = page.tab.locator("#view-parallel .name").all_text_contents()
    assert any("<img src=x" in name for name in names) and max(map(len, names)) <= 80
    words = ElementTree.fromstring(page.saved("front", "svg")[1]).iter()
    words = [text.text for text in words if text.text]
    assert any("<svg" in text for text in words), words
    assert page.is_clean() and page.tab.locator("#view-parallel :is(img, a)").count() == 0
    assert page.tab.locator("h1").text_content() == "".join(HOSTILE)
    page.tab.set_viewport_size({"width": 390, "height": 844})
    assert page.fits()


def test_nothing_in_a_document_can_run(opened):
    n = len(HOSTILE)
    examples = [example(name, (name, "silk")) for name in HOSTILE]
    document = details(figures={"confusion": confusion_of(np.eye(n, dtype=int), HOSTILE)}, examples=examples)
    document |= {"notes": list(HOSTILE)}
    document["tasks"] = {HOSTILE[0]: document["tasks"]["texture"], "__proto__": {}}
    frame = table(4).assign(task=HOSTILE[0], **{HOSTILE[2]: 1.0})
    frame["encoder.kind"] = [HOSTILE[trial] for trial in frame["trial"]]
    frame["model.name"] = [HOSTILE[-1 - trial] for trial in frame["trial"]]
    link = "chosen=0.0&show=inside&expert=1"
    page = opened(frame, link, documents={0: document}, name=HOSTILE[1])
    for tab in ("confusion", "surface", "raster"):
        page.tab.click(f"#tab-{tab}")
        page.tab.wait_for_selector(f"#design-pane [data-figure={tab}] svg >> nth=0")
    for k, name in enumerate(HOSTILE):
        page.tab.select_option("[data-name=example]", str(k))
        answer = page.tab.inner_text("#design-pane > .summary >> nth=-1")
        assert f"{name[:30]}" in answer or "\u2028" in name
        assert page.tab.get_attribute("#design-pane [role=img]", "aria-label").startswith(name)
    for width, height in ((1280, 720), (390, 844)):
        page.tab.set_viewport_size({"width": width, "height": height})
        assert page.fits()
    assert page.is_clean()
