"""A server of a test: let it answer, ask it, and hear its bare words."""

import http.client
import socket
import threading
from contextlib import contextmanager

from tests.waiting import PATIENCE_S


@contextmanager
def served(server):
    """Let a server answer in a thread of its own."""
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def ask(server, path="/", method="GET", body=None, **headers):
    """Send a request, with the token of the server if it names none; return its status, headers and body."""
    if "token=" not in path:
        path = f"{path}{'&' if '?' in path else '?'}token={server.token}"
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=PATIENCE_S)
    try:
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        return answer.status, answer.headers, answer.read()
    finally:
        connection.close()


def connect(server):
    """Return a connection on which nothing was said yet."""
    return socket.create_connection(("127.0.0.1", server.server_port), timeout=PATIENCE_S)


def answer_to(server, sent):
    """Send bytes that need be no request, and return all that comes back."""
    with connect(server) as connection, connection.makefile("rb") as answer:
        connection.sendall(sent)
        connection.shutdown(socket.SHUT_WR)
        return answer.read()
