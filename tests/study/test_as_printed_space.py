"""The printed training, as a search space: it is read, and trains on a scene small enough for a test."""

import re
from pathlib import Path

import numpy as np

import dse
from dse import store
from dse.cli import main

SPACE = Path(__file__).resolve().parents[2] / "search_spaces" / "texture_profile_as_printed.yaml"


def small(folder):
    """Return the space with few trials of a small scene, coarse pools and few neurons and epochs."""
    text, n = re.subn(r"(?s)  train: .*?(?=# Printed: 78)", "SPLIT", SPACE.read_text())
    assert n == 1
    for before, after in (
        (
            "SPLIT",
            "  train: {repetition: [0, 1]}\n  validation: {repetition: [2]}\n  test: {repetition: [3]}\n",
        ),
        ("{kind: scene, scene: neurotac_dvxplorer}", "{kind: scene, scene: quickstart, trials: 4}"),
        ("{bin_ms: 1, pool: 4,", "{bin_ms: 4, pool: 16,"),
        ("{choice: [425, 450]}", "12"),
        ("{choice: [0.3, 0.9]}", "0.3"),
        ("target: {choice: [texture, profile]}", "target: texture"),
        ("epochs: 100", "epochs: 3"),
        ("batch_size: 4 ", "batch_size: 8 "),
        ("delay_learning_rate: 0.01", "delay_learning_rate: 0.5"),
        ("decay_learning_rate: 2.44e-6", "decay_learning_rate: 0.001"),
        ("weight_scale: 2 ", "weight_scale: 4 "),  # of fewer inputs
        ("jobs: 2", "jobs: 1"),
    ):
        assert text.count(before) == 1, before
        text = text.replace(before, after)
    path = folder / "small.yaml"
    path.write_text(text)
    return path


def test_it_trains(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["run", str(small(tmp_path)), "--results", "results"]) == 0
    study = dse.open("results/texture_profile_as_printed")
    (trial,) = study.trials.to_dict("records")
    assert trial["epochs_trained"] == 3 and 1 <= trial["epoch_kept"] <= 3
    (run,) = Path("results").rglob("runs/*.npz")
    network = store.fitted_of(store.load_arrays(run / "weights.npz"))
    hidden, outputs = network.layers
    assert hidden.delay is None and outputs.delay is not None
    assert (outputs.delay == outputs.delay[:1]).all() and 0 < outputs.delay.max() <= 62
    for layer in network.layers:
        decays = [layer.parameters[name] for name in ("decay_current", "decay_voltage")]
        assert all(len(np.unique(d)) == 1 for d in decays)
        assert [int(d.flat[0]) for d in decays] != [1024, 123]
