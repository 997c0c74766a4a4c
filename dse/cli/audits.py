"""An audit as the answer of a command."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dse.cli.answer import Answer

if TYPE_CHECKING:
    from dse.audit import Audit

_SHOWN = (
    *("task", "probe", "reader", "accuracy", "se", "chance", "without", "test"),
    *("shortcut", "verdict", "remedy"),
)


def audit_answer(audit: Audit) -> Answer:
    """Return the rows of an audit; a terminal shows the task where there are several."""
    several = len({row.task for row in audit.rows}) > 1
    shown = [name for name in _SHOWN if name != "task" or several]
    return Answer([row.columns for row in audit.rows], audit.notes, shown, all_rows=True)
