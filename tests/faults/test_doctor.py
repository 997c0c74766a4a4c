"""Planted faults, each of which `dse doctor` names, and after which a study ends with the tables it had."""

from __future__ import annotations

import itertools
import json
import os
import shutil
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from pandas.testing import assert_frame_equal

import dse
from dse import store, trust
from dse.audit import record as audit
from dse.audit.audit import Audit
from dse.cli import main
from dse.config import SearchSpace, load_space
from dse.records import Array, Dataset, Network, Response
from dse.study import explore, held, notes, queue, saved_views, tables
from dse.study.journal import read_journal
from dse.study.results import Study
from dse.study.workers import Workers
from tests import page_data, tiny_study
from tests.faults.damage import unsealed
from tests.study.test_racing import in_process

PLUGIN = '''
from dataclasses import dataclass
from dse.registry import register

@register("encoders", "encoder_of_planted_faults")
@dataclass(frozen=True)
class OfPlantedFaults:
    """An encoder of a user."""
    n_channels = positions = encode_all = str
'''
RUN, WEIGHTS = "artefacts/00003/repeat_0", "artefacts/00003/repeat_0/weights.npz"


@dataclass(frozen=True)
class Rounded(tiny_study.Curve):
    """The same, that answers at other precisions too."""

    def respond(self, network: Network, dataset: Dataset, samples: Array) -> Response:
        sizes = (network.sizes[0], *self.hidden, len(dataset.classes))
        return self._answer(dataset, samples, np.random.default_rng(3), sizes)


def space_of(folder: Path, **changes: Any) -> SearchSpace:
    rates = [0.2, 0.5, 0.55, 0.6, 0.7, 0.8]
    model = {"kind": "rounded", "true_rate": {"choice": rates}, "hidden": {"choice": [[8], [9]]}}
    search = {"sampler": "grid", "batch": 6, "racing": {"rungs": [2, 5], "audit": 1}}
    undecided = {"repeats_on_front": 2, "front_undecided": [0.02, 0.98]}
    return tiny_study.make_space(
        folder,
        **{
            "plugins": [str(Path("mine.py").absolute())],
            "model": model,
            "training": {"epochs": 20},
            "objectives": ["accuracy:max", "n_weights:min"],
            "search": search | undecided,
            "decision": {"phi": [0], "theta": [0.4]},
            "hardware": ["op_4.6_0.9"],
            "precision": {"weight_bits": [4], "within": 0.0},
            "execution": {"jobs": 1},
            **changes,
        },
    )


