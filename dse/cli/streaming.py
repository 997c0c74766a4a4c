"""Decisions as samples or events arrive: what `dse stream` does."""

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
from dse.text import json_line, one_line

if TYPE_CHECKING:
    from dse.deploy.bundle import Bundle
    from dse.deploy.sources import End
    from dse.deploy.stream import Windows
    from dse.deploy.window import Decision

_COLUMNS = (
    *("recording", "window", "begin_ms", "time_ms", "answer"),
    *("confidence", "margin", "decided"),
)


@dataclass(frozen=True)
class Source:
    """Where samples or events come from: lines of a file or a serial port, or recordings.

    file: '-' or None: standard input. realtime: at their own pace.
    """

    file: str | None
    serial: str | None
    baud: int
    data: str | None
    realtime: bool


def stream(folder: str, source: Source, windows: Windows | None, as_json: bool) -> Answer:
    """Print the decisions of a bundle as they fall; return what is left to say at the end of the input."""
    from dse.deploy.bundle import read
    from dse.deploy.sources import End
    from dse.recordings import RecordingError

    sources = [name for name in ("file", "serial", "data") if getattr(source, name)]
    if len(sources) > 1:
        raise RecordingError(f"a stream must have one source, got {' and '.join(sources)}")
    recording, n_without, is_answered = 0, 0, False
    with ExitStack() as files, contextlib.suppress(KeyboardInterrupt):  # Ctrl-C ends a stream
        items = _decisions(read(folder), source, windows, files)
        if not as_json:
            print(",".join(_COLUMNS), flush=True)
        for item in items:
            if isinstance(item, End):
                n_without += item.n_open > 0 and not is_answered
                recording, is_answered = recording + 1, False
            else:
                is_answered = True
                _print(item, recording, as_json)
    notes = [f"{n_without} of {recording} recordings ended before an answer"] if n_without else []
    return Answer([], notes, is_printed=True)


def windows(
    where: Literal["once", "restart", "onset"] | None, every: int | None, first: int
) -> Windows | None:
    """Return where windows begin; None: as in training.

    Raises:
        RecordingError: options that exclude or need each other.
    """
    from dse.deploy.stream import Windows
    from dse.recordings import RecordingError

    if every and where:
        raise RecordingError("--every is a rule of its own and excludes --window")
    if first < 0:
        raise RecordingError(f"--first must be >= 0, got {first}")
    if first and not (every or where):
        raise RecordingError("--first needs --window or --every")
    if every:
        return Windows("every", every, first)
    return Windows(where, 0, first) if where else None


def _decisions(
    bundle: Bundle, source: Source, windows: Windows | None, files: ExitStack
) -> Iterator[Decision | End]:
    from dse.deploy import sources
    from dse.deploy.stream import Stream

    if source.data:
        return sources.played(
            bundle, sources.recordings_of_file(bundle, source.data, windows), source.realtime
        )
    taken = Stream(bundle, windows).input
    if source.serial:
        name, chunks = source.serial, sources.chunks_of_serial(source.serial, source.baud)
    elif source.file in (None, "-"):
        name, chunks = "standard input", sources.chunks_of_file(sys.stdin.fileno())
    else:
        name = source.file
        chunks = sources.chunks_of_file(files.enter_context(open(name, "rb")).fileno())
    recordings = sources.recordings_of_lines(chunks, taken, name, windows)
    return sources.played(bundle, recordings, source.realtime)


def _print(decision: Decision, recording: int, as_json: bool) -> None:
    row = {"recording": recording, **decision._asdict()}
    if as_json:
        print(json_line(json.dumps(row, ensure_ascii=False)))
    else:
        if sys.stdout.isatty():
            row["answer"] = one_line(decision.answer or "")
        csv.writer(sys.stdout, lineterminator="\n").writerow(row[name] for name in _COLUMNS)
    sys.stdout.flush()
