"""Weights that were trained on, back in a bundle: measured, priced, and what is refused."""

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from dse.cli import main
from dse.deploy import bundle, tuned
from dse.deploy.evaluate import evaluate
from dse.deploy.export import export
from dse.study.results import Study
from tests import tiny_study
from tests.command import document
from tests.deploy import bundles

torch = pytest.importorskip("torch")


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """One spiking network, with early and late decisions, at 8 and 3 bits."""
    text = f"{tiny_study.REAL}precision: {{weight_bits: [3, 8], pruned: [0, 0.5], within: 1}}\n"
    return bundles.explored(tmp_path_factory.mktemp("study"), text.replace("repeats: 2", "repeats: 1"))


def row(study, rule):
    points = study.points()
    few = (points["weight_bits"] == 3) & (points["pruned_after"] == 0.5)
    full = points["phi"].isna() & points["read_out_ms"].isna()
    of_rule = {
        "phi and theta": (points["phi"] == 2) & (points["theta"] == 0.6) & (points["weight_bits"] == 8),
        "read-out": (points["read_out_ms"] == 40) & (points["weight_bits"] == 8),
        "end": full & (points["weight_bits"] == 8),
        "end, three bits, pruned": full & few,
    }
    return dict(points[of_rule[rule]].iloc[0].to_dict())


def saved(module, file, change=lambda state: None):
    state = module.state_dict()
    change(state)
    torch.save(state, file)
    return str(file)


@pytest.mark.parametrize("rule", ["phi and theta", "read-out", "end", "end, three bits, pruned"])
def test_weights_that_did_not_change_are_measured_and_priced_as_in_the_study(study, rule, tmp_path):
    point = row(study, rule)
    made = export(study, point, tmp_path / "bundle")
    from dse.dataset import load
    from dse.dataset.cache import usual_root

    validation = load(usual_root() / study.runs(0)[0]["data"]).validation
    with np.load(study.folder.parents[1] / "tiny.npz") as file:
        arrays = {k: file[k] if k == "names" else file[k][validation] for k in file.files}
    np.savez(tmp_path / "new.npz", **arrays)
    weights = saved(made.as_module(), tmp_path / "same.pt")
    again = tuned.import_weights(tmp_path / "bundle", weights, tmp_path / "new.npz", tmp_path / "tuned")
    for name, value in again.record.items():
        if isinstance(value, float):
            assert value == pytest.approx(made.record[name], rel=1e-12), name
        elif name != "measured_on":
            assert value == made.record[name], name
    assert {"energy_uj", "latency_ms", "accuracy", "n_weights"} <= set(again.record)
    assert again.record["accuracy"] == evaluate(tmp_path / "tuned", tmp_path / "new.npz").accuracy
    assert again.evidence["imported"]["file"] == "same.pt" and again.record["measured_on"] == "new.npz"
    for old, new in zip(made.fitted.layers, bundle.read(tmp_path / "tuned").fitted.layers, strict=True):
        assert np.array_equal(old.weight, new.weight)


def test_weights_that_changed_answer_like_their_module(study, tmp_path, capsys):
    touch = study.folder.parents[1] / "tiny.npz"
    made = export(study, row(study, "end"), tmp_path / "bundle")
    module, examples = made.as_module(), made.as_dataset(touch)
    spikes, label = torch.utils.data.default_collate([examples[i] for i in range(len(examples))])
    assert spikes.shape == (36, 16, 4) and np.array_equal(label, examples.labels)
    optimiser = torch.optim.SGD(module.parameters(), lr=0.5)
    module.loss(module(spikes), label).backward()
    optimiser.step()
    weights = saved(module, tmp_path / "tuned.pt")
    folder = str(tmp_path / "tuned")
    assert main(["import", str(tmp_path / "bundle"), weights, "--data", str(touch), "--out", folder]) == 0
    assert "energy_uj" in capsys.readouterr().out
    with torch.no_grad():
        answer = module(spikes).sum(1).argmax(1)
    found = evaluate(folder, touch)
    assert np.array_equal(found.label, answer) and not np.array_equal(
        found.label, evaluate(tmp_path / "bundle", touch).label
    )
    shown = ["import", str(tmp_path / "bundle"), weights, "--data", str(touch), "--out", folder, "--json"]
    assert main([*shown, "--hardware", "mcu_m4"]) == 0
    (row_of_import,) = json.loads(capsys.readouterr().out)["rows"]
    assert row_of_import["hardware"] == "mcu_m4" and row_of_import["accuracy"] == found.accuracy


