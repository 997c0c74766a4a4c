"""Every registered sampler keeps the contract of `dse.search.proposals.Sampler`."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from dse import registry, seeds
from dse.config import Design, SearchSpace, load_space
from dse.search import proposals
from dse.search.proposals import Sampler, Values
from dse.search.space import grid
from tests.spaces import write_space

NAMES = sorted(registry.known("search.samplers"))
# The Gaussian process takes seconds per design; it has a test of its own below.
OPEN = [name for name in NAMES if name not in ("grid", "gp")]
DIRECTIONS = ("max", "min")
BATCH = 4
# Few random designs, so that the models behind the samplers are asked as well.
OPTIONS: dict[str, dict[str, Any]] = {"tpe": {"startup": 4}, "nsga2": {"population": 4}}


def space_of(
    folder: Path, *changes: tuple[str, str], sampler: str = "tpe", batch: int = BATCH, seed: int = 3
) -> SearchSpace:
    path = write_space(
        folder, *changes, ("sampler: grid, batch: 2", f"sampler: {sampler}, n_trials: 99, batch: {batch}")
    )
    return load_space(path, {"seed": str(seed)})


@pytest.fixture
def open_space(tmp_path: Path) -> SearchSpace:
    """A space with an unordered choice, an integer grid, a real and a logarithmic range."""
    changes = (
        ("true_rate: 0.8", "true_rate: {range: [0.5, 0.9]}"),
        ("epochs: 1", "epochs: {range: [1, 1000], log: true}"),
    )
    return space_of(tmp_path, *changes)


@pytest.fixture
def small_space(tmp_path: Path) -> SearchSpace:
    return space_of(tmp_path)


def start(name: str, space: SearchSpace) -> Sampler:
    cls = registry.known("search.samplers")[name]
    sampler: Sampler = cls(**OPTIONS.get(name, {})).start(space, DIRECTIONS)
    return sampler


def measured(designs: Sequence[Design]) -> list[Values]:
    """Return two objectives that pull apart; every fifth kind of design fails."""
    values: list[Values] = []
    for design in designs:
        hidden, rate = design["model.hidden"], design.get("model.true_rate", 0.7)
        values.append(
            None
            if hidden == 12 and len(design["encoder.thresholds"]) == 3
            else (hidden * rate, float(hidden))
        )
    return values


def played(sampler: Sampler, batches: int) -> list[Design]:
    history: list[Design] = []
    for _ in range(batches):
        designs = sampler.ask(BATCH)
        history += designs
        sampler.tell(designs, measured(designs))
    return history


def test_all_samplers_are_here() -> None:
    assert {"grid", "random", "tpe", "nsga2", "gp"} <= set(NAMES)
    assert all(dataclasses.is_dataclass(cls) for cls in registry.known("search.samplers").values())


@pytest.mark.parametrize("name", OPEN)
def test_designs_lie_on_their_axes_and_never_repeat(name: str, open_space: SearchSpace) -> None:
    designs = played(start(name, open_space), 3)
    assert len(designs) == 3 * BATCH
    for design in designs:
        assert list(design) == list(open_space.axes)
        open_space.resolve(design)
    assert len(set(map(seeds.design_key, designs))) == len(designs)


@pytest.mark.parametrize("name", OPEN)
def test_a_resumed_study_asks_the_same(name: str, open_space: SearchSpace) -> None:
    whole = played(start(name, open_space), 3)
    for known in (0, BATCH, 2 * BATCH):
        resumed = start(name, open_space)
        for first in range(0, known, BATCH):
            batch = whole[first : first + BATCH]
            resumed.tell(batch, measured(batch))
        assert resumed.ask(BATCH) == whole[known : known + BATCH]


@pytest.mark.parametrize("name", ["grid", *OPEN])
def test_the_history_may_be_told_at_once(name: str, small_space: SearchSpace) -> None:
    whole = played(start(name, small_space), 1)
    one = start(name, small_space)
    one.tell(whole, measured(whole))
    assert not {seeds.design_key(d) for d in one.ask(2)} & {seeds.design_key(d) for d in whole}


@pytest.mark.parametrize("name", OPEN)
def test_a_batch_that_was_asked_in_part_is_asked_again(name: str, open_space: SearchSpace) -> None:
    """A process that died while a batch was being written down asks for the same designs."""
    assert start(name, open_space).ask(2) == start(name, open_space).ask(BATCH)[:2]


@pytest.mark.parametrize("name", OPEN)
def test_another_seed_is_another_search(name: str, tmp_path: Path) -> None:
    first, second = (space_of(tmp_path, ("0.8", "{range: [0.1, 0.9]}"), seed=seed) for seed in (1, 2))
    assert start(name, first).ask(BATCH) != start(name, second).ask(BATCH)


@pytest.mark.parametrize("name", ["grid", *OPEN])
def test_a_finite_space_is_asked_to_its_end(name: str, small_space: SearchSpace) -> None:
    sampler = start(name, small_space)
    designs = played(sampler, 2)
    assert sorted(map(seeds.design_key, designs)) == sorted(map(seeds.design_key, grid(small_space)))
    assert sampler.ask(BATCH) == []


def test_the_grid_goes_row_by_row(small_space: SearchSpace) -> None:
    sampler = start("grid", small_space)
    assert sampler.ask(2) + sampler.ask(99) == grid(small_space)


def test_the_grid_skips_what_was_told(small_space: SearchSpace) -> None:
    sampler = start("grid", small_space)
    told = [grid(small_space)[0], grid(small_space)[3]]
    sampler.tell(told, measured(told))
    assert sampler.ask(99) == [design for design in grid(small_space) if design not in told]


def test_the_grid_refuses_ranges(open_space: SearchSpace) -> None:
    with pytest.raises(ValueError, match="the grid sampler needs axes with values"):
        start("grid", open_space)


def test_better_values_draw_the_search(tmp_path: Path) -> None:
    """With one objective that rises along an axis, later designs lie higher than the first."""
    sampler = registry.known("search.samplers")["tpe"](startup=4).start(one_axis(tmp_path), ("max",))
    rates: list[float] = []
    for _ in range(6):
        designs = sampler.ask(BATCH)
        rates += [design["model.true_rate"] for design in designs]
        sampler.tell(designs, [(rate,) for rate in rates[-len(designs) :]])
    assert sum(rates[-8:]) / 8 > sum(rates[:8]) / 8 + 0.1


def one_axis(folder: Path) -> SearchSpace:
    space = space_of(
        folder, ("0.8", "{range: [0.1, 0.9]}"), ("[accuracy:max, n_weights:min]", "[accuracy:max]")
    )
    return dataclasses.replace(space, axes={"model.true_rate": space.axes["model.true_rate"]})


def test_evolution_replays_its_generations(open_space: SearchSpace) -> None:
    """Rebuilt from its history, NSGA-II asks what it would have asked in a study that was never stopped."""
    import optuna

    ours = played(start("nsga2", open_space), 6)
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(directions=["maximize", "minimize"])
    distributions = {axis.name: proposals._distribution(axis) for axis in open_space.axes.values()}
    theirs: list[Design] = []
    while len(theirs) < len(ours):
        seed = int(seeds.generator(open_space.seed, {}, "sampler", len(theirs)).integers(2**31))
        study.sampler = optuna.samplers.NSGAIISampler(population_size=4, seed=seed)
        batch: list[tuple[Any, Design]] = []
        while len(batch) < BATCH:
            trial = study.ask(distributions)
            axes = open_space.axes.values()
            design = {axis.name: proposals._to_value(axis, trial.params[axis.name]) for axis in axes}
            if design in theirs or design in [other for _, other in batch]:
                study.tell(trial, state=optuna.trial.TrialState.FAIL)
            else:
                batch.append((trial, design))
        for trial, design in batch:
            (value,) = measured([design])
            study.tell(trial, value, state=optuna.trial.TrialState.FAIL if value is None else None)
        theirs += [design for _, design in batch]
    assert ours == theirs
    generations = {trial.system_attrs.get("NSGAIISampler:generation") for trial in study.trials}
    assert len(generations) > 3


def test_the_gaussian_process_resumes(tmp_path: Path) -> None:
    space = one_axis(tmp_path)
    told: list[Design] = [{"model.true_rate": rate} for rate in (0.2, 0.5, 0.8)]
    asked = []
    for _ in range(2):
        sampler = registry.known("search.samplers")["gp"](startup=2).start(space, ("max",))
        sampler.tell(told, [(0.1,), (0.9,), None])
        asked.append(sampler.ask(1))
    assert asked[0] == asked[1]
    assert asked[0][0] not in told
    assert 0.1 <= asked[0][0]["model.true_rate"] <= 0.9


def test_not_a_number_counts_as_failed(open_space: SearchSpace) -> None:
    sampler = start("tpe", open_space)
    for values in ((float("nan"), 1.0), (float("inf"), 1.0)):
        designs = sampler.ask(1)
        sampler.tell(designs, [values])
    assert len(sampler.ask(2)) == 2


def test_failed_designs_are_not_asked_again(small_space: SearchSpace) -> None:
    sampler = start("tpe", small_space)
    first = sampler.ask(BATCH)
    sampler.tell(first, [None] * BATCH)
    assert all(design not in first for design in sampler.ask(2))
