"""The page of a study while it runs: a small server that reads, and writes notes.

There are five routes to read: `/` is the page; `/data.json` and `/progress.json` are its data, each sent
again after a change (`ETag`); `/design.json` is the details of one trial; `/bundle.zip` is a design point to
download. Two write: `POST /note` is a note on a design, `POST /view` a view under a name; each carries a
token that only the page holds. No address names a file. Every request carries the token of the server, which
the printed address holds: other users of this machine can connect too. One to a loopback address must name
this machine (`Host`) as well.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import gzip
import hashlib
import hmac
import ipaddress
import json
import math
import re
import secrets
import socket
import sys
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

from dse.dashboard.write import Filled, as_json, filled
from dse.text import one_line

PORT = 8050
LOOPBACK = "127.0.0.1"
LONGEST_ADDRESS = 1024
"""Characters of a path with its query; the longest that the page asks for has fewer than 200."""
LONGEST_NOTE = 16_384
"""Bytes of a note or a view that is sent."""
LONGEST_HEADERS = 16_384
"""Characters of all headers of a request."""
MOST_READERS = 64
"""Largest number of connections that are served at once; others wait, and the slowest is closed for them."""
MOST_WAITING = 256
"""Largest number of connections that wait for a place; the system holds back further ones."""
MOST_HOLDERS = 8
"""Places beside these, for requests with the token of the server alone."""
HEAD_S = 10.0
"""Time for the first line of a request, and for its headers, however they drip in; a connection may be closed
for another one much sooner."""
ANSWER_S = 60.0
"""Time for all of an answer to be taken."""
_BACKLOG = 1024  # connections that the system holds back
# A client whose request or answer has taken so long may be closed for another one.
_SLOW_HEAD_S, _SLOW_ANSWER_S = 2.0, 5.0
_POLL_S = 0.05
_WORTH_PACKING = 1024
_NOTHING = "default-src 'none'; base-uri 'none'; form-action 'none'"  # policy of answers that are no page
_GUARDS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",  # the address may hold the token
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Headers of every answer."""
_MOST_DOCUMENTS = 16
"""Number of trials with a document in memory, a few 100 kB each."""

_OFTEN = ("progress",)
"""Keys of a page that change with every trial that ends."""

Page = Mapping[str, Any]
_Connection = socket.socket | tuple[bytes, socket.socket]


class Refused(Exception):
    """A request that is refused: the status of the answer, and one sentence for the reader."""

    def __init__(self, status: HTTPStatus, text: str) -> None:
        super().__init__(text)
        self.status = status


@dataclass(frozen=True)
class Download:
    """A file to send; any character of its name but letters, digits, '.', '_' and '-' is replaced."""

    name: str
    content: bytes


def _no_design(trial: int) -> Page:
    raise Refused(HTTPStatus.NOT_FOUND, "No further details of this design are available.")


def _no_bundle(trial: int, point: int, hardware: str) -> Download:
    raise Refused(HTTPStatus.NOT_FOUND, "Designs cannot be downloaded from this page.")


@dataclass(frozen=True)
class Writing:
    """How notes and views are written.

    token: of the page; a request without it is refused, so that no other page can send one.
    note: trial, point or None, text and pin of a note -> nothing; may raise Refused.
    view: name and link of a view -> nothing; '' for a link removes it; may raise Refused.
    """

    token: str
    note: Callable[[int, int | None, str, bool], None]
    view: Callable[[str, str], None]


@dataclass(frozen=True)
class Document:
    """A part of a page to send; equal parts have equal tags on every server."""

    part: Page

    @functools.cached_property
    def text(self) -> str:
        return as_json(self.part)

    @functools.cached_property
    def tag(self) -> str:
        """Its `ETag`; weak, because the packed answer has the same one."""
        return f'W/"{hashlib.sha256(self.text.encode()).hexdigest()[:32]}"'

    @functools.cached_property
    def packed(self) -> bytes:
        return _packed(self.text.encode())


@dataclass(frozen=True)
class PageVersion:
    """A version of the page: the data from tables, and the progress, which changes with every trial."""

    data: Document
    progress: Document

    @functools.cached_property
    def filled(self) -> Filled:
        tags = {"data.json": self.data.tag, "progress.json": self.progress.tag}
        return filled("page", {**self.data.part, **self.progress.part, "tags": tags}, live=True)


