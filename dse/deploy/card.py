"""The model card of a bundle: what it is for, what it was made from, how good it is and where it fails.

Source: Mitchell et al., Model Cards for Model Reporting (REFERENCES.md).
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from dse import store
from dse.base import registry
from dse.base.records import Network, Parameters
from dse.base.text import markdown
from dse.config.values import read_object, refuse
from dse.deploy.c.text import filled
from dse.deploy.classifier import Classifier
from dse.deploy.prefix import prefixed
from dse.deploy.verdict import Verdict, in_words
from dse.engine.neurons import neuron_of

_MEASURED = {
    "accuracy_corrected": "accuracy, corrected for being the best of many",
    "accuracy": "accuracy, validation",
    "accuracy_test": "accuracy, test",
    "accuracy_shifted": "accuracy in moved windows",
    "accuracy_unseen": "accuracy in groups that were not trained on",
    "n_weights": "weights",
    "memory_bytes": "memory, bytes",
    "spikes_per_inference": "spikes per decision",
    "decision_latency_ms": "decides after, ms",
    "hardware": "chip",
    "energy_uj": "energy per decision on it, modelled, uJ",
    "latency_ms": "answers on it after, modelled, ms",
}
"""Columns of a design point that a card shows -> what they are; bundle.json holds all."""

_MOST_FAILURES = 5


@dataclass(frozen=True, kw_only=True)
class _Confusion:
    """Which class was taken for which.

    of: the samples. counts: (true class, answer) numbers of them; a last column counts what is no known pair.
    """

    of: Literal["test", "validation"]
    counts: tuple[tuple[int, ...], ...]


@dataclass(frozen=True, kw_only=True)
class Stated:
    """What of a bundle's evidence its card says; absent in bundles of earlier versions."""

    study: str = "dse"
    recordings: str | None = None
    licence: str | None = None
    refit: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    confusion: _Confusion | None = None


def stated(evidence: Mapping[str, Any], n_answers: int) -> Stated:
    """Return what a card says of a bundle's evidence."""
    found = read_object(Stated, store.plain(dict(evidence)), (), refuse, also=evidence)
    assert found is not None  # a mistake raises
    rows = () if found.confusion is None else found.confusion.counts
    if rows and (len(rows) != n_answers or {len(row) for row in rows} - {n_answers, n_answers + 1}):
        raise ValueError(f"confusion.counts must have {n_answers} rows of {n_answers} or one more")
    if len({len(row) for row in rows}) > 1:
        raise ValueError("confusion.counts must have rows of one length")
    return found


def card(bundle: Classifier, targets: Mapping[str, Verdict]) -> str:
    """Return the model card of a bundle, Markdown, with the verdicts of the targets in it."""
    known_of = stated(bundle.evidence, len(bundle.answers))
    title = f"{known_of.study}: a classifier of {', '.join(bundle.answers)}"
    known: dict[str, Any] = registry.known("targets") if targets else {}
    rows = []
    for name, verdict in targets.items():
        target = known.get(name)
        use = "" if verdict.kind == "unsupported" else prefixed(getattr(target, "use", ""), bundle.prefix)
        row = {"name": markdown(name), "label": getattr(target, "label", ""), "use": use}
        rows.append({**row, "verdict": _in_words(verdict)})
    fitted, at = bundle.fitted, bundle.read_out_ms
    sections = bundle.sections.to_plain()
    return filled(
        Path(__file__).parent / "templates" / "README.md",
        bundle,
        title=markdown(title),
        n_answers=len(bundle.answers),
        takes=_takes(bundle),
        when="at the end of the window" if at is None else f"after {at:g} ms",
        early=bundle.phi is not None,
        spikes=f"{bundle.phi or 0:g}",
        fraction=f"{bundle.theta or 0:g}",
        recordings=_as_json(sections["data"]),
        split=_as_json(sections["split"]),
        digest=markdown(known_of.recordings or "not known"),
        licence=markdown(known_of.licence or "not stated; ask those who recorded them"),
        refit=markdown(" and ".join(known_of.refit)),
        **(_of_network(fitted) if isinstance(fitted, Network) else _of_family(bundle, fitted)),
        rows=[{"name": name, "value": markdown(value)} for name, value in _measured(bundle.record)],
        failures=[{"text": markdown(text)} for text in _failures(known_of, bundle.answers)],
        verdicts=rows,
    )


