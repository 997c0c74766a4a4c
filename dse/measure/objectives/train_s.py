"""Time of training."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dse.base.registry import Column, register
from dse.measure.objectives import FullReadOut


@register("objectives", "train_s")
@dataclass(frozen=True)
class TrainingTime:
    """Wall-clock time of training, as the family reports it; it depends on the machine."""

    needs = "full_read_out"
    columns = (Column("train_s", "s", "min", "Wall-clock time of training.", of_design=True),)

    def measure(self, answer: FullReadOut) -> Mapping[str, float]:
        return {"train_s": answer.outcome.train_s}
