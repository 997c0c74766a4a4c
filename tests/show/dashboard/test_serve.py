"""The server of a live page: what it answers, what it refuses, and the page in a real browser beside it."""

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

from dse.show.dashboard.gather import gather_page
from dse.show.dashboard.live import Live
from dse.show.dashboard.serve import Download, Refused, Server, Site
from tests.page_data import OBJECTIVES, points
from tests.serving import answer_to, ask, connect, served
from tests.waiting import PATIENCE_MS, PATIENCE_S

HOSTILE = ("__proto__", "</script><script>window.hacked=1</script>", "<img src=x onerror=window.hacked=1>")
BUNDLE = "/bundle.zip?trial=7&point=0&hardware=chip"


class Folder(Site):
    """A folder with the table of a page; trials 0 to 99 have details, and the point 0 on one chip."""

    def __init__(self, path):
        self.path = path
        self.table = path / "points.parquet"
        self.n_read = 0
        self.asked = []
        self.at_once = self.most_at_once = 0

    def put(self, frame):
        unfinished = self.path / "unfinished"
        frame.to_parquet(unfinished, index=False)
        unfinished.replace(self.table)

    def gather(self, frame):
        return gather_page(frame, name="fabric", objectives=OBJECTIVES)

    def read(self):
        self.n_read += 1
        return self.gather(pd.read_parquet(self.table))

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


@pytest.fixture(scope="module")
def fixed(tmp_path_factory):
    """A server whose table stays."""
    folder = Folder(tmp_path_factory.mktemp("fixed"))
    folder.put(points())
    with running(folder) as server:
        yield server


def data(server, path="/data.json"):
    status, _, body = ask(server, path)
    assert status == 200
    return json.loads(body)


def tag(server, path="/data.json"):
    """Return the tag of the version of a part of the page."""
    return ask(server, path, "HEAD")[1]["ETag"]


def said(server, path, sent="HTTP/1.1\r\nHost: localhost\r\n\r\n"):
    """Return the first line and the last of the answer to a bare request."""
    head, _, body = answer_to(server, f"GET {path} {sent}".encode()).partition(b"\r\n\r\n")
    return head.split(b"\r\n")[0], body


def test_the_page_is_the_one_that_a_file_holds_and_runs_its_own_scripts_alone(fixed):
    status, headers, body = ask(fixed)
    text = body.decode()
    assert (status, headers["Content-Type"]) == (200, "text/html; charset=utf-8")
    held = json.loads(text.split('<script type="application/json" id="data">')[1].split("</script>")[0])
    assert held.pop("tags") == {name: tag(fixed, f"/{name}") for name in ("data.json", "progress.json")}
    assert held == json.loads(json.dumps(fixed.site.read()))
    stated = re.search(r'http-equiv="Content-Security-Policy" content="([^"]+)"', text)[1]
    policy = headers["Content-Security-Policy"]
    assert policy == f"{stated}; frame-ancestors 'none'"
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "base-uri 'none'; form-action 'none'" in stated and "connect-src 'self'" in policy
    assert "script-src 'unsafe-inline'" not in policy and " 'unsafe-eval'" not in policy
    guards = ("X-Content-Type-Options", "Cache-Control", "Referrer-Policy", "Cross-Origin-Resource-Policy")
    for path in ("/", "/data.json", "/progress.json", "/nothing"):
        _, headers, _ = ask(fixed, path)
        assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
        assert [headers[name] for name in guards] == ["nosniff", "no-store", "no-referrer", "same-origin"]
        assert headers["Access-Control-Allow-Origin"] is None and headers["Server"].strip() == "dse"


@pytest.mark.parametrize("path", ["/", "/data.json", "/progress.json", BUNDLE])
def test_head_is_get_without_a_body_and_texts_are_packed_for_those_who_can_unpack(fixed, path):
    status, of_get, body = ask(fixed, path)
    assert (status, of_get["Content-Encoding"], of_get["Content-Length"]) == (200, None, str(len(body)))
    status, headers, nothing = ask(fixed, path, "HEAD")
    assert (status, nothing, headers["Content-Length"]) == (200, b"", str(len(body)))
    _, packed, small = ask(fixed, path, **{"Accept-Encoding": "br, gzip"})
    if path == BUNDLE:
        assert "Content-Encoding" not in packed and small == body
    else:
        assert packed["Content-Encoding"] == "gzip" and gzip.decompress(small) == body


