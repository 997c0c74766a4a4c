"""A first search space for recordings, written to a file: what `dse init` and `dse.init` share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dse.config import ConfigError, load_space
from dse.data import look as looking
from dse.data import starter
from dse.data.look import Look, Options
from dse.data.recordings import RecordingError
from dse.store import StoreError, write_text
from dse.study.preview import preview


@dataclass(frozen=True)
class First:
    """A search space that was written.

    file: where it is. row: of `dse check`. assumed: one sentence each. n_recordings: that it is for.
    """

    file: Path
    row: dict[str, object]
    assumed: tuple[str, ...]
    n_recordings: int


def write(
    data: str | Path | Mapping[str, Any],
    out: str | Path | None,
    label: str | None,
    group: str | None,
    options: Mapping[str, Any],
    *,
    force: bool = False,
    ask_step_ms: Callable[[], float | None] = lambda: None,
    ask_label: Callable[[Look, str], str] = lambda _, likely: likely,
) -> First:
    """Write a first search space, and check it; a faulty one is not left. Arguments and errors as of `init`.

    Args:
        data: recordings.
        out: where to write.
        label: label column to predict.
        group: label column whose values stay in one part of the split.
        options: of a file or folder.
        force: replace the file if it exists.
        ask_step_ms: returns the sampling period, where the recordings do not tell.
        ask_label: returns the label column, given the recordings and the likely one.
    """
    named = data.get("file") or data.get("folder") if isinstance(data, Mapping) else data
    path = Path(str(named))
    stem = path.resolve().name if path.is_dir() else path.stem
    place = Path(out or f"{stem or 'study'}.yaml")
    if place.exists() and not force:
        raise StoreError(f"{place}: exists already; --force replaces it, --out FILE writes another")
    if isinstance(data, Mapping):
        name, look = "data", starter.described(data, place.parent)
    else:
        name, look = path.name, looking.look(path, replace(Options(**options), base=place.parent))
    if look.lacks_step and (step_ms := ask_step_ms()):
        look = replace(look, data=look.data | {"step_ms": step_ms})
    if look.lacks_step:
        raise RecordingError(f"{name}: the sampling period is not in the file; state it with --step-ms N")
    recordings = starter.read(look, place.parent)
    label = label or ask_label(look, starter.label_of(look, recordings))
    for option, column in (("--label", label), ("--group", group)):
        if column is not None and column not in look.n_values:
            if column == label and column in recordings.columns and column not in look.refused:
                starter.check_classes(recordings.columns[column], column)
            known = ", ".join(look.n_values) or "none"
            why = f"column '{column}' {look.refused[column]}; " if column in look.refused else ""
            text = f"{option} {column}: {why}must be a label column of {name}; there are {known}"
            raise RecordingError(text)
    text, assumed = starter.starter(look, place, recordings, label, group)
    write_text(place, text)
    try:
        row = {"file": str(place), **preview(load_space(place, check_data=True))}
    except (ConfigError, RecordingError):
        place.unlink()  # nothing is left that does not run
        raise
    doubts = row.pop("doubts", [])
    assert isinstance(doubts, list)  # as `preview` has it
    return First(place, row, (*assumed, *doubts), recordings.n_recordings)


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
    if isinstance(data, Mapping) and options:
        raise TypeError(f"section `data` states {', '.join(options)} itself")
    return write(data, out, label, group, options, force=force).file
