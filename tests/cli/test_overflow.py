"""A study whose states leave 24 bits says so wherever it is read, and does not fit a chip of such states."""

import re

import numpy as np
import pytest

import dse
from dse.engine.neurons.fixed_point import STATE_LIMIT
from dse.study import results
from tests.command import document
from tests.page_data import held

PAGES = True
SPACE = """
study: over
seed: 3
data: {kind: raster, file: tiny.npz, step_ms: 5.0, columns: {fabric: label}, class_names: {fabric: names}}
task: {target: fabric}
split: {stratified: {validation: 0.25, test: 0.25}}
model: {kind: snn, hidden: 8, threshold: 1.25, current_decay: 0.05, voltage_decay: 0.01}
training: {epochs: 3, batch_size: 8, learning_rate: 1.0, step_unit: weight}
hardware: [mcu_m4, loihi1_silicon]
objectives: [accuracy:max, energy_uj:min]
execution: {jobs: 1}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A study of one network that steps of a whole weight drive far below its threshold."""
    place = tmp_path_factory.mktemp("over")
    rng, label = np.random.default_rng(0), np.repeat([0, 1, 2], 8)
    spikes = rng.random((24, 48, 24)) < np.array([0.2, 0.5, 0.8])[label][:, None, None]
    np.savez(place / "tiny.npz", spikes=spikes, label=label, names=np.array(["felt", "silk", "wool"]))
    (place / "over.yaml").write_text(SPACE, encoding="utf-8")
    dse.run(place / "over.yaml", results=place / "results", progress=False)
    return place


def test_run_report_and_page_name_it_and_by_how_much(folder, capsys):
    study = results.open(folder / "results" / "over")
    [trial] = study.trials.to_dict("records")
    assert trial["overflows_24_bit"] is True and trial["peak_state"] > STATE_LIMIT
    times = trial["peak_state"] / STATE_LIMIT
    ran = document(capsys, "run", str(folder / "over.yaml"), "--results", str(folder / "results"))
    reported = document(capsys, "report", str(study.folder))
    page = held(study.folder / "page.html")
    for text in (*ran["notes"], *reported["notes"], *page["notes"]):
        if found := re.search(r"overflows_24_bit.*?(\d+) thresholds, and 24 bits hold (\d+)", text):
            peak, most = map(float, found.groups())
            assert peak == pytest.approx(trial["peak_thresholds"], abs=0.5) and most == 1638
            assert peak / most == pytest.approx(times, rel=1e-3)
    for notes in (ran["notes"], reported["notes"], page["notes"]):
        assert sum("overflows_24_bit" in text for text in notes) == 1


def test_it_does_not_fit_a_chip_of_24_bits_but_one_whose_program_holds_its_states(folder, capsys, tmp_path):
    study = str(folder / "results" / "over")
    on_chips = document(capsys, "skyline", study, "--where", "trial == 0", "--oversize")["rows"]
    assert {row["fits"] for row in on_chips if row["hardware"] == "mcu_m4"} == {True}
    refused = document(capsys, "pick", study, "--budget", "hardware == 'loihi1_silicon'", code=3)
    assert {row["fits"] for row in refused["rows"]} == {False}
    assert any(f"at most {STATE_LIMIT}" in note for note in refused["notes"])

    bundle, data = str(tmp_path / "bundle"), str(folder / "tiny.npz")
    on_mcu = ("--budget", "hardware == 'mcu_m4'", "--export", bundle)
    picked = document(capsys, "pick", study, *on_mcu)
    assert sum("leaves 24 bits" in note for note in picked["notes"]) == 1
    targets = ("--target", "loihi", "--target", "c99", "--verify", data)
    verdicts = {row["target"]: row for row in document(capsys, "export", bundle, *targets)["rows"]}
    assert verdicts["loihi"]["verdict"] == "unsupported" and "24 bits" in verdicts["loihi"]["reason"]
    assert verdicts["c99"]["verdict"] == "faithful"  # states of as many bits as they need


def test_of_several_runs_the_one_that_overflows_counts():
    from dse.measure.numbers import Numbers
    from dse.study.trials import summary

    peaks = (1000, STATE_LIMIT + 1, 2000)
    runs = [Numbers({"peak_state": x, "overflows_24_bit": x > STATE_LIMIT}, {}) for x in peaks]
    row = summary(runs, None)
    assert row["overflows_24_bit"] is True and row["peak_state"] == STATE_LIMIT + 1
