"""The server of a live page: what it answers, what it refuses, and the page in a real browser beside it."""

from __future__ import annotations

import contextlib
import gzip
import itertools
import json
import re
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from http import HTTPStatus

import pandas as pd
import pytest

from dse.dashboard.gather import gather_page
from dse.dashboard.live import Live
from dse.dashboard.serve import MOST_OPEN, Download, Refused, Server, Site
from tests.page_data import OBJECTIVES, points
from tests.serving import answer_to, ask, connect, served
from tests.waiting import PATIENCE_MS, PATIENCE_S, until

HOSTILE = ("__proto__", "</script><script>window.hacked=1</script>", "<img src=x onerror=window.hacked=1>")
NOTE = {"trial": 1, "point": None, "text": "x", "pinned": True}


class Folder(Site):
    """A folder with the table of a page; trials 0 to 99 have details, and the point 0 on one chip."""

    def __init__(self, path):
        self.path = path
        self.table = path / "points.parquet"
        self.n_read = 0
        self.asked, self.notes = [], []
        self.at_once = self.most_at_once = 0

    def put(self, frame):
        unfinished = self.path / "unfinished"
        frame.to_parquet(unfinished, index=False)
        unfinished.replace(self.table)

    def gather(self, frame):
        return gather_page(frame, name="fabric", objectives=OBJECTIVES)

    def read(self):
        self.n_read += 1
        notes = [note._asdict() for note in self.notes]
        return self.gather(pd.read_parquet(self.table)) | {"design_notes": notes}

    def live(self):
        empty = lambda: self.gather(pd.DataFrame())  # noqa: E731
        return Live(self.read, [self.table], [self.path / "warnings.json"], empty)

    def details(self, trial):
        self.asked.append(trial)
        if trial == 66:
            raise KeyError("/etc/passwd")
        if trial == 67:
            raise PermissionError(13, "Permission denied", "/etc/passwd")
        if trial > 99:
            raise Refused(HTTPStatus.NOT_FOUND, "There is no such trial.")
        return {"trial": trial, "notes": [], "tasks": {}, "name": HOSTILE[1]}

    def bundle(self, trial, point, hardware):
        self.at_once += 1
        self.most_at_once = max(self.most_at_once, self.at_once)
        time.sleep(0.02)
        self.at_once -= 1
        self.asked.append((trial, point, hardware))
        if trial == 66:
            raise KeyError("/etc/passwd")
        if (point, hardware) != (0, "chip"):
            raise Refused(HTTPStatus.NOT_FOUND, "There is no such point.")
        return Download(f'trial {trial}";\r\nX: y/é.zip', b"PK" + bytes(2000))

    def write(self, note):
        self.notes = [note]
        self.put(pd.read_parquet(self.table))


def running(folder, host="127.0.0.1", port=0, **more):
    return served(Server(folder.live(), host, port, folder, **more))


@pytest.fixture
def folder(tmp_path):
    return Folder(tmp_path)


@pytest.fixture
def server(folder):
    folder.put(points())
    with running(folder) as server:
        yield server


def data(server):
    """Return what the page shows and does not follow from its trials alone."""
    status, _, body = ask(server, "/data.json")
    assert status == 200
    return json.loads(body)


def tag(server, path="/data.json"):
    """Return the tag of the version of a part of the page."""
    return ask(server, path, "HEAD")[1]["ETag"]


def test_the_page_is_the_one_that_a_file_holds(server, folder):
    status, headers, body = ask(server)
    text = body.decode()
    assert (status, headers["Content-Type"]) == (200, "text/html; charset=utf-8")
    held = json.loads(text.split('<script type="application/json" id="data">')[1].split("</script>")[0])
    tags = held.pop("tags")
    assert held == json.loads(json.dumps(folder.read()))
    assert tags == {name: tag(server, f"/{name}") for name in ("data.json", "progress.json")}


