"""What every sampler promises, and the Optuna-backed one.

The promise that matters is resumption: what `ask` returns is a function of the study seed and of
what was asked and told before, not of how often the process was restarted in between.
"""

from __future__ import annotations

import itertools
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Protocol, cast

import numpy as np

from dse.base import seeds
from dse.config.axes import Axis
from dse.config.space import Design, SearchSpace
from dse.config.yaml_lines import Raw
from dse.search.limits import Exclusion
from dse.search.space import at, design_at, index_of, position

if TYPE_CHECKING:
    import optuna

Values = Sequence[float] | None
# Where a space has no grid, the rest of it is looked for by this many random draws.
_DRAWS = 1000
# A sampler that proposes only known designs this often in a row gets them from the rest of the grid.
_TRIES = 20


class Sampler(Protocol):
    """A started sampler."""

    def ask(self, n: int) -> list[Design]:
        """Return up to n designs that were never asked or told before; fewer when no more are left."""

    def tell(self, designs: Sequence[Mapping[str, Raw]], values: Sequence[Values]) -> None:
        """Add the objectives of designs, in the order of the space's objectives; None for a failed design.

        Designs that this sampler did not ask for are taken in as well: so a stopped study resumes.
        """


Check = Callable[[Mapping[str, Raw]], Exclusion | None]
"""Returns why a design is not to be trained; None if it is."""


class Limited(Sampler):
    """A started sampler that knows before it proposes which designs are not to be trained.

    refused: designs that the last `ask` considered and passed over.
    """

    def __init__(self) -> None:
        self._check: Check | None = None
        self.refused: list[tuple[Design, Exclusion]] = []

    def restrict(self, check: Check) -> None:
        """Let `ask` propose only designs that pass a check."""
        self._check = check

    def _refuses(self, design: Design) -> bool:
        """Return whether a design is not to be trained; if so, it is noted."""
        why = None if self._check is None else self._check(design)
        if why is not None:
            self.refused.append((design, why))
        return why is not None


class Filtered(Limited):
    """A sampler that knows no limits: designs that are not to be trained are told as failed."""

    def __init__(self, sampler: Sampler) -> None:
        super().__init__()
        self._sampler = sampler

    def ask(self, n: int) -> list[Design]:
        """Return up to n new designs that pass the check; fewer when no more are found."""
        self.refused = []
        designs: list[Design] = []
        for _ in range(_DRAWS):
            proposed = self._sampler.ask(n - len(designs))
            for design in proposed:
                if self._refuses(design):
                    self._sampler.tell([design], [None])
                else:
                    designs.append(design)
            if len(designs) == n or not proposed:
                break
        return designs

    def tell(self, designs: Sequence[Mapping[str, Raw]], values: Sequence[Values]) -> None:
        """Add to the history."""
        self._sampler.tell(designs, values)


def limited(sampler: Sampler, check: Check) -> Limited:
    """Return a sampler that proposes only designs that pass a check."""
    able = sampler if isinstance(sampler, Limited) else Filtered(sampler)
    able.restrict(check)
    return able


