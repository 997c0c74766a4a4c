"""The decision rule of a classifier, on what it responds."""

from __future__ import annotations

import numpy as np

from dse.deploy.classifier import Classifier
from dse.measure import decision
from dse.measure.heads import head_answers, head_slices, joint_label
from dse.measure.run import read_out
from dse.records import Answers, Bools, Dataset, Floats, Ints, Response


def read_out_number(bundle: Classifier, response: Answers) -> int:
    """Return after which of its input lengths a classifier answers."""
    time_ms = response.time_ms
    return (
        len(time_ms) - 1 if bundle.read_out_ms is None else int(np.abs(time_ms - bundle.read_out_ms).argmin())
    )


def decided(bundle: Classifier, data: Dataset, response: Response | Answers) -> tuple[Ints, Floats, Bools]:
    """Return the label, the time of the answer in ms, and whether theta was reached, by the decision rule.

    A label of -1 is a combination of the heads' answers that no training recording had.
    """
    if isinstance(response, Answers):
        column = read_out_number(bundle, response)
        label = bundle.answered(response.label[:, column])
        return label, np.full(len(label), response.time_ms[column]), np.ones(len(label), bool)
    n, n_steps = response.output.shape[:2]
    parts = dict(zip((x.name for x in bundle.heads), head_slices(data), strict=False))  # without heads: one
    output = response.output[..., parts.get(bundle.head, slice(None))]
    if bundle.phi is not None and bundle.theta is not None:
        label, step, decided = decision.decide(output, bundle.phi, bundle.theta)
        return label, (step + 1) * response.step_ms, decided
    if bundle.read_out_ms is not None:
        n_steps = min(n_steps, max(1, round(bundle.read_out_ms / response.step_ms)))
    if parts and not bundle.head:
        counts = output[:, :n_steps].sum(axis=1, dtype=np.int64)
        label = joint_label(head_answers(data, counts), bundle.heads)
    else:
        label = read_out(output[:, :n_steps])
    return label, np.full(n, n_steps * response.step_ms), np.ones(n, bool)
