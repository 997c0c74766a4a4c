"""NeuTouch text: the recorder's files against the same recordings as packed, and lines that are none."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.recordings import RecordingError
from dse.recordings.formats import Repairs, detect, neutouch
from dse.recordings.formats.neutouch import Neutouch

LINES = [
    "0 44 1606029303.0246768",
    "1 3 1606029303.024703",
    "0 0 1606029303.1",
    "0 60 1606029303.2",
    "1 79 1606029305",
]


def read(path, repair=False):
    repairs = Repairs(path.name, repair)
    blocks = list(Neutouch().blocks(path, repairs.broken))
    fields = ("t_us", "x", "y", "polarity")
    return [
        np.concatenate([getattr(block, name) for block in blocks] or [np.zeros(0)]) for name in fields
    ], repairs.notes


@pytest.mark.parametrize(("name", "n"), [("sponge", 11099), ("stiff_block", 5386)])
def test_the_recorder_s_files_are_the_packed_recordings(shared_data, name, n):
    path = shared_data / "native_event_files" / f"neutouch_{name}_trial1_5.tact"
    assert detect(path) == Neutouch() and Neutouch().frame(path) == (80, 1)
    (t_us, x, y, polarity), notes = read(path)
    assert len(t_us) == n and notes == [] and not y.any() and t_us[0] == 0
    with np.load(shared_data / "neutouch_objects" / "neutouch_objects.npz") as packed:
        one = np.flatnonzero(
            (packed["class_names"][packed["label"]] == name)
            & (packed["session"] == "class_test/trial1")
            & (packed["iteration"] == 5)
        ).item()
        part = slice(*packed["offsets"][one : one + 2])
        assert (x == packed["taxel"][part]).all() and (polarity == packed["polarity"][part]).all()
        # Both round to the microsecond, from two zeros of time.
        times = packed["t_us"][part].astype(np.int64)
        assert np.abs(t_us - (times - times[0])).max() <= 1


@pytest.mark.parametrize("end", ["\n", "\r\n", "\n\n"])
@pytest.mark.parametrize("chunk", [1, 1 << 16])
def test_by_hand(tmp_path, monkeypatch, end, chunk):
    monkeypatch.setattr(neutouch, "BLOCK_EVENTS", chunk)  # also where a line lies across two chunks
    path = tmp_path / "a.tact"
    path.write_bytes(end.join(LINES).encode())
    (t_us, x, _, polarity), notes = read(path)
    assert t_us.tolist() == [0, 26, 1975323] and x.tolist() == [44, 3, 79]
    assert polarity.tolist() == [1, 0, 0] and notes == []


@pytest.mark.parametrize(
    "line", ["2 44 1.5", "0 44", "0 -4 1.5", "0 44 nan", "0 44 1.5 7", "0,44,1.5", "\x00\xff"]
)
def test_a_line_that_is_no_event(tmp_path, line):
    path = tmp_path / "a.tact"
    path.write_text("\n".join([*LINES[:2], line, LINES[-1], line]))
    with pytest.raises(
        RecordingError, match=r"a\.tact: line 3 must be a sign \(0 or 1\), a taxel and a time, got "
    ) as e:
        read(path)
    assert "\n" not in str(e.value)
    (t_us, *_), (note,) = read(path, repair=True)
    assert len(t_us) == 3
    assert "line 3 must be" in note and note.endswith("--repair skips lines that are not events (2 in all)")


def test_a_file_without_lines_is_not_gathered_in_memory(tmp_path):
    path = tmp_path / "a.tact"
    path.write_bytes(b"7" * 20_000_000)
    tracemalloc.start()
    (t_us, *_), (note,) = read(path, repair=True)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(t_us) == 0 and "line 1 must be" in note and len(note) < 300 and peak < 10e6


def test_an_empty_file_has_no_events(tmp_path):
    path = tmp_path / "a.tact"
    path.touch()
    assert detect(path) == Neutouch()
    assert len(read(path)[0][0]) == 0


def test_other_text_is_not_taken_for_events(tmp_path):
    assert not Neutouch().matches(tmp_path / "a.txt", LINES[0].encode())
    assert not Neutouch().matches(tmp_path / "a.tact", b"1606029300 75273990 1 1 3 3 0 0 3 0 \n")


@given(at=st.integers(0, 130), junk=st.binary(min_size=1, max_size=9))
def test_damage_leaves_the_other_lines(tmp_path_factory, at, junk):
    path = tmp_path_factory.mktemp("damage") / "a.tact"
    data = "\n".join(["0 44 1606029303.0246768"] * 6).encode()
    path.write_bytes(data[:at] + junk + data[at + len(junk) :])
    (t_us, *_), notes = read(path, repair=True)
    assert len(t_us) >= 4  # junk of nine bytes reaches over two lines at most
    assert all("\n" not in note for note in notes)
