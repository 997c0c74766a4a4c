"""Simulated touch: speed against error of the fast method, beside its slow definition and a peer's pixels.

    python -m benchmarks.scene [error] [speed] [classifier] [peer] [--scene neurotac_dvxplorer] [--rounds 3]
                               [--full] [--v2e FOLDER]

error       four scenes, records of 0.4 s without background: each step of the method against the reference
            (full frame every 0.1 ms); all pins reading the texture in place of those in contact; background
            that resets no pixel; and the floor: two references that differ in the start levels of the pixels,
            which no experiment controls
speed       whole trials of the 12 x 12 scene; what standing still costs; what pixels without pins cost
classifier  accuracy of a multinomial logistic regression on the rasters of three methods: 10 trials per
            cell, of 4 textures or (--full) of 12
peer        v2e's EventEmulator on the frames of the same trial, light and levels the same, dead time off;
            FOLDER is a clone of github.com/SensorsINI/v2e (what it imports for windows and files need not be
            there). ESIM is not run: rpg_esim is a ROS workspace, its Python binding (rpg_vid2e) has no wheel
            and is built against OpenCV and Boost; its pixel is the rule that the reference follows

Counts, r1 and r10 are those of events in 4 x 4 pixels, polarities together: r is the correlation in bins of 1
and 10 ms. vR is the van Rossum distance of the pooled trains (10 ms) over the norm of the reference's.
Times are CPU times of one process with one thread, the least of the rounds.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar
from unittest import mock

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks import scene_reference as reference
from dse.base.records import Block
from dse.config.settings import Preprocessing
from dse.data import preprocessing
from dse.data.preprocessing import Pooling
from dse.data.recordings.pooling import pooling
from dse.scene import background, simulate
from dse.scene.load import load_scene
from dse.scene.scene import Method, Scene

CASES = {
    "denim, constant 28": ("denim", "{kind: constant, speed_mm_s: 28}"),
    "acrylic, accelerating to 42": ("acrylic", "{kind: accelerating, peak_mm_s: 42}"),
    "foam, constant 60": ("foam", "{kind: constant, speed_mm_s: 60}"),
    "satin, constant 42": ("satin", "{kind: constant, speed_mm_s: 42}"),
}
SOME_TEXTURES = "[aluminium, acrylic, denim, foam]"
POOL = 4
TAU_MS = 10.0

DEFAULT = Method()
EXACT = Method(friction_step_ms=0.1, texture_step_ms=0.1, camera_step_ms=0.1, skip_px=0.0)
"""The steps of the reference: what differs is the closed form of the camera."""

NO_TURNS_PX = 1.0
"""As `turn_px`: a pin hardly ever goes so far between two looks and turns."""

FINE = Method(texture_step_ms=0.1, camera_step_ms=0.5, skip_px=0.02)
COARSE = Method(camera_step_ms=4.0, skip_px=0.2, turn_px=NO_TURNS_PX)

METHODS: Mapping[str, Method] = {
    "path of the reference": EXACT,
    "+ camera every 1 ms and at turns": replace(EXACT, camera_step_ms=1.0),
    "+ camera every 2 ms and at turns": replace(EXACT, camera_step_ms=2.0),
    "+ camera every 2 ms alone": replace(EXACT, camera_step_ms=2.0, turn_px=NO_TURNS_PX),
    "+ skip 0.05 px": replace(EXACT, skip_px=0.05),
    "+ skip 0.1 px": replace(EXACT, skip_px=0.1),
    "+ texture every 0.5 ms": replace(EXACT, texture_step_ms=0.5, camera_step_ms=0.5),
    "+ friction every 0.25 ms": replace(
        EXACT, friction_step_ms=0.25, texture_step_ms=0.25, camera_step_ms=0.25
    ),
    "default": DEFAULT,
    "default but no looks at turns": replace(DEFAULT, turn_px=NO_TURNS_PX),
    "default but camera every 1 ms": replace(DEFAULT, camera_step_ms=1.0),
    "default but camera every 4 ms": replace(DEFAULT, camera_step_ms=4.0),
    "fine: texture 0.1, camera 0.5 ms, skip 0.02 px": FINE,
    "coarse: camera 4 ms, skip 0.2 px, no turns": COARSE,
}
"""The path of the reference with one step changed (coarser steps must be its multiples); the default, too."""


@dataclass(frozen=True)
class Likeness:
    """How like events are to others: relative error of their count, pooled correlations, distance."""

    heads: ClassVar[tuple[str, ...]] = ("counts", "r1", "r10", "vR")

    counts: float
    r1: float
    r10: float
    van_rossum: float

    def cells(self) -> tuple[str, ...]:
        """Return the figures of a table's row."""
        return (
            f"{100 * self.counts:+.2f} %", f"{self.r1:.3f}", f"{self.r10:.4f}", f"{self.van_rossum:.3f}",
        )  # fmt: skip


