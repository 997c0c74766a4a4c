import dataclasses
import functools

import numpy as np
import pytest

from dse.config.settings import Window
from dse.study.audit import Levels, probe, readers, rows
from tests.study.audit import planted


def audited(material):
    """Return the rows by name, of two readers the one that has found more."""
    probed, _ = probe(material)
    return {row.probe: row for row in sorted(probed, key=lambda row: row.shortcut)}


@functools.cache
def audit_of(made, seed=0):
    return audited(made(seed))


@pytest.mark.parametrize(("made", "seed"), [(planted.clean, 0), (planted.synchronous, 0)])
def test_clean_recordings_have_no_shortcut(made, seed):
    assert not any(row.shortcut for row in audit_of(made, seed).values())


def test_clean_recordings_are_read_wherever_the_window_lies():
    audit = audit_of(planted.clean)
    assert audit["counts over time"].accuracy > 0.9
    assert audit["position in time"].without > 0.9
    assert audit["position in time"].verdict.startswith("it holds")
    assert audit["unseen force"].without > 0.9


def test_what_a_frame_of_many_channels_knows_is_read_from_its_regions(monkeypatch):
    """Single channels tell little: logistic regression on 16 bins of each reads 0.742, nearest 0.425."""
    monkeypatch.setattr(readers, "N_TREES", 200)
    monkeypatch.setattr(planted, "REPEATS", 2)
    material = planted.by_rate_of_regions(0)
    assert material.best.reader == readers.TREES and material.best.accuracy > 0.85
    again = dataclasses.replace(material)
    assert np.array_equal(again.best.correct, material.best.correct)


def test_regions_are_cells_of_the_frame_and_few_channels_are_their_own():
    y, x = np.divmod(np.arange(64), 8)
    frame = np.stack([x, y, 0 * x], axis=1)
    region = readers.regions(frame, 2).reshape(8, 8)
    assert len(np.unique(region)) == 4 and (region[:4, :4] == region[0, 0]).all()
    assert readers.regions(frame, 12).tolist() == list(range(64))
    assert not readers.regions(frame, 1).any()
    row = np.stack([np.arange(64), 0 * x, 0 * x], axis=1)
    assert readers.regions(row, 2).tolist() == np.repeat(range(4), 16).tolist()
    planes = np.concatenate([row, row + np.array([0, 0, 1])])
    assert len(np.unique(readers.regions(planes, 2))) == 8


@pytest.mark.parametrize(
    ("made", "name", "remedy", "others"),
    [
        (planted.by_total, "spike total", "encoder", set()),
        (planted.by_end, "active part of the window", "window.n_steps", {"spike total", "position in time"}),
        (
            planted.by_contact,
            "before contact",
            "contact_onset",
            {"spike total", "active part of the window", "position in time"},
        ),
        (planted.by_position, "position in time", "shifts: [8, -8]", {"active part of the window"}),
        (planted.by_condition, "twins", "leave_out", {"unseen force", "unseen speed"}),
        (planted.by_group, "unseen force", "leave_out: force", {"twins"}),
        (planted.by_session, "identity: session", "leave_out: session", {"twins"}),
        (planted.by_order, "identity: trial", "blocks of trial", set()),
    ],
)
def test_a_planted_shortcut_is_found(made, name, remedy, others, monkeypatch):
    monkeypatch.setattr(planted, "REPEATS", 1 + (made is planted.by_order))  # which needs an order to see
    audit = audit_of(made)
    assert audit[name].shortcut, audit[name]
    assert remedy in audit[name].remedy
    assert {name for name, row in audit.items() if row.shortcut} - {name} <= others


def test_position_is_found_by_its_loss():
    row = audit_of(planted.by_position)["position in time"]
    assert row.accuracy > 0.9 and row.without < 0.6
    assert "(windows moved by +8 or -8 steps, 40 ms)" in row.verdict


def test_crops_hide_the_position_within_their_range_only():
    material = dataclasses.replace(planted.by_position(0), window=Window(8, jitter_steps=2))
    probed, _ = probe(material, shifts=[2, 8])
    within, beyond = (row for row in probed if row.reader == "nearest, crops")
    assert not within.shortcut and within.without > 0.8
    assert beyond.shortcut and beyond.without < 0.6


def test_one_row_per_reader_and_shift():
    probed, _ = probe(planted.clean(0), shifts=[0, 3])
    assert [row.reader for row in probed if row.probe == "position in time"] == ["trees"] * 2 + [
        "nearest"
    ] * 2


def test_windows_without_room_have_no_row_of_position():
    material = planted.clean(0)
    still = dataclasses.replace(
        material.dataset, start_low=material.dataset.start, start_high=material.dataset.start
    )
    probed, notes = probe(dataclasses.replace(material, dataset=still))
    assert "position in time" not in {row.probe for row in probed}
    assert "material: windows have no room to move in their recordings" in notes


def test_recordings_that_name_their_class():
    material = planted.clean(0)
    label = material.columns["label"]
    audit = audited(planted.with_columns(material, {"recording": label + 10}))
    assert audit["identity: recording"].shortcut
    assert audit["identity: recording"].reader == "look-up of recording"
    assert "cannot be told apart" in audit["identity: recording"].verdict


