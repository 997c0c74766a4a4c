"""Writers of AEDAT files, after the specification: version 2 of jAER and 4 of DV."""

import struct

import numpy as np
import pyarrow

CHIPS = {
    "ch.unizh.ini.jaer.chip.retina.DVS128": (128, 128),
    "eu.seebetter.ini.chips.davis.DAVIS240C": (240, 180),
    "eu.seebetter.ini.chips.davis.Davis346red": (346, 260),
    "eu.seebetter.ini.chips.davis.Davis640": (640, 480),
}
DVS128, DAVIS240 = list(CHIPS)[:2]
VERSION_2, VERSION_4 = b"#!AER-DAT2.0\r\n", b"#!AER-DAT4.0\r\n"
END_2 = b"#End Of ASCII Header\r\n"


def _without_size(data):
    sink = pyarrow.BufferOutputStream()
    with pyarrow.CompressedOutputStream(sink, "zstd") as stream:
        stream.write(data)
    return sink.getvalue().to_pybytes()


COMPRESS = {
    "none": bytes,
    "lz4": lambda data: pyarrow.Codec("lz4").compress(data, asbytes=True),
    "lz4 high": lambda data: pyarrow.Codec("lz4", compression_level=9).compress(data, asbytes=True),
    "zstd": lambda data: pyarrow.Codec("zstd").compress(data, asbytes=True),
    "zstd high": _without_size,
}
STREAMS = (("EVTS", (320, 240)), ("FRME", (320, 240)), ("IMUS", None))


def head_2(chip=DVS128, end=END_2):
    named = b"" if chip is None else f"# AEChip: {chip}\r\n".encode()
    return VERSION_2 + b"# This is a raw AE data file - do not edit\r\n" + named + end


def stamped(addresses, t_us):
    return b"".join(struct.pack(">II", *x) for x in zip(addresses, t_us, strict=True))


def words(events, chip=DVS128):
    """Return words of AEDAT 2: jAER's chips count columns from the right and rows from the bottom."""
    width, height = CHIPS[chip]
    shifts = (8, 1, 0) if chip == DVS128 else (22, 12, 11)
    return b"".join(
        struct.pack(
            ">II",
            (height - 1 - y) << shifts[0]
            | (width - 1 - x) << shifts[1]
            | (p ^ (chip == DVS128)) << shifts[2],
            t % (1 << 32),
        )
        for t, x, y, p in events
    )


def prefixed(kind, table):
    """Return a size-prefixed flatbuffer; `table`, which begins at byte 12 of it, says where its root is."""
    root = 12 + struct.unpack_from("<H", table)[0]
    root += -root % 4
    data = struct.pack("<I", root - 4) + kind + table
    return struct.pack("<I", len(data)) + data


def head_4(compression="lz4", end=-1, streams=STREAMS):
    attr = '<attr key="{}" type="{}">{}</attr>'.format
    nodes = ""
    for i, (kind, size) in enumerate(streams):
        sides = zip(("sizeX", "sizeY"), size or (), strict=False)
        info = "".join(attr(key, "int", side) for key, side in sides)
        named = attr("typeIdentifier", "string", kind)
        nodes += f'<node name="{i}">{named}<node name="info">{info}</node></node>'
    number = list(COMPRESS).index(compression) if isinstance(compression, str) else compression
    return described(f'<dv version="2.0"><node name="outInfo">{nodes}</node></dv>'.encode(), number, end)


def described(text, compression, end=-1):
    lookup = struct.pack("<5H2x", 10, 20, 4, 12, 8)  # compression, end, text within the table
    table = struct.pack("<iiIq", 12, compression, 12, end)
    return VERSION_4 + prefixed(b"IOHE", lookup + table + struct.pack("<I", len(text)) + text + b"\x00")


def content(events, kind=b"EVTS", count=None):
    rows = np.array([(t, x, y, p, b"") for t, x, y, p in events], np.dtype("<i8, <i2, <i2, u1, V3"))
    table = struct.pack("<3H2xiI", 6, 8, 4, 8, 4)
    n = len(rows) if count is None else count
    return prefixed(kind, table + struct.pack("<I", n) + rows.tobytes())


def packet_4(data, stream=0, size=None):
    return struct.pack("<ii", stream, len(data) if size is None else size) + data


def coded(events, compression="lz4", stream=0, **fields):
    return packet_4(COMPRESS[compression](content(events, **fields)), stream)
