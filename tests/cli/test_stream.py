"""`dse stream`: lines in, decisions out."""

import csv
import io
import json
import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from dse.base.records import Block
from dse.cli import main
from dse.deploy import bundle, sources
from dse.deploy.bundle import Input
from dse.deploy.evaluate import evaluate
from dse.deploy.stream import Passed, Stream, Windows
from tests.deploy.bundles import bundle as bundle_of
from tests.deploy.bundles import network
from tests.spaces import sections

N_STEPS = 20
ROWS = np.random.default_rng(3).integers(0, 2, (3, 50, 4))
EVENTS = {
    "data": {"kind": "events", "file": "x.npz", "width": 4, "taxel": "taxel"},
    "task": {"target": "letter"},
    "split": {"stratified": {"validation": 0.2}},
    "window": {"n_steps": N_STEPS, "at": "start"},
    "preprocessing": {"bin_ms": 1.0, "polarity": "merge"},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Bundles of spikes and of events, recordings, and the same as text."""
    folder = tmp_path_factory.mktemp("stream")
    fitted = network(np.random.default_rng(1), (4, 9, 3), recurrent=True)
    of_spikes = bundle_of(fitted, input=Input("spikes", 4, 0, 0, N_STEPS, 5.0))
    window = replace(of_spikes.sections.window, n_steps=N_STEPS)
    of_spikes = replace(of_spikes, sections=replace(of_spikes.sections, window=window))
    bundle.write(of_spikes, folder / "spikes")
    events = replace(of_spikes, sections=sections(EVENTS), input=Input("events", 0, 4, 1, N_STEPS, 1.0))
    bundle.write(events, folder / "events")
    np.savez(folder / "rows.npz", spikes=ROWS)
    text = "\n\n".join("\n".join(",".join(map(str, row)) for row in recording) for recording in ROWS)
    (folder / "rows.csv").write_text(f"a,b,c,d\n{text}\n")
    return folder


def printed(capsys):
    return list(csv.DictReader(io.StringIO(capsys.readouterr().out)))


def test_recordings_are_decided_as_evaluate_does(folder, capsys):
    assert main(["stream", str(folder / "spikes"), "--data", str(folder / "rows.npz")]) == 0
    rows = printed(capsys)
    expected = evaluate(folder / "spikes", folder / "rows.npz")
    assert [(row["answer"], float(row["time_ms"])) for row in rows] == [
        (answer["answer"], answer["time_ms"]) for answer in expected.answers
    ]
    assert [row["begin_ms"] for row in rows] == ["75.0"] * 3  # in the middle


def test_lines_are_the_recordings(folder, capsys):
    arguments = [
        "stream",
        str(folder / "spikes"),
        str(folder / "rows.csv"),
        "--window",
        "once",
        "--first",
        "15",
    ]
    assert main([*arguments, "--json"]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    expected = evaluate(folder / "spikes", folder / "rows.npz")
    assert [row["recording"] for row in rows] == [0, 1, 2]
    assert [row["answer"] for row in rows] == [answer["answer"] for answer in expected.answers]


def test_recordings_without_an_answer_are_counted(folder, capsys):
    (folder / "short.csv").write_text("0 0 0 0\n" * 5)
    assert main(["stream", str(folder / "spikes"), str(folder / "short.csv")]) == 0
    captured = capsys.readouterr()
    assert captured.out.count("\n") == 1  # the names of the columns
    assert captured.err == "1 of 1 recordings ended before an answer\n"


@pytest.mark.parametrize(
    ("kind", "text", "message"),
    [
        ("spikes", "1 0 0\n", "line 1 must have 4 numbers, got 3"),
        ("spikes", "a b c d\n0 0 0 0\n0 x 0 0\n", "line 3 must have numbers, got 'x'"),
        ("spikes", "0 0 0 0\n\n0 0 2 0\n", "line 3 must have 0 or 1 of every channel, got 2"),
        ("spikes", "0 0 nan 0\n", "line 1 must have finite numbers, got nan"),
        ("spikes", "0 0 0 0\n\xff\n", "line 2 must have numbers, got '"),
        ("events", "1 2 0\n", "line 1 must have the 4 numbers t_us x y polarity, got 3"),
        ("events", "9 2 0 1\n8 2 0 1\n", "line 2 must not be earlier than the one before, at 9 us, got 8"),
        ("events", "9 2 0 1\n7\n", "line 2 must not be earlier than the one before, at 9 us, got 7"),
        ("events", "9 4 0 1\n", "line 1 must have x below 4 and y below 1, got 4 and 0"),
        ("events", "9 1 0 7\n", "line 1 must have the polarity 0 or 1, got 7"),
        ("events", "9.5 1 0 1\n", "line 1 must have whole numbers, got '9.5 1 0 1'"),
        ("events", f"{2**63} 1 0 1\n", "line 1 must have a time from 0 to"),
    ],
)
def test_malformed_lines_are_named(kind, text, message, folder, tmp_path, capsys):
    path = tmp_path / "x.csv"
    path.write_text(text, encoding="latin-1")
    assert main(["stream", str(folder / kind), str(path)]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"{path}: {message}") and error.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["x.csv", "--data", "x.npz"], "a stream must have one source, got file and data"),
        (["no.csv"], "no.csv: No such file or directory"),
        (["x", "--every", "2", "--window", "once"], "--every is a rule of its own and excludes --window"),
        (["x", "--first", "3"], "--first needs --window or --every"),
    ],
)
def test_wrong_arguments_are_one_line(arguments, message, folder, capsys):
    assert main(["stream", str(folder / "spikes"), *arguments]) == 2
    assert capsys.readouterr().err == f"{message}\n"


def test_events_and_times_decide(folder):
    made = bundle.read(folder / "events")
    assert made.input is not None
    lines = b"t,x,y,p\n100,1,0,1\n1100;2;0;0\n1200 2 0 1\n21100\n"
    [recording] = [
        x._replace(items=list(x.items))
        for x in sources.recordings_of_lines([lines[:20], lines[20:]], made.input, "x", Windows("once"))
    ]
    assert [type(x) for x in recording.items] == [Block, Block, Passed]
    stream = Stream(made, Windows("once"))
    assert [x for item in recording.items[:2] for x in stream.push(item)] == []
    [decision] = stream.push(Passed(20_100))
    assert list(sources.played(made, [recording])) == [decision, sources.End(0)]


def test_a_pipe_is_answered_as_it_speaks(folder):
    command = [sys.executable, "-m", "dse", "stream", str(folder / "spikes"), "--window", "restart"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as running:
        assert running.stdin and running.stdout
        running.stdin.write("1 1 1 1\n" * 60)
        running.stdin.flush()
        assert running.stdout.readline().startswith("recording,window,")
        assert running.stdout.readline().startswith("0,0,0.0,")  # before the pipe is closed
        running.send_signal(signal.SIGINT)
        assert running.wait(60) == 0
