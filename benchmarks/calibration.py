"""Whether a stated probability of being on the front is right: a small search, run many times.

    python -m benchmarks.calibration [--runs 50] [--csv FILE]

A run simulates recordings of its own and trains 12 designs with seeds of its own, twice each; the study then
states of every design the probability that it is on the front of accuracy and weights
(`dse skyline --draws`). The true front is that of the mean accuracies over all runs. Printed: designs by
stated probability, and how many of them are on the true front.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import yaml
from rich.console import Console
from rich.table import Table

import dse
from dse.skyline.front import comparable, front_draws, skyline
from dse.skyline.table import group_numbers
from dse.study.precision import GROUPS
from dse.study.resampling import draws

BINS = (0.0, 0.05, 0.4, 0.6, 0.85, 0.95, 1.0)
N_TRAIN, N_TRIALS, N_DRAWS = 12, 24, 400
SPACE = {
    "study": "calibration",
    "data": {"kind": "scene", "scene": "quickstart", "trials": N_TRIALS},
    "task": {"target": "texture"},
    "split": {
        "train": {"repetition": list(range(N_TRAIN))},
        "validation": {"repetition": list(range(N_TRAIN, N_TRIALS))},
    },
    "preprocessing": {"bin_ms": 8, "pool": 16, "pool_threshold": 2, "polarity": "merge"},
    "model": {
        "kind": "snn",
        "hidden": {"choice": [[4], [6], [9], [13], [20], [30]]},
        "true_rate": 0.6,
        "input_delays": {"choice": [[0], [0, 8, 16]]},
        "current_decay": [0.1, 1.0],
        "voltage_decay": [0.06, 0.96],
        "output_current_decay": 0.2,
        "output_voltage_decay": 0.06,
        "threshold": 5.0,
        "output_tau_grad": 0.3,
    },
    "training": {"epochs": 12, "learning_rate": 0.05, "warmup_epochs": 2, "lr_every": 4, "average_epochs": 2},
    "decision": {"phi": 1000, "theta": 0.9},  # never reached: every sample answers at its end
    "objectives": ["accuracy:max", "n_weights:min"],
    "search": {"sampler": "grid", "repeats": 2},
}


def main() -> None:
    """Run the searches, and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--csv", help="file for a row per run and design, as they come")
    options = parser.parse_args()
    stated = pd.DataFrame()
    for seed in range(options.runs):
        stated = pd.concat([stated, searched(seed)], ignore_index=True)
        if options.csv:
            stated.to_csv(options.csv, index=False)
    shown = Table("stated", "designs", "mean stated", "on the true front")
    for row in calibrated(stated, BINS).itertuples():
        shown.add_row(str(row.Index), str(row.n), f"{row.stated:.3f}", f"{row.on_front:.3f}")
    Console().print(shown)


def searched(seed: int) -> pd.DataFrame:
    """Return a row per point of one search; `probability` is that of its design."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "space.yaml"
        file.write_text(yaml.safe_dump({**SPACE, "seed": seed}))
        study = dse.run(str(file), Path(folder) / "results", jobs=1)
        points = study.points()
        probability = front_probabilities(study.folder, points, study.objectives)
    rows = points[["trial", "point", "accuracy", "n_weights"]]
    return rows.assign(run=seed, probability=rows["trial"].map(probability))


def front_probabilities(
    folder: Path, points: pd.DataFrame, goals: Sequence[tuple[str, str]]
) -> dict[int, float]:
    """Return trial -> the probability that one of its design points is on the front of its group.

    Over recordings, seeds and the chip's uncertain numbers jointly, as `draws`; the largest over the fronts
    of tasks, families and chips that a trial is in.

    Args:
        folder: of the study, whose artefacts and hardware are written.
        points: its table of design points.
        goals: of the front.
    """
    rows = comparable(points, goals).rows
    by = [name for name in GROUPS if name in rows.columns]
    drawn = front_draws(rows, goals, draws([folder], [points], (), goals, N_DRAWS), by)
    trials = rows["trial"].to_numpy(np.int64)[drawn.rows]
    group = group_numbers(rows, by)[drawn.rows]
    probability = dict.fromkeys(map(int, np.unique(rows["trial"])), 0.0)
    for trial, number in sorted(set(zip(trials.tolist(), group.tolist(), strict=True))):
        here = (trials == trial) & (group == number)
        probability[trial] = max(probability[trial], float(drawn.on_front[:, here].any(axis=1).mean()))
    return probability


def calibrated(stated: pd.DataFrame, bins: Sequence[float]) -> pd.DataFrame:
    """Return by stated probability: designs, the mean of what was stated, the share on the true front."""
    truth = stated.groupby(["trial", "point"], as_index=False)[["accuracy", "n_weights"]].mean()
    best = set(skyline(truth, [("accuracy", "max"), ("n_weights", "min")]).rows["trial"])
    rows = stated.drop_duplicates(["run", "trial"])
    rows = rows.assign(on_front=rows["trial"].isin(best))
    groups = rows.groupby(pd.cut(rows["probability"], bins, include_lowest=True), observed=True)
    return groups.agg(n=("trial", "size"), stated=("probability", "mean"), on_front=("on_front", "mean"))


if __name__ == "__main__":
    main()
