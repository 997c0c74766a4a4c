"""NIR: the network as a graph, run in Norse and in snnTorch.

graph.nir    input -> weights_0 -> layer_0 -> weights_1 -> ... -> output; recurrent_<k>: from layer_<k> back
golden.h5    made-up input spikes and the spikes of every layer, in NIR's format of data (`nir.read_data`)

A step of Norse and snnTorch is forward Euler: with tau_syn = dt/(1-a), tau_mem = dt/(1-b), w_in = tau_syn/dt,
r = tau_mem/dt and v_leak = 0 it is

    I = a I + W s,    v = b v + I,    s = 1 and v = 0 where v > v_threshold

which is a CUBA-LIF neuron (dse.engine.neurons.cuba_lif) of a = (4096 - d_u) / 4096 and b = (4096 - d_v) /
4096. Time constants are float64 and weights are those that run, so that a, b and W are exact. A decay of 0,
whose time constant is infinite, is written as 2**-40. dt is 1e-4, which snnTorch takes for granted: it stands
for a network step of any duration. Other readers may integrate otherwise and run another network: Rockpool
3.1 decays exponentially, by a dt of its own. A verdict is of the readers that it names.

What NIR has no word for is in the graph's metadata:

  * Layers hand on their spikes one step later, readers of NIR at once: layer k fires k steps earlier there.
    Recurrent spikes arrive one step later in both.
  * Delays of inputs, and of synapses of the first layer, are copies of the inputs, fed by whoever runs the
    graph: input d * n_channels + c is channel c, delays[d] steps ago. (Norse and snnTorch do not read the
    node Delay.) Delays of synapses of later layers, and of axons, are refused.
  * Input spikes arrive on the first of `steps_per_sample` steps.
  * The decision rule.

Equality ends at rounding. Integer states lose what is below 1/4096 at every leak, toward 0; no reader of NIR
does that. Where both decays are 0 or 4096 nothing is lost. Elsewhere u strays from the real number by less
than 1 / d_u, and v by less than (1 + 4096 / d_u) / d_v, in weight units: a neuron whose v comes so near its
threshold may fire in one of them alone. A threshold is written half a unit (1/8192) higher: integer states
fire alike, and neither equality nor float rounding matters.

Source: Pedersen et al. 2024 (REFERENCES.md).
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dse.base.records import Array, Dataset, Floats, Ints, Network, Spikes
from dse.base.registry import register
from dse.deploy.bundle import Bundle
from dse.deploy.form import Net, Unsupported, net_of, network_in
from dse.deploy.reference import Reference, windows_of
from dse.deploy.run import interpreter, of_script, require
from dse.deploy.targets import BackEnd, Engine, Run
from dse.deploy.targets.chips import decision_of
from dse.engine.events import gather
from dse.engine.neurons import cuba_lif
from dse.engine.neurons.fixed_point import DECAY_SCALE, STATE_SCALE
from dse.models.snn.respond import spikes_of_layers

DT = 1e-4
"""Duration of a step in the time unit of the graph, as snnTorch assumes it."""
FRAMEWORKS = ("norse", "snntorch")

_LEAST_DECAY = 2.0**-40
_GRAPH, _GOLDEN = "graph.nir", "golden.h5"
_PEER = Path(__file__).resolve().parents[1] / "nir_peer.py"
_GOLDEN_RATES = (0.0, 0.02, 0.1, 0.3)
_GOLDEN_STEPS = 64


@register("targets", "nir")
@dataclass(frozen=True)
class Nir(BackEnd[Network]):
    """The network as a NIR graph, run in Norse and in snnTorch."""

    label: ClassVar[str] = "NIR graph for Norse and snnTorch"
    extra: ClassVar[str] = "h5"
    use: ClassVar[str] = "`nir.read('targets/nir/graph.nir')`; golden.h5 beside it says what must come out"

    def form(self, bundle: Bundle) -> Network:
        """Return the network, with copies of the inputs for the delays of its first layer."""
        network = network_in(bundle, "NIR holds")
        for k, layer in enumerate(net_of(network).layers, 1):
            if k > 1 and layer.delays is not None and layer.delays.any():
                raise Unsupported(
                    f"no reader of NIR delays spikes in a network, and layer {k} receives some later"
                )
            if not isinstance(layer.population, cuba_lif.Population):
                if layer.neuron == "resonator":
                    raise Unsupported("NIR has no node whose two states rotate, as those of resonators do")
                raise Unsupported(
                    f"only CUBA-LIF neurons are written as NIR, and layers of '{layer.neuron}' are not"
                )
        return with_copies(network)

    def emit(self, form: Network, bundle: Bundle, folder: Path) -> None:
        """Write graph.nir and golden.h5."""
        require("h5py", "h5")
        _write_graph(folder / _GRAPH, net_of(form), _metadata(bundle, form))
        _write_golden(folder / _GOLDEN, form)

    def engines(self, form: Network, bundle: Bundle, folder: Path, reference: Reference) -> Iterator[Engine]:
        """Run graph.nir in the frameworks that are installed."""
        for framework in FRAMEWORKS:
            python = interpreter(framework, "nir")
            if python is None:
                yield Engine((f"{framework} is not installed",))
                continue
            require("h5py", "h5")
            fired, written = of_script(python, _PEER, [framework, folder / _GRAPH], form, reference)
            fired = [_moved(spikes, k, reference.n_steps) for k, spikes in enumerate(fired)]
            note = f", {written['note']}" if str(written["note"]) else ""
            by = f"{framework} {written['version']}{note}"
            yield Engine((by,), Run.of_fired(bundle, reference, fired))


def with_copies(network: Network) -> Network:
    """Return a network whose inputs are copied by the delays of the first layer; it spikes alike."""
    first = network.layers[0]
    if first.delay is None:
        return network
    weights, delays = [], []
    for copy, lag in enumerate(network.delays):
        columns = slice(copy * network.n_channels, (copy + 1) * network.n_channels)
        weight, delay = first.weight[:, columns], first.delay[:, columns]
        for late in np.unique(delay).tolist():
            weights.append(np.where(delay == late, weight, np.float32(0)))
            delays.append(lag + late)
    layer = dataclasses.replace(first, weight=np.concatenate(weights, axis=1), delay=None, shared=None)
    return dataclasses.replace(network, layers=(layer, *network.layers[1:]), delays=tuple(delays))


def time_constant(decay: Ints) -> Floats:
    """Return the time constants, in the time unit of the graph, of 12-bit decays per step."""
    return DT / np.maximum(np.asarray(decay, np.float64) / DECAY_SCALE, _LEAST_DECAY)


def _neuron(population: cuba_lif.Population, n: int, is_integer: bool) -> dict[str, Array]:
    """Return the parameters of a node CubaLIF of n neurons, (n,) float64 each."""
    tau_syn, tau_mem = (
        np.broadcast_to(time_constant(d), n).copy()
        for d in (population.decay_current, population.decay_voltage)
    )
    margin = 0.5 / STATE_SCALE if is_integer else 0.0
    return {
        "tau_syn": tau_syn,
        "tau_mem": tau_mem,
        "w_in": tau_syn / DT,
        "r": tau_mem / DT,
        "v_leak": np.zeros(n),
        "v_threshold": np.full(n, population.to_threshold + margin),
    }


def _metadata(bundle: Bundle, network: Network) -> dict[str, object]:
    rule = decision_of(bundle)
    return {
        "dt": DT,
        "integration": "forward Euler, one step per network step",
        "reset": "to 0 in the step of the spike; the synaptic current stays",
        "threshold": "a neuron fires where v > v_threshold",
        "arithmetic": network.arithmetic,
        "rounding": "the deployed network truncates each leak toward 0 to multiples of 1/4096"
        if network.arithmetic == "integer"
        else "none",
        "step_ms": "unknown" if bundle.input is None else bundle.input.step_ms / network.steps_per_sample,
        "handed_on": "here in the same step; in the deployed network one step later: layer k fires k steps "
        f"later, and the decision reads the output {len(network.layers)} steps later",
        "n_channels": network.n_channels,
        "delays": np.array(network.delays),
        "inputs": "input d * n_channels + c is channel c, delays[d] steps ago",
        "steps_per_sample": network.steps_per_sample,
        "classes": json.dumps(rule.pop("classes")),
        "heads": json.dumps(rule.pop("heads")),
        "decision": json.dumps(rule),
    }


def _write_graph(path: Path, net: Net, metadata: Mapping[str, object]) -> None:
    """Write the file as `nir.write` does, without `v_reset`: absent it is 0, and nir 1.0.4 refuses it."""
    import h5py

    with h5py.File(path, "w") as file:
        _put(file, "version", "1.0.4")
        graph = file.create_group("node")
        _put(graph, "type", "NIRGraph")
        nodes = graph.create_group("nodes")

        def node(name: str, kind: str, **values: object) -> str:
            group = nodes.create_group(name)
            for key, value in {"type": kind, **values}.items():
                _put(group, key, value)
            return name

        before, edges = node("input", "Input", shape=np.array([net.sizes[0]])), []
        for k, layer in enumerate(net.layers):
            matrix = node(f"weights_{k}", "Linear", weight=np.ascontiguousarray(layer.weights.T))
            assert isinstance(layer.population, cuba_lif.Population)
            neurons = _neuron(layer.population, layer.n_neurons, net.arithmetic == "integer")
            name = node(f"layer_{k}", "CubaLIF", **neurons)
            edges += [(before, matrix), (matrix, name)]
            if layer.recurrent is not None:
                ring = node(f"recurrent_{k}", "Linear", weight=np.ascontiguousarray(layer.recurrent.T))
                edges += [(name, ring), (ring, name)]
            before = name
        edges.append((before, node("output", "Output", shape=np.array([net.sizes[-1]]))))
        graph.create_dataset("edges", data=np.array(edges, object), dtype=h5py.string_dtype())
        about = graph.create_group("metadata")
        for key, value in metadata.items():
            _put(about, key, value)


def _put(group: Any, name: str, value: object) -> None:
    import h5py

    if isinstance(value, str):
        group.create_dataset(name, data=value, dtype=h5py.string_dtype())
    elif isinstance(value, np.ndarray) and value.ndim:
        group.create_dataset(name, data=value, compression="gzip")
    else:
        group.create_dataset(name, data=value)


def _write_golden(path: Path, network: Network) -> None:
    """Write made-up input spikes, and what the deployed network fires, at the steps of a reader of NIR."""
    import h5py

    data = _made_up(network.n_channels)
    n_steps = data.n_steps * network.steps_per_sample
    rows = gather(data.spikes, data.test, data.start, data.n_steps, network.delays, network.steps_per_sample)
    signals = {"input": (rows.listed(), network.sizes[0])}
    for k, fired in enumerate(spikes_of_layers(network, data, data.test)):
        signals[f"layer_{k}"] = (_moved(fired, -k, n_steps), network.sizes[k + 1])
    with h5py.File(path, "w") as file:
        file.attrs["__type__"] = "NIRGraphData"
        nodes = file.create_group("nodes")
        for name, (spikes, n) in signals.items():
            node = nodes.create_group(name)
            node.attrs["__type__"] = "NIRNodeData"
            observable = node.create_group("observables").create_group("spikes")
            observable.attrs["__type__"] = "TimeGriddedData"
            observable.attrs["dt"] = DT
            dense = np.zeros((len(data.test), n_steps, n), bool)
            dense[tuple(spikes.T)] = True
            observable.create_dataset("data", data=dense, compression="gzip")


def _made_up(n_channels: int) -> Dataset:
    """Return samples of random spikes, one per rate; the first is silent."""
    rng = np.random.default_rng(0)
    drawn = rng.random((len(_GOLDEN_RATES), _GOLDEN_STEPS, n_channels))
    return windows_of(Spikes.of_dense(drawn < np.array(_GOLDEN_RATES)[:, None, None], 1.0), ("",))


def _moved(spikes: Ints, by: int, n_steps: int) -> Ints:
    """Return spikes so many steps later, those outside of the window left out."""
    moved: Ints = np.asarray(spikes, np.int64) + np.array([0, by, 0])
    return moved[(moved[:, 1] >= 0) & (moved[:, 1] < n_steps)]
