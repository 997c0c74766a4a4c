import numpy as np
import pytest

from dse.config import ConfigError
from dse.data.dataset import cache, load, read_meta
from dse.data.recordings import RecordingError
from tests.data.dataset.plain import build, build_for, dense, prepare
from tests.data.encoders.plain import send_on_delta

RNG = np.random.default_rng(8)
LENGTHS = RNG.integers(40, 60, 12)
OFFSETS = np.concatenate([[0], np.cumsum(LENGTHS)])
SIGNAL = RNG.integers(0, 30, (OFFSETS[-1], 3)).astype(np.uint16)
LABEL = np.arange(12) % 3
REPETITION = np.arange(12) // 3
NAMES = np.array(["wool", "silk", "linen"])

DESIGN = {
    "data": {
        "kind": "time_series", "file": "x.npz", "signal": "signal", "offsets": "offsets", "step_ms": 28,
        "columns": {"fabric": "label", "repetition": "repetition"}, "class_names": {"fabric": "names"},
    },
    "task": {"name": "texture", "target": "fabric"},
    "window": {"n_steps": 20, "at": "middle", "jitter_steps": 4},
    "split": {"train": {"repetition": [0, 1]}, "validation": {"repetition": [2]}},
    "encoder": {"kind": "send_on_delta", "thresholds": [2, 5]},
}  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    save(tmp_path / "x.npz")
    return tmp_path


def save(path, recordings=range(12), **other):
    recordings = list(recordings)
    arrays = {
        "signal": np.concatenate([SIGNAL[OFFSETS[i] : OFFSETS[i + 1]] for i in recordings]),
        "offsets": np.concatenate([[0], np.cumsum(LENGTHS[recordings])]),
        "label": LABEL[recordings],
        "repetition": REPETITION[recordings],
        "names": NAMES,
    }
    np.savez(path, **{name: array for name, array in (arrays | other).items() if array is not None})


def window_of(dataset, sample, start=None):
    """The spikes in a window of one sample, dense."""
    return dense(dataset, sample, dataset.start[sample] if start is None else start, dataset.n_steps)


def encoded(recording, first, n_steps=20, thresholds=(2.0, 5.0)):
    whole = send_on_delta(SIGNAL[OFFSETS[recording] : OFFSETS[recording + 1]], thresholds, "step")
    return whole[first : first + n_steps]


def test_sampled_recordings_become_windows_of_spikes(folder):
    dataset, notes = build(DESIGN, folder)
    assert notes == []
    assert dataset.classes == ("linen", "silk", "wool")
    assert [dataset.classes[i] for i in dataset.target[:9]] == ["wool", "silk", "linen"] * 3
    assert dataset.train.tolist() == list(range(6)) and dataset.validation.tolist() == [6, 7, 8]
    assert dataset.test.size == 0 and dataset.test.dtype == np.int64
    assert (dataset.n_steps, dataset.spikes.n_channels, dataset.spikes.step_ms) == (20, 12, 28.0)
    assert (dataset.start_high + dataset.n_steps <= dataset.spikes.n_steps).all()
    for i in range(9):
        middle = (LENGTHS[i] - 20) // 2
        assert np.array_equal(window_of(dataset, i), encoded(i, middle))
        assert np.array_equal(window_of(dataset, i, dataset.start_low[i]), encoded(i, middle - 4))
        assert np.array_equal(window_of(dataset, i, dataset.start_high[i]), encoded(i, middle + 4))
        assert dataset.start_high[i] - dataset.start_low[i] == 8


def test_recordings_in_no_part_have_no_spikes_and_may_be_short(folder):
    save(
        folder / "x.npz",
        offsets=np.concatenate([OFFSETS[:-1], [OFFSETS[-2] + 3]]),
        signal=SIGNAL[: OFFSETS[-2] + 3],
    )
    spikes = build(DESIGN, folder)[0].spikes
    assert spikes.n_samples == 12 and spikes.row_offsets[9 * spikes.n_steps] == spikes.channel.size


def test_classes_are_those_in_use(folder):
    save(folder / "x.npz", label=np.where(REPETITION == 3, 1, 2 * (LABEL % 2)))
    dataset, _ = build(DESIGN, folder)
    assert dataset.classes == ("linen", "wool")
    assert set(dataset.target[:9].tolist()) == {0, 1} and dataset.target[9:].tolist() == [-1, -1, -1]


