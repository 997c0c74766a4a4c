"""The contract of a sampler."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

from dse.base import seeds
from dse.config import Design, SearchSpace, load_space
from dse.search.proposals import Sampler
from dse.testing import small
from dse.testing.expect import expect, expect_component

BATCH = 4


def check_sampler(sampler: Any) -> None:
    """Check a sampler: new designs on their axes, the same by seed and history, results in any order.

    Args:
        sampler: its component, which inherits `SamplerSettings` and has `start(space, directions)`.

    Raises:
        AssertionError: what it violates.
    """
    name = expect_component(sampler)
    expect(
        hasattr(sampler, "conditional") and hasattr(sampler, "requires"),
        f"{name} must inherit `SamplerSettings`, which declares `conditional` and `requires`",
    )
    whole = _played(name, sampler)
    keys = [seeds.design_key(design) for design in whole]
    expect(len(set(keys)) == len(keys), f"{name}.ask must return designs that it did not return before")
    expect(
        [seeds.design_key(design) for design in _played(name, sampler)] == keys,
        f"{name} must propose the same designs by the same seed and results",
    )
    resumed: Sampler = sampler.start(_space(), ("max", "min"))
    resumed.tell(whole[:BATCH], _values(whole[:BATCH]))
    expect(
        [seeds.design_key(design) for design in resumed.ask(BATCH)] == keys[BATCH : 2 * BATCH],
        f"{name} must propose after a resume what it would have proposed without a stop",
    )
    shuffled: Sampler = sampler.start(_space(), ("max", "min"))
    backwards = whole[::-1]
    shuffled.tell(backwards, _values(backwards))
    new = shuffled.ask(BATCH)
    known = set(keys) & {seeds.design_key(design) for design in new}
    expect(not known, f"{name} must take results in any order, and propose no design again")


def _played(name: str, component: Any) -> list[Design]:
    """Return the designs of two batches."""
    space = _space()
    sampler: Sampler = component.start(space, ("max", "min"))
    history: list[Design] = []
    for _ in range(2):
        designs = sampler.ask(BATCH)
        expect(len(designs) == BATCH, f"{name}.ask({BATCH}) must return {BATCH} designs, got {len(designs)}")
        for design in designs:
            axes = space.active(design)
            on_axes = set(design) == set(axes) and all(axes[key].contains(x) for key, x in design.items())
            expect(on_axes, f"{name} must propose designs on the axes, got {design}")
        sampler.tell(designs, _values(designs))
        history += designs
    return history


def _values(designs: Sequence[Design]) -> list[tuple[float, float] | None]:
    """Return two objectives that pull apart; a few designs fail."""
    numbers = [(cast(int, x["model.hidden"]), cast(int, x["training.epochs"])) for x in designs]
    return [
        None if hidden == 12 and epochs == 3 else (hidden / 20 + epochs / 100, float(hidden))
        for hidden, epochs in numbers
    ]


def _space() -> SearchSpace:
    """Return a grid of 48 designs over a choice and two stepped ranges."""
    axes = {
        "model.hidden": "{choice: [4, 8, 12, 16]}",
        "training.epochs": "{range: [1, 3]}",
        "training.dropout": "{range: [0, 0.3], step: 0.1}",
    }
    return load_space(small.SPACE, axes | {"seed": "5", "window.n_steps": "16", "search.batch": str(BATCH)})
