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
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from dse.base.records import Ints
from dse.base.registry import register
from dse.deploy.bundle import Bundle
from dse.deploy.form import LayerForm, Net, Unsupported, net_of, network_in
from dse.deploy.reference import Reference
from dse.deploy.run import of_script
from dse.deploy.targets import BackEnd, Engine, Run
from dse.deploy.targets.chips import decision_of, inputs_of, misfit
from dse.engine.neurons import xylo_lif

CHIP = "xylo_imu"
_SPECIFICATION, _SCRIPT = "xylo.json", "run.py"
_RUN = Path(__file__).resolve().parents[1] / "xylo_run.py"


@register("targets", "xylo")
@dataclass(frozen=True)
class Xylo(BackEnd[Net]):
    """The network as a specification of Xylo, run in the vendor's simulator."""

    label: ClassVar[str] = "SynSense Xylo, specification for xylosim and Rockpool"
    extra: ClassVar[str] = "xylo"
    use: ClassVar[str] = (
        "`specification` in targets/xylo/xylo.json is what `XyloSim.from_specification` of Rockpool takes; "
        "`python targets/xylo/run.py` runs it with xylosim alone"
    )

    def form(self, bundle: Bundle) -> Net:
        """Return the network, within the limits of the chip."""
        net = net_of(network_in(bundle, "Xylo holds"))
        for k, layer in enumerate(net.layers, 1):
            if not isinstance(layer.population, xylo_lif.Population):
                raise Unsupported(
                    f"layer {k} has neurons '{layer.neuron}', but Xylo's decay by bit shifts and reset by "
                    "subtraction: train with model.neuron: xylo_lif"
                )
        if net.arithmetic != "integer":
            raise Unsupported(f"Xylo holds integers, and the network has {net.arithmetic} arithmetic")
        shifts = {
            _population(layer).weight_shift
            for k, layer in enumerate(net.layers[:-1])
            if k or layer.recurrent is not None
        }
        if len(shifts) > 1:
            raise Unsupported(f"hidden layers of Xylo share one shift of their weights, got {sorted(shifts)}")
        if why := misfit(bundle, CHIP):
            raise Unsupported(why)
        return net

    def emit(self, form: Net, bundle: Bundle, folder: Path) -> None:
        """Write xylo.json and run.py."""
        document = {
            "specification": specification(form),
            "hidden_layers": list(form.sizes[1:-1]),
            "inputs": inputs_of(form),
            "decision": decision_of(bundle),
        }
        (folder / _SPECIFICATION).write_text(json.dumps(document) + "\n", encoding="utf-8")
        shutil.copyfile(_RUN, folder / _SCRIPT)

    def engines(self, form: Net, bundle: Bundle, folder: Path, reference: Reference) -> Iterator[Engine]:
        """Run xylo.json in xylosim; figures say how near hidden neurons come to their cap."""
        if find_spec("xylosim") is None:
            yield Engine(("xylosim is not installed",))
            return
        fired, _ = of_script(sys.executable, _RUN, [folder / _SPECIFICATION], form, reference)
        by = f"xylosim {importlib.metadata.version('xylosim')}"
        yield Engine((by,), Run.of_fired(bundle, reference, fired), spike_counts(form, fired))


def spike_counts(net: Net, fired: Sequence[Ints]) -> dict[str, float]:
    """Return the most spikes of a hidden neuron in a step, and in how many steps of neurons they are capped.

    Args:
        net: its neurons spike up to `most_spikes` times in a step; what is beyond stays in the potential.
        fired: (n_spikes, 3) recording, step and neuron of each layer.
    """
    most, capped = 0, 0
    for layer, spikes in zip(net.layers[:-1], fired, strict=False):
        counts = np.unique(np.asarray(spikes).reshape(-1, 3), axis=0, return_counts=True)[1]
        most = max(most, int(counts.max(initial=0)))
        capped += int(np.count_nonzero(counts >= layer.most_spikes))
    return {"most_spikes_per_step": float(most), "capped_steps": float(capped)}


def specification(net: Net) -> dict[str, Any]:
    """Return the specification of a network of `xylo_lif` neurons, plain numbers; matrices are (from, to)."""
    *hidden, out = net.layers
    begins = np.cumsum([0, *net.sizes]).tolist()
    n_in, end = begins[1], begins[-2]
    weights = np.zeros((begins[-1], begins[-1]), np.int64)  # from and to inputs, hidden neurons, outputs
    for before, (begin, after), layer in zip(begins, pairwise(begins[1:]), net.layers, strict=False):
        weights[before:begin, begin:after] = layer.forward_steps
        if layer.recurrent is not None:
            weights[begin:after, begin:after] = layer.ring_steps
    populations = [_population(layer) for layer in hidden]
    neurons = {"dash_syn": "current_shift", "dash_mem": "voltage_shift", "threshold": "threshold"}
    return {
        "weights_in": weights[:n_in, n_in:end].tolist(),
        "weights_rec": weights[n_in:end, n_in:end].tolist(),
        "weights_out": weights[n_in:end, end:].tolist(),
        **{name: _joined(hidden, field) for name, field in neurons.items()},
        **{f"{name}_out": _joined([out], field) for name, field in neurons.items()},
        "weight_shift_in": populations[0].weight_shift,
        "weight_shift_rec": populations[-1].weight_shift,
        "weight_shift_out": _population(out).weight_shift,
    }


def _population(layer: LayerForm) -> xylo_lif.Population:
    assert isinstance(layer.population, xylo_lif.Population)
    return layer.population


def _joined(layers: Sequence[LayerForm], field: str) -> list[int]:
    """Return a parameter of the neurons of some layers, one number each."""
    values: list[Ints] = [np.broadcast_to(getattr(x.population, field), x.n_neurons) for x in layers]
    return [int(x) for x in np.concatenate(values)]
