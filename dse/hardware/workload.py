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
given are those that the mean rates let expect (`dse.hardware.activity`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dse.config.faults import ConfigError, Fault, known_names
from dse.config.values import INVALID, Hint, Report, dotted, echo, read, read_object
from dse.config.yaml_lines import Document, Raw, in_file_order, parse
from dse.config.yaml_lines import Path as Keys
from dse.hardware.inference import Inference, PerStep, of_network
from dse.records import Operations, Workload
from dse.registry import Rule, param

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
        load = Operations(
            macs=np.asarray(self.macs, np.float64),
            additions=np.asarray(self.additions, np.float64),
            updates=np.asarray(self.updates, np.float64),
            n_weights=np.asarray(self.n_weights, np.float64),
            duration_ms=np.asarray(self.duration_ms, np.float64),
            number_bits=self.number_bits,
        )
        return Inference(
            load=load, per_step=False, n_weights=self.n_weights, n_steps=1, step_ms=self.duration_ms
        )


_COUNTS = ("spikes", "mean_rate")
_OF_NEURONS = ("updates", "recurrent", "mapping", "stored", "resonators")  # the input has none of these
_IN_INPUT = ("neurons", *_COUNTS)
_IN_LAYER = (*_IN_INPUT, "updates", "recurrent", "cores", "stored", "resonators")
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
    """Read a workload (see the head of this module).

    Args:
        text: YAML or JSON.
        source: what faults call the file.

    Raises:
        ConfigError: everything that is wrong with it.
    """
    document = parse(text, source)
    faults = list(document.faults)
    inference = None if faults else _inference(document, faults)
    if faults or inference is None:
        raise in_file_order(faults)
    return inference


def _inference(document: Document, faults: list[Fault]) -> Inference | None:
    def report(path: Keys, message: str) -> None:
        faults.append(document.fault(path, message))

    data = document.data
    if not isinstance(data, dict):
        report((), f"a workload must be a mapping of keys to values, got {echo(data)}")
        return None
    if "layers" in data:
        return _network(data, report)
    if "macs" in data or "additions" in data:
        operations = read_object(_Operations, data, (), report)
        return None if operations is None else operations.inference()
    report((), "a workload must have either layers (a network) or macs and additions (any other classifier)")
    return None


def _network(data: Mapping[str, Raw], report: Report) -> Inference | None:
    keys = read_object(_Network, data, (), report, also=("layers", *_COUNTS, *_OF_NEURONS))
    entries = _entries(data, report)
    if entries is None:
        return None
    n_steps = read(data.get("n_steps"), int, Rule(doc="", low=0), ("n_steps",), lambda path, text: None)
    layers = [
        _layer(index, entry, None if n_steps is INVALID else n_steps, report)
        for index, entry in enumerate(entries)
    ]
    sizes = [layer.neurons for layer in layers]
    stored: Any = INVALID
    if all(layer.neurons and layer.recurrent is not None for layer in layers):
        stored = _stored(entries, sizes, [bool(layer.recurrent) for layer in layers[1:]], report)
    whole = [_for_all(key, entries, report) for key in ("updates", "cores")]
    if keys is None or stored is INVALID or not all(whole) or not all(layer.good for layer in layers):
        return None
    cores = [layer.cores for layer in layers[1:] if layer.cores is not None]
    updates = [layer.updates for layer in layers[1:] if layer.updates is not None]
    resonators = tuple(layer.resonators for layer in layers[1:])
    net = Workload(
        sizes=tuple(sizes),
        recurrent=tuple(bool(layer.recurrent) for layer in layers[1:]),
        n_steps=np.zeros(()),
        spikes=np.zeros(len(sizes)),
        updates=None,
        step_ms=keys.step_ms,
        weight_bits=keys.weight_bits,
        stored=stored,
        delay_bits=keys.delay_bits,
        cores=tuple(cores) or None,
        resonators=resonators if any(resonators) else None,
    )
    spikes = [layer.spikes for layer in layers]
    return of_network(net, keys.n_steps, spikes, updates or None, keys.pipeline_steps)


def _for_all(key: str, entries: Sequence[_Entry], report: Report) -> bool:
    """Return whether all layers after the input say something, or none."""
    lack = [index for index, entry in enumerate(entries) if index and key not in entry]
    if len(lack) in (0, len(entries) - 1):
        return True
    report(("layers", lack[0]), f"{dotted(('layers', lack[0]))} must have {key}, because other layers do")
    return False


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
            inner = "cores" if key == "mapping" else key
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
            entries[first + index]["cores" if key == "mapping" else key] = (value, (key, index))
    return entries


@dataclass(frozen=True)
class _Layer:
    """A layer as written.

    neurons: 0 where they are wrong. recurrent: None where that is wrong.
    spikes, updates: per step.
    good: whether nothing is wrong with it.
    """

    neurons: int
    recurrent: bool | None
    spikes: PerStep
    updates: PerStep | None
    cores: int | None
    resonators: int
    good: bool


def _layer(index: int, entry: _Entry, n_steps: int | None, report: Report) -> _Layer:
    """Return a layer.

    Args:
        index: of the layer, 0 for the input.
        entry: as written.
        n_steps: of the workload; None if that is wrong itself.
        report: called with (path, sentence) for every mistake.
    """

    def value(key: str, hint: Hint, default: Any, **rule: Any) -> Any:
        return (
            read(entry[key][0], hint, Rule(doc="", **rule), entry[key][1], report)
            if key in entry
            else default
        )

    neurons = value("neurons", int, INVALID, low=1, high=_MOST_NEURONS)
    most = None if neurons is INVALID else neurons
    rate = _counts(entry, "mean_rate", 1.0, INVALID, n_steps, report)
    spikes = _counts(entry, "spikes", most, INVALID, n_steps, report)
    if spikes is INVALID and rate is not INVALID and neurons is not INVALID:
        spikes = rate * neurons
    recurrent = value("recurrent", bool, False)
    updates = _counts(entry, "updates", most, None, n_steps, report)
    cores = value("cores", int, None, low=1, high=most)
    resonators = value("resonators", int, 0, low=0, high=most)
    return _Layer(
        neurons=0 if neurons is INVALID else neurons,
        recurrent=None if recurrent is INVALID else recurrent,
        spikes=0.0 if spikes is INVALID else spikes,
        updates=None if updates is INVALID else updates,
        cores=None if cores is INVALID else cores,
        resonators=resonators,
        good=not any(x is INVALID for x in (neurons, recurrent, spikes, updates, cores, resonators)),
    )


def _counts(
    entry: _Entry, key: str, most: float | None, default: Any, n_steps: int | None, report: Report
) -> Any:
    """Return a mean, or an array of n_steps counts; INVALID after a fault."""
    if key not in entry:
        return default
    written, path = entry[key]
    rule = Rule(doc="", low=0, high=most)
    if not isinstance(written, list):
        return read(written, float, rule, path, report)
    if key == "mean_rate":
        report(path, f"{dotted(path)} must be one number, got a list; use spikes for one count per step")
        return INVALID
    if n_steps is not None and len(written) != n_steps:
        report(path, f"{dotted(path)} must have n_steps = {n_steps} counts, got {len(written)}")
        return INVALID
    counts = [read(x, float, rule, (*path, step), report) for step, x in enumerate(written)]
    return INVALID if any(x is INVALID for x in counts) else np.array(counts)


def _stored(
    entries: Sequence[_Entry], sizes: Sequence[int], recurrent: Sequence[bool], report: Report
) -> Any:
    """Return the weights left into each layer after the input, None if all are, INVALID after a fault."""
    if not any("stored" in entry for entry in entries):
        return None
    stored = []
    for layer, (entry, back) in enumerate(zip(entries[1:], recurrent, strict=True), start=1):
        dense = sizes[layer] * (sizes[layer - 1] + sizes[layer] * back)
        written, path = entry.get("stored", (dense, ("layers",)))
        stored.append(read(written, int, Rule(doc="", low=0, high=dense), path, report))
    return INVALID if INVALID in stored else tuple(stored)
