"""Which design wins on which chip, with energies that are chosen draw by draw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from dse import pricing
from dse.report import HARDWARE, Report, Row, report
from dse.report.hardware import ratio
from dse.study import Study
from tests.report.made import write

Draws = Mapping[str, Sequence[Any]]

# 20 draws: the 5 % quantile is the smallest, the 95 % quantile the second largest.
STEADY = np.full(20, 10.0)
NEAR = np.array([9.0, *[11.0] * 17, 12.0, 14.0])
DEAR = np.array([15.0, *[20.0] * 17, 30.0, 90.0])
NONE = np.full(20, np.nan)


@pytest.fixture
def priced(monkeypatch: pytest.MonkeyPatch) -> dict[str, list[Any]]:
    """Draws of the energies of every trial in turn, by chip; a chip's rows are priced as they are asked."""
    draws: dict[str, list[Any]] = {}

    def energies(folder: Path, rows: pd.DataFrame, hardware: str) -> Any:
        assert set(rows["hardware"]) == {hardware} and set(rows["point"]) == {0}
        return np.stack([draws[hardware][trial] for trial in rows["trial"]], axis=1)

    monkeypatch.setattr(pricing, "energies_uj", energies)
    return draws


def made(folder: Path, designs: Sequence[Mapping[str, Any]], draws: Draws) -> Study:
    """Write a study whose designs are priced at the median of their draws; `misfits` names chips."""
    found = []
    for trial, given in enumerate(designs):
        design = {"accuracy_se": 0.02, **given}
        misfits = design.pop("misfits", ())
        on = {chip: _columns(own[trial], chip not in misfits) for chip, own in draws.items()}
        found.append({**design, "on": on})
    return write(folder, found)


def _columns(energies: Any, fits: bool) -> dict[str, Any]:
    value = float(np.median(energies))
    if np.isnan(value):
        return {}
    return {
        "energy_uj": value,
        "energy_uj_low": value / 2,
        "energy_uj_high": value * 2,
        "latency_ms": 1000.0 + value,
        "fits": fits,
    }


def rows_of(found: Report, chip: str) -> dict[str, Row]:
    rows = [row for row in found.rows if row.system == HARDWARE and row.hardware == chip]
    named = {row.figure: row for row in rows}
    assert len(named) == len(rows)
    return named


def note_of(found: Report, chip: str) -> str:
    [note] = [note for note in found.notes if note.startswith(f"nets, texture: {chip}: ")]
    return note


def test_energies_over_common_draws_by_hand() -> None:
    # NEAR over STEADY: 0.9, 17 times 1.1, 1.2, 1.4; DEAR over STEADY: 1.5, 17 times 2, 3, 9
    assert ratio(STEADY, NEAR) == pytest.approx((1.1, 0.9, 1.2, 0.95))
    assert ratio(STEADY, DEAR) == pytest.approx((2.0, 1.5, 3.0, 1.0))
    assert ratio(STEADY, STEADY) == (1.0, 1.0, 1.0, 0.0)
    assert ratio(np.zeros(20), np.zeros(20)) == (1.0, 1.0, 1.0, 0.0), "nothing is as much as nothing"
    assert ratio(np.zeros(20), STEADY) == (np.inf, np.inf, np.inf, 1.0)


def test_a_winner_on_each_chip_and_by_how_much(tmp_path: Path, priced: dict[str, list[Any]]) -> None:
    # Within a standard error of the best, 0.9 - 0.02: trials 0, 1 and 2; on `one` 0 is cheapest, on `two` 1.
    priced |= {
        "one": [STEADY, NEAR, DEAR, STEADY / 10],
        "two": [DEAR, STEADY, DEAR, STEADY / 10],
    }
    designs = [
        {"accuracy": 0.9, "n_weights": 500, "accuracy_test": 0.7},
        {"accuracy": 0.89, "n_weights": 300},
        {"accuracy": 0.885, "n_weights": 200},
        {"accuracy": 0.87, "n_weights": 10},
    ]
    found = report([made(tmp_path / "nets", designs, priced)])
    one, two = rows_of(found, "one"), rows_of(found, "two")
    assert list(one) == [
        "winner: accuracy",
        "winner: n_weights",
        "winner: energy_uj",
        "winner: latency_ms",
        "winner of two: accuracy below",
        "winner of two: fits",
        "winner of two: energy_uj",
        "winner of two: energy ratio",
        "winner of two: share dearer",
        "designs on the front",
        "designs on the front of two too",
        "Spearman of energies, two, 4 designs",
    ]
    accuracy = one["winner: accuracy"]
    assert (accuracy.trial, accuracy.ours, accuracy.se, accuracy.test, accuracy.runs) == (
        0,
        0.9,
        0.02,
        0.7,
        1,
    )
    assert one["winner: n_weights"].ours == 500 and two["winner: n_weights"].ours == 300
    energy = one["winner: energy_uj"]
    assert (energy.ours, energy.low, energy.high) == (10.0, 5.0, 20.0)
    assert one["winner: latency_ms"].ours == 1010.0
    times = one["winner of two: energy ratio"]
    assert (times.trial, times.family) == (1, "snn")
    assert (times.ours, times.low, times.high) == pytest.approx((1.1, 0.9, 1.2))
    assert one["winner of two: share dearer"].ours == pytest.approx(0.95)
    less = one["winner of two: accuracy below"]
    assert (less.ours, less.se) == pytest.approx((0.01, np.hypot(0.02, 0.02)))
    assert note_of(found, "one").endswith(
        "snn, trial 0 wins, accuracy 0.9 ± 0.02, 10 uJ (10 to 10); the winner of two (snn, trial 1) takes "
        "1.1 times the energy (0.9 to 1.2), more in 95% of draws, within the uncertainty"
    )
    assert note_of(found, "two").endswith(
        "takes 2 times the energy (1.5 to 3), more in 100% of draws, beyond the uncertainty"
    )
    assert any(note.startswith("hardware: the winner has the least energy") for note in found.notes)


