"""Section `search`: how designs are proposed, how often each is trained, and what ends the search."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

from dse.base import registry
from dse.base.registry import param
from dse.config.axes import Axis, n_combinations
from dse.config.bounds import MOST_TRIALS
from dse.config.contracts import SamplerSettings
from dse.config.parts import KeyFault, Part, Written
from dse.config.settings import KFold
from dse.config.values import plain
from dse.config.yaml_lines import Raw

AUTO = "auto"
"""The sampler that is chosen by the number of designs."""
_FEW = 12
_BATCH = 8


@dataclass(frozen=True)
class Racing:
    """Which designs stop before their last epoch: those that others are ahead of."""

    ignored: ClassVar[frozenset[str]] = frozenset({"audit"})

    rungs: tuple[float, ...] = param(
        doc="epochs after which each design is measured, and stops or goes on, rising; below 1: shares of "
        "training.epochs, the least of the designs",
        low=0,
        low_open=True,
    )
    eta: float = param(
        3.0,
        doc="of the designs at a rung one in so many goes on, the best front first, and two per objective at "
        "least; less loses less of the front",
        low=1,
        low_open=True,
    )

    def __post_init__(self) -> None:
        """Check the order of the rungs, and that they are shares or whole."""
        if not self.rungs or list(self.rungs) != sorted(set(self.rungs)):
            raise ValueError(f"rungs must be at least one number of epochs, rising, got {list(self.rungs)}")
        if parts := [rung for rung in self.rungs if rung > 1 and rung % 1]:
            raise ValueError(f"rungs must be whole numbers of epochs, or shares below 1, got {parts[0]:g}")

    def at(self, epochs: int) -> list[int]:
        """Return the rungs of trainings of so many epochs, rising.

        >>> Racing(rungs=(0.1, 0.5, 20)).at(30)
        [3, 15, 20]
        """
        return sorted({max(1, round(rung * epochs)) if rung < 1 else int(rung) for rung in self.rungs})


@dataclass(frozen=True)
class Stop:
    """What ends a search before all designs are trained."""

    gone: ClassVar[Mapping[str, str]] = {"cpu_hours": "minutes ends a command in time"}

    minutes: float = param(
        doc="time that a command takes, its last tables included: no training begins that cannot end by "
        "then, by estimates, and one that does not end is stopped and goes on at the next command from where "
        "it stood at most 20 s before",
        unit="min",
        low=0,
        low_open=True,
    )


@dataclass(frozen=True)
class Search:
    """How designs are proposed and how often each is trained; a sampler adds its own keys."""

    gone: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(
            ("front_undecided", "front_trainings"), "repeats_on_front repeats all designs on the front"
        ),
        "from": "every study trains its own designs",
    }

    sampler: SamplerSettings = param(  # noqa: RUF009
        "grid",
        component="search.samplers",
        doc="a component of search.samplers (default: grid if every axis is a choice or has a step, "
        "otherwise tpe), or auto: grid where n_trials covers it, sobol below 12 designs, else tpe",
    )
    n_trials: int | None = param(None, doc="number of designs to train (default: the whole grid)", low=1)
    batch: int = param(
        _BATCH,
        doc="number of designs proposed at a time (default: the whole grid for sampler grid, otherwise 8)",
        low=1,
        high=MOST_TRIALS,
    )
    repeats: int = param(
        1,
        doc="trainings of each design, each with its own seed (default: 1, or one per fold of split.k_fold)",
        low=1,
    )
    repeats_on_front: int = param(
        1, doc="trainings of each design on the front of its task and family", low=1
    )
    racing: Racing | None = param(  # noqa: RUF009
        None,
        doc="stop designs early: keys rungs, eta; families whose training cannot pause train to their ends "
        "(default: all designs do)",
    )
    stop: Stop | None = param(  # noqa: RUF009
        None,
        doc="key minutes: the search ends when the command took so long",
    )

    @property
    def sampler_name(self) -> str:
        """The name of the sampler."""
        return registry.name_of("search.samplers", self.sampler)

    def to_plain(self) -> dict[str, Raw]:
        """Return the settings as they are written in YAML; what is not set is left out."""
        return {key: value for key, value in plain(self).items() if value not in (None, ())}

    @classmethod
    def faults(cls, part: Part, space: Written) -> Iterator[KeyFault]:
        """Yield what folds and epochs lack for the search."""
        if not part.good:
            return
        search, n_folds = part.fixed, folds(space.parts)
        for key, n in (("repeats", search.repeats), ("repeats_on_front", search.repeats_on_front)):
            if n_folds and n % n_folds and (key == "repeats" or n > search.repeats):
                text = f"must be a multiple of split.k_fold.k = {n_folds}, one run per fold, got {n}"
                yield part.fault(key, text)
        if search.racing is None:
            return
        epochs = min(space.range("training", "epochs"), default=math.inf)
        for index, rung in enumerate(search.racing.rungs):
            if rung >= epochs:
                text = f"must be below training.epochs, {epochs}, got {rung:g}"
                yield ("search", "racing", "rungs", index), f"search.racing.rungs {text}"


def folds(parts: Mapping[str, Part]) -> int:
    """Return the number of folds of a cross-validation; 0 without one."""
    split = parts.get("split")
    k_fold: KFold | None = split.values.get("k_fold") if split is not None and split.good else None
    return 0 if k_fold is None else k_fold.k


def with_defaults(raw: Raw, axes: Collection[Axis], n_folds: int) -> Raw:
    """Return section `search` as written, with the keys whose defaults follow from other sections.

    n_folds: of a cross-validation, of which every repeat is one; 0 without.
    """
    if not isinstance(raw, dict | None):
        return raw
    keys = {key: value for key, value in (raw or {}).items() if value is not None}
    n_designs = n_combinations(axes)
    name = keys.get("sampler", "tpe" if n_designs is None else "grid")
    if name == AUTO:
        name = automatic(n_designs, keys.get("n_trials"))
    # A grid learns nothing from its results: designs that are proposed at once share the most passes.
    whole = name == "grid" and "stop" not in keys
    batch = min(n_designs or 1, MOST_TRIALS) if whole else _BATCH
    return {"batch": batch, "repeats": n_folds or 1, **keys, "sampler": name}


def automatic(n_designs: int | None, n_trials: Raw) -> str:
    """Return the sampler that `auto` stands for.

    A grid that is trained whole needs no sampler. Of the others, Sobol points lead while designs are few, and
    TPE from then on (results/measurements.md, section Search).

    Args:
        n_designs: of the grid; None: there is none.
        n_trials: as written; None: all.
    """
    n = n_trials if type(n_trials) is int else None
    if n_designs is not None and (n is None or n >= n_designs):
        return "grid"
    return "sobol" if n is not None and n < _FEW else "tpe"
