"""Objectives and a figure of an installed module are used from the command line."""

import json
import os
import sys
from pathlib import Path

import pytest

from dse.base import registry
from dse.cli import main
from dse.cli.commands.drawing import size_px
from dse.show.figures import image
from dse.testing import check_figure, check_objective
from tests.command import document
from tests.spaces import write_space

PLUGIN = '''
"""Components of a user's own."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go

from dse.show.figures import Results
from dse.measure.objectives import FullReadOut, Points
from dse.base.registry import Column, param, register


@register("objectives", "recall_worst")
@dataclass(frozen=True)
class RecallWorst:
    """Recall of the class that is recognised worst."""

    needs = "full_read_out"
    columns = (Column("recall_worst", "", "max", "Recall of the class that is recognised worst."),)

    def measure(self, answer: FullReadOut) -> Mapping[str, float]:
        right, n = np.diag(answer.confusion), answer.confusion.sum(axis=1)
        return {"recall_worst": float((right[n > 0] / n[n > 0]).min())}


@register("objectives", "additions_per_right")
@dataclass(frozen=True)
class AdditionsPerRight:
    """Additions for one right answer."""

    needs = "points"
    columns = (Column("additions_per_right", "", "min", "Additions per right answer, NaN without one."),)

    def measure(self, points: Points) -> Mapping[str, np.ndarray]:
        right = np.where(points.accuracy > 0, points.accuracy, np.nan)
        return {"additions_per_right": points.load.synaptic_operations / right}


@dataclass(frozen=True)
class Bars:
    trials: np.ndarray
    values: np.ndarray


@register("figures", "bars")
@dataclass(frozen=True)
class BarsFigure:
    """A column of every trial as a bar."""

    column: str = param("recall_worst", doc="column of the trials", axis=False)

    def gather(self, results: Results) -> Bars:
        trials = results.trials
        return Bars(trials["trial"].to_numpy(), trials[self.column].to_numpy(float))

    def draw(self, record: Bars) -> go.Figure:
        return go.Figure(go.Bar(x=record.trials, y=record.values))
'''


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Yield the results of a study; a distribution names the plugin as its entry point."""
    folder = tmp_path_factory.mktemp("plugin")
    (folder / "components_of_a_test.py").write_text(PLUGIN)
    distribution = folder / "components_of_a_test-1.0.dist-info"
    distribution.mkdir()
    (distribution / "METADATA").write_text("Metadata-Version: 2.1\nName: components\nVersion: 1.0\n")
    (distribution / "entry_points.txt").write_text("[dse.components]\nmine = components_of_a_test\n")
    objectives = ("accuracy:max, n_weights:min", "recall_worst:max, additions_per_right, n_weights:min")
    space = write_space(folder, objectives, ("choice: [4, 8, 12]", "choice: [4, 8]"))
    for section in registry.SECTIONS:
        registry.known(section)  # imported before the copy below, which is thrown away
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        patch.setenv("PYTHONPATH", os.pathsep.join([str(folder), str(Path(__file__).parents[2])]))
        patch.setenv("DSE_CACHE", str(folder / "cache"))
        patch.setattr(registry, "_imported", registry._imported - {f"{registry.ENTRY_POINTS} "})
        patch.setattr(registry, "_entry_points", registry._entry_points.__wrapped__)
        patch.setattr(registry, "_plugins", {})
        patch.setattr(registry, "_components", {s: dict(c) for s, c in registry._components.items()})
        assert main(["run", str(space), "--results", str(folder / "results")]) == 0
        [points] = (folder / "results").rglob("points.parquet")
        yield points.parent
    sys.modules.pop("components_of_a_test", None)


def rows(capsys, *arguments):
    return document(capsys, *arguments)["rows"]


def test_an_objective_is_a_column_and_selects(installed, capsys):
    front = rows(capsys, "skyline", str(installed))
    assert front
    assert all(0 <= row["recall_worst"] <= 1 for row in front)
    assert {row["phi"] for row in front} == {None}, "only full read-outs have a recall"
    objectives = "accuracy:max,additions_per_right:min"
    costs = rows(capsys, "skyline", str(installed), "--objectives", objectives)
    assert any(row["phi"] is not None for row in costs), "every point has its own additions"


def test_objectives_and_figures_are_described(installed, capsys):
    described = {row["name"]: row for row in rows(capsys, "describe", "objectives")}
    assert described["recall_worst"]["direction"] == "max"
    assert "bars" in {row["name"] for row in rows(capsys, "describe", "figures")}


def test_a_figure_is_drawn(installed, tmp_path):
    out = tmp_path / "bars.json"
    assert main(["figure", str(installed), "bars", "--out", str(out)]) == 0
    [bars] = json.loads(out.read_text())["data"]
    assert bars["type"] == "bar"
    out = tmp_path / "bars.html"
    assert main(["figure", str(installed), "bars", "--out", str(out), "--set", "column=accuracy"]) == 0
    assert "plotly" in out.read_text()


def test_a_figure_for_print(installed, tmp_path, chromium_path, monkeypatch):
    pytest.importorskip("kaleido", reason="no kaleido: pip install 'dse-spiking[figures]'")
    monkeypatch.setenv("DSE_CHROMIUM", str(chromium_path))
    out = tmp_path / "bars.pdf"
    assert main(["figure", str(installed), "bars", "--out", str(out), "--size", "400x300"]) == 0
    assert size_px("85x60mm") == (321, 227), "1/96 inch each"
    assert out.read_bytes().startswith(b"%PDF-")


def test_a_figure_for_print_without_kaleido(installed, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(image, "find_spec", lambda name: None)
    assert main(["figure", str(installed), "bars", "--out", str(tmp_path / "bars.svg")]) == 2
    assert capsys.readouterr().err == (
        "dse figure: a figure as PDF, SVG or PNG needs kaleido: pip install 'dse-spiking[figures]'\n"
    )
    assert not list(tmp_path.iterdir())


def test_its_components_keep_their_contracts(installed):
    check_objective(registry.known("objectives")["recall_worst"]())
    check_objective(registry.known("objectives")["additions_per_right"]())
    check_figure(registry.known("figures")["bars"](column="accuracy"))


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("bras", "--out", "x.json"), "unknown figure 'bras'; known: bars"),
        (("bars", "--out", "x.gif"), "--out must end in .pdf, .svg, .png, .html or .json, got 'x.gif'"),
        (("bars", "--out", "x.pdf", "--size", "700"), "--size must be WIDTHxHEIGHT, such as 85x60mm or"),
        (("bars", "--out", "x.pdf", "--size", "9x450"), "--size must have sides of 50 to 10000 pixels, got"),
        (("bars", "--out", "x.json", "--set", "colum=a"), "unknown key 'bars.colum'"),
        (("bars", "--out", "x.json", "--set", "column=[a"), "--set column: not valid YAML"),
        (("bars", "--out", "x.json", "--set", "column=none"), "figure bars: KeyError in line"),
        (("bars", "--out", "x.json", "--set", "column"), "--set column: must be KEY=VALUE"),
        (("sweep", "--out", "x.json", "--set", "x=a"), "figure sweep: "),
        (("bars", "--out", "x.json", "--plugin", "no.py"), "plugin 'no.py': cannot read"),
    ],
)
def test_what_cannot_be_drawn(installed, tmp_path, monkeypatch, capsys, arguments, text):
    monkeypatch.chdir(tmp_path)
    assert main(["figure", str(installed), *arguments]) == 2
    assert text in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
