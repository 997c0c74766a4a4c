"""`dse dashboard` as a program: the page of a study that runs, how it ends, and what it refuses."""

import http.client
import json
import re
import signal
import socket
import subprocess
import sys
import threading
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from dse import store
from dse.base import registry
from dse.cli import main
from dse.show.dashboard.serve import Server
from dse.show.dashboard.study import write_page
from dse.show.report.gather import gather_marks
from dse.study import results
from tests import tiny_study
from tests.installed import PAPERS
from tests.page_data import held
from tests.show.report.made import write
from tests.waiting import PATIENCE_MS, PATIENCE_S, until

ROOT = Path(__file__).resolve().parent.parent.parent
RUN = "import sys; from tests.tiny_study import run_folder; sys.exit(run_folder(sys.argv[1]))"


@pytest.fixture
def fake_model():
    tiny_study.register()


@contextmanager
def ending(process):
    """Leave no process behind, whatever fails."""
    with process:
        try:
            yield
        finally:
            process.kill()


@contextmanager
def shown(*arguments):
    """Run `dse dashboard`, and yield its process and the address that it printed."""
    command = [sys.executable, "-m", "dse", "dashboard", *arguments]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    with ending(process):
        first = process.stdout.readline()
        assert first, f"{' '.join(command)}: ended without an address"
        yield process, first.split()[0]


def ask(url, path):
    """Ask for a path with the token of an address."""
    at = urlsplit(url)
    connection = http.client.HTTPConnection("127.0.0.1", at.port, timeout=PATIENCE_S)
    try:
        connection.request("GET", f"{path}?{at.query}")
        answer = connection.getresponse()
        body = answer.read()
        return (answer.status, json.loads(body)) if answer.status == 200 else (answer.status, None)
    finally:
        connection.close()


def asked(monkeypatch, *arguments):
    """Run `dse dashboard` in this process and ask it for its data; return its address, status and answer."""
    found, serve_forever = [], Server.serve_forever

    def serve(server):
        thread = threading.Thread(target=serve_forever, args=(server, 0.01))
        thread.start()
        try:
            found.append((server.url, *ask(server.url, "/data.json")))
        finally:
            server.shutdown()
            thread.join()
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Server, "serve_forever", serve)
        assert main(["dashboard", *arguments, "--port", "0"]) == 0
    [answer] = found
    return answer


def study_folder(path, **changes):
    """Return the folder of a study that has not run."""
    space = tiny_study.make_space(path, **changes)
    folder = path / "results" / "tiny"
    folder.mkdir(parents=True)
    (folder / "search_space.yaml").write_text(space.source.read_text(encoding="utf-8"), encoding="utf-8")
    return folder


def test_a_page_from_before_the_first_trial_to_the_last(fake_model, chromium, tmp_path):
    gate = tmp_path / "gate"
    model = {"kind": "fake", "hidden": {"choice": [[4], [8], [16]]}, "gate": str(gate)}
    space = tiny_study.make_space(tmp_path, model=model, execution={"jobs": 1})
    folder = tmp_path / "results" / space.study
    run = subprocess.Popen([sys.executable, "-c", RUN, str(tmp_path)], cwd=ROOT, stderr=subprocess.PIPE)
    with ending(run):
        until(lambda: run.poll() is not None or (folder / "search_space.yaml").exists(), "the study begins")
        assert run.poll() is None
        with shown(str(folder), "--port", "0") as (process, url):
            tab = chromium.new_page()
            tab.set_default_timeout(PATIENCE_MS)
            faults = []
            tab.on("pageerror", lambda error: faults.append(str(error)))
            tab.on("console", lambda line: faults.append(line.text) if line.type == "error" else None)
            tab.add_init_script(
                "window.seen = []; addEventListener('live', (e) => seen.push(e.detail.counts))"
            )
            tab.goto(url)
            tab.wait_for_function("document.querySelector('#state').innerText.includes('Training has begun')")
            gate.touch()
            tab.wait_for_function("window.seen.some((counts) => counts.finished === 3)")
            assert run.wait(PATIENCE_S) == 0
            # It grew from an empty page by what the server sent meanwhile.
            counts = tab.evaluate("window.seen.map((counts) => counts.finished ?? 0)")
            assert counts == sorted(counts)
            assert counts[-1] == 3
            assert ask(url, "/trials.parquet") == (404, None)
            page = ask(url, "/data.json")[1] | ask(url, "/progress.json")[1]
            tab.close()  # it would ask a server that is gone
            process.send_signal(signal.SIGINT)
            rest, errors = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, rest, errors) == (0, "stopped\n", "")
    assert faults == []
    written = held(write_page(results.open(folder), tmp_path / "page.html"))
    assert sorted(written.pop("details")) == ["0", "1", "2"]  # which a server sends when they are asked for
    assert len(written.pop("touches")["designs"]) > 0  # likewise
    assert len(written.pop("cards")) > 0  # likewise
    # The server does not know the family of these tests, and so not how many designs there are.
    assert [one.pop("progress")["runs"]["done"] for one in (page, written)] == [3, 3]
    served, of_page = page.pop("notes"), written.pop("notes")
    [note] = [text for text in served if text not in of_page]  # it has no published designs either
    assert "unknown model.kind 'fake'" in note
    assert page == written


