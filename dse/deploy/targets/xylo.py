"""SynSense Xylo: a specification for the vendor's bit-precise simulator, and a script that runs it there.

xylo.json    the specification, by the names that Rockpool's `XyloSim.from_specification` takes; how inputs
             arrive, the decision rule
run.py       runs it in xylosim on spikes (dse.deploy.xylo_run)

Only neurons `xylo_lif` are as on the chip; others decay and reset otherwise, so a network of theirs must be
trained again. The limits are those of the profile xylo_imu. A weight of 8 bits is stored as it is; the
shifts of weights and thresholds are those of the neurons. All hidden layers lie in the hidden neurons, one
after the other: weights to the next layer and recurrent weights are `weights_rec`.

What xylosim 0.1.3 (module v2) does, found by running it on cases that were computed by hand:

  * A step: input spikes are delivered, then spikes that hidden neurons fired in the step before, to hidden
    neurons and to outputs alike. Then hidden neurons evolve, then outputs. So every layer hands on its spikes
    one step later, as here.
  * A neuron: the current decays, with what has just arrived in it; the potential decays; the current is
    added; the threshold is subtracted as often as the potential reaches it (equality does), at most 31 times
    of a hidden neuron and once of an output. What an output has left above it fires in the next steps.
  * A decay subtracts x >> dash, rounded down, but at least 1 from what is positive, and nothing from 0.
    A `dash_syn` of 0 empties the current before it is added: such a neuron never fires.
  * Sums saturate at -32768 and 32767: the current after every single spike, in the order of the inputs, then
    that of the hidden neurons; then the change of the potential, and the potential.
  * `reset_all` sets states and spikes on their way to 0. `XyloLayer` points to its synapses without owning
    them: without another reference to them the process crashes.

Where the current leaves 16 bits between two spikes of one step and comes back, the chip has lost what the
definition of `xylo_lif` keeps. Nothing else differs; a run shows it.

Source: xylosim, Rockpool (REFERENCES.md).
"""

from __future__ import annotations

import importlib.metadata
import json
import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dse.deploy.bundle import Bundle
from dse.deploy.reference import Reference
from dse.deploy.targets import Run, Verdict, compare
from dse.deploy.targets.chips import decision_of, inputs_of, misfit, run_script, whole_weights
from dse.neurons import population_of, xylo_lif
from dse.records import Ints, Layer, Network
from dse.registry import register

CHIP = "xylo_imu"
_SPECIFICATION, _SCRIPT = "xylo.json", "run.py"
_RUN = Path(__file__).resolve().parents[1] / "xylo_run.py"


@register("targets", "xylo")
@dataclass(frozen=True)
class Xylo:
    """The network as a specification of Xylo, run in the vendor's simulator."""

    label: ClassVar[str] = "SynSense Xylo, specification for xylosim and Rockpool"
    extra: ClassVar[str] = "xylo"
    use: ClassVar[str] = (
        "`specification` in targets/xylo/xylo.json is what `XyloSim.from_specification` of Rockpool takes; "
        "`python targets/xylo/run.py` runs it with xylosim alone"
    )

    def refusal(self, bundle: Bundle) -> str:
        """Return why Xylo cannot hold the classifier; '' if it can."""
        network = bundle.fitted
        if not isinstance(network, Network):
            return f"Xylo holds networks of neurons, and family {bundle.sections.kinds['model']} is none"
        for k, layer in enumerate(network.layers, 1):
            if not isinstance(population_of(layer.neuron, layer.parameters), xylo_lif.Population):
                return (
                    f"layer {k} has neurons '{layer.neuron}', but Xylo's decay by bit shifts and reset by "
                    "subtraction: train with model.neuron: xylo_lif"
                )
        if network.arithmetic != "integer":
            return f"Xylo holds integers, and the network has {network.arithmetic} arithmetic"
        shifts = {
            _population(layer).weight_shift
            for k, layer in enumerate(network.layers[:-1])
            if k or layer.recurrent is not None
        }
        if len(shifts) > 1:
            return f"hidden layers of Xylo share one shift of their weights, got {sorted(shifts)}"
        return misfit(bundle, CHIP)

    def write(self, bundle: Bundle, folder: Path) -> None:
        """Write xylo.json and run.py (`dse.deploy.targets.Target`)."""
        network = bundle.fitted
        assert isinstance(network, Network)
        document = {
            "specification": specification(network),
            "hidden_layers": list(network.sizes[1:-1]),
            "inputs": inputs_of(network),
            "decision": decision_of(bundle),
        }
        (folder / _SPECIFICATION).write_text(json.dumps(document) + "\n", encoding="utf-8")
        shutil.copyfile(_RUN, folder / _SCRIPT)

    def verify(self, bundle: Bundle, folder: Path, reference: Reference) -> Verdict:
        """Run xylo.json in xylosim, and compare; figures say how near hidden neurons come to their cap."""
        if find_spec("xylosim") is None:
            return Verdict("not verified", "xylosim is not installed")
        network = bundle.fitted
        assert isinstance(network, Network)
        fired, _ = run_script(sys.executable, _RUN, [folder / _SPECIFICATION], network, reference)
        run, figures = Run.of_fired(bundle, reference, fired), spike_counts(network, fired)
        return compare(reference, run, figures, run_by=[f"xylosim {importlib.metadata.version('xylosim')}"])


