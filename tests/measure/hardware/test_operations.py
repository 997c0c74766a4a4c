import dataclasses

import numpy as np
import pytest

from dse.measure.hardware.cost import cost, drawn
from dse.measure.hardware.plan import NotApplicable
from dse.measure.hardware.profile import load
from tests.measure.hardware.loads import network, operations

NAME = "op_4.6_0.9"
PROFILE = load(NAME)


def test_energy_by_hand():
    # 1000 MACs and 2000 additions: 4600 + 1800 pJ; low end 230 + 60 pJ.
    found = cost(PROFILE, operations(1000, 2000))
    assert float(found.energy_uj.value) == pytest.approx(6.4e-3)
    assert float(found.energy_uj.low) == pytest.approx(2.9e-4)
    assert float(found.energy_uj.high) == pytest.approx(6.4e-3)
    assert {cause: float(x) for cause, x in found.breakdown.items()} == pytest.approx(
        {"mac": 4.6e-3, "addition": 1.8e-3}
    )
    assert not found.timed and found.fits and found.n_cores.value == 0
    assert found.hardware_latency_ms == found.idle_mw == found.static_throttled_uj.value == 0


def test_the_rule_of_syops_counter_by_hand():
    # A dense layer from 4 to 3, 10 steps: of numbers 4 x 3 x 10 = 120 MACs, 552 pJ; of spikes at a mean rate
    # of 0.25 per input and step 0.25 x 120 = 30 ACs, 27 pJ.
    assert cost(PROFILE, operations(120, 0)).energy_uj.value == pytest.approx(552e-6)
    of_spikes = cost(PROFILE, network((4, 3), [0.25 * 4 * 10, 0]))
    assert of_spikes.energy_uj.value == pytest.approx(27e-6)
    # Then a layer from 3 to 2: 6 spikes of the first layer are 6 x 2 more ACs, 10.8 pJ.
    assert cost(PROFILE, network((4, 3, 2), [10, 6, 5])).energy_uj.value == pytest.approx(37.8e-6)


def test_weights_that_are_zero_are_no_additions():
    pruned = network((4, 3, 2), [10, 6, 5], synapses=(1.5, 0.5, 0.0), stored=(6, 2))
    assert cost(PROFILE, pruned).energy_uj.value == pytest.approx(0.9e-6 * (10 * 1.5 + 6 * 0.5))


def test_leading_axes_and_nothing_done():
    found = cost(PROFILE, operations([[0, 1e6], [2e6, 0]], [[0, 0], [1e6, 1e6]]))
    expected = [[0.0, pytest.approx(4.6)], [pytest.approx(10.1), pytest.approx(0.9)]]
    assert found.energy_uj.value.tolist() == expected
    assert (found.energy_uj.low <= found.energy_uj.value).all() and found.energy_uj.low.shape == (2, 2)
    assert cost(PROFILE, network((4, 3), [0, 0])).energy_uj.value == 0
    assert cost(PROFILE, network((4, 3), [0, 0], n_steps=0)).energy_uj.high == 0


@pytest.mark.parametrize("bad", [-1.0, np.nan, np.inf])
def test_counts_that_are_none(bad):
    with pytest.raises(ValueError, match="macs must be finite and >= 0"):
        cost(PROFILE, operations([1.0, bad], [0.0, 0.0]))
    with pytest.raises(ValueError, match="additions must be finite and >= 0"):
        cost(PROFILE, operations(0.0, bad))


EVENTS = load("op_4.6_0.9_events")


def test_work_per_spike_by_hand():
    dense = operations([1000, 1000], [20, 40])
    with pytest.raises(NotApplicable, match="_events runs only classifiers that count their work per"):
        cost(EVENTS, dense)
    both = dataclasses.replace(dense, event_macs=np.array([50.0, 50]), event_additions=np.array([200.0, 400]))
    assert cost(PROFILE, both).energy_uj.value.tolist() == cost(PROFILE, dense).energy_uj.value.tolist()
    per_spike = [(50 * 4.6 + n * 0.9) * 1e-6 for n in (200, 400)]
    assert cost(EVENTS, both).energy_uj.value.tolist() == pytest.approx(per_spike)
    last = both.mapped(lambda x: x[-1:])
    assert cost(EVENTS, last).energy_uj.value.tolist() == pytest.approx(per_spike[1:])
    figures = EVENTS.drawn(5, np.random.default_rng(1))
    of_draws = np.outer(figures["mac_pj"], [50, 50]) + np.outer(figures["addition_pj"], [200, 400])
    assert drawn(EVENTS, both, figures).energy_uj == pytest.approx(of_draws * 1e-6)
    spiking = network((4, 3, 2), [10, 6, 5])
    assert cost(EVENTS, spiking).energy_uj.value == cost(PROFILE, spiking).energy_uj.value
    with pytest.raises(ValueError, match="event_macs must be finite and >= 0"):
        cost(EVENTS, dataclasses.replace(both, event_macs=np.array([-1.0, 0])))
