"""Columns of deployment cost and of training, measured by `dse.hardware.cost` and by the models."""

from __future__ import annotations

from dse.metrics import declare

declare(
    "energy_uj", "uJ", "min", "Energy per inference: dynamic, plus static power while computing flat out."
)
declare("energy_uj_low", "uJ", "min", "Energy with every figure of the hardware profile at its low end.")
declare("energy_uj_high", "uJ", "min", "Energy with every figure of the hardware profile at its high end.")
declare("n_cores", "", "min", "Cores that the network occupies.")
declare("fits", "", "max", "1 where the network meets every limit of the chip, else 0.")
declare("train_s", "s", "min", "Wall-clock time of training.")
