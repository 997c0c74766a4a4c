"""Costs of the design points of studies on any hardware, their uncertainty, and costs at a rate of contacts.

This trains nothing: a study stores the work counts of its points.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from dse import store
from dse.base import registry
from dse.base.records import Floats, Ints, Workload
from dse.config import ConfigError, Fault
from dse.config.settings import Schedule
from dse.measure.hardware.cost import cost
from dse.measure.hardware.duty import on_schedule
from dse.measure.hardware.profile import End, Profile, load, read
from dse.skyline.table import read as read_table
from dse.store import StoreError
from dse.study import held
from dse.study import points as _points
from dse.study.held import plain_space
from dse.study.precision import AS_TRAINED, Setting
from dse.study.record import RunRecord, load_records

if TYPE_CHECKING:
    import pandas

_FOLDER = "hardware"
_ENDS: tuple[End, ...] = get_args(End)


def check(profiles: Sequence[Profile], folder: Path) -> list[str]:
    """Check that profiles have the numbers that a study stores: its sampler received costs from these.

    Returns:
        A sentence about each copy that is damaged, or lacks numbers; `keep` writes it anew.

    Raises:
        ConfigError: a number of a profile has changed.
    """
    faults, notes = [], []
    for chip in profiles:
        stored = folder / _FOLDER / f"{chip.name}.yaml"
        try:
            before = kept(folder, chip.name) if stored.is_file() else chip
        except store.Damaged as error:
            notes.append(f"{error}; it is written anew")
            continue
        if lacking := len(set(chip.stated) - set(before.stated)):
            notes.append(
                f"{stored} lacks {lacking} numbers that {chip.name} has now: classifiers trained before may "
                f"lack the counts that these price, and then cost otherwise than those of new trials"
            )
        if differ(before, chip):
            hint = "change it back, rename the profile, or use another --results folder"
            faults.append(Fault(chip.name, 0, f"the numbers differ from those in {stored}; {hint}"))
    if faults:
        raise ConfigError(faults)
    return notes


def differ(one: Profile, other: Profile) -> bool:
    """Return whether two profiles price differently: any number that both have, without sources and notes."""
    if type(one) is not type(other) or one.interval_only != other.interval_only:
        return True
    both = set(one.stated) & set(other.stated)
    return any(one.at(end)[name] != other.at(end)[name] for end in _ENDS for name in both)


def keep(profiles: Sequence[Profile], folder: Path) -> None:
    """Write the profiles of a study to its folder, as they are now."""
    for chip in profiles:
        store.write_text(folder / _FOLDER / f"{chip.name}.yaml", chip.text)


def profile(folder: Path, name: str) -> Profile:
    """Return a hardware profile on the schedule of a study: the study's copy, or a shipped one, or a file.

    Raises:
        ConfigError: as `kept`.
        StoreError: the search space is damaged.
    """
    return replace(kept(folder, name), schedule=schedule_of(folder))


def kept(folder: Path, name: str) -> Profile:
    """Return a hardware profile: the study's copy, or a shipped one, or a file.

    Raises:
        ConfigError: there is none, or it is wrong; of the study's copy in one line.
    """
    stored = folder / _FOLDER / f"{name}.yaml"
    if not stored.is_file():
        return load(name)
    text = store.read_text(stored)
    try:
        return read(text, str(stored))
    except ConfigError as error:
        why = f"another version of dse wrote this profile ({error.faults[0].message.split(';')[0]})"
        remedy = f"`dse doctor {folder} --repair` prices the study with the profile as it is now"
        raise ConfigError([Fault(str(stored), 0, f"{why}; {remedy}")]) from None


def label_of(folder: Path, name: str) -> str:
    """Return what readers call the hardware of a study's points: that of its profile, or its name."""
    for read_it in (functools.partial(kept, folder), load):  # copies of earlier studies have no label
        with contextlib.suppress(ConfigError, StoreError):
            if label := read_it(name).label:
                return label
    return name


