"""NIR graphs, run in Norse and in snnTorch."""

import json
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from dse.deploy.run import interpreter
from dse.deploy.targets import nir
from dse.deploy.targets.nir import FRAMEWORKS, Nir
from tests.deploy import bundles


@pytest.fixture(params=FRAMEWORKS)
def framework(request, monkeypatch):
    """One framework, the other being absent."""
    name = str(request.param)
    if interpreter(name, "nir") is None:
        pytest.skip(f"{name} is not installed: `make peers` installs it")
    monkeypatch.setattr(nir, "FRAMEWORKS", (name,))
    return name


def verdict(folder, made, rng, n_steps=40):
    return bundles.verified(Nir(), made, folder, rng, n_steps)[0]


def test_without_rounding_every_spike_is_equal(framework, tmp_path):
    rng = np.random.default_rng(1)
    every_feature = {
        "sizes": (4, 7, 6, 5, 3),
        "recurrent": True,
        "delays": (0, 3, 7),
        "steps_per_sample": 2,
        "pruned": 0.5,
        "scale": 3.0,  # weights beyond 8 bits
    }
    network = bundles.network(rng, decays=[0, 4096], **every_feature)
    made = bundles.bundle(network)
    if framework == "snntorch":  # delays of the first layer are copies of the inputs
        first = network.layers[0]
        late = rng.integers(0, 6, first.weight.shape).astype(np.int8)
        made = bundles.bundle(replace(network, layers=(replace(first, delay=late), *network.layers[1:])))
        assert Nir().refusal(made) == ""
        spikes = bundles.spikes(rng, 4)
        late, early = (bundles.reference(x, spikes, tmp_path) for x in (made, bundles.bundle(network)))
        assert not np.array_equal(late.fired[0], early.fired[0])
    found = verdict(tmp_path, made, rng)
    assert found.kind == "faithful" and found.output_f1 == 1
    assert [name.split()[0] for name in found.run_by] == [framework]


@pytest.mark.parametrize(
    ("framework", "seed", "kind"),
    [("norse", 2, "equivalent"), ("snntorch", 4, "approximate")],
    indirect=["framework"],
)
def test_rounded_states_are_nearly_equal(framework, seed, kind, tmp_path):
    rng = np.random.default_rng(seed)
    network = bundles.network(rng, (6, 40, 4), decays=[3, 10, 30, 100], scale=0.1)
    found = verdict(tmp_path, bundles.bundle(network), rng, 150)
    assert (found.kind, found.decisions_differ > 0) == (kind, kind == "approximate")
    assert 0.5 < found.spikes_differ < 1 and found.output_f1 is not None and 0.98 < found.output_f1 < 1
    assert (
        found.largest_difference <= 2
        and found.run_by[0].startswith(framework)
        and f"{found.output_f1:.3f}" in found.reason
    )


def test_real_states_are_equal(tmp_path, monkeypatch):
    if interpreter("norse", "nir") is None:
        pytest.skip("norse is not installed: `make peers` installs it")
    monkeypatch.setattr(nir, "FRAMEWORKS", ("norse",))
    rng = np.random.default_rng(2)
    network = bundles.network(rng, (6, 20, 4), decays=[30, 100, 1000], scale=0.3, arithmetic="float32")
    assert verdict(tmp_path, bundles.bundle(network), rng, 100).spikes_differ == 0


def test_the_file_and_its_golden_spikes_are_read_by_both_versions_of_nir(tmp_path):
    made = bundles.bundle(bundles.network(np.random.default_rng(3), delays=(0, 2), recurrent=True))
    Nir().write(made, tmp_path)
    code = """
import json, sys, nir
graph = nir.read("graph.nir")
shapes = {name: list(next(iter(node.output_type.values()))) for name, node in graph.nodes.items()}
told = {k: x.tolist() if hasattr(x, "tolist") else x for k, x in graph.metadata.items()}
golden = None
if hasattr(nir, "read_data"):
    data = nir.read_data("golden.h5")
    data.check_nodes(graph)
    golden = {name: list(node.observables["spikes"].data.shape) for name, node in data.nodes.items()}
print(json.dumps([nir.__version__, shapes, sorted(graph.edges), told, golden], default=int))
"""
    versions = []
    for name in FRAMEWORKS:
        python = interpreter(name, "nir")
        if python is None:
            pytest.skip(f"{name} is not installed: `make peers` installs it")
        done = subprocess.run(
            [python, "-I", "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        version, shapes, edges, told, golden = json.loads(done.stdout)
        versions.append(version)
        assert shapes == {
            "input": [8],
            "weights_0": [7],
            "layer_0": [7],
            "recurrent_0": [7],
            "weights_1": [3],
            "layer_1": [3],
            "output": [3],
        }
        assert ["layer_0", "recurrent_0"] in edges and ["recurrent_0", "layer_0"] in edges
        assert told["dt"] == 1e-4 and told["delays"] == [0, 2] and told["reset"].startswith("to 0")
        assert json.loads(told["decision"])["theta"] == 0.5
        if golden is not None:
            assert golden == {"input": [4, 64, 8], "layer_0": [4, 64, 7], "layer_1": [4, 64, 3]}
    assert versions == ["1.0.4", "1.0.8"]


def test_time_constants_by_hand():
    assert nir.time_constant(np.array([4096, 2048, 1])).tolist() == [1e-4, 2e-4, 0.4096]
    keep = 1 - nir.DT / nir.time_constant(np.arange(1, 4097))
    assert np.allclose(keep, (4096 - np.arange(1, 4097)) / 4096, rtol=0, atol=2**-52)
    assert np.float32(1 - nir.DT / nir.time_constant(np.array([0])))[0] == 1
