"""Check this code against a file of golden CUBA networks, laid out like cuba_golden.npz.

    python -m benchmarks.golden FILE

Every case and mode runs by the definition (dse.engine.neurons) and by the fast path (dse.engine). The table
holds the worst error of each kind: states, with 8-bit weights among them, in weight units; spikes and outputs
as wrong entries; rates; the loss, relative; gradients, relative to the largest entry of each.

Exit code 0: all within tolerance; 1: something is out; 2: the file cannot be read or is laid out otherwise.
"""

from __future__ import annotations

import argparse
import json
import sys
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from benchmarks.ours import rows_of
from dse.base.records import Arithmetic
from dse.engine.events import delayed, dense
from dse.engine.goal import SPIKE_RATE, Goal
from dse.engine.layers import prepare, weights
from dse.engine.network import gradients
from dse.engine.neurons import cuba_lif, fixed_point
from dse.engine.neurons.surrogate import Exponential, exponential

MODES = ("quant", "slayerfloat", "ideal")
"""8-bit weights and integer states; integer states with weights as given; real numbers."""

TOLERANCE = {"states": 0.0, "spikes": 0.0, "output": 0.0, "rates": 1e-12, "loss": 1e-6, "gradients": 1e-5}
_LARGEST_LOSS_TAKEN_FOR_ZERO = 1e-6  # below it the loss's error is as good as absolute


class GoldenError(ValueError):
    """A golden file cannot be read, or is laid out otherwise; one line that names the file."""


