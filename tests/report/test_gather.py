"""Families against each other, and what a report says of its studies, from numbers that are chosen."""

import pandas as pd
import pytest

from dse import store
from dse.report.designs import tasks_of
from dse.report.gather import report
from dse.report.rows import FAMILIES
from tests.report.made import noted, rows_of, write


def test_families_meet_and_the_winner_is_named(tmp_path):
    names = ("accuracy", "n_weights", "energy_uj", "spikes_per_inference_no_input")
    numbers = [(0.90, 30_000, 3.0, 20.0), (0.89, 9_000, 2.0, 500.0), (0.80, 500, 0.1, 20.0)]
    designs = [dict(zip(names, each, strict=True)) for each in numbers]
    knn = {"accuracy": 0.95, "family": "knn", "macs": 80_000.0, "n_weights": 80_000, "energy_uj": 9.0}
    designs += [knn, {"accuracy": 1.0, "family": "knn", "transductive": True, "n_weights": 1}]
    designs = [{"hardware": "op_4.6_0.9", **design} for design in designs]
    found = report([write(tmp_path / "families", designs)])
    rows = rows_of(found, FAMILIES)
    assert {figure: (row.trial, row.ours) for figure, row in rows.items()} == {
        "best accuracy, spiking": (0, 0.90),
        "best accuracy, not spiking": (3, 0.95),
        "best accuracy, spiking, W_t <= 10000": (1, 0.89),
        "best accuracy, spiking, W_t <= 20000": (1, 0.89),
        "best accuracy, spiking, own spikes <= 400": (0, 0.90),
        "least W_t, spiking, within 0.02": (1, 9_000),
        "least W_t, not spiking, within 0.02": (3, 80_000),
        "least own spikes, spiking, within 0.02": (0, 20.0),
        "least energy_uj, spiking, within 0.02": (1, 2.0),
        "least energy_uj, not spiking, within 0.02": (3, 9.0),
    }
    [verdict] = [note for note in found.notes if note.startswith("texture on tiny.npz: ")]
    assert "accuracy: not spiking wins (knn 0.95 against snn 0.9)" in verdict
    assert "least W_t: spiking wins (9000 against 80000)" in verdict


def test_designs_of_different_splits_do_not_meet(tmp_path):
    other = {"split": {"stratified": {"validation": 0.5, "group": None, "seed": 1}}}
    one = write(tmp_path / "nets", [{"accuracy": 0.9}])
    two = write(tmp_path / "others", [{"accuracy": 0.8, "family": "knn", "macs": 1.0}], other)
    found = report([one, two])
    assert not rows_of(found, FAMILIES)
    assert noted(found, "texture on tiny.npz: spiking and other designs use different splits")
    [part] = tasks_of(two)
    assert part.split == "stratified: validation 0.5, test 0.0 (train 20, validation 10)"


def test_accuracies_within_their_errors_are_a_draw(tmp_path):
    designs = [{"accuracy": 0.9}, {"accuracy": 0.914, "family": "mlp", "macs": 1.0}]
    found = report([write(tmp_path / "x", designs)])
    assert noted(found, "accuracy: a draw (snn 0.9 against mlp 0.914); least W_t: a draw (100 against 100)")
    designs[1]["accuracy"] = 0.915  # the error of the difference is 0.0141
    assert noted(report([write(tmp_path / "y", designs)]), "accuracy: not spiking wins")


def test_a_study_whose_designs_all_failed_has_its_reason(tmp_path):
    found = report([write(tmp_path / "bad", [], failed=3)])
    assert found.rows == []
    assert noted(found, "bad: 3 of 3 designs failed; the first: ValueError: hidden must be kind")


def test_warnings_are_passed_on(tmp_path):
    written = write(tmp_path / "traps", [{"accuracy": 0.9}])
    told = ["labels are given away", "level 0.9 of 7", "level 0.8 of 7", "level 0.91 of 12"]
    store.keep(written.folder, store.WARNINGS, told)
    found = [note for note in report([written]).notes if "warning" in note]
    assert found == [
        "traps: warning: labels are given away",
        "traps: warning: level 0.9 of 7 (and 2 of the kind)",
    ]


def test_what_is_damaged_is_one_line(tmp_path):
    written = write(tmp_path / "damaged", [{"accuracy": 0.9}])
    store.run_file(written.folder, 0, 0).write_bytes(b"no run")
    with pytest.raises(store.StoreError, match=r"00000-0\.npz: cannot be read"):
        report([written])


@pytest.mark.parametrize(
    ("split", "told"),
    [
        (
            {"k_fold": {"k": 10, "group": None, "test": {"repetition": 1}, "seed": 1, "fold": 3}},
            "k-fold: k 10, test repetition 1 (train 20, validation 10)",
        ),
        ({"train": {"a": [0, 1, 2, 3, 4, 5]}, "validation": {"a": [6]}}, "train: a 0 to 5; validation: a 6"),
        ({"train": {"a": ["x", "y", "z", "u", "v"]}, "validation": {"a": "w"}}, 'train: a "x", "y", "z"'),
    ],
)
def test_splits_in_words(tmp_path, split, told):
    [part] = tasks_of(write(tmp_path / "s", [{"accuracy": 0.9}], {"split": split}))
    assert part.split.startswith(told)


def test_nothing_is_changed(tmp_path):
    assert report([]).rows == []
    written = write(tmp_path / "kept", [{"accuracy": 0.9}])
    before = {path: path.stat().st_mtime_ns for path in written.folder.rglob("*")}
    table = written.points()
    report([written])
    assert before == {path: path.stat().st_mtime_ns for path in written.folder.rglob("*")}
    pd.testing.assert_frame_equal(written.points(), table)


def test_accuracy_on_moved_windows_and_unseen_groups_stands_beside(tmp_path):
    honest = {"accuracy_shifted_se": 0.02, "accuracy_unseen_se": 0.03}
    names = ("accuracy", "accuracy_shifted", "accuracy_unseen", "family", "macs")
    numbers = [(0.6, 0.58, 0.5, "snn", 0.0), (0.5, 0.59, 0.4, "snn", 0.0)]
    numbers += [(0.9, 0.27, 0.5, "knn", 5.0), (0.8, 0.22, 0.2, "mlp", 5.0)]
    designs = [dict(zip(names, each, strict=True)) | honest for each in numbers]
    found = report([write(tmp_path / "families", designs)])
    rows = rows_of(found, FAMILIES)
    knn = rows["best accuracy, knn"]
    assert (knn.ours, knn.shifted, knn.shifted_se, knn.unseen, knn.unseen_se) == (0.9, 0.27, 0.02, 0.5, 0.03)
    assert [rows[f"best accuracy, {family}"].shifted for family in ("snn", "mlp")] == [0.58, 0.22]
    best = rows["best accuracy_shifted, spiking"]
    assert (best.trial, best.ours, best.se) == (1, 0.59, 0.02)
    assert noted(found, "accuracy: not spiking wins (knn 0.9 against snn 0.6)")
    assert noted(found, "accuracy_shifted: spiking wins (snn 0.59 against knn 0.27)")
    assert noted(found, "accuracy_unseen: a draw (snn 0.5 against knn 0.5)")
