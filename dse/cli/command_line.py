"""Arguments in, exit code out."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

import dse
from dse.cli.answer import Answer, show
from dse.cli.commands import commands_by_name
from dse.cli.stopping import INTERRUPTED
from dse.config import ConfigError

EXIT_CODES = (
    "exit codes: 0 success; 1 nothing could be trained, or a study is damaged; 2 bad input, every fault on "
    "stderr; 3 no design point meets the budgets; 4 a target that was faithful is so no longer; "
    "130 stopped by Ctrl-C"
)
_BAD_INPUT = 2
_RESUMABLE = "stopped; finished trials are kept, and the same command resumes the study"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code; print users' mistakes on stderr, one line each."""
    try:
        parsed = _parser().parse_args(arguments)
        answer: Answer = parsed.answer(parsed)
        show(answer, parsed.command, getattr(parsed, "format", None))
        sys.stdout.flush()
    except KeyboardInterrupt as stopped:
        print(*(stopped.args or (_RESUMABLE,)), file=sys.stderr)
        return getattr(stopped, "code", INTERRUPTED)
    except BrokenPipeError:
        # The reader (`| head`) has closed the pipe; the interpreter must not flush into it again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except ConfigError as error:
        print(error, file=sys.stderr)
        return _BAD_INPUT
    except OSError as error:
        print(f"{error.filename or 'dse'}: {error.strerror or error}", file=sys.stderr)
        return _BAD_INPUT
    except MemoryError:
        print("dse: out of memory; nothing that has finished is lost", file=sys.stderr)
        return _BAD_INPUT
    except UnicodeEncodeError as error:
        print(f"dse: a name or text must be UTF-8, got {error.object!r}", file=sys.stderr)
        return _BAD_INPUT
    except Exception as error:
        if not isinstance(error, _users_mistakes()):
            raise
        print(error, file=sys.stderr)
        return _BAD_INPUT
    return answer.code


def _users_mistakes() -> tuple[type[Exception], ...]:
    """Return the errors whose text is written for users; imported only after an error."""
    from dse.dashboard.views import ViewError
    from dse.deploy.bundle import BundleError
    from dse.native.extras import MissingExtra
    from dse.recordings import RecordingError
    from dse.report.compare import SetupError
    from dse.skyline.constraints import ExpressionError
    from dse.skyline.table import TableError
    from dse.store import StoreError

    return (
        *(ExpressionError, BundleError, RecordingError, SetupError, TableError, StoreError, ViewError),
        MissingExtra,
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="dse",
        description="Design space exploration of spiking classifiers for touch.",
        epilog=EXIT_CODES,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"dse {dse.__version__}")
    subparsers = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, module in commands_by_name().items():
        subparser = subparsers.add_parser(
            name, help=module.HELP, description=module.HELP, epilog=EXIT_CODES, allow_abbrev=False
        )
        module.add_arguments(subparser)
        subparser.set_defaults(answer=module.answer)
    return parser
