"""The C of a classifier of counts: one source."""

from __future__ import annotations

import numpy as np

from dse.deploy.c.counting import Bayes, Classifier, CountingPlan, Extreme, Nearest, Perceptron
from dse.deploy.c.files import Code
from dse.deploy.c.front_end import front_end, level_type
from dse.deploy.c.memory import Member, Table, front_end_members, struct_bytes
from dse.deploy.c.text import filled, indented, string

_ARITHMETIC = {
    Nearest: "Integers only",
    Bayes: "Counts are integers, likelihoods double",
    Perceptron: "Counts are integers, weights float, sums double",
    Extreme: "Counts are integers, weights and sums double",
}


def code(plan: CountingPlan) -> Code:
    """Return a classifier of counts as C."""
    ram, constant = struct_bytes(members(plan)), sum(table.n_bytes for table in tables(plan))
    return Code(
        frame=plan,
        source=_source(plan, ram, constant),
        n_outputs=0,
        steps_per_sample=1,
        ram_bytes=ram,
        table_bytes=constant,
        what=f"A classifier of family {plan.family} on {plan.n_features} spike counts. "
        f"{_ARITHMETIC[type(plan.classifier)]}",
    )


def members(plan: CountingPlan) -> list[Member]:
    """Return all variables, the widest types first."""
    classifier = plan.classifier
    out = [
        Member(_counter(plan), "counts", (plan.n_features,), "spikes by window and channel"),
        Member("uint32_t", "step", (), "steps since dse_reset()"),
        Member("uint32_t", "answered", (), "step of the answer"),
        Member("uint16_t", "window", (), "counting window"),
        Member("int16_t", "label", (), "the answer"),
        Member("uint32_t", "spikes", (1, plan.channel_words), "input spikes, a bit per channel"),
        Member("uint8_t", "pushed", (), "whether there are any in this step"),
    ]
    if isinstance(classifier, Nearest):
        out += [
            Member(_distance(plan, classifier), "distance", (classifier.k,), "squared, of the nearest"),
            Member("uint16_t", "vote", (classifier.k,), "their classes"),
            Member("uint16_t", "votes", (len(plan.labels),), "of every class"),
        ]
    if isinstance(classifier, Perceptron):
        out += [
            Member("double", f"layer_{k}", (_n_units(plan, classifier, k),))
            for k in range(1, len(classifier.layers) + 1)
        ]
    if isinstance(classifier, Extreme):
        out.append(Member("double", "outputs", (len(plan.labels),)))
    return sorted([*out, *front_end_members(plan)], key=lambda m: -m.width)


def tables(plan: CountingPlan) -> list[Table]:
    """Return the constant data."""
    classifier = plan.classifier
    out = [
        Table("uint32_t", "ends", np.array(plan.ends)),
        Table("int16_t", "rows", np.array(plan.rows)),
        Table("int16_t", "labels", np.array(plan.labels)),
    ]
    if isinstance(classifier, Nearest):
        small = "uint8_t" if classifier.counts.max(initial=0) < 256 else "uint16_t"
        return [
            *out,
            Table(small, "stored", classifier.counts.ravel()),
            Table("uint16_t", "place", classifier.place),
        ]
    if isinstance(classifier, Bayes):
        if classifier.says_nothing:
            return out
        named = {"prior": classifier.prior, "constant": classifier.constant}
        named |= {"mean": classifier.mean.ravel(), "variance": classifier.variance.ravel()}
        return [*out, *(Table("double", name, values) for name, values in named.items())]
    if isinstance(classifier, Perceptron):
        if not classifier.layers:
            return out
        out += [Table("float", "mean", classifier.mean), Table("float", "scale", classifier.scale)]
        for k, (weight, bias) in enumerate(classifier.layers, 1):
            out += [Table("float", f"weight_{k}", weight.ravel()), Table("float", f"bias_{k}", bias)]
        return out
    real = "float" if classifier.weight.dtype == np.float32 else "double"
    named = {"input_weight": classifier.weight.ravel(), "bias": classifier.bias}
    named["output_weight"] = classifier.solution.ravel()
    return [*out, *(Table(real, name, values) for name, values in named.items())]


