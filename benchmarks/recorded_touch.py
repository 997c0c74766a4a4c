"""Accuracy on recorded touch, last epoch, mean of seeds, beside scikit-learn baselines on the same split.

    DSE_DATA=... python -m benchmarks.recorded_touch [--seeds 3] [--jobs 2] [--only fabrics]

Designs of shipped search spaces (below) are trained with several seeds; baselines are a standardised
logistic regression and 5 nearest neighbours on simple features of the same windows; the analog spectrum
shows what the raw signal holds. CPU seconds are per run.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import dataclass
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
from dse import dataset, store
from dse.engine.events import dense, gather
from dse.recordings.cutting import cut


@dataclass(frozen=True)
class Case:
    """A design of a shipped search space, as overrides: dotted key -> YAML text."""

    name: str
    space: str
    overrides: dict[str, str]


_FABRIC = "{kind: send_on_delta, thresholds: [1, 2, 4, 8, 16]}"
_FINE = "{kind: send_on_delta, thresholds: [1, 2, 3, 5, 8, 12, 20, 40, 80, 160]}"
_SLOW = (
    "current_decay: [0.1, 1.0], output_current_decay: 0.12, output_voltage_decay: 0.03, output_tau_grad: 0.3,"
    " threshold: 5.0"
)
_FAST = (
    "current_decay: [0.3, 1.0], voltage_decay: [0.12, 0.96], output_current_decay: 0.12, output_tau_grad: 0.3"
)

CASES = (
    Case(
        "7 fabrics",
        "fabric_texture",
        {"model.hidden": "150", "model.pruned": "0.0", "model.input_delays": "[0, 2, 5]", "encoder": _FABRIC},
    ),
    Case(
        "7 fabrics, pruned",
        "fabric_texture",
        {
            "model.hidden": "150",
            "model.pruned": "0.73",
            "model.input_delays": "[0, 2, 5]",
            "encoder": _FABRIC,
        },
    ),
    Case(
        "6 speeds",
        "fabric_speed",
        {
            "model.hidden": "150",
            "model.true_rate": "0.2",
            "model.input_delays": "[0, 2, 5, 10, 20, 40]",
            "encoder": _FABRIC,
        },
    ),
    Case(
        "26 ridged textures",
        "families_sankar",
        {
            "encoder": _FINE,
            "model": "{kind: snn, hidden: 150, true_rate: 0.1, input_delays: [0, 10, 30, 60, 100],"
            f" voltage_decay: [0.003, 0.5], initial_rate: 0.05, {_SLOW}}}",
            "training.epochs": "150",
            "training.lr_every": "25",
            "training.learning_rate": "0.1",
            "training.average_epochs": "20",
        },
    ),
    Case(
        "7 Braille letters",
        "braille",
        {
            "model.hidden": "80",
            "model.true_rate": "0.2",
            "model.input_delays": "[0, 2, 4, 8, 16, 32, 64]",
            "model.threshold": "5.0",
        },
    ),
    Case(
        "7 Braille letters, few spikes",
        "families_braille",
        {
            "model": "{kind: snn, hidden: 100, true_rate: 0.2, initial_rate: 0.08, threshold: 3.0,"
            f" input_delays: [0, 2, 4, 8, 16, 32, 64], output_voltage_decay: 0.03, {_FAST}}}",
        },
    ),
    Case(
        "36 objects",
        "families_evtouch",
        {
            "model": "{kind: snn, hidden: 300, true_rate: 0.8, initial_rate: 0.15,"
            " voltage_decay: [0.01, 0.96],"
            f" input_delays: [0, 25, 50, 75, 100, 125, 150, 175, 200, 225], {_SLOW}}}",
            "training.learning_rate": "0.1",
        },
    ),
    Case(
        "36 objects, pruned",
        "families_evtouch",
        {
            "model": "{kind: snn, hidden: 150, pruned: 0.42, prune_epoch: 0.35, true_rate: 0.6,"
            f" initial_rate: 0.05, voltage_decay: [0.01, 0.3], {_SLOW}}}",
            "training.epochs": "160",
            "training.lr_every": "27",
            "training.learning_rate": "0.05",
        },
    ),
)


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
    if sections.kinds["data"] != "time_series":
        return None
    recordings = sections.data.read(space.source.parent)
    signals = cut(recordings, sections.window.cut_steps, sections.window.every_steps)
    assert isinstance(signals, dse.records.Signals)
    begins = signals.offsets[:-1] + (np.diff(signals.offsets) - n_steps) // 2
    windows = np.stack([signals.values[b : b + n_steps] for b in begins]).astype(float)
    magnitude = np.abs(np.fft.rfft(windows - windows.mean(axis=1, keepdims=True), axis=1))
    return np.asarray(magnitude[:, 1:17].reshape(len(windows), -1))


def main() -> None:
    """Train, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", help="cases whose name holds this text")
    asked = parser.parse_args()
    table = Table(
        *("data", "classifier", "weights", "hidden spikes", "accuracy", "each seed", "s per run"),
        title="Recorded touch",
    )
    done: set[str] = set()
    for case in (case for case in CASES if asked.only is None or asked.only in case.name):
        space = dse.load_space(case.space, case.overrides | {"search.repeats": str(asked.seeds)})
        data, _ = dataset.build(space.resolve({}), space.source.parent)
        key = dataset.dataset_key(space.resolve({}), space.source.parent)
        inputs = {"spike totals": features(data, 1), "spikes in 16 bins": features(data, 16)}
        if (analog := spectra(space, data.n_steps)) is not None:
            inputs["analog spectrum"] = analog
        for what, x in inputs.items() if key not in done else ():
            for label, model in classifiers().items():
                began = time.process_time()
                model.fit(x[data.train], data.target[data.train])
                score = model.score(x[data.validation], data.target[data.validation])
                took = time.process_time() - began
                table.add_row(case.name, f"{label} on {what}", "", "", f"{score:.3f}", "", f"{took:.1f}")
        done.add(key)
        with tempfile.TemporaryDirectory() as folder:
            study = dse.run(space, Path(folder), jobs=asked.jobs)
            records = study.runs(0)
            runs = [record["columns"] for record in records]
            hidden = [hidden_spikes(study.folder, record["repeat"]) for record in records]
        each = [run["accuracy"] for run in runs]
        error = np.std(each, ddof=1) / np.sqrt(len(each)) if len(each) > 1 else 0.0
        table.add_row(
            case.name,
            "CUBA-LIF, integer",
            f"{np.mean([run['n_weights'] for run in runs]):.0f}",
            f"{np.mean(hidden):.0f}",
            f"{np.mean(each):.3f} ± {error:.3f}",
            " ".join(f"{a:.3f}" for a in each),
            f"{np.mean([run['train_s'] for run in runs]):.0f}",
        )
        table.add_section()
    Console(width=130).print(table)


def hidden_spikes(folder: Path, repeat: int) -> float:
    """Return the mean spikes of the hidden layers per validation sample."""
    said = store.response_of(store.load_arrays(store.run_folder(folder, 0, repeat) / "response.npz"))
    return float(said.spikes[..., 1:-1].sum(axis=(1, 2)).mean())


if __name__ == "__main__":
    main()
