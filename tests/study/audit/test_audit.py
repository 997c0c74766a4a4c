import json

import numpy as np
import pytest

from dse.cli import main
from dse.config import load_space
from dse.data.dataset import cache
from dse.data.recordings import RecordingError
from dse.study import explore
from dse.study.audit import audit, gather, record
from dse.study.preview import preview
from tests.command import document
from tests.spaces import FINGERTIP

SPACE = """\
study: felt
seed: 1
data: {kind: time_series, file: felt.npz, step_ms: 10, columns: {material: label, part: part, force: force}}
task: {target: material}
window: {n_steps: 32, at: middle}
split: {train: {part: [0]}, validation: {part: [1]}}
encoder: {kind: send_on_delta, thresholds: {choice: [[1], [1, 2]]}}
model: {kind: naive_bayes, window_ms: 80}
hardware: [op_4.6_0.9]
objectives: [accuracy:max, n_weights:min]
"""

SIMULATED = """\
study: tip
data: {kind: scene, scene: tip.yaml}
task: {target: texture}
split: {train: {repetition: [0, 1, 2, 3]}, validation: {repetition: [5]}, test: {repetition: [4]}}
preprocessing: {bin_ms: 10, pool: 16, polarity: merge}
model: {kind: naive_bayes, window_ms: 50}
hardware: [op_4.6_0.9]
objectives: [accuracy:max, n_weights:min]
"""


def write(folder, level=0.0, slope=0.0, text=SPACE, **changes):
    """Write recordings that rest at `level` times the class, drift by `slope` per step and move at random."""
    rng = np.random.default_rng(0)
    part, label, force, _ = np.indices((2, 2, 2, 10)).reshape(4, -1)
    n, n_steps = len(label), 48
    moved = np.cumsum(rng.integers(-1, 2, (n, n_steps, 3)), axis=1)
    offset = level * label[:, None, None] + slope * label[:, None, None] * np.arange(n_steps)[:, None]
    arrays = {"signal": np.asarray(moved + offset, np.float32), "label": label, "part": part, "force": force}
    np.savez(folder / "felt.npz", **(arrays | changes))
    path = folder / "felt.yaml"
    path.write_text(text, encoding="utf-8")
    return load_space(path)


def row_of(space, folder, probe):
    return next(row for row in audit(space, folder / "cache").rows if row.probe == probe)


def test_an_encoder_of_changes_hides_the_resting_level(tmp_path):
    row = row_of(write(tmp_path, level=40), tmp_path, "resting level")
    assert row.accuracy == 1 and not row.shortcut
    assert row.verdict.endswith("but readers do without it (0 % of the spike counts follow it)")


def test_an_encoder_of_levels_shows_the_resting_level(tmp_path):
    text = SPACE.replace("{kind: send_on_delta, thresholds: {choice: [[1], [1, 2]]}}", "{kind: receptors}")
    row = row_of(write(tmp_path, level=40, text=text), tmp_path, "resting level")
    assert row.shortcut and row.remedy == "window.remove_mean: true"
    assert row.accuracy == 1 and row.without < 0.8


def test_drift_shows_in_changes(tmp_path):
    row = row_of(write(tmp_path, slope=2), tmp_path, "drift")
    assert row.shortcut and row.accuracy == 1 and row.without < 0.8


def test_random_movement_is_clean_for_every_target(tmp_path):
    both = SPACE.replace("target: material", "target: {choice: [material, force]}")
    result = audit(write(tmp_path, text=both), tmp_path / "cache")
    assert result.shortcuts == []
    assert any("encoder.thresholds [1.0]" in note for note in result.notes)
    assert {row.task for row in result.rows} == {"material", "force"}


def test_windows_of_one_recording_on_both_sides(tmp_path):
    drawn = SPACE.replace("{train: {part: [0]}, validation: {part: [1]}}", "{stratified: {validation: 0.5}}")
    text = drawn.replace("{n_steps: 32, at: middle}", "{cut_steps: 24, every_steps: 12}")
    row = row_of(write(tmp_path, text=text), tmp_path, "label leak")
    assert row.shortcut and "windows with common steps of one recording" in row.verdict
    assert row.without is not None


def test_an_encoder_that_reads_labels(tmp_path):
    threshold = "{kind: threshold, matching: {choice: [own_label, nearest]}}"
    text = SPACE.replace("{kind: send_on_delta, thresholds: {choice: [[1], [1, 2]]}}", threshold)
    result = audit(write(tmp_path, text=text), tmp_path / "cache")
    leak, first = result.rows[0], result.rows[1]
    assert leak.probe == "label leak" and leak.shortcut and leak.accuracy == 1
    assert leak.without == max(row.accuracy for row in result.rows[1:] if row.probe == first.probe) < 0.7
    assert "audited at encoder.matching 'nearest'" in result.notes
    only = SPACE.replace(
        "{kind: send_on_delta, thresholds: {choice: [[1], [1, 2]]}}", threshold.replace(", nearest", "")
    )
    result = audit(write(tmp_path, text=only), tmp_path / "cache")
    assert [row.shortcut for row in result.rows if row.probe == "label leak"] == [True]


def test_folds_and_draws_are_stated(tmp_path, monkeypatch):
    monkeypatch.setattr(gather, "MOST", 30)
    folds = SPACE.replace("{train: {part: [0]}, validation: {part: [1]}}", "{k_fold: {k: 2}}")
    notes = audit(write(tmp_path, text=folds), tmp_path / "cache").notes
    assert "audited on fold 0 of 2" in notes
    assert "material: 30 of 40 training samples are drawn" in notes


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tip")
    (folder / "tip.yaml").write_text(FINGERTIP + "trials: 6\n", encoding="utf-8")
    (folder / "sim.yaml").write_text(SIMULATED, encoding="utf-8")
    return load_space(folder / "sim.yaml"), folder / "cache"


