import dataclasses

import numpy as np
import pandas as pd
import pytest

from dse.recordings import RecordingError
from dse.recordings.table import Table

SAMPLES = pd.DataFrame(
    {
        "id": ["b", "b", "a", "b", "a"],
        "t": [0.0, 10.0, 0.0, 20.0, 10.0],
        "left": [1, 2, 30, 3, 40],
        "right": [0.5, 0.25, 7.0, 0.125, 8.0],
    }
)
LABELS = pd.DataFrame({"id": ["a", "b"], "cloth": ["silk", "wool"], "speed": [-5, 10]})
SOURCE = Table(
    "x.csv",
    10,
    ("left", "right"),
    "id",
    time_ms="t",
    labels="labels.csv",
    columns={"fabric": "cloth", "v": "speed"},
)


def save(folder, samples=SAMPLES, labels=LABELS):
    samples.to_csv(folder / "x.csv", index=False)
    labels.to_csv(folder / "labels.csv", index=False)


def test_a_long_table_is_grouped_by_recording(tmp_path):
    save(tmp_path)
    assert SOURCE.check(tmp_path) == []
    signals = SOURCE.read(tmp_path)
    assert signals.offsets.tolist() == [0, 2, 5]
    assert signals.values.tolist() == [[30, 7], [40, 8], [1, 0.5], [2, 0.25], [3, 0.125]]
    assert signals.columns["fabric"].tolist() == ["silk", "wool"] and signals.columns["v"].tolist() == [
        -5,
        10,
    ]
    assert signals.columns["fabric"].dtype.kind == "U"


@pytest.mark.parametrize("ending", ["parquet", "npz"])
def test_other_files_hold_the_same(tmp_path, ending):
    save(tmp_path)
    for name, table in (("x", SAMPLES), ("labels", LABELS)):
        table.to_parquet(tmp_path / f"{name}.parquet")
        np.savez(tmp_path / f"{name}.npz", **{column: table[column].tolist() for column in table})
    source = Table(f"x.{ending}", 10, ("left", "right"), "id", "t", f"labels.{ending}", SOURCE.columns)
    assert source.check(tmp_path) == []
    a, b = SOURCE.read(tmp_path), source.read(tmp_path)
    assert (a.values == b.values).all() and (a.offsets == b.offsets).all()
    assert all((a.columns[name] == b.columns[name]).all() for name in SOURCE.columns)


def test_without_labels_recordings_come_as_they_appear(tmp_path):
    save(tmp_path)
    signals = Table("x.csv", 10, ("left",), "id").read(tmp_path)
    assert signals.values.ravel().tolist() == [1, 2, 3, 30, 40] and signals.columns == {}


def _with(frame, column, row, value):
    frame = frame.copy()
    frame[column] = frame[column].astype(object)
    frame.loc[row, column] = value
    return frame


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"samples": _with(SAMPLES, "left", 3, None)}, "x.csv: column 'left' is empty or NaN in line 5"),
        ({"samples": _with(SAMPLES, "left", 3, "u")}, "x.csv: column 'left' must hold numbers, got"),
        (
            {"samples": _with(SAMPLES, "right", 4, "inf")},
            "must be finite, got inf in recording 0, sample 1, channel 1",
        ),
        ({"samples": _with(SAMPLES, "id", 1, None)}, "x.csv: 'id' is empty in line 3"),
        (
            {"samples": _with(SAMPLES, "id", 1, "c")},
            "x.csv: recording 'c' has no row in the label table labels.csv",
        ),
        ({"samples": SAMPLES[SAMPLES.id == "a"]}, "x.csv: recording 'b' has no samples"),
        ({"samples": SAMPLES[:0]}, "x.csv: the table has no rows"),
        (
            {"samples": _with(SAMPLES, "t", 0, -10)},
            "recording 'b': all channels must have times .* step_ms = 10 ms, got -10, 10 in sample 1",
        ),
        (
            {"samples": _with(SAMPLES, "t", 3, 40)},
            "by step_ms = 10 ms, got 10, 40 in sample 2",
        ),
        ({"samples": SAMPLES[::-1]}, "recording 'a': times must rise, got 10 ms and then 0 ms in sample 1"),
        ({"samples": SAMPLES.drop(columns="right")}, "x.csv: no column 'right'; known: id, t, left"),
        (
            {"labels": LABELS.rename(columns={"cloth": "cloths"})},
            "labels.csv: no column 'cloth'; .*Did you mean 'cloths'",
        ),
        ({"labels": pd.concat([LABELS, LABELS[:1]])}, "labels.csv: recording 'a' has more than one row"),
        ({"labels": _with(LABELS, "cloth", 1, None)}, "labels.csv: 'cloth' is empty in line 3"),
    ],
)
def test_each_fault_is_one_clear_line(tmp_path, tables, message):
    save(tmp_path, **tables)
    with pytest.raises(RecordingError, match=message) as error:
        SOURCE.read(tmp_path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("x.csv", b"", "x.csv: the file is empty"),
        ("x.csv", b'id,t,left,right\na,"b', "x.csv: the file cannot be read"),
        ("x.parquet", b"PAR1 and no more", "x.parquet: the file cannot be read"),
        ("x.txt", b"id", "x.txt: the file cannot be read"),
    ],
)
def test_unreadable_files(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordingError, match=message) as error:
        Table(name, 10, ("left",), "id").read(tmp_path)
    assert "\n" not in str(error.value)


