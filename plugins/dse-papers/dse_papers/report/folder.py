"""A folder about one paper: its numbers beside ours, its figures redrawn, and the tables of the studies.

    README.md                   printed beside ours, what differs, cost of the studies, figures
    compared.csv                every row of `dse report --paper`, with all of its columns
    fig_3_time_STUDY.png        a printed figure as a study of ours draws it
    STUDY/                      its tables, search space and environment, which `dse skyline` and others read

The same studies give the same files.
"""

from __future__ import annotations

import dataclasses
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dse import store
from dse.base import registry
from dse.base.text import markdown
from dse.config.yaml_lines import dump
from dse.data.recordings.scene import SceneTrials
from dse.show.figures import draw
from dse.show.figures.image import static_image
from dse.show.report.designs import best, sections_of
from dse.show.report.rows import number
from dse.study.held import plain_space
from dse.study.results import Study
from dse_papers.report.compare import PaperReport, fits, paper_report, sides_of
from dse_papers.report.ours import Side
from dse_papers.report.papers import Redrawn, publication

_COMPARED, _README = "compared.csv", "README.md"
_KEPT = ("trials.parquet", "points.parquet")
_SMALL_BYTES = 64_000
_PNG_SCALE = 1.0
_SHOWN = (
    *("where", "quantity", "condition", "printed", "ours", "se", "runs", "why"),
    *("causes", "setup", "study", "task"),
)
_COST = ("study", "task", "designs", "trainings", "hours")


def write_paper(studies: Sequence[Study], key: str, folder: Path) -> PaperReport:
    """Write the folder about a paper, and return what it compares.

    Args:
        studies: as in `paper_report`.
        key: number of the paper.
        folder: a new one, or one that this function wrote, which is replaced.

    Raises:
        ReportError: no study is of the paper's set-up.
        StoreError: a study's folder is damaged, or `folder` holds something else.
        MissingExtra: what draws images is not installed.
    """
    import pandas

    is_empty = folder.is_dir() and not any(folder.iterdir())
    if folder.exists() and not (is_empty or (folder / _COMPARED).is_file()):
        raise store.StoreError(f"{folder}: exists and is not the folder of a paper; name another one")
    compared, (sides, _) = paper_report(studies, key), sides_of(studies, key)
    with store.published(folder, replaces=True) as new:
        for study in dict.fromkeys(side.part.study.folder for side in sides):
            _keep(study, new / study.name)
        drawn = [line for figure in publication(key).figures for line in _redraw(figure, sides, new)]
        table = pandas.DataFrame([row.columns for row in compared.rows])
        table.to_csv(new / _COMPARED, index=False)
        (new / _README).write_text(_readme(key, compared, sides, drawn), encoding="utf-8")
    return compared


def _keep(study: Path, kept: Path) -> None:
    """Copy the tables of a study, not its runs; plugins are named without their folders of this machine."""
    kept.mkdir(parents=True)
    book = study / store.BOOK
    is_small = book.is_file() and book.stat().st_size <= _SMALL_BYTES
    for name in (*_KEPT, *([store.BOOK] if is_small else [])):
        if (study / name).is_file():
            shutil.copyfile(study / name, kept / name)
    space = plain_space(study / store.SPACE)
    if plugins := space.get("plugins"):
        space["plugins"] = [Path(str(name)).name for name in plugins]
    store.write_text(kept / store.SPACE, dump(space))


def _redraw(figure: Redrawn, sides: Sequence[Side], folder: Path) -> Iterator[str]:
    """Draw a printed figure from every task that has what it shows; yield lines of Markdown."""
    for side in sides:
        if not fits(figure, side):
            continue
        about = f"{side.part.name}, {side.part.task}"
        try:
            image = draw(side.part.study, figure.figure, **_keys(figure, side))
        except (ValueError, store.StoreError) as error:
            text = str(error).replace(f"{side.part.study.folder}", side.part.name)
            yield f"- {figure.where}, {markdown(about)}: not drawn, for {markdown(text)}"
            continue
        name = re.sub(r"[^a-z0-9]+", "_", f"{figure.where}_{side.part.name}_{side.part.task}".lower())
        (folder / f"{name}.png").write_bytes(static_image(image, "png", png_scale=_PNG_SCALE))
        what = f"{figure.where}, {markdown(about)}"
        yield f"- {what} (`{figure.figure}`)\n\n  ![{what}]({name}.png)\n"


