"""The iCub's skin on 20 materials: the authors' test part.

Their file holds (recording, 6, 10, step): the patch of 6 x 10 taxels over 75 steps, in float32. The result is
(recording, step, taxel), taxel = 10 * row + column, as stored: the plugin `icub_roboskin` puts it back into
the order of time. Labels number the materials.

Source: Taunyazov et al., IROS 2020; Gao et al., IROS 2020.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dse.base.records import Array
from dse.base.registry import register
from dse.data.recordings import RecordingError
from dse.data.recordings.prepare import Converted, folder

FILES = ("temp_data/icub_test.npy", "temp_data/labels_test.npy")
_PATCH = (6, 10, 75)


@register("datasets", "icub")
@dataclass(frozen=True)
class ICub:
    """The iCub's skin on 20 materials."""

    file: ClassVar[str] = "icub_roboskin20_test/icub_roboskin20_test200.npz"
    origin: ClassVar[str] = "github.com/tasbolat1/transfer_learning at a745c42"
    licence: ClassVar[str] = ""
    files: ClassVar[tuple[str, ...]] = FILES
    digest: ClassVar[str] = "38edd90a1bdc10a5f124f4be9c586ba4ebe774df2bd5546d3bf5027273c70c61"

    def convert(self, source: Path) -> Converted:
        """Return the recordings, `signal` and `label`.

        Raises:
            RecordingError: a file is missing or is no array of this layout.
        """
        files = [folder(source, *name.split("/"))[0] for name in FILES]
        signal, label = map(_array, files)
        if signal.ndim != 4 or signal.shape[1:] != _PATCH or signal.dtype.kind != "f":
            layout = f"floats of shape (recordings, {', '.join(map(str, _PATCH))})"
            raise RecordingError(f"{files[0]}: must hold {layout}, got {signal.dtype} {signal.shape}")
        label = label.reshape(-1)
        whole = label.dtype.kind in "iuf" and np.isfinite(label).all() and (label == np.floor(label)).all()
        fits = len(label) == len(signal) and whole and bool((label >= 0).all() and (label < 2**15).all())
        if not fits:
            text = f"one whole number for each of {len(signal)} recordings"
            raise RecordingError(f"{files[1]}: must hold {text}, got {label.dtype} {label.shape}")
        steps = signal.reshape(len(signal), -1, _PATCH[2]).transpose(0, 2, 1)
        arrays: dict[str, Array] = {
            "signal": np.ascontiguousarray(steps, np.float32),
            "label": label.astype(np.int16),
        }
        return Converted(files, {"icub_roboskin20_test200.npz": arrays})


def _array(path: Path) -> Array:
    try:
        return np.asarray(np.load(path, allow_pickle=False))
    except (OSError, ValueError, EOFError) as error:
        raise RecordingError(f"{path}: is no array: {str(error).splitlines()[0]}") from None
