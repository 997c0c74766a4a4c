"""Networks as torch modules: the engine's spikes."""

from dataclasses import replace

import numpy as np
import pytest

from dse.base.records import Layer, Network, Parameters
from dse.base.registry import known
from dse.deploy.bundle import BundleError
from dse.engine.neurons import LayerSpec, name_of_population, parameters_of
from dse.models.snn.quantise import rounded
from dse.models.snn.respond import spikes_of_layers
from tests.deploy import bundles

pytestmark = pytest.mark.usefixtures("torch")

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
    import torch

    from dse.deploy.module import listed

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
    network = bundles.network(rng, **KINDS.get(kind, {}))
    if kind == "delays of synapses":
        network = delayed(network, rng)
    if kind == "two bits":
        network = rounded(network, 2, 0.3)
    assert_same_spikes(bundles.bundle(network), network, tmp_path, 70)


def test_the_output_is_what_the_decision_rule_receives(torch):
    made = bundles.bundle(bundles.network(np.random.default_rng(1)))
    spikes = torch.from_numpy(bundles.spikes(np.random.default_rng(0), 4))
    module = made.as_module()
    output, fired = module(spikes), module.fired(spikes)[-1]
    assert output.shape == (12, 40, 3) and not output[:, 0].any() and fired.any()
    assert torch.equal(output[:, 1:], fired[:, :-1])


def test_every_shipped_neuron_runs(torch, tmp_path):
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


def test_what_is_no_spike_or_no_network_is_refused(torch):
    made = bundles.bundle(bundles.network(np.random.default_rng(6)))
    module = made.as_module()
    with pytest.raises(ValueError, match=r"spikes must be \(sample, input step, 4\), got \(2, 9, 5\)"):
        module(torch.zeros(2, 9, 5))
    with pytest.raises(ValueError, match="spikes must be 0 or 1"):
        module(torch.full((2, 9, 4), 0.5))
    with pytest.raises(BundleError, match="only networks of neurons are torch modules"):
        replace(made, fitted=Parameters({}, 4)).as_module()
