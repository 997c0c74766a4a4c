"""Trials of a simulated scene: no file is read; every record is simulated on request."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from dse.base.records import Array, Block
from dse.base.registry import fixed, register
from dse.config.faults import ConfigError, known_names
from dse.data.recordings import RecordingError, Simulated
from dse.scene.checks import half_width_px
from dse.scene.load import find_scene, load_scene
from dse.scene.scene import Scene

COLUMNS = ("texture", "profile", "speed_mm_s", "force_n", "randomised_force", "repetition")


@dataclass(frozen=True)
class Trials(Simulated):
    """The trials of a scene as recordings; recording i is trial i.

    columns: texture (name), profile (label of the motion), speed_mm_s (its highest speed, before the trial's
        own gain), force_n (mean force of the cell, before the trial's own deviation), randomised_force (1 if
        every trial draws its force, else 0), repetition (from 0).
    """

    scene: Scene

    @property
    def width(self) -> int:
        return self.scene.sensor.frame_px[0]

    @property
    def height(self) -> int:
        return self.scene.sensor.frame_px[1]

    @property
    def n_recordings(self) -> int:
        return self.scene.n_trials

    @property
    def duration_us(self) -> int:
        """Length of every record."""
        return round(self.scene.duration_ms * 1000)

    @functools.cached_property
    def columns(self) -> Mapping[str, Array]:
        """Label columns, each (n,)."""
        from dse.scene.trial import mean_force

        scene = self.scene
        cells = np.array([scene.cell(k) for k in range(scene.n_trials)], dtype=np.int64)
        texture, motion, force, repetition = cells.T
        values = (
            np.array([x.name for x in scene.textures])[texture],
            np.array([x.label for x in scene.motions])[motion],
            np.array([x.peak_mm_s for x in scene.motions])[motion],
            np.array([mean_force(scene, k) for k in range(scene.n_trials)]),
            (force == len(scene.forces_n)).astype(np.int64),
            repetition,
        )
        return dict(zip(COLUMNS, values, strict=True))

    def pins(self) -> tuple[int, int, int, int]:
        """Return x, y, width and height of the pixels that see pins.

        They are the box around the image of the resting pins, wider by a pitch on every side: more than shear
        moves a pin, within the frame.
        """
        sensor = self.scene.sensor
        reach = half_width_px(sensor) + sensor.image_scale_px_mm * sensor.pin_pitch_mm
        low = [max(0, math.floor(size / 2 - reach)) for size in sensor.frame_px]
        high = [min(size, math.ceil(size / 2 + reach)) for size in sensor.frame_px]
        return low[0], low[1], high[0] - low[0], high[1] - low[1]

    def blocks(self, i: int) -> Iterator[Block]:
        """Yield the events of trial i, in one piece; times count from the start of the record."""
        from dse.scene import simulate

        yield simulate.events(self.scene, i)

    def notes(self) -> list[str]:
        """Return no repairs: simulated events are sound."""
        return []


@register("recordings", "scene")
@dataclass(frozen=True)
class SceneTrials:
    """Trials of a simulated scene.

    Label columns: texture, profile, speed_mm_s, force_n, randomised_force, repetition.
    """

    scene: str = fixed(
        doc="a scene file (an absolute path, or relative to the YAML file), or the name of a shipped scene"
    )
    textures: tuple[str, ...] | None = fixed(None, doc="textures of the scene to use (default: all)")
    trials: int | None = fixed(
        None, doc="trials of each texture, motion and force (default: as in the scene)", low=1
    )
    duration_ms: float | None = fixed(
        None, doc="duration of a trial (default: as in the scene)", unit="ms", low=0, low_open=True
    )
    seed: int | None = fixed(None, doc="seed of the scene (default: as in the scene file)", low=0)

    @property
    def columns(self) -> Mapping[str, str]:
        """Label column -> its name: a scene names them itself."""
        return {name: name for name in COLUMNS}

    def check(self, base: Path) -> list[str]:
        """Return the faults of the scene's file and of the component's keys; nothing is simulated."""
        try:
            scene = _scene(self.scene, base)
        except ConfigError as error:
            return [
                f"scene '{self.scene}': {fault if fault.line else fault.message}" for fault in error.faults
            ]
        names = [texture.name for texture in scene.textures]
        faults = [
            f"data.textures: scene '{self.scene}' has no texture '{name}'; {known_names(name, names)}"
            for name in self.textures or ()
            if name not in names
        ]
        if self.textures is not None and (not self.textures or len(set(self.textures)) < len(self.textures)):
            faults.append(
                f"data.textures must name one texture or more, each once, got {list(self.textures)}"
            )
        return faults

    def with_columns_found(self, base: Path) -> Self:
        """Return the component: a scene has all of its columns."""
        return self

    def resolved(self, base: Path) -> Scene:
        """Return the scene with the numbers of the component's keys."""
        if faults := self.check(base):
            raise RecordingError(*"\n".join(faults).splitlines())
        scene = _scene(self.scene, base)
        overrides = {"trials": self.trials, "duration_ms": self.duration_ms, "seed": self.seed}
        changes: dict[str, Any] = {key: value for key, value in overrides.items() if value is not None}
        if self.textures is not None:
            by_name = {texture.name: texture for texture in scene.textures}
            changes["textures"] = tuple(by_name[name] for name in self.textures)
        return dataclasses.replace(scene, **changes)

    def content(self, base: Path) -> str:
        """Return a hash of what the records follow from: the scene's numbers and the simulator's version."""
        from dse.scene import simulate

        scene = self.resolved(base)
        numbers = dataclasses.asdict(dataclasses.replace(scene, name=""))
        if scene.randomised_force_n is None:
            del numbers["randomised_force_n"]
        if not scene.sensor.incipient_slip:  # as randomised_force_n, added later: data sets keep their names
            del numbers["sensor"]["incipient_slip"]
        kinds = [type(motion).__name__ for motion in scene.motions]
        text = json.dumps([simulate.VERSION, kinds, numbers], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def channel_positions(self, base: Path) -> None:
        """Return None: an event's position is its address."""

    def read(self, base: Path) -> Trials:
        """Return the trials; they are simulated as they are read."""
        return Trials(self.resolved(base))


def _scene(path_or_name: str, base: Path) -> Scene:
    path = find_scene(path_or_name, base)
    about = path.stat()
    return _loaded(path, about.st_size, about.st_mtime_ns)


@functools.lru_cache(maxsize=64)
def _loaded(path: Path, size: int, modified_ns: int) -> Scene:
    """Return the scene of a file; it is read again only where size or time have changed."""
    return load_scene(path)