class OptunaSampler(Limited):
    """Asks one of Optuna's samplers, in a fresh in-memory study built from the history at every ask.

    A fresh study makes an ask a pure function of the history. It is seeded by the study seed and the
    number of designs known, so batch k gets the same generator whether or not the process lived on.

    make: seed -> Optuna sampler.
    replay: batch size with which the history is asked and told again, for samplers that note
        something at every ask (generations); None where values alone carry the history. Samplers that
        are replayed cross designs: they see a value on every axis, also on one that a design does not have.
    """

    def __init__(
        self,
        space: SearchSpace,
        directions: Sequence[str],
        make: Callable[[int], optuna.samplers.BaseSampler],
        replay: int | None = None,
    ) -> None:
        super().__init__()
        self._space = space
        self._directions = directions
        self._make = make
        self._replay = replay
        self._distributions = {name: _distribution(axis) for name, axis in space.axes.items()}
        self._proposed: dict[str, Design] = {}
        self._history: dict[str, tuple[Design, Values]] = {}

    def ask(self, n: int) -> list[Design]:
        """Return up to n new designs; fewer when the space has no more."""
        import optuna

        rng = seeds.generator(self._space.seed, {}, "sampler", len(self._proposed))
        designs: list[Design] = []
        self.refused = []
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
            study = self._study(int(rng.integers(2**31)))
            for _ in range(n):
                design = self._new(study) or self._untried(rng)
                if design is None:
                    break
                self._proposed[seeds.design_key(design)] = design
                designs.append(design)
        return designs

    def tell(self, designs: Sequence[Mapping[str, Raw]], values: Sequence[Values]) -> None:
        """Add to the history; telling a design again replaces its values."""
        for design, value in zip(designs, values, strict=True):
            key = seeds.design_key(design)
            self._proposed.setdefault(key, dict(design))
            failed = value is None or not all(map(math.isfinite, value))
            self._history[key] = (dict(design), None if failed else value)

    def _study(self, seed: int) -> optuna.Study:
        """Return a study that knows the history and a sampler with a fresh generator."""
        import optuna

        verbosity = optuna.logging.get_verbosity()
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        try:
            study = optuna.create_study(
                directions=["maximize" if name == "max" else "minimize" for name in self._directions],
                sampler=self._make(seed),
            )
        finally:
            optuna.logging.set_verbosity(verbosity)
        if self._replay is None:
            for design, value in self._history.values():
                self._add(study, design, value)
            return study
        history = [(self._parameters(design), value) for design, value in self._history.values()]
        for first in range(0, len(history), self._replay):
            batch = history[first : first + self._replay]
            for parameters, _ in batch:
                study.enqueue_trial(parameters)
            trials = [study.ask(self._distributions) for _ in batch]
            for trial in trials:
                _ = trial.relative_params  # Optuna lets the sampler note the generation on this access
            for trial, (_, value) in zip(trials, batch, strict=True):
                study.tell(trial, value, state=optuna.trial.TrialState.FAIL if value is None else None)
        # The replay drew numbers; what follows must not depend on how many.
        study.sampler = self._make(seed)
        return study

    def _add(self, study: optuna.Study, design: Design, value: Values) -> None:
        """Add a design to a study; one without values has failed, or is not to be trained."""
        import optuna

        parameters = self._parameters(design)
        states = optuna.trial.TrialState
        study.add_trial(
            optuna.trial.create_trial(
                state=states.PRUNED if value is None else states.COMPLETE,
                values=value,
                params=parameters,
                distributions={name: self._distributions[name] for name in parameters},
            )
        )

    def _parameters(self, design: Design) -> dict[str, Raw]:
        """Return a design as Optuna knows it.

        On an axis that the design does not have, a sampler that crosses designs sees a value drawn for the
        design: so a child of two kinds inherits what it can of either.
        """
        values = dict(design)
        if self._replay is not None:
            rng = seeds.generator(self._space.seed, design, "sampler")
            values |= {
                name: at(axis, rng.random()) for name, axis in self._space.axes.items() if name not in design
            }
        return {
            name: _to_optuna(axis, values[name]) for name, axis in self._space.axes.items() if name in values
        }

    def _proposal(self, study: optuna.Study) -> tuple[optuna.Trial, Design]:
        """Return a new trial and its design."""
        always = {axis.name for axis in self._space.axes.values() if axis.condition is None}
        if self._replay is not None:
            always |= self._distributions.keys()
        trial = study.ask({name: dist for name, dist in self._distributions.items() if name in always})
        shared = {
            name: _to_value(axis, trial.params[name])
            for name, axis in self._space.axes.items()
            if axis.condition is None
        }
        design = {
            name: _to_value(axis, trial.params[name] if name in always else self._suggested(trial, name))
            for name, axis in self._space.active(shared).items()
        }
        return trial, design

    def _suggested(self, trial: optuna.Trial, name: str) -> float:
        """Return what the sampler proposes on one more axis of a trial."""
        from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

        one = self._distributions[name]
        if isinstance(one, FloatDistribution):
            return trial.suggest_float(name, one.low, one.high, log=one.log)
        if isinstance(one, IntDistribution):
            return trial.suggest_int(name, one.low, one.high, log=one.log)
        assert isinstance(one, CategoricalDistribution)  # there are no others
        return cast(int, trial.suggest_categorical(name, one.choices))

    def _new(self, study: optuna.Study) -> Design | None:
        """Return a design that was never proposed before, or None if the sampler finds none."""
        import optuna

        for _ in range(_TRIES):
            trial, design = self._proposal(study)
            key = seeds.design_key(design)
            if key not in self._proposed:
                if not self._refuses(design):
                    return design
                self._proposed[key] = design
                if self._replay is None:
                    self._add(study, design, None)
            study.tell(trial, state=optuna.trial.TrialState.FAIL)
        return None

    def _untried(self, rng: np.random.Generator) -> Design | None:
        """Return a design that was not proposed before; None if there is none.

        On a grid it is the first one from a random place on, else one drawn at random.
        """
        total = self._space.n_designs
        if total is None:
            for _ in range(_DRAWS):
                design = self._drawn_design(rng)
                if seeds.design_key(design) not in self._proposed and self._passes(design):
                    return design
            return None
        tried = {index_of(self._space, design) for design in self._proposed.values()}
        if len(tried) >= total:
            return None
        first = int(rng.integers(total))
        for index in itertools.chain(range(first, total), range(first)):
            if index not in tried and self._passes(design := design_at(self._space, index)):
                return design
        return None

    def _passes(self, design: Design) -> bool:
        return self._check is None or self._check(design) is None

    def _drawn_design(self, rng: np.random.Generator) -> Design:
        """Return a design drawn uniformly: its kinds first, then on every axis that they have."""
        axes = self._space.axes.items()
        design = {name: at(axis, rng.random()) for name, axis in axes if axis.condition is None}
        return {
            name: design[name] if name in design else at(axis, rng.random())
            for name, axis in self._space.active(design).items()
        }


def _is_ordered(axis: Axis) -> bool:
    values = axis.values or ()
    numbers = [value for value in values if isinstance(value, int | float) and not isinstance(value, bool)]
    return len(numbers) == len(values) and numbers == sorted(numbers)


def distribution(axis: Axis, values: Sequence[str | float | None]) -> optuna.distributions.BaseDistribution:
    """Return an axis as Optuna knows it.

    Args:
        axis: of the search space.
        values: what stands for each value of the axis, where it has values.
    """
    from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

    if axis.values is not None:
        return CategoricalDistribution(values)
    assert axis.low is not None and axis.high is not None  # a range has ends
    if axis.is_int:
        return IntDistribution(int(axis.low), int(axis.high), log=axis.log)
    return FloatDistribution(axis.low, axis.high, log=axis.log)


def _distribution(axis: Axis) -> optuna.distributions.BaseDistribution:
    """Return an axis as the samplers know it: the place among its values, or the number itself."""
    from optuna.distributions import IntDistribution

    n_values = len(axis.values or ())
    if axis.values is not None and _is_ordered(axis):
        return IntDistribution(0, n_values - 1)
    return distribution(axis, range(n_values))


def _to_optuna(axis: Axis, value: Raw) -> Raw:
    return value if axis.values is None else position(axis, value)


def _to_value(axis: Axis, parameter: float) -> Raw:
    return parameter if axis.values is None else axis.values[int(parameter)]
