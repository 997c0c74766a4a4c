"""How design points are looked at: on which chips and targets, how often, over which runs and samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from dse.config.faults import known_names
from dse.door import arguments
from dse.skyline.constraints import ExpressionError
from dse.study import pricing
from dse.study.repeats import checked, over_repeats

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Question:
    """What is asked of design points, beside objectives and budgets.

    hardware: profiles, by name or file, to compute costs on; empty: those of the study.
    oversize: admit designs that do not fit their hardware; their costs are as if it were larger.
    contacts_per_hour: inferences per hour, for columns power_mw and battery_h.
    battery_mwh: capacity of the battery.
    targets: names of targets, for columns ram_bytes and cycles; points that none can hold are left out.
    repeats: of a design with several runs, 'mean' of all, or the 'last' or 'worst' run alone.
    confidence: fraction of the samples of recordings, seeds and uncertain numbers in which a point must be on
        the front (and a pick within all budgets).
    draws: number of samples; a front has columns front_share and front_probability then.
    """

    hardware: tuple[str, ...] = ()
    oversize: bool = False
    contacts_per_hour: float | None = None
    battery_mwh: float | None = None
    targets: tuple[str, ...] = ()
    repeats: str = "mean"
    confidence: float | None = None
    draws: int | None = None

    @classmethod
    def of(cls, **options: Any) -> Self:
        """Return the question that options ask, as people write them in Python.

        Raises:
            TypeError: an unknown option, or one of another kind.
            ValueError: a number out of range.
        """
        known = [field.name for field in fields(cls)]
        if strange := [name for name in options if name not in known]:
            raise TypeError(f"unknown option '{strange[0]}'; {known_names(strange[0], known)}")
        for name in ("hardware", "targets"):
            options[name] = tuple(arguments.texts(options.get(name), name))
        for name in ("confidence", "contacts_per_hour", "battery_mwh"):
            options[name] = arguments.amount(
                options.get(name), name, high=1 if name == "confidence" else None
            )
        if not isinstance(options.get("oversize", False), bool):
            raise TypeError(f"oversize must be True or False, got {options['oversize']!r}")
        if (draws := options.get("draws")) is not None and (type(draws) is not int or draws < 1):
            raise ValueError(f"draws must be a positive integer, got {draws!r}")
        checked(options.get("repeats", "mean"))
        return cls(**options)

    def points(self, results: Sequence[str | Path]) -> list[pandas.DataFrame]:
        """Return the design points of studies, or of tables, as they are asked for.

        Raises:
            ExpressionError: samples are asked for of single runs.
            StoreError: a table is no study where one is needed, or a study is damaged.
            TableError: a table cannot be read.
        """
        frames = pricing.tables(results, self.hardware)
        if self.repeats != "mean":
            if self.draws or self.confidence is not None:
                text = f"repeats {self.repeats} is one run of each design: samples are over all runs"
                raise ExpressionError(text)
            pricing.check_studies(results, "repeats needs")
            frames = [
                over_repeats(Path(path), frame, self.repeats)
                for path, frame in zip(results, frames, strict=True)
            ]
        return [pricing.on_duty(frame, self.contacts_per_hour, self.battery_mwh) for frame in frames]