def test_a_test_file_is_appended_and_keeps_the_classes_of_the_data_file(folder):
    # Other codes for the same names, one class absent.
    save(folder / "new.npz", [11, 9, 2], names=np.array(["linen", "none", "wool"]), label=np.array([0, 2, 0]))
    dataset, _ = build(DESIGN | {"test": {"file": "new.npz"}}, folder)
    assert dataset.test.tolist() == [12, 13, 14]
    assert [dataset.classes[i] for i in dataset.target[12:]] == ["linen", "wool", "linen"]
    for sample, recording in zip((12, 13, 14), (11, 9, 2), strict=True):
        assert np.array_equal(window_of(dataset, sample), encoded(recording, (LENGTHS[recording] - 20) // 2))
    alone, _ = build(DESIGN, folder)
    for i in range(9):
        assert np.array_equal(window_of(dataset, i), window_of(alone, i))


def test_a_test_file_may_name_its_own_columns(folder):
    save(folder / "new.npz", [0, 1, 2], label=None, repetition=None, cloth=np.array([2, 1, 0]))
    test = {"file": "new.npz", "columns": {"fabric": "cloth"}}
    dataset, _ = build(DESIGN | {"test": test}, folder)
    assert [dataset.classes[i] for i in dataset.target[dataset.test]] == ["linen", "silk", "wool"]


def test_new_recordings_are_prepared_alike(folder):
    save(folder / "new.npz", [4, 10, 5])
    new = {**DESIGN["data"], "file": "new.npz"}
    by_test, _ = build(DESIGN | {"test": {"file": "new.npz"}}, folder)
    dataset, _ = build_for(DESIGN | {"data": new}, folder, by_test.classes)
    assert dataset.test.tolist() == [0, 1, 2] and dataset.train.size == dataset.validation.size == 0
    assert dataset.target.tolist() == by_test.target[by_test.test].tolist()
    assert dataset.classes == by_test.classes
    for i in range(3):
        assert np.array_equal(window_of(dataset, i), window_of(by_test, 12 + i))


def test_new_recordings_need_no_labels(folder):
    save(folder / "new.npz", [4, 10], label=None, repetition=None, names=None)
    dataset, _ = build_for(DESIGN | {"data": {**DESIGN["data"], "file": "new.npz"}}, folder, ("a", "b"))
    assert dataset.target.tolist() == [-1, -1] and dataset.classes == ("a", "b")


def test_mean_removal_leaves_changes_as_they_are(folder):
    window = {**DESIGN["window"], "remove_mean": True}
    # Thresholds between two counts: rounding after the subtraction of a mean cannot reach them.
    half = {"kind": "send_on_delta", "thresholds": [1.5, 4.5], "reference": "value"}
    plain, _ = build(DESIGN | {"encoder": half}, folder)
    removed, _ = build(DESIGN | {"encoder": half, "window": window}, folder)
    assert np.array_equal(plain.spikes.channel, removed.spikes.channel)


RASTER = {
    "data": {
        "kind": "raster", "file": "r.npz", "array": "spikes", "step_ms": 5,
        "columns": {"letter": "label", "part": "part"},
    },
    "task": {"target": "letter"},
    "split": {"train": {"part": "train"}, "validation": {"part": "val"}},
}  # fmt: skip
SPIKES = RNG.random((8, 30, 4)) < 0.3
SPIKES[:, :5] = False


@pytest.fixture
def rasters(tmp_path):
    part = np.array(["train", "train", "val", "val"] * 2)
    np.savez(tmp_path / "r.npz", spikes=SPIKES, label=np.arange(8) % 2, part=part)
    return tmp_path


def test_rasters_whole_and_in_windows(rasters):
    dataset, _ = build(RASTER, rasters)
    assert (dataset.n_steps, dataset.classes, dataset.train.tolist()) == (30, ("0", "1"), [0, 1, 4, 5])
    assert all(np.array_equal(window_of(dataset, i), SPIKES[i]) for i in range(8))
    dataset, _ = build(RASTER | {"window": {"n_steps": 10, "jitter_steps": 15}}, rasters)
    assert set(dataset.start.tolist()) == {10} and set(dataset.start_low.tolist()) == {0}
    assert set(dataset.start_high.tolist()) == {20}
    assert np.array_equal(window_of(dataset, 3), SPIKES[3, 10:20])
    onset = {"n_steps": 10, "at": "contact_onset", "onset_threshold": 2}
    dataset, _ = build(RASTER | {"window": onset}, rasters)
    for i in range(8):
        assert dataset.start[i] == (SPIKES[i].sum(axis=1) >= 2).argmax() >= 5


EVENTS = {
    "data": {
        "kind": "events", "file": "e.npz", "width": 4, "taxel": "taxel", "polarity": "polarity",
        "columns": {"object": "label", "part": "part"},
    },
    "task": {"target": "object"},
    "window": {"n_steps": 5, "at": "contact_onset", "onset_threshold": 3},
    "split": {"train": {"part": 0}, "validation": {"part": 1}},
    "preprocessing": {"bin_ms": 1},
}  # fmt: skip


@pytest.fixture
def events(tmp_path):
    # Three events at the onset, 2 ms + i after the first; then one per ms on taxel i % 4 for 10 ms.
    t, taxel, offsets = [], [], [0]
    for i in range(4):
        onset = 2000 + 1000 * i
        t += [500, *[500 + onset] * 3, *(500 + onset + 1000 * np.arange(1, 10))]
        taxel += [0, 1, 2, 3, *[i] * 9]
        offsets.append(len(t))
    polarity = np.ones(len(t), dtype=np.uint8)
    np.savez(
        tmp_path / "e.npz", t_us=np.array(t), taxel=np.array(taxel), polarity=polarity,
        offsets=np.array(offsets), label=np.array([0, 1, 0, 1]), part=np.array([0, 0, 1, 1]),
    )  # fmt: skip
    return tmp_path


def test_events_from_their_contact_onset(events):
    dataset, _ = build(EVENTS, events)
    assert (dataset.n_steps, dataset.spikes.n_channels, dataset.spikes.step_ms) == (5, 8, 1.0)
    for i in range(4):
        steps = [np.flatnonzero(row).tolist() for row in window_of(dataset, i)]
        assert steps == [[5, 6, 7], *[[4 + i]] * 4]


REFUSED = [
    ("folder", DESIGN, {"encoder": None}, "encoder is required: it turns data of kind 'time_series'"),
    ("folder", DESIGN, {"preprocessing": {"bin_ms": 1}}, "preprocessing does not apply to data of kind"),
    ("rasters", RASTER, {"preprocessing": {"bin_ms": 1}}, "preprocessing does not apply to data of kind"),
    ("rasters", RASTER, {"window": {"remove_mean": True}}, "window.remove_mean must be false"),
    ("events", EVENTS, {"preprocessing": None}, "preprocessing is required: it turns data of kind 'events'"),
    ("folder", DESIGN, {"window": {"n_steps": 70}}, "a window of 70 steps does not fit recording 0"),
    (
        "folder",
        DESIGN,
        {"split": {"train": {"fabric": "wool"}, "validation": {"fabric": "silk"}}},
        "split cannot",
    ),
    ("folder", DESIGN, {"task": {"target": "velocity"}}, "task.target: no column 'velocity'"),
    ("folder", DESIGN, {"data": {**DESIGN["data"], "kind": "series"}}, "unknown data.kind 'series'; known"),
    ("folder", DESIGN, {"encoder": {"kind": "send_on_delta", "theta": 2}}, "unknown key 'encoder.theta'"),
    ("folder", DESIGN, {"test": {"file": "absent.npz"}}, "data file 'absent.npz' not found"),
    (
        *(
            "folder",
            DESIGN,
            {"test": {"file": "x.npz"}, "split": {"stratified": {"validation": 0.3, "test": 0.3}}},
        ),
        "from split.test or from the test file, not from both",
    ),
]


@pytest.mark.parametrize(("fixture", "design", "change", "message"), REFUSED)
def test_faults_are_one_clear_line(request, fixture, design, change, message):
    with pytest.raises((RecordingError, ConfigError), match=message) as error:
        build(design | change, request.getfixturevalue(fixture))
    assert "\n" not in str(error.value)


def test_other_recordings_that_do_not_fit(folder):
    unknown = {"names": np.array(["wool", "tweed", "linen"])}
    for other, test, message in (
        (unknown, {}, "the test file: class 'tweed' is unknown; .* linen, silk, wool"),
        ({"signal": SIGNAL[:, :2]}, {}, "the test file must have 12 channels, as the data file, got 8"),
        ({}, {"step_ms": 10}, "the test file must have 28.0 ms per step, as the data file, got 10.0"),
    ):
        save(folder / "new.npz", **other)
        with pytest.raises(RecordingError, match=message):
            build(DESIGN | {"test": {"file": "new.npz", **test}}, folder)
    with pytest.raises(RecordingError, match=r"the new recordings: class 'linen' .* are silk, wool"):
        build_for(DESIGN, folder, ("silk", "wool"))


def test_a_joint_target_has_heads(folder):
    speed = np.array([10, 20, 10, 20] * 3)
    save(folder / "x.npz", speed=speed)
    design = DESIGN | {
        "data": {**DESIGN["data"], "columns": {**DESIGN["data"]["columns"], "speed": "speed"}},
        "task": {"target": ["fabric", "speed"]},
    }
    plain, _ = build(design, folder)
    assert plain.heads == () and "linen|10" in plain.classes
    joint, _ = build(design | {"task": {**design["task"], "joint": True}}, folder)
    assert joint.classes == plain.classes and np.array_equal(joint.target, plain.target)
    fabric, speeds = joint.heads
    assert (fabric.name, fabric.classes) == ("fabric", ("linen", "silk", "wool"))
    assert (speeds.name, speeds.classes) == ("speed", ("10", "20"))
    for i in range(9):
        assert fabric.classes[fabric.of_class[joint.target[i]]] == NAMES[LABEL[i]]
        assert speeds.classes[speeds.of_class[joint.target[i]]] == str(speed[i])
    with pytest.raises(RecordingError, match=r"task\.joint needs at least two columns in task\.target"):
        build(DESIGN | {"task": {"target": "fabric", "joint": True}}, folder)


def test_traps_are_looked_for_in_every_head(folder):
    level = np.repeat(LABEL * 100, LENGTHS).astype(np.uint16)[:, None]
    save(folder / "x.npz", signal=SIGNAL + level, other=np.array([0, 1] * 6))
    design = DESIGN | {
        "data": {**DESIGN["data"], "columns": {**DESIGN["data"]["columns"], "other": "other"}},
        "task": {"target": ["fabric", "other"], "joint": True},
        "split": {"train": {"repetition": [0, 1]}, "validation": {"repetition": [2, 3]}},
    }
    _, notes = build(design, folder)
    assert [note.split(" with ")[0] for note in notes] == [
        "resting level (mean of each channel) alone predicts fabric"
    ]


PIECES = DESIGN | {"window": {"cut_steps": 12, "every_steps": 6}}


def test_pieces_of_recordings_are_recordings(folder):
    n = (LENGTHS - 12) // 6 + 1
    dataset, _ = build(PIECES, folder)
    assert (dataset.spikes.n_samples, dataset.n_steps) == (n.sum(), 12)
    first = np.cumsum(n) - n
    assert np.array_equal(dataset.train, np.arange(n[:6].sum()))
    # Each piece begins anew: its first sample is the first level that was sent.
    values = SIGNAL[OFFSETS[1] + 6 : OFFSETS[1] + 18]
    assert np.array_equal(window_of(dataset, first[1] + 1), send_on_delta(values, (2.0, 5.0), "step"))
    save(folder / "new.npz", [4, 10])
    design = PIECES | {"data": {**DESIGN["data"], "file": "new.npz"}}
    new, _ = build_for(design, folder, dataset.classes)
    assert new.test.size == n[4] + n[10]
    assert np.array_equal(window_of(new, 0), window_of(dataset, first[4]))
    tested, _ = build(PIECES | {"test": {"file": "new.npz"}}, folder)
    assert tested.test.tolist() == (n.sum() + np.arange(n[4] + n[10])).tolist()


@pytest.mark.parametrize("kind", ["stratified", "k_fold"])
def test_pieces_of_one_recording_in_two_parts_are_said_to_leak(folder, kind):
    rule = {"stratified": {"validation": 0.4}, "k_fold": {"k": 3}}[kind]
    cache.tidy(folder / "cache")
    found = {}
    for group in (None, "recording"):
        design = PIECES | {"split": {kind: {**rule, "group": group}}}
        prepared = prepare(design, folder, folder / "cache")
        data, found[group] = load(prepared), read_meta(prepared).transductive
    assert "are in train and in validation" in found[None]
    assert found["recording"] == ""
    n = (LENGTHS - 12) // 6 + 1
    original = np.repeat(np.arange(12), n)
    assert not np.intersect1d(original[data.train], original[data.validation]).size
