"""Workload files: what one inference does, written down, so that a design can be priced without training it.

    layers: [24, 50, 7]                neurons per layer, input first
    n_steps: 100                       network steps
    mean_rate: [0.02, 0.02, 0.0]       spikes per neuron and step, each layer
    spikes: [0.5, 1.0, 0.1]            or spikes per step of each layer, or a list of n_steps counts
    updates: [50, 7]                   neuron updates per step after the input, in the same forms
    recurrent: [true, false]           which layers after the input are recurrent
    mapping: [2, 1]                    cores of each layer after the input
    stored: [900, 350]                 weights into each layer after the input that pruning left
    resonators: [25, 0]                neurons of each layer after the input that resonate
    step_ms, weight_bits, delay_bits, pipeline_steps

or `layers` as one mapping per layer: {neurons, spikes | mean_rate, updates, recurrent, cores, stored,
resonators}. A classifier that is no stack of spiking layers has macs, additions, updates, n_weights,
number_bits and duration_ms instead. A mean stands for the same count in every step. Updates that are not
given are those that the mean rates let expect (`dse.measure.hardware.inference`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from dse.base.records import Operations, Workload
from dse.base.registry import Rule, param
from dse.config.faults import ConfigError, Fault, known_names
from dse.config.values import INVALID, Hint, Report, dotted, echo, read, read_object
from dse.config.yaml_lines import Document, Raw, parse
from dse.config.yaml_lines import Path as Keys
from dse.measure.hardware.inference import Inference, of_network

# Far beyond any chip; above, products overflow or tiles of cores do not fit in memory.
_MOST, _MOST_NEURONS, _MOST_BITS = 1e9, 1e7, 64


@dataclass(frozen=True)
class _Network:
    n_steps: int = param(doc="network steps of an inference", low=0, high=_MOST)
    step_ms: float = param(1.0, doc="period of a step", low=0, low_open=True, high=_MOST)
    weight_bits: int = param(8, doc="bits per weight", low=1, high=_MOST_BITS)
    delay_bits: int = param(0, doc="bits per synapse for an individual delay", low=0, high=_MOST_BITS)
    pipeline_steps: int | None = param(
        None, doc="steps through the layers (default: as the hardware takes)", low=0, high=_MOST
    )


@dataclass(frozen=True)
class _Operations:
    macs: float = param(doc="multiply-accumulates", low=0, high=_MOST**2)
    additions: float = param(doc="additions without multiplication", low=0, high=_MOST**2)
    n_weights: int = param(doc="stored numbers", low=0, high=_MOST**2)
    duration_ms: float = param(doc="length of the input", low=0, low_open=True, high=_MOST)
    updates: float = param(0.0, doc="neuron updates of a spiking classifier", low=0, high=_MOST**2)
    number_bits: int = param(32, doc="bits per stored number", low=1, high=_MOST_BITS)

    def inference(self) -> Inference:
        counts: Any = {name: np.asarray(x, np.float64) for name, x in vars(self).items()}
        load = Operations(**counts | {"number_bits": self.number_bits})
        return Inference(load, False, self.n_weights, n_steps=1, step_ms=self.duration_ms)


_COUNTS = ("spikes", "mean_rate")
_OF_NEURONS = {
    **{"updates": "updates", "recurrent": "recurrent", "mapping": "cores"},
    **{"stored": "stored", "resonators": "resonators"},
}
"""Keys of lists -> of a layer's mapping; the input has none of these."""
_IN_INPUT = ("neurons", *_COUNTS)
_IN_LAYER = (*_IN_INPUT, *_OF_NEURONS.values())
_Entry = dict[str, tuple[Raw, Keys]]  # key -> what is written, and where


