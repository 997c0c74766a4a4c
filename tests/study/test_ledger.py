"""The designs of a study in its book: what was asked and told, and what a damaged book still holds."""

import random

import pytest

from dse import store
from dse.base.seeds import design_key
from dse.config import load_space
from dse.search.limits import Exclusion
from dse.search.space import design_at
from dse.store import BOOK, Book
from dse.study.ledger import Ledger, read_entries
from dse.study.mended import fault, opened
from tests import families
from tests.spaces import write_space

DESIGNS = [
    {"model.hidden": n, "model.true_rate": 0.2, "task.target": t} for n, t in ((4, "fabric"), (8, ["a", "b"]))
]
EXPECTED = [
    (0, 0, DESIGNS[0], True, (0.5, 100.0, 1.5)),
    (1, 0, DESIGNS[1], True, None),
    (2, 1, DESIGNS[0], False, None),
]


@pytest.fixture
def folder(tmp_path):
    with Book(tmp_path, writes=True) as book:
        ledger = Ledger(book)
        ledger.ask(0, DESIGNS)
        ledger.tell(0, (0.5, 100.0, 1.5))
        ledger.tell(1, None)
        ledger.ask(1, DESIGNS[:1])
        assert without_times(ledger.entries) == EXPECTED
        assert [entry.trial for entry in ledger.batch(0)] == [0, 1]
        assert ledger.entries == read_entries(tmp_path)
    return tmp_path


def without_times(entries):
    return [(entry.trial, entry.batch, entry.design, entry.is_reported, entry.values) for entry in entries]


def test_what_was_asked_and_told_is_there_after_a_restart(folder):
    entries = read_entries(folder)
    assert without_times(entries) == EXPECTED
    assert all(entry.reported_s is None or entry.proposed_s <= entry.reported_s for entry in entries)


def test_an_excluded_design_says_why(folder):
    with Book(folder, writes=True) as book:
        ledger = Ledger(book)
        ledger.exclude(1, DESIGNS[1], Exclusion("too dear", ()))
        ledger.exclude_proposed(2, Exclusion("too slow", ()))
    _, _, slow, dear = read_entries(folder)
    assert (slow.excluded, dear.excluded) == ("too slow", "too dear")
    assert slow.is_reported and dear.is_reported


def test_what_a_block_writes_together_is_not_there_if_it_fails(folder):
    with Book(folder, writes=True) as book:
        ledger = Ledger(book)
        with pytest.raises(ZeroDivisionError), ledger.together():
            ledger.ask(2, DESIGNS)
            raise ZeroDivisionError
    assert without_times(read_entries(folder)) == EXPECTED


def recorded(folder):
    """Write the records of the trials that have ended."""
    for trial, design in enumerate(DESIGNS):
        run = store.run_file(folder, trial, 0)
        store.save_run(run, {"trial": trial, "repeat": 0, "design": design}, {})


@pytest.mark.parametrize("n_bytes", [0, 50, 5000, 12_000])
def test_a_torn_book_is_written_anew_with_the_designs_of_all_runs(folder, n_bytes):
    recorded(folder)
    path = folder / BOOK
    path.write_bytes(path.read_bytes()[:n_bytes])
    assert fault(folder)
    with opened(folder, 2) as (_, [note]):
        assert note.startswith(f"{path}: ") and f"now {BOOK}.damaged" in note
        assert "written anew with 2 trials" in note and "the queue and what racing decided are lost" in note
    assert [entry[:3] for entry in without_times(read_entries(folder))][:2] == [x[:3] for x in EXPECTED[:2]]
    with opened(folder, 2) as (_, notes):
        assert fault(folder) == "" and notes == []


def test_no_changed_bit_is_believed(folder):
    recorded(folder)
    path, rng = folder / BOOK, random.Random(1)
    content = path.read_bytes()
    with Book(folder) as book:
        expected = book.rows("trial")
    n_refused = 0
    for _ in range(300):
        changed = bytearray(content)
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
        path.write_bytes(changed)
        try:
            with Book(folder) as book:
                assert book.rows("trial") == expected
        except store.StoreError:
            n_refused += 1
    assert 0 < n_refused < 300


def changed_row(folder):
    path = folder / BOOK
    path.write_bytes(path.read_bytes().replace(b"[0.5, 100.0, 1.5]", b"[0.6, 100.0, 1.5]"))


def without_a_row(folder):
    with Book(folder, writes=True) as book:
        book.drop("trial", "trial = 1")


@pytest.mark.parametrize(
    "harm, told",
    [(changed_row, "a row of table trial is not what was written"), (without_a_row, "lacks a design")],
)
def test_a_damaged_book_is_restored_from_its_copy(folder, harm, told):
    with opened(folder) as (_, notes):
        assert notes == []
    before = read_entries(folder)
    harm(folder)
    assert told in fault(folder)
    with opened(folder) as (_, [note]):
        assert f"it is restored from {BOOK}.copy" in note
    assert read_entries(folder) == before
    assert fault(folder) == fault(folder, f"{BOOK}.copy") == ""


def test_designs_of_several_kinds_have_their_own_axes(tmp_path):
    families.register()
    space = load_space(write_space(tmp_path, text=families.SPACE))
    designs = [design_at(space, index) for index in (0, 40, 117, 170)]
    assert len({tuple(design) for design in designs}) == 4
    with Book(tmp_path, writes=True) as book:
        Ledger(book).ask(0, designs)
    again = read_entries(tmp_path)
    assert [space.resolve(entry.design) for entry in again] == [space.resolve(design) for design in designs]
    assert [design_key(entry.design) for entry in again] == list(map(design_key, designs))
