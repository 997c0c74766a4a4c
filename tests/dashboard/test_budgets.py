"""Budgets on the page, in a real browser: the numbers of the skyline, and everything that moves them."""

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
from tests.page_data import OBJECTIVES, points

DIRECTIONS = {**OBJECTIVES, "latency_ms": "min", "spikes_per_inference": "min"}
FILTERS = ("task", "family", "hardware")
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
      front: found.front.map(whole), joined: engine.joined(found, ["accuracy", "n_weights"]).map(whole),
      nearest: found.nearest.map(({row, missed}) => ({...whole(row), missed})),
    };
  });
}"""


def random_states(frame, n=30, seed=1):
    """Return n states of the page: filters, and limits from none to ones that nothing meets."""
    rng = np.random.default_rng(seed)
    states = []
    for k in range(n):
        state = {name: rng.choice(["all", *frame[name].unique()]) for name in ("task", "family")}
        state["hardware"] = rng.choice(frame["hardware"].unique())
        for name, way in DIRECTIONS.items():
            if rng.random() < 0.6:
                share = rng.uniform(0.0, 0.9) if k % 4 else 0.01
                values = frame[name][np.isfinite(frame[name])]
                limit = float(values.quantile(1 - share if way == "max" else share))
                state[f"b.{name}"] = repr(limit if k % 2 else float(f"{limit:.3g}"))
        if k >= 2 * n // 3:  # of numbers, and of words
            low, high = sorted(rng.choice(9, 2))
            state["f.phi"] = str(rng.choice([f"{low}~{high}", f"{low}~", f"~{high}"]))
            state["f.coat"] = "in:thin" if rng.random() < 0.5 else ""
        states.append({key: str(value) for key, value in state.items()})
    return states


def conditions_of(state):
    found = [f"{name} == '{state[name]}'" for name in FILTERS if state[name] != "all"]
    found += ["coat == 'thin'"] if state.get("f.coat") else []
    ends = zip((">=", "<="), state.get("f.phi", "~").split("~"), strict=True)
    found += [f"phi {sign} {end}" for sign, end in ends if end]
    signs = {name: ">=" if way == "max" else "<=" for name, way in DIRECTIONS.items()}
    return found + [f"{n} {sign} {state[f'b.{n}']}" for n, sign in signs.items() if f"b.{n}" in state]


def same(row, other):
    """Return whether a row of the page is a row of the table, where a missing number is NaN."""
    names = ("trial", "phi", "accuracy", "n_weights", "energy_uj")
    return all(row[name] == other[name] or (row[name] is None and np.isnan(other[name])) for name in names)


def keys(rows):
    return sorted((row["trial"], row["phi"], row["accuracy"], row["energy_uj"]) for row in rows)


@pytest.mark.parametrize("most", [20_000, 900], ids=["whole", "thinned"])
def test_random_budgets_and_filters_give_the_rows_of_the_skyline_and_the_pick(opened, monkeypatch, most):
    monkeypatch.setattr(gather_module, "MAX_POINTS", most)
    frame = many().assign(coat=lambda f: np.where(f["trial"] % 3, "thin", "thick"))
    states = random_states(frame)
    is_whole = most > len(frame)
    n_feasible = 0
    page = opened(frame, name=f"{most} points")
    for state, got in zip(states, page.tab.evaluate(EVALUATED, states), strict=True):
        conditions = conditions_of(state)
        where = " and ".join(conditions) or None
        picked = pick(frame, conditions, "accuracy", TIES)
        assert got["exact"] == is_whole
        if is_whole:
            assert got["count"] == len(comparable(frame, [("accuracy", "max")], where).rows)
        elif "f.phi" in state:
            continue  # with filters a sample knows its own best alone
        assert keys(got["front"]) == keys(
            skyline(frame, [*OBJECTIVES.items()], where, "task").rows.to_dict("records")
        )
        pair = skyline(frame, [("accuracy", "max"), ("n_weights", "min")], where, "task").rows
        drawn = {(row["task"], row["accuracy"], row["n_weights"]) for row in got["joined"]}
        assert drawn == {*zip(pair["task"], pair["accuracy"], pair["n_weights"], strict=True)}
        if picked.row is not None:
            n_feasible += 1
            words = shlex.split(got["command"])
            assert words[:3] == ["dse", "pick", "results/fabric"]
            budgets = [word for flag, word in itertools.pairwise(words) if flag == "--budget"]
            assert same(got["pick"], picked.row)
            assert same(got["pick"], pick(frame, budgets, "accuracy", TIES).row)
            continue
        assert got["pick"] is None
        if "f.phi" in state:
            continue  # what a filter excludes is not the nearest
        for offered, nearest in zip(got["nearest"][:1], picked.nearest.to_dict("records"), strict=False):
            assert same(offered, nearest)
            for missed in offered["missed"]:
                sign = ">=" if missed["way"] == "max" else "<="
                assert missed["by"] == pytest.approx(
                    nearest[f"missed {missed['column']}{sign}{missed['limit']:g}"]
                )
    assert 5 < n_feasible < 28


def tally(page):
    return page.tab.eval_on_selector_all("#tally span", "spans => spans.map((span) => span.textContent)")


def test_sliders_and_boxes_move_each_other_and_a_link_restores_them(opened):
    page = opened(many(300))
    assert page.tab.locator(".budget").count() == len(DIRECTIONS)
    page.tab.focus("#budget-0")
    seen = []
    for _ in range(5):
        seen.append(page.tab.evaluate("document.activeElement.id"))
        page.tab.keyboard.press("Tab")
    assert seen == ["budget-0", "slider-0", "budget-1", "slider-1", "budget-2"]
    assert page.tab.get_attribute("#slider-1", "aria-label") == "energy at most, µJ"
    assert page.tab.get_attribute("#slider-1", "aria-valuetext") == "no limit"
    before = tally(page)
    for k, (name, way) in enumerate(DIRECTIONS.items()):
        page.tab.focus(f"#slider-{k}")
        for _ in range(4):
            page.tab.keyboard.press("PageUp" if way == "max" else "PageDown")
        limit = page.tab.input_value(f"#budget-{k}")
        assert float(limit) > 0 and page.tab.inner_text(f"#cost-{k}").startswith("costs ")
        assert limit in page.tab.inner_text("#command").split(name)[1]
        before, earlier = tally(page), before
        assert before != earlier
    page.tab.click("#clear")
    assert page.tab.input_value("#budget-1") == "" and page.tab.input_value("#slider-1") == "200"
    page.tab.select_option("#family", "mlp")
    page.tab.select_option("#task", "texture")
    page.tab.wait_for_function("location.hash.includes('family=mlp')")
    for k, (name, way) in enumerate(DIRECTIONS.items()):
        middle = f"{many(300)[name].replace(np.inf, np.nan).median():.6g}"
        where = page.tab.input_value(f"#slider-{k}")
        page.tab.fill(f"#budget-{k}", middle)
        assert page.tab.input_value(f"#slider-{k}") != where
        assert f"{name} {'>=' if way == 'max' else '<='} {float(middle):g}"[:12] in page.tab.inner_text(
            "#command"
        )
        page.tab.fill(f"#budget-{k}", "")
        assert page.tab.input_value(f"#slider-{k}") == where
    page.tab.fill("#budget-1", "12.5")
    page.tab.wait_for_function("location.hash.includes('b.energy_uj=12.5')")
    shown = tally(page), page.tab.inner_text("#pick"), page.tab.inner_text("#command")
    page.tab.reload()
    page.tab.wait_for_function(READY)
    assert (tally(page), page.tab.inner_text("#pick"), page.tab.inner_text("#command")) == shown
    assert (page.tab.input_value("#budget-1"), page.tab.input_value("#family")) == ("12.5", "mlp")


def test_small_table_by_hand(opened):
    page = opened(points(), "b.energy_uj=30")
    assert tally(page)[:2] == ["4 of 5 points feasible", "3 on the front"]
    assert page.tab.inner_text("#cost-1") == "costs 1"
    assert page.tab.locator("#pick button").all_inner_texts() == ["Trial 1", "Trial 4"]
    assert page.cells(1) == ["1", "2", "3"]
    assert [trace["x"] for trace in page.traces()[1:3]] == [[5, 20]] * 2
    red, _, blue, _ = page.cloud(50, 0.95)
    assert abs(red - blue) < 40, "grey: outside the budgets"
    command = "dse pick results/fabric --budget 'energy_uj <= 30' --export bundle"
    assert page.tab.inner_text("#command") == command
    page.tab.click("#copy")
    page.tab.wait_for_function("document.querySelector('#copied').textContent !== ''")
    assert page.tab.inner_text("#copied") == "copied"
    page.tab.click("#pick button >> nth=0")
    assert page.tab.inner_text("#design h2") == "Trial 1"
    page.open("b.energy_uj=4&b.accuracy=0.6")
    assert page.tab.inner_text("#pick h2") == "Nothing is feasible"
    assert [page.tab.inner_text(f"#cost-{k}") for k in (0, 1)] == ["not alone", "from 5"]
    assert page.tab.inner_text("#pick button >> nth=0") == "Trial 3"
    assert page.tab.inner_text("#pick .missed >> nth=0") == "misses energy by 1\u00a0µJ"
    assert not page.tab.is_visible("#export")
    assert page.marked("diamond-open") == [(5, 0.6)]
    assert "nothing is within the budgets" in page.tab.get_attribute("#plot", "aria-label")
    assert tally(page)[:2] == ["0 of 5 points feasible", "0 on the front"]
    assert page.tab.is_visible("#plot .plot-container")
    for broken in ("b.energy_uj=%3Cimg%3E&b.accuracy=NaN", "b.__proto__=1&family=%22"):
        assert tally(page.open(broken))[0] == "5 of 5 points feasible"


def test_hostile_names_are_one_argument_in_the_shell(opened):
    frame = pd.concat(
        [points(trial=range(5 * k, 5 * k + 5), task=HOSTILE[k], family=HOSTILE[-1 - k]) for k in range(3)],
        ignore_index=True,
    )
    page = opened(frame, results="a 'b' $(c) `d`\n; e")
    page.tab.select_option("#task", HOSTILE[2])
    page.tab.select_option("#family", HOSTILE[-3])
    assert shlex.split(page.tab.text_content("#command"))[2] == "a 'b' $(c) `d`\n; e"
    assert pick(frame, page.budgets(), "accuracy", TIES).row["trial"] == 10
    assert page.tab.inner_text("#pick button >> nth=0") == "Trial 10"
    assert page.is_clean()


def test_limited_columns_are_objectives_latency_and_spikes():
    frame = points(latency_ms=np.nan, decision_latency_ms=5.0, spikes_per_inference=7.0)
    expected = {**OBJECTIVES, "decision_latency_ms": "min", "spikes_per_inference": "min"}
    assert budget_columns(frame, {**OBJECTIVES, "not a name": "min"}) == expected


def test_contenders_of_a_large_table_are_few_and_hold_every_front():
    frame = many(20_000).assign(energy_uj=lambda f: f["energy_uj"].round(1))
    rows = contenders(frame, OBJECTIVES, "accuracy")
    assert len(rows) < len(frame) / 2
    for objectives in ([*OBJECTIVES.items()], [*OBJECTIVES.items()][:2]):
        front = skyline(frame, objectives, "latency_ms <= 9", ["task", "family"]).rows
        goals = [name for name, _ in objectives]
        held = set(frame.loc[rows, goals].itertuples(index=False, name=None))
        assert set(front[goals].itertuples(index=False, name=None)) <= held


def test_contenders_hold_the_pick_that_the_corrected_accuracy_decides():
    frame = points(
        accuracy=[0.9, 0.9, 0.9, 0.8, 0.7],
        accuracy_corrected=[0.85, 0.86, 0.84, 0.8, 0.7],
        **{name: [1.0, 2.0, 3.0, 4.0, 5.0] for name in ("energy_uj", "latency_ms", "n_weights")},
    )
    rows = contenders(frame, OBJECTIVES, "accuracy").tolist()
    assert rows == [0, 1]  # the second costs more than the first, and is picked
    assert pick(frame, [], "accuracy", TIES).row["energy_uj"] == 2.0
