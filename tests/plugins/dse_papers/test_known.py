"""What a plain reader knows of the recordings stands beside what networks answer."""

from pathlib import Path

import pytest

from dse import store
from dse.data.recordings.scene import SceneTrials
from dse.study.audit import Audit, AuditRow, record
from dse_papers.report.compare import paper_report
from tests.show.report.made import write

KEY = "of the data set"


def study_of(folder, known=None, key=KEY, **design):
    """Return a study of printed profiles whose network answers 0.229, and a plain reader `known`."""
    study = write(
        folder,
        [{"task": "profile", "accuracy": 0.25, "accuracy_test": 0.229, **design}],
        {
            "data": {"kind": "scene", "scene": "neurotac_dvxplorer", "trials": 13},
            "task": {"target": "profile"},
            "preprocessing": {"bin_ms": 1, "pool": 4, "exceeds": True, "polarity": "merge"},
        },
        classes=sorted(
            set(map(str, SceneTrials(scene="neurotac_dvxplorer").read(Path()).columns["profile"]))
        ),
        samples={"train": 1008, "validation": 432, "test": 432},
        data=KEY,
    )
    if known is not None:
        row = AuditRow(
            *("profile", "counts over time", "trees", known, 0.02, 1 / 12, None, None, 432, False, "", ""),
            test=known,
            test_se=0.018,
            data=key,
        )
        store.keep(folder, record.DOCUMENT, record.plain(Audit((row,), ())))
    return study


def best_accuracy(study):
    rows = paper_report([study], "002").rows
    return next(x for x in rows if (x.quantity, x.condition) == ("accuracy", "movement, best accuracy"))


def test_a_network_far_below_its_data_is_told_so_and_set_ups_are_no_cause(tmp_path):
    row = best_accuracy(study_of(tmp_path / "low", known=0.83))
    assert "trees" in row.causes and "0.830 ± 0.018 on test" in row.causes and "learnt" in row.causes
    gap, _, reasons = row.differs.partition(": ")
    assert gap == "0.6 below" and reasons.startswith(row.causes) and "; set-up: " in reasons
    assert row.setup and "trials of each texture and profile" not in row.causes


def test_data_that_no_reader_knows_more_of_are_named_instead(tmp_path):
    row = best_accuracy(study_of(tmp_path / "scene", known=0.24))
    assert "0.240" in row.causes and "learnt" not in row.causes


@pytest.mark.parametrize(("known", "key"), [(None, KEY), (0.83, "of other windows")])
def test_without_a_measurement_no_cause_is_printed(tmp_path, known, key):
    row = best_accuracy(study_of(tmp_path / "old", known, key))
    assert row.causes == "" and row.differs.startswith("0.6 below: set-up: ")


def test_states_beyond_24_bits_are_a_cause(tmp_path):
    over = {"overflows_24_bit": True, "peak_state": 2**24, "peak_thresholds": 3277.0}
    row = best_accuracy(study_of(tmp_path / "over", **over))
    assert "3277 thresholds, and 24 bits hold 1638" in row.causes
