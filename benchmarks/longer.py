"""Whether a first study answers as a search ten times as long: the family of the pick, within three budgets.

    python -m benchmarks.longer FOLDER [FOLDER ...]

The folders are those that `benchmarks.yardstick --keep` wrote: recordings, the space that `dse init` made of
them, and its study. The longer search has ten times as many designs, proposed by `tpe` and raced, from wider
ranges of the same families; it stays beside the first one, and goes on where it was stopped. Budgets are
energies on a Cortex-M4: none, and the median and the lower fifth of those of the first study's designs.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import pandas
import yaml

import dse

CHIP = "mcu_m4"
SHARES = (1.0, 0.5, 0.2)
SPIKING = ("snn", "kernel_snn")
_TIMES = 10


def main() -> None:
    """Search, and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folders", nargs="+", type=Path)
    rows = []
    for folder in parser.parse_args().folders:
        (space,) = (x for x in folder.glob("*.yaml") if x.stem != "longer")
        first = dse.open(folder / "results" / space.stem)
        longer = dse.run(wider(space, len(first.trials)), folder / "results", jobs=1, progress=False)
        rows += [(space.stem, *row) for row in compared(first, longer)]
        print(pandas.DataFrame(rows, columns=COLUMNS).to_string(index=False), flush=True)


COLUMNS = [
    *("set", "energy at most, uJ", "first study", "accuracy, energy uJ", "ten times as long"),
    *("accuracy, energy uJ", "same family", "same answer: spike or not"),
]


def compared(first: Any, longer: Any) -> list[tuple[Any, ...]]:
    """Return a row per budget: the picks of both, and whether their families and kinds are the same."""
    energies = first.points().query(f"hardware == '{CHIP}'")["energy_uj"]
    rows: list[tuple[Any, ...]] = []
    for share in SHARES:
        most = float(f"{energies.quantile(share):.3g}") if share < 1 else float("inf")
        budgets = [] if share == 1 else [f"energy_uj <= {most:g}"]
        one, other = (study.pick(budgets, hardware=CHIP) for study in (first, longer))
        families = [str(pick["family"]) for pick in (one, other)]
        spike = [family in SPIKING for family in families]
        figures = [f"{pick['accuracy_test']:.3f}, {pick['energy_uj']:.0f}" for pick in (one, other)]
        same = ["yes" if len(set(x)) == 1 else "no" for x in (families, spike)]
        rows.append((f"{most:g}", families[0], figures[0], families[1], figures[1], *same))
    return rows


def wider(path: Path, n_trials: int) -> Any:
    """Return the space with wider ranges, and ten times as many designs."""
    space = yaml.safe_load(path.read_text(encoding="utf-8"))
    space["study"] += "_longer"
    space["search"] = {
        "sampler": "tpe",
        "n_trials": _TIMES * n_trials,
        "racing": {"rungs": [0.2, 0.5], "eta": 3},
    }
    for model in space["model"]["choice"]:
        _WIDER[model["kind"]](model)
    space["training"]["learning_rate"] = {"choice": [0.02, 0.05, 0.1]}
    file = path.with_name("longer.yaml")
    file.write_text(yaml.safe_dump(space, sort_keys=False), encoding="utf-8")
    return dse.load_space(file)


def _windows(model: dict[str, Any]) -> None:
    given = model["window_ms"]
    windows_ms = given["choice"] if isinstance(given, dict) else [given]
    model["window_ms"] = {"choice": sorted({each * x for each in windows_ms for x in (0.5, 1.0, 2.0)})}


def _linear(model: dict[str, Any]) -> None:
    _windows(model)
    model["alpha"] = {"choice": [0.001, 0.01, 0.1]}


def _mlp(model: dict[str, Any]) -> None:
    _windows(model)
    model["hidden"] = {"choice": [16, 32, 64, 128]}


def _kernels(model: dict[str, Any]) -> None:
    model["kernels"] = {"choice": [100, 300, 1000, 3000]}


def _kernel_snn(model: dict[str, Any]) -> None:
    model["hidden"] = {"choice": [30, 50, 100, 200, 400]}
    model["output_tau_grad"] = {"choice": [0.1, 0.3]}


def _snn(model: dict[str, Any]) -> None:
    model["hidden"] = {"choice": [10, 20, 50, 100, 200]}
    model["recurrent"] = {"choice": [False, True]}
    model["output_tau_grad"] = {"choice": [0.1, 0.3]}


_WIDER = {"linear": _linear, "mlp": _mlp, "kernels": _kernels, "kernel_snn": _kernel_snn, "snn": _snn}

if __name__ == "__main__":
    main()
