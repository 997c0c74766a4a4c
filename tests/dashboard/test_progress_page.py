"""How a study goes, in a real browser: the line, its figure, its lists, and that nothing in them can run."""

from __future__ import annotations

import json

import pandas as pd
import pytest

from dse.dashboard.gather import gather_page
from dse.dashboard.write import write_filled
from dse.figures.progress import ProgressFigure, gather_progress
from tests.page_data import OBJECTIVES, points

EVIL = '<img src=x onerror="window.hacked=1">'
SHAPES = "document.querySelector('#progress .plot').data.map(({ x, y, name }) => ({ x, y, name }))"
DRAWN = "document.querySelector('#progress .plot')?.data"
INK = "(ink) => getComputedStyle(document.querySelector('#progress .plot .ytitle')).fill === ink"


def told(frame, **more):
    """Return how a study of these points goes, with two failed and one trial stopped early of twelve."""
    growth = gather_progress(frame, OBJECTIVES, range(5), [0.1, 0.2, 0.3, 0.4, 0.5])
    return {
        "trials": {"total": 12, "done": 8, "running": 3, "failed": 2, "stopped": 1},
        "runs": {"total": 12, "done": 8},
        "running": [{"trial": 9, "design": {"model.hidden": [8, 8], "model.true_rate": 0.25}}],
        "failed": [
            {"reason": "loss is not finite", "count": 1, "trials": [5]},
            {"reason": EVIL + "x" * 500, "count": 1, "trials": [6]},
        ],
        "stopped": [{"reason": "behind the median", "count": 1, "trials": [7]}],
        "hours": 0.5,
        "time_left_s": 734.0,
        "sign": "2026-01-02T03:04:05+00:00",
        "is_running": None,
        "hypervolume": [
            {
                "task": curve.task,
                "hardware": curve.hardware,
                "hypervolume": float(curve.hypervolume[-1]),
                "trials": int(curve.trials[-1]),
                "hours": float(curve.hours[-1]),
            }
            for curve in growth.curves
        ],
        "figure": json.loads(ProgressFigure().draw(growth).to_json()) if growth.curves else None,
        **more,
    }


@pytest.fixture
def opened(new_tab, page_path):
    """Return a function that writes a page with some progress and opens it."""
    faults = []

    def open_page(frame, progress):
        page = gather_page(frame, name="fabric", objectives=OBJECTIVES)
        path = write_filled("page", page | {"progress": progress}, page_path)
        tab = new_tab()
        tab.on("pageerror", lambda error: faults.append(str(error)))
        tab.on("console", lambda line: faults.append(line.text) if line.type == "error" else None)
        tab.on("request", lambda asked: faults.append(asked.url) if asked.url.startswith("http") else None)
        tab.goto(path.as_uri(), wait_until="commit")
        tab.wait_for_function(
            "document.querySelector('#counts')?.textContent || !document.querySelector('#state')?.hidden"
        )
        return tab

    yield open_page
    assert faults == []


def unfold(tab):
    tab.click("#progress > details > summary")
    tab.wait_for_function(DRAWN)


def test_a_line_says_how_it_goes_and_unfolds(opened):
    frame = points(hardware="a")
    tab = opened(frame, told(frame))
    line = "8/12 done · 3 begun · 2 failed · 1 stopped early · 30\u202fmin spent"
    assert tab.inner_text("#progress > details > summary") == line
    assert not tab.is_visible("#progress .plot")
    unfold(tab)
    trials, hours = tab.evaluate(SHAPES)
    (curve,) = gather_progress(frame, OBJECTIVES, range(5)).curves
    assert trials["x"] == curve.trials.tolist()
    assert trials["y"] == hours["y"] == pytest.approx(curve.hypervolume.tolist())
    assert hours["x"][-1] == 0.5
    said = tab.get_attribute("#progress .plot", "aria-label")
    assert f"hypervolume {curve.hypervolume[-1]:.3f} after 5 trials and 30" in said


def test_curves_follow_the_task_and_the_chip_that_are_chosen(opened):
    frame = pd.concat([points(hardware=chip, task=task) for chip in "ab" for task in ("texture", "speed")])
    frame = frame.reset_index(drop=True)
    tab = opened(frame, told(frame))
    unfold(tab)
    names = f"[...new Set({SHAPES}.map(({{ name }}) => name))].join()"
    assert tab.evaluate(names) == "texture · a,speed · a"
    tab.select_option("#hardware", "b")
    tab.wait_for_function(f"{names} === 'texture · b,speed · b'")
    tab.select_option("#task", "speed")
    tab.wait_for_function(f"{names} === 'speed · b'")