def load_inference(path: str | Path) -> Inference:
    """Read a workload file, YAML or JSON.

    Raises:
        ConfigError: it cannot be read, or everything that is wrong with it.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError([Fault(str(path), 0, f"cannot be read: {error.strerror}")]) from None
    except UnicodeDecodeError:
        raise ConfigError([Fault(str(path), 0, "cannot be read: not UTF-8 text")]) from None
    if Path(path).suffix == ".json":
        text = text.replace("\t", " ")  # white space in JSON, an error in YAML
    return read_inference(text, str(path))


def read_inference(text: str, source: str) -> Inference:
    """Read a workload, YAML or JSON (see the head of this module); `source` is what faults call it."""
    document = parse(text, source)
    document.check()
    inference = _inference(document)
    document.check()
    assert inference is not None  # else there were faults
    return inference


def _inference(document: Document) -> Inference | None:
    data, report = document.data, document.report
    if not isinstance(data, dict):
        report((), f"a workload must be a mapping of keys to values, got {echo(data)}")
        return None
    if "layers" in data:
        return _network(data, document)
    if "macs" in data or "additions" in data:
        operations = read_object(_Operations, data, (), report)
        return None if operations is None else operations.inference()
    report((), "a workload must have either layers (a network) or macs and additions (any other classifier)")
    return None


def _network(data: Mapping[str, Raw], document: Document) -> Inference | None:
    """Return the inference of a network, None after reporting every mistake in a document's data."""
    report = document.report
    keys = read_object(_Network, data, (), report, also=("layers", *_COUNTS, *_OF_NEURONS))
    entries = _entries(data, report)
    if entries is None:
        return None
    n_steps = read(data.get("n_steps"), int, Rule(doc="", low=0), ("n_steps",), lambda path, text: None)
    layers = [_layer(entry, None if n_steps is INVALID else n_steps, report) for entry in entries]
    stored = _stored(entries, layers, report)
    for key in ("updates", "cores"):
        lack = [index for index, entry in enumerate(entries) if index and key not in entry]
        if 0 < len(lack) < len(entries) - 1:
            path: Keys = ("layers", lack[0])
            report(path, f"{dotted(path)} must have {key}, because other layers do")

    if keys is None or document.faults:
        return None
    sizes, recurrent, resonators = (
        tuple(layer[key] for layer in layers) for key in ("neurons", "recurrent", "resonators")
    )
    net = Workload(
        sizes=sizes,
        recurrent=recurrent[1:],
        n_steps=np.zeros(()),
        spikes=np.zeros(len(sizes)),
        updates=None,
        step_ms=keys.step_ms,
        weight_bits=keys.weight_bits,
        stored=stored,
        delay_bits=keys.delay_bits,
        cores=tuple(layer["cores"] for layer in layers[1:]) if "cores" in entries[1] else None,
        resonators=resonators[1:] if any(resonators) else None,
    )
    updates = [layer["updates"] for layer in layers[1:]] if "updates" in entries[1] else None
    spikes = [layer["spikes"] for layer in layers]
    return of_network(net, keys.n_steps, spikes, updates, keys.pipeline_steps)


def _entries(data: Mapping[str, Raw], report: Report) -> list[_Entry] | None:
    """Return what is written of each layer, or None after a fault that leaves nothing to read."""
    layers = data["layers"]
    if not isinstance(layers, list) or len(layers) < 2:
        report(("layers",), f"layers must be a list of an input and at least one layer, got {echo(layers)}")
        return None
    if not any(isinstance(layer, dict) for layer in layers):
        return _flat(data, layers, report)
    for key in (*_COUNTS, *_OF_NEURONS):
        if key in data:
            inner = _OF_NEURONS.get(key, key)
            report((key,), f"{key} must be given in each layer (as {inner}) if layers are mappings")
    entries: list[_Entry] = []
    for index, layer in enumerate(layers):
        path: Keys = ("layers", index)
        if not isinstance(layer, dict):
            report(path, f"{dotted(path)} must be a mapping like the others, got {echo(layer)}")
            layer = {}
        known = _IN_INPUT if index == 0 else _IN_LAYER
        for key in layer:
            if key not in known:
                what = "does not apply to the input" if key in _IN_LAYER else "is unknown"
                report((*path, key), f"key '{key}' in {dotted(path)} {what}; {known_names(key, known)}")
        entry = {key: (layer[key], (*path, key)) for key in known if key in layer}
        if layer and "neurons" not in layer:
            report(path, f"{dotted(path)}.neurons is required")
        counts = [key for key in _COUNTS if key in layer]
        if layer and len(counts) != 1:
            got = "both" if counts else "neither"
            report(path, f"{dotted(path)} must have either spikes or mean_rate, got {got}")
        entries.append(entry)
    return entries


