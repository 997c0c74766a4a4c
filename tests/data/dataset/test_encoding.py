"""Encoders of recordings that are spikes already, encoders that learn, and where channels lie."""

import json
import tracemalloc

import numpy as np
import pytest

from dse.base.records import Signals, Spikes
from dse.config.values import plain
from dse.data.dataset import cache, load
from dse.data.dataset.encoding import encoded, learnt
from dse.data.dataset.files import Stored, read_meta
from dse.data.recordings import RecordingError, splits
from tests.data.dataset.encoders import Counting, Levels, encoders  # noqa: F401
from tests.data.dataset.plain import as_prepared, build, build_for, dense, entries, prepare

pytestmark = pytest.mark.usefixtures("encoders")

RNG = np.random.default_rng(21)
RASTER = RNG.random((12, 30, 4)) < 0.4
LABEL = np.array(["b", "a", "c"] * 4)
PART = np.repeat(["train", "val", "test"], [6, 3, 3])
SIGNAL = (
    RNG.normal(size=(12, 30, 4)).astype(np.float32)
    + np.array([{"a": 0, "b": 2, "c": 5}[x] for x in LABEL])[:, None, None]
)

PARTS = {"train": {"part": "train"}, "validation": {"part": "val"}}
OF_RASTERS = {
    "data": {
        "kind": "raster", "file": "x.npz", "array": "raster", "step_ms": 5,
        "columns": {"letter": "label", "part": "part"},
    },
    "task": {"target": "letter"},
    "window": {"n_steps": 10, "jitter_steps": 3},
    "split": PARTS,
}  # fmt: skip
OF_SIGNALS = OF_RASTERS | {
    "data": {
        "kind": "time_series", "file": "x.npz", "signal": "signal", "step_ms": 5,
        "columns": {"letter": "label", "part": "part"},
    },
}  # fmt: skip
OF_EVENTS = OF_RASTERS | {
    "data": {
        "kind": "events", "file": "e.npz", "width": 4, "taxel": "taxel",
        "columns": {"letter": "label", "part": "part"},
    },
    "preprocessing": {"bin_ms": 5, "polarity": "merge"},
}  # fmt: skip
KINDS = {"raster": OF_RASTERS, "signal": OF_SIGNALS, "events": OF_EVENTS}


@pytest.fixture
def folder(tmp_path):
    np.savez(tmp_path / "x.npz", raster=RASTER, signal=SIGNAL, label=LABEL, part=PART)
    sample, step, taxel = np.nonzero(RASTER)
    ends = np.searchsorted(sample, np.arange(13))
    np.savez(
        tmp_path / "e.npz", t_us=step * 5000, taxel=taxel, offsets=ends, label=LABEL, part=PART
    )  # fmt: skip
    cache.tidy(tmp_path / "cache")
    return tmp_path


def same_windows(one, other):
    """Return whether every step that a window can reach has the same spikes."""
    reach = one.start_high + one.n_steps
    return all(
        np.array_equal(getattr(one, name), getattr(other, name))
        for name in ("start", "start_low", "start_high", "target", "train", "validation", "test")
    ) and all(np.array_equal(dense(one, i)[: reach[i]], dense(other, i)[: reach[i]]) for i in one.train)


def made(design, folder):
    """Return a prepared data set, its design as prepared, and its meta data."""
    prepared = prepare(design, folder, folder / "cache")
    return load(prepared), as_prepared(design, prepared), read_meta(prepared)


@pytest.mark.parametrize(
    "window",
    [
        {},
        {"n_steps": 10, "jitter_steps": 3},
        {"n_steps": 8, "at": "contact_onset", "onset_threshold": 2, "jitter_steps": 2},
    ],
)
@pytest.mark.parametrize("kind", ["raster", "events"])
def test_an_encoder_of_every_spike_changes_nothing(folder, kind, window):
    design = KINDS[kind] | {"window": window}
    if kind == "events" and not window:
        design |= {"window": {"n_steps": 20}}  # recordings end with their last event
    bare, _ = build(design, folder)
    through, _ = build(design | {"encoder": {"kind": "counting"}}, folder)
    assert same_windows(bare, through)
    assert bare.spikes.step_ms == through.spikes.step_ms == 5
    assert np.array_equal(bare.positions, through.positions)


def test_an_encoder_begins_at_the_first_step_that_a_window_reaches(folder):
    raster, _ = build(OF_RASTERS | {"encoder": {"kind": "counting", "every": 3}}, folder)
    assert (raster.start[0], raster.start_low[0], raster.start_high[0]) == (10, 7, 13)
    bare, _ = build(OF_EVENTS, folder)
    events, _ = build(OF_EVENTS | {"encoder": {"kind": "counting", "every": 2}}, folder)
    for i in range(9):
        assert np.array_equal(dense(raster, i), (RASTER[i] & (np.cumsum(RASTER[i], axis=0) % 3 == 0))[:23])
        before = dense(bare, i) > 0
        assert np.array_equal(dense(events, i), before & (np.cumsum(before, axis=0) % 2 == 0))
    assert not dense(raster, 9).any(), "recordings in no part have no spikes"


