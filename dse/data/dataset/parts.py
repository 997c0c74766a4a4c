"""Recordings of one source -> the places of windows, and the spikes, one recording after the other."""

from __future__ import annotations

import contextlib
import dataclasses
from collections import deque
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple, TypeVar

import numpy as np

from dse.base.records import Array, Bools, Floats, Ints, Rasters, Signals, Spikes
from dse.config.bounds import MOST_STEPS
from dse.config.contracts import Encoder
from dse.config.resolved import Sections
from dse.config.settings import Preprocessing, Window
from dse.data import preprocessing
from dse.data.preprocessing import Pooling
from dse.data.recordings import EventSource, RecordingError, Recordings, trials_of
from dse.data.recordings.pooling import pooling
from dse.data.recordings.windows import mean_levels, onset, place, without_mean

Result = TypeVar("Result")
Progress = Callable[[str], None]
"""Called now and then with a sentence that says how far the work is."""


class Rows(NamedTuple):
    """Spikes of one recording: how many in each of its first steps, their channels, and perhaps times.

    t_us: as in `Spikes`.
    """

    counts: Ints
    channels: Ints
    t_us: Ints | None = None


NO_ROWS = Rows(np.zeros(0, np.int64), np.zeros(0, np.int32))

# Results that may wait for a slower one before them, per thread.
_AHEAD = 2


def silent(sentence: str) -> None:
    """Ignore a sentence of progress."""


@contextlib.contextmanager
def refusals() -> Iterator[None]:
    """Turn an encoder's `ValueError` into a `RecordingError`."""
    try:
        yield
    except RecordingError:
        raise
    except ValueError as error:
        raise RecordingError(str(error)) from None


@dataclasses.dataclass(frozen=True)
class Part:
    """Where windows lie in the recordings of one source, and how to make their spikes.

    start, low, high: (n,) as in Dataset, in the steps that are stored.
    n_steps: window length. n_stored: steps that are stored of a recording, at most.
    lengths, levels: steps and, where there is such a thing, mean of every channel over the window, of whole
        recordings: what may give labels away.
    positions: (n_channels, 3) int32 x, y and plane of every channel.
    rows: called with a number of threads; yields the spikes of every recording, in order.
    notes: called after that; what had to be repaired.
    first: (n,) first step of each recording that is stored; None where it was stored before.
    rises: as in Dataset.
    """

    start: Ints
    low: Ints
    high: Ints
    n_steps: int
    n_stored: int
    positions: Ints
    step_ms: float
    lengths: Ints
    levels: Floats | None
    rows: Callable[[int], Iterator[Rows]]
    notes: Callable[[], list[str]] = list
    first: Ints | None = None
    rises: Ints | None = None

    @property
    def n_channels(self) -> int:
        return len(self.positions)


def placed(
    recordings: Recordings,
    design: Sections,
    used: Bools,
    threads: int = 1,
    positions: Ints | None = None,
    progress: Progress = silent,
) -> Part:
    """Return where the windows of a source lie; recorded events are read once for it, spikes are not made.

    Signals pass the encoder on their way; what the encoder of other recordings makes is `encoding.encoded`.
    Crop and encoder of the design are fitted. used: (n,) bool, recordings in some part of the split; others
    get no spikes. threads: for trials that are simulated. positions: (n_channels, 3) of signals and rasters.

    Raises:
        RecordingError: a window does not fit, or a section is absent or out of place.
    """
    window = design.window
    kind, needed = design.kinds["data"], recordings.front_end
    if needed is not None and getattr(design, needed) is None:
        raise RecordingError(f"{needed} is required: it turns data of kind '{kind}' into spikes")
    if needed != "preprocessing" and design.preprocessing is not None:
        raise RecordingError(f"preprocessing does not apply to data of kind '{kind}' and must be absent")
    if window.remove_mean and recordings.front_end != "encoder":
        raise RecordingError("window.remove_mean must be false for events and spikes, got true")
    if not isinstance(recordings, Signals | Rasters):
        assert design.preprocessing is not None  # events are refused without it
        pools = pooling_of(recordings, design.preprocessing)
        every_event = design.preprocessing.every_event
        return _of_events(recordings, window, pools, every_event, used, threads, progress)
    if positions is None:
        raise ValueError("placed needs the positions of the channels of signals and rasters, got None")
    if isinstance(recordings, Rasters):
        return _of_rasters(recordings, window, used, positions)
    assert design.encoder is not None  # so are signals without an encoder
    return _of_signals(recordings, window, design.encoder, used, positions)


