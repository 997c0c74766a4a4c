"""`dse enqueue`: designs to train next, also while the study runs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dse.cli.answer import Answer
from dse.cli.fields import argument, formats
from dse.cli.options import InResults, load

GROUP = "search"
HELP = "train designs of your choice next; a running study begins them after its batch"


@dataclass(frozen=True, kw_only=True)
class Arguments(InResults):
    """The arguments."""

    designs: str = argument(
        "FILE", "a YAML file: a mapping of axes to values, such as model.hidden: 40, or a list of these"
    )
    format: str | None = formats()


def answer(arguments: Arguments) -> Answer:
    """Append the designs to the queue of the study, and return them."""
    space = load(arguments)
    from dse.study import queue

    designs = queue.read_designs(space, Path(arguments.designs))
    folder = Path(arguments.results) / space.study
    queue.add(folder, designs)
    n = f"{len(designs)} design{'s' if len(designs) > 1 else ''}"
    return Answer(designs, [f"{n} enqueued in {folder}; `dse run` trains them"])
