"""`dse init`: a first search space for recordings, with what was assumed about them."""

from __future__ import annotations

import dataclasses
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dse.cli.answer import Answer, listing, wrapped
from dse.cli.asking import asked, is_person
from dse.cli.fields import argument, flag, formats, number, option
from dse.recordings.table import UNITS_MS
from dse.text import one_line

if TYPE_CHECKING:
    from dse.data.look import Look

GROUP = "begin"
HELP = "write a first search space for your recordings, and say what it assumes about them"


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The arguments."""

    data: str = argument(
        "DATA", "a table (.csv, .tsv, .parquet), arrays (.npz, .npy, .mat, .h5), or a folder of event files"
    )
    label: str | None = option("COLUMN", "label column to predict (default: guessed)")
    labels: str | None = option(
        "FILE", "file of the labels: a table or arrays (default: looked for beside DATA)"
    )
    group: str | None = option(
        "COLUMN", "label column whose values stay in one part of the split, e.g. session (default: guessed)"
    )
    step_ms: float | None = option("N", "sampling period in ms, if the file does not tell", low=0)
    time_unit: str | None = option(
        "", "unit of the column of times (default: guessed)", choices=tuple(UNITS_MS)
    )
    recording: str | None = option("COLUMN", "column that tells recordings apart")
    signal: str | None = option("NAME", "array of samples (default: the largest)")
    out: str | None = option("FILE", "where to write (default: the name of DATA with .yaml, in this folder)")
    force: bool = flag("replace the file if it exists")
    format: str | None = formats()


def answer(arguments: Arguments) -> Answer:
    """Look at the data, write the search space, check it, and return what was assumed."""
    from dse.data import look as looking
    from dse.door import first

    path = Path(arguments.data)
    out = first.place_of(path, arguments.out, arguments.force)
    options = looking.Options(
        step_ms=arguments.step_ms or None,
        time_unit=arguments.time_unit,
        labels=arguments.labels,
        signal=arguments.signal,
        recording=arguments.recording,
        base=out.parent,
    )
    look = looking.look(path, options)
    if look.lacks_step and (step_ms := asked("Sampling period in ms")):
        look = dataclasses.replace(
            look, data=look.data | {"step_ms": number(step_ms, low=0)}, lacks_step=False
        )
    seen = first.seen(path.name, look, out)
    label = arguments.label or _label(look, seen.likely)
    written = first.write(seen, label, arguments.group)
    row = written.row
    parts = ", ".join(f"{row[part]} {part}" for part in ("train", "validation", "test") if part in row)
    ends = [
        wrapped(
            f"{out}: {row['designs']} designs, {seen.recordings.n_recordings} "
            f"recordings{f' ({parts})' if parts else ''}"
        ),
        f"next: dse audit {shlex.quote(str(out))}",
        f"      dse run {shlex.quote(str(out))}",
    ]
    text = "\n".join(listing([("-", sentence) for sentence in written.assumed]).splitlines() + ends)
    return Answer([row], list(written.assumed) if arguments.format == "json" else (), text=text)


def _label(look: Look, likely: str) -> str:
    """Return the label column that is asked for where there is a person to ask, else the likely one."""
    names = list(look.n_values)
    if len(names) < 2 or not is_person():
        return likely
    print(listing([(name, f"{look.n_values[name]} values") for name in names]), file=sys.stderr)
    while True:
        name = asked("Label column to predict", likely)
        if name in names:
            return name
        print(one_line(f"must be one of {', '.join(names)}, got '{name}'"), file=sys.stderr)