def _version(page: Page, last: PageVersion | None) -> PageVersion:
    """Return the version of a page; a part whose values are the last version's objects is reused."""
    progress = {key: page[key] for key in _OFTEN if key in page}
    data = {key: value for key, value in page.items() if key not in _OFTEN}
    if last is None:
        return PageVersion(Document(data), Document(progress))
    return PageVersion(_renewed(last.data, data), _renewed(last.progress, progress))


def _renewed(document: Document, part: Page) -> Document:
    same = document.part.keys() == part.keys() and all(part[key] is document.part[key] for key in part)
    return document if same else Document(part)


class Live:
    """The page of files that change, in the last version that could be read."""

    def __init__(
        self,
        read: Callable[[], Page],
        required: Sequence[Path],
        optional: Sequence[Path],
        waiting: Callable[[], Page],
        beside: Callable[[], object] = lambda: None,
    ) -> None:
        """Store the files and the functions; nothing is read yet.

        Args:
            read: gathers the page; any exception means that the files cannot be read now. A value that is the
                same object as last time counts as unchanged.
            required: files that a page needs. Every request checks all files; they are read after a change.
            optional: files that may be absent.
            waiting: gathers the page before the files can be read for the first time.
            beside: what else the page depends on: the files are read again when it changes.
        """
        self._read = read
        self._required = required
        self._files = [*required, *optional]
        self._good: Page | None = None
        self._waiting = waiting
        self._beside = beside
        self._read_at = ""
        self._stamps: list[object] = []
        self._version: PageVersion | None = None
        self._reading = threading.Lock()

    def version(self) -> PageVersion:
        """Return the current page, or the last one while another request reads the files."""
        if not self._reading.acquire(blocking=self._version is None):
            assert self._version is not None
            return self._version
        try:
            stamps = self._now()
            if self._version is None or stamps != self._stamps:
                self._version = _version(self._page(), self._version)
                self._stamps = stamps  # files that change during the reading are read again next time
            return self._version
        finally:
            self._reading.release()

    def _now(self) -> list[object]:
        return [*map(stamp, self._files), self._beside()]

    def _page(self, tries: int = 3) -> Page:
        stamps = self._now()
        try:
            page = self._read()
        except Exception as error:  # a file cut short raises nearly anything, and the server goes on
            if tries > 1 and self._now() != stamps:  # replaced meanwhile: parts of two files were read
                return self._page(tries - 1)
            missing = [path.name for path in self._required if not path.exists()]
            if self._good is None and missing:
                return self._waiting()
            print(one_line(str(error)) or type(error).__name__, file=sys.stderr)
            return self._unreadable(missing)
        self._good = page
        self._read_at = time.strftime("%H:%M:%S")
        return page

    def _unreadable(self, missing: Sequence[str]) -> Page:
        fault = f"{' and '.join(missing)} cannot be found" if missing else "The tables cannot be read"
        if self._good is None:
            text = f"{fault}: they are damaged or being written. The page reads them again when they change."
            return {**self._waiting(), "state": {"title": "No table to read", "text": text}}
        note = f"{fault} now. The page shows the study as read at {self._read_at}."
        return {**self._good, "notes": [note, *self._good["notes"]]}


Stamp = tuple[int, int, int]
"""Inode, time of the last change in ns, and size of a file."""


