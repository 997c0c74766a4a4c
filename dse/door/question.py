"""How design points are looked at: on which chips and targets, how often, over which runs and samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from dse.config.faults import known_names
from dse.registry import param
from dse.study.repeats import CHOICES, checked, over_repeats

if TYPE_CHECKING:
    import pandas

MOST_DRAWS = 100_000


@dataclass(frozen=True)
class Question:
    """What is asked of design points, beside objectives and budgets.

    Its fields are options of the command line and of Python (`dse.open(folder).skyline(hardware="mcu_m4")`).
    """

    hardware: tuple[str, ...] = param(
        (),
        doc="compute costs on this hardware profile (name or YAML file); nothing is retrained; repeatable",
    )
    oversize: bool = param(
        False, doc="admit designs that do not fit their hardware, priced as if it were larger"
    )
    contacts_per_hour: float | None = param(
        None,
        low=0,
        doc="inferences per hour; adds the column power_mw, mean power at the sensor's step period, idle "
        "time included",
    )
    battery_mwh: float | None = param(
        None,
        low=0,
        doc="battery capacity in mWh; adds the column battery_h, battery life in hours (needs "
        "--contacts-per-hour)",
    )
    targets: tuple[str, ...] = param((), doc="leave out what none of these targets can hold")
    repeats: str = param(
        "mean",
        choices=CHOICES,
        doc="of a design that was trained several times (seeds, folds): means of all its runs (default), or "
        "every number of its last run, or of the one with the least accuracy",
    )
    confidence: float | None = param(
        None,
        low=0,
        low_open=True,
        high=1,
        doc="keep points that are on the front, and picks within all budgets at once, in at least this "
        "fraction of the samples of recordings, seeds and the chip's uncertain numbers, e.g. 0.9",
    )
    draws: int | None = param(
        None,
        low=1,
        high=MOST_DRAWS,
        doc="sample N times what is uncertain: column front_share is the fraction of samples of the chip's "
        "numbers in which a point stays non-dominated, column front_probability also varies recordings and "
        "seeds (default: 200 if --confidence or a condition asks for them, else none)",
    )

    @classmethod
    def of(cls, **options: Any) -> Self:
        """Return the question that options ask, as people write them in Python.

        Raises:
            TypeError: an unknown option, or one of another kind.
            ValueError: a number out of range.
        """
        from dse.door import arguments

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
        from dse.skyline.constraints import ExpressionError
        from dse.study import pricing

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
