"""A paper's numbers beside ours, from studies whose every number is chosen."""

from pathlib import Path

import pytest

from dse.data.recordings.scene import SceneTrials
from dse.show.report import ReportError
from dse_papers.report.compare import agrees, gap_of, paper_report, rounds_to
from dse_papers.report.papers import key_of, publication, publications
from dse_papers.report.tables import TABLES
from tests.show.report.made import write

SAMPLES = {"train": 1008, "validation": 432, "test": 432}


def on_scene(folder, scene, target, designs, **sections):
    """Write a study of a shipped scene, with the classes of one of its columns and 13 trials a cell."""
    classes = sorted(set(map(str, SceneTrials(scene=scene).read(Path()).columns[target])))
    own = {
        "data": {"kind": "scene", "scene": scene, "trials": 13},
        "task": {"target": target},
        "preprocessing": {"bin_ms": 1, "pool": 4, "exceeds": True, "polarity": "merge"},
        "training": {"epochs": 30},
        **sections,
    }
    return write(folder, [{"task": target, **x} for x in designs], own, classes=classes, samples=SAMPLES)


def rows_of(found, *names):
    """Return the rows whose quantity and condition begin with these words."""
    return [
        row
        for row in found.rows
        if all(
            text.startswith(name) for text, name in zip((row.quantity, row.condition), names, strict=False)
        )
    ]


def only(found, *names):
    [row] = rows_of(found, *names)
    return row


def test_every_printed_number_has_a_place_and_something_of_ours_or_a_reason():
    assert [paper.name for paper in publications().values()] == list(TABLES)
    for key, paper in publications().items():
        assert key_of(paper.name) == key_of(paper.source) == key_of(key) == key
        assert set(TABLES[paper.name].OURS) == set(paper.results), key
        for number in paper.numbers():
            assert number.entry.where and number.entry.quantity, number
            assert set(number.condition) == set(number.entry.by), number
            if number.kind == "setup":
                assert bool(number.entry.reads) != bool(number.entry.lacks), number.key
    assert key_of("005") is None


def test_ends_of_the_front_and_their_reductions(tmp_path):
    designs = [
        {"accuracy": 0.8, "accuracy_test": 0.76, "n_weights": 152_000, "spikes_total_no_input": 43_200},
        {
            **{"accuracy": 0.6, "accuracy_test": 0.57, "n_weights": 38_000, "spikes_total_no_input": 4_320},
            "spikes_per_inference_no_input": 5.0,
        },
    ]
    found = paper_report([on_scene(tmp_path / "grid", "neurotac_dvxplorer", "texture", designs)], "002")
    peak = only(found, "accuracy", "texture, best accuracy")
    assert (peak.printed, peak.ours, peak.same, peak.trial) == ("0.95", "0.76", True, 0)
    assert peak.differs.startswith(
        "0.19 below: set-up: simulated touch; the paper's recordings are not public; samples"
    )
    assert "epochs: 30 instead of 100" in peak.differs
    assert "trials of each texture and profile 13 (printed 100)" in peak.scale
    assert "pools" not in peak.differs, "the printed ones"
    s = only(found, "S, spikes", "texture, best accuracy")
    # 43 200 of 432 test samples; printed 9.07e6 of 2880
    assert (s.ours_value, s.why) == (43_200, "per test sample 100, printed 3149")
    assert only(found, "W_t", "texture, least spikes").ours == "38000"
    assert only(found, "reduction of S", "texture, least spikes").ours_value == pytest.approx(90)
    assert only(found, "reduction of W_t", "texture, least weights").ours_value == pytest.approx(75)
    assert only(found, "loss of accuracy", "texture, least spikes").ours_value == pytest.approx(25)
    assert only(found, "least accuracy of all").ours_value == 0.57

    profile = only(found, "accuracy", "movement, best accuracy")
    assert (profile.ours, profile.same, profile.differs) == ("", None, "no study of movement")


def test_without_a_test_set_it_is_another_quantity(tmp_path):
    study = on_scene(tmp_path / "grid", "neurotac_dvxplorer", "profile", [{"accuracy": 0.8}])
    found = paper_report([study], "002")
    row = only(found, "accuracy", "movement, best accuracy")
    assert (row.ours, row.same) == ("0.8", False) and "on validation; none of the test set" in row.differs
    # Of every class three samples are right; the next class in order gets one, the last has no next.
    constant = only(found, "accuracy on a kind of profile", "movement, constant")
    assert constant.ours_value == pytest.approx(12 / 16)
    assert only(found, "profile 5 answered").why == "accelerating_42 as accelerating_50 or accelerating_60"
    assert only(found, "profile 5 answered").ours_value == pytest.approx(25)
    [errors] = [note for note in found.notes if "most often taken for another" in note]
    assert "on test, most often taken for another: accelerating_35 for accelerating_42 (25%)" in errors


