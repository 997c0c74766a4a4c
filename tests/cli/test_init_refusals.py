"""What no search space can be written for: one line on stderr, exit code 2, and no file."""

from pathlib import Path

import numpy as np
import pytest

from dse.cli import main

N = 20
SIGNAL = np.random.default_rng(0).normal(size=(N, 30, 3))
LABEL = np.tile(["denim", "silk"], N // 2)
BAD = {
    "one class": ({"label": np.full(N, "denim")}, "label"),
    "a class of one": ({"label": np.where(np.arange(N) == 3, "silk", "denim")}, "'silk' of 'label' has 1"),
    "constant": ({"signal": np.ones_like(SIGNAL)}, "every channel has one value"),
    "no numbers in a channel": ({"signal": np.where(np.arange(3) == 1, np.nan, SIGNAL)}, "channel 1"),
    "measured labels": (
        {"label": np.repeat(np.linspace(0.05, 1, N // 2), 2)},
        "measured numbers such as 0.05",
    ),
    "groups are classes": ({"session": LABEL}, "'session' has one value in class 'denim'"),
}


@pytest.mark.parametrize("name", BAD)
def test_one_line_says_what_is_wrong(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    changed, why = BAD[name]
    np.savez("touch.npz", **{"signal": SIGNAL, "label": LABEL, **changed})
    group = ["--group", "session"] if "session" in changed else []
    assert main(["init", "touch.npz", "--step-ms", "4", "--label", "label", *group]) == 2
    said = capsys.readouterr().err
    assert why in said and said.count("\n") == 1, said
    assert not Path("touch.yaml").exists()
