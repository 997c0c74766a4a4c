"""Spiking activity S, all ways it is reported.

    S = (1 / N) sum over samples n, neurons i of s_i,n           per inference, Eq. (3)

The source prints values that exceed what one inference can hold, fall by 98.6 % between nets of equal input,
and fit the sum over its test set without the input layer: `spikes_total_no_input`. A study without a test set
does not have it. The mean per inference, with and without the input layer, and the total of all layers are
those of the validation set.

Source: Brayshaw et al., texture and velocity, Eq. (3) (REFERENCES.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dse.measure.objectives import Points
from dse.records import Array
from dse.registry import Column, register


@register("objectives", "spikes")
@dataclass(frozen=True)
class SpikingActivity:
    """Spikes of all layers per inference (S of Eq. 3), without the input, and over the whole set."""

    needs = "points"
    columns = (
        Column("spikes_per_inference", "", "min", "Mean spikes per inference, all layers (S of Eq. 3)."),
        Column(
            "spikes_per_inference_no_input",
            "",
            "min",
            "Mean spikes per inference, without the input layer.",
        ),
        Column(
            "spikes_total",
            "",
            "min",
            "Spikes of all layers, summed over all samples of the validation set.",
        ),
        Column(
            "spikes_total_no_input",
            "",
            "min",
            "Spikes of hidden and output layers, summed over the test set (S as published).",
            of_test=True,
        ),
    )

    def measure(self, points: Points) -> Mapping[str, Array]:
        spikes = points.spikes.sum(axis=-1)
        columns = {
            "spikes_per_inference": spikes,
            "spikes_per_inference_no_input": points.spikes[..., 1:].sum(axis=-1),
            "spikes_total": np.asarray(np.rint(spikes * points.n_samples).astype(np.int64)),
        }
        of_test = points.spikes_test
        return columns if of_test is None else columns | {"spikes_total_no_input": of_test}
