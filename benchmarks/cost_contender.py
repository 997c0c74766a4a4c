"""The workers behind benchmarks.cost: a peer's simulation of a case, or many design points priced.

python -m benchmarks.cost_contender sanafe | price
"""

from __future__ import annotations

import resource
import sys
import time
from itertools import pairwise
from typing import Any

import numpy as np

from benchmarks.mapped_cases import LEAK, Case
from benchmarks.worker import serve

_NEURON = {"threshold": 1.0, "leak_decay": LEAK, "reset_mode": "soft"}
_UNITS = {
    "soma_hw_name": "loihi_lif",
    "default_synapse_hw_name": "loihi_dense_synapse",
    "default_dendrite_hw_name": "loihi_dendrites",
}
PORT = 1024
"""Inputs that a core can send for."""


def sanafe(fields: dict[str, Any], cores: list[int], timings: list[str]) -> list[dict[str, float]]:
    """Return what SANA-FE makes of a case; its inputs are sent by cores of their own, after the others.

    Args:
        fields: of the case.
        cores: of each layer after the input.
        timings: its models of time: simple, detailed, cycle.
    """
    import sanafe

    case = Case(**{key: tuple(x) if isinstance(x, list) else x for key, x in fields.items()})
    architecture, network = sanafe.load_loihi(), sanafe.Network()
    groups = [network.create_neuron_group("input", case.sizes[0])]
    groups += [
        network.create_neuron_group(f"layer{k}", n, _NEURON, **_UNITS)
        for k, n in enumerate(case.sizes[1:], 1)
    ]
    ports = np.array_split(np.arange(case.sizes[0]), -(-case.sizes[0] // PORT))
    for part in ports:
        for unit, j in enumerate(part):
            groups[0].neurons[int(j)].set_attributes(
                soma_hw_name=f"loihi_inputs[{unit}]",
                model_attributes={"spikes": case.inputs[:, j].tolist()},
            )
    for k, (before, group) in enumerate(pairwise(groups)):
        n = case.sizes[k]
        for source, rows in ((before, slice(n)), (group, slice(n, None))):
            _connect(source, group, case.weights[k][rows], case.connected[k][rows])
    places = architecture.cores() if callable(architecture.cores) else architecture.cores
    first = 0
    for group, n_cores in zip(groups[1:], cores, strict=True):
        _place(group, np.array_split(np.arange(len(group.neurons)), n_cores), places[first:])
        first += n_cores
    _place(groups[0], ports, places[first:])
    answers = []
    for timing in timings:
        chip = sanafe.SpikingChip(architecture)  # a reset chip has no inputs any more
        chip.load(network)
        began = time.process_time()
        run = chip.sim(case.n_steps, timing_model=timing, processing_threads=1)
        answers.append(
            {
                "cpu_s": time.process_time() - began,
                "energy_uj": 1e6 * run["energy"]["total"],
                "step_us": 1e6 * run["sim_time"] / case.n_steps,
                "spikes": run["neurons_fired"],
            }
        )
    return answers


def _connect(source: Any, target: Any, weight: np.ndarray, connected: np.ndarray) -> None:
    if connected.size == 0:
        return
    if connected.all():
        source.connect_neurons_dense(target, {"weight": weight.ravel().tolist()})
    else:
        pairs = [tuple(pair) for pair in np.argwhere(connected).tolist()]
        source.connect_neurons_sparse(target, {"weight": weight[connected].tolist()}, pairs)


def _place(group: Any, parts: list[np.ndarray], places: Any) -> None:
    for part, core in zip(parts, places, strict=False):
        for j in part:
            group.neurons[int(j)].map_to_core(core)


def price(hardware: str, n_architectures: int, n_points: int) -> dict[str, float]:
    """Return CPU seconds and peak memory of pricing points of many architectures, and of a loop over some.

    The peak is that of the process, Python and the points included; Linux starts it from the parent's.
    """
    from dse.base.records import Workload
    from dse.measure.hardware.cost import cost
    from dse.measure.hardware.profile import load

    def peak_gib() -> float:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20

    profile, rng = load(hardware), np.random.default_rng(0)
    every = np.unravel_index(rng.choice(2000 * 500, n_architectures, replace=False), (2000, 500))
    loads = []
    for n_inputs, n_hidden in zip(*(x.tolist() for x in every), strict=True):  # no two alike
        sizes = (1 + n_inputs, 1 + n_hidden, 7)
        n_steps = rng.integers(10, 128, n_points).astype(np.float64)
        spikes = n_steps[:, None] * np.array(sizes) * rng.uniform(0, 0.1, (n_points, 3))
        updates = n_steps[:, None] * np.array(sizes[1:]) * rng.random((n_points, 2))
        loads.append(Workload(sizes, (False, False), n_steps, spikes, updates, 1.0))
    points = [
        Workload(x.sizes, x.recurrent, x.n_steps[i], x.spikes[i], x.updates[i], x.step_ms)
        for x in loads[:100]
        for i in range(max(1, 2000 // len(loads[:100])))
        if i < n_points
    ]
    cost(profile, points[0])
    before_gib = peak_gib()
    began = time.process_time()
    at_once = [cost(profile, x).energy_uj.high for x in loads]
    took, gib = time.process_time() - began, peak_gib()
    began = time.process_time()
    one_by_one = np.array([float(cost(profile, x).energy_uj.high) for x in points])
    loop_s = (time.process_time() - began) / len(points)
    per_load = len(points) // len(loads[:100])
    sample = np.concatenate([x[:per_load] for x in at_once[:100]])
    return {
        "cpu_s": took,
        "peak_gib": gib,
        "before_gib": before_gib,
        "loop_s": loop_s,
        "error": float(np.abs(sample / one_by_one - 1).max()),
    }


def main() -> None:
    """Answer the parent."""
    if sys.argv[1] == "sanafe":
        import sanafe as _  # noqa: F401  what is missing is said at once

        serve({"sanafe": sanafe, "ready": lambda: True})
    else:
        serve({"price": price})


if __name__ == "__main__":
    main()
