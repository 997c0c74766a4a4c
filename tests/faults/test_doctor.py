"""Planted faults, each of which `dse doctor` names, and after which a study ends with the tables it had."""

from __future__ import annotations

import itertools
import json
import os
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from pandas.testing import assert_frame_equal

import dse
from dse import store
from dse.base import trust
from dse.base.records import Array, Dataset, Network, Response
from dse.cli import main
from dse.config import load_space
from dse.study import explore, held, queue, tables
from dse.study.audit import record as audit
from dse.study.audit.audit import Audit
from dse.study.ledger import read_entries
from dse.study.results import Study
from dse.study.workers import Workers
from tests import page_data, tiny_study
from tests.command import document
from tests.rewriting import rewrite
from tests.study.test_racing import in_process

PLUGIN = '''
from dataclasses import dataclass
from dse.base.registry import register

@register("encoders", "encoder_of_planted_faults")
@dataclass(frozen=True)
class OfPlantedFaults:
    """An encoder of a user."""
    n_channels = positions = encode_all = str
'''
RUN, PRECISION = "runs/00003-0.npz", "precision/{}/4_0.0.npz"


@dataclass(frozen=True)
class Rounded(tiny_study.Curve):
    """The same, that answers at other precisions too."""

    def respond(self, network: Network, dataset: Dataset, samples: Array) -> Response:
        sizes = (network.sizes[0], *self.hidden, len(dataset.classes))
        return self._answer(dataset, samples, np.random.default_rng(3), sizes)


def space_of(folder, **changes):
    rates = [0.2, 0.5, 0.55, 0.6, 0.7, 0.8]
    model = {"kind": "rounded", "true_rate": {"choice": rates}, "hidden": {"choice": [[8], [9]]}}
    search = {"sampler": "grid", "batch": 6, "racing": {"rungs": [2, 5]}}
    return tiny_study.make_space(
        folder,
        **{
            "plugins": [str(Path("mine.py").absolute())],
            "model": model,
            "training": {"epochs": 20},
            "objectives": ["accuracy:max", "n_weights:min"],
            "search": search | {"repeats_on_front": 2},
            "decision": {"phi": [0], "theta": [0.4]},
            "hardware": ["op_4.6_0.9"],
            "precision": {"weight_bits": [4], "within": 0.0},
            "execution": {"jobs": 1},
            **changes,
        },
    )


@pytest.fixture(scope="module")
def patched(tmp_path_factory):
    """The folder of the search space; work is done in this process."""
    with pytest.MonkeyPatch.context() as patch, trust.answering(True):
        patch.setitem(tiny_study.FAMILIES, "rounded", Rounded)
        patch.setattr(Workers, "stream", in_process)
        folder = tmp_path_factory.mktemp("planted")
        patch.setenv("DSE_CACHE", str(folder / "cache"))
        patch.chdir(folder)
        (folder / "mine.py").write_text(PLUGIN)
        yield folder


@pytest.fixture(scope="module")
def whole(patched):
    """A finished study with every kind of file that a study may have."""
    study = explore.run(space_of(patched), patched / "whole", progress=False)
    store.keep(study.folder, store.WARNINGS, ["labels are few"])
    store.keep(study.folder, audit.DOCUMENT, audit.plain(Audit((), ())))
    queue.enqueue(study.folder, [dict(read_entries(study.folder)[2].design)])
    return study


@pytest.fixture(scope="module")
def another(patched):
    """A study of the same name and designs, of another seed."""
    folder = patched / "another"
    folder.mkdir()
    shutil.copy(patched / "tiny.npz", folder)
    return explore.run(space_of(folder, seed=8), folder, progress=False).folder


@pytest.fixture(scope="module")
def paused(patched, whole):
    """The same study, stopped while designs of its second batch stand at a rung."""

    def until_paused(_, function, jobs):
        for job in jobs:
            for part in function(job):
                yield job, part
                if len(store.document(patched / "paused" / "tiny", "racing/00001", [])) == 2:
                    raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(Workers, "stream", until_paused)
        explore.run(load_space(patched / "tiny.yaml"), patched / "paused", progress=False)
    return patched / "paused" / "tiny"