def test_check_names_the_faults_of_both_tables_at_once(tmp_path):
    save(tmp_path, labels=LABELS.drop(columns=["cloth", "speed"]))
    faults = Table("x.csv", 10, ("middle",), "id", None, "labels.csv", SOURCE.columns).check(tmp_path)
    assert [x.split(";")[0] for x in faults] == [
        "x.csv: no column 'middle'", "labels.csv: no column 'cloth'", "labels.csv: no column 'speed'"
    ]  # fmt: skip
    assert "not found" in Table("y.csv", 10, ("left",)).check(tmp_path)[0]


def test_unlabelled_tables_keep_the_columns_they_have(tmp_path):
    save(tmp_path, labels=LABELS.drop(columns="cloth"))
    assert SOURCE.with_columns_found(tmp_path).columns == {"v": "speed"}
    assert SOURCE.with_columns_found(tmp_path).read(tmp_path).columns["v"].tolist() == [-5, 10]
    (tmp_path / "labels.csv").unlink()
    assert SOURCE.with_columns_found(tmp_path).read(tmp_path).columns == {}


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"channels": ()}, "data.channels must contain at least one column"),
        (
            {"channels": ("left", "cloth")},
            "must be sensor channels only, got 'cloth', which is a label column",
        ),
        ({"channels": ("t",), "time_ms": "t"}, "must be sensor channels only, got 't'"),
        ({"channels": ("left",), "time": "t", "time_ms": "t"}, "data.time and data.time_ms exclude each"),
        ({"channels": ("left",), "time_ms": None, "time_unit": "s"}, "data.time_unit needs data.time"),
        ({"channels": ("left",), "time_ms": None, "resample": "linear"}, "data.resample needs data.time"),
        ({"channels": ("left",), "recording": None, "time": "t"}, "data.labels needs data.recording"),
        (
            {"channels": ("left",), "recording": None, "labels": None, "time_ms": None},
            "data.recording must name a column where data.time does not",
        ),
    ],
)
def test_keys_that_contradict(keys, message):
    with pytest.raises(RecordingError, match=message):
        Table(**{"file": "x.csv", "step_ms": 10, "labels": "y.csv", "columns": {"fabric": "cloth"}} | keys)


def test_channels_lie_where_positions_say(tmp_path):
    source = Table("x.csv", 1.0, ("a", "b"), positions=((3, 1), (0, 2)))
    assert source.channel_positions(tmp_path).tolist() == [[3, 1, 0], [0, 2, 0]]
    assert Table("x.csv", 1.0, ("a", "b")).channel_positions(tmp_path).tolist() == [[0, 0, 0], [1, 0, 0]]
    with pytest.raises(RecordingError, match="for each of the 2 taxels, got 1"):
        Table("x.csv", 1.0, ("a", "b"), positions=((3, 1),))


TIDY = pd.DataFrame(
    {
        "seconds": [0.0, 0.01, 0.02, 0.0, 0.01],
        "left": [1.0, 2.0, 3.0, 30.0, 40.0],
        "cloth": ["wool", "wool", "wool", "silk", "silk"],
    }
)


@pytest.mark.parametrize(("unit", "scale"), [("s", 1), ("ms", 1e3), ("us", 1e6)])
@pytest.mark.parametrize("separator", [",", ";", "\t"])
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
    assert signals.notes() == [
        "x.csv: 1 of 2 recordings have samples at uneven times; they were interpolated every 10 ms "
        "(widest gap 30 ms)"
    ]
    TIDY.assign(id=list("aaabb"), seconds=[0, 0.01, 0.01, 0, 0.01]).to_csv(tmp_path / "x.csv")
    with pytest.raises(RecordingError, match="times must rise, got 10 ms and then 10 ms in sample 2"):
        dataclasses.replace(source, resample="linear").read(tmp_path)