def test_only_what_changed_is_sent(server, folder):
    first = tag(server)
    for method in ("GET", "HEAD"):
        status, headers, nothing = ask(server, "/data.json", method, **{"If-None-Match": first})
        assert (status, headers["ETag"], headers["Content-Length"], nothing) == (304, first, None, b"")
    assert folder.n_read == 1, "a table is read once for every time that it is written"
    folder.put(pd.concat([points(), points(trial=5, accuracy=0.99).iloc[:1]], ignore_index=True))
    status, headers, body = ask(server, "/data.json", **{"If-None-Match": first})
    assert (status, folder.n_read) == (200, 2) and headers["ETag"] == tag(server) != first
    assert json.loads(body) == data(server)
    assert json.loads(body)["columns"]["accuracy"]["values"][-1] == 0.99
    folder.put(points())
    assert tag(server) == first
    with running(folder) as another:
        assert tag(another) == first, "a server started again knows what the page has"


@pytest.mark.parametrize("method", ["POST", "PUT", "CONNECT"])
def test_other_methods_are_refused(fixed, method):
    status, headers, body = ask(fixed, "/", method)
    assert (status, headers["Allow"], body) == (405, "GET, HEAD", b"405 Method Not Allowed\n")


@pytest.mark.parametrize(
    "path",
    [
        *("/points.parquet", "/../../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd"),
        *("/data.json%00.html", "/data.json/", "http://127.0.0.1/data.json", "*"),
        *("/x/../bundle.zip", "/<script>alert(1)</script>"),
    ],
)
def test_no_address_names_a_file(fixed, path):
    found = said(fixed, f"{path}?token={fixed.token}")
    assert found == (b"HTTP/1.0 404 Not Found", b"404 Not Found\n")  # nothing that was sent comes back


def test_who_says_nothing_or_too_much_shuts_nobody_out(fixed, monkeypatch, capsys):
    assert ask(fixed, "/?" + "x" * 100_000)[0] == 414 and ask(fixed, "/", Cookie="x" * 100_000)[0] == 431
    assert ask(fixed, "/data.json?x=%ff%00", **{"If-None-Match": "\xff" * 200})[0] == 200
    with contextlib.ExitStack() as stack:
        for sent in 10 * [
            "",
            "G",
            "GET / HTTP/1.1\r\nHost: x\r\n",
            f"GET /?token={fixed.token} HTTP/1.1\r\n",
        ]:
            stack.enter_context(connect(fixed)).sendall(sent.encode())
        with ThreadPoolExecutor(50) as pool:
            assert set(pool.map(lambda _: ask(fixed, "/data.json")[0], range(100))) == {200}
    monkeypatch.setattr("dse.show.dashboard.serve._Handler.timeout", 0.1)
    with connect(fixed) as one:
        assert one.recv(1) == b"", "a silent connection is closed"
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
def test_every_request_needs_the_token(folder, host):
    folder.put(points())
    with running(folder, host) as server:
        assert len(server.token) >= 32
        assert server.url.endswith(f":{server.server_port}/?token={server.token}")
        for path in ("/", "/data.json", "/progress.json", "/design.json?trial=7", BUNDLE, "/nothing"):
            assert said(server, path)[0].startswith(b"HTTP/1.0 403 ")
            for token in ("", "wrong", f"{server.token}x", server.token[:-1], "%ff%C3%A9"):
                assert ask(server, f"{path}{'&' if '?' in path else '?'}token={token}")[0] == 403
        assert folder.asked == []
        assert ask(server, "/data.json", Host="my-machine")[0] == 200
        with running(folder, host) as another:
            assert another.token != server.token
        with pytest.raises(OSError, match="in use; choose another port with --port N") as caught:
            Server(folder.live(), host, port=server.server_port)
        assert caught.value.filename == f"{host}:{server.server_port}"


