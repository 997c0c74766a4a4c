"""How accuracies of design points vary with the recordings and the seeds that they were measured on.

Each run stores its answer to every validation recording. A resample weights the recordings at random, all
runs alike, so that designs which fail on the same recordings vary together; seeds vary by what the repeats of
all trials show together. Points at other precisions, whose single answers are not stored, vary as the same
point at the trained precision does.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dse import store
from dse.base.native.threads import single_threaded
from dse.base.records import Array, Bools, Floats, Ints
from dse.base.seeds import generator
from dse.measure import decision
from dse.measure.objectives.accuracy import wilson_se
from dse.measure.on_chips import DRAWN
from dse.skyline.front import Draws, front_share
from dse.skyline.posterior import posterior_samples
from dse.skyline.table import group_numbers, numbers
from dse.store import StoreError
from dse.study import corrected, pricing
from dse.study.record import RunRecord, load_records

if TYPE_CHECKING:
    import pandas

ACCURACIES = corrected.ACCURACIES
"""Columns that are resampled, if the table has them."""

_SEED = 20261122
_WITHIN_SE = 5.0  # standard errors within which every sample is
_ANSWERS = ("index", "target", "output", "shape", "step_ms", "label", "time_ms")


def errors(folder: Path, rows: pandas.DataFrame, n_draws: int) -> Floats:
    """Return resampled accuracies less the measured ones, (draw, row), of design points of a study.

    Args:
        folder: of the study.
        rows: of its points, with all columns that identify them.
        n_draws: number of resamples; the same ones for all designs, and at every call.

    Raises:
        StoreError: an artefact is missing or damaged.
    """
    sampled = np.zeros((n_draws, len(rows)))
    seed_variance, n_free = 0.0, 0
    groups = list(rows.groupby("trial", sort=False).indices.values())
    trials, repeats = rows["trial"].to_numpy(np.int64), rows["repeats"].to_numpy(np.int64)
    for places in groups:
        of_trial = rows.iloc[places]
        records = load_records(folder, int(trials[places[0]]))[: repeats[places[0]]]
        right = [right_answers(folder, record, of_trial) for record in records]
        of_runs = np.stack(
            [_resampled(record, *answers, n_draws) for record, answers in zip(records, right, strict=True)]
        )
        sampled[:, places] = of_runs.mean(axis=0)
        if len(records) > 1:
            # What differs between runs beyond the recordings that they were measured on is the seed's.
            measured = np.stack([answers.mean(axis=0) for _, answers in right])
            of_seeds = measured.var(axis=0, ddof=1).mean() - of_runs.var(axis=0, ddof=1).mean()
            seed_variance += of_seeds * (len(records) - 1)
            n_free += len(records) - 1
    if n_free and seed_variance > 0:
        rng = generator(_SEED, {}, "seeds")
        scale = np.sqrt(seed_variance / rng.chisquare(n_free, n_draws))  # pooled, as of Student's t
        for places in groups:
            trial, n_runs = trials[places[0]], repeats[places[0]]
            unit = generator(_SEED, {}, "seed of a trial", int(trial)).standard_normal(n_draws)
            sampled[:, places] += (unit * scale / np.sqrt(n_runs))[:, None]
    return sampled


def draws(
    paths: Sequence[str | Path],
    frames: Sequence[pandas.DataFrame],
    hardware: Sequence[str],
    goals: Sequence[tuple[str, str]],
    n_draws: int,
    names: Sequence[str] = (),
    accuracies: Sequence[str] = ACCURACIES,
) -> Draws:
    """Return the joint sampler of accuracies, over recordings and seeds, and of hardware's uncertain numbers.

    Accuracies are samples of what is probably true (`dse.skyline.posterior`).

    Args:
        paths: studies.
        frames: their points; a row is identified by its position in the concatenation of all frames.
        hardware: as in `pricing.points`.
        goals: of the front.
        n_draws: number of samples.
        names: further columns, such as those with a budget.
        accuracies: those that are sampled; others are as they stand.

    Raises:
        StoreError: a frame is not from a study, or nothing among the columns is uncertain.
    """
    pricing.check_studies(paths, "sampling needs")
    columns = list(dict.fromkeys([*(name for name, _ in goals), *names]))
    accuracies = [name for name in columns if name in accuracies]
    on_chips = [name for name in columns if name in DRAWN]
    if on_chips and any("hardware" not in frame for frame in frames):
        if not accuracies:
            raise StoreError("nothing to sample: the points have no hardware; choose it with --hardware NAME")
        on_chips = []
    if not accuracies and not on_chips:
        raise StoreError(
            "nothing to sample: no objective or budget depends on uncertain numbers of hardware "
            f"({', '.join(DRAWN)})"
        )
    starts = np.cumsum([0, *map(len, frames)])
    others = [name for name, _ in goals if name not in accuracies]

    def of_studies(rows: pandas.DataFrame) -> Iterator[tuple[int, Path, Bools]]:
        study = np.searchsorted(starts, rows.index.to_numpy(), side="right") - 1
        for number in np.unique(study):
            yield int(number), Path(paths[number]), study == number

    @single_threaded()
    def of(rows: pandas.DataFrame) -> dict[str, Floats]:
        samples: dict[str, Floats] = {name: np.empty((n_draws, len(rows))) for name in on_chips}
        sampled, study = np.empty((n_draws, len(rows))), np.empty(len(rows), np.int64)
        for number, folder, here in of_studies(rows):
            study[here] = number
            if on_chips:
                for name, x in pricing.drawn(folder, rows[here], on_chips, n_draws, hardware).items():
                    samples[name][:, here] = x
            if accuracies:
                sampled[:, here] = errors(folder, rows[here], n_draws)
        group = group_numbers(rows, [name for name in ("task", "hardware") if name in rows])
        trial = group_numbers(rows.assign(study=study), ["study", "trial"])
        of_others = [numbers(rows, name) for name in others] if accuracies else []
        costs = np.stack([np.zeros(len(rows)), *of_others], axis=1)[:, 1:]
        bounds = ends(rows)
        for name in accuracies:
            measured, scaled = numbers(rows, name), sampled * _scale(rows, name)
            values = np.empty_like(scaled)
            for number in np.unique(group):
                of_group = np.flatnonzero(group == number)
                values[:, of_group] = posterior_samples(
                    measured[of_group],
                    costs[of_group],
                    trial[of_group],
                    scaled[:, of_group],
                    generator(_SEED, {}, "prior"),
                )
            samples[name] = np.clip(values, *bounds[name])
        return samples

    def ends(rows: pandas.DataFrame) -> dict[str, tuple[Floats, Floats]]:
        se = np.empty(len(rows))
        for _, folder, here in of_studies(rows) if accuracies else ():
            se[here] = _largest_se(folder, rows[here])
        within = {name: _WITHIN_SE * se * _scale(rows, name) for name in accuracies}
        return {name: (numbers(rows, name) - x, numbers(rows, name) + x) for name, x in within.items()}

    return Draws([*accuracies, *on_chips], of, ends)


def certainty(
    paths: Sequence[str | Path],
    frames: Sequence[pandas.DataFrame],
    hardware: Sequence[str],
    goals: Sequence[tuple[str, str]],
    n_draws: int,
    among: pandas.DataFrame,
    by: str | Sequence[str] | None = None,
) -> tuple[dict[str, pandas.Series], list[str]]:
    """Return the fractions of samples in which points are on their front, and why one is missing.

    front_share varies the hardware's uncertain numbers, front_probability also recordings and seeds.

    Args:
        paths: as of `draws`.
        frames: as of `draws`.
        hardware: as of `draws`.
        goals: as of `draws`.
        n_draws: number of samples.
        among: the rows of all frames that are compared.
        by: columns whose values have separate fronts.

    Raises:
        StoreError: a frame is not from a study, or nothing among the objectives is uncertain.
    """
    import pandas

    names = {name for name, _ in goals}
    columns: dict[str, pandas.Series] = {}
    notes = []

    def share(drawing: Draws) -> pandas.Series:
        return pandas.Series(front_share(among, goals, drawing, by), among.index)

    if not names & {*ACCURACIES} or (names & {*DRAWN} and all("hardware" in x for x in frames)):
        columns["front_share"] = share(draws(paths, frames, hardware, goals, n_draws, accuracies=()))
    if names & {*ACCURACIES}:
        try:
            columns["front_probability"] = share(draws(paths, frames, hardware, goals, n_draws))
        except StoreError as error:  # studies of earlier versions lack answers to single recordings
            notes.append(f"no front_probability: {error}")
    return columns, notes


def _resampled(record: RunRecord, index: Ints, right: Bools, n_draws: int) -> Floats:
    """Return a run's accuracies with recordings weighted at random, less their mean, (draw, point).

    Weights are exponential (the Bayesian bootstrap; Rubin, Ann. Stat. 9, 1981). Two answers of the run's own,
    one right and one wrong, keep accuracies of 0 and 1 uncertain. `right` says of each recording of `index`
    whether a point answers it right, (n, point).
    """
    weights = np.stack([_weights(int(i), n_draws) for i in index], axis=1)
    rng = generator(_SEED, {}, "own answers", record.trial, record.repeat)
    own = rng.exponential(size=(n_draws, 2))
    sums = weights @ right.astype(np.float32) + own[:, :1]
    accuracy = sums / (weights.sum(axis=1) + own.sum(axis=1))[:, None]
    return np.asarray(accuracy - accuracy.mean(axis=0), np.float64)


@functools.lru_cache(maxsize=1 << 16)
def _weights(recording: int, n_draws: int) -> Floats:
    """Return the weights of a recording in every resample, the same for all runs, (draw,)."""
    rng = generator(_SEED, {}, "recording", recording)
    return rng.standard_exponential(n_draws, dtype=np.float32)


def _largest_se(folder: Path, rows: pandas.DataFrame) -> Floats:
    """Return an upper bound of the standard error of each point's accuracy, (row,)."""
    accuracy = numbers(rows, "accuracy")
    se = np.nan_to_num(numbers(rows, "accuracy_se")) if "accuracy_se" in rows else np.zeros(len(rows))
    trials = rows["trial"].to_numpy(np.int64)
    for places in rows.groupby("trial", sort=False).indices.values():
        record = store.read_record(store.first_run(folder, int(trials[places[0]])))
        n = max(int(record["samples"]["validation"]), 1)
        se[places] += wilson_se(np.rint(np.nan_to_num(accuracy[places]) * n), n)
    return se