def stamp(path: Path) -> Stamp | None:
    """Return a stamp that changes when a file is written or replaced; None if there is no file."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_ino, status.st_mtime_ns, status.st_size


def _head(connection: socket.socket) -> bytes:
    """Return the head of a request that has come and is not read yet; b'' until all of it has come."""
    try:
        # A second handle has no timeout: with one, recv would wait for it even where it is told not to.
        with socket.fromfd(connection.fileno(), connection.family, connection.type) as look:
            sent = look.recv(LONGEST_ADDRESS + LONGEST_HEADERS, socket.MSG_PEEK | socket.MSG_DONTWAIT)
    except OSError:
        return b""
    head, end, _ = sent.partition(b"\r\n\r\n")
    return head + end if end else b""


@dataclass
class _Open:
    """An open connection: whether it waits for its request ('head'), us ('') or its client ('answer')."""

    socket: socket.socket
    waits_for: str
    since_s: float

    def is_slow(self, head_s: float, answer_s: float) -> bool:
        """Return whether its client has taken longer than it may; a request that lies unread is ours."""
        may_s = {"head": head_s, "answer": answer_s}.get(self.waits_for, math.inf)
        is_late = time.monotonic() - self.since_s > may_s
        return is_late and not (self.waits_for == "head" and _head(self.socket))

    def close(self) -> None:
        """End it; its thread sees that."""
        with contextlib.suppress(OSError):
            self.socket.shutdown(socket.SHUT_RDWR)


@dataclass(frozen=True)
class _Waiting:
    """A connection without a place."""

    socket: socket.socket
    address: Any
    since_s: float

    def path(self) -> str:
        """Return the address that its request asks for; '' until the whole head has come."""
        words = _head(self.socket).partition(b"\r\n")[0].decode("latin-1").split()
        return words[1] if len(words) > 1 else ""


class Server(ThreadingHTTPServer):
    """A server of a live page with one thread for each request.

    Who sends a request within two seconds and takes the answer is always served: if there is no place, it
    waits, and the clients that have been slow for longest are closed. Requests that carry the token do not
    wait for the others: places are kept free for them.
    """

    request_queue_size = _BACKLOG

    def __init__(
        self,
        live: Live,
        host: str = LOOPBACK,
        port: int = PORT,
        design: Callable[[int], Page] = _no_design,
        bundle: Callable[[int, int, str], Download] = _no_bundle,
        writing: Writing | None = None,
        token: str = "",
    ) -> None:
        """Bind the port.

        Args:
            live: the page.
            host: name or address to listen on.
            port: 0 for any free port.
            design: number of a trial -> its details; may raise Refused. Called once for each version of the
                page's points.
            bundle: trial, point and hardware -> a file; may raise Refused. Never called concurrently.
            writing: how notes and views are written; None: they are not.
            token: of every request; '': a new one. With the same one, open pages find a server that returns.

        Raises:
            OSError: the host is not an address of this machine, or the port is in use; the text is for users.
        """
        self.live = live
        self._design, self._bundle, self.writing = design, bundle, writing
        self._documents: OrderedDict[tuple[str, int], str] = OrderedDict()
        self._gathering, self._exporting = threading.Lock(), threading.Lock()
        self._open: dict[int, _Open] = {}
        self._waiting: list[_Waiting] = []
        self._opening = threading.RLock()
        try:
            family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
            self.address_family = family
            super().__init__(address[:2], _Handler)  # type: ignore[arg-type]
        except OSError as error:
            busy = "; choose another port with --port N, or any free port with --port 0"
            why = f"{error.strerror}{busy if error.errno == errno.EADDRINUSE else ''}"
            raise OSError(error.errno, why, f"{host}:{port}") from error
        bound = ipaddress.ip_address(str(self.server_address[0]))
        self.token, self.is_local = token or secrets.token_urlsafe(24), bound.is_loopback
        # If the server listens on every address, readers use the name of the machine.
        name = socket.gethostname() if bound.is_unspecified else str(bound)
        self._name = f"[{name}]" if ":" in name else name
        self.hosts = {self._name, host.lower(), "localhost"}

    @property
    def url(self) -> str:
        """The address of the page for a browser."""
        return f"http://{self._name}:{self.server_port}/?token={self.token}"

    def document(self, trial: int) -> str:
        """Return the details of a trial, as JSON.

        Raises:
            Refused: there is nothing to show.
        """
        key = self.live.version().data.tag, trial
        with self._gathering:
            if key not in self._documents:
                self._documents[key] = as_json(self._design(trial))
            self._documents.move_to_end(key)
            while len(self._documents) > _MOST_DOCUMENTS:
                self._documents.popitem(last=False)
            return self._documents[key]

    def bundle(self, trial: int, point: int, hardware: str) -> Download:
        """Return a design point as a file.

        Raises:
            Refused: there is no such point, or it cannot be exported.
        """
        self.live.version()
        with self._exporting:
            return self._bundle(trial, point, hardware)

    def process_request(self, request: _Connection, client_address: object) -> None:
        """Let a connection wait for a place; it has one at once while fewer than `MOST_READERS` are open."""
        assert isinstance(request, socket.socket)
        with self._opening:
            self._waiting.append(_Waiting(request, client_address, time.monotonic()))
        self._admit()
        while len(self._waiting) >= MOST_WAITING:
            time.sleep(_POLL_S)
            self.service_actions()

    def process_request_thread(self, request: _Connection, client_address: object) -> None:
        """Answer, and hand the place of the connection on."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            with self._opening:
                del self._open[id(request)]
            self._admit()

    def _admit(self) -> None:
        """Start a thread for every connection that waits and has a place, the oldest first."""
        with self._opening:
            for each in list(self._waiting):
                n_open = len(self._open)
                if n_open < MOST_READERS or (n_open < MOST_READERS + MOST_HOLDERS and self._is_holder(each)):
                    self._waiting.remove(each)
                    self._open[id(each.socket)] = _Open(each.socket, "head", time.monotonic())
                    try:
                        super().process_request(each.socket, each.address)
                    except RuntimeError:  # the machine starts no further thread
                        del self._open[id(each.socket)]
                        self.shutdown_request(each.socket)

    def _is_holder(self, waiting: _Waiting) -> bool:
        """Return whether the request of a connection that waits carries the token."""
        return self.carries_token(waiting.path())

    def carries_token(self, path: str) -> bool:
        """Return whether an address has the token of the server in its query."""
        token = parse_qs(path.partition("?")[2], errors="replace").get("token", [""])[-1]
        return hmac.compare_digest(token.encode(), self.token.encode())

    def waits_for(self, request: socket.socket, what: str) -> None:
        """Note what a connection waits for from now on."""
        with self._opening:
            self._open[id(request)] = _Open(request, what, time.monotonic())

    def service_actions(self) -> None:
        """Close connections that have taken all of their time, or more than others leave them; give places.

        Called after every connection, and about twice a second.
        """
        self._close_slow(HEAD_S, ANSWER_S, most=len(self._open))
        self._close_slow(_SLOW_HEAD_S, _SLOW_ANSWER_S, most=len(self._waiting))
        if len(self._waiting) >= MOST_WAITING:
            self._drop_silent()
        self._admit()

    def _drop_silent(self) -> None:
        """Close the connections that wait for a place and have not sent a request for a while."""
        with self._opening:
            for each in list(self._waiting):
                if time.monotonic() - each.since_s > _SLOW_HEAD_S and not _head(each.socket):
                    self._waiting.remove(each)
                    self.shutdown_request(each.socket)

    def _close_slow(self, head_s: float, answer_s: float, most: int) -> None:
        """Close at most so many connections whose client has taken longer, the slowest first."""
        with self._opening:
            slow = [each for each in self._open.values() if each.is_slow(head_s, answer_s)]
        for each in sorted(slow, key=lambda each: each.since_s)[:most]:
            each.close()

    def server_close(self) -> None:
        """Close the port, and the connections that wait for a place."""
        super().server_close()
        with self._opening:
            for each in self._waiting:
                self.shutdown_request(each.socket)
            self._waiting.clear()

    def handle_error(self, request: _Connection, client_address: object) -> None:
        """Ignore lost connections; print any other error."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)

    def server_bind(self) -> None:
        """Bind without the query to a name server that HTTPServer makes."""
        super(ThreadingHTTPServer, self).server_bind()


class _Handler(BaseHTTPRequestHandler):
    server: Server
    timeout = ANSWER_S
    server_version = "dse"
    sys_version = ""

    def parse_request(self) -> bool:
        """Read the headers; the time for them begins with the first line, however late we read it."""
        self.server.waits_for(self.connection, "head")
        return super().parse_request()

    def do_GET(self) -> None:
        self.server.waits_for(self.connection, "")
        refused = self._refused()
        if refused:
            self.send_error(refused)
            return
        path, _, query = self.path.partition("?")
        if path == "/":
            page = self.server.live.version().filled
            self._send("text/html", page.html.encode(), policy=page.policy)
        elif path == "/data.json":
            self._send_document(self.server.live.version().data)
        elif path == "/progress.json":
            self._send_document(self.server.live.version().progress)
        elif path in ("/design.json", "/bundle.zip"):
            self._send_design(path, query)
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    do_HEAD = do_GET

    def do_POST(self) -> None:
        """Write a note: an object with trial, point, text and pinned; or a view: name and link."""
        # The body belongs to the request: it must come within the time for that.
        if refused := self._refused() or self._unwritable():
            self.send_error(refused)
            return
        writing = self.server.writing
        assert writing is not None
        body = self.rfile.read(int(self.headers["Content-Length"]))
        self.server.waits_for(self.connection, "")
        try:
            if self.path.partition("?")[0] == "/note":
                writing.note(*_note(body))
            else:
                writing.view(*_view(body))
        except Refused as reason:
            self._answer(reason.status, str(reason))
        except Exception as error:  # a damaged study raises nearly anything, and the server goes on
            print(one_line(str(error)) or type(error).__name__, file=sys.stderr)
            self.send_error(HTTPStatus.INTERNAL_SERVER_ERROR)
        else:
            self._reply(HTTPStatus.NO_CONTENT, {})

    def _unwritable(self) -> HTTPStatus | None:
        """Return why a request to write is refused, or None."""
        writing = self.server.writing
        if writing is None or self.path.partition("?")[0] not in ("/note", "/view"):
            return HTTPStatus.METHOD_NOT_ALLOWED
        if not hmac.compare_digest(self.headers.get("X-Note-Token", "").encode(), writing.token.encode()):
            return HTTPStatus.FORBIDDEN
        length = self.headers.get("Content-Length", "")
        if not (length.isascii() and length.isdecimal() and len(length) < 10):
            return HTTPStatus.LENGTH_REQUIRED
        return HTTPStatus.REQUEST_ENTITY_TOO_LARGE if int(length) > LONGEST_NOTE else None

    def _send_design(self, path: str, query: str) -> None:
        """Send the details or the bundle of one design, or the reason of a refusal."""
        text, download = "", None
        try:
            if path == "/design.json":
                text = self.server.document(_number(query, "trial"))
            else:
                trial, point = _number(query, "trial"), _number(query, "point")
                download = self.server.bundle(trial, point, _once(query, "hardware"))
        except Refused as refused:
            self._answer(refused.status, str(refused))
        except Exception as error:  # a damaged study raises nearly anything, and the server goes on
            print(one_line(str(error)) or type(error).__name__, file=sys.stderr)
            self.send_error(HTTPStatus.INTERNAL_SERVER_ERROR)
        else:
            if download is None:
                self._send("application/json", text.encode())
            else:
                self._send_file(download)

    def _send_file(self, download: Download) -> None:
        name = re.sub(r"[^A-Za-z0-9._-]", "_", download.name)
        headers = {
            "Content-Type": "application/zip",
            "Content-Disposition": f'attachment; filename="{name}"',
        }
        self._reply(HTTPStatus.OK, headers, download.content)

    def _refused(self) -> HTTPStatus | None:
        """Return why a request is not answered, or None."""
        if len(self.path) > LONGEST_ADDRESS:
            return HTTPStatus.REQUEST_URI_TOO_LONG
        if sum(len(name) + len(value) for name, value in self.headers.items()) > LONGEST_HEADERS:
            return HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE
        # The name of a foreign page may resolve to this machine; the browser then sends that name.
        named = self.headers.get_all("Host") or []
        if self.server.is_local and (len(named) != 1 or _without_port(named[0]) not in self.server.hosts):
            return HTTPStatus.MISDIRECTED_REQUEST
        return None if self.server.carries_token(self.path) else HTTPStatus.FORBIDDEN

    def _send_document(self, document: Document) -> None:
        """Send a part of the page, or 304 if the reader has this version."""
        if self.headers.get("If-None-Match") == document.tag:
            self._reply(HTTPStatus.NOT_MODIFIED, {"ETag": document.tag})
            return
        self._send(
            "application/json", document.text.encode(), packed=lambda: document.packed, tag=document.tag
        )

    def _send(
        self,
        kind: str,
        body: bytes,
        *,
        policy: str = _NOTHING,
        packed: Callable[[], bytes] | None = None,
        tag: str = "",
    ) -> None:
        is_packed = len(body) > _WORTH_PACKING and "gzip" in self.headers.get("Accept-Encoding", "")
        if is_packed:
            body = packed() if packed else _packed(body)
        headers = {"Content-Type": f"{kind}; charset=utf-8", "Vary": "Accept-Encoding"}
        if is_packed:
            headers["Content-Encoding"] = "gzip"
        if tag:
            headers["ETag"] = tag
        self._reply(HTTPStatus.OK, headers, body, policy)

    def _reply(
        self, status: HTTPStatus, headers: Mapping[str, str], body: bytes = b"", policy: str = _NOTHING
    ) -> None:
        """Send an answer; it has a length only if it has a body, as 304 has none."""
        self.send_response(status)
        self.send_header("Content-Security-Policy", f"{policy}; frame-ancestors 'none'")
        for name, value in {**_GUARDS, **headers}.items():
            self.send_header(name, value)
        if body:
            self.send_header("Content-Length", str(len(body)))
        self.server.waits_for(self.connection, "answer")
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Answer with the status alone: nothing that was sent comes back."""
        # The base class knows a method by our having a function for it, and calls others unsupported.
        known = HTTPStatus.METHOD_NOT_ALLOWED if code == HTTPStatus.NOT_IMPLEMENTED else HTTPStatus(code)
        self._answer(known, f"{known.value} {known.phrase}")

    def _answer(self, known: HTTPStatus, text: str) -> None:
        """Answer with one line of text."""
        headers = {"Content-Type": "text/plain; charset=utf-8"}
        if known is HTTPStatus.METHOD_NOT_ALLOWED:
            headers["Allow"] = "GET, HEAD"
        self._reply(known, headers, f"{text}\n".encode())

    def log_message(self, format: str, *args: object) -> None:
        """Keep no log: an address may hold the token."""


