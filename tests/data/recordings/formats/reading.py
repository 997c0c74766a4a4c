"""What the tests of the formats share: a file read whole, its faults, and real files."""

import signal
from contextlib import contextmanager

import numpy as np
import pytest

from dse.base.records import Block
from dse.data.recordings import RecordingError
from dse.data.recordings.formats import Repairs


def read(form, path, repair=False):
    """Return all events of a file, unchecked, and what was repaired."""
    repairs = Repairs(path.name, repair)
    blocks = list(form.blocks(path, repairs))
    types = {"t_us": np.int64, "x": np.int32, "y": np.int32, "polarity": np.uint8}
    for block in blocks:
        assert len(block.t_us) > 0
        assert {name: getattr(block, name).dtype for name in types} == types
    columns = {
        name: np.concatenate([np.empty(0, kind), *(getattr(block, name) for block in blocks)])
        for name, kind in types.items()
    }
    return Block(**columns), repairs.notes


def faulty(form, path, n_left, *sentences):
    """Check that a file is refused with a fault that repair notes, and return the events that repair leaves.

    Args:
        form: reads it.
        path: of the file.
        n_left: number of these events.
        sentences: parts of the fault and of the repair.
    """
    with pytest.raises(RecordingError) as error:
        read(form, path)
    found, notes = read(form, path, repair=True)
    assert len(notes) == 1 and len(found.t_us) == n_left
    for text in (str(error.value), notes[0]):
        assert text.startswith(f"{path.name}: ") and "; --repair " in text and "\n" not in text
    assert all(sentence in notes[0] for sentence in sentences), notes[0]
    return found


def refused(form, path, sentence):
    """Check that a file is refused even with repair."""
    for repair in (False, True):
        with pytest.raises(RecordingError) as error:
            read(form, path, repair)
        assert str(error.value).startswith(f"{path.name}: ") and sentence in str(error.value)
        assert "\n" not in str(error.value)


@contextmanager
def a_reader_that_hangs_fails(most_s=20):
    """Raise a TimeoutError in what takes longer: of fuzzing, which runs on nobody's watch."""

    def give_up(*_):
        raise TimeoutError(f"still reading after {most_s} s")

    before = signal.signal(signal.SIGALRM, give_up)
    signal.alarm(most_s)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def tuples(found):
    """Return events as t_us, x, y and polarity."""
    columns = (found.t_us, found.x, found.y, found.polarity)
    return list(zip(*(column.tolist() for column in columns), strict=True))


def block(*events):
    """Return events as a block."""
    t_us, x, y, polarity = np.array(events, dtype=np.int64).reshape(-1, 4).T
    return Block(t_us, x.astype(np.int32), y.astype(np.int32), polarity.astype(np.uint8))


def many(n, width, height):
    """Return n events that differ from each other."""
    return [(3 * i, i % width, i // 7 % height, i % 2) for i in range(n)]


# Format, frame, number of events, of them ON, the first and the last (what is known of them), and CRC-32 of
# t, x and y as others decode them.
RECORDED = {
    "faery_dvs.es": (
        *("es", (320, 240), 473225, 270001, (), (999000, 38, 193, 1)),
        [4149783995, 2153943521, 3035768722],
    ),
    "tonic_sample_nmnist.bin": (
        *("nmnist", (34, 34), 4325, None, (654, 7, 15, 1), (311175, 21, 14, 1), None),
    ),
    "tonic_sample_ncars.dat": ("dat", None, 2009, None, (0, 25, 8, 0), (99952, 75, 28, 1), None),
    "expelliarmus_evt2_sample.raw": ("evt2", None, 539481, 367855, (), (), None),
    "expelliarmus_evt3_sample.raw": ("evt3", None, 219596, None, (), (), None),
    "tonic_sample.aedat4": (
        *("aedat4", (320, 240), 111954, 55023, (1605537493718345, 154, 204), (1605537494308262, 88, 237)),
        [1231361461, 828355067, 2444565237],
    ),
    "tonic_sample_aedat_header.aedat": ("aedat2", (346, 260), 0, 0, (), (), None),
    "neutouch_sponge_trial1_5.tact": ("neutouch", (80, 1), 11099, None, (0,), (), None),
    "neutouch_stiff_block_trial1_5.tact": ("neutouch", (80, 1), 5386, None, (0,), (), None),
    "tonic_sample_stmnist.mat": ("stmnist", (10, 10), 2346, None, (), (895745,), None),
    "expelliarmus_evt3_sample_decoded.npz": ("npz", None, 219596, None, (), (), None),
}
"""Real files, and what is in them."""
MARKS = (
    b"",
    b"% evt 2.0\n",
    b"% evt 3.0\n",
    b"% Version 2\n\x0c\x08",
    b"#!AER-DAT2.0\r\n",
    b"#!AER-DAT3.1\r\nFormat: RAW\r\n#!END-HEADER\r\n",
    b"#!AER-DAT4.0\r\n",
    b"Event Stream\x02\x00\x00\x01\x40\x01\xf0\x00",
    b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM",
    b"\x89HDF\r\n\x1a\n",
    b"PK\x03\x04",
    b"0 12 1600000000.5\n",
    b"t,x,y,p\n1,2,",
)
"""How files of the formats begin, so that random bytes get past the first look."""
