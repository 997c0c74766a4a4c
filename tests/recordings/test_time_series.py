import dataclasses

import numpy as np
import pytest

from dse.recordings import RecordingError
from dse.recordings.time_series import TimeSeries

GOOD = {
    "signal": np.arange(20).reshape(10, 2),
    "offsets": np.array([0, 4, 10]),
    "label": np.array([1, 0]),
    "names": np.array(["smooth", "rough"]),
    "force": np.array([0.5, 2.0]),
}
SOURCE = TimeSeries(
    "x.npz",
    step_ms=28,
    offsets="offsets",
    columns={"fabric": "label", "force": "force"},
    class_names={"fabric": "names"},
)


def test_recordings_lie_end_to_end_with_named_labels(write, tmp_path):
    write("x.npz", **GOOD)
    assert SOURCE.check(tmp_path) == []
    signals = SOURCE.read(tmp_path)
    assert signals.values.dtype == np.float32 and signals.values.tolist() == GOOD["signal"].tolist()
    assert signals.offsets.dtype == np.int64 and signals.offsets.tolist() == [0, 4, 10]
    assert (signals.n_recordings, signals.n_channels, signals.step_ms) == (2, 2, 28.0)
    assert signals.columns["fabric"].tolist() == ["rough", "smooth"]
    assert signals.columns["force"].tolist() == [0.5, 2.0]


def test_a_cube_needs_no_offsets(write, tmp_path):
    cube = np.arange(24.0).reshape(2, 4, 3)
    write("x.npz", signal=cube, label=[3, 4])
    source = TimeSeries("x.npz", step_ms=1, columns={"a": "label"})
    assert source.check(tmp_path) == []
    signals = source.read(tmp_path)
    assert signals.offsets.tolist() == [0, 4, 8]
    assert np.array_equal(signals.values.reshape(2, 4, 3), cube)


def _nan(value: float) -> np.ndarray:
    signal = GOOD["signal"].astype(float)
    signal[6, 1] = value
    return signal


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"signal": np.zeros((10, 2, 1))}, r"'signal' must be \(sample, channel\), got shape \(10, 2, 1\)"),
        ({"signal": np.array([["a", "b"]] * 10)}, "'signal' must hold numbers, got <U1"),
        ({"signal": _nan(np.nan)}, "must be finite, got nan in recording 1, sample 2, channel 1"),
        ({"signal": _nan(1e300)}, "must be finite, got inf in recording 1, sample 2, channel 1"),
        ({"signal": _nan(-np.inf)}, "must be finite, got -inf in recording 1, sample 2, channel 1"),
        ({"signal": np.zeros((10, 0))}, "'signal' has no channel"),
        ({"offsets": np.array([0, 4, 9])}, "offsets must run from 0 to its end at 10, got 0 to 9"),
        ({"offsets": np.array([1, 4, 10])}, "offsets must run from 0 to its end at 10, got 1 to 10"),
        ({"offsets": np.array([0, 12, 10])}, "offsets must not decrease, got 12 and then 10"),
        ({"offsets": np.array([0, 10, 10])}, "recording 1 is empty"),
        ({"offsets": np.array([0.0, 4, 10])}, "offsets must be integers, one more .*got float64"),
        ({"offsets": np.array([0])}, r"offsets must be integers, one more .*of shape \(1,\)"),
        (
            {"label": np.array([1, 0, 1])},
            r"column 'fabric' \(array 'label'\) must have one value for each of the 2",
        ),
        (
            {"label": np.array([[1], [0]])},
            r"must have one value for each of the 2 recordings, got shape \(2, 1\)",
        ),
        (
            {"label": np.array([0, 2])},
            "column 'fabric' has code 2 for recording 1, but class_names holds 2 names",
        ),
        ({"label": np.array([0, -1])}, "column 'fabric' has code -1 for recording 1"),
        ({"label": np.array([0.0, 1])}, "column 'fabric' must hold integer codes to be named .*got float64"),
        ({"names": np.array([["a", "b"]])}, r"class_names must be a list of names, got shape \(1, 2\)"),
        ({"force": np.array([0.5, np.nan])}, "column 'force' is NaN for recording 1"),
        ({"force": np.array([0.5, 1j])}, "column 'force' must hold numbers or texts, got complex128"),
    ],
)
def test_each_fault_is_one_clear_line(write, tmp_path, wrong, message):
    write("x.npz", **GOOD | wrong)
    with pytest.raises(RecordingError, match=message) as error:
        SOURCE.read(tmp_path)
    assert str(error.value).startswith("x.npz: ") and "\n" not in str(error.value)


