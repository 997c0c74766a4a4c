"""A spiking network as C: the form, stored in flash."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from dse.deploy.c.arrays import Member, Table, index, members_of
from dse.deploy.c.code import Code
from dse.deploy.c.layer import LayerPlan, Population
from dse.deploy.c.text import filled, indented
from dse.deploy.classifier import Classifier
from dse.deploy.form import Spiking, Unsupported, spiking_of
from dse.engine.neurons import resonator, xylo_lif

_MOST_CHANNELS = 2**16


@dataclass(frozen=True, kw_only=True)
class Plan(Spiking, Code):
    """All that the C of a spiking network needs of a bundle."""

    layers: tuple[LayerPlan, ...]

    template: ClassVar[str] = "dse.c"

    @property
    def what(self) -> str:
        """What it is, a sentence."""
        sizes = "-".join(str(n) for n in (self.n_channels, *(layer.n_neurons for layer in self.layers)))
        return f"A {sizes} network of spiking neurons: integers only"

    @property
    def n_outputs(self) -> int:
        """Output neurons."""
        return self.layers[-1].n_neurons

    @property
    def longest_ring(self) -> int:
        """Neurons of the largest recurrent layer; 0 without any."""
        return max((x.n_neurons for x in self.layers if x.back is not None), default=0)

    def members(self) -> list[Member]:
        """Return all variables."""
        often = (x.n_neurons for x in self.layers if x.back is not None and x.several)
        own = members_of(
            "members.txt",
            self,
            neuron=index(self.longest_ring),
            often=max(often, default=0),
            counter="uint16_t" if self.network_steps < 2**16 else "uint32_t",
        )
        return [*own, *super().members()]

    @cached_property
    def tables(self) -> list[Table]:
        """Weights and parameters of the layers, delays of inputs, answers of joint heads."""
        out = [table for layer in self.layers for table in layer.tables()]
        if self.is_delayed:
            later = [(d, copy) for copy, d in enumerate(self.delays) if d]
            k = self.steps_per_sample
            out += [
                Table("uint16_t", "lags", np.array([d // k for d, _ in later])),
                Table("uint16_t", "copies", np.array([copy * self.n_channels for _, copy in later])),
            ]
            if k > 1:
                out.append(Table("uint16_t", "parts", np.array([d % k for d, _ in later])))
        if self.rule.joint:
            out.append(Table("int16_t", "joint", np.array([x if x >= 0 else -2 for x in self.rule.joint])))
        return out

    def parts(self) -> Counter[str]:
        """Return how often each part of the code occurs."""
        adders: dict[str, str] = {}
        n = super().parts()
        n.update(base=1, delayed_copies=self.is_delayed, confidence=self.rule.least_total is not None)
        n["many_classes"] = len(self.classes) > 4  # their names are searched with a longer loop
        for layer in self.layers:
            turns = layer.turns
            is_mixed = isinstance(layer.population, resonator.Population) and turns.any() and not turns.all()
            kind = "mixed" if is_mixed else "resonators" if turns.all() else "cuba_lif"
            if isinstance(layer.population, xylo_lif.Population):
                kind = "xylo_lif" if layer.several else "xylo_output"
            n[kind] += 1
            n["recurrent"] += layer.back is not None
            n["held"] += layer.n_later > 0
            for row in layer.rows:
                if row.is_short:
                    n["short_matrix"] += 1
                    n["short_row"] += row.matrix.row_length
                else:
                    adders[row.adder] = "later" if row.matrix.delays is not None else row.matrix.form
        n.update(f"add_{form}" for form in adders.values())
        return n

    def values(self) -> dict[str, Any]:
        """Return what dse.c needs: layers, the decision, a step and its input spikes, what is set to 0."""
        updates = "".join(layer.update() for layer in self.layers)
        rows = [row for layer in self.layers for row in layer.rows]
        adders = dict.fromkeys(row.adder_text for row in rows if not row.is_short)
        return {
            "leaks": filled("leaks.c", leak="LEAK(" in updates, decayed="decayed(" in updates),
            "rows": "".join([*adders, *(row.text for row in rows)]),
            "layers": "".join(map(self._layer, reversed(self.layers))),
            **self._decision(),
            **self._step(),
        }

    def _layer(self, layer: LayerPlan) -> str:
        """Return the function that advances a layer."""
        rule, is_last, inside = self.rule, layer is self.layers[-1], ""
        if (rule.first, rule.n) != (0, layer.n_neurons):
            inside = f"i < {rule.n}u" if rule.first == 0 else f"(i - {rule.first}u) < {rule.n}u"
        values = {"next": layer.k + 1, "last": is_last, "inside": inside, "fired": index(self.longest_ring)}
        spikes = filled("spike.c", layer, **values, **{"in": "    " if layer.several else ""})
        update = indented(indented(layer.update(indented(spikes))))
        return filled("layer.c", layer, n_layers=len(self.layers), update=update)

    def _decision(self) -> dict[str, Any]:
        rule, confidence = self.rule, self.rule.confidence
        sure = ""
        if confidence:
            largest = self.network_steps * self.n_outputs
            wide = largest * max(confidence.numerator, confidence.denominator) >= 2**32
            cast = "(uint64_t)" if wide else ""
            sure = (
                f" && (({cast}net->counts[best] * {confidence.denominator}u) >= "
                f"({cast}net->total * {confidence.numerator}u))"
            )
        heads = [{**_of_outputs(first, n), "n": n} for first, n in rule.heads]
        return {"heads": heads, "sure": sure, **_of_outputs(rule.first, rule.n)}

    def _step(self) -> dict[str, Any]:
        copies = [copy * self.n_channels for copy, delay in enumerate(self.delays) if delay == 0]
        several_parts = self.steps_per_sample > 1
        return {
            "slot": "net->slot" if self.n_slots > 1 else "0",
            "several_slots": self.n_slots > 1,
            "at_once": [{"copy": f"{first}u + " if first else ""} for first in copies],
            "n_later": len(self.delays) - len(copies),
            "part": ", part" if several_parts else "",
            "of_part": " && (parts[i] == part)" if several_parts else "",
            "in": " " * (8 if several_parts else 4),
            "steps": self.layers[::-1],
        }


def plan_of(bundle: Classifier, fixed: bool = False) -> Plan:
    """Return the plan of a bundle of a spiking network; fixed: its form follows from no weight."""
    form = spiking_of(bundle)
    if form.arithmetic != "integer":
        raise Unsupported(f"C needs a network in integer arithmetic, got {form.arithmetic} arithmetic")
    for layer in form.layers:
        if not isinstance(layer.population, Population):
            names = "CUBA-LIF neurons, resonators and xylo_lif"
            raise Unsupported(f"C is written for {names}, got neuron {layer.neuron}")
    if max(*form.sizes, form.n_channels) > _MOST_CHANNELS:
        raise Unsupported(f"C numbers neurons with 16 bits, and a layer has {max(form.sizes)}")
    if any(x.bounds is None or max(x.bounds.first, x.bounds.second) >= 2**50 for x in form.layers):
        raise Unsupported("the states of a layer may exceed 50 bits within its window")
    if (most := form.layers[-1].most_spikes) > 1:
        raise Unsupported(f"C counts one spike of an output in a step, and these fire up to {most}")
    return Plan(**{**vars(form), "layers": tuple(LayerPlan.of(x, fixed) for x in form.layers)})


def _of_outputs(first: int, n: int) -> dict[str, Any]:
    """Return the values by which the most active of some outputs is found, the lowest on ties."""
    return {"first": first, "second": first + 1, "end": first + n, "less": f" - {first}u" if first else ""}
