"""What is asked of design points: by which objectives, under which conditions, on which chips, how surely."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from dse.base.registry import Rule, param
from dse.config.values import read, read_object

if TYPE_CHECKING:
    import pandas

    from dse.skyline.table import Goal

CERTAINTY = ("front_share", "front_probability")
"""Columns of what is sampled (`dse.study.resampling.certainty`)."""
MOST_DRAWS = 100_000
DRAWS = 200
"""Number of samples of recordings, seeds and uncertain numbers where it is not stated."""


@dataclass(frozen=True)
class Question:
    """What a front, a pick, a page or a comparison is of.

    Its fields are options of the command line and of Python (`dse.open(folder).skyline(hardware="mcu_m4")`).
    """

    objectives: str | None = param(
        None, doc="e.g. accuracy:max,energy_uj:min (default: the objectives of the study)"
    )
    where: tuple[str, ...] = param(
        (),
        doc='keep the points that meet this condition, e.g. "n_weights <= 100000 and phi > 2"; repeatable: '
        "all must be met",
    )
    by: tuple[str, ...] = param(
        (),
        doc="compute one front per value of this column, e.g. task; separate several columns by commas. "
        "Costs on different hardware are never compared",
    )
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
    targets: tuple[str, ...] = param((), doc="leave out what none of these targets can hold")
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
    def of(cls, *, objectives: Any = None, **options: Any) -> Self:
        """Return the question that options ask, as people write them in Python; None is the default.

        Args:
            objectives: 'accuracy:max,energy_uj:min', a list of such texts or of pairs, or a mapping.
            options: the other fields.

        Raises:
            TypeError: an unknown option, or one of another kind or out of range.
        """
        given = {name: value for name, value in options.items() if value is not None}
        if objectives is not None:
            pairs = list(objectives.items()) if isinstance(objectives, Mapping) else objectives
            given["objectives"] = pairs if isinstance(pairs, str) else ",".join(map(_goal, _listed(pairs)))
        question = read_object(cls, given, (), _refuse)
        assert question is not None  # else it was refused
        return question

    @property
    def groups(self) -> list[str]:
        """The columns of `by`, one each."""
        return [name.strip() for each in self.by for name in each.split(",") if name.strip()]

    def goals(self, results: str | Path) -> list[Goal]:
        """Return the objectives that are asked for, else those of a study.

        Raises:
            ExpressionError: they cannot be read, or a table has none.
            TableError: there is no such table.
        """
        from dse.skyline.constraints import ExpressionError
        from dse.skyline.table import TableError, parse_goals
        from dse.study.results import open as open_study

        if self.objectives is not None:
            return parse_goals(self.objectives)
        if not Path(results).exists():
            raise TableError(f"{results}: no such file")
        if not Path(results).is_dir():
            text = "a table has no objectives of its own; state them: --objectives accuracy:max,..."
            raise ExpressionError(f"{results}: {text}")
        return open_study(results).objectives

    def points(self, results: Sequence[str | Path]) -> list[pandas.DataFrame]:
        """Return the design points of studies, or of tables, as they are asked for.

        Raises:
            StoreError: a table is no study where one is needed, or a study is damaged.
            TableError: a table cannot be read.
        """
        from dse.skyline.table import read as read_table
        from dse.study import held

        if not self.hardware:
            frames = [held.without_lost(Path(path), read_table(path)) for path in results]
        else:
            from dse.study import pricing

            pricing.check_studies(results, "--hardware needs")
            frames = [pricing.points(path, self.hardware) for path in results]
        if self.contacts_per_hour is not None:
            from dse.study import pricing

            frames = [pricing.at_rate(frame, self.contacts_per_hour) for frame in frames]
        return frames


def texts(value: Any, name: str) -> list[str]:
    """Return a text, or a list of texts, as a list; None is none.

    Raises:
        TypeError: it is neither.
    """
    read_texts = () if value is None else read(value, tuple[str, ...], Rule(), (name,), _refuse)
    return list(read_texts)


def _goal(pair: Any) -> str:
    if not isinstance(pair, str) and not (isinstance(pair, list | tuple) and len(pair) == 2):
        raise TypeError(f"objectives must be pairs such as ('energy_uj', 'min'), got {pair!r}")
    return pair if isinstance(pair, str) else ":".join(texts(list(pair), "objectives"))


def _listed(value: Any) -> Any:
    if not isinstance(value, list | tuple):
        raise TypeError(f"objectives must be like 'accuracy:max,energy_uj:min', got {value!r}")
    return value


def _refuse(_: object, text: str) -> None:
    raise TypeError(text)
