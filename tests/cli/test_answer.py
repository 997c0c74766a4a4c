from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from dse.cli.answer import Answer, cell, document, show


def test_a_document_has_only_what_json_has() -> None:
    row = {
        "nan": math.nan,
        "inf": np.float64("inf"),
        "int": np.int64(3),
        "bool": np.bool_(True),
        "na": pd.NA,
        "array": np.array([1.0, math.nan]),
        "tuple": (1, 2),
        "text": "é<",
        "nested": {1: [math.nan]},
        "nat": pd.NaT,
    }
    found = json.loads(document(Answer([row], ["note"]), "run"), parse_constant=pytest.fail)
    assert found == {
        "schema": "dse/run/1",
        "rows": [
            {
                "nan": None, "inf": None, "int": 3, "bool": True, "na": None, "array": [1.0, None],
                "tuple": [1, 2], "text": "é<", "nested": {"1": [None]}, "nat": None,
            }
        ],
        "notes": ["note"],
    }  # fmt: skip


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.123456, "0.1235"), (123456.7, "123457"), (1e-7, "1e-07"), (3, "3"), (math.nan, "-"), (None, "-"),
     ("[bold]", "[bold]"), (True, "True"), ((1, 2), "[1, 2]")],
)  # fmt: skip
def test_cells(value: object, text: str) -> None:
    assert cell(value) == text


def test_a_long_table_is_thinned_and_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    show(Answer([{"n": n} for n in range(1000)]), "skyline", "table")
    lines = capsys.readouterr().out.split("\n")
    assert lines[1].strip() == "0" and lines[24].strip() == "999"
    assert lines[25] == "24 of 1000 rows, evenly spaced; --format csv prints all"


def test_markup_in_values_is_printed_as_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    show(Answer([{"[red]name": "[/red][link=x]"}]), "skyline", "table")
    assert "[red]name" in (out := capsys.readouterr().out)
    assert "[/red][link=x]" in out


def test_notes_do_not_mix_with_csv(capsys: pytest.CaptureFixture[str]) -> None:
    show(Answer([{"a": 1}], ["a note"]), "skyline", "csv")
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("a\n1\n", "a note\n")


def test_a_reader_that_goes_away_is_no_error() -> None:
    code = "import sys; from dse.cli import main; sys.exit(main(['describe', '--schema']))"
    done = subprocess.run(
        f'"{sys.executable}" -c "{code}" | head -n 1; exit ${{PIPESTATUS[0]}}',
        shell=True,
        executable="/bin/bash",
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[2],
        check=False,
    )
    assert done.stdout == "{\n"
    assert done.stderr == ""
    assert done.returncode == 0