def test_windows_with_common_steps():
    material = planted.by_condition(0)
    number = np.arange(len(material.columns["label"]))
    shared = {"recording": number // 2, "window": number % 2}
    material = dataclasses.replace(
        planted.with_columns(material, shared),
        window=Window(cut_steps=4, every_steps=2),
        leak="windows with common steps of one recording",
    )
    row = audited(material)["label leak"]
    assert row.shortcut and row.verdict == material.leak and "group: recording" in row.remedy
    assert row.without is not None


def test_signals_that_rest_at_another_level():
    material = planted.clean(0)
    rng = np.random.default_rng(1)
    level = material.columns["label"][:, None] + rng.normal(0, 0.1, (len(material.columns["label"]), 2))
    none = np.zeros_like(level)
    as_before = dataclasses.replace(material.dataset.spikes)

    def cut(spikes):
        """Return the spikes of the windows, from step 0."""
        rows_of_samples = [
            np.arange(planted.N_STEPS) + i * spikes.n_steps + planted.ROOM for i in range(spikes.n_samples)
        ]
        dense = np.zeros((spikes.n_samples, planted.N_STEPS, spikes.n_channels), bool)
        for i, some in enumerate(rows_of_samples):
            for t, row in enumerate(some):
                dense[i, t, spikes.channel[spikes.row_offsets[row] : spikes.row_offsets[row + 1]]] = True
        return planted.spikes_of(dense)

    hidden = Levels(level, none, lambda constant, trend: cut(as_before))
    row = audited(dataclasses.replace(material, levels=hidden))["resting level"]
    assert not row.shortcut and "readers do without it (0 %" in row.verdict
    assert row.without == pytest.approx(audit_of(planted.clean)["counts over time"].accuracy, abs=0.1)
    silent = planted.spikes_of(np.zeros((len(level), planted.N_STEPS, planted.N_CHANNELS), bool))
    shown = Levels(level, level, lambda constant, trend: silent)
    audit = audited(dataclasses.replace(material, levels=shown))
    assert audit["resting level"].shortcut and audit["resting level"].remedy == "window.remove_mean: true"
    assert audit["drift"].shortcut
    assert "before contact" not in audit


def test_the_length_of_recordings_is_hidden_by_windows_of_one_length():
    material = planted.clean(0)
    lengths = 80 + 10 * material.columns["label"]
    row = audited(dataclasses.replace(material, lengths=lengths))["length of the recording"]
    assert row.accuracy == 1 and not row.shortcut
    assert row.verdict == "the length of a recording explains 100 %; windows of one length hide it"


def test_one_class_has_nothing_to_tell_apart():
    material = planted.clean(0)
    one = dataclasses.replace(material.dataset, target=np.zeros_like(material.dataset.target))
    probed, notes = probe(dataclasses.replace(material, dataset=one))
    assert probed == []
    assert notes == ["material: training has one class, so that there is nothing to tell apart"]


def test_constant_columns_and_single_samples():
    material = planted.with_columns(planted.clean(0), {"finger": np.zeros(240)})
    first = [int(np.flatnonzero(material.codes == code)[0]) for code in range(3)]
    few = dataclasses.replace(material, train=material.train[first], validation=material.validation[first])
    probed, notes = probe(few)
    assert not any(row.shortcut for row in probed)
    assert "material: training has one value of force, speed, finger" in notes


def test_silent_recordings():
    probed, notes = probe(planted.material_of(np.zeros(1), np.random.default_rng(0)))
    assert not any(row.shortcut for row in probed)
    assert any(note.startswith("material: no input spikes: no window has a spike") for note in notes)


def test_probabilities_by_hand():
    def score(right, n=10):
        return rows.Score("", np.arange(n) < right, 0.5)

    assert rows.is_above(score(10)) and not rows.is_above(score(10), readers=2)  # 1 / 1024
    assert not rows.is_above(score(9, 9))  # 1 / 512
    ok, wrong = np.ones(10, bool), np.zeros(10, bool)
    assert rows.is_lower(ok, wrong) and not rows.is_lower(wrong, ok) and not rows.is_lower(ok, ok)
    assert not rows.is_lower(ok[:9], wrong[:9])
    assert rows.share_lost(score(10), score(6)) == pytest.approx(0.8)
    assert rows.share_explained(score(6), best=0.7) == pytest.approx(0.5)
    assert rows.share_explained(score(4), best=0.5) == 0


def test_nearest_rows():
    x, query = np.array([[0.0], [2.0], [4.0]]), np.array([[1.0], [5.0]])
    squared = readers.distances(x, query)
    assert squared.tolist() == [[1, 1, 9], [25, 9, 1]]
    assert readers.nearest(squared).tolist() == [0, 2]
    allowed = np.array([[False, True, True], [False, False, False]])
    assert readers.nearest(squared, allowed).tolist() == [1, -1]
    assert readers.classes_of(np.array([7, 8, 9]), np.array([1, -1])).tolist() == [8, -1]
