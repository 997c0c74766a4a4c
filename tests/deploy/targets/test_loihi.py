"""Files for Loihi: run by the recorded integers of Lava's simulator and by brian2-loihi."""

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from dse.deploy import loihi_run
from dse.deploy.run import interpreter
from dse.deploy.targets import loihi
from dse.deploy.targets.loihi import Loihi
from tests.deploy import bundles
from tests.golden import FILE

TRACES = FILE.with_name("lava_nc_traces.npz")
DECAYS = [1, 40, 123, 1024, 2000, 4095]
needs_brian2 = pytest.mark.skipif(
    interpreter("brian2_loihi") is None, reason="brian2-loihi is not installed: `make peers` installs it"
)


@pytest.fixture(autouse=True)
def without_brian2(request, monkeypatch):
    """Start brian2-loihi, which takes seconds, only where a test is about it."""
    if "brian2" not in request.node.name:
        monkeypatch.setattr(loihi, "interpreter", lambda *names: None)


def verified(made, folder, rng):
    return bundles.verified(Loihi(), made, folder, rng)[0]


def layer(weights, q):
    n = len(weights)
    decays = (np.full(n, q["d_u"]), np.full(n, q["d_v"]))
    return loihi_run.Layer(weights.astype(np.int64), np.zeros_like(weights), None, *decays, q["vth"])


@pytest.mark.skipif(not TRACES.exists(), reason="shared/reference/lava_nc_traces.npz is absent")
def test_the_integers_are_those_that_lavas_simulator_was_recorded_with():
    """Every state and spike of both layers of 25 cases; each layer was recorded one step later."""
    golden, traces = np.load(FILE), np.load(TRACES)
    index = json.loads(str(golden["index_json"]))
    names = {key.split("/")[0] for key in traces.files if "/" in key}
    assert len(names) == 25
    for name in sorted(names):
        spikes = golden[f"{name}/x"][0].T[:, None] > 0
        for number in (1, 2):
            one = layer(golden[f"{name}/quant/w{number}_int"], index[name]["int_params"])
            steps = list(loihi_run.states(one, spikes))
            for key, values in zip(("u", "v", "s"), zip(*steps, strict=True), strict=True):
                recorded = traces[f"{name}/{key}{number}"][:, 1 : len(steps) + 1]
                assert np.array_equal(np.array(values)[:, 0].T, recorded), f"{name}, {key}{number}"
            spikes = loihi_run.later(np.array([fired for _, _, fired in steps]))


def test_registers_of_24_bits_wrap_and_clip():
    one = layer(np.array([[254]]), {"d_u": 1, "d_v": 0, "vth": 2**17 - 1})
    states = zip(*loihi_run.states(one, np.ones((700, 1, 1), bool)), strict=True)
    u, v, fired = (np.array(x).ravel() for x in states)
    before = int(u[np.argmin(np.diff(u))])
    assert before * 4095 // 4096 + 64 * 254 - 2**24 == u.min() < 0
    assert v.min() == 1 - 2**23 and fired.any() and not fired.all()


@pytest.mark.parametrize(
    "features",
    [
        {},
        {"sizes": (4, 7, 6, 5, 3), "delays": (0, 3, 7), "steps_per_sample": 2, "pruned": 0.5, "scale": 3.0},
        {"sizes": (5, 9, 3), "recurrent": True, "scale": 0.3},
    ],
    ids=["plain", "deep, delayed, pruned and clipped", "recurrent"],
)
def test_it_spikes_as_the_engine_does(features, tmp_path):
    rng = np.random.default_rng(3)
    verdict = verified(bundles.bundle(bundles.network(rng, decays=DECAYS, **features)), tmp_path, rng)
    assert verdict.kind == "faithful" and verdict.n_recordings == 12


@needs_brian2
def test_brian2_loihi_runs_every_recording_with_delays_of_synapses_too(tmp_path):
    rng = np.random.default_rng(4)
    network = bundles.network(rng, (4, 7, 3), decays=DECAYS, recurrent=True)
    late = [rng.integers(0, 9, x.weight.shape).astype(np.int8) for x in network.layers]
    layers = tuple(replace(x, delay=d) for x, d in zip(network.layers, late, strict=True))
    verdict = verified(bundles.bundle(replace(network, layers=layers)), tmp_path, rng)
    assert verdict.kind == "faithful"
    assert verdict.figures == {"brian2_loihi_recordings": 12}
    assert verdict.run_by == ("run.py", "brian2-loihi 0.5.2")


def test_the_layout_is_that_of_netx(tmp_path):
    import h5py

    network = bundles.network(np.random.default_rng(5), decays=DECAYS, recurrent=True)
    same = network.layers[1].parameters | {"decay_current": np.full(3, 77)}
    layers = (network.layers[0], replace(network.layers[1], parameters=same))
    made = bundles.bundle(replace(network, layers=layers))
    Loihi().write(made, tmp_path)
    with h5py.File(tmp_path / "net.hdf5") as file:
        assert [bytes(file[f"layer/{k}/type"][0]) for k in (0, 1)] == [b"dense_rec", b"dense"]
        group = file["layer/0"]
        assert group["weight"].dtype == np.float32 and group["weight"].shape == (7, 4)
        assert group["weight_rec"].shape == (7, 7) and group["shape"][()].tolist() == [7]
        weights = group["weight"][()]
        assert (weights % 2 == 0).all() and -256 <= weights.min() and weights.max() <= 254
        assert np.array_equal(
            weights, 64 * np.clip(np.rint(network.layers[0].weight * 32) / 32, -4, 254 / 64)
        )
        neuron = file["layer/1/neuron"]
        assert neuron["iDecay"][()] == 77 and neuron["type"][()] == b"CUBA" and neuron["refDelay"][()] == 1
        assert neuron["vThMant"][()] == network.layers[1].parameters["threshold"]
        assert file["layer/0/neuron/iDecay"].shape == (7,)
        assert json.loads(file.attrs["decision"])["phi"] == 2.0


def test_the_script_runs_without_dse(tmp_path):
    """By hand: 2 * 64 reaches above 1 * 64 at once, and 64 arrives late by a delay of 2."""
    made = bundles.network(np.random.default_rng(0), (2, 2, 2))
    neurons = {"decay_current": np.array(4096), "decay_voltage": np.array(4095), "threshold": np.array(1)}
    first = replace(
        made.layers[0],
        weight=np.array([[1, 0], [0, 1]], np.float32) / 32,
        delay=np.array([[0, 0], [0, 2]], np.int8),
        parameters=neurons,
    )
    second = replace(made.layers[1], weight=np.eye(2, dtype=np.float32) / 32, parameters=neurons)
    Loihi().write(bundles.bundle(replace(made, layers=(first, second))), tmp_path)
    np.savez(tmp_path / "spikes.npz", spikes=[[0, 1, 0], [0, 1, 1]], n_recordings=1, n_steps=6)
    files = ["net.hdf5", "spikes.npz", "fired.npz"]
    subprocess.run([sys.executable, "-I", "run.py", *files], cwd=tmp_path, check=True)
    with np.load(tmp_path / "fired.npz") as fired:
        assert fired["fired_0"].tolist() == [[0, 1, 0], [0, 3, 1]]
        assert fired["fired_1"].tolist() == [[0, 2, 0], [0, 4, 1]]
