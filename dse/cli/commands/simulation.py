"""The trials of a scene as a file of events, and one of them as a page: what `dse simulate` does."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dse.cli.answer import Answer
from dse.cli.signature import Count, Texts
from dse.config import ConfigError, Fault

if TYPE_CHECKING:
    from dse.base.records import Block
    from dse.scene.scene import Scene
    from dse.scene.simulate import Flags
    from dse.study.progress import Progress

_WARM_UP_MS = 100.0


@dataclass(frozen=True)
class _Summary:
    """A simulated trial, without its events. cpu_s: time of the one core that simulated it."""

    texture: str
    n_events: int
    cpu_s: float
    flags: Flags


def simulate(
    scene: str,
    *,
    out: Path | None = None,
    trials: str | None = None,
    set: Texts = (),
    jobs: Count = None,
    figure: Path | None = None,
    trial: str | None = None,
    quiet: bool = False,
) -> Answer:
    """Simulate the trials of a scene; write their events to a file, and one trial as a page.

    Args:
        scene: a YAML file, or the name of a shipped scene.
        out (FILE.npz): write the events of the trials to this file.
        trials (FIRST:END): trials to simulate, from FIRST to END - 1 (default: all).
        set (KEY=VALUE): replace the value of a key, e.g. trials=2 or 'textures=[denim, wool]'; repeatable.
        jobs: trials simulated in parallel (default: one per core).
        figure (PAGE.html): write a page that shows one trial to this file.
        trial (K): the trial that --figure shows (default: the first).
        quiet: print no progress on stderr.

    Returns:
        One row per texture.
    """
    from dse.cli.spaces import overrides_of
    from dse.scene.checks import warnings
    from dse.scene.load import load_scene
    from dse.study import progress

    loaded = load_scene(scene, overrides_of(set))
    span, shown = _choices(loaded.n_trials, out, figure, trials, trial)
    notes = warnings(loaded)
    try:
        with progress.shown(not quiet) as meter:
            # Compiles the kernels first: the speeds below are those of simulation alone.
            _simulated(dataclasses.replace(loaded, duration_ms=min(_WARM_UP_MS, loaded.duration_ms)), shown)
            if out is None:
                summaries = [_simulated(loaded, shown)[1]]
            else:
                summaries = _write(loaded, span, out, jobs or _cores(), meter)
                notes += _empty(span, summaries)
                notes.append(
                    f"to train on this file, write into a search space: {_data_section(loaded, out)}"
                )
            if figure is not None:
                notes.append(f"page of trial {shown}: {_draw(loaded, shown, figure)}")
    except KeyboardInterrupt:
        raise KeyboardInterrupt("stopped; no incomplete file was written") from None
    return Answer(_rows(loaded, summaries), notes)


def _choices(
    n_trials: int, out: Path | None, figure: Path | None, trials: str | None, trial: str | None
) -> tuple[range, int]:
    """Return the trials to simulate and the one to show, or raise all that is wrong with the options."""
    faults = []
    if out is None and figure is None:
        faults.append(Fault("dse simulate", 0, "needs --out FILE.npz, --figure PAGE.html, or both"))
    for name, path, suffix in (("--out", out, ".npz"), ("--figure", figure, ".html")):
        if path is not None:
            faults += [Fault(f"{name} {path}", 0, fault) for fault in _place_faults(path, suffix)]
    span = _span(trials, n_trials)
    if span is None:
        text = f"must be FIRST:END with 0 <= FIRST < END <= {n_trials}, the trials of the scene"
        faults.append(Fault(f"--trials {trials}", 0, text))
    shown = trial if trial is not None else str(span[0] if span else 0)
    if trial is not None and figure is None:
        faults.append(Fault(f"--trial {shown}", 0, "needs --figure, whose trial it selects"))
    elif not (shown.isascii() and shown.isdigit() and int(shown) < n_trials):
        faults.append(Fault(f"--trial {shown}", 0, f"must be one of the trials 0 to {n_trials - 1}"))
    if faults or span is None:
        raise ConfigError(faults)
    return span, int(shown)


def _place_faults(path: Path, suffix: str) -> Iterator[str]:
    """Yield why a file cannot be written at a path, before its content takes hours."""
    if path.suffix != suffix:
        yield f"must end in {suffix}"
    elif path.is_dir():
        yield "must be a file, got a folder"
    elif not path.parent.is_dir():
        yield f"must be in a folder that exists, got '{path.parent}'"
    elif not os.access(path.parent, os.W_OK):
        yield f"must be in a folder that may be written, got '{path.parent}'"


def _span(text: str | None, n: int) -> range | None:
    """Return the trials of FIRST:END, where either end may be absent; None if there are none."""
    first, colon, end = (text if text is not None else ":").partition(":")
    ends = (first.strip() or "0", end.strip() or str(n))
    if not colon or not all(part.isascii() and part.isdigit() for part in ends):
        return None
    low, high = map(int, ends)
    return range(low, high) if low < high <= n else None


def _write(scene: Scene, trials: range, path: Path, jobs: int, meter: Progress) -> list[_Summary]:
    """Simulate the trials into a file, in order."""
    from dse.data.dataset.parts import in_order
    from dse.data.recordings.events import event_archive
    from dse.data.recordings.scene import Trials

    recordings = Trials(scene)
    columns = {name: values[trials.start : trials.stop] for name, values in recordings.columns.items()}
    meter.expect(len(trials))
    summaries = []
    with (
        event_archive(path, recordings.width, recordings.height, recordings.duration_us, columns) as append,
        contextlib.closing(in_order(lambda k: _simulated(scene, k), trials, jobs)) as simulated,
    ):
        for k, (block, summary) in zip(trials, simulated, strict=True):
            append(block)
            summaries.append(summary)
            meter.advance(f"trial {k}: {summary.texture}, {summary.n_events} events")
    return summaries


def _simulated(scene: Scene, k: int) -> tuple[Block, _Summary]:
    from dse.scene import simulate as simulating

    began = time.thread_time()
    block, flags = simulating.simulated(scene, k)
    texture = scene.textures[scene.cell(k)[0]].name
    return block, _Summary(texture, len(block.t_us), time.thread_time() - began, flags)


def _rows(scene: Scene, summaries: Sequence[_Summary]) -> list[dict[str, object]]:
    """Return one row per texture that was touched, in the order of the scene."""
    rows = []
    for name in dict.fromkeys(summary.texture for summary in summaries):
        of_texture = [summary for summary in summaries if summary.texture == name]
        n_events = sum(summary.n_events for summary in of_texture)
        touched_s = len(of_texture) * scene.duration_ms / 1000
        rows.append(
            {
                "texture": name,
                "trials": len(of_texture),
                "touch_s": touched_s,
                "events": n_events,
                "million_events_per_s": n_events / touched_s / 1e6,
                "x_real_time": touched_s / max(sum(summary.cpu_s for summary in of_texture), 1e-9),
                "refractory_drops": sum(summary.flags.refractory_drops for summary in of_texture),
                "lost_looks": sum(summary.flags.lost_looks for summary in of_texture),
                "contact_saturated": sum(summary.flags.contact_saturated for summary in of_texture),
            }
        )
    return rows


def _empty(trials: range, summaries: Sequence[_Summary]) -> list[str]:
    """Return a note on trials without events."""
    empty = [k for k, summary in zip(trials, summaries, strict=True) if summary.n_events == 0]
    if not empty:
        return []
    return [
        f"{len(empty)} of {len(summaries)} trials sent no event, the first is trial {empty[0]}; exclude them "
        "from the split of a search space"
    ]


def _data_section(scene: Scene, path: Path) -> str:
    """Return the line that reads the file in a search space."""
    import yaml

    from dse.data.recordings.scene import COLUMNS

    width, height = scene.sensor.frame_px
    keys = {
        "kind": "events",
        "file": str(path.resolve()),
        "width": width,
        "height": height,
        **{name: name for name in ("x", "y", "polarity")},
        "columns": {name: name for name in COLUMNS},
    }
    flow = yaml.safe_dump(keys, default_flow_style=True, sort_keys=False, allow_unicode=True, width=10**6)
    return f"data: {flow.strip()}"


def _draw(scene: Scene, k: int, path: Path) -> Path:
    """Write the page of a trial and return the path."""
    from dse.scene import simulate as simulating
    from dse.scene.trial import mean_force
    from dse.show.dashboard.trial import write_trial_page
    from dse.show.figures.trial import gather_trial

    texture, motion, _, repetition = scene.cell(k)
    name = (
        f"{scene.name}, trial {k}: {scene.textures[texture].name}, {scene.motions[motion].label}, "
        f"{mean_force(scene, k):.3g} N, repetition {repetition}"
    )
    # The step of the physics: at a coarser one, slips and events would not coincide.
    paths = simulating.pin_paths(scene, k, scene.method.friction_step_ms)
    view = gather_trial(simulating.events(scene, k), paths, scene.sensor.frame_px, name)
    try:
        return write_trial_page(view, path)
    except OSError as error:
        why = f"cannot be written: {error.strerror or error}"
        raise ConfigError([Fault(f"--figure {path}", 0, why)]) from error


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
