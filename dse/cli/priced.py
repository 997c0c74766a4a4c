"""Points of studies as the command line asks for them: on which hardware, and under draws of its figures."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from dse.cli.fronts import Objective

if TYPE_CHECKING:
    import pandas

    from dse.records import Array


def add_hardware(parser: argparse.ArgumentParser) -> None:
    """Declare `--hardware`."""
    parser.add_argument(
        "--hardware",
        action="append",
        default=[],
        metavar="NAME",
        help="price the points on this profile, or file of one, without training; repeatable",
    )


def points(paths: Sequence[str], hardware: Sequence[str]) -> list[pandas.DataFrame]:
    """Return the points of every study or table, priced anew where hardware is named.

    Raises:
        StoreError: hardware is named for what is no study.
    """
    from dse import pricing, skyline

    if hardware:
        _must_be_studies(paths, "--hardware needs")
        return [pricing.points(path, hardware) for path in paths]
    return [skyline.read(path) for path in paths]


def drawn(
    paths: Sequence[str], frames: Sequence[pandas.DataFrame], names: Sequence[str], n_draws: int
) -> dict[str, Array]:
    """Return the columns among `names` that depend on figures of hardware, (draw, row of all the frames).

    Raises:
        StoreError: a frame is of no study, or none of the columns depends on hardware.
    """
    import numpy as np

    from dse import pricing, store
    from dse.measure import DRAWN

    _must_be_studies(paths, "draws need")
    columns = [name for name in dict.fromkeys(names) if name in DRAWN]
    if not columns:
        raise store.StoreError(
            f"nothing to draw: no objective or budget is among {', '.join(DRAWN)}; others do not depend on it"
        )
    if any(not {"point", "hardware"} <= set(frame) for frame in frames):
        raise store.StoreError("nothing to draw: the points are on no hardware; name it: --hardware NAME")
    found = [pricing.drawn(path, frame, columns, n_draws) for path, frame in zip(paths, frames, strict=True)]
    return {name: np.concatenate([one[name] for one in found], axis=1) for name in columns}


def apart(frame: pandas.DataFrame, by: str | None, objectives: Sequence[Objective]) -> list[str]:
    """Return the columns whose values have a front each: as asked, and hardware where costs would mix."""
    from dse.config.sections import OF_HARDWARE

    asked = [name.strip() for name in by.split(",")] if by else []
    mixes = "hardware" in frame and frame["hardware"].nunique() > 1
    costs = any(name in OF_HARDWARE for name, _ in objectives)
    return [*asked, *(["hardware"] if mixes and costs and "hardware" not in asked else [])]


def _must_be_studies(paths: Sequence[str], who: str) -> None:
    from dse.store import StoreError

    for path in paths:
        if not Path(path).is_dir():
            raise StoreError(f"{path}: {who} the folder of a study, which holds the work of its points")