def _takes(bundle: Classifier) -> str:
    """Return what recordings a classifier takes, in words."""
    takes = bundle.input
    if takes is None:
        return "recordings as those that it was trained on"
    frame = f"{takes.width} x {takes.height} pixels"
    of = frame if takes.kind == "events" else f"{takes.n_channels} channels"
    return f"{takes.kind} of {of}, {takes.n_steps} steps of {takes.step_ms:g} ms"


def _as_json(section: Mapping[str, Any]) -> str:
    """Return what a section of the search space states, as JSON in a line of Markdown."""
    return markdown(json.dumps({key: value for key, value in section.items() if value not in (None, "")}))


def _measured(record: Mapping[str, Any]) -> Iterable[tuple[str, str]]:
    """Yield the rows of the table of measurements, with an interval where there is one."""
    for column, words in _MEASURED.items():
        if (value := record.get(column)) is not None:
            low, high = record.get(f"{column}_low"), record.get(f"{column}_high")
            interval = "" if low is None or high is None else f" ({_in_digits(low)} to {_in_digits(high)})"
            yield words, f"{_in_digits(value)}{interval}"


def _in_digits(value: Any) -> str:
    """Return a value as text, a number in four digits or as a whole one."""
    if not isinstance(value, float):
        return str(value)
    return f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"


def _failures(known: Stated, answers: Sequence[str]) -> Iterable[str]:
    """Yield what the classifier mistakes most, and what the study warned of."""
    if known.confusion is not None and known.confusion.counts:
        counts, names = np.array(known.confusion.counts), [*answers, "no known pair"]
        wrong = counts / np.maximum(1, counts.sum(axis=1, keepdims=True))
        np.fill_diagonal(wrong, 0)
        for at in np.argsort(-wrong, axis=None, kind="stable")[:_MOST_FAILURES]:
            true, answer = np.unravel_index(at, wrong.shape)
            if wrong[true, answer] > 0:
                of = f"{counts[true, answer]} of {counts[true].sum()} {known.confusion.of} samples"
                yield f"{names[true]} is taken for {names[answer]}: {of}"
    yield from (f"the study warned: {warning}" for warning in known.warnings)


def _in_words(verdict: Verdict) -> str:
    words = [f"**{markdown(in_words(verdict.kind, verdict.run_by))}**"]
    if verdict.kind == "faithful":
        of = f"{verdict.n_recordings} recordings ({markdown(verdict.recordings)})"
        words.append(f"all decisions and spikes of {of}")
    words += [markdown(verdict.reason)] * bool(verdict.reason)
    words += [markdown(f"{name} {value:g}") for name, value in verdict.figures.items()]
    words += [markdown(f"compiled by {verdict.compiler}")] * bool(verdict.compiler)
    return "; ".join(words)


def _of_family(bundle: Classifier, fitted: Parameters) -> dict[str, object]:
    """Return what the card says of a classifier that is no single network."""
    arrays = ", ".join(f"`own/{markdown(name)}`" for name in fitted.arrays)
    return {"network": False, "kind": bundle.sections.kinds["model"], "arrays": arrays}


def _of_network(fitted: Network) -> dict[str, object]:
    """Return what the card says of a network."""
    kinds = {layer.neuron: (neuron_of(layer.neuron), layer.parameters) for layer in fitted.layers}
    has_8_bits = all("fixed_point" in neuron.exports for neuron, _ in kinds.values())
    eight = " before 8-bit rounding, `k/weight_8bit` what runs on a chip (value / 32)" if has_8_bits else ""
    parameters = [
        f"`k/{name}`" + (f" in {neuron.units[name]}" if name in neuron.units else "")
        for neuron, names in kinds.values()
        for name in names
    ]
    own = " `k/delay` (neuron, input) are the synapses' own delays, steps." if fitted.delay_bits else ""
    return {
        "network": True,
        "sizes": "-".join(map(str, fitted.sizes)),
        "labels": " and ".join(neuron.label for neuron, _ in kinds.values()),
        "as_far": ", as far as its neurons have them" if len(kinds) > 1 else "",
        "arrays": ", ".join([f"`k/weight` (neuron, input){eight}", *dict.fromkeys(parameters)]),
        "own_delays": own,
    }
