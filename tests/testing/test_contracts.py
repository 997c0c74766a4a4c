"""Every shipped component keeps its contract; `dse.testing` is the same check for a user's own."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from dse import store
from dse.base import registry
from dse.base.records import Array, Parameters
from dse.config.locate import shipped_folder
from dse.data.encoders.threshold import Threshold
from dse.deploy.verilog import tools
from dse.measure.hardware import profile
from dse.testing import (
    check_chip_kind,
    check_encoder,
    check_family,
    check_figure,
    check_loss,
    check_neuron,
    check_objective,
    check_sampler,
    check_source,
    check_target,
    check_view,
)
from dse.testing.small import SmallStudy
from tests.installed import needs_papers
from tests.joint_data import joint

# Keys that a component needs, and those that keep its check small.
FAMILIES = {
    "snn": {"hidden": (6,)},
    "cascade": {"hidden": (6,), "first_hidden": (5,)},
    "threshold_lif": {},
    "hots": {},
    "elm": {"hidden": 12},
    "mlp": {"hidden": (6,)},
    "linear": {},
    "kernels": {"kernels": 12},
    "tcn": {"hidden": (8, 8), "epochs": 2},
    "knn": {},
    "naive_bayes": {},
}
OF_HEADS = ("cascade",)  # what joint targets alone can train
ENCODERS = {"send_on_delta": {"thresholds": (2.0, 4.0)}, "threshold": {"level": "past"}, "receptors": {}}
LOSSES = {"count_cross_entropy": {"count_scale": 2.0, "read_outs": 4}}
SAMPLERS = {"tpe": {"startup": 4}, "nsga2": {"population": 4}, "gp": {"startup": 8}}
FIGURES = {
    "grid": {"x": "model.hidden", "y": "window.n_steps"},
    "energy": {"hardware": "loihi1_silicon"},
    "cores": {"hardware": "loihi1_silicon"},
    "sweep": {"x": "model.hidden"},
    "inputs": {"samples": (0, 1)},
}


class WithHistograms(SmallStudy):
    """What a HOTS of the small study would have learnt."""

    def arrays(self, trial: int, name: str) -> list[dict[str, Array]]:
        signatures = np.ones((1, 3, 4), np.float32)
        learnt = Parameters({"signatures": signatures, "signature_class": np.arange(3)}, 6)
        return [store.record_arrays(learnt)] if name == "weights.npz" else super().arrays(trial, name)


class OfManyDesigns(SmallStudy):
    """Four times the designs, of other sizes."""

    def points(self):
        points = super().points()
        more = [
            points.assign(**{"trial": points["trial"] + 3 * k, "model.hidden": points["model.hidden"] + k})
            for k in range(4)
        ]
        return pd.concat(more, ignore_index=True)


STUDIES = {"histograms": WithHistograms, "importance": OfManyDesigns}
ARRAYS = {
    "signal": np.arange(24.0).reshape(2, 4, 3),
    "spikes": np.eye(6, dtype=np.uint8).reshape(2, 3, 6),
    "t_us": np.array([5, 5, 9, 2, 7]),
    "taxel": np.array([0, 3, 1, 2, 2]),
    "offsets": np.array([0, 3, 5]),
    "label": np.array([1, 0]),
}
SCENE = """\
scene: tiny
sensor:
  {layout: grid, n_across: 2, pin_pitch_mm: 2.5, image_scale_px_mm: 8, frame_px: [64, 48], pin_radius_mm: 0.5}
textures: [denim, foam]
motions: [{kind: constant, speed_mm_s: 20}]
forces_n: [1]
trials: 1
duration_ms: 120
"""
SOURCES = {
    "event_files": {"folder": "cloths", "label_from": "folder", "columns": {"fabric": "folder"}},
    "events": {"file": "x.npz", "width": 4, "taxel": "taxel", "columns": {"fabric": "label"}},
    "long_table": {"file": "long.csv", "step_ms": 5.0, "channels": ("left",), "recording": "recording"},
    "raster": {"file": "x.npz", "step_ms": 5.0, "columns": {"fabric": "label"}},
    "scene": {"scene": "tiny.yaml"},
    "table": {"file": "x.csv", "step_ms": 5.0, "channels": ("left",)},
    "time_series": {"file": "x.npz", "step_ms": 5.0, "columns": {"fabric": "label"}},
    "wide_table": {"file": "wide.csv", "step_ms": 5.0, "samples": ("left_",), "columns": {"fabric": "label"}},
}


def names(section):
    components = list(registry.known(section))
    assert components, f"found no component of section {section}"
    return components


def checked_family(family):
    if registry.name_of("models", family) == "tcn":
        pytest.importorskip("torch")
    check_family(family, joint(n_steps=20) if registry.name_of("models", family) in OF_HEADS else None)


CHECKS = {
    "models": (checked_family, FAMILIES),
    "targets": (check_target, {}),
    "encoders": (check_encoder, ENCODERS),
    "neurons": (check_neuron, {}),
    "losses": (check_loss, LOSSES),
    "search.samplers": (check_sampler, SAMPLERS),
    "objectives": (check_objective, {}),
}


@pytest.mark.parametrize(("section", "name"), [(x, name) for x in CHECKS for name in names(x)])
def test_component(section, name, monkeypatch):
    monkeypatch.setattr(tools, "placed", lambda board, folder: {})  # `test_fpga` does so
    check, keys = CHECKS[section]
    check(registry.known(section)[name](**keys.get(name, {})))


@pytest.mark.parametrize("name", names("recordings"))
def test_source(name, tmp_path):
    np.savez(tmp_path / "x.npz", **ARRAYS)
    (tmp_path / "x.csv").write_text("recording,left\n0,1.5\n0,2.5\n1,3.5\n")
    (tmp_path / "wide.csv").write_text("label,left_0,left_1\nsilk,1.5,2.5\nwool,3.5,\n")
    (tmp_path / "long.csv").write_text(
        "recording,time,channel,value\n0,0,left,1.5\n0,5,left,2.5\n1,0,left,3.5\n"
    )
    (tmp_path / "tiny.yaml").write_text(SCENE)
    for fabric in ("silk", "wool"):
        (tmp_path / "cloths" / fabric).mkdir(parents=True)
        (tmp_path / "cloths" / fabric / "a.tact").write_text("0 5 1.500000\n0 6 1.750000\n")
    check_source(registry.known("recordings")[name](**SOURCES[name]), tmp_path)


@pytest.mark.parametrize("matching", ["nearest", "tolerance", "own_label", "none"])
def test_threshold_that_knows_the_whole_window(matching):
    check_encoder(Threshold(matching=matching), causal=False)


@pytest.mark.parametrize("name", names("figures"))
def test_figure(name):
    check_figure(registry.known("figures")[name](**FIGURES.get(name, {})), STUDIES.get(name, SmallStudy)())


@pytest.mark.parametrize("name", profile.names())
def test_chip(name):
    check_chip_kind(profile.load(name))


def test_every_kind_of_chip_has_a_profile():
    assert {type(profile.load(name)) for name in profile.names()} == set(profile.kinds().values())


@pytest.mark.parametrize("at", sorted(shipped_folder("dashboards").glob("views/*.js")), ids=lambda x: x.stem)
def test_view(at):
    check_view(at.stem, at)


@needs_papers
def test_the_small_study_has_its_data_wherever_the_cache_is(tmp_path, monkeypatch):
    for name in ("first", "second"):
        monkeypatch.setenv("DSE_CACHE", str(tmp_path / name))
        check_figure(registry.known("figures")["psth"](), SmallStudy())
