"""A small search space on made-up recordings, which tests of several packages change to their needs."""

import dataclasses

import numpy as np
import pytest

from dse.config import ConfigError, Sections, load_space
from dse.search.space import design_at

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

FINGERTIP = """\
scene: fingertip
sensor:
  {layout: rings, n_across: 1, pin_pitch_mm: 2, image_scale_px_mm: 8, frame_px: [96, 64], pin_radius_mm: 0.5}
textures: [denim, satin]
motions: [{kind: constant, speed_mm_s: {choice: [20, 50]}}]
duration_ms: 150
"""
"""A scene of short trials of a tip with 7 pins; a test appends forces and trials."""


def sections(design):
    """Return a design's sections of plain data; absent ones have the simplest that do."""
    if isinstance(design, Sections):
        return design
    written = {name: keys for name, keys in design.items() if keys is not None}
    return Sections.from_plain({"model": {"kind": "snn"}, "training": {}, **written}, "a design of a test")


RASTER = {
    "data": {"kind": "raster", "file": "x.npz", "step_ms": 5},
    "task": {"target": "letter"},
    "split": {"stratified": {"validation": 0.2}},
}


def design_of(model, training):
    """Return a design on recordings that need not be there, because its data set is."""
    return dataclasses.replace(sections(RASTER), model=model, training=training)


def write_space(folder, *changes, text=SPACE):
    """Write the search space, each change replacing a text that occurs in it once, and its recordings."""
    for old, new in changes:
        assert text.count(old) == 1, f"{old!r} occurs {text.count(old)} times"
        text = text.replace(old, new)
    path = folder / "tiny.yaml"
    path.write_text(text, encoding="utf-8")
    write_recordings(folder / "touch.npz")
    return path


def write_recordings(path):
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


def faults_of(path, overrides=None, *, check_data=False):
    """Return the faults without the name of the file."""
    with pytest.raises(ConfigError) as caught:
        load_space(path, overrides, check_data=check_data)
    assert str(caught.value) == "\n".join(map(str, caught.value.faults))
    return [str(fault).removeprefix(f"{path}:") for fault in caught.value.faults]


def grid(space):
    """Return every design, row-major: the last axis changes fastest."""
    assert space.n_designs is not None
    return [design_at(space, index) for index in range(space.n_designs)]
