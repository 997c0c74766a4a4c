"""What the design points of a study cost on any hardware, and how sure that is; nothing is trained for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dse import points as _points
from dse import seeds, skyline, store
from dse.config.sections import OF_HARDWARE
from dse.hardware.profile import Figures, Profile, load, read
from dse.records import Array

if TYPE_CHECKING:
    import pandas

_FOLDER = "hardware"

DRAWS = 200
"""How often a chip's figures are drawn where nothing else is said."""


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
    return chip.drawn(n_draws, seeds.generator(0, {"hardware": chip.name}, "figures"))


def points(folder: str | Path, hardware: Sequence[str]) -> pandas.DataFrame:
    """Return the design points of a study, priced on other hardware than it was run with.

    Args:
        folder: of the study.
        hardware: names of profiles, or files.

    Raises:
        ConfigError: a profile does not exist or is wrong.
        StoreError: the study's artefacts are damaged, or too old to hold the work of their points.
    """
    import pandas

    folder = Path(folder)
    chips = [profile(folder, name) for name in hardware]
    table = skyline.read(folder)
    if "point" not in table:
        raise store.StoreError(f"{folder}: is of an older version, which kept no work to price; run it again")
    if "hardware" in table:
        table = table[table["hardware"] == table["hardware"].iloc[0]]
    table = table.drop(columns=[name for name in table if name in OF_HARDWARE])
    priced = []
    for chip in chips:
        columns = [
            pandas.DataFrame(
                _points.priced(folder, records(folder, int(own["trial"].iloc[0])), chip), own.index
            )
            for _, own in table.groupby("trial", sort=False)
        ]
        priced.append(pandas.concat([table.assign(hardware=chip.name), pandas.concat(columns)], axis=1))
    return pandas.concat(priced, ignore_index=True)


def drawn(
    folder: str | Path, rows: pandas.DataFrame, columns: Sequence[str], n_draws: int = DRAWS
) -> dict[str, Array]:
    """Return hardware columns of design points under draws of their chips' figures, (n_draws, row) each.

    Args:
        folder: of the study.
        rows: of its points; columns `trial`, `point` and `hardware` say which.
        columns: some of `dse.measure.DRAWN`.
        n_draws: how many; the same ones at every call, and for all designs on a chip.

    Returns:
        NaN where the chip cannot run the classifier.

    Raises:
        ConfigError, StoreError: as `points`.
    """
    folder = Path(folder)
    found = {name: np.full((n_draws, len(rows)), np.nan) for name in columns}
    trial_of, point_of, chip_of = (rows[name].to_numpy() for name in ("trial", "point", "hardware"))
    for name in dict.fromkeys(chip_of.tolist()):
        chip = profile(folder, name)
        figures_of_it = figures(chip, n_draws)
        for trial in dict.fromkeys(trial_of[chip_of == name].tolist()):
            own = np.flatnonzero((chip_of == name) & (trial_of == trial))
            costs = _points.drawn(folder, records(folder, trial), chip, figures_of_it, columns)
            for column, values in costs.items():
                found[column][:, own] = values[:, point_of[own]]
    return found


def energies_uj(folder: str | Path, rows: pandas.DataFrame, hardware: str, n_draws: int = DRAWS) -> Array:
    """Return the energies of design points on one chip under draws of its figures, (n_draws, row) in uJ.

    Args:
        folder: of the study.
        rows: of its points, on whatever hardware they are priced.
        hardware: name of a profile.
        n_draws: as of `drawn`.
    """
    return drawn(folder, rows.assign(hardware=hardware), ("energy_uj",), n_draws)["energy_uj"]


def records(folder: Path, trial: int) -> list[Mapping[str, Any]]:
    """Return the records of a trial's runs, repeat 0 first.

    Raises:
        StoreError: an artefact is damaged, or the study has no such trial.
    """
    folders = store.run_folder(folder, trial, 0).parent.glob("repeat_*")
    found = [record for each in folders if (record := store.load_run(each)) is not None]
    if not found:
        raise store.StoreError(f"{folder}: has no trial {trial}")
    return sorted(found, key=lambda record: int(record["repeat"]))
