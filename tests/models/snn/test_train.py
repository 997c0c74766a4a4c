"""Cohorts: a design's result is bitwise its own, whatever trains beside it."""

import dataclasses
import tracemalloc
from functools import partial

import numpy as np
import pytest

from dse.base import seeds
from dse.base.records import Outcome, Spikes
from dse.engine.losses.count_cross_entropy import CountCrossEntropy
from dse.engine.neurons import fixed_point
from dse.engine.neurons.resonator import Resonator
from dse.models.snn.augment import Augmentation
from dse.models.snn.columns import Columns
from dse.models.snn.family import SNN
from dse.models.snn.train import train
from dse.models.training import FitRequest, Training, TrainingDiverged
from dse.testing.expect import same
from dse.testing.small import spikes_of
from tests.models.snn.toy import toy


def own(design):
    return partial(lambda purpose, *index: seeds.generator(1, {"design": design}, purpose, *index))


SHARED = own(-1)


def asked(data, design, number):
    model, training = design
    return FitRequest(model.placed(data.positions), training, own(number))


def together(data, designs):
    return dict(train(data, [asked(data, design, k) for k, design in enumerate(designs)], SHARED))


def alone(data, design, number):
    ((_, outcome),) = train(data, [asked(data, design, number)], SHARED)
    return outcome


def settled(outcome):
    assert isinstance(outcome, Outcome)
    return outcome


def assert_same(a, b):
    for name in ("network", "validation", "history", "health"):
        assert same(getattr(a, name), getattr(b, name)), name


def base(**keys):
    return Training(**{"epochs": 4, "batch_size": 9, "learning_rate": 0.1, "dropout": 0.0, **keys})


MIXED = [
    (SNN(hidden=(20,)), base()),
    (SNN(hidden=(70,), true_rate=0.5), base(dropout=0.3, learning_rate=0.02)),
    (SNN(hidden=(9, 33)), base(epochs=2)),
    (SNN(hidden=(17,), recurrent=True), base(clip_norm=0.5)),
    (SNN(hidden=(20,), arithmetic="ideal"), base(average_epochs=3)),
    (SNN(hidden=(40,), arithmetic="float32", tau_grad=0.1), base(step_unit="weight", learning_rate=0.005)),
]


LEARNT = {"max_axonal_delay": 20, "delay_learning_rate": 1.0, "learnt_decays": "neuron"}
RESTING = Resonator(share=0.3, reset=True)
COHORTS = {
    "mixed": MIXED,
    "delays": [
        MIXED[0],
        (SNN(hidden=(10,), max_delay=9), base()),
        (SNN(hidden=(12,), **LEARNT), base(keep="best")),
        (SNN(hidden=(8,), learnt_decays="layer"), base()),
    ],
    "neurons": [
        MIXED[0],
        (SNN(hidden=(10,), neuron=Resonator()), base()),
        (SNN(hidden=(10,), neuron=RESTING, arithmetic="ideal"), base()),
    ],
    "shared and pruned weights": [
        MIXED[0],
        (SNN(hidden=(30,), pruned=0.6, prune_epoch=0.0), base()),
        (SNN(hidden=(20,), regions=3, start="contrasts", arithmetic="float32"), base()),
        (SNN(hidden=(9,), regions=12), base()),
        (Columns(features=5, neighbours=1, read_out="shared"), base()),
    ],
}


@pytest.mark.parametrize("designs", COHORTS.values(), ids=COHORTS)
def test_a_result_is_bitwise_the_same_alone_and_in_any_cohort(designs):
    data = toy(margin=3)
    whole = together(data, designs)
    for number, design in enumerate(designs):
        assert_same(settled(whole[number]), settled(alone(data, design, number)))
    last, first = len(designs) - 1, 0
    pair = dict(train(data, [asked(data, designs[k], k) for k in (last, first)], SHARED))
    assert_same(settled(pair[0]), settled(whole[last]))
    assert_same(settled(pair[1]), settled(whole[first]))
    assert not same(alone(data, designs[0], 1).network, whole[0].network), "of another seed"


AUGMENTED = [
    {"event_dropout": 0.3},
    {"dilation": (0.8, 1.25), "dilation_keeps_label": True},
    {"channel_shift": 2},
    {"blend": 0.7},
    {"input_dropout": 0.3},
]


