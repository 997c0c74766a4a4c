import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from dse.cli.answer import Answer, cell, document, listing, show
from dse.config import ConfigError


def test_a_document_has_only_what_json_has():
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
def test_cells(value, text):
    assert cell(value) == text


def test_a_long_table_is_thinned_and_says_so(capsys):
    show(Answer([{"n": n} for n in range(1000)]), "skyline", "table")
    lines = capsys.readouterr().out.split("\n")
    assert lines[1].strip() == "0" and lines[24].strip() == "999"
    assert lines[25] == "24 of 1000 rows, evenly spaced; --format csv prints all"


WIDE = [
    {
        "trial": n,
        "task": "texture",
        "model.input_delays": [0, 12, n],
        "accuracy": 0.123456 + n,
        "energy_uj": 3.25 * n,
        "reason": f"a sentence of several words that may be wrapped between them, {n}",
    }
    for n in range(4)
]


@pytest.mark.parametrize("width", [40, 80, 120])
@pytest.mark.parametrize("essential", [(), ("trial", "accuracy", "energy_uj")])
def test_no_header_and_no_number_is_broken(width, essential, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(width))
    show(Answer(WIDE, essential=essential), "skyline", "table")
    out = capsys.readouterr().out
    assert all(len(line.rstrip()) <= width for line in out.splitlines())
    left_out = out.partition("too narrow for ")[2]
    for name in WIDE[0]:
        assert name in out and (name not in essential or name not in left_out)
    for row in WIDE:
        for name in ("trial", *(essential or WIDE[0])):
            words = cell(row[name]).split() if name == "reason" else [cell(row[name])]
            assert all(word in out for word in words)
    assert bool(left_out) == (bool(essential) and width < 80)
    assert out.startswith("in all rows: task texture")


def test_rows_that_do_not_fit_are_listed_below_each_other(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "24")
    rows = [{"target": "c99", "verdict": "faithful", "recordings": n, "ram_bytes": 12345} for n in (3, 4)]
    show(Answer(rows), "verify", "table")
    assert capsys.readouterr().out.splitlines() == [
        *("in all rows: verdict", "faithful · ram_bytes", "12345", "target  recordings"),
        *("c99              3", "c99              4"),
    ]
    show(Answer([rows[0]]), "verify", "table")
    assert capsys.readouterr().out.splitlines() == [
        *("target      c99", "verdict     faithful", "recordings  3", "ram_bytes   12345")
    ]


START, END = '{"schema": "dse/run/1", "rows": ', ', "notes": []}\n'
ANSWER = Answer([{"a": 1, "b": 2}] * 2, columns=["a"], table=[{"a": 1, "b": 2}])


@pytest.mark.parametrize(
    ("form", "columns", "printed"),
    [
        ("csv", None, "a\n1\n1\n"),  # every row
        ("csv", "b, a", "b,a\n2,1\n2,1\n"),
        ("csv", "all", "a,b\n1,2\n1,2\n"),
        ("table", None, "a\n1\n"),
        ("table", "all", "a  b\n1  2\n"),
        ("json", None, f"{START}[{{\"a\": 1, \"b\": 2}}, {{\"a\": 1, \"b\": 2}}]{END}"),
        ("json", "b", f"{START}[{{\"b\": 2}}, {{\"b\": 2}}]{END}"),
    ],
)  # fmt: skip
def test_a_view_is_a_table_and_csv_alike_and_other_columns_are_named(form, columns, printed, capsys):
    show(ANSWER, "run", form, columns)
    out = capsys.readouterr().out
    assert "".join(f"{line.strip()}\n" for line in out.splitlines()) == printed


def test_an_unknown_column_is_a_fault():
    with pytest.raises(ConfigError, match="--columns: unknown column 'c'"):
        show(ANSWER, "skyline", "csv", "a,c")


def test_markup_in_values_is_printed_as_it_is(capsys):
    show(Answer([{"[red]name": "[/red][link=x]"}]), "skyline", "table")
    assert "[red]name" in (out := capsys.readouterr().out)
    assert "[/red][link=x]" in out


def test_notes_do_not_mix_with_csv(capsys):
    show(Answer([{"a": 1}], ["a note"]), "skyline", "csv")
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("a\n1\n", "a note\n")


def test_a_reader_that_goes_away_is_no_error():
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


def test_a_chip_is_left_out_last_and_notes_are_wrapped_around_what_is_copied(capsys, monkeypatch):
    rows = [{"trial": n, "phi": n, "hardware": f"a long name {n}", "accuracy": 0.5 + n / 9} for n in range(5)]
    notes = ["these words are longer than the terminal is wide", "restrict it with --budget \"task == 'a'\""]
    answer = Answer(rows, notes, essential=["trial", "accuracy"], telling=["hardware"])
    for width, columns in ((31, ["trial", "hardware", "accuracy"]), (24, ["trial", "accuracy"])):
        monkeypatch.setenv("COLUMNS", str(width))
        show(answer, "skyline", "table")
        lines = capsys.readouterr().out.splitlines()
        assert lines[0].split() == columns
        assert lines[-2:] == ["restrict it with", "--budget \"task == 'a'\""]
        assert max(map(len, lines)) <= width


def test_a_listing_indents_less_where_a_word_of_its_texts_would_not_fit():
    lines = listing([("a_name_of_many_letters", "4.6 pJ per multiply-accumulate")], 40).splitlines()
    assert all(len(line) <= 40 for line in lines)
    assert lines[1] == "  multiply-accumulate"
