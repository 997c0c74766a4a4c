"""The notebooks of docs/notebooks: every cell runs in IPython, and shows what is stored with it.

`WRITE_DOCS=1 pytest tests/docs` stores the outputs anew; those of figures are pictures.
"""

import base64
import json
import os
import shutil
import sys
from pathlib import Path

import pytest

from dse.base import registry
from dse.show.figures.image import static_image
from tests.docs import pages

ROOT = Path(__file__).resolve().parent.parent.parent
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
PICTURE = "image/png"
WRITES = bool(os.environ.get("WRITE_DOCS"))


def code_of(path):
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    return [cell for cell in cells if cell["cell_type"] == "code"]


def lines(text):
    return text.splitlines(keepends=True)


def shown_by(result, printed, shell):
    """Return what a cell shows, format -> text; of a figure a picture, drawn where it is stored."""
    if hasattr(result, "to_plotly_json"):
        picture = static_image(result, "png", png_scale=1) if WRITES else b""
        return "", {PICTURE: base64.b64encode(picture).decode()}
    formats = {} if result is None else shell.display_formatter.format(result)[0]
    return printed, {kind: x for kind, x in formats.items() if kind in ("text/html", "text/plain")}


def compared(cells):
    """Return outputs without what differs between machines: durations, sizes of C, and pictures."""
    shown = [{k: x for k, x in y.get("data", y).items() if k != PICTURE} for x in cells for y in x["outputs"]]
    return pages.masked(json.dumps(shown, indent=0))


@pytest.fixture
def performed(tmp_path, monkeypatch):
    """Return a function that runs a notebook in a folder that lies in a clone as its own does."""
    shells = pytest.importorskip("IPython.core.interactiveshell")
    capture = pytest.importorskip("IPython.utils.capture").capture_output
    config = pytest.importorskip("traitlets.config").Config()
    config.HistoryManager.enabled = False
    shutil.copytree(ROOT / "results" / "example", tmp_path / "results" / "example")
    (tmp_path / "docs" / "notebooks").mkdir(parents=True)
    monkeypatch.chdir(tmp_path / "docs" / "notebooks")
    monkeypatch.setitem(sys.modules, "__main__", sys.modules["__main__"])  # a shell puts its own there
    components = registry._outside()
    shell = shells.InteractiveShell(config=config)
    for name in ("write_output_prompt", "write_format_data"):  # results are kept, not printed
        monkeypatch.setattr(shell.displayhook, name, lambda *_: None)

    def run(name):
        path = ROOT / "docs" / "notebooks" / f"{name}.ipynb"
        notebook = json.loads(path.read_text(encoding="utf-8"))
        cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
        before, shown = compared(cells), []
        for number, cell in enumerate(cells, 1):
            with capture(stderr=False) as captured:
                result = shell.run_cell("".join(cell["source"]))
            result.raise_error()
            printed, data = shown_by(result.result, captured.stdout, shell)
            data = {kind: lines(text.replace(str(tmp_path), "...")) for kind, text in data.items()}
            stream = {"output_type": "stream", "name": "stdout", "text": lines(printed)}
            value = {"output_type": "execute_result", "execution_count": number, "data": data, "metadata": {}}
            cell["outputs"] = [stream] * bool(printed) + [value] * bool(data)
            cell["execution_count"] = number
            shown.append(
                (result.result, printed or "".join(data.get("text/html", data.get("text/plain", ""))))
            )
        if WRITES:
            path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        else:
            assert compared(cells) == before, f"{path}: WRITE_DOCS=1 pytest tests/docs"
        return shown

    yield run
    registry._replace(components)


def test_own_sensor(performed):
    shown = performed("own_sensor")
    reports = [line for line in shown[2][1].splitlines() if ": accuracy " in line]
    assert [line.split(":")[0] for line in reports] == ["trial 0", "trial 1"]
    (study, page), (best, _), (accuracy, _) = shown[3:6]
    assert len(study) == 2 and "<table" in page and "n_weights" in page
    assert best["n_weights"] <= 100
    assert accuracy > 0.8


def test_microcontroller(performed):
    shown = performed("microcontroller")
    picked, _ = shown[1]
    assert picked["ram_bytes"] <= 8192 and picked["hardware_latency_ms"] <= 100 < picked["cycles"]
    assert "; the nearest misses flash_bytes<=200 by " in shown[3][1]
    bundle, text = shown[4]
    assert sorted(bundle.targets) == ["c99", "cortex_m4"]
    assert text.startswith("<Bundle snn: 12 classes, accuracy 0.660, c99: ") and "\n" not in text
    assert "#define DSE_CLASSES 12u" in shown[5][1]


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


def test_notebooks_are_linked_and_show_what_they_print():
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    assert len(NOTEBOOKS) == 4
    for path in NOTEBOOKS:
        assert f"(notebooks/{path.name})" in index
        assert any(cell["outputs"] for cell in code_of(path))
