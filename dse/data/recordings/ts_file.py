"""The text files of the archive of time series (.ts): a line is a recording, its channels and its class.

After `@data`, colons part the channels of a recording and its class, commas the samples of a channel; ? is a
missing sample. Source: timeseriesclassification.com, as aeon and sktime read it.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dse.base.records import Floats
from dse.data.recordings import RecordingError


def read(path: Path) -> tuple[list[Floats], list[str]]:
    """Return the samples of each recording, (step, channel), and their classes.

    Raises:
        RecordingError: samples have time stamps, no class or no number follows, or channels differ in length.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    except OSError as error:
        raise RecordingError(f"{path.name}: cannot be read: {error.strerror or error}") from error
    labels, signals = zip(*_rows(path, lines), strict=True)
    return list(signals), list(labels)


def _rows(path: Path, lines: list[str]) -> Iterator[tuple[str, Floats]]:
    """Yield the class and the samples, (step, channel), of each recording."""
    marks = [line.strip().lower() for line in lines]
    if "@data" not in marks:
        raise RecordingError(f"{path.name}: must have a line @data, got none in {len(lines)} lines")
    begin, width = marks.index("@data") + 1, 0
    tags = {words[0]: words[1] for line in marks[:begin] if len(words := line.split()) > 1}
    has_stamps, is_labelled = (tags.get(tag) == "true" for tag in ("@timestamps", "@classlabel"))
    if has_stamps or not is_labelled:
        got = "@timeStamps true" if has_stamps else "no @classLabel true"
        raise RecordingError(f"{path.name}: must have samples without times and a class, got {got}")
    for number, line in enumerate(lines[begin:], begin + 1):
        if not marks[number - 1]:
            continue
        *channels, label = line.strip().split(":")
        where = f"{path.name}, line {number}"
        try:
            values = [np.array(x.replace("?", "nan").split(","), float) for x in channels]
        except ValueError as error:
            raise RecordingError(f"{where}: {error}") from None
        lengths, width = sorted({*map(len, values)}), width or len(values)
        if len(lengths) != 1 or len(values) != width:
            got = f"{len(values)} channels of {', '.join(map(str, lengths)) or 'no'} samples"
            raise RecordingError(f"{where}: must have {width or 'some'} channels of one length, got {got}")
        if "," in label:
            raise RecordingError(
                f"{where}: must end with a class, got '{label[:40]}', as if it were cut short"
            )
        yield label.strip(), np.stack(values, axis=1)
    if not width:
        raise RecordingError(f"{path.name}: no recording after @data")
