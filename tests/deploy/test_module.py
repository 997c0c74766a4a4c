"""Networks as torch modules: the engine's spikes, gradients, and back."""

from dataclasses import replace

import numpy as np
import pytest

from dse.deploy.bundle import BundleError
from dse.models.snn.quantise import exponents, rounded
from dse.models.snn.respond import spikes_of_layers
from dse.neurons import LayerSpec, name_of_population, parameters_of
from dse.records import Head, Layer, Network, Parameters
from dse.registry import known
from tests.deploy import bundles

torch = pytest.importorskip("torch")
listed = pytest.importorskip("dse.deploy.module").listed

KINDS = {
    "one hidden layer": {},
    "three hidden layers, pruned, weights beyond 8 bits": {
        "sizes": (5, 8, 6, 5, 3),
        "pruned": 0.6,
        "scale": 6.0,
    },
    "recurrent, input delays, two steps per sample": {
        "recurrent": True,
        "delays": (0, 3, 50),
        "steps_per_sample": 2,
    },
    "resonators": {"resonates": True, "recurrent": True},
    "real states": {"arithmetic": "ideal", "decays": [30, 1000]},
    "saturated": {"decays": [0], "scale": 30.0},
}


def delayed(network, rng):
    layers = [replace(x, delay=rng.integers(0, 63, x.weight.shape).astype(np.int8)) for x in network.layers]
    return replace(network, layers=tuple(layers))


def assert_same_spikes(made, network, folder, n_steps=40):
    """Assert that a bundle's module fires as the engine runs a network."""
    spikes = bundles.spikes(np.random.default_rng(0), made.fitted.n_channels, n_steps=n_steps)
    data = bundles.reference(made, spikes, folder).dataset
    with torch.no_grad():
        fired = made.as_module().fired(torch.from_numpy(spikes))
    of_engine = spikes_of_layers(network, data, data.test)
    assert len(of_engine[0])
    for layer, expected in zip(fired, of_engine, strict=True):
        assert np.array_equal(listed(layer), expected)


@pytest.mark.parametrize("kind", [*KINDS, "delays of synapses", "two bits"])
def test_every_layer_fires_as_in_the_engine(kind, tmp_path):
    rng = np.random.default_rng(7)
    network, evidence = bundles.network(rng, **KINDS.get(kind, {})), {}
    if kind == "delays of synapses":
        network = delayed(network, rng)
    if kind == "two bits":
        network = rounded(network, 2, 0.3)
        evidence = {"precision": {"weight_bits": 2, "exponents": exponents(network, 2)}}
    assert_same_spikes(bundles.bundle(network, evidence=evidence), network, tmp_path, 70)


def test_the_output_is_what_the_decision_rule_receives():
    made = bundles.bundle(bundles.network(np.random.default_rng(1)))
    spikes = torch.from_numpy(bundles.spikes(np.random.default_rng(0), 4))
    module = made.as_module()
    output, fired = module(spikes), module.fired(spikes)[-1]
    assert output.shape == (12, 40, 3) and not output[:, 0].any() and fired.any()
    assert torch.equal(output[:, 1:], fired[:, :-1])


def test_a_step_of_training_moves_the_weights_that_are_there_and_no_others(tmp_path):
    rng = np.random.default_rng(2)
    for arithmetic in (None, "float32"):
        made = bundles.bundle(bundles.network(rng, (4, 20, 3), recurrent=True, pruned=0.3))
        before = made.fitted
        module = made.as_module(arithmetic)
        spikes = torch.from_numpy(bundles.spikes(rng, 4, n_steps=20))
        label = torch.arange(12) % 3
        optimiser = torch.optim.Adam(module.parameters(), lr=0.05)
        losses = []
        for _ in range(3):
            optimiser.zero_grad()
            loss = module.loss(module(spikes), label)
            loss.backward()
            optimiser.step()
            losses.append(float(loss.detach()))
        assert losses[-1] < losses[0]
        after = module.network()
        assert after.arithmetic == "integer"
        for old, new in zip(before.layers, after.layers, strict=True):
            assert np.array_equal(old.weight == 0, new.weight == 0)
            moved = old.weight != new.weight
            assert moved.any() and not (moved & (old.weight == 0)).any()
        assert not np.array_equal(before.layers[0].recurrent, after.layers[0].recurrent)
        assert_same_spikes(replace(made, fitted=after), after, tmp_path)


