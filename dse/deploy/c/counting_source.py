"""The C of a classifier of counts: one source."""

from __future__ import annotations

import numpy as np

from dse.deploy.c.arrays import Member, Table, declared, struct_bytes
from dse.deploy.c.counting import Bayes, Classifier, CountingPlan, Extreme, Nearest, Perceptron, Units
from dse.deploy.c.files import Code
from dse.deploy.c.front_end import begin, binned, floats, front_end, front_end_members, level_type
from dse.deploy.c.text import NAMES, TITLE, filled


def code(plan: CountingPlan) -> Code:
    """Return a classifier of counts as C."""
    variables, constants = members(plan), tables(plan)
    row = "(uint32_t)rows[net.window]"
    each = plan.per_window > 1 or plan.n_channels == 1
    source = filled(
        "counting.c",
        title=TITLE,
        ram_bytes=struct_bytes(variables),
        table_bytes=sum(table.n_bytes for table in constants),
        family=plan.family,
        n_steps=plan.n_steps,
        floats=floats(plan, [table.kind for table in constants]),
        tables="\n".join(table.text for table in constants) + level_type(plan),
        members=declared(variables),
        bound="" if plan.n_channels == 2**16 else f"channel >= {plan.n_channels}u || ",
        n_windows=len(plan.ends),
        place=f"{row} * {plan.per_window}u + channel" if each else row,
        classify=_classify(plan, plan.classifier),
        channel_words=plan.channel_words,
        front_end=front_end(plan),
        n_features=plan.n_features,
        init=begin(plan),
        **binned(plan),
        names=NAMES,
        n_classes=len(plan.classes),
    )
    what = f"A classifier of family {plan.family} on {plan.n_features} spike counts. "
    return Code(plan, source, 0, 1, variables, constants, what + _arithmetic(plan.classifier))


def _arithmetic(classifier: Classifier) -> str:
    """Return what the C computes in: the same as the engine."""
    if isinstance(classifier, Nearest):
        return "Integers only"
    if isinstance(classifier, Bayes):
        return "Counts are integers, likelihoods double"
    return f"Counts are integers, weights and sums {real_type(classifier)}"


def real_type(units: Units) -> str:
    """Return the type of weights and sums: that of the engine."""
    is_double = any(weight.dtype == np.float64 for weight, _ in units.layers)
    return "double" if is_double else "float"


def members(plan: CountingPlan) -> list[Member]:
    """Return all variables."""
    classifier = plan.classifier
    out = [
        Member(_counter(plan), "counts", (plan.n_features,), "spikes by window and channel"),
        Member("uint32_t", "step", (), "steps since dse_reset()"),
        Member("uint32_t", "answered", (), "step of the answer"),
        Member("uint16_t", "window", (), "counting window"),
        Member("int16_t", "answer", (), "the class + 1; 0: none so far"),
        Member("uint32_t", "spikes", (1, plan.channel_words), "input spikes, a bit per channel"),
        Member("uint8_t", "pushed", (), "whether there are any in this step"),
    ]
    if isinstance(classifier, Nearest):
        out += [
            Member(_distance(plan, classifier), "distance", (classifier.k,), "squared, of the nearest"),
            Member("uint16_t", "vote", (classifier.k,), "their classes"),
            Member("uint16_t", "votes", (len(plan.labels),), "of every class"),
        ]
    if isinstance(classifier, Units) and classifier.layers:
        out.append(Member(real_type(classifier), "units", (sum(classifier.sizes[1:]),), "of all layers"))
    return [*out, *front_end_members(plan)]


def tables(plan: CountingPlan) -> list[Table]:
    """Return the constant data."""
    classifier = plan.classifier
    out = [
        Table("uint32_t", "ends", np.array(plan.ends)),
        Table("int16_t", "rows", np.array(plan.rows)),
        Table("int16_t", "labels", np.array(plan.labels)),
    ]
    if isinstance(classifier, Nearest):
        return [
            *out,
            Table(_stored(classifier), "stored", classifier.counts.ravel()),
            Table("uint16_t", "place", classifier.place),
        ]
    if isinstance(classifier, Bayes):
        if classifier.says_nothing:
            return out
        named = {"prior": classifier.prior, "constant": classifier.constant}
        named |= {"mean": classifier.mean.ravel(), "variance": classifier.variance.ravel()}
        return [*out, *(Table("double", name, values) for name, values in named.items())]
    if not classifier.layers:
        return out
    if isinstance(classifier, Perceptron):
        out += [Table("float", "mean", classifier.mean), Table("float", "scale", classifier.scale)]
    weights, biases = zip(*classifier.layers, strict=True)
    return [
        *out,
        Table("uint32_t", "sizes", np.array(classifier.sizes)),
        Table(real_type(classifier), "weight", np.concatenate([x.ravel() for x in weights])),
        Table(real_type(classifier), "bias", np.concatenate(biases)),
    ]


def _classify(plan: CountingPlan, classifier: Classifier) -> str:
    n, n_places = plan.n_features, len(plan.labels)
    if isinstance(classifier, Nearest):
        return filled(
            "nearest.c",
            k=classifier.k,
            n_samples=len(classifier.counts),
            n_features=n,
            n_places=n_places,
            count=_counter(plan),
            small=_stored(classifier),
            wide=_distance(plan, classifier),
        )
    if isinstance(classifier, Bayes):
        if classifier.says_nothing:
            return filled("prior.c", best=int(classifier.prior.argmax()))
        return filled("bayes.c", n_features=n, n_places=n_places)
    if not classifier.layers:
        return filled("prior.c", best=0)
    n_outputs = classifier.sizes[-1]
    given, positive = "((float)net.counts[j] - mean[j]) / scale[j]", "y[i]"
    if isinstance(classifier, Extreme):
        full, least = classifier.full, 1 / classifier.full  # powers of 2
        given = "(real)net.counts[j]"
        positive = f"y[i] > 1 ? 1 : (real)(int32_t)(y[i] * (real){full}) * (real){least}"
    real = real_type(classifier)
    return filled(
        "units.c",
        real=real,
        n_layers=len(classifier.layers),
        input=given.replace("(real)", f"({real})"),
        positive=positive.replace("(real)", f"({real})"),
        n_outputs=n_outputs,
        # Of two classes, one output > 0 says the second.
        answer="best" if n_outputs > 1 else "(uint32_t)(x[0] > 0)",
    )


def _most(plan: CountingPlan) -> int:
    """Return the most spikes that a count of a window can hold."""
    steps = max(np.diff([0, *plan.ends]).tolist())
    return int(steps * (1 if plan.per_window > 1 else plan.n_channels))


def _counter(plan: CountingPlan) -> str:
    """Return the type of a count."""
    return "uint16_t" if _most(plan) < 2**16 else "uint32_t"


def _stored(classifier: Nearest) -> str:
    """Return the type of a count of a training sample."""
    return "uint8_t" if classifier.counts.max(initial=0) < 256 else "uint16_t"


def _distance(plan: CountingPlan, classifier: Nearest) -> str:
    """Return the type of a squared distance: it holds the largest."""
    largest = max(_most(plan), int(classifier.counts.max(initial=0)))
    return "uint32_t" if largest**2 * plan.n_features < 2**32 else "uint64_t"
