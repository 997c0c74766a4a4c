"""Points of studies on any hardware, on a duty cycle, and under samples of the hardware's figures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas

    from dse.records import Array
    from dse.skyline.front import Draws


def on_duty(
    frame: pandas.DataFrame, contacts_per_hour: float | None, battery_mwh: float | None
) -> pandas.DataFrame:
    """Return points with their mean power and battery life, where these are asked for.

    Both are NaN where contacts would overlap, where the profile does not say what idling takes, and where
    the chip cannot run the classifier.

    Raises:
        StoreError: points have no such costs, or a battery is asked of no contacts.
    """
    import numpy as np

    from dse.hardware.duty import battery_h, mean_power_mw
    from dse.store import StoreError

    if contacts_per_hour is None:
        if battery_mwh is not None:
            raise StoreError("--battery-mwh needs --contacts-per-hour (0: always idle)")
        return frame
    needed = ("energy_throttled_uj", "idle_mw", "hardware_latency_ms", "decision_latency_ms")
    lacking = [name for name in needed if name not in frame]
    if lacking:
        raise StoreError(
            f"--contacts-per-hour needs the column {lacking[0]}; choose hardware that has it with "
            "--hardware NAME"
        )
    energy, idle, computing, window = (frame[name].to_numpy(np.float64, na_value=np.nan) for name in needed)
    contact_ms = np.fmax(computing, window)
    apart = contacts_per_hour * contact_ms <= 3.6e6
    known = np.where((idle > 0) & apart, idle, np.nan)
    power = mean_power_mw(contacts_per_hour, energy, np.where(apart, contact_ms, 0.0), known)
    lasts = {} if battery_mwh is None else {"battery_h": battery_h(battery_mwh, power)}
    return frame.assign(power_mw=power, **lasts)


def points(paths: Sequence[str], hardware: Sequence[str]) -> list[pandas.DataFrame]:
    """Return the points of every study or table, priced anew where hardware is named.

    Raises:
        StoreError: hardware is named for what is no study.
    """
    from dse.skyline import table
    from dse.study import pricing

    if hardware:
        _must_be_studies(paths, "--hardware needs")
        return [pricing.points(path, hardware) for path in paths]
    return [table.read(path) for path in paths]


def draws(
    paths: Sequence[str],
    frames: Sequence[pandas.DataFrame],
    hardware: Sequence[str],
    names: Sequence[str],
    n_draws: int,
) -> Draws:
    """Return draws of the columns among `names` that depend on figures of hardware.

    Args:
        paths: studies.
        frames: their points; rows are asked for by their place in all of them, one after the other.
        hardware: as of `points`.
        names: columns.
        n_draws: how often figures are drawn.

    Raises:
        StoreError: a frame is of no study, or none of the columns depends on hardware.
    """
    import numpy as np

    from dse import store
    from dse.measure.on_chips import DRAWN
    from dse.skyline.front import Draws
    from dse.study import pricing

    _must_be_studies(paths, "sampling needs")
    columns = [name for name in dict.fromkeys(names) if name in DRAWN]
    if not columns:
        raise store.StoreError(
            "nothing to sample: no objective or budget depends on uncertain numbers of hardware "
            f"({', '.join(DRAWN)})"
        )
    if any("hardware" not in frame for frame in frames):
        raise store.StoreError(
            "nothing to sample: the points have no hardware; choose it with --hardware NAME"
        )
    starts = np.cumsum([0, *map(len, frames)])

    def of(rows: pandas.DataFrame) -> dict[str, Array]:
        study = np.searchsorted(starts, rows.index.to_numpy(), side="right") - 1
        found = {name: np.empty((n_draws, len(rows))) for name in columns}
        for number in np.unique(study):
            own = study == number
            costs = pricing.drawn(paths[number], rows[own], columns, n_draws, hardware)
            for name in columns:
                found[name][:, own] = costs[name]
        return found

    return Draws(columns, of)


def _must_be_studies(paths: Sequence[str], who: str) -> None:
    from dse.store import StoreError

    for path in paths:
        if not Path(path).is_dir():
            raise StoreError(
                f"{path}: {who} the folder of a study, which holds the work counts of its points"
            )
