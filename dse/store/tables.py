"""Tables of a study as Parquet files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from dse.store.errors import StoreError
from dse.store.files import verify

if TYPE_CHECKING:
    import pandas

_MADE_FROM = "follows_from"


def write_table(path: Path, table: pandas.DataFrame, made_from: str = "") -> None:
    """Write a table without its index.

    Args:
        path: of the file.
        table: of a study.
        made_from: all that the table follows from, as a text; '' where nobody asks.

    Raises:
        StoreError: a column holds values of types that no table mixes.
    """
    import pyarrow.parquet

    try:
        content = pyarrow.Table.from_pandas(table, preserve_index=False)
    except pyarrow.ArrowException as error:
        raise StoreError(f"{path}: cannot be written: {str(error).splitlines()[0]}") from error
    with pyarrow.parquet.ParquetWriter(path, content.schema, compression="zstd") as writer:
        writer.write_table(content)
        writer.add_key_value_metadata({_MADE_FROM: made_from})


def made_from(path: Path) -> str:
    """Return what a table says it was made from; '' if it says nothing, or is not whole."""
    import pyarrow.parquet

    try:
        verify(path)
        metadata = pyarrow.parquet.read_metadata(path).metadata or {}
    except (StoreError, pyarrow.ArrowException, OSError):
        return ""
    return str(metadata.get(_MADE_FROM.encode(), b"").decode())