def test_only_its_own_scripts_may_run_and_nobody_may_frame_it(server):
    _, headers, body = ask(server)
    stated = re.search(r'http-equiv="Content-Security-Policy" content="([^"]+)"', body.decode())[1]
    policy = headers["Content-Security-Policy"]
    assert policy == f"{stated}; frame-ancestors 'none'"
    assert "base-uri 'none'; form-action 'none'" in stated
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "connect-src 'self'" in policy
    assert "script-src 'unsafe-inline'" not in policy and "unsafe-eval" not in policy
    for path in ("/", "/data.json", "/progress.json", "/nothing"):
        _, headers, _ = ask(server, path)
        assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
        guards = (
            "X-Content-Type-Options",
            "Cache-Control",
            "Referrer-Policy",
            "Cross-Origin-Resource-Policy",
        )
        assert [headers[name] for name in guards] == ["nosniff", "no-store", "no-referrer", "same-origin"]
        assert headers["Access-Control-Allow-Origin"] is None
        assert headers["Server"].strip() == "dse"


def test_only_what_changed_is_sent(server, folder):
    first = tag(server)
    for method in ("GET", "HEAD"):
        status, headers, nothing = ask(server, "/data.json", method, **{"If-None-Match": first})
        assert (status, headers["ETag"], headers["Content-Length"], nothing) == (304, first, None, b"")
    assert folder.n_read == 1, "a table is read once for every time that it is written"
    folder.put(pd.concat([points(), points(trial=5, accuracy=0.99).iloc[:1]], ignore_index=True))
    status, headers, body = ask(server, "/data.json", **{"If-None-Match": first})
    assert (status, folder.n_read) == (200, 2)
    assert headers["ETag"] != first
    assert json.loads(body) == data(server)
    assert json.loads(body)["columns"]["accuracy"]["values"][-1] == 0.99
    assert tag(server) == headers["ETag"]
    folder.put(points())
    assert tag(server) == first
    with running(folder) as another:
        assert tag(another) == first, "a server started again knows what the page has"


def test_answers_are_packed_for_those_who_can_unpack(server):
    _, plain, body = ask(server, "/data.json")
    _, packed, small = ask(server, "/data.json", **{"Accept-Encoding": "br, gzip"})
    assert (plain["Content-Encoding"], packed["Content-Encoding"]) == (None, "gzip")
    assert gzip.decompress(small) == body
    assert len(small) < len(body)


@pytest.mark.parametrize("path", ["/", "/data.json", "/progress.json"])
def test_head_is_get_without_a_body(server, path):
    _, of_get, body = ask(server, path)
    status, headers, nothing = ask(server, path, "HEAD")
    assert (status, nothing) == (200, b"")
    assert headers["Content-Length"] == of_get["Content-Length"] == str(len(body))


@pytest.mark.parametrize("method", ["POST", "PUT", "OPTIONS", "CONNECT"])
def test_other_methods_are_refused(server, method):
    status, headers, body = ask(server, "/", method)
    assert (status, headers["Allow"], body) == (405, "GET, HEAD", b"405 Method Not Allowed\n")


