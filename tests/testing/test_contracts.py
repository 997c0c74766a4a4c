"""Every shipped component keeps its contract; `dse.testing` is the same check for a user's own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest

from dse import registry, store
from dse.dashboard.sources import sources
from dse.encoders.threshold import Threshold
from dse.hardware import profile
from dse.records import Array, Parameters
from dse.testing import (
    check_chip_kind,
    check_encoder,
    check_family,
    check_figure,
    check_neuron,
    check_objective,
    check_sampler,
    check_view,
)
from dse.testing.small import SmallStudy
from tests.joint_data import joint

# Keys that a component needs, and those that keep its check small.
FAMILIES: dict[str, dict[str, Any]] = {
    "snn": {"hidden": (6,)},
    "cascade": {"hidden": (6,), "first_hidden": (5,)},
    "threshold_lif": {},
    "hots": {},
    "elm": {"hidden": 12},
    "mlp": {"hidden": (6,)},
    "knn": {},
    "naive_bayes": {},
}
OF_HEADS = ("cascade",)  # what joint targets alone can train
ENCODERS: dict[str, dict[str, Any]] = {
    "send_on_delta": {"thresholds": (2.0, 4.0)},
    "threshold": {"level": "past"},
    "receptors": {},
}
SAMPLERS: dict[str, dict[str, Any]] = {
    "tpe": {"startup": 4},
    "nsga2": {"population": 4},
    "gp": {"startup": 8},
}
FIGURES: dict[str, dict[str, Any]] = {
    "grid": {"x": "model.hidden", "y": "window.n_steps"},
    "trade": {"parameter": "model.hidden"},
    "energy": {"hardware": "loihi1_silicon"},
    "cores": {"hardware": "loihi1_silicon"},
    "sweep": {"x": "model.hidden"},
}


class WithPower(SmallStudy):
    """The power that no profile of the small study has."""

    def points(self) -> pd.DataFrame:
        return super().points().assign(power_idle_w=0.5, power_w=2.25)


class WithHistograms(SmallStudy):
    """What a HOTS of the small study would have learnt."""

    def arrays(self, trial: int, name: str) -> list[dict[str, Array]]:
        signatures = np.ones((1, 3, 4), np.float32)
        learnt = Parameters({"signatures": signatures, "signature_class": np.arange(3)}, 6)
        return [store.record_arrays(learnt)] if name == "weights.npz" else super().arrays(trial, name)


STUDIES: dict[str, type[SmallStudy]] = {"power": WithPower, "histograms": WithHistograms}


def names(section: str) -> list[str]:
    components = list(registry.known(section))
    assert components, f"found no component of section {section}"
    return components


@pytest.mark.parametrize("name", names("models"))
def test_family(name: str) -> None:
    data = joint(n_steps=20) if name in OF_HEADS else None
    check_family(registry.known("models")[name](**FAMILIES.get(name, {})), data)


@pytest.mark.parametrize("name", names("encoders"))
def test_encoder(name: str) -> None:
    check_encoder(registry.known("encoders")[name](**ENCODERS.get(name, {})))


@pytest.mark.parametrize("matching", ["nearest", "tolerance", "own_label", "none"])
def test_threshold_that_knows_the_whole_window(matching: str) -> None:
    check_encoder(Threshold(matching=matching), causal=False)


@pytest.mark.parametrize("name", names("neurons"))
def test_neuron(name: str) -> None:
    check_neuron(registry.known("neurons")[name]())


@pytest.mark.parametrize("name", names("search.samplers"))
def test_sampler(name: str) -> None:
    check_sampler(registry.known("search.samplers")[name](**SAMPLERS.get(name, {})))


@pytest.mark.parametrize("name", names("objectives"))
def test_objective(name: str) -> None:
    check_objective(registry.known("objectives")[name]())


@pytest.mark.parametrize("name", names("figures"))
def test_figure(name: str) -> None:
    study = STUDIES.get(name, SmallStudy)()
    check_figure(registry.known("figures")[name](**FIGURES.get(name, {})), study)


@pytest.mark.parametrize("name", profile.names())
def test_chip(name: str) -> None:
    check_chip_kind(profile.load(name))


def test_every_kind_of_chip_has_a_profile() -> None:
    assert {type(profile.load(name)) for name in profile.names()} == set(profile.kinds().values())


@pytest.mark.parametrize("path", sorted((sources() / "views").glob("*.js")), ids=lambda path: path.stem)
def test_view(path: Any) -> None:
    check_view(path.stem, path)
