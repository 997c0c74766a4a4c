"""The sweep compares like with like: designs, batches, weights and schedule are those of the engine."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from benchmarks import grid
from benchmarks.sweep import Result, mean_and_error
from dse.models.snn.train import train
from dse.records import Outcome
from dse.search.space import design_at


def test_a_plain_loop_trains_a_design_as_the_engine_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DSE_DATA", raising=False)
    space, data, recorded = grid.load(tmp_path, 2, "float32")
    assert not recorded
    number = 22
    accuracy = grid.task(space, data, [number]).train("csr loop", number)
    ((_, outcome),) = train(data, [grid.designs(space)[number]], grid.shared(space))
    assert isinstance(outcome, Outcome)
    found = outcome.validation.output.sum(axis=1).argmax(axis=1) == data.target[data.validation]
    assert accuracy == found.mean()
    assert 1.5 / len(data.classes) < accuracy < 1


def test_some_designs_stand_for_the_grid(tmp_path: Path) -> None:
    space, _, _ = grid.load(tmp_path, 1, "integer")
    assert space.n_designs == grid.N_DESIGNS
    chosen = [design_at(space, number) for number in grid.some()]
    assert set(Counter(x["model.hidden"] for x in chosen).values()) == {2}
    assert set(Counter(x["model.true_rate"] for x in chosen).values()) == {4}
    assert set(Counter(x["training.learning_rate"] for x in chosen).values()) == {1, 2}


def test_time_is_scaled_up_and_accuracy_has_its_standard_error() -> None:
    result = Result({0: 1.0, 6: 3.0}, {0: 0.5, 6: 0.7})
    assert result.whole_s == 2 * grid.N_DESIGNS
    assert result.mean([0, 6]) == mean_and_error([0.5, 0.7]) == "0.600 ± 0.100"
    assert np.isnan(float(mean_and_error([0.5, np.nan]).split(" ")[0]))