@pytest.mark.parametrize(
    "path",
    [
        *("/points.parquet", "/../../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd"),
        *("/data.json%00.html", "/data.json/", "/data.json;x", "http://127.0.0.1/data.json", "*"),
        *("/design.json/", "/x/../bundle.zip", "/<script>alert(1)</script>"),
    ],
)
def test_no_address_names_a_file(server, path):
    text = answer_to(server, f"GET {path}?token={server.token} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
    assert text.startswith(b"HTTP/1.0 404 ")
    assert text.endswith(b"\r\n\r\n404 Not Found\n")  # nothing that was sent comes back


@pytest.mark.parametrize(
    ("path", "headers", "status"),
    [
        ("/?" + "x" * 100_000, {}, 414),
        ("/data.json?" + "a=b&" * 200, {}, 200),
        ("/data.json?x=%ff%00", {}, 200),
        ("/data.json", {"If-None-Match": "\xff" * 200}, 200),
        ("/", {"Cookie": "x" * 100_000}, 431),
        ("/", {f"X-{k}": "x" for k in range(200)}, 431),
    ],
)
def test_huge_requests_are_refused(server, path, headers, status):
    assert ask(server, path, **headers)[0] == status
    assert ask(server)[0] == 200


@pytest.mark.parametrize(
    "sent", [b"\r\n", b"\x00\xff\r\n\r\n", b"GET\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n", b""]
)
def test_what_is_no_request_does_no_harm(server, sent, capsys):
    answer_to(server, sent)
    assert ask(server)[0] == 200
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
def test_every_request_needs_the_token(folder, host):
    folder.put(points())
    with running(folder, host) as server:
        assert len(server.token) >= 32
        assert server.url.endswith(f":{server.server_port}/?token={server.token}")
        paths = (
            "/",
            "/data.json",
            "/progress.json",
            "/design.json?trial=7",
            "/bundle.zip?trial=7",
            "/nothing",
        )
        for path in paths:
            bare = f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode()
            assert answer_to(server, bare).startswith(b"HTTP/1.0 403 ")
            for token in ("", "wrong", f"{server.token}x", server.token[:-1], "%ff%C3%A9"):
                assert ask(server, f"{path}{'&' if '?' in path else '?'}token={token}")[0] == 403
        assert ask(server, "/note?token=", "POST", json.dumps(NOTE))[0] == 403
        assert folder.asked == folder.notes == []
        assert ask(server, "/data.json", Host="my-machine")[0] == 200
        with running(folder, host) as another:
            assert another.token != server.token


def test_a_taken_port_is_said(server, folder):
    with pytest.raises(OSError, match="Address already in use; choose another port with --port N") as caught:
        Server(folder.live(), port=server.server_port)
    assert caught.value.filename == f"127.0.0.1:{server.server_port}"


def test_a_study_without_a_trial_has_a_face(folder):
    with running(folder) as server:
        assert data(server)["state"]["title"] == "No design yet"
        folder.table.write_bytes(b"PAR1")
        assert data(server)["state"]["title"] == "No table to read"
        folder.put(points())
        assert data(server)["state"] is None


@pytest.mark.parametrize("harm", ["cut", "empty", "text", "missing"])
def test_the_last_good_page_stays(server, folder, harm, capsys):
    good = data(server)
    whole = folder.table.read_bytes()
    if harm == "missing":
        folder.table.unlink()
    else:
        folder.table.write_bytes({"cut": whole[:-100], "empty": b"", "text": b"no table"}[harm])
    kept = data(server)
    note, *others = kept.pop("notes")
    why = "points.parquet cannot be found" if harm == "missing" else "The tables cannot be read"
    assert re.fullmatch(rf"{why} now. The page shows the study as read at \d\d:\d\d:\d\d.", note)
    assert others == good["notes"]
    assert kept == {key: value for key, value in good.items() if key != "notes"}
    assert len(capsys.readouterr().err.splitlines()) >= 1
    folder.put(points())
    assert data(server) == good


def test_a_table_that_is_replaced_while_it_is_read_is_read_again(folder, capsys):
    folder.put(points())

    def read():
        table = folder.read()
        if len(reads) < 2:
            folder.put(points(accuracy=0.25 * (len(reads) + 1)))
            reads.append("cut short")
            raise ValueError("parts of two files")
        return table

    reads = []
    with served(Server(Live(read, [folder.table], [], dict), port=0)) as server:
        assert set(data(server)["columns"]["accuracy"]["values"]) == {0.5}
    assert capsys.readouterr().err == ""


def test_many_at_once_while_the_table_is_written(server, folder):
    stop = threading.Event()
    folder.put(points(accuracy=0.5))

    def write():
        for k in itertools.takewhile(lambda _: not stop.is_set(), itertools.count(1)):
            folder.put(points(accuracy=0.5 + k / 10_000))

    writer = threading.Thread(target=write)
    writer.start()
    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(lambda k: ask(server, ("/data.json", "/nothing")[k % 2]), range(60)))
    stop.set()
    writer.join()
    assert [status for status, _, _ in answers] == [200, 404] * 30
    pages = [json.loads(body) for status, _, body in answers if status == 200]
    assert all(len(set(page["columns"]["accuracy"]["values"])) == 1 for page in pages)
    assert [page["notes"] for page in pages if any("read" in note for note in page["notes"])] == []


