"""`dse.Classifier`: what scikit-learn asks of estimators, what X may be, and what bad recordings say."""

import pickle

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.model_selection import GroupKFold, cross_val_score
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer
from sklearn.utils.estimator_checks import parametrize_with_checks

import dse

FAST = {
    **{
        "training.epochs": 2,
        "model": {"kind": "snn", "hidden": 4},
        "encoder": {"kind": "send_on_delta", "thresholds": [0.2]},
    },
    **{"hardware": [], "objectives": ["accuracy:max"], "split": {"stratified": {"validation": 0.3}}},
}
PLAIN = FAST | {"model": {"kind": "linear", "window_ms": 100.0}, "limits": []}


# Rows of numbers are recordings of one channel; the check of the array API skips itself.
@parametrize_with_checks([dse.Classifier(settings=PLAIN)])
@pytest.mark.filterwarnings("ignore::sklearn.exceptions.SkipTestWarning")
def test_scikit_learn_accepts_it(estimator, check):
    check(estimator)


def waves(n=40, steps=50, channels=2):
    rng = np.random.default_rng(1)
    y = np.tile(["denim", "silk"], n // 2)
    turn = np.where(y == "denim", 0.1, 0.6)[:, None, None] * np.arange(steps)
    return np.sin(turn + rng.normal(size=(n, channels, 1))), y


LEARNS = {"training.epochs": 20, "model.snn.hidden": [20], "encoder": FAST["encoder"], "split": FAST["split"]}


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    X, y = waves()
    return dse.Classifier(chip="mcu_m4", settings=LEARNS, results=tmp_path_factory.mktemp("kept")).fit(X, y)


def test_it_learns_and_keeps_study_pick_and_bundle(fitted, tmp_path):
    X, y = waves()
    assert fitted.score(X, y) > 0.8 and fitted.classes_.tolist() == ["denim", "silk"]
    assert set(fitted.study_.points()["hardware"]) == {"mcu_m4"} and fitted.pick_["n_weights"] > 0
    proba = fitted.predict_proba(X)
    np.testing.assert_allclose(proba.sum(axis=1), 1)
    assert (fitted.classes_[proba.argmax(axis=1)] == fitted.predict(X)).all()
    written = fitted.export(tmp_path / "bundle")
    np.savez(tmp_path / "new.npz", signal=X.transpose(0, 2, 1).reshape(-1, 2), offsets=np.arange(41) * 50)
    found = dse.evaluate(written, tmp_path / "new.npz")
    names = np.array(found.classes)[found.label]
    assert (names == fitted.predict(X)).all() and (
        names == fitted.bundle_.predict(X.transpose(0, 2, 1))
    ).all()
    assert fitted.bundle_.score(X, y, "recording channel step") == fitted.score(X, y)
    assert (pickle.loads(pickle.dumps(fitted)).predict(X) == fitted.predict(X)).all()


@pytest.mark.parametrize("kind", ["linear", "mlp"])
def test_plain_families_know_how_sure_they_are_of_each_recording(kind):
    X, y = waves()
    learns = {**LEARNS, "training.epochs": 5, "model": {"kind": kind, "window_ms": 100.0}, "limits": []}
    del learns["model.snn.hidden"]
    fitted = dse.Classifier(settings=learns).fit(X, y)
    X = np.concatenate([X, X + np.random.default_rng(2).normal(0, 0.5, X.shape)])
    proba = fitted.predict_proba(X)
    np.testing.assert_allclose(proba.sum(axis=1), 1)
    assert (fitted.classes_[proba.argmax(axis=1)] == fitted.predict(X)).all()
    assert len(np.unique(proba.max(axis=1).round(6))) > 10  # a number of its own for each


@pytest.mark.parametrize(
    "same",
    [list, lambda X: pd.DataFrame({f"c{k}": [pd.Series(x) for x in X[:, k]] for k in range(2)})],
    ids=["list", "table of series"],
)
def test_the_same_recordings_in_another_form_have_the_same_answers(fitted, same):
    X, _ = waves()
    assert (fitted.predict(same(X)) == fitted.predict(X)).all()


def test_the_other_order_of_axes_and_unequal_lengths_fit():
    X, y = waves()
    there = dse.Classifier(settings=FAST).fit(X, y)
    turned = clone(there).set_params(axes="recording step channel").fit(X.transpose(0, 2, 1), y)
    assert (there.predict(X) == turned.predict(X.transpose(0, 2, 1))).all()
    unequal = [x[:, : 40 + i % 7] for i, x in enumerate(X)]
    padded = clone(there).fit(unequal, y)
    assert padded.study_.space["window"]["n_steps"] == 46 and len(padded.predict(unequal)) == 40
    with pytest.raises(ValueError, match="must have 2 channels"):
        padded.predict([X[0], X[1, :1, :40]])


def test_it_is_crossed_validated_in_pipelines_with_tables_and_groups():
    X, y = waves()
    several = make_pipeline(FunctionTransformer(lambda x: 2 * x), dse.Classifier(settings=FAST))
    assert cross_val_score(several, X, y, cv=GroupKFold(2), groups=np.arange(40) // 4).shape == (2,)
    table = pd.DataFrame({"fabric": y, "hand": np.arange(40) % 3})
    as_written = {name: value for name, value in FAST.items() if name != "split"}
    grouped = dse.Classifier(task="fabric", settings=as_written)
    found = grouped.fit(X, table, groups=pd.Series(np.arange(40) // 4))
    folds = found.study_.space["split"]["k_fold"]
    assert (folds["k"], folds["test"], folds["group"]) == (4, 0.2, "group")
    assert found.study_.space["task"]["target"] == "fabric"


X, Y = waves()
BAD = {
    "one class": (X, ["denim"] * 40, None, "2 classes or more"),
    "a class of one": (X, ["denim"] * 39 + ["silk"], None, "'silk' of 'label' has 1"),
    "two recordings": (X[:2], Y[:2], None, "at least 2 recordings"),
    "constant": (np.ones_like(X), Y, None, "every channel has one value"),
    "no numbers": (np.where(np.arange(2)[:, None] == 1, np.nan, X), Y, None, "NaN"),
    "measured": (X, np.linspace(0, 1, 40), None, "continuous"),
    "groups are classes": (X, Y, Y, "'group' has one value in class 'denim'"),
    "labels of others": (X, Y[:5], None, "each of the 40 recordings"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_no_study_can_be_made_of_is_said_in_one_line(name):
    signals, labels, groups, why = BAD[name]
    with pytest.raises(ValueError, match=why) as caught:
        dse.Classifier(settings=FAST).fit(signals, labels, groups)
    if name not in ("no numbers", "measured"):  # scikit-learn's own words
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("keys", "why"),
    [
        ({"budget": "n_weights <= 1"}, "n_weights <= 1"),
        ({"chip": "mcu_m99"}, "mcu_m99"),
        ({"settings": {"model.hiden": 4}}, "hiden"),
    ],
)
def test_what_cannot_be_asked_for_is_said_in_one_line(keys, why):
    settings = {name: value for name, value in FAST.items() if name != "hardware"}
    with pytest.raises(ValueError, match=why) as caught:
        dse.Classifier(**{"settings": settings, **keys}).fit(X, Y)
    assert "\n" not in str(caught.value)
