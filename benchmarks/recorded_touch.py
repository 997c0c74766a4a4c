"""Accuracy on recorded touch, last epoch, mean of seeds, beside scikit-learn baselines on the same split.

    DSE_DATA=... python -m benchmarks.recorded_touch [--readme | --only "6 speeds"] [--seeds 3] [--csv FILE]

The networks of the README's table (search_spaces/headline_*.yaml) or designs of other shipped search spaces
(below) are trained with several seeds in integer arithmetic; baselines are a standardised logistic regression
and 5 nearest neighbours on simple features of the same windows; the analog spectrum shows what the raw signal
holds. `shifted`: on moved windows (mean, worst); `unseen`: on groups that training left out. Energy is that
of the chip below. CPU seconds are per training.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from rich.console import Console
from rich.table import Table
from sklearn.linear_model import LogisticRegression
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

import dse
import dse.base.records
import dse.config
from dse import store
from dse.data import dataset
from dse.data.recordings.windows import cut
from dse.engine.events import dense, gather

CHIP = "mcu_m4"
"""A chip that runs every design below."""


@dataclass(frozen=True)
class Recordings:
    """A shipped search space and the part of it that all designs of a set share.

    model: keys of the spiking network. encoder, training: their keys; empty: as in the space.
    evaluation: what else a design is tested on; empty: nothing.
    """

    space: str
    model: Mapping[str, Any]
    encoder: Mapping[str, Any]
    training: Mapping[str, Any]
    evaluation: Mapping[str, Any]


def _deltas(*thresholds: int) -> dict[str, Any]:
    return {"kind": "send_on_delta", "thresholds": list(thresholds)}


_SLOW = {
    "current_decay": [0.1, 1.0],
    "output_current_decay": 0.12,
    "output_voltage_decay": 0.03,
    "output_tau_grad": 0.3,
    "threshold": 5.0,
}
_FAST = {
    "current_decay": [0.3, 1.0],
    "voltage_decay": [0.12, 0.96],
    "output_current_decay": 0.12,
    "output_voltage_decay": 0.05,
    "output_tau_grad": 0.3,
    "threshold": 5.0,
    "initial_rate": 0.2,
}
_UNSTRETCHED = {"dilation": [1, 1], "dilation_keeps_label": False}
_MOVED = [-40, -16, 16, 32, 40]

SETS = {
    "6 speeds": Recordings(
        "fabric_speed",
        {"hidden": 150, "true_rate": 0.2, "input_delays": [0, 2, 5, 10, 20, 40], **_FAST},
        _deltas(1, 2, 4, 8, 16),
        {},
        {"shifts": _MOVED, "leave_out": [{"column": "force", "folds": 3}, {"column": "fabric", "folds": 3}]},
    ),
    "7 fabrics": Recordings(
        "fabric_texture",
        {"hidden": 150, "true_rate": 0.5, "input_delays": [0, 2, 5], **_FAST},
        _deltas(1, 2, 4, 8, 16),
        _UNSTRETCHED,
        {"shifts": _MOVED, "leave_out": [{"column": "force", "folds": 3}]},
    ),
    "26 ridged textures": Recordings(
        "families_sankar",
        {
            "hidden": 150,
            "true_rate": 0.1,
            "input_delays": [0, 10, 30, 60, 100],
            **_SLOW,
            "voltage_decay": [0.003, 0.5],
            "initial_rate": 0.05,
        },
        _deltas(1, 2, 3, 5, 8, 12, 20, 40, 80, 160),
        {"epochs": 150, "lr_every": 25, "learning_rate": 0.1, "average_epochs": 20},
        {"shifts": [-18, -9, 9, 18]},
    ),
    "7 Braille letters": Recordings(
        "braille",
        {
            "hidden": 80,
            "true_rate": 0.2,
            "input_delays": [0, 2, 4, 8, 16, 32, 64],
            **_FAST,
            "output_voltage_decay": 0.03,
        },
        {},
        {
            **_UNSTRETCHED,
            "event_dropout": 0.0,
            "epochs": 100,
            "learning_rate": 0.1,
            "lr_every": 16,
            "average_epochs": 10,
        },
        {},
    ),
    "36 objects": Recordings(
        "families_evtouch",
        {
            "hidden": 300,
            "true_rate": 0.8,
            "input_delays": [0, 25, 50, 75, 100, 125, 150, 175, 200, 225],
            **_SLOW,
            "voltage_decay": [0.01, 0.96],
            "initial_rate": 0.15,
        },
        {},
        {"learning_rate": 0.1},
        {},
    ),
}


@dataclass(frozen=True)
class Case:
    """A design: the recordings, what it is, and the keys in which it differs from what its set shares.

    jitter_steps: by which training windows move; None: as the space says.
    """

    recordings: str
    design: str
    model: Mapping[str, Any]
    encoder: Mapping[str, Any] | None = None
    training: Mapping[str, Any] | None = None
    jitter_steps: int | None = None

    def __str__(self) -> str:
        """Return the name of the set and of the design."""
        return f"{self.recordings}: {self.design}"

    def space(self, seeds: int) -> dse.config.SearchSpace:
        """Return the search space of this one design."""
        base = SETS[self.recordings]
        overrides: dict[str, Any] = {"model": {"kind": "snn", **base.model, **self.model}}
        overrides |= {f"training.{key}": x for key, x in {**base.training, **(self.training or {})}.items()}
        if encoder := self.encoder or base.encoder:
            overrides["encoder"] = encoder
        if self.jitter_steps is not None:
            overrides["window.jitter_steps"] = self.jitter_steps
        if base.evaluation:
            overrides["evaluation"] = base.evaluation
        overrides |= {"search.repeats": seeds, "hardware": [CHIP], "objectives": ["accuracy:max"]}
        texts = {key: yaml.safe_dump(x, default_flow_style=True) for key, x in overrides.items()}
        return dse.load_space(base.space, texts)


_CROSS_ENTROPY = {"loss": "count_cross_entropy"}
_RESONATOR = {"neuron": "resonator", **_CROSS_ENTROPY}
_NEURONS_AND_LOSSES = {
    "CUBA-LIF, spike rate": {},
    "CUBA-LIF, cross-entropy": _CROSS_ENTROPY,
    "resonators, spike rate": {"neuron": "resonator"},
    "resonators, cross-entropy": _RESONATOR,
    "half resonators, cross-entropy": {**_RESONATOR, "share": 0.5},
}
_ONE_COPY = {"input_delays": [0]}
_DELAYS = {**_ONE_COPY, "max_delay": 40}
_FEW_DELAYS = {**_ONE_COPY, "max_delay": 10}
_DROPPED = {"event_dropout": 0.2}
_DILATED = {"dilation": [0.8, 1.25], "dilation_keeps_label": True}
_LONG_BRAILLE = {
    **_DROPPED,
    **_DILATED,
    "dilation": [0.9, 1.1],
    "learning_rate": 0.05,
    "epochs": 200,
    "lr_every": 32,
    "average_epochs": 20,
}
_SMALL_SPEED = {"hidden": 150, "input_delays": [0, 2, 5, 10, 20, 40]}
_TINY_SPEED = {**_SMALL_SPEED, **_RESONATOR, "hidden": 40}
_TINY_BRAILLE = {**_CROSS_ENTROPY, "hidden": 40, "input_delays": [0]}
_PRUNED_BRAILLE = {**_CROSS_ENTROPY, "pruned": 0.78, "prune_epoch": 0.35}


def _taught(recordings: str, **keys: Any) -> dict[str, Any]:
    """Return a teacher: the network of a set, with some other keys."""
    return {"teacher": {"kind": "snn", **SETS[recordings].model, **keys}}


CASES = (
    *(Case(name, design, keys) for name in SETS for design, keys in _NEURONS_AND_LOSSES.items()),
    Case("6 speeds", "small, CUBA-LIF, spike rate", _SMALL_SPEED, _deltas(2, 8)),
    Case("6 speeds", "small, resonators, cross-entropy", {**_SMALL_SPEED, **_RESONATOR}, _deltas(2, 8)),
    Case(
        "6 speeds",
        "small, resonators, event dropout",
        {**_SMALL_SPEED, **_RESONATOR},
        _deltas(2, 8),
        _DROPPED,
    ),
    Case(
        "6 speeds",
        "small, resonators, blend",
        {**_SMALL_SPEED, **_RESONATOR},
        _deltas(2, 8),
        {"blend": 0.5},
    ),
    Case(
        "6 speeds",
        "small, resonators, spike penalty",
        {**_SMALL_SPEED, **_RESONATOR, "hidden_spike_penalty": 1e-5},
        _deltas(2, 8),
    ),
    Case(
        "6 speeds", "small, resonators, one copy", {**_SMALL_SPEED, **_RESONATOR, **_ONE_COPY}, _deltas(2, 8)
    ),
    Case("6 speeds", "small, CUBA-LIF, delays", {**_SMALL_SPEED, **_CROSS_ENTROPY, **_DELAYS}, _deltas(2, 8)),
    Case("6 speeds", "resonators, delays, event dropout", {**_RESONATOR, **_DELAYS}, training=_DROPPED),
    Case(
        "6 speeds",
        "resonators, delays, event dropout, crops of 64",
        {**_RESONATOR, **_DELAYS},
        training={**_DROPPED, "epochs": 480, "lr_every": 80},
        jitter_steps=64,
    ),
    Case("6 speeds", "resonators, one copy, event dropout", {**_RESONATOR, **_ONE_COPY}, training=_DROPPED),
    Case("6 speeds", "tiny, resonators", _TINY_SPEED, _deltas(2, 8)),
    Case(
        "6 speeds", "tiny, resonators, taught", _TINY_SPEED, _deltas(2, 8), _taught("6 speeds", **_RESONATOR)
    ),
    Case("7 fabrics", "pruned, CUBA-LIF, spike rate", {"pruned": 0.73, "prune_epoch": 0.35}),
    Case(
        "7 fabrics", "pruned, resonators, cross-entropy", {"pruned": 0.73, "prune_epoch": 0.35, **_RESONATOR}
    ),
    Case("7 fabrics", "cross-entropy, event dropout", _CROSS_ENTROPY, training=_DROPPED),
    Case(
        "7 fabrics",
        "pruned, cross-entropy, event dropout",
        {"pruned": 0.73, "prune_epoch": 0.35, **_CROSS_ENTROPY},
        training=_DROPPED,
    ),
    Case("7 fabrics", "CUBA-LIF, delays", _FEW_DELAYS),
    Case("7 fabrics", "small, CUBA-LIF, spike rate", {**_ONE_COPY, "hidden": 118}),
    Case("7 fabrics", "small, dilation", {**_ONE_COPY, "hidden": 118}, training=_DILATED),
    Case("7 fabrics", "small, delays, dilation", {**_FEW_DELAYS, "hidden": 118}, training=_DILATED),
    Case("7 fabrics", "resonators, event dropout", _RESONATOR, training=_DROPPED),
    Case("7 fabrics", "resonators, blend", _RESONATOR, training={"blend": 0.5}),
    Case(
        "7 Braille letters",
        "few spikes, CUBA-LIF, spike rate",
        {"hidden": 100, "initial_rate": 0.08, "threshold": 3.0},
    ),
    Case(
        "26 ridged textures",
        "small, CUBA-LIF, cross-entropy",
        {**_CROSS_ENTROPY, "hidden": 60, "input_delays": [0, 30, 100]},
    ),
    Case("7 Braille letters", "CUBA-LIF, event dropout", _CROSS_ENTROPY, training=_DROPPED),
    Case(
        "7 Braille letters",
        "CUBA-LIF, event dropout, dilation",
        _CROSS_ENTROPY,
        training={**_DROPPED, **_DILATED, "dilation": [0.9, 1.1]},
    ),
    Case(
        "7 Braille letters",
        "long, 160 hidden, event dropout, dilation",
        {**_CROSS_ENTROPY, "hidden": 160},
        training={**_LONG_BRAILLE, "learning_rate": 0.1},
    ),
    Case("7 Braille letters", "CUBA-LIF, delays", {**_CROSS_ENTROPY, "input_delays": [0], "max_delay": 62}),
    Case("7 Braille letters", "CUBA-LIF, one copy", {**_CROSS_ENTROPY, **_ONE_COPY}),
    Case(
        "7 Braille letters",
        "half resonators, event dropout",
        {**_RESONATOR, "share": 0.5},
        training=_DROPPED,
    ),
    Case(
        "7 Braille letters",
        "small, half resonators",
        {**_RESONATOR, "share": 0.5, "hidden": 40, "input_delays": [0, 8, 32]},
    ),
    Case("7 Braille letters", "pruned, event dropout", _PRUNED_BRAILLE, training=_DROPPED),
    Case(
        "7 Braille letters",
        "pruned, event dropout, taught",
        _PRUNED_BRAILLE,
        training={**_DROPPED, **_taught("7 Braille letters", **_CROSS_ENTROPY)},
    ),
    Case(
        "7 Braille letters",
        "pruned, 40 hidden, event dropout, taught",
        {**_PRUNED_BRAILLE, "hidden": 40, "pruned": 0.57},
        training={**_DROPPED, **_taught("7 Braille letters", **_CROSS_ENTROPY)},
    ),
    Case(
        "7 Braille letters",
        "two layers, delays, taught",
        {**_TINY_BRAILLE, "hidden": [36, 26], "max_delay": 62},
        training={
            **_LONG_BRAILLE,
            "dropout": 0.0,
            **_taught("7 Braille letters", **_CROSS_ENTROPY),
        },
    ),
    Case("7 Braille letters", "tiny, cross-entropy", _TINY_BRAILLE),
    Case(
        "7 Braille letters",
        "tiny, cross-entropy, taught",
        _TINY_BRAILLE,
        training=_taught("7 Braille letters", **_CROSS_ENTROPY),
    ),
)

HEADLINE = {
    "headline_fabrics": "7 fabrics",
    "headline_fabrics_small": "7 fabrics",
    "headline_speeds": "6 speeds",
    "headline_speeds_small": "6 speeds",
    "headline_ridges": "26 ridged textures",
    "headline_braille": "7 Braille letters",
    "headline_braille_small": "7 Braille letters",
    "headline_objects": "36 objects",
    "headline_objects_small": "36 objects",
}
"""The shipped search spaces of the README's table, a network each, and what they recognise."""


