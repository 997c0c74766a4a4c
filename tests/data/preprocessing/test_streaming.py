import itertools
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dse.base.records import Block
from dse.config.settings import POLARITIES, Preprocessing, pair
from dse.data.preprocessing import pool, survey, without_quiet
from dse.data.recordings.events import EventFile
from dse.data.recordings.pooling import pooling

NEVER = 10**9


def block(*rows):
    """Events (t, x, y, polarity)."""
    t, x, y, p = np.array(rows, dtype=np.int64).reshape(-1, 4).T
    return Block(t.copy(), x.astype(np.int32), y.astype(np.int32), p.astype(np.uint8))


def pieces(whole, cuts):
    """The same events in blocks that end at `cuts`, empty ones among them."""
    borders = [0, *sorted(min(cut, len(whole.t_us)) for cut in cuts), len(whole.t_us)]
    for a, b in itertools.pairwise(borders):
        yield Block(whole.t_us[a:b], whole.x[a:b], whole.y[a:b], whole.polarity[a:b])


def spikes(blocks, settings, width=6, height=1, t0_us=0, first_bin=0, n_bins=1):
    """The channels of every bin."""
    counts, channels = pool(blocks, pooling(settings, width, height), t0_us, first_bin, n_bins)
    assert (counts.dtype, channels.dtype) == (np.int64, np.int32)
    assert (len(counts), counts.sum()) == (n_bins, len(channels))
    return [part.tolist() for part in np.split(channels, np.cumsum(counts)[:-1])]


def definition(whole, settings, width, height, t0_us, first_bin, n_bins):
    """Counts in a dense frame, pool by pool: (n_bins, channel) bool."""
    start, end = (0, NEVER) if settings.time_ms is None else (round(edge * 1000) for edge in settings.time_ms)
    frame = np.zeros((n_bins, 2, height, width), dtype=int)
    for t, x, y, p in zip(whole.t_us.tolist(), whole.x, whole.y, whole.polarity, strict=True):
        b = (t - t0_us - start) // settings.bin_us - first_bin
        if start <= t - t0_us < end and 0 <= b < n_bins:
            frame[b, p, y, x] += 1
    if settings.polarity == "merge":
        frame = frame.sum(axis=1, keepdims=True)
    if settings.polarity.startswith("ignore"):
        frame = frame[:, :1] if settings.polarity == "ignore_on" else frame[:, 1:]
    if settings.crop is not None:
        x, y, columns, rows = settings.crop
        frame = frame[:, :, y : y + rows, x : x + columns]
    pad_x, pad_y = pair(settings.padding)
    frame = np.pad(frame, ((0, 0), (0, 0), (pad_y, pad_y), (pad_x, pad_x)))
    stride_x, stride_y = pair(settings.stride or settings.pool)
    kernel_x, kernel_y = (min(k, n) for k, n in zip(pair(settings.pool), frame.shape[:1:-1], strict=True))
    n_y = (frame.shape[2] - kernel_y) // stride_y + 1
    n_x = (frame.shape[3] - kernel_x) // stride_x + 1
    counts = np.zeros((*frame.shape[:2], n_y, n_x), dtype=int)
    for j in range(n_y):
        for i in range(n_x):
            rows = slice(j * stride_y, j * stride_y + kernel_y)
            columns = slice(i * stride_x, i * stride_x + kernel_x)
            counts[:, :, j, i] = frame[:, :, rows, columns].sum(axis=(2, 3))
    if settings.exceeds:
        found = counts > settings.pool_threshold
    else:
        found = counts >= settings.pool_threshold
    found = found.reshape(n_bins, -1)
    seconds = n_bins * settings.bin_us * 1e-6
    return found & (found.sum(axis=0) >= settings.rate_floor_hz * seconds - 1e-9)


