"""What holds for every event file format: bad bytes are a sentence or a repair, and files are told apart."""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dse.base.registry import known
from dse.data.recordings import RecordingError
from dse.data.recordings.formats import BLOCK_EVENTS, Repairs, checked, detect, named
from tests.data.recordings.formats.encoders import dat, evt2_words, evt3_words, nmnist, raw
from tests.data.recordings.formats.reading import MARKS, RECORDED

FORMATS = list(known("recordings.formats"))
assert {"dat", "evt2", "evt3", "nmnist"} <= set(FORMATS)
FRAME = (320, 240)
ONE = [(70, 3, 4, 1)]


def read(path, name, repair):
    """Read a file to its end, or to its RecordingError; what comes out must be sound."""
    form = named(name)
    repairs = Repairs(path.name, repair)
    n_events, latest = 0, 0
    try:
        width, height = form.frame(path) or FRAME
        assert width > 0 and height > 0
        for block in checked(form.blocks(path, repairs), width, height, repairs):
            n = len(block.t_us)
            assert len({len(column) for column in vars(block).values()}) == 1
            assert 0 < n <= 16 * BLOCK_EVENTS
            assert block.t_us[0] >= latest and (block.t_us[1:] >= block.t_us[:-1]).all()
            assert 0 <= block.x.min() and block.x.max() < width
            assert 0 <= block.y.min() and block.y.max() < height
            assert block.polarity.max() <= 1
            n_events, latest = n_events + n, int(block.t_us[-1])
    except RecordingError as error:
        assert str(error).startswith(f"{path.name}: ") and "\n" not in str(error)
        return None
    assert repair or not repairs.notes
    return n_events


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("contract")


@pytest.mark.parametrize("name", FORMATS)
def test_an_empty_file_no_file_and_a_folder(folder, name):
    suffixes = named(name).suffixes
    assert suffixes and all(x.startswith(".") and x == x.lower() for x in suffixes)
    path = folder / f"empty{suffixes[0]}"
    path.write_bytes(b"")
    assert read(path, name, repair=False) is None
    assert read(path, name, repair=True) in (None, 0)
    for path in (folder / "none", folder):
        assert read(path, name, repair=True) is None
        with pytest.raises(RecordingError, match="cannot be read"):
            detect(path)


@pytest.mark.parametrize("name", FORMATS)
@given(mark=st.sampled_from(MARKS), content=st.binary(max_size=200), repair=st.booleans())
def test_random_bytes(folder, name, mark, content, repair):
    path = folder / f"random{named(name).suffixes[0]}"
    path.write_bytes(mark + content)
    read(path, name, repair)


@pytest.mark.parametrize("file", RECORDED)
@settings(max_examples=6, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_real_files_cut_and_damaged(shared_data, folder, file, data):
    content = (shared_data / "native_event_files" / file).read_bytes()[: 1 << 15]
    cut = data.draw(st.integers(0, len(content)) | st.integers(0, min(700, len(content))), label="cut")
    damaged = bytearray(content[:cut])
    at = st.integers(0, max(cut - 1, 0)) | st.integers(0, min(700, max(cut - 1, 0)))
    for place, byte in data.draw(st.lists(st.tuples(at, st.integers(0, 255)), max_size=4), label="bytes"):
        damaged[place : place + 1] = bytes([byte])
    path = folder / file
    path.write_bytes(damaged)
    for repair in (False, True):
        read(path, RECORDED[file][0], repair)


@pytest.mark.parametrize(
    ("file", "content", "name"),
    [
        ("a.raw", raw(evt2_words(ONE), 4, "% evt 2.0\n"), "evt2"),
        ("a.raw", raw(evt3_words(ONE), 2, "% format EVT3;height=720;width=1280\n"), "evt3"),
        ("a.DAT", dat(ONE, "% Width 304\n"), "dat"),
        ("a.dat", b"no header", "dat"),
        ("a.bin", nmnist(ONE), "nmnist"),
        ("a.BIN", b"\xff" * 10, "nmnist"),
        ("evt2", raw([], 4, "% evt 2.0\n"), "evt2"),
    ],
)
def test_content_decides_and_then_the_suffix(folder, file, content, name):
    (folder / file).write_bytes(content)
    assert detect(folder / file) == named(name)


@pytest.mark.parametrize(
    ("file", "content", "sentence"),
    [
        ("a.raw", b"\x00" * 8, "could be any of evt2, evt3"),
        ("a.txt", b"hello", "has no known format"),
        ("a", b"", "has no known format"),
    ],
)
def test_a_file_that_could_be_several_or_none(folder, file, content, sentence):
    (folder / file).write_bytes(content)
    with pytest.raises(RecordingError, match=f"^{file}: {sentence}; set the key 'format' to one of .*evt3"):
        detect(folder / file)
    with pytest.raises(RecordingError, match=r"^format must be one of .*evt2, evt3.*, got 'evt'$"):
        named("evt")


def test_repairs_count_each_kind():
    repairs = Repairs("a.raw", True)
    repairs("one is bad", "drops it")
    repairs("two are bad", "drops it", 2)
    repairs("other", "keeps it")
    assert repairs.notes == [
        "a.raw: one is bad; --repair drops it (3 in all)",
        "a.raw: other; --repair keeps it",
    ]
    with pytest.raises(RecordingError, match=r"^a\.raw: one is bad; --repair drops it$"):
        Repairs("a.raw", False)("one is bad", "drops it")
