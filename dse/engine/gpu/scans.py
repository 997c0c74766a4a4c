"""Kernels: neurons over time, and their gradients back in time.

A program runs SAMPLES samples of one tile of WIDTH neurons; no program reads what another one writes.
Powers of two multiply as reciprocals: float32 division is not exact on the device.
"""

from __future__ import annotations

import triton
import triton.language as tl

from dse.engine.gpu.numbers import WIDTH, store_parts
from dse.neurons import fixed_point

SAMPLES = tl.constexpr(4)
"""Samples per program."""
_STATE_SCALE = tl.constexpr(fixed_point.STATE_SCALE)
_DECAY_SCALE = tl.constexpr(fixed_point.DECAY_SCALE)
_WEIGHT_SCALE = tl.constexpr(fixed_point.WEIGHT_SCALE)


@triton.jit(do_not_specialize=["first_step", "end_step"])
def scan(
    z: tl.tensor,
    passed: tl.tensor,
    raw: tl.tensor,
    state_u: tl.tensor,
    state_v: tl.tensor,
    n_fired: tl.tensor,
    n_sent: tl.tensor,
    tiles: tl.tensor,
    kept: tl.tensor,
    keep_u_ptr: tl.tensor,
    keep_v_ptr: tl.tensor,
    cross: tl.tensor,
    threshold: tl.tensor,
    surrogate: tl.tensor,
    n_tiles: tl.tensor,
    n_samples: tl.tensor,
    n_steps: tl.tensor,
    first_step: tl.tensor,
    end_step: tl.tensor,
    INTEGER: tl.constexpr,
    MASKED: tl.constexpr,
    STEPWISE: tl.constexpr,
    TURNS: tl.constexpr,
) -> None:
    """Run neurons over some steps; z becomes the surrogate gradient (dse.neurons.cuba_lif.Population.step).

    Spikes are stored one step later, as the next layer (`passed`) and the layer itself (`raw`) see them.

    Args:
        z: (tile, sample * step, WIDTH) weighted input, weight units.
        passed: like z; spikes that dropout lets through.
        raw: like z; all spikes, written where STEPWISE.
        state_u: (tile, sample, WIDTH) currents between calls, used where STEPWISE.
        state_v: potentials after reset, likewise.
        n_fired: (tile, sample, WIDTH) int32 spikes.
        n_sent: those before the last step, likewise.
        tiles: tile numbers, one per program on axis 0; blocks of samples on axis 1.
        kept: (tile, sample, WIDTH) uint8, 0 where dropout silences a neuron; read where MASKED.
        keep_u_ptr: (tile, WIDTH) int32 factor in 1/4096.
        keep_v_ptr: likewise.
        cross: (4, tile, WIDTH) int32 of Stage, read where TURNS.
        threshold: (tile,) int32 mantissa.
        surrogate: (4, n_tiles) float64 of Exponential.exponents.
        n_tiles: tiles of the arrays.
        n_samples: samples of the arrays.
        n_steps: steps of the arrays.
        first_step: first step to run; 0 unless STEPWISE.
        end_step: the step after the last one to run; n_steps unless STEPWISE.
        INTEGER: integer states; otherwise states of z's precision.
        MASKED: some neurons are silenced.
        STEPWISE: states are kept between calls.
        TURNS: some neurons are resonators (dse.neurons.resonator).
    """
    tile = tl.load(tiles + tl.program_id(0)).to(tl.int64)
    sample = tl.program_id(1) * SAMPLES + tl.arange(0, SAMPLES)
    inside = (sample < n_samples)[:, None]
    left = tl.where(sample < n_samples, n_steps, 0)[:, None]
    column = tl.arange(0, WIDTH)
    real = z.dtype.element_ty
    of_sample = (tile * n_samples + sample)[:, None] * WIDTH + column[None, :]
    of_column = tile * WIDTH + column[None, :]
    keep_u = tl.load(keep_u_ptr + of_column)
    keep_v = tl.load(keep_v_ptr + of_column)
    mantissa = tl.load(threshold + tile)
    if INTEGER:
        keep_u = keep_u.to(tl.int64)
        keep_v = keep_v.to(tl.int64)
        above = (mantissa * (_STATE_SCALE // _WEIGHT_SCALE)).to(tl.int64)
        u = tl.zeros((SAMPLES, WIDTH), tl.int64)
    else:
        keep_u = keep_u.to(real) * (1 / _DECAY_SCALE)
        keep_v = keep_v.to(real) * (1 / _DECAY_SCALE)
        above = mantissa.to(real) * (1 / _WEIGHT_SCALE)
        u = tl.zeros((SAMPLES, WIDTH), real)
    v = u
    if TURNS:
        one = n_tiles * WIDTH
        v_to_u = tl.load(cross + of_column).to(keep_u.dtype)
        u_to_v = tl.load(cross + one + of_column).to(keep_u.dtype)
        now_to_v = tl.load(cross + 2 * one + of_column).to(keep_u.dtype)
        hold = tl.load(cross + 3 * one + of_column).to(keep_u.dtype)
        if not INTEGER:
            v_to_u = v_to_u * (1 / _DECAY_SCALE)
            u_to_v = u_to_v * (1 / _DECAY_SCALE)
    fired_before = tl.zeros((SAMPLES, WIDTH), tl.int32)
    sent_before = fired_before
    if STEPWISE:
        if first_step > 0:
            u = tl.load(state_u + of_sample, mask=inside, other=0)
            v = tl.load(state_v + of_sample, mask=inside, other=0)
            fired_before = tl.load(n_fired + of_sample, mask=inside, other=0)
            sent_before = tl.load(n_sent + of_sample, mask=inside, other=0)
    centre = tl.load(surrogate + tile).to(real)
    rate = tl.load(surrogate + n_tiles + tile).to(real)
    height = tl.load(surrogate + 2 * n_tiles + tile).to(real)
    lowest = tl.load(surrogate + 3 * n_tiles + tile).to(real)
    allowed = inside
    if MASKED:
        allowed = inside & (tl.load(kept + of_sample, mask=inside, other=0) != 0)
    fired_now = fired_before
    sent_now = sent_before
    at = ((tile * n_samples + sample)[:, None] * n_steps + first_step) * WIDTH + column[None, :]
    if first_step == 0:
        nothing = tl.zeros((SAMPLES, WIDTH), passed.dtype.element_ty)
        tl.store(passed + at, nothing, mask=inside)
        if STEPWISE:
            tl.store(raw + at, nothing, mask=inside)
    for t in range(first_step, end_step):
        drive = tl.load(z + at, mask=inside, other=0.0)
        if TURNS:
            across_u = u * keep_u + v * v_to_u
            across_v = v * keep_v + u * u_to_v
            if INTEGER:
                u = tl.where(across_u < 0, -((-across_u) >> 12), across_u >> 12)
                u += (drive * _STATE_SCALE).to(tl.int64)
                before = tl.where(across_v < 0, -((-across_v) >> 12), across_v >> 12) + now_to_v * u
            else:
                u = across_u + drive
                before = across_v + now_to_v * u
        elif INTEGER:  # every rounding is toward zero
            u = tl.where(u < 0, -((-u * keep_u) >> 12), (u * keep_u) >> 12)
            u += (drive * _STATE_SCALE).to(tl.int64)
            before = tl.where(v < 0, -((-v * keep_v) >> 12), (v * keep_v) >> 12) + u
        else:
            u = u * keep_u + drive
            before = v * keep_v + u
        fired = before > above
        if TURNS:
            v = tl.where(fired, hold * before, before)
        else:
            v = tl.where(fired, tl.zeros_like(before), before)
        potential = before.to(real)
        if INTEGER:
            potential = potential * (1 / _STATE_SCALE)
        exponent = rate * tl.abs(potential - centre)
        slope = tl.where(exponent > lowest, height * tl.exp2(exponent), 0.0)
        tl.store(z + at, slope.to(real), mask=inside)
        more = t + 1 < left
        tl.store(passed + at + WIDTH, (fired & allowed).to(passed.dtype.element_ty), mask=more)
        if STEPWISE:
            tl.store(raw + at + WIDTH, fired.to(raw.dtype.element_ty), mask=more)
        fired_now += fired.to(tl.int32)
        sent_now += (fired & more).to(tl.int32)
        at += WIDTH
    tl.store(n_fired + of_sample, fired_now, mask=inside)
    tl.store(n_sent + of_sample, sent_now, mask=inside)
    if STEPWISE:
        tl.store(state_u + of_sample, u, mask=inside)
        tl.store(state_v + of_sample, v, mask=inside)


@triton.jit(do_not_specialize=["first_step", "end_step"])
def scan_back(
    slope: tl.tensor,
    arriving: tl.tensor,
    by_ring: tl.tensor,
    by_z: tl.tensor,
    state_u: tl.tensor,
    state_v: tl.tensor,
    tiles: tl.tensor,
    kept: tl.tensor,
    factor: tl.tensor,
    penalty: tl.tensor,
    keep_u_ptr: tl.tensor,
    keep_v_ptr: tl.tensor,
    cross: tl.tensor,
    n_tiles: tl.tensor,
    n_samples: tl.tensor,
    n_steps: tl.tensor,
    first_step: tl.tensor,
    end_step: tl.tensor,
    by_z_size: tl.tensor,
    N_PARTS: tl.constexpr,
    OUTPUT: tl.constexpr,
    MASKED: tl.constexpr,
    PENALISED: tl.constexpr,
    STEPWISE: tl.constexpr,
    TURNS: tl.constexpr,
) -> None:
    """Set dL/dz of some steps, backward in time, the reset ignored (dse.neurons.cuba_lif.backward).

    Args:
        slope: (tile, sample * step, WIDTH) surrogate gradient.
        arriving: dL/ds as the next layer sees s, one step later: like slope, or where OUTPUT
            (tile, sample, WIDTH), the same at every step. The last step's spikes never leave.
        by_ring: (tile, sample, WIDTH) dL/ds by the layer's own next step, read where STEPWISE.
        by_z: like slope, in parts `by_z_size` apart.
        state_u: (tile, sample, WIDTH) dL/du between calls, used where STEPWISE.
        state_v: dL/dv, likewise.
        tiles: tile numbers, one per program on axis 0; blocks of samples on axis 1.
        kept: (tile, sample, WIDTH) uint8, 0 where dropout silences a neuron; read where MASKED.
        factor: (tile,) float32 gain of spikes that are kept, read where MASKED.
        penalty: (tile, WIDTH) what every spike adds to the loss, read where PENALISED.
        keep_u_ptr: (tile, WIDTH) int32 factor in 1/4096.
        keep_v_ptr: likewise.
        cross: (4, tile, WIDTH) int32 of Stage, read where TURNS.
        n_tiles: tiles of the arrays.
        n_samples: samples of the arrays.
        n_steps: steps of the arrays.
        first_step: the last step to run; 0 unless STEPWISE.
        end_step: the step after the first one to run; n_steps unless STEPWISE.
        by_z_size: numbers per part.
        N_PARTS: parts of by_z.
        OUTPUT: the tiles are output neurons.
        MASKED: some neurons are silenced.
        PENALISED: spikes add to the loss.
        STEPWISE: sums are kept between calls.
        TURNS: some neurons are resonators.
    """
    tile = tl.load(tiles + tl.program_id(0)).to(tl.int64)
    sample = tl.program_id(1) * SAMPLES + tl.arange(0, SAMPLES)
    inside = (sample < n_samples)[:, None]
    left = tl.where(sample < n_samples, n_steps, 0)[:, None]
    column = tl.arange(0, WIDTH)
    real = slope.dtype.element_ty
    of_sample = (tile * n_samples + sample)[:, None] * WIDTH + column[None, :]
    of_column = tile * WIDTH + column[None, :]
    keep_u = tl.load(keep_u_ptr + of_column).to(real) * (1 / _DECAY_SCALE)
    keep_v = tl.load(keep_v_ptr + of_column).to(real) * (1 / _DECAY_SCALE)
    if TURNS:
        one = n_tiles * WIDTH
        v_to_u = tl.load(cross + of_column).to(real) * (1 / _DECAY_SCALE)
        u_to_v = tl.load(cross + one + of_column).to(real) * (1 / _DECAY_SCALE)
        now_to_v = tl.load(cross + 2 * one + of_column).to(real)
    lv = tl.zeros((SAMPLES, WIDTH), real)
    lu = lv
    if STEPWISE:
        if end_step < n_steps:
            lv = tl.load(state_v + of_sample, mask=inside, other=0.0)
            lu = tl.load(state_u + of_sample, mask=inside, other=0.0)
    gain = tl.zeros((SAMPLES, WIDTH), real) + 1.0
    if MASKED:
        gain = tl.load(kept + of_sample, mask=inside, other=0).to(real) * tl.load(factor + tile)
    constant = lv
    if OUTPUT:
        constant = tl.load(arriving + of_sample, mask=inside, other=0.0)
    at = ((tile * n_samples + sample)[:, None] * n_steps + end_step - 1) * WIDTH + column[None, :]
    for back in range(end_step - first_step):
        leaves = end_step - back < left
        if OUTPUT:
            by_spike = tl.where(leaves, constant, tl.zeros_like(constant))
        else:
            by_spike = tl.load(arriving + at + WIDTH, mask=leaves, other=0.0) * gain
        if STEPWISE:
            by_spike += tl.load(by_ring + of_sample, mask=leaves, other=0.0)
        if PENALISED:
            by_spike += tl.load(penalty + of_column)
        by_v = by_spike * tl.load(slope + at, mask=inside, other=0.0)
        if TURNS:
            later = lv
            lv = keep_v * lv + (v_to_u * lu + by_v)
            lu = keep_u * lu + (u_to_v * later + now_to_v * lv)
        else:
            lv = keep_v * lv + by_v
            lu = keep_u * lu + lv
        store_parts(by_z, at, by_z_size, lu, inside, N_PARTS)
        at -= WIDTH
    if STEPWISE:
        tl.store(state_v + of_sample, lv, mask=inside)
        tl.store(state_u + of_sample, lu, mask=inside)
