"""Layers with thresholds on a finer grid, the first dithered, in every target that holds integers."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from dse.deploy.bundle import Bundle
from dse.deploy.reference import Reference
from dse.deploy.targets import Target, loihi
from dse.deploy.targets.c99 import C99
from dse.deploy.targets.loihi import Loihi
from dse.deploy.targets.nir import Nir
from dse.models.snn.family import SNN
from dse.neurons.fixed_point import quantise
from dse.records import Network
from tests.deploy.c import nets
from tests.models.snn.test_rounding import LEVELS, TRAINING, touched
from tests.models.snn.toy import rngs


@pytest.fixture(scope="module")
def trained() -> tuple[Bundle, Reference]:
    """Return a trained network and what it does on 20 samples."""
    data = touched(n=40, side=8)
    model = SNN(**{**LEVELS, "hidden": (20,)}, rounding="dithered", threshold_exponents=(2, 2))
    network = model.fit(data, TRAINING, rngs()).network
    assert isinstance(network, Network)
    thresholds = [int(x.parameters["threshold"]) for x in network.layers]
    assert thresholds == [320, 320]
    levels = quantise(network.layers[0].weight)
    assert 0.02 < (levels != 0).mean()
    fired = np.zeros((20, data.n_steps, 64), np.uint8)
    for k in range(20):
        borders = data.spikes.row_offsets[k * data.n_steps : (k + 1) * data.n_steps + 1]
        step = np.repeat(np.arange(data.n_steps), np.diff(borders))
        fired[k, step, data.spikes.channel[borders[0] : borders[-1]]] = 1
    made = nets.bundle(network, data.n_steps)
    reference = nets.reference(made, fired)
    assert all(len(spikes) > 50 for spikes in reference.fired)
    return made, reference


EXACT, REAL = ("faithful",), ("faithful", "equivalent", "not verified")
"""Verdicts of integers; of simulators that calculate in real numbers, where one is installed."""


@pytest.mark.parametrize(("target", "kinds"), [(C99, EXACT), (Loihi, EXACT), (Nir, REAL)])
def test_spikes_are_the_engines(
    target: type[Target],
    kinds: tuple[str, ...],
    trained: tuple[Bundle, Reference],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if target is C99 and not nets.has_compiler():
        pytest.skip("no C compiler is installed")
    if target is not C99 and find_spec("h5py") is None:
        pytest.skip("h5py is not installed")
    monkeypatch.setattr(loihi, "interpreter", lambda *names: None)
    made, reference = trained
    assert target().refusal(made) == ""
    target().write(made, tmp_path)
    verdict = target().verify(made, tmp_path, reference)
    assert verdict.kind in kinds, verdict.reason
