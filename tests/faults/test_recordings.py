"""Small recordings that ask for much: a clear line within little memory."""

import importlib
import io
import struct
import tracemalloc
import zipfile

import numpy as np
import pytest
from numpy.lib import format as npy

from dse.data.recordings import RecordingError
from tests.data.dataset.plain import prepare
from tests.data.recordings.formats.encoders import (
    evt2_event,
    evt2_high,
    evt3_high,
    evt3_low,
    evt3_x,
    evt3_y,
    raw,
)
from tests.spaces import sections

MOST_BYTES = 1 << 29
HEADER = "% evt {}\n% geometry 64x64\n% end\n"
WRAPS = 10_000
EVT3 = [evt3_y(1), *(word for _ in range(WRAPS) for word in (evt3_high(4095), evt3_high(0)))]
EVT2 = [word for _ in range(200) for word in (evt2_high(0xFFFFFFF), evt2_high(0), evt2_event(3, 1, 2, 1))]


def files(evt3, evt2):
    """Return a recording of each format, with words between its first and its last event."""
    begin, end = [evt3_high(0), evt3_y(1), evt3_low(5), evt3_x(1, 1)], [evt3_low(9), evt3_x(2, 1)]
    return {
        "evt3": raw([*begin, *evt3, *end], 2, HEADER.format("3.0")),
        "evt2": raw([evt2_high(0), evt2_event(1, 1, 1, 1), *evt2], 4, HEADER.format("2.0")),
    }


def design(data, **more):
    return {
        "data": data,
        "task": {"target": "fabric"},
        "split": {"stratified": {"validation": 0.5}},
        "model": {"kind": "snn"},
        **more,
    }


def refusal(data, folder, **more):
    """Return the sentence that refuses recordings, and check the memory that it took."""
    importlib.import_module("numba")  # whose code objects are no part of what a file asks for
    tracemalloc.start()
    try:
        with pytest.raises(RecordingError) as refused:
            prepare(sections(design(data, **more)), folder, folder / "cache")
        assert tracemalloc.get_traced_memory()[1] < MOST_BYTES
    finally:
        tracemalloc.stop()
    return str(refused.value)


@pytest.mark.parametrize("kind", ["evt3", "evt2"])
def test_times_that_wrap_again_and_again(tmp_path, kind):
    for label in ("felt", "silk"):
        (tmp_path / "all" / label).mkdir(parents=True)
        for k in range(2):
            content = files(EVT3, EVT2) if (label, k) == ("felt", 0) else files([], EVT2[:3])
            (tmp_path / "all" / label / f"{k}.raw").write_bytes(content[kind])
    data = {"kind": "event_files", "folder": "all", "label_from": "folder", "repair": True}
    data["columns"] = {"fabric": "folder"}
    text = refusal(data, tmp_path, preprocessing={"bin_ms": 1.0})
    assert "must last at most 67108864 steps" in text


def test_a_frame_without_end(tmp_path):
    events = {name: np.arange(8) for name in ("t", "x", "y", "p")}
    labels = np.array([0, 0, 1, 1])
    np.savez(tmp_path / "x.npz", **events, offsets=np.arange(0, 10, 2), label=labels)
    data = {
        "kind": "events", "file": "x.npz", "t_us": "t", "x": "x", "y": "y", "offsets": "offsets",
        "width": 10**9, "height": 10**6, "columns": {"fabric": "label"},
    }  # fmt: skip
    text = refusal(data, tmp_path, preprocessing={"bin_ms": 1.0})
    assert "the frame must have at most 16777216 pixels" in text


def member(shape, content):
    head = io.BytesIO()
    npy.write_array_header_1_0(head, {"descr": "|u1", "fortran_order": False, "shape": shape})
    return head.getvalue() + content


@pytest.mark.parametrize(
    ("shape", "n_bytes", "text"),
    [
        ((1 << 40, 4, 4), 64, "declares uint8 of shape (1099511627776, 4, 4), but holds 64 bytes"),
        ((-1, 4, 4), 64, "an array cannot have shape (-1, 4, 4)"),
        ((4, 17 << 22), 17 << 24, "must be at most 200 times as large as it is stored"),
    ],
)
def test_arrays_that_are_not_what_they_declare(tmp_path, shape, n_bytes, text):
    with zipfile.ZipFile(tmp_path / "x.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        with archive.open("spikes.npy", "w") as file:
            file.write(member(shape, b""))
            for _ in range(max(1, n_bytes >> 24)):
                file.write(bytes(min(n_bytes, 1 << 24)))
        archive.writestr("label.npy", member((4,), struct.pack("4B", 0, 0, 1, 1)))
    data = {
        "kind": "raster",
        "file": "x.npz",
        "array": "spikes",
        "step_ms": 5.0,
        "columns": {"fabric": "label"},
    }
    assert text in refusal(data, tmp_path)
