from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from dse.base import registry
from dse.base.records import Events, Rasters, Signals
from dse.base.registry import param, register
from dse.config import ConfigError, SearchSpace, Sections, load_space, shipped_spaces
from dse.config.resolved import front_end
from dse.config.settings import Task, Training
from dse.data.recordings import EventSource
from dse.data.recordings.scene import Trials
from tests.installed import needs_papers
from tests.spaces import SPACE, faults_of, write_space


def test_a_file_without_faults(tmp_path):
    space = load_space(write_space(tmp_path), check_data=True)
    assert (space.study, space.seed, space.source) == ("tiny", 3, tmp_path / "tiny.yaml")
    assert list(space.axes) == ["encoder.thresholds", "model.hidden"]
    assert space.axes["model.hidden"].values == (4, 8, 12)
    assert space.axes["encoder.thresholds"].values == ((1.0, 2.0), (1.0, 2.0, 4.0))
    assert space.decision.phi.tolist() == [0, 2]
    assert space.decision.theta.tolist() == [0.25, 0.5, 0.75]
    assert space.decision.phi.dtype == np.int64
    assert space.objectives == (("accuracy", "max"), ("n_weights", "min"))
    assert space.hardware == ("loihi1_silicon",)
    assert (space.search.sampler_name, space.search.n_trials, space.search.batch) == ("grid", None, 2)
    assert space.execution.jobs == 1
    assert space.parts["task"].fixed == Task("fabric", joint=False, name="fabric")
    assert "hidden" not in space.parts["model"].values
    assert space.parts["training"].fixed == Training(epochs=1, batch_size=8)
    assert set(space.to_plain()["training"]) > {"epochs", "learning_rate"}  # defaults are written out


def test_a_grid_is_proposed_at_once_and_others_in_batches(tmp_path):
    absent = ("sampler: grid, batch: 2", "sampler: grid")
    assert load_space(write_space(tmp_path, absent)).search.batch == 6
    learning = ("sampler: grid, batch: 2", "sampler: tpe, n_trials: 30")
    assert load_space(write_space(tmp_path, learning)).search.batch == 8


def test_six_mistakes_of_six_kinds_are_all_listed(tmp_path):
    path = write_space(
        tmp_path,
        ("kind: send_on_delta", "kind: send_on_detla"),
        ("hidden: {choice: [4, 8, 12]}", "hiden: {choice: [4, 8, 12]}"),
        ("true_rate: 0.8", "true_rate: 1.8"),
        ("epochs: 1,", "epochs: {range: [9, 1], step: 1},"),
        ("accuracy:max", "acuracy:max"),
        ("batch: 2", "batch: two"),
    )
    *faults, last = faults_of(path)
    assert [fault.split(";")[0] for fault in faults] == [
        "13: unknown encoder.kind 'send_on_detla'",
        "14: unknown key 'model.hiden'",
        "14: model.true_rate must be in [0, 1], got 1.8",
        "15: training.epochs.range must be in increasing order, got [9, 1]",
        "18: unknown objective 'acuracy'",
    ]
    assert last == "19: search.batch must be an integer, got 'two'"
    for fault, name in zip(
        (faults[0], faults[1], faults[4]), ("send_on_delta", "hidden", "accuracy"), strict=True
    ):
        assert fault.endswith(f"Did you mean '{name}'?")