@pytest.mark.parametrize(
    "sent", ["", "G", "GET / HTTP/1.1\r\nHost: x\r\n", "GET /?token={} HTTP/1.1\r\n\r\n"]
)
def test_connections_that_say_or_take_nothing_shut_nobody_out(server, sent):
    with contextlib.ExitStack() as stack:
        for _ in range(MOST_OPEN + 20):
            stack.enter_context(connect(server)).sendall(sent.format(server.token).encode())
        assert [ask(server, path)[0] for path in ("/data.json", "/")] == [200, 200]
        assert len(server._open) <= MOST_OPEN
    until(lambda: not server._open, "all connections to be closed once their threads have seen the end")


def test_a_silent_connection_is_closed(server, monkeypatch):
    monkeypatch.setattr("dse.dashboard.serve._Handler.timeout", 0.1)
    with connect(server) as one:
        assert one.recv(1) == b""


def test_two_hundred_readers_at_once_are_all_answered(server):
    with ThreadPoolExecutor(200) as pool:
        answers = list(pool.map(lambda _: ask(server, "/data.json")[0], range(400)))
    assert answers == [200] * 400


def test_while_one_reads_others_get_the_last_page(folder):
    folder.put(points())
    reading, go_on = threading.Event(), threading.Event()
    live = folder.live()
    first = live.version()
    read = live._read

    def slow():
        reading.set()
        assert go_on.wait(PATIENCE_S)
        return read()

    live._read = slow
    folder.put(points(accuracy=0.5))
    with ThreadPoolExecutor(1) as pool:
        new = pool.submit(live.version)
        assert reading.wait(PATIENCE_S)
        assert live.version() is first
        go_on.set()
        assert new.result().data.tag != first.data.tag


# ---- what is asked of one design


def test_the_document_of_a_trial(server, folder):
    status, headers, body = ask(server, "/design.json?trial=7")
    assert (status, headers["Content-Type"]) == (200, "application/json; charset=utf-8")
    assert json.loads(body)["name"] == HOSTILE[1]
    assert b"<" not in body
    assert ask(server, "/design.json?trial=007")[2] == body
    assert folder.asked == [7]
    folder.put(points(accuracy=0.5))
    assert ask(server, "/design.json?trial=7")[2] == body
    assert folder.asked == [7, 7], "other points"
    for trial in (*range(40), 39, 0):
        ask(server, f"/design.json?trial={trial}")
    assert folder.asked == [7, 7, *range(7), *range(8, 40), 0], "so many are kept"


def test_a_document_outlasts_progress(folder):
    page, trials_done = folder.gather(points()), itertools.count()
    folder.put(points())
    live = Live(lambda: {**page, "progress": next(trials_done)}, [folder.table], [], dict)
    with served(Server(live, port=0, site=folder)) as server:
        first = ask(server, "/design.json?trial=7")[2]
        tags = tag(server), tag(server, "/progress.json")
        assert json.loads(ask(server, "/progress.json")[2]) == {"progress": 0}
        folder.put(points())
        assert tag(server) == tags[0]
        assert tag(server, "/progress.json") != tags[1]
        assert json.loads(ask(server, "/progress.json")[2]) == {"progress": 1}
        assert ask(server, "/design.json?trial=7")[2] == first
    assert folder.asked == [7]


def test_a_design_can_be_downloaded(server):
    path = "/bundle.zip?trial=7&point=0&hardware=chip"
    status, headers, body = ask(server, path)
    assert (status, body) == (200, b"PK" + bytes(2000))
    assert headers["Content-Type"] == "application/zip"
    assert headers["Content-Disposition"] == 'attachment; filename="trial_7____X__y__.zip"'
    assert headers["X"] is None
    assert "Content-Encoding" not in headers
    assert headers["X-Content-Type-Options"] == "nosniff"
    status, headers, nothing = ask(server, path, "HEAD")
    assert (status, headers["Content-Length"], nothing) == (200, str(len(body)), b"")


