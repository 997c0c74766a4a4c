"""Budgets on the page, in a real browser: the numbers of the skyline, and everything that moves them."""

from __future__ import annotations

import itertools
import shlex

import numpy as np
import pandas as pd
import pytest

from dse.dashboard import gather as gather_module
from dse.dashboard.budgets import budget_columns, contenders
from dse.skyline.front import comparable, skyline
from dse.skyline.pick import pick
from tests.dashboard.page import HOSTILE, READY
from tests.page_data import OBJECTIVES, points, write_page

DIRECTIONS = {**OBJECTIVES, "latency_ms": "min", "spikes_per_inference": "min"}
TIES = [(name, way) for name, way in OBJECTIVES.items() if name != "accuracy"]


def many(n=1200, seed=0):
    """Return points of two tasks, families and chips: ties, missing numbers, misfits, leaky rows."""
    rng = np.random.default_rng(seed)
    quality = rng.random(n)
    frame = pd.DataFrame(
        {
            "trial": np.arange(n) // 6,
            "task": rng.choice(["texture", "velocity"], n),
            "family": rng.choice(["mlp", "recurrent"], n),
            "hardware": rng.choice(["small chip", "large chip"], n),
            "phi": rng.integers(0, 9, n),
            "accuracy": np.round(0.4 + 0.4 * quality + 0.2 * rng.random(n), 2),
            "energy_uj": np.exp(4 * quality + rng.normal(size=n)),
            "n_weights": (rng.integers(1, 60, n) * 1000),
            "latency_ms": rng.uniform(1, 90, n) / 3,
            "spikes_per_inference": np.round(rng.uniform(100, 900, n)),
            "fits": rng.random(n) < 0.8,
            "transductive": rng.random(n) < 0.03,
        }
    )
    frame.loc[rng.random(n) < 0.05, "energy_uj"] = np.nan
    frame.loc[rng.random(n) < 0.03, "accuracy"] = np.nan
    frame.loc[rng.random(n) < 0.03, "latency_ms"] = np.inf
    return frame


@pytest.fixture
def opened(shown, page_path):
    """Return a function that writes a page of a table and opens it."""

    def open_page(frame, *, fragment="", results="results/fabric", size=(1280, 720), name="fabric"):
        write_page(frame, page_path, name=name, objectives=OBJECTIVES, results=results)
        return shown(fragment, size=size)

    return open_page


# What the page would show under budgets, for some of which a whole reload per budget would take long.
EVALUATED = """async (moved) => {
  const page = await Data.read();
  const engine = Budgets.over(page);
  const whole = (row) => row < 0 ? null : Object.fromEntries(
    Object.entries(page.columns).map(([name, column]) => [name, column.values[row]]));
  return moved.map((state) => {
    const found = engine.evaluate(state);
    return {
      count: found.count, exact: found.exact, command: found.command, pick: whole(found.pick),
      front: found.front.map(whole), nearest: found.nearest.map(({row, missed}) => ({...whole(row), missed})),
    };
  });
}"""


def random_budgets(frame, n=20, seed=1):
    """Return n states of the page: filters, and limits from none to ones that nothing meets."""
    rng = np.random.default_rng(seed)
    states = []
    for k in range(n):
        state = {
            "task": rng.choice(["all", "texture", "velocity"]),
            "family": rng.choice(["all", "mlp", "recurrent"]),
            "hardware": rng.choice(["small chip", "large chip"]),
        }
        for name, way in DIRECTIONS.items():
            if rng.random() < 0.6:
                share = rng.uniform(0.0, 0.9) if k % 4 else 0.01
                values = frame[name][np.isfinite(frame[name])]
                limit = float(values.quantile(1 - share if way == "max" else share))
                state[f"b.{name}"] = repr(limit if k % 2 else float(f"{limit:.3g}"))
        states.append({key: str(value) for key, value in state.items()})
    return states


def expected(frame, state):
    """Return (rows within the budgets, front, pick) as `dse.skyline.front` has them."""
    conditions = [
        f"{name} == '{state[name]}'" for name in ("task", "family", "hardware") if state[name] != "all"
    ]
    limits = [
        f"{name} {'>=' if way == 'max' else '<='} {state[f'b.{name}']}"
        for name, way in DIRECTIONS.items()
        if f"b.{name}" in state
    ]
    picked = pick(frame, [*conditions, *limits], "accuracy", TIES)
    where = " and ".join([*conditions, *limits]) or None
    within = comparable(frame, [("accuracy", "max")], where).rows
    front = skyline(frame, list(OBJECTIVES.items()), where, "task").rows
    return within, front, picked


