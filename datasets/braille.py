"""Braille letters, seven of 27, read by the iCub's fingertip: spikes of 12 taxels in bins of 5 ms.

`data/braille_splitted/ds_val_0.pt` to `ds_val_9.pt` are PyTorch's `TensorDataset`: spikes (280, 256 bins,
12 taxels), labels (280,); ten stratified draws of one pool. The result holds each sample once, in the order
of first appearance, and which draws held it. `braille.npy` lists the samples that train and validate, by the
start of their SHA-256; the others are a file of their own.

Source: `data/BRAILLE.py` (files, letters) and `prepare_splits.py` (draws) of
github.com/neuromorphic-polito/L2MU-Braille; Mueller-Cleve et al., Frontiers in Neuroscience 16:951164, 2022.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from dse.base.native.extras import require_torch
from dse.base.records import Array
from dse.base.registry import register
from dse.data.recordings import RecordingError
from dse.data.recordings.prepare import Converted, folder

FILES = ("data/braille_splitted/ds_val_0.pt to ds_val_9.pt",)
LETTERS = ("Space", "A", "E", "I", "O", "U", "Y")
_DRAWS = 10
_STEPS, _TAXELS = 256, 12


@register("datasets", "braille")
@dataclass(frozen=True)
class Braille:
    """Braille letters read by the iCub's fingertip."""

    file: ClassVar[str] = "braille7_events/braille7_train_val.npz"
    origin: ClassVar[str] = "github.com/neuromorphic-polito/L2MU-Braille at 72344f6"
    licence: ClassVar[str] = "Apache-2.0"
    files: ClassVar[tuple[str, ...]] = FILES
    digest: ClassVar[str] = "1bf2e5817fe34f887cdcb85b5d66f65709013c63c2327c96f0106299794ff380"

    def convert(self, source: Path) -> Converted:
        """Return the samples that train and validate, and the others.

        Raises:
            RecordingError: a file is missing or holds something else.
            MissingExtra: torch is not installed.
        """
        require_torch("prepare braille")
        files = folder(source, "data/braille_splitted", "ds_val_[0-9].pt")
        if len(files) != _DRAWS:
            raise RecordingError(f"{files[0].parent}: must have {FILES[0]}, has {len(files)} of them")
        packed, labels, draws = _pool([_draw(path) for path in files])
        known = np.load(Path(__file__).with_suffix(".npy"), allow_pickle=False)
        names = np.array([_name(sample) for sample in packed], known["name"].dtype)
        place = np.minimum(np.searchsorted(known["name"], names), len(known) - 1)
        listed = known["name"][place] == names
        parts = {}
        for name, chosen, split in (
            ("braille7_train_val.npz", listed, np.where(known["validates"][place], "val", "train")),
            ("braille7_test.npz", ~listed, np.full(len(packed), "test")),
        ):
            if chosen.any():
                parts[name] = {
                    "spikes_packed": packed[chosen],
                    "shape": np.array([int(chosen.sum()), _STEPS, _TAXELS], np.int64),
                    "label": labels[chosen],
                    "class_names": np.array(LETTERS),
                    "val_fold_membership": draws[chosen],
                    "split": split[chosen].astype("<U7"),
                }
        return Converted(files, parts)


def _pool(drawn: list[tuple[Array, Array]]) -> tuple[Array, Array, Array]:
    """Return each sample once: spikes, labels, and (sample, draw) of whether the draw held it."""
    places: dict[bytes, int] = {}
    packed: list[Array] = []
    labels: list[int] = []
    draws: list[Array] = []
    for draw, (spikes, letters) in enumerate(drawn):
        for sample, letter in zip(np.packbits(spikes, axis=1), letters, strict=True):
            place = places.setdefault(sample.tobytes(), len(places))
            if place == len(packed):
                packed.append(sample)
                labels.append(letter)
                draws.append(np.zeros(_DRAWS, bool))
            draws[place][draw] = True
    return np.stack(packed), np.array(labels, np.int8), np.stack(draws)


def _name(sample: Array) -> int:
    """Return the first 32 bits of a sample's SHA-256."""
    return int.from_bytes(hashlib.sha256(sample.tobytes()).digest()[:4], "big")


def _draw(path: Path) -> tuple[Array, Array]:
    """Return spikes and labels of a file; nothing in it is executed."""
    import torch

    torch.serialization.add_safe_globals([torch.utils.data.TensorDataset])
    try:
        tensors = torch.load(path, map_location="cpu", weights_only=True).tensors
        spikes, labels = (tensor.numpy() for tensor in tensors)
    except Exception as error:
        raise RecordingError(f"{path}: is no TensorDataset: {str(error).splitlines()[0]}") from None
    fits = spikes.ndim == 3 and spikes.shape[1:] == (_STEPS, _TAXELS) and labels.shape == spikes.shape[:1]
    if not (fits and ((spikes == 0) | (spikes == 1)).all() and np.isin(labels, range(len(LETTERS))).all()):
        text = f"0 and 1 of shape (samples, {_STEPS}, {_TAXELS}) and labels 0 to {len(LETTERS) - 1}"
        raise RecordingError(f"{path}: must hold {text}, got {spikes.shape}, {labels.shape}")
    return np.asarray(spikes, bool), np.asarray(labels)
