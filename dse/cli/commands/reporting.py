"""Whether to spike, chips and published systems beside each other: what `dse report` does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from dse.base import registry
from dse.cli.answer import Answer, audit_answer, with_interval
from dse.cli.signature import Texts

if TYPE_CHECKING:
    from dse.study.results import Study

_HONEST = ("shifted", "shifted_se", "unseen", "unseen_se")  # where a study evaluates them
_SHOWN = (
    *("system", "figure", "task", "published", "corrected", "ours", "se", "low", "high", "test"),
    *("reader", "reader_se", *_HONEST),
    *("runs", "hardware", "family", "trial", "study"),
)
_ESSENTIAL = ("system", "figure", "published", "corrected", "ours")
_TELLING = ("task",)


def reports() -> dict[str, str]:
    """Return the options of section `reports`, with help; those of plugins that are not installed too."""
    missing = {
        name: f"needs plugin {plugin}"
        for plugin, sections in registry.ELSEWHERE.items()
        for name in sections.get("reports", ())
    }
    installed: Mapping[str, Any] = registry.known("reports")
    return missing | {name: component.about for name, component in installed.items()}


def report(
    results: Texts,
    *,
    system: str | None = None,
    out: Path | None = None,
    hardware: Texts = (),
    **published: Annotated[str | None, reports],
) -> Answer:
    """Compare spiking with other families, chips with each other, and studies with published systems.

    Args:
        results: folders of studies, or a folder that contains some.
        system (LETTERS): print only the rows of these published systems, by their letters in the report, e.g.
            A or DE.
        out (FOLDER): with --paper, also write a folder: the comparison, figures (needs
            `pip install 'dse-spiking[figures]'` and Chromium) and the tables of the studies.
        hardware (NAME): compare this hardware profile (name or YAML file) with others; repeatable (default:
            the profiles of each study).
        published: components of section `reports`, an option each.
    """
    from dse.measure.on_chips import DRAWN
    from dse.show.report import gather
    from dse.skyline.constraints import ExpressionError

    either = " or ".join(f"--{name}" for name in published)
    studies = {study.folder.resolve(): study for text in results for study in _studies(Path(text))}
    if asked := [(name, text) for name, text in published.items() if text is not None]:
        if len(asked) > 1 or system is not None or hardware:
            text = f"{either} must be without --system and --hardware, got more than one of them"
            raise ExpressionError(text)
        return _of_published(*asked[0], list(studies.values()), out)
    if out is not None:
        raise ExpressionError(f"--out must be with {either}, got it alone")
    known = {letter: x for source in gather.published().values() for letter, x in source.systems().items()}
    letters = _systems(system, list(known))
    chips = list(dict.fromkeys(hardware))
    if len(chips) == 1:
        raise ExpressionError(f"--hardware must name two profiles or more, got only '{chips[0]}'")
    gathered = gather.report(list(studies.values()), chips)
    rows = [row for row in gathered.rows if letters is None or row.system in letters]
    used = {row.system for row in rows}
    titles = [f"{name}: {known[name].title} ({known[name].source})" for name in known if name in used]
    splits = dict.fromkeys((row.study, row.task, row.split) for row in rows if row.split)
    splits_of_rows = [f"{study}, {task}: {split}" for study, task, split in splits]
    lead = gathered.spikes if letters is None else []
    code = 0 if rows or lead else 1
    columns = [row.columns for row in rows]
    empty = {name for name in (*_HONEST, "reader", "reader_se") if all(row[name] is None for row in columns)}
    columns = [{name: x for name, x in row.items() if name not in empty} for row in columns]
    audits = {f"audit of {name}": audit_answer(audit) for name, audit in gathered.audits.items()}
    notes = [*titles, *splits_of_rows, *gathered.notes]
    shown = _with_values(columns, _SHOWN)
    essential = [name for name in _ESSENTIAL if name in shown]
    table = [
        with_interval(row, "ours", row["low"], row["high"]) if str(row["figure"]).endswith(DRAWN) else row
        for row in columns  # the ends of a ratio stand beside it, whatever they are
    ]
    return Answer(
        *(columns, notes, shown, essential, _TELLING),
        table=table,
        lead=lead,
        code=code,
        all_rows=True,
        sections=audits,
    )


def _of_published(name: str, asked: str, studies: list[Study], out: Path | None) -> Answer:
    """Return a report of section `reports`."""
    from dse.show.report.gather import published
    from dse.skyline.constraints import ExpressionError

    if missing := registry.elsewhere("reports", name):
        raise ExpressionError(f"--{name} is an option{missing}")
    table = published()[name].table(studies, asked, out)
    written = [] if out is None else [f"folder: {out}"]
    return Answer(table.rows, [*table.notes, *written], _with_values(table.rows, table.shown), all_rows=True)


def _with_values(rows: Sequence[Mapping[str, object]], columns: Sequence[str]) -> list[str]:
    """Return the columns that are not empty, without that for the name of the only study."""
    values = {name: {row.get(name) for row in rows} - {None, ""} for name in columns}
    return [name for name in columns if len(values[name]) > (name == "study")]


def _systems(text: str | None, known: list[str]) -> set[str] | None:
    """Return the systems of --system; None: all."""
    from dse.skyline.constraints import ExpressionError

    if text is None:
        return None
    letters = dict.fromkeys(text.upper().replace(",", "").replace(" ", ""))
    unknown = [name for name in letters if name not in known]
    if not known:
        raise ExpressionError("--system: no plugin of published systems is installed, such as dse-papers")
    if unknown or not letters:
        raise ExpressionError(f"--system must be letters among {', '.join(known)}, e.g. DE, got '{text}'")
    return set(letters)


def _studies(path: Path) -> list[Study]:
    from dse.store import StoreError
    from dse.study import results

    if (path / "search_space.yaml").is_file():
        return [results.open(path)]
    inside = sorted(x.parent for x in path.glob("*/points.parquet")) if path.is_dir() else []
    if not inside:
        raise StoreError(f"{path}: must be the folder of a study with results, or contain such folders")
    return [results.open(folder) for folder in inside]
