"""A neuron that a user wrote, in a file beside the search space: trained, resumed, picked and evaluated."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import dse
from dse import store
from dse.config.locate import shipped_folder
from tests.command import document

SPACE = """\
study: adaptive
seed: 1
plugins: [adaptive.py]
data: {kind: scene, scene: touch.yaml}
task: {target: texture}
split:
  train: {repetition: [0, 1, 2, 3]}
  validation: {repetition: [4]}
preprocessing: {bin_ms: 10, pool: 20, pool_threshold: 3, polarity: merge}
model:
  kind: snn
  neuron: adaptive
  tau_v_ms: [10, 300]
  rise: {choice: [0.0, 0.3]}
  hidden: 12
  true_rate: 0.6
  initial_rate: 0.2
  output_tau_grad: 0.3
  arithmetic: float32
training: {epochs: 6, batch_size: 24, learning_rate: 0.1}
decision: {phi: [0, 20], theta: [0.3, 0.6]}
objectives: [accuracy:max, n_weights:min]
search: {sampler: grid, n_trials: 1}
"""


def run(*arguments, capsys):
    return document(capsys, *arguments)["rows"]


@pytest.mark.slow
def test_a_users_neuron_goes_from_a_file_to_a_bundle(torch, tmp_path, capsys):
    shutil.copy(Path(__file__).parents[2] / "plugins" / "adaptive.py", tmp_path)
    scene = tmp_path / "touch.yaml"
    quickstart = shipped_folder("search_spaces") / "scenes" / "quickstart.yaml"
    scene.write_text(quickstart.read_text(encoding="utf-8").replace("trials: 20", "trials: 5"))
    space = tmp_path / "adaptive.yaml"
    space.write_text(SPACE, encoding="utf-8")
    results = tmp_path / "results" / "adaptive"
    run("run", space, "--results", tmp_path / "results", "--quiet", "--trust", capsys=capsys)
    space.write_text(SPACE.replace("n_trials: 1", "n_trials: 2"), encoding="utf-8")
    first = store.load_arrays(results / "runs" / "00000-0.npz" / "weights.npz")["0/weight"]
    run("run", space, "--results", tmp_path / "results", "--quiet", capsys=capsys)  # trains what is missing
    stored = store.load_arrays(results / "runs" / "00000-0.npz" / "weights.npz")
    assert str(stored["0/neuron"]) == "adaptive"
    np.testing.assert_array_equal(stored["0/weight"], first)
    front = run("skyline", results, capsys=capsys)
    assert {row["trial"] for row in front} <= {0, 1}
    (picked,) = run("pick", results, "--export", tmp_path / "bundle", capsys=capsys)[:1]
    assert float(str(picked["accuracy"])) > 1 / 6  # six textures

    # The bundle answers the scene's recordings; on those of the validation part it has the recorded accuracy.
    validation = dse.open(results).dataset(int(str(picked["trial"]))).validation
    (tmp_path / "adaptive.py").unlink()  # the bundle has its own copy
    answers = run("evaluate", tmp_path / "bundle", "--data", scene, "--each", capsys=capsys)
    correct = [answers[i]["answer"] == answers[i]["true"] for i in validation]
    assert np.mean(correct) == picked["accuracy"]