def schedule_of(folder: Path, contacts_per_hour: float | None = None) -> Schedule | None:
    """Return the schedule of a study, or that of a rate of contacts in its place."""
    if contacts_per_hour is not None:
        return Schedule(contacts_per_hour=contacts_per_hour)
    path = folder / store.SPACE
    stated = plain_space(path).get("schedule") if path.is_file() else None
    return None if stated is None else Schedule(**stated)


def profiles(folder: Path, hardware: Sequence[str]) -> list[Profile]:
    """Return hardware profiles by their names or files, without duplicates.

    Raises:
        ConfigError: as `profile`, or two files give one name.
    """
    chips: dict[str, Profile] = {}
    for name in dict.fromkeys(hardware):
        chip = profile(folder, name)
        if chips.setdefault(chip.name, chip) != chip:
            raise ConfigError([Fault(name, 0, f"another profile has the name '{chip.name}' too")])
    return list(chips.values())


def points(folder: str | Path, hardware: Sequence[str]) -> pandas.DataFrame:
    """Return the design points of a study with the costs on other hardware than it was run with.

    Args:
        folder: of the study.
        hardware: names of profiles, or files.

    Raises:
        ConfigError: a profile does not exist or is wrong.
        StoreError: the study's artefacts are damaged, or no longer match the points of its table.
    """
    import pandas

    folder = Path(folder)
    chips = profiles(folder, hardware)
    table = held.without_lost(folder, read_table(folder))
    if "hardware" in table and len(table):
        table = table[table["hardware"] == table["hardware"].iloc[0]]
    of_hardware = registry.columns("hardware")
    table = table.drop(columns=[name for name in table if name in of_hardware])
    priced = [
        pandas.concat([table.assign(hardware=chip.name), on_chip], axis=1)
        for chip, on_chip in zip(chips, costs(folder, table, chips), strict=True)
    ]
    whole = pandas.concat(priced, ignore_index=True)
    # A chip that no design can run on has no costs; fronts over them still look for the columns.
    lacking = {name: np.nan for name in ("energy_uj", "energy_uj_high", "latency_ms") if name not in whole}
    whole = whole.assign(**lacking).astype({"fits": "boolean"} if "fits" in whole else {})
    return whole.copy()  # in one piece: pandas warns where more columns are added to many


def costs(folder: str | Path, rows: pandas.DataFrame, chips: Sequence[Profile]) -> list[pandas.DataFrame]:
    """Return the hardware columns of design points, with the index of the points: a table per chip.

    Args:
        folder: of the study.
        rows: of its points, with all columns that identify them (`dse.study.points.places`).
        chips: on which they are priced.

    Raises:
        StoreError: as in `points`.
    """
    import pandas

    folder = Path(folder)
    on: list[list[pandas.DataFrame]] = [[] for _ in chips]
    for _, of_trial in rows.groupby("trial", sort=False):
        answers, places = answered(folder, of_trial)
        for parts, chip in zip(on, chips, strict=True):
            priced = _points.priced(answers, chip)
            parts.append(pandas.DataFrame({name: x[places] for name, x in priced.items()}, of_trial.index))
    return [pandas.concat(parts) for parts in on]


def at_rate(frame: pandas.DataFrame, contacts_per_hour: float) -> pandas.DataFrame:
    """Return points with power_mw and energy_per_hour_mj at a rate of contacts, in place of the study's.

    They are NaN if contacts would overlap, if the profile does not state the idle power, or if the chip
    cannot run the classifier.
    """
    needed = ("energy_throttled_uj", "idle_mw", "hardware_latency_ms", "decision_latency_ms")
    lacking = [name for name in needed if name not in frame]
    if lacking:
        raise StoreError(
            f"--contacts-per-hour needs the column {lacking[0]}; choose hardware that has it with "
            "--hardware NAME"
        )
    energy, idle, computing, window = (frame[name].to_numpy(np.float64, na_value=np.nan) for name in needed)
    schedule = Schedule(contacts_per_hour=contacts_per_hour)
    columns = on_schedule(schedule, energy, np.fmax(computing, window), idle)
    return frame.drop(columns="battery_days", errors="ignore").assign(**columns)


