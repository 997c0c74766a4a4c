"""Whether the stated probability that a spiking design is the most accurate is what test recordings show.

    python -m benchmarks.odds STUDY [STUDY ...] [--budgets 100]

Of each study and chip, and within random limits of costs, the question is asked as `dse report` asks it:
"should it spike?". Printed are, by the stated probability, how often it was stated, its mean, and how often
the spiking design that is most accurate on validation beats the other one on the test recordings; equal ones
count as half. Where test recordings are few, they decide with an error of their own, which moves what they
show towards a half. Then the answers without limits, study by study.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from dse.skyline.rivals import spiking
from dse.study import results
from dse.study.question import Question
from dse.study.rivals import of_study

COSTS = ("energy_uj", "latency_ms", "n_weights", "memory_bytes")
EDGES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
_SEED = 12


class Stated(NamedTuple):
    """A probability, and what the test recordings show of it: 1, 0, or a half."""

    study: str
    hardware: str
    answer: str
    probability: float
    shown: float


def main() -> None:
    """Ask, and print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("studies", nargs="+", type=Path)
    parser.add_argument("--budgets", type=int, default=100, help="random limits per study")
    options = parser.parse_args()
    rng = np.random.default_rng(_SEED)
    found = [x for folder in options.studies for x in asked(folder, rng, options.budgets)]
    table = pd.DataFrame(found, columns=Stated._fields)
    by = pd.cut(table["probability"], EDGES, include_lowest=True)
    print(table.groupby(by, observed=True)[["probability", "shown"]].agg(["size", "mean"]).to_string())
    score = ((table["probability"] - table["shown"]) ** 2).mean()
    print(f"{len(table)} statements, Brier score {score:.3f} (0.25: a half each time)")
    plain = [x for folder in options.studies for x in asked(folder, rng, 0)]
    print(pd.DataFrame(plain, columns=Stated._fields).to_string())


def asked(folder: Path, rng: np.random.Generator, n_budgets: int) -> Iterator[Stated]:
    """Yield what a study states within random limits, on each chip; without limits where there are none."""
    study = results.open(folder)
    points = study.points()
    for _ in range(max(1, n_budgets)):
        costs = rng.choice(COSTS, rng.integers(1, 3), replace=False) if n_budgets else []
        budgets = [f"{x} <= {points[x].quantile(rng.uniform(0.1, 1)):.6g}" for x in costs]
        for of in of_study(study, Question(), budgets):
            if of.odds:
                within = points.query(" and ".join([f"hardware == '{of.hardware}'", *budgets]))
                shown = test_of(within)
                if shown is not None:
                    yield Stated(str(folder), of.hardware, of.answer, of.odds[0].best, shown)


def test_of(points: pd.DataFrame) -> float | None:
    """Return whether the most accurate spiking design of points beats the other one on test recordings."""
    rows = points[points["fits"].astype("boolean").fillna(False) & np.isfinite(points["energy_uj"])]
    is_spiking = spiking(rows)
    if not 0 < is_spiking.sum() < len(rows):
        return None
    ours, theirs = (
        float(side.loc[side["accuracy"].idxmax(), "accuracy_test"])
        for side in (rows[is_spiking], rows[~is_spiking])
    )
    return 0.5 * float(ours == theirs) + float(ours > theirs)


if __name__ == "__main__":
    main()