def _note(body: bytes) -> tuple[int, int | None, str, bool]:
    """Return trial, point, text and pin of a note that was sent.

    Raises:
        Refused: it is something else.
    """
    try:
        note = json.loads(body)
        trial, point, text, pinned = (note[key] for key in ("trial", "point", "text", "pinned"))
    except (ValueError, TypeError, KeyError, RecursionError):
        raise Refused(HTTPStatus.BAD_REQUEST, "A note must have trial, point, text and pinned.") from None
    is_number = all(
        type(value) is int and 0 <= value < 10**9 for value in (trial, point) if value is not None
    )
    if trial is None or not is_number or not isinstance(text, str) or not isinstance(pinned, bool):
        raise Refused(HTTPStatus.BAD_REQUEST, "A note must have trial, point, text and pinned.")
    return trial, point, text, pinned


def _view(body: bytes) -> tuple[str, str]:
    """Return name and link of a view that was sent.

    Raises:
        Refused: it is something else.
    """
    try:
        view = json.loads(body)
        name, link = view["name"], view["link"]
    except (ValueError, TypeError, KeyError, RecursionError):
        name = link = None
    if not isinstance(name, str) or not isinstance(link, str):
        raise Refused(HTTPStatus.BAD_REQUEST, "A view must have name and link.")
    return name, link


def _packed(body: bytes) -> bytes:
    return gzip.compress(body, compresslevel=5, mtime=0)


def _once(query: str, name: str) -> str:
    """Return a field of a query, '' where it is missing.

    Raises:
        Refused: it occurs more than once.
    """
    values = parse_qs(query, errors="replace").get(name, [""])
    if len(values) > 1:
        raise Refused(HTTPStatus.BAD_REQUEST, f"{name} must be given once.")
    return values[0]


def _number(query: str, name: str) -> int:
    """Return a field of a query as a whole number.

    Raises:
        Refused: it is missing, occurs more than once, or is anything but up to nine digits.
    """
    text = _once(query, name)
    if not re.fullmatch("[0-9]{1,9}", text):
        raise Refused(HTTPStatus.BAD_REQUEST, f"{name} must be a number of up to nine digits.")
    return int(text)


def _without_port(host: str) -> str:
    """Return the name of a `Host` header: `[::1]:8050` is `[::1]`."""
    name, _, port = host.lower().rpartition(":")
    return name if port.isdecimal() else host.lower()
