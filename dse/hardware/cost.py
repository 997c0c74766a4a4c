"""Energy, time and cores of one inference on a chip of Loihi's kind, in closed form.

Dynamic energy, from counts per inference (T steps; layers 1.. are neurons, layer 0 the input):

    E = access N T + update U + spike S + event sum_l s_l f_l + message M + hops

N neurons, U updates, S spikes of neurons, s_l spikes and f_l targets per spike of layer l, and M
messages: one per spike and destination core. On a chip that skips zero weights, f_l counts the weights
that pruning left (`Workload.synapses`). Time of a step, from mean counts per step:

    t = barrier(tiles) + max over cores of max(send, receive)
    send    = access n + update u + spike s + message_out m        what the core's own n neurons do
    receive = sum over messages received of (message_in + event n)          n: targets in the core

Static energy = static power x time, twice: computing flat out, and at the period of the sensor's
steps. Every figure has a range; the interval of a cost is the cost at all low ends to that at all
high ends (the formulas grow with each of them), so it is wider than independent errors would give.

Mean field of a pruned network: every spike of a layer reaches the same share of each core's neurons,
and every neuron still gets every message.

What it leaves out: the maximum of means is below the mean of maxima (up to 6 % on reference runs
whose activity fluctuates), and queues in the network count in the high end only.

Source: SANA-FE (REFERENCES.md), whose energy and `simple` time it reproduces from the same counts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dse.hardware.placement import Placement, hops, neurons_per_core, place
from dse.hardware.profile import End, Profile
from dse.records import Workload

Values = NDArray[np.float64]


@dataclass(frozen=True)
class Cost:
    """Cost per inference; arrays have the leading axes of the workload.

    dynamic_uj: energy of what happens.
    static_uj: static energy of the whole chip, computing flat out.
    static_throttled_uj: the same at the sensor's step period (or the computing time, if longer).
    energy_uj: dynamic_uj + static_uj, with its interval.
    step_time_us: time to compute a step, with its interval.
    hardware_latency_ms: time to compute all steps flat out.
    n_cores, fits, misfits: cores in use, whether every limit is met, and which are not.
    breakdown: dynamic energy by cause, in uJ; adds up to dynamic_uj.
    """

    dynamic_uj: Values
    static_uj: Values
    static_throttled_uj: Values
    energy_uj: Values
    energy_uj_low: Values
    energy_uj_high: Values
    step_time_us: Values
    step_time_us_low: Values
    step_time_us_high: Values
    hardware_latency_ms: Values
    n_cores: int
    fits: bool
    misfits: tuple[str, ...]
    breakdown: Mapping[str, Values]


def cost(profile: Profile, workload: Workload) -> Cost:
    """Return what a workload costs.

    Raises:
        ValueError: counts that are negative or not finite, no steps, or shapes that do not belong together.
    """
    counts = _counts(workload)
    limits = profile.at("value")
    if not limits["skips_zero_weights"]:
        counts = replace(counts, workload=replace(workload, synapses=None, stored=None))
    placement = place(
        workload.sizes, workload.recurrent, workload.weight_bits, limits, counts.workload.stored
    )
    ends: dict[End, tuple[dict[str, Values], Values, Values]] = {}
    for end in ("low", "value", "high"):
        figures = profile.at(end)
        energies = _energies(figures, counts, placement)
        step_us = _step_time_us(figures, counts, placement)
        chips = -(-placement.n_cores // int(limits["cores"]))
        static_uj = figures["static_mw"] * chips * counts.n_steps * step_us * 1e-3  # mW x us = nJ
        ends[end] = energies, step_us, static_uj
    energies, step_us, static_uj = ends["value"]
    total = {end: np.asarray(sum(parts.values()) + static) for end, (parts, _, static) in ends.items()}
    slowdown = np.maximum(workload.step_ms * 1e3, step_us) / step_us
    return Cost(
        dynamic_uj=np.asarray(sum(energies.values())),
        static_uj=static_uj,
        static_throttled_uj=static_uj * slowdown,
        energy_uj=total["value"],
        energy_uj_low=total["low"],
        energy_uj_high=total["high"],
        step_time_us=step_us,
        step_time_us_low=ends["low"][1],
        step_time_us_high=ends["high"][1],
        hardware_latency_ms=counts.n_steps * step_us * 1e-3,
        n_cores=placement.n_cores,
        fits=not placement.misfits,
        misfits=placement.misfits,
        breakdown=energies,
    )


@dataclass(frozen=True)
class _Counts:
    """A checked workload as float64: n_steps (...), spikes (..., layer), updates (..., layer - 1)."""

    n_steps: Values
    spikes: Values
    updates: Values
    workload: Workload


def _counts(workload: Workload) -> _Counts:
    sizes, n_layers = workload.sizes, len(workload.sizes)
    if n_layers < 2 or min(sizes) < 1 or len(workload.recurrent) != n_layers - 1:
        raise ValueError(
            "sizes must name an input and a layer or more, recurrent one less, "
            f"got {sizes} and {workload.recurrent}"
        )
    n_steps = np.asarray(workload.n_steps, dtype=np.float64)
    spikes = np.asarray(workload.spikes, dtype=np.float64)
    if workload.updates is None:
        updates = n_steps[..., None] * np.array(sizes[1:], dtype=np.float64)
    else:
        updates = np.asarray(workload.updates, dtype=np.float64)
    for name, given, most in (
        ("synapses", workload.synapses, workload.fan_out),
        ("stored", workload.stored, workload.dense),
    ):
        if given is not None and (
            len(given) != len(most) or not all(0 <= a <= b for a, b in zip(given, most, strict=True))
        ):
            raise ValueError(f"{name} must be between 0 and {most} layer by layer, got {given}")
    for name, values, shape in (
        ("spikes", spikes, (*n_steps.shape, n_layers)),
        ("updates", updates, (*n_steps.shape, n_layers - 1)),
    ):
        if values.shape != shape:
            raise ValueError(f"{name} must be {shape} like n_steps and sizes, got {values.shape}")
        if not (np.isfinite(values) & (values >= 0)).all():
            raise ValueError(f"{name} must be finite and >= 0")
    if not (np.isfinite(n_steps) & (n_steps > 0)).all():
        raise ValueError("n_steps must be finite and > 0")
    if not workload.step_ms > 0:
        raise ValueError(f"step_ms must be > 0, got {workload.step_ms}")
    return _Counts(n_steps, spikes, updates, workload)


def _destinations(placement: Placement, workload: Workload) -> Values:
    """Return how many cores a spike of each layer goes to, input first."""
    own = (n if back else 0 for n, back in zip(placement.cores, workload.recurrent, strict=True))
    return np.add((*placement.cores, 0), (0, *own)).astype(np.float64)


def _energies(figures: Mapping[str, float], counts: _Counts, placement: Placement) -> dict[str, Values]:
    """Return the dynamic energy in uJ by cause."""
    workload = counts.workload
    distance = hops(placement, workload.sizes, workload.recurrent, figures)
    reached = np.array(workload.fan_out if workload.synapses is None else workload.synapses)
    picojoules = {
        "neuron_access": figures["neuron_access_pj"] * sum(workload.sizes[1:]) * counts.n_steps,
        "neuron_update": figures["neuron_update_pj"] * counts.updates.sum(axis=-1),
        "spike": figures["spike_pj"] * counts.spikes[..., 1:].sum(axis=-1),
        "synaptic_event": figures["synaptic_event_pj"] * (counts.spikes @ reached),
        "message": figures["message_pj"] * (counts.spikes @ _destinations(placement, workload)),
        "hop": counts.spikes @ (distance @ (figures["hop_x_pj"], figures["hop_y_pj"])),
    }
    return {cause: np.asarray(energy * 1e-6) for cause, energy in picojoules.items()}


def _step_time_us(figures: Mapping[str, float], counts: _Counts, placement: Placement) -> Values:
    """Return the mean time of a step: the barrier and the slowest core."""
    workload = counts.workload
    spikes = counts.spikes / counts.n_steps[..., None]
    updates = counts.updates / counts.n_steps[..., None]
    destinations = _destinations(placement, workload)
    # Inputs are sent by sources of as many channels as a core has neurons.
    sources = -(-workload.sizes[0] // int(figures["neurons_per_core"]))
    slowest = spikes[..., 0] / sources * destinations[0] * figures["message_out_ns"]
    shares = _shares(workload)
    for layer, (size, n_cores) in enumerate(zip(workload.sizes[1:], placement.cores, strict=True), start=1):
        neurons = float(neurons_per_core(size, n_cores).max())
        per_spike = figures["spike_ns"] + figures["message_out_ns"] * destinations[layer]
        send = figures["neuron_access_ns"] * neurons + neurons / size * (
            figures["neuron_update_ns"] * updates[..., layer - 1] + per_spike * spikes[..., layer]
        )
        receive = sum(
            spikes[..., source]
            * (figures["message_in_ns"] + figures["synaptic_event_ns"] * neurons * shares[source])
            for source in (layer - 1, *([layer] if workload.recurrent[layer - 1] else []))
        )
        slowest = np.maximum(slowest, np.maximum(send, receive))
    step_us = _barrier_us(figures, placement) + slowest * 1e-3
    crowded = (spikes > figures["congestion_spikes"]) & (destinations >= figures["congestion_cores"])
    return np.asarray(np.where(crowded.any(axis=-1), figures["congestion_factor"], 1.0) * step_us)


def _shares(workload: Workload) -> tuple[float, ...]:
    """Return the share of its targets that a spike of each layer reaches, input first."""
    if workload.synapses is None:
        return (1.0,) * len(workload.sizes)
    return tuple(
        reached / dense if dense else 1.0
        for reached, dense in zip(workload.synapses, workload.fan_out, strict=True)
    )


def _barrier_us(figures: Mapping[str, float], placement: Placement) -> float:
    tiles = -(-placement.n_cores // int(figures["cores_per_tile"]))
    return figures[f"barrier_{max(n for n in (1, 2, 4, 29) if n <= tiles)}_us"]