def test_listing_faults_imports_no_heavy_library(tmp_path):
    path = write_space(
        tmp_path, ("kind: snn", "kind: sn"), ("seed: 3", "seed: x"), ("epochs: 1", "epochs: 0")
    )
    code = (
        "import sys\n"
        "from dse.cli import main\n"
        "assert main(['check', sys.argv[1]]) == 2\n"
        "print(*{'torch', 'optuna', 'pandas', 'plotly', 'sklearn'} & sys.modules.keys())"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parents[2],
    )
    assert len(done.stderr.splitlines()) == 3, done.stderr
    assert done.stdout.split() == []


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        ("study: tiny", "study: a/b", "1: study must be valid as a folder name, got 'a/b'"),
        ("study: tiny", "study: ..", "1: study must be valid as a folder name, got '..'"),
        ("study: tiny", "study: 5", "1: study must be text, got 5"),
        ("seed: 3", "seed: -1", "2: seed must be >= 0, got -1"),
        ("seed: 3", "sed: 3", "2: unknown section 'sed'; known: study, seed, plugins, data, task, window"),
        ("seed: 3", "seed: 3\nseed: 4", "3: duplicate key 'seed', first on line 2"),
        ("kind: time_series", "kind: time_serie", "4: unknown data.kind 'time_serie'; known: "),
        ("  file: touch.npz\n", "", "3: data.file is required: "),
        ("step_ms: 10", "step_ms: {choice: [5, 10]}", "6: data.step_ms cannot be an axis; it must be a"),
        ("target: fabric", "traget: fabric", "8: task.target is required: "),
        ("n_steps: 16", "n_steps: 0", "9: window.n_steps must be >= 1, got 0"),
        ("at: middle", "at: {choice: [start, midle]}", "9: unknown window.at.choice[1] 'midle'; known"),
        ("model: {kind: snn, ", "model: {", "14: model.kind is required; known: "),
        ("kind: snn", "kind: {choice: [snn]}", "14: unknown model.kind {'choice': ['snn']}; known: "),
        ("hidden: {choice: [4, 8, 12]}", "hidden: {choice: [4, [8, 0]]}", "14: model.hidden.choice[1][1]"),
        ("phi: [0, 2]", "phi: [0, -2]", "16: decision.phi.choice[1] must be >= 0, got -2"),
        (", step: 0.25}", "}", "16: decision.theta is evaluated on a grid, so its range needs a step"),
        ("[loihi1_silicon]", "[loihi1]", "17: unknown hardware 'loihi1'; known: "),
        ("accuracy:max", "accuracy:min", "18: objective 'accuracy' must be 'accuracy:max', got"),
        ("accuracy:max", "accuracy:up", "18: objective 'accuracy' must be followed by :max or :min, got"),
        ("accuracy:max", "n_weights", "18: objective 'n_weights' is named twice"),
        ("[accuracy:max, n_weights:min]", "[]", "18: objectives must hold at least one objective; known: "),
        ("[accuracy:max, n_weights:min]", "{accuracy: max}", "18: objectives must be a list of texts, got"),
        ("accuracy:max", "accuracy_test", "18: objective 'accuracy_test' cannot select designs: the test"),
        ("sampler: grid", "sampler: gird", "19: unknown search.sampler 'gird'; known: "),
        ("sampler: grid", "sampler: tpe", "19: search.n_trials is required for sampler 'tpe'"),
        ("sampler: grid", "sampler: nsga2, n_trials: 5, population: 1", "19: search.population must be >="),
        ("sampler: grid", "sampler: grid, population: 4", "19: unknown key 'search.population'; known"),
        ("true_rate: 0.8", "true_rate: {range: [0.5, 0.9]}", "14: model.true_rate needs a step or a choice"),
        ("jobs: 1", "jobs: 0", "20: execution.jobs must be >= 1, got 0"),
        ("jobs: 1", "device: gpu", "20: unknown execution.device 'gpu'; known: cpu, cuda"),
        ("jobs: 1", "memory_gib: 0", "20: execution.memory_gib must be > 0, got 0"),
    ],
)
def test_one_fault_has_one_line(tmp_path, old, new, fault):
    faults = faults_of(write_space(tmp_path, (old, new)))
    matching = [found for found in faults if found.startswith(fault)]
    assert len(matching) == 1, faults
    # A misspelt required key is missing as well; nothing else follows from one mistake.
    assert len(faults) == (2 if "traget" in new else 1), faults


def test_what_the_test_set_measures_needs_a_test_set(tmp_path):
    objective = ("n_weights:min", "spikes_total_no_input:min")
    [fault] = faults_of(write_space(tmp_path, objective))
    assert fault == (
        "18: objective 'spikes_total_no_input' needs a test set: section 'test', or key test of the split"
    )
    split = ("validation: {repetition: [1]}", "validation: {repetition: [1]}\n  test: {repetition: [2]}")
    assert load_space(write_space(tmp_path, objective, split)).objectives[1][0] == "spikes_total_no_input"


def test_what_a_chip_decides_needs_a_chip(tmp_path):
    assert set(registry.columns("hardware")) < set(registry.columns())
    of_test = [name for name, column in registry.columns().items() if not column.selects]
    assert "accuracy_test" in of_test and all("_test" in name for name in of_test)
    path = write_space(tmp_path, ("[loihi1_silicon]", "[]"), ("accuracy:max", "energy_uj"))
    assert faults_of(path) == [
        "18: objective 'energy_uj' needs a hardware profile in section 'hardware', got none"
    ]


