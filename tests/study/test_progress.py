"""What is said while a study runs: nothing, lines, or a bar; never on stdout."""

from __future__ import annotations

import sys

import pytest

from dse.study.progress import Progress, shown


def report(progress: Progress) -> None:
    progress.expect(1)
    progress.doing("preparing data: 1 of 9 recordings [soon]")
    progress.note("warning: [bold] resting level gives fabric away")
    progress.expect(1)
    progress.advance("trial 0 accuracy 0.9")
    progress.advance("trial 1 failed: [red]")


def test_lines(capsys: pytest.CaptureFixture[str]) -> None:
    with shown(True) as progress:
        report(progress)
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.splitlines() == [
        "warning: [bold] resting level gives fabric away",
        "1/2 trial 0 accuracy 0.9, about 0 s left",
        "2/2 trial 1 failed: [red], about 0 s left",
    ]


def test_what_goes_on_is_a_line_now_and_then(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [0.0]
    monkeypatch.setattr("dse.study.progress.time.monotonic", lambda: clock[0])
    with shown(True) as progress:
        for seconds in (1, 9, 11, 12, 20.5, 21):
            clock[0] = seconds
            progress.doing(f"at {seconds}")
    assert capsys.readouterr().err.splitlines() == ["at 11", "at 21"]


def test_silence(capsys: pytest.CaptureFixture[str]) -> None:
    with shown(False) as progress:
        report(progress)
    assert capsys.readouterr() == ("", "")


def test_a_bar_on_a_terminal(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "120")
    with shown(True) as progress:
        report(progress)
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "2/2" in captured.err
    assert "trial 1 failed: [red]" in captured.err
    assert "[bold] resting level" in captured.err


@pytest.mark.parametrize(("seconds", "text"), [(59.4, "59 s"), (61, "1 min 1 s"), (7260, "2 h 1 min")])
def test_the_time_left_is_readable(
    seconds: float, text: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter([0.0, seconds])
    monkeypatch.setattr("dse.study.progress.time.monotonic", lambda: next(clock))
    with shown(True) as progress:
        progress.expect(2)
        progress.advance("trial 0")
    assert capsys.readouterr().err == f"1/2 trial 0, about {text} left\n"
