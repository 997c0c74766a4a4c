"""Time and energy of a bundle on this machine: as a stream in Python, and as C."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dse.base.records import Array, Floats, Ints, Network
from dse.deploy.bundle import Bundle
from dse.deploy.c import host, replay
from dse.deploy.c.counting import code_of
from dse.deploy.form import Unsupported
from dse.deploy.reference import Reference, of_recordings, of_spikes
from dse.deploy.run import TargetError
from dse.deploy.sources import Recording, by_step, recordings_of
from dse.deploy.stream import Spiking, Stream, Windows
from dse.deploy.targets.c99 import C99
from dse.measure.hardware.counter import measured_power

SPIKE_RATE = 0.02
"""Input spikes per channel and step of random windows."""
_WINDOWS = 20
_LEAST_S = 1.0
_MOST_STEPS = 2_000_000


@dataclass(frozen=True)
class Times:
    """What steps and inferences of one engine took.

    engine: 'stream' or 'c99'.
    step_us: (n,) time of every input step until the answer. inference_us: (m,) their sums.
    energy_uj: mean energy of an inference above that at rest; None for the `reason`.
    """

    engine: str
    step_us: Floats
    inference_us: Floats
    energy_uj: float | None
    reason: str

    @property
    def columns(self) -> dict[str, object]:
        """The numbers as a row."""
        quantiles = {
            f"{name}_us_p{q}": float(np.percentile(values, q)) if len(values) else None
            for name, values in (("step", self.step_us), ("inference", self.inference_us))
            for q in (50, 99)
        }
        n = {"steps": len(self.step_us), "inferences": len(self.inference_us)}
        return {"engine": self.engine, **n, **quantiles, "energy_uj": self.energy_uj}


def measure(bundle: Bundle, data_file: str | None = None, rest_s: float = 5.0) -> list[Times]:
    """Return what a bundle takes on one core of this machine, in each engine that can hold it.

    Args:
        bundle: as read.
        data_file: recordings, from which encoder or preprocessing make spikes; None: windows of random
            spikes, past encoder and preprocessing.
        rest_s: for how long the power at rest is measured.

    Raises:
        BundleError: the bundle cannot run on a stream, or not on such recordings.
        RecordingError: the recordings do not fit.
    """
    if data_file is None:
        taken = Stream(bundle).input
        shape = _WINDOWS, taken.n_steps, bundle.fitted.n_channels
        reference = of_spikes(bundle, np.random.default_rng(0).random(shape) < SPIKE_RATE, taken.step_ms)
    else:
        reference = of_recordings(bundle, data_file)
    return [_of_stream(bundle, reference, rest_s), _of_c(bundle, reference, rest_s)]


def _of_stream(bundle: Bundle, reference: Reference, rest_s: float) -> Times:
    if reference.inputs is None:
        windows = _windows_of_spikes(reference)
        recordings = [Recording([*map(Spiking, spikes)], Windows("once")) for spikes in windows]
    else:
        recordings = [
            x._replace(items=list(by_step(x.items, reference.dataset.spikes.step_ms)))
            for x in recordings_of(reference.inputs, reference.first_step)
        ]
    _timed(bundle, recordings[:1])  # compiles
    steps, inferences = _timed(bundle, recordings)
    return _priced("stream", steps, inferences, lambda: len(_timed(bundle, recordings)[1]), rest_s)


def _windows_of_spikes(reference: Reference) -> list[list[Ints]]:
    """Return the channels that spike in each step of each window of recordings."""
    n, n_steps = reference.n_recordings, reference.dataset.n_steps
    row = reference.spikes_in[:, 0].astype(np.int64) * n_steps + reference.spikes_in[:, 1]
    borders = np.searchsorted(row, np.arange(1, n * n_steps))
    of_rows = np.split(np.ascontiguousarray(reference.spikes_in[:, 2]), borders)
    return [of_rows[i * n_steps : (i + 1) * n_steps] for i in range(n)]


def _timed(bundle: Bundle, recordings: Sequence[Recording]) -> tuple[Floats, Floats]:
    """Return the microseconds of every step until the answer, and of every inference."""
    of_steps: list[list[float]] = []
    for items, windows, t0_us in recordings:
        stream, taken = Stream(bundle, windows, t0_us), []
        for item in items:
            was_open = stream.n_open
            began = time.perf_counter()
            decisions = stream.push(item)
            us = (time.perf_counter() - began) * 1e6
            if was_open or decisions or stream.n_open:
                taken.append(us)
            if decisions:
                break
        of_steps.append(taken)
    return np.array([x for taken in of_steps for x in taken]), np.array([sum(x) for x in of_steps])


def _priced(engine: str, steps: Floats, inferences: Floats, work: Callable[[], int], rest_s: float) -> Times:
    """Add the energy of an inference; `work` does some and returns how many."""
    done, spent_s = 0, 0.0

    def run() -> None:
        nonlocal done, spent_s
        began = time.perf_counter()
        done += work()
        spent_s += time.perf_counter() - began

    power = measured_power(run, rest_s)
    energy_uj = None
    if power.idle_w is not None and power.running_w is not None:
        energy_uj = (power.running_w - power.idle_w) * spent_s / done * 1e6
    return Times(engine, steps, inferences, energy_uj, power.reason)


def _of_c(bundle: Bundle, reference: Reference, rest_s: float) -> Times:
    none = np.zeros(0)
    try:
        recorded = replay.of_recordings(reference, code_of(bundle))
        commands = recorded.commands or replay.of_spikes(reference)
        with tempfile.TemporaryDirectory() as temporary:
            C99().write(bundle, Path(temporary) / "c")
            options = "-O2", "-DDSE_TIMES", *recorded.options
            program = host.replaying(Path(temporary) / "c", Path(temporary), *options)
            first = _played(program, commands, 1)
            seconds = max(1e-4, sum(float(x.sum()) for x, _ in first) * 1e-9)
            n_steps = max(1, sum(len(x) for x, _ in first))
            repetitions = max(1, min(math.ceil(_LEAST_S / seconds), _MOST_STEPS // n_steps))
            runs = _played(program, commands, repetitions)
            network = bundle.fitted
            per_sample = network.steps_per_sample if isinstance(network, Network) else 1
            until = [x[: -(-steps // per_sample)] * 1e-3 for x, steps in runs]
            return _priced(
                "c99",
                np.concatenate(until),
                np.array([x.sum() for x in until]),
                lambda: len(_played(program, commands, repetitions)),
                rest_s,
            )
    except (Unsupported, TargetError) as error:
        return Times("c99", none, none, None, str(error))


def _played(program: Path, commands: Sequence[Ints], repetitions: int) -> list[tuple[Array, int]]:
    """Return the nanoseconds of the steps of every window, and its network steps until the answer."""
    windows = replay.windows(host.told(program, commands, str(repetitions)), 1)
    return [(times.ravel().astype(np.float64), int(answer[1])) for times, answer, _ in windows]