# --- where channels lie


PLACES = [[0, 0], [3, 0], [0, 2], [3, 2]]


def test_positions_of_sampled_channels_and_their_copies(folder):
    encoder = {"kind": "send_on_delta", "thresholds": [1, 2]}
    data, _ = build(OF_SIGNALS | {"encoder": encoder}, folder)
    assert data.positions.dtype == np.int32 and data.positions.shape == (16, 3)
    assert data.positions[:5].tolist() == [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [0, 0, 1]]
    placed = {**OF_SIGNALS["data"], "positions": PLACES}
    data, _ = build(OF_SIGNALS | {"data": placed, "encoder": encoder}, folder)
    assert data.positions.tolist() == [[*place, plane] for plane in range(4) for place in PLACES]


def test_positions_of_rasters_with_polarities(folder):
    np.savez(folder / "x.npz", raster=RASTER.reshape(12, 30, 2, 2), label=LABEL, part=PART)
    keys = {**OF_RASTERS["data"], "axes": "sample step taxel polarity"}
    data, _ = build(OF_RASTERS | {"data": keys}, folder)
    assert data.positions.tolist() == [[0, 0, 0], [0, 0, 1], [1, 0, 0], [1, 0, 1]]
    data, _ = build(OF_RASTERS | {"data": {**keys, "positions": [[5, 1], [4, 7]]}}, folder)
    assert data.positions.tolist() == [[5, 1, 0], [5, 1, 1], [4, 7, 0], [4, 7, 1]]
    new, _ = build_for(OF_RASTERS | {"data": {**keys, "positions": [[5, 1], [4, 7]]}}, folder, data.classes)
    assert np.array_equal(new.positions, data.positions)


def test_positions_of_pooled_events(folder):
    keys = {key: value for key, value in OF_EVENTS["data"].items() if key != "taxel"}
    # One pixel per recording, in each polarity: its spike must be in the channel that lies there.
    x, y, on = np.arange(12) % 5, np.arange(12) % 3, np.arange(12) % 2
    np.savez(
        folder / "e.npz", t_us=np.tile([0, 40_000], 12), x=np.repeat(x, 2), y=np.repeat(y, 2),
        p=np.repeat(on, 2), offsets=2 * np.arange(13), label=LABEL, part=PART,
    )  # fmt: skip
    design = OF_EVENTS | {
        "data": keys | {"width": 5, "height": 3, "x": "x", "y": "y", "polarity": "p"},
        "preprocessing": {"bin_ms": 5},
        "window": {"n_steps": 5, "at": "start"},
    }
    data, _ = build(design, folder)
    assert data.positions.shape == (30, 3)
    for i in range(9):
        [channel] = np.flatnonzero(dense(data, i).any(axis=0))
        assert data.positions[channel].tolist() == [x[i], y[i], on[i]]
    pooled, _ = build(design | {"preprocessing": {"bin_ms": 5, "pool": 2, "polarity": "merge"}}, folder)
    assert pooled.positions.tolist() == [[0, 0, 0], [1, 0, 0]]


def test_a_test_file_lies_where_the_data_lie(folder):
    design = OF_RASTERS | {"test": {"file": "x.npz", "positions": PLACES}}
    with pytest.raises(RecordingError, match="the test file must have the same channel positions"):
        build(design, folder)


# --- encoders that learn


@pytest.mark.parametrize("kind", KINDS)
def test_what_was_learnt_is_in_the_spikes_the_design_and_new_recordings(folder, kind):
    design = KINDS[kind] | {"encoder": {"kind": "levels"}}
    data, used, meta = made(design, folder)
    bare, _ = build(KINDS[kind] | {"encoder": {"kind": "counting"}}, folder)
    learned = np.array(used.encoder.levels)
    assert learned.shape == (3, 4) and json.dumps(meta.fitted) and not meta.transductive
    windows = SIGNAL if kind == "signal" else RASTER
    if kind != "events":  # whose middle is that of each recording's own length
        for c, name in enumerate("abc"):
            expected = windows[:6][LABEL[:6] == name, 10:20].mean(axis=1).mean(axis=0)
            assert learned[c] == pytest.approx(expected, rel=1e-5)
            assert np.array_equal(
                dense(data, 0)[:16, 4 * c : 4 * c + 4],
                (windows[0, 7:23] if kind == "signal" else windows[0, :16]) > learned[c],
            )
    assert data.positions[:, 2].tolist() == np.repeat([0, 1, 2], 4).tolist()
    assert np.array_equal(data.start, bare.start)
    Levels.seen.clear()
    new, _ = build_for(used, folder, data.classes)
    assert not Levels.seen, "nothing is learnt from new recordings"
    assert all(np.array_equal(dense(new, i), dense(data, i)) for i in range(9))
    again, _ = build(used, folder)
    assert np.array_equal(again.spikes.channel, data.spikes.channel)


