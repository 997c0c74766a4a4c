"""What a run of a target has shown."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from dse.base.registry import param

Kind = Literal["faithful", "equivalent", "approximate", "unsupported", "not verified"]
"""faithful: all decisions and spikes are equal on all recordings; equivalent: all decisions are, some spikes
are not; approximate: some decisions differ; unsupported: the target cannot hold the classifier; not verified:
nothing was run. From the best to the worst, but for the last."""
KINDS: tuple[Kind, ...] = get_args(Kind)


@dataclass(frozen=True)
class Verdict:
    """How faithful a target is to a bundle; it follows from a run, never from a claim.

    reason: one sentence; '' if faithful.
    n_recordings: recordings that the target answered.
    decisions_differ: share of recordings whose label, decision time or decidedness differs.
    spikes_differ: share of recordings with any differing spike of any layer.
    largest_difference: of the number of output spikes of a class within a recording.
    figures: column -> number, such as ram_bytes, flash_bytes, instructions_per_inference.
    recordings: name of the file that they are from.
    compiler: what compiled the code that `figures` are of; '' where nothing was.
    output_f1: F1 score of the output spikes, one within a step of another counting as the same; None where
        there are no output spikes to compare.
    run_by: what ran the files, names with versions: the verdict is of these alone.
    """

    kind: Kind
    reason: str = ""
    n_recordings: int = param(0, low=0)
    decisions_differ: float = param(0.0, low=0, high=1)
    spikes_differ: float = param(0.0, low=0, high=1)
    largest_difference: int = param(0, low=0)
    figures: Mapping[str, float] = field(default_factory=dict)
    recordings: str = ""
    compiler: str = ""
    output_f1: float | None = param(None, low=0, high=1)
    run_by: tuple[str, ...] = ()


def in_words(kind: str, run_by: Iterable[str]) -> str:
    """Return the kind of a verdict with what it is of: 'faithful (norse 1.1.0, snntorch 1.0.0)'."""
    names = ", ".join(run_by)
    return f"{kind} ({names})" if names else kind
