"""Decisions as samples or events arrive: what `dse stream` does."""

from __future__ import annotations

import contextlib
import csv
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from json import dumps
from typing import TYPE_CHECKING, Literal

from dse.base.text import json_line, one_line
from dse.cli.answer import Answer
from dse.cli.signature import Count

if TYPE_CHECKING:
    from dse.deploy.bundle import Bundle
    from dse.deploy.sources import End
    from dse.deploy.stream import Windows
    from dse.deploy.window import Decision

_COLUMNS = (
    *("recording", "window", "begin_ms", "time_ms", "answer"),
    *("confidence", "margin", "decided"),
)


def stream(
    bundle: str,
    file: str | None = None,
    *,
    data: str | None = None,
    window: Literal["once", "restart", "onset"] | None = None,
    every: Count = None,
    first: int = 0,
    json: bool = False,
) -> Answer:
    """Decide as samples or events arrive: from a pipe, a file or recordings.

    Args:
        file: text, a line per sample (a number of every channel), step (0 or 1 of every channel) or event
            (t_us x y polarity); an empty line ends a recording; -: standard input (default).
        data (RECORDINGS): play recordings in the format of the training data.
        window: where windows begin: once, at --first; restart: the next with the step after an answer; onset:
            at each onset of contact, by window.onset_threshold of the bundle (default: as in training: onset,
            or restart; of --data: where `dse evaluate` has the window).
        every: sliding windows: one begins every so many steps of the input.
        first: step of the first window (default: 0).
        json: print a JSON object per line (default: CSV).
    """
    from dse.data.recordings import RecordingError
    from dse.deploy.bundle import read
    from dse.deploy.sources import End

    if file and data:
        raise RecordingError("a stream must have one source, got file and data")
    windows = _windows(window, every, first)
    recording, n_without, is_answered = 0, 0, False
    with ExitStack() as files, contextlib.suppress(KeyboardInterrupt):  # Ctrl-C ends a stream
        items = _decisions(read(bundle), file, data, windows, files)
        if not json:
            print(",".join(_COLUMNS), flush=True)
        for item in items:
            if isinstance(item, End):
                n_without += item.n_open > 0 and not is_answered
                recording, is_answered = recording + 1, False
            else:
                is_answered = True
                _print(item, recording, json)
    notes = [f"{n_without} of {recording} recordings ended before an answer"] if n_without else []
    return Answer([], notes, is_printed=True)


def _windows(
    where: Literal["once", "restart", "onset"] | None, every: int | None, first: int
) -> Windows | None:
    """Return where windows begin; None: as in training."""
    from dse.data.recordings import RecordingError
    from dse.deploy.stream import Windows

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
    bundle: Bundle,
    file: str | None,
    data: str | None,
    windows: Windows | None,
    files: ExitStack,
) -> Iterator[Decision | End]:
    from dse.deploy import sources
    from dse.deploy.stream import Stream

    if data:
        return sources.played(bundle, sources.recordings_of_file(bundle, data, windows))
    taken = Stream(bundle, windows).input
    if file is None or file == "-":
        name, chunks = "standard input", sources.chunks_of_file(sys.stdin.fileno())
    else:
        name = file
        chunks = sources.chunks_of_file(files.enter_context(open(name, "rb")).fileno())
    recordings = sources.recordings_of_lines(chunks, taken, name, windows)
    return sources.played(bundle, recordings)


def _print(decision: Decision, recording: int, as_json: bool) -> None:
    row = {"recording": recording, **decision._asdict()}
    if as_json:
        print(json_line(dumps(row, ensure_ascii=False)))
    else:
        if sys.stdout.isatty():
            row["answer"] = one_line(decision.answer or "")
        csv.writer(sys.stdout, lineterminator="\n").writerow(row[name] for name in _COLUMNS)
    sys.stdout.flush()
