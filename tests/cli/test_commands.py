"""Every command from its arguments to exit code, stdout and stderr."""

import io
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from dse.cli import main
from dse.cli.commands import MODULE_OF
from dse.config.resolved import SECTIONS
from dse.measure.hardware.counter import MeasuredPower
from dse.study import explore
from dse.study.results import Study
from tests.command import document
from tests.spaces import write_space

PAGES = True
ONE = ("[[1, 2], [1, 2, 4]]", "[[1, 2]]"), ("[4, 8, 12]", "[4]")
"""Changes that leave one design."""


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """The folder of a study of two designs, trained for an epoch."""
    folder = tmp_path_factory.mktemp("study")
    space = write_space(folder, ("[[1, 2], [1, 2, 4]]", "[[1, 2]]"), ("[4, 8, 12]", "[4, 8]"))
    assert main(["run", str(space), "--results", str(folder / "results"), "--quiet", "--json"]) == 0
    return folder / "results" / "tiny"


@pytest.fixture
def table(tmp_path):
    """A table of points: three on the front, one dominated."""
    path = tmp_path / "points.csv"
    path.write_text(
        "trial,task,model.hidden,accuracy,n_weights\n0,a,4,0.7,40\n1,a,8,0.9,80\n2,b,16,0.8,160\n3,b,32,0.95,320\n",
        encoding="utf-8",
    )
    return path


def test_check_says_what_a_run_would_be(tmp_path, capsys):
    path = write_space(tmp_path)
    found = document(capsys, "check", path)
    assert found["schema"] == "dse/check/1"
    (row,) = found["rows"]
    assert row["designs"] == row["trained"] == row["runs"] == 6
    assert row["design_points"] == 6 * (2 * 3 + 1)
    assert (row["train"], row["validation"], row["test"]) == (12, 12, 0)
    assert row["classes"] == ["0", "1"]
    assert row["data"] == str(tmp_path / "touch.npz")
    # 2 channels x 2 polarities x 2 or 3 thresholds -> 4 to 12 neurons -> 2 classes
    assert (row["n_weights_low"], row["n_weights_high"]) == (8 * 4 + 4 * 2, 12 * 12 + 12 * 2)


def test_check_in_words(tmp_path, capsys):
    changes = (
        ("true_rate: 0.8", "true_rate: {range: [0.1, 0.9]}"),
        ("sampler: grid", "sampler: tpe, n_trials: 9"),
    )
    assert main(["check", str(write_space(tmp_path, *changes))]) == 0
    lines = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
    assert lines["designs"] == "unlimited"
    assert lines["trained"] == "9"
    assert lines["axes"] == "encoder.thresholds, model.hidden, model.true_rate"


def test_check_lists_faults_in_both_forms(tmp_path, capsys):
    path = write_space(tmp_path, ("seed: 3", "seed: x"), ("epochs: 1", "epochs: 0"))
    assert main(["check", str(path)]) == 2
    plain = capsys.readouterr()
    assert plain.out == ""
    assert plain.err.splitlines() == [
        f"{path}:2: seed must be an integer, got 'x'",
        f"{path}:15: training.epochs must be in [1, 1000000], got 0",
    ]
    rows = document(capsys, "check", path, code=2)["rows"]
    assert [row["line"] for row in rows] == [2, 15]
    assert rows[0]["message"] == "seed must be an integer, got 'x'"


@pytest.mark.parametrize("text", ["execution.jobs", "=3", "a..b=3"])
def test_set_must_be_a_key_and_a_value(tmp_path, capsys, text):
    assert main(["check", str(write_space(tmp_path)), "--set", text]) == 2
    assert capsys.readouterr().err.startswith("--set ")


def test_run_compares_costs_on_one_chip(tmp_path, capsys):
    path = write_space(
        tmp_path, *ONE, ("hardware: [loihi1_silicon]", "hardware: [loihi1_silicon, op_4.6_0.9]")
    )
    found = document(capsys, "run", path, "--results", tmp_path / "r", "--quiet")
    assert {row["hardware"] for row in found["rows"]} == {"loihi1_silicon"}
    assert [note for note in found["notes"] if note.startswith("costs are those on loihi1_silicon")]


