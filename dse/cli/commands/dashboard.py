"""`dse dashboard`: the page of a study, served or as a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dse.cli.answer import Answer
from dse.cli.fields import argument, like, option
from dse.config import ConfigError, Fault
from dse.door.question import MOST_DRAWS, Question

GROUP = "choose"
HELP = "serve the page of a study, also while it runs, or write it as one HTML file"


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The arguments."""

    results: str = argument("RESULTS", "folder of a study")
    html: Path | None = option(  # noqa: RUF009
        "FILE", "write the page to this file instead of serving it; the file opens without a server"
    )
    page: str = option(
        "PAGE",
        "page definition (parts, axes, budgets): study (default), paper, deployment, or a YAML file",
        "study",
    )
    hardware: tuple[str, ...] = like(Question, "hardware")
    repeats: str = like(Question, "repeats")
    draws: int = option(
        "N",
        "sample recordings, seeds and the chip's uncertain numbers N times; points that are non-dominated "
        "in few of the samples are drawn paler, and a slider leaves out the less certain ones",
        0,
        low=1,
        high=MOST_DRAWS,
    )
    port: int | None = option("N", "TCP port (default: 8050; 0: any free port)", low=0, high=65_535)
    host: str | None = option(
        "NAME",
        "address to listen on (default: 127.0.0.1, this machine only); readers need the token in the "
        "printed URL",
    )


def answer(arguments: Arguments) -> Answer:
    """Write the page and return its path, or serve it until Ctrl-C."""
    from dse.dashboard.study import PageRequest, load_definition, write_page

    faults = []
    if arguments.html:
        conflicting = [name for name in ("port", "host") if getattr(arguments, name) is not None]
        text = "applies to a served page and cannot be combined with --html"
        faults += [Fault(f"--{name}", 0, text) for name in conflicting]
    try:
        page = load_definition(Path(arguments.results), arguments.page)
    except ConfigError as error:
        faults += error.faults
    if faults:
        raise ConfigError(faults)
    request = PageRequest(page, arguments.draws, tuple(arguments.hardware), arguments.repeats)
    if arguments.html:
        from dse.study import results

        path = write_page(results.open(arguments.results), arguments.html, request)
        return Answer([{"page": str(path)}], text=str(path))

    from dse.dashboard.serve import LOOPBACK, PORT
    from dse.dashboard.site import page_server

    host, number = arguments.host or LOOPBACK, PORT if arguments.port is None else arguments.port
    with page_server(Path(arguments.results), host, number, request) as server:
        print(f"{server.url}  (stop with Ctrl-C)", flush=True)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            pass  # the usual way to stop the server
    return Answer([], text="stopped")
