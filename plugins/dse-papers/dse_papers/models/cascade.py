"""A cascade of two spiking stacks: what one makes of the first head is input to the other.

The first stack answers one head of a joint target, such as the velocity profile. The second sees the data's
channels and, as channels of their own, the output spikes of the first as they arrive (its running estimate:
one step late, as between any two layers), and answers the other heads, such as the texture.

Outputs of the first on its own training samples are better than on others, and the second would come to
trust them too much. What the second trains on comes from stacks that trained on other samples (`cross_fit`).

Costs: layers of the response are the delayed copies of the data (one for both stacks), the layers of the
first, the delayed copies of its outputs (delay 0 is the output itself), and the layers of the second. Two
stacks side by side are no layered `Workload`, so chips have no figures for them.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

import numpy as np

from dse import store
from dse.base.records import Array, Dataset, Ints, Network, Outcome, Parameters, Response, Spikes
from dse.base.registry import param, register
from dse.engine.checks import check_network
from dse.engine.neurons import neuron_of
from dse.measure.heads import head_answers, head_sizes, head_targets
from dse.models.snn.family import SNN
from dse.models.snn.respond import fan_outs, respond, respond_and_count
from dse.models.snn.settings import Stack
from dse.models.training import Generators, Training

_ADDED = (
    *("dead_neurons", "saturated_neurons", "saturated_outputs", "collapsed_outputs"),
    *("clipped_weights", "missed_initial_rates", "n_weights_dense"),
)


@register("models", "cascade")
@dataclass(frozen=True)
class Cascade(Stack):
    """Two spiking networks; the second also receives the output spikes of the first."""

    no_c: ClassVar[str] = (
        "family cascade runs one network on the estimates of another, and C holds one network"
    )

    first: str = param("", doc="head that the first stack predicts (default: the last column of the target)")
    first_hidden: tuple[int, ...] = param(
        (100,), low=1, doc="neurons of each hidden layer of the first stack"
    )
    cross_fit: int = param(
        2,
        low=0,
        doc="number of parts of the training set; a stack trained on the others predicts each part; 0: no "
        "cross-fitting",
    )

    def __post_init__(self) -> None:
        """Check what one key alone cannot say."""
        super().__post_init__()
        if not 1 <= len(self.first_hidden) <= 3:
            raise ValueError(f"first_hidden must have 1 to 3 layers, got {len(self.first_hidden)}")
        if self.longest_delay:
            raise ValueError(
                f"{'max_delay' if self.max_delay else 'max_axonal_delay'} must be 0 in a cascade, "
                f"whose costs count no delays, got {self.longest_delay}"
            )
        if self.threshold_exponents and len(self.first_hidden) != len(self.hidden):
            raise ValueError(
                "threshold_exponents are those of both stacks of a cascade, whose first_hidden must then "
                f"have as many layers as hidden, got {len(self.first_hidden)} and {len(self.hidden)}"
            )
        if self.cross_fit == 1:
            raise ValueError("cross_fit must be 0 or >= 2, got 1")

    def fit(self, dataset: Dataset, training: Training, rngs: Generators) -> Outcome:
        """Train the first stack, then the second on its outputs; respond on validation and on test.

        Raises:
            TrainingDiverged: in one of the stacks.
            ValueError: no joint target, no head of this name, or no training samples.
        """
        began = time.perf_counter()
        number = self._first_of(dataset)
        data = _kept(dataset)
        of_first = replace(data, heads=data.heads[number : number + 1])
        first = self._stack(self.first_hidden).fit(of_first, training, _named(rngs, "first"))
        assert isinstance(first.network, Network)
        output, accuracy = self._outputs(of_first, first.network, training, rngs)
        of_second = replace(
            data,
            heads=data.heads[:number] + data.heads[number + 1 :],
            spikes=beside(data.spikes, output),
            positions=np.concatenate([data.positions, _own_planes(output.shape[2])]),
        )
        second = self._stack(self.hidden).fit(of_second, training, _named(rngs, "second"))
        assert isinstance(second.network, Network)
        fitted = _stored(first.network, second.network, dataset.spikes.n_channels)
        return Outcome(
            fitted,
            self.respond(fitted, dataset, dataset.validation),
            self.respond(fitted, dataset, dataset.test) if dataset.test.size else None,
            {**second.history, **{f"first_{name}": curve for name, curve in first.history.items()}},
            _health(first.health, second.health, fitted.n_weights, accuracy),
            time.perf_counter() - began,
        )

    def respond(self, fitted: Parameters, dataset: Dataset, samples: Array) -> Response:
        """Run both stacks on the evaluated windows of some samples; outputs are in the order of the heads."""
        number = self._first_of(dataset)
        first, second = (store.record_of(Network, fitted.arrays, name) for name in ("first/", "second/"))
        n = len(samples)
        start = np.zeros(n, np.int32)
        window = cut(dataset.spikes, samples, dataset.start[samples], np.full(n, dataset.n_steps))
        data = replace(dataset, spikes=window, start=start)
        of_first, counts = respond_and_count(first, data, np.arange(n), of_inputs=True)
        after = replace(data, spikes=beside(window, _arriving(of_first.output, self.steps_per_sample)))
        of_second, counts_second = respond_and_count(second, after, np.arange(n), of_inputs=True)
        sizes = head_sizes(dataset)
        sizes_second = sizes[:number] + sizes[number + 1 :]
        parts = np.split(of_second.output, np.cumsum(sizes_second)[:-1], axis=2)
        parts.insert(number, of_first.output)
        return _together(
            np.concatenate(parts, axis=2), (first, second), (of_first, of_second), (counts, counts_second)
        )

    def check_fitted(self, fitted: Parameters, n_outputs: int) -> None:
        """Check the arrays of both networks, which are read from disk.

        Raises:
            ValueError: shapes, ranges or numbers disagree with the description.
        """
        first, second = (store.record_of(Network, fitted.arrays, name) for name in ("first/", "second/"))
        n_first = first.sizes[-1] if first.layers else 0
        check_network(first, n_first)
        check_network(second, n_outputs - n_first)
        channels = (first.n_channels, second.n_channels)
        if channels != (fitted.n_channels, fitted.n_channels + n_first):
            raise ValueError(
                f"both networks must have {fitted.n_channels} and {fitted.n_channels + n_first} channels, "
                f"got {channels[0]} and {channels[1]}"
            )

    def _first_of(self, dataset: Dataset) -> int:
        """Return the number of the head that comes first."""
        names = [head.name for head in dataset.heads]
        if len(names) < 2:
            raise ValueError(f"model cascade needs a joint target, got {len(names) or 1} head")
        if self.first and self.first not in names:
            raise ValueError(
                f"model.first must be a column of the target ({' or '.join(names)}), got '{self.first}'"
            )
        return names.index(self.first) if self.first else len(names) - 1

    def _stack(self, hidden: tuple[int, ...]) -> SNN:
        settings = {field.name: getattr(self, field.name) for field in fields(Stack)}
        return SNN(**settings | {"hidden": hidden})

    def _outputs(
        self, data: Dataset, first: Network, training: Training, rngs: Generators
    ) -> tuple[Array, float]:
        """Return the first stack's outputs over all stored steps, and its accuracy on what it did not see.

        Args:
            data: with the first head alone.
            first: trained on all training samples.
            training: settings of the training.
            rngs: random generators.
        """
        whole = replace(data, start=np.zeros_like(data.start), n_steps=data.spikes.n_steps)
        everything = np.arange(data.spikes.n_samples)
        output = _arriving(respond(first, whole, everything).output, self.steps_per_sample)
        parts = min(self.cross_fit, data.train.size)
        if parts < 2:
            return output, float("nan")
        order = rngs("cross fit").permutation(data.train)
        correct = 0
        for part in range(parts):
            held = np.sort(order[part::parts])
            others = replace(data, train=np.setdiff1d(data.train, held), validation=held, test=held[:0])
            without = self._stack(self.first_hidden).fit(
                others, replace(training, keep="last"), _named(rngs, f"first without {part}")
            )  # what is held out chooses no epoch
            assert isinstance(without.network, Network) and isinstance(without.validation, Response)
            answers = head_answers(data, without.validation.output.sum(axis=1, dtype=np.int64))
            correct += int((answers == head_targets(data, held)).sum())
            output[held] = _arriving(respond(without.network, whole, held).output, self.steps_per_sample)
        return output, correct / data.train.size


def cut(spikes: Spikes, samples: Array, first: Array, length: Array) -> Spikes:
    """Return stretches of some samples as samples of their own, filled up with empty steps.

    Args:
        spikes: stored spikes.
        samples: (n,) sample numbers.
        first: (n,) first step of each stretch.
        length: (n,) its steps.
    """
    n_steps = int(length.max(initial=1))
    per_step = np.zeros((len(samples), n_steps), np.int64)
    parts: list[Ints] = [np.zeros(0, np.int32)]
    for row, (sample, begin, steps) in enumerate(zip(samples, first, length, strict=True)):
        at = int(sample) * spikes.n_steps + int(begin)
        borders = spikes.row_offsets[at : at + int(steps) + 1]
        per_step[row, : int(steps)] = np.diff(borders)
        parts.append(spikes.channel[borders[0] : borders[-1]])
    offsets = np.concatenate([[0], np.cumsum(per_step)])
    return Spikes(offsets, np.concatenate(parts), n_steps, spikes.n_channels, spikes.step_ms)


def beside(spikes: Spikes, more: Array) -> Spikes:
    """Return spikes with further channels, given as (sample, step, channel) 0 or 1, after their own."""
    flat = more.reshape(more.shape[0] * more.shape[1], more.shape[2])
    row, channel = np.nonzero(flat)
    added = np.bincount(row, minlength=len(flat))
    before = np.concatenate([[0], np.cumsum(added)])
    offsets = spikes.row_offsets + before
    merged = np.empty(int(offsets[-1]), np.int32)
    merged[np.arange(len(spikes.channel)) + np.repeat(before[:-1], np.diff(spikes.row_offsets))] = (
        spikes.channel
    )
    merged[np.arange(len(row)) + spikes.row_offsets[row + 1]] = channel + spikes.n_channels
    return Spikes(offsets, merged, spikes.n_steps, spikes.n_channels + more.shape[2], spikes.step_ms)


def _own_planes(n_channels: int) -> Ints:
    """Return positions of channels that are no taxels, each in a plane of its own."""
    planes = -1 - np.arange(n_channels, dtype=np.int32)
    return np.stack([np.zeros_like(planes), np.zeros_like(planes), planes], axis=1)


def _kept(dataset: Dataset) -> Dataset:
    """Return the training and validation samples alone, each from the first step that it may need."""
    used = np.concatenate([dataset.train, dataset.validation])
    crops = np.arange(len(used)) < dataset.train.size
    low = np.where(crops, dataset.start_low[used], dataset.start[used])
    high = np.where(crops, dataset.start_high[used], dataset.start[used])
    return replace(
        dataset,
        spikes=cut(dataset.spikes, used, low, high - low + dataset.n_steps),
        target=dataset.target[used],
        start=np.where(crops, dataset.start[used] - low, 0).astype(np.int32),
        start_low=np.zeros(len(used), np.int32),
        start_high=(high - low).astype(np.int32),
        train=np.arange(dataset.train.size),
        validation=np.arange(dataset.train.size, len(used)),
        test=np.zeros(0, np.int64),
    )


def _named(rngs: Generators, name: str) -> Generators:
    """Return generators of a stack's own."""
    return lambda purpose, *index: rngs(f"{name}: {purpose}", *index)


