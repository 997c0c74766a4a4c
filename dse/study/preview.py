"""What `dse check` says of a search space before any work: faults of a run, number of designs, and data."""

from __future__ import annotations

import contextlib
import functools
import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from dse.base import registry
from dse.base.records import Events, Ints, Rasters, Signals
from dse.base.registry import Plugin
from dse.config import SearchSpace
from dse.config.contracts import check_channels, placed, trains_in_cohorts
from dse.config.parts import chips, target_columns
from dse.config.resolved import LeftOut, Sections
from dse.config.settings import Evaluation
from dse.config.yaml_lines import Path as Keys
from dse.config.yaml_lines import error_of
from dse.data import dataset
from dse.data.dataset import cache
from dse.data.dataset.shape import Shape, announced
from dse.data.dataset.shifts import shifts_described
from dse.data.recordings import RecordingError, Recordings, doubts
from dse.data.recordings.files import locate
from dse.data.recordings.splits import Labelled, in_turn, split
from dse.data.recordings.targets import heads, in_use, target
from dse.data.recordings.windows import chosen, cut, onset, place
from dse.search.space import corners, design_at, n_designs_of_each
from dse.study.workers import Workers

# Larger files are not read just to count their channels and classes.
_MOST_BYTES = 200_000_000
_MOST_COMBINATIONS = 10_000
_PLACES: tuple[Literal["file", "folder"], ...] = ("file", "folder")
_MOST_ENCODERS = 16  # that are tried on some training recordings, `_FEW`
_FEW = 8
_MOST_WEIGHTS = 10_000_000
_SIZING = ("task", "preprocessing", "encoder", "model")
_MOST_CORNERS = 256
_MOST_TASKS = 100


class _Look:
    """The recordings of a search space, as they lie in their files.

    Raises:
        RecordingError: they cannot be read.
    """

    def __init__(self, space: SearchSpace) -> None:
        self.space = space
        self.read: Recordings = space.data.read(space.source.parent)
        self._shapes: dict[str, Shape | None] = {}

    @functools.cached_property
    def positions(self) -> Ints | None:
        """Where channels lie, by the files."""
        return self.space.data.channel_positions(self.space.source.parent)

    def cut(self, sections: Sections) -> Recordings:
        """Return the recordings as a design cuts them."""
        return cut(self.read, sections.window)

    def shape(self, sections: Sections) -> Shape | None:
        """Return the shape of a design's data set; None where the data decide."""
        key = repr((sections.task, sections.window, sections.preprocessing, sections.encoder))
        if key not in self._shapes:
            self._shapes[key] = announced(sections, self.cut(sections), self.positions)
        return self._shapes[key]


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
    from dse.store import StoreError
    from dse.study.audit import record

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
    first = space.resolve(next(corners(space, (), 1)))
    look = _Look(space)
    recordings = look.cut(first)
    codes, classes = target(recordings.columns, first.task.target)
    of = Labelled.of(recordings.columns, first.task, first.split)
    parts = of.train, of.validation, of.test
    if isinstance(recordings, Events):
        for i in sorted(itertools.chain(*parts)):
            if recordings.offsets[i] == recordings.offsets[i + 1]:
                raise RecordingError(f"recording {i} must have events, got none")
    row: dict[str, object] = {"recordings": len(codes)}
    row |= zip(("train", "validation", "test"), map(len, parts), strict=True)
    row["classes"] = list(classes)
    row |= _of_evaluation(space, first, recordings)
    if notes := recordings.notes():
        row["repairs"] = notes
    k_fold = first.split.k_fold
    name = " and ".join(target_columns(first.task.target))
    row["doubts"] = warnings = [
        *doubts.few(len(parts[1]), 1 if k_fold is None else k_fold.k),
        *doubts.doubts(doubts.Used(recordings, of, first.window.n_steps, look.positions, name)),
        *_without_spikes(space, recordings, look.positions, parts[0]),
    ]
    row |= _excluded(space, look.shape)
    weights: set[int] = set()
    for design in corners(space, _SIZING, _MOST_COMBINATIONS):
        sections = space.resolve(design)
        model, known = sections.model, look.shape(sections)
        if known is None or not trains_in_cohorts(model):  # other families have weights only after training
            return row
        weights.add(placed(model, known.positions).n_weights(len(known.positions), known.n_outputs))
    if max(weights) > _MOST_WEIGHTS:
        warnings.append(
            f"model: the largest design has {max(weights)} weights; a network for touch needs fewer than a "
            "million, and each has to be stored on the device"
        )
    return row | {"n_weights_low": min(weights), "n_weights_high": max(weights)}


