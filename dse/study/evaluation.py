"""What section `evaluation` means for the recordings of a search space, before anything is prepared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dse.config import SearchSpace
from dse.config.resolved import LeftOut, Sections
from dse.config.settings import Evaluation
from dse.config.yaml_lines import error_of
from dse.dataset.shifts import shifts_described
from dse.recordings import RecordingError, Recordings, splits
from dse.recordings.splits import split
from dse.recordings.targets import target
from dse.recordings.windows import place, signal_onset
from dse.records import Array, Ints, Rasters, Signals
from dse.search.space import corners

_MOST_TASKS = 100


def previewed(space: SearchSpace, first: Sections, recordings: Recordings) -> dict[str, object]:
    """Return the entries of `dse check`: sentences about moved windows, and the number of trainings.

    Args:
        space: search space.
        first: a design of it; only its target is varied.
        recordings: of the design.

    Raises:
        ConfigError: windows have no room for the shifts, or a class cannot be trained without a fold.
    """
    evaluation = first.evaluation
    if evaluation is None:
        return {}
    sentences: list[str] = []
    folds: list[LeftOut] = []
    faults: dict[str, None] = {}
    for design in corners(space, ("task",), _MOST_TASKS):
        codes, classes = target(recordings.columns, space.resolve(design).task.target)
        train, validation, test = split(recordings.columns, codes, classes, first.split)
        try:
            columns = recordings.columns
            folds = [y for x in evaluation.groups for y in splits.folds(columns, x, codes, train, validation)]
            lost = (splits.untrained(columns, x, codes, classes, train, validation) for x in folds)
            faults |= dict.fromkeys(filter(None, lost))
            used = np.concatenate([train, validation, test])
            sentences += _of_shifts(first, evaluation, recordings, used, validation, codes, classes)
        except RecordingError as error:
            faults[str(error)] = None
    if faults:
        raise error_of(space.source, faults)
    row: dict[str, object] = {"evaluation": list(dict.fromkeys(sentences))} if sentences else {}
    if folds:
        n_trials = space.search.n_trials or space.n_designs or 0
        row["trainings"] = n_trials * (space.search.repeats + len(folds))
    return row


def _of_shifts(
    first: Sections,
    evaluation: Evaluation,
    recordings: Recordings,
    used: Ints,
    validation: Ints,
    codes: Ints,
    classes: tuple[str, ...],
) -> list[str]:
    """Return what is worth saying about moved windows; of events nothing, whose lengths are not known yet."""
    if evaluation.shifts is None or not isinstance(recordings, Signals | Rasters):
        return []
    window, onset = first.window, None
    if window.at == "contact_onset":
        if isinstance(recordings, Rasters):
            return []
        onset = signal_onset(recordings, window.onset_threshold)
    wide = replace(window, jitter_steps=max(window.jitter_steps, evaluation.reach))
    mask: Array = np.isin(np.arange(recordings.n_recordings), used)
    start, low, high, _ = place(wide, recordings.lengths, mask, onset)
    room = low, high
    return shifts_described(start, room, codes, classes, validation, evaluation.shifts, window.jitter_steps)
