"""Folders of event files: which files, which labels, one frame, every fault at once, repair with notes."""

import hashlib
import os
import pickle
import tracemalloc

import numpy as np
import pandas as pd
import pytest

from dse.config.resolved import front_end
from dse.data.recordings import RecordingError, event_files, files
from dse.data.recordings.event_files import EventFiles

LINE = "{} {} {:.6f}\n"
NAMES = ("silk/a.tact", "silk/b.tact", "wool/a.tact", "wool/c.tact")
LABELS = pd.DataFrame(
    {
        "file": ["wool/c.tact", "silk/a.tact", "./wool/a.tact", "silk/b.tact"],
        "cloth": ["wool", "silk", "wool", "silk"],
        "speed": [5, -5, 10, -10],
    }
)
BY_FOLDER = {"label_from": "folder", "columns": {"cloth": "folder"}}
BY_TABLE = {"labels": "labels.csv", "columns": {"fabric": "cloth", "v": "speed"}}


def tact(path, t_us, taxel=5):
    """Write a NeuTouch file: ON events of one taxel at the given times from its first event on."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(LINE.format(0, taxel, 1_600_000_000 + t / 1e6) for t in t_us))


def corrupt(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(LINE.format(0, 5, 1.5) + "no event\n" + LINE.format(0, 5, 1.75))


def arrays(path, n=3, **changes):
    path.parent.mkdir(parents=True, exist_ok=True)
    content = {"t": np.arange(n) * 10, "x": np.arange(n) % 4, "y": np.arange(n) % 2, "p": np.arange(n) % 2}
    np.savez(path, **content | changes)


def times(source, i):
    return np.concatenate([block.t_us for block in source.blocks(i)]).tolist()


def columns_of(found):
    return {name: values.tolist() for name, values in found.columns.items()}


def table(folder, labels, name="labels.csv"):
    labels.to_csv(folder / name, index=False) if name.endswith("csv") else labels.to_parquet(folder / name)


@pytest.fixture
def base(tmp_path):
    """A folder with `cloths`: two files of each of two classes, and a table in another order."""
    for k, name in enumerate(NAMES):
        tact(tmp_path / "cloths" / name, [0, 10 * (k + 1)], taxel=k + 1)
    table(tmp_path / "cloths", LABELS)
    return tmp_path


# ---- labels


def test_labels_from_the_folders(base):
    assert front_end(EventFiles) == "preprocessing"
    source = EventFiles("cloths", "**/*.tact", **BY_FOLDER)
    assert source.check(base) == []
    found = source.read(base)
    assert found.names == NAMES and columns_of(found) == {"cloth": ["silk", "silk", "wool", "wool"]}
    assert (found.width, found.height, found.n_recordings) == (80, 1, 4)
    assert [times(found, i) for i in (3, 0, 3)] == [[0, 40], [0, 10], [0, 40]] and found.notes() == []
    assert times(pickle.loads(pickle.dumps(found)), 3) == [0, 40], "it goes to another process"
    (base / "cloths" / "silk" / "b.tact").unlink()
    with pytest.raises(RecordingError, match=r"silk/b\.tact: cannot be read: No such file"):
        times(found, 1)


@pytest.mark.parametrize("name", ["labels.csv", "labels.parquet"])
@pytest.mark.parametrize("inside", [True, False])
def test_labels_from_a_table_in_its_order(base, name, inside):
    (base / "cloths" / "labels.csv").unlink()
    table(base / "cloths" if inside else base, LABELS, name)
    source = EventFiles("cloths", **BY_TABLE | {"labels": name})
    assert source.check(base) == []
    found = source.read(base)
    assert found.names == ("wool/c.tact", "silk/a.tact", "wool/a.tact", "silk/b.tact")
    assert columns_of(found) == {"fabric": ["wool", "silk", "wool", "silk"], "v": [5, -5, 10, -10]}
    assert times(found, 0) == [0, 40]


def test_folders_above(tmp_path):
    for part, digit in (("train", "3"), ("train", "7"), ("test", "3")):
        tact(tmp_path / "digits" / part / digit / "x.tact", [0])
    source = EventFiles("digits", label_from="folder", columns={"digit": "folder", "part": "folder2"})
    found = {"digit": ["3", "3", "7"], "part": ["test", "train", "train"]}
    assert columns_of(source.read(tmp_path)) == found
    tact(tmp_path / "digits" / "train" / "shallow.tact", [0])
    (fault,) = source.check(tmp_path)
    assert fault == (
        "data.columns: every file must lie in a folder 'folder2', but 'train/shallow.tact' does not; "
        "known: folder. Did you mean 'folder'?"
    )


def _edited(column, row, value):
    frame = LABELS.copy()
    frame[column] = frame[column].astype(object)
    frame.loc[row, column] = value
    return frame


MORE = pd.DataFrame({"file": ["x y.tact"], "cloth": ["silk"], "speed": [1]})


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        (LABELS[1:], "must have a row for every file, but there is none for 'wool/c.tact'"),
        (pd.concat([LABELS, MORE]), "must have a file for every row, but there is none for 'x y.tact'"),
        (pd.concat([LABELS, LABELS[:1].assign(file="wool//c.tact")]), "one row per file, got several for"),
        (_edited("cloth", 1, None), "'cloth' is empty in line 3"),
        (_edited("file", 2, None), "'file' is empty in line 4"),
        (LABELS.rename(columns={"cloth": "cloths"}), "known: file, cloths, speed. Did you mean 'cloths'?"),
        (LABELS.rename(columns={"file": "path"}), "no column 'file'; known: path, cloth, speed"),
    ],
)
def test_each_fault_of_a_label_table(base, labels, message):
    table(base / "cloths", labels)
    for repair in (False, True):
        source = EventFiles("cloths", **BY_TABLE, repair=repair)
        (fault,) = source.check(base)
        assert fault.startswith("labels.csv: ") and message in fault
        with pytest.raises(RecordingError) as error:
            source.read(base)
        assert str(error.value) == fault


def test_all_faults_at_once(base):
    table(base / "cloths", _edited("cloth", 0, None)[:3].assign(speed=[1, 2, np.nan]))
    (base / "cloths" / "silk" / "notes.txt").write_text("not a recording")
    columns = {"c": "cloth", "s": "speed", "h": "heat"}
    faults = EventFiles("cloths", labels="labels.csv", columns=columns, width=9, height=1).check(base)
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
def test_what_is_not_there(base, keys, message):
    source = EventFiles(**{"folder": "cloths", "pattern": "**/*.tact"} | keys)
    assert source.check(base)
    with pytest.raises(RecordingError, match=message) as error:
        source.read(base)
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


def test_unlabelled_recordings_keep_the_columns_they_have(base):
    source = EventFiles("cloths", labels="labels.csv", columns={"fabric": "cloth", "heat": "heat"})
    assert source.with_columns_found(base).columns == {"fabric": "cloth"}
    tact(base / "new" / "n.tact", [0])
    table(base, LABELS)  # found beside the file, but of other recordings
    for keys in ({"labels": "labels.csv", "columns": {"fabric": "cloth"}}, BY_FOLDER):
        new = EventFiles("new", **keys).with_columns_found(base)
        assert new.columns == {} and new.read(base).n_recordings == 1
    assert EventFiles("nowhere", labels="x.csv", columns={"a": "b"}).with_columns_found(base).columns == {}


# ---- the frame


def test_the_frame_is_that_of_the_files_or_given(tmp_path):
    arrays(tmp_path / "f" / "a.npz", stamp=np.array([0.001, 0.002, 0.003]))
    (fault,) = EventFiles("f").check(tmp_path)
    assert fault == "data.width and data.height must be given: a.npz does not state its frame"
    keys = {"width": 4, "height": 2}
    found = EventFiles("f", **keys).read(tmp_path)
    assert (found.width, found.height) == (4, 2) and times(found, 0) == [0, 10, 20]
    keys |= {"arrays": {"t": "stamp"}, "time_unit": "s"}
    assert times(EventFiles("f", **keys).read(tmp_path), 0) == [1000, 2000, 3000]
    assert EventFiles("f", **keys | {"arrays": {"t": "stamps"}}).check(tmp_path) == [
        "a.npz: no array 'stamps'; known: t, x, y, p, stamp. Did you mean 'stamp'?; --repair skips the file"
    ]
    tact(tmp_path / "f" / "b.tact", [0])
    (fault,) = EventFiles("f", width=4, height=2).check(tmp_path)
    assert fault.startswith("b.tact: data.width and data.height must be 80 x 1")


def test_files_of_two_frames(tmp_path, shared_data):
    (tmp_path / "f").mkdir()
    tact(tmp_path / "f" / "a.tact", [0])
    matrix = "tonic_sample_stmnist.mat"
    (tmp_path / "f" / matrix).symlink_to(shared_data / "native_event_files" / matrix)
    (fault,) = EventFiles("f").check(tmp_path)
    assert fault == f"f: all files must have the same frame, got 80 x 1 in a.tact and 10 x 10 in {matrix}"


# ---- damage


def test_one_corrupt_file_among_good_ones(base):
    corrupt(base / "cloths" / "silk" / "b.tact")
    source = EventFiles("cloths", "**/*.tact", **BY_FOLDER)
    assert source.check(base) == []  # headers do not show it
    found = source.read(base)
    assert times(found, 0) == [0, 10]
    with pytest.raises(
        RecordingError, match=r"silk/b\.tact: line 2 must be .* got 'no event'; --repair skips"
    ):
        times(found, 1)
    mended = EventFiles("cloths", "**/*.tact", repair=True).read(base)
    assert mended.notes() == []
    assert [times(mended, i) for i in range(4)] == [[0, 10], [0, 250000], [0, 30], [0, 40]]
    (note,) = mended.notes()
    assert note.startswith("silk/b.tact: line 2 must be") and "skips lines that are not events" in note
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


def test_files_that_hold_nothing_are_left_out_with_repair(base):
    (base / "cloths" / "silk" / "b.tact").write_bytes(b"")
    (base / "cloths" / "wool" / "a.tact").write_text("nothing\n" * 3)
    found = EventFiles("cloths", **BY_TABLE, repair=True).read(base)
    assert found.names == ("wool/c.tact", "silk/a.tact"), "rows of what remains"
    assert columns_of(found) == {"fabric": ["wool", "silk"], "v": [5, -5]}
    (base / "cloths" / "wool" / "README.txt").write_text("about")
    (fault,) = EventFiles("cloths", "*/*", **BY_FOLDER).check(base)
    assert fault.startswith("wool/README.txt: has no known format") and "--repair skips the file" in fault
    plain = EventFiles("cloths", "**/*.tact", **BY_FOLDER).read(base)
    with pytest.raises(RecordingError, match=r"silk/b\.tact: must have events, got none"):
        times(plain, 1)
    mended = EventFiles("cloths", "*/*", repair=True, **BY_FOLDER)
    assert mended.check(base) == []
    found = mended.read(base)
    assert found.names == ("silk/a.tact", "wool/c.tact") and columns_of(found) == {"cloth": ["silk", "wool"]}
    for name, note in zip(["wool/README.txt", "silk/b.tact", "wool/a.tact"], found.notes(), strict=True):
        assert note.startswith(f"{name}: ") and note.endswith("; --repair skips the file")


def test_repair_cannot_make_something_of_nothing_and_sums_up(tmp_path, monkeypatch):
    tact(tmp_path / "f" / "a.tact", [])
    with pytest.raises(
        RecordingError, match=r"f: no file is usable; the first fault: a\.tact: must have eve"
    ):
        EventFiles("f", repair=True).read(tmp_path)
    for k in range(9):
        (tmp_path / "f" / f"{k}.txt").write_text("about")
    faults = EventFiles("f", "*.txt", repair=True).check(tmp_path)
    assert len(faults) == 6 and faults[-1] == "f: 4 more files of the same kind"
    monkeypatch.setattr(event_files, "_MOST_NOTES", 3)
    for k in range(7):
        corrupt(tmp_path / "g" / f"{k}.tact")
    found = EventFiles("g", repair=True).read(tmp_path)
    for i in range(7):
        times(found, i)
    assert len(found.notes()) == 4 and found.notes()[-1] == "g: 4 more repairs"


# ---- which files


def test_names_with_anything_in_them(tmp_path):
    names = ["Stoff für Möbel/a b.tact", "naïve/ナイロン.tact", "x;y/--set.tact", "[a]/*.tact"]
    for name in names:
        tact(tmp_path / "f" / name, [0, 5])
    frame = pd.DataFrame({"file": names, "cloth": ["Möbel", "ナイロン", "x", "a,b"]})
    frame.to_csv(tmp_path / "labels.csv", index=False)
    found = EventFiles("f", labels="labels.csv", columns={"cloth": "cloth"}).read(tmp_path)
    assert list(found.names) == names and columns_of(found) == {"cloth": ["Möbel", "ナイロン", "x", "a,b"]}
    assert [times(found, i) for i in range(4)] == [[0, 5]] * 4


def test_hidden_files_loops_and_what_is_no_file_are_ignored(tmp_path):
    folder = tmp_path / "f"
    for name in ("f/a/x.tact", "f/.cache/x.tact", "f/a/.x.tact", "elsewhere/y.tact"):
        tact(tmp_path / name, [0])
    os.mkfifo(folder / "a" / "pipe.tact")
    for name, target in {
        "a/loop": folder,
        "self": folder / "self",
        "a/link.tact": folder / "a" / "pipe.tact",
        "a/zero.tact": "/dev/zero",
        "linked": tmp_path / "elsewhere",
    }.items():
        (folder / name).symlink_to(target)
    assert files.files_below(folder, "**/*.tact") == ["a/x.tact", "linked/y.tact"]
    assert EventFiles("f", "**/*.tact").read(tmp_path).names == ("a/x.tact", "linked/y.tact")
    assert EventFiles("f").check(tmp_path)[0].startswith("self: cannot be read:")


def test_patterns(tmp_path):
    everything = ["a.tact", "p/a.tact", "p/q/B.tact"]
    for name in everything:
        tact(tmp_path / name, [0])
    for pattern, wanted in {
        "**/*": everything,
        "*": ["a.tact"],
        "*/*": ["p/a.tact"],
        "**/a.tact": ["a.tact", "p/a.tact"],
        "p/**/*.tact": ["p/a.tact", "p/q/B.tact"],
        "**/q/?.tact": ["p/q/B.tact"],
        "**/[A-Z].tact": ["p/q/B.tact"],
        "**": everything,
        "p": [],
        "a.tact": ["a.tact"],
    }.items():
        assert files.files_below(tmp_path, pattern) == wanted, pattern


def test_the_content_says_all_that_counts(base, tmp_path, monkeypatch):
    first = EventFiles("cloths", **BY_TABLE).content(base)
    with monkeypatch.context() as patched:
        patched.setattr(hashlib, "file_digest", lambda *_: pytest.fail("unchanged files are read again"))
        assert EventFiles("cloths", **BY_TABLE).content(base) == first
    folder = (base / "cloths").rename(tmp_path / "moved")
    moved = EventFiles("moved", **BY_TABLE)
    seen = {moved.content(tmp_path)}
    assert seen == {first}, "where it lies does not count"
    table(folder, LABELS.assign(speed=1))
    seen.add(moved.content(tmp_path))
    tact(folder / "silk" / "a.tact", [0, 11])
    seen.add(moved.content(tmp_path))
    (folder / "silk" / "a.tact").rename(folder / "silk" / "d.tact")
    seen.add(moved.content(tmp_path))
    assert len(seen) == 4


def test_a_thousand_files(tmp_path):
    for k in range(1000):
        tact(tmp_path / "f" / str(k % 10) / f"{k:03}.tact", [0, k + 1])
    source = EventFiles("f", label_from="folder", columns={"digit": "folder"}, format="neutouch")
    assert source.check(tmp_path) == []
    assert list(source.read(tmp_path).blocks(0))  # modules are imported before memory is counted
    tracemalloc.start()
    found = source.read(tmp_path)
    n = sum(len(block.t_us) for i in range(found.n_recordings) for block in found.blocks(i))
    kept, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert n == 2000 and found.columns["digit"].tolist() == [str(k // 100) for k in range(1000)]
    assert kept < 2e6 and peak < 8e6
