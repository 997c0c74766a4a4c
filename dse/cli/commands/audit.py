"""`dse audit`: what could pass for skill in the recordings and the split of a search space."""

from __future__ import annotations

import dataclasses
import tempfile
from dataclasses import dataclass
from pathlib import Path

from dse.cli.answer import FORMATS, Answer
from dse.cli.audits import audit_answer
from dse.cli.fields import formats, option
from dse.cli.options import OfSpace, load

GROUP = "search"
HELP = "find what could pass for skill in recordings and split: position in time, twins, sessions and others"


@dataclass(frozen=True, kw_only=True)
class Arguments(OfSpace):
    """The arguments."""

    shifts: tuple[int, ...] = option(
        "STEPS",
        "move windows by these steps, and print one row for each (default: an eighth of their length, both "
        "ways)",
        (),
    )
    format: str | None = formats(FORMATS)


def answer(arguments: Arguments) -> Answer:
    """Audit a search space, store the audit for `dse check` and `dse run`, and return its rows."""
    space = load(arguments)
    from dse.audit import audit, record
    from dse.dataset import cache
    from dse.study.progress import Lines

    with tempfile.TemporaryDirectory() as instead:
        root, note = cache.opened_root(Path(instead))
        result = audit(space, root, arguments.shifts, Lines().doing)
        if not note:
            record.save(result, space, root)
    table = audit_answer(result)
    return dataclasses.replace(table, notes=[*table.notes, *filter(None, [note])])
