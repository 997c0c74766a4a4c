"""Commands that begin: the example study, a first search space for recordings, and public recordings."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from dse.base.registry import Rule
from dse.base.text import one_line
from dse.cli.answer import Answer, listing, wrapped
from dse.cli.asking import answered, is_person
from dse.cli.signature import Amount, number
from dse.data.recordings.table import UNITS_MS

if TYPE_CHECKING:
    from dse.data.look import Look


def example(*, results: str = "results") -> Answer:
    """Put the example study, which the documentation reads, into a folder.

    Args:
        results (DIR): folder for studies (default: results).
    """
    from dse import store
    from dse.config.locate import shipped_folder

    folder = Path(results) / "example"
    if folder.exists():
        raise store.StoreError(f"{folder}: exists; choose another folder with --results, or remove it")
    with store.published(folder) as new:
        made_here = shutil.ignore_patterns(".lock", "page.html", "checkpoints")  # in a clone
        shutil.copytree(shipped_folder("results") / "example", new, ignore=made_here)
    return Answer([{"study": str(folder)}], text=f"{folder}\nnext: dse dashboard {shlex.quote(str(folder))}")


def init(
    data: str,
    *,
    label: str | None = None,
    labels: str | None = None,
    group: str | None = None,
    step_ms: Amount = None,
    time_unit: Annotated[str | None, Rule(choices=tuple(UNITS_MS))] = None,
    recording: str | None = None,
    signal: str | None = None,
    out: str | None = None,
    force: bool = False,
    format: str | None = None,
) -> Answer:
    """Write a first search space for your recordings, and say what it assumes about them.

    Args:
        data: a table (.csv, .tsv, .txt, .parquet), arrays (.npz, .npy, .mat, .h5, .ts), or a folder of event
            files.
        label (COLUMN): label column to predict (default: guessed).
        labels (FILE): file of the labels: a table or arrays (default: looked for beside DATA).
        group (COLUMN): label column whose values stay in one part of the split, e.g. session (default:
            guessed).
        step_ms: sampling period in ms, if the file does not tell.
        time_unit: unit of the column of times (default: guessed).
        recording (COLUMN): column that tells recordings apart.
        signal (NAME): array of samples (default: the largest).
        out (FILE): where to write (default: the name of DATA with .yaml, in this folder).
        force: replace the file if it exists.
    """
    from dse.api.first import write

    options = {"step_ms": step_ms or None, "time_unit": time_unit, "labels": labels, "signal": signal}
    options |= {"recording": recording}
    first = write(data, out, label, group, options, force=force, ask_step_ms=_step_ms, ask_label=_label)
    row, place = first.row, first.file
    parts = ", ".join(f"{row[part]} {part}" for part in ("train", "validation", "test") if part in row)
    n = f"{row['trained']} designs, {first.n_recordings} recordings"
    lines = [
        *listing([("-", sentence) for sentence in first.assumed]).splitlines(),
        wrapped(f"{place}: {n}{f' ({parts})' if parts else ''}"),
        f"next: dse audit {shlex.quote(str(place))}",
        f"      dse run {shlex.quote(str(place))}",
    ]
    return Answer([row], list(first.assumed) if format == "json" else (), text="\n".join(lines))


def _step_ms() -> float | None:
    """Return the sampling period that is asked for; None without an answer."""
    text = answered("Sampling period in ms")
    return number(text, low=0) if text else None


def _label(look: Look, likely: str) -> str:
    """Return the label column that is asked for where there is a person to ask, else the likely one."""
    names = list(look.n_values)
    if len(names) < 2 or not is_person():
        return likely
    print(listing([(name, f"{look.n_values[name]} values") for name in names]), file=sys.stderr)
    while (name := answered("Label column to predict", likely)) not in names:
        print(one_line(f"must be one of {', '.join(names)}, got '{name}'"), file=sys.stderr)
    return name


def prepare(set: str | None = None, source: Path | None = None, *, out: Path | None = None) -> Answer:
    """Convert public recordings, as their authors publish them, to what the shipped search spaces read.

    Args:
        set (SET): name of a set (without one: list all).
        source: folder with the authors' files.
        out (DIR): folder of recordings, where search spaces look files up (default: $DSE_DATA).
    """
    from dse.data.recordings import RecordingError
    from dse.data.recordings import prepare as preparing

    if set is None:
        rows = [
            {
                "set": name,
                "file": one.file,
                "origin": one.origin,
                "licence": one.licence or "none stated",
                "converted from": ", ".join(one.files),
            }
            for name, one in preparing.sets().items()
        ]
        return Answer(rows, all_rows=True)
    preparing.named(set)
    if source is None:
        raise RecordingError(f"prepare {set} needs SOURCE, the folder with the authors' files")
    folder = out or os.environ.get("DSE_DATA")
    if not folder:
        raise RecordingError("prepare needs --out DIR, or DSE_DATA, the folder of recordings")
    written = preparing.prepare(set, source, Path(folder))
    answers = {True: "yes", False: "no, other recordings", None: "in no search space"}
    rows = [{"file": str(path), "as in the published results": answers[x]} for path, x in written.items()]
    return Answer(rows)