def pooling_of(source: EventSource, settings: Preprocessing) -> Pooling:
    """Return the pools that section `preprocessing` describes on a source's frame."""
    trials = trials_of(source)
    pins = None if trials is None else trials.pins()
    return pooling(settings, source.width, source.height, pins)


def cropped(source: Recordings, design: Sections, train: Ints, progress: Progress = silent) -> Sections:
    """Return a design whose crop is a rectangle where it was `pins`, fitted to training recordings alone."""
    settings = design.preprocessing
    if settings is None or settings.crop != "pins" or isinstance(source, Rasters | Signals):
        return design
    if (trials := trials_of(source)) is not None:
        crop = trials.pins()
    else:
        columns, rows = np.zeros(source.width, np.int64), np.zeros(source.height, np.int64)
        for done, i in enumerate(train, 1):
            more = preprocessing.count_pixels(source.blocks(int(i)), source.width, source.height)
            columns, rows = columns + more[0], rows + more[1]
            progress(f"locating pins: {done} of {len(train)} recordings")
        crop = preprocessing.pin_rectangle(columns, rows)
    return dataclasses.replace(design, preprocessing=dataclasses.replace(settings, crop=crop))


def _of_rasters(rasters: Rasters, window: Window, used: Bools, positions: Ints) -> Part:
    spikes, lengths = rasters.spikes, rasters.lengths
    start, low, high, n_steps = place(window, lengths, used, onset(rasters, window))
    return Part(
        start, low, high, n_steps, spikes.n_steps, positions, spikes.step_ms, lengths, None,
        lambda threads: rows_of(spikes), first=np.zeros_like(low),
    )  # fmt: skip


def place_signals(
    signals: Signals, window: Window, used: Array
) -> tuple[tuple[Array, Array, Array, int], Array]:
    """Return what `place` finds for sampled recordings, and the mean (n, channel) of each over its window."""
    placement = place(window, signals.lengths, used, onset(signals, window))
    return placement, mean_levels(signals, placement[0], placement[3])


def seen_by_encoder(signals: Signals, window: Window, levels: Array) -> Signals:
    """Return signals as they are encoded; levels: (n, channel) means over their windows."""
    return without_mean(signals, levels) if window.remove_mean else signals


def encoded_without(
    signals: Signals, design: Sections, used: Bools, constant: Floats, trend: Floats
) -> Spikes:
    """Return the spikes of the windows, from step 0, of signals less some of what they show without touch.

    The encoder of the design is fitted. used: (n,) bool, recordings that get spikes. constant, trend: (n,
    channel) that is subtracted, the latter per step since the start of the window.
    """
    assert design.encoder is not None  # signals without an encoder are refused
    (start, _, _, n_steps), _ = place_signals(signals, design.window, used)
    if (signals.values == np.rint(signals.values)).all():
        constant = np.round(constant)  # counts of a sensor stay whole: no threshold is missed by rounding
    since = np.arange(len(signals.values)) - np.repeat(signals.offsets[:-1] + start, signals.lengths)
    removed = np.repeat(constant, signals.lengths, axis=0)
    removed = removed + np.repeat(trend, signals.lengths, axis=0) * since[:, None]
    changed = dataclasses.replace(signals, values=(signals.values - removed).astype(np.float32))
    shown = seen_by_encoder(changed, design.window, mean_levels(changed, start, n_steps))
    return design.encoder.encode_all(shown, start, np.where(used, n_steps, 0))


