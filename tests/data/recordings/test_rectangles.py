"""Recordings of one file: tables, arrays, rasters and events, where channels lie, and faults in one line."""

import dataclasses

import numpy as np
import pandas as pd
import pytest

from dse.data.recordings import RecordingError
from dse.data.recordings.events import EventFile
from dse.data.recordings.raster import RasterFile, sparse
from dse.data.recordings.table import LongTable, Table
from dse.data.recordings.time_series import TimeSeries, WideTable
from tests.data.recordings.rectangles import (
    EVENTS,
    LABEL_COLUMNS,
    LABELS,
    LONG,
    LONG_TABLE,
    RASTER,
    SAMPLES,
    SERIES,
    SPIKES,
    TABLE,
    TAXELS,
    TIME_SERIES,
    WIDE,
    WIDE_TABLE,
)


def save(folder, samples=SAMPLES, labels=LABELS):
    samples.to_csv(folder / "x.csv", index=False)
    labels.to_csv(folder / "labels.csv", index=False)


def edited(frame, column, row, value):
    frame = frame.copy()
    frame[column] = frame[column].astype(object)
    frame.loc[row, column] = value
    return frame


def with_value(value):
    signal = SERIES["signal"].astype(float)
    signal[6, 1] = value
    return signal


def dense(spikes):
    out = np.zeros((spikes.n_samples * spikes.n_steps, spikes.n_channels), dtype=np.uint8)
    for row in range(len(out)):
        out[row, spikes.channel[spikes.row_offsets[row] : spikes.row_offsets[row + 1]]] += 1
    return out.reshape(spikes.n_samples, spikes.n_steps, spikes.n_channels)


# ---- what is wrong

