"""Ridged textures stroked by a rigid prosthetic finger with 9 taxels, from its authors' MATLAB figures.

`<texture>_50_Bionic_touch_figure.fig` is a figure of a recording. MATLAB keeps figures as .mat files whose
structure `hgS_070000` nests `children`, each with `type` and `properties`; a line has `YData`, here the volts
of one taxel at 100 Hz, NaN where a sample is missing. One count is 5/1024 volts. Nothing public says in which
order the figures hold their lines: the order, as stored or backwards, is the one whose recordings have the
known checksum; without one, the set is refused. The first 35 strokes train and validate; the rest is a file
of its own.

Source: folder `Raw Texture data/Rigid prosthetic finger raw texture data` of
github.com/ssankar6/SciAdv-Hybrid_robotics_with_tactile_sensing; Sankar et al., Science Advances, 2025. No
public code reads its .mat files.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dse.base.records import Array
from dse.base.registry import register
from dse.data.recordings import RecordingError
from dse.data.recordings.prepare import Converted, digest, folder

FOLDER = "Raw Texture data/Rigid prosthetic finger raw texture data"
FILES = (f"{FOLDER}/*_50_Bionic_touch_figure.fig",)
DIGEST = "db1ef939c56a49f8b6806ab75a9903e680a74d91d959a7982def007ec3e025cd"
"""Of the part that trains and validates."""
_END = "_50_Bionic_touch_figure.fig"
_TAXELS, _TEXTURES = 9, 26
_TRAINED = 35 * 517
"""Samples that train and validate: strokes of 517."""
_VOLTS_PER_COUNT = 5 / 1024
_PERIOD_SAMPLES = 516.9
_PERIODS_SAMPLES = {"Soft_Flat": 517.0}
"""Length of a stroke, by autocorrelation of the recording."""


@register("datasets", "sankar")
@dataclass(frozen=True)
class Sankar:
    """Ridged textures stroked by a rigid prosthetic finger."""

    file: ClassVar[str] = "sankar_ridged_textures/sankar_rigid_finger_train_val.npz"
    origin: ClassVar[str] = "github.com/ssankar6/SciAdv-Hybrid_robotics_with_tactile_sensing at d657260"
    licence: ClassVar[str] = ""
    files: ClassVar[tuple[str, ...]] = FILES
    digest: ClassVar[str] = DIGEST

    def convert(self, source: Path) -> Converted:
        """Return the strokes that train and validate, and the rest.

        Raises:
            RecordingError: a figure is missing or holds something else, or no order of lines gives the known
                recordings.
        """
        files = folder(source, FOLDER, f"*{_END}")
        if len(files) != _TEXTURES:
            text = f"must have {_TEXTURES} figures *{_END}, has {len(files)}"
            raise RecordingError(f"{files[0].parent}: {text}")
        files = sorted(files, key=lambda path: path.name.removesuffix(_END))
        names = [path.name.removesuffix(_END) for path in files]
        recordings = [_counts(path) for path in files]
        length = min(len(one) for one in recordings)
        stored = np.stack([one[:length] for one in recordings])
        for adc in (stored, stored[:, :, ::-1]):
            part = _arrays(adc[:, :_TRAINED], names)
            if digest(part) == DIGEST:
                rest = _arrays(adc[:, _TRAINED:], names)
                parts = {"sankar_rigid_finger_train_val.npz": part, "sankar_rigid_finger_test.npz": rest}
                return Converted(files, parts)
        text = "no order of the figures' lines gives the recordings of the published results"
        raise RecordingError(f"{files[0].parent}: {text}")


def _arrays(adc: Array, names: list[str]) -> Mapping[str, Array]:
    return {
        "adc": np.ascontiguousarray(adc),
        "class_names": np.array(names),
        "sampling_hz": np.array(100.0),
        "volts_per_count": np.array(_VOLTS_PER_COUNT),
        "period_samples": np.array([_PERIODS_SAMPLES.get(name, _PERIOD_SAMPLES) for name in names]),
    }


def _counts(path: Path) -> Array:
    """Return the lines of a figure in the order of the file, (sample, line); -1 is a missing sample."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        figure = loadmat(path, struct_as_record=False, squeeze_me=True, variable_names=["hgS_070000"])
    except (OSError, ValueError, NotImplementedError, MatReadError) as error:
        raise RecordingError(f"{path}: is no figure of MATLAB: {str(error).splitlines()[0]}") from None
    lines = [line for line in _lines(figure.get("hgS_070000")) if len(line) >= _TRAINED]
    if len(lines) != _TAXELS or len({len(line) for line in lines}) > 1:
        text = f"{_TAXELS} lines of one length of {_TRAINED} or more"
        raise RecordingError(f"{path}: must hold {text}, got {[len(line) for line in lines]}")
    counts = np.stack(lines, axis=1) / _VOLTS_PER_COUNT
    whole = np.rint(np.nan_to_num(counts, nan=-1.0))
    return whole.astype(np.int16)


def _lines(node: Any) -> Iterator[Array]:
    """Yield the values of all lines below a node, in the order of the file."""
    for child in np.atleast_1d(np.asarray(getattr(node, "children", []), object)).ravel():
        values = getattr(getattr(child, "properties", None), "YData", None)
        if values is not None and "line" in str(getattr(child, "type", "")):
            yield np.atleast_1d(np.asarray(values, np.float64))
        yield from _lines(child)
