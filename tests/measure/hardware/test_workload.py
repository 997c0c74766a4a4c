import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.base.records import Workload
from dse.config.faults import ConfigError
from dse.measure.hardware.cost import cost_of_steps
from dse.measure.hardware.inference import expected_updates
from dse.measure.hardware.profile import load
from dse.measure.hardware.workload import load_inference, read_inference

PROFILE = load("loihi1_silicon")
NET = "layers: [24, 50, 7]\nn_steps: 100\nmean_rate: [0.02, 0.1, 0]\n"


def faults_of(text):
    with pytest.raises(ConfigError) as caught:
        read_inference(text, "w")
    return [str(fault).removeprefix("w:") for fault in caught.value.faults]


def of_network(text):
    load = read_inference(text, "w").load
    assert isinstance(load, Workload)
    return load


def test_mean_rates():
    found = read_inference(NET, "w")
    net = of_network(NET)
    assert (net.sizes, net.recurrent) == ((24, 50, 7), (False, False))
    assert net.n_steps == 100
    assert net.spikes == pytest.approx([0.02 * 24 * 100, 0.1 * 50 * 100, 0])
    assert (net.step_ms, net.weight_bits, net.delay_bits, net.stored, net.cores) == (1.0, 8, 0, None, None)
    assert (found.per_step, found.n_weights, found.decision_ms) == (False, 24 * 50 + 50 * 7, 100.0)


def test_the_number_of_weights():
    # "2.59e6" in print.
    dense = "layers: [6084, 425, 12]\nn_steps: 1\nmean_rate: [0, 0, 0]\n"
    assert read_inference(dense, "w").n_weights == 2_590_800
    assert read_inference(dense + "recurrent: [true, false]\n", "w").n_weights == 2_590_800 + 425**2
    assert read_inference(dense + "stored: [1000, 70]\n", "w").n_weights == 1070


def test_spikes_per_step_and_all_other_keys():
    net = of_network(
        "layers: [24, 50, 7]\nn_steps: 20\nspikes: [0.5, 2, 0.25]\nupdates: [50, 3.5]\n"
        "recurrent: [true, false]\nmapping: [2, 1]\nstored: [1850, 70]\n"
        "step_ms: 2.5\nweight_bits: 4\ndelay_bits: 6\n"
    )
    assert net.spikes.tolist() == [10, 40, 5]
    assert net.updates.tolist() == [1000, 70]
    assert (net.recurrent, net.cores, net.stored) == ((True, False), (2, 1), (1850, 70))
    assert (net.step_ms, net.weight_bits, net.delay_bits) == (2.5, 4, 6)
    # Half of 24 x 50 + 50 x 50 weights are left, and a fifth of 50 x 7.
    assert net.synapses == pytest.approx((25, 0.2 * 7 + 25, 0))


def test_a_mapping_for_each_layer_says_the_same():
    flat = of_network(
        "layers: [24, 50, 7]\nn_steps: 20\nspikes: [0.5, 2, 0.25]\nupdates: [50, 3.5]\n"
        "recurrent: [true, false]\nmapping: [2, 1]\nstored: [1850, 70]\n"
    )
    nested = of_network(
        "layers:\n- {neurons: 24, spikes: 0.5}\n"
        "- {neurons: 50, mean_rate: 0.04, updates: 50, recurrent: true, cores: 2, stored: 1850}\n"
        "- {neurons: 7, spikes: 0.25, updates: 3.5, cores: 1, stored: 70}\nn_steps: 20\n"
    )
    assert repr(nested) == repr(flat)


def test_json_is_read_as_well(tmp_path):
    file = tmp_path / "w.json"
    content = {"layers": [24, 50, 7], "n_steps": 100, "mean_rate": [0.02, 1e-1, 0]}
    for indent in (None, 1, "\t"):
        file.write_text(json.dumps(content, indent=indent))
        assert repr(load_inference(file)) == repr(read_inference(NET, "w"))


