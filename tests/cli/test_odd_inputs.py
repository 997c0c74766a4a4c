"""Odd inputs at the command line: each is one line with exit code 2, or is said before anything is trained."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from dse.cli import main
from tests.spaces import write_space

Captured = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def refused(capsys: Captured, *arguments: str) -> str:
    """Return the one line that a command refuses its arguments with."""
    capsys.readouterr()
    assert main(list(arguments)) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.count("\n") == 1, printed.err
    return printed.err


def notes(capsys: Captured, *arguments: str) -> str:
    """Return the notes of a command that is right."""
    capsys.readouterr()
    assert main([*arguments, "--json"]) == 0, capsys.readouterr().err
    return "\n".join(json.loads(capsys.readouterr().out)["notes"])


@pytest.mark.parametrize(
    ("old", "value"),
    [
        ("true_rate: 0.8", "{range: [0, 1], step: .nan}"),
        ("true_rate: 0.8", "{range: [0, 1], step: .inf}"),
        ("seed: 3", f"0x{'f' * 100_000}"),
        ("seed: 3", "9" * 350),
        ("epochs: 1", "100000000000"),
        ("batch_size: 8", "1000000000000"),
    ],
)
def test_a_number_beyond_bounds_is_refused(tmp_path: Path, capsys: Captured, old: str, value: str) -> None:
    key = old.split(":")[0]
    space = write_space(tmp_path, (old, f"{key}: {value}"))
    error = refused(capsys, "check", str(space))
    assert error.startswith(f"{space}:") and f"{key}" in error and len(error) < 300 + len(str(space))


DAMAGES = {
    "complex": (145, b"\x08"),  # an array without its imaginary part crashes scipy
    "no_class": (144, b"\x00"),
    "dimensions": (152, b"\x09"),
    "no_matrix": (128, b"\x14"),
    "noise": (128, bytes(range(250, 50, -1))),
}


def test_damaged_files_of_matlab_are_refused() -> None:
    file = io.BytesIO()
    savemat(file, {"p": np.arange(48).reshape(4, 6, 2), "label": np.arange(4) % 2})
    for name, (at, new) in DAMAGES.items():
        content = bytearray(file.getvalue())
        content[at : at + len(new)] = new
        Path(f"{name}.mat").write_bytes(content)
    # In a process of its own: what crashes may not take the tests along.
    code = "import sys; from dse.cli import main; print([main(['init', x]) for x in sys.argv[1:]])"
    command = [sys.executable, "-c", code, *(f"{name}.mat" for name in DAMAGES)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stdout.strip() == str([2] * len(DAMAGES)), done.stderr
    lines = done.stderr.splitlines()
    assert len(lines) == len(DAMAGES)
    for name, line in zip(DAMAGES, lines, strict=True):
        assert line.startswith(f"{name}.mat: the file cannot be read: it is not a MATLAB file")


def test_a_table_of_a_million_columns_is_refused_at_once(capsys: Captured) -> None:
    names = ",".join(f"v{k}" for k in range(1_000_000))
    Path("wide.csv").write_text(f"{names}\n{names.replace('v', '')}\n")
    assert "at most 100000 columns, got 1000000" in refused(capsys, "init", "wide.csv", "--step-ms", "4")
