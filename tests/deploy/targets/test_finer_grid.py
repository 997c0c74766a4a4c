"""Trained networks in every target that holds integers: finer grids, lags and learnt axonal delays."""

from importlib.util import find_spec

import numpy as np
import pytest

from dse.deploy.targets import loihi, nir
from dse.deploy.targets.c99 import C99
from dse.deploy.targets.loihi import Loihi
from dse.deploy.targets.nir import Nir
from dse.engine.neurons.fixed_point import quantise
from dse.models.snn.family import SNN
from tests.deploy.c import nets
from tests.models.snn.test_rounding import LEVELS, TRAINING, touched
from tests.models.snn.toy import rngs

FINE = {
    **LEVELS, "hidden": (20,), "rounding": "dithered", "threshold_exponents": (2, 2)
}  # fmt: skip
MODELS = {
    "fine, with lags": {**FINE, "input_delays": (0, 4, 16)},
    "axonal delays": {"hidden": (20, 16), "max_axonal_delay": 12, "initial_rate": 0.2},
}


@pytest.fixture(scope="module", params=MODELS)
def trained(request):
    """Return a trained network and what it does on 20 samples."""
    data = touched(n=40, side=8)
    network = SNN(**MODELS[request.param]).fit(data, TRAINING, rngs()).network
    if "fine" in request.param:
        assert [int(x.parameters["threshold"]) for x in network.layers] == [320, 320]
        assert 0.01 < (quantise(network.layers[0].weight) != 0).mean()
    else:
        late = [x.delay for x in network.layers[1:] if x.delay is not None]
        assert len(late) == 2 and all(len(set(d[0].tolist())) > 1 and (d == d[0]).all() for d in late)
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
def test_spikes_are_the_engines(target, kinds, trained, tmp_path, monkeypatch):
    if target is C99 and not nets.has_compiler():
        pytest.skip("no C compiler is installed")
    if target is not C99 and find_spec("h5py") is None:
        pytest.skip("h5py is not installed")
    monkeypatch.setattr(loihi, "interpreter", lambda *names: None)
    monkeypatch.setattr(nir, "FRAMEWORKS", nir.FRAMEWORKS[:1])
    made, reference = trained
    late_within = any(x.delay is not None for x in made.fitted.layers[1:])
    assert bool(target().refusal(made)) == (target is Nir and late_within)
    if target().refusal(made):
        return
    target().write(made, tmp_path)
    verdict = target().verify(made, tmp_path, reference)
    assert verdict.kind in kinds, verdict.reason
