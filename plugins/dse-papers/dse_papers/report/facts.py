"""What a study holds, as facts that stand beside the set-up that a paper prints (`reads` in published.yaml).

A fact is a number, a text, or the two ends of a range; a fact that a study does not show is absent.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np

from dse.config import Sections
from dse.config.faults import ConfigError
from dse.config.values import plain
from dse.data.recordings import RecordingError
from dse.data.recordings.pooling import pooling
from dse.data.recordings.scene import SceneTrials, Trials
from dse.engine.neurons import izhikevich
from dse.measure.decision import HUMAN_ACCURACY
from dse.scene.scene import Scene
from dse.scene.surface import PRINTED_HEIGHT_MM
from dse.show.report.designs import StudyTask, record, sections_of

if TYPE_CHECKING:
    import pandas

Fact = float | str | tuple[float, ...] | None
Facts = dict[str, Fact]

_WITHIN_PERCENT = 10
_MOVEMENT = ("profile", "velocity", "speed", "motion")


def of_movement(part: StudyTask) -> bool:
    """Return whether a task is a movement, not a texture or an object."""
    return any(word in column for column in part.target for word in _MOVEMENT)


def facts_of(part: StudyTask, row: pandas.Series[Any]) -> Facts:
    """Return the facts of one design of a study.

    Args:
        part: the study's designs for one task.
        row: the design.

    Raises:
        StoreError: the design's record is damaged.
    """
    trial = int(row["trial"])
    sections = sections_of(part.study.folder, trial)
    scene = scene_of(part, sections)
    pools = None
    if scene is not None and sections.preprocessing is not None:
        pools = pooling(sections.preprocessing, *scene.sensor.frame_px, Trials(scene).pins())
    n_classes = len(part.classes(trial))
    facts: Facts = {
        **_settings(sections),
        **_counts(record(part.study.folder, trial).get("samples", {}), n_classes, sections),
        "profiles" if of_movement(part) else "textures": n_classes,
        "chance": None if of_movement(part) else 1 / n_classes,
        **_times(part, row, sections),
        **_layers(part, trial),
        **_model(sections, _channels(part, sections) if pools is None else pools.n_channels),
        **_searched(part, str(row["family"])),
        "human": HUMAN_ACCURACY,
        "t_c_within": _WITHIN_PERCENT,
        **({} if scene is None else _scene(scene)),
        "pools": None if pools is None else f"{pools.width} x {pools.height}",
    }
    return {name: value for name, value in facts.items() if value is not None}


def scene_of(part: StudyTask, sections: Sections) -> Scene | None:
    """Return the simulated scene of a design; None where touch is recorded, or the scene is not found."""
    if not isinstance(sections.data, SceneTrials):
        return None
    try:
        return sections.data.resolved(part.study.folder)
    except (ConfigError, RecordingError, OSError):
        return None


def is_artificial(scene: Scene | None) -> bool:
    """Return whether all textures of a scene are printed pins."""
    return scene is not None and all(texture.pin_radius_mm is not None for texture in scene.textures)


def _settings(sections: Sections) -> Facts:
    """Return single numbers of the sections by dotted key, and what follows from them."""
    facts: Facts = {}
    for name, keys in sections.to_plain().items():
        for key, value in keys.items():
            numbers = value if isinstance(value, list | tuple) else [value]
            if numbers and all(_is_number(x) for x in numbers):
                facts[f"{name}.{key}"] = _several(numbers)
    steps = sections.preprocessing
    if steps is not None:
        facts |= {
            "bin_ms": steps.bin_ms,
            "kernel": _same(steps.pool),
            "stride": _same(steps.pool if steps.stride is None else steps.stride),
            "exceeds": steps.pool_threshold - 1 + steps.exceeds,
        }
    training = sections.training
    facts["lr_decay_percent"] = 100 * (1 - training.lr_factor)
    hidden, inputs = 100 * training.dropout, 100 * training.input_dropout
    facts["dropout_percent"] = hidden if hidden == inputs else f"{hidden:g} of hidden, {inputs:g} of input"
    return facts


def _counts(counts: Mapping[str, int], n_classes: int, sections: Sections) -> Facts:
    """Return sizes of the parts of the recordings, and of cross-validation.

    With cross-validation the folds together are the training set, as papers count.
    """
    train, validation, test = (int(counts.get(name, 0)) for name in ("train", "validation", "test"))
    k_fold, n = sections.split.k_fold, train + validation + test
    if k_fold is not None:
        train, validation = train + validation, 0
    held_out = test if k_fold is not None else validation
    return {
        "n_samples": n,
        "n_train": train,
        "n_validation": validation,
        "n_test": test,
        "n_test_per_class": test / n_classes,
        "folds": 1 if k_fold is None else k_fold.k,
        "samples_per_class": n / n_classes,
        "recordings_per_class": n / n_classes if sections.window.cut_steps is None else None,
        "test_fraction": _share(test, n),
        "train_part": _share(train, n),
        "validation_part": _share(validation, n),
        "train_fraction": _share(train, train + held_out),
        "held_out_fraction": _share(held_out, train + held_out),
    }


def _share(n: int, of: int) -> Fact:
    return n / of if of else None


def _times(part: StudyTask, row: pandas.Series[Any], sections: Sections) -> Facts:
    used_ms = float(row["decision_latency_ms"])
    lengths = part.of([str(row["family"])])["decision_latency_ms"].astype(float)
    facts: Facts = {"used_ms": used_ms, "used_s": used_ms / 1000, "sample_s": used_ms / 1000}
    facts["lengths_ms"] = _span(lengths[np.isfinite(lengths)])
    step_ms = getattr(sections.data, "step_ms", None)
    if step_ms is None and sections.preprocessing is not None:
        step_ms = sections.preprocessing.bin_ms
    if step_ms:
        facts |= {"sampling_hz": 1000 / step_ms, "window_steps": used_ms / step_ms}
        if (every := sections.window.every_steps or sections.window.cut_steps) is not None:
            facts["every_ms"] = every * step_ms
    return facts


def _layers(part: StudyTask, trial: int) -> Facts:
    """Return the sizes of a network's layers; nothing for classifiers that are no network."""
    runs = part.arrays(trial, "read_out")
    if not runs or "work/sizes" not in runs[0]:
        return {}
    sizes = [int(n) for n in runs[0]["work/sizes"]]
    return {
        "layers": len(sizes),
        "inputs": sizes[0],
        "outputs": sizes[-1],
        "hidden": sum(sizes[1:-1]) or None,
        "encoded_layers": len(sizes),
        "spike_trains": sizes[0],
    }


