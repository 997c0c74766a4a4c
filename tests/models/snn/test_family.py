"""Training CUBA-LIF classifiers: start, learning, determinism, hard cases."""

from dataclasses import replace

import numpy as np
import pytest

from dse.base.records import Spikes
from dse.engine.losses.count_cross_entropy import CountCrossEntropy
from dse.engine.neurons.cuba_lif import CubaLif
from dse.engine.neurons.lif import Lif
from dse.engine.neurons.resonator import Resonator
from dse.measure import heads
from dse.models.snn.columns import Columns
from dse.models.snn.family import SNN
from dse.models.training import Training, TrainingDiverged
from dse.testing import check_family
from tests.joint_data import joint
from tests.models.snn.toy import accuracy, fit, rngs, toy

FAST = Training(epochs=25, batch_size=8, learning_rate=0.1, warmup_epochs=1, dropout=0.0)


@pytest.mark.parametrize(
    "model",
    [
        {"hidden": (20,)},
        {"hidden": (20, 15)},
        {"hidden": (12, 10, 8)},
        {"hidden": (20,), "recurrent": True},
        {"hidden": (20,), "arithmetic": "ideal"},
        {"hidden": (20,), "input_delays": (0, 2), "steps_per_sample": 2},
        {
            "hidden": (20,),
            "neuron": CubaLif(current_decay=(0.1, 1.0), voltage_decay=(0.03, 0.9), threshold=5.0),
        },
    ],
    ids=lambda m: ", ".join(f"{k}={v}" for k, v in m.items()),
)
def test_every_kind_of_network_learns_the_toy_task(model):
    data = toy()
    outcome = fit(data, SNN(true_rate=0.5, output_tau_grad=0.3, **model), FAST, rngs())
    assert accuracy(outcome, data) >= 0.8
    assert outcome.history["loss"][-1] < 0.7 * outcome.history["loss"][0]
    settings = SNN(**model)
    assert outcome.network.n_weights == settings.n_weights(12, 3)
    assert outcome.validation.output.shape == (30, 40 * settings.steps_per_sample, 3)


@pytest.mark.parametrize(
    "model",
    [
        SNN(hidden=(6, 5), max_delay=12, delayed_layers="all", pruned=0.3),
        SNN(hidden=(6, 5), max_axonal_delay=20, learnt_decays="neuron"),
        SNN(hidden=(6,), neuron=Resonator(share=0.5), recurrent=True, pruned=0.3),
        SNN(hidden=(6,), regions=3, start="contrasts", rounding="dithered"),
        SNN(hidden=(6,), whitened="output", weight_norm=True, arithmetic="float32", loss=CountCrossEntropy()),
        SNN(hidden=(6,), input_delays=(0, 2), steps_per_sample=2, arithmetic="ideal"),
        Columns(features=3, neighbours=1, read_out="shared"),
    ],
    ids=range(7),
)
def test_every_kind_of_network_keeps_the_contract(model):
    """It follows from its seed, answers again after it was stored, and trains alone as in a cohort."""
    check_family(model)


def test_a_wide_input_does_not_start_silent():
    # Uniform(-1/sqrt(C), 1/sqrt(C)) rounds to zero in 8 bits for C > 4096: no spikes, no gradient.
    data = toy(n_channels=6084, n_steps=20, n=12, rate=0.02)
    outcome = fit(data, SNN(hidden=(8,)), Training(epochs=1, batch_size=6), rngs())
    assert outcome.health["missed_initial_rates"] == 0
    assert 0.05 <= outcome.health["initial_rate_hidden"] <= 0.2
    assert outcome.validation.spikes[..., 1].sum() > 0


def test_an_unreachable_initial_rate_is_reported_and_does_not_run_away():
    data = toy()
    nothing = Spikes(np.zeros_like(data.spikes.row_offsets), np.zeros(0, np.int32), 40, 12, 5.0)
    silent = replace(data, spikes=nothing)
    outcome = fit(silent, SNN(hidden=(10,)), Training(epochs=2), rngs())
    assert outcome.health["missed_initial_rates"] == 2
    assert outcome.health["dead_neurons"] == 10
    assert np.isfinite(outcome.network.layers[0].weight).all()


def test_divergence_is_raised_with_its_epoch():
    with pytest.raises(TrainingDiverged, match=r"not finite (in|after) epoch \d"):
        fit(toy(), SNN(hidden=(10,), arithmetic="ideal"), Training(epochs=9, learning_rate=1e40), rngs())


