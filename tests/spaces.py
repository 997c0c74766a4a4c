"""A small search space on made-up recordings, which tests of several packages change to their needs."""

from __future__ import annotations

from pathlib import Path

import numpy as np

SPACE = """\
study: tiny
seed: 3
data:
  kind: time_series
  file: touch.npz
  step_ms: 10
  columns: {fabric: label, speed: speed, repetition: repetition}
task: {target: fabric}
window: {n_steps: 16, at: middle}
split:
  train: {repetition: [0]}
  validation: {repetition: [1]}
encoder: {kind: send_on_delta, thresholds: {choice: [[1, 2], [1, 2, 4]]}}
model: {kind: snn, hidden: {choice: [4, 8, 12]}, true_rate: 0.8}
training: {epochs: 1, batch_size: 8}
decision: {phi: [0, 2], theta: {range: [0.25, 0.75], step: 0.25}}
hardware: [loihi1_silicon]
objectives: [accuracy:max, n_weights:min]
search: {sampler: grid, batch: 2}
execution: {jobs: 1}
"""


def write_space(folder: Path, *changes: tuple[str, str], text: str = SPACE) -> Path:
    """Write the search space, each change replacing a text that occurs in it once, and its recordings."""
    for old, new in changes:
        assert text.count(old) == 1, f"{old!r} occurs {text.count(old)} times"
        text = text.replace(old, new)
    path = folder / "tiny.yaml"
    path.write_text(text, encoding="utf-8")
    write_recordings(folder / "touch.npz")
    return path


def write_recordings(path: Path) -> None:
    """Write 24 recordings of 2 channels: the label is the channel that moves."""
    rng = np.random.default_rng(0)
    label = np.arange(24) % 2
    signal = np.cumsum(rng.integers(0, 2, (24, 20, 2)), axis=1).astype(np.float32)
    signal[np.arange(24), :, label] *= 4
    np.savez(
        path,
        signal=signal,
        label=label,
        speed=np.where(np.arange(24) % 3 == 0, -50, 50),
        repetition=np.arange(24) // 12,
    )
