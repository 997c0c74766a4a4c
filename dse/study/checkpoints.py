"""Checkpoints: where trainings stand, on disk, so that a killed job repeats the last epochs alone.

    checkpoints/<epochs>/runs/<trial>-<repeat>.npz   the state from which the training goes on, with a record

So the folder of a rung is laid out as a study of trainings of so many epochs. A run has the newest
checkpoint alone, and none once it has ended.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from dse import store
from dse.base.records import Array
from dse.measure.numbers import Numbers
from dse.store import Damaged
from dse.study.record import RunRecord

_FOLDER, _STATE = "checkpoints", "state.npz"
SCHEMA = 1
"""Of states; a state of another schema is not used."""


@dataclasses.dataclass(frozen=True)
class Checkpoint:
    """A run that has trained some epochs.

    rungs: epochs -> what was measured there.
    """

    epochs: int
    folder: Path
    rungs: Mapping[int, Numbers]

    def state(self) -> dict[str, Array]:
        """Return the named arrays from which the training goes on."""
        return store.load_arrays(self.folder / _STATE)


def rung_folder(study: Path, epochs: int) -> Path:
    """Return the folder of the checkpoints after some epochs, which is laid out as a study."""
    return study / _FOLDER / f"{epochs:05d}"


def folders(study: Path, trial: int, repeat: int) -> dict[int, Path]:
    """Return epochs -> folder of the checkpoints of a run, the newest first."""
    root = study / _FOLDER
    names = [x.name for x in root.iterdir() if x.name.isdecimal()] if root.is_dir() else []
    places = {int(x): store.run_file(root / x, trial, repeat) for x in sorted(names, reverse=True)}
    return {epochs: folder for epochs, folder in places.items() if folder.is_file()}


def newest(study: Path, trial: int, repeat: int, training: str) -> Checkpoint | None:
    """Return the newest checkpoint of a run; damaged ones, and those of another training, are removed."""
    for epochs, folder in folders(study, trial, repeat).items():
        try:
            plain = store.load_run(folder)
            if plain is not None and made_as(plain, epochs) == (SCHEMA, epochs, training):
                rungs = {int(n): Numbers.from_plain(x) for n, x in plain.get("rungs", {}).items()}
                return Checkpoint(epochs, folder, rungs)
        except (Damaged, KeyError, TypeError, ValueError):
            pass
        store.remove(folder)
    return None


def made_as(plain: Mapping[str, Any], epochs: int) -> tuple[int, int, str]:
    """Return schema, epochs (by the folder, in records of earlier versions) and training of a checkpoint."""
    return plain["states"], plain.get("epochs", epochs), plain["training"]


def save(
    study: Path,
    epochs: int,
    training: str,
    record: Mapping[str, Any],
    state: Mapping[str, Array],
) -> None:
    """Publish a checkpoint of a run, then remove its older ones.

    A training of anything else than `training` cannot go on from its state. The record has at least trial and
    repeat; at a rung it is that of a run.
    """
    trial, repeat = int(record["trial"]), int(record["repeat"])
    path = store.run_file(rung_folder(study, epochs), trial, repeat)
    older = [folder for folder in folders(study, trial, repeat).values() if folder != path]
    about = {"states": SCHEMA, "training": training, "epochs": epochs}
    store.save_run(path, {**record, **about}, {_STATE: state}, replaces=True, compressed=False)
    for folder in older:
        store.remove(folder)


def remove(study: Path, trial: int, repeat: int) -> None:
    """Remove all checkpoints of a run."""
    for folder in folders(study, trial, repeat).values():
        store.remove(folder)


def forget(study: Path, ended: Collection[tuple[int, int]]) -> None:
    """Remove the checkpoints of runs (trial, repeat) that have ended, and the folder when it is empty."""
    root = study / _FOLDER
    if not root.is_dir():
        return
    every = list(root.glob(f"*/{store.RUNS}/*.npz"))
    left = [path for path in every if store.named(path) not in ended]
    for path in set(every) - set(left) if left else [root]:
        store.remove(path)


def at_rung(study: Path, trial: int, repeat: int, epochs: int) -> RunRecord | None:
    """Return the record of a run at a rung where it pauses; None: it stands elsewhere."""
    folder = store.run_file(rung_folder(study, epochs), trial, repeat)
    try:
        plain = store.load_run(folder)
        if plain is None or plain.get("status") != "finished" or plain.get("epochs", epochs) != epochs:
            return None
        return RunRecord.from_plain(plain, folder)
    except Damaged:
        return None
