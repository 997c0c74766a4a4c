import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.measure.hardware.cost import cost
from dse.measure.hardware.profile import load
from tests.measure.hardware.loads import network

PROFILE = load("loihi1_silicon")
SANAFE = json.loads((Path(__file__).parents[2] / "golden" / "sanafe.json").read_text())


def test_a_network_small_enough_to_add_up():
    # As in test_mesh, with 2 recurrent neurons: only what their spikes reach is more.
    found, plain = (
        cost(PROFILE, network((3, 2, 1), [7, 5, 4], [12, 8], 10.0, recurrent=(back, False)))
        for back in (True, False)
    )
    more = {"synaptic_event": 35.5 * 5 * 2, "message": 111.0 * 5}
    assert {cause: float(x) for cause, x in found.breakdown.items()} == pytest.approx(
        {cause: float(x) + more.get(cause, 0) * 1e-6 for cause, x in plain.breakdown.items()}
    )
    assert found.dynamic_uj == pytest.approx(sum(found.breakdown.values()))
    # Per step: the hidden core sends 2 x 6 + 1.2 x 3.7 + 0.5 x (30 + 2 x 5.1) = 36.54 ns and receives
    # (0.7 + 0.5) x (16 + 2 x 3.8) = 28.32 ns; all others do less.
    assert found.step_time_us.value == pytest.approx(0.6 + 0.03654)
    assert found.hardware_latency_ms == pytest.approx(10 * 0.63654e-3)
    assert found.static_uj.value == pytest.approx(104e-3 * 10 * 0.63654)
    assert found.static_throttled_uj.value == pytest.approx(104e-3 * 10 * 1000)
    assert found.energy_uj.value == pytest.approx(found.dynamic_uj + found.static_uj.value)
    assert (found.n_cores.value, found.fits, found.misfits) == (2, True, ())


@pytest.mark.parametrize("run", SANAFE, ids=lambda run: "-".join(map(str, run["sizes"])))
def test_sanafe_is_reproduced_from_its_counts(run):
    sizes, n_neurons = run["sizes"], sum(run["sizes"][1:])
    updates = [run["updates"] * n / n_neurons for n in sizes[1:]]
    found = cost(PROFILE, network(sizes, run["spikes"], updates, run["n_steps"]))
    assert found.n_cores.value == sum(run["cores"])
    parts = {cause: float(x) * 1e-6 for cause, x in found.breakdown.items()}
    soma = parts["neuron_access"] + parts["neuron_update"] + parts["spike"]
    assert soma == pytest.approx(run["energy_j"]["soma"], rel=1e-12)
    assert parts["synaptic_event"] == pytest.approx(run["energy_j"]["synapse"], rel=1e-12)
    assert parts["message"] == pytest.approx(111e-12 * run["messages"], rel=1e-12)
    # Hops assume that all neurons of a layer fire alike; in the run they do not.
    assert parts["hop"] == pytest.approx(4.2e-12 * run["hops"], rel=0.01)
    assert found.dynamic_uj * 1e-6 == pytest.approx(run["energy_j"]["total"], rel=1e-5)
    # The maximum over cores of the means is at most the mean of the maxima.
    ratio = float(found.step_time_us.value) * run["n_steps"] * 1e-6 / run["time_s"]
    assert 0.94 < ratio <= 1.0


def test_what_computes_slower_waits_less():
    # A processor near the step period: at the slow end nothing waits, so the figures' ends are not the range.
    profile = load("mcu_m4")
    found = cost(profile, network((300, 300, 10), [20_000, 8_000, 0], n_steps=300.0))
    assert found.hardware_latency_ms < 300 < found.step_time_us.high * 0.3
    assert found.static_uj.low == found.static_uj.value == found.static_uj.high == 0
    assert found.static_throttled_uj.low == 0
    waits_ms = 300 - found.step_time_us.low * 0.3
    running_mw = profile.cycle_nj.high * 120
    idle_mw = profile.sleep_uw.high * 1e-3 + running_mw * profile.wake_us.high * 1e-3
    assert found.static_throttled_uj.high == pytest.approx(idle_mw * waits_ms)
    assert 0 < found.static_throttled_uj.value < found.static_throttled_uj.high
    mesh = cost(PROFILE, network((24, 50, 7), [46, 100, 10]))
    for static, total in (
        (mesh.static_uj, mesh.energy_uj),
        (mesh.static_throttled_uj, mesh.energy_throttled_uj),
    ):
        assert static.low == pytest.approx(total.low - 0.85 * mesh.dynamic_uj)
        assert static.high == pytest.approx(total.high - 1.15 * mesh.dynamic_uj)


def test_a_chip_that_ignores_cores_given_by_hand_says_so():
    ignored = "the number of cores set by the user does not matter on such a chip"
    by_hand = dataclasses.replace(network((24, 50, 7), [46, 100, 10]), cores=(3, 2))
    assert ignored not in cost(PROFILE, by_hand).assumptions
    for name in ("truenorth", "xylo_imu", "mcu_m4"):
        assert ignored in cost(load(name), by_hand).assumptions
        assert ignored not in cost(load(name), dataclasses.replace(by_hand, cores=None)).assumptions


