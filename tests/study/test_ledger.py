"""The journal of a study: what was asked and told, and what a torn file still holds."""

from __future__ import annotations

import json
import random
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from dse import store
from dse.config import SearchSpace, load_space
from dse.search.space import design_at
from dse.seeds import design_key
from dse.study.journal import CREATE_TRIAL, RUNNING, SET_TRIAL_STATE, Entry, read_journal
from dse.study.ledger import Ledger
from dse.study.lines import CREATE_STUDY, _sum
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
    (0, 0, DESIGNS[0], True, (0.5, 100.0, 1.5)),
    (1, 0, DESIGNS[1], True, None),
    (2, 1, DESIGNS[0], False, None),
]


def without_times(entries: list[Entry]) -> list[tuple[object, ...]]:
    return [(entry.trial, entry.batch, entry.design, entry.is_reported, entry.values) for entry in entries]


def test_what_was_asked_and_told_is_there_after_a_restart(
    ledger: Ledger, tmp_path: Path, space: SearchSpace, capfd: pytest.CaptureFixture[str]
) -> None:
    assert without_times(ledger.entries) == EXPECTED
    again = Ledger(tmp_path / "journal.log", space).entries
    assert without_times(again) == EXPECTED
    assert capfd.readouterr() == ("", "")
    for written, read in zip(ledger.entries, again, strict=True):
        assert abs(written.proposed_s - read.proposed_s) < 120
        assert read.reported_s is None or read.proposed_s <= read.reported_s


def test_a_copy_of_hard_links_goes_its_own_way(ledger: Ledger, tmp_path: Path, space: SearchSpace) -> None:
    (tmp_path / "copy").mkdir()
    (tmp_path / "copy" / "journal.log").hardlink_to(tmp_path / "journal.log")
    before = (tmp_path / "journal.log").read_bytes()
    Ledger(tmp_path / "copy" / "journal.log", space).tell(2, (0.25, 1.0, 1.0))
    assert (tmp_path / "journal.log").read_bytes() == before
    copied = read_journal(tmp_path / "copy" / "journal.log")
    assert [entry.values for entry in copied] == [(0.5, 100.0, 1.5), None, (0.25, 1.0, 1.0)]


def test_a_journal_is_read_as_optuna_reads_it(ledger: Ledger, tmp_path: Path) -> None:
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend
    from optuna.storages.journal._storage import JournalOperation
    from optuna.trial import TrialState

    assert (CREATE_TRIAL, SET_TRIAL_STATE) == (
        JournalOperation.CREATE_TRIAL.value,
        JournalOperation.SET_TRIAL_STATE_VALUES.value,
    )
    assert TrialState.RUNNING.value == RUNNING
    path = tmp_path / "journal.log"
    storage = JournalStorage(JournalFileBackend(str(path)))
    [study] = storage.get_all_studies()
    trials = storage.get_all_trials(study._study_id)
    entries = read_journal(path)
    assert [
        (t.number, t.user_attrs["batch"], t.user_attrs["design"], t.state.is_finished(), t.values)
        for t in trials
    ] == [(*rest, None if values is None else list(values)) for *rest, values in without_times(entries)]
    assert [t.datetime_start.timestamp() for t in trials] == [entry.proposed_s for entry in entries]
    assert [t.datetime_complete and t.datetime_complete.timestamp() for t in trials] == [
        entry.reported_s for entry in entries
    ]


def test_every_cut_leaves_a_readable_beginning(ledger: Ledger, tmp_path: Path, space: SearchSpace) -> None:
    path = tmp_path / "journal.log"
    content = path.read_bytes()
    lengths = []
    for cut in [*range(0, len(content), 31), len(content)]:
        path.write_bytes(content[:cut])
        assert read_journal(path) == Ledger(path, space).entries
        entries = without_times(read_journal(path))
        assert [entry[:3] for entry in entries] == [entry[:3] for entry in EXPECTED[: len(entries)]]
        lengths.append(len(entries))
    assert lengths == sorted(lengths)
    assert (lengths[0], lengths[-1]) == (0, 3)


def test_a_last_line_that_is_no_json_is_cut_off(ledger: Ledger, tmp_path: Path, space: SearchSpace) -> None:
    with (tmp_path / "journal.log").open("ab") as file:
        file.write(b"\0\0\0\0\n")
    again = Ledger(tmp_path / "journal.log", space)
    assert without_times(again.entries) == EXPECTED
    again.tell(2, None)
    assert Ledger(tmp_path / "journal.log", space).entries[2].is_reported


@pytest.fixture
def records(tmp_path: Path) -> None:
    """The records of the trials that have ended."""
    for trial, design in enumerate(DESIGNS):
        record = {"trial": trial, "repeat": 0, "design": design}
        store.save_run(store.run_folder(tmp_path, trial, 0), record, {})


def _flipped(lines: list[bytes], k: int, rng: random.Random) -> None:
    line = bytearray(lines[k])
    line[rng.randrange(len(line))] ^= 1 << rng.randrange(8)
    lines[k] = bytes(line)


DAMAGES: dict[str, Callable[[list[bytes], int, random.Random], object]] = {
    "flipped": _flipped,
    "cut": lambda lines, k, rng: lines.__setitem__(k, lines[k][: rng.randrange(len(lines[k]))]),
    "lost": lambda lines, k, _: lines.pop(k),
    "doubled": lambda lines, k, _: lines.insert(k, lines[k]),
    "moved": lambda lines, k, rng: lines.insert(rng.randrange(len(lines)), lines.pop(k)),
    "digit": lambda lines, k, _: lines.__setitem__(k, lines[k].replace(b"1", b"3", 1)),
}


