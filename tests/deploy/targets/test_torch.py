"""Modules in files: the same bytes, the same spikes, and what is refused."""

import numpy as np
import pytest

from dse.deploy.targets import torch as target
from dse.deploy.targets.torch import Torch
from dse.deploy.verdict import Verdict
from tests.deploy import bundles


def test_a_module_in_a_file_is_faithful(tmp_path, monkeypatch):
    torch = pytest.importorskip("torch")
    monkeypatch.setattr(target, "_MOST_RECORDINGS", 5)  # several batches
    rng = np.random.default_rng(1)
    network = bundles.network(rng, (4, 8, 6, 3), resonates=True, recurrent=True, delays=(0, 5))
    made = bundles.bundle(network)
    reference = bundles.reference(made, bundles.spikes(rng, 4), tmp_path)
    Torch().write(made, tmp_path)
    assert Torch().verify(made, tmp_path, reference) == Verdict(
        "faithful", n_recordings=12, output_f1=1.0, run_by=(f"torch {torch.__version__}",)
    )
    content = torch.load(tmp_path / "module.pt", weights_only=True)
    assert content["network"]["0/neuron"] == "resonator"
