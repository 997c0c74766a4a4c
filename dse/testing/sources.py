"""The contract of a source of recordings."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dse.base.records import Rasters, Signals
from dse.config.contracts import Recordings, Source
from dse.config.resolved import front_end
from dse.testing.expect import expect, expect_component


def check_source(source: Source, base: Path) -> None:
    """Check a source of recordings.

    Args:
        source: of recordings that are sound.
        base: folder that its files lie beside.

    Raises:
        AssertionError: what it violates.
    """
    name = expect_component(source)
    faults = source.check(base)
    expect(faults == [], f"{name}.check must find no fault in sound recordings, got {faults}")
    content = source.content(base)
    expect(content and content == source.content(base), f"{name}.content must be a hash, the same twice")
    recordings = source.read(base)
    _check_kind(source, recordings)
    n = recordings.spikes.n_samples if isinstance(recordings, Rasters) else recordings.n_recordings
    expect(n > 0, f"{name}.read must return recordings")
    missing = sorted(set(source.columns) - set(recordings.columns))
    expect(
        not missing, f"{name}.read must return the label columns of its key, it lacks {', '.join(missing)}"
    )
    for column, values in recordings.columns.items():
        expect(len(values) == n, f"{name}: label column {column} must have {n} values, got {len(values)}")
    if isinstance(recordings, Signals):
        offsets = np.asarray(recordings.offsets)
        whole = offsets[0] == 0 and offsets[-1] == len(recordings.values) and (np.diff(offsets) >= 0).all()
        expect(whole, f"{name}: offsets must rise from 0 to the number of samples")
    elif not isinstance(recordings, Rasters):
        for i in range(n):
            for block in recordings.blocks(i):
                inside = (block.x < recordings.width).all() and (block.y < recordings.height).all()
                expect(inside, f"{name}: addresses must be below {recordings.width} and {recordings.height}")
                expect((np.diff(block.t_us) >= 0).all(), f"{name}: time must not fall within a recording")
    positions = source.channel_positions(base)
    if positions is not None:
        expect(positions.ndim == 2 and positions.shape[1] == 3, f"{name}.channel_positions must be (n, 3)")


def _check_kind(source: Source, recordings: Recordings) -> None:
    """Check what is known of recordings before they are read: the section that they need."""
    name, kind = type(source).__name__, type(recordings).__name__
    declares = all(hasattr(recordings, key) for key in ("front_end", "simulated"))
    expect(
        declares or isinstance(recordings, Signals | Rasters),
        f"{kind} must inherit `EventSource`, which declares `front_end` and `simulated`",
    )
    try:
        declared = front_end(type(source))
    except (AttributeError, KeyError, NameError, TypeError) as error:
        text = f"{name}.read must be annotated with the one class of recordings that it returns, {kind}"
        raise AssertionError(text) from error
    expect(
        declared == recordings.front_end,
        f"{name}.read must return what its annotation says: recordings for {declared}, got {kind}",
    )
