from __future__ import annotations

from typing import Any

import pytest

from dse.config.search import Stop
from dse.search.stop import Spent, gained, reached, unchanged_for

HOUR_S = 3600.0


def spent(**changes: Any) -> Spent:
    usual: dict[str, Any] = {
        "cpu_hours": 2.0,
        "wall_hours": 1.0,
        "session_s": 2 * HOUR_S,
        "ages_s": [1.9 * HOUR_S, 1.5 * HOUR_S, 0.5 * HOUR_S, 10.0],
        # Two designs on the front after an hour, and two that change nothing.
        "costs": [[-0.8, 50.0], [-0.9, 90.0], [-0.7, 60.0], [-0.85, 95.0]],
    }
    return Spent(**usual | changes)


@pytest.mark.parametrize(
    ("stop", "changes", "key"),
    [
        (Stop(cpu_hours=2.0), {}, "cpu_hours"),
        (Stop(cpu_hours=2.1), {}, ""),
        (Stop(wall_hours=1.0), {}, "wall_hours"),
        (Stop(wall_hours=1.1, cpu_hours=2.1), {}, ""),
        (Stop(pick_unchanged_for=2), {}, "pick_unchanged_for"),
        (Stop(pick_unchanged_for=3), {}, ""),
        (Stop(pick_unchanged_for=1), {"costs": [], "ages_s": []}, ""),
        (Stop(front_gain_per_hour=1.0), {}, "front_gain_per_hour"),
        (Stop(front_gain_per_hour=1.0), {"session_s": HOUR_S - 1}, ""),  # no hour has passed
        (Stop(front_gain_per_hour=1.0), {"ages_s": [9.0, 8.0, 7.0, 6.0]}, ""),  # nothing to compare with
        (
            Stop(front_gain_per_hour=1.0),
            {"costs": [[-0.8, 50.0], [-0.9, 90.0], [-0.9, 40.0], [0.0, 95.0]]},
            "",
        ),
        (Stop(cpu_hours=9.0, pick_unchanged_for=1), {}, "pick_unchanged_for"),
    ],
)
def test_the_first_condition_that_is_reached_is_named(stop: Stop, changes: dict[str, Any], key: str) -> None:
    text = reached(stop, spent(**changes))
    assert text.startswith(f"search.stop.{key} ") if key else not text


def test_the_gain_is_that_of_the_hypervolume() -> None:
    import numpy as np

    costs = np.array([[1.0, 0.0], [0.0, 1.0], [0.5, 0.5]])
    before = np.array([True, True, False])
    # 2 * 1.05 * 0.05 - 0.05 ** 2, and then the square up to (0.5, 0.5) beside two strips.
    first = 2 * 1.05 * 0.05 - 0.05**2
    last = first + 0.5**2
    assert gained(costs, before) == pytest.approx(100 * (last / first - 1))
    assert gained(costs, np.zeros(3, bool)) is None


def test_ties_in_the_first_objective_go_to_the_others() -> None:
    assert unchanged_for([[-0.9, 5.0], [-0.9, 4.0], [-0.8, 1.0]]) == 1
    assert unchanged_for([[-0.9, 4.0], [-0.9, 4.0], [-0.8, 1.0]]) == 2