def _source(plan: CountingPlan, ram_bytes: int, table_bytes: int) -> str:
    row = "(uint32_t)rows[net.window]"
    each = plan.per_window > 1 or plan.n_channels == 1
    clear, advance, init = "", "", ""
    if plan.pooling is not None:
        advance = f"    if (net.started) {{\n        net.end_us += {plan.pooling.bin_us};\n    }}\n"
        init = "    net.started = 0;\n"
        if plan.pooling.counts_needed:
            clear = f"    for (i = 0; i < {plan.n_channels}u; i++) {{\n        net.events[i] = 0;\n    }}\n"
    if plan.encoder is not None:
        init = "    net.begun = 0;\n"
    return filled(
        "counting.c",
        title="TITLE",
        ram_bytes=ram_bytes,
        table_bytes=table_bytes,
        family=plan.family,
        n_steps=plan.n_steps,
        tables="\n".join(table.text for table in tables(plan)) + level_type(plan),
        members="".join(member.text for member in members(plan)),
        bound="" if plan.n_channels == 2**16 else f"channel >= {plan.n_channels}u || ",
        n_windows=len(plan.ends),
        place=f"{row} * {plan.per_window}u + channel" if each else row,
        classify=_classify(plan, plan.classifier),
        advance=advance,
        channel_words=plan.channel_words,
        clear=clear,
        front_end=front_end(plan),
        n_features=plan.n_features,
        init=init,
        names="\n        ".join(string(name) for name in plan.classes),
        n_classes=len(plan.classes),
    )


def _classify(plan: CountingPlan, classifier: Classifier) -> str:
    n, n_places = plan.n_features, len(plan.labels)
    if isinstance(classifier, Nearest):
        return filled(
            "nearest.c",
            k=classifier.k,
            n_samples=len(classifier.counts),
            n_features=n,
            n_places=n_places,
            wide=_distance(plan, classifier),
        )
    if isinstance(classifier, Bayes):
        if classifier.says_nothing:
            return filled("prior.c", best=int(classifier.prior.argmax()))
        return filled("bayes.c", n_features=n, n_places=n_places)
    if isinstance(classifier, Extreme):
        precision = "float" if classifier.weight.dtype == np.float32 else "double"
        n_hidden, full = len(classifier.weight), repr(classifier.full)
        return filled(
            "extreme.c", n_features=n, n_places=n_places, n_hidden=n_hidden, full=full, precision=precision
        )
    if not classifier.layers:
        return filled("prior.c", best=0)
    return _perceptron(plan, classifier)


def _perceptron(plan: CountingPlan, classifier: Perceptron) -> str:
    last, text = len(classifier.layers), ""
    for k, (weight, _) in enumerate(classifier.layers, 1):
        n_inputs, n = weight.shape
        # Of two classes, one output > 0 says the second: the first stays 0.
        at = "i + 1u" if k == last and n == 1 else "i"
        x = f"net.layer_{k - 1}[j]" if k > 1 else "(double)(((float)net.counts[j] - mean[j]) / scale[j])"
        text += (
            f"for (i = 0; i < {n}u; i++) {{\n    net.layer_{k}[{at}] = bias_{k}[i];\n}}\n"
            f"for (j = 0; j < {n_inputs}u; j++) {{\n    const double x = {x};\n"
            f"    for (i = 0; i < {n}u; i++) {{\n"
            f"        net.layer_{k}[{at}] += x * (double)weight_{k}[j * {n}u + i];\n    }}\n}}\n"
        )
        if k < last:
            text += (
                f"for (i = 0; i < {n}u; i++) {{\n    if (net.layer_{k}[i] < 0) {{\n"
                f"        net.layer_{k}[i] = 0;\n    }}\n}}\n"
            )
        if at != "i":
            text += f"net.layer_{k}[0] = 0;\n"
    return filled("perceptron.c", layers=indented(text), n_places=len(plan.labels), last=f"layer_{last}")


def _n_units(plan: CountingPlan, classifier: Perceptron, k: int) -> int:
    return len(plan.labels) if k == len(classifier.layers) else classifier.layers[k - 1][0].shape[1]


def _counter(plan: CountingPlan) -> str:
    """Return the type of a count: it holds all spikes of a counting window."""
    steps = max(np.diff([0, *plan.ends]).tolist())
    most = steps * (1 if plan.per_window > 1 else plan.n_channels)
    return "uint16_t" if most < 2**16 else "uint32_t"


def _distance(plan: CountingPlan, classifier: Nearest) -> str:
    """Return the type of a squared distance: it holds the largest."""
    steps = max(np.diff([0, *plan.ends]).tolist())
    most = steps * (1 if plan.per_window > 1 else plan.n_channels)
    largest = max(most, int(classifier.counts.max(initial=0)))
    return "uint32_t" if largest**2 * plan.n_features < 2**32 else "uint64_t"
