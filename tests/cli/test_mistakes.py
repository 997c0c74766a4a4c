"""A hundred mistakes on the command line: each is refused in words, with exit code 2, and nothing is left."""

import shlex
from pathlib import Path

import numpy as np
import pytest

from dse.cli import main

STUDY = Path(__file__).resolve().parents[2] / "results" / "example"
SPACE = """
data: {kind: time_series, file: ok.npz, signal: signal, step_ms: 5, columns: {label: label}}
task: {target: label}
split: {stratified: {validation: 0.2, test: 0.2, seed: 1}}
encoder: {kind: send_on_delta, thresholds: [0.2]}
model: {kind: snn, hidden: 5}
training: {epochs: 2}
"""
MISTAKES = """
init missing.npz
init one.npz --step-ms 5
init nolabel.npz --step-ms 5
init float.npz --step-ms 5
init nan.npz --step-ms 5
init two.npz --step-ms 5
init uneven.npz --step-ms 5
init empty.npz
init flat.npy
init obj.npy
init bad.csv
init empty.csv
init head.csv
init bin.csv
init long.csv
init notes.txt
init folder
init trunc.npz
init ok.npz --label lable --step-ms 5 --out x.yaml
init ok.npz --step-ms -1
init ok.npz --step-ms x
init ok.npz --step-ms 5 --group nobody --out x.yaml
init ok.npz --step-ms 5 --signal nope --out x.yaml
init ok.npz --step-ms 5 --out /proc/no/x.yaml
init ok.npz --step-ms 5 --labels missing.csv --out x.yaml
runn ok.yaml
run missing.yaml
run folder
run ok.npz
run notes.txt
run ok.yaml --jobs 0
run ok.yaml --jobs x
run ok.yaml --set training.epochs
run ok.yaml --set trainin.epochs=3
run ok.yaml --set training.epochs=x
run ok.yaml --minutes -1
run ok.yaml --results /proc/no
run --nope ok.yaml
skyline missing
skyline folder
skyline notes.txt
skyline STUDY --where "accurcy > 1"
skyline STUDY --where "accuracy >"
skyline STUDY --objectives accuracy
skyline STUDY --objectives "accuracy:up"
skyline STUDY --by nothing
skyline STUDY --hardware loihi9
skyline STUDY --format xml
skyline STUDY --columns nothing
skyline STUDY --draws -5
skyline STUDY --confidence 2
pick STUDY --budget "energy_uj"
pick STUDY --budget "energy<=5"
pick STUDY --budget "energy_uj<=five"
pick STUDY --maximise nothing
pick missing
pick STUDY --target nowhere
pick STUDY --export /proc/no/b
pick STUDY --verify ok.npz
pick STUDY --refit
dashboard missing
dashboard STUDY --html /proc/no/p.html
dashboard STUDY --port 99999
dashboard STUDY --page nothing
dashboard STUDY --html x.html --port 1
figure STUDY nothing --out f.json
figure STUDY front --out f.xyz
figure STUDY front
report missing
report STUDY --paper 999
evaluate missing --data ok.npz
evaluate folder --data ok.npz
export missing --target c99
export folder --target c99
verify folder --data ok.npz
stream missing --data ok.npz
measure missing --data ok.npz
reproduce missing
doctor missing
doctor folder
enqueue ok.yaml missing.yaml --results results
cost missing --hardware mcu_m4
cost STUDY --hardware mcu_m4
describe nothing
describe models nothing
describe hardware loihi9
simulate nothing
prepare nothing
prepare braille
audit missing.yaml
audit ok.npz
init ok.npz
run
check
pick
evaluate missing
export missing
enqueue ok.yaml
simulate
cost STUDY
"""


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """A folder of files that mistakes are about."""
    folder = tmp_path_factory.mktemp("desk")
    rng = np.random.default_rng(0)
    signal, label = rng.normal(size=(30, 40, 3)), np.tile(["a", "b", "c"], 10)
    arrays = {
        "ok": {"signal": signal, "label": label},
        "one": {"signal": signal, "label": np.repeat("a", 30)},
        "nolabel": {"signal": signal},
        "float": {"signal": signal, "label": rng.normal(size=30)},
        "nan": {"signal": np.full_like(signal, np.nan), "label": label},
        "two": {"signal": signal[:2], "label": label[:2]},
        "uneven": {"signal": signal, "label": label[:27]},
        "empty": {},
    }
    for name, of in arrays.items():
        np.savez(folder / f"{name}.npz", **of)
    np.save(folder / "flat.npy", signal[:, 0, 0])
    np.save(folder / "obj.npy", np.array([{}, 1], object), allow_pickle=True)
    (folder / "trunc.npz").write_bytes((folder / "ok.npz").read_bytes()[:100])
    (folder / "bin.csv").write_bytes(bytes(range(256)) * 10)
    (folder / "folder").mkdir()
    texts = {"bad.csv": "a,b\n1,2\n3\n", "empty.csv": "", "head.csv": "time,x,label\n", "notes.txt": "hello"}
    texts |= {"long.csv": "time,x,label\n0,1,a\n1,2,b\n", "ok.yaml": SPACE}
    for name, text in texts.items():
        (folder / name).write_text(text)
    return folder


def test_a_hundred_mistakes_are_refused_in_words(desk, monkeypatch, capsys):
    monkeypatch.chdir(desk)
    mistakes = MISTAKES.strip().splitlines()
    assert len(mistakes) == len(set(mistakes)) >= 100
    for line in mistakes:
        try:
            code = main([word.replace("STUDY", str(STUDY)) for word in shlex.split(line)])
        except SystemExit as left:  # of argparse
            code = left.code
        said = capsys.readouterr()
        assert said.err.strip() and "Traceback" not in said.err and not said.out, line
        assert code == 2, (line, code)
    assert not list(desk.glob("x.yaml")) and not (desk / "results").exists()  # nothing half-written
