"""Key `training.teacher`: names, own keys, axes, and every fault with its line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from dse.config import Sections, load_space
from dse.models.counts.mlp import MLP
from dse.models.snn.family import SNN
from dse.search.space import index_of
from tests.spaces import faults_of, write_space

TRAINING = "training: {epochs: 1, batch_size: 8}"


def written(folder: Path, teacher: str) -> Path:
    """Write the small search space with a teacher, which is in line 15."""
    return write_space(folder, (TRAINING, f"training: {{epochs: 1, teacher: {teacher}}}"))


def test_a_name_a_mapping_and_an_axis_of_both(tmp_path: Path) -> None:
    choice = "{choice: [null, mlp, {kind: snn, hidden: [30, 20]}]}"
    space = load_space(written(tmp_path, choice))
    axis = space.axes["training.teacher"]
    teachers = []
    for value in axis.values or ():
        first = {"encoder.thresholds": (1, 2), "model.hidden": 4}
        design = json.loads(json.dumps({**first, "training.teacher": value}))  # as a journal holds it
        assert index_of(space, design) % 3 == len(teachers)
        sections = space.resolve(design)
        again = Sections.from_plain(sections.to_plain(), "again")
        assert again.training == sections.training
        teachers.append(sections.training.teaching())
    assert teachers == [None, MLP(), SNN(hidden=(30, 20))]


@pytest.mark.parametrize(
    ("teacher", "fault"),
    [
        ("mpl", "unknown training.teacher.kind 'mpl'; known: columns, mlp, snn. Did you mean 'mlp'?"),
        ("knn", "unknown training.teacher.kind 'knn'; known: columns, mlp, snn"),
        ("7", "training.teacher must be text or a mapping or null, got 7"),
        ("{hidden: 300}", "training.teacher.kind is required; known: columns, mlp, snn"),
        ("{kind: 3}", "unknown training.teacher.kind 3; known: columns, mlp, snn"),
        ("{kind: mlp, hiden: 300}", "unknown key 'training.teacher.hiden'; known: window_ms"),
        ("{kind: mlp, hidden: 0}", "training.teacher.hidden[0] must be >= 1, got 0"),
        (
            "{kind: mlp, hidden: {choice: [1, 2]}}",
            "training.teacher.hidden cannot be an axis; it must be a list of integers",
        ),
        (
            "{choice: [mlp, mpl]}",
            "unknown training.teacher.choice[1].kind 'mpl'; known: columns, mlp, snn. Did you mean 'mlp'?",
        ),
        ("{kind: snn, hidden: []}", "training.teacher.hidden must have 1 to 3 layers, got 0"),
    ],
)
def test_faults_name_the_line(tmp_path: Path, teacher: str, fault: str) -> None:
    (line,) = faults_of(written(tmp_path, teacher))
    assert line.startswith(f"15: {fault}")
