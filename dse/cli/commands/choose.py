"""Commands that choose among design points, and show them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from dse.base.registry import Rule
from dse.cli.answer import Answer
from dse.cli.signature import Texts, Without
from dse.config import ConfigError, Fault
from dse.study.question import MOST_DRAWS, Question

_NOTHING_FEASIBLE = 3


def dashboard(
    results: str,
    *,
    html: Path | None = None,
    page: str = "study",
    hardware: Texts = (),
    draws: Annotated[int | None, Rule(low=1, high=MOST_DRAWS)] = None,
    port: Annotated[int | None, Rule(low=0, high=65_535)] = None,
    host: str | None = None,
) -> Answer:
    """Serve the page of a study, also while it runs, or write it as one HTML file.

    Args:
        html (FILE): write the page to this file instead of serving it; the file opens without a server.
        page: page definition (parts, axes, budgets): study (default), paper, deployment, or a YAML file.
        draws: sample recordings, seeds and the chip's uncertain numbers N times; points that are
            non-dominated in few of the samples are drawn paler, and a slider leaves out less certain ones.
        port: TCP port (default: 8050; 0: any free port).
        host (NAME): address to listen on (default: 127.0.0.1, this machine only); readers need the token in
            the printed URL.
    """
    from dse.show.dashboard.study import PageRequest, load_definition, write_page

    faults = []
    if html:
        text = "applies to a served page and cannot be combined with --html"
        served = {"port": port, "host": host}
        faults += [Fault(f"--{name}", 0, text) for name, given in served.items() if given is not None]
    try:
        definition = load_definition(Path(results), page)
    except ConfigError as error:
        faults += error.faults
    if faults:
        raise ConfigError(faults)
    request = PageRequest(definition, Question(hardware=hardware, draws=draws))
    if html:
        from dse.study import results as studies

        path = write_page(studies.open(results), html, request)
        return Answer([{"page": str(path)}], text=str(path))

    from dse.show.dashboard.serve import LOOPBACK, PORT
    from dse.show.dashboard.site import page_server

    with page_server(Path(results), host or LOOPBACK, PORT if port is None else port, request) as server:
        print(f"{server.url}  (stop with Ctrl-C)", flush=True)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            pass  # the usual way to stop the server
    return Answer([], text="stopped")


def pick(
    results: str,
    *,
    budget: Texts = (),
    maximise: str | None = None,
    question: Annotated[Question, Without(["objectives", "where", "by", "targets"])],
    target: Texts = (),
    export: str | None = None,
    refit: bool = False,
    verify: str | None = None,
    force: bool = False,
) -> Answer:
    """Pick the best design point that meets all budgets, and export it as a bundle.

    Args:
        results: folder of a study, or a CSV, Parquet or JSON table.
        budget (EXPR): condition that the pick must meet, e.g. "energy_uj<=50"; repeatable.
        maximise (COLUMN): column to maximise (default: the first objective that is maximised; of a table,
            accuracy).
        export (DIR): write the picked design to this folder as a bundle; the page of the study shows those in
            RESULTS/bundles, with the verdicts on their targets.
        refit: train it once more before --export, on the recordings of training and validation together; what
            is printed was measured before.
        force: replace a bundle though files of its targets were edited.

    Returns:
        The picked row, or if no row meets every budget the nearest rows and by how much they miss.
    """
    from dse.api.choice import TRAINED, choose
    from dse.cli.fronts import TELLING, columns, records, rivals_section
    from dse.store import StoreError

    if export and not Path(results).is_dir():
        raise StoreError(f"{results}: only a design of a study's folder can be exported")
    if verify and not (target and export):
        raise StoreError("--verify needs --target NAME, the target to run, and --export DIR, its folder")
    if refit and not export:
        raise StoreError("--refit needs --export DIR, the folder of the bundle")
    choice = choose(results, budget, maximise, replace(question, targets=target))
    if choice.row is None:
        missed = [str(name) for name in choice.nearest.columns if str(name).startswith("missed ")]
        shown = columns(choice.nearest, choice.goals, missed)
        known = ("trial", *(name for name, _ in choice.goals), *missed)
        essential = [name for name in known if name in shown]
        rows = records(choice.nearest)
        return Answer(rows, choice.notes, shown, essential, TELLING, code=_NOTHING_FEASIBLE)
    spikes = rivals_section(lambda: choice.rivals)
    if not export:
        return Answer([dict(choice)], choice.notes, list(choice.shown), sections=spikes)
    from dse.cli import verdicts

    bundle = choice.export(export, recordings=verify, refit=TRAINED if refit else (), force=force)
    of_targets = [verdicts.row(name, verdict) for name, verdict in bundle.targets.items()]
    sections = {"targets": Answer(of_targets)} if of_targets else {}
    again = ", trained once more on training and validation together" if refit else ""
    notes = [*choice.notes, f"bundle: {export}{again}"]
    return Answer([dict(choice)], notes, list(choice.shown), sections=sections | spikes)


def skyline(results: Texts, *, question: Annotated[Question, Without(["targets"])]) -> Answer:
    """Print the skyline: the non-dominated design points of studies or of any tables.

    Args:
        results: folder of a study, or a CSV, Parquet or JSON table; several are concatenated.
    """
    from dse.api.front import ADDED, front_of
    from dse.cli.fronts import front_answer
    from dse.config.expressions import named_columns

    rows, remarks = front_of(results, question)
    beside = [*question.groups, *sorted(named_columns(question.where)), *ADDED]
    return front_answer(rows, question.goals(results[0]), remarks, beside)
