"""The loops of the CPU engine: sums of weight rows, state scans forward and backward, Adam.

Every function works on flat arrays in the blocks of dse.engine.layout and on one block or one sample of them;
the equations are those of dse.engine.neurons.cuba_lif and, where there is a `cross`,
dse.engine.neurons.resonator, sixteen neurons at a time. Sums run over events in their order and never across
neurons, so that a neuron's numbers do not depend on what is computed beside it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from dse.base.native.compiled import compiled, overload
from dse.base.native.simd import (
    LANES_16,
    LANES_32,
    LANES_64,
    as_type_of,
    bits,
    count_bits,
    differs,
    either,
    fma,
    greater,
    larger,
    load,
    lowest_bit,
    magnitude,
    power_of_two,
    rint,
    select,
    smaller,
    splat,
    sqrt,
    store,
    trunc,
    widened,
    zeros,
)
from dse.base.records import Array
from dse.engine.layout import LANES, width_at

_kernel = compiled()
_part = compiled(forceinline=True)

NOTHING, SLOPE, VOLTAGE = 0, 1, 2

# An int16 holds the sum of 256 int8 weights: 256 * -128 = -32768.
_SEGMENT = 256


@_part
def _sum_rows(
    table: Array, start: int, width: int, index: Array, begin: int, end: int, lanes: Any, out: Array
) -> Any:
    """Return the sum of some rows of a block as a vector of `out`'s type; int8 rows sum exactly."""
    total = zeros(out, lanes)
    for first in range(begin, end, _SEGMENT):
        last = min(first + _SEGMENT, end)
        part = widened(zeros(table, lanes), out)
        e = first
        while e + 4 <= last:
            a = widened(load(table, start + index[e] * width, lanes), out)
            b = widened(load(table, start + index[e + 1] * width, lanes), out)
            c = widened(load(table, start + index[e + 2] * width, lanes), out)
            d = widened(load(table, start + index[e + 3] * width, lanes), out)
            part = part + ((a + b) + (c + d))
            e += 4
        while e < last:
            part = part + widened(load(table, start + index[e] * width, lanes), out)
            e += 1
        total = total + as_type_of(part, out)
    return total


@_part
def _sum_counted(
    table: Array,
    start: int,
    width: int,
    index: Array,
    times: Array,
    begin: int,
    end: int,
    lanes: Any,
    out: Array,
) -> Any:
    """Return the sum of some rows of a block, each as many times as it counts; int8 rows sum exactly."""
    total = zeros(out, lanes)
    for e in range(begin, end):
        row = as_type_of(load(table, start + index[e] * width, lanes), out)
        total = fma(splat(times[e], total), row, total)
    return total


@_part
def _sum_listed(
    table: Array,
    start: int,
    width: int,
    index: Array,
    times: Array,
    begin: int,
    end: int,
    lanes: Any,
    out: Array,
) -> Any:
    if times.size > 0:
        return _sum_counted(table, start, width, index, times, begin, end, lanes, out)
    return _sum_rows(table, start, width, index, begin, end, lanes, out)


@_part
def _put(total: Any, scale: float, out: Array, place: int, accumulate: bool, lanes: Any) -> None:
    total = total * splat(scale, total)
    store(out, place, load(out, place, lanes) + total if accumulate else total)


@_kernel
def gather(
    offsets: Array,
    index: Array,
    times: Array,
    first_row: int,
    n_rows: int,
    table: Array,
    start: int,
    width: int,
    scale: float,
    out: Array,
    place: int,
    accumulate: bool,
) -> None:
    """Write (or add) to each of some rows of a block the scaled sum of the table rows that it lists.

    Args:
        offsets, index: row r lists `index[offsets[r]:offsets[r + 1]]`.
        times: factor of each entry, a whole number; empty: 1.
        first_row, n_rows: which rows.
        table, start, width: the block of the table, int8 or floating.
        scale: factor of the sums.
        out, place: the block of the result starts at `place` with row `first_row`.
        accumulate: add to what is there.
    """
    for r in range(n_rows):
        begin, end = offsets[first_row + r], offsets[first_row + r + 1]
        if accumulate and begin == end:
            continue
        here = place + r * width
        if width == 64:
            total = _sum_listed(table, start, 64, index, times, begin, end, LANES_64, out)
            _put(total, scale, out, here, accumulate, LANES_64)
        elif width == 32:
            half = _sum_listed(table, start, 32, index, times, begin, end, LANES_32, out)
            _put(half, scale, out, here, accumulate, LANES_32)
        else:
            quarter = _sum_listed(table, start, 16, index, times, begin, end, LANES_16, out)
            _put(quarter, scale, out, here, accumulate, LANES_16)


