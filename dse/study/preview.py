"""The preview of a study: number of designs, sizes of networks, and the data."""

from __future__ import annotations

import contextlib
import itertools

from dse.config import SearchSpace
from dse.config.chips import chips
from dse.config.contracts import placed, trains_in_cohorts
from dse.config.goals import programmed_neurons
from dse.dataset import cache
from dse.recordings.files import locate
from dse.registry import Plugin
from dse.search.space import corners, n_designs_of_each

# Larger files are not read just to count their channels and classes.
_MOST_BYTES = 200_000_000
_MOST_COMBINATIONS = 10_000
_SIZING = ("task", "preprocessing", "encoder", "model")


def preview(space: SearchSpace) -> dict[str, object]:
    """Return the row that `dse check` prints; `designs` is None if an axis is a range without steps.

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
        "sampler": space.search.sampler,
        # Where phi follows the outputs of each run, the number is not known before.
        **({"design_points": points} if space.decision.phi_step is None else {}),
        **_unpriced(space),
        "data": getattr(space.data, "scene", None),
    }
    size = 0
    for kind in ("file", "folder"):
        if place := getattr(space.data, kind, None):
            path = locate(place, space.source.parent, kind)
            row["data"] = str(path)
            size = path.stat().st_size if path.is_file() else 0  # a folder of event files is not read
    if size > _MOST_BYTES:
        return row
    # The name of an audit follows from what the recordings hold, and a folder is not read.
    is_folder = getattr(space.data, "folder", None) is not None
    return row | _from_data(space) | ({} if is_folder else _audited(space))


def _unpriced(space: SearchSpace) -> dict[str, object]:
    """Return which neurons no chip of the search space can run; nothing where each has one."""
    neurons = programmed_neurons(space.parts["model"])
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
    from dse.dataset.parts import pool_positions, pooling_of
    from dse.recordings import RecordingError
    from dse.recordings.cutting import cut
    from dse.recordings.splits import split
    from dse.recordings.targets import heads, target
    from dse.records import Events, Rasters, Signals
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
    weights: set[int] = set()
    for design in corners(space, _SIZING, _MOST_COMBINATIONS):
        sections = space.resolve(design)
        settings, encoder, model = sections.preprocessing, sections.encoder, sections.model
        if isinstance(recordings, Signals | Rasters):
            of_file = sections.data.channel_positions(space.source.parent)
            assert of_file is not None  # only events have addresses instead
            positions = of_file
        elif settings is not None and (settings.crop != "pins" or recordings.simulated):
            positions = pool_positions(pooling_of(recordings, settings))
        else:  # the crop depends on the events, which a preview does not read
            return row
        if encoder is not None:
            try:
                positions = encoder.positions(positions)
            except ValueError:  # the encoder learns its channels, and a preview fits nothing
                return row
        if not trains_in_cohorts(model):  # other families have weights only after training
            return row
        columns = sections.task.target
        joint_codes, names = target(recordings.columns, columns)
        parts_of = heads(recordings.columns, columns, joint_codes) if sections.task.joint else ()
        n_outputs = sum(len(head.classes) for head in parts_of) or len(names)
        sizes = placed(model, positions)
        weights.add(sizes.n_weights(len(positions), n_outputs))
    return row | {"n_weights_low": min(weights), "n_weights_high": max(weights)}