def drawn(
    folder: str | Path,
    rows: pandas.DataFrame,
    columns: Sequence[str],
    n_draws: int,
    hardware: Sequence[str] = (),
) -> dict[str, Floats]:
    """Return hardware columns of design points under samples of their chips' numbers, (n_draws, row) each.

    Args:
        folder: of the study.
        rows: of its points, with all columns that identify them (`dse.study.points.places`).
        columns: some of `dse.measure.on_chips.DRAWN`.
        n_draws: number of samples; the same ones at every call, and for all designs on a chip.
        hardware: as in `points`, if the rows are from there: a profile's name does not give its file.

    Returns:
        NaN for points that the chip cannot run.

    Raises:
        ConfigError, StoreError: as in `points`.
    """
    folder = Path(folder)
    samples: dict[str, Floats] = {name: np.full((n_draws, len(rows)), np.nan) for name in columns}
    named = {chip.name: chip for chip in profiles(folder, hardware)}
    chips = {name: named.get(name) or profile(folder, name) for name in rows["hardware"].unique()}
    figures_of = {name: chip.draws(n_draws) for name, chip in chips.items()}
    for indices in rows.groupby("trial", sort=False).indices.values():
        of_trial = rows.iloc[indices]
        answers, places = answered(folder, of_trial)
        for name, chip in chips.items():
            on_chip = np.flatnonzero(of_trial["hardware"] == name)
            if len(on_chip):
                costs = _points.drawn(answers, chip, figures_of[name], columns, places[on_chip])
                for column, values in costs.items():
                    samples[column][:, indices[on_chip]] = values
    return samples


def misfits(folder: str | Path, row: pandas.Series[Any], hardware: Sequence[str] = ()) -> list[str]:
    """Return why a design point does not fit its hardware, a sentence each.

    Args:
        folder: of the study.
        row: of its points.
        hardware: as in `points`, if the row is from there.

    Raises:
        ConfigError, StoreError: as in `points`.
    """
    chips = {chip.name: chip for chip in profiles(Path(folder), hardware)}
    chip = chips.get(row["hardware"]) or profile(Path(folder), row["hardware"])
    [piece, *_], _ = answered(Path(folder), row.to_frame().T)
    return [str(misfit) for misfit in cost(chip, piece.work[0]).misfits]


def work_is_counted(folder: str | Path, rows: pandas.DataFrame) -> bool:
    """Return whether the program of a trial's classifier was counted: not by runs of earlier versions.

    Raises:
        StoreError: as in `points`.
    """
    loads = [load for piece in answered(Path(folder), rows)[0] for load in piece.work]
    return all(isinstance(load, Workload) or bool(load.program) for load in loads)


def _precisions(rows: pandas.DataFrame) -> list[Setting]:
    """Return the precisions, other than the trained one, of some points of a trial."""
    if "weight_bits" not in rows:
        return []
    pairs = rows[["weight_bits", "pruned_after"]].dropna().drop_duplicates().itertuples(index=False)
    return sorted({(int(bits), float(pruned)) for bits, pruned in pairs} - {AS_TRAINED})


def runs_of(folder: Path, rows: pandas.DataFrame) -> list[RunRecord]:
    """Return the records of the runs behind some points of a trial.

    The trial may have more runs by now: a running study writes its table at intervals.
    """
    return load_records(folder, int(rows["trial"].iloc[0]))[: int(rows["repeats"].iloc[0])]


def answered(folder: Path, rows: pandas.DataFrame) -> tuple[list[_points.Answered], Ints]:
    """Return the answers of a trial at the precisions of some of its points, and the place of each point.

    Raises:
        StoreError: an artefact is damaged, or the answers no longer match the points.
    """
    answers = _points.answers(folder, runs_of(folder, rows), _precisions(rows))
    places = _points.places(answers, rows)
    if (places < 0).any():
        trial = rows["trial"].iloc[0]
        raise StoreError(f"{folder}: the points of trial {trial} have changed; run the study again")
    return answers, places


def check_studies(paths: Sequence[str | Path], who: str) -> None:
    """Check that paths are folders of studies."""
    for path in paths:
        if not Path(path).is_dir():
            raise StoreError(
                f"{path}: {who} the folder of a study, which holds the work counts of its points"
            )