def _exp2_of_negative(x: Any) -> Any:
    """Return 2**x for x <= 0 within a few ulp; below 2**-100 (float32) or 2**-1000 about that number."""


# Powers of ln 2 over factorials; in float32 the first six are refitted on [-0.5, 0.5] for relative error.
_SINGLE = (1.0000001, 0.69314694, 0.24022122, 0.05550743, 0.00967546, 0.0013267)
_DOUBLE = tuple(math.log(2) ** k / math.factorial(k) for k in range(14))
_S0, _S1, _S2, _S3, _S4, _S5 = _SINGLE


@overload(_exp2_of_negative)
def _typed_exp2(x: Any) -> Any:
    import numba

    if x.element == numba.float32:

        def single(x: Any) -> Any:
            x = larger(x, splat(-100.0, x))
            n = rint(x)
            f = x - n
            p = fma(splat(_S5, x), f, splat(_S4, x))
            p = fma(p, f, splat(_S3, x))
            p = fma(p, f, splat(_S2, x))
            p = fma(p, f, splat(_S1, x))
            p = fma(p, f, splat(_S0, x))
            return p * power_of_two(n)

        return single

    def double(x: Any) -> Any:
        x = larger(x, splat(-1000.0, x))
        n = rint(x)
        f = x - n
        p = splat(_DOUBLE[13], x)
        for k in range(12, -1, -1):
            p = fma(p, f, splat(_DOUBLE[k], x))
        return p * power_of_two(n)

    return double


def _flushed(x: Any) -> Any:
    """Return float32 lanes with what is far below any weight's effect set to 0.

    A trace or a moment that decays in float32 ends in a denormal number that never reaches 0, and every
    operation on one costs a hundred ordinary ones. float64 traces take ten times as long to get there.
    """


_NEGLIGIBLE = 1e-30


@overload(_flushed)
def _typed_flushed(x: Any) -> Any:
    import numba

    if x.element == numba.float32:
        return lambda x: select(greater(magnitude(x), splat(_NEGLIGIBLE, x)), x, splat(0.0, x))
    return lambda x: x


@_part
def _advance(u: Any, v: Any, z: Any, keep_u: Any, keep_v: Any, integer: bool, scale: float) -> Any:
    """Return the current and the potential before reset one step on (dse.engine.neurons.cuba_lif)."""
    if integer:
        u = trunc(u * keep_u) + trunc(z * splat(scale, u))
        return u, trunc(v * keep_v) + u
    u = _flushed(u * keep_u + z)
    return u, _flushed(v * keep_v + u)


@_part
def _advance_across(
    u: Any, v: Any, z: Any, keep_u: Any, keep_v: Any, cross: Array, o: int, integer: bool, scale: float
) -> Any:
    """Return both states before reset one step on (neurons.resonator); without `cross`, as `_advance`."""
    n = cross.size // 4
    v_to_u, u_to_v = load(cross, o, LANES_16), load(cross, n + o, LANES_16)
    now_to_v = load(cross, 2 * n + o, LANES_16)
    across_u = u * keep_u + v * v_to_u
    across_v = v * keep_v + u * u_to_v
    if integer:
        u = trunc(across_u) + trunc(z * splat(scale, u))
        return u, trunc(across_v) + now_to_v * u
    u = _flushed(across_u + z)
    return u, _flushed(across_v + now_to_v * u)


