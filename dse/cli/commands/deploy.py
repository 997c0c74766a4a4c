"""Commands about exported classifiers: bundles, their targets, new recordings."""

from __future__ import annotations

import shlex
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

from dse.base.registry import Rule
from dse.cli.answer import Answer
from dse.cli.signature import Texts

if TYPE_CHECKING:
    from dse.deploy.evaluate import Evaluation

_REST_S = 5.0
"""Time for which the power at rest is measured."""
_UNVERIFIED = 2


def evaluate(
    bundle: str, *, data: str, each: bool = False, repair: bool = False, power: bool = False
) -> Answer:
    """Run an exported classifier (bundle) on new recordings.

    Args:
        data (FILE): recordings in the format of the training data; a classifier trained on a scene also takes
            an event file or a folder of event files.
        each: print one row per recording (its label and decision time) instead of the summary.
        power: measure the power of this machine's processor, at rest and while it classifies; adds the
            columns power_idle_w and power_w.
    """
    from dse.deploy import evaluate as evaluating

    evaluation = evaluating.evaluate(bundle, data, repair=repair, rest_s=_REST_S if power else None)
    rows = evaluation.answers if each else [evaluation.columns]
    notes = [*_by_class(evaluation), *(f"warning: {note}" for note in evaluation.notes)]
    if evaluation.power is not None:
        unmeasured = evaluation.power.reason
        notes.append(f"power: {unmeasured or 'of the processor, with everything else that runs on it'}")
    return Answer(rows, notes)


def _by_class(evaluation: Evaluation) -> list[str]:
    """Return one sentence per class that has labelled recordings, worst first."""
    sentences = []
    for true, row in enumerate([] if evaluation.confusion is None else evaluation.confusion):
        if total := int(row.sum()):
            wrong = [(int(n), evaluation.classes[k]) for k, n in enumerate(row) if k != true and n]
            confused = ", ".join(f"{n} as {name}" for n, name in sorted(wrong, key=lambda x: -x[0]))
            text = f"{evaluation.classes[true]}: {int(row[true])} of {total} correct"
            sentences.append((row[true] / total, f"{text}; {confused}" if confused else text))
    return [text for _, text in sorted(sentences, key=lambda x: x[0])]


def export(
    bundle: str,
    *,
    target: Texts = (),
    board: str | None = None,
    verify: str | None = None,
    prefix: str | None = None,
    force: bool = False,
) -> Answer:
    """Write the classifier of a bundle for targets (C, microcontrollers, NIR, ...) and verify them by a run.

    Args:
        board (NAME): write the target of this board (`dse describe boards`), and tell the commands that flash
            it; a classifier that does not fit is refused.
        prefix (NAME_): of the names and files in C, so that several classifiers live in one program: texture_
            gives texture_init and texture.h (default: that of the bundle, dse_ at first).
        force: replace files of the target that were edited.

    Returns:
        The verdict on every target; the bundle holds their files and verdicts then.
    """
    from dse.cli import verdicts
    from dse.deploy.boards import board_named
    from dse.deploy.verify import export_targets
    from dse.store import StoreError

    its = None if board is None else board_named(board)
    if not (names := target or (its and (its.target,))):
        raise StoreError("dse export needs --target NAME or --board NAME: what to write")
    answer = verdicts.answer(export_targets(bundle, names, verify, prefix, force, its))
    if its is None:
        return answer
    steps = [f"cd {shlex.quote(f'{bundle}/targets/{its.target}')}", *its.steps.splitlines()]
    return replace(answer, notes=[*answer.notes, f"to flash {its.title}:", *steps])


def reproduce(bundle: str, *, data: str | None = None, trial: int | None = None) -> Answer:
    """Train an exported classifier once more from what its bundle states, and compare every number.

    Args:
        bundle: folder that `dse pick --export` wrote, or that of a study.
        data (PATH): the recordings, or the folder that they are named relative to (default: they are looked
            up in this folder, in that of the bundle and in those above it).
        trial: of a study (default: that of most accuracy).

    Returns:
        identical; close, where floating point differs by less than 1e-6; or different: exit code 4.
    """
    import dataclasses

    from dse.cli.verdicts import DRIFT
    from dse.deploy.reproduce import reproduce

    found = reproduce(bundle, data, trial)
    row = {name: x for name, x in dataclasses.asdict(found).items() if name != "changed"}
    return Answer([row], list(found.changed), code=DRIFT if found.kind == "different" else 0)


def measure(bundle: str, *, data: str | None = None, rest: Annotated[float, Rule(low=0)] = _REST_S) -> Answer:
    """Measure time and energy of an exported classifier on this machine: as a stream and as C.

    Args:
        data (RECORDINGS): recordings in the format of the training data (default: random input spikes, 2 % of
            channels and steps).
        rest: time at rest in seconds (default: 5).
    """
    from dse.deploy import measure as measuring
    from dse.deploy.bundle import read

    times = measuring.measure(read(bundle), data, max(rest, 0.1))
    notes = [
        f"{x.engine}: {'energy_uj is empty: ' if 'counter' in x.reason else ''}{x.reason}"
        for x in times
        if x.reason
    ]
    return Answer([each.columns for each in times], notes)


def verify(bundle: str, *, data: str, target: Texts = ()) -> Answer:
    """Run the targets of a bundle on recordings and compare all decisions and spikes.

    Args:
        bundle: folder with targets that `dse export` wrote.
        target (NAME): target to run (default: all of the bundle); repeatable.

    Returns:
        The verdict on every target, beside that of the bundle.
    """
    from dse.cli import verdicts
    from dse.deploy import verify as verifying

    verified = verifying.verify(bundle, data, target)
    unverified = any(each.verdict.kind == "not verified" for each in verified.values())
    return verdicts.answer(verified, code=_UNVERIFIED if unverified else 0)
