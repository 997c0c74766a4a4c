"""`dse dashboard` as a program: the page of a study that runs, how it ends, and what it refuses."""

from __future__ import annotations

import http.client
import json
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from dse.cli import main
from dse.dashboard.study import write_page
from dse.report import gather_marks
from dse.study import results
from tests import tiny_study
from tests.page_data import held
from tests.report.made import write

ROOT = Path(__file__).resolve().parent.parent.parent
# Tables are written at most once a minute; here after each run.
RUN = """
import sys
from dse.study import explore
from tests.tiny_study import run_folder
explore._REFRESH_S, explore._REFRESH_SHARE = 0.0, float("inf")
sys.exit(run_folder(sys.argv[1]))
"""


@pytest.fixture
def fake_model() -> Iterator[None]:
    tiny_study.register()
    yield
    tiny_study.unregister()


@contextmanager
def shown(*arguments: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Run `dse dashboard`, and yield its process and the address that it printed."""
    command = [sys.executable, "-m", "dse", "dashboard", *arguments]
    with subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None
            yield process, process.stdout.readline().split()[0]
        finally:
            process.kill()


def ask(url: str, path: str) -> Any:
    at = urlsplit(url)
    connection = http.client.HTTPConnection("127.0.0.1", at.port, timeout=20)
    try:
        connection.request("GET", path)
        answer = connection.getresponse()
        body = answer.read()
        return (answer.status, json.loads(body)) if answer.status == 200 else (answer.status, None)
    finally:
        connection.close()


def study_folder(path: Path, **changes: Any) -> Path:
    """Return the folder of a study that has not run."""
    space = tiny_study.make_space(path, **changes)
    folder = path / "results" / "tiny"
    folder.mkdir(parents=True)
    (folder / "search_space.yaml").write_text(space.source.read_text(encoding="utf-8"), encoding="utf-8")
    return folder


def test_a_page_from_before_the_first_trial_to_the_last(
    fake_model: None, chromium: Any, tmp_path: Path
) -> None:
    model = {"kind": "fake", "hidden": {"choice": [[4], [8], [16]]}, "seconds": 2.5}
    space = tiny_study.make_space(tmp_path, model=model, execution={"jobs": 1})
    folder = tmp_path / "results" / space.study
    run = subprocess.Popen([sys.executable, "-c", RUN, str(tmp_path)], cwd=ROOT, stderr=subprocess.PIPE)
    with run:
        while not (folder / "search_space.yaml").exists():
            assert run.poll() is None
        with shown(str(folder), "--port", "0") as (process, url):
            tab = chromium.new_page()
            faults: list[str] = []
            tab.on("pageerror", lambda error: faults.append(str(error)))
            tab.on("console", lambda line: faults.append(line.text) if line.type == "error" else None)
            tab.add_init_script(
                "window.seen = []; addEventListener('live', (e) => seen.push(e.detail.counts))"
            )
            tab.goto(url)
            tab.wait_for_function(
                "document.querySelector('#counts').textContent.startsWith('3 finished')", timeout=60_000
            )
            assert run.wait(60) == 0
            # It grew: from an empty page, or from one trial, by what the server sent meanwhile.
            counts = tab.evaluate("window.seen.map((counts) => counts.finished ?? 0)")
            assert counts == sorted(counts)
            assert len(counts) >= 2
            assert counts[-1] == 3
            assert ask(url, "/trials.parquet") == (404, None)
            page = ask(url, "/data.json")[1]["page"]
            process.send_signal(signal.SIGINT)
            rest, errors = process.communicate(timeout=20)
            tab.close()
    assert (process.returncode, rest, errors) == (0, "ended\n", "")
    assert faults == []
    written = held(write_page(results.open(folder), tmp_path / "page.html"))
    assert sorted(written.pop("details")) == ["0", "1", "2"]  # which a server sends when they are asked for
    # The server does not know the family of these tests, and so not how many designs there are.
    assert [one.pop("progress")["runs"]["done"] for one in (page, written)] == [3, 3]
    assert page == written


def test_a_study_that_never_ran(fake_model: None, tmp_path: Path) -> None:
    with shown(str(study_folder(tmp_path)), "--port", "0") as (_, url):
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+/", url)
        status, answer = ask(url, "/data.json")
    assert (status, answer["page"]["name"]) == (200, "tiny")
    assert answer["page"]["state"]["title"] == "No design yet"


def test_other_hosts_are_given_a_token(fake_model: None, tmp_path: Path) -> None:
    with shown(str(study_folder(tmp_path)), "--port", "0", "--host", "0.0.0.0") as (_, url):
        assert ask(url, "/data.json") == (403, None)
        assert ask(url, f"/data.json?{urlsplit(url).query}")[0] == 200


def test_a_taken_port_is_one_line(
    fake_model: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert main(["dashboard", str(study_folder(tmp_path)), "--port", str(port)]) == 2
    error = capsys.readouterr().err
    assert error == (
        f"127.0.0.1:{port}: Address already in use; --port N takes another port, --port 0 any that is free\n"
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--port", "70000"], "must be an integer from 0 to 65535, got '70000'"),
        (["--port", "-1"], "must be an integer from 0 to 65535"),
        (["--host", "192.0.2.1", "--port", "0"], "192.0.2.1:0: Cannot assign requested address\n"),
        (
            ["--html", "page.html", "--port", "1"],
            "--port: applies to a served page and cannot be combined with --html",
        ),
        (["--html", "page.html", "--host", "x"], "--host: applies to a served page"),
    ],
)
def test_what_cannot_be_served_is_said(
    fake_model: None,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    message: str,
) -> None:
    try:
        code = main(["dashboard", str(study_folder(tmp_path)), *arguments])
    except SystemExit as ended:  # argparse
        code = int(str(ended.code))
    assert code == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("more", [["--html", "page.html", "--port", "1"], []])
def test_a_page_definition_is_read_before_anything_else(
    fake_model: None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    more: list[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.yaml").write_text("views: [tabel]\nsort: 3\n", encoding="utf-8")
    assert main(["dashboard", str(study_folder(tmp_path)), "--page", "mine.yaml", *more]) == 2
    out, error = capsys.readouterr()
    lines = error.splitlines()
    assert out == "", "no server was started"
    assert not Path("page.html").exists()
    assert lines[: len(lines) - 2] == [
        "--port: applies to a served page and cannot be combined with --html"
    ] * (1 if more else 0)
    assert lines[-2].startswith("mine.yaml:1: unknown views[0] 'tabel'; known: front, ")
    assert lines[-1] == "mine.yaml:2: sort must be text, got 3"


def test_a_page_of_another_definition_and_published_designs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = write(tmp_path / "made", [{"accuracy": 0.8, "n_weights": 100}, {"accuracy": 0.6, "n_weights": 10}])
    own = tmp_path / "own.yaml"
    own.write_text("title: mine\nviews: [table]\ntable: [n_weights, n_cores]\n", encoding="utf-8")
    path = tmp_path / "page.html"
    assert main(["dashboard", str(made.folder), "--html", str(path), "--page", str(own)]) == 0
    assert capsys.readouterr().out == f"{path}\n"
    page = held(path)
    assert (page["definition"]["title"], page["definition"]["views"]) == ("mine", ["table"])
    assert page["definition"]["table"] == ["n_weights"]
    assert any("has no n_cores" in note for note in page["notes"])
    assert page["marks"] == gather_marks(made)
    assert {mark["name"][0] for mark in page["marks"]} == {"A", "D"}
    with shown(str(made.folder), "--port", "0", "--page", str(own)) as (_, url):
        served = ask(url, "/data.json")[1]["page"]
    assert all(served[part] == page[part] for part in ("definition", "marks", "notes"))


def test_a_study_of_before_families_has_a_page_without_published_designs(tmp_path: Path) -> None:
    made = write(tmp_path / "old", [{"accuracy": 0.8}])
    made.points().drop(columns="family").to_parquet(made.folder / "points.parquet")
    page = held(write_page(made, tmp_path / "page.html"))
    assert page["marks"] == []
    assert any("Published designs are not drawn beside: " in note for note in page["notes"])
