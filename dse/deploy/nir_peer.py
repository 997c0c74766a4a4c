"""Run a NIR graph in Norse or snnTorch, step by step: a script for an interpreter that need not have dse.

    python nir_peer.py {norse,snntorch} GRAPH SPIKES FIRED

SPIKES (.npz): `spikes`, (n_spikes, 3) recording, step, input; `n_recordings`, `n_steps`.
FIRED (.npz, written): `fired_<k>`, (n_spikes, 3) recording, step, neuron of node layer_<k>, sorted; `version`
of the framework; `note`, what its own reader could not do, or ''.

Numbers are float32, as a user of the framework gets them.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import sys
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import torch

_BATCH = 64

Reader = Callable[[Any], tuple[torch.nn.Module, str]]
"""A NIR graph -> the framework's module at rest, and a note."""


def norse(graph: Any) -> tuple[torch.nn.Module, str]:
    """Return a graph in Norse: forward Euler with the dt of the graph, reset to zero."""
    from norse.torch.utils.import_nir import from_nir

    return from_nir(graph, dt=float(graph.metadata["dt"])), ""


def snntorch(graph: Any) -> tuple[torch.nn.Module, str]:
    """Return a graph in snnTorch.

    Its reader (1.0.0) takes a layer with recurrent weights for a graph within the graph, and loses its input
    or fails. Then its neurons are run in the whole graph, by the executor that it uses itself.
    """
    import nir
    import nirtorch
    import snntorch as snn
    from snntorch import import_nir

    layers = [name for name in graph.nodes if name.startswith("layer_")]
    nodes, edges = dict(graph.nodes), list(graph.edges)
    with contextlib.suppress(Exception):
        module = import_nir.import_from_nir(graph)
        if all(isinstance(module.get_submodule(name), snn.SpikingNeuron) for name in layers):
            return module, ""

    def neurons(node: Any) -> torch.nn.Module:
        made: torch.nn.Module = import_nir._nir_to_snntorch_module(node, init_hidden=True)
        return made

    whole = nir.NIRGraph(nodes=nodes, edges=edges, metadata=graph.metadata)
    module = nirtorch.nir_to_torch(whole, {nir.Linear: neurons, nir.CubaLIF: neurons})
    return module, "its neurons in the graph of nirtorch, since its own reader loses recurrent layers"


READERS: dict[str, Reader] = {"norse": norse, "snntorch": snntorch}


def run(
    module: torch.nn.Module, n_layers: int, n_inputs: int, spikes: Any, n_recordings: int, n_steps: int
) -> list[Any]:
    """Return per layer (n_spikes, 3) recording, step and neuron of every spike of a module at rest.

    Input spikes are (n_spikes, 3) recording, step, input; sorted by step.
    """
    fired: list[list[Any]] = [[np.zeros((0, 3), np.int64)] for _ in range(n_layers)]
    step = 0

    def watch(layer: int) -> Callable[[Any, Any, Any], None]:
        def hook(_module: Any, _inputs: Any, output: Any) -> None:
            values = output[0] if isinstance(output, tuple) else output
            recording, neuron = np.nonzero(values.reshape(n_recordings, -1).numpy())
            fired[layer].append(np.stack([recording, np.full_like(neuron, step), neuron], axis=1))

        return hook

    for k in range(n_layers):
        module.get_submodule(f"layer_{k}").register_forward_hook(watch(k))
    borders = np.searchsorted(spikes[:, 1], np.arange(n_steps + 1))
    state = None
    for step in range(n_steps):
        here = spikes[borders[step] : borders[step + 1]]
        values = torch.zeros(n_recordings, n_inputs)
        values[here[:, 0], here[:, 2]] = 1.0
        _, state = module(values, state)
    return [np.concatenate(parts) for parts in fired]


def main(framework: str, graph_file: str, spikes_file: str, fired_file: str) -> None:
    """Run recordings in batches, and write what fired."""
    import nir

    warnings.simplefilter("ignore")
    torch.set_num_threads(1)
    with np.load(spikes_file) as file:
        spikes = file["spikes"].astype(np.int64)
        n_recordings, n_steps = int(file["n_recordings"]), int(file["n_steps"])
    parts: list[list[Any]] = []
    note = ""
    for first in range(0, n_recordings, _BATCH):
        graph = nir.read(graph_file)
        n_layers = sum(name.startswith("layer_") for name in graph.nodes)
        n_inputs = int(graph.nodes["weights_0"].weight.shape[1])
        module, note = READERS[framework](graph)
        size = min(_BATCH, n_recordings - first)
        batch = spikes[(spikes[:, 0] >= first) & (spikes[:, 0] < first + size)] - np.array([first, 0, 0])
        batch = batch[np.argsort(batch[:, 1], kind="stable")]
        with torch.no_grad():
            fired = run(module, n_layers, n_inputs, batch, size, n_steps)
        parts.append([of_layer + np.array([first, 0, 0]) for of_layer in fired])
    arrays: dict[str, Any] = {}
    for k, of_layer in enumerate(zip(*parts, strict=True)):
        every = np.concatenate(of_layer)
        arrays[f"fired_{k}"] = every[np.lexsort(every.T[::-1])].astype(np.int32)
    version = importlib.metadata.version(framework)
    np.savez(fired_file, version=np.array(version), note=np.array(note), **arrays)


if __name__ == "__main__":
    main(*sys.argv[1:])
