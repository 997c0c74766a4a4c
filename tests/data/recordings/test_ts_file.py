"""Text files of the archive of time series (.ts)."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.cli import main
from dse.data.recordings import RecordingError, arrays

HEAD = (
    "# A comment: with a colon.\n@problemName touch\n@timeStamps false\n@classLabel true felt silk\n@data\n"
)


def written(folder, text):
    path = folder / "touch_TRAIN.ts"
    path.write_text(text)
    return path


@given(st.integers(1, 4), st.lists(st.integers(1, 5), min_size=1, max_size=5), st.integers(0, 2**31))
def test_what_is_written_is_read(tmp_path_factory, n_channels, lengths, seed):
    rng = np.random.default_rng(seed)
    recordings = [rng.standard_normal((n, n_channels)) for n in lengths]
    recordings[0][0, 0] = np.nan
    lines = [
        ":".join(
            [*(",".join("?" if np.isnan(x) else repr(float(x)) for x in channel) for channel in of.T), "silk"]
        )
        for of in recordings
    ]
    path = written(tmp_path_factory.mktemp("ts"), HEAD + "\n".join(lines) + "\n\n")
    found = arrays.load(path)
    assert set(found) == {"signal", "label"} and found["label"].tolist() == ["silk"] * len(lengths)
    assert (found["signal"].dtype == object) == (len(set(lengths)) > 1)
    for one, other in zip(found["signal"], recordings, strict=True):
        np.testing.assert_array_equal(one, other)
    n_steps = -1 if len(set(lengths)) > 1 else lengths[0]
    assert arrays.headers(path) == {"signal": (len(lengths), n_steps, n_channels), "label": (len(lengths),)}


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("", "the file is empty"),
        ("export const x = 1;\n", "@data"),
        (HEAD, "no recording"),
        (HEAD.replace("false", "true") + "(0,1),(1,2):silk\n", "@timeStamps true"),
        (HEAD.replace("@classLabel true", "@classLabel false") + "1,2\n", "@classLabel"),
        (HEAD + "1,2:3,4:silk\n1,2:silk\n", "line 7: .* 2 channels"),
        (HEAD + "1,2:3:silk\n", "line 6: .* 1, 2 samples"),
        (HEAD + "1,x:silk\n", "line 6: .*'x'"),
        (HEAD + "silk\n", "line 6: .*0 channels of no samples"),
        (HEAD + "1,2:3,4:silk\n1,2:3,4:5,6", "line 7: .*got '5,6'"),  # cut short
        (HEAD.replace("@classLabel true felt silk", "@classLabel") + "1,2\n", "no @classLabel"),
    ],
)
def test_what_is_none_is_one_line(tmp_path, text, fault):
    with pytest.raises(RecordingError) as refused:
        arrays.load(written(tmp_path, text))
    assert re.search(fault, str(refused.value)) and "\n" not in str(refused.value)


def test_marks_and_line_ends_of_windows_are_no_text(tmp_path):
    path = tmp_path / "touch.TS"
    path.write_bytes(b"\xef\xbb\xbf@classLabel True a b\r\n@DATA\r\n1,2:3,4:a\r\n5,6:7,8:b\r\n")
    found = arrays.load(path)
    assert found["label"].tolist() == ["a", "b"] and found["signal"].tolist()[1] == [[5, 7], [6, 8]]


def test_a_first_space_reads_it(tmp_path, capsys):
    rng = np.random.default_rng(0)
    lines = [
        ",".join(f"{x:.3f}" for x in rng.standard_normal(20).cumsum()) + (":felt", ":silk")[k % 2]
        for k in range(24)
    ]
    path, space = written(tmp_path, HEAD + "\n".join(lines)), tmp_path / "touch.yaml"
    assert main(["init", str(path), "--step-ms", "10", "--out", str(space)]) == 0
    assert main(["check", str(space)]) == 0
    text = space.read_text()
    assert "signal: signal" in text and "{label: label}" in text and "target: label" in text
