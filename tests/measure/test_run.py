"""Columns of one run, counted by hand."""

from dataclasses import replace

import numpy as np
import pytest

from dse import store
from dse.base.records import Answers, Dataset, Head, Layer, Network, Outcome, Parameters, Response, Spikes
from dse.config.space import DecisionGrid
from dse.measure.hardware.profile import load
from dse.measure.objectives.accuracy import wilson_se
from dse.measure.objectives.recognition import itr_bits
from dse.measure.on_chips import columns_on
from dse.measure.run import measure, read_out
from tests.layers import cuba_parameters
from tests.saved_data import in_a_row

GRID, NO_GRID = DecisionGrid(np.array([0]), np.array([0.6])), DecisionGrid()
LOIHI, OPERATIONS = load("loihi1_silicon"), load("op_4.6_0.9")


def _layer(n_out, n_in):
    decay = np.full(n_out, 1024, np.int32)
    return Layer(np.ones((n_out, n_in), np.float32), None, cuba_parameters(decay, decay, 80))


@pytest.fixture
def dataset():
    zeros = np.zeros(6, np.int32)
    return Dataset(
        spikes=Spikes(np.zeros(6 * 4 + 1, np.int64), np.zeros(0, np.int32), 4, 3, 2.0),
        target=np.array([0, 1, 0, 1, 1, 0]),
        classes=("a", "b"),
        start=zeros,
        start_low=zeros,
        start_high=zeros,
        n_steps=4,
        train=np.array([0, 1]),
        validation=np.array([2, 3, 4]),
        test=np.array([5]),
        positions=in_a_row(3),
    )


@pytest.fixture
def outcome():
    """Three samples of four steps: decided at once, decided late, never a spike."""
    output = np.zeros((3, 4, 2), np.uint8)
    output[0, 0, 0] = output[0, 2, 1] = 1  # class 0 first; a tie at the end goes to class 0
    output[1, 1, 0] = output[1, 2, 1] = output[1, 3, 1] = 1  # 0 first, 1 at the end
    spikes = np.zeros((3, 4, 3), np.int32)
    spikes[..., 0] = 2
    spikes[..., 1] = 1
    spikes[..., 2] = output.sum(axis=2)
    updates = np.ones((3, 4, 2), np.int32)
    response = Response(output, spikes, updates, step_ms=2.0, peak_state=9)
    test = replace(response, output=output[:1], spikes=spikes[:1], updates=updates[:1])
    network = Network((_layer(5, 3), _layer(2, 5)), 3, (0,), 1, "integer")
    health = {"dead_neurons": 1, "overflows_24_bit": False, "initial_gain": [1.0, 2.0]}
    return Outcome(network, response, test, {}, health, train_s=1.5)


def test_the_full_read_out(outcome, dataset):
    found = measure(outcome, dataset, NO_GRID, [])
    assert found.numbers.columns == {
        "accuracy": pytest.approx(2 / 3),  # 0 right (tie), 1 right, silent sample answers 0 and is 1
        "accuracy_se": pytest.approx(float(wilson_se(2, 3))),
        "accuracy_test": 1.0,
        "n_weights": 25,
        "memory_bytes": 25.0,
        "decision_latency_ms": 8.0,
        "spikes_per_inference": pytest.approx((3 * 12 + 5) / 3),
        "spikes_per_inference_no_input": pytest.approx((3 * 4 + 5) / 3),
        "spikes_total": 41,
        "spikes_total_no_input": 4 + 2,  # of the one test sample
        "input_spike_rate_hz": pytest.approx(8 / 3 / 8e-3),
        "spike_rate_hz": pytest.approx((3 * 4 + 5) / 3 / 7 / 8e-3),
        "recall_macro": pytest.approx((1 + 1 / 2) / 2),
        "precision_macro": pytest.approx((1 / 2 + 1) / 2),
        "f1_macro": pytest.approx(2 / 3),
        "recall_macro_test": 1.0,  # one class has no sample
        "precision_macro_test": 1.0,
        "f1_macro_test": 1.0,
        "synaptic_operations": 8 * 5 + 4 * 2,  # output spikes have no targets
        "macs": 0,
        "itr_bits": pytest.approx(itr_bits([[1, 0], [1, 1]])),
        "itr_bits_per_s": pytest.approx(itr_bits([[1, 0], [1, 1]]) / 8e-3),
        "t_c_ms": 8.0,  # sample 1 is answered 0 until its last spike
        "accuracy_at_t_c_test": 1.0,
        # Sample 0 after 2 ms, sample 1 after 6 ms, of a class each; the last one is silent.
        "first_spike_ms": 4.0,
        "first_spike_median_ms": 4.0,
        "first_spike_class_median_ms": 4.0,
        "first_spike_class_min_ms": 2.0,
        "first_spike_class_max_ms": 6.0,
        "first_spike_test_ms": 2.0,
        "first_spike_test_class_median_ms": 2.0,
        "first_spike_test_class_min_ms": 2.0,
        "first_spike_test_class_max_ms": 2.0,
        "dead_neurons": 1,
        "overflows_24_bit": False,
        "train_s": 1.5,
    }
    assert found.files["confusion.npz"]["validation"].tolist() == [[1, 0], [1, 1]]
    assert found.files["confusion.npz"]["test"].tolist() == [[1, 0], [0, 0]]
    assert "surface.npz" not in found.files and found.numbers.hardware == {}


