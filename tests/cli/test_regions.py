"""First layers tied by region: what cannot be is refused in one line, before any work."""

import pytest

from dse.cli import main
from tests.spaces import write_space

MODEL = "model: {kind: snn, hidden: {choice: [4, 8, 12]}, true_rate: 0.8}"


@pytest.mark.parametrize(
    ("model", "sentences"),
    [
        (
            "kind: snn, hidden: 4, regions: {choice: [0, 3, 6]}",
            [f"regions must be at most the 2 places of the channels, got {n}" for n in (3, 6)],
        ),
        ("kind: snn, hidden: 4, threshold_exponents: [0, -1]", ["for outputs that do not learn alone first"]),
        ("kind: snn, hidden: 4, regions: 5", ["regions must be a multiple of 3 rings, got 5"]),
        ("kind: snn, hidden: 4, threshold_exponents: [9, 0]", ["got 9"]),
        ("kind: snn, hidden: 4, threshold_exponents: [0, 8], threshold: 20", ["at most 6", "got 8"]),
        ("kind: columns, regions: 3", ["unknown key 'model.regions'"]),
    ],
)
def test_what_cannot_be_is_refused(model, sentences, tmp_path, capsys):
    assert main(["check", str(write_space(tmp_path, (MODEL, f"model: {{{model}}}")))]) == 2
    said = capsys.readouterr().err
    assert all(sentence in said for sentence in sentences)
    assert all(line.startswith(f"{tmp_path}/tiny.yaml:14: ") for line in said.strip().splitlines())
