"""The preview of a study: number of designs, sizes of networks, and the data."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from dse import dataset, registry
from dse.config import SearchSpace
from dse.config.chips import chips
from dse.config.contracts import placed, trains_in_cohorts
from dse.config.resolved import Sections
from dse.dataset import cache
from dse.recordings.files import locate
from dse.registry import Plugin
from dse.search.space import corners, design_at, n_designs_of_each

if TYPE_CHECKING:
    from dse.dataset.shape import Shape
    from dse.recordings import Recordings
    from dse.records import Ints

# Larger files are not read just to count their channels and classes.
_MOST_BYTES = 200_000_000
_MOST_COMBINATIONS = 10_000
_PLACES: tuple[Literal["file", "folder"], ...] = ("file", "folder")
_MOST_ENCODERS = 16  # that are tried on some training recordings, `_FEW`
_FEW = 8
_MOST_WEIGHTS = 10_000_000
_SIZING = ("task", "preprocessing", "encoder", "model")


def preview(space: SearchSpace) -> dict[str, object]:
    """Return the row that `dse check` prints; `designs` is None if an axis is a range without steps.

    Key `doubts` is a list of sentences about the recordings and the networks; absent where no recordings are
    read.

    Raises:
        RecordingError: the recordings do not fit the search space.
    """
    grid = space.n_designs
    n_trials = min(x for x in (space.search.n_trials, grid) if x is not None)
    settings = len(space.decision.phi) * len(space.decision.theta) + 1  # one more for the full read-out
    points = n_trials * settings * max(1, len(space.hardware))
    row: dict[str, object] = {
        "study": space.study,
        "task": space.parts["task"].values["name"],
        **({"plugins": [_loaded(plugin) for plugin in space.plugins]} if space.plugins else {}),
        "axes": list(space.axes),
        "designs": grid,
        **{f"{section}_designs": n_designs_of_each(space, section) for section in space.choices},
        "trained": n_trials,
        "runs": n_trials * space.search.repeats,
        "sampler": space.search.sampler_name,
        # Where phi follows the outputs of each run, the number is not known before.
        **({"design_points": points} if space.decision.phi_step is None else {}),
        **_unpriced(space),
        "data": getattr(space.data, "scene", None),
    }
    if (path := _path_of(space)) is not None:
        row["data"] = str(path)
    if is_large(space):
        return row | _excluded(space, lambda _: None)
    # The name of an audit follows from what the recordings hold, and a folder is not read.
    is_folder = getattr(space.data, "folder", None) is not None
    return row | _from_data(space) | ({} if is_folder else _audited(space))


def is_large(space: SearchSpace) -> bool:
    """Return whether the file of the recordings is too large to be read before a run."""
    path = _path_of(space)
    return path is not None and path.is_file() and path.stat().st_size > _MOST_BYTES


def _path_of(space: SearchSpace) -> Path | None:
    """Return the file or folder of the recordings; None for a scene."""
    for kind in _PLACES:
        if place := getattr(space.data, kind, None):
            return locate(place, space.source.parent, kind)
    return None


def _unpriced(space: SearchSpace) -> dict[str, object]:
    """Return which neurons no chip of the search space can run; nothing where each has one."""
    known: dict[str, Any] = registry.known("neurons")
    named = (name for part in space.parts["model"].each for name in part.components("neurons"))
    neurons = [name for name in dict.fromkeys(named) if getattr(known[name], "programmed", False)]
    if not neurons or not space.hardware:
        return {}
    fixed = [chip for chip in chips(space.hardware, space.source.parent) if chip.is_fixed]
    if len(fixed) < len(space.hardware):
        return {}
    names = ", ".join(space.hardware)
    return {"without_costs": f"neuron {', '.join(neurons)}: the neurons of {names} cannot be programmed"}


def _audited(space: SearchSpace) -> dict[str, object]:
    """Return what the last audit of the search space has found; nothing without an audit."""
    from dse.audit import record
    from dse.recordings import RecordingError
    from dse.store import StoreError

    with contextlib.suppress(OSError, RuntimeError, RecordingError, StoreError):
        if (audit := record.last(space, cache.usual_root())) is not None:
            return {"shortcuts": audit.shortcuts}
    return {}


def _loaded(plugin: Plugin) -> str:
    """Return the components of a plugin: `my_neuron.py: neurons adaptive, objectives jitter`."""
    components = ", ".join(f"{section} {name}" for section, name in plugin.components)
    return f"{plugin.name}: {components}"


def _from_data(space: SearchSpace) -> dict[str, object]:
    """Return recordings, classes and the range of the number of weights, if known before preprocessing."""
    from dse.dataset.shape import announced
    from dse.recordings import RecordingError, doubts
    from dse.recordings.cutting import cut
    from dse.recordings.splits import split
    from dse.recordings.targets import heads, in_use, target, target_columns
    from dse.records import Events
    from dse.study.evaluation import previewed

    first = space.resolve(next(corners(space, (), 1)))
    read = first.data.read(space.source.parent)
    recordings = cut(read, first.window.cut_steps, first.window.every_steps)
    codes, classes = target(recordings.columns, first.task.target)
    if first.task.joint:
        heads(recordings.columns, first.task.target, codes)
    parts = split(recordings.columns, codes, classes, first.split)
    if isinstance(recordings, Events):
        for i in sorted(itertools.chain(*parts)):
            if recordings.offsets[i] == recordings.offsets[i + 1]:
                raise RecordingError(f"recording {i} must have events, got none")
    row: dict[str, object] = {"recordings": len(codes)}
    row |= zip(("train", "validation", "test"), map(len, parts), strict=True)
    row["classes"] = list(classes)
    row |= previewed(space, first, recordings)
    if notes := recordings.notes():
        row["repairs"] = notes
    of_file = first.data.channel_positions(space.source.parent)
    used = np.zeros(len(codes), bool)
    used[np.concatenate(parts)] = True
    k_fold = first.split.k_fold
    name = " and ".join(target_columns(first.task.target))
    labels = in_use(codes, classes, used)
    row["doubts"] = said = [
        *doubts.few(len(parts[1]), 1 if k_fold is None else k_fold.k),
        *doubts.doubts(
            doubts.Used(recordings, *labels, np.flatnonzero(used), first.window.n_steps, of_file, name)
        ),
        *_without_spikes(space, recordings, of_file, parts[0]),
    ]
    shapes: dict[str, Shape | None] = {}

    def shape(sections: Sections) -> Shape | None:
        key = repr((sections.task, sections.window, sections.preprocessing, sections.encoder))
        if key not in shapes:
            shapes[key] = announced(sections, recordings, of_file)
        return shapes[key]

    row |= _excluded(space, shape)
    weights: set[int] = set()
    for design in corners(space, _SIZING, _MOST_COMBINATIONS):
        sections = space.resolve(design)
        model, known = sections.model, shape(sections)
        if known is None or not trains_in_cohorts(model):  # other families have weights only after training
            return row
        weights.add(placed(model, known.positions).n_weights(len(known.positions), known.n_outputs))
    if max(weights) > _MOST_WEIGHTS:
        said.append(
            f"model: the largest design has {max(weights)} weights; a network for touch needs fewer than a "
            "million, and each has to be stored on the device"
        )
    return row | {"n_weights_low": min(weights), "n_weights_high": max(weights)}


def _without_spikes(
    space: SearchSpace, recordings: Recordings, positions: Ints | None, train: Ints
) -> list[str]:
    """Return a sentence for each encoder that makes no spikes of some training recordings."""
    from dse.audit.gather import values_of
    from dse.dataset.parts import placed as windows_of
    from dse.recordings.doubts import silent_windows
    from dse.recordings.windows import chosen
    from dse.records import Signals

    if not isinstance(recordings, Signals):
        return []
    some = chosen(recordings, train[:: max(1, len(train) // _FEW)][:_FEW])
    sentences = []
    for design in corners(space, ("encoder",), _MOST_ENCODERS):
        sections = space.resolve(design)
        if sections.encoder is None or sections.encoder.learns:
            continue
        with contextlib.suppress(ValueError):  # what it cannot encode is said by the training
            part = windows_of(some, sections, np.ones(some.n_recordings, bool), positions=positions)
            n_spikes = np.array([row.counts.sum() for row in part.rows(1)])
            values = {name: x for name, x in design.items() if name.startswith("encoder.")}
            at = f" (at {values_of(values)})" if values else ""
            sentences += [f"{text}{at}" for text in silent_windows(n_spikes) if not n_spikes.any()]
    return sentences


def _excluded(space: SearchSpace, announced: Callable[[Sections], Shape | None]) -> dict[str, object]:
    """Return how many designs of a grid are never trained, and which limit each cannot meet.

    Args:
        space: search space.
        announced: returns the shape of a design's data set where it follows from the recordings' headers and
            labels; a data set that is prepared already is read from the cache.
    """
    total = space.n_designs
    if not space.limits or total is None:
        return {}

    from dse.dataset.shape import Shape
    from dse.hardware.profile import load_all
    from dse.recordings import RecordingError
    from dse.study.known import KnownBefore

    shapes: dict[str, Shape | None] = {}

    def shape_of(sections: Sections) -> Shape | None:
        key = dataset.dataset_key(sections, space.source.parent)
        if key not in shapes:
            with contextlib.suppress(OSError, RuntimeError, RecordingError):
                data = dataset.find(cache.usual_root(), key)
                shapes[key] = announced(sections) if data is None else Shape.of(data)
        return shapes.get(key)

    before = KnownBefore(space, load_all(space.hardware, space.source.parent), shape_of)
    n = min(total, _MOST_COMBINATIONS)
    why = [before.exclusion(design_at(space, place * total // n)) for place in range(n)]
    excluded = [x for x in why if x is not None]
    row: dict[str, object] = {"excluded": len(excluded)}
    if None in shapes.values():
        row["excluded_later"] = "perhaps more, once the data are prepared"
    if n < total:
        row["excluded_of"] = n  # evenly spaced ones
    if excluded:
        by_limit = {limit: sum(limit in x.limits for x in excluded) for limit in space.limits}
        together = sum(not x.limits for x in excluded)
        row["excluded_by"] = by_limit | ({"all limits together": together} if together else {})
    return row