def test_no_more_touch_is_simulated_than_probes_use(simulated, monkeypatch):
    space, root = simulated
    monkeypatch.setattr(gather, "MOST_SIMULATED", (6, 6, 2))
    (design,) = gather.designs(space)
    read = gather.material(space, design, root)
    assert len(read.train) == 6 and read.validation.tolist() == [5, 11, 17, 23]
    recordings = np.arange(24)
    drawn = np.isin(recordings, [*read.train, *read.validation, *read.test])
    assert read.columns["repetition"][read.train].max() <= 3
    n_spikes = np.diff(read.dataset.spikes.row_offsets[:: read.dataset.spikes.n_steps])
    assert (n_spikes[drawn] > 0).all() and not n_spikes[~drawn].any()
    notes = audit(space, root).notes
    assert "texture: 6 of 16 training samples are drawn" in notes
    monkeypatch.setattr(gather, "MOST_SIMULATED", (400, 400, 400))
    assert len(gather.material(space, design, root).train) == 16


def test_an_audit_is_stored_and_mentioned(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("DSE_CACHE", str(tmp_path / "cache"))
    space = write(tmp_path, slope=2)
    assert "shortcuts" not in preview(space)
    study = explore.run(space, tmp_path / "results", jobs=1, progress=False)
    assert study.audit is None and not (study.folder / record.FILE).exists()
    assert main(["audit", str(space.source), "--format", "json"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert any(row["probe"] == "drift" and row["shortcut"] for row in rows)
    assert "drift (material)" in preview(space)["shortcuts"]
    study = explore.run(space, tmp_path / "results", jobs=1, progress=False)
    assert [row.columns for row in study.audit.rows] == rows
    assert main(["report", str(study.folder), "--format", "table"]) == 0
    text = capsys.readouterr().out
    assert "felt: shortcuts that could pass for skill: " in text and "audit of felt\n" in text
    assert main(["report", str(study.folder), "--format", "json"]) == 0
    assert json.loads(capsys.readouterr().out)["sections"]["audit of felt"]["rows"] == rows
    changed = record.last(write(tmp_path, slope=3), cache.usual_root())
    assert changed is None, "other recordings have not been audited"


def test_a_shift_without_room_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("DSE_CACHE", str(tmp_path / "cache"))
    space = write(tmp_path)
    assert main(["audit", str(space.source), "--shifts", "4", "9"]) == 2
    message = "no validation window of material can be moved by 4, 9 steps in its recording"
    assert capsys.readouterr().err.strip() == message


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"signal": np.zeros((0, 48, 3)), "label": np.zeros(0), "part": np.zeros(0), "force": np.zeros(0)},
            "offsets must be integers",
        ),
        ({"label": np.repeat([0, 1], 40)}, "class '1' is in validation but missing from train"),
    ],
)
def test_recordings_that_cannot_be_audited(changes, message, tmp_path):
    with pytest.raises(RecordingError, match=message):
        audit(write(tmp_path, **changes), tmp_path / "cache")


def test_a_first_design_that_its_encoder_refuses(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("DSE_CACHE", str(tmp_path / "cache"))
    space = write(tmp_path)
    monkeypatch.setattr(type(space), "resolve", refuse)
    assert main(["audit", str(space.source)]) == 2
    assert capsys.readouterr().err.strip() == "encoder: these do not go together"


def refuse(space, design):
    raise ValueError("encoder: these do not go together")


@pytest.mark.parametrize(
    ("encoder", "advice"),
    [
        ("{kind: receptors}", "window.remove_mean: true or"),
        ("{kind: send_on_delta, thresholds: [1]}", "drops it already"),
    ],
)
def test_run_and_audit_read_the_resting_level_alike(encoder, advice, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = SPACE.replace("{kind: send_on_delta, thresholds: {choice: [[1], [1, 2]]}}", encoder)
    write(tmp_path, level=8, text=text)
    rows = {row["probe"]: row for row in document(capsys, "audit", "felt.yaml")["rows"]}
    (note,) = (
        x for x in document(capsys, "run", "felt.yaml", "--quiet")["notes"] if x.startswith("resting level")
    )
    assert f"with accuracy {rows['resting level']['accuracy']:.3f} on validation" in note
    assert advice in note
    verdict = rows["resting level"]["verdict"]
    assert verdict.startswith("the resting level of the signals explains 100 %")
    assert ("(0 % of the spike counts follow it)" in verdict) == ("already" in advice)


def test_the_reader_that_validation_chooses_is_told_on_the_test_set(simulated):
    space, root = simulated
    found = audit(space, root)
    known = found.known("texture")
    rows = [row for row in found.rows if row.probe == "counts over time"]
    assert known.accuracy == max(row.accuracy for row in rows) and known.test is not None
    (design,) = gather.designs(space)
    read = gather.material(space, design, root)
    answered = read.on_test(known.reader)
    assert known.test == answered.accuracy == answered.correct.mean() and answered.n == len(read.test) == 4
    assert found.known("profile") is None


def test_an_audit_of_before_has_no_accuracy_on_the_test_set(tmp_path):
    found = audit(write(tmp_path), tmp_path / "cache")
    document = json.loads(json.dumps(record.plain(found)))
    assert record.of_plain(document) == found
    for row in document["rows"]:
        del row["test"], row["test_se"]
    assert record.of_plain(document) == found  # these recordings have no test set
