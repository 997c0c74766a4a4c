"""Workers answer, and say what became of them."""

import sys

import pytest

from benchmarks.worker import NotInstalled, Worker


def echo():
    return Worker(sys.executable, "tests.benchmarks.echo")


def test_a_worker_answers_on_one_thread_whatever_is_printed():
    with echo() as worker:
        assert worker.ask("echo", 1, "two", [3.5]) == [1, "two", [3.5]]
        assert worker.ask("echo") == []
        assert worker.ask("threads") == "1"


def test_a_missing_framework_or_python_is_not_installed():
    with echo() as worker, pytest.raises(NotInstalled, match="no_such_framework"):
        worker.ask("missing")
    with pytest.raises(NotInstalled, match="/nowhere/python cannot be run"):
        Worker("/nowhere/python", "tests.benchmarks.echo")


def test_a_failed_worker_says_its_last_line():
    with echo() as worker:
        for _ in range(2):
            with pytest.raises(RuntimeError, match="ValueError: no such thing"):
                worker.ask("fail")