@pytest.mark.parametrize("kind", KINDS)
def test_only_training_labels_are_shown_but_to_an_encoder_that_says_so(folder, kind):
    codes = np.array(["abc".index(x) for x in LABEL])
    for peeks in (False, True):
        Levels.seen.clear()
        design = KINDS[kind] | {"encoder": {"kind": "levels", "peeks": peeks}}
        why = read_meta(prepare(design, folder, folder / "cache")).transductive
        assert ("encoder levels reads the labels" in why) == peeks and bool(why) == peeks
        [seen] = Levels.seen
        shown = seen["target"][:9].tolist() if peeks else seen["target"][seen["train"]].tolist()
        assert shown == codes[: 9 if peeks else 6].tolist() and len(seen["train"]) == 6
        assert peeks or (np.delete(seen["target"], seen["train"]) == -1).all()
        assert (seen["first"][seen["train"]] + 10 <= seen["lengths"][seen["train"]]).all()


@pytest.mark.parametrize("kind", KINDS)
def test_a_test_file_is_encoded_as_the_data(folder, kind):
    file = KINDS[kind]["data"]["file"]
    design = KINDS[kind] | {"test": {"file": file}, "encoder": {"kind": "levels"}}
    data, used, _ = made(design, folder)
    alone, fitted, _ = made({key: x for key, x in design.items() if key != "test"}, folder)
    assert used.encoder == fitted.encoder
    assert data.test.tolist() == list(range(12, 24))
    for i in range(9):
        assert np.array_equal(dense(data, i)[:16], dense(alone, i)[:16])
        assert np.array_equal(dense(data, i)[:16], dense(data, 12 + i)[:16])


def test_a_class_without_training_recordings():
    signals = Signals(np.ones((6, 2), np.float32), np.array([0, 2, 4, 6]), 1.0, {})
    labels = splits.Labelled({}, None, np.array([0, 2, 1]), ("a", "b", "c"), np.array([0, 1]), None, None)
    encoder = learnt(Levels(), signals, np.zeros(3, np.int64), 2, labels)
    assert encoder.levels == ((1.0, 1.0), (1e9, 1e9), (1.0, 1.0))
    assert json.loads(json.dumps(plain(encoder))) == {
        "peeks": False, "levels": [[1, 1], [1e9, 1e9], [1, 1]]
    }  # fmt: skip


def test_what_an_encoder_refuses_is_a_fault_of_the_recordings(folder):
    for design in KINDS.values():
        with pytest.raises(RecordingError, match="levels must be fitted first"):
            build_for(design | {"encoder": {"kind": "levels"}}, folder, ("a", "b", "c"))


# --- the cache


OTHER_SPLIT = {"split": {"train": {"part": "val"}, "validation": {"part": "train"}}}


def test_a_split_changes_spikes_only_where_something_is_learnt(folder):
    for encoder, expected in (("counting", 2), ("levels", 3)):
        for entry in (folder / "cache").glob("*"):
            cache.discard(folder / "cache", entry.name)
        design = OF_RASTERS | {"encoder": {"kind": encoder}}
        made(design, folder)
        made(design | OTHER_SPLIT, folder)
        # The spikes without an encoder are shared in both cases.
        found = {name: len(keys) for name, keys in entries(folder / "cache").items()}
        assert found == {"dataset": 2, "spikes": expected}


def test_signals_of_spikes_are_made_a_few_recordings_at_a_time(monkeypatch):
    n, n_steps, n_channels = 1000, 250, 36
    rng = np.random.default_rng(2)
    counts = rng.poisson(1.0, n * n_steps).clip(max=n_channels)
    offsets = np.concatenate([[0], np.cumsum(counts)])
    channel = np.concatenate([np.arange(k) for k in counts]).astype(np.int32)
    zeros, used = np.zeros(n, np.int64), np.arange(n) % 5 > 0
    stored = Stored(
        Spikes(offsets, channel, n_steps, n_channels, 1.0), zeros, zeros, zeros, n_steps,
        np.zeros((n_channels, 3), np.int32), np.full(n, n_steps), None, ["one was repaired"],
    )  # fmt: skip
    part = encoded(stored, Counting(), used)
    assert part.notes() == ["one was repaired"] and part.n_channels == n_channels
    tracemalloc.start()
    try:
        found = sum(len(rows.channels) for rows in part.rows(1))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    per_recording = np.diff(offsets[::n_steps])
    assert found == per_recording[used].sum()
    assert max(size for _, size in Counting.shown) <= 2**24
    assert sum(count for count, _ in Counting.shown) == 800
    whole = 4 * n * n_steps * n_channels
    assert peak < 4 * 2**24 < 2 * whole
