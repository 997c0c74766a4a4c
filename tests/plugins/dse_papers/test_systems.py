"""Rows of published systems beside studies whose every number is chosen."""

from pathlib import Path

import numpy as np
import pytest

from dse import store
from dse.measure.objectives.accuracy import wilson_se
from dse.show.report.gather import report
from dse_papers.report.papers import publication, publication_of, systems
from tests.rewriting import damage_part
from tests.show.report.made import noted, rows_of, write


def test_every_printed_system_has_a_title_a_source_and_families():
    from dse.base import registry

    references = (Path(__file__).resolve().parents[3] / "REFERENCES.md").read_text(encoding="utf-8")
    assert list(systems()) == list("ABCDEFG")
    for name, system in systems().items():
        assert f"**{system.source}**" in references, name
        assert set(system.families) <= set(registry.known("models")), name
        assert set(system.families) <= set(publication_of(name).holds.families), name
    lengths = publication("000")
    settings = ("accuracy", "t_p_ms", "theta_p", "phi_p", "t_h_ms", "theta_h", "phi_h")
    assert {tuple(lengths.table(name)) for name in settings} == {tuple(lengths.table("accuracy"))}


def test_the_mean_of_several_runs_goes_before_a_lucky_one(tmp_path):
    knn = {"family": "knn", "macs": 5.0}
    designs = [
        {"accuracy": 0.92, **knn, "accuracy_se": 0.04},
        {"runs": [0.85, 0.95], **knn, "accuracy_se": 0.03, "accuracy_test": 0.7, "t_c_ms": 300.0},
        {"runs": [0.84, 0.95], **knn, "accuracy_se": 0.03},
        {"runs": [0.4, 0.4, 0.4], **knn, "accuracy_se": 0.0},
        {"accuracy": 0.95, "family": "mlp", "macs": 5.0, "t_c_ms": np.nan},
        {"runs": [0.5, 0.5, 0.5], "family": "mlp", "macs": 5.0, "accuracy_se": 0.0},
    ]
    found = report([write(tmp_path / "windows", designs)])
    rows = rows_of(found, "B")
    knn_row = rows["accuracy, knn"]
    assert (knn_row.trial, knn_row.ours, knn_row.runs, knn_row.test) == (1, pytest.approx(0.9), 2, 0.7)
    assert (knn_row.published, knn_row.study, knn_row.family) == ("0.91; natural 0.6875", "windows", "knn")
    assert (rows["t_c_ms, knn"].published, rows["t_c_ms, knn"].ours) == ("500; natural 500", 300)
    # Three runs of half the accuracy are no match for one.
    assert rows["t_c_ms, mlp"].ours is None and rows["accuracy, mlp"].ours == 0.95
    assert "accuracy, naive_bayes" not in rows
    assert knn_row.split == "train: repetition 0 1; validation: repetition 2 (train 20, validation 10)"
    assert noted(found, "no designs for these systems: A (snn), C (hots)")


def test_runs_that_agree_leave_the_error_of_few_recordings(tmp_path):
    designs = [
        {"runs": [0.6, 0.6], "family": "hots", "macs": 2.0, "accuracy_se": 0.0, "model": {"layers": 1}}
    ]
    [row] = rows_of(report([write(tmp_path / "same", designs)]), "C").values()
    assert row.se == pytest.approx(float(wilson_se(6, 10)))


def test_lengths_stand_beside_the_printed_ones(tmp_path):
    designs = [
        {
            "decision_latency_ms": ms,
            "accuracy": accuracy,
            "t_p_ms": 40.0,
            "t_p_test_ms": 44.0,
            "t_h_ms": np.nan,
        }
        for ms, accuracy in ((100.0, 0.5), (200.0, 0.6), (200.0, 0.7), (1000.0, 0.9))
    ]
    rows = rows_of(report([write(tmp_path / "lengths", designs)]), "A")
    # 100 of 1000 ms is as much of the longest as 500 of 5000.
    assert rows["accuracy, 100 ms (printed: 500 ms)"].published == 0.85
    assert rows["accuracy, 200 ms (printed: 1000 ms)"].ours == 0.7
    longest = rows["accuracy, 1000 ms (printed: 5000 ms)"]
    assert (longest.published, longest.trial) == (0.94, 3)
    time = rows["t_p_ms, 1000 ms (printed: 5000 ms)"]
    assert (time.published, time.ours, time.test) == (2459, 40, 44)
    assert rows["phi_p, 1000 ms"].test is None
    peak = rows["peak over phi and theta, 1000 ms"]
    assert (peak.published, peak.ours, peak.se) == (0.94, 0.97, None)
    settings = {name: rows[f"{name}, 1000 ms"] for name in ("phi_p", "theta_p", "phi_h", "theta_h")}
    assert [row.published for row in settings.values()] == [1800, 0.3, 675, 0.3]
    assert {row.ours for row in settings.values()} == {7.0}
    assert rows["t_h_ms, 1000 ms (printed: 5000 ms)"].ours is None
    early = rows["accuracy, longest net read out at 250 ms"]
    assert (early.trial, early.ours, early.test, early.se) == (3, 0.45, 0.1, 0.02)
    assert rows["t_p_ms, longest net read out at 250 ms"].ours == 1
    assert rows["power of GPU, W: idle; beyond; in all"].published == "28; 18; 46.39"