def test_a_length_stands_beside_the_same_length_alone(tmp_path):
    designs = [
        {
            **{"runs": [0.8, 0.9, 0.7], "decision_latency_ms": ms, "accuracy_test": 0.93},
            **{"t_p_ms": 400.0, "t_p_test_ms": 437.4, "t_h_ms": t_h_ms},
        }
        for ms, t_h_ms in ((1000.0, 100.0), (4000.0, None), (5000.0, 120.0))
    ]
    k_fold = {"k_fold": {"k": 3, "group": None, "test": {"repetition": 1}, "seed": 1, "fold": 0}}
    study = on_scene(tmp_path / "lengths", "neurotac_davis", "texture", designs, split=k_fold)
    found = paper_report([study], "000")
    row = only(found, "t_p", "samples of 1000 ms")
    assert (row.ours, row.same, row.differs, row.setup) == ("437.4", True, "", ""), (
        "rounds to the printed 437"
    )
    assert only(found, "t_p", "samples of 250 ms").differs == "no network of this length"
    assert only(found, "t_h", "samples of 1000 ms").same is False
    assert only(found, "t_h", "samples of 4000 ms").why == "no setting reaches the human baseline"
    assert only(found, "peak accuracy", "samples of 1000 ms").why.startswith("at the end of the sample")
    phi = only(found, "φ of t_p", "samples of 5000 ms")
    assert (phi.ours_value, phi.low, phi.high, phi.runs, phi.why) == (7, 7, 7, 3, "median over the folds")
    assert only(found, "largest θ at the human baseline").ours == "0.4"
    worst = only(found, "accuracy of one texture", "samples of 5000 ms, worst")
    assert (worst.ours_value, worst.why) == (0.75, "acrylic")
    assert only(found, "reduction of the least t_h").ours_value == pytest.approx(75), "100 instead of 400 ms"
    assert only(found, "folds").ours == "3" and only(found, "samples of training").ours == "1440"
    assert only(found, "power, W", "CPU, in all").printed == "56.005"
    assert only(found, "power, W", "CPU, in all").differs == "no power_w of a CPU profile"
    assert only(found, "force of people").differs == "quoted from another work"


def test_power_is_of_our_design_or_quoted(tmp_path):
    on = {
        "loihi2_board": {"power_idle_w": 0.5, "power_w": 2.25, "n_cores": 1},
        "loihi1_silicon": {
            "power_idle_w": 0.1,
            "power_w": 0.12,
            "power_w_low": 0.11,
            "power_w_high": 0.2,
            "n_cores": 30,
        },
        "gpu_rtx_a4500": {"power_idle_w": 28.0, "power_w": 46.39, "n_cores": 1},
    }
    design = {"accuracy": 0.8, "decision_latency_ms": 5000.0, "on": on}
    found = paper_report([on_scene(tmp_path / "chips", "neurotac_davis", "texture", [design])], "000")
    board = only(found, "power, W", "Loihi 2, in all")
    assert (board.ours, board.low, board.high, board.same) == ("0.12", 0.11, 0.2, False)
    assert board.why == "profile loihi1_silicon, another chip"
    assert only(found, "power, W", "Loihi 2, beyond idle").ours_value == pytest.approx(0.02)
    quoted = only(found, "power, W", "GPU, idle")
    assert (quoted.ours, quoted.same) == ("28", False) and quoted.why.endswith("the printed power")
    assert only(found, "reduction of power", "against the GPU").ours_value == pytest.approx(
        100 * (1 - 0.12 / 46.39)
    )
    assert only(found, "reduction of power", "against the CPU").ours == ""
    assert only(found, "cores in use").ours == "30"


def test_printed_pins_and_natural_textures(tmp_path):
    designs = [
        {"family": "knn", "accuracy": 0.9, "accuracy_test": 0.88, "t_c_ms": 500.0, "macs": 4.0},
        {"family": "hots", "accuracy": 0.7, "accuracy_test": 0.6, "model": {"layers": 1}, "macs": 4.0},
    ]
    pins = on_scene(tmp_path / "pins", "pin_arrays", "texture", designs)
    found = paper_report([pins], "001")
    assert only(found, "t_C", "artificial textures, knn").differs == ""
    assert only(found, "t_C", "natural textures, knn").differs == "no study of natural textures"
    assert only(found, "peak accuracy of HOTS", "artificial textures, 1").ours == "0.6"
    assert (
        only(found, "peak accuracy of HOTS", "artificial textures, 2").why
        == "the study has no hots of 2 layers"
    )
    assert only(found, "radius and gap R").ours == "0 to 5"
    natural = on_scene(tmp_path / "natural", "neurotac_davis", "texture", designs[:1])
    found = paper_report([pins, natural], "001")
    assert {row.study for row in rows_of(found, "peak accuracy", "natural textures, knn")} == {"natural"}


