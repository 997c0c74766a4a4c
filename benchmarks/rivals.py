"""Plain rivals of the README's networks: the same recordings, split, crops, moved windows and unseen groups.

    DSE_DATA=... python -m benchmarks.rivals [--only "7 fabrics"] [--seeds 3] [--networks] [--csv FILE]

One design of each family in integers of 8 bits, chosen before: 4 windows of linear classifiers, 8 of
perceptrons, 300 kernels with four thresholds each. They read the network's spikes, or the levels of the
quantised signal where there is one. Of recordings whose windows move in training they see nine crops each.
With `--networks` the spiking network is trained too, which takes hours; the table of the measurements has it
from `benchmarks.recorded_touch`. Energy is of the C of an inference on the processors.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

import dse
from benchmarks.recorded_touch import HEADLINE, SETS

SPACES = (
    "headline_fabrics_small",
    "headline_speeds_small",
    "headline_ridges",
    "headline_braille_small",
    "headline_objects_small",
)
CROPS = 9
CHIPS = ("mcu_m4", "mcu_m33", "loihi1_silicon")
READ_OUTS = {"read_outs": 1}


def families(whole_ms: float, step_ms: float, reads: str) -> list[dict[str, Any]]:
    """Return the rivals, keys of `model`, for windows of `whole_ms`."""
    each = {"channels": "each", **READ_OUTS, "reads": reads}
    hidden = {"hidden": 32, "precision": "int8"}
    kernels = {"kernels": 300, "thresholds": 4, "readout": "ridge", **READ_OUTS}
    return [
        {"kind": "linear", "window_ms": whole_ms / 4, **each},
        {"kind": "mlp", "window_ms": whole_ms / 8, **hidden, **each},
        {"kind": "kernels", "window_ms": step_ms, **kernels},
    ]


def spaces(name: str, seeds: int, networks: bool) -> dict[str, dse.SearchSpace]:
    """Return the search spaces of a network's rivals by what they read, and with it the network."""
    plain = yaml.safe_load(dse.load_space(name).to_yaml())
    step_ms = plain["data"]["step_ms"]
    whole_ms = plain["window"]["n_steps"] * step_ms
    changed: dict[str, Any] = {"hardware": [*CHIPS], "search.repeats": seeds}
    if evaluation := SETS[HEADLINE[name]].evaluation:
        changed["evaluation"] = dict(evaluation)
    if plain["window"].get("jitter_steps"):
        changed["training.crops"] = CROPS
    made = {"spikes": changed | {"model": {"choice": families(whole_ms, step_ms, "counts")}}}
    if plain.get("encoder"):
        signal = {"encoder": {"kind": "quantised", "step": min(plain["encoder"]["thresholds"])}}
        made["signal"] = changed | signal | {"model": {"choice": families(whole_ms, step_ms, "levels")}}
    if networks:
        made["spiking"] = changed
    texts = {what: {key: yaml.safe_dump(x) for key, x in keys.items()} for what, keys in made.items()}
    return {what: dse.load_space(name, keys) for what, keys in texts.items()}


def rows(recordings: str, reads: str, space: dse.SearchSpace) -> list[dict[str, Any]]:
    """Return what the designs of a space reach, whole windows of 8 bits."""
    with tempfile.TemporaryDirectory() as folder:
        study = dse.run(space, Path(folder), jobs=1, progress=False)
        points, trials = study.points(), study.trials
    points = points.assign(**{key: None for key in ("phi", "weight_bits") if key not in points})
    found = []
    for trial, group in points.groupby("trial"):
        whole = group[group["phi"].isna() & (group["weight_bits"].fillna(8) == 8)]
        energy_uj = whole.groupby("hardware")["energy_uj"].max()
        row = trials.set_index("trial").loc[trial]
        tested = [
            key
            for key in row.index
            if key.startswith(("accuracy_shifted", "accuracy_unseen_")) and not key.endswith("_se")
        ]
        found.append(
            {"recordings": recordings, "family": row["family"], "reads": reads}
            | {key: row[key] for key in ("accuracy", "accuracy_se", *tested, "n_weights", "memory_bytes")}
            | {chip: energy_uj.get(chip) for chip in CHIPS}
        )
    return found


def main() -> None:
    """Train, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=[HEADLINE[name] for name in SPACES])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--networks", action="store_true", help="train the spiking network too")
    parser.add_argument("--csv", type=Path, help="file for the table")
    options = parser.parse_args()
    found: list[dict[str, Any]] = []
    for name in SPACES:
        if options.only in (None, HEADLINE[name]):
            for reads, space in spaces(name, options.seeds, options.networks).items():
                found += rows(HEADLINE[name], reads, space)
                print(pd.DataFrame(found[-3:]).to_string(), flush=True)
    table = pd.DataFrame(found)
    print(table.round(3).to_string())
    if options.csv is not None:
        table.to_csv(options.csv, index=False)


if __name__ == "__main__":
    main()
