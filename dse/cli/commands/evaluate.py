"""`dse evaluate`: run an exported classifier on new recordings."""

from __future__ import annotations

from dataclasses import MISSING, dataclass
from typing import TYPE_CHECKING

from dse.cli.answer import FORMATS, Answer
from dse.cli.fields import argument, flag, formats, option
from dse.cli.options import REPAIR

if TYPE_CHECKING:
    from dse.deploy.evaluate import Evaluation

_REST_S = 5.0
"""Time for which the power at rest is measured."""

GROUP = "deploy"
HELP = "run an exported classifier (bundle) on new recordings"


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The arguments."""

    bundle: str = argument("BUNDLE", "folder written by `dse pick --export`")
    data: str = option(
        "FILE",
        "recordings in the format of the training data; a classifier trained on a scene also takes an event "
        "file or a folder of event files",
        MISSING,
    )
    each: bool = flag("print one row per recording (its label and decision time) instead of the summary")
    repair: bool = flag(REPAIR)
    power: bool = flag(
        "measure the power of this machine's processor, at rest and while it classifies; adds the columns "
        "power_idle_w and power_w"
    )
    format: str | None = formats(FORMATS)


def answer(arguments: Arguments) -> Answer:
    """Return the measurements of the classifier on the recordings, or its answer to each."""
    from dse.deploy.evaluate import evaluate

    rest_s = _REST_S if arguments.power else None
    evaluation = evaluate(arguments.bundle, arguments.data, repair=arguments.repair, rest_s=rest_s)
    rows = evaluation.answers if arguments.each else [evaluation.columns]
    notes = [*_by_class(evaluation), *(f"warning: {note}" for note in evaluation.notes)]
    if evaluation.power is not None:
        unmeasured = evaluation.power.reason
        notes.append(f"power: {unmeasured or 'of the processor, with everything else that runs on it'}")
    return Answer(rows, notes)


def _by_class(evaluation: Evaluation) -> list[str]:
    """Return one sentence per class that has labelled recordings, worst first."""
    if evaluation.confusion is None:
        return []
    sentences = []
    for true, row in enumerate(evaluation.confusion):
        if total := int(row.sum()):
            wrong = [(int(n), evaluation.classes[k]) for k, n in enumerate(row) if k != true and n]
            confused = ", ".join(f"{n} as {name}" for n, name in sorted(wrong, key=lambda x: -x[0]))
            text = f"{evaluation.classes[true]}: {int(row[true])} of {total} correct" + (
                f"; {confused}" if confused else ""
            )
            sentences.append((row[true] / total, text))
    return [text for _, text in sorted(sentences, key=lambda x: x[0])]
