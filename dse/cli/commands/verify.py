"""`dse verify`: run the targets of a bundle again, on this machine and these recordings."""

from __future__ import annotations

from dataclasses import MISSING, dataclass

from dse.cli.answer import Answer
from dse.cli.fields import argument, formats, option

GROUP = "deploy"
HELP = "run the targets of a bundle on recordings and compare all decisions and spikes"
_UNVERIFIED = 2


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The arguments."""

    bundle: str = argument("BUNDLE", "folder with targets that `dse export` wrote")
    data: str = option("RECORDINGS", "recordings in the format of the training data", MISSING)
    target: tuple[str, ...] = option("NAME", "target to run (default: all of the bundle); repeatable", ())
    format: str | None = formats()


def answer(arguments: Arguments) -> Answer:
    """Return the verdict on every target, beside that of the bundle."""
    from dse.cli import verdicts
    from dse.deploy.verify import verify

    verified = verify(arguments.bundle, arguments.data, arguments.target)
    drifts = verdicts.drifts(verified)
    unverified = any(each.verdict.kind == "not verified" for each in verified.values())
    code = verdicts.DRIFT if drifts else _UNVERIFIED if unverified else 0
    return Answer(verdicts.rows(verified), drifts, code=code)
