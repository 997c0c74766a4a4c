"""Published designs beside a study: no number but what the report prints beside it, and that all of them."""

import re

import pytest
import yaml

from dse.config import shipped_spaces
from dse.show.report.gather import gather_marks, report
from dse_papers.report.papers import systems as published
from tests import tiny_study
from tests.show.report.made import write

# What the report calls the printed figure of each column.
FIGURES = {
    "accuracy": "accuracy",
    "decision_latency_ms": "t_p_ms, ",
    "t_p_ms": "t_p_ms, ",
    "t_h_ms": "t_h_ms, ",
    "phi": "phi_p, ",
    "theta": "theta_p, ",
    "n_cores": "n_cores, ",
    "t_c_ms": "t_c_ms, ",
    "n_weights": ": n_weights",
    "spikes_total_no_input": ": spikes_total_no_input (printed S)",
}


def study_of(folder, space):
    """Return a made-up study of the families of a shipped search space."""
    model = yaml.safe_load(shipped_spaces()[space].read_text(encoding="utf-8"))["model"]
    kinds = [entry["kind"] for entry in model["choice"]] if "choice" in model else [model["kind"]]
    times = {"t_p_ms": 40.0, "t_h_ms": 20.0, "n_cores": 3, "hardware": "chip"}
    designs = [
        {"accuracy": 0.7, "family": kind, "model": {"layers": layers} if kind == "hots" else {}}
        | (times if kind == "snn" else {"hardware": "chip"})
        for kind in kinds
        for layers in ((1, 2, 3) if kind == "hots" else (1,))
    ]
    return write(folder, designs)


def printed(row):
    """Return the numbers that a row prints."""
    if isinstance(row.published, str):
        return {float(text) for text in re.findall(r"\d+(?:\.\d+)?", row.published)}
    return set() if row.published is None else {float(row.published)}


@pytest.mark.parametrize(
    ("space", "systems"),
    [
        ("sample_length", "AD"),
        ("rate_windows", "B"),
        ("hots", "C"),
        ("receptors_elm", "G"),
        ("threshold_lif", "F"),
        ("texture_profile_grid", "AD"),
        ("hardware_fabric_texture", "ABDG"),
    ],
)
def test_marks_are_what_the_report_prints(tmp_path, space, systems):
    study = study_of(tmp_path / space, space)
    marks = gather_marks(study)
    rows = [row for row in report([study]).rows if row.system in published()]
    assert "".join(dict.fromkeys(mark["name"][0] for mark in marks)) == systems
    assert {(mark["name"][0], mark["task"]) for mark in marks} == {(r.system, r.task) for r in rows if r.task}
    for mark in marks:
        beside = [row for row in rows if (row.system, row.task) == (mark["name"][0], mark["task"])]
        for column, value in mark["values"].items():
            figures = [row for row in beside if FIGURES[column] in row.figure]
            assert value in set().union(*map(printed, figures)), (mark["name"], column)
        assert mark["source"] == published()[mark["name"][0]].source
        assert (
            f"published ({mark['source']}), on recordings that are " in mark["caption"]
            and "; not reproduced" in mark["caption"]
        )


def named(study):
    return {mark["name"]: mark for mark in gather_marks(study)}


def test_lengths_are_those_that_the_report_sets_beside(tmp_path):
    designs = [
        {"accuracy": 0.7, "decision_latency_ms": ms, "t_p_ms": 40.0, "t_h_ms": 20.0} for ms in (100.0, 1000.0)
    ]
    marks = named(write(tmp_path / "lengths", designs))
    # 100 of 1000 ms is as much of the longest as 500 of 5000; figures of Table I.
    assert [name for name in marks if name.startswith("A")] == [
        "A, samples of 500 ms",
        "A, samples of 5000 ms",
    ]
    assert marks["A, samples of 500 ms"]["values"] == {
        "accuracy": 0.85,
        "decision_latency_ms": 298,
        "phi": 200,
        "theta": 0.3,
        "t_p_ms": 298,
        "t_h_ms": 135,
    }
    without = named(write(tmp_path / "no_grid", [{"accuracy": 0.7}]))
    assert without["A, samples of 1000 ms"]["values"] == {"accuracy": 0.93}


def test_ends_of_the_published_front(tmp_path):
    profile = {"task": {"name": "profile", "target": "profile"}}
    marks = named(write(tmp_path / "profiles", [{"accuracy": 0.8, "task": "profile"}], profile))
    assert list(marks) == ["E, best accuracy", "E, least spikes", "E, least weights"]
    assert marks["E, least spikes"]["values"] == {
        "accuracy": 0.42,
        "spikes_total_no_input": 0.08e6,
        "n_weights": 0.15e6,
    }
    assert "hidden 450 and true_rate 0.3" in marks["E, best accuracy"]["caption"]


def test_a_joint_net_stands_beside_the_nets_of_one_task(tmp_path):
    heads = {"texture": {"classes": ["a", "b", "c"], "of_class": [0, 1, 2]}}
    designs = [{"accuracy": 0.7}, {"accuracy": 0.6, "family": "cascade"}]
    marks = named(write(tmp_path / "joint", designs, heads=heads, of_heads={"texture": {}}))
    assert list(marks) == ["D, best accuracy", "D, least spikes", "D, least weights"]


def test_a_leak_and_another_task_are_told(tmp_path):
    profile = {"task": {"name": "profile", "target": "profile"}}
    designs = [
        {"accuracy": 0.8, "task": "profile", "family": "elm", "macs": 1.0, "model": {"hidden": 64}},
        {"accuracy": 0.8, "task": "profile", "family": "knn", "macs": 1.0},
    ]
    marks = named(write(tmp_path / "other", designs, profile))
    assert "transductive: it has seen the labels" in marks["G"]["caption"]
    assert all("for textures, not for movements" in mark["caption"] for mark in marks.values())
    assert marks["B, knn on natural textures"]["values"] == {"accuracy": 0.6875, "t_c_ms": 500}


def test_an_unrelated_study_has_none(tmp_path):
    designs = [{"accuracy": 0.9, "family": "fake"}, {"accuracy": 1.0, "transductive": True}]
    tiny_study.register()
    assert gather_marks(write(tmp_path / "own", designs)) == []
    assert gather_marks(write(tmp_path / "failed", [], failed=2)) == []
