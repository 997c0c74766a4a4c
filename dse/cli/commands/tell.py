"""`dse tell`: record values of a design that were measured elsewhere."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dse.cli.answer import Answer
from dse.cli.fields import argument, formats, option
from dse.config import ConfigError, Fault

GROUP = "search"
HELP = "record the values of a design of dse ask; the tables mark them as told"


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The arguments."""

    results: str = argument("RESULTS", "folder of a study")
    trial: int = argument("DESIGN", "number that dse ask gave the design")
    values: tuple[str, ...] = argument(
        "COLUMN=VALUE",
        "its values, such as accuracy=0.91 energy_uj=12.5; every objective of the study is needed",
        (),
    )
    failed: str = option("REASON", "the design has no values, and why", "")
    format: str | None = formats()


def answer(arguments: Arguments) -> Answer:
    """Record the values and return the row of the design."""
    told, faults = {}, []
    for text in arguments.values:
        name, _, value = text.partition("=")
        try:
            told[name] = float(value)
        except ValueError:
            faults.append(Fault(f"'{text}'", 0, "must be COLUMN=VALUE with a number, such as accuracy=0.91"))
    if bool(arguments.values) == bool(arguments.failed):
        faults.append(Fault("dse tell", 0, "needs values, such as accuracy=0.91, or --failed REASON"))
    if faults:
        raise ConfigError(faults)
    from dse.study.outside import tell

    row = tell(Path(arguments.results), arguments.trial, told, arguments.failed)
    return Answer([row])
