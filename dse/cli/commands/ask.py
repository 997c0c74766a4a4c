"""`dse ask`: the designs that the sampler proposes next, for measurements elsewhere."""

from __future__ import annotations

from dataclasses import dataclass

from dse.cli.answer import Answer
from dse.cli.fields import formats, option
from dse.cli.options import InResults, load

GROUP = "search"
HELP = "print the design that the sampler proposes next, with its number, to be measured elsewhere"


@dataclass(frozen=True, kw_only=True)
class Arguments(InResults):
    """The arguments."""

    n: int = option("N", "number of designs (default: 1)", 1, low=1)
    format: str | None = formats()


def answer(arguments: Arguments) -> Answer:
    """Propose designs, write them to the study, and return them as YAML."""
    space = load(arguments)
    import yaml

    from dse.store import plain
    from dse.study.outside import ask

    asked, notes = ask(space, arguments.results, arguments.n)
    rows = [{"trial": trial, "design": plain(design)} for trial, design in asked]
    text = yaml.safe_dump(rows, sort_keys=False).rstrip() if rows else ""
    return Answer(rows, notes, text=text, code=0 if rows else 1)
