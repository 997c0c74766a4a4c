import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.preprocessing import POLARITIES, Preprocessing, event_onset, n_bins, pooled, spikes_of
from dse.recordings.events import EventFile
from dse.records import Events, Spikes


def recordings(*parts: list[tuple[int, int, int, int]], width: int = 6, height: int = 1) -> Events:
    rows = np.array([row for part in parts for row in part], dtype=np.int64).reshape(-1, 4)
    offsets = np.concatenate([[0], np.cumsum([len(part) for part in parts])])
    t, x, y, p = rows.T
    return Events(t, x.astype(np.int32), y.astype(np.int32), p.astype(np.uint8), offsets, width, height, {})


def dense(spikes: Spikes) -> np.ndarray:
    out = np.zeros((spikes.n_samples * spikes.n_steps, spikes.n_channels), dtype=bool)
    rows = np.repeat(np.arange(len(out)), np.diff(spikes.row_offsets))
    order = rows * spikes.n_channels + spikes.channel
    assert (np.diff(order) > 0).all()  # by sample, step, channel; nothing twice
    out[rows, spikes.channel] = True
    return out.reshape(spikes.n_samples, spikes.n_steps, spikes.n_channels)


def whole(events: Events, settings: Preprocessing) -> Spikes:
    lengths = n_bins(events, settings)
    return spikes_of(events, settings, np.zeros_like(lengths), lengths)


def definition(events: Events, settings: Preprocessing, i: int) -> np.ndarray:
    """Counts in a dense frame, pool by pool: what the sparse path must equal."""
    (n_x, kernel_x, stride), (n_y, kernel_y, _) = (
        pooled(size, settings) for size in (events.width, events.height)
    )
    part = slice(events.offsets[i], events.offsets[i + 1])
    t, x, y, p = (a[part] for a in (events.t_us, events.x, events.y, events.polarity))
    bins = (t - t[0]) // settings.bin_us
    frame = np.zeros((bins[-1] + 1, 2, events.height, events.width), dtype=int)
    np.add.at(frame, (bins, p, y, x), 1)
    if settings.polarity != "split":
        frame = frame[:, 1:] if settings.polarity == "ignore_off" else frame.sum(axis=1, keepdims=True)
    counts = np.zeros((*frame.shape[:2], n_y, n_x), dtype=int)
    for j in range(n_y):
        for k in range(n_x):
            rows, columns = slice(j * stride, j * stride + kernel_y), slice(k * stride, k * stride + kernel_x)
            counts[:, :, j, k] = frame[:, :, rows, columns].sum(axis=(2, 3))
    return (counts >= settings.pool_threshold).reshape(len(frame), -1)


def test_bins_start_at_the_first_event():
    events = recordings([(1003, 0, 0, 1), (1012, 1, 0, 0), (1013, 2, 0, 1), (1033, 5, 0, 0)])
    spikes = whole(events, Preprocessing(bin_ms=0.01))
    assert (spikes.n_steps, spikes.n_channels, spikes.step_ms) == (4, 12, 0.01)
    assert np.argwhere(dense(spikes)[0]).tolist() == [[0, 1], [0, 6], [1, 8], [3, 5]]


def test_polarity_and_threshold():
    events = recordings([(0, 0, 0, 1), (1, 0, 0, 0), (2, 1, 0, 0), (3, 1, 0, 0), (4, 2, 0, 1)], width=3)
    counts = {
        (polarity, n): np.flatnonzero(
            dense(whole(events, Preprocessing(1, pool_threshold=n, polarity=polarity)))
        ).tolist()
        for polarity in POLARITIES
        for n in (1, 2, 3)
    }
    assert counts == {
        ("split", 1): [0, 1, 3, 5], ("split", 2): [1], ("split", 3): [],
        ("merge", 1): [0, 1, 2], ("merge", 2): [0, 1], ("merge", 3): [],
        ("ignore_off", 1): [0, 2], ("ignore_off", 2): [], ("ignore_off", 3): [],
    }  # fmt: skip


