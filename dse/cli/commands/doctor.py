"""`dse doctor`: what is damaged in a study, what it costs, and its repair."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dse.cli.answer import Answer
from dse.cli.fields import argument, flag, formats

GROUP = "search"
HELP = "say what is damaged or missing in a study's folder and what it costs; repair what can be repaired"
_DAMAGED = 1


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The arguments."""

    results: str = argument("RESULTS", "folder of a study")
    repair: bool = flag(
        "remove damaged runs, checkpoints and copies, or move them aside; write the book and the "
        "tables again; convert the folder of an earlier version. `dse run` trains what is missing then"
    )
    format: str | None = formats()


def answer(arguments: Arguments) -> Answer:
    """Return a row per damage; exit code 1 while there is some that is not repaired."""
    from dse.study.doctor import examine, repair

    folder = Path(arguments.results)
    damages = examine(folder)
    rows = [{"file": x.file, "fault": x.fault, "cost": x.cost, "remedy": x.remedy} for x in damages]
    if not damages:
        return Answer([], text=f"{folder}: nothing is damaged")
    if not arguments.repair:
        mended = any(x.repair is not None for x in damages)
        left, notes = list(damages), [f"`dse doctor {folder} --repair` repairs what it can"] if mended else []
    else:
        left, notes = repair(folder)
        n_left = len({x.file for x in left} & {x.file for x in damages})
        notes += [f"{len(damages) - n_left} of {len(damages)} repaired"]
        notes += [f"not repaired: {x.file} {x.fault}; {x.remedy}" for x in left]
    return Answer(rows, notes, all_rows=True, code=_DAMAGED if left else 0)