@pytest.mark.parametrize("keys", [*AUGMENTED, {k: v for keys in AUGMENTED for k, v in keys.items()}])
def test_changed_windows_are_the_same_alone_and_in_a_cohort_and_train_another_network(keys):
    data = toy(margin=3)
    designs = [(model, dataclasses.replace(t, epochs=2, **keys)) for model, t in MIXED[:2]]
    whole = together(data, designs)
    for number, design in enumerate(designs):
        assert_same(settled(whole[number]), settled(alone(data, design, number)))
    unchanged = settled(alone(data, (MIXED[0][0], base(epochs=2)), 0))
    assert not same(settled(whole[0]).network, unchanged.network)


def test_blended_windows_are_of_one_class():
    data = toy(margin=3)
    of_class = np.zeros((60, 46, 12), bool)
    of_class[np.arange(60), :, data.target] = True  # channel c fires at every step of class c
    data = dataclasses.replace(data, spikes=spikes_of(of_class, 5.0))
    spikes = Augmentation(data, base(blend=0.5), SHARED).batch(data.train, data.start[data.train])
    np.testing.assert_array_equal(spikes.channel, np.repeat(data.target[data.train], data.n_steps))


def test_a_design_that_diverges_ends_and_leaves_its_neighbours_untouched():
    data = toy()
    wild = SNN(hidden=(20,), arithmetic="ideal"), base(learning_rate=1e3)
    found = together(data, [MIXED[0], wild, MIXED[1]])
    assert isinstance(found[1], TrainingDiverged)
    assert str(found[1]).startswith("the weights of layer") and "times after epoch 1" in str(found[1])
    assert_same(settled(found[0]), settled(alone(data, MIXED[0], 0)))
    assert_same(settled(found[2]), settled(alone(data, MIXED[1], 2)))


def test_integer_weights_may_grow_to_the_limit_of_their_bits():
    """The output weights start near 0 and grow a hundredfold, which high target rates need."""
    design = SNN(hidden=(20,), true_rate=0.9), base(epochs=20, learning_rate=1.0, step_unit="weight")
    weights = settled(alone(toy(), design, 0)).network.layers[1].weight
    assert 2 < float(np.sqrt((weights**2).mean())) <= 4


@pytest.mark.parametrize("recurrent", [False, True])
def test_integer_weights_stay_within_their_bits(recurrent):
    """Beyond them a weight would have no gradient and never come back."""
    design = SNN(hidden=(20,), recurrent=recurrent), base(epochs=2, learning_rate=1e3)
    layers = settled(alone(toy(), design, 0)).network.layers
    for weight in (w for x in layers for w in (x.weight, x.recurrent) if w is not None):
        assert (weight >= -4).all() and (weight <= 254 / 64).all()
        assert fixed_point.quantise_passes(weight).all()


def test_designs_are_yielded_as_they_finish():
    order = [k for k, _ in train(toy(), [FitRequest(*MIXED[k], own(k)) for k in (0, 2)], SHARED)]
    assert order == [1, 0]  # the second has two epochs, the first four


def test_designs_of_other_batches_are_refused():
    with pytest.raises(ValueError, match=r"must agree in input_delays, .*, input_dropout and augmentation"):
        together(toy(), [MIXED[0], (SNN(), base(batch_size=3))])


def test_a_network_that_stays_silent_ends_early_and_says_so():
    data = toy()
    nothing = Spikes(np.zeros_like(data.spikes.row_offsets), np.zeros(0, np.int32), 40, 12, 5.0)
    outcome = settled(
        alone(
            dataclasses.replace(data, spikes=nothing), (SNN(hidden=(6,)), base(epochs=9, silent_epochs=3)), 0
        )
    )
    assert outcome.health["stopped_early"] == "layer 1 was silent for 3 epochs"
    assert (outcome.health["collapsed_outputs"], outcome.health["saturated_outputs"]) == (1, 0)
    assert outcome.health["epochs_trained"] == 3 == len(outcome.history["loss"])
    assert (
        settled(alone(data, (SNN(hidden=(6,)), base(epochs=5, silent_epochs=3)), 0)).health["stopped_early"]
        == ""
    )


def test_a_network_that_saturates_ends_early_and_says_so():
    model = SNN(hidden=(30,), true_rate=1.0, false_rate=0.99, initial_rate=0.5)  # outputs are to fire always
    outcome = settled(alone(toy(n_steps=200), (model, base(epochs=9, silent_epochs=2)), 0))
    assert outcome.health["stopped_early"] == "layer 2 was saturated for 2 epochs"
    assert outcome.health["saturated_outputs"] > 0


