"""Tables of a study as Parquet files."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from dse.store.errors import StoreError
from dse.store.files import verify

if TYPE_CHECKING:
    import pandas
    import pyarrow
    import pyarrow.parquet

_MADE_FROM = "follows_from"


@contextlib.contextmanager
def parquet(
    path: Path, schema: pyarrow.Schema, made_from: str = ""
) -> Iterator[pyarrow.parquet.ParquetWriter]:
    """Yield the writer of a Parquet file.

    Args:
        path: of the file.
        schema: of its columns.
        made_from: all that the table follows from, as a text; '' where nobody asks.
    """
    import pyarrow.parquet

    with pyarrow.parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        yield writer
        writer.add_key_value_metadata({_MADE_FROM: made_from})


def write_table(path: Path, table: pandas.DataFrame, made_from: str = "") -> None:
    """Write a table without its index; `made_from` as in `parquet`.

    Raises:
        StoreError: a column holds values of types that no table mixes.
    """
    import pyarrow

    try:
        content = pyarrow.Table.from_pandas(table, preserve_index=False)
    except pyarrow.ArrowException as error:
        raise StoreError(f"{path}: cannot be written: {str(error).splitlines()[0]}") from error
    with parquet(path, content.schema, made_from) as writer:
        writer.write_table(content)


def made_from(path: Path) -> str:
    """Return what a table says it was made from; '' if it says nothing, or is not whole."""
    import pyarrow.parquet

    try:
        verify(path)
        metadata = pyarrow.parquet.read_metadata(path).metadata or {}
    except (StoreError, pyarrow.ArrowException, OSError):
        return ""
    return str(metadata.get(_MADE_FROM.encode(), b"").decode())
