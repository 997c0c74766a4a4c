"""Kinds whose cost is linear in the counts of an inference, with neither cores nor limits.

    operations             E = mac M + addition A                M multiply-accumulates, A additions
    event_operations       the same, with M and A of work per input spike
    per_event_convention   E = synaptic_event sum_l s_l f_l + neuron_update N T
    platform               E = (at rest + beyond rest) x length of the input

Counts per inference: T steps, N neurons (resonators count twice), s_l spikes and f_l targets per spike of
layer l. Counting operations is what the literature quotes where no chip is named. It is computing alone:
moving data costs more than that, and static power, cores and time are left out. It compares classifiers of
all families by one rule, and with published figures by the same rule, and nothing else. A spiking network
adds a weight per spike and synapse other than 0; its neurons are not counted, while syops-counter has one
more addition per neuron and step.

What an inference of each family does, of which all kinds of hardware price the same counts:

    family         numbers stored               multiply-accumulates          additions
    snn,           weights other than 0         none                          one per spike and weight
    threshold_lif                                                             other than 0 that it reaches
    cascade        the same of both stacks      none                          the same of both stacks
    knn            training samples x features  one per number stored         one per input spike, to the
    naive_bayes    2 x features x classes                                     count of its window
    mlp, linear    matrices
    kernels        readout, thresholds          one per weight of the readout     the same, one per bin and
                                                                                  place of a group, 12 per bin
                                                                                  and kernel
    tcn            filters and readout          each weight of the readout once,  none
                                                of a filter whenever it computes
    elm            W, b and beta in use
    hots           prototypes, signatures       f + 1 per number of a         one per event; with the filter
                                                surface, event and layer (f   one per input event and place
                                                prototypes); one per number
                                                of the signatures

Numbers take their bits, stored as bits / 8 bytes. A state update is a neuron's in a step, of spiking families
only. Left out throughout: comparisons, sorting, exponentials and roots, the constants of classes, scales and
biases (but for b of elm), and what the program keeps between events, such as the time surfaces of hots.

A dense pass multiplies all weights with all counts, however few the spikes are. Work per input spike adds the
weights that a spike meets, so that the energy follows the spike rate: what a chip of current mirrors does,
where a spike is a current into every hidden neuron. Spiking networks work per spike in both; of the others,
elm has both counts: per spike, beta is its multiply-accumulates, and its additions are b and one per hidden
neuron and spike in the delay line.

A platform is a whole computer or board of which nothing but power is published: at rest, and while inference
goes on. It keeps pace with the sensor and computes for as long as the input lasts. Power does not depend on
the network, so a platform ranks no network above another.

Sources: syops-counter and SpikingJelly, which count so; Rasouli et al., an extreme learning machine for
texture recognition, section II.E; those of the profiles (REFERENCES.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dse.base.records import Floats, Operations, Workload
from dse.base.registry import register
from dse.measure.hardware.plan import NotApplicable, Placement, Plan, energy_only, per_count
from dse.measure.hardware.profile import Figures, Number, Profile, figure


@register("hardware.kinds", "operations")
@dataclass(frozen=True)
class CountedOperations(Profile):
    """Energy per operation of any classifier, without memory, static power, cores or time."""

    any_neuron = True

    mac_pj: Number = figure("pJ", "a multiply-accumulate")
    addition_pj: Number = figure("pJ", "an accumulation without multiplication, such as a spike's weight")

    def plan_network(self, load: Workload, figures: Figures) -> Plan:
        """Return the plan of a spiking network (`Profile.plan`)."""
        reached = load.fan_out if load.synapses is None else load.synapses
        return _linear(figures, addition=per_count(load, spike=reached))

    def plan_operations(self, load: Operations, figures: Figures) -> Plan:
        """Return the plan of any other classifier (`Profile.plan`)."""
        _, mac, addition, _ = np.eye(4)
        return _linear(figures, mac=mac, addition=addition)


@register("hardware.kinds", "event_operations")
@dataclass(frozen=True)
class EventOperations(CountedOperations):
    """Energy per operation of work per input spike, without memory, power at rest, cores or time."""

    def counts(self, load: Workload | Operations) -> Floats:
        """Return what happens in an inference that works per spike, (..., F)."""
        return load.counts if isinstance(load, Workload) else load.of_events.counts

    def plan_operations(self, load: Operations, figures: Figures) -> Plan:
        """Return the plan of a classifier that can work per spike."""
        if load.event_additions is None:
            raise NotApplicable(f"{self.name} runs only classifiers that count their work per spike")
        return super().plan_operations(load, figures)


@register("hardware.kinds", "per_event_convention")
@dataclass(frozen=True)
class EventConvention(Profile):
    """Figures per synaptic event and neuron update: a convention, without cores, time or static power."""

    synaptic_event_pj: Number = figure("pJ", "per synapse that a spike reaches, weights of 0 included")
    neuron_update_pj: Number = figure("pJ", "per neuron and step")

    def plan_network(self, load: Workload, figures: Figures) -> Plan:
        """Return the plan of a spiking network (`Profile.plan`)."""
        neurons = per_count(load, step=sum(load.sizes[1:]) + load.n_resonators)
        events = per_count(load, spike=load.fan_out)
        return _linear(figures, synaptic_event=events, neuron_update=neurons)


@register("hardware.kinds", "platform")
@dataclass(frozen=True)
class Platform(Profile):
    """A computer or board with published power and nothing else; it runs networks of spiking layers."""

    any_neuron = True

    idle_w: Number = figure("W", "power at rest")
    beyond_idle_w: Number = figure("W", "power in addition while inference goes on")

    def plan_network(self, load: Workload, figures: Figures) -> Plan:
        """Return the plan of a spiking network (`Profile.plan`)."""
        idle_mw, beyond_w = figures["idle_w"] * 1e3, figures["beyond_idle_w"]
        step = per_count(load, step=load.step_ms * 1e6)
        assumptions = (
            "it computes for as long as the input lasts",
            "its power is that of the published network, whatever the network",
        )
        return Plan(
            energy_pj={"beyond_idle": np.multiply.outer(beyond_w, per_count(load, step=load.step_ms * 1e9))},
            time_ns=np.multiply.outer(np.ones_like(beyond_w), step[None]),
            static_mw=idle_mw,
            idle_mw=idle_mw,
            placement=Placement((1,), assumptions=assumptions),
            running_mw=idle_mw + beyond_w * 1e3,
        )


def _linear(figures: Figures, **causes: Floats) -> Plan:
    """Return the plan of energies alone: of each cause, its figure times (F,) of it per count."""
    return energy_only({name: np.multiply.outer(figures[f"{name}_pj"], x) for name, x in causes.items()})