@pytest.mark.parametrize(
    "trial",
    [
        *("", "=", "=../../etc/passwd", "=%2e%2e%2f", "=١", "=%D9%A1", "=1e3", "=+1", "=-1", "=1%00"),
        *("=1_0", "= 1", "=1%0a", "=" + "9" * 10, "=1&trial=1", "=1&trial=2", "[]=1", "=NaN"),
    ],
)
@pytest.mark.parametrize("path", ["/design.json?trial", "/bundle.zip?point=0&hardware=chip&trial"])
def test_a_number_is_digits(server, folder, path, trial):
    path = path.replace("?", f"?token={server.token}&")
    text = answer_to(server, f"GET {path}{trial} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
    assert text.startswith(b"HTTP/1.0 400 ")
    assert text.split(b"\r\n\r\n")[1] in (
        b"trial must be a number of up to nine digits.\n",
        b"trial must be given once.\n",
        b"400 Bad Request\n",
    )
    assert folder.asked == []


@pytest.mark.parametrize(
    ("path", "status", "said"),
    [
        ("/bundle.zip?trial=7&point=1&hardware=chip", 404, "There is no such point.\n"),
        ("/bundle.zip?trial=7&point=0", 404, "There is no such point.\n"),
        ("/bundle.zip?trial=7&point=0&hardware=../../etc/passwd", 404, "There is no such point.\n"),
        ("/bundle.zip?trial=7&point=0&hardware=a&hardware=a", 400, "hardware must be given once.\n"),
        ("/bundle.zip?trial=7&hardware=a", 400, "point must be a number of up to nine digits.\n"),
        ("/bundle.zip?trial=66&point=0&hardware=chip", 500, "500 Internal Server Error\n"),
        ("/design.json?trial=66", 500, "500 Internal Server Error\n"),
        ("/design.json?trial=67", 500, "500 Internal Server Error\n"),
        ("/design.json?trial=100", 404, "There is no such trial.\n"),
    ],
)
def test_a_fault_names_nothing(server, path, status, said, capsys):
    found, headers, body = ask(server, path)
    assert (found, body.decode()) == (status, said)
    assert headers["Content-Type"] == "text/plain; charset=utf-8"
    assert ("passwd" in capsys.readouterr().err) is (status == 500)
    assert ask(server)[0] == 200


def test_one_export_at_a_time(server, folder):
    path = "/bundle.zip?trial=7&point=0&hardware=chip"
    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(lambda _: ask(server, path)[0], range(16)))
    assert answers == [200] * 16
    assert folder.most_at_once == 1


def test_a_server_of_a_page_alone_has_no_designs(folder):
    folder.put(points())
    with served(Server(folder.live(), port=0)) as server:
        for path in ("/design.json?trial=1", "/bundle.zip?trial=1&point=0&hardware=chip"):
            assert ask(server, path)[0] == 404
        assert ask(server, "/note", "POST", json.dumps(NOTE))[0] == 405


def test_a_note_is_whole(server, folder):
    def post(body, path="/note"):
        return ask(server, path, "POST", body if isinstance(body, str) else json.dumps(body))[0]

    assert post(NOTE, path="/data.json") == 405
    assert post("x" * 20_000) == 413
    wrong = [NOTE | {"trial": None}, NOTE | {"point": "1"}, NOTE | {"trial": -1}, NOTE | {"trial": True}]
    wrong += [NOTE | {"text": 3}, NOTE | {"pinned": 1}, [], "x", "[" * 9000, {"trial": 1}]
    assert {post(body) for body in wrong} == {400}
    assert folder.notes == []
    assert post(NOTE) == 204
    assert folder.notes == [tuple(NOTE.values())]


# ---- in a browser


# The page asks every 2 s; a test need not wait that long.
QUICKLY = """(() => {
  const wait = setTimeout;
  globalThis.setTimeout = (what, ms, ...more) => wait(what, ms === 2000 ? 100 : ms, ...more);
})();"""


@pytest.fixture(scope="module")
def only_tab(chromium):
    """The tab of all tests: it has compiled the drawing library, at one address as often as it is opened."""
    context = chromium.new_context(viewport={"width": 1280, "height": 720})
    context.set_default_timeout(PATIENCE_MS)
    context.add_init_script(QUICKLY)
    tab = context.new_page()
    tab.on("pageerror", lambda error: tab.faults.append(str(error)))
    tab.on("console", lambda line: tab.faults.append(line.text) if line.type == "error" else None)
    yield tab
    context.close()


