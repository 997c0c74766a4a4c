"""A stranger's first hour: a CSV of one's own, and from there to a classifier that is deployed."""

import json
import os
import resource
import shlex
import shutil
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import dse
from dse.cli import main
from dse.data.recordings import RecordingError
from dse.store import StoreError
from tests.command import document

ROOT = Path(__file__).resolve().parents[2]
CHANNELS, STEPS, STEP_S = ("left", "right"), 50, 0.004
FREQUENCY_HZ = {"denim": 4.0, "silk": 22.0}
SESSIONS = 5


def recordings():
    """Return touches of two fabrics in five sessions as a tidy table: a row per sample."""
    rng = np.random.default_rng(1)
    time_s = np.arange(STEPS) * STEP_S
    parts = []
    for number in range(SESSIONS * 4):
        fabric = sorted(FREQUENCY_HZ)[number % 2]
        phase = 2 * np.pi * FREQUENCY_HZ[fabric] * time_s + rng.uniform(0, 6)
        signal = {name: np.sin(phase + k) + rng.normal(0, 0.05, STEPS) for k, name in enumerate(CHANNELS)}
        labels = {"trial": number, "time_s": time_s.round(4), "fabric": fabric, "session": number // 4}
        parts.append(pd.DataFrame({**labels, **signal}))
    return pd.concat(parts, ignore_index=True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hour")
    recordings().to_csv(folder / "touch.csv", index=False)
    return folder


def formats(folder):
    """Write the same recordings in every layout; return the arguments of `dse init` for each."""
    tidy = recordings()
    labels = tidy.groupby("trial")[["fabric", "session"]].first()
    signal = tidy[list(CHANNELS)].to_numpy().reshape(-1, STEPS, len(CHANNELS))
    tidy.drop(columns="trial").to_parquet(folder / "unnamed.parquet")
    tidy.assign(time_s=tidy.time_s * 1e6).rename(columns={"time_s": "t_us"}).to_csv(folder / "us.csv")
    uneven = tidy.time_s + np.random.default_rng(2).uniform(0, 0.0025, len(tidy))
    tidy.assign(time_s=uneven).to_csv(folder / "uneven.csv", index=False)
    tidy.drop(columns=["fabric", "session"]).to_csv(folder / "beside.csv", index=False)
    labels.reset_index().to_csv(folder / "beside_labels.csv", index=False)
    names = ["trial", "time_s", "fabric", "session"]
    tidy.melt(names, CHANNELS, "channel", "value").to_csv(folder / "long.csv", index=False)
    wide = {f"{name}_{k}": signal[:, k, c] for c, name in enumerate(CHANNELS) for k in range(STEPS)}
    pd.DataFrame({**labels.to_dict("list"), **wide}).to_csv(folder / "wide.csv", index=False)
    pd.DataFrame(wide).to_csv(folder / "apart.csv", index=False)
    labels.to_csv(folder / "apart_labels.csv", index=False)
    np.savez(folder / "cube.npz", signal=signal, fabric=labels.fabric.to_numpy(str), session=labels.session)
    np.save(folder / "cube.npy", signal)
    labels.to_csv(folder / "cube_labels.csv", index=False)
    step = ("--step-ms", "4")
    stated = {name: step for name in ("wide.csv", "apart.csv", "cube.npz", "cube.npy")}
    return {
        **{name: () for name in ("unnamed.parquet", "us.csv", "uneven.csv", "beside.csv", "long.csv")},
        **stated,
    }


def test_every_layout_gives_a_space_that_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name, arguments in formats(tmp_path).items():
        answer = document(capsys, "init", name, *arguments, "--out", "x.yaml", "--force")
        (row,) = answer["rows"]
        assert (row["recordings"], row["train"], row["classes"]) == (20, 12, ["denim", "silk"]), name
        assert any("'session' stay in one part" in note for note in answer["notes"]), name
        assert any("uneven" in note for note in answer["notes"]) == (name == "uneven.csv"), name
    text = Path("x.yaml").read_text(encoding="utf-8")
    assert "\n# Assumed:\n# - " in text and "'session' stay in one part" in text
    events = np.random.default_rng(3)
    for number in range(8):
        place = tmp_path / "events" / "ab"[number % 2] / f"{number}.npz"
        place.parent.mkdir(parents=True, exist_ok=True)
        columns = {key: events.integers(0, 9, 60) for key in "xy"} | {"p": events.integers(0, 2, 60)}
        np.savez(place, t=np.sort(events.integers(0, 90_000, 60)), **columns)
        if number > 3:  # some of them are text
            pd.DataFrame(dict(np.load(place))).to_csv(place.with_suffix(".csv"), index=False)
            place.unlink()
    assert document(capsys, "init", "events", "--out", "x.yaml", "--force")["rows"][0]["classes"] == [
        "a",
        "b",
    ]
    jitter = recordings().time_s + np.random.default_rng(2).uniform(0, 0.001, len(recordings()))
    recordings().assign(time_s=jitter).to_csv("jitter.csv", index=False)
    assert main(["init", "jitter.csv", "--out", "x.yaml", "--force"]) == 0
    assert "steps differ from that by up to" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "arguments", "message"),
    [
        ("absent.csv", [], "absent.csv: no such file or folder"),
        ("notes.doc", [], "notes.doc: must be a table"),
        ("touch.csv", ["--label", "velvet"], "--label velvet: must be a label column of touch.csv; there"),
        ("touch.csv", ["--label", "fabric", "--group", "x"], "--group x: must be a label column"),
        ("touch.csv", ["--recording", "touch"], "touch.csv: no column 'touch'; there are trial, time_s"),
        ("touch.csv", ["--out", "taken.yaml"], "taken.yaml: exists already; --force replaces it"),
        ("one.csv", [], "one.csv: must hold several recordings, got one"),
        ("bare.csv", [], "no label column was found"),
        ("signals", [], "signals: must hold several recordings, got one"),
        ("seconds", [], "seconds: the unit of the times is not known; state it with --time-unit"),
        ("cube.npz", [], "cube.npz: the sampling period is not in the file; state it with --step-ms N"),
        ("rows.csv", ["--step-ms", "4"], "rows_labels.csv: 'trial' must be as in rows.csv, in the same"),
    ],
)
def test_what_cannot_be_guessed_is_one_clear_line(name, arguments, message, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    tidy = recordings()
    Path("notes.doc").write_text("notes")
    Path("taken.yaml").write_text("mine")
    tidy[tidy.trial == 0].drop(columns="trial").to_csv("one.csv", index=False)
    tidy[["trial", "time_s", "left"]].to_csv("bare.csv", index=False)
    np.savez("cube.npz", signal=np.ones((4, 3, 2)), label=[0, 0, 1, 1])
    pd.DataFrame({"trial": range(4), **{f"v{k}": range(4) for k in range(5)}}).to_csv("rows.csv", index=False)
    pd.DataFrame({"trial": [1, 0, 2, 3], "label": [0, 0, 1, 1]}).to_csv("rows_labels.csv", index=False)
    for place, lines in (("signals", "time,pressure\n0,0.5\n"), ("seconds", "t,x,y,p\n0.5,1,2,1\n")):
        Path(place, "a").mkdir(parents=True, exist_ok=True)
        Path(place, "a", "1.csv").write_text(lines)
    before = sorted(Path().iterdir())
    out = [] if "--out" in arguments else ["--out", "new.yaml"]
    assert main(["init", name, *arguments, *out]) == 2
    printed = capsys.readouterr()
    assert message in printed.err and printed.err.count("\n") == 1 and printed.out == ""
    assert sorted(Path().iterdir()) == before and Path("taken.yaml").read_text() == "mine"


def test_from_python_a_space_follows_from_arrays(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    tidy = recordings()
    signal = tidy[list(CHANNELS)].to_numpy().reshape(-1, STEPS, len(CHANNELS))
    labels = tidy.groupby("trial")[["fabric", "session"]].first().to_dict("list")
    data = dse.data.from_arrays(signal, labels, step_ms=4)
    space = dse.init(data, "touch.yaml")
    assert dse.load_space(space).parts["task"].values["target"] == "fabric"
    assert "'session' stay in one part" in space.read_text()
    tidy.to_csv("tidy.csv", index=False)
    assert dse.init("tidy.csv", label="session") == Path("tidy.yaml")
    for call, kind, message in (
        (lambda: dse.init(data, space), StoreError, "touch.yaml: exists already"),
        (lambda: dse.init(data, step_ms=4), TypeError, "states step_ms itself"),
        (lambda: dse.init(data, "x.yaml", label="velvet"), RecordingError, "must be a label column"),
        (lambda: dse.init("tidy.csv", "x.yaml", steps=4), TypeError, "steps"),
    ):
        with pytest.raises(kind, match=message):
            call()
    assert not Path("x.yaml").exists()


def installed(folder):
    """Install what git tracks into a new environment with the dependencies of this one; return its `dse`.

    Compiled kernels come along. DSE_INSTALLED names the `dse` of an environment that is there (.ci/wheel).
    """
    if there := os.environ.get("DSE_INSTALLED"):
        return Path(there)
    listing = ["git", "-C", ROOT, "ls-files", "-z"]
    tracked = subprocess.run(listing, capture_output=True, text=True, check=False)
    if tracked.returncode:
        pytest.skip("the sources are no clone")
    clone = folder / "clone"
    for name in filter(None, tracked.stdout.split("\0")):
        if (ROOT / name).is_file():
            (clone / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, clone / name)
    venv.create(folder / "venv")
    python = folder / "venv" / "bin" / "python"
    ask = "import sysconfig; print(sysconfig.get_path('purelib'))"
    site = subprocess.run([python, "-c", ask], capture_output=True, text=True, check=True).stdout.strip()
    Path(site, "dependencies.pth").write_text(f"{sysconfig.get_path('purelib')}\n")
    pip = [sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-index", "--no-deps"]
    subprocess.run([*pip, "--no-build-isolation", "--no-compile", clone], check=True)
    for kernel in ROOT.glob("dse/**/__pycache__/*.nb[ic]"):
        there = Path(site) / kernel.relative_to(ROOT)
        there.parent.mkdir(exist_ok=True)
        shutil.copy2(kernel, there)
    return python.with_name("dse")


QUICK = "--jobs 1 --set training.epochs=40 --set limits=[]"
QUICK += " --set 'model={kind: snn, hidden: 12}' --set 'encoder={kind: quantised, step: 0.03}'"
PICK = "dse pick results/touch --hardware mcu_m4 --budget n_weights<=10000 --export bundle"
_REST = """
import json, sys
import dse
from dse.cli import main
for words in json.loads(sys.argv[1]):
    assert main(words) == 0, words
print(dse.__file__, dse.load_space("fabric_texture").study)
"""
KNOWN = "warning: the design was trained and selected on these recordings"


def test_the_first_hour_on_a_bare_clone(tmp_path, monkeypatch, capsys):
    """Install, example page, own CSV, run, pick, export, verify, evaluate; no line is written by the user.

    `make wheel` runs the whole search, and prints the table of docs/tutorial.md.
    """
    dse_command, whole = installed(tmp_path), "DSE_INSTALLED" in os.environ
    desk = tmp_path / "desk"
    desk.mkdir()
    recordings().to_csv(desk / "touch.csv", index=False)
    steps = {
        "dse example": "results/example/study.sqlite",
        "dse dashboard results/example --html page.html": "page.html",
        "dse init touch.csv": "touch.yaml",
        "dse audit touch.yaml": None,
        f"dse run touch.yaml --quiet {'' if whole else QUICK}": "results/touch/page.html",
        "dse skyline results/touch": None,
        PICK: "bundle/bundle.json",
        "dse evaluate bundle --data touch.csv": None,
        "dse export bundle --target c99 --verify touch.csv": "bundle/targets/c99",
        "dse verify bundle --data touch.csv": None,
    }
    if not whole:  # what needs no file of the installation that others do not need
        left_out = ("dashboard", "audit", "skyline", "evaluate", "verify")
        steps = {x: made for x, made in steps.items() if x.split()[1] not in left_out}
    environment = {key: x for key, x in os.environ.items() if key != "PYTHONPATH"}
    environment |= {"DSE_CACHE": str(tmp_path / "cache")}
    rows, lines = [], [shlex.split(command)[1:] for command in steps]

    def called(*command):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(command, cwd=desk, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, (command, done.stderr)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        rows.append(f"| `dse {' '.join(command[1:]).replace(f'{ROOT}/', '')}` | {cpu_s:.1f} |")
        return done.stdout

    n_alone = len(lines) if whole else 1  # each imports for seconds: the others in one process
    for words in lines[:n_alone]:
        called(dse_command, *words)
    with capsys.disabled():
        print(*(["\n| command | CPU s |\n|---|---|", *rows] if whole else []), sep="\n", end="")
    where = called(dse_command.with_name("python"), "-c", _REST, json.dumps(lines[n_alone:])).splitlines()[-1]
    assert where.startswith(str(dse_command.parents[1])) and where.endswith(" fabric_texture"), where
    assert all((desk / artefact).exists() for artefact in filter(None, steps.values()))
    trials = pd.read_parquet(desk / "results" / "touch" / "trials.parquet")
    rivals = ["linear", "mlp", "kernels", "kernel_snn"] if whole else []
    assert trials["family"].unique().tolist() == [*rivals, "snn"]
    assert trials.loc[trials["status"] != "excluded", "accuracy"].notna().all()
    assert json.loads((desk / "bundle" / "bundle.json").read_text())["targets"]["c99"]["kind"] == "faithful"
    monkeypatch.chdir(desk)
    recordings().query("session > 2").to_csv("new.csv", index=False)
    for file, n, is_known in (("touch.csv", 20, True), ("new.csv", 8, False)):
        answer = document(capsys, "evaluate", "bundle", "--data", file)
        assert answer["rows"][0]["recordings"] == n and answer["rows"][0]["accuracy"] >= 0.8
        assert any(note.startswith(KNOWN) for note in answer["notes"]) == is_known