def same(row, other):
    """Return whether a row of the page is a row of the table, where a missing number is NaN."""
    names = ("trial", "phi", "accuracy", "n_weights", "energy_uj")
    return all(row[name] == other[name] or (row[name] is None and np.isnan(other[name])) for name in names)


def keys(rows):
    return sorted((row["trial"], row["phi"], row["accuracy"], row["energy_uj"]) for row in rows)


@pytest.mark.parametrize("most", [20_000, 900], ids=["whole", "thinned"])
def test_twenty_random_budgets_give_the_rows_of_the_skyline_and_the_pick(opened, monkeypatch, most):
    monkeypatch.setattr(gather_module, "MAX_POINTS", most)
    frame = many()
    page = opened(frame)
    states = random_budgets(frame)
    n_feasible = 0
    for state, got in zip(states, page.tab.evaluate(EVALUATED, states), strict=True):
        within, front, picked = expected(frame, state)
        assert got["exact"] == (most > len(frame))
        if got["exact"]:
            assert got["count"] == len(within)
        assert keys(got["front"]) == keys(front.to_dict("records"))
        if picked.row is not None:
            n_feasible += 1
            assert same(got["pick"], picked.row)
            words = shlex.split(got["command"])
            assert words[:3] == ["dse", "pick", "results/fabric"]
            budgets = [word for flag, word in itertools.pairwise(words) if flag == "--budget"]
            assert same(got["pick"], pick(frame, budgets, "accuracy", TIES).row)
        else:
            assert got["pick"] is None
            nearest = picked.nearest.iloc[0]
            assert same(got["nearest"][0], nearest)
            for missed in got["nearest"][0]["missed"]:
                sign = ">=" if missed["way"] == "max" else "<="
                name = f"missed {missed['column']}{sign}{missed['limit']:g}"
                assert missed["by"] == pytest.approx(nearest[name])
    assert 5 < n_feasible < 20


def tally(page):
    return page.tab.eval_on_selector_all("#tally span", "spans => spans.map((span) => span.textContent)")


def test_every_slider_moves_by_keyboard_and_moves_its_box(opened):
    page = opened(many(300))
    assert page.tab.locator(".budget").count() == len(DIRECTIONS)
    before = tally(page)
    for k, (name, way) in enumerate(DIRECTIONS.items()):
        page.tab.focus(f"#slider-{k}")
        for _ in range(4):
            page.tab.keyboard.press("PageUp" if way == "max" else "PageDown")
        limit = page.tab.input_value(f"#budget-{k}")
        assert float(limit) > 0
        assert page.tab.inner_text(f"#cost-{k}").startswith("costs ")
        assert limit in page.tab.inner_text("#command").split(name)[1]
        after = tally(page)
        assert after != before
        before = after
    page.tab.click("#clear")
    assert page.tab.input_value("#budget-1") == ""
    assert page.tab.evaluate("document.querySelector('#slider-1').value") == "200"


def test_every_box_takes_a_limit_and_moves_its_slider(opened):
    page = opened(many(), fragment="task=texture")
    for k, (name, way) in enumerate(DIRECTIONS.items()):
        where = page.tab.input_value(f"#slider-{k}")
        middle = many()[name].replace(np.inf, np.nan).median()
        page.tab.fill(f"#budget-{k}", f"{middle:.6g}")
        assert page.tab.input_value(f"#slider-{k}") != where
        sign = ">=" if way == "max" else "<="
        assert f"{name} {sign} {float(f'{middle:.6g}'):g}"[:12] in page.tab.inner_text("#command")
        page.tab.fill(f"#budget-{k}", "")
        assert page.tab.input_value(f"#slider-{k}") == where


def test_small_table_by_hand(opened):
    page = opened(points(), fragment="b.energy_uj=30")
    assert tally(page)[:2] == ["4 of 5 points feasible", "3 on the front"]
    assert page.tab.inner_text("#cost-1") == "costs 1"
    assert page.tab.inner_text("#pick button >> nth=0") == "Trial 1"
    assert page.tab.inner_text("#pick button >> nth=1") == "Trial 4"
    assert page.cells(1) == ["1", "2", "3"]
    assert [trace["x"] for trace in page.traces()[1:3]] == [[5, 20]] * 2
    red, _, blue, _ = page.cloud(50, 0.95)
    assert abs(red - blue) < 40, "grey: outside the budgets"
    assert page.tab.inner_text("#command") == (
        "dse pick results/fabric --budget 'energy_uj <= 30' --export bundle"
    )
    page.tab.click("#pick button >> nth=0")
    assert page.tab.inner_text("#design h2") == "Trial 1"


