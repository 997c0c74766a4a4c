"""What a plain reader knows of the recordings stands beside what networks answer."""

import numpy as np

from tests.command import document
from tests.installed import needs_papers
from tests.tiny_study import write_recordings

SPACE = """\
study: tiny
seed: 7
data: {kind: raster, file: tiny.npz, step_ms: 5.0, columns: {fabric: label}, class_names: {fabric: names}}
task: {target: fabric}
split: {stratified: {validation: 0.3, test: 0.3}}
model: {kind: naive_bayes, window_ms: 50}
hardware: [op_4.6_0.9]
objectives: [accuracy:max, n_weights:min]
execution: {jobs: 1}
"""


@needs_papers
def test_audit_run_and_report(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("DSE_CACHE", str(tmp_path / "cache"))
    write_recordings(tmp_path / "tiny.npz")
    path = tmp_path / "tiny.yaml"
    path.write_text(SPACE, encoding="utf-8")
    space = str(path)
    results = str(tmp_path / "results")

    def rows_and_notes(*arguments):
        answer = document(capsys, *arguments)
        return answer["rows"], answer["notes"]

    rows_and_notes("run", space, "--results", results)
    rows, notes = rows_and_notes("report", results + "/tiny")
    assert "reader" not in rows[0] and sum("is not recorded" in note for note in notes) == 1
    audited, _ = rows_and_notes("audit", space)
    rows_and_notes("run", space, "--results", results)
    rows, notes = rows_and_notes("report", results + "/tiny")
    knows = [row for row in audited if row["probe"] == "counts over time"]
    best = max(knows, key=lambda row: row["accuracy"])
    shown = [row for row in rows if row["figure"].startswith("accuracy") and row["ours"] is not None]
    assert shown and {row["reader"] for row in shown} == {best["test"]} and np.isfinite(best["test"])
    assert {row["reader_se"] for row in shown} == {best["test_se"]}
    assert not any("is not recorded" in note for note in notes)
