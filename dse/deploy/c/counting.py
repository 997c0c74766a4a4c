"""A classifier of counts as C: spikes counted in windows, then one answer at a fixed time."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from dse.base.records import Array, Floats, Ints, Network, Parameters
from dse.deploy.bundle import Bundle
from dse.deploy.c.arrays import Member, Table, index, members_of
from dse.deploy.c.code import Code
from dse.deploy.c.plan import plan_of
from dse.deploy.c.text import filled
from dse.deploy.form import Unsupported, frame_of
from dse.models.counts.elm import ELM, borders
from dse.models.counts.integers import MOST_SUM, MOST_UNIT, IntegerLayers, largest_sum
from dse.models.counts.kernels import MOST_LEVEL, Kernels, Sliding, begins, ring_bins
from dse.models.counts.knn import KNN
from dse.models.counts.levels import HELD, LevelReader
from dse.models.counts.naive_bayes import NaiveBayes
from dse.models.counts.rate_windows import RateClassifier, input_lengths, most_spikes, window_edges
from dse.models.counts.readouts import Readouts, layers_of
from dse.models.counts.tcn import HIGHEST, LOWEST, TCN


@dataclass(frozen=True)
class Classifier:
    """How counts become a class: a template of C, and what it uses.

    template: its file. values: of it.
    tables: constant data, in the precision of the engine. members: templates that declare its variables.
    arithmetic: what it computes in, a sentence.
    parts: of the code (dse.deploy.c.code_size), with how often each occurs.
    slides: template of what is done at the end of every window, of what spikes have added up to; '': nothing,
        they are counted by window.
    """

    template: str
    arithmetic: str
    values: Mapping[str, object]
    tables: tuple[Table, ...] = ()
    members: tuple[str, ...] = ()
    parts: Mapping[str, int] = field(default_factory=dict)
    slides: str = ""

    def fed(self, **more: Any) -> Classifier:
        """Return it with what makes its counts: more values, tables, variables and parts of the code."""
        values, parts = ({**getattr(self, name), **more.pop(name)} for name in ("values", "parts"))
        tables, members = ((*getattr(self, name), *more.pop(name)) for name in ("tables", "members"))
        return replace(self, values=values, parts=parts, tables=tables, members=members, **more)


@dataclass(frozen=True, kw_only=True)
class CountingPlan(Code):
    """All that the C of a classifier of counts needs of a bundle.

    family: its name.
    classifier: what looks at the counts.
    ends: (window,) input step that ends each counting window; the last ends with the answer.
    rows: (window,) where the counts of each window lie among the features; -1: not looked at.
    per_window: counts of a window: one per channel, or one of all. most: that a count can hold.
    labels: what each class of training answers.
    """

    family: str
    classifier: Classifier
    ends: tuple[int, ...]
    rows: tuple[int, ...]
    per_window: int
    most: int
    labels: tuple[int, ...]

    template: ClassVar[str] = "counting.c"
    steps_per_sample: ClassVar[int] = 1

    @property
    def what(self) -> str:
        """What it is, a sentence."""
        counts = f"{self.n_features} spike counts. {self.classifier.arithmetic}"
        return f"A classifier of family {self.family} on {counts}"

    @property
    def n_outputs(self) -> int:
        """It has no output neurons."""
        return 0

    @property
    def n_features(self) -> int:
        """Counts that the classifier looks at."""
        return (max(self.rows) + 1) * self.per_window

    @property
    def counts_spikes(self) -> bool:
        """Whether a spike is counted as it comes."""
        return not (self.classifier.slides or self.classifier.values.get("reads_levels"))

    @property
    def counter(self) -> str:
        """Type of a count."""
        if self.classifier.values.get("reads_levels"):  # of which there are negative ones
            return "int32_t"
        return "uint16_t" if self.most < 2**16 else "uint32_t"

    def members(self) -> list[Member]:
        """Return all variables."""
        values = {"n_places": len(self.labels), **self.classifier.values}
        tables = "counting_members.txt", *self.classifier.members
        own = [member for table in tables for member in members_of(table, self, **values)]
        return [*own, *super().members()]

    @cached_property
    def tables(self) -> list[Table]:
        """Counting windows, answers, and what the classifier has learnt."""
        return [
            Table("uint32_t", "ends", np.array(self.ends)),
            *([Table("int16_t", "rows", np.array(self.rows))] if self.counts_spikes else []),
            Table("int16_t", "labels", np.array(self.labels)),
            *self.classifier.tables,
        ]

    def parts(self) -> Counter[str]:
        """Return how often each part of the code occurs."""
        n = super().parts()
        n.update(counting=1, **self.classifier.parts)
        n["many_places"], n["two_places"] = len(self.labels) > 4, len(self.labels) <= 2  # unrolled loops
        n["several_words"] = self.channel_words > 1
        # Encoder and classifier call the same routines.
        n["doubles_again"] = "double" in self.kinds and (self.is_receptors or self.takes_real)
        return n

    def values(self) -> dict[str, Any]:
        """Return what counting.c needs: where a spike is counted, and what looks at the counts."""
        row, each = "(uint32_t)rows[net->window]", self.per_window > 1 or self.n_channels == 1
        zero = "0" if self.counter.startswith("int") else "0u"
        shared = {"n_places": len(self.labels), "count": self.counter, "zero_count": zero}
        values = {**shared, **self.classifier.values}
        slides = self.classifier.slides
        return {
            "reads_levels": False,
            "n_levels": 0,
            **self.classifier.values,
            "slides": slides,
            "several_slots": False,
            "network_steps": self.n_steps,
            "n_windows": len(self.ends),
            "counted_at": f"{row} * {self.per_window}u + channel" if each else row,
            "classify": (filled(slides, self, **values) if slides else "")
            + filled(self.classifier.template, self, **values),
        }


def code_of(bundle: Bundle, fixed: bool = False) -> Code:
    """Return the C of a bundle of any family; fixed: where it can, its form follows from no weight."""
    return plan_of(bundle, fixed) if isinstance(bundle.fitted, Network) else counting_plan_of(bundle)


def counting_plan_of(bundle: Bundle) -> CountingPlan:
    """Return the plan of a bundle of a classifier of counts."""
    model: Any = bundle.sections.model
    fitted = bundle.fitted
    kind = bundle.sections.kinds["model"]
    if not isinstance(fitted, Parameters) or not isinstance(model, KNN | NaiveBayes | Readouts | ELM):
        raise Unsupported(getattr(model, "no_c", f"family {kind} is not written in C"))
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
    elif isinstance(model, Sliding):
        rows, per_window = (0,) * n, model.n_inputs(fitted.arrays)
    elif isinstance(model, RateClassifier) and model.channels == "sum":
        per_window = 1
    elif reads_levels(model):
        per_window = 2 * (int(fitted.arrays["place"].max()) + 1)
    n_features = (max(rows) + 1) * per_window
    classes = np.unique(fitted.arrays["target"]) if isinstance(model, KNN) else fitted.arrays["classes"]
    ends = tuple(edges[1 : n + 1].tolist())
    most = most_spikes([0, *ends], 1 if per_window > 1 else frame.n_channels)
    if isinstance(model, Sliding):
        most = n * model.most_in_bin
    elif reads_levels(model):
        most = HELD
    classifier = _classifier(model, fitted.arrays, column, n_features, most, frame.n_steps)
    return CountingPlan(
        **vars(frame),
        family=kind,
        classifier=_of_levels(classifier, fitted.arrays, ends) if reads_levels(model) else classifier,
        ends=ends,
        rows=rows,
        per_window=per_window,
        most=most,
        labels=tuple(bundle.answered(classes).tolist()),
    )


def reads_levels(model: object) -> bool:
    """Return whether a classifier reads levels in place of counts."""
    return isinstance(model, LevelReader) and model.reads == "levels"


def _of_levels(classifier: Classifier, arrays: Mapping[str, Array], ends: Sequence[int]) -> Classifier:
    """Return a classifier of levels in windows that end at some steps."""
    sign = arrays["sign"].astype(np.int64)
    longest = max(b - a for a, b in pairwise([0, *ends]))
    if ends[-1] * longest * int(np.bincount(arrays["place"], np.abs(sign)).max()) > MOST_SUM:
        raise Unsupported("the sums of its levels may exceed 32 bits")
    tables, n_levels = _wired(arrays)
    shift = int(arrays["shift"])  # of negative numbers, towards minus infinity
    values = {
        "reads_levels": True,
        "n_levels": n_levels,
        "shift": shift,
        "rest": (1 << shift) - 1,
        "held": HELD,
    }
    members, parts = ("levels_members.txt",), {"levels": 1}
    return classifier.fed(values=values, tables=tables, members=members, parts=parts)


def _wired(arrays: Mapping[str, Array]) -> tuple[tuple[Table, Table], int]:
    """Return what the spikes of each channel add to, and by how much; and to how many levels they add up."""
    n_levels = int(arrays["place"].max()) + 1
    place = Table(index(n_levels), "place", arrays["place"])
    return (place, Table(f"{arrays['sign'].dtype}_t", "sign", arrays["sign"])), n_levels


def _highest(arrays: Mapping[str, Array], n_steps: int, n_places: int) -> Floats:
    """Return the largest magnitude of each level after some steps, (place,)."""
    rises = np.abs(arrays["sign"].astype(np.int64))
    return n_steps * np.bincount(arrays["place"], rises, n_places).astype(np.float64)


def _classifier(
    model: Any, arrays: Mapping[str, Array], column: int, n_features: int, most: int, n_steps: int
) -> Classifier:
    """Return what looks at counts of up to `most`, by the arrays of a family at a time of its answer."""
    if isinstance(model, KNN):
        return _nearest(arrays["counts"], arrays["target"], model.k, n_features, most)
    if isinstance(model, NaiveBayes):
        return _bayes(arrays, column, n_features)
    if isinstance(model, Readouts):
        layers = layers_of(arrays, column)
        exact = f"{column}/scale" in arrays
        readout = _integers(arrays, column, n_features, most) if exact else _SURE
        if isinstance(model, Kernels):
            return _sliding(readout, arrays, n_steps)
        if isinstance(model, TCN):
            return _convolving(readout, model, arrays, n_steps)
        if exact or not layers:
            return readout
        scaling = [Table("float", name, arrays[name][:n_features]) for name in ("mean", "scale")]
        given, positive = "((float)net->counts[j] - mean[j]) / scale[j]", "y[i]"
        return _units("perceptron", n_features, layers, scaling, given, positive)
    hidden = np.ascontiguousarray(arrays["input_weight"][:, :n_features].T), arrays["bias"]
    outputs = arrays["output_weight"]
    last = outputs, np.zeros(outputs.shape[1], outputs.dtype)
    full = 2.0**model.counter_bits  # hidden units count up to a full scale, a power of 2
    positive = "(y[i] > (real)1) ? (real)1 : counted(y[i])"
    return _units("extreme", n_features, [hidden, last], [], "(real)net->counts[j]", positive, full)


def _nearest(counts: Ints, target: Ints, k: int, n_features: int, most: int) -> Classifier:
    """Return the vote of the k nearest training samples, by their counts and the places of their classes."""
    features, classes = counts.reshape(len(counts), -1)[:, :n_features], np.unique(target)
    highest, k = int(features.max(initial=0)), min(k, len(target))
    small = "uint8_t" if highest < 256 else "uint16_t"
    wide = "uint32_t" if max(most, highest) ** 2 * n_features < 2**32 else "uint64_t"  # squared distances
    return Classifier(
        "nearest.c",
        "Integers only",
        {"k": k, "n_samples": len(features), "small": small, "wide": wide},
        (
            Table(small, "stored", features.ravel()),
            Table("uint16_t", "place", np.searchsorted(classes, target)),
        ),
        ("nearest_members.txt",),
        {"nearest": 1, "neighbours": k > 1},
    )


def _bayes(arrays: Mapping[str, Array], column: int, n_features: int) -> Classifier:
    """Return Gaussian naive Bayes; where no feature varied in training, its prior answers."""
    arithmetic, prior = "Counts are integers, likelihoods double", np.asarray(arrays["log_prior"], np.float64)
    variance = arrays["variance"][:, :n_features] + arrays["smoothing"][column]
    if not variance.all():
        return Classifier("prior.c", arithmetic, {"best": int(prior.argmax())})
    constant = np.array([-0.5 * np.log(2 * np.pi * v).sum() for v in variance])
    mean = arrays["mean"][:, :n_features]
    named = {"prior": prior, "constant": constant, "mean": mean.ravel(), "variance": variance.ravel()}
    tables = tuple(Table("double", name, values) for name, values in named.items())
    parts = {"bayes": 1, "bayes_halves": n_features > 128}
    leaves = list(_leaves(n_features))
    values = {
        "several_leaves": len(leaves) > 1,
        "n_leaves": len(leaves),
        "by_eights": n_features >= 8,
        "leaves": ", ".join(str(n) for n, _ in leaves),
        "joins": ", ".join(str(n) for _, n in leaves),
        "depth": 1 + math.ceil(math.log2(n_features)),
    }
    return Classifier("bayes.c", arithmetic, values, tables, parts=parts)


def _leaves(n: int, joins: int = 0) -> Iterator[tuple[int, int]]:
    """Yield the lengths of the sums that numpy's sum of n consists of, and how many join after each."""
    if n <= 128:
        yield n, joins
        return
    half = n // 2 - n // 2 % 8
    yield from _leaves(half)
    yield from _leaves(n - half, joins + 1)