def test_a_link_restores_budgets_and_filters(opened):
    page = opened(many())
    page.tab.fill("#budget-1", "12.5")
    page.tab.select_option("#family", "mlp")
    page.tab.select_option("#task", "texture")
    page.tab.wait_for_function("location.hash.includes('b.energy_uj=12.5')")
    before = tally(page), page.tab.inner_text("#pick"), page.tab.inner_text("#command")
    page.tab.reload()
    page.tab.wait_for_function(READY)
    assert (tally(page), page.tab.inner_text("#pick"), page.tab.inner_text("#command")) == before
    assert page.tab.input_value("#budget-1") == "12.5"
    assert page.tab.input_value("#family") == "mlp"


def test_nothing_feasible_names_the_nearest_and_what_is_missed(opened):
    page = opened(points(), fragment="b.energy_uj=4&b.accuracy=0.6")
    assert page.tab.inner_text("#pick h2") == "Nothing is feasible"
    assert [page.tab.inner_text(f"#cost-{k}") for k in (0, 1)] == ["not alone", "from 5"]
    assert page.tab.inner_text("#pick button >> nth=0") == "Trial 3"
    assert page.tab.inner_text("#pick .missed >> nth=0") == "misses energy by 1\u00a0µJ"
    assert not page.tab.is_visible("#export")
    assert page.marked("diamond-open") == [(5, 0.6)]
    assert "nothing is within the budgets" in page.tab.get_attribute("#plot", "aria-label")
    assert tally(page)[:2] == ["0 of 5 points feasible", "0 on the front"]
    assert page.tab.is_visible("#plot .plot-container")


def test_tab_goes_through_the_budgets_in_order(opened):
    page = opened(points())
    page.tab.focus("#budget-0")
    seen = []
    for _ in range(5):
        seen.append(page.tab.evaluate("document.activeElement.id"))
        page.tab.keyboard.press("Tab")
    assert seen == ["budget-0", "slider-0", "budget-1", "slider-1", "budget-2"]
    assert page.tab.get_attribute("#slider-1", "aria-label") == "energy at most, µJ"
    assert page.tab.get_attribute("#slider-1", "aria-valuetext") == "no limit"


def test_the_command_can_be_copied(opened):
    page = opened(points(), fragment="b.energy_uj=30")
    page.tab.click("#copy")
    page.tab.wait_for_function("document.querySelector('#copied').textContent !== ''")
    assert page.tab.inner_text("#copied") == "copied"


@pytest.mark.parametrize("size", [(1280, 720), (390, 844), (320, 568)])
def test_hostile_names_are_words_in_the_panel_and_one_argument_in_the_shell(opened, size):
    frame = pd.concat(
        [points(trial=range(5 * k, 5 * k + 5), task=HOSTILE[k], family=HOSTILE[-1 - k]) for k in range(3)],
        ignore_index=True,
    )
    page = opened(frame, results="a 'b' $(c) `d`\n; e", size=size, name=HOSTILE[0])
    page.tab.evaluate("document.getElementById('shown-as').open = true")
    page.tab.select_option("#task", HOSTILE[2])
    page.tab.select_option("#family", HOSTILE[-3])
    words = shlex.split(page.tab.text_content("#command"))
    assert words[2] == "a 'b' $(c) `d`\n; e"
    budgets = [word for flag, word in itertools.pairwise(words) if flag == "--budget"]
    assert pick(frame, budgets, "accuracy", TIES).row["trial"] == 10
    assert page.tab.inner_text("#pick button >> nth=0") == "Trial 10"
    assert page.tab.evaluate("window.hacked") is None
    assert page.overflow() <= 0


@pytest.mark.parametrize("fragment", ["b.energy_uj=%3Cimg%3E&b.accuracy=NaN", "b.__proto__=1&family=%22"])
def test_a_broken_link_sets_no_budget(opened, fragment):
    page = opened(points(), fragment=fragment)
    assert tally(page)[0] == "5 of 5 points feasible"


def test_limited_columns_are_objectives_latency_and_spikes():
    frame = points(latency_ms=np.nan, decision_latency_ms=5.0, spikes_per_inference=7.0)
    assert budget_columns(frame, {**OBJECTIVES, "not a name": "min"}) == {
        **OBJECTIVES,
        "decision_latency_ms": "min",
        "spikes_per_inference": "min",
    }


def test_contenders_of_a_large_table_are_few_and_hold_every_front():
    frame = many(20_000).assign(energy_uj=lambda f: f["energy_uj"].round(1))
    rows = contenders(frame, OBJECTIVES, "accuracy")
    assert len(rows) < len(frame) / 2
    front = skyline(frame, list(OBJECTIVES.items()), "latency_ms <= 9", ["task", "family"]).rows
    assert set(front.index) <= set(rows)
