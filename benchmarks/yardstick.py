"""A first study, untouched, beside plain readers: `dse init`, `run` and `pick` on public recordings.

`python -m benchmarks.yardstick` takes the sets that come inside the wheel of aeon, with their published
splits (`pip install --no-deps aeon==1.6.0`), and prints a table: test accuracy of the pick, of the best
spiking design by validation, of 1 nearest neighbour and of logistic regression on the samples.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np

import dse

SETS = {"BasicMotions": "", "GunPoint": "", "JapaneseVowels": "_eq"}
"""Names, and the ending of the files in which recordings have one length."""
STEP_MS = 10.0  # the sets name no sampling period that matters here


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", nargs="*", choices=SETS, default=list(SETS))
    parser.add_argument("--seeds", type=int, default=3)
    arguments = parser.parse_args()
    found = importlib.util.find_spec("aeon")
    if found is None or found.origin is None:
        parser.error("the sets are in the wheel of aeon: pip install --no-deps aeon==1.6.0")
    folder = Path(found.origin).parent / "datasets" / "data"
    print("| set | recordings | pick | best by validation | 1-NN | logistic regression | CPU s of a study |")
    print("|---|---|---|---|---|---|---|")
    for name in arguments.sets:
        arrays = published(folder / name, name, SETS[name])
        picks, best, cpu_s = np.array([first_study(name, arrays, seed) for seed in range(arguments.seeds)]).T
        nearest, logistic = plain(arrays)
        spread = picks.std(ddof=1) if len(picks) > 1 else 0.0
        print(
            f"| {name} | {len(arrays['label'])} | {picks.mean():.3f} ± {spread:.3f} | {best.mean():.3f} | "
            f"{nearest:.3f} | {logistic:.3f} | {cpu_s.mean():.0f} |",
            flush=True,
        )


def published(folder: Path, name: str, ending: str) -> dict[str, Any]:
    """Return signals (recording, step, channel), labels and parts of the published split."""
    signals, labels, parts = [], [], []
    for part in ("TRAIN", "TEST"):
        text = (folder / f"{name}{ending}_{part}.ts").read_text(encoding="utf-8")
        for line in text.partition("@data")[2].splitlines():
            if line.strip():
                *channels, label = line.strip().split(":")
                signals.append(np.array([[float(x) for x in each.split(",")] for each in channels]).T)
                labels.append(label)
                parts.append(part.lower())
    return {"signal": np.stack(signals), "label": np.array(labels), "split": np.array(parts)}


def first_study(name: str, arrays: dict[str, Any], seed: int) -> tuple[float, float, float]:
    """Return test accuracy of the pick and of the best design by validation, and CPU seconds."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{name}.npz"
        np.savez(file, **arrays)
        began = sum(os.times()[:4])
        path = dse.init(file, Path(folder) / f"{name}.yaml", label="label", step_ms=STEP_MS)
        space = dse.load_space(path, {"seed": str(seed + 1)})
        study = dse.run(space, Path(folder) / "results", jobs=1, progress=False)
        cpu_s = sum(os.times()[:4]) - began
        picked = float(study.pick()["accuracy_test"])
        trials = study.trials.sort_values("accuracy", ascending=False)
        return picked, float(trials["accuracy_test"].iloc[0]), cpu_s


def plain(arrays: dict[str, Any]) -> tuple[float, float]:
    """Return the test accuracy of 1 nearest neighbour and of logistic regression on the samples."""
    from sklearn.linear_model import LogisticRegression
    from sklearn.neighbors import KNeighborsClassifier
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    x, is_train = arrays["signal"].reshape(len(arrays["label"]), -1), arrays["split"] == "train"
    readers = KNeighborsClassifier(1), make_pipeline(StandardScaler(), LogisticRegression(max_iter=2000))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for reader in readers:
            reader.fit(x[is_train], arrays["label"][is_train])
    nearest, logistic = (float(r.score(x[~is_train], arrays["label"][~is_train])) for r in readers)
    return nearest, logistic


if __name__ == "__main__":
    main()