def test_counts_of_each_step():
    text = "layers: [3, 2, 1]\nn_steps: 2\nspikes: [[3, 0], [1, 2], [0, 1]]\nupdates: [[2, 1], 1]\n"
    found = read_inference(text, "w")
    net = of_network(text)
    assert found.per_step
    assert net.spikes.tolist() == [[3, 1, 0], [0, 2, 1]]
    assert net.updates.tolist() == [[2, 1], [1, 1]]
    assert net.n_steps.tolist() == [1, 1]
    assert found.counts_on(PROFILE).tolist() == [2, 3, 3, 1, 3, 2]
    assert found.cost_on(PROFILE).hardware_latency_ms == cost_of_steps(PROFILE, net).hardware_latency_ms


def test_a_step_with_many_spikes_takes_longer_than_the_mean_says():
    net = "layers: [3, 200]\nn_steps: 2\nupdates: [200]\n"
    burst = read_inference(net + "spikes: [[3, 0], [0, 200]]\n", "w").cost_on(PROFILE)
    mean = read_inference(net + "spikes: [1.5, 100]\n", "w").cost_on(PROFILE)
    # First step: 3 messages in with 200 synapses each; second: 200 neurons fire; always 200 updates.
    first, second = 0.6 + 3 * (16 + 200 * 3.8) * 1e-3, 0.6 + 200 * (6 + 3.7 + 30) * 1e-3
    assert burst.hardware_latency_ms == pytest.approx((first + second) * 1e-3)
    assert mean.hardware_latency_ms == pytest.approx(2e-3 * (0.6 + 200 * (6 + 3.7 + 15) * 1e-3))
    assert burst.dynamic_uj == pytest.approx(mean.dynamic_uj)


@given(st.lists(st.floats(0, 1), min_size=3, max_size=3), st.integers(1, 20))
def test_a_mean_is_the_same_count_in_every_step(rates, n_steps):
    spikes = [rate * size for rate, size in zip(rates, (24, 50, 7), strict=True)]
    head = f"layers: [24, 50, 7]\nn_steps: {n_steps}\nupdates: [50, 7]\n"
    mean = read_inference(f"{head}spikes: {spikes}\n", "w").cost_on(PROFILE)
    listed = read_inference(f"{head}spikes: {[[x] * n_steps for x in spikes]}\n", "w").cost_on(PROFILE)
    for name in ("energy_uj", "energy_throttled_uj", "step_time_us"):
        of_list, of_mean = (list(map(float, getattr(priced, name))) for priced in (listed, mean))
        assert of_list == pytest.approx(of_mean, rel=1e-9)


def test_no_steps_are_exact_zeros():
    for counts in ("mean_rate: [0.5, 0.5, 0.5]", "spikes: [[], [], []]", "spikes: [[], 1, 0]"):
        found = read_inference(f"layers: [24, 50, 7]\nn_steps: 0\n{counts}\n", "w").cost_on(PROFILE)
        assert found.energy_uj.value == found.energy_uj.high == found.energy_throttled_uj.high == 0
        assert found.step_time_us.value == found.hardware_latency_ms == found.pipeline_ms == 0


def test_updates_that_are_not_given_are_expected_from_the_rates():
    net = of_network(NET)
    assert net.updates == pytest.approx(expected_updates((24, 50, 7), (0.02, 0.1, 0), 100))
    # A listed count has its mean as rate; half of the weights are half of the inputs of a neuron.
    listed = of_network("layers: [4, 2]\nn_steps: 2\nspikes: [[1, 3], 0]\nstored: [4]\n")
    assert listed.updates == pytest.approx([expected_updates((4, 2), (0.5, 0), 2, (2.0,)).item() / 2] * 2)
    silent = of_network(NET.replace("0.02, 0.1", "0, 0"))
    assert silent.updates == pytest.approx(np.zeros(2), abs=0)


