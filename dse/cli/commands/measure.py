"""`dse measure`: time and energy of an exported classifier on this machine."""

from __future__ import annotations

from dataclasses import dataclass

from dse.cli.answer import FORMATS, Answer
from dse.cli.fields import argument, formats, option

GROUP = "deploy"
HELP = "measure time and energy of an exported classifier on this machine: as a stream and as C"


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The arguments."""

    bundle: str = argument("BUNDLE", "folder written by `dse pick --export`")
    data: str | None = option(
        "RECORDINGS",
        "recordings in the format of the training data (default: random input spikes, 2 % of channels and "
        "steps)",
    )
    rest: float = option("S", "time at rest in seconds (default: 5)", 5.0, low=0)
    format: str | None = formats(FORMATS)


def answer(arguments: Arguments) -> Answer:
    """Return one row per engine."""
    from dse.deploy.bundle import read
    from dse.deploy.measure import measure

    times = measure(read(arguments.bundle), arguments.data, max(arguments.rest, 0.1))
    notes = [f"{each.engine}: {_not_measured(each.reason)}" for each in times if each.reason]
    return Answer([each.columns for each in times], notes)


def _not_measured(reason: str) -> str:
    return f"energy_uj is empty: {reason}" if "counter" in reason else reason
