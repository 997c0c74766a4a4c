"""Weights beside the code: all tables of a classifier as one block, a struct of C with a checksum.

The code reads a block through a pointer, and `dse_load` takes it only if its checksum is right and its layout
that of the code: the CRC-32 of the source without comments. So weights of another training are an update
where nothing else has changed, and are refused where anything has.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Sequence

from dse.deploy.c.arrays import Table, dtype_of, laid_out
from dse.deploy.c.text import filled


def beside(source: str, tables: Sequence[Table], names: str) -> tuple[str, bytes]:
    """Return a source whose tables are in a block, and the block, given the names of classes in C."""
    defined = "\n".join(table.text for table in tables)
    before, after = source.split(defined)
    named = re.compile(rf"\b({'|'.join(table.name for table in tables)})\b")
    after = named.sub(r"net->weights->\1", after)
    placed = laid_out(tables)
    declared = filled("weights.c", tables=placed)
    code = re.sub(r"/\*.*?\*/", "", before + declared + after, flags=re.DOTALL)
    layout = zlib.crc32(f"{code}{names}".encode())
    return before + f"#define LAYOUT 0x{layout:x}u\n{declared}" + after, _block(layout, placed)


def _block(layout: int, tables: Sequence[Table]) -> bytes:
    body = b"".join(x.values.astype(dtype_of(x.kind).newbyteorder("<")).tobytes() for x in tables)
    widest = max(4, *(x.width for x in tables))
    body += bytes(-len(body) % widest)
    return struct.pack("<4I", layout, 16 + len(body), zlib.crc32(body), 0) + body
