"""What networks learn from a teacher, and how teachers are trained."""

from dataclasses import replace

import numpy as np
import pytest

from dse.config.contracts import FitRequest
from dse.engine.losses.count_cross_entropy import CountCrossEntropy
from dse.measure.heads import head_scores, softmax
from dse.models.counts.mlp import MLP
from dse.models.snn.family import SNN
from dse.models.teacher import Teachers
from dse.models.training import TrainingDiverged
from dse.testing.expect import same
from tests.joint_data import joint
from tests.models.snn.toy import SHORT, accuracy, rngs, toy

TAUGHT = replace(SHORT, teacher="mlp")


def test_targets_are_between_labels_and_a_softened_teacher():
    data, own = toy(), rngs()
    family = MLP(read_outs=1)
    fitted = family.fit(data, SHORT, lambda purpose, *index: own(f"teacher {purpose}", *index))
    scores = family.scores(fitted.network, data, data.train)
    taught = Teachers(data, own).taught(replace(TAUGHT, teacher_weight=0.3, teacher_temperature=4.0))
    assert taught is not None and taught.seconds > 0
    labels = np.eye(3)[data.target[data.train]]
    np.testing.assert_allclose(taught.soft[data.train], 0.7 * labels + 0.3 * softmax(scores / 4))
    assert not taught.soft[data.validation].any()
    right = family.respond(fitted.network, data, data.train).label[:, -1] == scores.argmax(axis=1)
    assert right.all()
    assert Teachers(data, own).taught(SHORT) is None
    assert Teachers(data, own).taught(replace(TAUGHT, teacher_weight=0.0)) is None


@pytest.mark.parametrize("teacher", ["mlp", {"kind": "snn", "hidden": 8, "loss": "count_cross_entropy"}])
def test_teachers_see_training_recordings_alone(teacher):
    data = toy(margin=2)
    training = replace(SHORT, epochs=2, crops=2, teacher=teacher)
    other = replace(data, validation=data.validation[:3], target=data.target.copy())
    other.target[data.validation] = 0
    first, second = (Teachers(x, rngs()).taught(training) for x in (data, other))
    assert first is not None and second is not None
    assert np.array_equal(first.soft, second.soft)


def test_heads_have_the_probabilities_of_their_classes():
    data = joint()
    p = np.array([[0.1, 0.2, 0.3, 0.15, 0.25]])  # a|p a|q b|p b|q c|p
    heads = np.exp(head_scores(data, np.log(p)))
    np.testing.assert_allclose(heads, [[0.3, 0.45, 0.25, 0.65, 0.35]])
    taught = Teachers(data, rngs()).taught(TAUGHT)
    np.testing.assert_allclose(taught.soft[data.train].sum(axis=1), 2)


def test_a_class_or_all_but_one_may_lack_training_samples():
    data = toy()
    for n_classes in (2, 1):
        few = replace(data, train=data.train[data.target[data.train] < n_classes])
        taught = Teachers(few, rngs()).taught(TAUGHT)
        assert (taught.soft[few.train, n_classes:] == 0).all() and np.isfinite(taught.soft).all()


def test_taught_networks_are_the_same_alone_and_beside_others_and_leave_those_as_they_are():
    data, model = toy(), SNN(hidden=(9,), loss=CountCrossEntropy())
    failing = replace(SHORT, teacher={"kind": "mlp", "window_ms": 1})
    trainings = [TAUGHT, SHORT, failing, replace(SHORT, teacher={"kind": "snn", "hidden": 6})]
    designs = [FitRequest(model, training, rngs()) for training in trainings]
    together = dict(SNN.fit_cohort(data, designs, rngs()))
    failed = together.pop(2)
    assert isinstance(failed, TrainingDiverged)
    assert str(failed) == "teacher: window_ms must be >= the step of 5 ms, got 1"
    for number, outcome in together.items():
        alone = model.fit(data, trainings[number], rngs())
        assert same(outcome.network, alone.network) and same(outcome.validation, alone.validation)
    assert not same(together[0].validation, together[1].validation)
    assert accuracy(together[0], data) > 0.8
