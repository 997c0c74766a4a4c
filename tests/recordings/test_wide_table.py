from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from dse.recordings import RecordingError
from dse.recordings.time_series import WideTable

WIDE = pd.DataFrame(
    {
        "cloth": ["silk", "wool"],
        **{f"l_{k}": [float(k), 10.0 + k] for k in (0, 1, 2, 10)},
        **{f"r_{k}": [100.0 + k, 200.0 + k] for k in (2, 0, 10, 1)},
    }
)
SOURCE = WideTable("x.csv", 4, ("l_", "r_"), {"fabric": "cloth"})


def test_a_row_is_a_recording_and_numbers_order_its_samples(tmp_path: Path) -> None:
    WIDE.to_csv(tmp_path / "x.csv", index=False)
    assert SOURCE.check(tmp_path) == []
    signals = SOURCE.read(tmp_path)
    assert signals.offsets.tolist() == [0, 4, 8] and signals.step_ms == 4
    assert signals.values.tolist() == [
        *([0, 100], [1, 101], [2, 102], [10, 110]),
        *([10, 200], [11, 201], [12, 202], [20, 210]),
    ]
    assert signals.columns["fabric"].tolist() == ["silk", "wool"]
    assert SOURCE.channel_positions(tmp_path).tolist() == [[0, 0, 0], [1, 0, 0]]
    numbered = WIDE[["cloth", "l_0", "l_1"]].rename(columns={"l_0": "0", "l_1": "1"})
    numbered.to_parquet(tmp_path / "x.parquet")
    alone = WideTable("x.parquet", 4, ("",)).read(tmp_path)
    assert alone.values.ravel().tolist() == [0, 1, 10, 11] and alone.columns == {}


def test_empty_cells_at_the_end_make_a_recording_shorter(tmp_path: Path) -> None:
    WIDE.assign(l_10=[10.0, np.nan], r_10=[110.0, np.nan]).to_csv(tmp_path / "x.csv", index=False)
    assert SOURCE.read(tmp_path).offsets.tolist() == [0, 4, 7]


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (WIDE.assign(l_1=[1.0, np.nan]), r"x\.csv: column 'l_1' must hold a number in line 3, got none"),
        (WIDE.assign(r_10=[1.0, np.nan]), r"x\.csv: column 'r_10' must hold a number in line 3, got none"),
        (WIDE.assign(l_1=["1", "x"]), r"column 'l_1' must hold numbers, got 'x' in line 3"),
        (WIDE.assign(cloth=["silk", None]), r"'cloth' is empty in line 3"),
        (WIDE.drop(columns="r_1"), r"as many sample columns as each other, got 4 of 'l_', 3 of 'r_'"),
        (WIDE.drop(columns="cloth"), r"no column 'cloth'; known: l_0"),
        (WIDE.rename(columns=lambda name: name.replace("r_", "q_")), r"no column is named 'r_' and a number"),
        (WIDE[:0], r"x\.csv: the table has no rows"),
    ],
)
def test_each_fault_is_one_clear_line(tmp_path: Path, table: pd.DataFrame, message: str) -> None:
    table.to_csv(tmp_path / "x.csv", index=False)
    with pytest.raises(RecordingError, match=message) as error:
        SOURCE.read(tmp_path)
    assert "\n" not in str(error.value)


def test_labels_of_a_file_beside(tmp_path: Path) -> None:
    WIDE.drop(columns="cloth").to_csv(tmp_path / "x.csv", index=False)
    WIDE[["cloth"]].to_csv(tmp_path / "labels.csv", index=False)
    source = WideTable("x.csv", 4, ("l_", "r_"), {"fabric": "cloth"}, "labels.csv")
    assert source.check(tmp_path) == []
    assert source.read(tmp_path).columns["fabric"].tolist() == ["silk", "wool"]
    before = source.content(tmp_path)
    WIDE[["cloth"]][:1].to_csv(tmp_path / "labels.csv", index=False)
    assert source.content(tmp_path) != before
    with pytest.raises(RecordingError, match=r"labels\.csv: .*'cloth'.* each of the 2 recordings"):
        source.read(tmp_path)
    (tmp_path / "labels.csv").write_text("fibre\na\nb\n")
    assert "labels.csv: no column 'cloth'" in source.check(tmp_path)[0]
    assert source.with_columns_found(tmp_path).columns == {}
    (tmp_path / "labels.csv").unlink()
    assert "labels.csv" in source.check(tmp_path)[0]
    assert source.with_columns_found(tmp_path).labels is None
