"""A figure of something that a study did not record is one sentence."""

from typing import Any

import pandas as pd
import pytest

from dse.base import registry
from dse.base.records import Array, Dataset
from dse.data.recordings import RecordingError
from dse.show.figures import draw
from dse.store import StoreError
from dse.testing.small import SmallStudy

NEEDED = {
    "grid": {"x": "model.hidden", "y": "no.such"},
    "trade": {"parameter": "no.such"},
    "sweep": {"x": "no.such"},
    "energy": {"hardware": "loihi1_silicon"},
    "cores": {"hardware": "loihi1_silicon"},
    "inputs": {"samples": (0,)},
}
DRAWN = ("chips", "front", "price", "progress")  # of tables alone, which every study has


class Bare(SmallStudy):
    """A study that has its tables alone, without a sample length, power and precisions."""

    def points(self) -> pd.DataFrame:
        points = super().points().drop(columns=["weight_bits", "pruned_after"])
        return points.drop(columns=[name for name in points if name.startswith("power")])

    @property
    def trials(self) -> pd.DataFrame:
        return super().trials.drop(columns="window.n_steps")

    def arrays(self, trial: int, name: str) -> list[dict[str, Array]]:
        return []

    def dataset(self, trial: int) -> Dataset:
        raise StoreError(f"the data set of trial {trial} is no longer in the cache")

    def stages(self, trial: int, sample: int) -> Any:
        raise RecordingError("data must be events to be preprocessed, got kind 'time_series'")


@pytest.mark.parametrize("name", sorted(set(registry.known("figures")) - set(DRAWN)))
def test_what_is_missing_is_one_sentence(name):
    with pytest.raises((ValueError, StoreError)) as missing:
        draw(Bare(), name, **NEEDED.get(name, {}))
    text = str(missing.value)
    assert text and "\n" not in text and len(text) < 200, text


@pytest.mark.parametrize("name", DRAWN)
def test_tables_are_enough(name):
    assert draw(Bare(), name).data
