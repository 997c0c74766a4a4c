"""The class of each section of a search space; its fields are the keys of the section.

`data`, `encoder` and `model` hold one component of a package, named by `kind`; the other sections
are one dataclass each (`dse.config.settings`). Components are imported on request.
"""

from __future__ import annotations

import typing
from collections.abc import Mapping

from dse.config.contracts import Source
from dse.config.search import Search
from dse.config.settings import (
    Decision,
    Evaluation,
    ExecutionSettings,
    Precision,
    Preprocessing,
    Schedule,
    Split,
    Task,
    Training,
    Window,
)
from dse.records import FrontEnd

SETTINGS: Mapping[str, type] = {
    "task": Task,
    "window": Window,
    "split": Split,
    "evaluation": Evaluation,
    "preprocessing": Preprocessing,
    "training": Training,
    "decision": Decision,
    "precision": Precision,
    "schedule": Schedule,
    "execution": ExecutionSettings,
    "search": Search,
}
# In the order of a file; `test` holds keys of `data`; `hardware`, `targets`, `objectives` are lists of
# names, `limits` is one of conditions.
SECTIONS = (
    *("data", "task", "window", "split", "evaluation", "test", "preprocessing", "encoder", "model"),
    *("training", "decision", "precision", "hardware", "schedule", "targets", "objectives", "limits"),
    *("search", "execution"),
)


def front_end(source: type[Source]) -> FrontEnd | None:
    """Return the section that the recordings of a source require; None for spikes.

    Signals require an encoder, and events preprocessing. Spikes, and events once they are counted, may have
    an encoder as well.

    Raises:
        TypeError: the annotation of `read` names recordings of several kinds.
    """
    hint = typing.get_type_hints(source.read)["return"]
    sections: set[FrontEnd | None] = {kind.front_end for kind in typing.get_args(hint) or (hint,)}
    if len(sections) > 1:
        raise TypeError(f"{source.__name__}.read must return recordings of one kind, got {hint}")
    return sections.pop()
