"""`dse export`: write a bundle's classifier for targets, run them, and state what differs."""

from __future__ import annotations

from dataclasses import MISSING, dataclass

from dse.cli.answer import Answer
from dse.cli.fields import argument, formats, option
from dse.cli.options import Verifying

GROUP = "deploy"
HELP = "write the classifier of a bundle for targets (C, microcontrollers, NIR, ...) and verify them by a run"


@dataclass(frozen=True, kw_only=True)
class Arguments(Verifying):
    """The arguments."""

    bundle: str = argument("BUNDLE", "folder written by `dse pick --export`")
    target: tuple[str, ...] = option("NAME", "target to write (`dse describe targets`); repeatable", MISSING)
    prefix: str | None = option(
        "NAME_",
        "of the names and files in C, so that several classifiers live in one program: texture_ gives "
        "texture_init and texture.h (default: that of the bundle, dse_ at first)",
    )
    format: str | None = formats()


def answer(arguments: Arguments) -> Answer:
    """Return the verdict on every target; the bundle holds their files and verdicts then."""
    from dse.cli import verdicts
    from dse.deploy.verify import export_targets

    verified = export_targets(arguments.bundle, arguments.target, arguments.verify, arguments.prefix)
    drifts = verdicts.drifts(verified)
    return Answer(verdicts.rows(verified), drifts, code=verdicts.DRIFT if drifts else 0)