@st.composite
def cases(draw):
    width, height = draw(st.sampled_from([(7, 5), (7, 1), (1, 3), (12, 11)]))
    sides = st.integers(1, 5)
    kernel = draw(st.one_of(sides, st.tuples(sides, sides)))
    padding = draw(st.tuples(*(st.integers(0, side - 1) for side in pair(kernel))))
    crop = None
    if draw(st.booleans()):
        x, y = draw(st.integers(0, width - 1)), draw(st.integers(0, height - 1))
        crop = (x, y, draw(st.integers(1, width - x)), draw(st.integers(1, height - y)))
    time_ms = None
    if draw(st.booleans()):
        start = draw(st.integers(0, 30))
        time_ms = (start / 1000, (start + draw(st.integers(1, 40))) / 1000)
    settings = Preprocessing(
        bin_ms=draw(st.sampled_from([0.001, 0.007, 0.05])), pool=kernel,
        stride=draw(st.one_of(st.none(), sides, st.tuples(sides, sides))), padding=padding,
        pool_threshold=draw(st.integers(1, 3)), exceeds=draw(st.booleans()),
        polarity=draw(st.sampled_from(POLARITIES)), crop=crop, time_ms=time_ms,
        rate_floor_hz=draw(st.sampled_from([0.0, 0.0, 20_000.0])),
    )  # fmt: skip
    event = st.tuples(
        st.integers(0, 60), st.integers(0, width - 1), st.integers(0, height - 1), st.integers(0, 1)
    )
    # Repeats make counts above a threshold likely.
    rows = [row for row in draw(st.lists(event, max_size=25)) for _ in range(draw(st.integers(1, 3)))]
    offset = draw(st.sampled_from([0, 3, 1 << 61]))
    whole = block(*sorted((t + offset, *rest) for t, *rest in rows))
    return whole, settings, width, height, offset, draw(st.lists(st.integers(0, 70), max_size=6))


@settings(max_examples=100)
@given(case=cases(), first_bin=st.integers(0, 3), n_bins=st.integers(1, 12))
def test_the_streaming_pass_is_the_definition(case, first_bin, n_bins):
    whole, settings, width, height, t0_us, cuts = case
    found = spikes(pieces(whole, cuts), settings, width, height, t0_us, first_bin, n_bins)
    expected = definition(whole, settings, width, height, t0_us, first_bin, n_bins)
    assert found == [np.flatnonzero(row).tolist() for row in expected]


