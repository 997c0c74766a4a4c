"""A first search space for recordings, written to a file: what `dse init` and `dse.init` share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dse.config import ConfigError, load_space
from dse.data import look as looking
from dse.data import starter
from dse.data.look import Look, Options
from dse.recordings import RecordingError, Recordings
from dse.store import StoreError, write_text
from dse.study.preview import preview


@dataclass(frozen=True)
class Seen:
    """Recordings that a search space is to be written for, and the file that it goes to.

    name: of the recordings, for errors. likely: the column that most probably is the label.
    """

    name: str
    look: Look
    recordings: Recordings
    likely: str
    out: Path


@dataclass(frozen=True)
class First:
    """A search space that was written: the row of `dse check`, and what was assumed, one sentence each."""

    row: dict[str, object]
    assumed: tuple[str, ...]


def place_of(data: str | Path | Mapping[str, Any], out: str | Path | None, force: bool) -> Path:
    """Return the file of the search space.

    Raises:
        StoreError: it exists.
    """
    named = data.get("file") or data.get("folder") if isinstance(data, Mapping) else data
    path = Path(str(named))
    name = path.resolve().name if path.is_dir() else path.stem
    place = Path(out or f"{name or 'study'}.yaml")
    if place.exists() and not force:
        raise StoreError(f"{place}: exists already; --force replaces it, --out FILE writes another")
    return place


def seen(name: str, look: Look, out: Path, label: str | None = None) -> Seen:
    """Return recordings as a look at them says that they are read.

    Args:
        name: of the recordings, for errors.
        look: at them.
        out: file of the search space.
        label: the column to predict; None: guess it.

    Raises:
        RecordingError: the sampling period is not known, the recordings are faulty, or there is no label.
    """
    if look.lacks_step:
        raise RecordingError(f"{name}: the sampling period is not in the file; state it with --step-ms N")
    recordings = starter.read(look, out.parent)
    return Seen(name, look, recordings, label or starter.label_of(look, recordings), out)


def write(of: Seen, label: str, group: str | None) -> First:
    """Write the search space, and check it; a faulty one is not left.

    Raises:
        RecordingError: no such column, or no classes in it; a class has too few recordings for any split.
        ConfigError: the recordings fit no search space.
    """
    for option, column in (("--label", label), ("--group", group)):
        if column is not None and column not in of.look.n_values:
            if column == label and column in of.recordings.columns and column not in of.look.refused:
                starter.check_classes(of.recordings.columns[column], column)
            known = ", ".join(of.look.n_values) or "none"
            why = f"column '{column}' {of.look.refused[column]}; " if column in of.look.refused else ""
            raise RecordingError(
                f"{option} {column}: {why}must be a label column of {of.name}; there are {known}"
            )
    first = starter.starter(of.look, of.out, of.recordings, label, group)
    write_text(of.out, first.text)
    try:
        row = {"file": str(of.out), **preview(load_space(of.out, check_data=True))}
    except (ConfigError, RecordingError):
        of.out.unlink()  # nothing is left that does not run
        raise
    doubts = row.pop("doubts", [])
    assert isinstance(doubts, list)  # as `preview` has it
    return First(row, (*first.assumed, *doubts))


def init(
    data: str | Path | Mapping[str, Any],
    out: str | Path | None = None,
    *,
    label: str | None = None,
    group: str | None = None,
    force: bool = False,
    **options: Any,
) -> Path:
    """Write a first search space for recordings, as `dse init` does, and return its file for `dse.run`.

    Its first lines say what was assumed.

    Args:
        data: a file or a folder, or section `data` as `dse.data.from_arrays` and its like return it.
        out: where to write; None: the name of the data with .yaml, in this folder.
        label: label column to predict; None: guessed.
        group: label column whose values stay in one part of the split; None: guessed.
        force: replace the file if it exists.
        options: of a file or folder: step_ms, time_unit, labels, signal, recording, as of `dse init`.

    Raises:
        RecordingError: the data cannot be read, or lack what cannot be guessed.
        StoreError: the file exists.
        TypeError: an unknown option, or data of another type.

    >>> file = dse.init("touch.npz", "first.yaml", step_ms=4, group="session")
    >>> dse.load_space(file).objectives
    (('accuracy', 'max'), ('n_weights', 'min'), ('energy_uj', 'min'))
    """
    if not isinstance(data, str | Path | Mapping):
        raise TypeError(
            f"data must be a file, a folder, or section `data`, got {type(data).__name__}; "
            "dse.data.from_arrays(signals, labels, step_ms=...) makes the latter of arrays"
        )
    place = place_of(data, out, force)
    if isinstance(data, Mapping):
        if options:
            raise TypeError(f"section `data` states {', '.join(options)} itself")
        name, look = "data", starter.described(data, place.parent)
    else:
        name, look = Path(data).name, looking.look(Path(data), replace(Options(**options), base=place.parent))
    recordings = seen(name, look, place, label)
    write(recordings, recordings.likely, group)
    return place
