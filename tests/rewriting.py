"""Runs of a study on disk, changed as if dse had written them so, or as a disk may."""

import zipfile
from pathlib import Path

from dse import store


def rewrite(run, change):
    """Change the record of a run, which the book of its study knows."""
    record = store.record_in(run)
    parts = {name: store.load_arrays(run / name) for name in record.pop("files")}
    store.save_run(run, change(record), parts, replaces=True)
    with store.Book(run.parents[1], writes=True) as book:
        store.note_files(book, [run])


def damage_part(run, name):
    """Change a bit of every array of a part of a run."""
    content = bytearray(run.read_bytes())
    with zipfile.ZipFile(run) as archive:
        for member in archive.infolist():
            if member.filename.startswith(f"{Path(name).stem}/"):
                head = member.header_offset
                sizes = content[head + 26 : head + 30]
                begin = head + 30 + int.from_bytes(sizes[:2], "little") + int.from_bytes(sizes[2:], "little")
                content[begin + member.compress_size // 2] ^= 1
    run.write_bytes(content)
