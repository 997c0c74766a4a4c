"""What a run of a target has shown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

Kind = Literal["faithful", "approximate", "unsupported", "not verified"]
"""faithful: all decisions and spikes equal on all recordings; approximate: some differ;
unsupported: the target cannot hold the classifier; not verified: nothing was run."""
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
    """

    kind: Kind
    reason: str = ""
    n_recordings: int = 0
    decisions_differ: float = 0.0
    spikes_differ: float = 0.0
    largest_difference: int = 0
    figures: Mapping[str, float] = field(default_factory=dict)
    recordings: str = ""
    compiler: str = ""
