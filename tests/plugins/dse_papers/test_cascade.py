"""Cascades: the second stack sees the first one's outputs, late and as they would be on a chip."""

import dataclasses

import numpy as np
import pytest

from dse import store
from dse.base.records import Network, Response, Spikes
from dse.engine.events import dense, gather
from dse.measure import heads
from dse.models.snn.respond import respond
from dse.models.training import Training
from dse_papers.models.cascade import Cascade, beside, cut
from tests.joint_data import joint
from tests.models.snn.toy import rngs

FAST = Training(epochs=20, batch_size=8, learning_rate=0.1, warmup_epochs=1, dropout=0.0)
SHORT = Training(epochs=2, batch_size=8, dropout=0.1)
SMALL = {"hidden": (14,), "first_hidden": (9,), "true_rate": 0.5, "output_tau_grad": 0.3}


def arrays(spikes, start, n_steps):
    return dense(gather(spikes, np.arange(spikes.n_samples), start, n_steps))


def fit(model, data, training=SHORT, seed=0):
    return model.fit(data, training, rngs(seed))


def test_both_heads_are_learnt_and_answers_come_in_their_order():
    data = joint()
    outcome = fit(Cascade(**SMALL), data, FAST)
    counts = outcome.validation.output.sum(axis=1, dtype=np.int64)
    right = heads.head_answers(data, counts) == heads.head_targets(data, data.validation)
    assert right.mean(axis=0).min() >= 0.8
    assert outcome.health["accuracy_cross_fit"] >= 0.7
    assert outcome.test is not None and outcome.test.output.shape == (10, 40, 5)
    assert len(outcome.history["loss"]) == len(outcome.history["first_loss"]) == 20


def of(fitted, name):
    return store.record_of(Network, fitted.arrays, name)


@pytest.mark.parametrize(
    "keys",
    [{}, {"input_delays": (0, 3)}, {"input_delays": (2, 4)}, {"steps_per_sample": 2, "input_delays": (0, 1)}],
    ids=str,
)
@pytest.mark.parametrize("first", ["texture", "profile"])
def test_the_second_stack_reads_what_the_first_one_sends_and_every_spike_is_counted(first, keys):
    data = joint(margin=3)
    model = Cascade(**SMALL, first=first, cross_fit=0, pruned=0.5, **keys)
    outcome = fit(model, data)
    said, k = outcome.validation, model.steps_per_sample
    assert isinstance(said, Response)
    one, two = of(outcome.network, "first/"), of(outcome.network, "second/")
    alone = respond(one, data, data.validation)
    places = heads.head_slices(data)[0 if first == "texture" else 1]
    np.testing.assert_array_equal(said.output[..., places], alone.output)

    # What the second stack sees, made anew from dense arrays: the data, and the outputs so far.
    n = data.validation.size
    window = cut(data.spikes, data.validation, data.start[data.validation], np.full(n, 40))
    sent = np.zeros((n, 40, alone.output.shape[2]), np.uint8)
    for t in range(40 * k):
        due = -(-t // k)  # the first input step that begins no earlier
        if due < 40:
            sent[:, due] |= alone.output[:, t]
    seen = dataclasses.replace(data, spikes=beside(window, sent), start=np.zeros(n, np.int32))
    expected = respond(two, seen, np.arange(n))
    rest = np.delete(said.output, np.arange(5)[places], axis=2)
    np.testing.assert_array_equal(rest, expected.output)

    # Layers: data copies, first hidden, first output, its delayed copies, second hidden, second output.
    np.testing.assert_array_equal(said.spikes[..., :3], alone.spikes)
    np.testing.assert_array_equal(said.spikes[..., 4:], expected.spikes[..., 1:])
    copies = np.zeros((n, 40 * k), int)
    for d in model.input_delays:
        if d:
            copies[:, d * k :: k] += sent.sum(axis=2, dtype=int)[:, : 40 - d]
    np.testing.assert_array_equal(said.spikes[..., 3], copies)
    np.testing.assert_array_equal(
        said.updates[..., [0, 1, 3, 4]], np.concatenate([alone.updates, expected.updates], 2)
    )
    assert not said.updates[..., 2].any()
    assert said.peak_state == max(alone.peak_state, expected.peak_state)

    total = said.spikes.sum(axis=(0, 1), dtype=np.int64)
    both = [x.spikes.sum(axis=(0, 1), dtype=np.int64) @ np.array(x.synapses) for x in (alone, expected)]
    assert total @ np.array(said.synapses) == pytest.approx(sum(both), rel=1e-9)
    assert int(outcome.network.arrays["n_weights"]) == one.n_weights + two.n_weights
    assert outcome.health["n_weights"] == one.n_weights + two.n_weights
    assert (
        outcome.health["n_weights_dense"]
        == one.n_weights_dense + two.n_weights_dense
        > one.n_weights + two.n_weights
    )


def watched(monkeypatch):
    """Return the data that stacks train on, as they are trained."""
    from dse.models.snn.family import SNN

    seen = []
    before = SNN.fit
    monkeypatch.setattr(SNN, "fit", lambda self, data, *rest: seen.append(data) or before(self, data, *rest))
    return seen


def test_samples_are_answered_by_stacks_that_trained_on_others(monkeypatch):
    data, seen = joint(), watched(monkeypatch)
    fit(Cascade(**SMALL, cross_fit=3), data)
    whole, *parts, last = seen
    assert [x.spikes.n_channels for x in seen] == [12] * 4 + [14]
    assert whole.train.tolist() == last.train.tolist() == list(range(40))
    held = [x.validation for x in parts]
    assert sorted(np.concatenate(held).tolist()) == list(range(40))
    for x in parts:
        assert not set(x.train) & set(x.validation)
        assert x.train.size + x.validation.size == 40
    test = {tuple(arrays(data.spikes, np.zeros(80, int), 40)[i].ravel()) for i in data.test}
    for x in seen:
        of_data = arrays(x.spikes, np.zeros(x.spikes.n_samples, int), 40)[..., :12]
        assert not test & {tuple(sample.ravel()) for sample in of_data}


def test_one_training_sample_and_silence():
    data = joint()
    one = dataclasses.replace(data, train=data.train[:1])
    assert fit(Cascade(**SMALL), one).validation.output.shape == (30, 40, 5)
    nothing = Spikes(np.zeros_like(data.spikes.row_offsets), np.zeros(0, np.int32), 40, 12, 5.0)
    silent = fit(Cascade(**SMALL), dataclasses.replace(data, spikes=nothing))
    assert not silent.validation.output.any() and np.isfinite(silent.validation.synapses).all()


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"max_delay": 9}, "max_delay must be 0 in a cascade"),
        ({"max_axonal_delay": 9}, "max_axonal_delay must be 0 in a cascade"),
        ({"cross_fit": 1}, r"cross_fit must be 0 or >= 2, got 1"),
        ({"first_hidden": (1, 2, 3, 4)}, r"first_hidden must have 1 to 3 layers, got 4"),
        ({"input_delays": (1, 1)}, r"must hold at least one delay and none twice"),
    ],
)
def test_settings_that_contradict_are_refused(keys, message):
    with pytest.raises(ValueError, match=message):
        Cascade(**keys)