def flip(path, share=0.5):
    content = bytearray(path.read_bytes())
    content[int(len(content) * share)] ^= 1
    path.write_bytes(content)


def cut(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def longer(path):
    path.write_bytes(path.read_bytes() + b"\0" * 512)


def zero(path):
    path.write_bytes(bytes(path.stat().st_size))


def empty(path):
    path.write_bytes(b"")


def a_folder(path):
    store.remove(path)
    (path / "inside").mkdir(parents=True)


def a_pipe(path):
    store.remove(path)
    os.mkfifo(path)


def a_dangling_link(path):
    store.remove(path)
    path.symlink_to("nowhere")


def unreadable(path):
    path.chmod(0)


INSIDE = {f.__name__: f for f in (flip, cut, longer, zero, empty)}
NEEDED = (
    *(RUN, store.SPACE, "trials.parquet", "points.parquet"),
    *("hardware/op_4.6_0.9.yaml", "plugins/0_mine.py"),
)


def at(name, harm):
    return lambda study: harm(study / name)


def swapped(one, other):
    def swap(study):
        (study / one).rename(study / "between")
        (study / other).rename(study / one)
        (study / "between").rename(study / other)

    return swap


def copied(one, other):
    def copy(study):
        (study / other).parent.mkdir(parents=True, exist_ok=True)
        is_folder = (study / one).is_dir()
        (shutil.copytree if is_folder else shutil.copy)(study / one, study / other)

    return copy


def copied_away(one, other):
    return lambda study: (copied(one, other)(study), store.remove(study / one))


def removed(*names):
    return lambda study: [store.remove(study / name) for name in names]


def foreign(name):
    """Return what puts a file or a folder of the other study in place of one."""

    def plant(study):
        store.remove(study / name)
        source = Path("another") / "tiny" / name
        (shutil.copytree if source.is_dir() else shutil.copy)(source, study / name)

    return plant


def rewritten(name, change):
    """Return what changes the record of a run as if dse had written it."""
    return lambda study: rewrite(study / name, change)


def retabled(name, change):
    """Return what changes a table as if dse had written it, with the note on what it was made from."""

    def plant(study):
        path = study / name
        table, made_from = change(held.read(path)), store.made_from(path)
        with store.noted(path) as temporary:
            store.write_table(temporary, table, made_from)

    return plant


def without_rows(table, condition):
    """Return what removes rows of the book as if dse had done so."""

    def plant(study):
        with store.Book(study, writes=True) as book:
            book.drop(table, condition)

    return plant


def changed_row(old, new):
    """Return what changes bytes of the book as a disk may."""

    def plant(study):
        content = (study / store.BOOK).read_bytes()
        assert old in content
        (study / store.BOOK).write_bytes(content.replace(old, new, 1))

    return plant


def other_numbers(path):
    store.write_text(path, store.read_text(path).replace("4.6", "4.7").replace("op_4.7", "op_4.6"))


LAST_RUNS = [f"runs/{trial:05d}-0.npz" for trial in range(6, 12)]
STATE = "checkpoints/00005/runs/00011-0.npz"
KINDS = {**INSIDE, "missing": store.remove}
"""What may happen to the content of a file."""
OF_BOOK = {name: harm for name, harm in KINDS.items() if name not in ("flip", "longer")}
"""What harms the book for sure: it has room that nobody reads."""
NO_FILES = {x.__name__: x for x in (a_folder, a_pipe, a_dangling_link)}
"""What may lie in place of a file."""


def rotated(harms, names, n):
    """Return n harms to each file, in turn: every harm is done, and every file is harmed."""
    turn = itertools.cycle(harms.items())
    return {f"{harm} {name}": at(name, do) for name in names for harm, do in itertools.islice(turn, n)}


WHOLE = {
    **{
        name: (plant, name.split()[1])
        for name, plant in {
            **rotated(KINDS, NEEDED, len(KINDS)),
            **rotated(OF_BOOK, [store.BOOK], len(OF_BOOK)),
            **rotated({x: OF_BOOK[x] for x in OF_BOOK if x != "missing"}, [store.COPY], len(OF_BOOK) - 1),
            **rotated(NO_FILES, (*NEEDED, store.BOOK, store.COPY), len(NO_FILES)),
            **rotated(NO_FILES, ("page.html", ".lock"), 2),
            **rotated({"unreadable": unreadable}, (RUN, "points.parquet", store.BOOK, ".lock", "runs"), 1),
            **rotated({"a_pipe": a_pipe}, ("runs", "precision"), 1),
            **rotated({"a_dangling_link": a_dangling_link}, ("hardware", "plugins", "checkpoints"), 1),
        }.items()
    },
    **{
        f"of another study: {name}": (foreign(name), name)
        for name in (RUN, store.SPACE, "trials.parquet", "points.parquet")
    },
    "of another study: the book": (foreign(store.BOOK), store.SPACE),
    "a run removed": (removed(RUN), RUN),
    "a stopped run removed": (removed("runs/00002-0.npz"), "runs/00002-0.npz"),
    "the second run of a design removed": (removed("runs/00005-1.npz"), "runs/00005-1.npz"),
    "the first run of a design removed": (removed("runs/00005-0.npz"), "runs/00005-0.npz"),
    "all runs of a batch removed": (removed(*LAST_RUNS), "runs/00006"),
    "all runs removed": (removed("runs"), "runs/00000"),
    "a run renamed to another trial": (copied_away(RUN, "runs/00033-0.npz"), "runs/00033-0.npz"),
    "a run renamed to another repeat": (copied_away(RUN, "runs/00003-1.npz"), "runs/00003-1.npz"),
    "a run renamed": (copied_away(RUN, "runs/old.npz"), "runs/old.npz"),
    "a run doubled": (copied(RUN, "runs/00012-0.npz"), "runs/00012-0.npz"),
    "a run doubled beside": (copied(RUN, "runs/00003-0 (copy).npz"), "runs/00003-0 (copy).npz"),
    "runs swapped": (swapped(RUN, "runs/00004-0.npz"), RUN),
    "a run of another seed": (rewritten(RUN, lambda record: record | {"seed": 8}), RUN),
    "a run of another design": (
        rewritten(RUN, lambda x: x | {"design": x["design"] | {"model.true_rate": 0.2}}),
        RUN,
    ),
    "a record of a newer schema": (rewritten(RUN, lambda x: x | {"schema": 99}), RUN),
    "a record without numbers": (
        rewritten(RUN, lambda x: {k: v for k, v in x.items() if k != "columns"}),
        RUN,
    ),
    "precisions of two runs swapped": (
        swapped(PRECISION.format("00005-0"), PRECISION.format("00011-0")),
        PRECISION.format("00005-0"),
    ),
    "a precision under another name": (
        copied(PRECISION.format("00005-0"), "precision/00005-0/8_0.0.npz"),
        "precision/00005-0/8_0.0.npz",
    ),
    "a precision cut": (at(PRECISION.format("00005-0"), cut), PRECISION.format("00005-0")),
    "a precision removed": (removed(PRECISION.format("00005-0")), PRECISION.format("00005-0")),
    "a book without its last trials": (without_rows("trial", "trial >= 10"), store.BOOK),
    "a book without a trial": (without_rows("trial", "trial = 4"), store.BOOK),
    "a changed byte of a trial": (changed_row(b'"model.true_rate"', b'"model.true_ratf"'), store.BOOK),
    "tables swapped": (swapped("trials.parquet", "points.parquet"), "trials.parquet"),
    "a table of trials without a row": (retabled("trials.parquet", lambda x: x.iloc[:-1]), "trials.parquet"),
    "a table of trials with a row twice": (
        retabled("trials.parquet", lambda x: pd.concat([x, x.iloc[-1:]])),
        "trials.parquet",
    ),
    "points without a row": (retabled("points.parquet", lambda x: x.iloc[:-1]), "points.parquet"),
    "points with a row twice": (
        retabled("points.parquet", lambda x: pd.concat([x, x.iloc[-1:]])),
        "points.parquet",
    ),
    "tables of a run that has changed": (rewritten(RUN, lambda x: x | {"leak": ""}), "points.parquet"),
    "a profile of another name": (
        at("hardware/op_4.6_0.9.yaml", lambda x: x.rename(x.with_name("loihi2_board.yaml"))),
        "hardware/loihi2_board.yaml",
    ),
    "a profile of other numbers": (
        lambda study: other_numbers(study / "hardware" / "op_4.6_0.9.yaml"),
        "hardware/op_4.6_0.9.yaml",
    ),
}
PAUSED = {
    "checkpoints in no folder": (at("checkpoints", a_pipe), "checkpoints"),
    "tables removed": (removed("trials.parquet", "points.parquet"), "trials.parquet"),
}
UNNAMED = {
    **{f"{harm} state": (at(STATE, function), "") for harm, function in INSIDE.items()},
    "a checkpoint removed": (removed(STATE), ""),
    "a checkpoint of other epochs": (copied_away("checkpoints/00005", "checkpoints/00003"), ""),
    "a checkpoint of another design": (copied(STATE, "checkpoints/00002/runs/00010-0.npz"), ""),
}
"""What `dse run` mends without a word of the doctor."""


def named_by_doctor(study, capsys):
    code = main(["doctor", str(study), "--json"])
    out = capsys.readouterr().out
    rows = json.loads(out)["rows"] if code else []
    assert code == (1 if rows else 0), out
    return [row["file"] for row in rows]


NAMED = [
    name
    for number, name in enumerate((*WHOLE, *PAUSED))
    if "FAULTS" in os.environ or number % 5 == 0 or name.split()[0] not in {*KINDS, *NO_FILES}
]
"""Of harms to a file every fifth without `make faults`: still every harm, and every file."""


@pytest.mark.parametrize("name", NAMED)
def test_a_planted_fault_is_named(whole, paused, another, tmp_path, capsys, name):
    source, (plant, expected) = (whole.folder, WHOLE[name]) if name in WHOLE else (paused, PAUSED[name])
    study = Path(shutil.copytree(source, tmp_path / "results" / "tiny"))
    plant(study)
    found = named_by_doctor(study, capsys)
    assert any(file.startswith(expected) for file in found), found


def test_nothing_is_named_of_healthy_studies(whole, paused, another, capsys):
    for study in (whole.folder, paused, another):
        assert named_by_doctor(study, capsys) == []


def same_tables(study, whole):
    for one, other in ((study.trials, whole.trials), (study.points(), whole.points())):
        assert_frame_equal(one.drop(columns="train_s"), other.drop(columns="train_s"), check_exact=True)


NOT_MENDED = ("a record of a newer schema",)
"""What another version of dse reads."""
TOGETHER = (
    ("a run removed", "a stopped run removed", "the second run of a design removed", "zero study.sqlite"),
    ("a run renamed to another trial", "a book without its last trials", "tables swapped", "a precision cut"),
    ("a book without a trial", "a_folder .lock", "a run of another seed", "points without a row"),
    ("runs swapped", "a changed byte of a trial", "zero study.sqlite.copy"),
    ("all runs of a batch removed", "a precision removed", "a_folder trials.parquet", "missing study.sqlite"),
    ("of another study: the book",),
    ("cut state", "tables removed"),
    ("a checkpoint of another design", "a checkpoint removed"),
)
"""Faults that are mended together: each alone takes a second (`make faults`)."""
ALONE = [(name,) for name in (*WHOLE, *PAUSED, *UNNAMED) if "FAULTS" in os.environ and name not in NOT_MENDED]


@pytest.mark.parametrize("faults", [*TOGETHER, *ALONE], ids=", ".join)
def test_a_repaired_study_ends_with_the_tables_it_had(whole, paused, another, tmp_path, capsys, faults):
    source = whole.folder if faults[0] in WHOLE else paused
    study = Path(shutil.copytree(source, tmp_path / "results" / "tiny"))
    for name in faults:
        (WHOLE | PAUSED | UNNAMED)[name][0](study)
    main(["doctor", str(study), "--repair"])
    capsys.readouterr()
    explore.run(load_space("tiny.yaml"), tmp_path / "results", progress=False)
    same_tables(Study(study), whole)
    assert named_by_doctor(study, capsys) == []


def test_the_book_of_another_study_costs_no_run(whole, another, tmp_path, capsys):
    study = Path(shutil.copytree(whole.folder, tmp_path / "tiny"))
    WHOLE["of another study: the book"][0](study)
    assert main(["doctor", str(study), "--repair"]) == 0, capsys.readouterr().out
    assert store.runs_in(study) == store.runs_in(whole.folder)
    same_tables(Study(study), whole)


def test_readers_leave_out_a_trial_whose_run_is_missing(whole, tmp_path, capsys):
    study = Path(shutil.copytree(whole.folder, tmp_path / "tiny"))
    lost = 5
    assert {lost} & {*dse.open(whole.folder).skyline().rows["trial"]}
    store.run_file(study, lost, 1).unlink()
    for command in ("skyline", "pick"):
        answer = document(capsys, command, study)
        assert any(f"trial {lost} is left out" in note for note in answer["notes"]), answer["notes"]
        assert answer["rows"] and all(row["trial"] != lost for row in answer["rows"])
    drawn = json.loads(_printed(capsys, "skyline", str(study), "--draws", "20", "--json"))
    assert "front_probability" in drawn["rows"][0]
    _printed(capsys, "dashboard", str(study), "--html", str(tmp_path / "page.html"))
    assert f"trial {lost} is left out" in json.dumps(page_data.held(tmp_path / "page.html")["notes"])


def test_readers_say_what_tables_lack_that_are_older_than_the_records(whole, tmp_path, capsys):
    study = Path(shutil.copytree(whole.folder, tmp_path / "tiny"))
    late = store.runs_of(study, 11)
    for run in late:
        run.rename(study / run.name)
    tables.write_again(study)
    for run in late:
        (study / run.name).rename(run)
    for command in ("skyline", "pick"):
        notes_of = json.loads(_printed(capsys, command, str(study), "--json"))["notes"]
        assert any("11 of the 12 trials" in note and "trial 11" in note for note in notes_of), notes_of
    assert set(named_by_doctor(study, capsys)) == {"trials.parquet", "points.parquet"}
    assert main(["doctor", str(study), "--repair"]) == 0
    capsys.readouterr()
    notes_of = json.loads(_printed(capsys, "skyline", str(study), "--json"))["notes"]
    assert not any("trial 11" in note for note in notes_of)
    same_tables(Study(study), whole)


def test_a_table_cut_short_is_named_by_who_reads_it(whole, tmp_path, capsys):
    study = Path(shutil.copytree(whole.folder, tmp_path / "tiny"))
    content = (study / "points.parquet").read_bytes()
    (study / "points.parquet").write_bytes(content[: len(content) // 2])
    assert held.remarks(study) == []
    assert main(["skyline", str(study)]) == 2
    assert "points.parquet" in capsys.readouterr().err


def _printed(capsys, *arguments):
    assert main([*arguments]) == 0
    return capsys.readouterr().out


def test_run_says_how_many_of_its_trials_the_tables_hold(patched, whole, tmp_path, capsys):
    def stopped(*arguments):
        for n, ended in enumerate(in_process(*arguments)):
            if n == 3:
                raise KeyboardInterrupt
            yield ended

    command = ["run", str(patched / "tiny.yaml"), "--results", str(tmp_path), "--quiet", "--json"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Workers, "stream", stopped)
        assert main(command) == 130
    n = len(Study(tmp_path / "tiny").trials)
    assert f"the tables hold {n} of 12 trials" in capsys.readouterr().err and n < 12
    assert "the tables hold 12 of 12 trials" in json.loads(_printed(capsys, *command))["notes"]
