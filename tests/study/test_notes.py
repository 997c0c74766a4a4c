"""Notes on designs: written, replaced, removed; refused; damaged; beside a front."""

import threading

import pandas as pd
import pytest

from dse.store import Book, StoreError, write_table
from dse.study import notes


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "search_space.yaml").write_text("study: x\n")
    points = pd.DataFrame({"trial": [0, 0, 3], "point": [0, 1, 0]})
    write_table(tmp_path / "points.parquet", points)
    write_table(tmp_path / "trials.parquet", pd.DataFrame({"trial": [0, 3]}))
    Book(tmp_path, writes=True).close()
    return tmp_path


def short(folder):
    return [(note.design, note.text, note.pinned) for note in notes.of(folder)]


def test_a_note_is_written_replaced_and_removed_and_pins_come_first(folder):
    assert notes.of(folder) == []
    notes.write(folder, 0, 1, " early ", False)
    notes.write(folder, 3, None, "", True)
    notes.write(folder, 0, None, "of all points", False)
    assert short(folder) == [("3", "", True), ("0", "of all points", False), ("0.1", "early", False)]
    notes.write(folder, 0, 1, "later", False)
    notes.write(folder, 3, None, "", False)
    assert short(folder) == [("0", "of all points", False), ("0.1", "later", False)]
    rows = pd.DataFrame({"trial": [0, 0, 3], "point": [0, 1, 0]})
    assert notes.with_notes(rows, folder)["note"].tolist() == ["of all points", "later", ""]


@pytest.mark.parametrize(
    ("trial", "point", "text", "fault"),
    [
        (1, None, "x", "has no trial 1"),
        (3, 1, "x", "has no point 1 of trial 3"),
        (3, 0, "x" * 2001, "at most 2000 characters, got 2001"),
    ],
)
def test_what_cannot_be_noted_is_refused_and_nothing_is_written(folder, trial, point, text, fault):
    with pytest.raises(StoreError, match=fault):
        notes.write(folder, trial, point, text, True)
    assert notes.of(folder) == []


@pytest.mark.parametrize("text", ["", "3.", ".3", "3.1.2", "-1", "x", "3 ", "1" * 10])
def test_a_design_is_a_trial_or_a_point_of_it(text):
    assert notes.parse_design("3") == (3, None)
    assert notes.parse_design("3.12") == (3, 12)
    with pytest.raises(StoreError, match="DESIGN must be a trial such as 3"):
        notes.parse_design(text)


def test_notes_that_are_written_at_once_are_all_kept(folder):
    threads = [
        threading.Thread(target=notes.write, args=(folder, *design, "x", False))
        for design in ((0, 0), (0, 1), (3, 0), (0, None), (3, None))
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(notes.of(folder)) == 5