def test_a_study_without_a_trial_has_a_face(folder):
    with running(folder) as server:
        assert data(server)["state"]["title"] == "No design yet"
        folder.table.write_bytes(b"PAR1")
        assert data(server)["state"]["title"] == "No table to read"
        folder.put(points())
        assert data(server)["state"] is None


@pytest.mark.parametrize("harm", ["cut", "text", "missing"])
def test_the_last_good_page_stays(server, folder, harm, capsys):
    good = data(server)
    whole = folder.table.read_bytes()
    if harm == "missing":
        folder.table.unlink()
    else:
        folder.table.write_bytes(whole[:-100] if harm == "cut" else b"no table")
    kept = data(server)
    note, *others = kept.pop("notes")
    why = "points.parquet cannot be found" if harm == "missing" else "The tables cannot be read"
    assert re.fullmatch(rf"{why} now. The page shows the study as read at \d\d:\d\d:\d\d.", note)
    assert {**kept, "notes": others} == good
    assert capsys.readouterr().err
    folder.put(points())
    assert data(server) == good


def test_a_table_that_is_written_while_it_is_read_is_read_again(folder, capsys):
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
        stop = threading.Event()

        def write():
            for k in itertools.takewhile(lambda _: not stop.is_set(), itertools.count(1)):
                folder.put(points(accuracy=0.5 + k / 10_000))

        writer = threading.Thread(target=write)
        writer.start()
        with ThreadPoolExecutor(8) as pool:
            answers = list(pool.map(lambda k: ask(server, ("/data.json", "/nothing")[k % 2]), range(40)))
        stop.set()
        writer.join()
    assert [status for status, _, _ in answers] == [200, 404] * 20
    pages = [json.loads(body) for status, _, body in answers if status == 200]
    assert all(len(set(page["columns"]["accuracy"]["values"])) == 1 for page in pages)
    assert [page["notes"] for page in pages if any("read" in note for note in page["notes"])] == []
    assert capsys.readouterr().err == ""


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


def test_the_document_of_a_trial_is_made_once_for_each_version_of_the_points(folder):
    page, trials_done = folder.gather(points()), itertools.count()
    folder.put(points())
    versions = {"page": page}
    live = Live(lambda: {**versions["page"], "progress": next(trials_done)}, [folder.table], [], dict)
    with served(Server(live, port=0, site=folder)) as server:
        status, headers, body = ask(server, "/design.json?trial=7")
        assert (status, headers["Content-Type"]) == (200, "application/json; charset=utf-8")
        assert json.loads(body)["name"] == HOSTILE[1] and b"<" not in body
        assert ask(server, "/design.json?trial=007")[2] == body
        tags = tag(server), tag(server, "/progress.json")
        assert data(server, "/progress.json") == {"progress": 0}
        folder.put(points())
        assert tag(server) == tags[0] and tag(server, "/progress.json") != tags[1]
        assert data(server, "/progress.json") == {"progress": 1}
        assert ask(server, "/design.json?trial=7")[2] == body
        assert folder.asked == [7], "it outlasts progress"
        versions["page"] = folder.gather(points(accuracy=0.5))
        folder.put(points(accuracy=0.5))
        for trial in (*range(40), 39, 0):
            ask(server, f"/design.json?trial={trial}")
    assert folder.asked == [7, *range(40), 0], "so many are kept"


@pytest.mark.parametrize(
    "trial",
    [
        *("", "=", "=../../etc/passwd", "=%2e%2e%2f", "=١", "=%D9%A1", "=1e3", "=-1", "=1%00", "=1_0"),
        *("= 1", "=1%0a", "=" + "9" * 10, "=1&trial=1", "[]=1"),
    ],
)
@pytest.mark.parametrize("path", ["/design.json?trial", "/bundle.zip?point=0&hardware=chip&trial"])
def test_a_number_is_digits(fixed, path, trial):
    fixed.site.asked.clear()
    head, body = said(fixed, path.replace("?", f"?token={fixed.token}&") + trial)
    number, once = b"trial must be a number of up to nine digits.\n", b"trial must be given once.\n"
    assert head.startswith(b"HTTP/1.0 400 ") and body in (number, once, b"400 Bad Request\n")
    assert fixed.site.asked == []


