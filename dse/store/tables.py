"""Tables of a study as sealed Parquet files."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from dse.store.sealed import BLANK, seal

if TYPE_CHECKING:
    import pandas
    import pyarrow
    import pyarrow.parquet


@contextlib.contextmanager
def parquet(path: Path, schema: pyarrow.Schema) -> Iterator[pyarrow.parquet.ParquetWriter]:
    """Yield the writer of a Parquet file, which is sealed when the block ends without an error."""
    import pyarrow.parquet

    with pyarrow.parquet.ParquetWriter(path, schema) as writer:
        yield writer
        writer.add_key_value_metadata({"seal": BLANK.decode()})
    seal(path)


def write_table(path: Path, table: pandas.DataFrame) -> None:
    """Write a table without its index."""
    import pyarrow

    content = pyarrow.Table.from_pandas(table, preserve_index=False)
    with parquet(path, content.schema) as writer:
        writer.write_table(content)
