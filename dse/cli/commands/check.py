"""`dse check`: every fault of a search space, and what a run would do."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from dse.cli.answer import Answer, listing
from dse.cli.fields import formats
from dse.cli.options import OfSpace, load, overrides_of
from dse.config import ConfigError, SearchSpace
from dse.config.yaml_lines import in_file_order, read_document
from dse.study.preview import is_large, preview
from dse.study.refusals import refusals

GROUP = "search"
HELP = "check a search space without training: list every fault, or what a run would do"
_BAD_INPUT = 2


@dataclass(frozen=True, kw_only=True)
class Arguments(OfSpace):
    """The arguments."""

    format: str | None = formats()


def answer(arguments: Arguments) -> Answer:
    """Return a preview of the study, or with `--json` its faults, which are printed on stderr too.

    Raises:
        ConfigError: the faults, without `--json`.
    """
    try:
        space = load(arguments)
        _refuse(space, arguments)
        row = preview(space)
    except ConfigError as error:
        if arguments.format != "json":
            raise
        print(error, file=sys.stderr)
        return Answer([vars(fault) for fault in error.faults], code=_BAD_INPUT)
    doubts = row.pop("doubts", [])
    assert isinstance(doubts, list)  # as `preview` has it
    return Answer([row], doubts, text=listing([(name, _text(value)) for name, value in row.items()]))


def _refuse(space: SearchSpace, arguments: Arguments) -> None:
    """Raise a ConfigError of all that a run would refuse, each with the line of its key."""
    if is_large(space):
        return
    document = read_document(space.source, overrides_of(arguments.set))
    faults = [document.fault(path, message) for path, message in refusals(space)]
    if faults:
        raise in_file_order(faults)


def _text(value: object) -> str:
    if isinstance(value, list):
        return ", ".join(map(str, value)) or "none"
    if isinstance(value, dict):
        return ", ".join(f"{name} {_text(inner)}" for name, inner in value.items())
    return "unlimited" if value is None else str(value)