def test_targets_that_do_not_fit_are_refused():
    data = joint()
    with pytest.raises(
        ValueError, match=r"must be a column of the target \(texture or profile\), got 'speed'"
    ):
        fit(Cascade(first="speed"), data)
    with pytest.raises(ValueError, match=r"cascade needs a joint target, got 1 head"):
        fit(Cascade(), dataclasses.replace(data, heads=()))


def test_both_stacks_are_tied_by_region_and_dithered():
    """The outputs of the first are inputs of their own, with a weight each."""
    keys = {**SMALL, "regions": 3, "start": "levels", "rounding": "dithered", "threshold_exponents": (-1, 2)}
    outcome = fit(Cascade(**keys), joint())
    for name in ("first/", "second/"):
        network = of(outcome.network, name)
        assert network.n_weights == network.n_weights_dense
        assert [int(x.parameters["threshold"]) for x in network.layers][1] == 320
    with pytest.raises(ValueError, match="first_hidden must then have as many layers as hidden, got 2 and 1"):
        Cascade(**{**keys, "first_hidden": (5, 6)})


def test_without_cross_fit_its_accuracy_is_unknown(monkeypatch):
    seen = watched(monkeypatch)
    assert np.isnan(fit(Cascade(**SMALL, cross_fit=0), joint()).health["accuracy_cross_fit"])
    assert len(seen) == 2


def test_further_channels_stand_after_the_others():
    data = joint()
    more = (np.random.default_rng(0).random((80, 40, 3)) < 0.2).astype(np.uint8)
    found = beside(data.spikes, more)
    own = arrays(data.spikes, np.zeros(80, int), 40)
    np.testing.assert_array_equal(arrays(found, np.zeros(80, int), 40), np.concatenate([own, more], axis=2))
    rows = np.repeat(np.arange(80 * 40), np.diff(found.row_offsets))
    assert (np.diff(rows * 15 + found.channel) > 0).all()  # sorted, no duplicates
    assert beside(data.spikes, more[..., :0]).channel.tolist() == data.spikes.channel.tolist()
