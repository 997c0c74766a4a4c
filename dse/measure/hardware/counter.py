"""Power of this machine's processor, from its energy counters (RAPL, in Linux under /sys/class/powercap).

A counter belongs to a processor package and counts everything that runs on it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

_ROOT = Path("/sys/class/powercap")
_LEAST_S = 1.0  # of work; a shorter one is repeated


class CounterError(ValueError):
    """The machine has no energy counter that can be read; one sentence says why."""


@dataclass(frozen=True)
class MeasuredPower:
    """Mean power of the processor packages at rest and during some work, in W; None for the `reason`."""

    idle_w: float | None
    running_w: float | None
    reason: str = ""


def measured_power(work: Callable[[], object], rest_s: float, root: Path = _ROOT) -> MeasuredPower:
    """Measure the power at rest, then during some work, which is repeated for a second or longer.

    Args:
        work: what the processor is to do.
        rest_s: time at rest, > 0.
        root: folder of the counters.
    """
    try:
        idle_w = _power_w(lambda: time.sleep(rest_s), rest_s, root)
        return MeasuredPower(idle_w, _power_w(work, _LEAST_S, root))
    except CounterError as error:
        return MeasuredPower(None, None, str(error))


def _power_w(work: Callable[[], object], least_s: float, root: Path) -> float:
    before, began_s = _energies_uj(root), time.perf_counter()
    elapsed_s = 0.0
    while elapsed_s < least_s:
        work()
        elapsed_s = time.perf_counter() - began_s
    after = _energies_uj(root)
    spent_uj = sum(
        # A counter that reaches its range starts again at 0.
        energy + (span if energy < before[counter][0] else 0) - before[counter][0]
        for counter, (energy, span) in after.items()
    )
    return spent_uj * 1e-6 / elapsed_s


def _energies_uj(root: Path) -> dict[str, tuple[int, int]]:
    """Return counter -> its energy and its range, for every processor package."""
    try:
        zones = [
            zone for zone in sorted(root.glob("intel-rapl:*")) if _text(zone / "name").startswith("package")
        ]
        energies = {
            zone.name: (int(_text(zone / "energy_uj")), int(_text(zone / "max_energy_range_uj")))
            for zone in zones
        }
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise CounterError(f"the energy counter in {root} cannot be read: {reason}") from None
    if not energies:
        raise CounterError(f"this machine has no energy counter of its processor in {root}")
    return energies


def _text(path: Path) -> str:
    return path.read_text(encoding="ascii").strip()
