"""What `dse describe` says of scenes and hardware: it is read from the code and the data files themselves."""

import dataclasses
from pathlib import Path

import pandas
import pytest
import yaml

import dse
import dse.measure.hardware
from dse.cli import glossary, main, reference
from dse.measure.hardware import profile
from dse.scene import presets
from dse.scene.load import SceneFile
from dse.scene.scene import Camera, Method, Sensor, Variation
from dse.show.dashboard.definition import Definition, FrontView
from tests.command import document

PROFILES = Path(dse.measure.hardware.__file__).parent / "profiles"


@pytest.mark.parametrize(
    ("section", "cls"),
    [
        ("page", Definition),
        ("page.front", FrontView),
        ("scene", SceneFile),
        ("scene.camera", Camera),
        ("scene.variation", Variation),
        ("scene.method", Method),
    ],
)
def test_keys_are_those_of_the_record(section, cls):
    assert reference.names(section) == []
    assert [row["key"] for row in reference.keys(section, None)] == [f.name for f in dataclasses.fields(cls)]


def test_a_sensor_says_what_is_assumed():
    assert [row["name"] for row in reference.names("scene.sensor")] == list(presets.sensors())
    rows = {row["key"]: row for row in reference.keys("scene.sensor", "davis240_49")}
    assert set(rows) == {field.name for field in dataclasses.fields(Sensor)} | {
        f"camera.{field.name}" for field in dataclasses.fields(Camera)
    }
    assert rows["pin_radius_mm"] == {
        "key": "pin_radius_mm",
        "value": "0.5",
        "unit": "mm",
        "evidence": "assumed",
        "doc": "radius of a pin's image [A]",
        "source": "4.4 px",
    }
    assert rows["frame_px"]["evidence"] == "seen"
    assert rows["camera.refractory_us"]["value"] == "500"


@pytest.mark.parametrize("name", profile.names())
def test_every_number_of_a_profile_is_described_as_it_is_written(name):
    written = yaml.safe_load(profile.load(name).text)
    numbers = {key: value for key, value in written.items() if isinstance(value, dict)}
    rows = {row["key"]: row for row in reference.keys("hardware", name)}
    assert rows.keys() == numbers.keys()
    for key, row in rows.items():
        assert row["doc"]
        assert {column: row[column] for column in numbers[key]} == numbers[key]


def described(capsys, *arguments):
    return document(capsys, "describe", "hardware", *arguments)


def own_profile(path, old="", new=""):
    text = (
        (PROFILES / "op_4.6_0.9.yaml").read_text(encoding="utf-8").replace("name: op_4.6_0.9", "name: mine")
    )
    path.write_text(text.replace(old, new) if old else text, encoding="utf-8")
    return path


def test_a_profile_of_ones_own_is_described_from_its_file(tmp_path, capsys):
    path = own_profile(tmp_path / "my_chip.yaml", "kind:", "interval_only: true\nkind:")
    found = described(capsys, path)
    assert found["rows"] == described(capsys, "op_4.6_0.9")["rows"]
    assert str(found["notes"][0]).startswith("mine: ")
    assert found["notes"][-1] == "costs are given as intervals only"


def test_a_terminal_shows_every_number(capsys):
    assert main(["describe", "hardware", "loihi1_silicon", "--format", "table"]) == 0
    shown = capsys.readouterr().out
    keys = [row["key"] for row in reference.keys("hardware", "loihi1_silicon")]
    assert len(keys) > 24  # more than other tables show
    starts = [line.split()[0] for line in shown.splitlines() if line[:1].strip()]  # others go on a row
    assert [start for start in starts if start in keys] == keys


def test_no_such_profile(tmp_path, capsys):
    (tmp_path / "empty.yaml").write_text("")
    (tmp_path / "folder.yaml").mkdir()
    for name in ("empty.yaml", "folder.yaml", "none.yaml"):
        assert main(["describe", "hardware", str(tmp_path / name)]) == 2
        assert capsys.readouterr().err.startswith(str(tmp_path / name))
    assert main(["describe", "hardware", "loihi1_silicn"]) == 2
    shown = capsys.readouterr().err
    assert shown.startswith("dse describe: unknown hardware 'loihi1_silicn'; known: ")
    assert shown.endswith("Did you mean 'loihi1_silicon'?\n")


def test_every_column_of_a_study_is_explained(capsys):
    rows = document(capsys, "describe", "columns")["rows"]
    assert len({row["name"] for row in rows}) == len(rows) and all(row["doc"] for row in rows)
    assert {"accuracy", "phi", "energy_uj", "status", "battery_h"} <= {row["name"] for row in rows}
    shown = Path(dse.__file__).parent.parent / "results" / "quickstart" / "points.parquet"
    names = pandas.read_parquet(shown).columns if shown.is_file() else ["trial", "n_weights", "energy_uj_low"]
    known = {row["name"] for row in rows}
    ends = tuple(glossary.ENDINGS)
    assert [x for x in names if x not in known and "." not in x and not x.endswith(ends)] == []
    assert main(["describe", "columns", "accurcy"]) == 2
    assert "unknown column 'accurcy'" in capsys.readouterr().err


def test_help_lists_the_exit_codes(capsys):
    for arguments in (["--help"], ["pick", "--help"]):
        with pytest.raises(SystemExit):
            main(arguments)
        assert "exit codes: 0 success;" in " ".join(capsys.readouterr().out.split())