@pytest.fixture
def tab(only_tab):
    """A tab; nothing that its page complains about may be left at the end.

    The browser itself logs requests that find nobody: the page may ask once more after its server has gone.
    """
    only_tab.faults = []
    yield only_tab
    only_tab.goto("about:blank")
    assert [fault for fault in only_tab.faults if "Failed to load resource: net::ERR_" not in fault] == []


@pytest.fixture(scope="module")
def long_served(tmp_path_factory):
    """A folder that is served, at `url`, to all tests that write its table and look."""
    folder = Folder(tmp_path_factory.mktemp("served"))
    folder.put(points())
    with running(folder) as server:
        folder.url = server.url
        yield folder


@pytest.fixture
def watched(tab, long_served):
    """The folder of a study that the tab shows."""
    long_served.put(points())
    tab.goto(long_served.url)
    return long_served


def trials(tab):
    return tab.eval_on_selector_all("#front tbody td:first-child", "cells => cells.map((c) => c.textContent)")


def hears(tab, condition, **arguments):
    tab.wait_for_function(condition, **arguments)


def test_rows_come_in_and_nothing_jumps(tab, watched):
    tab.select_option("#x", "n_weights")
    tab.check("#lx")
    tab.click("#front th button[title=energy_uj]")
    tab.click("#front tbody tr:nth-child(3)")
    tab.focus("#front tbody tr:nth-child(2)")
    assert trials(tab) == ["3", "1", "2", "0"]
    assert tab.inner_text("#design h2") == "Trial 2"
    tab.evaluate("Plotly.relayout('plot', {'yaxis.range': [0.4, 1.1]})")
    # A trial that was asked for earlier ends now: its rows come before those that are there.
    early = points(trial=-1, accuracy=0.97, energy_uj=3.0, n_weights=1).iloc[:1]
    watched.put(pd.concat([early, points()], ignore_index=True))
    hears(tab, "document.querySelectorAll('#front tbody tr').length === 1")
    assert trials(tab) == ["-1"]
    watched.put(pd.concat([early.assign(accuracy=0.3), points()], ignore_index=True))
    hears(tab, "document.querySelectorAll('#front tbody tr').length === 5")
    assert trials(tab) == ["-1", "3", "1", "2", "0"]
    assert tab.inner_text("#design h2") == "Trial 2"
    assert tab.input_value("#x") == "n_weights"
    assert tab.is_checked("#lx")
    assert tab.get_attribute("#front th[aria-sort=ascending] button", "title") == "energy_uj"
    assert tab.evaluate("document.getElementById('plot').layout.yaxis.range") == [0.4, 1.1]
    assert tab.inner_text("#live") == ""


def test_budgets_stay_and_count_what_comes(tab, watched):
    box = tab.locator(".budget", has_text="weights").locator("input:not([type=range])")
    box.fill("15")
    box.press("Enter")
    hears(tab, "location.hash.includes('b.n_weights=15')")
    feasible = tab.inner_text("#tally span:first-child")
    more = points(trial=9, accuracy=0.99, energy_uj=1.0, n_weights=2).iloc[:1]
    watched.put(pd.concat([points(), more], ignore_index=True))
    hears(tab, f"document.querySelector('#tally span').textContent !== {json.dumps(feasible)}")
    assert box.input_value() == "15"
    assert "Trial 9" in tab.inner_text("#pick"), "the new trial is the pick"
    assert "n_weights <= 15" in tab.inner_text("#command")


def test_focus_and_the_third_dimension_stay(tab, watched):
    tab.click("#view-3")
    tab.wait_for_selector("#plot canvas")
    tab.focus("#front tbody tr:nth-child(2)")
    watched.put(pd.concat([points(trial=-1, accuracy=0.01).iloc[:1], points()], ignore_index=True))
    hears(tab, "document.querySelector('#counts').textContent.includes('6 points')")
    assert tab.text_content("#front tr:focus td") == "1"
    assert tab.is_visible("#z")


def status_of_next_answer(tab):
    with tab.expect_response("**/*.json*") as answer:
        pass
    return answer.value.status


