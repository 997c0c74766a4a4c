"""Which design is cheapest on which chip, with energies that are chosen draw by draw."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import pytest

from dse.show.report.gather import report
from dse.show.report.hardware import HOW
from dse.show.report.rows import HARDWARE
from dse.study import pricing, rivals
from tests.show.report.made import write

Draws = Mapping[str, Sequence[Any]]

# 20 draws: the 5 % quantile is the smallest, the 95 % quantile the second largest.
STEADY = np.full(20, 10.0)
NEAR = np.array([9.0, *[11.0] * 17, 12.0, 14.0])
DEAR = np.array([15.0, *[20.0] * 17, 30.0, 90.0])
NONE = np.full(20, np.nan)


@pytest.fixture
def priced(monkeypatch):
    """Draws of the energies of every trial in turn, by chip; a pair is flat out and at the period."""
    draws = {}

    def drawn(folder, rows, columns, n_draws, hardware):
        [hardware] = set(rows["hardware"])
        assert set(rows["point"]) == {0}
        both = [_both(draws[hardware][trial]) for trial in rows["trial"]]
        return {name: np.stack([each[name] for each in both], axis=1) for name in columns}

    monkeypatch.setattr(pricing, "drawn", drawn)
    monkeypatch.setattr(rivals, "sentences", lambda *_: [])  # has draws of its own
    return draws


def made(folder, designs, draws, interval_only=(), n_validation=10**6):
    """Write a study whose designs are priced at the median of their draws; `misfits` names chips."""
    found = []
    for trial, given in enumerate(designs):
        design = {"accuracy_se": 0.02, **given}
        misfits = design.pop("misfits", ())
        on = {
            chip: _columns(own[trial], chip not in misfits, chip not in interval_only)
            for chip, own in draws.items()
        }
        found.append({**design, "on": on})
    return write(folder, found, samples={"train": 20, "validation": n_validation, "test": 0})


def _both(energies):
    flat_out, at_period = energies if isinstance(energies, tuple) else (energies, energies)
    return {"energy_uj": flat_out, "energy_throttled_uj": at_period}


def _columns(energies, fits, has_value):
    both = {name: float(np.median(drawn)) for name, drawn in _both(energies).items()}
    if np.isnan(both["energy_uj"]):
        return {}
    columns = {"latency_ms": 1000.0 + both["energy_uj"], "fits": fits}
    for name, value in both.items():
        columns |= {name: value if has_value else np.nan, f"{name}_low": value / 2, f"{name}_high": value * 2}
    return columns


def rows_of(found, chip):
    rows = [row for row in found.rows if row.system == HARDWARE and row.hardware == chip]
    named = {row.figure: row for row in rows}
    assert len(named) == len(rows)
    return named


def at_level(found, mode):
    [note] = [note for note in found.notes if note.startswith("nets, texture: at") and f", {mode}: " in note]
    return note


def middle(row):
    return row.trial, row.ours, row.low, row.high


def test_a_chip_that_nothing_fits(tmp_path, priced):
    priced |= {"tiny": [STEADY, NONE], "large": [STEADY, NEAR], "larger": [STEADY, NEAR]}
    designs = [{"accuracy": 0.9, "misfits": ("tiny",)}, {"accuracy": 0.8, "family": "knn", "macs": 9.0}]
    found = report([made(tmp_path / "nets", designs, priced)])
    assert "nets, texture: tiny: no design fits" in found.notes
    assert [found.notes.count(text) for text in HOW] == [1] * len(HOW)
    assert not rows_of(found, "tiny")
    assert rows_of(found, "large")["equal accuracy: accuracy"].ours == 0.9, "the others are compared"
    assert not any("tiny" in figure for figure in rows_of(found, "large"))
    assert "tiny" not in at_level(found, "flat out")

    alone = {name: priced[name] for name in ("tiny", "large")}
    found = report([made(tmp_path / "alone" / "nets", designs, alone)])
    assert not any("equal accuracy" in row.figure for row in found.rows), "a chip alone compares with none"


def test_chips_at_equal_accuracy(tmp_path, priced):
    # `two` reaches 0.7 ± 0.02, by trial 1, and it is its cheapest; on `one` trial 2 is, of 0.69.
    few = np.array([1.0, 2.0])
    priced |= {
        "one": [(STEADY[:2], STEADY[:2] * 2), (few * 3, few * 9), (few, few * 10)],
        "two": [(few, few), (few * 2, few * 4), (few * 3, few * 3)],
    }
    designs = [
        {"accuracy": 0.9, "misfits": ("two",)},
        {"accuracy": 0.7, "n_weights": 50},
        {"accuracy": 0.69, "n_weights": 60},
    ]
    found = report([made(tmp_path / "nets", designs, priced)])
    one, two = rows_of(found, "one"), rows_of(found, "two")
    equal = [name for name in one if name.startswith("equal accuracy: ")]
    assert [name.removeprefix("equal accuracy: ") for name in equal] == [
        "accuracy",
        "n_weights",
        "energy_uj",
        "latency_ms",
        "energy_uj over that on two",
        "energy_throttled_uj",
        "energy_throttled_uj over that on two",
    ]
    assert not any("over that on one" in name for name in two), "a pair is said once"
    assert middle(one["equal accuracy: energy_uj"]) == (2, 1.5, 0.75, 3.0)
    assert middle(two["equal accuracy: energy_uj"]) == (1, 3.0, 1.5, 6.0)
    assert (two["equal accuracy: accuracy"].ours, two["equal accuracy: n_weights"].ours) == (0.7, 50)
    assert two["equal accuracy: latency_ms"].ours == 1003.0
    # 1 and 2 over 2 and 4: 0.25, 0.5, 0.5, 1
    assert middle(one["equal accuracy: energy_uj over that on two"]) == (2, 0.5, 0.25, 1.0)
    assert at_level(found, "flat out") == (
        "nets, texture: at accuracy 0.7 ± 0.02, flat out: one 1 uJ (1 to 2), snn, trial 2; two 2 uJ (2 to "
        "4), snn, trial 1; two over one: 2 times the energy (1 to 4), more in 75% of draws, within the "
        "uncertainty"
    )
    # At the period 1 is cheapest on `one`, 2 on `two`: 9 and 18 over 3 and 6 are 1.5, 3, 3 and 6.
    assert middle(one["equal accuracy: energy_throttled_uj"]) == (1, 13.5, 6.75, 27.0)
    assert middle(one["equal accuracy: energy_throttled_uj over that on two"]) == (1, 3.0, 1.5, 6.0)
    assert at_level(found, "at the sensor's period").endswith(
        "period: two 3 uJ (3 to 6), snn, trial 2; one 9 uJ (9 to 18), snn, trial 1; one over two: 3 times "
        "the energy (1.5 to 6), more in 100% of draws, beyond the uncertainty; flat out the order is one, two"
    )


def test_chips_are_set_against_the_next_cheaper_and_the_cheapest(tmp_path, priced):
    priced |= {name: [STEADY * k] for name, k in (("c", 4), ("a", 1), ("d", 8), ("b", 2))}
    found = report([made(tmp_path / "nets", [{"accuracy": 0.9}], priced)])
    told = [part.split(",")[0] for part in at_level(found, "flat out").split("; ") if " over " in part]
    assert told == [
        "b over a: 2 times the energy (2 to 2)",
        "c over b: 2 times the energy (2 to 2)",
        "c over a: 4 times the energy (4 to 4)",
        "d over c: 2 times the energy (2 to 2)",
        "d over a: 8 times the energy (8 to 8)",
    ]
    assert "order" not in at_level(found, "at the sensor's period")
    pairs = [row for row in found.rows if row.figure.startswith("equal accuracy: energy_uj over")]
    assert len(pairs) == 6, "rows hold every pair"


def test_a_chip_of_which_only_intervals_are_known(tmp_path, priced):
    priced |= {"one": [STEADY, DEAR], "two": [STEADY, DEAR]}
    designs = [{"accuracy": 0.9}, {"accuracy": 0.89}]
    found = report([made(tmp_path / "nets", designs, priced, interval_only=("one",))])
    one = rows_of(found, "one")
    assert middle(one["equal accuracy: energy_uj"]) == (0, None, 5.0, 20.0)
    assert middle(one["equal accuracy: energy_uj over that on two"]) == (0, None, 1.0, 1.0)
    assert "one 10 to 10 uJ, snn, trial 0; two 10 uJ (10 to 10)" in at_level(found, "flat out")


def test_what_saw_its_answers_and_other_precisions_win_nothing(tmp_path, priced):
    priced |= {"one": [STEADY, STEADY / 2], "two": [STEADY, STEADY / 2]}
    study = made(tmp_path / "nets", [{"accuracy": 0.9}, {"accuracy": 0.99, "transductive": True}], priced)
    points = study.points().assign(weight_bits=8.0, pruned_after=0.0)
    fewer = points.assign(accuracy=1.0, weight_bits=4.0)
    pruned = points.assign(accuracy=1.0, pruned_after=0.5)
    pd.concat([points, fewer, pruned]).to_parquet(study.folder / "points.parquet")
    found = report([study])
    accuracy = rows_of(found, "one")["equal accuracy: accuracy"]
    assert (accuracy.trial, accuracy.ours) == (0, 0.9)
    accuracies = {row.ours for row in found.rows if row.system == "A" and row.figure.startswith("accuracy")}
    assert accuracies and 1.0 not in accuracies, "as trained only"


def test_where_there_is_nothing_to_compare(tmp_path, priced):
    priced |= {"one": [STEADY]}
    assert not rows_of(report([made(tmp_path / "nets", [{"accuracy": 0.9}], priced)]), "one")
    assert not rows_of(report([write(tmp_path / "plain", [{"accuracy": 0.9}])]), "")
    priced |= {"two": [NEAR]}
    found = report([made(tmp_path / "both" / "nets", [{"accuracy": 0.9}], priced)])
    one = rows_of(found, "one")
    # Of 400 pairs 20 are 10 / 14, 20 are 10 / 12, 340 are 10 / 11 and 20 are 10 / 9.
    times = one["equal accuracy: energy_uj over that on two"]
    assert middle(times) == pytest.approx((0, 10 / 11, 10 / 14, 10 / 11))


def test_other_chips_are_priced_without_training(tmp_path, priced, monkeypatch):
    priced |= {"one": [STEADY], "two": [NEAR], "three": [DEAR]}
    every = made(tmp_path / "every" / "nets", [{"accuracy": 0.9}], priced).points()
    study = made(tmp_path / "nets", [{"accuracy": 0.9}], {"one": priced["one"]})

    def points(folder, hardware):
        assert folder == study.folder
        return every[every["hardware"].isin(hardware)]

    monkeypatch.setattr(pricing, "points", points)
    found = report([study], ["two", "three"])
    assert rows_of(found, "three")["equal accuracy: energy_uj"].ours == 20.0
    assert "two 11 uJ" in at_level(found, "flat out")
    assert not rows_of(found, "one")
