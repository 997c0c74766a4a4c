"""The page of a study while it runs: a small server that only reads.

`/` is the page; `/data.json` and `/progress.json` are its data, each sent again after a change (`ETag`);
`/design.json` is the details of one trial; of a design point `/touch.json` is what plays it, `/card.json` its
model card, `/bundle.zip` it to download.
No address names a file. Every request carries the token of the server, which the printed address holds: other
users of this machine, and pages of others in a reader's browser, can connect too.
"""

from __future__ import annotations

import errno
import functools
import hmac
import ipaddress
import re
import secrets
import socket
import sys
import threading
from collections.abc import Callable, Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import MappingProxyType
from typing import Any, NamedTuple
from urllib.parse import parse_qs

from dse.base.text import one_line
from dse.show.dashboard.live import Document, Live, Page
from dse.show.dashboard.write import as_json, gzipped

PORT = 8050
LOOPBACK = "127.0.0.1"
_WAIT_S = 60.0  # for a client that sends or takes nothing
_MOST_DOCUMENTS = 16  # trials with a document in memory, a few 100 kB each
_NOTHING = "default-src 'none'; base-uri 'none'; form-action 'none'"  # policy of answers that are no page
_GUARDS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",  # the address holds the token
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Headers of every answer."""


class Refused(Exception):
    """A request that is refused: the status of the answer, and one sentence for the reader."""

    def __init__(self, status: HTTPStatus, text: str = "") -> None:
        super().__init__(text or f"{status.value} {status.phrase}")
        self.status = status


class Download(NamedTuple):
    """A file to send; any character of its name but letters, digits, '.', '_' and '-' is replaced."""

    name: str
    content: bytes


class Site:
    """What a server shows beside its page; a site without designs refuses what is asked of one."""

    def details(self, trial: int) -> Page:
        """Return the details of a trial; may raise Refused. Called once for each version of the points."""
        raise Refused(HTTPStatus.NOT_FOUND, "No further details of this design are available.")

    def touches(self, trial: int, point: int) -> Page:
        """Return what plays recordings to a design point; may raise Refused. Called as `details`."""
        raise Refused(HTTPStatus.NOT_FOUND, "Designs cannot be played on this page.")

    def card(self, trial: int, point: int, hardware: str) -> Page:
        """Return the model card of a design point; may raise Refused. Called as `details`."""
        raise Refused(HTTPStatus.NOT_FOUND, "Designs have no model cards on this page.")

    def bundle(self, trial: int, point: int, hardware: str) -> Download:
        """Return a design point as a file; may raise Refused. Never called concurrently."""
        raise Refused(HTTPStatus.NOT_FOUND, "Designs cannot be downloaded from this page.")


class Server(ThreadingHTTPServer):
    """A server of a live page with one thread for each connection; each carries one request."""

    request_queue_size = 1024

    def __init__(
        self, live: Live, host: str = LOOPBACK, port: int = PORT, site: Site | None = None, token: str = ""
    ) -> None:
        """Bind the port.

        port: 0 for any free port. site: details and bundles of designs.
        token: of every request; '': a new one. With the same one, open pages find a server that returns.
        """
        self.live, self.site, self.token = live, site or Site(), token or secrets.token_urlsafe(24)
        self.working = threading.Lock()  # one document or bundle at a time
        self._document = functools.lru_cache(_MOST_DOCUMENTS)(
            lambda points, make, *of: as_json(getattr(self.site, make)(*of)).encode()
        )
        try:
            family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
            self.address_family = family
            super().__init__(address[:2], _Handler)  # type: ignore[arg-type]
        except OSError as error:
            busy = "; choose another port with --port N, or any free port with --port 0"
            why = f"{error.strerror}{busy if error.errno == errno.EADDRINUSE else ''}"
            raise OSError(error.errno, why, f"{host}:{port}") from error

    @property
    def url(self) -> str:
        """The address of the page for a browser."""
        bound = ipaddress.ip_address(str(self.server_address[0]))
        # If the server listens on every address, readers use the name of the machine.
        name = socket.gethostname() if bound.is_unspecified else str(bound)
        return f"http://{f'[{name}]' if ':' in name else name}:{self.server_port}/?token={self.token}"

    def document(self, make: str, *of: int | str) -> bytes:
        """Return what a method of the site tells of a trial or a point, as JSON.

        Raises:
            Refused: there is nothing to show.
        """
        points = self.live.version().data.tag
        with self.working:
            return self._document(points, make, *of)

    def handle_error(self, request: Any, client_address: object) -> None:
        """Ignore lost connections; print any other error."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)

    def server_bind(self) -> None:
        """Bind without the query to a name server that HTTPServer makes."""
        super(ThreadingHTTPServer, self).server_bind()


