"""A reference as commands for replay.c, and what came of them as a run."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from dse.deploy.c import host
from dse.deploy.c.host import Played
from dse.deploy.c.plan import Frame, Plan
from dse.deploy.reference import Reference
from dse.deploy.targets import Run, Verdict, compare
from dse.recordings import EventSource, trials_of
from dse.records import Ints, Rasters, Signals


def of_spikes(reference: Reference) -> list[Ints]:
    """Return the commands that push the input spikes of every window."""
    n, n_steps = reference.n_recordings, reference.dataset.n_steps
    spikes = reference.spikes_in
    borders = np.searchsorted(spikes[:, 0], np.arange(n + 1))
    parts = [spikes[a:b] for a, b in pairwise(borders)]
    return [host.of_spikes(np.bincount(x[:, 1], minlength=n_steps), x[:, 2]) for x in parts]


def of_recordings(reference: Reference, plan: Frame) -> list[Ints] | None:
    """Return the commands that push what was recorded; None where C makes no spikes of it."""
    inputs, n_steps = reference.inputs, reference.dataset.n_steps
    starts = reference.first_step.tolist()
    if plan.encoder is not None and isinstance(inputs, Signals):
        if reals(reference, plan):
            values = np.asarray(inputs.values, np.float32)
        else:
            values = inputs.values.astype(np.int32)
        pieces = [values[a:b] for a, b in pairwise(inputs.offsets)]
        return [host.of_samples(x, first, n_steps) for x, first in zip(pieces, starts, strict=True)]
    if plan.pooling is not None and inputs is not None and not isinstance(inputs, Signals | Rasters):
        return [_of_events(inputs, i, plan, first, n_steps) for i, first in enumerate(starts)]
    return None


def reals(reference: Reference, plan: Frame) -> bool:
    """Return whether samples must be pushed as floating point: they, or the thresholds, are not whole."""
    if plan.encoder is None or not isinstance(reference.inputs, Signals):
        return False
    values = reference.inputs.values
    whole = bool((values == np.rint(values)).all() and (np.abs(values) < 2**24).all())
    return not (plan.encoder.takes_whole and whole)


def _of_events(source: EventSource, i: int, plan: Frame, first: int, n_steps: int) -> Ints:
    blocks = [(x.t_us, x.x, x.y, x.polarity) for x in source.blocks(i)]
    events = tuple(np.concatenate(column) for column in zip(*blocks, strict=True))
    t0_us = 0 if trials_of(source) is not None else int(events[0][0])
    assert plan.pooling is not None
    begin_us = t0_us + plan.pooling.start_us
    return host.of_events(events, t0_us, begin_us, plan.pooling.bin_us, first, n_steps)


def verdict_of(
    played: Played,
    plan: Frame,
    reference: Reference,
    figures: Mapping[str, float],
    compiler: str,
    run_by: Sequence[str],
) -> Verdict:
    """Return the verdict on what C did (`dse.deploy.targets.compare`); its input spikes must be equal too."""
    verdict = compare(reference, run_of(played, plan, reference), figures, compiler, run_by)
    if verdict.kind == "faithful" and not same_input(played, reference):
        return dataclasses.replace(verdict, kind="equivalent", reason="the input spikes differ")
    return verdict


def run_of(played: Played, plan: Frame, reference: Reference) -> Run:
    """Return what C did as a run; labels of unknown combinations are -1, as in a reference."""
    return Run(
        label=np.where(played.label == -2, -1, played.label),
        time_ms=played.steps * reference.step_ms,
        decided=played.confident,
        fired=[_of_layer(played, k + 1) for k in range(len(plan.layers) if isinstance(plan, Plan) else 0)],
    )


def same_input(played: Played, reference: Reference) -> bool:
    """Return whether the encoder in C made the input spikes of the reference."""
    spikes = _of_layer(played, 0)
    spikes[:, 1] //= max(1, reference.n_steps // reference.dataset.n_steps)
    order = np.lexsort(spikes.T[::-1])
    return np.array_equal(spikes[order], reference.spikes_in)


def _of_layer(played: Played, layer: int) -> Ints:
    return np.asarray(played.spikes[played.spikes[:, 1] == layer][:, [0, 2, 3]])