@pytest.fixture(scope="module")
def patched(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The folder of the search space; work is done in this process."""
    with pytest.MonkeyPatch.context() as patch, trust.answering(True):
        patch.setitem(tiny_study.FAMILIES, "rounded", Rounded)
        patch.setattr(Workers, "stream", in_process)
        folder = tmp_path_factory.mktemp("planted")
        patch.setenv("DSE_CACHE", str(folder / "cache"))
        patch.chdir(folder)
        (folder / "mine.py").write_text(PLUGIN)
        yield folder
        tiny_study.unregister()


@pytest.fixture(scope="module")
def whole(patched: Path) -> Study:
    """A finished study with every kind of file that a study may have."""
    study = explore.run(space_of(patched), patched / "whole", progress=False)
    notes.write(study.folder, 3, None, "likes wool", True)
    saved_views.write(study.folder, "wool", "#x=energy_uj")
    store.write_json(study.folder / store.WARNINGS, ["labels are few"])
    audit.write(Audit((), ()), study.folder / audit.FILE)
    queue.add(study.folder, [dict(read_journal(study.folder / "journal.log")[2].design)])
    return study


@pytest.fixture(scope="module")
def another(patched: Path) -> Path:
    """A study of the same name and designs, of another seed."""
    folder = patched / "another"
    folder.mkdir()
    shutil.copy(patched / "tiny.npz", folder)
    return explore.run(space_of(folder, seed=8), folder, progress=False).folder


@pytest.fixture(scope="module")
def paused(patched: Path, whole: Study) -> Path:
    """The same study, stopped while designs of its second batch stand at a rung."""

    def until_paused(_: object, function: Callable[..., Iterable[Any]], jobs: Iterable[Any]) -> Iterator[Any]:
        for job in jobs:
            for part in function(job):
                yield job, part
                path = patched / "paused" / "tiny" / "racing" / "00001.json"
                if path.exists() and len(store.read_json(path)["rounds"]) == 2:
                    raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(Workers, "stream", until_paused)
        explore.run(load_space(patched / "tiny.yaml"), patched / "paused", progress=False)
    return patched / "paused" / "tiny"


Plant = Callable[[Path], object]


def flip(path: Path, share: float = 0.5) -> None:
    content = bytearray(path.read_bytes())
    content[int(len(content) * share)] ^= 1
    path.write_bytes(content)


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def longer(path: Path) -> None:
    path.write_bytes(path.read_bytes() + b"\0" * 512)


def zero(path: Path) -> None:
    path.write_bytes(bytes(path.stat().st_size))


def empty(path: Path) -> None:
    path.write_bytes(b"")


def unseal(path: Path) -> None:
    path.write_bytes(unsealed(path.read_bytes()))


def a_folder(path: Path) -> None:
    store.remove(path)
    (path / "inside").mkdir(parents=True)


def a_pipe(path: Path) -> None:
    store.remove(path)
    os.mkfifo(path)


def a_dangling_link(path: Path) -> None:
    store.remove(path)
    path.symlink_to("nowhere")


def unreadable(path: Path) -> None:
    path.chmod(0)


INSIDE = {f.__name__: f for f in (flip, cut, longer, zero, empty)}
NEEDED = {
    **dict.fromkeys((f"{RUN}/record.json", WEIGHTS, f"{RUN}/read_out.npz"), RUN),
    **{name: name for name in ("search_space.yaml", "journal.log", "environment.json", "trials.parquet")},
    **{name: name for name in ("points.parquet", "hardware/op_4.6_0.9.yaml", "plugins/0_mine.py")},
    **{name: name for name in ("racing/00000.json", "racing/audit.json", "front_repeats.json")},
}
OPTIONAL = ("notes.json", "views.json", "warnings.json", "audit.json")


def at(name: str, harm: Callable[[Path], object]) -> Plant:
    return lambda study: harm(study / name)


def swapped(one: str, other: str) -> Plant:
    def swap(study: Path) -> None:
        (study / one).rename(study / "between")
        (study / other).rename(study / one)
        (study / "between").rename(study / other)

    return swap


def copied(one: str, other: str) -> Plant:
    def copy(study: Path) -> None:
        (study / other).parent.mkdir(parents=True, exist_ok=True)
        is_folder = (study / one).is_dir()
        (shutil.copytree if is_folder else shutil.copy)(study / one, study / other)

    return copy


def copied_away(one: str, other: str) -> Plant:
    return lambda study: (copied(one, other)(study), store.remove(study / one))


def removed(*names: str) -> Plant:
    return lambda study: [store.remove(study / name) for name in names]


def foreign(name: str) -> Plant:
    """Return what puts a file or a folder of the other study in place of one."""

    def plant(study: Path) -> None:
        store.remove(study / name)
        source = Path("another") / "tiny" / name
        (shutil.copytree if source.is_dir() else shutil.copy)(source, study / name)

    return plant


def rewritten(name: str, change: Callable[[Any], Any]) -> Plant:
    """Return what changes a sealed JSON file as if dse had written it."""
    return lambda study: store.write_json(study / name, change(store.read_json(study / name)))


def retabled(name: str, change: Callable[[pd.DataFrame], pd.DataFrame]) -> Plant:
    """Return what changes a table as if dse had written it, with the note on what it was made from."""

    def plant(study: Path) -> None:
        path = study / name
        store.write_table(path, change(held.read(path)), store.made_from(path))

    return plant


def lines_of(change: Callable[[list[bytes]], list[bytes]]) -> Plant:
    def plant(study: Path) -> None:
        path = study / "journal.log"
        path.write_bytes(b"".join(change(path.read_bytes().splitlines(keepends=True))))

    return plant


def up_to_trial(n: int) -> Callable[[list[bytes]], list[bytes]]:
    """Return what leaves the lines of a journal before that which creates a trial."""

    def change(lines: list[bytes]) -> list[bytes]:
        place = next(i for i, line in enumerate(lines) if json.loads(line).get("trial") == n)
        return lines[:place]

    return change


def killed_in_an_audit(study: Path) -> None:
    """Leave what earlier versions did: no record of a design in the audit, and no checkpoint at its rung."""
    store.remove(study / "artefacts" / "00009")
    about = {"trial": 9, "repeat": 0, "states": 1, "training": "", "epochs": 9, "rungs": {}}
    target = store.run_folder(study / "checkpoints" / "00009", 9, 0)
    store.save_run(
        target, about, {"state.npz": lambda path: store.save_arrays(path, {"epochs": np.array(9)})}
    )


def of_trial(trial: int) -> Plant:
    """Return what leaves a checkpoint of a trial."""
    about = {"trial": trial, "repeat": 0, "states": 1, "training": "", "epochs": 2}
    return lambda study: store.save_run(
        store.run_folder(study / "checkpoints" / "00002", trial, 0), about, {}
    )


def other_numbers(path: Path) -> None:
    store.write_sealed_text(
        path, store.read_sealed_text(path).replace("4.6", "4.7").replace("op_4.7", "op_4.6")
    )


def another_seed(record: dict[str, Any]) -> dict[str, Any]:
    return record | {"seed": 8}


def doubled(lines: list[bytes]) -> list[bytes]:
    return [*lines[:5], lines[4], *lines[5:]]


LAST_RUNS = [f"artefacts/{trial:05d}" for trial in range(6, 12)]
STATE = "checkpoints/00005/artefacts/00011/repeat_0"
KINDS = {**INSIDE, "missing": store.remove, "unsealed": unseal}
"""What may happen to the content of a file."""
NO_FILES = {x.__name__: x for x in (a_folder, a_pipe, a_dangling_link)}
"""What may lie in place of a file."""


def rotated(harms: dict[str, Callable[[Path], object]], names: Iterable[str], n: int) -> dict[str, Plant]:
    """Return n harms to each file, in turn: every harm is done, and every file is harmed."""
    turn = itertools.cycle(harms.items())
    return {f"{harm} {name}": at(name, do) for name in names for harm, do in itertools.islice(turn, n)}


WHOLE: dict[str, tuple[Plant, str]] = {
    **{
        name: (plant, NEEDED.get(name.split()[1], name.split()[1]))
        for name, plant in {
            **rotated(KINDS, NEEDED, 4),
            **rotated(INSIDE, OPTIONAL, 2),
            **rotated(NO_FILES, (*NEEDED, *OPTIONAL, "page.html", ".lock", ".notes.lock"), 1),
            **rotated({"unreadable": unreadable}, ("journal.log", WEIGHTS, "racing/audit.json", "racing"), 1),
            **rotated({"unreadable": unreadable}, (RUN, "points.parquet", ".lock"), 1),
            **rotated({"a_pipe": a_pipe}, (RUN, "artefacts", "racing"), 1),
            **rotated({"a_dangling_link": a_dangling_link}, ("artefacts/00003", "hardware", "queue"), 1),
        }.items()
    },
    **{
        f"of another study: {name}": (foreign(name), named)
        for name, named in (NEEDED | {"artefacts/00003": RUN}).items()
        if name not in ("hardware/op_4.6_0.9.yaml", "plugins/0_mine.py")
    },
    "a run removed": (removed("artefacts/00003"), "artefacts/00003"),
    "a stopped run removed": (removed("artefacts/00002"), "artefacts/00002"),
    "an audited run removed": (removed("artefacts/00009"), "artefacts/00009"),
    "the second run of a design removed": (removed("artefacts/00011/repeat_1"), "artefacts/00011/repeat_1"),
    "the first run of a design removed": (removed("artefacts/00011/repeat_0"), "artefacts/00011/repeat_0"),
    "all runs of a batch removed": (removed(*LAST_RUNS), "artefacts/00006"),
    "all runs removed": (removed("artefacts", "queue"), "artefacts/00000"),
    "a run renamed to another trial": (copied_away("artefacts/00003", "artefacts/00033"), "artefacts/00033"),
    "a run renamed to another repeat": (
        copied_away(RUN, "artefacts/00003/repeat_1"),
        "artefacts/00003/repeat_1",
    ),
    "a run renamed": (copied_away(RUN, "artefacts/00003/old"), "artefacts/00003/old"),
    "a run doubled": (copied("artefacts/00003", "artefacts/00012"), "artefacts/00012"),
    "a run doubled beside": (copied(RUN, f"{RUN} (copy)"), f"{RUN} (copy)"),
    "runs swapped": (swapped("artefacts/00003", "artefacts/00004"), "artefacts/00003"),
    "records swapped": (swapped(f"{RUN}/record.json", "artefacts/00004/repeat_0/record.json"), RUN),
    "weights swapped": (swapped(WEIGHTS, "artefacts/00004/repeat_0/weights.npz"), RUN),
    "a file doubled in a run": (copied(WEIGHTS, f"{RUN}/weights (copy).npz"), f"{RUN}/weights (copy).npz"),
    "a run of another seed": (rewritten(f"{RUN}/record.json", another_seed), RUN),
    "a run of another design": (
        rewritten(f"{RUN}/record.json", lambda x: x | {"design": x["design"] | {"model.true_rate": 0.2}}),
        RUN,
    ),
    "a record of a newer schema": (rewritten(f"{RUN}/record.json", lambda x: x | {"schema": 99}), RUN),
    "a record without numbers": (
        rewritten(f"{RUN}/record.json", lambda x: {k: v for k, v in x.items() if k != "columns"}),
        RUN,
    ),
    "precisions of two runs swapped": (
        swapped(
            "artefacts/00005/repeat_0/precision_4_0.0.npz", "artefacts/00011/repeat_0/precision_4_0.0.npz"
        ),
        "artefacts/00005/repeat_0/precision_4_0.0.npz",
    ),
    "a precision under another name": (
        copied(
            "artefacts/00005/repeat_0/precision_4_0.0.npz", "artefacts/00005/repeat_0/precision_8_0.0.npz"
        ),
        "artefacts/00005/repeat_0/precision_8_0.0.npz",
    ),
    "a precision cut": (
        at("artefacts/00005/repeat_0/precision_4_0.0.npz", cut),
        "artefacts/00005/repeat_0/precision_4_0.0.npz",
    ),
    "a precision removed": (removed("artefacts/00005/repeat_0/precision_4_0.0.npz"), "points.parquet"),
    "a journal without its last trials": (lines_of(up_to_trial(10)), "journal.log"),
    "a journal without a line": (lines_of(lambda lines: [*lines[:4], *lines[5:]]), "journal.log"),
    "a journal with a line twice": (lines_of(doubled), "journal.log"),
    "a journal with lines swapped": (
        lines_of(lambda lines: [*lines[:4], lines[5], lines[4], *lines[6:]]),
        "journal.log",
    ),
    "half a last line": (lines_of(lambda lines: [*lines[:-1], lines[-1][:40]]), "journal.log"),
    "a bit of the last line": (
        lines_of(lambda lines: [*lines[:-1], lines[-1].replace(b"e", b"f", 1)]),
        "journal.log",
    ),
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
    "tables of a run that has changed": (
        rewritten(f"{RUN}/record.json", lambda x: x | {"leak": ""}),
        "points.parquet",
    ),
    "racing: batches swapped": (swapped("racing/00000.json", "racing/00001.json"), "racing/00000.json"),
    "racing: a batch removed": (removed("racing/00000.json"), "racing/00000.json"),
    "racing: all removed": (removed("racing"), "racing/00000.json"),
    "racing: an unknown trial in the audit": (
        rewritten("racing/audit.json", lambda x: x | {"trials": [9, 99]}),
        "racing/audit.json",
    ),
    "racing: a finished design in the audit": (
        rewritten("racing/audit.json", lambda x: x | {"trials": [3]}),
        "racing/audit.json",
    ),
    "racing: an audit without trials": (rewritten("racing/audit.json", lambda _: {}), "racing/audit.json"),
    "racing: an audit of the recordings": (swapped("racing/audit.json", "audit.json"), "racing/audit.json"),
    "racing: rounds without rungs": (
        rewritten("racing/00000.json", lambda x: {"rounds": [{"trials": [1]}]}),
        "racing/00000.json",
    ),
    "racing: killed in an audit": (killed_in_an_audit, "checkpoints/00009/artefacts/00009"),
    "a checkpoint of a finished run": (of_trial(3), "checkpoints/00002/artefacts/00003"),
    "a checkpoint of an unknown trial": (of_trial(40), "checkpoints/00002/artefacts/00040"),
    "front_repeats of an unknown trial": (
        rewritten("front_repeats.json", lambda x: {"rounds": [{"repeats": {"77": 2}}]}),
        "front_repeats.json",
    ),
    "notes and views swapped": (swapped("notes.json", "views.json"), "notes.json"),
    "warnings and sessions swapped": (swapped("warnings.json", "environment.json"), "warnings.json"),
    "a profile of another name": (
        at("hardware/op_4.6_0.9.yaml", lambda x: x.rename(x.with_name("loihi2_board.yaml"))),
        "hardware/loihi2_board.yaml",
    ),
    "a profile of other numbers": (
        lambda study: other_numbers(study / "hardware" / "op_4.6_0.9.yaml"),
        "hardware/op_4.6_0.9.yaml",
    ),
    "an enqueued design that is cut": (
        lambda study: cut(next((study / "queue").iterdir())),
        "queue/000001_",
    ),
    "an enqueued folder": (lambda study: a_folder(next((study / "queue").iterdir())), "queue/000001_"),
}
PAUSED: dict[str, tuple[Plant, str]] = {
    **{f"{harm} state": (at(f"{STATE}/state.npz", function), STATE) for harm, function in INSIDE.items()},
    **{f"{harm} record": (at(f"{STATE}/record.json", function), STATE) for harm, function in INSIDE.items()},
    "a checkpoint removed": (removed(STATE), "checkpoints/00002/artefacts/00011"),
    "a checkpoint of other epochs": (
        copied_away("checkpoints/00005", "checkpoints/00003"),
        "checkpoints/00003/artefacts/00011",
    ),
    "a checkpoint of a stopped design beyond its rung": (
        copied("checkpoints/00002/artefacts/00006", "checkpoints/00009/artefacts/00006"),
        "checkpoints/00009/artefacts/00006",
    ),
    "checkpoints in no folder": (at("checkpoints", a_pipe), "checkpoints"),
    "checkpoints of two designs swapped": (
        swapped("checkpoints/00002/artefacts/00006", "checkpoints/00002/artefacts/00007"),
        "checkpoints/00002/artefacts/00006",
    ),
    "rounds removed": (removed("racing/00001.json"), "racing/00001.json"),
    "rounds cut": (at("racing/00001.json", cut), "racing/00001.json"),
    "tables removed": (removed("trials.parquet", "points.parquet"), "trials.parquet"),
}


def named_by_doctor(study: Path, capsys: pytest.CaptureFixture[str]) -> list[str]:
    code = main(["doctor", str(study), "--json"])
    out = capsys.readouterr().out
    rows = json.loads(out)["rows"] if code else []
    assert code == (1 if rows else 0), out
    return [row["file"] for row in rows]


@pytest.mark.parametrize("name", [*WHOLE, *PAUSED])
def test_a_planted_fault_is_named(
    whole: Study, paused: Path, another: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    source, (plant, expected) = (whole.folder, WHOLE[name]) if name in WHOLE else (paused, PAUSED[name])
    study = Path(shutil.copytree(source, tmp_path / "results" / "tiny"))
    plant(study)
    found = named_by_doctor(study, capsys)
    assert any(file.startswith(expected) for file in found), found


def test_nothing_is_named_of_healthy_studies(whole: Study, paused: Path, another: Path, capsys) -> None:
    for study in (whole.folder, paused, another):
        assert named_by_doctor(study, capsys) == []


def same_tables(study: Study, whole: Study) -> None:
    for one, other in ((study.trials, whole.trials), (study.points(), whole.points())):
        assert_frame_equal(one.drop(columns="train_s"), other.drop(columns="train_s"), check_exact=True)


def test_the_list_has_more_than_a_hundred_faults() -> None:
    assert len(WHOLE) + len(PAUSED) > 100


NOT_MENDED = ("a record of a newer schema",)
"""What another version of dse reads."""
TOGETHER = (
    (
        *("a run removed", "a stopped run removed", "the second run of a design removed"),
        *("half a last line", "cut notes.json", "an enqueued design that is cut"),
    ),
    ("weights swapped", "an audited run removed", "a bit of the last line", "a precision cut"),
    ("a run renamed to another trial", "a journal without its last trials", "tables swapped"),
    ("a journal without a line", "racing: all removed", "a_folder .lock", "a run of another seed"),
    ("racing: killed in an audit", "a checkpoint of a finished run", "points without a row"),
    ("runs swapped", "racing: batches swapped", "a_pipe journal.log", "cut environment.json"),
    (
        "all runs of a batch removed",
        "a precision removed",
        "longer racing/audit.json",
        "a_folder trials.parquet",
    ),
    ("cut state", "rounds removed", "tables removed"),
    ("a checkpoint removed", "checkpoints of two designs swapped"),
)
"""Faults that are mended together: each alone takes a second (`make faults`)."""
ALONE = [(name,) for name in (*WHOLE, *PAUSED) if "FAULTS" in os.environ and name not in NOT_MENDED]


@pytest.mark.parametrize("faults", [*TOGETHER, *ALONE], ids=", ".join)
def test_a_repaired_study_ends_with_the_tables_it_had(
    whole: Study,
    paused: Path,
    another: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    faults: tuple[str, ...],
) -> None:
    source = whole.folder if faults[0] in WHOLE else paused
    study = Path(shutil.copytree(source, tmp_path / "results" / "tiny"))
    for name in faults:
        (WHOLE | PAUSED)[name][0](study)
    main(["doctor", str(study), "--repair"])
    capsys.readouterr()
    explore.run(load_space("tiny.yaml"), tmp_path / "results", progress=False)
    same_tables(Study(study), whole)
    assert named_by_doctor(study, capsys) == []


def test_readers_leave_out_a_trial_whose_run_is_missing(
    whole: Study, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = Path(shutil.copytree(whole.folder, tmp_path / "tiny"))
    lost = 5
    assert {lost} & {*dse.open(whole.folder).skyline().rows["trial"]}
    store.remove(study / "artefacts" / f"{lost:05d}" / "repeat_1")
    for command in ("skyline", "pick"):
        assert main([command, str(study), "--json"]) == 0
        answer = json.loads(capsys.readouterr().out)
        assert any(f"trial {lost} is left out" in note for note in answer["notes"]), answer["notes"]
        assert answer["rows"] and all(row["trial"] != lost for row in answer["rows"])
    drawn = json.loads(_printed(capsys, "skyline", str(study), "--draws", "20", "--json"))
    assert "front_probability" in drawn["rows"][0]
    _printed(capsys, "dashboard", str(study), "--html", str(tmp_path / "page.html"))
    assert f"trial {lost} is left out" in json.dumps(page_data.held(tmp_path / "page.html")["notes"])


def test_readers_say_what_tables_lack_that_are_older_than_the_records(
    whole: Study, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = Path(shutil.copytree(whole.folder, tmp_path / "tiny"))
    late = study / "artefacts" / "00011"
    late.rename(study / "later")
    tables.write_again(study)
    (study / "later").rename(late)
    for command in ("skyline", "pick"):
        notes_of = json.loads(_printed(capsys, command, str(study), "--json"))["notes"]
        assert any("11 of the 12 trials" in note and "trial 11" in note for note in notes_of), notes_of
    assert set(named_by_doctor(study, capsys)) == {"trials.parquet", "points.parquet"}
    assert main(["doctor", str(study), "--repair"]) == 0
    capsys.readouterr()
    notes_of = json.loads(_printed(capsys, "skyline", str(study), "--json"))["notes"]
    assert not any("trial 11" in note for note in notes_of)
    same_tables(Study(study), whole)


def test_a_table_cut_short_is_named_by_who_reads_it(
    whole: Study, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = Path(shutil.copytree(whole.folder, tmp_path / "tiny"))
    content = (study / "points.parquet").read_bytes()
    (study / "points.parquet").write_bytes(content[: len(content) // 2])
    assert held.remarks(study) == []
    assert main(["skyline", str(study)]) == 2
    assert "points.parquet" in capsys.readouterr().err


def _printed(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main([*arguments]) == 0
    return capsys.readouterr().out


def test_run_says_how_many_of_its_trials_the_tables_hold(
    patched: Path, whole: Study, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def stopped(*arguments: Any) -> Iterator[Any]:
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
