from __future__ import annotations

import dataclasses
from pathlib import Path

import pandas as pd
import pytest

from dse.recordings import RecordingError
from dse.recordings.table import LongTable

LONG = pd.DataFrame(
    [
        (1000 * t, taxel, 10 * number + t + (100 if taxel == "b" else 0), cloth)
        for number, cloth in enumerate(("silk", "wool"))
        for t in range(3)
        for taxel in "ab"
    ],
    columns=["t", "taxel", "pressure", "cloth"],
)
SOURCE = LongTable(
    "x.csv", 1, ("b", "a"), "t", "taxel", "pressure", time_unit="us", columns={"fabric": "cloth"}
)
VALUES = [[100, 0], [101, 1], [102, 2], [110, 10], [111, 11], [112, 12]]


@pytest.mark.parametrize("by", [["cloth", "t", "taxel"], ["cloth", "taxel", "t"]])
def test_a_recording_begins_where_the_time_of_a_channel_falls(tmp_path: Path, by: list[str]) -> None:
    LONG.sort_values(by, kind="stable").to_csv(tmp_path / "x.csv", index=False)
    assert SOURCE.check(tmp_path) == []
    signals = SOURCE.read(tmp_path)
    assert signals.values.tolist() == VALUES and signals.offsets.tolist() == [0, 3, 6]
    assert signals.columns["fabric"].tolist() == ["silk", "wool"] and signals.notes() == []


def test_what_a_file_holds_stays_in_the_line_of_its_fault(tmp_path: Path) -> None:
    LONG.assign(taxel=["a", "b\n\x1b[2J"] * 6).to_csv(tmp_path / "x.csv", index=False)
    with pytest.raises(RecordingError, match=r"channel 'b\\n\\x1b\[2J' is not among data\.channels$"):
        SOURCE.read(tmp_path)


def test_recordings_and_labels_may_be_named_in_a_table_beside(tmp_path: Path) -> None:
    LONG.assign(id=LONG.cloth).drop(columns="cloth").sample(frac=1, random_state=1).sort_values("t").to_csv(
        tmp_path / "x.csv", index=False
    )
    pd.DataFrame({"id": ["wool", "silk"], "cloth": ["w", "s"]}).to_csv(tmp_path / "y.csv", index=False)
    signals = dataclasses.replace(SOURCE, recording="id", labels="y.csv").read(tmp_path)
    assert signals.values.tolist() == [*VALUES[3:], *VALUES[:3]]
    assert signals.columns["fabric"].tolist() == ["w", "s"]


def test_channels_with_times_of_their_own_are_interpolated_where_all_have_values(tmp_path: Path) -> None:
    shifted = LONG.assign(t=LONG.t + 500 * (LONG.taxel == "b"))
    shifted.to_csv(tmp_path / "x.csv", index=False)
    with pytest.raises(
        RecordingError,
        match=r"recording '0': .* times that rise by step_ms = 1 ms, got others",
    ):
        SOURCE.read(tmp_path)
    signals = dataclasses.replace(SOURCE, resample="linear").read(tmp_path)
    assert signals.values.tolist() == [[100, 0.5], [101, 1.5], [110, 10.5], [111, 11.5]]
    assert signals.notes()[0].startswith("x.csv: 2 of 2 recordings have samples at uneven times")


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (LONG.assign(taxel="a"), r"recording '0' has no samples of channel 'b'"),
        (LONG.assign(taxel=["c", *"bababababab"]), r"channel 'c' is not among data\.channels"),
        (LONG.drop(columns="pressure"), r"x\.csv: no column 'pressure'; known: t, taxel, cloth"),
        (LONG.assign(pressure=["high", *range(11)]), r"'pressure' must hold numbers, got 'high' in line 2"),
        (LONG.assign(cloth=["felt", *LONG.cloth[1:]]), r"got 'felt' and, in line 3, 'silk'"),
    ],
)
def test_each_fault_is_one_clear_line(tmp_path: Path, table: pd.DataFrame, message: str) -> None:
    table.to_csv(tmp_path / "x.csv", index=False)
    with pytest.raises(RecordingError, match=message) as error:
        SOURCE.read(tmp_path)
    assert "\n" not in str(error.value)