def test_steps_through_the_layers_are_what_the_hardware_takes_unless_given():
    counted = load("op_4.6_0.9")
    for text, on_mesh, elsewhere in ((NET, 2, 0), (NET + "pipeline_steps: 5\n", 5, 5)):
        found = read_inference(text, "w")
        assert found.on(PROFILE).pipeline_steps == on_mesh
        assert found.on(counted).pipeline_steps == elsewhere
        assert found.cost_on(PROFILE).pipeline_ms == on_mesh


def test_counted_operations():
    text = "macs: 12000\nadditions: 300\nn_weights: 5000\nduration_ms: 250\nnumber_bits: 8\n"
    found = read_inference(text, "w")
    assert (found.load.macs, found.load.additions, found.load.updates) == (12000, 300, 0)
    assert (found.load.number_bits, found.n_weights, found.decision_ms) == (8, 5000, 250)
    expected = 12000 * 4.6e-6 + 300 * 0.9e-6
    assert found.cost_on(load("op_4.6_0.9")).energy_uj.value == pytest.approx(expected)


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (("[0.02, 0.1, 0]", "[0.02, 1.1, 0]"), "3: mean_rate[1] must be in [0, 1], got 1.1"),
        (("[0.02, 0.1, 0]", "[0.02, -0.1, 0]"), "3: mean_rate[1] must be in [0, 1], got -0.1"),
        (("[0.02, 0.1, 0]", "[0.02, .nan, 0]"), "3: mean_rate[1] must be a finite number, got nan"),
        (("[0.02, 0.1, 0]", "[0.02, high, 0]"), "3: mean_rate[1] must be a number, got 'high'"),
        (("[0.02, 0.1, 0]", "[0.02, [0.1, 0.1], 0]"), "3: mean_rate[1] must be one number, got a list; use"),
        (("[0.02, 0.1, 0]", "[0.02, 0.1]"), "3: mean_rate must be a list of 3, one per layer, got 2 of them"),
        (("[0.02, 0.1, 0]", "0.02"), "3: mean_rate must be a list of 3, one per layer, got 0.02"),
        (("mean_rate: [0.02, 0.1, 0]", ""), "1: a workload must have either spikes or mean_rate, got"),
        (("mean_rate: [0.02", "spikes: [25"), "3: spikes[0] must be in [0, 24], got 25"),
        (("mean_rate: [0.02, ", "spikes: [[1, 2], "), "3: spikes[0] must have n_steps = 100 counts, got 2"),
        (("n_steps: 100\n", ""), "1: n_steps is required: network steps of an inference"),
        (("n_steps: 100", "n_steps: -1"), "2: n_steps must be in [0, 1000000000], got -1"),
        (("n_steps: 100", "n_steps: .inf"), "2: n_steps must be an integer, got inf"),
        (("[24, 50, 7]", "[24, 0, 7]"), "1: layers[1] must be in [1, 10000000], got 0"),
        (("[24, 50, 7]", "[24, 50.5, 7]"), "1: layers[1] must be an integer, got 50.5"),
        (("[24, 50, 7]", "[24]"), "1: layers must be a list of an input and at least one layer, got [24]"),
        (("[24, 50, 7]", "24"), "1: layers must be a list of an input and at least one layer, got 24"),
        (("n_steps", "step_ms: 0\nn_steps"), "2: step_ms must be in (0, 1000000000], got 0"),
        (("n_steps", "weight_bits: 0\nn_steps"), "2: weight_bits must be in [1, 64], got 0"),
        (("n_steps", "macs: 5\nn_steps"), "2: unknown key 'macs'; known: "),
        (("n_steps", "updates: [51, 7]\nn_steps"), "2: updates[0] must be in [0, 50], got 51"),
        (("n_steps", "updates: [24, 50, 7]\nn_steps"), "2: updates must be a list of 2, one per layer"),
        (("n_steps", "recurrent: [1, false]\nn_steps"), "2: recurrent[0] must be true or false, got 1"),
        (("n_steps", "mapping: [2, 8]\nn_steps"), "2: mapping[1] must be in [1, 7], got 8"),
        (("n_steps", "stored: [1200, 351]\nn_steps"), "2: stored[1] must be in [0, 350], got 351"),
    ],
)
def test_one_mistake_has_its_line_and_what_is_allowed(change, fault):
    (found,) = faults_of(NET.replace(*change))
    assert found.startswith(fault)