def test_reasons_unfold_to_trials_and_nothing_in_them_runs(opened):
    frame = points(task=EVIL, hardware="</script><script>window.hacked=1</script>")
    begun = [{"trial": 9, "design": {EVIL: EVIL}}]
    tab = opened(frame, told(frame, running=begun))
    unfold(tab)
    lists = "#progress .lists"
    assert tab.locator(f"{lists} h2").all_inner_texts() == [
        "2 failed",
        "1 stopped early",
        "3 begun and not finished",
    ]
    assert not tab.get_by_text("trial 5", exact=True).nth(1).is_visible()
    tab.focus(f"{lists} li summary >> nth=0")
    tab.keyboard.press("Enter")
    assert tab.inner_text(f"{lists} li p >> nth=0") == "trial 5"
    text = tab.inner_text(lists)
    assert "trial 9 <img" in text
    assert "2 more" in text
    assert tab.locator("img").count() == 0
    assert tab.evaluate("window.hacked") is None


def test_a_study_without_points_opens_what_is_known(opened):
    tab = opened(pd.DataFrame(), told(points(), figure=None, hypervolume=[], time_left_s=None))
    assert "loss is not finite" in tab.inner_text("#progress .lists")
    assert not tab.is_visible("#progress .growth")
    assert "left" not in tab.inner_text("#progress > details > summary")


def test_a_page_without_progress_hides_it_and_words_of_counts_and_times(opened):
    tab = opened(points(), None)
    assert not tab.is_visible("#progress")
    far = "\u202f"
    spans = {
        5: f"5{far}s",
        90: f"2{far}min",
        3570: f"1{far}h",
        5400: f"1.5{far}h",
        4e6: f"1{far}111{far}h",
    }
    for seconds, text in spans.items():
        assert tab.evaluate("(s) => Progress.duration(s)", seconds) == text
    many = told(points(), runs={"total": 24_000, "done": 12_345}, hours=0)
    many["trials"] = {"total": None, "done": 12_000, "running": 3, "failed": 0, "stopped": 0}
    assert (
        tab.evaluate("(p) => Progress.summary(p, true)", many)
        == f"12{far}000 done · 12{far}345/24{far}000 runs · 3 running or waiting · 12{far}min left"
    )


def test_what_a_study_does_with_the_last_sign_of_life_in_the_reader_s_time(opened):
    tab = opened(points(), None)
    begun = told(points(), sign="2026-01-02T03:04:05+00:00")
    done = {**begun, "trials": {**begun["trials"], "done": 12, "running": 0}}
    later = "Date.parse('2026-01-02T03:04:47Z')"
    words = f"([p, running]) => Progress.stateOf({{...p, is_running: running}}, {later})"
    clock = tab.evaluate("new Date('2026-01-02T03:04:05Z').toLocaleString()")
    assert tab.evaluate(words, [begun, True]) == "running, last sign of life 42\u202fs ago"
    assert tab.evaluate(words, [begun, False]) == f"stopped, last sign of life at {clock}"
    assert tab.evaluate(words, [begun, None]) == "last sign of life 42\u202fs ago"
    assert tab.evaluate(words, [done, True]).startswith("running")
    assert tab.evaluate(words, [done, False]) == f"finished at {clock}"


def test_trials_that_are_done_before_their_points_are_said(opened):
    tab = opened(pd.DataFrame(), told(points(), figure=None, hypervolume=[]))
    assert tab.inner_text("#state h2") == "8 trials done"
    nothing = {"total": 12, "done": 0, "running": 3, "failed": 0, "stopped": 0}
    begun = told(points(), figure=None, hypervolume=[], trials=nothing, failed=[], stopped=[])
    assert opened(pd.DataFrame(), begun).inner_text("#state h2") == "No design yet"
    begun["is_running"] = True
    assert opened(pd.DataFrame(), begun).inner_text("#state h2") == "Training has begun"


def test_readable_anywhere_and_saved_as_a_picture(opened):
    frame = points(hardware="a")
    tab = opened(frame, told(frame))
    unfold(tab)
    for width in (320, 390, 1280):
        tab.set_viewport_size({"width": width, "height": 720})
        assert tab.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
    for scheme, ink in (("light", "rgb(27, 30, 34)"), ("dark", "rgb(232, 234, 237)")):
        tab.emulate_media(color_scheme=scheme)
        tab.wait_for_function(INK, arg=ink)
    for name, head in (("svg", b"<svg"), ("png", b"\x89PNG")):
        with tab.expect_download() as saved:
            tab.click(f"#progress .save button:text-is('{name.upper()}')")
        assert saved.value.suggested_filename == f"fabric-progress.{name}"
        assert saved.value.path().read_bytes().startswith(head)
