"""What a file alone shows to be wrong: every fault with its line, before anything is read or trained."""

import pytest

from dse.config import load_space
from dse.study.preview import preview
from tests.spaces import SPACE, faults_of, write_space

TEACHERS = "; known: columns, kernel_snn, kernels, linear, mlp, snn, tcn"


def with_sections(folder, **sections):
    """Write the small search space with other sections; those that it lacks are line 21."""
    text = SPACE
    for name, written in sections.items():
        before = [line for line in text.splitlines() if line.startswith(f"{name}:")] or [""]
        text = text.replace(before[0], f"{name}: {written}") if before[0] else f"{text}{name}: {written}\n"
    return write_space(folder, text=text)


def snn(keys):
    return {"model": f"{{kind: snn, {keys}}}"}


def resonator(keys):
    return snn(f"neuron: resonator, {keys}") | {"hardware": "[]"}


CASES = [
    # Delays
    (snn("max_delay: 63"), ["14: model.max_delay must be in [0, 62], got 63"]),
    (snn("max_delay: 16"), ["14: model.max_delay must be below the network steps of the window, 16: later"]),
    (
        snn("input_delays: {choice: [[0], [0, 16]]}"),
        ["14: model.input_delays must be below the steps of the window, 16: later spikes are lost, got 16"],
    ),
    (snn("max_delay: 9, delayed_layers: last"), ["14: unknown model.delayed_layers 'last'"]),
    (
        snn("max_delay: 9, input_delays: [0, 5]"),
        ["14: model.input_delays must be [0] where synapses have delays"],
    ),
    (
        snn("max_delay: 9")
        | {
            "hardware": "[mcu_m4, xylo_imu, loihi2_scenario, spinnaker2, asic45_memory, loihi1_silicon]",
            "execution": "{jobs: 1, device: cuda}",
        },
        [
            "14: model.max_delay must be 0 on execution.device cuda, got 9",
            "17: hardware 'xylo_imu' cannot delay synapses (model.max_delay 9)",
            "17: hardware 'spinnaker2' cannot delay synapses (model.max_delay 9)",
        ],
    ),
    # Resonators
    (resonator("period: [1.5, 40]"), ["14: model.period must be at least 2 input steps, got 1.5"]),
    (resonator("period: [40, 3]"), ["14: model.period must have bounds in increasing order, got [40"]),
    (resonator("quality: [5, 1]"), ["14: model.quality must have bounds in increasing order, got [5"]),
    (resonator("share: 0"), ["14: model.share must be in (0, 1], got 0"]),
    (
        resonator("period: [15, 200], period_unit: ms"),
        ["14: model.period must be at least 2 input steps of 10 ms, got 15 ms"],
    ),
    (
        resonator("period: [2, 80], period_unit: {choice: [steps, Hz]}"),
        ["14: model.period must be at least 2 input steps of 10 ms, got 80 Hz"],
    ),
    (resonator("period_unit: s"), ["14: unknown model.period_unit 's'"]),
    (
        snn("neuron: resonator")
        | {"hardware": "[mcu_m4, xylo_imu, loihi2_scenario, op_4.6_0.9, loihi1_silicon]"},
        [
            f"17: hardware '{name}' cannot run neuron resonator: its neurons cannot be programmed"
            for name in ("xylo_imu", "loihi1_silicon")
        ],
    ),
    # The teacher
    *(
        ({"training": f"{{epochs: 1, teacher: {teacher}}}"}, [f"15: {fault}"])
        for teacher, fault in (
            ("mpl", f"unknown training.teacher.kind 'mpl'{TEACHERS}. Did you mean 'mlp'?"),
            ("knn", f"unknown training.teacher.kind 'knn'{TEACHERS}"),
            ("7", "training.teacher must be text or a mapping or null, got 7"),
            ("{hidden: 300}", f"training.teacher.kind is required{TEACHERS}"),
            ("{kind: 3}", f"unknown training.teacher.kind 3{TEACHERS}"),
            ("{kind: mlp, hiden: 300}", "unknown key 'training.teacher.hiden'; known: window_ms"),
            ("{kind: mlp, hidden: 0}", "training.teacher.hidden[0] must be >= 1, got 0"),
            ("{kind: mlp, hidden: {choice: [1, 2]}}", "training.teacher.hidden cannot be an axis; it must"),
            ("{choice: [mlp, mpl]}", f"unknown training.teacher.choice[1].kind 'mpl'{TEACHERS}. Did you"),
            ("{kind: snn, hidden: []}", "training.teacher.hidden must have 1 to 3 layers, got 0"),
        )
    ),
    # The evaluation
    *(
        ({"evaluation": evaluation}, [f"21: evaluation{fault}"])
        for evaluation, fault in (
            ("{}", " needs shifts or leave_out"),
            ("{shifts: []}", ".shifts must hold at least one shift, got []"),
            ("{shifts: [2, 2]}", ".shifts must hold each entry once, got 2 twice"),
            ("{shifts: [0.5]}", ".shifts[0] must be an integer, got 0.5"),
            ("{leave_out: []}", ".leave_out must hold at least one column, got []"),
            ("{leave_out: [speed, {column: speed}]}", ".leave_out must hold each entry once, got 'speed'"),
            ("{leave_out: {column: speed, folds: 1}}", ".leave_out.folds must be >= 2, got 1"),
        )
    ),
    (
        {"evaluation": "{shifts: [2]}", "window": "{at: middle}"},
        ["21: evaluation.shifts needs window.n_steps"],
    ),
    (
        {"evaluation": "{leave_out: [sped, fabric]}"},
        [
            "21: evaluation.leave_out must be among data.columns, got 'sped'; known: fabric, speed",
            "21: evaluation.leave_out must not be the target, got 'fabric', which task.target predicts",
        ],
    ),
    (
        {
            "evaluation": "{leave_out: speed}",
            "task": "{target: {choice: [fabric, {column: speed, abs: true}]}}",
        },
        ["21: evaluation.leave_out must not be the target, got 'speed', which task.target predicts"],
    ),
    (
        {"evaluation": "{shifts: [2]}", "objectives": "[accuracy_unseen:max, accuracy_shifted:max]"},
        ["18: objective 'accuracy_unseen' needs leave_out in section 'evaluation', got none"],
    ),
    ({"training": "{epochs: 1, crops: 3}"}, ["15: training.crops needs window.jitter_steps > 0, got 0"]),
    # Other precisions
    *(
        ({"precision": precision}, [f"21: {fault}" for fault in faults])
        for precision, *faults in (
            ("", "precision.weight_bits is required: bits per weight"),
            ("4", "precision must be a mapping of keys to values, got 4"),
            (
                *("{weight_bits: [1, 9]}", "precision.weight_bits[0] must be in [2, 8], got 1"),
                "precision.weight_bits[1] must be in [2, 8], got 9",
            ),
            ("{weight_bits: [true]}", "precision.weight_bits[0] must be an integer, got true"),
            ("{weight_bits: []}", "precision.weight_bits must hold at least one value, got []"),
            ("{weight_bits: 4, pruned: []}", "precision.pruned must hold at least one value, got []"),
            ("{weight_bits: 4, pruned: [1.0]}", "precision.pruned[0] must be in [0, 1), got 1"),
            ("{weight_bits: 4, within: -1}", "precision.within must be in [0, 1], got -1"),
            ("{weight_bits: 4, bits: 2}", "unknown key 'precision.bits'; known: weight_bits, pruned, within"),
            ("{weight_bits: {choice: [4, 8]}}", "precision.weight_bits cannot be an axis"),
        )
    ),
    # The grid of decisions
    *(
        ({"decision": decision}, [f"16: {fault}"])
        for decision, fault in (
            ("{phi: {up_to: inputs}}", "unknown decision.phi.up_to 'inputs'; known: outputs"),
            ("{phi: {up_to: outputs, step: 0}}", "decision.phi.step must be >= 1, got 0"),
            ("{phi: {step: 5}}", "decision.phi.up_to is required"),
            ("{phi: [0, {up_to: outputs}]}", "decision.phi must be integers, or up_to and step alone"),
            ("{theta: {range: [0, 1]}}", "decision.theta is evaluated on a grid, so its range needs a step"),
            ("{read_out_every_ms: 0}", "decision.read_out_every_ms must be > 0, got 0"),
        )
    ),
    # Racing, the end of a search, earlier studies, a cluster
    *(
        ({"search": f"{{sampler: grid, {search}}}"}, [f"19: {fault}"])
        for search, fault in (
            ("racing: {rungs: [1]}", "search.racing.rungs must be below training.epochs, 1, got 1"),
            ("racing: {rungs: [3, 2]}", "search.racing.rungs must be at least one number of epochs, rising"),
            ("racing: {rungs: [2, 2]}", "search.racing.rungs must be at least one number of epochs, rising"),
            ("racing: {rungs: []}", "search.racing.rungs must be at least one number of epochs, rising"),
            ("racing: {rungs: [0.1, 1.5]}", "search.racing.rungs must be whole numbers of epochs, or shares"),
            ("racing: {rungs: [0]}", "search.racing.rungs"),
            ("racing: {rungs: [2], eta: 1}", "search.racing.eta must be"),
            ("racing: {rungs: [2], ladder: 3}", "unknown key 'search.racing.ladder'"),
            ("racing: {eta: 2}", "search.racing.rungs is required"),
            ("stop: {minutes: 0}", "search.stop.minutes must be > 0, got 0"),
            ("stop: {}", "search.stop.minutes is required"),
            ("stop: {cpu_hours: 1, minutes: 2}", "unknown key 'search.stop.cpu_hours'; minutes ends"),
            ("front_undecided: [0.1, 0.9]", "unknown key 'search.front_undecided'; repeats_on_front"),
            ("from: [a]", "unknown key 'search.from'; every study trains its own designs"),
        )
    ),
    (
        {"execution": "{address: 'tcp://nowhere:1'}"},
        ["20: execution.address needs execution.backend dask, got loky"],
    ),
    (
        {"execution": "{backend: dask, address: 'tcp://nowhere:1', scheduler_file: s.json}"},
        ["20: execution.scheduler_file must be absent where execution.address"],
    ),
]