def test_neurons_that_no_chip_holds_are_priced_as_operations(outcome, dataset):
    network = outcome.network
    layers = tuple(replace(layer, neuron="lif") for layer in network.layers)
    other = replace(outcome, network=replace(network, layers=layers))
    m4 = load("mcu_m4")
    found = measure(other, dataset, NO_GRID, [LOIHI, OPERATIONS, m4])
    assert found.numbers.hardware["loihi1_silicon"] == {}
    assert found.numbers.columns["n_weights"] == 25
    as_cuba = measure(outcome, dataset, NO_GRID, [OPERATIONS])
    # The same additions; what updates cost is no part of that convention.
    assert (
        found.numbers.hardware["op_4.6_0.9"]["energy_uj"]
        == as_cuba.numbers.hardware["op_4.6_0.9"]["energy_uj"]
    )
    assert store.work_of(found.files["read_out.npz"]).additions[-1] == 8 * 5 + 4 * 2
    # A neuron with one state is updated at half the cost of one with two: 8 updates count as 4.
    assert store.work_of(found.files["read_out.npz"]).updates[-1] == 4
    assert found.numbers.hardware["mcu_m4"]["energy_uj"] > 0


def test_points_count_the_work_up_to_the_decision(outcome, dataset):
    found = measure(outcome, dataset, GRID, [LOIHI])
    points = {name: x.item() for name, x in found.files["surface.npz"].items() if "/" not in name}
    # Decided after 1, 2 and (never, so at the end) 4 steps.
    assert points["decision_latency_ms"] == pytest.approx(2.0 * (1 + 2 + 4) / 3)
    assert points["accuracy"] == pytest.approx(1 / 3)
    assert points["accuracy_se"] == pytest.approx(float(wilson_se(1, 3)))
    assert points["accuracy_test"] == 1.0
    assert points["undecided"] == pytest.approx(1 / 3)
    assert points["spikes_per_inference"] == pytest.approx((7 * 3 + 1 + 1) / 3)
    assert points["spikes_per_inference_no_input"] == pytest.approx((7 + 2) / 3)
    assert points["spikes_total"] == 23
    assert points["spikes_total_no_input"] == 2  # the test sample decides after a step
    assert points["spike_rate_hz"] == pytest.approx((7 + 2) / 3 / 7 / (14e-3 / 3))
    assert points["synaptic_operations"] == pytest.approx((7 * 2 * 5 + 7 * 2) / 3)
    assert found.numbers.columns["t_p_ms"] == pytest.approx(points["decision_latency_ms"])
    assert found.numbers.columns["t_h_ms"] is None
    assert (found.numbers.columns["t_p_test_ms"], found.numbers.columns["accuracy_at_t_p_test"]) == (2.0, 1.0)
    assert found.numbers.columns["t_h_test_ms"] is found.numbers.columns["accuracy_at_t_h_test"] is None
    assert found.numbers.columns["t_p_on_border"] == 0.0  # a grid of one setting has no ends
    assert found.numbers.columns["output_spikes_most"] == 3
    on_chip, full = (
        columns_on(LOIHI, store.work_of(found.files["surface.npz"])),
        found.numbers.hardware["loihi1_silicon"],
    )
    assert on_chip["energy_uj"].shape == (1, 1)
    assert on_chip["energy_uj"].item() < full["energy_uj"]
    assert full["energy_uj"] == pytest.approx(full["energy_dynamic_uj"] + full["energy_static_uj"])
    assert full["energy_uj_low"] < full["energy_uj"] < full["energy_uj_high"]
    assert full["latency_ms"] > 8.0
    assert on_chip["fits"].item() is True and full["n_cores"] == 2