def test_one_training_sample_and_a_batch_that_does_not_divide():
    data = toy()
    one = replace(data, train=data.train[:1])
    assert len(fit(one, SNN(hidden=(4,)), Training(epochs=2), rngs()).history["loss"]) == 2
    none = replace(data, train=data.train[:0])
    with pytest.raises(ValueError, match=r"needs at least one training sample"):
        fit(none, SNN(hidden=(4,)), Training(epochs=1), rngs())


def test_input_spikes_of_the_response_count_every_delayed_copy():
    data = toy()
    outcome = fit(data, SNN(hidden=(4,), input_delays=(0, 1)), Training(epochs=1), rngs())
    i = data.validation[0]
    stored = np.diff(data.spikes.row_offsets)[i * 40 : (i + 1) * 40]
    expected = stored + np.concatenate([[0], stored[:-1]])
    np.testing.assert_array_equal(outcome.validation.spikes[0, :, 0], expected)


def test_the_last_epochs_are_averaged():
    data, model = toy(), SNN(hidden=(6,))
    runs = [fit(data, model, Training(epochs=n, batch_size=8), rngs()) for n in (2, 3)]
    mean = fit(data, model, Training(epochs=3, batch_size=8, average_epochs=2), rngs())
    expected = np.mean([r.network.layers[0].weight for r in runs], axis=0)
    np.testing.assert_allclose(mean.network.layers[0].weight, expected, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"hidden": (1, 2, 3, 4)}, r"1 to 3 layers, got 4"),
        ({"input_delays": (1, 1)}, r"must hold at least one delay and none twice"),
        ({"false_rate": 0.9}, r"false_rate must be below true_rate"),
    ],
)
def test_settings_that_contradict_are_refused(keys, message):
    with pytest.raises(ValueError, match=message):
        SNN(**keys)


def test_time_constants_stay_within_their_bounds_and_spread():
    data = toy()
    model = SNN(hidden=(200,), neuron=CubaLif(current_decay=(0.1, 0.9), voltage_decay=(0.25,)))
    decays = fit(data, model, Training(epochs=1), rngs()).network.layers[0].parameters
    assert decays["decay_current"].min() >= 409 and decays["decay_current"].max() <= 3687
    assert decays["decay_current"].std() > 300
    assert set(decays["decay_voltage"].tolist()) == {1024}


def test_the_learning_rate_rises_then_steps_down():
    training = Training(learning_rate=1.0, warmup_epochs=2, lr_every=10, lr_factor=0.5)
    assert 0 < training.rate(0) < 0.01
    assert training.rate(1) == pytest.approx(0.5, abs=1e-3)
    assert training.rate(9.9) == 1.0
    assert training.rate(10) == 0.5
    assert training.rate(25.5) == 0.25


def test_a_joint_network_learns_both_heads_with_one_hidden_layer():
    data = joint()
    model = SNN(hidden=(20,), true_rate=0.5, output_tau_grad=0.3)
    outcome = fit(data, model, FAST, rngs())
    assert outcome.validation.output.shape == (30, 40, 5)
    assert outcome.network.n_weights == model.n_weights(12, 5) == 20 * (12 + 5)
    assert outcome.health["missed_initial_rates"] == 0
    counts = outcome.validation.output.sum(axis=1, dtype=np.int64)
    right = heads.head_answers(data, counts) == heads.head_targets(data, data.validation)
    assert right.mean(axis=0).min() >= 0.8
    # In training a sample counts where both heads are right.
    trained = model.respond(outcome.network, data, data.train).output.sum(axis=1, dtype=np.int64)
    both = (heads.head_answers(data, trained) == heads.head_targets(data, data.train)).all(axis=1)
    assert outcome.history["accuracy_train"][-1] == pytest.approx(both.mean(), abs=0.15)


def test_a_single_head_trains_as_its_classes_alone():
    data = joint()
    profile = data.heads[1]
    one = replace(data, heads=(profile,))
    plain = replace(data, heads=(), target=profile.of_class[data.target], classes=profile.classes)
    outcomes = [fit(x, SNN(hidden=(9,)), Training(epochs=2), rngs()) for x in (one, plain)]
    for a, b in zip(*(x.network.layers for x in outcomes), strict=True):
        np.testing.assert_array_equal(a.weight, b.weight)
    np.testing.assert_array_equal(*(x.validation.output for x in outcomes))
    np.testing.assert_array_equal(*(x.history["accuracy_train"] for x in outcomes))


def test_neurons_that_cannot_be_made_are_refused():
    with pytest.raises(ValueError, match=r"one decay or two bounds, got 3"):
        CubaLif(current_decay=(0.1, 0.2, 0.3))
    with pytest.raises(ValueError, match=r"arithmetic must be float32 or ideal for neuron lif, got integer"):
        SNN(neuron=Lif())
