"""Inference time of a spiking network: the first output spike of the neuron that wins.

A sample's time counts from the start of its window, which is the first touch where `window.at` is
contact_onset, to the end of the step of the spike. Samples without an output spike are left out. The time of
a class is the median over its samples; networks with several heads have no times of classes.

Source: threshold encoding for texture recognition, section IV.B (REFERENCES.md), which prints a time per
texture.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dse.base.records import Array, Floats, Ints, Response
from dse.base.registry import Column, register
from dse.measure.objectives import FullReadOut


@register("objectives", "first_spike")
@dataclass(frozen=True)
class FirstSpike:
    """Times of first output spikes, over samples and over classes."""

    needs = "full_read_out"
    columns = (
        Column(
            "first_spike_ms",
            "ms",
            "min",
            "Mean time to the first output spike of the winning neuron.",
            of_design=True,
        ),
        Column("first_spike_median_ms", "ms", "min", "Median of these times over samples.", of_design=True),
        Column(
            "first_spike_class_median_ms", "ms", "min", "Median of these times over classes.", of_design=True
        ),
        Column("first_spike_class_min_ms", "ms", "min", "Time of the fastest class.", of_design=True),
        Column("first_spike_class_max_ms", "ms", "min", "Time of the slowest class.", of_design=True),
        *(
            Column(name, "ms", "min", doc, of_design=True, selects=False, of_test=True, ranged=True)
            for name, doc in (
                ("first_spike_test_ms", "The same as first_spike_ms, on the test set."),
                ("first_spike_test_class_median_ms", "Median over classes, on the test set."),
                ("first_spike_test_class_min_ms", "Time of the fastest class, on the test set."),
                ("first_spike_test_class_max_ms", "Time of the slowest class, on the test set."),
            )
        ),
    )

    def measure(self, answer: FullReadOut) -> Mapping[str, float]:
        columns: dict[str, float] = {}
        outcome, n_classes = answer.outcome, len(answer.confusion)
        for prefix, response, target in (
            ("first_spike", outcome.validation, answer.target),
            ("first_spike_test", outcome.test, answer.target_test),
        ):
            if not isinstance(response, Response) or target is None:
                continue
            times_ms = first_spike_ms(response)
            timed = times_ms[np.isfinite(times_ms)]
            if timed.size:
                columns[f"{prefix}_ms"] = float(timed.mean())
                if response is outcome.validation:
                    columns["first_spike_median_ms"] = float(np.median(timed))
                if response.output.shape[2] == n_classes:
                    of_classes = by_class(times_ms, target, n_classes)
                    for name, middle in (("median", np.nanmedian), ("min", np.nanmin), ("max", np.nanmax)):
                        columns[f"{prefix}_class_{name}_ms"] = float(middle(of_classes))
        return columns


def first_spike(output: Array) -> Ints:
    """Return the step of the first spike of the neuron that spikes most (lowest on ties), (n,); -1: silent.

    Args:
        output: (n, T, class) output spikes, one-step shift included.
    """
    winner = output.sum(axis=1, dtype=np.int64).argmax(axis=1)
    fired = output[np.arange(len(output)), :, winner] > 0
    return np.where(fired.any(axis=1), fired.argmax(axis=1), -1)


def first_spike_ms(response: Response) -> Floats:
    """Return the time of that spike, at the end of its step, (n,) float64; NaN where there is none."""
    step = first_spike(response.output)
    return np.where(step >= 0, (step + 1) * response.step_ms, np.nan)


def by_class(times_ms: Floats, target: Ints, n_classes: int) -> Floats:
    """Return the median time over the samples of each class, (class,); NaN for a class without times.

    Args:
        times_ms: (n,) of `first_spike_ms`; NaN is left out.
        target: (n,) true class of each sample.
        n_classes: number of classes.
    """
    timed = np.isfinite(times_ms)
    medians = np.full(n_classes, np.nan)
    for c in np.unique(target[timed]):
        medians[c] = np.median(times_ms[timed & (target == c)])
    return medians
