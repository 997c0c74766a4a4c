"""Key `training.teacher`: names, own keys, axes, and every fault with its line."""

import json

from dse.config import Sections, load_space
from dse.models.counts.mlp import MLP
from dse.models.snn.family import SNN
from dse.search.space import index_of
from tests.spaces import write_space

TRAINING = "training: {epochs: 1, batch_size: 8}"


def written(folder, teacher):
    """Write the small search space with a teacher, which is in line 15."""
    return write_space(folder, (TRAINING, f"training: {{epochs: 1, teacher: {teacher}}}"))


def test_a_name_a_mapping_and_an_axis_of_both(tmp_path):
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
