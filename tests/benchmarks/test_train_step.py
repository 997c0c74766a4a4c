"""What is timed computes the same thing: plain loops and this engine against the float64 witness."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.cases import CASES, Variant
from benchmarks.step_contender import contender
from benchmarks.train_step import EXACT, error, exact_gradients

TINY = CASES["tiny"]


@pytest.fixture(scope="module")
def exact():
    return exact_gradients(TINY)


WITNESSES = {
    Variant("ideal"): "loop",
    Variant("integer"): "dse, integer",
    Variant("ideal", 1.0): "loop, resonators",
    Variant("integer", 1.0): "dse, resonators, integer",
    Variant("integer", 0.5): "dse, half resonators, integer",
    Variant("integer", regions=12): "dse, 12 regions, integer",
}


@pytest.mark.parametrize("name", [name for name in EXACT if not name.startswith("spikingjelly")])
def test_gradients_and_answers_are_the_witness_s(name, exact):
    variant = EXACT[name]
    it = contender(name, TINY)
    assert error(it.gradients(), exact[variant]) < 1e-5
    real = replace(variant, arithmetic="ideal") if variant.arithmetic == "float32" else variant
    reference = contender(WITNESSES[real], TINY)
    np.testing.assert_array_equal(np.asarray(it.infer()), np.asarray(reference.infer()))
    rates = it.rates()
    assert len(rates) == 2 and all(0 < rate < 1 for rate in rates)


def test_rounded_weights_are_neighbours_on_the_grid_and_unbiased():
    case = CASES["C"]
    for w, rounded in zip(case.weights, case.weights_of(Variant("integer")), strict=True):
        np.testing.assert_array_equal(rounded * 32, np.round(rounded * 32))
        assert np.abs(rounded - w).max() < 1 / 32
        assert abs((rounded - w).mean()) < 4 * (1 / 64) / np.sqrt(w.size)