def _flat(data: Mapping[str, Raw], layers: list[Raw], report: Report) -> list[_Entry]:
    entries: list[_Entry] = [{"neurons": (size, ("layers", index))} for index, size in enumerate(layers)]
    if all(key in data for key in _COUNTS):
        report(("mean_rate",), "a workload must have either spikes or mean_rate, got both")
    elif not any(key in data for key in _COUNTS):
        report((), "a workload must have either spikes or mean_rate, got neither")
    for key in (*_COUNTS, *_OF_NEURONS):
        if key not in data:
            continue
        values, first = data[key], 1 if key in _OF_NEURONS else 0
        expected = len(layers) - first
        if not isinstance(values, list) or len(values) != expected:
            which = "layer after the input" if first else "layer"
            got = f"{len(values)} of them" if isinstance(values, list) else echo(values)
            report((key,), f"{key} must be a list of {expected}, one per {which}, got {got}")
            continue
        for index, value in enumerate(values):
            entries[first + index][_OF_NEURONS.get(key, key)] = (value, (key, index))
    return entries


def _layer(entry: _Entry, n_steps: int | None, report: Report) -> dict[str, Any]:
    """Return the values of a layer by key, spikes and updates per step; INVALID after a fault."""
    neurons = _value(entry, "neurons", int, INVALID, report, low=1, high=_MOST_NEURONS)
    most = None if neurons is INVALID else neurons
    rate = _counts(entry, "mean_rate", 1.0, n_steps, report)
    spikes = _counts(entry, "spikes", most, n_steps, report)
    if spikes is INVALID and rate is not INVALID and neurons is not INVALID:
        spikes = rate * neurons
    return {
        "neurons": neurons,
        "spikes": spikes,
        "recurrent": _value(entry, "recurrent", bool, False, report),
        "updates": _counts(entry, "updates", most, n_steps, report),
        "cores": _value(entry, "cores", int, None, report, low=1, high=most),
        "resonators": _value(entry, "resonators", int, 0, report, low=0, high=most),
    }


def _value(entry: _Entry, key: str, hint: Hint, default: Any, report: Report, **rule: Any) -> Any:
    """Return a value of an entry, INVALID after a fault; what is absent has its default."""
    if key not in entry:
        return default
    written, path = entry[key]
    return read(written, hint, Rule(doc="", **rule), path, report)


def _counts(entry: _Entry, key: str, most: float | None, n_steps: int | None, report: Report) -> Any:
    """Return a mean, or an array of n_steps counts; INVALID after a fault, and where there is none."""
    written, path = entry.get(key, (None, ()))
    if not isinstance(written, list):
        return _value(entry, key, float, INVALID, report, low=0, high=most)
    if key == "mean_rate":
        report(path, f"{dotted(path)} must be one number, got a list; use spikes for one count per step")
        return INVALID
    if n_steps is not None and len(written) != n_steps:
        report(path, f"{dotted(path)} must have n_steps = {n_steps} counts, got {len(written)}")
        return INVALID
    rule = Rule(doc="", low=0, high=most)
    counts = [read(x, float, rule, (*path, step), report) for step, x in enumerate(written)]
    return INVALID if any(x is INVALID for x in counts) else np.array(counts)


def _stored(
    entries: Sequence[_Entry], layers: Sequence[Mapping[str, Any]], report: Report
) -> tuple[Any, ...] | None:
    """Return the weights left into each layer after the input; None if all are, or sizes are wrong."""
    known = not any(layer[key] is INVALID for layer in layers for key in ("neurons", "recurrent"))
    if not known or not any("stored" in entry for entry in entries):
        return None
    stored = []
    for entry, (before, layer) in zip(entries[1:], pairwise(layers), strict=True):
        n = layer["neurons"]
        dense = n * (before["neurons"] + n * layer["recurrent"])
        stored.append(_value(entry, "stored", int, dense, report, low=0, high=dense))
    return tuple(stored)
