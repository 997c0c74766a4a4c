"""Multiply-accumulates: what classifiers on real numbers do in place of a spike's additions."""

from __future__ import annotations

from dse.measure.objectives import declare

declare(
    "macs", "", "min", "Mean multiply-accumulates per inference; a spiking network only adds, so it has none."
)
