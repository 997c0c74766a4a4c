"""What costs on every profile of the package must do, whatever its kind."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.measure.hardware.cost import NotApplicable, cost, drawn
from dse.measure.hardware.profile import load, names
from tests.measure.hardware import loads
from tests.measure.hardware.figures_of import figures_of

NETWORK = loads.network(
    (16, 20, 7),
    [[40, 90, 9], [0, 0, 0], [0, 0, 0]],
    [[800, 300], [0, 0], [0, 0]],
    n_steps=[100, 100, 0],
    recurrent=(True, False),
    weight_bits=4,
)
PRUNED = replace(NETWORK, synapses=(3.0, 5.0, 0.0), stored=(140, 30))
CLASSIFIER = loads.operations([1000, 2000, 0], [50, 0, 0], [10, 3, 0], 1000, duration_ms=[100, 50, 0])
INTERVALS = ("energy_uj", "energy_throttled_uj", "static_uj", "static_throttled_uj", "step_time_us")
RUN_ANYTHING = {"asic45_memory", "op_4.6_0.9", *(name for name in names() if name.startswith("mcu_"))}


EACH = pytest.mark.parametrize(
    ("name", "given_load"),
    [
        pytest.param(name, given_load, id=f"{name}, {what}")
        for name in names()
        for what, given_load in {"network": NETWORK, "pruned": PRUNED, "classifier": CLASSIFIER}.items()
        if what != "classifier" or name in RUN_ANYTHING
    ],
)


@pytest.mark.parametrize("name", sorted({*names()} - RUN_ANYTHING))
def test_other_chips_say_in_a_line_that_they_run_no_other_classifier(name):
    for price in (cost, lambda *given: drawn(*given, load(name).draws(3))):
        with pytest.raises(NotApplicable, match=f"^{name} runs only [^\n]*$"):
            price(load(name), CLASSIFIER)


@EACH
def test_the_interval_contains_the_value(name, given_load):
    profile = load(name)
    found = cost(profile, given_load)
    for field in INTERVALS:
        value, low, high = getattr(found, field)
        assert np.isnan(value).all() if profile.interval_only else (low <= value).all()
        assert (low <= high).all() and not (value > high).any()
    if found.timed:
        value, low, high = (x[0] for x in found.power_w)
        assert low <= high and not (value < low or value > high)
    assert np.shape(found.pipeline_ms) == np.shape(found.energy_uj.high)
    assert found.energy_uj.high[0] > 0
    if not profile.interval_only:
        assert sum(found.breakdown.values()) == pytest.approx(found.dynamic_uj)
    for misfit in found.misfits:
        assert misfit.rule and misfit.text and misfit.change, misfit


@EACH
def test_nothing_in_no_time_costs_nothing(name, given_load):
    found = cost(load(name), given_load)
    for field in INTERVALS:
        assert getattr(found, field).low[-1] == getattr(found, field).high[-1] == 0
    if not load(name).interval_only:
        assert found.hardware_latency_ms[-1] == found.dynamic_uj[-1] == 0


@EACH
def test_draws_stay_in_the_interval(name, given_load):
    profile = load(name)
    found = cost(profile, given_load)
    draws = drawn(profile, given_load, profile.drawn(50, np.random.default_rng(1)))
    for field in ("energy_uj", "energy_throttled_uj", "step_time_us"):
        values, interval = getattr(draws, field), getattr(found, field)
        assert values.shape == (50, 3) and (values[:, -1] == 0).all()
        assert (values >= interval.low * (1 - 1e-9)).all() and (values <= interval.high * (1 + 1e-9)).all()
        assert (np.ptp(values, axis=0) > 0).tolist() == (interval.low < interval.high).tolist()


@EACH
def test_leading_axes_are_design_points_of_their_own(name, given_load):
    together = cost(load(name), given_load)
    for at in range(3):
        alone = cost(load(name), given_load.mapped(lambda counts, at=at: counts[at]))
        of_alone = figures_of(alone)
        for field, values in figures_of(together).items():
            if isinstance(values, np.ndarray):
                assert values.shape == (3,)
                assert values[at] == pytest.approx(of_alone[field], rel=1e-12, nan_ok=True)
        for cause, values in together.breakdown.items():
            assert values[at] == pytest.approx(alone.breakdown[cause], rel=1e-12, nan_ok=True)


def ordered(before, after, of_as_many_steps=True):
    """Assert that a cost is none below another one, and has its ends in order."""
    for field in ("energy_uj", "energy_throttled_uj", "step_time_us"):
        value, low, high = getattr(after, field)
        assert not (value < low * (1 - 1e-12) or value > high * (1 + 1e-12)) and low <= high
        for less, more in zip(getattr(before, field), (value, low, high), strict=True):
            assert not more < less * (1 - 1e-12) or (field == "step_time_us" and not of_as_many_steps)
    assert not after.hardware_latency_ms < before.hardware_latency_ms * (1 - 1e-12)


@given(
    st.sampled_from(names()),
    st.tuples(*[st.integers(1, 3000)] * 3),
    st.tuples(st.booleans(), st.booleans()),
    st.tuples(*[st.floats(0, 1e5)] * 3),
    st.integers(0, 2),
    st.floats(0, 1e5),
    st.integers(0, 100),
)
def test_more_spikes_and_steps_never_cost_less(name, sizes, recurrent, spikes, layer, more, steps):
    before = cost(load(name), loads.network(sizes, spikes, recurrent=recurrent))
    spikes = np.array(spikes)
    spikes[layer] += more
    after = cost(load(name), loads.network(sizes, spikes, n_steps=100.0 + steps, recurrent=recurrent))
    ordered(before, after, steps == 0)


@given(
    st.sampled_from(sorted(RUN_ANYTHING)),
    st.lists(st.floats(0, 1e7), min_size=5, max_size=5),
    st.lists(st.floats(0, 1e7), min_size=5, max_size=5),
    st.sampled_from([4, 8, 32]),
)
def test_more_operations_never_cost_less(name, counts, more, bits):
    before = cost(load(name), loads.operations(*counts, number_bits=bits))
    after = cost(load(name), loads.operations(*np.add(counts, more), number_bits=bits))
    ordered(before, after)
    assert before.fits or not after.fits
