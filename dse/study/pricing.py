"""What the design points of a study cost on any hardware, and how sure that is; nothing is trained for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dse import registry, store
from dse.config import ConfigError, Fault
from dse.hardware.profile import Figures, Profile, load, read
from dse.records import Array
from dse.skyline.table import read as read_table
from dse.study import points as _points
from dse.study.precision import AS_TRAINED, Setting

if TYPE_CHECKING:
    import pandas

_FOLDER = "hardware"

DRAWS = 200
"""Default number of samples of a chip's uncertain numbers."""


def check(profiles: Sequence[Profile], folder: Path) -> None:
    """Check that profiles say what a study keeps of them: its samplers were told costs by those figures.

    Raises:
        ConfigError: one says something else.
    """
    faults = []
    for chip in profiles:
        kept = folder / _FOLDER / f"{chip.name}.yaml"
        if kept.is_file() and _figures(profile(folder, chip.name)) != _figures(chip):
            hint = "change it back, rename the profile, or use another --results folder"
            faults.append(Fault(chip.name, 0, f"the numbers differ from those in {kept}; {hint}"))
    if faults:
        raise ConfigError(faults)


def _figures(chip: Profile) -> object:
    """Return what costs come from: not the sources, nor what is said about them."""
    return type(chip), chip.interval_only, [chip.at(end) for end in ("low", "value", "high")]


def keep(profiles: Sequence[Profile], folder: Path) -> None:
    """Write the profiles of a study to its folder, as they are now."""
    for profile in profiles:
        store.write_text(folder / _FOLDER / f"{profile.name}.yaml", profile.text)


def profile(folder: Path, name: str) -> Profile:
    """Return a hardware profile: as a study kept it, or the package's, or a file.

    Raises:
        ConfigError: there is none, or it is wrong.
    """
    kept = folder / _FOLDER / f"{name}.yaml"
    if kept.is_file():
        return read(kept.read_text(encoding="utf-8"), str(kept))
    return load(name)


def figures(chip: Profile, n_draws: int) -> Figures:
    """Return draws of a chip's figures, the same at every call: designs are compared on the same draw."""
    return chip.draws(n_draws)


def profiles(folder: Path, hardware: Sequence[str]) -> list[Profile]:
    """Return hardware profiles of different names; one that is named twice is meant once.

    Raises:
        ConfigError: as `profile`, or two files give one name.
    """
    found: dict[str, Profile] = {}
    for name in dict.fromkeys(hardware):
        chip = profile(folder, name)
        if found.setdefault(chip.name, chip) != chip:
            raise ConfigError([Fault(name, 0, f"another profile has the name '{chip.name}' too")])
    return list(found.values())


def points(folder: str | Path, hardware: Sequence[str]) -> pandas.DataFrame:
    """Return the design points of a study, priced on other hardware than it was run with.

    Args:
        folder: of the study.
        hardware: names of profiles, or files.

    Raises:
        ConfigError: a profile does not exist or is wrong.
        StoreError: the study has no design points, or its artefacts are damaged.
    """
    import pandas

    folder = Path(folder)
    chips = profiles(folder, hardware)
    table = read_table(folder)
    if table.empty:
        raise store.StoreError(f"{folder}: has no design points: no trial has finished")
    if "hardware" in table:
        table = table[table["hardware"] == table["hardware"].iloc[0]]
    of_hardware = registry.columns("hardware")
    table = table.drop(columns=[name for name in table if name in of_hardware])
    on: list[list[pandas.DataFrame]] = [[] for _ in chips]
    for trial, own in table.groupby("trial", sort=False):
        answered = _answered(folder, trial, own)
        if sum(map(len, answered)) != len(own):
            raise store.StoreError(f"{folder}: the points of trial {trial} have changed; run the study again")
        for columns, chip in zip(on, chips, strict=True):
            columns.append(pandas.DataFrame(_points.priced(answered, chip), own.index))
    priced = [
        pandas.concat([table.assign(hardware=chip.name), pandas.concat(columns)], axis=1)
        for chip, columns in zip(chips, on, strict=True)
    ]
    found = pandas.concat(priced, ignore_index=True)
    # A chip that no design can run on has no costs; fronts over them still look for the columns.
    lacking = {name: np.nan for name in ("energy_uj", "energy_uj_high", "latency_ms") if name not in found}
    return found.assign(**lacking).astype({"fits": "boolean"} if "fits" in found else {})


