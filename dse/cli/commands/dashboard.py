"""`dse dashboard`: the page of a study, live or as a file."""

from __future__ import annotations

import argparse
from pathlib import Path

from dse.cli import priced
from dse.cli.answer import Answer
from dse.cli.numbers import draws, port
from dse.config import ConfigError, Fault
from dse.dashboard.study import Asked, page_server, write_page

HELP = "show the page of a study while it runs, or write it as one HTML file that opens without a server"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("results", metavar="RESULTS", help="folder of a study")
    parser.add_argument(
        "--html", type=Path, metavar="FILE", help="write the page there instead of serving it"
    )
    parser.add_argument(
        "--page",
        metavar="PAGE",
        default="study",
        help="parts, axes and budgets of the page: study (default), paper, deployment, or a file",
    )
    priced.add_hardware(parser)
    parser.add_argument(
        "--draws",
        type=draws,
        default=0,
        metavar="N",
        help="draw the figures of the hardware so often: points that stay on the front in few are paler",
    )
    parser.add_argument(
        "--port", type=port, metavar="N", help="where to serve it (default: 8050; 0: any that is free)"
    )
    parser.add_argument(
        "--host",
        metavar="NAME",
        help="where to listen (default: 127.0.0.1, for this machine alone; else the address holds a token)",
    )


def answer(arguments: argparse.Namespace) -> Answer:
    """Write the page and return where it is, or serve it until Ctrl-C."""
    from dse.dashboard import definition

    faults = []
    if arguments.html:
        given = [name for name in ("port", "host") if getattr(arguments, name) is not None]
        text = "is for a page that is served, and --html writes a file"
        faults += [Fault(f"--{name}", 0, text) for name in given]
    try:
        page = definition.load(arguments.page)
    except ConfigError as error:
        faults += error.faults
    if faults:
        raise ConfigError(faults)
    asked = Asked(page, arguments.draws, tuple(arguments.hardware))
    if arguments.html:
        from dse.study import results

        path = write_page(results.open(arguments.results), arguments.html, asked)
        return Answer([{"page": str(path)}], text=str(path))

    from dse.dashboard.serve import LOOPBACK, PORT

    host, number = arguments.host or LOOPBACK, PORT if arguments.port is None else arguments.port
    with page_server(Path(arguments.results), host, number, asked) as server:
        print(f"{server.url}  (Ctrl-C ends it)", flush=True)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            pass  # how it is meant to end
    return Answer([], text="ended")