def _stored(first: Network, second: Network, n_channels: int) -> Parameters:
    arrays = store.record_arrays(first, "first/") | store.record_arrays(second, "second/")
    return Parameters({**arrays, "n_weights": np.array(first.n_weights + second.n_weights)}, n_channels)


def _together(
    output: Array,
    networks: tuple[Network, Network],
    responses: tuple[Response, Response],
    counts: tuple[list[Array], list[Array]],
) -> Response:
    """Return what both stacks did as one response; the module says what its layers are.

    Args:
        output: of all heads.
        networks: the first stack and the second.
        responses: of either.
        counts: per stack, from `respond_and_count`.
    """
    (first, second), (one, two) = networks, responses
    fired, fired_then = ([x.sum(axis=0) for x in of_stack] for of_stack in counts)
    place = np.arange(second.sizes[0])
    is_data = place % second.n_channels < first.n_channels
    is_output = ~is_data & (np.asarray(second.delays)[place // second.n_channels] == 0)
    # Input spikes of the second stack that are not the data's; a copy at delay 0 is the output itself.
    copies = two.spikes[..., 0] - one.spikes[..., 0]
    if 0 in second.delays:
        k = second.steps_per_sample
        copies[:, ::k] -= _arriving(one.output, k).sum(axis=2, dtype=np.int32)
    spikes = np.concatenate([one.spikes, copies[..., None], two.spikes[..., 1:]], axis=2)
    none = np.zeros_like(one.updates[..., :1])
    reached, reached_then = fan_outs(first), fan_outs(second)
    operations = [
        *(int(a @ b) for a, b in zip(reached[:-1], fired[:-1], strict=True)),
        *(int(reached_then[0][of] @ fired_then[0][of]) for of in (is_output, ~is_data & ~is_output)),
        *(int(a @ b) for a, b in zip(reached_then[1:], fired_then[1:], strict=True)),
    ]
    operations[0] += int(reached_then[0][is_data] @ fired_then[0][is_data])
    total = spikes.sum(axis=(0, 1), dtype=np.int64)
    return Response(
        output,
        spikes,
        np.concatenate([one.updates, none, two.updates], axis=2),
        one.step_ms,
        max(one.peak_state, two.peak_state),
        tuple(n / max(1, int(of)) for n, of in zip(operations, total, strict=True)),
        (*_update_work(first), 1.0, *_update_work(second)),
    )


def _update_work(network: Network) -> tuple[float, ...]:
    """Return per layer how often an update counts: those of resonators twice."""
    resonators = (neuron_of(layer.neuron).resonators(layer.parameters) for layer in network.layers)
    return tuple(1 + r / n for r, n in zip(resonators, network.sizes[1:], strict=True))


def _arriving(output: Array, steps_per_sample: int) -> Array:
    """Return whether an output fired since the last input step, (n, input step, class)."""
    n, n_steps, n_classes = output.shape
    k = steps_per_sample
    late = np.pad(output, ((0, 0), (k - 1, 0), (0, 0)))[:, :n_steps]  # nothing arrives before it was sent
    return np.asarray(late.reshape(n, n_steps // k, k, n_classes).max(axis=2))


def _health(
    first: Mapping[str, Any], second: Mapping[str, Any], n_weights: int, accuracy: float
) -> dict[str, Any]:
    """Return the health of both stacks, and the first one's accuracy on samples it did not train on."""
    stopped = [f"{name}: {x['stopped_early']}" for name, x in (("first", first), ("second", second))]
    return {
        **second,
        **{name: first[name] + second[name] for name in _ADDED},
        "n_weights": n_weights,
        **{name: max(first[name], second[name]) for name in ("peak_state", "peak_thresholds")},
        "overflows_24_bit": first["overflows_24_bit"] or second["overflows_24_bit"],
        "initial_rates": [*first["initial_rates"], *second["initial_rates"]],
        "stopped_early": "; ".join(x for x in stopped if not x.endswith(": ")),
        "accuracy_cross_fit": accuracy,
    }
