"""`dse stream`: decisions as samples or events arrive."""

from __future__ import annotations

import contextlib
import csv
import json
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from dse.cli.answer import Answer
from dse.cli.fields import argument, flag, option
from dse.text import json_line, one_line

if TYPE_CHECKING:
    from dse.deploy.bundle import Bundle
    from dse.deploy.sources import End
    from dse.deploy.stream import Decision, Windows

GROUP = "deploy"
HELP = "decide as samples or events arrive: from a pipe, a file, a serial port or recordings"
_COLUMNS = (
    *("recording", "window", "begin_ms", "time_ms", "answer"),
    *("confidence", "margin", "decided"),
)


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The arguments."""

    bundle: str = argument("BUNDLE", "folder written by `dse pick --export`")
    file: str | None = argument(
        "FILE",
        "text, a line per sample (a number of every channel), step (0 or 1 of every channel) or event (t_us "
        "x y polarity); an empty line ends a recording; -: standard input (default)",
        None,
    )
    serial: str | None = option("PORT", "read the lines from this serial port, e.g. /dev/ttyACM0")
    baud: int = option("N", "of the serial port (default: 115200)", 115200, low=1)
    data: str | None = option("RECORDINGS", "play recordings in the format of the training data")
    realtime: bool = flag("play a file or recordings at their own pace, not at once")
    window: Literal["once", "restart", "onset"] | None = option(
        "",
        "where windows begin: once, at --first; restart: the next with the step after an answer; onset: at "
        "each onset of contact, by window.onset_threshold of the bundle (default: as in training: onset, or "
        "restart; of --data: where `dse evaluate` has the window)",
        choices=("once", "restart", "onset"),
    )
    every: int | None = option("K", "sliding windows: one begins every K steps of the input", low=1)
    first: int = option("STEP", "step of the first window (default: 0)", 0)
    json: bool = flag("print a JSON object per line (default: CSV)")


def answer(arguments: Arguments) -> Answer:
    """Print decisions as they fall; return what is left to say at the end of the input."""
    from dse.deploy.bundle import read
    from dse.deploy.sources import End
    from dse.recordings import RecordingError

    sources = [name for name in ("file", "serial", "data") if getattr(arguments, name)]
    if len(sources) > 1:
        raise RecordingError(f"a stream must have one source, got {' and '.join(sources)}")
    windows = _windows(arguments)
    recording, n_without, is_answered = 0, 0, False
    with ExitStack() as files, contextlib.suppress(KeyboardInterrupt):  # Ctrl-C ends a stream
        items = _decisions(read(arguments.bundle), arguments, windows, files)
        if not arguments.json:
            print(",".join(_COLUMNS), flush=True)
        for item in items:
            if isinstance(item, End):
                n_without += item.n_open > 0 and not is_answered
                recording, is_answered = recording + 1, False
            else:
                is_answered = True
                _print(item, recording, arguments.json)
    notes = [f"{n_without} of {recording} recordings ended before an answer"] if n_without else []
    return Answer([], notes, is_printed=True)


def _windows(arguments: Arguments) -> Windows | None:
    from dse.deploy.stream import Windows
    from dse.recordings import RecordingError

    if arguments.every and arguments.window:
        raise RecordingError("--every is a rule of its own and excludes --window")
    if arguments.first < 0:
        raise RecordingError(f"--first must be >= 0, got {arguments.first}")
    if arguments.every:
        return Windows("every", arguments.every, arguments.first)
    if arguments.window:
        return Windows(arguments.window, 0, arguments.first)
    if arguments.first:
        raise RecordingError("--first needs --window or --every")
    return None


def _decisions(
    bundle: Bundle, arguments: Arguments, windows: Windows | None, files: ExitStack
) -> Iterator[Decision | End]:
    from dse.deploy import sources
    from dse.deploy.stream import Stream

    if arguments.data:
        return sources.replayed(bundle, arguments.data, windows, arguments.realtime)
    recordings = Stream(bundle, windows).input
    if arguments.serial:
        name, chunks = arguments.serial, sources.chunks_of_serial(arguments.serial, arguments.baud)
    elif arguments.file in (None, "-"):
        name, chunks = "standard input", sources.chunks_of_file(sys.stdin.fileno())
    else:
        name = arguments.file
        chunks = sources.chunks_of_file(files.enter_context(open(name, "rb")).fileno())
    items = sources.items_of_lines(chunks, recordings, name)
    if arguments.realtime:
        items = sources.paced(items, recordings.step_ms)
    return sources.played(bundle, items, windows)


def _print(decision: Decision, recording: int, as_json: bool) -> None:
    row = {"recording": recording, **decision._asdict()}
    if as_json:
        print(json_line(json.dumps(row, ensure_ascii=False)))
    else:
        if sys.stdout.isatty():
            row["answer"] = one_line(decision.answer or "")
        csv.writer(sys.stdout, lineterminator="\n").writerow(row[name] for name in _COLUMNS)
    sys.stdout.flush()
