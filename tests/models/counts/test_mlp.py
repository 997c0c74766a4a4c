"""The perceptron against scikit-learn's own predictions."""

import numpy as np
import pytest

from dse.models.counts.mlp import MLP, _scaled
from dse.models.counts.readouts import forward
from dse.models.training import Training, TrainingDiverged
from tests.models.counted import data_of, rngs, textures

FAST = {"window_ms": 50.0, "channels": "each", "hidden": (8,), "learning_rate": 0.05}


@pytest.mark.parametrize("n_classes", [2, 3])
@pytest.mark.parametrize("hidden", [(8,), (8, 6)])
def test_every_length_is_scikit_learn_on_that_length(monkeypatch, n_classes, hidden):
    trained = []
    learn = MLP._trained
    monkeypatch.setattr(MLP, "_trained", lambda *a: trained.append(learn(*a)) or trained[-1])
    data = textures(n_classes=n_classes)
    family = MLP(**FAST | {"hidden": hidden, "epochs": 20})
    outcome = family.fit(data, Training(), rngs)
    x = _scaled(family.counts(data, data.validation, {}).reshape(24, -1), outcome.network.arrays)
    assert len(trained) == 5 and x.dtype == np.float32
    for j, net in enumerate(trained):
        assert np.array_equal(outcome.validation.label[:, j], net.predict(x[:, : 4 * (j + 1)]))
    assert outcome.network.arrays["0/0/weight"].dtype == np.float32
    assert len(outcome.history["loss"]) == outcome.health["epochs_trained"] == trained[-1].n_iter_


def test_forward_by_hand():
    layers = [
        (np.array([[1.0, -1.0], [0.0, 2.0]]), np.array([0.0, 1.0])),
        (np.array([[1.0], [3.0]]), np.array([-5.0])),
    ]
    # (2, 1): hidden (2, -2 + 2 + 1 = 1), output 2 + 3 - 5; (-1, -3): hidden (0, 0)
    assert forward(np.array([[2.0, 1.0], [-1.0, -3.0]]), layers)[-1].tolist() == [[0.0], [-5.0]]


def test_features_are_scaled_by_what_training_saw():
    data = textures()
    family = MLP(**FAST | {"epochs": 1})
    arrays = family.fit(data, Training(), rngs).network.arrays
    x = _scaled(family.counts(data, data.train, {}).reshape(30, -1), arrays)
    assert x.mean(axis=0) == pytest.approx(0, abs=1e-6) and x.std(axis=0) == pytest.approx(1, rel=1e-5)


def test_it_says_whether_training_ended_by_itself():
    short = MLP(**FAST | {"epochs": 1}).fit(textures(), Training(), rngs)
    assert short.health == {"converged": False, "epochs_trained": 1}
    long = MLP(**FAST | {"epochs": 2000}).fit(textures(), Training(), rngs)
    assert long.health["converged"] is True and 10 < long.health["epochs_trained"] < 2000


def test_threads_change_nothing():
    from threadpoolctl import threadpool_limits

    data = textures(n=300, n_steps=40, n_channels=30)
    family = MLP(window_ms=10.0, channels="each", epochs=2, read_outs=1)
    found = []
    for threads in (1, 4):
        with threadpool_limits(threads):
            found.append(family.fit(data, Training(), rngs))
    a, b = (outcome.network.arrays for outcome in found)
    assert all(np.array_equal(a[name], b[name]) for name in a)
    assert np.array_equal(found[0].validation.label, found[1].validation.label)


def test_the_start_depends_on_the_seed_alone():
    def other(purpose, *index):
        return np.random.default_rng([99, *index])

    family = MLP(**FAST | {"epochs": 2})
    a, b = (family.fit(textures(), Training(), own).network.arrays["0/0/weight"] for own in (rngs, other))
    assert not np.array_equal(a, b)


def test_a_run_away_training_says_so():
    family = MLP(**FAST | {"learning_rate": 1e30, "epochs": 5})
    with pytest.raises(TrainingDiverged, match=r"infinite or NaN with learning rate 1e\+30"):
        family.fit(textures(), Training(), rngs)


def test_more_units_than_samples():
    x = np.zeros((4, 10, 1), bool)
    x[::2] = True
    data = data_of(x, [0, 1, 0, 1], [0, 1], [2, 3])
    answers = MLP(window_ms=50.0, hidden=(64,), learning_rate=0.01).fit(data, Training(), rngs).validation
    assert answers.label.tolist() == [[0, 0], [1, 1]]
