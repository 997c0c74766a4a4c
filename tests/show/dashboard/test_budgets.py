"""Budgets on the page, in a real browser: the numbers of the skyline, and everything that moves them."""

import itertools
import shlex

import numpy as np
import pandas as pd
import pytest

from dse.show.dashboard import gather as gather_module
from dse.show.dashboard.budgets import budget_columns, contenders
from dse.skyline.front import comparable, skyline
from dse.skyline.pick import pick
from tests.page_data import OBJECTIVES, points
from tests.show.dashboard.page import HOSTILE

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
            "accuracy_se": 0.02,
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
      best: whole(found.best),
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
    n_feasible = n_cheaper = 0
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
            assert same(got["best"], picked.row)
            assert same(got["pick"], pick(frame, budgets, "accuracy", TIES).row)
            alike = frame if where is None else comparable(frame, [("accuracy", "max")], where).rows
            alike = alike[alike["accuracy"] >= picked.row["accuracy"] - picked.row["accuracy_se"]]
            if is_whole and where is not None and np.isfinite(alike["energy_uj"]).any():
                assert got["pick"]["energy_uj"] == alike["energy_uj"].min()
                n_cheaper += got["pick"]["energy_uj"] < picked.row["energy_uj"]
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
    assert n_cheaper > 3 or not is_whole


def test_hostile_names_are_one_argument_in_the_shell(opened):
    frame = pd.concat(
        [points(trial=range(5 * k, 5 * k + 5), task=HOSTILE[k], family=HOSTILE[-1 - k]) for k in range(3)],
        ignore_index=True,
    )
    page = opened(frame, "expert=1", results="a 'b' $(c) `d`\n; e")
    page.tab.select_option("#task", HOSTILE[2])
    page.tab.select_option("#family", HOSTILE[-3])
    assert page.command()[2] == "a 'b' $(c) `d`\n; e"
    assert pick(frame, page.budgets(), "accuracy", TIES).row["trial"] == 10
    assert page.tab.get_attribute("#cards article", "title") == "Trial 10"
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
