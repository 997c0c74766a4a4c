"""One layer of LIF outputs behind relay neurons: the classifier of threshold encoding.

The relay ("hidden") neurons are the encoder's spike trains, layer 0 of the network: they carry no weights and
their spikes are the input spikes. An output is the LIF neuron of dse.engine.neurons.lif with u_rest = 0 and
(1 - k) R_m = 1, so that a spike of weight w moves it by w; as a record it is a CUBA-LIF layer whose current
decays within the step, which is what makes decisions, energy and export those of any other network.

structural  as printed: the output of a class is joined to that class's copy of the channels by weights of 1,
            and to nothing else: n_in connections per output. `threshold` counts input spikes.
learnt      for spikes of any encoder. With X (sample, channel) the mean spikes per step of training windows
            and Y (sample, output) 1 for the label (of every head), else 0: W minimises
            |X W' - Y|^2 + ridge |X|^2 / n |W|^2, by singular values, n = min(X.shape). The label's mean input
            is then about 1 per step and `threshold` counts such steps. W and threshold are scaled together so
            that W fills its 8 bits.

Source: threshold encoding for texture recognition, section III.B (REFERENCES.md); learnt weights are ours.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from dse.base.records import Arithmetic, Array, Dataset, Layer, Network, Outcome, Response
from dse.base.registry import param, register
from dse.engine.events import gather
from dse.engine.neurons import cuba_lif, lif, parameters_of
from dse.engine.neurons.fixed_point import DECAY_SCALE, STATE_LIMIT, STATE_SCALE, WEIGHT_SCALE
from dse.measure.heads import head_answers, head_sizes, head_targets, output_labels
from dse.models.snn import respond
from dse.models.training import Generators, Training

_LARGEST_WEIGHT = 254 / WEIGHT_SCALE
# In weights: half of what a 24-bit state holds, so that the input of a step fits above it.
_LARGEST_THRESHOLD = STATE_LIMIT / STATE_SCALE / 2


@register("models", "threshold_lif")
@dataclass(frozen=True)
class ThresholdLIF:
    """LIF output neurons that sum the spikes of the channels of a class; W_t counts nonzero connections."""

    weights: str = param(
        "structural",
        choices=("structural", "learnt"),
        doc="structural: 1 from the channels of the class, 0 from others, which needs one copy of the "
        "channels per class (encoder threshold); learnt: ridge regression",
    )
    tau_m_ms: float = param(
        100.0, low=0, low_open=True, unit="ms", doc="membrane time constant of the outputs"
    )
    threshold: float = param(
        8.0,
        low=1 / 64,
        unit="input spikes",
        doc="firing threshold; with learnt weights in units of the mean input of the label's output per step",
    )
    ridge: float = param(
        1e-4,
        low=0,
        low_open=True,
        doc="ridge penalty of learnt weights, in units of the mean squared singular value",
    )
    arithmetic: Arithmetic = param(  # noqa: RUF009
        "integer",
        choices=("integer", "float32", "ideal"),
        doc="integer: what deployed networks compute; ideal: real numbers in float64",
    )

    def fit(self, dataset: Dataset, training: Training, rngs: Generators) -> Outcome:
        """Join or learn the output weights from `dataset.train`; respond on validation and test.

        Health has `answered`, the share of validation samples with an output spike.

        Raises:
            ValueError: structural weights need a single target, and a copy of the channels for each class.
        """
        began = time.perf_counter()
        network = self.network(dataset)
        validation = self.respond(network, dataset, dataset.validation)
        test = self.respond(network, dataset, dataset.test) if dataset.test.size else None
        counts = self.respond(network, dataset, dataset.train).output.sum(axis=1, dtype=np.int64)
        right = head_answers(dataset, counts) == head_targets(dataset, dataset.train)
        history = {"accuracy_train": np.array([right.all(axis=1).mean()])}
        health: dict[str, float | bool] = {
            "answered": float(validation.output.any(axis=(1, 2)).mean()),
            "peak_state": validation.peak_state,
            "overflows_24_bit": validation.peak_state > STATE_LIMIT,
        }
        return Outcome(network, validation, test, history, health, time.perf_counter() - began)

    def respond(self, fitted: Network, dataset: Dataset, samples: Array) -> Response:
        """Return what a fitted network answers to the evaluated windows of some samples."""
        return respond.respond(fitted, dataset, samples)

    def network(self, dataset: Dataset) -> Network:
        """Return the network for a data set.

        Raises:
            ValueError: as for `fit`.
        """
        n_channels, n_outputs = dataset.spikes.n_channels, sum(head_sizes(dataset))
        if self.weights == "structural":
            if dataset.heads:
                raise ValueError("model.weights must be learnt for a joint target, got structural")
            weight, threshold = structural_weights(n_channels, n_outputs), self.threshold
        else:
            counts = mean_spikes(dataset, dataset.train)
            target = np.zeros((len(counts), n_outputs))
            neurons = output_labels(dataset, dataset.train).reshape(len(counts), -1)
            np.put_along_axis(target, neurons, 1.0, axis=1)
            weight = ridge_weights(counts, target, self.ridge)
            scale = min(
                _LARGEST_WEIGHT / max(np.abs(weight).max(), 1e-9), _LARGEST_THRESHOLD / self.threshold
            )
            weight, threshold = weight * scale, max(self.threshold * scale, 1 / WEIGHT_SCALE)
        decay = cuba_lif.round_decay(lif.leak(dataset.spikes.step_ms, self.tau_m_ms))
        population = cuba_lif.Population(
            decay_current=np.full(n_outputs, DECAY_SCALE, np.int32),
            decay_voltage=np.full(n_outputs, decay, np.int32),
            threshold=cuba_lif.round_threshold(threshold),
        )
        layer = Layer(weight.astype(np.float32), None, parameters_of(population), "cuba_lif")
        return Network((layer,), n_channels, (0,), 1, self.arithmetic)


def structural_weights(n_channels: int, n_classes: int) -> Array:
    """Return (class, channel): 1 from a class's copy of the channels to its output, else 0.

    Raises:
        ValueError: the channels are not one copy per class.
    """
    if n_channels % n_classes:
        raise ValueError(
            "model.weights must be learnt unless the channels are one copy of a set per class, got "
            f"structural with {n_channels} channels for {n_classes} classes"
        )
    return np.repeat(np.eye(n_classes), n_channels // n_classes, axis=1)


def ridge_weights(inputs: Array, target: Array, ridge: float) -> Array:
    """Return W (output, input) that minimises |inputs W' - target|^2 + ridge mean(s^2) |W|^2.

    Args:
        inputs: (sample, input); s are its singular values. Rank deficient ones, and all zeros, are fine.
        target: (sample, output).
        ridge: > 0.
    """
    left, s, right = np.linalg.svd(inputs, full_matrices=False)
    shrunk = np.divide(s, s**2 + ridge * (s**2).mean(), out=np.zeros_like(s), where=s > 0)
    return np.asarray((target.T @ left * shrunk) @ right)


def mean_spikes(dataset: Dataset, samples: Array) -> Array:
    """Return the mean spikes per step of every channel in the evaluated windows, (n, channel) float64."""
    rows = gather(dataset.spikes, samples, dataset.start[samples], dataset.n_steps)
    cells = np.repeat(np.arange(len(samples)), rows.per_step().sum(axis=1)) * rows.n_inputs + rows.index
    counts = np.bincount(cells, minlength=len(samples) * rows.n_inputs)
    return counts.reshape(len(samples), rows.n_inputs) / dataset.n_steps
