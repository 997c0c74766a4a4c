"""FabricSlide: a finger with 16 taxels slides along seven fabrics, and over two gratings.

A file `FABRIC_F<force setting>_V<mm/s, signed>mmps_<repetition>.csv` is a recording: a row per sample,
columns `timestamp` (ms), `proximity1`, `proximity2`, `channel1` to `channel16` (counts). The result lays the
recordings end to end, ordered by fabric, force, velocity and repetition. Repetitions 0 and 1 train and
validate; the others are a file of their own.

Source: `src/pcan_interface.cpp` (rows), `src/verticalSlideOnFabric.cpp` (names) and `python/TacDataset.py` of
github.com/wngfra/FabricSlide; Wang et al., Frontiers in Neurorobotics 16:808222, 2022.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dse.base.records import Array
from dse.base.registry import register
from dse.data.recordings import RecordingError
from dse.data.recordings.prepare import Converted, folder

FILES = ("data/fabric/*.csv", "data/board/*.csv")
_PATTERN = "*_F*_V*mmps_*.csv"
_NAME = re.compile(r"([A-Za-z0-9]+)_F(\d+)_V([-+]?\d+)mmps_(\d+)\.csv")
_COLUMNS = ["timestamp", "proximity1", "proximity2", *(f"channel{taxel}" for taxel in range(1, 17))]
_TRAINED = 2
"""Repetitions that train and validate."""


@dataclass(frozen=True, order=True)
class _Slide:
    """A recording: what its file name says."""

    fabric: str
    force: int
    velocity: int
    repetition: int
    path: Path


@register("datasets", "fabric_slide")
@dataclass(frozen=True)
class FabricSlide:
    """A finger slides along seven fabrics."""

    file: ClassVar[str] = "fabric_slide/fabric_slide_train_val.npz"
    origin: ClassVar[str] = "github.com/wngfra/FabricSlide at eceb771"
    licence: ClassVar[str] = "MIT"
    files: ClassVar[tuple[str, ...]] = FILES
    digest: ClassVar[str] = "1512ad369e099b1a5fc78885da5dadc9a760fbb02dfccb660378240d6fddcf3b"

    def convert(self, source: Path) -> Converted:
        """Return the recordings of the fabrics, and those of the gratings if they are there.

        Raises:
            RecordingError: there are no recordings, or a file holds something else.
        """
        files = folder(source, "data/fabric", _PATTERN)
        slides = _slides(files)
        parts = {
            "fabric_slide_train_val.npz": [one for one in slides if one.repetition < _TRAINED],
            "fabric_slide_test.npz": [one for one in slides if one.repetition >= _TRAINED],
        }
        parts["gratings_board.npz"] = _slides(sorted((files[0].parent.parent / "board").glob(_PATTERN)))
        return Converted(
            [one.path for part in parts.values() for one in part],
            {name: _arrays(part) for name, part in parts.items() if part},
        )


def _slides(files: Sequence[Path]) -> list[_Slide]:
    matches = [(path, _NAME.fullmatch(path.name)) for path in files]
    if wrong := [path for path, match in matches if match is None]:
        raise RecordingError(f"{wrong[0]}: must be named FABRIC_F<force>_V<velocity>mmps_<repetition>.csv")
    return sorted(
        _Slide(match[1], int(match[2]), int(match[3]), int(match[4]), path)
        for path, match in matches
        if match is not None
    )


def _arrays(slides: Sequence[_Slide]) -> dict[str, Array]:
    rows = [_rows(one.path) for one in slides]
    names = sorted({one.fabric for one in slides})
    start = np.array([table[0, 0] for table in rows], np.int64)
    lengths = [len(table) for table in rows]
    samples = np.concatenate(rows)
    return {
        "signal": samples[:, 3:].astype(np.uint16),
        "t_ms": (samples[:, 0] - np.repeat(start, lengths)).astype(np.uint32),
        "proximity1": samples[:, 1].astype(np.uint16),
        "offsets": np.cumsum([0, *lengths], dtype=np.int64),
        "label": np.array([names.index(one.fabric) for one in slides], np.int16),
        "class_names": np.array(names),
        "force_setting": np.array([one.force for one in slides], np.int16),
        "velocity_mm_s": np.array([one.velocity for one in slides], np.int16),
        "repetition": np.array([one.repetition for one in slides], np.int8),
        "start_timestamp_ms": start,
    }


def _rows(path: Path) -> Array:
    """Return the samples of a file, (sample, column)."""
    try:
        with path.open(encoding="ascii") as file:
            header = [name.strip() for name in file.readline().split(",")]
            rows = np.loadtxt(file, np.int64, delimiter=",", ndmin=2) if header == _COLUMNS else None
    except (OSError, ValueError) as error:
        raise RecordingError(f"{path}: {str(error).splitlines()[0]}") from None
    if rows is None or rows.shape[1] != len(_COLUMNS) or not len(rows):
        raise RecordingError(f"{path}: must have samples of columns {', '.join(_COLUMNS)}")
    if (rows < 0).any() or (rows[:, 1:] >= 2**16).any() or (np.diff(rows[:, 0]) < 0).any():
        raise RecordingError(f"{path}: must hold counts from 0 to 65535 and times that do not fall")
    return rows