def _model(sections: Sections, channels: int | None) -> Facts:
    model, encoder = sections.model, sections.encoder
    facts: Facts = {"channels": channels}
    windows, hidden, gain = (
        getattr(model, "windows", None),
        getattr(model, "hidden", None),
        getattr(encoder, "gain", None),
    )
    if _is_number(windows):
        facts["delays"] = windows - 1
        if channels is not None:
            facts["features"] = windows * (channels if encoder is None else encoder.n_channels(channels))
    if _is_number(hidden):
        facts["hidden"] = hidden
    if _is_number(gain):
        constants = izhikevich.A, izhikevich.B, izhikevich.C, izhikevich.D
        facts |= {
            "receptors": 3 if getattr(encoder, "sa", True) else 2,
            "gain_sa": gain * getattr(encoder, "gain_sa", math.nan),
            # printed per change in 1 ms, ours per change in 1 s
            "gain_fa": 1000 * gain * getattr(encoder, "gain_fa", math.nan),
            "izhikevich": _several(constants),
            "izhikevich_peak_mv": izhikevich.PEAK_MV,
        }
        for name, params in (("SA", izhikevich.SA), ("FA", izhikevich.FA)):  # c is printed in 100 mV
            values = {"a": params.a, "b": params.b, "c": params.c / 100, "d": params.d}
            facts |= {f"izhikevich_{key}.{name}": float(np.asarray(value)) for key, value in values.items()}
    return facts