def pooled(block: Block, frame_px: tuple[int, int], duration_ms: float, bin_ms: float = 1.0) -> np.ndarray:
    """Return events per bin and pool, (bin, pool) float32; pools that stick out of the frame are left out."""
    width, height = (side // POOL for side in frame_px)
    n_bins = int(np.ceil(duration_ms / bin_ms))
    x, y, b = block.x // POOL, block.y // POOL, block.t_us // round(bin_ms * 1000)
    inside = (x < width) & (y < height) & (b < n_bins)
    cell = (b * height + y) * width + x
    n = np.bincount(cell[inside], minlength=n_bins * width * height)
    return n.reshape(n_bins, width * height).astype(np.float32)


def van_rossum(a: np.ndarray, b: np.ndarray, tau_bins: float) -> float:
    """Return |f(a) - f(b)| / |f(b)|, f filtering counts (bin, train) with exp(-t / tau)."""
    from scipy.signal import lfilter

    keep = np.exp(-1 / tau_bins)
    f, g = (lfilter([1.0], [1.0, -keep], x, axis=0) for x in (a - b, b))
    return float(np.linalg.norm(f) / np.linalg.norm(g))


def likeness(block: Block, expected: Block, scene: Scene) -> Likeness:
    """Compare events of a trial with others."""
    a, b = (pooled(x, scene.sensor.frame_px, scene.duration_ms) for x in (block, expected))
    long = [x[: len(x) // 10 * 10].reshape(-1, 10, x.shape[1]).sum(axis=1) for x in (a, b)]
    r1, r10 = (float(np.corrcoef(x.ravel(), y.ravel())[0, 1]) for x, y in ((a, b), long))
    return Likeness(len(block.t_us) / len(expected.t_us) - 1, r1, r10, van_rossum(a, b, TAU_MS))


def least(call: Callable[[], Any], rounds: int) -> tuple[float, Any]:
    """Return the least CPU time of the calls, and what the last one returned."""
    best = np.inf
    for _ in range(rounds):
        start = time.process_time()
        result = call()
        best = min(best, time.process_time() - start)
    return best, result


def case(name: str, texture: str, motion: str, noise_hz: float = 0.0, duration_ms: float = 400.0) -> Scene:
    """Return the scene of one cell of the 12 x 12 of a scene."""
    return load_scene(
        name,
        {
            "textures": f"[{texture}]", "motions": f"[{motion}]", "trials": "1",
            "duration_ms": str(duration_ms), "camera": f"{{noise_hz: {noise_hz}}}",
        },
    )  # fmt: skip


def seen(scene: Scene, *, key: int | None = None, resets: Block | None = None) -> Block:
    """Return trial 0 as the reference camera sees it.

    Args:
        scene: the scene.
        key: of the start levels; None: those of the trial.
        resets: background events that reset their pixels.
    """
    paths, thresholds = simulate.pin_paths(scene, 0, reference.STEP_MS), reference.thresholds(scene)
    width, height = scene.sensor.frame_px
    start = reference.start_levels(scene, 0) if key is None else reference.start_phases(key, height, width)
    camera = scene.camera
    return reference.camera(
        paths.t_s, paths.px, paths.radius_px, paths.edge_px, start, thresholds, camera, resets
    )


def pools(scene: Scene) -> Pooling:
    """Return the pooling of the rasters: 1 ms, 4 x 4 pixels, polarities together."""
    return pooling(Preprocessing(1.0, pool=POOL, polarity="merge"), *scene.sensor.frame_px)


def raster(scene: Scene, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the pooled events of trial k: spikes per bin, and their channels."""
    return preprocessing.pool([simulate.events(scene, k)], pools(scene), 0, 0, round(scene.duration_ms))


def all_read(scene: Scene) -> Block:
    """Return the events of trial 0 where every pin reads the texture, if only a millionth of it."""
    draw = simulate.trial

    def drawn(scene: Scene, k: int) -> Any:
        trial = draw(scene, k)
        contact = replace(trial.contact, pressure=np.maximum(trial.contact.pressure, 1e-6))
        return replace(trial, contact=contact)

    with mock.patch.object(simulate, "trial", drawn):
        return simulate.events(scene, 0)


def error(of: str, rounds: int) -> Iterator[Table]:
    """Yield a table per scene: time and error of the method's steps."""
    for name, cell in CASES.items():
        scene = case(of, *cell)
        seconds = scene.duration_ms / 1000
        slow_s, slow = least(partial(seen, scene), 1)
        rows: list[tuple[str, float | None, Likeness | None]] = []
        rows.append(("reference", slow_s, likeness(slow, slow, scene)))
        rows.append(("floor: other start levels", None, likeness(seen(scene, key=1), slow, scene)))
        simulate.events(scene, 0)  # compiled, and its surface made
        for label, method in METHODS.items():
            cpu_s, block = least(partial(simulate.events, replace(scene, method=method), 0), rounds)
            rows.append((label, cpu_s, likeness(block, slow, scene)))
        cpu_s, _ = least(partial(raster, scene, 0), rounds)
        rows.append(("default, pooled", cpu_s, None))
        cpu_s, block = least(partial(all_read, scene), rounds)
        rows.append(("default, all pins read the texture", cpu_s, likeness(block, slow, scene)))
        for hz in (0.1, 1.0):
            noisy = replace(scene, camera=replace(scene.camera, noise_hz=hz))
            reset = seen(scene, resets=background.events(noisy, 0))
            rows.append((f"{hz:g} Hz/px of background reset no pixel", None, likeness(slow, reset, scene)))
        rate = len(slow.t_us) / seconds / 1e3
        table = Table(
            "", *("CPU s", "x real time", "x reference"), *Likeness.heads, title=f"{name}, {rate:.0f} kev/s"
        )
        for label, cpu_s, like in rows:
            shown = ("", "", "")
            if cpu_s is not None:
                shown = (f"{cpu_s:.4f}", f"{seconds / cpu_s:.2f}", f"{slow_s / cpu_s:.0f}")
            table.add_row(label, *shown, *(like.cells() if like is not None else ()))
        yield table


def speed(of: str, rounds: int) -> Iterator[Table]:
    """Yield how long trials take: the mean of the 12 x 12 scene, standing still, a larger frame."""
    scene = load_scene(of, {"trials": "1"})
    seconds = scene.duration_ms / 1000
    for k in range(scene.n_trials):  # compiled, and the surfaces made
        if k == 0 or scene.cell(k)[0] != scene.cell(k - 1)[0]:
            raster(scene, k), simulate.events(scene, k)
    cpu = {name: np.empty(scene.n_trials) for name in ("event list", "raster")}
    n_events, n_spikes = np.empty(scene.n_trials), np.empty(scene.n_trials)
    for k in range(scene.n_trials):
        cpu["event list"][k], block = least(partial(simulate.events, scene, k), rounds)
        cpu["raster"][k], (counts, _) = least(partial(raster, scene, k), rounds)
        n_events[k], n_spikes[k] = len(block.t_us), counts.sum()
    table = Table("whole trials of 1 s", "CPU ms", "x real time", "slowest texture", "fastest", title=of)
    textures = np.array([scene.cell(k)[0] for k in range(scene.n_trials)])
    for name, cpu_s in cpu.items():
        by = np.array([seconds / cpu_s[textures == i].mean() for i in range(len(scene.textures))])
        low, high = (f"{scene.textures[i].name} {by[i]:.1f}" for i in (by.argmin(), by.argmax()))
        table.add_row(name, f"{1e3 * cpu_s.mean():.2f}", f"{seconds / cpu_s.mean():.1f}", low, high)
    share = n_spikes.mean() / (scene.duration_ms * pools(scene).n_channels)
    table.caption = (
        f"{n_events.mean() / seconds / 1e6:.3f} Mev/s; {100 * share:.2f} % of the raster's entries"
    )
    yield table

    still = Table("", "CPU ms", "of a moving trial", "events", title="raster of a trial that does not slide")
    zero = "[{kind: table, t_s: [0, 10], v_mm_s: [0, 0]}]"
    for name, changes in (
        ("no force, no background", {"forces_n": "[0]", "camera": "{noise_hz: 0}"}),
        ("no force", {"forces_n": "[0]"}),
        ("no speed, force constant", {"motions": zero, "variation": "{force_drift: 0}"}),
        ("no speed, force drifts", {"motions": zero}),
    ):
        quiet = load_scene(of, {"trials": "1", "textures": "[denim]", **changes})
        raster(quiet, 0)
        cpu_s, _ = least(partial(raster, quiet, 0), 10 * rounds)
        share = cpu_s / cpu["raster"].mean()
        n = len(simulate.events(quiet, 0).t_us)
        still.add_row(name, f"{1e3 * cpu_s:.3f}", f"{100 * share:.2f} %", str(n))
    yield still

    larger = Table(
        "frame", "pixels", "CPU ms", "of the first", title="pixels that see no pin (denim, constant 28)"
    )
    first = None
    for side in (312, 441, 624):
        wide = case(of, *CASES["denim, constant 28"], noise_hz=0.1, duration_ms=1000.0)
        wide = replace(wide, sensor=replace(wide.sensor, frame_px=(side, side)))
        raster(wide, 0)
        cpu_s, _ = least(partial(raster, wide, 0), 3 * rounds)
        first = first or cpu_s
        larger.add_row(
            f"{side} x {side}", f"{side * side}", f"{1e3 * cpu_s:.2f}", f"{100 * cpu_s / first - 100:+.1f} %"
        )
    yield larger


def features(scene: Scene) -> np.ndarray:
    """Return sqrt of the spikes of every pool in bins of 100 ms, (trial, bin * pool) float32."""
    pool_grid, n_bins = pools(scene), round(scene.duration_ms)
    rows = []
    for k in range(scene.n_trials):
        counts, channels = raster(scene, k)
        cell = np.repeat(np.arange(n_bins) // 100, counts) * pool_grid.n_channels + channels
        rows.append(
            np.sqrt(np.bincount(cell, minlength=n_bins // 100 * pool_grid.n_channels)).astype(np.float32)
        )
    return np.stack(rows)


def accuracy(x: np.ndarray, target: np.ndarray, seed: int) -> float:
    """Return the accuracy on 30 % of the trials, held out: 150 principal components, logistic regression."""
    from sklearn.decomposition import PCA
    from sklearn.linear_model import LogisticRegression
    from sklearn.model_selection import train_test_split
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    split = train_test_split(x, target, test_size=0.3, random_state=seed, stratify=target)
    components = PCA(min(150, *split[0].shape), svd_solver="randomized", random_state=0)
    model = make_pipeline(components, StandardScaler(), LogisticRegression(C=0.1, max_iter=5000))
    model.fit(split[0], split[2])
    return float(model.score(split[1], split[3]))


def classifier(of: str, full: bool) -> Iterator[Table]:
    """Yield the accuracy of texture and profile by method."""
    scene = load_scene(of, {"trials": "10"} | ({} if full else {"textures": SOME_TEXTURES}))
    shape = f"{len(scene.textures)} x {len(scene.motions)} x {scene.trials} trials"
    cells = np.array([scene.cell(k) for k in range(scene.n_trials)])
    table = Table("method", "CPU s", "texture", "profile", title=f"{shape}, 30 % held out, 2 splits")
    # The reference itself would take a day: fine steps stand for it; the part `error` says how near they are.
    methods = {"default": DEFAULT, "coarse": COARSE, "fine": FINE}
    for name, method in methods.items():
        start = time.process_time()
        x = features(replace(scene, method=method))
        cpu_s = time.process_time() - start
        shown = []
        for column in (0, 1):
            accuracies = [100 * accuracy(x, cells[:, column], seed) for seed in (0, 1)]
            shown.append(f"{np.mean(accuracies):.1f} ({min(accuracies):.1f} to {max(accuracies):.1f}) %")
        table.add_row(name, f"{cpu_s:.1f}", *shown)
    yield table


def emulator(folder: Path) -> Any:
    """Return v2e's EventEmulator class from a clone of its repository.

    Raises:
        ImportError: it is not there, or does not load.
    """
    import torch  # noqa: F401  # once and for all: what is first imported below is forgotten again

    # What v2e imports for windows, files and cameras; its pixels need none of it.
    unused = ("cv2", "h5py", "screeninfo", "engineering_notation", "dv_processing", "easygui", "tkinter")
    with mock.patch.dict(sys.modules, {name: mock.MagicMock() for name in unused}):
        sys.path.insert(0, str(folder))
        try:
            from v2ecore.emulator import EventEmulator  # type: ignore[import-not-found]
        finally:
            sys.path.remove(str(folder))
    return EventEmulator


def v2e(model: Any, scene: Scene, step_ms: float) -> tuple[float, Block]:
    """Return CPU seconds of v2e's pixels alone, and their events, on frames of trial 0 every `step_ms`."""
    import torch

    torch.set_num_threads(1)
    paths = simulate.pin_paths(scene, 0, reference.STEP_MS)
    thresholds = torch.tensor(reference.thresholds(scene))
    start = torch.tensor(reference.start_levels(scene, 0), dtype=torch.float32)
    every = round(step_ms / reference.STEP_MS)
    dark = -float(np.log(scene.camera.contrast))
    pixels = model(
        pos_thres=scene.camera.threshold, neg_thres=scene.camera.threshold, sigma_thres=0.0, cutoff_hz=0.0,
        leak_rate_hz=0.0, shot_noise_rate_hz=0.0, refractory_period_s=0.0, device="cpu", hdr=True,
    )  # fmt: skip
    cpu_s, batches = 0.0, []
    for t, px in zip(paths.t_s[::every], paths.px[::every], strict=True):
        light = reference.frame(
            px, paths.radius_px, paths.edge_px, scene.camera.contrast, scene.sensor.frame_px
        )
        log_light = np.log(light).astype(np.float32)
        begin = time.process_time()
        events = pixels.generate_events(log_light, float(t))
        cpu_s += time.process_time() - begin
        if t == 0:  # our thresholds and levels in place of its own
            pixels.pos_thres, pixels.neg_thres = thresholds[..., 1], thresholds[..., 0]
            theta = torch.where(start > 0, thresholds[..., 0], thresholds[..., 1])
            pixels.base_log_frame = (pixels.base_log_frame + start * theta).float().clamp(dark, 0.0)
        if events is not None:
            batches.append(events)
    t_s, x, y, sign = np.concatenate(batches).T
    t_us = (1e6 * t_s.astype(np.float64)).astype(np.int64)
    return cpu_s, Block(t_us, x.astype(np.int32), y.astype(np.int32), (sign > 0).astype(np.uint8))


def peer(of: str, rounds: int, folder: Path | None) -> Iterator[Table]:
    """Yield our cameras and v2e's pixels on one trial."""
    import logging

    name = "denim, constant 28"
    scene = case(of, *CASES[name])
    scene = replace(scene, camera=replace(scene.camera, refractory_us=0.0))
    seconds = scene.duration_ms / 1000
    table = Table("", "s per s", "events", *Likeness.heads, title=f"{name}, {seconds:g} s")
    slow_s, slow = least(partial(seen, scene), 1)
    simulate.events(scene, 0)

    def row(label: str, cpu_s: float, block: Block) -> None:
        cells = likeness(block, slow, scene).cells()
        table.add_row(label, f"{cpu_s / seconds:.3g}", str(len(block.t_us)), *cells)

    row("reference, rendering included", slow_s, slow)
    row("fast, physics included", *least(partial(simulate.events, scene, 0), rounds))
    logging.disable(logging.WARNING)
    try:
        if folder is None:
            raise ImportError("not given; see --v2e")
        model = emulator(folder)
    except ImportError as missing:
        table.add_row(f"v2e: {missing}", *6 * [""])
    else:
        for step_ms in (1.0, 0.1):
            row(f"v2e, {1 / step_ms:g} frames per ms, pixels alone", *v2e(model, scene, step_ms))
    yield table


def main() -> None:
    """Print the tables that are asked for."""
    parts = ("error", "speed", "classifier", "peer")
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(parts)}; default: all")
    parser.add_argument("--scene", default="neurotac_dvxplorer")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--full", action="store_true")
    parser.add_argument("--v2e", type=Path, metavar="FOLDER")
    arguments = parser.parse_args()
    if unknown := set(arguments.parts) - set(parts):
        parser.error(f"PART must be one of {', '.join(parts)}, got {', '.join(sorted(unknown))}")
    tables = {
        "error": lambda: error(arguments.scene, arguments.rounds),
        "speed": lambda: speed(arguments.scene, arguments.rounds),
        "classifier": lambda: classifier(arguments.scene, arguments.full),
        "peer": lambda: peer(arguments.scene, arguments.rounds, arguments.v2e),
    }
    console = Console(width=130)
    for part in arguments.parts or parts:
        for table in tables[part]():
            console.print(table)


if __name__ == "__main__":
    main()
