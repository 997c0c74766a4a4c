"""What the C of a classifier of counts does: spikes counted in windows, then one answer at a fixed time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dse.deploy.c.plan import Plan, plan_of
from dse.deploy.classifier import Classifier as Bundle
from dse.deploy.form import Frame, Unsupported, frame_of
from dse.models.counts.elm import ELM, borders
from dse.models.counts.knn import KNN
from dse.models.counts.mlp import MLP
from dse.models.counts.naive_bayes import NaiveBayes
from dse.models.counts.rate_windows import RateClassifier, input_lengths, window_edges
from dse.records import Array, Floats, Ints, Network, Parameters


@dataclass(frozen=True)
class Nearest:
    """k nearest neighbours: counts of training samples, (sample, feature), and the place of their class."""

    counts: Ints
    place: Ints
    k: int


@dataclass(frozen=True)
class Bayes:
    """Gaussian naive Bayes: log prior, log constant, mean and variance, (class,) and (class, feature).

    says_nothing: no feature varied in training.
    """

    prior: Floats
    constant: Floats
    mean: Floats
    variance: Floats
    says_nothing: bool


@dataclass(frozen=True)
class Units:
    """Layers of units: weight (input, unit) and bias (unit,) of each, in the precision of the engine.

    features: how many there are.
    layers: without any, there is one class.
    """

    features: int
    layers: tuple[tuple[Floats, Floats], ...]

    @property
    def sizes(self) -> tuple[int, ...]:
        """Features, and units of each layer."""
        return (self.features, *(bias.size for _, bias in self.layers))


@dataclass(frozen=True)
class Perceptron(Units):
    """Units that pass on what is positive; features are scaled: mean and scale, (feature,)."""

    mean: Floats
    scale: Floats


@dataclass(frozen=True)
class Extreme(Units):
    """Hidden units that count up to a full scale, and outputs."""

    full: float


Classifier = Nearest | Bayes | Perceptron | Extreme


@dataclass(frozen=True, kw_only=True)
class CountingPlan(Frame):
    """All that the C of a classifier of counts needs of a bundle.

    family: its name.
    classifier: its numbers.
    ends: (window,) input step that ends each counting window; the last ends with the answer.
    rows: (window,) where the counts of each window lie among the features; -1: not looked at.
    per_window: counts of a window: one per channel, or one of all.
    labels: what each class of training answers.
    """

    family: str
    classifier: Classifier
    ends: tuple[int, ...]
    rows: tuple[int, ...]
    per_window: int
    labels: tuple[int, ...]

    @property
    def n_features(self) -> int:
        """Counts that the classifier looks at."""
        return (max(self.rows) + 1) * self.per_window


_REASONS = {
    "hots": "family hots takes an exponential of every neighbour of every event, and the nearest of its "
    "prototypes by such numbers: the last bits of exponentials differ between C libraries, and C is written "
    "without one",
    "cascade": "family cascade runs one network on the estimates of another, and C holds one network",
}
"""Why a family has no C."""


def planned(bundle: Bundle) -> Plan | CountingPlan:
    """Return the plan of a bundle of any family.

    Raises:
        Unsupported: C cannot hold its classifier; the reason.
    """
    return plan_of(bundle) if isinstance(bundle.fitted, Network) else counting_plan_of(bundle)


def counting_plan_of(bundle: Bundle) -> CountingPlan:
    """Return the plan of a bundle of a classifier of counts.

    Raises:
        Unsupported: C cannot hold its classifier; the reason.
    """
    model: Any = bundle.sections.model
    fitted = bundle.fitted
    kind = bundle.sections.kinds["model"]
    if not isinstance(fitted, Parameters) or not isinstance(model, KNN | NaiveBayes | MLP | ELM):
        raise Unsupported(_REASONS.get(kind, f"family {kind} is not written in C"))
    if bundle.sections.preprocessing is not None and bundle.sections.preprocessing.every_event:
        raise Unsupported("preprocessing.every_event counts events, and C counts spikes of steps")
    if isinstance(model, KNN) and model.weights == "distance":
        raise Unsupported("votes by distance need square roots, and C is written without a library")
    if isinstance(model, ELM) and model.nonlinearity != "counter":
        raise Unsupported(f"nonlinearity {model.nonlinearity} needs a library, and C is written without one")
    frame = frame_of(bundle)
    if isinstance(model, ELM):
        edges = borders(frame.n_steps, round(model.window_ms / frame.step_ms))
        lengths = input_lengths(len(edges) - 1, 50)
    else:
        edges = window_edges(frame.n_steps, frame.step_ms, model.window_ms)
        lengths = fitted.arrays["lengths"]
        if lengths[-1] != len(edges) - 1:
            raise Unsupported(f"its counting windows do not fit a window of {frame.n_steps} steps")
    ends_ms = edges[lengths] * frame.step_ms
    column = len(lengths) - 1
    if bundle.read_out_ms is not None:
        column = int(np.abs(ends_ms - bundle.read_out_ms).argmin())
    n = int(lengths[column])
    rows = tuple(range(n))
    per_window = frame.n_channels
    if isinstance(model, ELM):  # the newest first
        rows = tuple(n - 1 - w if n - 1 - w < model.windows else -1 for w in range(n))
    elif model.channels == "sum":
        per_window = 1
    n_features = (max(rows) + 1) * per_window
    return CountingPlan(
        **vars(frame),
        family=kind,
        classifier=_classifier(model, fitted.arrays, column, n_features),
        ends=tuple(edges[1 : n + 1].tolist()),
        rows=rows,
        per_window=per_window,
        labels=_labels(bundle, _trained_classes(model, fitted.arrays)),
    )


def _trained_classes(model: RateClassifier | ELM, arrays: Mapping[str, Array]) -> Ints:
    """Return the classes that the classifier can answer, rising."""
    return np.unique(arrays["target"]) if isinstance(model, KNN) else np.asarray(arrays["classes"])


def _labels(bundle: Bundle, classes: Ints) -> tuple[int, ...]:
    """Return what each class answers: itself, or its class of the head that answers."""
    for head in bundle.heads:
        if head.name == bundle.head:
            return tuple(head.of_class[classes].tolist())
    return tuple(classes.tolist())


def _classifier(model: Any, arrays: Mapping[str, Array], column: int, n_features: int) -> Classifier:
    if isinstance(model, KNN):
        counts, target = arrays["counts"], arrays["target"]
        features = counts.reshape(len(counts), -1)[:, :n_features]
        place = np.searchsorted(np.unique(target), target)
        return Nearest(features, place, min(model.k, len(target)))
    if isinstance(model, NaiveBayes):
        variance = arrays["variance"][:, :n_features] + arrays["smoothing"][column]
        says_nothing = not variance.all()
        with np.errstate(divide="ignore"):
            constant = np.array([-0.5 * np.log(2 * np.pi * v).sum() for v in variance])
        return Bayes(
            np.asarray(arrays["log_prior"], np.float64),
            constant,
            arrays["mean"][:, :n_features],
            variance,
            says_nothing,
        )
    if isinstance(model, MLP):
        depth = sum(name.startswith(f"{column}/") and name.endswith("/weight") for name in arrays)
        layers = [(arrays[f"{column}/{k}/weight"], arrays[f"{column}/{k}/bias"]) for k in range(depth)]
        mean, scale = (arrays[name][:n_features] for name in ("mean", "scale"))
        return Perceptron(n_features, tuple(layers), mean, scale)
    hidden = np.ascontiguousarray(arrays["input_weight"][:, :n_features].T), arrays["bias"]
    outputs = arrays["output_weight"]
    last = outputs, np.zeros(outputs.shape[1], outputs.dtype)
    return Extreme(n_features, (hidden, last), 2.0**model.counter_bits)