def _channels(part: StudyTask, sections: Sections) -> int | None:
    """Return the number of sampled channels; None for events, or where the recordings are not found."""
    try:
        positions = sections.data.channel_positions(part.study.folder)
    except (ValueError, OSError):
        return None
    return None if positions is None else len(positions)


def _searched(part: StudyTask, family: str) -> Facts:
    """Return the ranges of the keys of models in the search space, and steps of those of one family."""
    model = part.study.space.get("model", {})
    entries = model.get("choice", [model]) if isinstance(model, Mapping) else []
    facts: Facts = {}
    for entry in entries:
        kind = entry.get("kind") if isinstance(entry, Mapping) else None
        for key, axis in entry.items() if kind else ():
            values = _values(axis)
            if values and all(_is_number(x) for x in values):
                facts[f"{kind}.{key}"] = _span(values)
                if key == "tau_ms":
                    facts[f"{kind}.tau_us"] = _span([1000 * x for x in values])
                if kind == family:
                    facts |= {f"axis.{key}": _span(values), f"step.{key}": _step(axis, values)}
    return facts


def _values(axis: object) -> list[Any]:
    """Return the ends of a range, the options of a choice, or the one value."""
    if isinstance(axis, Mapping):
        return list(axis.get("range") or axis.get("choice") or [])
    return [] if axis is None else list(axis) if isinstance(axis, list | tuple) else [axis]


def _step(axis: object, values: list[Any]) -> Fact:
    if isinstance(axis, Mapping) and "range" in axis:
        return axis.get("step")
    steps = {round(float(x), 9) for x in np.diff(sorted(values))}
    return steps.pop() if len(steps) == 1 else "uneven" if steps else None


def _scene(scene: Scene) -> Facts:
    peaks, n = [motion.peak_mm_s for motion in scene.motions], scene.sensor.n_across
    radii = sorted(x.pin_radius_mm for x in scene.textures if x.pin_radius_mm is not None)
    steps = {round(float(x), 9) for x in np.diff(radii)}
    facts: Facts = {
        "textures": len(scene.textures),
        "profiles": len(scene.motions),
        "forces_n": _several(scene.forces_n),
        "speed_mm_s": _span(peaks),
        "top_speed_mm_s": max(peaks),
        "speed_cm_s": _span([x / 10 for x in peaks]),
        "duration_ms": scene.duration_ms,
        "duration_s": scene.duration_ms / 1000,
        "recording_s": scene.duration_ms / 1000,
        "raw_ms": _span([1000 * motion.duration_s for motion in scene.motions]),
        "trials": scene.trials,
        "n_pins": 1 + 3 * n * (n + 1) if scene.sensor.layout == "rings" else n * n,
        "pin_pitch_mm": scene.sensor.pin_pitch_mm,
        "force_bound_n": scene.variation.force_bound_n,
    }
    if is_artificial(scene):
        facts |= {
            "pin_radius_mm": _span(radii),
            "pin_radius_step_mm": steps.pop() if len(steps) == 1 else None,
            "pin_height_mm": PRINTED_HEIGHT_MM,
        }
    return facts


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _same(pair: int | tuple[int, int]) -> Fact:
    """Return one number for a pair of equal ones, else both as text."""
    several = list(plain(pair)) if isinstance(pair, tuple) else [pair]
    return several[0] if len(set(several)) == 1 else " x ".join(map(str, several))


def _several(numbers: Sequence[Any]) -> Fact:
    return float(numbers[0]) if len(numbers) == 1 else ", ".join(f"{x:g}" for x in numbers)


def _span(values: Iterable[float]) -> Fact:
    """Return the two ends of some values, one number where all are equal, None of none."""
    several = [float(x) for x in values]
    if not several:
        return None
    low, high = min(several), max(several)
    return low if low == high else (low, high)