class _Handler(BaseHTTPRequestHandler):
    server: Server
    timeout = _WAIT_S
    server_version = "dse"
    sys_version = ""

    def do_GET(self) -> None:
        routes = {
            "/": self._page,
            "/data.json": lambda _: self._send_document(self.server.live.version().data),
            "/progress.json": lambda _: self._send_document(self.server.live.version().progress),
            "/design.json": lambda fields: self._told("details", fields, "trial"),
            "/touch.json": lambda fields: self._told("touches", fields, "trial", "point"),
            "/card.json": lambda fields: self._told("card", fields, "trial", "point", chip=True),
            "/bundle.zip": self._bundle,
        }
        self._answer(routes)

    do_HEAD = do_GET

    def _answer(self, routes: Mapping[str, Callable[[Mapping[str, list[str]]], None]]) -> None:
        """Answer a request that carries the token, with a line of text where that fails."""
        path, _, query = self.path.partition("?")
        try:
            fields = parse_qs(query, errors="replace")
            token = fields.get("token", [""])[-1]
            if not hmac.compare_digest(token.encode(), self.server.token.encode()):
                raise Refused(HTTPStatus.FORBIDDEN)
            if path not in routes:
                raise Refused(HTTPStatus.NOT_FOUND)
            routes[path](fields)
        except Refused as refused:
            self._say(refused)
        except (ConnectionError, TimeoutError):  # the client has gone
            raise
        except Exception as error:  # a damaged study raises nearly anything, and the server goes on
            print(one_line(str(error)) or type(error).__name__, file=sys.stderr)
            self._say(Refused(HTTPStatus.INTERNAL_SERVER_ERROR))

    def _page(self, _: object) -> None:
        page = self.server.live.version().filled
        self._send("text/html", page.html.encode(), page.policy)

    def _told(self, make: str, fields: Mapping[str, list[str]], *names: str, chip: bool = False) -> None:
        numbers = [_number(fields, name) for name in names]
        on = [_once(fields, "hardware")] if chip else []
        self._send("application/json", self.server.document(make, *numbers, *on))

    def _bundle(self, fields: Mapping[str, list[str]]) -> None:
        trial, point, hardware = _number(fields, "trial"), _number(fields, "point"), _once(fields, "hardware")
        self.server.live.version()
        with self.server.working:
            download = self.server.site.bundle(trial, point, hardware)
        name = re.sub(r"[^A-Za-z0-9._-]", "_", download.name)
        disposition = f'attachment; filename="{name}"'
        headers = {"Content-Type": "application/zip", "Content-Disposition": disposition}
        self._reply(HTTPStatus.OK, headers, download.content)

    def _send_document(self, document: Document) -> None:
        """Send a part of the page, or 304 if the reader has this version."""
        headers = {"ETag": document.tag}
        if self.headers.get("If-None-Match") == document.tag:
            self._reply(HTTPStatus.NOT_MODIFIED, headers)
        else:
            self._send("application/json", document.text, more=headers, pack=lambda _: document.packed)

    def _send(
        self,
        kind: str,
        body: bytes,
        policy: str = _NOTHING,
        more: Mapping[str, str] = MappingProxyType({}),
        pack: Callable[[bytes], bytes] = gzipped,
    ) -> None:
        """Send a text, packed if the reader can unpack it."""
        headers = {"Content-Type": f"{kind}; charset=utf-8", "Vary": "Accept-Encoding", **more}
        if "gzip" in self.headers.get("Accept-Encoding", ""):
            headers["Content-Encoding"] = "gzip"
            body = pack(body)
        self._reply(HTTPStatus.OK, headers, body, policy)

    def _say(self, refused: Refused) -> None:
        """Answer with one line of text."""
        headers = {"Content-Type": "text/plain; charset=utf-8"}
        if refused.status is HTTPStatus.METHOD_NOT_ALLOWED:
            headers["Allow"] = "GET, HEAD"
        self._reply(refused.status, headers, f"{refused}\n".encode())

    def _reply(
        self, status: HTTPStatus, headers: Mapping[str, str], body: bytes = b"", policy: str = _NOTHING
    ) -> None:
        """Send an answer; it has a length only if it has a body, as 304 has none."""
        self.send_response(status)
        length = {"Content-Length": str(len(body))} if body else {}
        guard = {"Content-Security-Policy": f"{policy}; frame-ancestors 'none'"}
        for name, value in {**guard, **_GUARDS, **headers, **length}.items():
            self.send_header(name, value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Answer with the status alone: nothing that was sent comes back."""
        # The base class knows a method by our having a function for it, and calls others unsupported.
        known = HTTPStatus.METHOD_NOT_ALLOWED if code == HTTPStatus.NOT_IMPLEMENTED else HTTPStatus(code)
        self._say(Refused(known))

    def log_message(self, format: str, *args: object) -> None:
        """Keep no log: an address holds the token."""


def _once(fields: Mapping[str, list[str]], name: str) -> str:
    """Return a field of a query, '' where it is missing."""
    values = fields.get(name, [""])
    if len(values) > 1:
        raise Refused(HTTPStatus.BAD_REQUEST, f"{name} must be given once.")
    return values[0]


def _number(fields: Mapping[str, list[str]], name: str) -> int:
    """Return a field of a query as a whole number."""
    text = _once(fields, name)
    if not re.fullmatch("[0-9]{1,9}", text):
        raise Refused(HTTPStatus.BAD_REQUEST, f"{name} must be a number of up to nine digits.")
    return int(text)
