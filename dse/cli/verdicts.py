"""Verdicts of targets as an answer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from dse.cli.answer import Answer, Row

if TYPE_CHECKING:
    from dse.deploy.verdict import Verdict
    from dse.deploy.verify import Verified

DRIFT = 4
"""Exit code where a target that was faithful or equivalent is less."""


def answer(verified: Mapping[str, Verified], code: int = 0) -> Answer:
    """Return a row per target, with what its bundle states or stated, and a sentence where it is less."""
    drifts = [
        f"target {name} was {each.before.kind} and is {each.verdict.kind}: {each.verdict.reason}"
        for name, each in verified.items()
        if each.drifts and each.before is not None
    ]
    rows = [
        {**row(name, each.verdict), "before": None if each.before is None else each.before.kind}
        for name, each in verified.items()
    ]
    return Answer(rows, drifts, code=DRIFT if drifts else code)


def row(name: str, verdict: Verdict) -> Row:
    """Return the row of a verdict; numbers of runs are None where nothing was run."""
    ran = verdict.n_recordings > 0
    return {
        "target": name,
        "verdict": verdict.kind,
        "run_by": ", ".join(verdict.run_by) if ran else None,
        "recordings": verdict.n_recordings if ran else None,
        "decisions_differ": verdict.decisions_differ if ran else None,
        "spikes_differ": verdict.spikes_differ if ran else None,
        "largest_difference": verdict.largest_difference if ran else None,
        "output_f1": verdict.output_f1,
        **verdict.figures,
        **({"compiler": verdict.compiler} if verdict.compiler else {}),
        "reason": verdict.reason,
    }