def _of_signals(signals: Signals, window: Window, encoder: Encoder, used: Bools, positions: Ints) -> Part:
    (start, low, high, n_steps), levels = place_signals(signals, window, used)
    n_kept = np.where(used, high - low + n_steps, 0)

    def rows(threads: int) -> Iterator[Rows]:
        with refusals():
            return rows_of(encoder.encode_all(seen_by_encoder(signals, window, levels), low, n_kept))

    with refusals():
        places = encoder.positions(positions)
    return Part(
        start - low, np.zeros_like(low), high - low, n_steps, int(n_kept.max()),
        places, signals.step_ms, signals.lengths, levels, rows, signals.notes, low,
        encoder.rises(signals.n_channels),
    )  # fmt: skip


def rows_of(spikes: Spikes) -> Iterator[Rows]:
    """Yield the spikes of every sample."""
    for i in range(spikes.n_samples):
        borders = spikes.row_offsets[i * spikes.n_steps : (i + 1) * spikes.n_steps + 1]
        t_us = None if spikes.t_us is None else spikes.t_us[borders[0] : borders[-1]]
        yield Rows(np.diff(borders), spikes.channel[borders[0] : borders[-1]], t_us)


def _of_events(
    source: EventSource,
    window: Window,
    pooling: Pooling,
    every_event: bool,
    used: Bools,
    threads: int,
    progress: Progress,
) -> Part:
    simulated = trials_of(source)
    t0_us, lengths, contact = np.zeros((3, source.n_recordings), dtype=np.int64)
    if simulated is not None:
        lengths[:] = pooling.n_bins(simulated.duration_us)
    if simulated is None or window.at == "contact_onset":

        def survey(i: int) -> preprocessing.Survey:
            begin = None if simulated is None else 0
            return preprocessing.survey(source.blocks(i), pooling, window.onset_threshold, begin)

        chosen = np.flatnonzero(used).tolist()
        for done, surveyed in enumerate(in_order(survey, chosen, threads if simulated else 1)):
            i = chosen[done]
            progress(f"reading data: {done + 1} of {len(chosen)} recordings")
            contact[i] = surveyed.onset_bin
            if simulated is None:
                if not surveyed.n_events:
                    raise RecordingError(f"recording {i} must have events, got none")
                t0_us[i], lengths[i] = surveyed.first_us, surveyed.n_bins
                if surveyed.n_bins > MOST_STEPS:
                    raise RecordingError(
                        f"recording {i} must last at most {MOST_STEPS} steps of {pooling.bin_us} us, first "
                        f"event to last, got {surveyed.n_bins}"
                    )
    start, low, high, n_steps = place(window, lengths, used, contact)
    n_kept = np.where(used, high - low + n_steps, 0)
    pool = preprocessing.pool_events if every_event else preprocessing.pool

    def recording(i: int) -> Rows:
        return Rows(*pool(source.blocks(i), pooling, int(t0_us[i]), int(low[i]), int(n_kept[i])))

    def rows(threads: int) -> Iterator[Rows]:
        return in_order(recording, range(source.n_recordings), threads if simulated else 1)

    return Part(
        start - low, np.zeros_like(low), high - low, n_steps, int(n_kept.max()),
        pool_positions(pooling), pooling.bin_us / 1000, lengths, None, rows,
        source.notes, low,
    )  # fmt: skip


def pool_positions(pooling: Pooling) -> Array:
    """Return column, row and polarity of every channel of the pooled frame, (n_channels, 3) int32."""
    plane, row, column = np.indices((pooling.poles, pooling.height, pooling.width), dtype=np.int32)
    return np.stack([column.ravel(), row.ravel(), plane.ravel()], axis=1)


def in_order(
    function: Callable[[int], Result], numbers: range | list[int], threads: int
) -> Generator[Result, None, None]:
    """Yield a function's result for every number, in order; no more than a few results wait to be taken.

    With several threads, the function must leave the interpreter to the others for most of its time.
    """
    if threads == 1:
        yield from map(function, numbers)
        return
    waiting: deque[Future[Result]] = deque()
    pool = ThreadPoolExecutor(threads)
    try:
        for number in numbers:
            waiting.append(pool.submit(function, number))
            if len(waiting) >= threads * _AHEAD:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)