def _keys(figure: Redrawn, side: Side) -> dict[str, Any]:
    """Return the keys of a figure: those of the paper, the task, and the best design.

    Raises:
        ValueError: no design is of its families.
    """
    fields = {x.name for x in dataclasses.fields(registry.known("figures")[figure.figure])}
    keys = dict(figure.keys)
    if figure.cells:
        samples = _samples(figure, side)
        keys |= {"samples": samples} if "samples" in fields else {"sample": samples[0]}
    if "task" in fields:
        keys["task"] = side.part.task
    if "trial" in fields:
        row = best(side.designs(*figure.families)) if figure.families else side.as_printed[0]
        if row is None:
            raise ValueError(f"the study has no design of family {' or '.join(figure.families)}")
        keys["trial"] = int(row["trial"])
    return keys


def _samples(figure: Redrawn, side: Side) -> tuple[int, ...]:
    """Return the first recording of each cell of the scene.

    Raises:
        ValueError: touch is recorded, or the scene has no such cell.
    """
    row = side.chosen
    assert row is not None  # a side has a design
    folder = side.part.study.folder
    data = sections_of(folder, int(row["trial"])).data
    if not isinstance(data, SceneTrials):
        raise ValueError("it shows cells of a simulated scene")
    trials, places = data.read(folder), []
    for texture, motion in figure.cells:
        textures, motions = trials.scene.textures, trials.scene.motions
        if texture >= len(textures) or motion >= len(motions):
            raise ValueError(f"the scene has no texture {texture} with motion {motion}")
        is_felt = trials.columns["texture"] == textures[texture].name
        places.append(int(np.argmax(is_felt & (trials.columns["profile"] == motions[motion].label))))
    return tuple(places)


def _readme(key: str, compared: PaperReport, sides: Sequence[Side], drawn: Iterable[str]) -> str:
    """Return the text of the folder."""
    paper, (about, *notes) = publication(key), compared.notes
    results = [row.columns for row in compared.rows if row.kind == "result"]
    return "\n".join(
        [
            f"# {markdown(paper.title)}",
            "",
            f"{markdown(about)}. `dse report STUDIES --paper {key} --out FOLDER` makes this folder anew from "
            f"finished studies. `{_COMPARED}` has every printed number, those of the set-up too.",
            "",
            "## Printed beside ours",
            "",
            *_table(results, _SHOWN),
            "",
            *(f"- {markdown(note)}" for note in notes),
            "",
            "## Cost",
            "",
            *_table([_cost(side) for side in sides], _COST),
            "",
            "Hours are of training alone, one thread each, on the clock.",
            "",
            "## Figures",
            "",
            *drawn,
            "",
        ]
    )


def _cost(side: Side) -> Mapping[str, object]:
    """Return how many designs a study trained for a task, and how long that took."""
    trials = side.part.study.trials
    trials = trials[(trials["status"] == "finished") & (trials["task"] == side.part.task)]
    hours = number((trials["train_s"] * trials["repeats"]).sum() / 3600) if "train_s" in trials else None
    return {
        "study": side.part.name,
        "task": side.part.task,
        "designs": len(trials),
        "trainings": int(trials["repeats"].sum()),
        "hours": hours,
    }


def _table(rows: Sequence[Mapping[str, object]], columns: Sequence[str]) -> list[str]:
    """Return rows as a table of Markdown, without the columns that are empty in all of them."""
    used = [name for name in columns if any(row[name] not in (None, "") for row in rows)]
    lines = [used, ["---"] * len(used), *([markdown(_cell(row[name])) for name in used] for row in rows)]
    return [f"| {' | '.join(line)} |" for line in lines]


def _cell(value: object) -> str:
    return "" if value is None else f"{value:.3g}" if isinstance(value, float) else str(value)