def spike_counts(network: Network, fired: Sequence[Ints]) -> dict[str, float]:
    """Return the most spikes of a hidden neuron in a step, and in how many steps of neurons they are capped.

    Args:
        network: its neurons spike up to `most_spikes` times in a step; what is beyond stays in the potential.
        fired: (n_spikes, 3) recording, step and neuron of each layer.
    """
    most, capped = 0, 0
    for layer, spikes in zip(network.layers[:-1], fired, strict=False):
        counts = np.unique(np.asarray(spikes).reshape(-1, 3), axis=0, return_counts=True)[1]
        most = max(most, int(counts.max(initial=0)))
        capped += int(np.count_nonzero(counts >= _population(layer).most_spikes))
    return {"most_spikes_per_step": float(most), "capped_steps": float(capped)}


def specification(network: Network) -> dict[str, Any]:
    """Return the specification of a network of `xylo_lif` neurons, plain numbers; matrices are (from, to)."""
    *hidden, out = network.layers
    borders = np.cumsum([0, *network.sizes[1:-1]])
    n_in, n_hidden = network.sizes[0], int(borders[-1])
    into = np.zeros((n_in, n_hidden), np.int64)
    among = np.zeros((n_hidden, n_hidden), np.int64)
    outward = np.zeros((n_hidden, network.sizes[-1]), np.int64)
    into[:, : borders[1]] = whole_weights(hidden[0].weight).T
    outward[borders[-2] :] = whole_weights(out.weight).T
    places = [slice(a, b) for a, b in pairwise(borders.tolist())]
    for before, here, layer in zip(places, places[1:], hidden[1:], strict=False):
        among[before, here] = whole_weights(layer.weight).T
    for here, layer in zip(places, hidden, strict=True):
        if layer.recurrent is not None:
            among[here, here] = whole_weights(layer.recurrent).T
    populations = [_population(layer) for layer in hidden]
    neurons = {"dash_syn": "current_shift", "dash_mem": "voltage_shift", "threshold": "threshold"}
    return {
        "weights_in": into.tolist(),
        "weights_rec": among.tolist(),
        "weights_out": outward.tolist(),
        **{name: _joined(hidden, field) for name, field in neurons.items()},
        **{f"{name}_out": _joined([out], field) for name, field in neurons.items()},
        "weight_shift_in": populations[0].weight_shift,
        "weight_shift_rec": populations[-1].weight_shift,
        "weight_shift_out": _population(out).weight_shift,
    }


def _population(layer: Layer) -> xylo_lif.Population:
    population = population_of(layer.neuron, layer.parameters)
    assert isinstance(population, xylo_lif.Population)
    return population


def _joined(layers: list[Layer], field: str) -> list[int]:
    """Return a parameter of the neurons of some layers, one number each."""
    values: list[Ints] = [np.broadcast_to(x.parameters[field], len(x.weight)) for x in layers]
    return [int(x) for x in np.concatenate(values)]
