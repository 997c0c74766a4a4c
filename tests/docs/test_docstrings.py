"""The examples in the docstrings of public functions run, and show what is written."""

import doctest
import shutil
from pathlib import Path

import numpy as np
import pytest

import dse

ROOT = Path(__file__).resolve().parent.parent.parent
SPACE = {
    "study": "my_touch",
    "data": {
        "kind": "time_series",
        "file": "touch.npz",
        "signal": "pressure",
        "step_ms": 4,
        "columns": {"fabric": "fabric", "session": "session"},
    },
    "task": {"target": "fabric"},
    "split": {"train": {"session": [0, 1, 2]}, "validation": {"session": [3]}, "test": {"session": [4]}},
    "encoder": {"kind": "send_on_delta", "thresholds": [0.2]},
    "model": {"kind": "snn", "hidden": 10},
    "training": {"epochs": 20, "batch_size": 8},
    "decision": {"phi": {"range": [0, 8], "step": 4}, "theta": {"range": [0.4, 0.8], "step": 0.2}},
    "hardware": ["loihi1_silicon"],
}


def public():
    """Return every public function and method by its name."""
    functions = [
        (f"{owner.__name__}.{name}", getattr(owner, name))
        for owner in (dse, dse.data)
        for name in owner.__all__
        if name not in ("Study", "ConfigError") and callable(getattr(owner, name))
    ]
    methods = [
        (f"Study.{name}", each)
        for name, each in vars(dse.Study).items()
        if callable(each) and not name.startswith("_")
    ]
    return functions + methods


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with recordings, their search space and a bundle, beside the shipped study."""
    import yaml

    folder = tmp_path_factory.mktemp("docstrings")
    shutil.copytree(ROOT / "results" / "example", folder / "results" / "example")
    rng = np.random.default_rng(1)
    fabric = np.tile(["denim", "silk"], 20)
    hz = np.where(fabric == "denim", 4.0, 22.0)[:, None, None]
    wave = np.sin(2 * np.pi * hz * 0.004 * np.arange(50)[:, None] + rng.uniform(0, 6, (40, 1, 2)))
    np.savez(folder / "touch.npz", pressure=wave, fabric=fabric, session=np.arange(40) // 8)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        Path("my_touch.yaml").write_text(yaml.safe_dump(SPACE))
        study = dse.run("my_touch.yaml", progress=False)
        study.pick().export("bundle", ["c99"])
    return folder


@pytest.mark.parametrize(("name", "function"), public(), ids=[name for name, _ in public()])
def test_example_shows_what_is_written(name, function, folder, monkeypatch):
    monkeypatch.chdir(folder)
    names = {"dse": dse, "np": np, "study": dse.open("results/example")}
    (found,) = doctest.DocTestFinder(recurse=False).find(function, name, globs=names)
    assert found.examples, f"{name} has no example"
    report = []
    doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(found, out=report.append)
    assert not report, "".join(report)
