"""Ten bundles of ten kinds, trained once more wherever this runs: identical, close, or what differs.

    python -m benchmarks.elsewhere FOLDER

The first run trains a design of each kind on the simulated scene of the quickstart and exports it to FOLDER.
Copied to another machine, it is read there: each row has the SHA-256 of what the bundle holds, and what
training it anew gives here. Families of integers must be identical.
"""

from __future__ import annotations

import platform
import sys
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import dse
from dse.deploy.reproduce import reproduce

_DELAYS = [0, 12, 25, 50]
_SNN: dict[str, Any] = {
    "kind": "snn",
    "hidden": 20,
    "current_decay": [0.05, 1.0],
    "voltage_decay": [0.03, 0.96],
    "output_current_decay": 0.12,
    "output_voltage_decay": 0.03,
    "threshold": 5.0,
    "initial_rate": 0.2,
    "output_tau_grad": 0.3,
}
_KERNELS = {
    **{"current_decay": 0.03, "voltage_decay": 1.0, "threshold": 5.0, "hidden": 20},
    **{"output_current_decay": 0.12, "output_voltage_decay": 0.05, "whitened": "output"},
}
_WINDOWS = {"window_ms": 250.0, "channels": "each"}
MODELS: tuple[dict[str, Any], ...] = (
    _SNN | {"recurrent": True},
    _SNN | {"input_delays": _DELAYS, "loss": "count_cross_entropy", "whitened": "output"},
    {"kind": "snn", "hidden": 20, "neuron": "resonator", "initial_rate": 0.2},
    _SNN | {"hidden": [20, 10]},
    {"kind": "kernel_snn", **_KERNELS, "input_delays": _DELAYS, "loss": "count_cross_entropy"},
    {"kind": "linear", "window_ms": 250.0},
    {"kind": "mlp", **_WINDOWS, "hidden": 16, "precision": "int8"},
    {"kind": "kernels", "window_ms": 20.0, "kernels": 100, "thresholds": 4, "readout": "ridge"},
    {"kind": "knn", **_WINDOWS},
    {"kind": "naive_bayes", **_WINDOWS},
)


def main() -> None:
    """Print the table."""
    folder = Path(sys.argv[1])
    for k, model in enumerate(MODELS):
        if not (folder / f"bundle_{k}").exists():
            file, folder_of = folder / f"{k}.yaml", folder / f"study_{k}"
            space = yaml.safe_load(Path("search_spaces/quickstart.yaml").read_text(encoding="utf-8"))
            space |= {
                "study": f"elsewhere_{k}",
                "model": model,
                "task": {"target": "texture"},
                "hardware": ["mcu_m4"],
            }
            folder.mkdir(parents=True, exist_ok=True)
            file.write_text(yaml.safe_dump(space), encoding="utf-8")
            dse.run(file, folder_of, progress=False).pick().export(folder / f"bundle_{k}")
    print(f"Python {platform.python_version()}, NumPy {np.__version__}, {platform.platform()}")
    for k, model in enumerate(MODELS):
        found = reproduce(folder / f"bundle_{k}")
        name = f"{model['kind']} {model.get('neuron', '')}".strip()
        print(f"| {name} | {found.sha256[:16]} | {found.kind} {found.first} |")


if __name__ == "__main__":
    main()
