"""What `dse check` and `dse describe` say of a search space of several kinds."""

import pytest

from dse.cli import main
from tests import families
from tests.command import document
from tests.spaces import write_space


@pytest.fixture(autouse=True)
def known():
    families.register()


def test_check_counts_the_designs_of_every_kind(tmp_path, capsys):
    path = write_space(tmp_path, text=families.SPACE)
    (row,) = document(capsys, "check", path)["rows"]
    assert row["designs"] == families.N_DESIGNS
    assert row["encoder_designs"] == {"send_on_delta": 120, "loud_of_a_test": 60}
    assert row["model_designs"] == {"snn": 6, "wide_of_a_test": 144, "near_of_a_test": 30}
    assert "n_weights_low" not in row  # no family but the nets knows it before training
    assert main(["check", str(path), "--format", "table"]) == 0
    shown = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
    assert shown["model_designs"] == "snn 6, wide_of_a_test 144, near_of_a_test 30"


def test_check_lists_faults_of_an_entry(tmp_path, capsys):
    path = write_space(tmp_path, text=families.SPACE)
    assert main(["check", str(path), "--set", "model.wide_of_a_test.width=0"]) == 2
    fault = "--set model.wide_of_a_test.width: model.wide_of_a_test.width must be >= 1, got 0\n"
    assert capsys.readouterr().err == fault


def test_check_says_which_kind_has_no_end(tmp_path, capsys):
    open_range = ("gain: {range: [0.5, 2.0], step: 0.5}", "gain: {range: [0.5, 2.0]}")
    tpe = ("sampler: grid, batch: 4", "sampler: tpe, n_trials: 30")
    path = write_space(tmp_path, open_range, tpe, text=families.SPACE)
    assert main(["check", str(path), "--format", "table"]) == 0
    shown = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
    assert (shown["designs"], shown["trained"]) == ("unlimited", "30")
    assert shown["model_designs"] == "snn 6, wide_of_a_test unlimited, near_of_a_test 30"
    assert shown["encoder_designs"] == "send_on_delta unlimited, loud_of_a_test unlimited"


def test_check_takes_the_size_of_every_kind_of_encoder(tmp_path, capsys):
    path = write_space(tmp_path, text=families.SPACE)
    (row,) = document(capsys, "check", path, "--set", "model={kind: snn, hidden: 10}")["rows"]
    # 2 channels x 2 polarities x 3 thresholds, and 3 copies of 2 channels, -> 10 neurons -> 2 classes
    assert (row["n_weights_low"], row["n_weights_high"]) == (10 * (6 + 2), 10 * (12 + 2))