_SURE = Classifier("prior.c", "Integers only", {"best": 0})
"""Where training held one class."""


def _integers(arrays: Mapping[str, Array], column: int, n_features: int, most: int) -> Classifier:
    """Return layers of integers on counts of up to `most`."""
    readout = IntegerLayers.of(arrays, column)
    if largest_sum(readout, most) > MOST_SUM:
        raise Unsupported("the sums of its integers may exceed 32 bits")
    sizes = (n_features, *(bias.size for bias in readout.biases))
    shifts = [Table("uint8_t", "shifts", np.array(readout.shifts))] if readout.shifts else []
    tables = (
        Table("uint32_t", "sizes", np.array(sizes)),
        Table("int8_t", "weight", np.concatenate([x.ravel() for x in readout.weights])),
        Table("int32_t", "bias", np.concatenate(readout.biases)),
        *shifts,
    )
    values = {
        "n_shifts": len(readout.shifts),
        "most": MOST_UNIT,
        "several_outputs": sizes[-1] > 1,
        "n_units": sum(sizes[1:]),
    }
    return Classifier(
        "integers.c",
        "Integers only",
        values,
        tables,
        ("integers_members.txt",),
        {"integers": 1, "integer_layers": int(bool(shifts))},
    )


def _sliding(readout: Classifier, arrays: Mapping[str, Array], n_steps: int) -> Classifier:
    """Return the kernels before a readout."""
    groups, n_bins = arrays["groups"], ring_bins(arrays)
    of_levels, _ = _wired(arrays)
    highest = int((np.abs(groups.astype(np.int64)) @ _highest(arrays, n_steps, groups.shape[1])).max())
    if highest > MOST_SUM:
        raise Unsupported("the sums of its kernels may exceed 32 bits")
    back = index(n_bins)
    dilations = np.resize(arrays["dilations"], len(arrays["taps"]))
    row, member = np.nonzero(groups)
    first = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=len(groups)))])
    tables = (
        *of_levels,
        Table("uint16_t" if row.size < 2**16 else "uint32_t", "first", first),
        Table(index(groups.shape[1]), "member", member),
        Table("int8_t", "turn", groups[row, member]),
        Table(back, "taps", (arrays["taps"] * dilations[:, None]).ravel()),
        Table("int32_t", "threshold", arrays["thresholds"]),
    )
    n_dilations, per_kernel = len(arrays["dilations"]), len(arrays["thresholds"]) // len(arrays["taps"])
    n_ring = 2 * n_bins  # each sum twice, so that the last bins are a row wherever it begins
    values = {
        "n_groups": len(groups),
        "n_kernels": len(arrays["taps"]),
        "n_dilations": n_dilations,
        "n_whole": np.count_nonzero(np.unique(begins(arrays))),
        "two_groups": 2 * n_dilations,
        "per_kernel": per_kernel,
        "n_thresholds": per_kernel if per_kernel > 1 else 0,
        "longest": int(arrays["dilations"].max()),
        "n_bins": n_bins,
        "n_levels": groups.shape[1],
        "n_ring": n_ring,
        "n_rings": len(groups) * n_ring,
        "back": back,
        "most_level": MOST_LEVEL if highest > MOST_LEVEL else 0,
    }
    more = {"members": ("kernels_members.txt",), "parts": {"kernels": 1}, "slides": "kernels.c"}
    return readout.fed(values=values, tables=tables, **more)


