"""What networks learn from a teacher: a family that was trained on the same samples before them.

The label's target 1, and 0 of the other classes, become

    q = (1 - w) [c = label] + w softmax(z / T)          w = teacher_weight, T = teacher_temperature

of each head. z are the teacher's log-odds in the recording's evaluated window. The cross-entropy to q is
(1 - w) times that to the label plus w times that to the teacher. A teacher never sees a recording that
validates or tests.
Source: [Hinton et al. 2015 in REFERENCES.md], here with temperature 1 in the network that learns.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from dse.base.records import Dataset, Floats
from dse.config.contracts import FitRequest, Teacher, trains_in_cohorts
from dse.engine.goal import is_label
from dse.measure.heads import head_sizes, head_slices, output_labels, softmax
from dse.models.crops import fit_alone
from dse.models.training import Generators, Training


@dataclass(frozen=True)
class Taught:
    """What a network learns from its teacher.

    soft: (sample, output) target of each output, of training samples; rows of other samples are 0.
    seconds: that the teacher took.
    """

    soft: Floats
    seconds: float


class Teachers:
    """Teachers of networks that train together; each is trained once, on `dataset.train`."""

    def __init__(self, dataset: Dataset, shared: Generators, device: str = "cpu", threads: int = 1) -> None:
        """Take what teachers train on.

        Args:
            dataset: of the networks.
            shared: random generators of what the networks share; a teacher's names begin with 'teacher'.
            device: 'cpu' or 'cuda'.
            threads: of the CPU.
        """
        self._dataset, self._shared = dataset, shared
        self._device, self._threads = device, threads
        self._scores: dict[tuple[Teacher, Training], tuple[Floats, float]] = {}

    def taught(self, training: Training) -> Taught | None:
        """Return what a network with this training learns; None: it has no teacher."""
        teacher = training.teaching()
        if teacher is None:
            return None
        data, train = self._dataset, self._dataset.train
        key = teacher, replace(training, teacher=None, teacher_weight=0.0, teacher_temperature=1.0)
        if key not in self._scores:
            self._scores[key] = self._fitted(*key)
        scores, seconds = self._scores[key]
        weight, soft = training.teacher_weight, np.zeros((len(data.target), sum(head_sizes(data))))
        labels = is_label(output_labels(data, train), soft.shape[1])
        for outputs in head_slices(data):
            likely = softmax(scores[:, outputs] / training.teacher_temperature)
            soft[train, outputs] = (1 - weight) * labels[:, outputs] + weight * likely
        return Taught(soft, seconds)

    def _fitted(self, teacher: Teacher, training: Training) -> tuple[Floats, float]:
        """Train a teacher; return its log-odds of the training samples, and the seconds that it took."""
        began = time.perf_counter()
        data = self._dataset

        def rngs(purpose: str, *index: int) -> np.random.Generator:
            return self._shared(f"teacher {purpose}", *index)

        if any(x.name == "read_outs" for x in fields(teacher)):  # type: ignore[arg-type]
            teacher = replace(teacher, read_outs=1)  # type: ignore[type-var]  # a training for each is wasted
        outcome: Any
        if trains_in_cohorts(teacher):
            designs = [FitRequest(teacher, training, rngs)]
            device = "cpu" if getattr(teacher, "cpu_only", False) else self._device
            ((_, outcome),) = teacher.fit_cohort(data, designs, rngs, device, self._threads)
            if isinstance(outcome, Exception):
                raise outcome
        else:
            outcome = fit_alone(teacher, data, training, rngs)
        scores = teacher.scores(outcome.network, data, data.train)
        return scores, time.perf_counter() - began
