"""Modules in files: the same bytes, the same spikes, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dse.deploy.bundle import BundleError
from dse.deploy.targets import TargetError
from dse.deploy.targets import torch as target
from dse.deploy.targets.torch import Torch
from dse.deploy.verdict import Verdict
from dse.records import Network, Parameters
from tests.deploy import bundles


def test_a_module_in_a_file_is_faithful(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    torch = pytest.importorskip("torch")
    monkeypatch.setattr(target, "_MOST_RECORDINGS", 5)  # several batches
    rng = np.random.default_rng(1)
    network = bundles.network(rng, (4, 8, 6, 3), resonates=True, recurrent=True, delays=(0, 5))
    made = bundles.bundle(network)
    reference = bundles.reference(made, bundles.spikes(rng, 4), tmp_path)
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        Torch().write(made, tmp_path / name)
    assert (tmp_path / "a" / "module.pt").read_bytes() == (tmp_path / "b" / "module.pt").read_bytes()
    assert Torch().verify(made, tmp_path / "a", reference) == Verdict(
        "faithful", n_recordings=12, output_f1=1.0, run_by=(f"torch {torch.__version__}",)
    )
    content = torch.load(tmp_path / "a" / "module.pt", weights_only=True)
    assert content["network"]["0/neuron"] == "resonator"
    other = bundles.bundle(bundles.network(rng, (4, 8, 6, 3)))
    Torch().write(other, tmp_path / "b")
    verdict = Torch().verify(made, tmp_path / "b", reference)
    assert verdict.kind == "approximate" and verdict.spikes_differ > 0.5


def test_damage_and_what_no_module_holds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("torch")
    rng = np.random.default_rng(2)
    made = bundles.bundle(bundles.network(rng))
    reference = bundles.reference(made, bundles.spikes(rng, 4), tmp_path)
    Torch().write(made, tmp_path)
    content = (tmp_path / "module.pt").read_bytes()
    for damaged in (content[: len(content) // 2], b"", b"text"):
        (tmp_path / "module.pt").write_bytes(damaged)
        with pytest.raises(BundleError, match=r"module\.pt: must be a module of dse/module/1"):
            Torch().verify(made, tmp_path, reference)
    assert isinstance(made.fitted, Network) and Torch().refusal(made) == ""
    knn = replace(made, fitted=Parameters({}, 4))
    assert Torch().refusal(knn) == "torch modules hold networks of neurons, and family snn is none"


def test_without_torch_it_says_how_to_install_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dse.deploy.run.find_spec", lambda name: None)
    made = bundles.bundle(bundles.network(np.random.default_rng(3)))
    with pytest.raises(TargetError, match=r"torch is not installed: pip install 'dse\[torch\]'"):
        Torch().write(made, tmp_path)
    assert not list(tmp_path.iterdir())