def test_every_read_out_counts_its_own_work(outcome, dataset):
    found = measure(outcome, dataset, GRID, [LOIHI]).files["read_out.npz"]
    assert found["decision_latency_ms"].tolist() == [2.0, 4.0, 6.0, 8.0]
    assert found["spikes_per_inference"][0] == pytest.approx((3 * 3 + 1) / 3)
    assert found["spikes_per_inference"][-1] == pytest.approx((3 * 12 + 5) / 3)
    assert found["accuracy_test"].tolist() == [1.0] * 4
    assert found["spikes_total_no_input"].tolist() == [2, 3, 5, 6]
    assert found["t_p_test_ms"].tolist() == [2.0] * 4 and found["accuracy_at_t_p_test"].tolist() == [1.0] * 4
    human = ~np.isnan(found["t_h_ms"])
    assert np.array_equal(~np.isnan(found["t_h_test_ms"]), human)
    assert (np.diff(found["synaptic_operations"]) > 0).all()
    assert found["t_p_ms"][-1] == measure(outcome, dataset, GRID, []).numbers.columns["t_p_ms"]


@pytest.mark.parametrize(
    ("every_ms", "times"),
    [(3.0, [4.0, 6.0, 8.0]), (4.0, [4.0, 8.0]), (100.0, [8.0]), (0.1, [2.0, 4.0, 6.0, 8.0])],
)
def test_read_outs_are_as_far_apart_as_requested(outcome, dataset, every_ms, times):
    found = measure(outcome, dataset, DecisionGrid(read_out_every_ms=every_ms), [])
    assert found.files["read_out.npz"]["decision_latency_ms"].tolist() == times
    assert found.numbers.columns["accuracy"] == pytest.approx(2 / 3)


def test_without_a_test_set_nothing_is_summed_over_it(outcome, dataset):
    alone = replace(outcome, test=None)
    columns = measure(alone, dataset, GRID, []).numbers.columns
    assert not [name for name in columns if "_test" in name or name == "spikes_total_no_input"]


@pytest.fixture
def answered(dataset):
    """A classifier on real numbers: two read-outs of the three validation samples 0, 1, 1."""
    said = Answers(
        label=np.array([[0, 0], [0, 1], [1, 0]]),
        time_ms=np.array([4.0, 8.0]),
        n_weights=np.array([10, 20]),
        macs=np.array([100.0, 200.0]),
        additions=np.array([3.0, 6.0]),
        input_spikes=np.array([[2, 4], [1, 1], [0, 4]]),
    )
    one = replace(said, label=said.label[:1], input_spikes=said.input_spikes[:1])
    return Outcome(Parameters({"x": np.zeros(2)}, 3), said, one, {}, {"ridge": 0.5}, train_s=0.1)