@pytest.mark.parametrize(
    ("path", "status", "text"),
    [
        ("/bundle.zip?trial=7&point=1&hardware=chip", 404, "There is no such point."),
        ("/bundle.zip?trial=7&point=0&hardware=../../etc/passwd", 404, "There is no such point."),
        ("/bundle.zip?trial=7&point=0&hardware=a&hardware=a", 400, "hardware must be given once."),
        ("/bundle.zip?trial=7&hardware=a", 400, "point must be a number of up to nine digits."),
        ("/bundle.zip?trial=66&point=0&hardware=chip", 500, "500 Internal Server Error"),
        ("/design.json?trial=66", 500, "500 Internal Server Error"),
        ("/design.json?trial=67", 500, "500 Internal Server Error"),
        ("/design.json?trial=100", 404, "There is no such trial."),
    ],
)
def test_a_fault_names_nothing(fixed, path, status, text, capsys):
    found, headers, body = ask(fixed, path)
    assert (found, body.decode()) == (status, f"{text}\n")
    assert headers["Content-Type"] == "text/plain; charset=utf-8"
    assert ("passwd" in capsys.readouterr().err) is (status == 500)
    assert ask(fixed)[0] == 200


def test_a_design_can_be_downloaded_one_at_a_time_and_a_page_alone_has_none(fixed):
    with ThreadPoolExecutor(8) as pool:
        status, headers, body = list(pool.map(lambda _: ask(fixed, BUNDLE), range(12)))[-1]
    assert fixed.site.most_at_once == 1
    assert (status, body) == (200, b"PK" + bytes(2000))
    assert headers["Content-Type"] == "application/zip" and headers["X"] is None
    assert headers["Content-Disposition"] == 'attachment; filename="trial_7____X__y__.zip"'
    with served(Server(fixed.site.live(), port=0)) as server:
        assert [ask(server, path)[0] for path in ("/design.json?trial=1", BUNDLE)] == [404, 404]
        assert ask(server, "/data.json", "POST", "{}")[0] == 405


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


@pytest.fixture
def watched(tab, fixed):
    """The folder of a study that the tab shows."""
    fixed.site.put(points())
    tab.goto(fixed.url)
    yield fixed.site
    fixed.site.put(points())


def trials(tab):
    return tab.eval_on_selector_all("#front tbody td:first-child", "cells => cells.map((c) => c.textContent)")


def hears(tab, condition):
    tab.wait_for_function(condition)


def has_rows(tab, n):
    tab.wait_for_function(f"document.querySelectorAll('#front tbody tr').length === {n}")


def status_of_next_answer(tab):
    with tab.expect_response("**/*.json*") as answer:
        pass
    return answer.value.status


def test_rows_come_in_and_nothing_jumps(tab, watched):
    while status_of_next_answer(tab) != 304:  # the page may still be fetching what was written before
        pass
    tab.evaluate("addEventListener('live', () => { window.drawn = true; })")
    assert [status_of_next_answer(tab) for _ in range(4)] == [304] * 4
    assert tab.evaluate("window.drawn") is None, "nothing is drawn again while nothing changes"
    tab.click("#expert summary")
    tab.select_option("#x", "n_weights")
    tab.check("#lx")
    tab.click("#front th button[title=energy_uj]")
    tab.click("#front tbody tr:nth-child(3)")
    tab.focus("#front tbody tr:nth-child(2)")
    assert trials(tab) == ["3", "1", "2", "0"] and "chosen=2" in tab.evaluate("location.hash")
    # A trial that was asked for earlier ends now: its rows come before those that are there.
    early = points(trial=-1, accuracy=0.97, energy_uj=3.0, n_weights=1).iloc[:1]
    watched.put(pd.concat([early, points()], ignore_index=True))
    has_rows(tab, 1)
    assert trials(tab) == ["-1"]
    watched.put(pd.concat([early.assign(accuracy=0.3), points()], ignore_index=True))
    has_rows(tab, 5)
    assert trials(tab) == ["-1", "3", "1", "2", "0"] and "chosen=2" in tab.evaluate("location.hash")
    assert tab.input_value("#x") == "n_weights" and tab.is_checked("#lx")
    assert tab.get_attribute("#front th[aria-sort=ascending] button", "title") == "energy_uj"
    assert tab.inner_text("#live") == ""