def test_shared_weights_stay_equal_and_few_bits_on_their_grid():
    rng = np.random.default_rng(3)
    network = bundles.network(rng)
    number = rng.integers(-1, 5, (7, 4)).astype(np.int32)
    values = np.append(rng.normal(size=5), 0).astype(np.float32)
    shared = replace(network.layers[0], weight=values[number], shared=number)
    made = bundles.bundle(replace(network, layers=(shared, *network.layers[1:])))
    module = made.as_module()
    assert module.state_dict()["layers.0.weight"].shape == (5,)
    with torch.no_grad():
        for weights in module.parameters():
            weights += 0.25
    (first, _) = module.network().layers
    assert np.array_equal(first.weight, np.where(number < 0, 0, values[number] + np.float32(0.25)))
    few = rounded(network, 3, 0.0)
    precision = {"weight_bits": 3, "exponents": [4, 5]}
    module = bundles.bundle(few, evidence={"precision": precision}).as_module()
    with torch.no_grad():
        for weights in module.parameters():
            weights += 0.4
    for layer, exponent in zip(module.network().layers, (4, 5), strict=True):
        whole = layer.weight[np.abs(layer.weight) > 1 / 64] * 32 / 2**exponent
        assert (whole == np.rint(whole)).all() and -4 <= whole.min() and whole.max() <= 3


def test_the_heads_of_a_joint_target_share_the_loss():
    heads = (
        Head("fabric", ("felt", "silk"), np.array([0, 0, 1])),
        Head("speed", ("slow", "fast"), np.array([0, 1, 1])),
    )
    network = bundles.network(np.random.default_rng(4), (4, 6, 4))
    module = bundles.bundle(network, heads=heads, classes=("a", "b", "c")).as_module()
    output = torch.zeros(1, 10, 4, dtype=torch.float64)
    output[0, :8, 0] = output[0, :8, 3] = 1  # felt and fast: joint class 1, at the true rate of 0.8
    losses = [float(module.loss(output, torch.tensor([label]))) for label in range(3)]
    assert min(losses) == losses[1] == pytest.approx(2 * 0.02**2)


def test_every_shipped_neuron_runs(tmp_path):
    rng = np.random.default_rng(5)
    for kind in known("neurons").values():
        spec = LayerSpec(n_neurons=5, is_output=False, steps_per_sample=1, step_ms=5.0)
        population = kind().population(spec, rng)
        name = name_of_population(population, kind())
        weight = rng.normal(0, 2, (5, 4)).astype(np.float32)
        layer = Layer(weight, None, parameters_of(population), name)
        arithmetic = kind.arithmetics[0]
        network = Network((layer,), 4, (0,), 1, arithmetic)
        if arithmetic == "integer":
            assert_same_spikes(bundles.bundle(network), network, tmp_path)
        else:
            assert bundles.bundle(network).as_module()(torch.ones(2, 9, 4)).shape == (2, 9, 5)


def test_what_is_no_spike_or_no_network_is_refused():
    made = bundles.bundle(bundles.network(np.random.default_rng(6)))
    module = made.as_module()
    with pytest.raises(ValueError, match=r"spikes must be \(sample, input step, 4\), got \(2, 9, 5\)"):
        module(torch.zeros(2, 9, 5))
    with pytest.raises(ValueError, match="spikes must be 0 or 1"):
        module(torch.full((2, 9, 4), 0.5))
    with pytest.raises(BundleError, match="only networks of neurons are torch modules"):
        replace(made, fitted=Parameters({}, 4)).as_module()
