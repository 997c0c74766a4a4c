"""Arguments in, exit code out."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

import dse
from dse.base import trust
from dse.base.registry import left_out
from dse.base.text import lines, one_line
from dse.cli.answer import Answer, show
from dse.cli.asking import trusts
from dse.cli.commands import MODULE_OF, function_of
from dse.cli.signature import call, declare, summary
from dse.cli.stopping import INTERRUPTED
from dse.config import ConfigError
from dse.config.faults import known_names

EXIT_CODES = (
    "exit codes: 0 success; 1 nothing could be trained, or a study is damaged; 2 bad input, every fault on "
    "stderr; 3 no design point meets the budgets; 4 a target shows less than its verdict; "
    "130 stopped by Ctrl-C"
)
_TRUST = "run the code of plugins that the folder or search space names, now and whenever it is the same"
_TRUSTING = ("search", "choose", "drawing", "reporting", "deploy", "streaming")
_BAD_INPUT = 2
_RESUMABLE = "stopped; finished trials are kept, and the same command resumes the study"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code; print users' mistakes on stderr, one line each."""
    words = sys.argv[1:] if arguments is None else arguments
    try:
        if words and not words[0].startswith("-") and words[0] not in MODULE_OF:
            known = known_names(words[0], MODULE_OF)
            print(f"dse: unknown command '{one_line(words[0])}'; {known}", file=sys.stderr)
            return _BAD_INPUT
        parsed = parser(words[:1]).parse_args(words)
        left_out()  # forget those of an earlier call in this process
        with trust.answering(getattr(parsed, "trust", False) or trusts):
            answer: Answer = call(parsed.function, parsed)
        show(answer, parsed.command, getattr(parsed, "format", None), getattr(parsed, "columns", None))
        sys.stdout.flush()
    except KeyboardInterrupt as stopped:
        print(*(stopped.args or (_RESUMABLE,)), file=sys.stderr)
        return getattr(stopped, "code", INTERRUPTED)
    except BrokenPipeError:
        # The reader (`| head`) has closed the pipe; the interpreter must not flush into it again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except ConfigError as error:
        return _refused(str(error))
    except OSError as error:
        return _refused(f"{error.filename or 'dse'}: {error.strerror or error}")
    except MemoryError:
        return _refused("dse: out of memory; nothing that has finished is lost")
    except UnicodeEncodeError as error:
        return _refused(f"dse: a name or text must be UTF-8, got {error.object!r}")
    except Exception as error:
        if not isinstance(error, _users_mistakes()):
            raise
        return _refused(str(error))
    return answer.code


def _refused(text: str) -> int:
    """Print an error; one about an unknown name may be that of a plugin that was not run."""
    reasons = left_out() if "unknown" in text else ()
    print(lines("\n".join((text, *reasons))), file=sys.stderr)
    return _BAD_INPUT


def _users_mistakes() -> tuple[type[Exception], ...]:
    """Return the errors whose text is written for users; imported only after an error."""
    from dse.base.native.extras import MissingExtra
    from dse.data.recordings import RecordingError
    from dse.deploy.bundle import BundleError
    from dse.show.dashboard.views import ViewError
    from dse.show.report import ReportError
    from dse.skyline.constraints import ExpressionError
    from dse.skyline.table import TableError
    from dse.store import StoreError

    return (
        *(ExpressionError, BundleError, RecordingError, ReportError, TableError, StoreError, ViewError),
        MissingExtra,
    )


def parser(words: Sequence[str]) -> argparse.ArgumentParser:
    """Return the parser of a command, or without one of all commands, for `dse --help`."""
    outer = argparse.ArgumentParser(
        prog="dse",
        description="Design space exploration of spiking classifiers for touch.",
        epilog=EXIT_CODES,
        allow_abbrev=False,
    )
    outer.add_argument("--version", action="version", version=f"dse {dse.__version__}")
    commands = outer.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name in [word for word in words if word in MODULE_OF] or MODULE_OF:
        function = function_of(name)
        text = summary(function)
        one = commands.add_parser(name, help=text, description=text, epilog=EXIT_CODES, allow_abbrev=False)
        declare(one, function)
        if MODULE_OF[name] in _TRUSTING:
            one.add_argument("--trust", action="store_true", help=_TRUST)
        one.set_defaults(function=function)
    return outer