def test_missing_sections(tmp_path):
    path = tmp_path / "empty.yaml"
    path.write_text("# nothing here\nseed: 1\n", encoding="utf-8")
    names = ("data", "task", "split", "model")
    assert faults_of(path) == [f"1: section '{name}' is required" for name in names]


def test_study_and_objectives_have_defaults(tmp_path):
    path = write_space(tmp_path, ("study: tiny\n", ""), ("objectives: [accuracy:max, n_weights:min]\n", ""))
    space = load_space(path)
    assert space.study == path.stem
    assert space.objectives == (("accuracy", "max"), ("n_weights", "min"), ("energy_uj", "min"))
    bare = load_space(
        write_space(tmp_path, ("[loihi1_silicon]", "[]"), ("objectives: [accuracy:max, n_weights:min]\n", ""))
    )
    assert bare.objectives == (("accuracy", "max"), ("n_weights", "min"))
    assert faults_of(write_space(tmp_path, ("study: tiny", f"study: {'x' * 201}"))) == [
        "1: study must have at most 200 bytes, as it names a folder, got 201"
    ]


def test_a_search_space_may_be_a_mapping_of_python(tmp_path):
    path = write_space(tmp_path)
    plain = yaml.safe_load(load_space(path).to_yaml())
    space = load_space(plain | {"model": {"kind": "snn", "hidden": {"choice": (np.int64(4), [8])}}})
    assert space.study == "tiny" and space.source.parent == Path()
    assert space.axes["model.hidden"].values == (4, 8)
    with pytest.raises(ConfigError) as error:
        load_space({**plain, "seed": "one", "task": {"target": object}})
    assert str(error.value.faults[0]) == "search space: seed must be an integer, got 'one'"
    assert "search space: task.target must be" in str(error.value)
    with pytest.raises(TypeError, match=r"name of a shipped one, or a mapping of its sections, got int"):
        load_space(3)


def test_a_search_space_is_a_mapping(tmp_path):
    path = tmp_path / "list.yaml"
    path.write_text("- 1\n", encoding="utf-8")
    assert faults_of(path) == ["1: a search space must be a mapping from section names to sections, got [1]"]


def test_a_syntax_error_is_the_only_fault(tmp_path):
    (fault,) = faults_of(write_space(tmp_path, ("target: fabric}", "target: fabric")))
    assert fault.startswith("9: not valid YAML: ")


def test_text_that_is_not_utf8(tmp_path):
    path = tmp_path / "latin.yaml"
    path.write_bytes(b"study: caf\xe9\n")
    assert faults_of(path) == [" cannot be read: not UTF-8 text"]


def test_the_front_end_belongs_to_the_recordings(tmp_path):
    path = write_space(
        tmp_path,
        ("encoder: {kind: send_on_delta", "preprocessing: {bin_ms: 5}\nencodr: {kind: send_on_delta"),
    )
    faults = faults_of(path)
    assert "1: section 'encoder' is required for time_series recordings" in faults
    assert "13: section 'preprocessing' does not apply to time_series recordings" in faults


@pytest.mark.parametrize(
    ("kinds", "section"),
    [
        (Signals, "encoder"),
        (Rasters, None),
        (Events, "preprocessing"),
        (EventSource, "preprocessing"),
        (Trials, "preprocessing"),
        (Events | EventSource, "preprocessing"),
        (Events | Trials, "preprocessing"),
    ],
)
def test_the_front_end_follows_from_what_is_read(kinds, section):
    class Component:
        def read(self, base): ...

    Component.read.__annotations__["return"] = kinds
    assert front_end(Component) == section


def test_a_component_reads_recordings_of_one_kind():
    class Component:
        def read(self, base): ...

    Component.read.__annotations__["return"] = Events | Signals
    with pytest.raises(TypeError, match=r"Component\.read must return recordings of one kind"):
        front_end(Component)


def test_overrides(tmp_path):
    path = write_space(tmp_path)
    space = load_space(path, {"model.hidden": "{choice: [7]}", "execution.jobs": "2", "task.name": "touch"})
    assert space.axes["model.hidden"].values == (7,)
    assert space.execution.jobs == 2
    assert space.parts["task"].values["name"] == "touch"