def test_a_single_length_is_compared_as_it_is(tmp_path):
    rows = rows_of(
        report([write(tmp_path / "one", [{"accuracy": 0.5, "hardware": "chip", "n_cores": 4}])]), "A"
    )
    assert rows["accuracy, 1000 ms (printed: 1000 ms)"].published == 0.93
    assert not any("read out at" in figure or figure.startswith("t_p") for figure in rows)
    cores = rows["n_cores, chip (printed: of 120)"]
    assert (cores.published, cores.ours) == (68, 4)


def test_hots_by_its_layers(tmp_path):
    designs = [
        {"family": "hots", "macs": 9.0, "accuracy": accuracy, "model": {"layers": layers}}
        for layers, accuracy in ((1, 0.6), (1, 0.8), (3, 0.9))
    ]
    rows = rows_of(report([write(tmp_path / "hots", designs)]), "C")
    assert {figure: (row.published, row.ours) for figure, row in rows.items()} == {
        "accuracy, 1 layer": ("0.76; natural 0.61", 0.8),
        "accuracy, 3 layers": ("0.4; natural 0.5", 0.9),
    }


def test_ends_of_the_front_and_rank_correlations(tmp_path):
    designs = [
        {
            "accuracy": accuracy,
            "n_weights": 10 * n,
            "spikes_per_inference_no_input": spikes / 10,
            "spikes_total_no_input": spikes,
            "model.hidden": 4 * n,
            "model": {"hidden": [4 * n]},
        }
        for n, accuracy, spikes in ((1, 0.5, 300), (2, 0.6, 100), (3, 0.9, 900))
    ]
    rows = rows_of(report([write(tmp_path / "grid", designs)]), "D")
    assert (rows["best accuracy: accuracy"].published, rows["best accuracy: accuracy"].ours) == (0.95, 0.9)
    assert (rows["least spikes: accuracy"].published, rows["least spikes: accuracy"].trial) == (0.68, 1)
    assert (rows["least weights: n_weights"].published, rows["least weights: n_weights"].ours) == (0.15e6, 10)
    assert rows["least spikes: spikes_total_no_input (printed S)"].ours == 100
    assert (rows["best accuracy: hidden"].published, rows["best accuracy: hidden"].ours) == (425, 12)
    assert rows["best accuracy: accuracy"].design == "hidden 12"
    weights = rows["Spearman of accuracy and n_weights, 3 designs"]
    assert (weights.published, weights.ours) == (0.51, 1.0)
    assert rows["Spearman of accuracy and spikes, 3 designs"].ours == 0.5


def test_profiles_are_the_other_system_and_counted_by_kind(tmp_path):
    task = {"task": {"name": "profile", "target": "profile"}}
    found = report([write(tmp_path / "profiles", [{"accuracy": 0.8, "task": "profile"}] * 2, task)])
    rows = rows_of(found, "E")
    assert not rows_of(found, "D") and not rows_of(found, "A")
    constant, triangular = (rows[f"best accuracy: {kind} profiles"] for kind in ("constant", "triangular"))
    # Of ten samples of the constant profiles seven are right, of five triangular ones three.
    assert (constant.published, constant.ours, constant.test) == (0.95, 0.7, 1.0)
    assert (triangular.published, triangular.ours) == (0.78, 0.6)
    assert not any("accelerating" in figure for figure in rows)
    # A constant column has no ranks.
    assert rows["Spearman of accuracy and n_weights, 2 designs"].ours is None
    assert noted(found, "published figures are for textures, those of E for velocity profiles")