def test_static_energy_at_the_sensors_period_is_never_less_than_flat_out():
    slow = cost(PROFILE, network((24, 50, 7), [46, 100, 10], step_ms=1.0))
    assert slow.static_throttled_uj.value == pytest.approx(104e-3 * 100 * 1000)
    late = cost(PROFILE, network((24, 50, 7), [46, 100, 10], step_ms=1e-4))
    assert late.static_throttled_uj.value == late.static_uj.value


def test_what_does_not_fit_is_data():
    found = cost(PROFILE, network((6084, 500, 12), [1e5, 1e3, 1e2]))
    assert not found.fits
    assert [misfit.text for misfit in found.misfits] == ["layer 1: 6084 input axons, 4096 per core"]
    assert np.isfinite(found.energy_uj.value)
    big = cost(PROFILE, network((4096, 4096, 11), [1e5, 1e3, 1e2]))
    assert not big.fits
    assert big.n_cores.value > 128
    chips = -(-big.n_cores.value // 128)
    assert big.static_uj.value == pytest.approx(104e-3 * chips * 100 * big.step_time_us.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"spikes": np.array([1.0, -1.0])}, "spikes must be finite and >= 0"),
        ({"spikes": np.array([1.0, np.nan])}, "spikes must be finite and >= 0"),
        ({"spikes": np.array([1.0, 1.0, 1.0])}, r"spikes must be \(2,\)"),
        ({"updates": np.array([1.0, 1.0])}, r"updates must be \(1,\)"),
        ({"n_steps": np.array(0.0)}, "spikes must be 0 where n_steps is 0"),
        ({"n_steps": np.array([1.0, 1.0])}, r"spikes must be \(2, 2\)"),
        ({"step_ms": 0.0}, "step_ms must be > 0"),
        ({"sizes": (3,)}, "sizes must hold an input and at least one layer"),
        ({"sizes": (3, 0)}, "sizes must hold"),
        ({"recurrent": ()}, "recurrent one value less"),
        ({"synapses": (3.0, 0.0)}, r"synapses must be between 0 and \(2, 0\) in each layer, got \(3.0"),
        ({"synapses": (float("nan"), 0.0)}, "synapses must be between"),
        ({"synapses": (1.0,)}, "synapses must be between"),
        ({"stored": (7,)}, r"stored must be between 0 and \(6,\)"),
        ({"stored": (-1,)}, "stored must be between"),
    ],
)
def test_impossible_workloads_are_named(change, message):
    good = network((3, 2), [1, 1])
    with pytest.raises(ValueError, match=message):
        cost(PROFILE, dataclasses.replace(good, **change))


def test_pruned_synapses_cost_no_events_where_the_chip_skips_them():
    dense = network((3, 2, 1), [7, 5, 4], [12, 8], 10.0, recurrent=(True, False))
    pruned = dataclasses.replace(dense, synapses=(1.5, 2.0, 0.0), stored=(6, 1))
    found, before = cost(PROFILE, pruned), cost(PROFILE, dense)
    assert found.breakdown["synaptic_event"] == pytest.approx(35.5e-6 * (7 * 1.5 + 5 * 2.0))
    for cause in set(found.breakdown) - {"synaptic_event"}:
        assert found.breakdown[cause] == before.breakdown[cause]
    # 0.7 x (16 + 2 x 3.8 x 1.5 / 2) + 0.5 x (16 + 2 x 3.8 x 2 / 3) = 26 ns in, still 36.54 ns out.
    assert found.step_time_us.value == pytest.approx(0.6 + 0.03654)
    busy = dataclasses.replace(pruned, spikes=np.array([700.0, 5.0, 4.0]))
    assert cost(PROFILE, busy).step_time_us.value == pytest.approx(
        0.6 + 70e-3 * (16 + 5.7) + 0.5e-3 * (16 + 7.6 * 2 / 3)
    )

    one = dataclasses.replace(PROFILE.skips_zero_weights, value=0, low=0, high=0)
    keeps = dataclasses.replace(PROFILE, skips_zero_weights=one)
    for name in ("dynamic_uj", "energy_uj", "step_time_us", "n_cores"):
        assert getattr(cost(keeps, pruned), name) == getattr(before, name)


@given(
    st.tuples(*[st.integers(1, 2000)] * 3),
    st.tuples(st.booleans(), st.booleans()),
    st.tuples(*[st.floats(0, 1e5)] * 3),
    st.floats(0, 1),
    st.floats(0, 1),
)
def test_fewer_synapses_never_cost_more_energy(sizes, recurrent, spikes, share, less):
    dense = network(sizes, spikes, recurrent=recurrent)

    def with_share(share):
        synapses = tuple(share * n for n in dense.fan_out)
        return cost(PROFILE, dataclasses.replace(dense, synapses=synapses, stored=dense.dense))

    more, fewer = with_share(share), with_share(share * less)
    assert fewer.dynamic_uj <= more.dynamic_uj * (1 + 1e-12)
    assert fewer.step_time_us.value <= more.step_time_us.value * (1 + 1e-12)
    assert more.energy_uj.value <= cost(PROFILE, dense).energy_uj.value * (1 + 1e-12)
