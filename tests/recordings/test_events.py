import numpy as np
import pytest

from dse.recordings import RecordingError
from dse.recordings.events import EventFile

GOOD = {
    "t_us": np.array([5, 5, 9, 2, 7], dtype=np.int32),
    "taxel": np.array([0, 3, 1, 2, 2], dtype=np.uint8),
    "polarity": np.array([1, 0, 1, 1, 0], dtype=np.uint8),
    "offsets": np.array([0, 3, 5]),
    "label": np.array([0, 1]),
}
SOURCE = EventFile("x.npz", width=4, taxel="taxel", polarity="polarity", columns={"object": "label"})


def test_taxel_events(write, tmp_path):
    write("x.npz", **GOOD)
    assert SOURCE.check(tmp_path) == []
    events = SOURCE.read(tmp_path)
    assert events.t_us.dtype == np.int64 and events.t_us.tolist() == [5, 5, 9, 2, 7]
    assert (events.x.tolist(), events.y.tolist()) == ([0, 3, 1, 2, 2], [0] * 5)
    assert events.polarity.dtype == np.uint8 and events.polarity.tolist() == [1, 0, 1, 1, 0]
    assert (events.width, events.height, events.n_recordings) == (4, 1, 2)


def test_pixel_events_without_polarity_are_all_on(write, tmp_path):
    write("x.npz", t=GOOD["t_us"], u=GOOD["taxel"], v=np.array([0, 1, 2, 2, 0]), o=GOOD["offsets"])
    events = EventFile("x.npz", 4, 3, t_us="t", x="u", y="v", offsets="o").read(tmp_path)
    assert events.y.tolist() == [0, 1, 2, 2, 0] and events.polarity.tolist() == [1] * 5


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            {"t_us": np.array([5, 4, 9, 2, 7])},
            "times must not decrease within a recording, got 4 at event 1 of recording 0",
        ),
        (
            {"t_us": np.array([5, 5, 9, 7, 2])},
            "times must not decrease within a recording, got 2 at event 1 of recording 1",
        ),
        ({"t_us": np.array([-5, 5, 9, 2, 7])}, "time must be >= 0 us, got -5 at event 0 of recording 0"),
        (
            {"t_us": np.array([5.0, 5, 9, 2, 7])},
            "'t_us' must be one integer for each of the 5 events, got float64",
        ),
        ({"t_us": np.zeros((5, 1), int)}, "'t_us' must have one value per event, got shape"),
        (
            {"taxel": np.array([0, 4, 1, 2, 2])},
            r"address must be in \[0, 3\], got 4 at event 1 of recording 0",
        ),
        (
            {"taxel": np.array([0, 3, 1, -1, 2])},
            r"address must be in \[0, 3\], got -1 at event 0 of recording 1",
        ),
        ({"offsets": np.array(3)}, r"offsets must be integers, .* got int64 of shape \(\)"),
        (
            {"taxel": np.array([0, 3, 1, 2])},
            r"'taxel' must be one integer for each of the 5 events, got .*\(4,\)",
        ),
        (
            {"polarity": np.array([1, -1, 1, 1, 1])},
            "polarity must be 0 or 1, got -1 at event 1 of recording 0",
        ),
        (
            {"polarity": np.array([1, 1, 1, 1, 256])},
            "polarity must be 0 or 1, got 256 at event 1 of recording 1",
        ),
        ({"offsets": np.array([0, 3, 6])}, "offsets must run from 0 to its end at 5, got 0 to 6"),
        ({"label": np.array([0])}, "must have one value for each of the 2 recordings"),
    ],
)
def test_each_fault_is_one_clear_line(write, tmp_path, wrong, message):
    write("x.npz", **GOOD | wrong)
    with pytest.raises(RecordingError, match=message) as error:
        SOURCE.read(tmp_path)
    assert str(error.value).startswith("x.npz: ") and "\n" not in str(error.value)


@pytest.mark.parametrize("offsets", [[0, 3, 3, 5], [0, 0, 3, 5], [0, 3, 5, 5]])
def test_a_recording_may_be_empty(write, tmp_path, offsets):
    write("x.npz", **GOOD | {"offsets": np.array(offsets), "label": np.arange(3)})
    events = SOURCE.read(tmp_path)
    found = [[t for block in events.blocks(i) for t in block.t_us.tolist()] for i in range(3)]
    assert [x for x in found if x] == [[5, 5, 9], [2, 7]]
    assert len(found) == 3


def test_a_fall_beside_an_empty_recording_is_found(write, tmp_path):
    write("x.npz", **GOOD | {"offsets": np.array([0, 5, 5])})
    with pytest.raises(RecordingError, match="must not decrease within a recording, got 2 at event 3"):
        SOURCE.read(tmp_path)


def test_rows_outside_the_frame(write, tmp_path):
    write("x.npz", **GOOD | {"y": np.array([0, 1, 2, 1, 0])})
    with pytest.raises(RecordingError, match=r"row y must be in \[0, 1\], got 2 at event 2 of recording 0"):
        EventFile("x.npz", 4, 2, x="taxel", y="y").read(tmp_path)


@pytest.mark.parametrize(
    "arrays", [{}, {"y": "y"}, {"x": "x", "taxel": "taxel"}, {"y": "y", "taxel": "taxel"}]
)
def test_addresses_are_pixels_or_taxels(arrays):
    with pytest.raises(RecordingError, match=r"arrays of addresses: x \(and y\), or taxel"):
        EventFile("x.npz", 4, **arrays)


def test_check_and_unlabelled_files(write, tmp_path):
    write("x.npz", **{k: v for k, v in GOOD.items() if k != "label"})
    assert SOURCE.check(tmp_path) == [
        "x.npz: no array 'label'; known: t_us, taxel, polarity, offsets. Did you mean 'taxel'?"
    ]
    assert SOURCE.with_columns_found(tmp_path).read(tmp_path).columns == {}


def test_public_recordings(shared_data):
    source = EventFile(
        "neutouch_objects/neutouch_objects.npz", 80, taxel="taxel", polarity="polarity",
        columns={"object": "label", "session": "session"}, class_names={"object": "class_names"},
    )  # fmt: skip
    assert source.check(shared_data) == []
    events = source.read(shared_data)
    assert (events.n_recordings, len(events.t_us)) == (360, 2773164)
    assert (events.columns["session"] == "class_test/trial1").sum() == 80
