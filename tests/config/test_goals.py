import pytest
import yaml

from dse.config import ConfigError, load_space, names
from dse.config.locate import is_hardware_file, shipped_profiles
from dse.config.schema import json_schema
from dse.config.search import automatic
from tests.spaces import write_space


def read(raw, base):
    faults = []
    found = names.hardware(raw, lambda path, text: faults.append(f"{path}: {text}"), base)
    return found, faults


def test_hardware_is_named_or_a_file_beside_the_search_space(tmp_path):
    (tmp_path / "chips").mkdir()
    (tmp_path / "chips" / "mine.yaml").touch()
    written = ["loihi1_silicon", "chips/mine.yaml"]
    assert read(written, tmp_path) == (tuple(written), [])
    assert read("chips/mine.yaml", tmp_path) == (("chips/mine.yaml",), [])
    assert read(None, tmp_path) == ((), [])


def test_a_search_space_names_a_file(tmp_path):
    path = write_space(tmp_path, ("[loihi1_silicon]", "[mine.yaml]"))
    with pytest.raises(
        ConfigError, match=r"tiny\.yaml:17: hardware 'mine\.yaml' must be a file, relative to"
    ):
        load_space(path)
    (tmp_path / "mine.yaml").touch()
    assert load_space(path).hardware == ("mine.yaml",)


@pytest.mark.parametrize(
    ("raw", "fault"),
    [
        (["loihi1_silicn"], "('hardware', 0): unknown hardware 'loihi1_silicn'; known: "),
        (["loihi1_silicon", "none.yaml"], "('hardware', 1): hardware 'none.yaml' must be a file, relative"),
        (["folder.yaml"], "('hardware', 0): hardware 'folder.yaml' must be a file, relative to the search"),
        (["mine.yaml", "mine.yaml"], "('hardware', 1): hardware 'mine.yaml' is named twice"),
        (["loihi1_silicon"] * 2, "('hardware', 1): hardware 'loihi1_silicon' is named twice"),
        ({"name": "mine.yaml"}, "('hardware',): hardware must be a list of texts"),
    ],
)
def test_what_is_no_hardware(tmp_path, raw, fault):
    (tmp_path / "mine.yaml").touch()
    (tmp_path / "folder.yaml").mkdir()
    _, (found,) = read(raw, tmp_path)
    assert found.startswith(fault)


def test_the_schema_knows_names_and_files():
    element, listed = json_schema()["properties"]["hardware"]["anyOf"]
    assert listed == {"type": "array", "items": element}
    names, file = element["anyOf"]
    assert names["enum"] == list(shipped_profiles())
    assert file == {"type": "string", "pattern": r"\.ya?ml$"}
    assert [is_hardware_file(name) for name in ("mine.yaml", "../x.yml", "op_4.6_0.9")] == [True, True, False]


def with_decision(folder, written):
    """Write the small search space with a section `decision`, which is line 16."""
    return write_space(folder, ("{phi: [0, 2], theta: {range: [0.25, 0.75], step: 0.25}}", written))


def test_phi_may_reach_as_far_as_the_outputs(tmp_path):
    written = "{phi: {up_to: outputs, step: 5}, theta: [0.5], read_out_every_ms: 100}"
    assert load_space(with_decision(tmp_path, written)).decision.to_plain() == yaml.safe_load(written)
    step = load_space(with_decision(tmp_path, "{phi: {up_to: outputs}}")).decision.to_plain()["phi"]
    assert step == {"up_to": "outputs", "step": 25}
    assert set(load_space(with_decision(tmp_path, "{}")).decision.to_plain()) == {"phi", "theta"}


@pytest.mark.parametrize(
    ("n_designs", "n_trials", "sampler"),
    [
        (96, None, "grid"),
        (96, 96, "grid"),
        (96, 95, "tpe"),
        (96, 11, "sobol"),
        (96, 12, "tpe"),
        (None, 11, "sobol"),
        (None, None, "tpe"),  # which then requires n_trials
    ],
)
def test_auto_chooses_by_the_number_of_designs(n_designs, n_trials, sampler):
    assert automatic(n_designs, n_trials) == sampler


def test_a_study_states_the_sampler_that_auto_chose(tmp_path):
    path = write_space(tmp_path, ("sampler: grid, batch: 2", "sampler: auto, n_trials: 3"))
    space = load_space(path)
    assert (space.search.sampler_name, space.to_plain()["search"]["sampler"]) == ("sobol", "sobol")
    whole = load_space(path, {"search.n_trials": "6"})
    assert (whole.search.sampler_name, whole.search.batch) == ("grid", 6)


@pytest.mark.parametrize(
    ("schedule", "objective", "faults"),
    [
        ("", "power_mw", ["objective 'power_mw' needs section 'schedule', got none"]),
        (
            "schedule: {continuous: true}",
            "battery_days",
            ["objective 'battery_days' needs battery_mwh in section 'schedule', got none"],
        ),
        (
            "schedule: {awake_ms: 9}",
            "accuracy",
            ["schedule.contacts_per_hour or continuous: true must be given"],
        ),
        (
            "schedule: {contacts_per_hour: 1, continuous: true}",
            "power_mw",
            ["schedule.contacts_per_hour or continuous: true must be given, got both"],
        ),
        (
            "schedule: {continuous: true, awake_ms: 9}",
            "power_mw",
            ["schedule.awake_ms needs contacts_per_hour"],
        ),
        ("schedule: {contacts_per_hour: 1, asleep_uw: 9}", "power_mw", ["schedule.asleep_uw needs awake_ms"]),
        ("schedule: {contacts_per_hour: 1, battery_mwh: 9}", "battery_days", []),
    ],
)
def test_objectives_on_a_schedule(tmp_path, schedule, objective, faults):
    before = "objectives: [accuracy:max, n_weights:min"
    path = write_space(tmp_path, (before, f"{schedule}\nobjectives: [{objective}, n_weights:min"))
    found = []
    try:
        space = load_space(path)
        assert load_space(space.to_plain()).schedule == space.schedule
    except ConfigError as error:
        found = [fault.message for fault in error.faults]
    assert len(found) == len(faults) and all(map(str.startswith, found, faults))
