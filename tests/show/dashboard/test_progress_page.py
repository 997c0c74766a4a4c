"""How a study goes, in a real browser: the line, its figure, its lists, and its words."""

import pandas as pd
import pytest

from dse.show.figures.progress import gather_progress
from tests.page_data import OBJECTIVES, points
from tests.show.dashboard.designs import progress_of

SHAPES = "document.querySelector('#progress .plot').data.map(({ x, y, name }) => ({ x, y, name }))"
NAMES = f"[...new Set({SHAPES}.map(({{ name }}) => name))].join()"
LINE = "#counts"


def unfold(tab):
    tab.click("#show-run")
    tab.wait_for_function("document.querySelector('#progress .plot')?.data")
    tab.wait_for_function("document.querySelector('#progress .plot')?.data")


def test_a_line_says_how_it_goes_and_unfolds_to_a_figure_and_lists(opened):
    frame = points(hardware="a")
    tab = opened(frame, parts={"progress": progress_of(frame)}).tab
    line = "8/12 done · 3 begun · 2 failed · 1 stopped early · 30\u202fmin spent"
    assert line in tab.inner_text("#counts") and not tab.is_visible("#progress .plot")
    unfold(tab)
    trials, hours = tab.evaluate(SHAPES)
    (curve,) = gather_progress(frame, OBJECTIVES, range(5))
    assert trials["x"] == curve.trials.tolist() and hours["x"][-1] == 0.5
    assert trials["y"] == hours["y"] == pytest.approx(curve.hypervolume.tolist())
    said = tab.get_attribute("#progress .plot", "aria-label")
    assert f"hypervolume {curve.hypervolume[-1]:.3f} after 5 trials and 30" in said
    lists = "#progress .lists"
    heads = ["2 failed", "1 stopped early", "3 begun and not finished"]
    assert tab.locator(f"{lists} h2").all_inner_texts() == heads
    assert not tab.get_by_text("trial 5", exact=True).nth(1).is_visible()
    tab.focus(f"{lists} li summary >> nth=0")
    tab.keyboard.press("Enter")
    assert tab.inner_text(f"{lists} li p >> nth=0") == "trial 5" and "2 more" in tab.inner_text(lists)


def test_curves_follow_the_task_and_the_chip_that_are_chosen(opened):
    frame = pd.concat([points(hardware=chip, task=task) for chip in "ab" for task in ("texture", "speed")])
    frame = frame.reset_index(drop=True)
    tab = opened(frame, parts={"progress": progress_of(frame)}).tab
    unfold(tab)
    assert tab.evaluate(NAMES) == "texture · a"
    tab.select_option("#hardware", "b")
    tab.wait_for_function(f"{NAMES} === 'texture · b'")
    tab.select_option("#task", "speed")
    tab.wait_for_function(f"{NAMES} === 'speed · b'")


def test_a_study_without_points_opens_what_is_known(opened):
    def empty(**more):
        return opened(pd.DataFrame(), parts={"progress": progress_of(pd.DataFrame(), **more)}).tab

    tab = empty()
    assert "loss is not finite" in tab.inner_text("#progress .lists")
    assert not tab.is_visible("#progress .growth") and "left" not in tab.inner_text(LINE)
    assert tab.inner_text("#state h2") == "8 trials done", "whose points are still to come"
    nothing = {"total": 12, "done": 0, "running": 3, "failed": 0, "stopped": 0}
    begun = {"trials": nothing, "failed": [], "stopped": []}
    assert empty(**begun).inner_text("#state h2") == "No design yet"
    assert empty(**begun, is_running=True).inner_text("#state h2") == "Training has begun"


def test_words_of_counts_times_and_the_last_sign_of_life(opened):
    tab = opened(points(), parts={"progress": None}).tab
    assert not tab.is_visible("#progress")
    far = "\u202f"
    spans = {5: f"5{far}s", 90: f"2{far}min", 3570: f"1{far}h", 5400: f"1.5{far}h", 4e6: f"1{far}111{far}h"}
    for seconds, text in spans.items():
        assert tab.evaluate("(s) => Progress.duration(s)", seconds) == text
    many = progress_of(points(), runs={"total": 24_000, "done": 12_345}, hours=0)
    many["trials"] = {"total": None, "done": 12_000, "running": 3, "failed": 0, "stopped": 0}
    words = f"12{far}000 done · 12{far}345/24{far}000 runs · 3 running or waiting · 12{far}min left"
    assert tab.evaluate("(p) => Progress.summary(p, true)", many) == words
    begun = progress_of(points())
    done = {**begun, "trials": {**begun["trials"], "done": 12, "running": 0}}
    later = "Date.parse('2026-01-02T03:04:47Z')"
    state = f"([p, running]) => Progress.stateOf({{...p, is_running: running}}, {later})"
    clock = tab.evaluate("new Date('2026-01-02T03:04:05Z').toLocaleString()")
    heard = f"last sign of life 42{far}s ago"
    assert [tab.evaluate(state, [begun, is_running]) for is_running in (True, False, None)] == [
        f"running, {heard}",
        f"stopped, last sign of life at {clock}",
        heard,
    ]
    assert tab.evaluate(state, [done, True]).startswith("running")
    assert tab.evaluate(state, [done, False]) == f"finished at {clock}"
