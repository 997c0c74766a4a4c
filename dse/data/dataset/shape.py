"""The shape of a data set: what the size of a network and the least work of an inference follow from."""

from __future__ import annotations

from dataclasses import dataclass

from dse.base.records import Dataset, Ints, Rasters, Signals
from dse.config.resolved import Sections
from dse.data.dataset.parts import pool_positions, pooling_of
from dse.data.recordings import Recordings
from dse.data.recordings.splits import Labelled


@dataclass(frozen=True)
class Shape:
    """Channels, outputs and steps of a data set.

    positions: (n_channels, 3) int32 x, y and plane of the channels.
    n_outputs: classes of all heads.
    n_steps: length of a window in input steps; None: the recordings decide.
    step_ms: duration of an input step.
    """

    positions: Ints
    n_outputs: int
    n_steps: int | None
    step_ms: float

    @classmethod
    def of(cls, data: Dataset) -> Shape:
        """Return the shape of a prepared data set."""
        n_outputs = sum(len(head.classes) for head in data.heads) or len(data.classes)
        return cls(data.positions, n_outputs, data.n_steps, data.spikes.step_ms)


def announced(design: Sections, recordings: Recordings, of_file: Ints | None) -> Shape | None:
    """Return the shape of a design's data set before it is prepared; None where the data decide.

    of_file: (n_channels, 3) positions of sampled channels and rasters; None of events.

    Raises:
        RecordingError: the recordings do not fit the task or the split.
    """
    of = Labelled.of(recordings.columns, design.task, design.split)
    n_outputs = sum(len(head.classes) for head in of.heads) or len(of.classes)
    settings, encoder = design.preprocessing, design.encoder
    if isinstance(recordings, Signals | Rasters):
        assert of_file is not None  # only events have addresses instead
        positions = of_file
        step_ms = recordings.step_ms if isinstance(recordings, Signals) else recordings.spikes.step_ms
    elif settings is not None and (settings.crop != "pins" or recordings.simulated):
        pooling = pooling_of(recordings, settings)
        positions, step_ms = pool_positions(pooling), pooling.bin_us / 1000
    else:  # the crop depends on the events
        return None
    if encoder is not None:
        try:
            positions = encoder.positions(positions)
        except ValueError:  # the encoder learns its channels
            return None
    return Shape(positions, n_outputs, design.window.n_steps, step_ms)
