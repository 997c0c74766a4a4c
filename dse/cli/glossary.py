"""The columns of a study's tables: those that objectives declare, and all others."""

from __future__ import annotations

from dse.base import registry

_OTHERS = {
    "trial": ("", "number of the trial, from 0"),
    "task": ("", "what is predicted: the name of the task, or its label columns"),
    "family": ("", "the model, e.g. snn or knn"),
    "repeats": ("", "trainings of the design; numbers are means over them"),
    "point": ("", "number of the design point within its trial"),
    "phi": ("", "output spikes after which the network may decide; empty at a fixed time or as trained"),
    "theta": ("", "fraction of output spikes that must be for one class"),
    "read_out_ms": ("ms", "time of an answer that waits for no spikes"),
    "weight_bits": ("bits", "bits per weight"),
    "pruned_after": ("", "fraction of the weights that was set to 0 after training"),
    "hardware": ("", "hardware profile of the costs"),
    "status": ("", "finished, failed, or excluded by limits before training"),
    "reason": ("", "why a trial failed or was excluded"),
    "transductive": (
        "",
        "whether the design reads the labels that it predicts; if so, it is on no front",
    ),
    "dead_neurons": ("", "hidden neurons that never spike on validation recordings"),
    "saturated_neurons": ("", "hidden neurons that spike at nearly every step"),
    "saturated_outputs": ("", "output neurons that spike at nearly every step"),
    "collapsed_outputs": ("", "outputs that nearly every validation sample is answered with"),
    "effective_rank": ("", "directions in which the counts of the last hidden layer differ"),
    "collinear_dropout": ("", "whether dropout met counts that differ in few directions"),
    "clipped_weights": ("", "weights at the largest value of their bits"),
    "peak_state": ("", "largest current or voltage in integer units"),
    "peak_thresholds": ("", "the same in the largest threshold of a layer"),
    "overflows_24_bit": ("", "whether peak_state exceeds 24-bit registers, as those of Loihi"),
    "missed_initial_rates": ("", "layers that began at less than half or more than twice their target rate"),
    "initial_rate_hidden": ("", "spikes per hidden neuron and step before training"),
    "initial_rate_output": ("", "spikes per output neuron and step before training"),
    "gradient_norm_largest": ("", "largest norm of the gradient in training"),
    "gradient_norm_last": ("", "norm of the gradient in the last epoch"),
    "clipped_gradients": ("", "batches whose gradient was shortened"),
    "epochs_trained": ("epochs", "epochs of the training"),
    "epoch_kept": ("", "epoch whose weights are kept, from 1"),
    "front_share": (
        "",
        "fraction of samples of uncertain numbers in which a point is on the front",
    ),
    "front_probability": ("", "the same with recordings and seeds resampled too"),
    "confidence": ("", "fraction of samples in which a pick is within all budgets and on the front"),
    "accuracy_corrected": (
        "",
        "accuracy expected on other recordings, without the luck of the best of many points, with its 90 % "
        "interval; ..._corrected of another accuracy among the objectives likewise",
    ),
    "battery_h": ("h", "how long the given battery lasts at power_mw"),
    "target": ("", "target whose memory and cycles stand beside it"),
    "ram_bytes": ("bytes", "memory of the exported classifier on a target"),
    "table_bytes": ("bytes", "constants of the exported classifier on a target"),
    "flash_bytes": (
        "bytes",
        "code and constants of the exported classifier on a target; of c99 as this machine's compiler has it",
    ),
    "cells": ("", "cells of the exported network on a gate array"),
    "memory_blocks": ("", "blocks of memory of the exported network on a gate array"),
    "most_cycles_per_step": (
        "cycles",
        "cycles of an input step of a gate array, at most",
    ),
    "compiler": ("", "compiler of the code that was run, with its version and options"),
    "cycles": ("cycles", "predicted processor cycles per inference on a target"),
}
"""Name -> unit and meaning."""
ENDINGS = {
    "_se": "standard error of the column before it",
    "_low": "lower end of the interval of an uncertain number",
    "_high": "upper end of the interval of an uncertain number",
    "_min": "least value over the repeats",
    "_max": "largest value over the repeats",
}


def columns() -> list[dict[str, str]]:
    """Return name, unit, better direction and meaning of every column."""
    declared = registry.columns()
    rows = [(name, unit, "", doc) for name, (unit, doc) in _OTHERS.items() if name not in declared]
    rows += [(name, column.unit, column.direction, column.doc) for name, column in declared.items()]
    rows.append(("model.hidden, ...", "", "", "axes of the search space"))
    rows += [(f"..{end}", "", "", doc) for end, doc in ENDINGS.items()]
    return [dict(zip(("name", "unit", "better", "doc"), row, strict=True)) for row in rows]