def classifiers() -> dict[str, Any]:
    """Return the baselines, fresh."""
    return {
        "LR": make_pipeline(StandardScaler(), LogisticRegression(C=0.1, max_iter=5000)),
        "kNN": make_pipeline(StandardScaler(), KNeighborsClassifier(5)),
    }


def features(data: dse.base.records.Dataset, bins: int) -> np.ndarray:
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
    assert isinstance(signals, dse.base.records.Signals)
    begins = signals.offsets[:-1] + (np.diff(signals.offsets) - n_steps) // 2
    windows = np.stack([signals.values[b : b + n_steps] for b in begins]).astype(float)
    magnitude = np.abs(np.fft.rfft(windows - windows.mean(axis=1, keepdims=True), axis=1))
    return np.asarray(magnitude[:, 1:17].reshape(len(windows), -1))


def headline(name: str) -> dse.config.SearchSpace:
    """Return a shipped search space of the README's table, tested on unseen groups too."""
    evaluation = SETS[HEADLINE[name]].evaluation
    tested = {"evaluation": yaml.safe_dump(evaluation, default_flow_style=True)} if evaluation else {}
    return dse.load_space(name, tested)


def trained(recordings: str, design: str, space: dse.config.SearchSpace, jobs: int) -> dict[str, Any]:
    """Train a space of one design; return its row, whose numbers are means over seeds."""
    with tempfile.TemporaryDirectory() as folder:
        study = dse.run(space, Path(folder), jobs=jobs)
        runs = study.runs(0)
        hidden = [hidden_spikes(study.folder, run["repeat"]) for run in runs]
        trial = study.trials.iloc[0]
    moved = ("accuracy_shifted", "accuracy_shifted_min")
    unseen = [
        name for name in trial.index if name.startswith("accuracy_unseen_") and not name.endswith("_se")
    ]
    return {
        "data": recordings,
        "classifier": design,
        "weights": round(trial["n_weights"]),
        "hidden_spikes": round(np.mean(hidden)),
        **{
            name: float(trial[name])
            for name in ("energy_uj", "accuracy", "accuracy_se", *moved, *unseen)
            if name in trial
        },
        "each": " ".join(f"{run['columns']['accuracy']:.3f}" for run in runs),
        "train_s": float(trial["train_s"]),
    }


