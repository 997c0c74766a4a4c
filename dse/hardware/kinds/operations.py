"""Energy by counting operations: what the literature quotes where no chip is named.

    E = mac M + addition A          M multiply-accumulates, A additions per inference

Computing alone: moving data costs more than that, and static power, cores and time are left out. It compares
classifiers of all families by one rule, and with published figures by the same rule, and nothing else. A
spiking network adds a weight per spike and synapse other than 0; its neurons are not counted, while
syops-counter has one more addition per neuron and step.

What an inference of each family does, of which all kinds of hardware price the same counts:

    family         numbers stored               multiply-accumulates          additions
    snn,           weights other than 0         none                          one per spike and weight
    threshold_lif                                                             other than 0 that it reaches
    cascade        the same of both stacks      none                          the same of both stacks
    knn            training samples x features  one per number stored         one per input spike, to the
    naive_bayes    2 x features x classes                                     count of its window
    mlp            matrices
    elm            W, b and beta in use
    hots           prototypes, signatures       f + 1 per number of a         one per event; with the filter
                                                surface, event and layer (f   one per input event and place
                                                prototypes); one per number
                                                of the signatures

Numbers take their bits, stored as bits / 8 bytes. A state update is a neuron's in a step, of spiking families
only. Left out throughout: comparisons, sorting, exponentials and roots, the constants of classes, scales and
biases (but for b of elm), and what the program keeps between events, such as the time surfaces of hots.

Source: syops-counter and SpikingJelly, which count so (REFERENCES.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dse.hardware.plan import Plan, energy_only, per_count
from dse.hardware.profile import Figures, Number, Profile, figure
from dse.records import Operations, Workload
from dse.registry import register


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
        additions = per_count(load, spike=reached)
        return energy_only({"addition": figures["addition_pj"][..., None] * additions})

    def plan_operations(self, load: Operations, figures: Figures) -> Plan:
        """Return the plan of any other classifier (`Profile.plan`)."""
        mac, addition = figures["mac_pj"], figures["addition_pj"]
        none = np.zeros_like(mac)
        return energy_only(
            {
                "mac": np.stack([none, mac, none, none], axis=-1),
                "addition": np.stack([none, none, addition, none], axis=-1),
            }
        )
