"""What the C of a network does and takes, known before a line of it is written: the form, stored in flash."""

from __future__ import annotations

from dataclasses import dataclass

from dse.deploy.bounds import Bounds
from dse.deploy.c.arrays import Matrix, stored
from dse.deploy.classifier import Classifier
from dse.deploy.form import Frame, LayerForm, Rule, Unsupported, frame_of, in_steps, net_of, rule_of
from dse.neurons import cuba_lif, neuron_of, resonator, xylo_lif
from dse.records import Network

Population = cuba_lif.Population | resonator.Population | xylo_lif.Population
_WRITTEN = (cuba_lif.Population, resonator.Population, xylo_lif.Population)
_MOST_CHANNELS = 2**16


@dataclass(frozen=True)
class LayerPlan(LayerForm):
    """A layer and its weights in flash.

    forward: from the delayed copies of the inputs, or from the layer before.
    back: from the layer itself; None: not recurrent.
    """

    population: Population
    bounds: Bounds
    forward: Matrix
    back: Matrix | None

    @property
    def n_later(self) -> int:
        """Network steps whose input must be held for delays of synapses, this one included; 0: none has."""
        delays = self.forward.delays
        return 0 if delays is None else 1 + int(delays.max(initial=0))

    @property
    def n_places(self) -> int:
        """Length of the array of u or x: its neurons, and those that fill packed rows."""
        return max(self.n_neurons, *(m.row_length for m in (self.forward, self.back) if m is not None), 0)


@dataclass(frozen=True, kw_only=True)
class Plan(Frame):
    """All that the C of a spiking network needs of a bundle.

    steps_per_sample: network steps per input step.
    delays: of the copies of the inputs, network steps.
    """

    layers: tuple[LayerPlan, ...]
    steps_per_sample: int
    delays: tuple[int, ...]
    rule: Rule

    @property
    def network_steps(self) -> int:
        """Network steps of the window."""
        return self.n_steps * self.steps_per_sample

    @property
    def n_slots(self) -> int:
        """Input steps whose spikes must be remembered."""
        return max(self.delays) // self.steps_per_sample + 1

    @property
    def is_delayed(self) -> bool:
        """Whether there are delayed copies of the inputs."""
        return any(self.delays)


def plan_of(bundle: Classifier) -> Plan:
    """Return the plan of a bundle of a spiking network.

    Raises:
        Unsupported: C cannot hold its classifier; the reason.
    """
    network = bundle.fitted
    assert isinstance(network, Network)
    frame = frame_of(bundle)
    per_sample = network.steps_per_sample
    rule = rule_of(bundle, frame.n_steps * per_sample, network.sizes[-1], frame.step_ms / per_sample)
    return plan_on(frame, network, rule)


def plan_on(frame: Frame, network: Network, rule: Rule) -> Plan:
    """Return the plan of a network with what surrounds it.

    Raises:
        Unsupported: C cannot hold the network; the reason.
    """
    if network.arithmetic != "integer":
        raise Unsupported(f"C needs a network in integer arithmetic, got {network.arithmetic} arithmetic")
    for layer in network.layers:
        if not issubclass(neuron_of(layer.neuron).Populations, _WRITTEN):
            names = "CUBA-LIF neurons, resonators and xylo_lif"
            raise Unsupported(f"C is written for {names}, got neuron {layer.neuron}")
    if max(*network.sizes, network.n_channels) > _MOST_CHANNELS:
        raise Unsupported(f"C numbers neurons with 16 bits, and a layer has {max(network.sizes)}")
    net = net_of(network, frame.n_steps * network.steps_per_sample)
    if any(x.bounds is None or max(x.bounds.first, x.bounds.second) >= 2**50 for x in net.layers):
        raise Unsupported("the states of a layer may exceed 50 bits within its window")
    if (most := net.layers[-1].most_spikes) > 1:
        raise Unsupported(f"C counts one spike of an output in a step, and these fire up to {most}")
    return Plan(
        **vars(frame),
        layers=tuple(map(_stored, net.layers)),
        steps_per_sample=net.steps_per_sample,
        delays=net.delays,
        rule=rule,
    )


def _stored(layer: LayerForm) -> LayerPlan:
    back = None if layer.recurrent is None else stored(in_steps(layer.recurrent))
    return LayerPlan(**vars(layer), forward=stored(in_steps(layer.weights), layer.delays), back=back)
