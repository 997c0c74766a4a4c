import json

import pandas as pd
import pytest

from dse.skyline.constraints import ExpressionError
from dse.skyline.table import TableError, parse_goals, read
from tests.skyline.tables import OBJECTIVES, table


@pytest.mark.parametrize("suffix", ["csv", "parquet", "json", "rows.json"])
def test_tables_survive_every_format(tmp_path, suffix):
    frame = table(trial=[1, 2], accuracy=[0.5, 0.25], task=["a", "b"])
    file = tmp_path / f"points.{suffix}"
    if suffix == "csv":
        frame.to_csv(file, index=False)
    elif suffix == "parquet":
        frame.to_parquet(file)
    else:
        rows = frame.to_dict("records")
        document = {"schema": "dse/skyline/1", "rows": rows, "notes": []}
        file.write_text(json.dumps(rows if suffix == "rows.json" else document))
    pd.testing.assert_frame_equal(read(file), frame, check_dtype=False)


def test_a_folder_is_a_study(tmp_path):
    frame = table(accuracy=[0.5])
    frame.to_parquet(tmp_path / "points.parquet")
    pd.testing.assert_frame_equal(read(tmp_path), frame)


def test_what_is_no_table_is_named(tmp_path):
    def written(name, content):
        file = tmp_path / name
        file.write_bytes(content)
        return file

    with pytest.raises(TableError, match=r"none\.csv: no such file"):
        read(tmp_path / "none.csv")
    with pytest.raises(TableError, match=r"points\.parquet: no such file"):
        read(tmp_path)
    for file in (
        written("torn.parquet", b"PAR1 and no more"),
        written("torn.json", b'{"rows": ['),
        written("empty.csv", b""),
        written("binary.csv", b"a,b\n\xff\xfe,1\n"),
    ):
        with pytest.raises(TableError, match=rf"{file.name}: the table cannot be read: \S"):
            read(file)
    with pytest.raises(TableError, match="the table has no rows"):
        read(written("header.csv", b"a,b\n"))
    with pytest.raises(TableError, match=r"points\.txt: must be a \.csv"):
        read(written("points.txt", b"a"))
    with pytest.raises(TableError, match="an object with 'rows'"):
        read(written("other.json", b"{}"))


def test_objectives_are_read_from_text():
    assert parse_goals("accuracy:max, energy_uj:min") == OBJECTIVES
    with pytest.raises(ExpressionError, match="'accuracy' must be followed by :max or :min, got ''"):
        parse_goals("accuracy")
    with pytest.raises(ExpressionError, match="'' must be followed"):
        parse_goals("accuracy:max,")
