"""What section `search.racing` asks of the sections that are trained."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from dse.config.contracts import has_rungs
from dse.config.parts import Part
from dse.config.settings import Racing
from dse.config.yaml_lines import Path as Keys


def racing_faults(racing: Racing, sections: Mapping[str, Part]) -> Iterator[tuple[Keys, str]]:
    """Yield (path, sentence) for rungs that a training does not reach, and models that cannot pause.

    Args:
        racing: as read.
        sections: data .. training.
    """
    training, model = sections.get("training"), sections.get("model")
    if training is not None and training.good:
        axis = training.axes.get("training.epochs")
        epochs = min((training.values["epochs"],) if axis is None else axis.extremes())
        for index, rung in enumerate(racing.rungs):
            if rung >= epochs:
                text = f"must be below training.epochs, {epochs}, got {rung}"
                yield ("search", "racing", "rungs", index), f"search.racing.rungs {text}"
    for part in [] if model is None else model.entries.values() or [model]:
        if not has_rungs(part.cls):
            text = f"needs models whose training can pause at a rung, which {part.kind} cannot"
            yield ("search", "racing"), f"search.racing {text}"