def test_the_first_points_are_shown_at_once_and_a_killed_run_as_stopped(fake_model, chromium, tmp_path):
    gate = tmp_path / "gate"
    model = {"kind": "fake", "hidden": {"choice": [[8], [4]]}, "gate": str(gate)}
    space = tiny_study.make_space(tmp_path, model=model, execution={"jobs": 1})
    folder = tmp_path / "results" / space.study
    run = subprocess.Popen([sys.executable, "-c", RUN, str(tmp_path)], cwd=ROOT, stderr=subprocess.PIPE)
    state = "document.querySelector('#counts').textContent"
    with ending(run):
        until(lambda: run.poll() is not None or (folder / "search_space.yaml").exists(), "the study begins")
        with shown(str(folder), "--port", "0") as (_, url):
            tab = chromium.new_page()
            tab.set_default_timeout(PATIENCE_MS)
            tab.goto(url)
            # The other design waits: its trial does not end before the points of the first are shown.
            tab.wait_for_function("document.querySelectorAll('#front tbody tr').length > 0")
            assert not tab.is_visible("#state")
            tab.wait_for_function(f"{state}.startsWith('running, last sign of life ')")
            tab.wait_for_function(f"{state}.includes(' · 1 done · 1 running')")
            run.kill()
            tab.wait_for_function(f"{state}.startsWith('stopped, last sign of life at ')")
            assert "running" not in tab.inner_text("#counts")
            tab.close()
        gate.touch()  # for a worker that has outlived its coordinator


def test_a_study_that_never_ran(fake_model, tmp_path, monkeypatch):
    url, status, answer = asked(monkeypatch, str(study_folder(tmp_path)))
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/\?token=[0-9a-f]{64}", url)
    assert (status, answer["name"]) == (200, "tiny")
    assert answer["state"]["title"] == "No design yet"


def test_a_taken_port_is_one_line(fake_model, tmp_path, capsys):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert main(["dashboard", str(study_folder(tmp_path)), "--port", str(port)]) == 2
    error = capsys.readouterr().err
    assert error == (
        f"127.0.0.1:{port}: Address already in use; choose another port with --port N, or any free port "
        "with --port 0\n"
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--port", "70000"], "must be in [0, 65535], got 70000"),
        (["--port", "-1"], "must be in [0, 65535], got -1"),
        (["--host", "192.0.2.1", "--port", "0"], "192.0.2.1:0: Cannot assign requested address\n"),
        (["--html", "page.html", "--port", "1"], "--port: applies to a served page and cannot be combined"),
        (["--html", "page.html", "--host", "x"], "--host: applies to a served page"),
    ],
)
def test_what_cannot_be_served_is_said(fake_model, tmp_path, capsys, arguments, message):
    try:
        code = main(["dashboard", str(study_folder(tmp_path)), *arguments])
    except SystemExit as ended:  # argparse
        code = int(str(ended.code))
    assert code == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("more", [["--html", "page.html", "--port", "1"], []])
def test_a_page_definition_is_read_before_anything_else(fake_model, tmp_path, monkeypatch, capsys, more):
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
    assert lines[-2].startswith("mine.yaml:1: unknown views[0] 'tabel'; known: audit, card, chips, ")
    assert lines[-1] == "mine.yaml:2: sort must be text, got 3"


def test_a_page_of_another_definition_and_published_designs(tmp_path, monkeypatch, capsys):
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
    assert {mark["name"][0] for mark in page["marks"]} == ({"A", "D"} if PAPERS else set())
    _, _, served = asked(monkeypatch, str(made.folder), "--page", str(own))
    assert all(served[part] == page[part] for part in ("definition", "marks", "notes"))


VIEW = """
from dataclasses import dataclass
from typing import ClassVar
from dse.base.registry import register

@register("views", "blank")
@dataclass(frozen=True)
class Blank:
    script: ClassVar[str] = "Views.blank = { view() { return { render() {} }; } };"
"""


@pytest.fixture
def plugin(tmp_path):
    """A plugin with the view `blank`, which the tests leave unregistered."""
    before = dict(registry._components.get("views", {}))
    path = tmp_path / "blank.py"
    path.write_text(VIEW, encoding="utf-8")
    yield path
    registry._components["views"] = before


@pytest.mark.parametrize("has_run", [False, True])
def test_a_view_of_a_plugin_of_the_study(fake_model, tmp_path, plugin, monkeypatch, capsys, has_run):
    folder = write(tmp_path / "made", [{"accuracy": 0.8}]).folder if has_run else study_folder(tmp_path)
    space = folder / "search_space.yaml"
    space.write_text(space.read_text(encoding="utf-8") + f"plugins: [{plugin}]\n", encoding="utf-8")
    definition = tmp_path / "mine.yaml"
    definition.write_text("views: [blank, table]\n", encoding="utf-8")
    _, _, served = asked(monkeypatch, str(folder), "--page", str(definition), "--trust")
    assert served["definition"]["views"] == ["blank", "table"]
    if has_run:
        path = tmp_path / "page.html"
        assert main(["dashboard", str(folder), "--html", str(path), "--page", str(definition)]) == 0
        assert "Views.blank = " in path.read_text(encoding="utf-8")
        capsys.readouterr()
    plugin.unlink()
    registry._components.get("views", {}).pop("blank", None)  # as in another process
    registry._plugins.clear()
    assert main(["dashboard", str(folder), "--port", "0", "--page", str(definition)]) == 2
    error = capsys.readouterr().err
    assert "unknown views[0] 'blank'" in error and f"plugin '{plugin}': cannot read " in error


def test_a_damaged_study_has_a_page_without_published_designs(tmp_path):
    made = write(tmp_path / "damaged", [{"accuracy": 0.8}])
    store.run_file(made.folder, 0, 0).unlink()
    page = held(write_page(made, tmp_path / "page.html"))
    assert page["marks"] == []
    assert any("Published designs are not shown: " in note for note in page["notes"])
