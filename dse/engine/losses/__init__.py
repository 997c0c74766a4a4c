"""Losses over output spikes: a file each, with the definition and its gradient in closed form.

A loss sees how often each output neuron has fired after one or more lengths of the input. Its gradient by a
spike is the sum of the gradients by the counts that include the spike: constant between two lengths, and over
the whole input where there is only one. No loss costs memory that grows with the number of steps.

To add a loss, here or in a module of your own, write a file with

    @register("losses", "my_loss")
    @dataclass(frozen=True)
    class MyLoss: ...                                       its YAML keys, and the methods of `Loss`

`dse.testing.check_loss` says what it lacks. `dse.engine.losses.spike_rate` is the shortest example.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

from dse.base.records import Array


@dataclass(frozen=True)
class Outputs:
    """What the outputs of some samples are to say; arrays are of the same library as the counts.

    is_label: (..., class) 1 where the neuron stands for the label of its head, else 0, floating; where a
        teacher is heard, probabilities of the classes of each head.
    lengths: steps after which output spikes are counted, rising; the last is the whole input.
    heads: classes of each head, whose outputs lie side by side.
    true_rate, false_rate: target spike rates of a label's neuron and of the others: numbers, or arrays that
        broadcast with counts.
    """

    is_label: Array
    lengths: tuple[int, ...]
    heads: tuple[int, ...]
    true_rate: Any
    false_rate: Any


class Loss(Protocol):
    """A loss over output spikes: a frozen dataclass whose fields are its YAML keys.

    Counts are (..., length, class) output spikes, arrays of numpy or of torch. Leading axes are samples, and
    the loss is a sum over them: what it says of one does not depend on the others.
    """

    def lengths(self, n_steps: int) -> tuple[int, ...]:
        """Return the steps after which output spikes are counted, rising, at least 1; the last is n_steps."""
        ...

    def value(self, counts: Array, outputs: Outputs) -> Array:
        """Return the loss, summed over all samples: the definition, over the array API, differentiable."""
        ...

    def gradient(self, counts: Array, outputs: Outputs) -> tuple[Array, Array]:
        """Return the loss, and its derivative by each count, (..., length, class), in closed form."""
        ...