def test_a_key_that_is_misspelt_is_missing_as_well():
    missing, unknown = faults_of(NET.replace("mean_rate", "mean_rates"))
    assert missing == "1: a workload must have either spikes or mean_rate, got neither"
    assert unknown.startswith("3: unknown key 'mean_rates'; known: n_steps, step_ms, weight_bits, ")
    assert unknown.endswith("Did you mean 'mean_rate'?")


def test_spikes_or_rates_but_not_both():
    assert faults_of(NET + "spikes: [1, 1, 1]\n") == [
        "3: a workload must have either spikes or mean_rate, got both"
    ]


def test_every_fault_of_a_file_at_once():
    assert faults_of(
        "layers:\n"
        "- {neurons: 24, mean_rate: 1.2, updates: 3}\n"
        "- {neurons: 50, mean_rate: 0.1, spikes: 3, coers: 2, cores: 2}\n"
        "- {neurons: 7}\n"
        "- 12\n"
        "n_steps: 3\nmapping: [1, 1]\nweight_bit: 8\n"
    ) == [
        "2: key 'updates' in layers[0] does not apply to the input; known: neurons, spikes, mean_rate",
        "2: layers[0].mean_rate must be in [0, 1], got 1.2",
        "3: key 'coers' in layers[1] is unknown; known: neurons, spikes, mean_rate, updates, recurrent, "
        "cores, stored, resonators. Did you mean 'cores'?",
        "3: layers[1] must have either spikes or mean_rate, got both",
        "4: layers[2] must have either spikes or mean_rate, got neither",
        "4: layers[2] must have cores, because other layers do",
        "5: layers[3] must be a mapping like the others, got 12",
        "7: mapping must be given in each layer (as cores) if layers are mappings",
        "8: unknown key 'weight_bit'; known: n_steps, step_ms, weight_bits, delay_bits, pipeline_steps, "
        "layers, spikes, mean_rate, updates, recurrent, mapping, stored, resonators. Did you mean "
        "'weight_bits'?",
    ]


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        (
            "",
            [
                "1: a workload must have either layers (a network) or macs and additions (any other "
                "classifier)"
            ],
        ),
        ("- 1\n", ["1: a workload must be a mapping of keys to values, got [1]"]),
        ("macs: 1\nadditions: 2\nn_weights: 3\n", ["1: duration_ms is required: length of the input"]),
        (
            "macs: -1\nadditions: .nan\nn_weights: 3\nduration_ms: 0\nlayer: 3\n",
            [
                "1: macs must be in [0, 1e+18], got -1.0",
                "2: additions must be a finite number, got nan",
                "4: duration_ms must be in (0, 1000000000], got 0.0",
                "5: unknown key 'layer'; known: macs, additions, n_weights, duration_ms, updates, "
                "number_bits",
            ],
        ),
    ],
)
def test_what_is_no_workload(text, faults):
    assert faults_of(text) == faults


def test_what_cannot_be_read(tmp_path):
    (tmp_path / "torn.yaml").write_text("layers: [\n")
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00")
    for name, message in [
        ("torn.yaml", r"torn\.yaml:2: not valid YAML"),
        ("binary.yaml", r"binary\.yaml: cannot be read: not UTF-8"),
        ("none.yaml", r"none\.yaml: cannot be read: No such file"),
        ("", "cannot be read: Is a directory"),
    ]:
        with pytest.raises(ConfigError, match=message):
            load_inference(tmp_path / name)