def test_faults_of_overrides_come_last_and_name_the_key(tmp_path):
    path = write_space(tmp_path, ("epochs: 1", "epochs: 0"))
    faults = faults_of(path, {"model.hidden": "none", "modell.hidden": "3", "seed": "[1"})
    assert faults[0] == "15: training.epochs must be in [1, 1000000], got 0"
    assert sorted(fault.split(":")[0] for fault in faults[1:]) == [
        "--set model.hidden", "--set modell.hidden", "--set seed"
    ]  # fmt: skip


def test_data_faults_are_listed_with_the_others(tmp_path):
    path = write_space(
        tmp_path, ("repetition: repetition", "repetition: repetitoin"), ("epochs: 1", "epochs: 0")
    )
    faults = faults_of(path, check_data=True)
    assert faults[0].startswith("7: ") and "repetitoin" in faults[0]
    assert faults[1] == "15: training.epochs must be in [1, 1000000], got 0"


def test_a_number_at_fault_does_not_hide_a_wrong_array_name(tmp_path):
    path = write_space(
        tmp_path, ("step_ms: 10", "step_ms: -10"), ("repetition: repetition", "repetition: repetitoin")
    )
    faults = faults_of(path, check_data=True)
    assert faults[0] == "6: data.step_ms must be > 0, got -10.0"
    assert faults[1].startswith("7: ") and "repetitoin" in faults[1]


def test_a_missing_data_file_says_where_it_was_looked_for(tmp_path, monkeypatch):
    monkeypatch.setenv("DSE_DATA", "/somewhere/else")
    (fault,) = faults_of(write_space(tmp_path, ("touch.npz", "tuch.npz")), check_data=True)
    assert fault.startswith("5: ")
    assert str(tmp_path) in fault and "/somewhere/else" in fault


def test_the_test_file_takes_the_other_keys_from_data(tmp_path):
    path = write_space(tmp_path, ("encoder:", "test: {file: touch.npz}\nencoder:"))
    space = load_space(path, check_data=True)
    assert space.to_plain()["test"] == {"file": "touch.npz"}
    sections = space.resolve({"encoder.thresholds": (1.0, 2.0), "model.hidden": 4})
    assert sections.test == sections.data == space.data
    assert sections.to_plain()["test"] == {"file": "touch.npz"}
    assert Sections.from_plain(sections.to_plain(), "a design") == sections
    (fault,) = faults_of(path, {"test.file": "other.npz"}, check_data=True)
    assert fault.startswith("--set test.file: ") and "other.npz" in fault


@pytest.mark.parametrize(
    ("target", "name"),
    [
        ("speed", "speed"),
        ("{column: speed, abs: true}", "speed"),
        ("[fabric, {column: speed, abs: true}]", "fabric|speed"),
        ("{choice: [fabric, speed]}", "target"),
    ],
)
def test_a_task_is_called_after_its_columns(tmp_path, target, name):
    space = load_space(write_space(tmp_path, ("target: fabric", f"target: {target}")))
    assert space.parts["task"].values["name"] == name
    assert ("task.target" in space.axes) == target.startswith("{choice")


def test_the_sampler_depends_on_the_axes_unless_it_is_named(tmp_path):
    path = write_space(tmp_path, ("{sampler: grid, batch: 2}", "{n_trials: 4}"))
    assert load_space(path).search.sampler_name == "grid"
    assert load_space(path, {"model.true_rate": "{range: [0.1, 0.9]}"}).search.sampler_name == "tpe"


