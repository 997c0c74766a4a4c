"""What targets that are chips have in common: the limits of their hardware profiles, what they say beside."""

from __future__ import annotations

import math

import numpy as np

from dse.base.records import Network, Workload
from dse.deploy.classifier import Classifier
from dse.deploy.form import Net
from dse.engine.neurons import neuron_of
from dse.engine.neurons.fixed_point import BITS
from dse.measure.hardware import profile
from dse.measure.hardware.cost import NotApplicable


def misfit(bundle: Classifier, chip: str) -> str:
    """Return why a chip cannot hold the network of a bundle, by its hardware profile; '' if it can."""
    network = bundle.fitted
    assert isinstance(network, Network)
    sizes = network.sizes
    neurons = [(neuron_of(layer.neuron), layer) for layer in network.layers]
    peak = bundle.record.get("peak_state")  # of the design's validation
    load = Workload(
        sizes=sizes,
        recurrent=tuple(layer.recurrent is not None for layer in network.layers),
        n_steps=np.ones(1),
        spikes=np.zeros((1, len(sizes))),
        updates=None,
        # Without the step of the recordings no clock is too slow.
        step_ms=1e3 if bundle.input is None else bundle.input.step_ms / network.steps_per_sample,
        weight_bits=int(bundle.evidence.get("precision", {}).get("weight_bits", BITS)),
        stored=network.stored,
        delay_bits=network.delay_bits,
        resonators=tuple(neuron.resonators(layer.parameters) for neuron, layer in neurons),
        peak_state=int(peak) if isinstance(peak, int | float) and 0 <= peak < math.inf else 0,
    )
    chosen = profile.load(chip)
    try:
        placement = chosen.plan(load, chosen.ends).placement
    except NotApplicable as error:
        return str(error)
    if placement is None or not placement.misfits:
        return ""
    return f"the network does not fit {chip}: {placement.misfits[0]}"


def inputs_of(net: Net) -> dict[str, object]:
    """Return in words and numbers what arrives at each input of the first layer."""
    return {
        "n_channels": net.n_channels,
        "delays": list(net.delays),
        "steps_per_sample": net.steps_per_sample,
        "rule": "input d * n_channels + c spikes where channel c spiked, delays[d] network steps later; "
        "input steps arrive on the first of steps_per_sample network steps",
    }


def decision_of(bundle: Classifier) -> dict[str, object]:
    """Return the decision rule, the parts of a joint target, and the names of the classes."""
    heads = [{"name": x.name, "classes": list(x.classes)} for x in bundle.heads]
    return {**bundle.rule, "heads": heads, "classes": list(bundle.classes)}