def test_nothing_is_drawn_again_while_nothing_changes(tab, watched):
    while status_of_next_answer(tab) != 304:  # the page may still be fetching what was written before
        pass
    tab.evaluate("addEventListener('live', () => { window.drawn = true; })")
    assert [status_of_next_answer(tab) for _ in range(4)] == [304] * 4
    assert tab.evaluate("window.drawn") is None


def test_a_study_grows_from_nothing_and_a_link_waits_for_it(tab, folder):
    with running(folder) as server:
        tab.goto(f"{server.url}#x=n_weights")
        assert "No design yet" in tab.inner_text("main")
        folder.table.write_bytes(b"PAR1")
        hears(tab, "document.querySelector('#state h2').textContent === 'No table to read'")
        folder.put(points())
        tab.wait_for_selector("#plot .plot-container")
        assert tab.input_value("#x") == "n_weights"
        assert trials(tab) == ["0", "1", "2", "3"]
        folder.table.write_bytes(b"")
        hears(tab, "document.querySelector('#notes').textContent.includes('cannot be read')")
        assert trials(tab) == ["0", "1", "2", "3"]
        folder.put(points().iloc[:1])
        hears(tab, "document.querySelectorAll('#front tbody tr').length === 1")
        assert "cannot be read" not in tab.inner_text("#notes")


def test_a_lost_connection_is_said_and_comes_back(tab, folder):
    folder.put(points())
    with running(folder) as server:
        same = {"port": server.server_port, "token": server.token}
        tab.goto(server.url)
        tab.click("#front tbody tr:nth-child(2)")
    hears(tab, "document.querySelector('#live').textContent.startsWith('Connection lost.')")
    assert trials(tab) == ["0", "1", "2", "3"]
    folder.put(points(n_weights=7))
    with running(folder, **same):
        hears(tab, "document.querySelector('#live').textContent === ''")
        assert trials(tab) == ["0", "1", "3"]
        assert tab.inner_text("#design h2") == "Trial 1"
    # The browser itself logs each request that found nobody; nothing else may be said.
    assert {re.sub(r"net::\w+", "", fault) for fault in tab.faults} <= {"Failed to load resource: "}
    tab.faults.clear()


def test_a_token_is_kept_by_the_page(tab, folder):
    folder.put(points())
    with running(folder, "0.0.0.0") as server:
        tab.goto(f"http://127.0.0.1:{server.server_port}/?token={server.token}")
        tab.click("#front tbody tr:nth-child(2)")
        folder.put(points(n_weights=7))
        hears(tab, "document.querySelectorAll('#front tbody tr').length === 3")
        tab.reload()
        assert trials(tab) == ["0", "1", "3"]


def test_hostile_rows_that_come_later_never_run(tab, watched):
    more = {f"model.{HOSTILE[0]}": list(range(5)), HOSTILE[0]: 1.0, HOSTILE[1]: [1.0, 2.0, 3.0, 4.0, 5.0]}
    watched.put(points(task=HOSTILE[2], **more))
    hears(tab, "document.querySelector('#x').textContent.includes('</script>')")
    watched.put(points(task=HOSTILE[1], **(more | {HOSTILE[0]: 2.0})).iloc[:4])
    hears(tab, "document.querySelector('#counts').textContent.includes('4 points')")
    tab.select_option("#x", HOSTILE[1])
    assert tab.evaluate("window.hacked") is None
    # A column is a column whatever its name, also once it was changed.
    assert HOSTILE[0] in tab.eval_on_selector_all("#x option", "o => o.map((x) => x.value)")
    assert tab.locator("img").count() == 0


def test_the_page_writes_a_note_and_shows_it_in_its_table(folder, new_tab):
    folder.put(points(point=0))
    with running(folder) as server:
        tab = new_tab((1280, 720))
        tab.goto(server.url)
        tab.click("#front tbody tr[data-key='1.0']")
        tab.fill("#note-text", "<b>survives rain</b>")
        tab.check("#notes-on input[type=checkbox]")
        tab.click("#notes-on button[type=submit]")
        tab.wait_for_selector("#notes-on li")
        assert "★ Trial 1, point 0 <b>survives rain</b>" in tab.inner_text("#notes-on li").replace("\n", " ")
        assert "★" in tab.inner_text("#front tbody tr[data-key='1.0']")