def test_limits_and_the_focus_stay(tab, watched):
    box = tab.locator("#budget-1")
    box.fill("60")
    hears(tab, "location.hash.includes('b.energy_uj=60')")
    tab.click("#asks [data-ask=take]")
    tab.focus("#front tbody tr:nth-child(2)")
    focused = tab.text_content("#front tr:focus td")
    more = points(trial=9, accuracy=0.98, energy_uj=59.0, n_weights=45_000).iloc[:1]
    watched.put(pd.concat([more, points()], ignore_index=True))
    hears(tab, "document.querySelector('#cards article').title === 'Trial 9'")
    assert tab.text_content("#front tr:focus td") == focused
    assert box.input_value() == "60" and "98" in tab.inner_text("#sentence strong")
    assert "energy_uj <= 60" in tab.inner_text("#command")


def test_a_study_grows_from_nothing_and_a_link_waits_for_it(tab, folder):
    with running(folder) as server:
        tab.goto(f"{server.url}#x=n_weights")
        assert "No design yet" in tab.inner_text("main")
        folder.table.write_bytes(b"PAR1")
        hears(tab, "document.querySelector('#state h2').textContent === 'No table to read'")
        folder.put(points())
        tab.wait_for_selector("#plot svg")
        assert "x=n_weights" in tab.evaluate("location.hash") and trials(tab) == ["0", "1", "2", "3"]
        folder.table.write_bytes(b"")
        hears(tab, "document.querySelector('#notes').textContent.includes('cannot be read')")
        assert trials(tab) == ["0", "1", "2", "3"]
        folder.put(points().iloc[:1])
        has_rows(tab, 1)
        assert "cannot be read" not in tab.text_content("#notes")


def test_a_lost_connection_is_said_and_comes_back_to_the_same_token(tab, folder):
    folder.put(points())
    with running(folder, "0.0.0.0") as server:
        same = {"port": server.server_port, "token": server.token}
        tab.goto(f"http://127.0.0.1:{server.server_port}/?token={server.token}")
        tab.click("#front tbody tr:nth-child(2)")
    hears(tab, "document.querySelector('#live').textContent.startsWith('Connection lost.')")
    assert trials(tab) == ["0", "1", "2", "3"]
    folder.put(points(n_weights=7))
    with running(folder, "0.0.0.0", **same):
        hears(tab, "document.querySelector('#live').textContent === ''")
        assert trials(tab) == ["0", "1", "3"] and "chosen=1" in tab.evaluate("location.hash")
        tab.reload()
        assert trials(tab) == ["0", "1", "3"], "the page keeps the token"
    # The browser itself logs each request that found nobody; nothing else may be said.
    assert {re.sub(r"net::\w+", "", fault) for fault in tab.faults} <= {"Failed to load resource: "}
    tab.faults.clear()


def test_hostile_rows_that_come_later_never_run(tab, watched):
    more = {f"model.{HOSTILE[0]}": list(range(5)), HOSTILE[0]: 1.0, HOSTILE[1]: [1.0, 2.0, 3.0, 4.0, 5.0]}
    watched.put(points(task=HOSTILE[2], **more))
    tab.evaluate("location.hash = 'expert=1'")
    hears(tab, "document.querySelector('#x').textContent.includes('</script>')")
    watched.put(points(task=HOSTILE[1], **(more | {HOSTILE[0]: 2.0})).iloc[:4])
    hears(tab, "document.querySelector('#counts').textContent.includes('4 settings')")
    tab.select_option("#x", HOSTILE[1])
    assert tab.evaluate("window.hacked") is None
    # A column is a column whatever its name, also once it was changed.
    assert HOSTILE[0] in tab.eval_on_selector_all("#x option", "o => o.map((x) => x.value)")
    assert tab.locator("img").count() == 0
