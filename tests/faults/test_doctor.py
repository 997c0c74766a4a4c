"""Planted faults, each of which `dse doctor` names, and after which a study ends with the tables it had."""

from __future__ import annotations

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

from dse import store
from dse.audit import record as audit
from dse.audit.audit import Audit
from dse.cli import main
from dse.config import ConfigError, SearchSpace, load_space
from dse.records import Array, Dataset, Network, Response
from dse.study import explore, held, notes, queue, saved_views
from dse.study.journal import read_journal
from dse.study.results import Study
from dse.study.workers import Workers
from tests import tiny_study
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
    with pytest.MonkeyPatch.context() as patch:
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
def another(patched: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study of the same name and designs, of another seed."""
    folder = tmp_path_factory.mktemp("another")
    shutil.copy(patched / "tiny.npz", folder)
    return explore.run(space_of(folder, seed=8), folder / "whole", progress=False).folder


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


@dataclass(frozen=True)
class Fault:
    """What is done to a study, and what `doctor` names of it.

    mends: whether `--repair` leaves nothing to `dse run`; None: not looked at.
    differs: columns of tables, or tables, that need not be as before.
    """

    name: str
    plant: Plant
    named: str
    is_paused: bool = False
    is_final: bool = False


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


def renamed(path: Path) -> None:
    path.rename(path.with_name(f"old_{path.name}"))


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


def removed(*names: str) -> Plant:
    return lambda study: [store.remove(study / name) for name in names]


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


def checkpoint(study: Path, epochs: int | None = None) -> Path:
    """Return the folder of a checkpoint."""
    return sorted(study.glob(f"checkpoints/{'*' if epochs is None else f'{epochs:05d}'}/artefacts/*/repeat_0"))[0]


def moved_on(study: Path) -> None:
    """Let a checkpoint claim epochs that its training has not had."""
    path = checkpoint(study)
    target = study / "checkpoints" / "00017" / Path(*path.parts[-3:])
    target.parent.mkdir(parents=True)
    path.rename(target)


def beyond(study: Path) -> None:
    """Leave what an earlier version did in an audit: no record, and a checkpoint beyond the rung."""
    stopped = store.read_json(study / "racing" / "00000.json")["rounds"][1]["stopped"][0]
    store.write_json(study / "racing" / "audit.json", {"designs": 6, "trials": [stopped["trial"]]})
    run = store.run_folder(study, stopped["trial"], 0)
    store.remove(run)
    about = {"trial": stopped["trial"], "repeat": 0, "states": 1, "training": "", "epochs": 9, "rungs": {}}
    target = store.run_folder(study / "checkpoints" / "00009", stopped["trial"], 0)
    store.save_run(target, about, {"state.npz": lambda path: store.save_arrays(path, {"epochs": np.array(9)})})


def of_a_finished_run(study: Path) -> None:
    about = {"trial": 3, "repeat": 0, "states": 1, "training": "", "epochs": 2}
    finished = next(
        (trial for trial in range(6) if store.read_record(store.run_folder(study, trial, 0))["status"] == "finished")
    )
    target = store.run_folder(study / "checkpoints" / "00002", finished, 0)
    store.save_run(target, about | {"trial": finished}, {})
