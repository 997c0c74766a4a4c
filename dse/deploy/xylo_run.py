"""Run a network in SynSense's simulator of Xylo: a script that needs numpy and xylosim, and not dse.

    python run.py xylo.json SPIKES FIRED

xylo.json: `specification`, by the names and shapes that `XyloSim.from_specification` of Rockpool takes, with
weights (from, to); `hidden_layers`, sizes of the layers that lie one after the other in the hidden neurons.
SPIKES (.npz): `spikes`, (n_spikes, 3) recording, step, input; `n_recordings`, `n_steps`.
FIRED (.npz, written): `fired_<k>`, (n_spikes, 3) recording, step, neuron of layer k, sorted; a neuron that
fires several times in a step is there as often. The last layer is the outputs.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from xylosim.v2 import XyloLayer, XyloSynapse


class Simulation:
    """A specification as a layer of xylosim, and the synapses, which the layer points to without owning."""

    def __init__(self, spec: Mapping[str, Any]) -> None:
        self._synapses = [
            [[XyloSynapse(j, 0, w) for j, w in enumerate(row) if w] for row in spec[name]]
            for name in ("weights_in", "weights_rec", "weights_out")
        ]
        n_hidden, n_out = len(spec["weights_rec"]), len(spec["threshold_out"])
        into, among, out = self._synapses
        self.layer = XyloLayer(
            synapses_in=into,
            synapses_rec=among,
            synapses_out=out,
            aliases=[[] for _ in range(n_hidden)],
            threshold=spec["threshold"],
            threshold_out=spec["threshold_out"],
            has_bias=False,
            bias=[0] * n_hidden,
            bias_out=[0] * n_out,
            weight_shift_inp=spec["weight_shift_in"],
            weight_shift_rec=spec["weight_shift_rec"],
            weight_shift_out=spec["weight_shift_out"],
            dash_mem=spec["dash_mem"],
            dash_mem_out=spec["dash_mem_out"],
            dash_syns=[[dash] for dash in spec["dash_syn"]],
            dash_syns_out=[[dash] for dash in spec["dash_syn_out"]],
            name="network",
        )

    def run(self, inputs: Any) -> tuple[Any, Any]:
        """Return the spikes of hidden neurons and of outputs, (step, neuron), from rest.

        Args:
            inputs: (step, input) numbers of spikes.
        """
        self.layer.reset_all()
        outputs = self.layer.evolve(inputs.tolist())
        return np.array(self.layer.rec_recurrent_spikes), np.array(outputs)


def run(
    spec: Mapping[str, Any], hidden_layers: Sequence[int], spikes: Any, n: int, n_steps: int
) -> list[Any]:
    """Return (n_spikes, 3) recording, step and neuron of every spike of each layer.

    Args:
        spec: as Rockpool's.
        hidden_layers: sizes.
        spikes: (n_spikes, 3) recording, step, input.
        n: recordings 0 to n - 1.
        n_steps: of a recording.
    """
    simulation = Simulation(spec)
    borders = np.cumsum([0, *hidden_layers])
    fired: list[list[Any]] = [[np.zeros((0, 3), np.int64)] for _ in range(len(hidden_layers) + 1)]
    for recording in range(n):
        inputs = np.zeros((n_steps, len(spec["weights_in"])), np.int64)
        own = spikes[spikes[:, 0] == recording]
        np.add.at(inputs, (own[:, 1], own[:, 2]), 1)
        hidden, out = simulation.run(inputs)
        for parts, counts in zip(fired, [*np.split(hidden, borders[1:-1], axis=1), out], strict=True):
            step, neuron = np.nonzero(counts)
            listed = np.stack([np.full_like(step, recording), step, neuron], axis=1)
            parts.append(np.repeat(listed, counts[step, neuron], axis=0))
    return [np.concatenate(parts) for parts in fired]


def main(network: str, spikes_file: str, fired_file: str) -> None:
    """Read the files, run the recordings, write what fired."""
    document = json.loads(Path(network).read_text(encoding="utf-8"))
    with np.load(spikes_file) as file:
        spikes, n, n_steps = file["spikes"], int(file["n_recordings"]), int(file["n_steps"])
    fired = run(document["specification"], document["hidden_layers"], spikes, n, n_steps)
    np.savez(fired_file, **{f"fired_{k}": spikes.astype(np.int32) for k, spikes in enumerate(fired)})


if __name__ == "__main__":
    main(*sys.argv[1:])