def test_a_joint_target_is_measured_head_by_head(tmp_path):
    text = tiny_study.REAL.replace("target: fabric", "target: [fabric, speed], joint: true")
    text = text.replace("{fabric: label}", "{fabric: label, speed: speed}").replace(
        "repeats: 2", "repeats: 1"
    )
    study = bundles.explored(tmp_path, text)
    points = study.points()
    of_speed = points[(points["task"] == "speed") & (points["phi"] == 2) & (points["theta"] == 0.6)].iloc[0]
    for point in (of_speed, study.trials.iloc[0]):
        made = export(study, dict(point.to_dict()), tmp_path / "bundle")
        weights = saved(made.as_module(), tmp_path / "same.pt")
        again = tuned.import_weights(
            tmp_path / "bundle", weights, tmp_path / "tiny.npz", tmp_path / "tuned", "loihi1_silicon"
        )
        assert again.record["accuracy"] == evaluate(tmp_path / "tuned", tmp_path / "tiny.npz").accuracy
        assert again.record["energy_uj"] > 0


def _without(state):
    del state["layers.1.weight"]


def _with(name, change):
    def edit(state):
        state[name] = change(state[name]) if name in state else change(None)

    return edit


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_without, r"w\.pt: must be a state of this bundle's module, but lacks layers\.1\.weight"),
        (_with("bias", lambda _: torch.zeros(3)), "must be a state of this bundle's module, which has no"),
        (_with("layers.0.weight", lambda x: x[:, :-1]), r"layers\.0\.weight must be \(12, 8\), got \(12"),
        (_with("layers.1.weight", lambda x: x * np.nan), r"layers\.1\.weight must hold finite numbers, got"),
        (_with("layers.0.neurons_threshold", lambda x: x + 1), r"layers\.0\.neurons_threshold must be that"),
        (
            _with("layers.0.weight", lambda _: "text"),
            r"must be written by torch\.save\(module\.state_dict\(\)",
        ),
    ],
)
def test_weights_of_another_network_are_one_line(study, change, message, tmp_path, capsys):
    made = export(study, row(study, "end"), tmp_path / "bundle")
    weights = saved(made.as_module(), tmp_path / "w.pt", change)
    touch, out = str(study.folder.parents[1] / "tiny.npz"), tmp_path / "tuned"
    assert main(["import", str(tmp_path / "bundle"), weights, "--data", touch, "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and not out.exists()
    with pytest.raises(bundle.BundleError, match=message):
        tuned.with_weights(made, Path(weights))


def test_files_that_are_no_state_and_recordings_without_labels_are_one_line(study, tmp_path, monkeypatch):
    made = export(study, row(study, "end"), tmp_path / "bundle")
    with pytest.raises(bundle.BundleError, match=r"none\.pt: cannot be read: No such file"):
        tuned.with_weights(made, tmp_path / "none.pt")
    (tmp_path / "text.pt").write_text("no pickle")
    torch.save(made.as_module(), tmp_path / "whole.pt")
    for name in ("text.pt", "whole.pt"):
        with pytest.raises(bundle.BundleError, match=rf"{name}: must be written by torch\.save\(module"):
            tuned.with_weights(made, tmp_path / name)
    weights = saved(made.as_module(), tmp_path / "same.pt")
    with np.load(study.folder.parents[1] / "tiny.npz") as file:
        np.savez(tmp_path / "new.npz", spikes=file["spikes"])
    with pytest.raises(bundle.BundleError, match=r"new\.npz: must have labelled recordings"):
        tuned.import_weights(tmp_path / "bundle", weights, tmp_path / "new.npz", tmp_path / "tuned")
    monkeypatch.setattr("dse.native.extras.find_spec", lambda name: None)
    touch = str(study.folder.parents[1] / "tiny.npz")
    assert main(["import", str(tmp_path / "bundle"), weights, "--data", touch, "--out", "x"]) == 2


def test_imported_weights_are_a_trial_of_their_study(study, tmp_path, capsys):
    shutil.copytree(study.folder.parents[1], tmp_path / "work", ignore=shutil.ignore_patterns("cache"))
    folder = tmp_path / "work" / "results" / study.folder.name
    touch = str(tmp_path / "work" / "tiny.npz")
    made = export(Study(folder), row(study, "end"), tmp_path / "bundle")
    module = made.as_module()
    same = saved(module, tmp_path / "same.pt")
    before = Study(folder).points()
    command = ["import", str(tmp_path / "bundle"), same]
    assert main([*command, "--data", touch, "--out", str(tmp_path / "tuned"), "--into", str(folder)]) == 0
    assert "trial 90000 of" in capsys.readouterr().err
    points = Study(folder).points()
    imported = points[points["trial"] == 90000]
    assert set(imported["origin"]) == {"trial 0, same.pt"}
    # The same weights: all points at full precision are those of the trial that they were trained in.
    own = before[(before["trial"] == 0) & (before["weight_bits"] == 8) & (before["pruned_after"] == 0)]
    for name in ("accuracy", "energy_uj", "decision_latency_ms", "n_weights"):
        assert np.array_equal(imported[name].to_numpy(), own[name].to_numpy()), name
    # What accuracies are expected to be follows from those of all points.
    corrected = [name for name in before if "_corrected" in name]
    others = points[points["trial"] != 90000].drop(columns=["origin", *corrected])
    unchanged = before.drop(columns=corrected)
    pd.testing.assert_frame_equal(others.reset_index(drop=True), unchanged, check_dtype=False)

    for again in (["import", str(tmp_path / "tuned")], command):
        assert main([*again, "--into", str(folder)]) == 2
        assert "trial 90000 has these weights already" in capsys.readouterr().err

    better = saved(module, tmp_path / "better.pt", lambda state: state["layers.0.weight"].mul_(0.5))
    assert main(["import", str(tmp_path / "bundle"), better, "--into", str(folder)]) == 0
    capsys.readouterr()
    where = ["--budget", "trial >= 90001", "--json"]
    rows = document(capsys, "skyline", folder, "--where", "trial >= 90000")["rows"]
    assert {x["origin"] for x in rows} <= {"trial 0, same.pt", "trial 0, better.pt"} and rows
    assert main(["pick", str(folder), *where, "--export", str(tmp_path / "picked")]) == 0
    assert bundle.read(tmp_path / "picked").record["origin"] == "trial 0, better.pt"
    # The search goes on beside them.
    assert (
        main(["run", str(tmp_path / "work" / "space.yaml"), "--results", str(folder.parent), "--quiet"]) == 0
    )
    assert set(Study(folder).trials["trial"]) == {0, 90000, 90001}


def elsewhere(made):
    window = dataclasses.replace(made.sections.window, at="start")
    return dataclasses.replace(made, sections=dataclasses.replace(made.sections, window=window))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda x: dataclasses.replace(x, evidence={**x.evidence, "study": "other"}), "exported from study"),
        (lambda x: dataclasses.replace(x, evidence={**x.evidence, "trial": 7}), "has no run 0 of trial 7"),
        (lambda x: dataclasses.replace(x, evidence={**x.evidence, "data": "0"}), "on other recordings"),
        (lambda x: dataclasses.replace(x, evidence={**x.evidence, "seed": 9}), "has seed 3"),
        (lambda x: dataclasses.replace(x, evidence={**x.evidence, "imported": None}), "nothing to import"),
        (elsewhere, "window.at is 'middle', and 'start' in the bundle"),
    ],
)
def test_weights_of_another_study_are_refused(study, change, message, tmp_path):
    made = export(study, row(study, "end"), tmp_path / "bundle")
    made = tuned.with_weights(made, Path(saved(made.as_module(), tmp_path / "same.pt")))
    with pytest.raises(bundle.BundleError, match=message):
        tuned.import_into(change(made), study.folder)
    assert list(study.trials["trial"]) == [0]