@_part
def _awake(u: Any, before: Any, drive: Any, cross: Array, o: int) -> Any:
    """Return a mask of the neurons that are updated: with potential or input; resonators with a state."""
    rest = splat(0.0, u)
    active = either(differs(before, rest), differs(drive, rest))
    if cross.size > 0:
        now_to_v = load(cross, cross.size // 2 + o, LANES_16)
        active = either(active, differs(u - now_to_v * u, rest))
    return active


@_part
def _kept(what: int, voltage: Any, centre: float, rate: float, height: float, cut: float) -> Any:
    """Return what the backward pass needs of a potential: the surrogate gradient, or itself."""
    if what == SLOPE:
        x = magnitude(voltage - splat(centre, voltage)) * splat(rate, voltage)
        if cut > -math.inf and bits(greater(x, splat(cut, x))) == 0:
            return splat(0.0, x)
        slope = splat(height, x) * _exp2_of_negative(x)
        return select(greater(x, splat(cut, x)), slope, splat(0.0, x)) if cut > -math.inf else slope
    return voltage


@_kernel
def scan(
    z: Array,
    place: int,
    n_steps: int,
    width: int,
    keep_u: Array,
    keep_v: Array,
    cross: Array,
    column: int,
    threshold: float,
    scale: float,
    integer: bool,
    what: int,
    surrogate: Any,
    fired: Array,
    first_group: int,
    n_groups: int,
    updates: Array,
    peak: Array,
    states: Array,
) -> int:
    """Run one block of one sample from rest through time; return its number of spikes.

    Args:
        z: weighted input in weight units, replaced by what is kept.
        place: where the block's first step of the sample lies.
        n_steps, width: of the block.
        keep_u, keep_v: (column,) factors of the states; they have the states' precision.
        cross: (4 * column,) neurons.resonator.Cross, one after the other; empty: CUBA-LIF neurons alone.
        column: the block's first column.
        threshold: in the states' units.
        scale: the states' units per weight unit.
        integer: states are whole numbers and leak by truncation.
        what: keep NOTHING, the SLOPE of the surrogate or the VOLTAGE before reset.
        surrogate: (centre, -log2(e) / width, height, exponent below which it is cut to 0).
        fired: uint16 spikes of 16 columns each, (step, group) from `first_group` on.
        n_groups: groups of a row.
        updates: (step,) neurons with a potential or an input are added here, where it is not empty.
        peak: (16,) largest magnitude of a state by lane, raised here where updates are counted.
        states: u, then v after its reset, in weight units, each laid out as `z`; empty: they are not kept.
    """
    centre, rate, height, cut = surrogate
    count, turns = updates.size > 0, cross.size > 0
    keeps, half = states.size > 0, states.size // 2
    n_fired = 0
    for group in range(width // LANES):
        o = column + LANES * group
        ku, kv = load(keep_u, o, LANES_16), load(keep_v, o, LANES_16)
        rest = splat(0.0, ku)
        u, v = rest, rest
        top, units = splat(threshold, rest), splat(1.0 / scale, rest)
        highest = rest
        at = place + LANES * group
        for t in range(n_steps):
            drive = as_type_of(load(z, at, LANES_16), keep_u)
            if turns:
                u, before = _advance_across(u, v, drive, ku, kv, cross, o, integer, scale)
                over = greater(before, top)
                v = select(over, before * load(cross, 3 * (cross.size // 4) + o, LANES_16), before)
            else:
                u, before = _advance(u, v, drive, ku, kv, integer, scale)
                over = greater(before, top)
                v = select(over, rest, before)
            spikes = bits(over)
            fired[first_group + t * n_groups + o // LANES] = spikes
            n_fired += count_bits(spikes)
            if what != NOTHING:
                voltage = as_type_of(before * units, z)
                store(z, at, _kept(what, voltage, centre, rate, height, cut))
            if keeps:
                store(states, at, as_type_of(u * units, states))
                store(states, half + at, as_type_of(v * units, states))
            if count:
                updates[t] += count_bits(bits(_awake(u, before, drive, cross, o)))
                highest = larger(highest, larger(magnitude(u), magnitude(before)))
            at += width
        if count:
            store(peak, 0, larger(load(peak, 0, LANES_16), highest))
    return n_fired


@_kernel
def scan_recurrent(
    z: Array,
    n_rows: int,
    first_row: int,
    n_steps: int,
    n_columns: int,
    ring: Array,
    ring_scale: float,
    keep_u: Array,
    keep_v: Array,
    cross: Array,
    threshold: float,
    scale: float,
    integer: bool,
    what: int,
    surrogate: Any,
    fired: Array,
    n_groups: int,
    updates: Array,
    peak: Array,
    states: Array,
    u: Array,
    v: Array,
    sent: Array,
    n_sent: int,
) -> int:
    """Run all blocks of one sample of a layer that feeds itself on from a state; arguments as in `scan`.

    Args:
        n_rows: rows of every block of z.
        first_row: row of the sample's first step.
        n_columns: padded neurons.
        ring: recurrent weights in blocks of `n_columns` rows; empty: it does not feed itself.
        ring_scale: weight units per unit of the ring.
        u, v: (column,) states, which become those after the last step.
        sent, n_sent: the neurons that fired in the step before; `sent` becomes those of the last step.
    """
    centre, rate, height, cut = surrogate
    count, turns = updates.size > 0, cross.size > 0
    keeps, half = states.size > 0, states.size // 2
    n_fired = 0
    for t in range(n_steps):
        row = first_row + t
        column = 0
        while column < n_columns:
            width = width_at(column, n_columns)
            for group in range(width // LANES):
                o = column + LANES * group
                at = n_rows * column + row * width + LANES * group
                own = _sum_rows(ring, n_columns * column + LANES * group, width, sent, 0, n_sent, LANES_16, z)
                drive = as_type_of(load(z, at, LANES_16) + own * splat(ring_scale, own), keep_u)
                ku, kv = load(keep_u, o, LANES_16), load(keep_v, o, LANES_16)
                now, before, after = load(u, o, LANES_16), load(v, o, LANES_16), splat(0.0, ku)
                if turns:
                    now, before = _advance_across(now, before, drive, ku, kv, cross, o, integer, scale)
                    after = before * load(cross, 3 * (cross.size // 4) + o, LANES_16)
                else:
                    now, before = _advance(now, before, drive, ku, kv, integer, scale)
                rest = splat(0.0, ku)
                over = greater(before, splat(threshold, rest))
                store(u, o, now)
                store(v, o, select(over, after, before))
                fired[row * n_groups + o // LANES] = bits(over)
                if what != NOTHING:
                    voltage = as_type_of(before * splat(1.0 / scale, rest), z)
                    store(z, at, _kept(what, voltage, centre, rate, height, cut))
                if keeps:
                    units = splat(1.0 / scale, rest)
                    store(states, at, as_type_of(now * units, states))
                    store(states, half + at, as_type_of(load(v, o, LANES_16) * units, states))
                if count:
                    updates[t] += count_bits(bits(_awake(now, before, drive, cross, o)))
                    highest = larger(magnitude(now), magnitude(before))
                    store(peak, 0, larger(load(peak, 0, LANES_16), highest))
            column += width
        n_sent = _decode_row(fired, row * n_groups, n_groups, sent, 0)
        n_fired += n_sent
    return n_fired


@_part
def _decode_row(fired: Array, place: int, n_groups: int, index: Array, position: int) -> int:
    """Append the numbers of a row's set bits to `index`; return where they end."""
    for group in range(n_groups):
        spikes = np.uint64(fired[place + group])
        while spikes != np.uint64(0):
            index[position] = LANES * group + lowest_bit(spikes)
            position += 1
            spikes &= spikes - np.uint64(1)
    return position


@_kernel
def decode(
    fired: Array,
    n_samples: int,
    n_steps: int,
    n_groups: int,
    delay: int,
    gain: Array,
    offsets: Array,
    index: Array,
) -> int:
    """List the spikes of each row as the next layer sees them: `delay` steps later, without silenced ones.

    Args:
        fired: uint16 spikes, (row, group).
        gain: (sample, column) factors; spikes of a factor 0 are left out; empty: none is.
        offsets, index: filled; `index` holds at most one entry per row and column.
    """
    has_gain = gain.size > 0
    position = 0
    offsets[0] = 0
    for n in range(n_samples):
        for t in range(n_steps):
            row = n * n_steps + t
            if t >= delay:
                begin = position
                position = _decode_row(fired, (row - delay) * n_groups, n_groups, index, position)
                if has_gain:
                    end, position = position, begin
                    for e in range(begin, end):
                        index[position] = index[e]
                        position += 1 if gain[n, index[e]] != 0 else 0
            offsets[row + 1] = position
    return position


@_kernel
def spike_counts(
    fired: Array, n_samples: int, n_steps: int, n_groups: int, ends: Array, counts: Array
) -> None:
    """Count each column's spikes between some steps into (sample, stretch, column).

    Args:
        fired: uint16 spikes, (row, group).
        n_samples, n_steps, n_groups: of them.
        ends: (stretch,) the step after the last one of each stretch; the first begins at step 0.
        counts: filled.
    """
    counts[:] = 0
    for n in range(n_samples):
        first = 0
        for stretch in range(len(ends)):
            for row in range(n * n_steps + first, n * n_steps + ends[stretch]):
                for group in range(n_groups):
                    spikes = np.uint64(fired[row * n_groups + group])
                    while spikes != np.uint64(0):
                        counts[n, stretch, LANES * group + lowest_bit(spikes)] += 1
                        spikes &= spikes - np.uint64(1)
            first = ends[stretch]


@_part
def _retreat(lu: Any, lv: Any, g: Any, keep_u: Any, keep_v: Any, cross: Array, o: int) -> Any:
    """Return dL/du and dL/dv of a step from those of the next one, given g = dL/ds times ds/dv."""
    if cross.size > 0:
        n = cross.size // 4
        later_v = lv
        lv = _flushed(fma(keep_v, lv, fma(load(cross, o, LANES_16), lu, g)))
        by_now = fma(load(cross, n + o, LANES_16), later_v, load(cross, 2 * n + o, LANES_16) * lv)
        return _flushed(fma(keep_u, lu, by_now)), lv
    lv = _flushed(fma(keep_v, lv, g))
    return _flushed(fma(keep_u, lu, lv)), lv


@_kernel
def scan_back(
    slope: Array,
    place: int,
    n_steps: int,
    width: int,
    keep_u: Array,
    keep_v: Array,
    cross: Array,
    column: int,
    by_column: Array,
    later: Array,
    later_rows: int,
    later_row: int,
    n_later: int,
    back: Array,
    n_columns: int,
    shift: int,
    penalty: Array,
) -> None:
    """Replace the surrogate gradients of one block of one sample by dL/dz, backward in time.

    dL/ds is the factor of the column times either 1 (an output, whose loss depends on its spike count) or
    the sum over the next layer's dL/dz, one step later, times the weights; and the penalty.

    Args:
        slope, place, n_steps, width: the block of the sample.
        keep_u, keep_v, cross, column: as in `scan`, in the slope's precision.
        by_column: (column,) factor: dL/ds of an output, or the gain of a hidden neuron.
        later: the next layer's dL/dz in blocks of `later_rows` rows, `n_later` neurons; empty: an output.
        later_row: row of the sample's first step there.
        back: (later column, column) weights.
        n_columns: padded columns of `back`.
        shift: steps by which the next layer sees spikes later.
        penalty: (column,) what every spike adds to the loss; empty: nothing.
    """
    is_output = later.size == 0
    for group in range(width // LANES):
        o = column + LANES * group
        ku, kv = load(keep_u, o, LANES_16), load(keep_v, o, LANES_16)
        factor = load(by_column, o, LANES_16)
        zero = splat(0.0, ku)
        lv, lu = zero, zero
        for t in range(n_steps - 1, -1, -1):
            at = place + t * width + LANES * group
            sensitive = load(slope, at, LANES_16)
            if t + shift >= n_steps or bits(differs(sensitive, zero)) == 0:
                g = zero  # the next layer never sees these spikes, or no potential was near its threshold
            elif is_output:
                g = factor
            else:
                row = later_row + t + shift
                g = splat(0.0, ku)
                first = 0
                while first < n_later:
                    w = width_at(first, n_later + -n_later % LANES)
                    source = later_rows * first + row * w
                    for c in range(min(w, n_later - first)):
                        weight = load(back, (first + c) * n_columns + o, LANES_16)
                        g = fma(splat(later[source + c], g), weight, g)
                    first += w
                g = g * factor
            if penalty.size > 0:
                g = g + load(penalty, o, LANES_16)
            lu, lv = _retreat(lu, lv, g * sensitive, ku, kv, cross, o)
            store(slope, at, lu)


@_kernel
def scan_back_recurrent(
    slope: Array,
    n_rows: int,
    first_row: int,
    n_steps: int,
    n_columns: int,
    ring_back: Array,
    keep_u: Array,
    keep_v: Array,
    cross: Array,
    by_column: Array,
    later: Array,
    n_later: int,
    back: Array,
    shift: int,
    penalty: Array,
) -> None:
    """Replace the surrogate gradients of one sample of a layer that feeds itself by dL/dz (`scan_back`).

    Args:
        n_rows: rows of every block of `slope` and of `later`.
        first_row: row of the sample's first step.
        ring_back: (postsynaptic, presynaptic) recurrent weights, row by row.
    """
    lv, lu = np.zeros_like(keep_u), np.zeros_like(keep_u)
    g_all = np.zeros_like(keep_u)
    for t in range(n_steps - 1, -1, -1):
        row = first_row + t
        seen = t + shift < n_steps
        for o in range(0, n_columns, LANES):
            g = zeros(lv, LANES_16)
            if seen:
                first = 0
                while first < n_later:
                    w = width_at(first, n_later + -n_later % LANES)
                    source = n_rows * first + (row + shift) * w
                    for c in range(min(w, n_later - first)):
                        weight = load(back, (first + c) * n_columns + o, LANES_16)
                        g = fma(splat(later[source + c], g), weight, g)
                    first += w
                g = g * load(by_column, o, LANES_16)
            for c in range(n_columns):  # lu is still that of step t + 1
                g = fma(splat(lu[c], g), load(ring_back, c * n_columns + o, LANES_16), g)
            if penalty.size > 0:
                g = g + load(penalty, o, LANES_16)
            store(g_all, o, g)
        column = 0
        while column < n_columns:
            width = width_at(column, n_columns)
            for group in range(width // LANES):
                o = column + LANES * group
                at = n_rows * column + row * width + LANES * group
                ku, kv = load(keep_u, o, LANES_16), load(keep_v, o, LANES_16)
                g = load(g_all, o, LANES_16)
                g = g * load(slope, at, LANES_16)
                by_u, by_v = _retreat(load(lu, o, LANES_16), load(lv, o, LANES_16), g, ku, kv, cross, o)
                store(lv, o, by_v)
                store(lu, o, by_u)
                store(slope, at, by_u)
            column += width


@_kernel
def scatter(
    offsets: Array,
    index: Array,
    n_rows: int,
    by_input: Array,
    place: int,
    width: int,
    gradient: Array,
    start: int,
) -> None:
    """Add dL/dz of each row of a block to the gradient rows of the inputs that the row lists."""
    for r in range(n_rows):
        for group in range(0, width, LANES):
            added = load(by_input, place + r * width + group, LANES_16)
            for e in range(offsets[r], offsets[r + 1]):
                at = start + index[e] * width + group
                store(gradient, at, load(gradient, at, LANES_16) + added)


@_kernel
def transpose(
    offsets: Array,
    index: Array,
    times: Array,
    n_inputs: int,
    starts: Array,
    out_offsets: Array,
    out: Array,
    out_times: Array,
) -> None:
    """List, chunk by chunk, the rows in which each input fires, counted from the chunk's first row.

    Args:
        offsets, index: the inputs that fire in each row.
        times: how often each fires; empty: once.
        starts: (chunk + 1,) first row of each chunk, and the end.
        out_offsets: (chunk, input + 1) where an input's rows lie in `out`.
        out: (event,) int32.
        out_times: `times` in their order.
    """
    for chunk in range(starts.size - 1):
        low, high = starts[chunk], starts[chunk + 1]
        ends = out_offsets[chunk]
        ends[:] = 0
        for e in range(offsets[low], offsets[high]):
            ends[index[e] + 1] += 1
        ends[0] = offsets[low]
        for i in range(n_inputs):
            ends[i + 1] += ends[i]
        # Fill each input's rows from its start, which moves to its end; then move the offsets back.
        for r in range(low, high):
            for e in range(offsets[r], offsets[r + 1]):
                i = index[e]
                out[ends[i]] = r - low
                if times.size > 0:
                    out_times[ends[i]] = times[e]
                ends[i] += 1
        for i in range(n_inputs, 0, -1):
            ends[i] = ends[i - 1]
        ends[0] = offsets[low]


@_kernel
def squared_norm(
    gradient: Array, factor: float, weights: Array, grid: float, low: float, high: float
) -> float:
    """Return the squared Euclidean norm of a gradient, in float64; clipped weights have none (see `adam`)."""
    wide = np.zeros(LANES)
    total = zeros(wide, LANES_16)
    for at in range(0, gradient.size, LANES):
        g = as_type_of(load(gradient, at, LANES_16), wide)
        if grid > 0:
            w = load(weights, at, LANES_16)
            q = rint(w * splat(grid, w))
            outside = either(greater(splat(low, q), q), greater(q, splat(high, q)))
            g = select(outside, splat(0.0, g), g)
        total = fma(g, g, total)
    store(wide, 0, total)
    return float(wide.sum() * factor * factor)


@_kernel
def adam(
    weights: Array,
    gradient: Array,
    first: Array,
    second: Array,
    n_rows: int,
    n_columns: int,
    unit: Array,
    factor: float,
    rate: float,
    beta_1: float,
    beta_2: float,
    correction: float,
    epsilon: float,
    table: Array,
    grid: float,
    low: float,
    high: float,
) -> float:
    """Move weights against their gradient, in place, round them anew; return the gradient's squared norm.

    Args:
        weights, first, second: float32 in blocks; Adam's moments.
        gradient: in blocks; it is set to 0 for the next batch.
        n_rows, n_columns: of the matrix, columns padded.
        unit: (column,) what a rate of 1 moves a weight by.
        factor: of the gradient.
        rate: learning rate over 1 - beta_1 ** step.
        correction: 1 / (1 - beta_2 ** step).
        table: int8 weights as they run, or empty where weights run as they are.
        grid, low, high: rounded weights are `rint(weight * grid)` in [low, high]. Where it lies outside, the
            gradient does not pass; moved weights are clipped to low / grid and high / grid, where it does.
            grid 0: weights are not rounded.
    """
    wide = np.zeros(LANES)
    norm = zeros(wide, LANES_16)
    column = 0
    while column < n_columns:
        width = width_at(column, n_columns)
        for group in range(width // LANES):
            size = load(unit, column + LANES * group, LANES_16)
            size = size * splat(rate, size)
            for i in range(n_rows):
                at = n_rows * column + i * width + LANES * group
                w, m, v = load(weights, at, LANES_16), load(first, at, LANES_16), load(second, at, LANES_16)
                summed = load(gradient, at, LANES_16)
                g = as_type_of(summed * splat(factor, summed), weights)
                store(gradient, at, splat(0.0, summed))
                if grid > 0:
                    q = rint(w * splat(grid, w))
                    outside = either(greater(splat(low, q), q), greater(q, splat(high, q)))
                    g = select(outside, splat(0.0, g), g)
                double = as_type_of(g, wide)
                norm = fma(double, double, norm)
                m = _flushed(m + splat(1.0 - beta_1, m) * (g - m))
                v = _flushed(v + splat(1.0 - beta_2, v) * (g * g - v))
                w = w - size * m / (sqrt(v * splat(correction, v)) + splat(epsilon, v))
                store(first, at, m)
                store(second, at, v)
                if grid > 0:
                    w = smaller(larger(w, splat(low / grid, w)), splat(high / grid, w))
                    store(table, at, rint(w * splat(grid, w)))
                store(weights, at, w)
        column += width
    store(wide, 0, norm)
    return float(wide.sum())
