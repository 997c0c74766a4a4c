import zipfile

import numpy as np
import pytest

from dse.recordings import RecordingError, arrays


def test_headers_give_shapes_and_load_gives_values(write):
    path = write("x.npz", a=np.arange(6).reshape(2, 3), b=np.array(["u", "v"]))
    assert arrays.headers(path) == {"a": (2, 3), "b": (2,)}
    assert arrays.load(path, ["a", "a"])["a"].tolist() == [[0, 1, 2], [3, 4, 5]]


def test_compressed_arrays_and_later_versions_of_the_format_are_read(tmp_path):
    np.savez_compressed(tmp_path / "x.npz", signal=np.ones(4))
    with zipfile.ZipFile(tmp_path / "x.npz", "a") as archive, archive.open("later.npy", "w") as stream:
        np.lib.format.write_array(stream, np.arange(3), version=(2, 0))
    assert arrays.headers(tmp_path / "x.npz") == {"signal": (4,), "later": (3,)}
    assert arrays.load(tmp_path / "x.npz", ["later"])["later"].tolist() == [0, 1, 2]


def test_wrong_name_lists_what_is_there(write):
    path = write("x.npz", signal=np.zeros(3), offsets=np.zeros(2))
    with pytest.raises(
        RecordingError, match=r"x.npz: no array 'signl'; known: .*signal.* Did you mean 'signal'\?"
    ):
        arrays.load(path, ["signl"])


@pytest.mark.parametrize("keep", [1, 30, 300, 5000])
def test_a_truncated_file_is_one_line_wherever_it_was_cut(write, keep):
    path = write("x.npz", signal=np.random.default_rng(0).random(1000))
    path.write_bytes(path.read_bytes()[:keep])
    for read in (arrays.headers, lambda p: arrays.load(p, ["signal"])):
        with pytest.raises(
            RecordingError, match=r"x.npz: .*cannot be read: it is not an .npz file, or is truncated"
        ) as error:
            read(path)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("text", [b"'shap_S]", b"'sha(pe ", b"  \n '\\x"])
@pytest.mark.parametrize("kind", ["x.npz", "x.npy"])
def test_a_header_that_is_no_text_of_python_is_one_line(tmp_path, kind, text):
    path = tmp_path / kind
    np.savez(path, array=np.zeros(4)) if kind == "x.npz" else np.save(path, np.zeros(4))
    path.write_bytes(path.read_bytes().replace(b"'shape'", text[:7].ljust(7)))
    with pytest.raises(RecordingError, match=rf"^{kind}: .*cannot be read") as error:
        arrays.headers(path)
    assert "\n" not in str(error.value)


def test_damage_inside_an_array_is_named(write):
    path = write("x.npz", signal=np.zeros(1000))
    content = bytearray(path.read_bytes())
    content[4000:4016] = b"\xff" * 16
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"array 'signal' of .*Bad CRC"):
        arrays.load(path, ["signal"])


def test_empty_file_and_pickled_array(write, tmp_path):
    (tmp_path / "empty.npz").write_bytes(b"")
    with pytest.raises(RecordingError, match=r"empty\.npz: the file is empty"):
        arrays.headers(tmp_path / "empty.npz")
    path = write("x.npz", label=np.array([{}, []], dtype=object))
    with pytest.raises(RecordingError, match=r"x\.npz: array 'label' holds Python objects"):
        arrays.load(path, ["label"])
