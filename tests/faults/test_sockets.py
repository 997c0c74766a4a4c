"""Seeded rubbish on the sockets of the page: a request is answered or dropped, the next one is served."""

import random

from dse.show.dashboard.gather import gather_page
from dse.show.dashboard.live import Live
from dse.show.dashboard.serve import Server
from tests.page_data import OBJECTIVES, points
from tests.serving import answer_to, ask, served

HEADERS = "Host: 127.0.0.1\r\nAccept-Encoding: gzip\r\nIf-None-Match: x\r\nContent-Length: 12\r\n"
REQUESTS = [
    f"{method} {path} HTTP/1.1\r\n{HEADERS}\r\n".encode()
    for method in ("GET", "HEAD", "POST", "PUT", "")
    for path in (
        *("/?token=TOKEN", "/data.json?token=TOKEN", "/design.json?trial=1&token=TOKEN"),
        *("/bundle.zip?trial=1&point=2&token=TOKEN", "/data.json", "*", ""),
    )
]


def _spoilt(request, rng):
    content = bytearray(request)
    for _ in range(rng.choice((1, 1, 4, 40))):
        place = rng.randrange(len(content) + 1)
        kind = rng.choice(("flip", "cut", "junk", "more", "line"))
        if kind == "flip" and place < len(content):
            content[place] ^= 1 << rng.randrange(8)
        elif kind == "cut" and place > 4:
            del content[place:]
        elif kind == "junk":
            content[place:place] = rng.randbytes(rng.choice((1, 30, 3000)))
        elif kind == "line":
            content[place:place] = b"\r\n"
        else:
            content += request
    return bytes(content)


def test_no_rubbish_stops_the_server(capsys, n_faults, tried):
    live = Live(lambda: gather_page(points(), name="page", objectives=OBJECTIVES), [], [], dict)
    rng = random.Random(25)
    with served(Server(live, port=0)) as server:
        for number in range(n_faults):
            sent = _spoilt(rng.choice(REQUESTS).replace(b"TOKEN", server.token.encode()), rng)
            answer = answer_to(server, sent)
            assert answer == b"" or answer.startswith((b"HTTP/1.0 ", b"<", b"4")), (number, sent, answer)
            tried["a request to the page"] += 1
            if number % 8 == 7:
                assert ask(server, "/data.json")[0] == 200, (number, sent)
    assert capsys.readouterr().err == ""