def test_a_classifier_without_spikes_has_the_same_columns(answered, dataset):
    chips = [LOIHI, OPERATIONS]
    found = measure(answered, dataset, DecisionGrid(np.array([0]), np.array([0.5])), chips)
    columns = found.numbers.columns
    assert columns["accuracy"] == pytest.approx(2 / 3)
    assert (columns["n_weights"], columns["macs"], columns["synaptic_operations"]) == (20, 200.0, 6.0)
    assert columns["spikes_per_inference"] == 3.0 and columns["spikes_per_inference_no_input"] == 0.0
    assert columns["spikes_total_no_input"] == 0 and "spike_rate_hz" not in columns  # it has no neurons
    assert columns["input_spike_rate_hz"] == pytest.approx(3 / 3 / 8e-3)
    assert (columns["decision_latency_ms"], columns["t_c_ms"], columns["ridge"]) == (8.0, 4.0, 0.5)
    assert columns["accuracy_test"] == 1.0 and "surface.npz" not in found.files
    assert found.files["read_out.npz"]["n_weights"].tolist() == [10, 20]
    assert found.files["read_out.npz"]["accuracy"].tolist() == pytest.approx([2 / 3, 2 / 3])
    assert found.numbers.hardware["loihi1_silicon"] == {}  # no chip for spikes runs it
    assert found.numbers.hardware["op_4.6_0.9"]["energy_uj"] == pytest.approx((200 * 4.6 + 6 * 0.9) * 1e-6)
    assert columns_on(OPERATIONS, store.work_of(found.files["read_out.npz"]))[
        "energy_uj"
    ].tolist() == pytest.approx([(100 * 4.6 + 3 * 0.9) * 1e-6, (200 * 4.6 + 6 * 0.9) * 1e-6])


def test_a_classifier_of_8_bits_takes_a_byte_per_number(answered, dataset):
    chip = load("asic45_memory")
    of_bits = {}
    for bits in (None, 8, 64):
        said = replace(answered, validation=replace(answered.validation, stored_bits=bits))
        numbers = measure(said, dataset, NO_GRID, [chip]).numbers
        of_bits[bits] = numbers.columns["memory_bytes"], numbers.hardware["asic45_memory"]["energy_uj"]
    assert [of_bits[bits][0] for bits in (None, 8, 64)] == [80, 20, 160]
    assert of_bits[8][1] < of_bits[None][1]  # multiplied and read as bytes


def test_a_network_is_priced_by_its_additions_too(outcome, dataset):
    found = measure(outcome, dataset, GRID, [OPERATIONS])
    assert found.numbers.hardware["op_4.6_0.9"]["energy_uj"] == pytest.approx(48 * 0.9e-6)
    on_it = columns_on(OPERATIONS, store.work_of(found.files["surface.npz"]))
    assert set(on_it) == {"energy_uj", "energy_uj_low", "energy_uj_high"}
    assert on_it["energy_uj"].shape == (1, 1)


_HEADS = (
    Head("texture", ("felt", "silk"), np.array([0, 1, 1])),
    Head("speed", ("slow", "fast"), np.array([0, 0, 1])),
)


def test_a_joint_net_is_measured_head_by_head(outcome, dataset):
    output = np.zeros((3, 4, 4), np.uint8)
    output[0, :, 0] = output[0, :, 2] = 1  # felt, slow
    output[1, :, 1] = output[1, :, 3] = 1  # silk, fast
    output[2, :, 0] = output[2, :, 3] = 1  # felt, fast: nothing that was ever felt
    said = outcome.validation
    assert isinstance(said, Response)
    joint = replace(
        dataset,
        target=np.array([0, 1, 0, 2, 1, 0]),
        classes=("felt|slow", "silk|slow", "silk|fast"),
        heads=_HEADS,
    )
    network = Network((_layer(5, 3), _layer(4, 5)), 3, (0,), 1, "integer")
    made = replace(outcome, network=network, validation=replace(said, output=output), test=None)
    found = measure(made, joint, DecisionGrid(np.array([0]), np.array([0.5])), [])
    assert found.numbers.columns["accuracy"] == pytest.approx(2 / 3)
    assert found.numbers.columns["accuracy_texture"] == pytest.approx(2 / 3)
    assert found.numbers.columns["accuracy_speed"] == pytest.approx(2 / 3)
    assert found.files["confusion_texture.npz"]["validation"].tolist() == [[1, 0], [1, 1]]
    assert found.files["surface_speed.npz"]["accuracy"].item() == pytest.approx(2 / 3)
    assert found.files["confusion.npz"]["validation"].tolist() == [[1, 0, 0], [0, 0, 0], [0, 0, 1]]
    assert "surface.npz" not in found.files and "t_p_ms" not in found.numbers.columns
    assert found.numbers.columns["itr_bits"] == pytest.approx(np.log2(3))  # no two of them are answered alike
    assert found.numbers.columns["recall_macro"] == pytest.approx((1 + 0 + 1) / 3)  # felt, fast is no class
    assert found.numbers.columns["precision_macro"] == pytest.approx((1 + 0 + 1) / 3)
    assert found.numbers.of_heads["speed"].columns["n_weights"] == found.numbers.columns["n_weights"] == 35