@pytest.mark.parametrize(
    ("size", "pool", "stride", "found"),
    [
        (160, 4, 4, (40, 4, 4)),
        (160, 4, None, (40, 4, 4)),
        (10, 4, 4, (2, 4, 4)),
        (10, 4, 2, (4, 4, 2)),
        (10, 2, 5, (2, 2, 5)),
        (1, 4, 4, (1, 1, 4)),
        (3, 4, 2, (1, 3, 2)),
    ],
)
def test_number_of_pools(size, pool, stride, found):
    assert pooled(size, Preprocessing(1, pool, stride)) == found


@given(
    rows=st.lists(
        st.tuples(st.integers(0, 40), st.integers(0, 6), st.integers(0, 4), st.integers(0, 1)),
        min_size=1,
        max_size=40,
    ),
    height=st.sampled_from([1, 5]),
    pool=st.integers(1, 4),
    stride=st.sampled_from([None, 1, 2, 3, 5]),
    threshold=st.integers(1, 3),
    polarity=st.sampled_from(POLARITIES),
)
def test_the_sparse_path_is_the_definition(rows, height, pool, stride, threshold, polarity):
    events = recordings(sorted((t, x, min(y, height - 1), p) for t, x, y, p in rows), width=7, height=height)
    settings = Preprocessing(0.007, pool, stride, threshold, polarity)
    assert np.array_equal(dense(whole(events, settings))[0], definition(events, settings, 0))


def test_many_recordings_cut_to_their_spans():
    rng = np.random.default_rng(2)
    parts = [
        [(int(t), *(int(x) for x in rng.integers(0, [6, 3, 2]))) for t in np.sort(rng.integers(50, 900, n))]
        for n in (80, 5, 60)
    ]
    events = recordings(*parts, width=6, height=3)
    settings = Preprocessing(0.05, 2, 1)
    first, length = np.array([3, 0, 5]), np.array([8, 0, 4])
    found = dense(spikes_of(events, settings, first, length))
    assert found.shape == (3, 8, 2 * 5 * 2)
    for i in (0, 2):
        expected = definition(events, settings, i)[first[i] : first[i] + length[i]]
        assert np.array_equal(found[i, : length[i]], expected) and not found[i, length[i] :].any()
    assert not found[1].any()


def test_lengths_and_onset_in_bins():
    events = recordings(
        [(7, 0, 0, 1), (26, 1, 0, 0), (27, 2, 0, 1), (46, 1, 0, 1)], [(100, 0, 0, 1), (109, 0, 0, 1)]
    )
    settings = Preprocessing(bin_ms=0.01)
    assert n_bins(events, settings).tolist() == [4, 1]
    assert event_onset(events, settings, 2).tolist() == [-1, 0]
    assert event_onset(events, Preprocessing(0.02), 2).tolist() == [0, 0]
    assert event_onset(events, Preprocessing(0.02), 3).tolist() == [-1, -1]


def test_input_is_left_alone():
    events = recordings([(0, 1, 0, 1), (5, 2, 0, 0)])
    for array in (events.t_us, events.x, events.y, events.polarity, events.offsets):
        array.setflags(write=False)
    assert whole(events, Preprocessing(0.001)).channel.size == 2


def test_public_recordings(shared_data):
    source = EventFile("neutouch_objects/neutouch_objects.npz", 80, taxel="taxel", polarity="polarity")
    events = source.read(shared_data)
    settings = Preprocessing(20, pool=4, stride=4, pool_threshold=2)
    lengths = n_bins(events, settings)
    spikes = spikes_of(events, settings, np.zeros_like(lengths), lengths)
    assert (spikes.n_samples, spikes.n_channels, spikes.n_steps) == (360, 40, lengths.max())
    for i in (0, 100, 359):
        rows = slice(i * spikes.n_steps, i * spikes.n_steps + lengths[i] + 1)
        counts = np.diff(spikes.row_offsets[rows])
        assert np.array_equal(counts, definition(events, settings, i).sum(axis=1))