def baselines(name: str) -> list[dict[str, Any]]:
    """Return the rows of the baselines of a set."""
    space = Case(name, "", {}).space(1)
    data, _ = dataset.build(space.resolve({}), space.source.parent)
    inputs = {"spike totals": features(data, 1), "spikes in 16 bins": features(data, 16)}
    if (analog := spectra(space, data.n_steps)) is not None:
        inputs["analog spectrum"] = analog
    rows = []
    for what, x in inputs.items():
        for label, model in classifiers().items():
            began = time.process_time()
            model.fit(x[data.train], data.target[data.train])
            score = model.score(x[data.validation], data.target[data.validation])
            took = time.process_time() - began
            rows.append(
                {"data": name, "classifier": f"{label} on {what}", "accuracy": score, "train_s": took}
            )
    return rows


def main() -> None:
    """Train, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--jobs", type=int, default=2)
    chosen = parser.add_mutually_exclusive_group()
    chosen.add_argument("--readme", action="store_true", help="the shipped spaces of the README's table")
    chosen.add_argument("--only", default="", help="only cases whose 'set: design' holds this text")
    parser.add_argument("--csv", type=Path, help="also write the rows to this file")
    arguments = parser.parse_args()
    rows: list[dict[str, Any]] = []
    cases = [
        (case.recordings, case.design, case.space(arguments.seeds))
        for case in CASES
        if arguments.only in str(case) and not arguments.readme
    ]
    if arguments.readme:
        cases = [(recordings, name, headline(name)) for name, recordings in HEADLINE.items()]
    for recordings, design, space in cases:
        if all(row["data"] != recordings for row in rows):
            rows += baselines(recordings)
        rows.append(trained(recordings, design, space, arguments.jobs))
        print(rows[-1], flush=True)
        if arguments.csv is not None:
            pd.DataFrame(rows).to_csv(arguments.csv, index=False)
    frame = pd.DataFrame(rows)
    table = Table(*(name.removeprefix("accuracy_") for name in frame.columns), title="Recorded touch")
    for row in frame.itertuples(index=False):
        table.add_row(*("" if pd.isna(x) else f"{x:.3g}" if isinstance(x, float) else str(x) for x in row))
    Console(width=200).print(table)


def hidden_spikes(folder: Path, repeat: int) -> float:
    """Return the mean spikes of the hidden layers per validation sample."""
    said = store.response_of(store.load_arrays(store.run_file(folder, 0, repeat) / "response.npz"))
    return float(said.spikes[..., 1:-1].sum(axis=(1, 2)).mean())


if __name__ == "__main__":
    main()