def test_answers_to_joint_classes_are_answers_of_heads(answered, dataset):
    joint = replace(
        dataset,
        target=np.array([0, 1, 0, 2, 1, 0]),
        classes=("felt|slow", "silk|slow", "silk|fast"),
        heads=_HEADS,
    )
    found = measure(answered, joint, NO_GRID, [])
    assert found.numbers.columns["accuracy"] == pytest.approx(1 / 3)
    assert found.numbers.of_heads["texture"].columns["accuracy"] == pytest.approx(2 / 3)
    assert found.numbers.of_heads["speed"].columns["accuracy"] == pytest.approx(2 / 3)


def test_ties_go_to_the_lowest_class_and_counts_do_not_overflow():
    output = np.zeros((2, 300, 3), np.uint8)
    output[0, :, 1:] = 1
    output[1, :290, 1] = 1  # 290 does not fit a byte
    output[1, :200, 0] = 1
    assert read_out(output).tolist() == [1, 1]


def test_what_pruning_removed_costs_nothing(outcome, dataset):
    assert isinstance(outcome.network, Network) and isinstance(outcome.validation, Response)
    whole = measure(outcome, dataset, NO_GRID, [LOIHI])
    first, last = outcome.network.layers
    kept = np.array(first.weight)
    kept[:3] = 0  # each of the 3 inputs reaches 2 of 5 neurons
    network = replace(outcome.network, layers=(replace(first, weight=kept), last))
    said = replace(outcome.validation, synapses=(2.0, 2.0, 0.0))
    made = replace(outcome, network=network, validation=said)
    found = measure(made, dataset, NO_GRID, [LOIHI])
    assert found.numbers.columns["n_weights"] == 2 * 3 + 5 * 2
    assert found.numbers.columns["synaptic_operations"] == 8 * 2 + 4 * 2
    assert found.numbers.columns["spikes_total"] == whole.numbers.columns["spikes_total"]
    chip = "loihi1_silicon"
    assert (
        found.numbers.hardware[chip]["energy_dynamic_uj"] < whole.numbers.hardware[chip]["energy_dynamic_uj"]
    )


def test_several_networks_in_one_are_measured_but_on_no_chip(outcome, dataset):
    assert isinstance(outcome.validation, Response)
    said = replace(outcome.validation, synapses=(5.0, 2.0, 0.0))
    together = Parameters({"n_weights": np.array(25)}, 3)
    made = replace(outcome, network=together, validation=said)
    chips = [LOIHI, OPERATIONS]
    found = measure(made, dataset, GRID, chips)
    whole = measure(outcome, dataset, GRID, chips)
    rates = {"input_spike_rate_hz", "spike_rate_hz"}  # how many neurons there are it does not say
    assert found.numbers.columns == {
        name: x for name, x in whole.numbers.columns.items() if name not in rates
    }
    own, others = (x.files["surface.npz"] for x in (found, whole))
    assert rates.isdisjoint(own)
    same = (name for name in others if name not in rates and "/" not in name)
    assert all(np.array_equal(own[name], others[name]) for name in same)
    assert found.numbers.hardware["op_4.6_0.9"] == pytest.approx(whole.numbers.hardware["op_4.6_0.9"])
    assert found.numbers.hardware["loihi1_silicon"] == {}


def test_a_response_without_steps_is_refused(outcome, dataset):
    nothing = replace(outcome.validation, output=outcome.validation.output[:, :0])
    with pytest.raises(
        ValueError, match=r"must have at least one sample and one step, got output of shape \(3, 0, 2\)"
    ):
        measure(replace(outcome, validation=nothing), dataset, NO_GRID, [])