def _convolving(readout: Classifier, model: TCN, arrays: Mapping[str, Array], n_steps: int) -> Classifier:
    """Return the convolutions before a readout."""
    n_layers, n_back = len(model.hidden), model.kernel_size - 1
    of_levels, n_levels = _wired(arrays)
    weights, biases = ([arrays[f"{name}/{k}"] for k in range(n_layers)] for name in ("filter", "offset"))
    largest = (
        largest_sum(IntegerLayers((w,), (b,), (), 1.0), -LOWEST) for w, b in zip(weights, biases, strict=True)
    )
    if max(*largest, 2 * int(_highest(arrays, n_steps, n_levels).max())) > MOST_SUM:
        raise Unsupported("the sums of its convolutions may exceed 32 bits")
    widths = [n_levels, *model.hidden]
    n_ring = sum((n_back * 2**k + 1) * n for k, n in enumerate(widths[:-1]))
    tables = (
        *of_levels,
        Table("uint32_t", "widths", np.array(widths)),
        Table("int8_t", "filters", np.concatenate([x.ravel() for x in weights])),
        Table("int32_t", "offsets", np.concatenate(biases)),
        *(Table("uint8_t", f"{name}_shifts", arrays[f"{name}_shifts"]) for name in ("level", "filter")),
    )
    values = {
        "is_cleared": model.reads != "levels",
        "n_levels": n_levels,
        "n_ring": n_ring,
        "n_sums": max(model.hidden),
        "n_layers": n_layers,
        "n_back": n_back,
        "stride": model.stride,
        "several_bins": model.stride > 1,
        "half": 2**30,
        "most_passed": HIGHEST,
        "least_passed": -LOWEST,
    }
    parts = {"convolutions": 1, "several_convolutions": int(n_layers > 1)}
    members = ("tcn_members.txt",)
    return readout.fed(values=values, tables=tables, parts=parts, members=members, slides="tcn.c")


