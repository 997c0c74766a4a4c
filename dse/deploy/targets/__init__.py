"""Targets: forms in which a classifier leaves the framework, a file each, verified by running them.

Contract: `Target`. To add one, here or in a module of your own, write a file with a frozen dataclass that
`@register("targets", "my_target")` names: what it refuses, what it writes, and how that is run.
`dse.testing.check_target` says what it lacks.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Protocol, Self

import numpy as np

from dse.deploy.bundle import Bundle, BundleError
from dse.deploy.decide import decided
from dse.deploy.reference import Reference
from dse.deploy.verdict import Verdict
from dse.records import Bools, Floats, Ints, Network, Response

__all__ = ["Run", "Target", "TargetError", "Verdict", "compare"]


class TargetError(BundleError):
    """A target cannot be written or run on this machine, such as for want of a compiler; one line."""


class Target(Protocol):
    """A form of a classifier outside `dse`: a frozen dataclass without keys.

    A target that knows what a classifier takes before anything is written has a method `footprint(bundle)`,
    which returns column -> number, such as ram_bytes; `dse pick` chooses by these columns. If it also has
    `profile`, the name of a hardware profile of kind processor, this predicts the column cycles.

    A target whose names begin with the bundle's `prefix` (`dse export --prefix`) has `has_prefix`, True.

    A target that knows some of it before training declares these columns in `known_before`, a tuple of
    `registry.Column`; `limits` of a search space may name them. Its method `least_footprint(sections, shape)`
    returns column -> least and largest number, both NaN where it can never hold the design; a column that
    is absent may hold any number.

    label: what it is, such as 'C99 for any processor'.
    extra: extra of `dse` (pip install 'dse[EXTRA]') that writing or verifying needs; '' for none.
    use: how its files are used, one sentence or command, relative to the bundle's folder.
    """

    label: ClassVar[str]
    extra: ClassVar[str]
    use: ClassVar[str]

    def refusal(self, bundle: Bundle) -> str:
        """Return why it cannot hold the classifier, one sentence; '' if it can."""
        ...

    def write(self, bundle: Bundle, folder: Path) -> None:
        """Write its files into an empty folder; the same bundle gives the same bytes.

        Raises:
            TargetError: something that writing needs is missing.
        """
        ...

    def verify(self, bundle: Bundle, folder: Path, reference: Reference) -> Verdict:
        """Run the files that `write` wrote on recordings, and compare; the folder is not changed.

        Raises:
            TargetError: something that running needs is missing, or it fails to run.
        """
        ...


@dataclass(frozen=True)
class Run:
    """What a target did on the recordings of a reference; fields as in `Reference`."""

    label: Ints
    time_ms: Floats
    decided: Bools
    fired: Sequence[Ints]

    @classmethod
    def of_fired(cls, bundle: Bundle, reference: Reference, fired: Sequence[Ints]) -> Self:
        """Return the run of a target that only spikes: its bundle's rule decides from the last layer.

        Args:
            bundle: the decision rule.
            reference: the recordings.
            fired: as in `Reference`.
        """
        n, n_steps, spikes = reference.n_recordings, reference.n_steps, np.asarray(fired[-1], np.int64)
        assert isinstance(bundle.fitted, Network)
        output = np.zeros((n, n_steps, bundle.fitted.sizes[-1]), np.uint8)
        recording, step, neuron = spikes[spikes[:, 1] < n_steps - 1].T
        np.add.at(output, (recording, step + 1, neuron), 1)
        none = np.zeros((n, n_steps, 0), np.int32)
        response = Response(output, none, none, reference.step_ms, peak_state=0)
        return cls(*decided(bundle, reference.dataset, response), fired)


def compare(
    reference: Reference, run: Run, figures: Mapping[str, float] | None = None, compiler: str = ""
) -> Verdict:
    """Return the verdict of a run.

    Args:
        reference: what the bundle's own engine does.
        run: what the target does on the same recordings.
        figures: column -> number that the run has measured.
        compiler: of the code that was run, where there is one.

    Raises:
        ValueError: the run has other numbers of recordings or layers.
    """
    n = reference.n_recordings
    for name in ("label", "time_ms", "decided"):
        if len(getattr(run, name)) != n:
            raise ValueError(f"{name} must have {n} recordings, got {len(getattr(run, name))}")
    if len(run.fired) != len(reference.fired):
        raise ValueError(f"fired must have {len(reference.fired)} layers, got {len(run.fired)}")
    if n == 0:
        return Verdict("not verified", "there are no recordings")
    other = (
        (np.asarray(run.label) != reference.label)
        | ~np.isclose(run.time_ms, reference.time_ms, rtol=1e-9, atol=0)
        | (np.asarray(run.decided) != reference.decided)
    )
    strayed = np.zeros(n, bool)
    for of_run, of_reference in zip(run.fired, reference.fired, strict=True):
        strayed[_recordings_that_differ(of_run, of_reference)] = True
    verdict = Verdict(
        "approximate" if other.any() or strayed.any() else "faithful",
        n_recordings=n,
        decisions_differ=float(other.mean()),
        spikes_differ=float(strayed.mean()),
        largest_difference=_largest_difference(run.fired, reference) if reference.fired else 0,
        figures=dict(figures or {}),
        compiler=compiler,
    )
    if verdict.kind == "faithful":
        return verdict
    reason = f"{int(other.sum())} of {n} recordings decide and {int(strayed.sum())} spike otherwise"
    return dataclasses.replace(verdict, reason=reason)


def _recordings_that_differ(first: Ints, second: Ints) -> Ints:
    """Return the recordings in which two lists of spikes, (n_spikes, 3) each, differ."""
    a, b = (np.asarray(x, np.int64).reshape(-1, 3) for x in (first, second))
    if np.array_equal(a, b):
        return np.zeros(0, np.int64)
    spikes, places = np.unique(np.concatenate([a, b]), axis=0, return_inverse=True)
    surplus = np.bincount(places.ravel(), np.repeat([1, -1], [len(a), len(b)]))
    return np.unique(spikes[surplus != 0, 0])


def _largest_difference(fired: Sequence[Ints], reference: Reference) -> int:
    """Return the largest difference in the output spikes of a class that were counted in a recording."""
    both = [np.asarray(x, np.int64).reshape(-1, 3) for x in (fired[-1], reference.fired[-1])]
    n_outputs = 1 + max(int(x[:, 2].max(initial=0)) for x in both)
    shape = (reference.n_recordings, n_outputs)
    counts = []
    for spikes in both:
        in_time = spikes[spikes[:, 1] < reference.n_steps - 1]  # what fires last is received by nobody
        cells = np.ravel_multi_index((in_time[:, 0], in_time[:, 2]), shape)
        counts.append(np.bincount(cells, minlength=int(np.prod(shape))))
    return int(np.abs(counts[0] - counts[1]).max(initial=0))