def test_ties_of_energy_go_to_fewer_weights(tmp_path: Path, priced: dict[str, list[Any]]) -> None:
    priced |= {"one": [STEADY] * 3, "two": [STEADY] * 3}
    designs = [{"accuracy": x, "n_weights": n} for x, n in ((0.9, 500), (0.89, 300), (0.89, 300))]
    found = report([made(tmp_path / "nets", designs, priced)])
    assert rows_of(found, "one")["winner: accuracy"].trial == 1, "of as many weights, the earlier"
    assert note_of(found, "one").endswith("; it wins on two too")
    assert not any(figure.startswith("winner of") for figure in rows_of(found, "one"))


def test_a_small_chip_holds_only_small_designs(tmp_path: Path, priced: dict[str, list[Any]]) -> None:
    priced |= {
        "one": [STEADY, STEADY / 5, STEADY],
        "two": [STEADY / 2, STEADY, DEAR],
        "three": [NEAR, DEAR, DEAR],
    }
    designs = [
        {"accuracy": 0.9, "misfits": ("two",)},
        {"accuracy": 0.7, "misfits": ("three",)},
        {"accuracy": 0.5},
    ]
    found = report([made(tmp_path / "nets", designs, priced)])
    one, two = rows_of(found, "one"), rows_of(found, "two")
    assert one["winner: accuracy"].trial == 0 and two["winner: accuracy"].trial == 1
    assert (
        "the winner of two (snn, trial 1) is less accurate by 0.2 ± 0.028, beyond the error, at 0.2 times"
        in (note_of(found, "one"))
    )
    assert note_of(found, "one").endswith("; it wins on three too")
    assert (
        "the winner of one (snn, trial 0) does not fit; the winner of three (snn, trial 0) does not fit"
        in (note_of(found, "two"))
    )
    assert (two["winner of one: energy_uj"].ours, two["winner of one: fits"].ours) == (5.0, 0.0)
    assert one["winner of two: fits"].ours == 1
    assert rows_of(found, "three")["winner of two: energy ratio"].ours > 1


def test_a_classifier_that_a_chip_cannot_run(tmp_path: Path, priced: dict[str, list[Any]]) -> None:
    priced |= {"spiking": [NONE, STEADY, DEAR], "any": [STEADY, STEADY, DEAR]}
    designs = [
        {"accuracy": 0.95, "family": "knn", "macs": 9.0},
        {"accuracy": 0.8},
        {"accuracy": 0.79},
    ]
    found = report([made(tmp_path / "nets", designs, priced)])
    spiking = rows_of(found, "spiking")
    assert spiking["winner: accuracy"].trial == 1
    of_any = [name for name in spiking if name.startswith("winner of any")]
    assert of_any == ["winner of any: accuracy below", "winner of any: fits"], "and no energy"
    assert spiking["winner of any: fits"].ours == 0
    below = spiking["winner of any: accuracy below"].ours
    assert below == pytest.approx(-0.15)
    assert note_of(found, "spiking").endswith("; the winner of any (knn, trial 0) cannot run here")
    assert rows_of(found, "any")["winner: accuracy"].family == "knn"


