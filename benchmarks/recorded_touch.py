"""Accuracy on recorded touch, last epoch, mean of seeds, beside scikit-learn baselines on the same split.

    DSE_DATA=... python -m benchmarks.recorded_touch [--seeds 3] [--jobs 2]

For each shipped search space one design (below) is trained with several seeds; baselines are a standardised
logistic regression and 5 nearest neighbours on simple features of the same windows; the analog spectrum
shows what the raw signal holds. CPU seconds are per run.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from sklearn.linear_model import LogisticRegression
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

import dse
import dse.config
import dse.records
from dse import dataset, registry
from dse.engine.events import dense, gather

DESIGNS: dict[str, dict[str, str]] = {
    "fabric_texture": {
        "encoder.thresholds": "[1, 2, 4, 8, 16]",
        "model.hidden": "150",
        "model.true_rate": "0.5",
        "model.input_delays": "[0, 2, 5]",
    },
    "fabric_speed": {
        "encoder.thresholds": "[1, 2, 4, 8, 16]",
        "model.hidden": "120",
        "model.true_rate": "0.5",
        "model.input_delays": "[0, 3, 8, 20]",
    },
    "braille": {
        "model.hidden": "80",
        "model.true_rate": "0.2",
        "model.input_delays": "[0, 2, 4, 8, 16, 32, 64]",
        "model.threshold": "5.0",
    },
}


def classifiers() -> dict[str, Any]:
    """Return the baselines, fresh."""
    return {
        "LR": make_pipeline(StandardScaler(), LogisticRegression(C=0.1, max_iter=5000)),
        "kNN": make_pipeline(StandardScaler(), KNeighborsClassifier(5)),
    }


def features(data: dse.records.Dataset, bins: int) -> np.ndarray:
    """Return spikes per channel in equal time bins of the evaluated windows, (sample, bins * channel)."""
    n = len(data.target)
    rows = gather(data.spikes, np.arange(n), data.start, data.n_steps)
    usable = data.n_steps - data.n_steps % bins
    counts = dense(rows)[:, :usable].reshape(n, bins, usable // bins, -1).sum(axis=2, dtype=np.int64)
    return counts.reshape(n, -1).astype(float)


def spectra(space: dse.config.SearchSpace, n_steps: int) -> np.ndarray | None:
    """Return magnitudes of bins 1-16 per channel of the analog windows, mean removed; None for spikes."""
    sections = space.resolve({})
    if sections["data"]["kind"] != "time_series":
        return None
    keys = {key: value for key, value in sections["data"].items() if key != "kind"}
    signals = registry.known("recordings")["time_series"](**keys).read(space.source.parent)
    begins = signals.offsets[:-1] + (np.diff(signals.offsets) - n_steps) // 2
    windows = np.stack([signals.values[b : b + n_steps] for b in begins]).astype(float)
    magnitude = np.abs(np.fft.rfft(windows - windows.mean(axis=1, keepdims=True), axis=1))
    return np.asarray(magnitude[:, 1:17].reshape(len(windows), -1))


def main() -> None:
    """Train, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("spaces", nargs="*", default=list(DESIGNS))
    asked = parser.parse_args()
    table = Table(
        "data", "classifier", "weights", "accuracy", "each seed", "s per run", title="Recorded touch"
    )
    for name in asked.spaces:
        overrides = DESIGNS[name] | {"search.repeats": str(asked.seeds)}
        space = dse.load_space(name, overrides)
        data, _ = dataset.build(space.resolve({}), space.source.parent)
        inputs = {"spike totals": features(data, 1), "spikes in 16 bins": features(data, 16)}
        if (analog := spectra(space, data.n_steps)) is not None:
            inputs["analog spectrum"] = analog
        for what, x in inputs.items():
            for label, model in classifiers().items():
                began = time.process_time()
                model.fit(x[data.train], data.target[data.train])
                score = model.score(x[data.validation], data.target[data.validation])
                took = time.process_time() - began
                table.add_row(name, f"{label} on {what}", "", f"{score:.3f}", "", f"{took:.1f}")
        with tempfile.TemporaryDirectory() as folder:
            study = dse.run(space, Path(folder), jobs=asked.jobs)
            runs = [record["columns"] for record in study.runs(0)]
        each = [run["accuracy"] for run in runs]
        error = np.std(each, ddof=1) / np.sqrt(len(each)) if len(each) > 1 else 0.0
        table.add_row(
            name,
            "CUBA-LIF, integer",
            str(runs[0]["n_weights"]),
            f"{np.mean(each):.3f} ± {error:.3f}",
            " ".join(f"{a:.3f}" for a in each),
            f"{np.mean([run['train_s'] for run in runs]):.0f}",
        )
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
