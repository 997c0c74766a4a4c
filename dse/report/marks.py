"""Published designs as reference marks: the numbers of their papers, under our column names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dse.report.designs import StudyTask
from dse.report.papers import publication, systems


@dataclass(frozen=True)
class Mark:
    """A published design.

    name: letter of its system, and which of its designs. task: our task that it is compared with.
    values: the published numbers, by the name of our column.
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
        part: the task that it is compared with.
        which: the design; '' if the system has only one.
        values: published numbers by column.
        more: a further remark.
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