OF_TABLES = [
    (TABLE, edited(SAMPLES, "left", 3, None), "column 'left' is empty or NaN in line 5"),
    (TABLE, edited(SAMPLES, "left", 3, "u"), "column 'left' must hold numbers, got"),
    (TABLE, edited(SAMPLES, "right", 4, "inf"), "finite, got inf in recording 0, sample 1, channel 1"),
    (TABLE, edited(SAMPLES, "id", 1, None), "'id' is empty in line 3"),
    (TABLE, edited(SAMPLES, "id", 1, "c"), "recording 'c' has no row in the label table labels.csv"),
    (TABLE, SAMPLES[SAMPLES.id == "a"], "recording 'b' has no samples"),
    (TABLE, SAMPLES[:0], "the table has no rows"),
    (TABLE, edited(SAMPLES, "t", 0, -10), "'b': all channels .* step_ms = 10 ms, got -10, 10 in sample 1"),
    (TABLE, edited(SAMPLES, "t", 3, 40), "by step_ms = 10 ms, got 10, 40 in sample 2"),
    (TABLE, SAMPLES[::-1], "recording 'a': times must rise, got 10 ms and then 0 ms in sample 1"),
    (TABLE, SAMPLES.drop(columns="right"), "no column 'right'; known: id, t, left"),
    (LONG_TABLE, LONG.assign(taxel="a"), "recording '0' has no samples of channel 'b'"),
    (LONG_TABLE, LONG.assign(taxel=["c", *"bababababab"]), r"channel 'c' is not among data\.channels"),
    (LONG_TABLE, LONG.assign(taxel=["a", "b\n\x1b[2J"] * 6), r"channel 'b\\n\\x1b\[2J' is not among"),
    (LONG_TABLE, LONG.drop(columns="pressure"), r"no column 'pressure'; known: t, taxel, cloth"),
    (LONG_TABLE, LONG.assign(pressure=["high", *range(11)]), "must hold numbers, got 'high' in line 2"),
    (LONG_TABLE, LONG.assign(cloth=["felt", *LONG.cloth[1:]]), "got 'felt' and, in line 3, 'silk'"),
    (WIDE_TABLE, WIDE.assign(l_1=[1.0, np.nan]), "column 'l_1' must hold a number in line 3, got none"),
    (WIDE_TABLE, WIDE.assign(r_10=[1.0, np.nan]), "column 'r_10' must hold a number in line 3, got none"),
    (WIDE_TABLE, WIDE.assign(l_1=["1", "x"]), "column 'l_1' must hold numbers, got 'x' in line 3"),
    (WIDE_TABLE, WIDE.assign(cloth=["silk", None]), "'cloth' is empty in line 3"),
    (WIDE_TABLE, WIDE.drop(columns="r_1"), "columns as each other, got 4 of 'l_', 3 of 'r_'"),
    (WIDE_TABLE, WIDE.drop(columns="cloth"), "no column 'cloth'; known: l_0"),
    (WIDE_TABLE, WIDE.rename(columns=lambda x: x.replace("r_", "q_")), "is named 'r_' and a number"),
    (WIDE_TABLE, WIDE[:0], "the table has no rows"),
]
OF_LABELS = [
    (LABELS.rename(columns={"cloth": "cloths"}), "no column 'cloth'; .*Did you mean 'cloths'"),
    (pd.concat([LABELS, LABELS[:1]]), "recording 'a' has more than one row"),
    (edited(LABELS, "cloth", 1, None), "'cloth' is empty in line 3"),
]
ONE_EACH = r"must have one value for each of the 2"
OF_ARRAYS = [
    (TIME_SERIES, {"signal": np.zeros((10, 2, 1))}, r"must be \(sample, channel\), got .*\(10, 2, 1\)"),
    (TIME_SERIES, {"signal": np.array([["a", "b"]] * 10)}, "'signal' must hold numbers, got <U1"),
    (TIME_SERIES, {"signal": with_value(np.nan)}, "finite, got nan in recording 1, sample 2, channel 1"),
    (TIME_SERIES, {"signal": with_value(1e300)}, "finite, got inf in recording 1, sample 2, channel 1"),
    (TIME_SERIES, {"signal": np.zeros((10, 0))}, "'signal' has no channel"),
    (TIME_SERIES, {"offsets": np.array([0, 4, 9])}, "offsets must run from 0 to its end at 10, got 0 to 9"),
    (TIME_SERIES, {"offsets": np.array([1, 4, 10])}, "must run from 0 to its end at 10, got 1 to 10"),
    (TIME_SERIES, {"offsets": np.array([0, 12, 10])}, "offsets must not decrease, got 12 and then 10"),
    (TIME_SERIES, {"offsets": np.array([0, 10, 10])}, "recording 1 is empty"),
    (TIME_SERIES, {"offsets": np.array([0.0, 4, 10])}, "offsets must be integers, one more .*got float64"),
    (TIME_SERIES, {"offsets": np.array([0])}, r"offsets must be integers, one more .*of shape \(1,\)"),
    (TIME_SERIES, {"label": np.array([1, 0, 1])}, rf"column 'fabric' \(array 'label'\) {ONE_EACH}"),
    (TIME_SERIES, {"label": np.zeros((2, 1, 1))}, rf"{ONE_EACH} recordings, got shape \(2, 1, 1\)"),
    (TIME_SERIES, {"label": np.array([0, 2])}, "has code 2 for recording 1, but class_names holds 2"),
    (TIME_SERIES, {"label": np.array([0, -1])}, "column 'fabric' has code -1 for recording 1"),
    (TIME_SERIES, {"label": np.array([0.0, 1])}, "must hold integer codes to be named .*got float64"),
    (TIME_SERIES, {"names": np.array([["a", "b"]])}, r"must be a list of names, got shape \(1, 2\)"),
    (TIME_SERIES, {"force": np.array([0.5, np.nan])}, "column 'force' is NaN for recording 1"),
    (TIME_SERIES, {"force": np.array([0.5, 1j])}, "'force' must hold numbers or texts, got complex128"),
    (EVENTS, {"t_us": np.array([5, 4, 9, 2, 7])}, "must not decrease .*, got 4 at event 1 of recording 0"),
    (EVENTS, {"t_us": np.array([5, 5, 9, 7, 2])}, "must not decrease .*, got 2 at event 1 of recording 1"),
    (EVENTS, {"t_us": np.array([-5, 5, 9, 2, 7])}, "time must be >= 0 us, got -5 at event 0 of recording 0"),
    (EVENTS, {"t_us": np.array([5.0, 5, 9, 2, 7])}, "'t_us' must be one integer for each .* got float64"),
    (EVENTS, {"t_us": np.zeros((5, 1), int)}, "'t_us' must have one value per event, got shape"),
    (EVENTS, {"taxel": np.array([0, 4, 1, 2, 2])}, r"address must be in \[0, 3\], got 4 at event 1"),
    (EVENTS, {"taxel": np.array([0, 3, 1, -1, 2])}, "got -1 at event 0 of recording 1"),
    (EVENTS, {"taxel": np.array([0, 3, 1, 2])}, r"'taxel' must be one integer for each of the 5 .*\(4,\)"),
    (EVENTS, {"polarity": np.array([1, -1, 1, 1, 1])}, "polarity must be 0 or 1, got -1 at event 1 of rec"),
    (EVENTS, {"polarity": np.array([1, 1, 1, 1, 256])}, "polarity must be 0 or 1, got 256 at event 1 of rec"),
    (EVENTS, {"offsets": np.array(3)}, r"offsets must be integers, .* got int64 of shape \(\)"),
    (EVENTS, {"offsets": np.array([0, 3, 6])}, "offsets must run from 0 to its end at 5, got 0 to 6"),
    (EVENTS, {"offsets": np.array([0, 5, 5])}, "must not decrease within a recording, got 2 at event 3"),
    (EVENTS, {"label": np.array([0])}, f"{ONE_EACH} recordings"),
    (RASTER, {"spikes": SPIKES * 2}, "must be 0 or 1, got 2 in recording 0, step"),
    (RASTER, {"spikes": SPIKES - 0.5}, "must be 0 or 1, got -0.5 in recording 0, step 0, channel 0"),
    (RASTER, {"spikes": SPIKES.astype(str)}, "must hold 0 and 1, got <U"),
    (RASTER, {"spikes": SPIKES[:0], "label": []}, r"must hold samples, steps and channels, .*\(0, 11, 4\)"),
    (RASTER, {"spikes": SPIKES[0], "label": [1] * 11}, r"axes 'sample step channel', got .*\(11, 4\)"),
    (RasterFile("x.npz", 5, n_steps=12), {"spikes": SPIKES}, "must hold 12 steps, got 11"),
    (RasterFile("x.npz", 5, packed=True), {"spikes": SPIKES.astype(int)}, "must be uint8 to be packed bits"),
    (RasterFile("x.npz", 5, shape="shape"), {"shape": [3, 11]}, "'shape' must hold 3 integers > 0"),
    (RasterFile("x.npz", 5, shape="shape"), {"shape": [3, -1, 4]}, "'shape' must hold 3 integers > 0"),
]
WHOLE = {TimeSeries: SERIES, EventFile: TAXELS, RasterFile: {"spikes": SPIKES, "label": [1, 2, 3]}}