def test_an_unknown_name_lists_the_known(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(
        ConfigError, match=r"^nothing_like_it: no such file and no shipped search space of this name; known: "
    ):
        load_space("nothing_like_it")


def test_what_is_no_file_is_named_as_such(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe.yaml")
    (tmp_path / "folder").mkdir()
    for name in ("pipe.yaml", "folder"):
        with pytest.raises(ConfigError, match=f"^{name}: must be a file, got a folder, pipe or device$"):
            load_space(name)
    (tmp_path / "quickstart").mkdir()  # beside the shipped space of this name
    assert load_space("quickstart").study == "quickstart"


@needs_papers
def test_every_shipped_search_space_is_right(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = shipped_spaces()
    assert names
    for name in names:
        assert isinstance(load_space(name), SearchSpace)


@pytest.fixture
def pair():
    """Register a model whose keys must fit each other."""

    @register("models", "pair_of_a_test")
    @dataclasses.dataclass(frozen=True)
    class Pair:
        low: int = param(1, doc="low")
        high: int = param(5, doc="high")
        plain: float = param(1.0, doc="plain", low=0, low_open=True)
        fit = respond = str

        def __post_init__(self):
            if self.low >= self.high:
                raise ValueError(f"low must be below high, got {self.low} and {self.high}")

    yield "pair_of_a_test"
    del registry._components["models"]["pair_of_a_test"]


def test_rules_between_keys_hold_for_every_choice(tmp_path, pair):
    model = "{kind: snn, hidden: {choice: [4, 8, 12]}, true_rate: 0.8}"
    good = write_space(tmp_path, (model, f"{{kind: {pair}, low: {{choice: [1, 4]}}}}"))
    assert pair in registry.known("models")
    assert load_space(good).axes["model.low"].values == (1, 4)
    bad = write_space(
        tmp_path, (model, f"{{kind: {pair}, low: {{range: [1, 7], step: 2}}, high: {{choice: [9, 6]}}}}")
    )
    assert faults_of(bad) == ["14: model.low must be below high, got 7 and 6"]


def test_no_single_character_crashes_the_reader(tmp_path):
    """Whatever happens to a file, the answer is a search space or a list of faults."""
    path = tmp_path / "broken.yaml"
    write_space(tmp_path)
    rng = np.random.default_rng(0)
    outcomes = {True: 0, False: 0}
    for _ in range(300):
        place = int(rng.integers(len(SPACE)))
        broken = SPACE[:place] + str(rng.choice(list("[]{}:,-x0\"' \n"))) + SPACE[place + 1 :]
        path.write_text(broken, encoding="utf-8")
        try:
            load_space(path)
        except ConfigError as error:
            assert error.faults
            outcomes[False] += 1
        else:
            outcomes[True] += 1
    assert outcomes[False] > 100


EVENTS = """
study: x
data: {{kind: scene, scene: quickstart}}
task: {{target: texture}}
split: {{stratified: {{validation: 0.2}}}}
preprocessing: {{bin_ms: 4, every_event: {every_event}}}
{encoder}
model: {model}
objectives: [accuracy:max]
search: {{sampler: tpe, n_trials: 2}}
"""


@pytest.mark.parametrize(
    ("every_event", "model", "encoder", "refused"),
    [
        ("true", "{kind: snn}", "", ["snn"]),
        pytest.param(
            *("true", "{choice: [snn, hots, threshold_lif]}", "", ["snn", "threshold_lif"]),
            marks=needs_papers,
        ),
        ("{choice: [false, true]}", "{kind: snn}", "", ["snn"]),
        ("true", "{choice: [knn, naive_bayes, mlp, elm]}", "", []),
        ("true", "{kind: snn}", "encoder: {kind: receptors}", []),
        ("false", "{kind: snn}", "", []),
    ],
)
def test_every_event_is_for_models_that_take_events(tmp_path, every_event, model, encoder, refused):
    path = tmp_path / "x.yaml"
    path.write_text(EVENTS.format(every_event=every_event, model=model, encoder=encoder), encoding="utf-8")
    if not refused:
        load_space(path)
        return
    with pytest.raises(ConfigError) as caught:
        load_space(path)
    expected = [
        f"preprocessing.every_event must be false for model {kind} without an encoder, which takes one spike "
        "per channel and bin, got true"
        for kind in refused
    ]
    assert [fault.message for fault in caught.value.faults] == expected


@pytest.mark.parametrize("reads", ["levels", "{choice: [counts, levels]}"])
def test_levels_are_not_read_of_events_with_times_of_their_own(tmp_path, reads):
    path, model = tmp_path / "x.yaml", f"{{kind: linear, reads: {reads}}}"
    path.write_text(EVENTS.format(every_event="true", model=model, encoder=""), encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        load_space(path)
    [fault] = caught.value.faults
    assert fault.message.startswith("model.reads must be counts") and fault.line == 8
    path.write_text(EVENTS.format(every_event="false", model=model, encoder=""), encoding="utf-8")
    load_space(path)
