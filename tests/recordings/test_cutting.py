import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from dse.config.settings import Window
from dse.recordings.windows import cut
from dse.records import Rasters, Signals, Spikes


def signals(lengths, n_channels=2):
    n = sum(lengths)
    return Signals(
        np.arange(n * n_channels, dtype=np.float32).reshape(n, n_channels),
        np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64),
        5.0,
        {"fabric": np.array([f"f{i}" for i in range(len(lengths))]), "force": np.arange(len(lengths)) * 10},
    )


def sparse(raster, step_ms=2.0):
    """Spikes of a dense (sample, step, channel) array."""
    _, n_steps, n_channels = raster.shape
    counts = raster.sum(axis=2).ravel()
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return Spikes(offsets, np.nonzero(raster)[2].astype(np.int32), n_steps, n_channels, step_ms)


@given(
    lengths=st.lists(st.integers(1, 20), min_size=1, max_size=5),
    cut_steps=st.integers(1, 6),
    every=st.one_of(st.none(), st.integers(1, 8)),
)
def test_cutting_signals_is_the_loop(lengths, cut_steps, every):
    recorded = signals([max(length, cut_steps) for length in lengths])
    before = recorded.values.copy()
    windows = cut(recorded, Window(cut_steps=cut_steps, every_steps=every))
    assert cut(recorded, Window()) is recorded
    expected = [
        (i, k, recorded.values[a + start : a + start + cut_steps])
        for i, (a, b) in enumerate(zip(recorded.offsets, recorded.offsets[1:], strict=False))
        for k, start in enumerate(range(0, b - a - cut_steps + 1, every or cut_steps))
    ]
    assert windows.n_recordings == len(expected)
    for number, (i, k, values) in enumerate(expected):
        assert np.array_equal(windows.values[windows.offsets[number] : windows.offsets[number + 1]], values)
        found = {name: column[number] for name, column in windows.columns.items()}
        assert found == {"fabric": f"f{i}", "force": 10 * i, "recording": i, "window": k}
    assert windows.values.dtype == np.float32 and windows.offsets.dtype == np.int64 and windows.step_ms == 5
    assert np.array_equal(recorded.values, before) and "recording" not in recorded.columns


@given(
    shape=st.tuples(st.integers(1, 4), st.integers(1, 12), st.integers(1, 3)),
    cut_steps=st.integers(1, 12),
    every=st.one_of(st.none(), st.integers(1, 6)),
    rate=st.sampled_from([0.0, 0.3, 1.0]),
)
def test_cutting_rasters_is_the_loop(shape, cut_steps, every, rate):
    cut_steps = min(cut_steps, shape[1])
    raster = np.random.default_rng(1).random(shape) < rate
    windows = cut(
        Rasters(sparse(raster), {"label": np.arange(shape[0])}),
        Window(cut_steps=cut_steps, every_steps=every),
    )
    expected = [
        (i, raster[i, start : start + cut_steps])
        for i in range(shape[0])
        for start in range(0, shape[1] - cut_steps + 1, every or cut_steps)
    ]
    whole = sparse(np.array([window for _, window in expected]))
    for name in ("row_offsets", "channel"):
        one, other = getattr(windows.spikes, name), getattr(whole, name)
        assert np.array_equal(one, other) and one.dtype == other.dtype
    assert (windows.spikes.n_steps, windows.spikes.n_channels, windows.spikes.step_ms) == (
        cut_steps,
        shape[2],
        2.0,
    )
    assert (
        windows.columns["recording"].tolist() == [i for i, _ in expected] == windows.columns["label"].tolist()
    )