@pytest.mark.parametrize(("sections", "faults"), CASES)
def test_every_fault_has_its_line(tmp_path, sections, faults):
    found = faults_of(with_sections(tmp_path, **sections))
    assert len(found) == len(faults), found
    for fault, begin in zip(found, faults, strict=True):
        assert fault.startswith(begin), found


@pytest.mark.parametrize(
    ("sections", "n_designs"),
    [
        (snn("max_delay: 31, steps_per_sample: 2"), 2),
        # One length of two is enough, and one design that a chip can run.
        (snn("input_delays: [0, 16]") | {"window": "{n_steps: {choice: [8, 17]}, at: middle}"}, 4),
        (snn("max_delay: {choice: [0, 9]}") | {"hardware": "[xylo_imu]"}, 4),
    ],
)
def test_what_some_designs_can_is_no_fault(tmp_path, sections, n_designs):
    assert load_space(with_sections(tmp_path, **sections)).n_designs == n_designs


@pytest.mark.parametrize(
    ("model", "n_designs"),
    [
        ("{kind: snn, neuron: {choice: [cuba_lif, resonator]}, share: {choice: [0.5, 1.0]}}", 6),
        ("{choice: [knn, {kind: snn, neuron: resonator}]}", 4),
    ],
)
def test_a_chip_that_cannot_run_some_of_the_neurons_prices_the_others(tmp_path, model, n_designs):
    space = load_space(with_sections(tmp_path, model=model))
    assert space.n_designs == n_designs
    without = "neuron resonator: the neurons of loihi1_silicon cannot be programmed"
    assert preview(space)["without_costs"] == without
    other = load_space(tmp_path / "tiny.yaml", {"hardware": "[loihi1_silicon, mcu_m4]"})
    assert "without_costs" not in preview(other)
