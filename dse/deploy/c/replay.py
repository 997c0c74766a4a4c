"""A reference as commands for replay.c, and what came of them as a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from dse.base.records import Bools, Floats, Ints, Rasters, Signals
from dse.data.recordings import EventSource, trials_of
from dse.deploy.c.plan import Plan
from dse.deploy.form import Frame, ReceptorsForm, SendOnDeltaForm
from dse.deploy.reference import Reference, Run

INIT, RESET, STEP, SPIKE, SAMPLE, START, EVENT, ANSWER = range(8)


@dataclass(frozen=True)
class Played:
    """What C did on n recordings.

    spikes: (m, 4) recording, layer, network step, neuron; layer 0 is the input.
    label, steps, confident: (n,) answer, network steps until then, and whether the rule was met.
    counts: (n, output) output spikes within the window.
    """

    spikes: Ints
    label: Ints
    steps: Ints
    confident: Bools
    counts: Ints


class Recorded(NamedTuple):
    """Commands that push what was recorded, None where C makes no spikes of it; options of the compiler."""

    commands: list[Ints] | None = None
    options: Sequence[str] = ()


class Executed(NamedTuple):
    """What an execution of C did, the numbers that it measured, the compiler of those, and what ran it."""

    played: Played
    figures: Mapping[str, float]
    compiler: str
    run_by: tuple[str, ...]


def of_spikes(reference: Reference, steps: Sequence[int] | Ints | None = None) -> list[Ints]:
    """Return the commands that push the input spikes of every window, up to (n,) network steps; None: all."""
    n, n_steps, spikes = reference.n_recordings, reference.dataset.n_steps, reference.spikes_in
    needed = np.full(n, n_steps)
    if steps is not None:
        per_sample = max(1, reference.n_steps // n_steps)
        needed = np.minimum(-(-np.asarray(steps) // per_sample), n_steps)
    commands = []
    borders = pairwise(np.searchsorted(spikes[:, 0], np.arange(n + 1)))
    for last, (a, b) in zip(needed.tolist(), borders, strict=True):
        counts = np.bincount(spikes[a:b, 1], minlength=n_steps)[:last]
        commands.append(of_window(counts, spikes[a : a + counts.sum(), 2]))
    return commands


def of_recordings(reference: Reference, plan: Frame) -> Recorded:
    """Return the commands that push what was recorded, if C makes spikes of it; options of the compiler."""
    inputs, n_steps = reference.inputs, reference.dataset.n_steps
    starts = reference.first_step.tolist()
    if plan.encoder is not None and isinstance(inputs, Signals):
        values, options = pushed(inputs.values, plan.encoder)
        pieces = [values[a:b] for a, b in pairwise(inputs.offsets)]
        commands = [of_samples(x, first, n_steps) for x, first in zip(pieces, starts, strict=True)]
        return Recorded(commands, options)
    if plan.pooling is not None and inputs is not None and not isinstance(inputs, Signals | Rasters):
        return Recorded([_of_events(inputs, i, plan, first, n_steps) for i, first in enumerate(starts)])
    return Recorded()


def pushed(values: Floats, encoder: SendOnDeltaForm | ReceptorsForm) -> tuple[Ints | Floats, list[str]]:
    """Return samples as C takes them, and its options: real ones, if they or the thresholds are not whole."""
    if encoder.takes_whole and (values == np.rint(values)).all() and (np.abs(values) < 2**24).all():
        return values.astype(np.int32), []
    return values.astype(np.float32), ["-DDSE_REAL_SAMPLES"]


def _of_events(source: EventSource, i: int, plan: Frame, first: int, n_steps: int) -> Ints:
    """Return the commands of recording i of events, up to the end of its window, whose first bin is given."""
    blocks = [(x.t_us, x.x, x.y, x.polarity) for x in source.blocks(i)]
    t_us, x, y, polarity = (np.concatenate(column).astype(np.int64) for column in zip(*blocks, strict=True))
    t0_us = 0 if trials_of(source) is not None else int(t_us[0])
    assert plan.pooling is not None
    ends = t0_us + plan.pooling.start_us + plan.pooling.bin_us * np.arange(1, first + n_steps + 1)
    borders = [0, *np.searchsorted(t_us, ends).tolist()]
    # Numbers become int32, which leaves of a time its lower half.
    rows = np.column_stack([np.full(len(t_us), EVENT), t_us, t_us >> 32, x, y, polarity])
    parts = [np.array([INIT, START, t0_us, t0_us >> 32])]
    for k, (a, b) in enumerate(pairwise(borders)):
        if k == first:
            parts.append(np.array([RESET]))
        parts += [rows[a:b].ravel(), np.array([STEP])]
    return np.concatenate([*parts, np.array([ANSWER])])


def of_window(counts: Ints, channels: Ints) -> Ints:
    """Return the commands of a window, given (step,) numbers of spikes and their channels, step by step."""
    commands = np.full(2 * len(channels) + len(counts), STEP)
    at = 2 * np.arange(len(channels)) + np.repeat(np.arange(len(counts)), counts)
    commands[at], commands[at + 1] = SPIKE, channels
    return np.concatenate([[INIT, RESET], commands, [ANSWER]])


def of_samples(values: Ints | Floats, start: int, n_steps: int) -> Ints:
    """Return the commands of (step, sensor) samples, int32 or float32, up to the end of their window."""
    bits = np.ascontiguousarray(values[: start + n_steps]).view(np.int32)
    pushes = np.column_stack([np.full(len(bits), SAMPLE), bits, np.full(len(bits), STEP)])
    before = pushes[:start, :-1]
    begin, reset, end = (np.array([command]) for command in (INIT, RESET, ANSWER))
    return np.concatenate([begin, before.ravel(), reset, pushes[start:].ravel(), end])


def hostile(plan: Frame, real: bool = False) -> list[Ints]:
    """Return commands of windows that no sensor gives: all spikes, bursts, many at random; leaping samples.

    Real samples are float32.
    """
    shape = plan.n_steps, plan.n_channels
    step = np.arange(plan.n_steps)[:, None]
    rasters = [np.broadcast_to(x, shape) for x in (step >= 0, step % 7 < 2, step % 2 == 0)]
    rasters.append(np.random.default_rng(0).random(shape) < 0.5)
    commands = [of_window(x.sum(axis=1), np.nonzero(x)[1]) for x in rasters]
    if plan.encoder is not None:
        leaps = np.where(step % 2 == 0, -(2**23), 2**23) * np.ones((1, plan.encoder.n_sensors), np.int32)
        samples: Any = leaps.astype(np.float32 if real else np.int32)
        commands.append(of_samples(samples, 0, plan.n_steps))
    return commands


def windows(numbers: Ints, width: int) -> Iterator[tuple[Ints, Ints, Ints]]:
    """Yield what replay.c has written of each window: rows of numbers, its answer, and the output spikes.

    A row of spikes has a width of 3, one of times of 1.
    """
    at = 0
    for end in np.flatnonzero(numbers == -1).tolist():
        if end < at or (end - at) % width:  # a label or a count of -1 is no end
            continue
        rows, answer, begin = numbers[at:end].reshape(-1, width), numbers[end + 1 : end + 4], end + 5
        at = begin + int(numbers[end + 4])
        yield rows, answer, numbers[begin:at]


def parsed(numbers: Ints) -> Played:
    """Return what replay.c has written of spikes and answers."""
    of_windows = list(windows(numbers, 3))
    spikes = [np.zeros((0, 4), np.int64)]
    spikes += [np.column_stack([np.full(len(rows), i), rows]) for i, (rows, _, _) in enumerate(of_windows)]
    answers = np.array([answer for _, answer, _ in of_windows], np.int64)
    label, steps, confident = answers.reshape(-1, 3).T
    counts = np.array([counts for _, _, counts in of_windows])
    return Played(np.concatenate(spikes), label, steps, confident.astype(bool), counts)


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