def test_a_chip_that_nothing_fits(tmp_path: Path, priced: dict[str, list[Any]]) -> None:
    priced |= {"tiny": [STEADY, NONE], "large": [STEADY, NEAR]}
    designs = [{"accuracy": 0.9, "misfits": ("tiny",)}, {"accuracy": 0.8, "family": "knn", "macs": 9.0}]
    found = report([made(tmp_path / "nets", designs, priced)])
    assert note_of(found, "tiny") == "nets, texture: tiny: no design fits"
    assert next(iter(rows_of(found, "tiny"))) == "designs on the front"
    assert rows_of(found, "tiny")["designs on the front"].ours == 0
    assert not any("tiny" in row.figure for row in rows_of(found, "large").values())


def test_one_design(tmp_path: Path, priced: dict[str, list[Any]]) -> None:
    priced |= {"one": [STEADY], "two": [NEAR]}
    found = report([made(tmp_path / "nets", [{"accuracy": 0.9}], priced)])
    assert note_of(found, "one").endswith("; it wins on two too")
    one = rows_of(found, "one")
    assert one["Spearman of energies, two, 1 designs"].ours is None, "ranks of one say nothing"
    assert one["designs on the front of two too"].ours == 1
    assert any(note.endswith("one 1, two 1, one and two are the same") for note in found.notes)


def test_fronts_differ(tmp_path: Path, priced: dict[str, list[Any]]) -> None:
    # Accuracy falls from trial to trial: on `one` energy does too, on `two` the third is dominated.
    priced |= {
        "one": [STEADY * 4, STEADY * 3, STEADY * 2, NONE],
        "two": [STEADY * 2, STEADY, STEADY * 3, STEADY],
    }
    designs = [{"accuracy": accuracy} for accuracy in (0.9, 0.8, 0.7, 0.6)]
    found = report([made(tmp_path / "nets", designs, priced)])
    figure = "designs on the front"
    assert rows_of(found, "one")[figure].ours == 3
    assert rows_of(found, "two")[figure].ours == 2
    one = rows_of(found, "one")
    assert one["designs on the front of two too"].ours == 2
    # Ranks 3 2 1 and 2 1 3: 1 - 6 (1 + 1 + 4) / (3 * 8)
    assert one["Spearman of energies, two, 3 designs"].ours == pytest.approx(-0.5)
    assert any(note.endswith("one 3, two 2, one and two share 2") for note in found.notes)


def test_what_saw_its_answers_and_other_precisions_win_nothing(
    tmp_path: Path, priced: dict[str, list[Any]]
) -> None:
    priced |= {"one": [STEADY, STEADY / 2], "two": [STEADY, STEADY / 2]}
    study = made(tmp_path / "nets", [{"accuracy": 0.9}, {"accuracy": 0.99, "transductive": True}], priced)
    points = study.points().assign(weight_bits=8.0, pruned_after=0.0)
    fewer = points.assign(accuracy=1.0, weight_bits=4.0)
    pruned = points.assign(accuracy=1.0, pruned_after=0.5)
    pd.concat([points, fewer, pruned]).to_parquet(study.folder / "points.parquet")
    found = report([study])
    assert rows_of(found, "one")["winner: accuracy"].trial == 0
    assert rows_of(found, "one")["winner: accuracy"].ours == 0.9
    accuracies = {row.ours for row in found.rows if row.system == "A" and row.figure.startswith("accuracy")}
    assert accuracies and 1.0 not in accuracies, "as trained only"


def test_where_there_is_nothing_to_compare(tmp_path: Path, priced: dict[str, list[Any]]) -> None:
    priced |= {"one": [STEADY]}
    assert not rows_of(report([made(tmp_path / "nets", [{"accuracy": 0.9}], priced)]), "one")
    assert not rows_of(report([write(tmp_path / "plain", [{"accuracy": 0.9}])]), "")
    priced |= {"two": [STEADY]}
    old = made(tmp_path / "old", [{"accuracy": 0.9}], priced)
    old.points().drop(columns="point").to_parquet(old.folder / "points.parquet")
    found = report([old])
    assert "old: chips do not compare: of a version that kept no work to price" in found.notes


def test_other_chips_are_priced_without_training(
    tmp_path: Path, priced: dict[str, list[Any]], monkeypatch: pytest.MonkeyPatch
) -> None:
    priced |= {"one": [STEADY], "two": [NEAR], "three": [DEAR]}
    every = made(tmp_path / "every" / "nets", [{"accuracy": 0.9}], priced).points()
    study = made(tmp_path / "nets", [{"accuracy": 0.9}], {"one": priced["one"]})

    def points(folder: Path, hardware: Sequence[str]) -> pd.DataFrame:
        assert folder == study.folder
        return every[every["hardware"].isin(hardware)]

    monkeypatch.setattr(pricing, "points", points)
    found = report([study], ["two", "three"])
    assert rows_of(found, "three")["winner: energy_uj"].ours == 20.0
    assert note_of(found, "two").endswith("; it wins on three too")
    assert not rows_of(found, "one")
