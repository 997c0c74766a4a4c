import dataclasses

import numpy as np
import pytest

from dse.base.records import Layer, Network, Workload
from dse.measure.hardware.duty import latency_ms
from dse.measure.objectives import Points
from dse.measure.objectives.work import Work, memory_bytes
from tests.layers import cuba_parameters


def layer(n, n_in, recurrent=False):
    own = np.ones((n, n), dtype=np.float32) if recurrent else None
    decay = np.zeros(n, dtype=np.int32)
    return Layer(np.ones((n, n_in), dtype=np.float32), own, cuba_parameters(decay, decay, 80))


def test_weights_count_delays_and_recurrence():
    network = Network((layer(5, 2 * 3, recurrent=True), layer(4, 5)), 3, (0, 2), 1, "integer")
    assert network.n_weights == 5 * 6 + 5 * 5 + 4 * 5


def test_weights_that_are_exactly_0_do_not_count():
    pruned = layer(5, 6, recurrent=True)
    pruned.weight[:, 2] = 0
    pruned.recurrent[0, 0] = 0
    network = Network((pruned, layer(4, 5)), 6, (0,), 1, "integer")
    assert network.stored == (5 * 5 + 5 * 5 - 1, 4 * 5)
    assert network.n_weights == sum(network.stored)
    assert network.n_weights_dense == 5 * 6 + 5 * 5 + 4 * 5


def workload(sizes, recurrent, spikes):
    spikes = np.asarray(spikes, dtype=float)
    return Workload(sizes, recurrent, np.ones(spikes.shape[:-1]), spikes, None, 1.0)


def points(load, n_samples=1):
    ones = np.ones(load.spikes.shape[:-1])
    return Points(
        n_samples=n_samples,
        accuracy=ones,
        accuracy_test=None,
        decision_latency_ms=ones,
        spikes=load.spikes,
        n_weights=ones.astype(int),
        load=load,
    )


def synaptic_operations(load):
    return Work().measure(points(load))["synaptic_operations"]


def test_spikes_both_ways_with_and_without_input():
    activity = Work().measure(points(workload((9, 4, 3), (False, False), [6.0, 1.5, 1.5]), 2))
    assert activity["spikes_per_inference"] == 9.0
    assert activity["spikes_per_inference_no_input"] == 3.0
    assert activity["spikes_total"] == 18


def test_totals_are_whole_and_do_not_overflow():
    thirds = workload((9, 4), (False,), [[2**33, 1 / 3], [1, 2 / 3]])
    total = Work().measure(points(thirds, 3))["spikes_total"]
    assert total.tolist() == [3 * 2**33 + 1, 5]
    assert total.dtype == np.int64


def test_synaptic_operations_of_a_network_small_enough_to_count():
    # 3 inputs -> 2 recurrent neurons -> 4 outputs: 7 input, 5 hidden and 9 output spikes.
    assert synaptic_operations(workload((3, 2, 4), (True, False), [7, 5, 9])) == 7 * 2 + 5 * (4 + 2)
    assert synaptic_operations(workload((3, 2, 4), (False, True), [7, 5, 9])) == 7 * 2 + 5 * 4 + 9 * 4


def test_pruned_synapses_are_no_operations():
    dense = workload((3, 2, 4), (True, False), [7, 5, 9])
    pruned = dataclasses.replace(dense, synapses=(1.5, 2.0, 0.0), stored=(4, 3))
    assert synaptic_operations(pruned) == 7 * 1.5 + 5 * 2
    assert synaptic_operations(dataclasses.replace(dense, synapses=dense.fan_out)) == synaptic_operations(
        dense
    )


def test_synaptic_operations_keep_leading_axes():
    spikes = np.arange(12.0).reshape(2, 2, 3)
    found = synaptic_operations(workload((3, 2, 4), (False, False), spikes))
    assert found.tolist() == (2 * spikes[..., 0] + 4 * spikes[..., 1]).tolist()


def queue(n, period, compute):
    """When the last of n steps is done, one after the other."""
    done = 0.0
    for step in range(1, n + 1):
        done = max(done, step * period) + compute
    return done


@pytest.mark.parametrize("compute_us", [0.0, 400.0, 2000.0, 5000.0])
@pytest.mark.parametrize("n", [1, 2, 7])
def test_latency_is_that_of_the_queue(n, compute_us):
    assert latency_ms(n * 2.0, 2.0, compute_us) == pytest.approx(queue(n, 2.0, compute_us / 1e3))


def test_memory_is_the_bits_of_every_stored_weight():
    n, bits = np.array([0, 1, 84000, 84000]), np.array([8, 3, 8, 5])
    assert memory_bytes(n, bits).tolist() == [0.0, 0.375, 84000.0, 52500.0]
