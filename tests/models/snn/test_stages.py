"""Trainings with whitened weights, weight norm and outputs that learn alone first."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.ours import rows_of
from dse.base.records import Layer, Outcome
from dse.cli import main
from dse.engine.events import delayed, gather
from dse.engine.forward import prepare
from dse.engine.goal import is_label
from dse.engine.layers import weights as layer_weights
from dse.engine.losses.count_cross_entropy import CountCrossEntropy
from dse.engine.network import layer_spikes
from dse.engine.neurons import cuba_lif, parameters_of
from dse.engine.neurons.cuba_lif import CubaLif
from dse.engine.neurons.lif import Lif
from dse.engine.neurons.response import constant_response
from dse.engine.neurons.xylo_lif import XyloLif
from dse.engine.parameters import lengths
from dse.measure import heads
from dse.models.snn import outputs
from dse.models.snn.columns import Columns
from dse.models.snn.family import SNN
from dse.models.snn.quantise import closest, compensated
from dse.models.snn.respond import batches_of, layers_of
from dse.models.snn.train import train
from dse.models.training import FitRequest, Span, Training
from dse.testing.small import spikes_of
from tests.joint_data import joint
from tests.models.snn.test_train import SHARED, alone, assert_same, own, settled, together
from tests.models.snn.toy import accuracy, fit, rngs, toy
from tests.spaces import write_space

LOSS = CountCrossEntropy(0.2)


def base(**keys):
    return Training(**{"epochs": 6, "output_epochs": 3, "batch_size": 9, "dropout": 0.0, **keys})


DESIGNS = [
    (SNN(hidden=(20,), whitened="output", loss=LOSS), base(lr_schedule="cosine", hidden_lr_factor=0.1)),
    (SNN(hidden=(20, 15), whitened="all", loss=LOSS), base(dropout=0.2, clip_norm=0.5)),
    (SNN(hidden=(20,), whitened="output"), base(average_epochs=2)),
    (SNN(hidden=(20,), weight_norm=True, arithmetic="float32"), base(step_unit="weight", learning_rate=0.01)),
    (SNN(hidden=(15,), weight_norm=True, recurrent=True, pruned=0.4, loss=LOSS), base()),
    (SNN(hidden=(12,), max_delay=5, delayed_layers="all", loss=LOSS), base(epochs=4)),
    (SNN(hidden=(15,), weight_norm=True, whitened="output", arithmetic="ideal"), base(teacher="mlp")),
    (SNN(hidden=(20,), start="contrasts"), base(epochs=3)),
]


def up_to(data, design, until, state=None):
    span = Span([] if state is None else [lambda: state], until)
    ((_, ended),) = train(data, [FitRequest(*design, own(0))], SHARED, span=span)
    return ended


def same_weights(a, b):
    pairs = zip(a.network.layers, b.network.layers, strict=True)
    return all(np.array_equal(x.weight, y.weight) for x, y in pairs)


def hidden_spikes(outcome):
    return int(outcome.validation.spikes[..., 1:-1].sum())


@pytest.mark.parametrize("design", DESIGNS, ids=range(len(DESIGNS)))
def test_every_kind_learns_the_toy_task_with_a_curve_per_epoch(design):
    data = toy()
    outcome = fit(data, design[0], replace(design[1], epochs=12), rngs())
    assert accuracy(outcome, data) > 0.9
    assert {len(curve) for curve in outcome.history.values()} == {12}
    assert all(np.isfinite(curve).all() for curve in outcome.history.values())
    assert 1 <= outcome.health["effective_rank"] <= 20


def test_a_result_is_bitwise_the_same_alone_and_in_any_cohort_and_with_any_threads():
    data = toy(margin=3)
    whole = together(data, DESIGNS)
    for number, design in enumerate(DESIGNS):
        assert_same(settled(whole[number]), settled(alone(data, design, number)))
    ((_, threaded),) = train(data, [FitRequest(*DESIGNS[1], own(1))], SHARED, threads=3)
    assert_same(settled(threaded), settled(whole[1]))


def test_the_outputs_begin_with_a_readout_at_the_rate_of_their_targets(monkeypatch):
    """With no step to speak of, the network ends as the readout of its counts, times one factor."""
    monkeypatch.setattr(outputs, "_COMMON", ())
    data, model = toy(), SNN(hidden=(20,), loss=LOSS, arithmetic="float32", true_rate=0.3)
    end = up_to(data, (model, base(learning_rate=1e-9)), None)
    assert accuracy(end, data) >= 0.9
    target = (0.3 + 2 * 0.02) / 3
    counts = end.validation.output.sum(axis=1, dtype=np.int64)
    assert counts.max(axis=1).mean() / 40 == pytest.approx(target, rel=0.3)
    assert end.health["initial_rate_output"] == pytest.approx(target, rel=0.1)
    spikes = outputs.hidden_spikes(end.network, data)
    hidden = outputs.counts_of(spikes, spikes.train)
    weights = outputs.readout(hidden, is_label(data.target[data.train], 3), (3,), own(0)("outputs"))
    found = end.network.layers[1].weight.T
    factor = (weights * found).sum() / (weights**2).sum()
    assert factor > 0
    np.testing.assert_allclose(found, factor * weights, rtol=1e-3, atol=1e-5)


def test_a_readout_comes_near_the_least_cross_entropy_of_the_counts():
    from scipy.optimize import minimize

    rng = np.random.default_rng(0)
    label = np.arange(300) % 3
    counts = rng.poisson(20 + 4 * np.eye(3)[label] @ rng.random((3, 6)))

    def entropy(flat):
        odds = counts @ flat.reshape(6, 3)
        odds = odds - odds.max(axis=1, keepdims=True)
        return float((np.log(np.exp(odds).sum(axis=1)) - odds[np.arange(300), label]).sum())

    found = outputs.readout(counts, is_label(label, 3), (3,), rng)
    least = minimize(entropy, np.zeros(18), method="BFGS").fun
    assert entropy(found.ravel()) == pytest.approx(least, rel=0.02)


@pytest.mark.parametrize("keys", [{}, {"arithmetic": "float32", "whitened": "output"}, {"hidden": (15, 12)}])
def test_outputs_that_learn_alone_take_the_steps_of_a_network_whose_hidden_layers_rest(keys):
    """The spikes that are computed once are those that every step of the whole network would compute."""
    data, model = toy(), SNN(**{"hidden": (20,), "loss": LOSS, "recurrent": True, **keys})
    alone = up_to(data, (model, base(epochs=3, output_epochs=3, keep="best")), None)
    rung = up_to(data, (model, base(epochs=3, output_epochs=3)), 0)
    assert isinstance(rung, Outcome) and rung.history["loss"].tolist() == alone.history["loss"].tolist()
    whole = alone.validation.output.sum(axis=1, dtype=np.int64).argmax(axis=1)
    right = (whole == data.target[data.validation]).mean()
    assert max(alone.history["accuracy_validation"]) == right  # outputs alone and the network answer alike
    for a, b in zip(alone.network.layers[:-1], rung.network.layers[:-1], strict=True):
        np.testing.assert_array_equal(a.weight, b.weight)
    layers = layers_of(alone.network)
    rows = next(batches_of(alone.network, data, data.train))
    hidden = outputs.hidden_spikes(alone.network, data)
    seen = gather(hidden.spikes, hidden.train[: rows.n_samples], hidden.start[: rows.n_samples], 40)
    expected = delayed(layer_spikes(rows, layers[:-1])[-1])
    np.testing.assert_array_equal(seen.index, expected.index)
    np.testing.assert_array_equal(seen.offsets, expected.offsets)


@pytest.mark.parametrize(
    "neuron", [CubaLif(), Lif()], ids=["cuba_lif", "lif"]
)  # with a kernel, and by its definition in torch
def test_hidden_neurons_drop_out_of_outputs_that_learn_alone(neuron, monkeypatch):
    steps, start = [], outputs.engines.start

    def watched(*arguments):
        engine = start(*arguments)
        step = engine.step

        def kept(rows, labels, turns):
            steps.append((rows.per_input() > 0, turns[0].gains))
            return step(rows, labels, turns)

        engine.step = kept
        return engine

    if isinstance(neuron, Lif):
        pytest.importorskip("torch", reason="torch is not installed")
    monkeypatch.setattr(outputs.engines, "start", watched)
    model = SNN(hidden=(20,), neuron=neuron, arithmetic="float32", loss=LOSS)
    outcome = fit(toy(), model, base(epochs=1, output_epochs=1, dropout=0.5), rngs())
    spiking = np.concatenate([fires for fires, _ in steps])
    assert isinstance(outcome, Outcome) and 0 < spiking.mean() < 0.6
    assert all(gain.shape == (len(fires), 1) and (gain == 2).all() for fires, (gain,) in steps)
    assert not spiking.all(axis=0).any() and not spiking.all(axis=1).any()


def test_a_price_of_hidden_spikes_leaves_fewer():
    data = toy()
    spikes = {}
    for price in (0.0, 0.003):
        model = SNN(hidden=(20,), whitened="output", loss=LOSS, hidden_spike_penalty=price)
        end = fit(data, model, base(epochs=12, output_epochs=3), rngs())
        assert accuracy(end, data) > 0.9
        spikes[price] = hidden_spikes(end)
    assert spikes[0.003] < 0.9 * spikes[0.0]


def test_factor_0_leaves_the_hidden_layers_as_drawn():
    data, model = toy(), SNN(hidden=(20,), recurrent=True, loss=LOSS, whitened="output")
    one, other = (fit(data, model, base(hidden_lr_factor=0.0, epochs=n), rngs()) for n in (4, 7))
    np.testing.assert_array_equal(one.network.layers[0].weight, other.network.layers[0].weight)
    np.testing.assert_array_equal(one.network.layers[0].recurrent, other.network.layers[0].recurrent)
    assert not same_weights(one, other)


def test_whitened_weights_tell_classes_apart_that_a_common_rate_hides():
    """Every channel follows one rate, which differs from sample to sample far more than the classes do."""
    rng = np.random.default_rng(4)
    target = np.arange(240) % 4
    share = np.full((240, 16), 0.12)
    for i in range(240):
        share[i, target[i] * 4 : target[i] * 4 + 4] *= 1.2
    share *= np.exp(rng.normal(0, 0.6, 240))[:, None]
    data = toy(n_channels=16, n_steps=120, n=240)
    spikes = spikes_of(rng.random((240, 120, 16)) < np.minimum(share, 0.9)[:, None], 5.0)
    data = replace(data, spikes=spikes, target=target, classes=("a", "b", "c", "d"))
    training = base(epochs=6, output_epochs=6, batch_size=32, learning_rate=0.05, lr_schedule="cosine")
    ends = []
    for whitened in ("none", "output"):
        model = SNN(hidden=(40,), whitened=whitened, loss=LOSS, arithmetic="float32")
        ends.append(fit(data, model, replace(training, hidden_lr_factor=0.05), rngs()))
    plain, white = (x.history["accuracy_train"][-1] for x in ends)
    assert white > plain + 0.05


def test_the_schedule_begins_anew_after_the_output_epochs():
    steps = base(epochs=10, output_epochs=4, learning_rate=0.1, output_learning_rate=0.4)
    steps = replace(steps, lr_every=2, lr_factor=0.5)
    assert [steps.rate(e) for e in (0, 1.9, 2, 3.9, 4, 5.5, 6, 9)] == [
        0.4,
        0.4,
        0.2,
        0.2,
        0.1,
        0.1,
        0.05,
        0.025,
    ]
    cosine = replace(steps, lr_schedule="cosine")
    expected = [0.4, 0.2, 0.1, 0.05]
    assert [cosine.rate(e) for e in (0, 2, 4, 7)] == pytest.approx(expected, rel=1e-12)
    assert cosine.rate(3.999) < 1e-6 and cosine.rate(9.999) < 1e-7
    assert replace(cosine, warmup_epochs=2).rate(5) == pytest.approx(
        0.05 * (1 + np.cos(np.pi / 6)) / 2, rel=1e-3
    )


def test_several_heads_have_a_readout_each():
    data = joint()
    model = SNN(hidden=(40,), whitened="output", loss=LOSS)
    design = model, Training(epochs=14, output_epochs=8, batch_size=16, dropout=0.0)
    rung, end = (up_to(data, design, until) for until in (8, None))
    for outcome in (rung.outcome, end):
        counts = outcome.validation.output.sum(axis=1, dtype=np.int64)
        right = heads.head_answers(data, counts) == heads.head_targets(data, data.validation)
        assert right.mean(axis=0).min() > 0.8


@pytest.mark.parametrize("read_out", ["dense", "shared"])
def test_columns_keep_shared_weights_equal_through_both_stages(read_out):
    data = toy(n_channels=6)
    model = Columns(features=4, neighbours=2, read_out=read_out, loss=LOSS).placed(data.positions)
    rung, end = (up_to(data, (model, base(epochs=8)), until) for until in (3, None))
    for outcome in (rung.outcome, end):
        for layer in outcome.network.layers:
            for number in () if layer.shared is None else range(layer.shared.max() + 1):
                assert len(np.unique(layer.weight[layer.shared == number])) == 1
    assert not same_weights(rung.outcome, end)


def test_neurons_without_a_kernel_have_both_stages():
    pytest.importorskip("torch")
    data = toy(n_channels=6, n_steps=24, n=30)
    model = SNN(hidden=(8,), neuron=XyloLif(), whitened="output", loss=LOSS)
    design = model, base(epochs=4, output_epochs=2, learning_rate=0.05)
    whole = up_to(data, design, None)
    state = up_to(data, design, 1).state
    for until in (2, 3):
        state = up_to(data, design, until, state).state
    assert_same(up_to(data, design, None, state), whole)
    assert whole.history["accuracy_train"][1] > 0.6


def test_a_silent_hidden_layer_and_a_single_sample_train():
    data = toy()
    silent = replace(data, spikes=spikes_of(np.zeros((60, 40, 12)), 5.0))
    for of in (silent, replace(data, train=data.train[:1])):
        for arithmetic in ("integer", "float32"):
            model = SNN(hidden=(10,), whitened="output", loss=LOSS, arithmetic=arithmetic)
            outcome = fit(of, model, base(epochs=4, output_epochs=2), rngs())
            assert all(np.isfinite(x.weight).all() for x in outcome.network.layers)
            assert np.isfinite(outcome.history["loss"]).all()


def test_weight_norm_trains_norms_and_directions():
    data, model = toy(), SNN(hidden=(20,), weight_norm=True, arithmetic="float32")
    before = up_to(data, (model, base(output_epochs=0)), 1).state
    outcome = fit(data, model, base(output_epochs=0), rngs())
    assert before["engine/0/feed_forward/1/weights"].shape == (32,)
    norms = lengths(outcome.network.layers[0].weight.T)[0]
    assert (np.abs(norms - before["engine/0/feed_forward/1/weights"][:20]) > 1e-3 * norms).mean() > 0.9


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (partial(SNN, whitened="output", pruned=0.3), "pruned must be 0 where weights are learnt in a"),
        (partial(SNN, weight_norm=True, regions=3), "weight_norm must be false where channels share weights"),
        (partial(Columns, whitened="all", read_out="shared"), "whitened must be none where read_out is"),
        (partial(Training, epochs=3, output_epochs=4), r"output_epochs must be at most epochs \(3\), got 4"),
    ],
)
def test_settings_that_contradict_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_contradictions_are_refused_in_a_line_each_before_any_work(tmp_path, capsys):
    changes = (
        ("hidden: {choice: [4, 8, 12]}", "hidden: [8], whitened: all, pruned: 0.5"),
        ("epochs: 1,", "epochs: 4, output_epochs: 5, lr_schedule: slow,"),
    )
    path = write_space(tmp_path, *changes)
    assert main(["check", str(path)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2 and all(line.startswith(str(path)) for line in lines)
    assert "lr_schedule" in lines[1] and "whitened" in lines[0]


def test_dropout_on_counts_that_move_together_is_recorded():
    """One channel drives all hidden neurons, and four classes are to be told by its rate."""
    rng = np.random.default_rng(0)
    data, target = toy(n_channels=1, n=120), np.arange(120) % 4
    spikes = spikes_of(rng.random((120, 40, 1)) < (0.1 + 0.2 * target)[:, None, None], 5.0)
    data = replace(data, spikes=spikes, target=target, classes=("a", "b", "c", "d"))
    for dropout in (0.0, 0.2):
        training = base(epochs=1, output_epochs=0, dropout=dropout)
        health = fit(data, SNN(hidden=(15,)), training, rngs()).health
        assert 1 <= health["effective_rank"] < 2
        assert health["collinear_dropout"] == (dropout > 0)


def test_a_free_exponent_of_the_outputs_fits_the_weights_they_begin_with_and_survives_a_pause():
    data, model = toy(), SNN(hidden=(20,), loss=LOSS, whitened="output", threshold_exponents=(0, -1))
    design = model, base(epochs=5, output_epochs=3)
    whole = up_to(data, design, None)
    rung = up_to(data, design, 4)
    assert_same(up_to(data, design, None, rung.state), whole)
    exponent = np.log2(
        whole.network.layers[1].parameters["threshold"] / whole.network.layers[0].parameters["threshold"]
    )
    assert exponent == int(exponent) == int(rung.state["start/exponent"])
    weights, squares = rung.state["start/outputs"] / 2.0**exponent, np.ones(20)
    assert abs(closest(weights, squares) - exponent) <= 1
    assert accuracy(whole, data) >= 0.9


@pytest.mark.parametrize(("largest", "expected"), [(3.9, 0), (0.49, 3), (0.015, 8)])
def test_the_closest_grid_holds_what_counts(largest, expected):
    rng = np.random.default_rng(0)
    weights = rng.uniform(-largest, largest, (50, 4))
    assert closest(weights, np.ones(50)) == expected
    weights[0] = 3.9  # of a neuron that hardly fires
    assert closest(weights, np.r_[0.0, np.ones(49)]) == expected


@given(seed=st.integers(0, 2**30), n=st.integers(2, 40), n_neurons=st.integers(1, 5))
def test_roundings_of_inputs_that_fire_together_cancel(seed, n, n_neurons):
    rng = np.random.default_rng(seed)
    common = rng.uniform(0, 2, (500, 2))
    seen = common @ rng.uniform(0, 1, (2, n)) + rng.normal(0, 0.02, (500, n))
    weights = rng.normal(0, 0.5, (n, n_neurons)).astype(np.float32)
    weights[0] = 5.0  # beyond 8 bits
    found = compensated(weights, seen.T @ seen / 500)
    np.testing.assert_array_equal(found * 32, np.clip(np.rint(found * 32), -128, 127))
    plain = np.clip(np.rint(weights * 32), -128, 127) / 32

    def missed(stored):
        return float(((seen @ (stored - weights)) ** 2).sum())

    assert missed(found) <= missed(plain) * 2 + 1e-9
    if n >= 20:
        assert missed(found) < 0.3 * missed(plain)
    np.testing.assert_array_equal(compensated(plain.astype(np.float32), np.eye(n)), plain)
    np.testing.assert_array_equal(compensated(plain.astype(np.float32), np.zeros((n, n))), plain)


def test_outputs_are_lifted_where_their_leak_hides_what_they_compare():
    """Of inputs of 100 and 120 spikes, the difference alone stays below the threshold of a leaky neuron."""
    rng = np.random.default_rng(0)
    label = np.arange(60) % 2
    rates = np.where(np.stack([label == 0, label == 1], axis=1), 0.12, 0.1)
    rows = rows_of((rng.random((60, 1000, 2)) < rates[:, None]).astype(np.uint8))
    neurons = cuba_lif.rounded(0.25, 0.03, 1.25)
    even = outputs.even_drive(neurons, 2, rows)
    drive = outputs.short_counts(neurons, 2, rows) @ even
    threshold = neurons.to_threshold / constant_response(neurons, 2, 1000)
    np.testing.assert_allclose(drive.mean(), threshold.mean(), rtol=1e-9)
    weights = np.array([[1.0, -1.0], [-1.0, 1.0]]) * threshold.mean() * 2
    last = Layer(np.zeros((2, 2), np.float32), None, parameters_of(neurons))
    targets = np.eye(2)[label]
    found = outputs.lifted(weights, last, "float32", rows, targets, (2,))
    np.testing.assert_allclose((found - weights)[:, 0], (found - weights)[:, 1], rtol=1e-5)
    assert (found - weights).min() > 0

    def right(matrix):
        ran = prepare(layer_weights(matrix.astype(np.float32), None, neurons), "float32").forward(rows)
        return float((ran.fired.per_input().argmax(axis=1) == label).mean())

    assert right(found) >= right(weights) + 0.1
    silent = rows_of(np.zeros((3, 50, 2), np.uint8))
    np.testing.assert_array_equal(outputs.even_drive(neurons, 2, silent), 0)