def _without_spikes(
    space: SearchSpace, recordings: Recordings, positions: Ints | None, train: Ints
) -> list[str]:
    """Return a sentence for each encoder that makes no spikes of some training recordings."""
    from dse.data.dataset.parts import placed as windows_of
    from dse.study.audit.gather import values_of

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
            sentences += [f"{text}{at}" for text in doubts.silent_windows(n_spikes) if not n_spikes.any()]
    return sentences


def _excluded(space: SearchSpace, announced: Callable[[Sections], Shape | None]) -> dict[str, object]:
    """Return how many designs of a grid are never trained, which limit each cannot meet, and what is left.

    `announced` returns the shape of a design's data set as far as headers and labels tell; one that is
    prepared already is read from the cache.
    """
    total = space.n_designs
    if not space.limits or total is None:
        return {}

    from dse.measure.hardware.profile import of_space
    from dse.study.known import KnownBefore

    shapes: dict[str, Shape | None] = {}

    def shape_of(sections: Sections) -> Shape | None:
        key = dataset.dataset_key(sections, space.source.parent)
        if key not in shapes:
            with contextlib.suppress(OSError, RuntimeError, RecordingError):
                data = dataset.find(cache.usual_root(), key)
                shapes[key] = announced(sections) if data is None else Shape.of(data)
        return shapes.get(key)

    before = KnownBefore(space, of_space(space), shape_of)
    n = min(total, _MOST_COMBINATIONS)
    why = [before.exclusion(design_at(space, place * total // n)) for place in range(n)]
    excluded = [x for x in why if x is not None]
    row: dict[str, object] = {"excluded": len(excluded)}
    if space.search.n_trials is None and n == total:
        row["trained"] = total - len(excluded)
        row["runs"] = (total - len(excluded)) * space.search.repeats
    if None in shapes.values():
        row["excluded_later"] = "perhaps more, once the data are prepared"
    if n < total:
        row["excluded_of"] = n  # evenly spaced ones
    if excluded:
        by_limit = {limit: sum(limit in x.limits for x in excluded) for limit in space.limits}
        together = sum(not x.limits for x in excluded)
        row["excluded_by"] = by_limit | ({"all limits together": together} if together else {})
    return row


class Refusal(NamedTuple):
    """A fault: the keys of the search space that it is about, and a sentence."""

    path: Keys
    message: str


def refusals(space: SearchSpace) -> list[Refusal]:
    """Return every fault that a run of a valid search space would meet in its recordings, each once.

    Designs at the ends of all axes are looked at. Events are read, but their windows are not placed, as these
    follow from the events of every file.
    """
    faults: dict[Refusal, None] = {}
    try:
        look = _Look(space)
    except RecordingError as error:
        return [Refusal(("data", "file"), str(error))]
    seen: set[str] = set()
    for design in corners(space, ("task", "window"), _MOST_CORNERS):
        sections = space.resolve(design)
        key = repr((sections.task, sections.window))
        if key not in seen:
            seen.add(key)
            faults |= dict.fromkeys(_of_labels_and_windows(sections, look))
    if not faults:
        faults |= dict.fromkeys(_of_channels(look))
    if not faults and (fault := _too_large(look)) is not None:
        faults[fault] = None
    return list(faults)


def _of_labels_and_windows(design: Sections, look: _Look) -> Iterator[Refusal]:
    """Yield what is wrong with cutting, classes, split and windows of a design."""
    try:
        recordings = look.cut(design)
    except RecordingError as error:
        yield Refusal(("window", "cut_steps"), str(error))
        return
    try:
        codes, classes = target(recordings.columns, design.task.target)
        if design.task.joint:
            heads(recordings.columns, design.task.target, codes)
    except RecordingError as error:
        yield Refusal(("task", "target"), str(error))
        return
    used = np.ones(len(codes), dtype=bool)
    try:
        used[:] = False
        used[np.concatenate(split(recordings.columns, codes, classes, design.split))] = True
    except RecordingError as error:
        yield Refusal(("split",), str(error))
        used[:] = True
    n_classes = len(in_use(codes, classes, used)[1])
    if n_classes < 2:
        yield Refusal(
            ("task", "target"),
            f"task.target must have two classes or more in the recordings of the split, got {n_classes}",
        )
    if isinstance(recordings, Signals | Rasters):
        try:
            place(design.window, recordings.lengths, used, onset(recordings, design.window))
        except RecordingError as error:
            yield Refusal(("window", "n_steps"), str(error))


def _shapes(look: _Look) -> Iterator[tuple[Sections, Shape]]:
    """Yield designs at the ends of all axes and the shapes of their data, up to one that the data decide."""
    for design in corners(look.space, _SIZING, _MOST_CORNERS):
        sections, shape = look.space.resolve(design), None
        with contextlib.suppress(RecordingError, ValueError):
            shape = look.shape(sections)
        if shape is None:
            return
        yield sections, shape


def _of_channels(look: _Look) -> Iterator[Refusal]:
    """Yield why designs cannot train on channels where they lie."""
    for sections, shape in _shapes(look):
        try:
            check_channels(sections.model, shape.positions)
        except ValueError as error:
            yield Refusal(("model",), str(error))


def _too_large(look: _Look) -> Refusal | None:
    """Return the fault of a search space in which no design fits the memory of a worker."""
    execution = look.space.execution
    budget = Workers(execution.jobs).memory_budget(execution.memory_gib, execution.device)
    least: tuple[int, int] | None = None
    for sections, shape in _shapes(look):
        if not trains_in_cohorts(sections.model):
            return None
        family, sizes = placed(sections.model, shape.positions), (len(shape.positions), shape.n_outputs)
        needed = family.memory_bytes(*sizes, shape.n_steps or 1, sections.training)
        least = min(filter(None, (least, (needed, family.n_weights(*sizes)))))
        if needed <= budget:
            return None
    if least is None:
        return None
    needed, n_weights = least
    return Refusal(
        ("model",),
        f"model: the smallest design has {n_weights} weights, and its training needs "
        f"{needed / 2**30:.3g} GiB, "
        f"more than the {budget / 2**30:.3g} GiB of a process (execution.memory_gib)",
    )


def _of_evaluation(space: SearchSpace, first: Sections, recordings: Recordings) -> dict[str, object]:
    """Return the entries of `dse check`: sentences about moved windows, and the number of trainings.

    They are of the recordings of the first design, whose target alone is varied.
    """
    evaluation = first.evaluation
    if evaluation is None:
        return {}
    sentences: list[str] = []
    folds: list[LeftOut] = []
    faults: dict[str, None] = {}
    for design in corners(space, ("task",), _MOST_TASKS):
        of = Labelled.of(recordings.columns, space.resolve(design).task, first.split)
        try:
            folds, lost = in_turn(of, evaluation.groups)
            faults |= dict.fromkeys(lost)
            sentences += _of_shifts(first, evaluation, recordings, of)
        except RecordingError as error:
            faults[str(error)] = None
    if faults:
        raise error_of(space.source, faults)
    row: dict[str, object] = {"evaluation": list(dict.fromkeys(sentences))} if sentences else {}
    if folds:
        n_trials = space.search.n_trials or space.n_designs or 0
        row["trainings"] = n_trials * (space.search.repeats + len(folds))
    return row


def _of_shifts(first: Sections, evaluation: Evaluation, recordings: Recordings, of: Labelled) -> list[str]:
    """Return what is worth saying about moved windows; of events nothing, whose lengths are not known yet."""
    if evaluation.shifts is None or not isinstance(recordings, Signals | Rasters):
        return []
    window = first.window
    if window.at == "contact_onset" and isinstance(recordings, Rasters):
        return []
    wide = replace(window, jitter_steps=max(window.jitter_steps, evaluation.reach))
    start, low, high, _ = place(wide, recordings.lengths, of.used, onset(recordings, window))
    return shifts_described(of, start, (low, high), evaluation.shifts, window.jitter_steps)