def _scale(rows: pandas.DataFrame, name: str) -> Floats:
    """Return how many times as uncertain as the plain accuracy an accuracy is, (row,), by standard errors."""
    if name == "accuracy" or not {f"{name}_se", "accuracy_se"} <= set(rows):
        return np.ones(len(rows))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = numbers(rows, f"{name}_se") / numbers(rows, "accuracy_se")
    return np.where(np.isfinite(ratio), np.clip(ratio, 0.5, 4.0), 1.0)


def right_answers(
    folder: Path, record: RunRecord, rows: pandas.DataFrame, answers: str = "response.npz"
) -> tuple[Ints, Bools]:
    """Return the recordings that a run was validated on, (n,), and which it answers right, (n, row)."""
    path = store.run_file(folder, record.trial, record.repeat) / answers
    arrays = store.load_arrays(path, _ANSWERS)
    right = np.zeros((len(arrays["index"]), len(rows)), dtype=bool)
    tasks = rows["task"].to_numpy(object) if record.heads else np.full(len(rows), "", object)
    first = 0
    for head in record.heads or (None,):
        n_classes = len(head.classes) if head else len(record.classes)
        here = np.flatnonzero(tasks == (head.name if head else ""))
        if len(here):
            of_class = head.of_class if head else np.arange(n_classes)
            outputs = slice(first, first + n_classes)
            right[:, here] = _right_at(arrays, of_class, outputs, rows.iloc[here])
        first += n_classes
    return arrays["index"], right


