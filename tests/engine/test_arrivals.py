"""Delays spike by spike: bit for bit what trains of bits give, whichever of the two a layer runs."""

import numpy as np
import pytest

from benchmarks.ours import rows_of
from dse.engine import arrivals, delays
from dse.engine.layout import packed, padded

CASES = [
    # Inputs, neurons, samples, steps, share of spikes.
    (1, 1, 1, 1, 1.0),
    (3, 17, 2, 63, 0.5),
    (4, 20, 3, 64, 0.3),
    (5, 100, 40, 65, 0.05),  # tiles that end within a sample
    (300, 33, 14, 150, 0.03),  # more inputs than an int16 sums; samples of three words
    (7, 16, 2, 2100, 0.02),  # a sample longer than a tile
    (6, 16, 2, 40, 0.0),
]


@pytest.mark.parametrize(("weights", "kind"), [("int8", "f4"), ("float32", "f4"), ("float32", "f8")])
@pytest.mark.parametrize(("n_in", "n_out", "n", "n_steps", "share"), CASES)
def test_bit_for_bit_as_trains(n_in, n_out, n, n_steps, share, weights, kind):
    rng = np.random.default_rng(n_in)
    rows = rows_of((rng.random((n + 1, n_steps, n_in)) < share).astype(np.uint8))
    first = n_steps  # the first sample is not of the chunk
    late = packed(rng.integers(0, 63, (n_in, n_out)), np.int8)
    drawn = rng.integers(-128, 128, (n_in, n_out)) if weights == "int8" else rng.normal(0, 1, (n_in, n_out))
    table = packed(drawn * (rng.random((n_in, n_out)) < 0.8), weights)
    columns = padded(n_out)
    of_inputs = arrivals.by_input(rows.offsets, rows.index, first, n, n_steps, n_in)
    inputs = np.arange(n_in)
    starts, places = arrivals.places_of(inputs, *of_inputs, n_steps)
    assert places.size == rows.offsets[-1] - rows.offsets[first]

    sums = [np.full(n * n_steps * columns, np.nan, kind) for _ in range(2)]
    trains = delays.trains_of(rows.offsets, rows.index, first, n, n_steps, n_in)
    delays.add_up(trains, n, n_steps, table, late, n_out, columns, 0.25, sums[0])
    arrivals.add_up(starts, places, n, n_steps, table, late, n_out, columns, 0.25, sums[1])
    np.testing.assert_array_equal(*sums)
    assert sums[0].any() == (places.size > 1)  # a single spike comes too late

    blocks = packed(rng.normal(0, 1, (n * n_steps, n_out)), kind)
    by_neuron = np.full((columns, n, arrivals.stride_of(n_steps)), np.nan, kind)
    delays.turn(blocks, n, n_steps, by_neuron)
    for learns, axonal in ((True, False), (True, True), (False, False)):
        found = []
        by_spikes = [
            (x, *arrivals.places_of(x, *of_inputs, n_steps), n_in)
            for x in (inputs[1::2].copy(), inputs[::2].copy())
        ]
        for add_gradients, of_some in (
            (delays.add_gradients, [(inputs, trains)]),
            (arrivals.add_gradients, by_spikes),
        ):
            by_weight = np.full(table.size, 0.5, kind)
            by_delay = np.full(table.size if learns else 0, 0.5, kind)
            for some in of_some:
                of_layer = (by_neuron, n_steps, table, late, n_out, 0.03, axonal)
                add_gradients(*some, *of_layer, by_weight, by_delay)
            found.append((by_weight, by_delay))
        for mine, other in zip(*found, strict=True):
            np.testing.assert_array_equal(mine, other)
