"""The notebooks of docs/notebooks: every cell runs in IPython, and what it shows is shown as in Jupyter."""

import json
import shutil
import sys
from pathlib import Path

import pytest

from dse import registry

ROOT = Path(__file__).resolve().parent.parent.parent
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


def code_of(path):
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    return [cell for cell in cells if cell["cell_type"] == "code"]


@pytest.fixture
def performed(tmp_path, monkeypatch):
    """Return a function that runs a notebook in a folder that lies in a clone as its own does."""
    shells = pytest.importorskip("IPython.core.interactiveshell")
    config = pytest.importorskip("traitlets.config").Config()
    config.HistoryManager.enabled = False
    shutil.copytree(ROOT / "results" / "example", tmp_path / "results" / "example")
    (tmp_path / "docs" / "notebooks").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "docs" / "notebooks")
    monkeypatch.setitem(sys.modules, "__main__", sys.modules["__main__"])  # a shell puts its own there
    components = registry._outside()
    shell = shells.InteractiveShell(config=config)

    def run(name):
        shown = []
        for cell in code_of(ROOT / "docs" / "notebooks" / f"{name}.ipynb"):
            result = shell.run_cell("".join(cell["source"]))
            result.raise_error()
            formats = shell.display_formatter.format(result.result)[0]
            shown.append((result.result, formats.get("text/html", formats.get("text/plain", ""))))
        return shown

    yield run
    registry._replace(components)


def test_own_sensor(performed, capsys):
    shown = performed("own_sensor")
    reports = [line for line in capsys.readouterr().out.splitlines() if ": accuracy " in line]
    assert [line.split(":")[0] for line in reports] == ["trial 0", "trial 1"]
    (study, page), (best, _), (accuracy, _) = shown[3:6]
    assert len(study) == 2 and "<table" in page and "n_weights" in page
    assert best["n_weights"] <= 100
    assert accuracy > 0.8


def test_microcontroller(performed, capsys):
    shown = performed("microcontroller")
    picked, _ = shown[1]
    assert picked["ram_bytes"] <= 8192 and picked["hardware_latency_ms"] <= 100 < picked["cycles"]
    printed = capsys.readouterr().out
    assert "; the nearest misses flash_bytes<=200 by " in printed
    assert "#define DSE_CLASSES 12u" in printed
    bundle, text = shown[4]
    assert sorted(bundle.targets) == ["c99", "cortex_m4"]
    assert text.startswith("<Bundle snn: 12 classes, accuracy 0.660, c99: ") and "\n" not in text


def test_own_neuron(performed):
    pytest.importorskip("torch")
    trials, _ = performed("own_neuron")[-1]
    assert trials["model.rise"].tolist() == [0.0, 0.3]
    assert (trials["accuracy"] > 0.8).all()
    assert trials["spikes_per_inference"].nunique() == 2


def test_reading_a_front(performed, monkeypatch):
    renderers = pytest.importorskip("plotly.io").renderers
    monkeypatch.setattr(renderers, "render_on_display", False)  # plotly asks for nbformat, which Jupyter has
    shown = performed("reading_a_front")
    (_, page), (front, table), _, (figure, _), (price, _), (chips, _), _, (both, _) = shown
    assert "<table" in page and "<table" in table
    assert (front["front_probability"] >= 0.5).all()
    assert {trace.name for trace in figure.data} >= {"texture front"}
    assert len(price.data[0].x) == 3 and len(chips.data[1].x) == 3
    assert {Path(name).stem for name in both["study"]} == {"example", "spiking"}


def test_notebooks_are_stored_without_outputs_and_are_linked():
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    assert len(NOTEBOOKS) == 4
    for path in NOTEBOOKS:
        assert f"(notebooks/{path.name})" in index
        assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code_of(path))
