"""`dse merge`: two studies of one search space as one."""

from __future__ import annotations

from dataclasses import MISSING, dataclass
from pathlib import Path

from dse.cli.answer import Answer
from dse.cli.fields import argument, formats, option

GROUP = "search"
HELP = "join two studies of one search space: equal designs once, with the repeats of both"


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The arguments."""

    first: str = argument("A", "folder of a study")
    second: str = argument("B", "folder of another study")
    into: str = option("C", "folder of the new study; its name is the study's", MISSING)
    format: str | None = formats()


def answer(arguments: Arguments) -> Answer:
    """Write the joint study and return how many designs and runs it has."""
    from dse.study.merge import merge

    into = Path(arguments.into)
    counts = merge(Path(arguments.first), Path(arguments.second), into)
    return Answer([{"study": str(into), **counts}])