def test_a_joint_net_is_marked_under_both_systems(tmp_path):
    heads = {
        name: {"classes": ["constant 20", "b", "c"], "of_class": [0, 1, 2]} for name in ("texture", "profile")
    }
    designs = [
        {"accuracy": 0.7, "task": "texture"},
        {"accuracy": 0.6, "task": "texture", "family": "cascade"},
    ]
    written = write(tmp_path / "joint", designs, heads=heads, of_heads={"texture": {}, "profile": {}})
    rows = rows_of(report([written]), "D")
    assert rows["joint net: best accuracy: accuracy"].ours == 0.7
    assert rows["cascade: best accuracy: accuracy"].ours == 0.6
    assert not any(figure.startswith("best") for figure in rows)
    assert noted(report([written]), "joint, texture: predicted by classifiers of several tasks")


def leaky(accuracy, family, **more):
    return {"accuracy": accuracy, "family": family, "transductive": True, **more}


def test_the_size_of_a_leak_is_told_and_the_leak_nowhere_else(tmp_path):
    designs = [
        leaky(1.0, "threshold_lif", first_spike_ms=30.0),
        {"accuracy": 0.7, "family": "threshold_lif", "first_spike_ms": 90.0},
        leaky(0.9, "snn"),
    ]
    found = report([write(tmp_path / "leaks", designs)])
    rows = rows_of(found, "F")
    as_printed = rows["accuracy, as printed (transductive)"]
    assert (as_printed.published, as_printed.ours, as_printed.trial) == (1.0, 1.0, 0)
    assert (rows["accuracy, honest"].published, rows["accuracy, honest"].ours) == (None, 0.7)
    leak = rows["size of the leak (as printed less honest)"]
    assert leak.ours == pytest.approx(0.3) and leak.se == pytest.approx(np.hypot(0.01, 0.01))
    assert rows["first_spike_ms, mean, as printed (transductive)"].published == "20 to 140"
    assert rows["first_spike_ms, mean, honest"].ours == 90
    assert not rows_of(found, "D") and not rows_of(found, "A"), "a leak is no answer of ours"
    assert noted(
        found,
        "leaks, texture: 2 transductive designs appear only in rows marked as such: windows of a recording",
    )


def test_a_leak_of_the_split_is_measured_across_studies(tmp_path):
    model = {"model": {"hidden": 64}, "itr_bits": 2.5, "itr_bits_per_s": 5.0, "t_c_ms": 400.0, "macs": 7.0}
    one = write(tmp_path / "apart", [{"accuracy": 0.8, "family": "elm", **model}])
    other = write(tmp_path / "mixed", [leaky(0.95, "elm", **model)])
    rows = rows_of(report([one, other]), "G")
    as_printed = rows["accuracy, as printed (transductive)"]
    assert (as_printed.published, as_printed.ours, as_printed.study) == (0.92, 0.95, "mixed")
    assert rows["size of the leak (as printed less honest)"].ours == pytest.approx(0.15)
    assert rows["itr_bits, honest"].ours == 2.5 and rows["t_c_ms, honest"].ours == 400
    assert (rows["hidden nodes"].published, rows["hidden nodes"].ours) == (128, 64)
    time = rows["time of the highest accuracy, ms"]
    assert (time.published, time.ours) == (1000, 500)
    # An encoder that reads labels is the leak of another system.
    encoder = {"encoder": {"kind": "threshold", "matching": "own_label"}}
    fourth = write(tmp_path / "read", [leaky(0.99, "elm", **model)], encoder)
    rows = rows_of(report([one, fourth]), "G")
    assert rows["accuracy, as printed (transductive)"].ours is None
    assert "size of the leak (as printed less honest)" not in rows
    # Another task's leak says nothing about this one.
    objects = {"task": {"name": "object", "target": "object"}}
    third = write(tmp_path / "objects", [leaky(0.99, "elm", **model, task="object")], objects)
    rows = {
        row.task: row for row in report([one, third]).rows if row.figure.startswith("accuracy, as printed")
    }
    assert (rows["texture"].ours, rows["object"].ours) == (None, 0.99)


def test_a_system_without_the_printed_leak_shows_the_printed_figure(tmp_path):
    rows = rows_of(report([write(tmp_path / "honest", [{"accuracy": 0.8, "family": "threshold_lif"}])]), "F")
    assert {figure: (row.published, row.ours) for figure, row in rows.items()} == {
        "accuracy, as printed (transductive)": (1.0, None),
        "accuracy, honest": (None, 0.8),
    }


def test_what_is_damaged_is_one_line(tmp_path):
    written = write(tmp_path / "damaged", [{"accuracy": 0.9, "t_p_ms": 3.0}])
    damage_part(store.run_file(written.folder, 0, 0), "read_out.npz")
    with pytest.raises(store.StoreError, match=r"00000-0\.npz/read_out\.npz: cannot be read"):
        report([written])
