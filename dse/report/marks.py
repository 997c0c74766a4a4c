"""Published designs as reference marks: the figures that their papers print, under our columns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dse.report.designs import StudyTask
from dse.report.papers import publication, systems


@dataclass(frozen=True)
class Mark:
    """A published design.

    name: its system and which of its designs. task: ours that it stands beside.
    values: the printed figures, by the column that holds the same of ours.
    source: the paper, as in REFERENCES.md. caption: one sentence; it claims no more than the publication.
    """

    name: str
    task: str
    values: Mapping[str, float]
    source: str
    caption: str


def mark(system: str, part: StudyTask, which: str, values: Mapping[str, float], more: str = "") -> Mark:
    """Return the mark of one design of a system.

    Args:
        system: letter of the system.
        part: what it stands beside.
        which: of the designs of the system; '' where there is one.
        values: printed figures by column.
        more: what else must be known of it.
    """
    of = systems()[system]
    paper = publication(of.paper)
    title = f"{of.title}{f', {which}' if which else ''}"
    other = "for textures, not for movements" if part.of_movement and system != "E" else ""
    about = "; ".join(
        filter(None, [f"on recordings that {paper.recordings}; not reproduced here", other, more])
    )
    caption = f"{title}: published ({paper.source}), {about}"
    return Mark(f"{system}, {which}" if which else system, part.task, values, paper.source, caption)