def test_check_sees_everything_that_headers_show_at_once(write, tmp_path):
    write("x.npz", **{k: v for k, v in GOOD.items() if k != "names"} | {"force": np.zeros(3)})
    faults = TimeSeries(
        "x.npz",
        28,
        "sgnal",
        "offsets",
        {"fabric": "label", "force": "force"},
        {"fabric": "names", "speed": "label"},
    ).check(tmp_path)
    assert len(faults) == 4
    assert "no array 'sgnal'" in faults[0] and "Did you mean 'signal'?" in faults[0]
    assert "no array 'names'" in faults[1]
    assert "column 'force' (array 'force') must have one value for each of the 2 recordings" in faults[2]
    assert "class_names contains 'speed', which is not a column" in faults[3]


def test_check_of_a_missing_or_cut_file_is_its_one_fault(write, tmp_path):
    assert ["not found" in x for x in SOURCE.check(tmp_path)] == [True]
    path = write("x.npz", **GOOD)
    path.write_bytes(path.read_bytes()[:200])
    assert ["truncated" in x for x in SOURCE.check(tmp_path)] == [True]


def test_unlabelled_recordings_keep_the_columns_they_have(write, tmp_path):
    write("x.npz", **{k: v for k, v in GOOD.items() if k != "label"})
    component = SOURCE.with_columns_found(tmp_path)
    assert (component.columns, component.class_names) == ({"force": "force"}, {})
    assert list(component.read(tmp_path).columns) == ["force"]


def test_public_recordings(shared_data):
    source = TimeSeries(
        "fabric_slide/fabric_slide_train_val.npz", 28, offsets="offsets",
        columns={"fabric": "label", "velocity": "velocity_mm_s"}, class_names={"fabric": "class_names"},
    )  # fmt: skip
    assert source.check(shared_data) == []
    signals = source.read(shared_data)
    assert (signals.n_recordings, signals.values.shape) == (644, (445271, 16))
    names, counts = np.unique(signals.columns["fabric"], return_counts=True)
    assert dict(zip(names.tolist(), counts.tolist(), strict=True)) == {
        "BeigeCotton": 120, "BrownCotton": 120, "Canvas": 120, "Denim": 48, "DenimFlex": 48, "Linen": 120,
        "WovenFabric": 68,
    }  # fmt: skip
    lengths = np.diff(signals.offsets)
    speed = np.abs(signals.columns["velocity"])
    assert lengths.min() == 141 and np.median(lengths[speed == 10]) == pytest.approx(2116, abs=2)


def test_channels_lie_where_positions_say(write, tmp_path):
    write("x.npz", **GOOD)
    row = SOURCE.channel_positions(tmp_path)
    assert (row.dtype, row.tolist()) == (np.int32, [[0, 0, 0], [1, 0, 0]])
    placed = dataclasses.replace(SOURCE, positions=((3, 1), (0, 2)))
    assert placed.check(tmp_path) == []
    assert placed.channel_positions(tmp_path).tolist() == [[3, 1, 0], [0, 2, 0]]
    write("cube.npz", signal=np.zeros((2, 4, 3)))
    cube = TimeSeries("cube.npz", step_ms=1, positions=((3, 1), (0, 2)))
    assert cube.check(tmp_path) == ["data.positions must hold [x, y] for each of the 3 taxels, got 2"]
    with pytest.raises(RecordingError, match="for each of the 3 taxels, got 2"):
        cube.channel_positions(tmp_path)
    with pytest.raises(RecordingError, match=r"must be distinct, got \[3, 1\] for taxels 0 and 1"):
        dataclasses.replace(SOURCE, positions=((3, 1), (3, 1)))


@pytest.mark.parametrize("signal", [np.zeros((10, 0)), np.zeros(10)])
def test_no_channel_lies_nowhere(write, tmp_path, signal):
    write("x.npz", **GOOD | {"signal": signal})
    with pytest.raises(RecordingError, match="'signal' has no channel"):
        SOURCE.channel_positions(tmp_path)
