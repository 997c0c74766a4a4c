"""From a trained point to a bundle, and the same answers from the bundle on recordings."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import dse
from dse import store
from dse.base import seeds
from dse.base.records import Network, Parameters
from dse.cli import main
from dse.config import load_space
from dse.data import dataset
from dse.data.dataset import load
from dse.data.dataset.cache import usual_root
from dse.data.recordings import RecordingError
from dse.data.recordings.scene import Trials
from dse.deploy import bundle
from dse.deploy.bundle import BundleError
from dse.deploy.evaluate import evaluate
from dse.deploy.export import bundle_of, export
from dse.measure import decision
from dse.measure.run import read_out
from dse.models.snn import respond
from dse.models.snn.quantise import rounded
from dse.scene.load import load_scene
from dse.study import explore, results
from tests import tiny_study
from tests.deploy.bundles import FAMILIES, JOINT, explored
from tests.installed import needs_papers
from tests.spaces import FINGERTIP, write_space


@pytest.fixture(scope="module")
def real(tmp_path_factory):
    """One spiking network, trained twice."""
    return explored(tmp_path_factory.mktemp("real"), tiny_study.REAL)


@pytest.fixture
def point(real):
    points = real.points()
    rows = points[(points["phi"] == 2) & (points["theta"] == 0.6)]
    return dict(rows.iloc[0].to_dict())


@pytest.fixture
def exported(real, point, tmp_path):
    export(real, point, tmp_path / "bundle")
    return tmp_path / "bundle"


def recordings(real):
    with np.load(real.folder.parents[1] / "tiny.npz") as file:
        return dict(file)


def test_the_bundle_answers_as_the_trained_network_did(real, point, exported, tmp_path):
    read = bundle.read(exported)
    records = real.runs(0)
    chosen = records[read.evidence["repeat"]]
    validation = load(usual_root() / chosen["data"]).validation
    arrays = recordings(real)
    arrays |= {"spikes": arrays["spikes"][validation], "label": arrays["label"][validation]}
    np.savez(tmp_path / "new.npz", **arrays)
    found = evaluate(exported, tmp_path / "new.npz")
    folder = store.run_file(real.folder, 0, chosen["repeat"])
    surface = store.load_arrays(folder / "surface.npz")
    assert found.accuracy == pytest.approx(surface["accuracy"][1, 1])
    assert found.accuracy_se == pytest.approx(surface["accuracy_se"][1, 1])
    assert found.decision_latency_ms == pytest.approx(surface["decision_latency_ms"][1, 1])
    assert found.undecided == pytest.approx(surface["undecided"][1, 1])
    assert found.confusion.sum(axis=1).tolist() == [6, 6, 6]
    assert found.columns["labelled"] == found.columns["recordings"] == 18
    assert read.classes == ("felt", "silk", "wool") == found.classes


def test_the_repeat_nearest_the_mean_is_exported(real, point, exported):
    read = bundle.read(exported)
    accuracies = np.array(read.evidence["accuracy_of_repeats"])
    assert accuracies.mean() == pytest.approx(point["accuracy"])
    assert read.evidence["repeat"] == np.abs(accuracies - accuracies.mean()).argmin()
    weights = store.load_arrays(store.run_file(real.folder, 0, read.evidence["repeat"]) / "weights.npz")
    assert np.array_equal(read.fitted.layers[0].weight, weights["0/weight"])
    assert (read.phi, read.theta) == (2.0, 0.6)
    assert read.record["energy_uj"] == point["energy_uj"]
    assert read.evidence["environment"][-1]["versions"]["dse"] == dse.__version__
    stated = json.loads((exported / "statement.json").read_text())["predicate"]["buildDefinition"]
    assert {"uri": f"pkg:pypi/dse-spiking@{dse.__version__}"} in stated["resolvedDependencies"]


def test_a_pick_learns_once_more_from_training_and_validation(real, point, exported, tmp_path):
    before = bundle.read(exported)
    record = real.runs(0)[before.evidence["repeat"]]
    data = load(usual_root() / record["data"])
    whole = np.sort(np.concatenate([data.train, data.validation]))

    def rngs(purpose, *index):
        return seeds.generator(record["seed"], record["design"], purpose, record["repeat"], *index)

    model, training = before.sections.model, before.sections.training
    wanted = model.fit(replace(data, train=whole), training, rngs).network
    again = export(real, point, tmp_path / "again", refit=("train", "validation"))
    same = export(real, point, tmp_path / "same", refit=("train",))
    for k, layer in enumerate(before.fitted.layers):
        assert np.array_equal(again.fitted.layers[k].weight, wanted.layers[k].weight)
        assert np.array_equal(same.fitted.layers[k].weight, layer.weight)
        assert not np.array_equal(again.fitted.layers[k].weight, layer.weight)
    assert again.record == before.record and again.evidence["refit"] == ["train", "validation"]
    texts = [(path / "README.md").read_text(encoding="utf-8") for path in (exported, tmp_path / "again")]
    assert ["on the recordings of train and validation together" in text for text in texts] == [False, True]
    run = store.run_file(real.folder, int(point["trial"]), before.evidence["repeat"])
    counts = store.load_arrays(run / "confusion.npz")
    assert before.evidence["confusion"] == {"of": "validation", "counts": counts["validation"].tolist()}
    file = real.folder.parents[1] / "tiny.npz"
    file.with_name(f"{file.name}.croissant.json").write_text('{"license": "MIT"}')
    assert bundle_of(real, point).evidence["licence"] == "MIT" and before.evidence["licence"] is None
    file.rename(tmp_path / "elsewhere.npz")
    try:
        with pytest.raises(RecordingError, match="the recordings of trial 0 are not found"):
            export(real, point, tmp_path / "never", refit=("train",))
    finally:
        (tmp_path / "elsewhere.npz").rename(file)
    assert not (tmp_path / "never").exists()


def test_arrays_are_no_spikes(exported):
    with pytest.raises(BundleError, match="arrays are for classifiers of sampled signals"):
        bundle.read(exported).predict(np.zeros((2, 16, 4)))


def test_a_bundle_says_what_recordings_it_takes(real, point, exported, on_scene, tmp_path, monkeypatch):
    assert bundle.read(exported).input == bundle.Input("spikes", 4, 0, 0, 16, 5.0)
    of_scene = bundle.read(on_scene / "bundle").input
    assert of_scene == bundle.Input("events", 0, 96, 64, 20, 5.0)
    monkeypatch.setenv("DSE_CACHE", str(tmp_path / "evicted"))
    assert export(real, point, tmp_path / "bundle").input == bundle.read(exported).input


def test_resonators_are_explored_priced_exported_and_evaluated(tmp_path):
    axis = "neuron: {choice: [cuba_lif, resonator]}, share: {choice: [0.5, 1.0]}, hidden: [12]"
    text = tiny_study.REAL.replace("hidden: [12]", axis).replace("repeats: 2", "repeats: 1")
    chips = "hardware: [loihi1_silicon, loihi2_scenario]"
    study = explored(tmp_path, text.replace("hardware: [loihi1_silicon]", chips))
    points = study.points()
    priced = points.groupby(["model.neuron", "hardware"])["energy_uj_high"].apply(lambda x: x.notna().all())
    assert priced.to_dict() == {
        ("cuba_lif", "loihi1_silicon"): True,
        ("cuba_lif", "loihi2_scenario"): True,
        ("resonator", "loihi1_silicon"): False,
        ("resonator", "loihi2_scenario"): True,
    }
    of = points[(points["model.neuron"] == "resonator") & (points["model.share"] == 0.5)]
    row = of[(of["phi"] == 2) & (of["theta"] == 0.6)].iloc[0].to_dict()
    export(study, row, tmp_path / "bundle")
    readme = (tmp_path / "bundle" / "README.md").read_text()
    assert "resonating and current-based leaky integrate-and-fire neurons" in readme
    assert "`k/cosine` in 1/4096" in readme
    validation = load(usual_root() / study.runs(int(row["trial"]))[0]["data"]).validation
    arrays = recordings(study)
    arrays |= {name: arrays[name][validation] for name in ("spikes", "label")}
    np.savez(tmp_path / "new.npz", **arrays)
    assert evaluate(tmp_path / "bundle", tmp_path / "new.npz").accuracy == pytest.approx(row["accuracy"])


def test_a_rounded_network_is_exported_as_it_was_evaluated(tmp_path):
    text = f"{tiny_study.REAL}precision: {{weight_bits: [3, 8], pruned: [0, 0.5], within: 1}}\n"
    found = explored(tmp_path, text)
    base = {"trial": 0, "task": "fabric", "weight_bits": 3, "pruned_after": 0.5}
    for point in (base, base | {"phi": 2.0, "theta": 0.6}, base | {"read_out_ms": 40.0}):
        made = export(found, point, tmp_path / "bundle")
        read = bundle.read(tmp_path / "bundle")
        run = store.run_file(found.folder, 0, read.evidence["repeat"])
        trained = store.fitted_of(store.load_arrays(run / "weights.npz"))
        fewer = rounded(trained, 3, 0.5)
        assert np.array_equal(read.fitted.layers[0].weight, fewer.layers[0].weight)
        told = read.evidence["precision"]
        assert (told["weight_bits"], told["pruned"]) == (3, 0.5)
        data = load(usual_root() / made.evidence["data"])
        said = respond.respond(read.fitted, data, data.validation)
        if "phi" in point:
            label, _, _ = decision.decide(said.output, 2.0, 0.6)
        else:
            label = read_out(said.output[:, : 8 if "read_out_ms" in point else None])
        accuracy = (label == data.target[data.validation]).mean()
        assert made.evidence["accuracy_of_repeats"][read.evidence["repeat"]] == pytest.approx(accuracy)
    more = export(found, {"trial": 0, "weight_bits": 32.0, "pruned_after": 0.0}, tmp_path / "bundle")
    assert "precision" not in more.evidence and more.fitted.n_weights == trained.n_weights
    with pytest.raises(ValueError, match=r"trial 0 was not evaluated at 4 bits with 0\.25 pruned"):
        export(found, base | {"weight_bits": 4, "pruned_after": 0.25}, tmp_path / "bundle")


def test_what_a_point_does_not_have_is_not_in_its_bundle(real, point, tmp_path):
    made = export(real, {**point, "fits": pd.NA, "read_out_ms": None, "energy_uj": np.nan}, tmp_path / "b")
    assert not {"fits", "read_out_ms", "energy_uj"} & set(made.record)
    assert bundle.read(tmp_path / "b").record == made.record


def test_recordings_without_labels_are_answered(real, exported, tmp_path):
    arrays = recordings(real)
    np.savez(tmp_path / "new.npz", spikes=arrays["spikes"][:5])
    found = evaluate(exported, tmp_path / "new.npz")
    assert len(found.label) == 5 and set(found.label) <= {0, 1, 2}
    assert (found.target == -1).all()
    assert (found.accuracy, found.accuracy_se, found.confusion) == (None, None, None)
    assert found.columns["labelled"] == 0
    assert (found.time_ms > 0).all() and (found.time_ms <= 80).all()


def test_recordings_that_do_not_fit_are_one_line(real, exported, tmp_path):
    arrays = recordings(real)
    np.savez(tmp_path / "narrow.npz", spikes=arrays["spikes"][..., :2])
    with pytest.raises(BundleError, match=r"narrow\.npz: must have 4 input channels .*, got 2"):
        evaluate(exported, tmp_path / "narrow.npz")
    with pytest.raises(RecordingError, match=r"missing\.npz"):
        evaluate(exported, tmp_path / "missing.npz")
    np.savez(tmp_path / "short.npz", spikes=arrays["spikes"][:, :8])
    with pytest.raises(RecordingError, match="16"):
        evaluate(exported, tmp_path / "short.npz")


def test_points_that_are_not_there_are_refused(real, point, tmp_path):
    with pytest.raises(ValueError, match="a point must have the column trial, got the columns phi"):
        export(real, {"phi": 0}, tmp_path / "b")
    with pytest.raises(ValueError, match=r"was not evaluated at phi 2, theta 0\.99"):
        export(real, {**point, "theta": 0.99}, tmp_path / "b")
    with pytest.raises(store.StoreError, match="there is no trial 4"):
        export(real, {**point, "trial": 4}, tmp_path / "b")
    assert not (tmp_path / "b").exists()


def test_every_kind_of_network_answers_as_it_was_measured(tmp_path):
    kinds = "recurrent: {choice: [false, true]}, arithmetic: {choice: [integer, ideal]}, input_delays: [0, 2]"
    path = write_space(
        tmp_path,
        ("thresholds: {choice: [[1, 2], [1, 2, 4]]}", "thresholds: [1, 2]"),
        ("hidden: {choice: [4, 8, 12]}", f"hidden: [6, 5], steps_per_sample: 2, {kinds}"),
        ("epochs: 1", "epochs: 3"),
    )
    found = explore.run(load_space(path), tmp_path / "results", progress=False)
    points = found.points()
    assert set(points["trial"]) == {0, 1, 2, 3}
    validation = np.load(tmp_path / "touch.npz")["repetition"] == 1
    for _, point in points.groupby("trial").nth([0, 4, -1]).iterrows():
        export(found, point.to_dict(), tmp_path / "bundle")
        answers = evaluate(tmp_path / "bundle", tmp_path / "touch.npz")
        right = (answers.label == answers.target)[validation]
        assert right.mean() == pytest.approx(point["accuracy"])
        assert answers.time_ms[validation].mean() == pytest.approx(point["decision_latency_ms"])


@needs_papers
@pytest.mark.parametrize("text", [FAMILIES, JOINT], ids=["one task", "joint"])
def test_every_family_and_every_kind_of_point_answers_as_it_was_measured(tmp_path, text):
    found = explored(tmp_path, text)
    points = found.points()
    assert set(found.trials["status"]) == {"finished"}, found.trials["reason"].tolist()
    kinds = ["knn", "naive_bayes", "elm", "hots", "snn", *(["cascade"] if text == JOINT else [])]
    assert len(set(points["trial"])) == len(kinds)
    seen = set()
    for (trial, task), rows in points.groupby(["trial", "task"]):
        record = found.runs(int(trial))[0]
        validation = load(usual_root() / record["data"]).validation
        early, decided = rows[rows["read_out_ms"].notna()], rows[rows["phi"].notna()]
        full = rows[rows["read_out_ms"].isna() & rows["phi"].isna()]
        assert len(full) == 1 and len(early) > 2
        for _, point in pd.concat([full, early.iloc[:1], decided]).iterrows():
            made = export(found, point.to_dict(), tmp_path / "bundle")
            answers = evaluate(tmp_path / "bundle", tmp_path / "tiny.npz")
            assert isinstance(
                made.fitted, Network if record["sections"]["model"]["kind"] == "snn" else Parameters
            )
            assert len(answers.classes) == (2 if task == "speed" else 3)
            right = (answers.label == answers.target)[validation]
            assert right.mean() == point["accuracy"]
            assert answers.time_ms[validation].mean() == pytest.approx(point["decision_latency_ms"])
            seen.add((record["sections"]["model"]["kind"], task, bool(np.isnan(point["read_out_ms"]))))
    if text == JOINT:  # all heads together
        for _, row in found.trials.iterrows():
            export(found, row.to_dict(), tmp_path / "bundle")
            answers = evaluate(tmp_path / "bundle", tmp_path / "tiny.npz")
            assert len(answers.classes) == 6
            validation = load(usual_root() / found.runs(row["trial"])[0]["data"]).validation
            assert (answers.label == answers.target)[validation].mean() == row["accuracy"]
    tasks = ["fabric", "speed"] if text == JOINT else ["fabric"]
    assert seen == {(kind, task, late) for kind in kinds for task in tasks for late in (True, False)}


def test_recordings_of_a_length_that_a_family_refuses_are_one_line(tmp_path):
    text = FAMILIES.replace("window: {n_steps: 16, at: middle}\n", "")
    model, after = text.index("model:"), text.index("training:")
    found = explored(tmp_path, f"{text[:model]}model: {{kind: naive_bayes, window_ms: 20}}\n{text[after:]}")
    export(found, found.trials.iloc[0].to_dict(), tmp_path / "bundle")
    with np.load(tmp_path / "tiny.npz") as file:
        arrays = dict(file)
    np.savez(tmp_path / "short.npz", **arrays | {"spikes": arrays["spikes"][:, :10]})
    with pytest.raises(BundleError, match=r"short.npz: samples must have .* windows of 20 ms as in training"):
        evaluate(tmp_path / "bundle", tmp_path / "short.npz")


LEAKY = """
study: leaky
data: {kind: time_series, file: touch.npz, step_ms: 10, columns: {fabric: label, repetition: repetition}}
task: {target: fabric}
window: {n_steps: 16, at: middle}
split: {stratified: {validation: 0.5}}
encoder: {kind: threshold, matching: {choice: [own_label, nearest]}}
model: {kind: threshold_lif}
objectives: [accuracy:max, n_weights:min]
search: {sampler: grid}
execution: {jobs: 1}
"""


@needs_papers
def test_an_encoder_that_reads_labels_is_not_deployed(tmp_path):
    write_space(tmp_path)
    (tmp_path / "leaky.yaml").write_text(LEAKY)
    found = explore.run(load_space(tmp_path / "leaky.yaml"), tmp_path / "results", progress=False)
    leaky, honest = (row.to_dict() for _, row in found.trials.iterrows())
    with pytest.raises(BundleError, match="trial 0 cannot be deployed: encoder threshold reads the labels"):
        export(found, leaky, tmp_path / "b")
    assert not (tmp_path / "b").exists()
    export(found, honest, tmp_path / "b")


def test_windows_of_a_run_on_both_sides_of_the_split_do_not_keep_it_from_being_deployed(tmp_path):
    write_space(tmp_path)
    text = LEAKY.replace("own_label, nearest", "nearest")
    text = text.replace("n_steps: 16, at: middle", "cut_steps: 8, every_steps: 4")
    (tmp_path / "cut.yaml").write_text(text)
    found = explore.run(load_space(tmp_path / "cut.yaml"), tmp_path / "results", progress=False)
    [row] = (row.to_dict() for _, row in found.trials.iterrows())
    assert row["transductive"]
    assert export(found, row, tmp_path / "b").record["transductive"] is True


ON_SCENE = """
study: scene
data: {kind: scene, scene: fingertip.yaml}
task: {target: texture}
window: {n_steps: 20, at: start}
split: {stratified: {validation: 0.5}}
preprocessing: {bin_ms: 5, pool: 8, polarity: merge, crop: pins}
model: {kind: snn, hidden: [12]}
training: {epochs: 2, batch_size: 8}
decision: {phi: [0], theta: [0.5]}
objectives: [accuracy:max, n_weights:min]
search: {sampler: grid}
"""


@pytest.fixture(scope="module")
def on_scene(tmp_path_factory):
    """The folder of a scene and of a bundle that was trained on it."""
    folder = tmp_path_factory.mktemp("scene")
    (folder / "fingertip.yaml").write_text(f"{FINGERTIP}trials: 4\n")
    (folder / "scene.yaml").write_text(ON_SCENE)
    found = explore.run(load_space(folder / "scene.yaml"), folder / "results", progress=False)
    export(found, found.trials.iloc[0].to_dict(), folder / "bundle")
    return folder


def test_a_scene_is_answered_with_the_crop_that_was_trained(on_scene):
    sections = bundle.read(on_scene / "bundle").sections
    pins = Trials(load_scene(str(on_scene / "fingertip.yaml"))).pins()
    assert sections.preprocessing.crop == pins != (0, 0, 96, 64)
    found = evaluate(on_scene / "bundle", on_scene / "fingertip.yaml")
    record = results.open(on_scene / "results" / "scene").runs(0)[0]
    validation = load(usual_root() / record["data"]).validation
    right = found.label == found.target
    assert len(right) == 16 and right[validation].mean() == pytest.approx(record["columns"]["accuracy"])


def test_a_scene_trained_network_answers_on_events(on_scene, tmp_path):
    assert (
        main(["simulate", str(on_scene / "fingertip.yaml"), "--out", str(tmp_path / "all.npz"), "--quiet"])
        == 0
    )
    several = evaluate(on_scene / "bundle", tmp_path / "all.npz")
    assert several.columns["labelled"] == several.columns["recordings"] == 16
    with np.load(tmp_path / "all.npz") as file:
        arrays, part = dict(file), slice(file["offsets"][2], file["offsets"][3])
    (tmp_path / "files").mkdir()
    fields = np.zeros((part.stop - part.start, 2), "<u4")
    t_us, x, y, p = (arrays[name][part].astype("<u4") for name in ("t_us", "x", "y", "polarity"))
    fields[:, 0], fields[:, 1] = t_us, x | y << 14 | p << 28
    header = b"% Data file containing CD events.\n% Version 2\n% Width 96\n% Height 64\n"
    (tmp_path / "files" / "one.dat").write_bytes(header + bytes((0x0C, 8)) + fields.tobytes())
    for path in (tmp_path / "files", tmp_path / "files" / "one.dat"):
        found = evaluate(on_scene / "bundle", path)
        assert found.label.tolist() == several.label[2:3].tolist()
        assert found.target.tolist() == [-1]


def test_what_was_repaired_is_said(real, exported, monkeypatch):
    build_for = dataset.build_for
    monkeypatch.setattr(
        "dse.deploy.reference.dataset.build_for",
        lambda *given: build_for(*given)._replace(notes=["recording 3 was cut"]),
    )
    notes = evaluate(exported, real.folder.parents[1] / "tiny.npz").notes
    assert notes[-1] == "recording 3 was cut" and notes[0].startswith("the design was trained and selected")


def test_a_missing_path_is_one_line_and_no_folder_is_searched(on_scene, monkeypatch, capsys):
    monkeypatch.setattr("dse.data.recordings.files.os.scandir", lambda _: pytest.fail("searched"))
    for command in ("evaluate", "stream"):
        assert main([command, str(on_scene / "bundle"), "--data", "/missing.aedat4"]) == 2
        assert capsys.readouterr().err == "/missing.aedat4: no such file or folder\n"
