"""Targets: forms in which a classifier leaves the framework, a file each, verified by running them.

Contract: `Target`. To add one, here or in a module of your own, write a file with a frozen dataclass that
`@register("targets", "my_target")` names: what it refuses, what it writes, and how that is run.
`dse.testing.check_target` says what it lacks.
"""

from __future__ import annotations

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

        The verdict names what ran them: `run_by`.

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
    reference: Reference,
    run: Run,
    figures: Mapping[str, float] | None = None,
    compiler: str = "",
    run_by: Sequence[str] = (),
) -> Verdict:
    """Return the verdict of a run.

    Args:
        reference: what the bundle's own engine does.
        run: what the target does on the same recordings.
        figures: column -> number that the run has measured.
        compiler: of the code that was run, where there is one.
        run_by: what ran the files, names with versions.

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
    reasons = []
    if other.any() or strayed.any():
        reasons.append(
            f"{int(other.sum())} of {n} recordings decide and {int(strayed.sum())} spike otherwise"
        )
    largest, f1 = 0, None
    if reference.fired:
        counted = [_counted(x[-1], reference.n_steps) for x in (run.fired, reference.fired)]
        largest, f1 = _largest_difference(*counted), _f1(*counted)
        if strayed.any():
            reasons.append(f"output F1 {f1:.3f} within one step, class counts differ by {largest} at most")
    return Verdict(
        "approximate" if other.any() else "equivalent" if strayed.any() else "faithful",
        "; ".join(reasons),
        n_recordings=n,
        decisions_differ=float(other.mean()),
        spikes_differ=float(strayed.mean()),
        largest_difference=largest,
        figures=dict(figures or {}),
        compiler=compiler,
        output_f1=f1,
        run_by=tuple(run_by),
    )


def _recordings_that_differ(first: Ints, second: Ints) -> Ints:
    """Return the recordings in which two lists of spikes, (n_spikes, 3) each, differ."""
    a, b = (np.asarray(x, np.int64).reshape(-1, 3) for x in (first, second))
    if np.array_equal(a, b):
        return np.zeros(0, np.int64)
    spikes, places = np.unique(np.concatenate([a, b]), axis=0, return_inverse=True)
    surplus = np.bincount(places.ravel(), np.repeat([1, -1], [len(a), len(b)]))
    return np.unique(spikes[surplus != 0, 0])


def _counted(fired: Ints, n_steps: int) -> Ints:
    """Return the output spikes that a decision can count: nobody receives those of the last step."""
    spikes = np.asarray(fired, np.int64).reshape(-1, 3)
    return spikes[spikes[:, 1] < n_steps - 1]


def _largest_difference(first: Ints, second: Ints) -> int:
    """Return the largest difference in the spikes of an output in a recording."""
    cells = np.concatenate([first, second])[:, ::2]
    signs = np.repeat([1, -1], [len(first), len(second)])
    places = np.unique(cells, axis=0, return_inverse=True)[1].ravel()
    return int(np.abs(np.bincount(places, signs)).max(initial=0))


def _f1(first: Ints, second: Ints) -> float:
    """Return the F1 score of spikes, each matched with at most one that is up to a step away."""
    both = np.concatenate([first, second])
    if not len(both):
        return 1.0
    _, trains = np.unique(both[:, ::2], axis=0, return_inverse=True)
    times = trains.ravel() * (both[:, 1].max() + 2) + both[:, 1]  # trains lie more than a step apart
    a, b = (np.sort(x).tolist() for x in np.split(times, [len(first)]))
    i = j = matched = 0
    while i < len(a) and j < len(b):
        gap = a[i] - b[j]
        matched += abs(gap) <= 1
        i, j = i + (gap <= 1), j + (gap >= -1)
    return 2 * matched / len(both)
