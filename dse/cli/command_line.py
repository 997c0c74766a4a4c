"""Arguments in, exit code out."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

import dse
from dse.cli.answer import Answer, show
from dse.cli.commands import check, cost, dashboard, describe, evaluate, pick, report, run, simulate, skyline
from dse.config import ConfigError

COMMANDS = (check, run, skyline, pick, evaluate, report, dashboard, simulate, cost, describe)
_BAD_INPUT = 2
_STOPPED = 130
_GOES_ON = "stopped; what was finished is kept, and the same command goes on"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code; users' mistakes are one line each on stderr."""
    given = _parser().parse_args(arguments)
    try:
        answer: Answer = given.answer(given)
        show(answer, given.command, getattr(given, "format", None))
        sys.stdout.flush()
    except KeyboardInterrupt as stopped:
        print(*(stopped.args or (_GOES_ON,)), file=sys.stderr)
        return _STOPPED
    except BrokenPipeError:
        # The reader (`| head`) has gone; the interpreter must not try to flush into it again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except ConfigError as error:
        print(error, file=sys.stderr)
        return _BAD_INPUT
    except OSError as error:
        print(f"{error.filename or 'dse'}: {error.strerror or error}", file=sys.stderr)
        return _BAD_INPUT
    except Exception as error:
        if not isinstance(error, _users_mistakes()):
            raise
        print(error, file=sys.stderr)
        return _BAD_INPUT
    return answer.code


def _users_mistakes() -> tuple[type[Exception], ...]:
    """Return the errors whose text is written for users; imported only once something went wrong."""
    from dse.deploy.bundle import BundleError
    from dse.recordings import RecordingError
    from dse.skyline.constraints import ExpressionError
    from dse.skyline.front import TableError
    from dse.store import StoreError

    return ExpressionError, BundleError, RecordingError, TableError, StoreError


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="dse",
        description="Design space exploration of spiking classifiers for touch.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"dse {dse.__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for module in COMMANDS:
        name = module.__name__.rsplit(".", 1)[-1]
        one = commands.add_parser(name, help=module.HELP, description=module.HELP, allow_abbrev=False)
        module.add_arguments(one)
        one.set_defaults(answer=module.answer)
    return parser