def one_line(source, folder, message, name):
    with pytest.raises(RecordingError, match=message) as error:
        source.read(folder)
    assert str(error.value).startswith(name) and "\n" not in str(error.value)


@pytest.mark.parametrize(("source", "frame", "message"), OF_TABLES)
def test_each_fault_of_a_table_is_one_clear_line(tmp_path, source, frame, message):
    save(tmp_path, frame)
    one_line(source, tmp_path, message, "x.csv")


@pytest.mark.parametrize(("labels", "message"), OF_LABELS)
def test_each_fault_of_a_label_table_is_one_clear_line(tmp_path, labels, message):
    save(tmp_path, labels=labels)
    one_line(TABLE, tmp_path, message, "labels.csv")


@pytest.mark.parametrize(("source", "wrong", "message"), OF_ARRAYS)
def test_each_fault_of_arrays_is_one_clear_line(write, tmp_path, source, wrong, message):
    write("x.npz", **WHOLE[type(source)] | wrong)
    one_line(source, tmp_path, message, "x.npz")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("x.csv", b"", "x.csv: the file is empty"),
        ("x.csv", b'id,t,left,right\na,"b', "x.csv: the file cannot be read"),
        ("x.parquet", b"PAR1 and no more", "x.parquet: the file cannot be read"),
        ("x.doc", b"id", "x.doc: the file cannot be read"),
    ],
)
def test_unreadable_tables(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    one_line(Table(name, 10, ("left",), "id"), tmp_path, message, name)


KEYS = [
    (Table, {"channels": ()}, "data.channels must contain at least one channel"),
    (Table, {"channels": ("left", "cloth")}, "sensor channels only, got 'cloth', which is a label column"),
    (Table, {"channels": ("t",), "time_ms": "t"}, "must be sensor channels only, got 't'"),
    (Table, {"channels": ("left",), "time": "t", "time_ms": "t"}, "data.time and data.time_ms exclude each"),
    (Table, {"channels": ("left",), "time_unit": "s"}, "data.time_unit needs data.time"),
    (Table, {"channels": ("left",), "resample": "linear"}, "data.resample needs data.time"),
    (Table, {"channels": ("left",), "recording": None, "time": "t"}, "data.labels needs data.recording"),
    (Table, {"channels": ("left",), "recording": None, "labels": None}, "data.recording must name a column"),
    (Table, {"channels": ("a", "b"), "positions": ((3, 1),)}, "for each of the 2 taxels, got 1"),
    (RasterFile, {"positions": ((2, 1), (0, 0), (2, 1))}, r"distinct, got \[2, 1\] for taxels 0 and 2"),
    (RasterFile, {"axes": "step channel"}, "data.axes must name each axis once"),
    (RasterFile, {"axes": "sample step step"}, "each axis once"),
    (RasterFile, {"n_steps": 3, "shape": "shape"}, "data must have n_steps or shape, not both"),
    *(
        (EventFile, keys, r"arrays of addresses: x \(and y\), or taxel")
        for keys in ({}, {"y": "y"}, {"x": "x", "taxel": "taxel"}, {"y": "y", "taxel": "taxel"})
    ),
]
REQUIRED = {
    Table: {"file": "x.csv", "step_ms": 10, "labels": "y.csv", "columns": {"fabric": "cloth"}},
    RasterFile: {"file": "x.npz", "step_ms": 5},
    EventFile: {"file": "x.npz", "width": 4},
}


@pytest.mark.parametrize(("kind", "keys", "message"), KEYS)
def test_keys_that_contradict(kind, keys, message):
    with pytest.raises(RecordingError, match=message):
        kind(**REQUIRED[kind] | keys)


def test_check_sees_everything_that_headers_show_at_once(write, tmp_path):
    save(tmp_path, labels=LABELS.drop(columns=["cloth", "speed"]))
    faults = dataclasses.replace(TABLE, channels=("middle",), time_ms=None).check(tmp_path)
    assert [x.split(";")[0] for x in faults] == [
        "x.csv: no column 'middle'", "labels.csv: no column 'cloth'", "labels.csv: no column 'speed'"
    ]  # fmt: skip
    assert "not found" in Table("y.csv", 10, ("left",)).check(tmp_path)[0]
    assert ["not found" in x for x in TIME_SERIES.check(tmp_path)] == [True]
    path = write("x.npz", **{k: v for k, v in SERIES.items() if k != "names"} | {"force": np.zeros(3)})
    names = {"fabric": "names", "speed": "label"}
    faults = dataclasses.replace(TIME_SERIES, signal="sgnal", class_names=names).check(tmp_path)
    assert len(faults) == 4
    assert "no array 'sgnal'" in faults[0] and "Did you mean 'signal'?" in faults[0]
    assert "no array 'names'" in faults[1]
    assert f"column 'force' (array 'force') {ONE_EACH} recordings" in faults[2]
    assert "class_names contains 'speed', which is not a column" in faults[3]
    path.write_bytes(path.read_bytes()[:200])
    assert ["truncated" in x for x in TIME_SERIES.check(tmp_path)] == [True]


def test_unlabelled_recordings_keep_the_columns_they_have(write, tmp_path):
    save(tmp_path, labels=LABELS.drop(columns="cloth"))
    assert TABLE.with_columns_found(tmp_path).columns == {"v": "speed"}
    assert TABLE.with_columns_found(tmp_path).read(tmp_path).columns["v"].tolist() == [-5, 10]
    (tmp_path / "labels.csv").unlink()
    assert TABLE.with_columns_found(tmp_path).read(tmp_path).columns == {}
    write("x.npz", **{k: v for k, v in SERIES.items() if k != "label"})
    component = TIME_SERIES.with_columns_found(tmp_path)
    assert (component.columns, component.class_names) == ({"force": "force"}, {})
    assert list(component.read(tmp_path).columns) == ["force"]
    write("x.npz", **{k: v for k, v in TAXELS.items() if k != "label"})
    assert EVENTS.check(tmp_path) == [
        "x.npz: no array 'label'; known: t_us, taxel, polarity, offsets. Did you mean 'taxel'?"
    ]
    assert EVENTS.with_columns_found(tmp_path).read(tmp_path).columns == {}
    write("x.npz", spikes=SPIKES, label=[1, 2])
    source = RasterFile("x.npz", 5, columns={"letter": "label", "split": "split"})
    faults = source.check(tmp_path)
    assert len(faults) == 2 and "no array 'split'" in faults[0] and "each of the 3 recordings" in faults[1]
    assert source.with_columns_found(tmp_path).columns == {"letter": "label"}


# ---- where channels lie


def test_sampled_channels_lie_where_positions_say(write, tmp_path):
    write("x.npz", **SERIES)
    write("cube.npz", signal=np.zeros((2, 4, 3)))
    for source in (TIME_SERIES, Table("x.csv", 1.0, ("a", "b")), WIDE_TABLE):
        row = source.channel_positions(tmp_path)
        assert (row.dtype, row.tolist()) == (np.int32, [[0, 0, 0], [1, 0, 0]])
        placed = dataclasses.replace(source, positions=((3, 1), (0, 2)))
        assert placed.channel_positions(tmp_path).tolist() == [[3, 1, 0], [0, 2, 0]]
    cube = TimeSeries("cube.npz", step_ms=1, positions=((3, 1), (0, 2)))
    assert cube.check(tmp_path) == ["data.positions must hold [x, y] for each of the 3 taxels, got 2"]
    with pytest.raises(RecordingError, match="for each of the 3 taxels, got 2"):
        cube.channel_positions(tmp_path)
    for signal in (np.zeros((10, 0)), np.zeros(10)):
        write("x.npz", **SERIES | {"signal": signal})
        with pytest.raises(RecordingError, match="'signal' has no channel"):
            TIME_SERIES.channel_positions(tmp_path)


@pytest.mark.parametrize(
    ("axes", "shape", "expected"),
    [
        ("sample step", (2, 3), [[0, 0, 0]]),
        ("sample step channel", (2, 3, 2), [[0, 0, 0], [1, 0, 0]]),
        ("sample taxel polarity step", (2, 2, 2, 3), [[0, 0, 0], [0, 0, 1], [1, 0, 0], [1, 0, 1]]),
        ("polarity sample taxel step", (2, 2, 2, 3), [[0, 0, 0], [1, 0, 0], [0, 0, 1], [1, 0, 1]]),
        ("sample step polarity", (2, 3, 2), [[0, 0, 0], [0, 0, 1]]),
        ("row sample polarity column step", (2, 1, 1, 3, 4), [[k, 0, 0] for k in range(6)]),
    ],
)
def test_an_axis_of_polarity_is_the_plane(write, tmp_path, axes, shape, expected):
    write("x.npz", spikes=np.zeros(shape, dtype=np.uint8))
    source = RasterFile("x.npz", 5, axes=axes)
    found = source.channel_positions(tmp_path)
    assert (found.dtype, found.tolist()) == (np.int32, expected)
    assert len(found) == source.read(tmp_path).spikes.n_channels


def test_positions_of_a_raster_are_of_taxels(write, tmp_path):
    write("x.npz", spikes=np.zeros((2, 2, 3, 4), dtype=np.uint8))
    source = RasterFile("x.npz", 5, axes="sample polarity taxel step", positions=((9, 0), (5, 5), (0, 9)))
    assert source.check(tmp_path) == []
    places = [[9, 0], [5, 5], [0, 9]]
    assert source.channel_positions(tmp_path).tolist() == [[*xy, p] for p in (0, 1) for xy in places]
    source = RasterFile("x.npz", 5, axes="sample plane taxel step", positions=((9, 0), (5, 5)))
    assert source.check(tmp_path) == ["data.positions must hold [x, y] for each of the 6 taxels, got 2"]
    for shape in ((2, 3, 0), (2, 3)):
        write("x.npz", spikes=np.zeros(shape, dtype=np.uint8))
        with pytest.raises(RecordingError, match="the axes 'sample step channel', none of length 0"):
            RasterFile("x.npz", 5).channel_positions(tmp_path)


# ---- tables


@pytest.mark.parametrize("ending", ["csv", "parquet", "npz"])
def test_a_table_is_grouped_by_recording(tmp_path, ending):
    save(tmp_path)
    for name, frame in (("x", SAMPLES), ("labels", LABELS)):
        frame.to_parquet(tmp_path / f"{name}.parquet")
        np.savez(tmp_path / f"{name}.npz", **{column: frame[column].tolist() for column in frame})
    source = dataclasses.replace(TABLE, file=f"x.{ending}", labels=f"labels.{ending}")
    assert source.check(tmp_path) == []
    signals = source.read(tmp_path)
    assert signals.offsets.tolist() == [0, 2, 5]
    assert signals.values.tolist() == [[30, 7], [40, 8], [1, 0.5], [2, 0.25], [3, 0.125]]
    assert {k: v.tolist() for k, v in signals.columns.items()} == {"fabric": ["silk", "wool"], "v": [-5, 10]}
    assert signals.columns["fabric"].dtype.kind == "U" and signals.columns.keys() == LABEL_COLUMNS.keys()
    bare = Table(f"x.{ending}", 10, ("left",), "id").read(tmp_path)  # recordings come as they appear
    assert bare.values.ravel().tolist() == [1, 2, 3, 30, 40] and bare.columns == {}


TIDY = pd.DataFrame(
    {
        "seconds": [0.0, 0.01, 0.02, 0.0, 0.01],
        "left": [1.0, 2.0, 3.0, 30.0, 40.0],
        "cloth": ["wool", "wool", "wool", "silk", "silk"],
    }
)


@pytest.mark.parametrize(
    ("unit", "scale", "separator"), [("s", 1, ","), ("s", 1, ";"), ("ms", 1e3, "\t"), ("us", 1e6, ",")]
)
def test_a_tidy_table_needs_no_other_file(tmp_path, unit, scale, separator):
    TIDY.assign(seconds=TIDY.seconds * scale).to_csv(tmp_path / "x.csv", index=False, sep=separator)
    source = Table("x.csv", 10, ("left",), None, columns={"fabric": "cloth"}, time="seconds", time_unit=unit)
    assert source.check(tmp_path) == []
    signals = source.read(tmp_path)
    assert signals.offsets.tolist() == [0, 3, 5] and signals.values.ravel().tolist() == [1, 2, 3, 30, 40]
    assert signals.columns["fabric"].tolist() == ["wool", "silk"] and signals.notes() == []
    assert source.with_columns_found(tmp_path) == source


def test_a_label_that_changes_within_a_recording_is_named_with_its_line(tmp_path):
    TIDY.assign(id=list("aaabb"), cloth=["wool", "silk", "wool", "silk", "silk"]).to_csv(tmp_path / "x.csv")
    source = Table("x.csv", 10, ("left",), "id", columns={"fabric": "cloth"})
    with pytest.raises(RecordingError, match=r"got 'wool' and, in line 3, 'silk' in recording 'a'"):
        source.read(tmp_path)


def test_uneven_times_are_a_fault_or_are_interpolated_with_a_note(tmp_path):
    TIDY.assign(id=list("aaabb"), seconds=[0, 0.01, 0.04, 0, 0.01]).to_csv(tmp_path / "x.csv")
    source = Table("x.csv", 10, ("left",), "id", time="seconds", time_unit="s")
    with pytest.raises(RecordingError, match=r"must have times that rise .*data\.resample: linear"):
        source.read(tmp_path)
    signals = dataclasses.replace(source, resample="linear").read(tmp_path)
    assert signals.offsets.tolist() == [0, 5, 7]
    assert signals.values.ravel().tolist() == pytest.approx([1, 2, 2 + 1 / 3, 2 + 2 / 3, 3, 30, 40])
    (note,) = signals.notes()
    assert note.startswith("x.csv: 1 of 2 recordings have samples at uneven times")
    assert note.endswith("every 10 ms (widest gap 30 ms)")
    TIDY.assign(id=list("aaabb"), seconds=[0, 0.01, 0.01, 0, 0.01]).to_csv(tmp_path / "x.csv")
    with pytest.raises(RecordingError, match="times must rise, got 10 ms and then 10 ms in sample 2"):
        dataclasses.replace(source, resample="linear").read(tmp_path)


LONG_VALUES = [[100, 0], [101, 1], [102, 2], [110, 10], [111, 11], [112, 12]]


@pytest.mark.parametrize("by", [["cloth", "t", "taxel"], ["cloth", "taxel", "t"]])
def test_a_recording_begins_where_the_time_of_a_channel_falls(tmp_path, by):
    LONG.sort_values(by, kind="stable").to_csv(tmp_path / "x.csv", index=False)
    assert LONG_TABLE.check(tmp_path) == []
    signals = LONG_TABLE.read(tmp_path)
    assert signals.values.tolist() == LONG_VALUES and signals.offsets.tolist() == [0, 3, 6]
    assert signals.columns["fabric"].tolist() == ["silk", "wool"] and signals.notes() == []


def test_recordings_and_labels_of_a_long_table_may_be_named_in_a_table_beside(tmp_path):
    shuffled = LONG.assign(id=LONG.cloth).drop(columns="cloth").sample(frac=1, random_state=1)
    shuffled.sort_values("t").to_csv(tmp_path / "x.csv", index=False)
    pd.DataFrame({"id": ["wool", "silk"], "cloth": ["w", "s"]}).to_csv(tmp_path / "y.csv", index=False)
    signals = dataclasses.replace(LONG_TABLE, recording="id", labels="y.csv").read(tmp_path)
    assert signals.values.tolist() == [*LONG_VALUES[3:], *LONG_VALUES[:3]]
    assert signals.columns["fabric"].tolist() == ["w", "s"]
    with pytest.raises(RecordingError, match=r"data\.channels must contain at least one channel"):
        LongTable("x.csv", 1, ())


def test_channels_with_times_of_their_own_are_interpolated_where_all_have_values(tmp_path):
    LONG.assign(t=LONG.t + 500 * (LONG.taxel == "b")).to_csv(tmp_path / "x.csv", index=False)
    one_line(LONG_TABLE, tmp_path, "recording '0': .* rise by step_ms = 1 ms, got others", "x.csv")
    signals = dataclasses.replace(LONG_TABLE, resample="linear").read(tmp_path)
    assert signals.values.tolist() == [[100, 0.5], [101, 1.5], [110, 10.5], [111, 11.5]]
    assert signals.notes()[0].startswith("x.csv: 2 of 2 recordings have samples at uneven times")


def test_a_row_is_a_recording_and_numbers_order_its_samples(tmp_path):
    WIDE.to_csv(tmp_path / "x.csv", index=False)
    assert WIDE_TABLE.check(tmp_path) == []
    signals = WIDE_TABLE.read(tmp_path)
    assert signals.offsets.tolist() == [0, 4, 8] and signals.step_ms == 4
    assert signals.values.tolist() == [
        *([0, 100], [1, 101], [2, 102], [10, 110]),
        *([10, 200], [11, 201], [12, 202], [20, 210]),
    ]
    assert signals.columns["fabric"].tolist() == ["silk", "wool"]
    numbered = WIDE[["cloth", "l_0", "l_1"]].rename(columns={"l_0": "0", "l_1": "1"})
    numbered.to_parquet(tmp_path / "x.parquet")
    alone = WideTable("x.parquet", 4, ("",)).read(tmp_path)
    assert alone.values.ravel().tolist() == [0, 1, 10, 11] and alone.columns == {}
    WIDE.assign(l_10=[10.0, np.nan], r_10=[110.0, np.nan]).to_csv(tmp_path / "x.csv", index=False)
    assert WIDE_TABLE.read(tmp_path).offsets.tolist() == [0, 4, 7], "empty cells at the end"


def test_labels_of_a_wide_table_in_a_file_beside(tmp_path):
    WIDE.drop(columns="cloth").to_csv(tmp_path / "x.csv", index=False)
    WIDE[["cloth"]].to_csv(tmp_path / "labels.csv", index=False)
    source = dataclasses.replace(WIDE_TABLE, labels="labels.csv")
    assert source.check(tmp_path) == []
    assert source.read(tmp_path).columns["fabric"].tolist() == ["silk", "wool"]
    before = source.content(tmp_path)
    WIDE[["cloth"]][:1].to_csv(tmp_path / "labels.csv", index=False)
    assert source.content(tmp_path) != before
    one_line(source, tmp_path, r"'cloth'.* each of the 2 recordings", "labels.csv")
    (tmp_path / "labels.csv").write_text("fibre\na\nb\n")
    assert "labels.csv: no column 'cloth'" in source.check(tmp_path)[0]
    assert source.with_columns_found(tmp_path).columns == {}
    (tmp_path / "labels.csv").unlink()
    assert "labels.csv" in source.check(tmp_path)[0]
    assert source.with_columns_found(tmp_path).labels is None


# ---- arrays


def test_recordings_lie_end_to_end_with_named_labels(write, tmp_path):
    write("x.npz", **SERIES)
    assert TIME_SERIES.check(tmp_path) == []
    signals = TIME_SERIES.read(tmp_path)
    assert signals.values.dtype == np.float32 and signals.values.tolist() == SERIES["signal"].tolist()
    assert signals.offsets.dtype == np.int64 and signals.offsets.tolist() == [0, 4, 10]
    assert (signals.n_recordings, signals.n_channels, signals.step_ms) == (2, 2, 28.0)
    assert signals.columns["fabric"].tolist() == ["rough", "smooth"]
    assert signals.columns["force"].tolist() == [0.5, 2.0]
    cube = np.arange(24.0).reshape(2, 4, 3)
    write("x.npz", signal=cube, label=[3, 4])
    signals = TimeSeries("x.npz", step_ms=1, columns={"a": "label"}).read(tmp_path)
    assert signals.offsets.tolist() == [0, 4, 8] and np.array_equal(signals.values.reshape(2, 4, 3), cube)


def test_a_raster_becomes_sparse_and_back(write, tmp_path):
    write("x.npz", spikes=SPIKES, label=[1, 2, 3])
    assert RASTER.check(tmp_path) == []
    rasters = RASTER.read(tmp_path)
    assert np.array_equal(dense(rasters.spikes), SPIKES)
    assert rasters.spikes.row_offsets.dtype == np.int64 and rasters.spikes.channel.dtype == np.int32
    assert (rasters.spikes.step_ms, rasters.columns["letter"].tolist()) == (5.0, [1, 2, 3])
    write("x.npz", spikes=SPIKES)
    pd.DataFrame({"letter": list("abc")}).to_csv(tmp_path / "y.csv", index=False)
    beside = RasterFile("x.npz", 5, labels="y.csv", columns={"letter": "letter"})
    assert beside.check(tmp_path) == [] and beside.read(tmp_path).columns["letter"].tolist() == list("abc")
    frozen = SPIKES.copy()
    frozen.setflags(write=False)
    assert sparse(frozen, 1.0, "raster").channel.size == SPIKES.sum(), "its input is left alone"


@pytest.mark.parametrize("steps", [{"n_steps": 11}, {"shape": "shape"}])
@pytest.mark.parametrize("axes", ["sample step channel", "channel sample step", "step channel sample"])
def test_packed_rasters_in_any_order_of_axes(write, tmp_path, steps, axes):
    order = [("sample", "step", "channel").index(name) for name in axes.split()]
    raster = SPIKES.transpose(order)
    packed = np.packbits(raster, axis=axes.split().index("step"))
    write("x.npz", spikes=packed, shape=np.array(raster.shape))
    source = RasterFile("x.npz", 5, axes=axes, packed=True, **steps)
    assert np.array_equal(dense(source.read(tmp_path).spikes), SPIKES)


def test_further_axes_are_flattened_in_the_order_of_the_file(write, tmp_path):
    raster = (np.random.default_rng(6).random((2, 3, 2, 5)) < 0.5).astype(bool)
    write("x.npz", spikes=raster)
    spikes = RasterFile("x.npz", 5, axes="sample taxel polarity step").read(tmp_path).spikes
    assert np.array_equal(dense(spikes), raster.transpose(0, 3, 1, 2).reshape(2, 5, 6))


def test_events_of_taxels_and_of_pixels(write, tmp_path):
    write("x.npz", **TAXELS)
    assert EVENTS.check(tmp_path) == []
    events = EVENTS.read(tmp_path)
    assert events.t_us.dtype == np.int64 and events.t_us.tolist() == [5, 5, 9, 2, 7]
    assert (events.x.tolist(), events.y.tolist()) == ([0, 3, 1, 2, 2], [0] * 5)
    assert events.polarity.dtype == np.uint8 and events.polarity.tolist() == [1, 0, 1, 1, 0]
    assert (events.width, events.height, events.n_recordings) == (4, 1, 2)
    write("x.npz", t=TAXELS["t_us"], u=TAXELS["taxel"], v=np.array([0, 1, 2, 2, 0]), o=TAXELS["offsets"])
    source = EventFile("x.npz", 4, 3, t_us="t", x="u", y="v", offsets="o")
    events = source.read(tmp_path)
    assert events.y.tolist() == [0, 1, 2, 2, 0] and events.polarity.tolist() == [1] * 5
    with pytest.raises(RecordingError, match=r"row y must be in \[0, 1\], got 2 at event 2 of recording 0"):
        dataclasses.replace(source, height=2).read(tmp_path)


@pytest.mark.parametrize("offsets", [[0, 3, 3, 5], [0, 0, 3, 5], [0, 3, 5, 5]])
def test_a_recording_of_events_may_be_empty(write, tmp_path, offsets):
    write("x.npz", **TAXELS | {"offsets": np.array(offsets), "label": np.arange(3)})
    events = EVENTS.read(tmp_path)
    found = [[t for block in events.blocks(i) for t in block.t_us.tolist()] for i in range(3)]
    assert [x for x in found if x] == [[5, 5, 9], [2, 7]] and len(found) == 3


# ---- public recordings


def test_public_recordings(shared_data):
    fabric = TimeSeries(
        "fabric_slide/fabric_slide_train_val.npz", 28, offsets="offsets",
        columns={"fabric": "label", "velocity": "velocity_mm_s"}, class_names={"fabric": "class_names"},
    )  # fmt: skip
    assert fabric.check(shared_data) == []
    signals = fabric.read(shared_data)
    assert (signals.n_recordings, signals.values.shape) == (644, (445271, 16))
    names, counts = np.unique(signals.columns["fabric"], return_counts=True)
    assert names.tolist()[:4] == ["BeigeCotton", "BrownCotton", "Canvas", "Denim"]
    assert counts.tolist() == [120, 120, 120, 48, 48, 120, 68]
    lengths, speed = np.diff(signals.offsets), np.abs(signals.columns["velocity"])
    assert lengths.min() == 141 and np.median(lengths[speed == 10]) == pytest.approx(2116, abs=2)

    braille = RasterFile(
        "braille7_events/braille7_train_val.npz", 5, "spikes_packed", packed=True, shape="shape",
        columns={"split": "split"},
    )  # fmt: skip
    rasters = braille.read(shared_data)
    with np.load(shared_data / braille.file) as z:
        raw = np.unpackbits(z["spikes_packed"], axis=1)[:, :256]
    assert raw.shape == (920, 256, 12) and np.array_equal(dense(rasters.spikes), raw)
    assert (rasters.columns["split"] == "train").sum() == 738
    axes, file = "sample taxel polarity step", "evtouch_objects/evtouch_objects.npz"
    objects = RasterFile(file, 20, "spikes_packed", axes, True, n_steps=250).read(shared_data).spikes
    assert (objects.n_samples, objects.n_steps, objects.n_channels) == (720, 250, 78)

    touched = EventFile(
        "neutouch_objects/neutouch_objects.npz", 80, taxel="taxel", polarity="polarity",
        columns={"object": "label", "session": "session"}, class_names={"object": "class_names"},
    )  # fmt: skip
    assert touched.check(shared_data) == []
    events = touched.read(shared_data)
    assert (events.n_recordings, len(events.t_us)) == (360, 2773164)
    assert (events.columns["session"] == "class_test/trial1").sum() == 80