@given(case=cases(), onset_events=st.sampled_from([1, 2, 2.5, 4]), from_start=st.booleans())
def test_the_survey_is_the_definition(case, onset_events, from_start):
    whole, settings, width, height, offset, cuts = case
    found = survey(
        pieces(whole, cuts), pooling(settings, width, height), onset_events, offset if from_start else None
    )
    assert found.n_events == len(whole.t_us)
    if not len(whole.t_us):
        assert (found.first_us, found.n_bins, found.onset_bin) == (0, 0, -1)
        return
    assert found.first_us == whole.t_us[0]
    t = whole.t_us - (offset if from_start else whole.t_us[0])
    start, end = (0, NEVER) if settings.time_ms is None else (round(edge * 1000) for edge in settings.time_ms)
    kept = (t >= start) & (t < end)
    last = min(t[-1], end - 1)  # the crop's end counts, not the last event before it
    assert found.n_bins == (0 if last < start else (last - start) // settings.bin_us + 1)
    x, y, columns, rows = settings.crop or (0, 0, width, height)
    kept &= (whole.x >= x) & (whole.x < x + columns) & (whole.y >= y) & (whole.y < y + rows)
    counts = np.bincount((t[kept] - start) // settings.bin_us, minlength=1)
    assert found.onset_bin == (int((counts >= onset_events).argmax()) if max(counts) >= onset_events else -1)


def test_bins_are_half_open_and_start_at_t_0():
    whole = block((1003, 0, 0, 1), (1012, 1, 0, 0), (1013, 2, 0, 1), (1033, 5, 0, 0))
    settings = Preprocessing(bin_ms=0.01)
    assert survey([whole], pooling(settings, 6, 1), 1).n_bins == 4
    assert spikes([whole], settings, t0_us=1003, n_bins=4) == [[1, 6], [8], [], [5]]
    assert spikes([whole], settings, t0_us=1000, n_bins=4) == [[6], [1, 8], [], [5]]


def test_polarity_and_threshold():
    whole = block((0, 0, 0, 1), (1, 0, 0, 0), (2, 1, 0, 0), (3, 1, 0, 0), (4, 2, 0, 1))
    found = {
        (polarity, n): spikes([whole], Preprocessing(1, pool_threshold=n, polarity=polarity), width=3)[0]
        for polarity in POLARITIES
        for n in (1, 2, 3)
    }
    assert found == {
        ("split", 1): [0, 1, 3, 5], ("split", 2): [1], ("split", 3): [],
        ("merge", 1): [0, 1, 2], ("merge", 2): [0, 1], ("merge", 3): [],
        ("ignore_off", 1): [0, 2], ("ignore_off", 2): [], ("ignore_off", 3): [],
        ("ignore_on", 1): [0, 1], ("ignore_on", 2): [1], ("ignore_on", 3): [],
    }  # fmt: skip


@pytest.mark.parametrize(("n", "threshold", "exceeds", "found"), [
    (254, 254, False, [0]), (254, 254, True, []), (255, 254, True, [0]), (256, 254, True, [0]),
    (600, 254, True, [0]), (257, 2, False, [0]), (253, 254, False, []),
])  # fmt: skip
def test_counts_stop_at_255_and_do_not_wrap(n, threshold, exceeds, found):
    whole = block(*[(0, 0, 0, 1)] * n)
    settings = Preprocessing(1, pool_threshold=threshold, exceeds=exceeds, polarity="merge")
    assert spikes([whole], settings) == [found]


def test_a_pixel_counts_in_every_pool_that_holds_it():
    settings = Preprocessing(1, pool=3, stride=1, padding=1, polarity="merge")
    assert spikes([block((0, 0, 0, 1))], settings, 4, 4) == [[0, 1, 4, 5]]
    assert spikes([block((0, 2, 1, 1))], settings, 4, 4) == [[1, 2, 3, 5, 6, 7, 9, 10, 11]]


def test_the_temporal_crop_begins_its_own_bins():
    whole = block(*((t, t // 10, 0, 1) for t in (0, 5, 14, 15, 24, 25, 34, 35, 50)))
    settings = Preprocessing(0.01, time_ms=(0.005, 0.035), polarity="merge")
    assert survey([whole], pooling(settings, 6, 1), 1).n_bins == 3
    # The events at 35 and later are cut off, that at 5 is not.
    assert spikes([whole], settings, n_bins=4) == [[0, 1], [1, 2], [2, 3], []]


def test_no_event_in_the_bins_that_are_kept():
    whole = block((0, 0, 0, 1), (90_000, 0, 0, 1))
    assert spikes([whole], Preprocessing(1), first_bin=10, n_bins=20) == [[]] * 20
    counts, channels = pool([whole], pooling(Preprocessing(1), 6, 1), 0, 0, 0)
    assert (counts.shape, channels.shape) == ((0,), (0,))


def test_times_near_the_end_of_int64():
    latest = (1 << 63) - 10_000
    whole = block((latest, 0, 0, 0), (latest + 999, 1, 0, 0), (latest + 1000, 2, 0, 0))
    assert survey([whole], pooling(Preprocessing(1), 6, 1), 1).n_bins == 2
    assert spikes([whole], Preprocessing(1), t0_us=latest, n_bins=100)[:3] == [[0, 1], [2], []]


def test_nothing_is_read_behind_the_last_bin():
    def blocks():
        yield block((0, 0, 0, 0))
        yield block((999, 1, 0, 0), (1000, 2, 0, 0))
        pytest.fail("read on")

    assert spikes(blocks(), Preprocessing(1)) == [[0, 1]]
    counts, _ = pool(blocks(), pooling(Preprocessing(1), 6, 1), 0, 0, 0)  # no bin: not even the first block
    assert len(counts) == 0


def copies(n, duration_us):
    """65536 events, n times, one block after the other."""
    rng = np.random.default_rng(3)
    t_us = np.sort(rng.integers(0, duration_us, 1 << 16))
    x, y = rng.integers(0, [[1280], [720]], (2, 1 << 16)).astype(np.int32)
    for k in range(n):
        yield Block(t_us + k * duration_us, x, y, np.ones(1 << 16, np.uint8))


def peak(function):
    """Return what a function returns, and the most bytes that it held on top of what was there."""
    function()  # compiled before
    tracemalloc.start()
    try:
        return function(), tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_memory_follows_blocks_and_spikes_and_not_events_or_pixels():
    found = pooling(Preprocessing(1, pool=16), 1280, 720)
    (few, some), (many, more) = (
        peak(lambda n=n: pool(copies(n, 1000 // n), found, 0, 0, 1)) for n in (4, 40)
    )
    assert few[0][0] > 3000 and many[0][0] >= few[0][0]
    assert more < some + 50_000  # ten times the events of the same bin
    # The output outgrows its first room many times; dense, it would be 80 x 45 x 2 x 40000 bytes.
    (counts, channels), held = peak(lambda: pool(copies(40, 1_000_000), found, 0, 0, 40_000))
    assert counts.sum() == len(channels) > 100 * found.n_channels
    assert held < some + counts.nbytes + 5 * channels.nbytes


def test_the_rate_floor_silences_channels_of_low_rate():
    # In 4 bins of 1 ms: channel 0 has a spike in two bins (500 Hz), 1 in one (250 Hz), 2 in four.
    whole = block(
        *((t, x, 0, 0) for t in (0, 1000, 2000, 3000) for x in range(3) if x == 2 or t < 2000 - 1000 * x)
    )
    rates = {
        floor: spikes([whole], Preprocessing(1, polarity="merge", rate_floor_hz=floor), n_bins=4)
        for floor in (0.0, 250.0, 250.1, 500.0, 501.0, 1001.0)
    }
    everything = [[0, 1, 2], [0, 2], [2], [2]]
    assert rates == {
        0.0: everything, 250.0: everything, 250.1: [[0, 2], [0, 2], [2], [2]],
        500.0: [[0, 2], [0, 2], [2], [2]], 501.0: [[2]] * 4, 1001.0: [[]] * 4,
    }  # fmt: skip


def test_the_rate_floor_leaves_its_input_alone():
    found = pooling(Preprocessing(1, rate_floor_hz=600.0), 6, 1)
    counts, channels = np.array([2, 1, 0]), np.array([1, 4, 4], dtype=np.int32)
    for array in (counts, channels):
        array.setflags(write=False)
    kept, left = without_quiet(counts, channels, found)
    assert (kept.tolist(), left.tolist(), left.dtype) == ([1, 1, 0], [4, 4], np.int32)


def test_onset_counts_both_polarities_in_the_crop():
    whole = block((0, 5, 0, 1), (1, 5, 0, 1), (10, 0, 0, 1), (19, 1, 0, 0), (20, 1, 0, 0))
    settings = Preprocessing(0.01, polarity="ignore_off")
    assert survey([whole], pooling(settings, 6, 1), 2).onset_bin == 0
    cropped = Preprocessing(0.01, polarity="ignore_off", crop=(0, 0, 4, 1))
    assert survey([whole], pooling(cropped, 6, 1), 2).onset_bin == 1
    assert survey([whole], pooling(cropped, 6, 1), 3).onset_bin == -1


def test_input_is_left_alone():
    whole = block((0, 1, 0, 1), (5, 2, 0, 0))
    for array in (whole.t_us, whole.x, whole.y, whole.polarity):
        array.setflags(write=False)
    assert survey([whole], pooling(Preprocessing(0.001), 6, 1), 1).n_bins == 6
    assert spikes([whole], Preprocessing(0.001), n_bins=6) == [[7], [], [], [], [], [2]]


def test_public_recordings(shared_data):
    source = EventFile("neutouch_objects/neutouch_objects.npz", 80, taxel="taxel", polarity="polarity")
    events = source.read(shared_data)
    settings = Preprocessing(20, pool=4, stride=4, pool_threshold=2)
    found = pooling(settings, events.width, events.height)
    assert (events.n_recordings, found.n_channels) == (360, 40)
    for i in (0, 100, 359):
        (whole,) = events.blocks(i)
        about = survey(pieces(whole, range(0, len(whole.t_us), 1000)), found, 3)
        assert (about.first_us, about.n_events) == (whole.t_us[0], len(whole.t_us))
        channels = spikes(
            pieces(whole, range(0, len(whole.t_us), 777)), settings, events.width, events.height,
            about.first_us, 0, about.n_bins,
        )  # fmt: skip
        expected = definition(whole, settings, events.width, events.height, about.first_us, 0, about.n_bins)
        assert channels == [np.flatnonzero(row).tolist() for row in expected]
        assert expected.any()