def test_a_page_that_cannot_be_written_fails_no_run(tmp_path, capsys, monkeypatch):
    def broken(*_, **__):
        raise KeyError("hardware")

    monkeypatch.setattr("dse.show.dashboard.study.write_page", broken)
    space = str(write_space(tmp_path, *ONE))
    arguments = ["run", space, "--results", str(tmp_path / "r"), "--quiet"]
    found = document(capsys, *arguments)
    assert found["rows"]
    [note] = [note for note in found["notes"] if "page" in note]
    assert note == (
        "the page could not be written: 'hardware'; "
        f"try again with dse dashboard {tmp_path / 'r' / 'tiny'} --html FILE"
    )


def test_run_again_trains_nothing_and_prints_the_same(results, capsys):
    space = results.parent.parent / "tiny.yaml"
    arguments = ["run", str(space), "--results", str(results.parent), "--jobs", "2", "--quiet"]
    before = {path: path.stat().st_mtime_ns for path in results.glob("runs/*.npz")}
    assert before
    found = document(capsys, *arguments)
    assert found["rows"]
    assert any(note.startswith("page: ") and note.endswith("page.html") for note in found["notes"])
    assert {path: path.stat().st_mtime_ns for path in results.glob("runs/*.npz")} == before


def test_run_reports_when_nothing_could_be_trained(tmp_path, capsys, monkeypatch):
    failed = pd.DataFrame({"trial": [0], "status": ["failed"], "reason": ["the loss is NaN in epoch 1"]})
    (tmp_path / "tiny").mkdir()
    (tmp_path / "tiny" / "search_space.yaml").write_text("study: tiny\nobjectives: ['accuracy:max']\n")
    failed.to_parquet(tmp_path / "tiny" / "trials.parquet")
    pd.DataFrame().to_parquet(tmp_path / "tiny" / "points.parquet")
    monkeypatch.setattr(explore, "run", lambda *_, **__: Study(tmp_path / "tiny"))
    found = document(capsys, "run", str(write_space(tmp_path)), code=1)
    assert found["rows"] == []
    assert "1 of 1 designs failed; the first: the loss is NaN in epoch 1" in found["notes"]


