"""The linear classifier: scikit-learn's logistic regression, then what its integers answer."""

from dataclasses import replace

import numpy as np
import pytest
from sklearn.linear_model import LogisticRegression

from dse.models.counts.linear import Linear
from dse.models.training import Training
from tests.models.counted import rngs, textures


@pytest.mark.parametrize("n_classes", [2, 3])
def test_answers_are_those_of_its_integers_and_nearly_those_that_were_trained(n_classes):
    data = textures(n=120, n_classes=n_classes)
    family = Linear(window_ms=50.0, read_outs=2)
    outcome = family.fit(data, Training(), rngs)
    arrays = outcome.network.arrays
    x = {
        part: family.counts(data, getattr(data, part), {}).reshape(-1, 20) for part in ("train", "validation")
    }
    weight, bias = arrays["1/0/weight"].astype(int), arrays["1/0/bias"].astype(int)
    outputs = [[int(b) + sum(int(v) * int(w) for v, w in zip(row, column, strict=True))
                for column, b in zip(weight.T, bias, strict=True)] for row in x["validation"]]  # fmt: skip
    answers = [int(y[0] > 0) if n_classes == 2 else int(np.argmax(y)) for y in outputs]
    assert outcome.validation.label[:, -1].tolist() == answers
    assert abs(weight).max() == 127 and outcome.validation.stored_bits == 8
    mean, scale = x["train"].mean(axis=0), x["train"].std(axis=0)
    trained = LogisticRegression(C=1 / (0.01 * 60), max_iter=1000)
    trained.fit((x["train"] - mean) / scale, data.target[data.train])
    expected = trained.decision_function((x["validation"] - mean) / scale).reshape(len(answers), -1)
    found = family.scores(outcome.network, data, data.validation)
    np.testing.assert_allclose(found[:, 1] - found[:, 0] if n_classes == 2 else found,
                               expected[:, 0] if n_classes == 2 else expected, atol=0.15)  # fmt: skip
    assert outcome.health == {"converged": True}


def test_a_solver_that_is_stopped_says_so():
    assert Linear(window_ms=50.0, epochs=2).fit(textures(), Training(), rngs).health == {"converged": False}


def test_a_window_longer_than_the_recording_is_the_recording():
    data = textures()
    long, whole = (Linear(window_ms=ms).fit(data, Training(), rngs).validation for ms in (1e6, 230.0))
    assert long.time_ms.tolist() == [230.0] and np.array_equal(long.label, whole.label)


def test_a_single_class_needs_no_weights():
    data = textures()
    some = replace(data, train=data.train[data.target[data.train] == 1])
    answers = Linear(window_ms=50.0).fit(some, Training(), rngs).validation
    assert (answers.label == 1).all() and answers.n_weights.tolist() == [0] * 5
