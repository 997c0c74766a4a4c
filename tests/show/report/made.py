"""Studies on disk whose every number a test chooses: what `dse run` leaves, without training."""

import numpy as np
import pandas as pd
import yaml

from dse import store
from dse.study import results

SECTIONS = {
    "data": {"kind": "raster", "file": "recordings/tiny.npz", "step_ms": 1},
    "task": {"name": "texture", "target": "fabric"},
    "split": {"train": {"repetition": [0, 1]}, "validation": {"repetition": [2]}},
    "model": {"kind": "snn", "hidden": [8], "true_rate": 0.5},
    "training": {},
}
LENGTHS_MS = np.array([250.0, 500.0, 1000.0])


def write(folder, designs, sections=None, failed=0, **of_record):
    """Write a study with a row of columns per design.

    Args:
        folder: of the study.
        designs: columns of each design's full read-out; `model` holds settings of its family, `runs` the
            accuracies of its runs where there are several, `on` its columns on each chip.
        sections: sections of every design's record that differ from SECTIONS.
        failed: how many designs failed.
        of_record: what the record holds beside.
    """
    folder.mkdir(parents=True)
    rows, space = [], {"study": folder.name, "objectives": ["accuracy:max"]}
    (folder / "search_space.yaml").write_text(yaml.safe_dump(space))
    for trial, given in enumerate(designs):
        design = dict(given)
        model, runs, on = design.pop("model", {}), design.pop("runs", None), design.pop("on", None)
        accuracies = runs or [design["accuracy"]]
        row = {
            "trial": trial,
            "task": "texture",
            "family": "snn",
            "repeats": len(accuracies),
            "accuracy": float(np.mean(accuracies)),
            "accuracy_se": 0.01,
            "n_weights": 100,
            "spikes_per_inference": 50.0,
            "spikes_per_inference_no_input": 0.0 if design.get("macs") else 20.0,
            "spikes_total": 5000,
            "spikes_total_no_input": 200,
            "macs": 0.0,
            "decision_latency_ms": 1000.0,
            "transductive": False,
            **design,
        }
        points = [row, {**row, "read_out_ms": 500.0, "accuracy": 0.999}]
        if on is not None:
            points = [
                {**point, "hardware": chip, "point": k, **columns}
                for chip, columns in on.items()
                for k, point in enumerate(points)
            ]
        rows += points
        own = {**SECTIONS, **(sections or {})}
        settings = own["model"] if row["family"] == own["model"]["kind"] else {}
        own["model"] = {**settings, "kind": row["family"], **model}
        record = {
            "trial": trial,
            "sections": own,
            "classes": ["constant 20", "constant 40", "triangular 30"],
            "samples": {"train": 20, "validation": 10, "test": 0},
            "transductive": "windows of a recording are on both sides" if row["transductive"] else "",
            **of_record,
        }
        n_classes = len(record["classes"])
        for repeat, accuracy in enumerate(accuracies):
            store.save_run(
                store.run_file(folder, trial, repeat),
                {**record, "repeat": repeat, "status": "finished"},
                _arrays(float(accuracy), design, n_classes),
            )
    trials = pd.DataFrame({"trial": range(len(designs) + failed)})
    trials["status"] = ["finished"] * len(designs) + ["failed"] * failed
    trials["reason"] = [""] * len(designs) + ["ValueError: hidden must be kind"] * failed
    trials.to_parquet(folder / "trials.parquet")
    pd.DataFrame(rows).to_parquet(folder / "points.parquet")
    return results.open(folder)


def _arrays(accuracy, design, n_classes):
    read_out = {
        "decision_latency_ms": LENGTHS_MS,
        "accuracy": np.array([accuracy / 2, accuracy, accuracy]),
        "accuracy_se": np.full(3, 0.02),
        "accuracy_test": np.array([0.1, 0.2, 0.3]),
    }
    if "t_p_ms" in design:
        read_out |= {name: np.array([1.0, 2.0, 3.0]) + k for k, name in enumerate(("t_p_ms", "t_h_ms"))}
        read_out["accuracy_best"] = np.array([0.6, 0.7, 0.97])
        read_out |= {name: np.array([5.0, 6.0, 7.0]) for name in ("phi_p", "theta_p", "phi_h", "theta_h")}
    matrix = np.array([[4, 1, 0], [1, 3, 1], [2, 0, 3]])
    if n_classes != len(matrix):
        matrix = 3 * np.eye(n_classes, dtype=int) + np.eye(n_classes, k=1, dtype=int)
    test = 2 * np.eye(3, dtype=int) if n_classes == 3 else matrix
    arrays = {"read_out.npz": read_out, "confusion.npz": {"validation": matrix, "test": test}}
    if "t_p_ms" in design:
        surface = np.array([[0.7, 0.66, 0.3], [0.9, 0.6, 0.2]])
        arrays["surface.npz"] = {
            "phi": np.array([0, 4]),
            "theta": np.array([0.3, 0.4, 0.5]),
            "accuracy": surface,
        }
    return arrays


def rows_of(found, system):
    """Return the rows of a system by figure; a figure twice is a fault."""
    rows = [row for row in found.rows if row.system == system]
    named = {row.figure: row for row in rows}
    assert len(named) == len(rows), [row.figure for row in rows]
    return named


def noted(found, text):
    return any(text in note for note in found.notes)
