"""Columns of deployment cost and of training, measured by `dse.hardware.cost` and by the models."""

from __future__ import annotations

from dse.measure.objectives import declare

declare(
    "energy_uj",
    "uJ",
    "min",
    "Energy per inference at full speed: dynamic energy, plus static power while computing.",
)
declare("energy_uj_low", "uJ", "min", "Energy with every number of the hardware profile at its low end.")
declare("energy_uj_high", "uJ", "min", "Energy with every number of the hardware profile at its high end.")
declare(
    "energy_throttled_uj", "uJ", "min", "Energy per inference with static power at the sensor's step period."
)
declare("energy_throttled_uj_low", "uJ", "min", "The same with every number at its low end.")
declare("energy_throttled_uj_high", "uJ", "min", "The same with every number at its high end.")
declare("energy_dynamic_uj", "uJ", "min", "Dynamic energy per inference, without static power.")
declare("energy_static_uj", "uJ", "min", "Static energy per inference at full speed.")
declare("energy_static_throttled_uj", "uJ", "min", "Static energy per inference at the sensor's step period.")
declare("idle_mw", "mW", "min", "Power between inferences, while the chip is idle.")
declare("n_cores", "", "min", "Cores that the network occupies.")
declare(
    "n_cores_high",
    "",
    "min",
    "Cores that the network may occupy if a compiler needs more than the memory limit.",
)
declare("fits", "", "max", "1 where the network meets every limit of the chip, else 0.")
declare("train_s", "s", "min", "Wall-clock time of training.")