def drawn(
    folder: str | Path,
    rows: pandas.DataFrame,
    columns: Sequence[str],
    n_draws: int = DRAWS,
    hardware: Sequence[str] = (),
) -> dict[str, Array]:
    """Return hardware columns of design points under draws of their chips' figures, (n_draws, row) each.

    Args:
        folder: of the study.
        rows: of its points, with all columns that say which.
        columns: some of `dse.measure.on_chips.DRAWN`.
        n_draws: how many; the same ones at every call, and for all designs on a chip.
        hardware: as of `points`, where the rows are from there: files are not found by the name of a profile.

    Returns:
        NaN where the chip cannot run the classifier.

    Raises:
        ConfigError, StoreError: as `points`.
    """
    folder = Path(folder)
    found = {name: np.full((n_draws, len(rows)), np.nan) for name in columns}
    named = {chip.name: chip for chip in profiles(folder, hardware)}
    chips = {name: named.get(name) or profile(folder, name) for name in rows["hardware"].unique()}
    draws = {name: figures(chip, n_draws) for name, chip in chips.items()}
    for trial, place in rows.groupby("trial", sort=False).indices.items():
        own = rows.iloc[place]
        answered = _answered(folder, trial, own)
        wanted = _place(own, sum(map(len, answered)))
        for name, chip in chips.items():
            here = np.flatnonzero(own["hardware"] == name)
            if len(here):
                costs = _points.drawn(answered, chip, draws[name], columns, wanted[here])
                for column, values in costs.items():
                    found[column][:, place[here]] = values
    return found


def _settings(rows: pandas.DataFrame) -> list[Setting]:
    """Return the other precisions of some points of a trial, in the order of all its points."""
    if "weight_bits" not in rows:
        return []
    pairs = rows[["weight_bits", "pruned_after"]].dropna().drop_duplicates().itertuples(index=False)
    return sorted({(int(bits), float(pruned)) for bits, pruned in pairs} - {AS_TRAINED})


def _answered(folder: Path, trial: Any, rows: pandas.DataFrame) -> list[_points.Answered]:
    """Return what a trial answers at the precisions of some rows, by the runs that these are means of.

    There may be more by now: a study that is being run writes its table now and then.
    """
    runs = records(folder, int(trial))[: int(rows["repeats"].iloc[0])]
    return _points.answers(folder, runs, _settings(rows))


def _place(rows: pandas.DataFrame, n_points: int) -> Array:
    """Return where points are among those that a trial has at the precisions of these rows alone."""
    settings = _settings(rows)
    n_each = n_points // (1 + len(settings))  # the same at every precision
    found = rows["point"].to_numpy() % n_each
    for number, (bits, pruned) in enumerate(settings, 1):
        at = (rows["weight_bits"] == bits) & (rows["pruned_after"] == pruned)
        found[at.to_numpy()] += number * n_each
    return np.asarray(found)


def records(folder: Path, trial: int) -> list[Mapping[str, Any]]:
    """Return the records of a trial's runs, repeat 0 first.

    Raises:
        StoreError: an artefact is damaged, or the study has no such trial.
    """
    folders = store.run_folder(folder, trial, 0).parent.glob("repeat_*")
    found = [record for each in folders if (record := store.load_run(each)) is not None]
    if not found:
        raise store.StoreError(f"{folder}: there is no trial {trial}")
    return sorted(found, key=lambda record: int(record["repeat"]))