def _right_at(arrays: dict[str, Array], of_class: Ints, outputs: slice, rows: pandas.DataFrame) -> Bools:
    """Return whether the answers to one target are right at some of its points, (n, row)."""
    target = of_class[arrays["target"]]
    phi, theta, after_ms = (
        rows[name].to_numpy(np.float64, na_value=np.nan) if name in rows else np.full(len(rows), np.nan)
        for name in ("phi", "theta", "read_out_ms")
    )
    right = np.empty((len(target), len(rows)), dtype=bool)
    if "label" in arrays:  # a classifier without output spikes
        place = np.abs(arrays["time_ms"] - np.nan_to_num(after_ms, nan=np.inf)[:, None]).argmin(axis=1)
        place[np.isnan(after_ms)] = len(arrays["time_ms"]) - 1
        return np.asarray(of_class[arrays["label"]][:, place] == target[:, None])
    shape = tuple(arrays["shape"].tolist())
    spikes = np.unpackbits(arrays["output"], count=int(np.prod(shape))).reshape(shape)[..., outputs]
    decides = ~np.isnan(phi)
    if decides.any():
        phis, phi_place = np.unique(phi[decides], return_inverse=True)
        thetas, theta_place = np.unique(theta[decides], return_inverse=True)
        right[:, decides] = decision.right_at(spikes, target, phis, thetas)[:, phi_place, theta_place]
    steps = np.where(
        np.isnan(after_ms), shape[1], np.rint(np.nan_to_num(after_ms) / float(arrays["step_ms"]))
    )
    for n_steps in np.unique(steps[~decides]):
        label = spikes[:, : int(n_steps)].sum(axis=1, dtype=np.int64).argmax(axis=1)
        right[:, ~decides & (steps == n_steps)] = (label == target)[:, None]
    return right