def test_a_leak_as_printed_and_without(tmp_path):
    leaky = {
        "accuracy": 1.0,
        "family": "threshold_lif",
        "transductive": True,
        "first_spike_class_min_ms": 30.0,
    }
    honest = {"accuracy": 0.7, "family": "threshold_lif"}
    found = paper_report([write(tmp_path / "both", [leaky, honest])], "003")
    as_printed, without = rows_of(found, "accuracy", "")[:2]
    assert (as_printed.ours, as_printed.trial, without.ours, without.trial) == ("1", 0, "0.7", 1)
    assert without.where == "not printed" and without.same is None
    fastest, slowest = rows_of(found, "inference time, from touch")
    assert (fastest.ours, fastest.why) == ("30", "on validation; none of the test set") and slowest.ours == ""
    assert [row.kind for row in found.rows].index("set-up") == 5, "after the results"
    found = paper_report([write(tmp_path / "honest", [honest])], "003")
    row = rows_of(found, "accuracy")[0]
    assert (row.ours, row.same) == ("0.7", False) and "0.3 below: means of the training set" in row.differs


def test_the_rate_of_a_receptor_is_that_of_all_its_channels(tmp_path):
    encoder = {"encoder": {"kind": "receptors", "spikes_per_step": 2}}
    designs = [
        {"family": "elm", "accuracy": accuracy, "input_spike_rate_hz": rate, "macs": 4.0}
        for accuracy, rate in ((0.9, 50.0), (0.82, 4.0), (0.5, 1.0))
    ]
    found = paper_report([write(tmp_path / "elm", designs, encoder)], "004")
    assert only(found, "mean spike rate").ours_value == 100
    least = only(found, "spike rate below which")
    # 0.82 is within a tenth of 0.9, 0.5 is not.
    assert (least.ours_value, least.trial, least.same) == (8, 1, False)
    assert least.why.endswith("rates of the study begin at 2 Hz")
    assert only(found, "accuracy without the leak").ours == "0.9"


def test_a_study_of_another_set_up_is_refused_in_a_line_each(tmp_path):
    nets = write(tmp_path / "nets", [{"accuracy": 0.9}])
    letters = write(tmp_path / "letters", [{"accuracy": 0.9}], {"task": {"target": "letter"}})
    bad = write(tmp_path / "bad", [], failed=1)
    with pytest.raises(ReportError) as refused:
        paper_report([nets, letters, bad], "000")
    assert str(refused.value).splitlines() == [
        "nets: is of another set-up than paper 000 (realtime_texture): texture has 3 classes, not 11",
        "letters: is of another set-up than paper 000 (realtime_texture): it predicts letter, not a texture",
        "bad: is of another set-up than paper 000 (realtime_texture): it has no finished design",
    ]
    with pytest.raises(ReportError, match="its models are snn, not elm"):
        paper_report([nets], "004")
    eleven = write(tmp_path / "eleven", [{"accuracy": 0.9}], classes=[f"c{k}" for k in range(11)])
    with pytest.raises(ReportError, match="its recordings are not events"):
        paper_report([eleven], "000")
    other = write(tmp_path / "elm", [{"accuracy": 0.8, "family": "elm", "macs": 1.0}])
    assert any(
        note.startswith("nets: is of another set-up") for note in paper_report([other, nets], "004").notes
    )


def test_agreement_is_to_the_printed_digits():
    assert rounds_to(0.95, 0.9549) and not rounds_to(0.95, 0.9551)
    assert rounds_to(1, 0.996) and not rounds_to(1, 0.63), "1 is 100 %"
    assert rounds_to(2.59e6, 2_590_800) and rounds_to(0.15e6, 152_400) and not rounds_to(0.13e6, 136_000)
    assert rounds_to(79, 79.4) and not rounds_to(79, 79.6)
    assert agrees((1.0, 6.0), (1.0, 6.0)) and not agrees((1.0, 6.0), 6.0)
    assert agrees(0.091, 1 / 11) and not agrees(4, 3.584)
    assert gap_of(0.95, 0.7, 0.3) == "within one standard error"
    assert gap_of(0.95, 0.7, 0.1) == "0.25 below" and gap_of(154, 308, None) == "2 times the printed value"
    assert publication("002").number("spikes", "texture", "least spikes") == 130_000