def _units(
    kind: str,
    n_features: int,
    layers: Sequence[tuple[Floats, Floats]],
    scaling: Sequence[Table],
    given: str,
    positive: str,
    full: float = 0.0,
) -> Classifier:
    """Return layers of units, weight (input, unit) and bias (unit,) of each, in the precision of the engine.

    Args:
        kind: perceptron or extreme.
        n_features: inputs.
        layers: one or more.
        scaling: tables of the inputs' scaling.
        given: expression of input j; `(real)` stands for the type.
        positive: of what unit y[i] > 0 passes on.
        full: steps of a counter from 0 to 1; 0: there is none.
    """
    real = "double" if any(weight.dtype == np.float64 for weight, _ in layers) else "float"
    weights, biases = zip(*layers, strict=True)
    sizes = (n_features, *(bias.size for bias in biases))
    values = {
        "real": real,
        "n_layers": len(layers),
        "input": given.replace("(real)", f"({real})"),
        "positive": positive.replace("(real)", f"({real})"),
        "n_outputs": sizes[-1],
        "full": f"({real}){full}" if full else "",
        "step": f"({real}){1 / full}" if full else "",
        "zero": "0.0f" if real == "float" else "0.0",
        "several_outputs": sizes[-1] > 1,
        "n_units": sum(sizes[1:]),
    }
    tables = (
        *scaling,
        Table("uint32_t", "sizes", np.array(sizes)),
        Table(real, "weight", np.concatenate([x.ravel() for x in weights])),
        Table(real, "bias", np.concatenate(biases)),
    )
    part = f"{kind}_double" if real == "double" else kind
    arithmetic = f"Counts are integers, weights and sums {real}"
    return Classifier("units.c", arithmetic, values, tables, ("units_members.txt",), {part: 1})
