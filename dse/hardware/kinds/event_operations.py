"""Energy by counting operations, of a classifier that works when a spike arrives.

    E = mac M + addition A

as `dse.hardware.kinds.operations`, but M and A are those of work per input spike: a spike adds the weights
that it meets, so that the energy follows the spike rate. A dense pass multiplies all weights with all counts,
however few the spikes are. Spiking networks work per spike in both; of the others, elm has both counts:

    family         multiply-accumulates           additions
    elm            beta                           one per hidden neuron and spike in the delay line, and b

It is what a chip of current mirrors does: a spike is a current into every hidden neuron.

Source: Rasouli et al., an extreme learning machine for texture recognition, section II.E (REFERENCES.md).
"""

from __future__ import annotations

from dataclasses import dataclass

from dse.hardware.kinds.operations import CountedOperations
from dse.hardware.plan import NotApplicable, Plan
from dse.hardware.profile import Figures
from dse.records import Floats, Operations, Workload
from dse.registry import register


@register("hardware.kinds", "event_operations")
@dataclass(frozen=True)
class EventOperations(CountedOperations):
    """Energy per operation of work per input spike, without memory, power at rest, cores or time."""

    def counts(self, load: Workload | Operations) -> Floats:
        """Return what happens in an inference that works per spike, (..., F)."""
        return load.counts if isinstance(load, Workload) else load.of_events.counts

    def plan_operations(self, load: Operations, figures: Figures) -> Plan:
        """Return the plan of a classifier that can work per spike.

        Raises:
            NotApplicable: there are no counts of it.
        """
        if load.event_additions is None:
            raise NotApplicable(f"{self.name} runs only classifiers that count their work per spike")
        return super().plan_operations(load, figures)