@dataclass(frozen=True)
class Case:
    """One golden network in one arithmetic mode.

    settings: its entry in the file's index. arrays: its arrays by their key without the case's name.
    """

    name: str
    mode: str
    settings: Mapping[str, Any]
    arrays: Mapping[str, np.ndarray]

    @property
    def n_layers(self) -> int:
        return int(self.settings["n_weight_layers"])

    @property
    def integer(self) -> bool:
        return self.mode != "ideal"

    @property
    def population(self) -> cuba_lif.Population:
        given = self.settings["params"]
        return cuba_lif.rounded(given["current_decay"], given["voltage_decay"], given["threshold"])

    @property
    def surrogate(self) -> Exponential:
        given = self.settings["params"]
        return exponential(self.population.to_threshold, given["tau_grad"], given["scale_grad"])

    def given(self, key: str) -> np.ndarray:
        """Return an input of the case: x (sample, step, channel), labels, w1 (neuron, input), ..."""
        found = self.arrays[key]
        return found.transpose(0, 2, 1) if key == "x" else found

    def running(self, layer: int) -> np.ndarray:
        """Return the weights of a layer (from 1) as they run, (neuron, input)."""
        weight = self.given(f"w{layer}")
        return fixed_point.quantise(weight) if self.mode == "quant" else weight

    def passes(self, layer: int) -> np.ndarray | float:
        """Return where the gradient of a layer's weights survives their rounding."""
        return fixed_point.quantise_passes(self.given(f"w{layer}")) if self.mode == "quant" else 1.0

    def expected(self, key: str) -> np.ndarray:
        """Return a result of the mode; states and spikes with time before neurons."""
        found = self.arrays[f"{self.mode}/{key}"]
        return found.transpose(0, 2, 1) if found.ndim == 3 else found

    def state(self, kind: str, layer: int) -> np.ndarray:
        """Return `cur` or `vol` of a layer (from 1) in weight units."""
        if self.integer:
            return self.expected(f"{kind}{layer}_int") / fixed_point.STATE_SCALE
        return self.expected(f"{kind}{layer}")

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the arrays that the case must have, with the shapes that follow from its x and weights."""
        n, channels, steps = self.arrays["x"].shape
        sizes = [channels, *(len(self.arrays[f"w{k}"]) for k in range(1, self.n_layers + 1))]
        found: dict[str, tuple[int, ...]] = {"labels": (n,), f"{self.mode}/loss": ()}
        for k in range(1, self.n_layers + 1):
            over_time, matrix = (n, sizes[k], steps), (sizes[k], sizes[k - 1])
            suffix = "_int" if self.integer else ""
            found |= {f"{self.mode}/{kind}{k}{suffix}": over_time for kind in ("cur", "vol")}
            found |= {f"{self.mode}/spk{k}": over_time, f"{self.mode}/grad_w{k}": matrix, f"w{k}": matrix}
            if self.mode == "quant":
                found[f"quant/w{k}_int"] = matrix
        return found | {f"{self.mode}/out": over_time, f"{self.mode}/rate": over_time[:2]}


@dataclass(frozen=True)
class Found:
    """What one of our paths gives for a case.

    states: by name, in weight units: `cur1`, `vol1`, ... and, where weights are rounded, `w1`, ...
    spikes: per layer (sample, step, neuron) before the shift. output: the last layer's, shift included.
    gradients: per layer (neuron, input).
    """

    states: Mapping[str, np.ndarray]
    spikes: Sequence[np.ndarray]
    output: np.ndarray
    loss: float
    gradients: Sequence[np.ndarray]


def by_definition(case: Case) -> Found:
    """Run a case by the equations of dse.engine.neurons."""
    population, shifts = case.population, case.settings["delay_shift"]
    arithmetic: Arithmetic = "integer" if case.integer else "ideal"
    states, inputs, fired = {}, [case.given("x").astype(np.float64)], []
    used = [case.running(k).astype(np.float64) for k in range(1, case.n_layers + 1)]
    for k, weight in enumerate(used, 1):
        states[f"cur{k}"], states[f"vol{k}"], spikes = cuba_lif.run(
            inputs[-1] @ weight.T, population, arithmetic
        )
        if case.mode == "quant":
            states[f"w{k}"] = weight
        fired.append(spikes)
        inputs.append((cuba_lif.shift(spikes) if shifts else spikes).astype(np.float64))
    output, n_steps = inputs.pop(), inputs[0].shape[1]
    goal = Goal(SPIKE_RATE, case.settings["true_rate"], case.settings["false_rate"])
    outputs = goal.outputs(case.given("labels"), n_steps, output.shape[2])
    loss, by_count = goal.loss.gradient(output.sum(axis=1, keepdims=True), outputs)
    grad = np.repeat(by_count, n_steps, axis=1)
    by_weight = []
    for k in range(case.n_layers, 0, -1):
        if shifts:
            grad = np.concatenate([grad[:, 1:], np.zeros_like(grad[:, :1])], axis=1)
        grad = cuba_lif.backward(
            grad, case.surrogate(states[f"vol{k}"] - population.to_threshold), population
        )
        by_weight.append(np.einsum("nto,ntc->oc", grad, inputs[k - 1], optimize=True) * case.passes(k))
        grad = grad @ used[k - 1]
    return Found(states, fired, output, float(loss), by_weight[::-1])


def by_engine(case: Case) -> Found:
    """Run a case by the fast path, dse.engine."""
    p, shifts = case.population, case.settings["delay_shift"]
    layers = [weights(case.running(k).T, None, p) for k in range(1, case.n_layers + 1)]
    rows = inputs = rows_of(case.given("x"))
    states, fired = {}, []
    for k, layer in enumerate(layers, 1):
        done = prepare(layer, "integer" if case.integer else "ideal").forward(inputs, keep_voltage=True)
        states[f"vol{k}"] = done.voltage
        fired.append(dense(done.fired))
        inputs = delayed(done.fired) if shifts else done.fired
    found = gradients(
        rows,
        layers,
        [case.surrogate] * len(layers),
        case.given("labels"),
        true_rate=case.settings["true_rate"],
        false_rate=case.settings["false_rate"],
        arithmetic="integer" if case.integer else "ideal",
        gains=[None] * len(layers),
        shift=shifts,
    )
    by_weight = [g.T * case.passes(k) for k, g in enumerate(found.feed_forward, 1)]
    return Found(states, fired, dense(inputs), found.loss, by_weight)


PATHS = {"definition": by_definition, "engine": by_engine}


def errors(case: Case, found: Found) -> dict[str, float]:
    """Return the worst error of each kind in TOLERANCE; what is NaN stays NaN, which is in no tolerance."""

    def exact(name: str) -> np.ndarray:
        return case.expected(f"{name}_int") / 64 if name[0] == "w" else case.state(name[:3], int(name[3:]))

    def relative(ours: np.ndarray, golden: np.ndarray) -> float:
        worst, largest = _largest(ours - golden), _largest(golden)
        return worst / largest if largest else np.inf if worst else 0.0

    layers = range(1, case.n_layers + 1)
    loss = float(case.expected("loss"))
    states = [_largest(ours - exact(name).astype(ours.dtype)) for name, ours in found.states.items()]
    spikes = [np.sum(s != case.expected(f"spk{k}")) for k, s in zip(layers, found.spikes, strict=True)]
    by_weight = zip(layers, found.gradients, strict=True)
    return {
        "states": float(np.max(states)),
        "spikes": float(sum(spikes)),
        "output": float(np.sum(found.output != case.expected("out"))),
        "rates": _largest(found.output.mean(axis=1) - case.expected("rate")),
        "loss": abs(found.loss - loss) / max(abs(loss), _LARGEST_LOSS_TAKEN_FOR_ZERO),
        "gradients": float(np.max([relative(g, case.expected(f"grad_w{k}")) for k, g in by_weight])),
    }


def _largest(x: np.ndarray) -> float:
    return float(np.abs(x).max(initial=0.0))


def out_of_tolerance(worst: Mapping[str, float]) -> list[str]:
    """Return the kinds of error that are out."""
    return [kind for kind, limit in TOLERANCE.items() if not worst[kind] <= limit]


def read(path: Path) -> list[Case]:
    """Return the cases of a golden file, mode by mode, checked for their layout.

    Arrays of other groups (moving windows) are not read.

    Raises:
        GoldenError: the file cannot be read, or lacks something, or something has another shape.
    """
    try:
        if path.exists() and not zipfile.is_zipfile(path):
            raise ValueError("it is no zip archive")
        with path.open("rb") as stream, np.load(stream) as file:
            arrays = {name: file[name] for name in file.files}
    except (OSError, ValueError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        raise GoldenError(f"{path}: cannot be read as npz: {error}".splitlines()[0]) from error
    try:
        index = json.loads(str(arrays["index_json"]))
        if not (isinstance(index, dict) and index):
            raise ValueError("index_json must name at least one case")
        return [case for name, settings in index.items() for case in _cases(name, settings, arrays)]
    except KeyError as error:
        raise GoldenError(f"{path}: is no golden file: it has no {error}") from error
    except (ValueError, TypeError, AttributeError) as error:
        raise GoldenError(f"{path}: is no golden file: {error}".splitlines()[0]) from error


def _cases(name: str, settings: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> list[Case]:
    prefix = f"{name}/"
    own = {key.removeprefix(prefix): array for key, array in arrays.items() if key.startswith(prefix)}
    modes = [mode for mode in MODES if any(key.startswith(f"{mode}/") for key in own)]
    if not modes:
        raise ValueError(f"case {name} must have at least one mode of {', '.join(MODES)}")
    found = [Case(name, mode, settings, own) for mode in modes]
    for case in found:
        _ = case.surrogate, [float(settings[key]) for key in ("true_rate", "false_rate", "delay_shift")]
        if case.n_layers < 1:
            raise ValueError(f"case {name} must have n_weight_layers of at least 1, got {case.n_layers}")
        for key in ("x", *(f"w{k}" for k in range(1, case.n_layers + 1))):
            if key not in own:
                raise KeyError(prefix + key)
        if own["x"].ndim != 3 or not own["x"].size or not np.isin(own["x"], (0, 1)).all():
            got = f"{own['x'].dtype} {own['x'].shape}"
            raise ValueError(f"{prefix}x must be 0 or 1 by sample, channel and step, got {got}")
        for key, shape in case.shapes().items():
            if key not in own:
                raise KeyError(prefix + key)
            if own[key].shape != shape or own[key].dtype.kind not in "iufb":
                raise ValueError(
                    f"{prefix}{key} must be numbers {shape}, got {own[key].dtype} {own[key].shape}"
                )
        labels, n_classes = own["labels"], len(own[f"w{case.n_layers}"])
        if labels.dtype.kind not in "iu" or not ((labels >= 0) & (labels < n_classes)).all():
            raise ValueError(f"{prefix}labels must be whole numbers from 0 to {n_classes - 1}")
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("file", type=Path)
    path = parser.parse_args(arguments).file
    try:
        cases = read(path)
    except GoldenError as error:
        print(error, file=sys.stderr)
        return 2
    table = Table(title=f"Worst errors against {path.name}")
    for heading in ("case", "mode", "by", *TOLERANCE, "out"):
        table.add_column(heading, no_wrap=True)
    out = []
    for case in cases:
        for how, run in PATHS.items():
            worst = errors(case, run(case))
            wrong = out_of_tolerance(worst)
            cells = [("[red]%.2g[/]" if kind in wrong else "%.2g") % x for kind, x in worst.items()]
            table.add_row(case.name, case.mode, how, *cells, ", ".join(wrong) or "ok")
            out += [f"{case.name}, {case.mode}, {how}: {kind} {worst[kind]:.2g}" for kind in wrong]
    limits = ", ".join(f"{kind} {limit:g}" for kind, limit in TOLERANCE.items())
    console = Console(width=140, highlight=False)
    console.print(table)
    console.print(f"{len(cases) * len(PATHS)} checks; tolerances: {limits}")
    if out:
        console.print(f"[red]{len(out)} out of tolerance[/]; the first: {out[0]}")
    return 1 if out else 0


if __name__ == "__main__":
    sys.exit(main())