@pytest.mark.parametrize("module", ["dse.config", "dse.cli.signature"])
def test_ctrl_c_before_a_command_begins_is_130_without_traceback(module):
    code = (
        "import signal, sys\n"
        "def look(event, arguments):\n"
        f"    if event == 'import' and arguments[0] == {module!r}: signal.raise_signal(signal.SIGINT)\n"
        "sys.addaudithook(look)\n"
        "from dse.cli import main\n"
        "sys.exit(main(['--version']))"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert done.returncode == 130
    assert "Traceback" not in done.stderr and done.stdout == ""


def test_ctrl_c_is_130(tmp_path, capsys, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(explore, "run", interrupted)
    assert main(["run", str(write_space(tmp_path))]) == 130
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.splitlines() == [
        "the tables hold 0 of 6 trials",
        "stopped; finished trials are kept, and the same command resumes the study",
    ]


def test_a_bug_is_not_hidden(tmp_path, monkeypatch):
    def broken(*_, **__):
        raise ValueError("ours")

    monkeypatch.setattr(explore, "run", broken)
    with pytest.raises(ValueError, match="ours"):
        main(["run", str(write_space(tmp_path))])


@pytest.mark.parametrize(
    ("jobs", "fault"), [("0", ">= 1, got 0"), ("two", "an integer, got 'two'"), ("-1", ">= 1, got -1")]
)
def test_jobs_must_be_a_number(tmp_path, capsys, jobs, fault):
    with pytest.raises(SystemExit) as caught:
        main(["run", str(write_space(tmp_path)), f"--jobs={jobs}"])
    assert caught.value.code == 2
    assert f"argument --jobs: must be {fault}" in capsys.readouterr().err


def test_skyline_of_a_table(table, capsys):
    arguments = ["skyline", str(table), "--objectives", "accuracy:max,n_weights:min"]
    rows = document(capsys, *arguments)["rows"]
    assert [(row["task"], row["trial"]) for row in rows] == [("a", 1), ("a", 0), ("b", 3), ("b", 2)]
    assert document(capsys, *arguments, "--by", "task")["rows"] == rows
    assert [row["trial"] for row in document(capsys, *arguments, "--where", "task == 'b'")["rows"]] == [3, 2]
    assert [
        row["trial"]
        for row in document(capsys, *arguments, "--where", "n_weights <= 100 and model.hidden > 4")["rows"]
    ] == [1]
    twice = ["--where", "n_weights <= 100 or model.hidden > 4", "--where", "model.hidden > 4"]
    assert [
        row["trial"] for row in document(capsys, *arguments, *twice, "--where", "n_weights <= 100")["rows"]
    ] == [1]


def test_a_front_loads_no_compiler():
    code = (
        "import sys; from dse.cli import main\n"
        "assert main(['skyline', 'results/example', '--where', 'n_weights > 0']) == 0\n"
        "print(*{'numba', 'torch', 'optuna', 'sklearn'} & sys.modules.keys(), file=sys.stderr)"
    )
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True, cwd=root)
    assert done.stdout and not done.stderr.splitlines()[-1]


def test_skyline_formats(table, capfdbinary):
    arguments = ["skyline", str(table), "--objectives", "accuracy:max,n_weights:min", "--format"]
    assert main([*arguments, "csv"]) == 0
    frame = pd.read_csv(io.BytesIO(capfdbinary.readouterr().out))
    assert frame["trial"].tolist() == [1, 0, 3, 2]
    columns = ["trial", "accuracy", "n_weights", "model.hidden"]
    assert frame.columns.tolist() == ["trial", "task", *columns[1:]]
    assert main([*arguments, "parquet"]) == 0
    assert pd.read_parquet(io.BytesIO(capfdbinary.readouterr().out))[frame.columns].equals(frame)
    assert main([*arguments, "table"]) == 0
    lines = [line.split() for line in capfdbinary.readouterr().out.decode().splitlines()]
    assert lines[0] == columns
    assert (lines[1], lines[4]) == (["a"], ["b"]) and lines[5] == ["3", "0.95", "320", "32"]


def test_skyline_of_several_tables_and_of_a_study(results, table, capsys):
    alone = document(capsys, "skyline", results)["rows"]
    assert {"phi", "theta", "energy_uj", "model.hidden"} <= set(alone[0])
    both = document(capsys, "skyline", results, table, "--by", "task")["rows"]
    assert {row["task"] for row in both} == {"fabric", "a", "b"}
    assert {row["study"] for row in both} == {str(results), str(table)} and "study" not in alone[0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["skyline", "{table}"], "a table has no objectives of its own; state them"),
        (["skyline", "{table}", "--objectives", "accuracy"], "must be followed by :max or :min"),
        (["skyline", "{table}", "--objectives", "acuracy:max"], "Did you mean 'accuracy'?"),
        (
            ["skyline", "{table}", "--objectives", "accuracy:max", "--where", "1 +"],
            "condition '1 +' must read like",
        ),
        (["skyline", "{table}x"], "no such file"),
        (["pick", "{table}", "--budget", "n_weight<=3"], "Did you mean 'n_weights'?"),
        (["pick", "{table}", "--export", "bundle"], "only a design of a study's folder can be exported"),
        (["evaluate", "{table}", "--data", "x.npz"], "no bundle.json"),
        (["dashboard", "{table}"], "is not the folder of a study"),
        (["describe", "modle"], "unknown section 'modle'; known: "),
        (["describe", "model", "snm"], "Did you mean 'snn'?"),
        (["check", "no_such_space"], "no such file and no shipped search space of this name"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(table, capsys, arguments, message):
    assert main([argument.format(table=table) for argument in arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert len(captured.err.splitlines()) == 1
    assert message in captured.err


def test_pick_says_when_it_went_across_hardware(tmp_path, capsys):
    (tmp_path / "x.csv").write_text("accuracy,energy_uj,hardware\n0.9,40,chip\n0.9,0.1,counted\n")
    *_, note = document(capsys, "pick", tmp_path / "x.csv", "--budget", "energy_uj <= 50")["notes"]
    assert note == (
        "this is the best over the hardware profiles chip, counted; "
        "restrict it to one with --budget \"hardware == 'chip'\""
    )


def test_pick_without_a_feasible_design_names_the_nearest(table, capsys):
    found = document(capsys, "pick", table, "--budget", "n_weights<=30", code=3)
    assert found["rows"][0]["trial"] == 0
    assert found["rows"][0]["missed n_weights<=30"] == 10
    assert found["notes"][0] == "no design point meets n_weights<=30"
    assert main(["pick", str(table), "--budget", "n_weights<=30", "--format", "table"]) == 3
    assert "missed n_weights<=30" in capsys.readouterr().out


def test_pick_exports_what_evaluate_runs(results, tmp_path, capsys, monkeypatch):
    bundle = tmp_path / "bundle"
    picked = document(capsys, "pick", results, "--budget", "n_weights<=60", "--export", bundle)
    assert picked["notes"][-1] == f"bundle: {bundle}"
    budget = ("--budget", "n_weights<=60")
    again = document(capsys, "pick", results, *budget, "--export", tmp_path / "again", "--refit")
    assert again["rows"] == picked["rows"] and "training and validation" in again["notes"][-1]
    readme = bundle / "targets" / "c99" / "README.md"
    assert main(["pick", str(results), *budget, "--export", str(bundle), "--target", "c99"]) == 0
    readme.write_text("mine")
    capsys.readouterr()
    assert main(["pick", str(results), *budget, "--export", str(bundle)]) == 2
    assert f"{readme}: was edited" in (told := capsys.readouterr().err) and told.count("\n") == 1
    assert readme.read_text() == "mine"
    picked |= document(capsys, "pick", results, *budget, "--export", bundle, "--force")
    assert main(["pick", str(results), "--refit"]) == 2 and "--export" in capsys.readouterr().err
    data = results.parent.parent / "touch.npz"
    found = document(capsys, "evaluate", bundle, "--data", data)
    (row,) = found["rows"]
    assert row["recordings"] == row["labelled"] == 24
    assert 0 <= row["accuracy"] <= 1
    *correct, known = found["notes"]
    assert all(" of 12 correct" in note for note in correct) and len(correct) == 2
    assert known.startswith("warning: the design was trained and selected on these recordings")
    each = document(capsys, "evaluate", bundle, "--data", data, "--each")["rows"]
    assert [r["recording"] for r in each] == list(range(24))
    assert np.mean([r["answer"] == r["true"] for r in each]) == row["accuracy"]
    assert np.mean([r["time_ms"] for r in each]) == pytest.approx(row["decision_latency_ms"])
    for measured, note in (
        (MeasuredPower(30.0, 42.5), "power: of the processor, with everything else that runs on it"),
        (MeasuredPower(None, None, "no counter"), "power: no counter"),
    ):
        monkeypatch.setattr("dse.deploy.evaluate.measured_power", lambda work, rest_s, m=measured: m)
        found = document(capsys, "evaluate", bundle, "--data", data, "--power")
        powers = measured.idle_w, measured.running_w
        assert found["rows"] == [row | dict(zip(("power_idle_w", "power_w"), powers, strict=True))]
        assert found["notes"][-1] == note


def test_describe_covers_every_section(capsys):
    assert main(["describe"]) == 0
    listed = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert listed == [
        *(*SECTIONS, "search.samplers", "recordings.formats", "neurons", "losses", "figures"),
        *("page", "page.front"),
        *("scene", "scene.sensor", "scene.textures", "scene.motions"),
        *("scene.camera", "scene.variation", "scene.method"),
        *("boards", "bounds", "columns"),
    ]
    for section in listed[:-2]:
        rows = document(capsys, "describe", section)["rows"]
        assert rows, section
        for row in rows:
            if "name" in row:
                assert row["doc"], (section, row["name"])
                keys = document(capsys, "describe", section, row["name"])["rows"]
                assert all(key["doc"] and key.get("must_be", True) for key in keys), row["name"]


def test_describe_prints_the_schema(capsys):
    assert main(["describe", "--schema"]) == 0
    assert json.loads(capsys.readouterr().out)["title"] == "dse search space"


def test_help_and_version(capsys):
    for arguments in (["--help"], ["--version"], *([name, "--help"] for name in MODULE_OF)):
        with pytest.raises(SystemExit) as caught:
            main(arguments)
        assert caught.value.code == 0
        assert capsys.readouterr().out
