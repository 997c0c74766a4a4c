"""Folders of event files: which files, which labels, one frame, every fault at once, repair with notes."""

import hashlib
import os
import pickle
import tracemalloc

import numpy as np
import pandas as pd
import pytest

from dse.config.sections import front_end
from dse.recordings import RecordingError, event_files, files
from dse.recordings.event_files import EventFiles

LINE = "{} {} {:.6f}\n"


def tact(path, t_us, taxel=5):
    """Write a NeuTouch file: ON events of one taxel at the given times from its first event on."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(LINE.format(0, taxel, 1_600_000_000 + t / 1e6) for t in t_us))


def corrupt(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(LINE.format(0, 5, 1.5) + "no event\n" + LINE.format(0, 5, 1.75))


def times(source, i):
    return np.concatenate([block.t_us for block in source.blocks(i)]).tolist()


@pytest.fixture
def cloths(tmp_path):
    """Two classes with two files each, and a table that names them in another order."""
    folder = tmp_path / "cloths"
    for k, name in enumerate(["silk/a.tact", "silk/b.tact", "wool/a.tact", "wool/c.tact"]):
        tact(folder / name, [0, 10 * (k + 1)], taxel=k + 1)
    table(folder, LABELS)
    return folder


LABELS = pd.DataFrame(
    {
        "file": ["wool/c.tact", "silk/a.tact", "./wool/a.tact", "silk/b.tact"],
        "cloth": ["wool", "silk", "wool", "silk"],
        "speed": [5, -5, 10, -10],
    }
)


def table(folder, labels, name="labels.csv"):
    labels.to_csv(folder / name, index=False) if name.endswith("csv") else labels.to_parquet(folder / name)


def test_it_is_a_source_of_events():
    assert front_end(EventFiles) == "preprocessing"


def test_labels_from_the_folders(cloths):
    source = EventFiles("cloths", "**/*.tact", label_from="folder", columns={"cloth": "folder"})
    assert source.check(cloths.parent) == []
    found = source.read(cloths.parent)
    assert found.names == ("silk/a.tact", "silk/b.tact", "wool/a.tact", "wool/c.tact")
    assert found.columns["cloth"].tolist() == ["silk", "silk", "wool", "wool"]
    assert (found.width, found.height, found.n_recordings) == (80, 1, 4)
    assert [times(found, i) for i in (3, 0, 3)] == [[0, 40], [0, 10], [0, 40]]
    assert found.notes() == []


@pytest.mark.parametrize("name", ["labels.csv", "labels.parquet"])
@pytest.mark.parametrize("inside", [True, False])
def test_labels_from_a_table_in_its_order(cloths, name, inside):
    (cloths / "labels.csv").unlink()
    table(cloths if inside else cloths.parent, LABELS, name)
    source = EventFiles("cloths", labels=name, columns={"fabric": "cloth", "v": "speed"})
    assert source.check(cloths.parent) == []
    found = source.read(cloths.parent)
    assert found.names == ("wool/c.tact", "silk/a.tact", "wool/a.tact", "silk/b.tact")
    assert found.columns["fabric"].tolist() == ["wool", "silk", "wool", "silk"]
    assert found.columns["v"].tolist() == [5, -5, 10, -10]
    assert times(found, 0) == [0, 40]


def test_folders_above(tmp_path):
    for part, digit in (("train", "3"), ("train", "7"), ("test", "3")):
        tact(tmp_path / "digits" / part / digit / "x.tact", [0])
    source = EventFiles("digits", label_from="folder", columns={"digit": "folder", "part": "folder2"})
    found = source.read(tmp_path)
    assert found.columns["digit"].tolist() == ["3", "3", "7"]
    assert found.columns["part"].tolist() == ["test", "train", "train"]
    tact(tmp_path / "digits" / "train" / "shallow.tact", [0])
    (fault,) = source.check(tmp_path)
    assert fault == (
        "data.columns: every file must lie in a folder 'folder2', but 'train/shallow.tact' does not; "
        "known: folder. Did you mean 'folder'?"
    )


def test_published_recordings(shared_data, monkeypatch):
    monkeypatch.setenv("DSE_DATA", str(shared_data))
    source = EventFiles("native_event_files", "*.tact")
    assert source.check(shared_data / "nowhere") == []
    found = source.read(shared_data / "nowhere")
    assert [len(times(found, i)) for i in range(2)] == [11099, 5386]
    matrix = EventFiles("native_event_files", "*.mat").read(shared_data)
    assert (matrix.width, matrix.height) == (10, 10) and len(times(matrix, 0)) == 2346


def _edited(column, row, value):
    frame = LABELS.copy()
    frame[column] = frame[column].astype(object)
    frame.loc[row, column] = value
    return frame


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        (LABELS[1:], "labels.csv: must have a row for every file, but there is none for 'wool/c.tact'"),
        (
            pd.concat([LABELS, pd.DataFrame({"file": ["x y.tact"], "cloth": ["silk"], "speed": [1]})]),
            "labels.csv: must have a file for every row, but there is none for 'x y.tact'",
        ),
        (
            pd.concat([LABELS, LABELS[:1].assign(file="wool//c.tact")]),
            "labels.csv: must have one row per file, got several for 'wool/c.tact'",
        ),
        (_edited("cloth", 1, None), "labels.csv: 'cloth' is empty in line 3"),
        (_edited("file", 2, None), "labels.csv: 'file' is empty in line 4"),
        (
            LABELS.rename(columns={"cloth": "cloths"}),
            "labels.csv: no column 'cloth'; known: file, cloths, speed. Did you mean 'cloths'?",
        ),
        (
            LABELS.rename(columns={"file": "path"}),
            "labels.csv: no column 'file'; known: path, cloth, speed",
        ),
    ],
)
def test_each_fault_of_a_label_table(cloths, labels, message):
    table(cloths, labels)
    source = EventFiles("cloths", labels="labels.csv", columns={"fabric": "cloth", "v": "speed"})
    for one in (source, EventFiles(**{**vars(source), "repair": True})):
        assert one.check(cloths.parent) == [message]
        with pytest.raises(RecordingError) as error:
            one.read(cloths.parent)
        assert str(error.value) == message


def test_all_faults_at_once(cloths):
    table(cloths, _edited("cloth", 0, None)[:3].assign(speed=[1, 2, np.nan]))
    (cloths / "silk" / "notes.txt").write_text("not a recording")
    source = EventFiles(
        "cloths", labels="labels.csv", columns={"c": "cloth", "s": "speed", "h": "heat"}, width=9, height=1
    )
    faults = source.check(cloths.parent)
    for part in (
        "no column 'heat'",
        "'cloth' is empty in line 2",
        "'speed' is empty in line 4",
        "a row for every file, but there is none for 'silk/b.tact', 'silk/notes.txt'",
        "silk/notes.txt: has no known format",
        "silk/a.tact: data.width and data.height must be 80 x 1 as in the file, got 9 x 1",
    ):
        assert len([fault for fault in faults if part in fault]) == 1, part
    assert len(faults) == 6 and all("\n" not in fault for fault in faults)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"folder": "nowhere"}, "data folder 'nowhere' not found; looked in .*DSE_DATA sets another folder"),
        ({"folder": "/nowhere"}, "data folder '/nowhere' not found; looked in /$"),
        ({"pattern": "*.bin"}, r"cloths: no file in it matches the pattern '\*\.bin'"),
        ({"labels": "none.csv"}, "data file 'none.csv' not found"),
        ({"format": "aedat4"}, r"silk/a\.tact: .*--repair skips the file"),
    ],
)
def test_what_is_not_there(cloths, keys, message):
    source = EventFiles(**{"folder": "cloths", "pattern": "**/*.tact"} | keys)
    assert source.check(cloths.parent)
    with pytest.raises(RecordingError, match=message) as error:
        source.read(cloths.parent)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"labels": "a.csv", "label_from": "folder"}, "data.labels and data.label_from exclude each other"),
        ({"columns": {"a": "b"}}, "data.columns must come from data.labels or data.label_from, got neither"),
        ({"width": 3}, "data.width and data.height must be given together"),
        ({"format": "evt4"}, "format must be one of .*evt3.*, got 'evt4'"),
        ({"arrays": {"time": "t"}}, "data.arrays must have keys of t, x, y and p, got 'time'"),
    ],
)
def test_keys_that_contradict(keys, message):
    with pytest.raises(RecordingError, match=message):
        EventFiles("x", **keys)


def arrays(path, n=3, **changes):
    path.parent.mkdir(parents=True, exist_ok=True)
    content = {"t": np.arange(n) * 10, "x": np.arange(n) % 4, "y": np.arange(n) % 2, "p": np.arange(n) % 2}
    np.savez(path, **content | changes)


def test_the_frame_is_that_of_the_files_or_given(tmp_path):
    arrays(tmp_path / "f" / "a.npz")
    (fault,) = EventFiles("f").check(tmp_path)
    assert fault == "data.width and data.height must be given: a.npz does not state its frame"
    found = EventFiles("f", width=4, height=2).read(tmp_path)
    assert (found.width, found.height) == (4, 2) and times(found, 0) == [0, 10, 20]
    tact(tmp_path / "f" / "b.tact", [0])
    (fault,) = EventFiles("f", width=4, height=2).check(tmp_path)
    assert fault.startswith("b.tact: data.width and data.height must be 80 x 1")


def test_files_of_two_frames(tmp_path, shared_data):
    native = shared_data / "native_event_files"
    (tmp_path / "f").mkdir()
    for name in ("neutouch_sponge_trial1_5.tact", "tonic_sample_stmnist.mat"):
        (tmp_path / "f" / name).symlink_to(native / name)
    (fault,) = EventFiles("f").check(tmp_path)
    assert fault == (
        "f: all files must have the same frame, got 80 x 1 in neutouch_sponge_trial1_5.tact and 10 x 10 in "
        "tonic_sample_stmnist.mat"
    )


def test_arrays_with_names_and_units_of_their_own(tmp_path):
    arrays(tmp_path / "f" / "a.npz", stamp=np.array([0.001, 0.002, 0.003]))
    keys = {"width": 4, "height": 2, "arrays": {"t": "stamp"}, "time_unit": "s"}
    assert times(EventFiles("f", **keys).read(tmp_path), 0) == [1000, 2000, 3000]
    assert EventFiles("f", **keys | {"arrays": {"t": "stamps"}}).check(tmp_path) == [
        "a.npz: no array 'stamps'; known: t, x, y, p, stamp. Did you mean 'stamp'?; --repair skips the file"
    ]


def test_one_corrupt_file_among_good_ones(cloths):
    corrupt(cloths / "silk" / "b.tact")
    source = EventFiles("cloths", "**/*.tact", label_from="folder", columns={"cloth": "folder"})
    assert source.check(cloths.parent) == []  # headers do not show it
    found = source.read(cloths.parent)
    assert times(found, 0) == [0, 10]
    with pytest.raises(
        RecordingError, match=r"silk/b\.tact: line 2 must be .* got 'no event'; --repair skips"
    ):
        times(found, 1)
    mended = EventFiles("cloths", "**/*.tact", repair=True).read(cloths.parent)
    assert mended.notes() == []
    assert [times(mended, i) for i in range(4)] == [[0, 10], [0, 250000], [0, 30], [0, 40]]
    (note,) = mended.notes()
    assert (
        note.startswith("silk/b.tact: line 2 must be") and "--repair skips lines that are not events" in note
    )
    times(mended, 1)
    assert mended.notes() == [note]  # reading again is not another repair


def test_a_reader_that_stops_early_does_not_hide_what_was_repaired(tmp_path):
    tact(tmp_path / "f" / "a.tact", range(70_000))
    with (tmp_path / "f" / "a.tact").open("a") as file:
        file.write("no event\n")
    found = EventFiles("f", repair=True).read(tmp_path)
    assert len(times(found, 0)) == 70_000 and len(found.notes()) == 1
    blocks = found.blocks(0)
    next(blocks)
    blocks.close()
    assert len(found.notes()) == 1


def test_files_that_hold_nothing_are_left_out_with_repair(cloths):
    (cloths / "silk" / "b.tact").write_bytes(b"")
    (cloths / "wool" / "a.tact").write_text("nothing\n" * 3)
    (cloths / "wool" / "README.txt").write_text("about")
    keys = {"label_from": "folder", "columns": {"cloth": "folder"}}
    source = EventFiles("cloths", "*/*", **keys)
    (fault,) = source.check(cloths.parent)
    assert fault.startswith("wool/README.txt: has no known format") and fault.endswith(
        "--repair skips the file"
    )
    plain = EventFiles("cloths", "**/*.tact", **keys).read(cloths.parent)
    with pytest.raises(RecordingError, match=r"silk/b\.tact: must have events, got none"):
        times(plain, 1)
    mended = EventFiles("cloths", "*/*", repair=True, **keys)
    assert mended.check(cloths.parent) == []
    found = mended.read(cloths.parent)
    assert found.names == ("silk/a.tact", "wool/c.tact") and found.columns["cloth"].tolist() == [
        "silk",
        "wool",
    ]
    assert len(found.notes()) == 3
    for name, note in zip(["wool/README.txt", "silk/b.tact", "wool/a.tact"], found.notes(), strict=True):
        assert note.startswith(f"{name}: ") and note.endswith("; --repair skips the file")


def test_repair_keeps_the_rows_of_what_remains(cloths):
    (cloths / "silk" / "a.tact").write_bytes(b"")
    found = EventFiles("cloths", labels="labels.csv", columns={"v": "speed"}, repair=True).read(cloths.parent)
    assert found.names == ("wool/c.tact", "wool/a.tact", "silk/b.tact")
    assert found.columns["v"].tolist() == [5, 10, -10]


def test_repair_cannot_make_something_of_nothing(tmp_path):
    for name in ("a.tact", "b.tact"):
        tact(tmp_path / "f" / name, [])
    with pytest.raises(
        RecordingError, match=r"f: no file is usable; the first fault: a\.tact: must have events"
    ):
        EventFiles("f", repair=True).read(tmp_path)
    for k in range(9):
        (tmp_path / "f" / f"{k}.txt").write_text("about")
    faults = EventFiles("f", "*.txt", repair=True).check(tmp_path)
    assert len(faults) == 6 and faults[-1] == "f: 4 more files of the same kind"


def test_many_repairs_are_summed_up(tmp_path, monkeypatch):
    monkeypatch.setattr(event_files, "_MOST_NOTES", 3)
    for k in range(7):
        corrupt(tmp_path / "f" / f"{k}.tact")
    found = EventFiles("f", repair=True).read(tmp_path)
    for i in range(7):
        times(found, i)
    assert len(found.notes()) == 4 and found.notes()[-1] == "f: 4 more repairs"


def test_a_file_that_vanishes_is_named(cloths):
    found = EventFiles("cloths", "**/*.tact").read(cloths.parent)
    (cloths / "silk" / "b.tact").unlink()
    with pytest.raises(RecordingError, match=r"silk/b\.tact: cannot be read: No such file"):
        times(found, 1)


def test_names_with_anything_in_them(tmp_path):
    names = ["Stoff für Möbel/a b.tact", "naïve/ナイロン.tact", "x;y/--set.tact", "[a]/*.tact"]
    for name in names:
        tact(tmp_path / "f" / name, [0, 5])
    frame = pd.DataFrame({"file": names, "cloth": ["Möbel", "ナイロン", "x", "a,b"]})
    frame.to_csv(tmp_path / "labels.csv", index=False)
    found = EventFiles("f", labels="labels.csv", columns={"cloth": "cloth"}).read(tmp_path)
    assert list(found.names) == names and found.columns["cloth"].tolist() == ["Möbel", "ナイロン", "x", "a,b"]
    assert [times(found, i) for i in range(4)] == [[0, 5]] * 4


def test_hidden_files_loops_and_what_is_no_file_are_ignored(tmp_path):
    tact(tmp_path / "f" / "a" / "x.tact", [0])
    tact(tmp_path / "f" / ".cache" / "x.tact", [0])
    tact(tmp_path / "f" / "a" / ".x.tact", [0])
    (tmp_path / "f" / "a" / "loop").symlink_to(tmp_path / "f")
    (tmp_path / "f" / "self").symlink_to(tmp_path / "f" / "self")
    os.mkfifo(tmp_path / "f" / "a" / "pipe.tact")
    (tmp_path / "f" / "a" / "link.tact").symlink_to(tmp_path / "f" / "a" / "pipe.tact")
    (tmp_path / "f" / "a" / "zero.tact").symlink_to("/dev/zero")
    tact(tmp_path / "elsewhere" / "y.tact", [0])
    (tmp_path / "f" / "linked").symlink_to(tmp_path / "elsewhere")
    assert files.files_below(tmp_path / "f", "**/*.tact") == ["a/x.tact", "linked/y.tact"]
    assert EventFiles("f", "**/*.tact").read(tmp_path).names == ("a/x.tact", "linked/y.tact")
    assert EventFiles("f").check(tmp_path)[0].startswith("self: cannot be read:")


@pytest.mark.parametrize(
    ("pattern", "wanted"),
    [
        ("**/*", ["a.tact", "p/a.tact", "p/q/B.tact"]),
        ("*", ["a.tact"]),
        ("*/*", ["p/a.tact"]),
        ("**/a.tact", ["a.tact", "p/a.tact"]),
        ("p/**/*.tact", ["p/a.tact", "p/q/B.tact"]),
        ("**/q/?.tact", ["p/q/B.tact"]),
        ("**/[A-Z].tact", ["p/q/B.tact"]),
        ("**", ["a.tact", "p/a.tact", "p/q/B.tact"]),
        ("p", []),
        ("a.tact", ["a.tact"]),
    ],
)
def test_patterns(tmp_path, pattern, wanted):
    for name in ("a.tact", "p/a.tact", "p/q/B.tact"):
        tact(tmp_path / name, [0])
    assert files.files_below(tmp_path, pattern) == wanted


def test_the_content_says_all_that_counts(cloths, tmp_path):
    source = EventFiles("cloths", labels="labels.csv", columns={"v": "speed"})
    first = source.content(cloths.parent)
    assert source.content(cloths.parent) == first
    cloths.rename(tmp_path / "moved")
    moved = EventFiles("moved", labels="labels.csv", columns={"v": "speed"})
    assert moved.content(tmp_path) == first  # where it lies does not count
    seen = {first}
    table(tmp_path / "moved", LABELS.assign(speed=1))
    seen.add(moved.content(tmp_path))
    tact(tmp_path / "moved" / "silk" / "a.tact", [0, 11])
    seen.add(moved.content(tmp_path))
    (tmp_path / "moved" / "silk" / "a.tact").rename(tmp_path / "moved" / "silk" / "d.tact")
    seen.add(moved.content(tmp_path))
    assert len(seen) == 4


def test_unchanged_files_are_not_hashed_again(cloths, monkeypatch):
    source = EventFiles("cloths", "**/*.tact")
    first = source.content(cloths.parent)
    monkeypatch.setattr(hashlib, "file_digest", lambda *_: pytest.fail("read again"))
    assert source.content(cloths.parent) == first


def test_unlabelled_recordings_keep_the_columns_they_have(cloths, tmp_path):
    base = cloths.parent
    source = EventFiles("cloths", labels="labels.csv", columns={"fabric": "cloth", "heat": "heat"})
    assert source.with_columns_found(base).columns == {"fabric": "cloth"}
    tact(tmp_path / "new" / "n.tact", [0])
    table(tmp_path, LABELS)  # found beside the file, but of other recordings
    new = EventFiles("new", labels="labels.csv", columns={"fabric": "cloth"}).with_columns_found(base)
    assert new.columns == {} and new.read(base).n_recordings == 1
    flat = EventFiles("new", label_from="folder", columns={"fabric": "folder"}).with_columns_found(base)
    assert flat.columns == {} and flat.read(base).columns == {}
    assert EventFiles("nowhere", labels="x.csv", columns={"a": "b"}).with_columns_found(base).columns == {}


def test_it_goes_to_another_process(cloths):
    found = pickle.loads(pickle.dumps(EventFiles("cloths", "**/*.tact").read(cloths.parent)))
    assert times(found, 3) == [0, 40]


def test_a_thousand_files(tmp_path):
    for k in range(1000):
        tact(tmp_path / "f" / str(k % 10) / f"{k:03}.tact", [0, k + 1])
    source = EventFiles("f", label_from="folder", columns={"digit": "folder"}, format="neutouch")
    assert source.check(tmp_path) == []
    tracemalloc.start()
    found = source.read(tmp_path)
    n = sum(len(block.t_us) for i in range(found.n_recordings) for block in found.blocks(i))
    kept, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert n == 2000 and found.columns["digit"].tolist() == [str(k // 100) for k in range(1000)]
    assert kept < 2e6 and peak < 8e6
