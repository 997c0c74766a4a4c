"""Where the channels of a sensor lie: x, y and plane, one row each, (n_channels, 3) int32.

A plane holds the copies of a channel that lie at one place: polarities, thresholds, receptors.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dse.recordings import RecordingError
from dse.records import Ints
from dse.registry import param

Positions = tuple[tuple[int, int], ...]
"""[x, y] of every taxel."""

# Event addresses are 16 bits wide in every format that is read.
_HIGHEST = 65535


def positions_key() -> Any:
    """Declare the key `positions` of a component."""
    return param(
        None,
        doc="[x, y] of every taxel, integers (default: x is the number of the taxel, y is 0)",
        low=0,
        high=_HIGHEST,
        axis=False,
    )


def check_positions(positions: Positions | None) -> None:
    """Refuse positions that are no places of taxels.

    Raises:
        RecordingError: not two whole numbers >= 0 each, or two taxels at one place.
    """
    first: dict[tuple[int, int], int] = {}
    for i, place in enumerate(() if positions is None else positions):
        pair = tuple(place) if isinstance(place, tuple | list) else (place,)
        whole = all(isinstance(u, int) and not isinstance(u, bool) and 0 <= u <= _HIGHEST for u in pair)
        if len(pair) != 2 or not whole:
            raise RecordingError(
                f"data.positions must be [x, y] with integers from 0 to {_HIGHEST} for every taxel, "
                f"got {list(pair)} for taxel {i}"
            )
        if pair in first:
            raise RecordingError(
                f"data.positions must be distinct, got {list(pair)} for taxels {first[pair]} and {i}"
            )
        first[pair] = i


def position_faults(positions: Positions | None, n_taxels: int | None) -> list[str]:
    """Return what is wrong with the number of positions; None: the number of taxels is not known."""
    if positions is None or n_taxels is None or len(positions) == n_taxels:
        return []
    return [f"data.positions must hold [x, y] for each of the {n_taxels} taxels, got {len(positions)}"]


def taxel_positions(positions: Positions | None, taxel: Ints, plane: Ints) -> Ints:
    """Return x, y and plane of channels of which the number of the taxel and the plane are known.

    Args:
        positions: as checked, or None.
        taxel: (n_channels,) numbers from 0, none left out.
        plane: (n_channels,) numbers.

    Raises:
        RecordingError: another number of positions than of taxels.
    """
    n_taxels = int(taxel.max()) + 1
    for fault in position_faults(positions, n_taxels):
        raise RecordingError(fault)
    if positions is None:
        x, y = taxel, np.zeros_like(taxel)
    else:
        x, y = np.array(positions, dtype=np.int32).reshape(n_taxels, 2)[taxel].T
    return np.stack([x, y, plane], axis=1).astype(np.int32)
