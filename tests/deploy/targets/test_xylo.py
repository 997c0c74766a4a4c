"""Specifications of Xylo, run in the vendor's simulator."""

import importlib.util
import json
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from dse.base.records import Layer, Network
from dse.deploy.form import net_of
from dse.deploy.targets import xylo
from dse.deploy.targets.xylo import Xylo
from dse.engine.neurons import LayerSpec, parameters_of
from dse.engine.neurons.xylo_lif import XyloLif
from tests.deploy import bundles

needs_xylosim = pytest.mark.skipif(
    importlib.util.find_spec("xylosim") is None,
    reason="xylosim is not installed: pip install 'dse-spiking[xylo]'",
)


def network(
    rng,
    sizes=(4, 9, 3),
    *,
    delays=(0,),
    steps_per_sample=1,
    recurrent=False,
    pruned=0.0,
    scale=1.0,
    threshold=1.0,
):
    neuron = XyloLif(threshold=threshold, current_shift=(1, 3), voltage_shift=(0, 4))
    layers = []
    for k, (n_in, n) in enumerate(pairwise((sizes[0] * len(delays), *sizes[1:]))):
        is_output = k == len(sizes) - 2
        population = neuron.population(LayerSpec(n, is_output, steps_per_sample, 1.0), rng)

        def matrix(rows, columns, size):
            kept = rng.random((rows, columns)) >= pruned
            return (rng.normal(size / 4, size, (rows, columns)) * kept).astype(np.float32)

        ring = matrix(n, n, scale / 4) if recurrent and not is_output else None
        layers.append(Layer(matrix(n, n_in, scale), ring, parameters_of(population), "xylo_lif"))
    return Network(tuple(layers), sizes[0], delays, steps_per_sample, "integer")


def verified(made, folder, rng):
    """Return the verdict, and the most spikes of a neuron in a step."""
    verdict, reference = bundles.verified(Xylo(), made, folder, rng)
    return verdict, max(int(np.unique(x, axis=0, return_counts=True)[1].max()) for x in reference.fired)


@needs_xylosim
@pytest.mark.parametrize(
    "features",
    [
        {},
        {"sizes": (3, 8, 7, 6, 3), "delays": (0, 2, 5), "steps_per_sample": 2, "pruned": 0.5, "scale": 0.4},
        {"sizes": (5, 12, 4), "recurrent": True, "threshold": 8.0, "scale": 3.0},
        {"sizes": (5, 6, 5, 4), "recurrent": True, "threshold": 0.125, "scale": 0.05},
    ],
    ids=["plain", "deep, delayed and pruned", "recurrent and clipped", "low threshold"],
)
def test_it_spikes_as_the_engine_does(features, tmp_path):
    rng = np.random.default_rng(7)
    verdict, most = verified(bundles.bundle(network(rng, **features)), tmp_path, rng)
    assert verdict.kind == "faithful" and verdict.n_recordings == 12
    assert [name.split()[0] for name in verdict.run_by] == ["xylosim"]
    assert most > 1, "hidden neurons spike several times in a step"
    assert verdict.figures["most_spikes_per_step"] == most
    assert (verdict.figures["capped_steps"] > 0) == (most == 31)


@needs_xylosim
def test_currents_that_leave_16_bits_between_two_spikes_of_a_step_differ(tmp_path):
    """9 times 127 << 8 and 9 times -128 << 8: the sum is small, and the chip saturates on the way."""
    rng = np.random.default_rng(0)
    made = network(rng, (16, 2, 2), threshold=0.125)
    weight = np.tile(np.where(np.arange(16) < 8, 3.96875, -3.9375), (2, 1)).astype(np.float32)
    layers = (replace(made.layers[0], weight=weight), made.layers[1])
    verdict, _ = verified(bundles.bundle(replace(made, layers=layers)), tmp_path, rng)
    assert verdict.kind == "approximate" and verdict.spikes_differ > 0


def test_the_specification_is_that_of_the_layers_by_hand():
    made = network(np.random.default_rng(1), (2, 2, 1, 2), recurrent=True)
    weights = [np.array(x, np.float32) / 32 for x in ([[1, 2], [3, 4]], [[5, 6]], [[7], [-200]])]
    rings = [np.array([[0, 9], [0, 0]], np.float32) / 32, np.zeros((1, 1), np.float32), None]
    layers = [
        replace(layer, weight=w, recurrent=r) for layer, w, r in zip(made.layers, weights, rings, strict=True)
    ]
    spec = xylo.specification(net_of(replace(made, layers=tuple(layers))))
    assert spec["weights_in"] == [[1, 3, 0], [2, 4, 0]]
    assert spec["weights_rec"] == [[0, 0, 5], [9, 0, 6], [0, 0, 0]]
    assert spec["weights_out"] == [[0, 0], [0, 0], [7, -128]]
    assert spec["threshold"] == [1024] * 3 and spec["threshold_out"] == [1024] * 2
    assert [spec[f"weight_shift_{name}"] for name in ("in", "rec", "out")] == [5, 5, 5]


@needs_xylosim
def test_the_script_runs_without_dse(tmp_path):
    """One input, one neuron, one output, by hand: 124 decays to 62, 31, 16; thresholds of 40."""
    spec = {
        **{"weights_in": [[124]], "weights_rec": [[0]], "weights_out": [[100]]},
        **{"dash_syn": [1], "dash_mem": [0], "threshold": [40]},
        **{"dash_syn_out": [1], "dash_mem_out": [0], "threshold_out": [40]},
        **{"weight_shift_in": 0, "weight_shift_rec": 0, "weight_shift_out": 0},
    }
    document = {"specification": spec, "hidden_layers": [1]}
    (tmp_path / "xylo.json").write_text(json.dumps(document))
    np.savez(tmp_path / "spikes.npz", spikes=[[1, 2, 0], [1, 2, 0]], n_recordings=2, n_steps=5)
    script = Path(xylo.__file__).parents[1] / "xylo_run.py"
    files = ["xylo.json", "spikes.npz", "fired.npz"]
    subprocess.run([sys.executable, "-I", str(script), *files], cwd=tmp_path, check=True)
    with np.load(tmp_path / "fired.npz") as fired:
        # Two spikes at once: 248 -> 124 spikes 3 times and leaves 4, which decays at once; 62 once; 31 never.
        assert fired["fired_0"].tolist() == [[1, 2, 0]] * 3 + [[1, 3, 0]]
        # 300 -> 150; 150 + 100 -> 125: an output spikes once in a step.
        assert fired["fired_1"].tolist() == [[1, 3, 0], [1, 4, 0]]