@pytest.mark.parametrize("is_old", [False, True], ids=["", "earlier version"])
@pytest.mark.parametrize("damage", DAMAGES)
def test_damage_in_the_middle_loses_no_trial(
    ledger: Ledger, records: None, tmp_path: Path, space: SearchSpace, damage: str, is_old: bool
) -> None:
    path, rng = tmp_path / "journal.log", random.Random(damage)
    whole = path.read_bytes()
    if is_old:
        logs = [json.loads(line) for line in whole.splitlines()]
        plain = [{k: x for k, x in log.items() if k not in ("n", "trial", "sum")} for log in logs]
        whole = b"".join(json.dumps(log, separators=(",", ":")).encode() + b"\n" for log in plain)
    for k in range(len(whole.splitlines()) - 1):
        lines = whole.splitlines()
        DAMAGES[damage](lines, k, rng)
        path.write_bytes(b"\n".join(lines) + b"\n")
        if is_old and damage in ("lost", "doubled", "moved", "digit", "flipped"):
            Ledger(path, space)  # it had no checksums: no error, and what Optuna refuses is mended
            assert Ledger(path, space).notes == []
            continue
        is_changed = path.read_bytes() != whole
        mended = Ledger(path, space)
        assert [entry[:3] for entry in without_times(mended.entries)][:2] == [e[:3] for e in EXPECTED[:2]]
        if not is_old:
            assert bool(mended.notes) == is_changed
        for trial, _, _, is_reported, values in without_times(mended.entries):
            assert not is_reported or values == EXPECTED[trial][4]
        mended.ask(1, DESIGNS[:1])
        assert Ledger(path, space).notes == []
        assert Ledger(path, space).entries == read_journal(path)


def test_a_line_without_its_number_is_damage(ledger: Ledger, tmp_path: Path, space: SearchSpace) -> None:
    path = tmp_path / "journal.log"
    *before, last, end = path.read_bytes().split(b"\n")
    text = re.sub(rb',"n":\d+|,"sum":.*', b"", last)
    path.write_bytes(b"\n".join([*before, text + b',"sum":"%s"}' % _sum(text), before[-1], end]))
    assert "line 7 is damaged (KeyError" in Ledger(path, space).notes[0]
    assert without_times(read_journal(path))[:2] == EXPECTED[:2]


def _forged(logs: list[dict[str, object]]) -> bytes:
    """Return the lines of a journal with checksums that fit."""
    texts = [json.dumps({k: x for k, x in log.items() if k != "sum"}, separators=(",", ":")) for log in logs]
    return b"".join(b'%s,"sum":"%s"}\n' % (x[:-1].encode(), _sum(x[:-1].encode())) for x in texts)


def test_trials_keep_their_numbers_when_one_is_lost_and_another_refused(
    ledger: Ledger, records: None, tmp_path: Path, space: SearchSpace
) -> None:
    path = tmp_path / "journal.log"
    logs = [json.loads(line) for line in path.read_bytes().splitlines()]
    del logs[2]["worker_id"]  # Optuna refuses the first trial
    logs[2]["n"] = 9_905_077_650  # and all others look as if they were moved
    path.write_bytes(_forged(logs))
    mended = Ledger(path, space)
    assert [entry[:3] for entry in without_times(mended.entries)][:2] == [entry[:3] for entry in EXPECTED[:2]]
    assert Ledger(path, space).notes == []


@pytest.mark.parametrize("parameter", [99.0, -1e17, float("inf"), "x", None])
@pytest.mark.parametrize("has_study", [True, False])
def test_what_optuna_refuses_is_mended_with_one_copy(
    ledger: Ledger, records: None, tmp_path: Path, space: SearchSpace, parameter: object, has_study: bool
) -> None:
    """Lines with checksums of operations that Optuna refuses: one may keep it from reading the next."""
    path = tmp_path / "journal.log"
    logs = [json.loads(line) for line in path.read_bytes().splitlines()]
    [trial] = [log for log in logs if log.get("trial") == 1]
    trial["params"]["model.hidden"] = parameter
    logs[0]["op_code"] = CREATE_STUDY if has_study else 77
    content = _forged(logs)
    path.write_bytes(content)
    mended = Ledger(path, space)
    [note] = mended.notes
    assert note.count("Optuna refuses operation") == (1 if has_study else 2)
    assert [entry[:3] for entry in without_times(mended.entries)][:2] == [entry[:3] for entry in EXPECTED[:2]]
    assert (tmp_path / "journal.log.damaged").read_bytes() == content
    assert Ledger(path, space).notes == []


def test_what_is_missing_and_has_no_record_is_proposed_again(
    ledger: Ledger, records: None, tmp_path: Path, space: SearchSpace
) -> None:
    path = tmp_path / "journal.log"
    ledger.ask(1, DESIGNS[1:])
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([*lines[:-2], b"?" + lines[-2][1:], lines[-1]]))
    assert [entry.trial for entry in read_journal(path)] == [0, 1]
    mended = Ledger(path, space)
    assert [entry.trial for entry in mended.entries] == [0, 1]
    assert mended.notes[0].startswith(f"{path}: line 7 is damaged")
    assert (tmp_path / "journal.log.damaged").read_bytes().splitlines(keepends=True)[:5] == lines[:5]


def test_lines_of_other_programs_stay(ledger: Ledger, tmp_path: Path, space: SearchSpace) -> None:
    path = tmp_path / "journal.log"
    with path.open("a") as file:
        file.write('{"op_code":2,"worker_id":"me","study_id":0,"user_attr":{"note":"mine"}}\n')
    again = Ledger(path, space)
    again.tell(2, (0.1, 1.0, 1.0))
    assert Ledger(path, space).notes == []
    assert "mine" in path.read_text() and read_journal(path)[2].values == (0.1, 1.0, 1.0)


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
