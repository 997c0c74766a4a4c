"""The journal of a study: what was asked and told, and what a torn file still holds."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from dse.config import SearchSpace, load_space
from dse.search.space import design_at
from dse.seeds import design_key
from dse.store import StoreError
from dse.study.ledger import Entry, Ledger
from tests import families, tiny_study
from tests.spaces import write_space

DESIGNS = [
    {"model.hidden": n, "model.true_rate": 0.2, "task.target": t} for n, t in ((4, "fabric"), (8, ["a", "b"]))
]


@pytest.fixture
def space(tmp_path: Path) -> Iterator[SearchSpace]:
    data = {**tiny_study.plain()["data"], "columns": {"fabric": "label", "a": "label", "b": "label"}}
    task = {"target": {"choice": ["fabric", ["a", "b"]]}, "name": "any"}
    yield tiny_study.make_space(tmp_path, data=data, task=task)
    tiny_study.unregister()


@pytest.fixture
def ledger(tmp_path: Path, space: SearchSpace) -> Ledger:
    made = Ledger(tmp_path / "journal.log", space)
    made.ask(0, DESIGNS)
    made.tell(0, (0.5, 100.0, 1.5))
    made.tell(1, None)
    made.ask(1, DESIGNS[:1])
    return made


EXPECTED = [
    Entry(0, 0, DESIGNS[0], True, (0.5, 100.0, 1.5)),
    Entry(1, 0, DESIGNS[1], True, None),
    Entry(2, 1, DESIGNS[0], False, None),
]


def test_what_was_asked_and_told_is_there_after_a_restart(
    ledger: Ledger, tmp_path: Path, space: SearchSpace, capfd: pytest.CaptureFixture[str]
) -> None:
    assert ledger.entries == EXPECTED
    assert Ledger(tmp_path / "journal.log", space).entries == EXPECTED
    assert capfd.readouterr() == ("", "")


def test_every_cut_leaves_a_readable_beginning(ledger: Ledger, tmp_path: Path, space: SearchSpace) -> None:
    path = tmp_path / "journal.log"
    content = path.read_bytes()
    lengths = []
    for cut in [*range(0, len(content), 31), len(content)]:
        path.write_bytes(content[:cut])
        found = Ledger(path, space).entries
        asked = [(entry.trial, entry.batch, entry.design) for entry in EXPECTED[: len(found)]]
        assert [(entry.trial, entry.batch, entry.design) for entry in found] == asked
        lengths.append(len(found))
    assert lengths == sorted(lengths)
    assert (lengths[0], lengths[-1]) == (0, 3)


def test_a_last_line_that_is_no_json_is_cut_off(ledger: Ledger, tmp_path: Path, space: SearchSpace) -> None:
    with (tmp_path / "journal.log").open("ab") as file:
        file.write(b"\0\0\0\0\n")
    again = Ledger(tmp_path / "journal.log", space)
    assert again.entries == EXPECTED
    again.tell(2, None)
    assert Ledger(tmp_path / "journal.log", space).entries[2].told


def test_the_lock_of_a_dead_process_is_no_obstacle(
    ledger: Ledger, tmp_path: Path, space: SearchSpace
) -> None:
    (tmp_path / "journal.log.lock").symlink_to(tmp_path / "journal.log")
    again = Ledger(tmp_path / "journal.log", space)
    again.tell(2, (0.1, 1.0, 1.0))
    assert again.entries[2].values == (0.1, 1.0, 1.0)


def test_damage_in_the_middle_is_named(ledger: Ledger, tmp_path: Path, space: SearchSpace) -> None:
    path = tmp_path / "journal.log"
    lines = path.read_bytes().split(b"\n")
    lines[1] = lines[1][:20]
    path.write_bytes(b"\n".join(lines))
    with pytest.raises(StoreError, match=r"journal\.log: is damaged"):
        Ledger(path, space)


def test_designs_of_several_kinds_have_their_own_axes(tmp_path: Path) -> None:
    families.register()
    try:
        space = load_space(write_space(tmp_path, text=families.SPACE))
    finally:
        families.unregister()
    designs = [design_at(space, index) for index in (0, 40, 117, 170)]
    assert len({tuple(design) for design in designs}) == 4
    ledger = Ledger(tmp_path / "journal.log", space)
    ledger.ask(0, designs)
    ledger.tell(1, (0.5, 10.0))
    again = Ledger(tmp_path / "journal.log", space).entries
    assert [space.resolve(entry.design) for entry in again] == [space.resolve(design) for design in designs]
    assert [design_key(entry.design) for entry in again] == list(map(design_key, designs))
    assert [entry.values for entry in again] == [None, (0.5, 10.0), None, None]