def test_cross_entropy_trains_and_a_price_of_hidden_spikes_halves_them():
    rates = {}
    for penalty in (0.0, 0.01):
        model = SNN(hidden=(20,), loss=CountCrossEntropy(0.3, read_outs=2), hidden_spike_penalty=penalty)
        outcome = settled(alone(toy(), (model, base(epochs=12)), 0))
        assert outcome.history["accuracy_train"][-1] > 0.7
        assert outcome.health["collapsed_outputs"] == 0
        rates[penalty] = outcome.validation.spikes[..., 1].sum()
    assert 0 < rates[0.01] < 0.5 * rates[0.0]


def test_clipped_gradients_are_counted_and_change_the_result():
    data = toy()
    free = settled(alone(data, (SNN(hidden=(8,)), base()), 0))
    loose = settled(alone(data, (SNN(hidden=(8,)), base(clip_norm=1e9)), 0))
    tight = settled(alone(data, (SNN(hidden=(8,)), base(clip_norm=1e-6)), 0))
    np.testing.assert_array_equal(free.network.layers[0].weight, loose.network.layers[0].weight)
    assert free.health["clipped_gradients"] == loose.health["clipped_gradients"] == 0
    assert tight.health["clipped_gradients"] == 4 * 4  # four batches in each of four epochs
    assert tight.health["gradient_norm_largest"] > 1e-3  # the norm before it is clipped
    assert not np.array_equal(free.network.layers[0].weight, tight.network.layers[0].weight)


@pytest.mark.parametrize("arithmetic", ["integer", "float32", "ideal"])
@pytest.mark.parametrize("n_steps", [1, 2])
def test_the_shortest_windows_train(arithmetic, n_steps):
    outcome = settled(alone(toy(n_steps=n_steps, n=12), (SNN(hidden=(5,), arithmetic=arithmetic), base()), 0))
    assert np.isfinite(outcome.history["loss"]).all()


def test_twenty_thousand_steps_train_and_keep_their_numbers():
    data = toy(n_channels=6, n_steps=20_000, n=6, rate=0.02)
    outcome = settled(alone(data, (SNN(hidden=(4,), arithmetic="float32"), base(epochs=1, batch_size=2)), 0))
    assert np.isfinite(outcome.history["loss"]).all()
    assert all(np.isfinite(x.weight).all() for x in outcome.network.layers)


def test_a_class_with_a_single_sample_trains():
    data = toy()
    keep = np.concatenate(
        [data.train[data.target[data.train] != 2], data.train[data.target[data.train] == 2][:1]]
    )
    outcome = settled(alone(dataclasses.replace(data, train=keep), (SNN(hidden=(5,)), base()), 0))
    assert np.isfinite(outcome.history["loss"]).all()


@pytest.mark.parametrize(
    ("n_channels", "hidden", "n_steps", "batch_size", "keys"),
    [
        (1500, (300,), 60, 16, {}),
        (6084, (425,), 200, 8, {}),
        (1500, (300, 300), 60, 16, {"whitened": "all", "weight_norm": True}),
    ],
)
def test_what_a_cohort_is_said_to_hold_is_not_less_than_what_it_holds(
    n_channels, hidden, n_steps, batch_size, keys
):
    data = toy(n_channels=n_channels, n_steps=n_steps, n=9, rate=0.02)
    model, training = SNN(hidden=hidden, **keys), base(epochs=1, batch_size=batch_size)
    alone(toy(), (model, training), 0)  # compile first
    tracemalloc.start()
    together(data, [(model, training)] * 3)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    sizes = n_channels, 3, n_steps, training
    said = 3 * model.memory_bytes(*sizes) + model.workspace_bytes(*sizes)
    events = 4 * data.spikes.channel.nbytes
    assert peak <= said + events
    assert said < 2.5 * peak  # a bound that is of use


def test_costs_rank_designs_as_they_take():
    training = base(epochs=10)
    costs = [SNN(hidden=(h,)).cost(1600, 11, 250, 8000.0, 320, training) for h in (50, 100, 450)]
    assert costs[0] < costs[1] < costs[2]
    assert SNN(hidden=(50,)).cost(1600, 11, 250, 8000.0, 320, base(epochs=20)) == pytest.approx(2 * costs[0])


def test_clipped_weights_are_counted():
    outcome = settled(
        alone(toy(), (SNN(hidden=(8,)), base(step_unit="weight", learning_rate=1.0, epochs=2)), 0)
    )
    expected = sum(
        int(np.isin(fixed_point.quantise(x.weight), (-4, 254 / 64)).sum()) for x in outcome.network.layers
    )
    assert outcome.health["clipped_weights"] == expected > 0
