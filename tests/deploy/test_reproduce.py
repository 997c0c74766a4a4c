"""A bundle trained once more from what it states."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from dse.cli import main
from dse.data.recordings import RecordingError
from dse.deploy import bundle
from dse.deploy.bundle import BundleError
from dse.deploy.export import bundle_of, export
from dse.deploy.reproduce import reproduce
from dse.deploy.statement import digest
from dse.store import StoreError
from tests import tiny_study
from tests.deploy.bundles import FAMILIES, explored


@pytest.fixture(scope="module")
def studies(tmp_path_factory):
    """A network trained twice, read at several precisions, and several families on folds."""
    precisions = f"{tiny_study.REAL}precision: {{weight_bits: [3, 8], within: 1}}\n"
    on_folds = FAMILIES.replace("split: {stratified: {validation: 0.5}}", "split: {k_fold: {k: 2, seed: 1}}")
    return [explored(tmp_path_factory.mktemp("study"), text) for text in (precisions, on_folds)]


def base_of(study):
    return study.folder.parents[1]


def test_every_design_is_the_same_bit_for_bit(studies, tmp_path):
    for study in studies:
        for trial in study.trials["trial"]:
            made = export(study, {"trial": int(trial)}, tmp_path / "bundle")
            found = reproduce(tmp_path / "bundle", base_of(study))
            assert (found.kind, found.first, found.largest_difference) == ("identical", "", 0), trial
            assert found.sha256 == digest(bundle.weights(made.fitted)) and not found.changed
    network = studies[0]
    point = {"trial": 0, "task": "fabric", "weight_bits": 3, "pruned_after": 0.0}
    fewer = export(network, point, tmp_path / "bundle")
    again = export(network, {"trial": 0}, tmp_path / "again", refit=("train", "validation"))
    for folder, made in (("bundle", fewer), ("again", again)):
        found = reproduce(tmp_path / folder, base_of(network))
        assert found.kind == "identical" and found.sha256 == digest(bundle.weights(made.fitted))
    assert reproduce(network.folder).kind == reproduce(network.folder, trial=0).kind == "identical"


def test_the_first_number_that_differs_is_named(studies, tmp_path, capsys, monkeypatch):
    made = bundle_of(studies[0], {"trial": 0})
    first = made.fitted.layers[0]
    weight = first.weight.copy()
    weight[2, 1] += 0.5
    changed = replace(made.fitted, layers=(replace(first, weight=weight), *made.fitted.layers[1:]))
    versions = made.evidence["environment"][-1] | {"python": "2.7.18"}
    evidence = {**made.evidence, "environment": [versions]}
    bundle.write(replace(made, fitted=changed, evidence=evidence), tmp_path / "bundle")
    monkeypatch.chdir(base_of(studies[0]))
    found = reproduce(tmp_path / "bundle")
    assert found.kind == "different" and found.first.startswith("0/weight[2, 1] is ")
    assert found.largest_difference == pytest.approx(0.5 / np.abs(weight).max(), rel=0.01)  # or in 8 bits
    assert [text.split()[0] for text in found.changed] == ["python"]
    assert main(["reproduce", str(tmp_path / "bundle")]) == 4
    assert "0/weight[2, 1]" in capsys.readouterr().out
    weight[2, 1] = np.nextafter(first.weight[2, 1], 9, dtype=weight.dtype)
    assert reproduce(replace(made, fitted=changed)).kind == "close"


def test_what_cannot_be_reproduced_is_said_in_a_line(studies, tmp_path, capsys):
    study = studies[0]
    made = export(study, {"trial": 0}, tmp_path / "bundle")
    (tmp_path / "others").mkdir()
    with np.load(base_of(study) / "tiny.npz") as file:
        np.savez(tmp_path / "others" / "tiny.npz", **{**file, "label": file["label"][::-1]})
    for data, kind, message in (
        (None, RecordingError, "are not found; name them with --data"),
        (tmp_path / "others", RecordingError, "are others"),
        (tmp_path / "others" / "tiny.npz", RecordingError, "are others"),
        (tmp_path / "absent", RecordingError, "no such file or folder"),
    ):
        with pytest.raises(kind, match=message):
            reproduce(tmp_path / "bundle", data)
    (tmp_path / "moved.npz").write_bytes((base_of(study) / "tiny.npz").read_bytes())
    assert reproduce(tmp_path / "bundle", tmp_path / "moved.npz").kind == "identical"
    for key, value, message in (
        ("design", 3, "design must be a mapping"),
        ("seed", -1, "seed must be >= 0"),
        ("refit", ["all"], r"unknown refit\[0\] 'all'"),
        ("precision", {"weight_bits": 3}, "precision.pruned is required"),
    ):
        with pytest.raises(BundleError, match=message):
            reproduce(replace(made, evidence={**made.evidence, key: value}), base_of(study))
    with pytest.raises(BundleError, match="recordings is required"):
        reproduce(replace(made, evidence={x: made.evidence[x] for x in ("seed", "design", "repeat")}))
    tables = shutil.copytree(studies[0].folder, tmp_path / "tables", ignore=shutil.ignore_patterns("runs"))
    with pytest.raises(StoreError, match="trial 0: the folder holds tables alone, not the runs"):
        reproduce(tables, trial=0)
    with pytest.raises(BundleError, match="has no trial 9"):
        reproduce(study.folder, trial=9)
    assert main(["reproduce", str(tmp_path / "bundle"), "--trial", "0"]) == 2
    assert main(["reproduce", str(tmp_path / "nothing")]) == 2
    assert capsys.readouterr().err.count("\n") == 2


def test_equal_arrays_have_one_digest():
    arrays = {"a": np.arange(3, dtype=np.int32), "b": np.ones((2, 2), np.float32)}
    swapped = {"b": arrays["b"].astype(">f4"), "a": arrays["a"].astype(">i4")}
    assert digest(arrays) == digest(swapped)
    others = (
        {**arrays, "a": arrays["a"] + 1},
        {**arrays, "a": arrays["a"].astype(np.int64)},
        {"c": arrays["b"]},
    )
    assert len({digest(x) for x in (arrays, *others)}) == 4
