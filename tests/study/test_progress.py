"""What is said while a study runs: nothing, lines, or a bar; never on stdout."""

import sys

import pytest

from dse.study.progress import duration, shown


def report(progress):
    progress.expect(1)
    progress.doing("preparing data: 1 of 9 recordings [soon]")
    progress.note("warning: [bold] resting level gives fabric away")
    progress.expect(1)
    progress.plan([1.0])
    progress.advance("trial 0 accuracy 0.9", 1.0)
    progress.advance("trial 1 failed: [red]")


def test_lines(capsys):
    with shown(True) as progress:
        report(progress)
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.splitlines() == [
        "warning: [bold] resting level gives fabric away",
        "1/2 trial 0 accuracy 0.9",
        "2/2 trial 1 failed: [red]",
    ]


def test_work_in_progress_is_a_line_now_and_then(capsys, monkeypatch):
    clock = [0.0]
    monkeypatch.setattr("dse.study.progress.time.monotonic", lambda: clock[0])
    with shown(True) as progress:
        for seconds in (1, 9, 11, 12, 20.5, 21):
            clock[0] = seconds
            progress.doing(f"at {seconds}")
    assert capsys.readouterr().err.splitlines() == ["at 11", "at 21"]


def test_silence(capsys):
    with shown(False) as progress:
        report(progress)
    assert capsys.readouterr() == ("", "")


def on_a_terminal(monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "120")


def test_a_bar_on_a_terminal(capsys, monkeypatch):
    on_a_terminal(monkeypatch)
    with shown(True) as progress:
        report(progress)
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "2/2" in captured.err
    assert "trial 1 failed: [red]" in captured.err
    assert "[bold] resting level" in captured.err
    assert "left" not in captured.err


@pytest.mark.parametrize("is_terminal", [False, True])
def test_the_time_left_is_shown_once_it_is_known(is_terminal, capsys, monkeypatch):
    clock = [0.0]
    monkeypatch.setattr("dse.study.progress.time.monotonic", lambda: clock[0])
    if is_terminal:
        on_a_terminal(monkeypatch)
    with shown(True, n_workers=1) as progress:
        progress.expect(20)
        progress.plan([60.0] * 20)
        for run in range(6):
            clock[0] += 60
            progress.advance(f"trial {run}", 60.0)
    shown_text = capsys.readouterr().err
    assert "about 14 min left" in shown_text
    if not is_terminal:
        *before, _, last = shown_text.splitlines()
        assert last == "6/20 trial 5, about 14 min left"
        assert not any("left" in line for line in before)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        *((1, "10 s"), (59.4, "60 s"), (94, "90 s"), (100, "2 min"), (3500, "58 min")),
        *((3599, "1 h"), (7260, "2 h"), (8000, "2 h 10 min")),
    ],
)
def test_a_duration_is_as_coarse_as_the_estimate(seconds, text):
    assert duration(seconds) == text
