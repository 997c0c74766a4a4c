"""Recordings from Python: what the file of section `data` holds is what was given."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dse
from dse.base import registry
from dse.data.recordings import RecordingError

CUBE = np.arange(24, dtype=np.float32).reshape(2, 4, 3)
EVENTS = np.array([(5, 1, 0, 1), (9, 3, 2, -1)], [("t", "i8"), ("x", "i2"), ("y", "i2"), ("p", "i1")])


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def read(data):
    keys = {key: value for key, value in data.items() if key != "kind"}
    source = registry.known("recordings")[data["kind"]](**keys)
    assert source.check(Path("elsewhere")) == []
    return source.read(Path("elsewhere"))


@pytest.mark.parametrize(
    ("signals", "axes"),
    [
        (CUBE, None),
        (CUBE.transpose(0, 2, 1), "recording channel step"),
        (list(CUBE), None),
        ([x.T for x in CUBE], "channel step"),
    ],
)
def test_arrays_and_lists_hold_the_same(signals, axes):
    data = dse.data.from_arrays(signals, ["silk", "wool"], step_ms=4, axes=axes)
    found = read(data)
    assert found.values.tolist() == CUBE.reshape(8, 3).tolist() and found.offsets.tolist() == [0, 4, 8]
    assert found.columns["label"].tolist() == ["silk", "wool"] and found.step_ms == 4
    assert Path(data["file"]).parent == Path("recordings").absolute()


def test_features_of_scikit_learn_are_steps_of_one_channel():
    found = read(dse.data.from_arrays(CUBE[..., 0], {"y": [3, 4], "fold": ["a", "b"]}, step_ms=1, file="x"))
    assert found.values.ravel().tolist() == CUBE[..., 0].ravel().tolist()
    assert {name: x.tolist() for name, x in found.columns.items()} == {"y": [3, 4], "fold": ["a", "b"]}
    assert Path("x.npz").is_file()


def test_recordings_of_unequal_length():
    found = read(dse.data.from_arrays([CUBE[0], CUBE[1, :2]], step_ms=1))
    assert found.offsets.tolist() == [0, 4, 6] and found.columns == {}


@pytest.mark.parametrize("scale", [1, 1000])
def test_events_with_fields_or_columns(scale):
    columns = np.stack([EVENTS["t"] / scale, EVENTS["x"], EVENTS["y"], EVENTS["p"]], axis=1)
    unit = {1: "us", 1000: "ms"}[scale]
    found = read(dse.data.from_events([columns, columns[:0]], ["a", "b"], time_unit=unit))
    assert found.t_us.tolist() == [5, 9] and found.x.tolist() == [1, 3] and found.y.tolist() == [0, 2]
    assert found.polarity.tolist() == [1, 0] and found.offsets.tolist() == [0, 2, 2]
    assert (found.width, found.height) == (4, 3)
    named = EVENTS.astype([("ts", "f8"), ("xs", "i4"), ("ys", "i4"), ("pol", "?")])
    assert read(dse.data.from_events([named], width=9, height=9)).width == 9
    four = read(dse.data.from_events([tuple(columns.T)], time_unit=unit))
    assert (four.t_us.tolist(), four.x.tolist()) == ([5, 9], [1, 3])


class Torch:
    """A data set by index, as torch has them."""

    classes = ("silk", "wool")

    def __init__(self, samples: list[Any]) -> None:
        self._samples = samples

    def __len__(self) -> int:
        return len(self._samples)

    def __getitem__(self, i: int) -> tuple[Any, np.int64]:
        return self._samples[i], np.int64(i)


def test_data_sets_yield_samples_and_labels():
    found = read(dse.data.from_dataset(Torch([CUBE[0], CUBE[1]]), step_ms=2))
    assert found.columns["label"].tolist() == ["silk", "wool"] and found.n_channels == 3
    tonic = Torch([EVENTS, EVENTS])
    tonic.sensor_size = (8, 8, 2)
    assert read(dse.data.from_dataset(tonic)).width == 8
    assert read(dse.data.from_dataset(iter([(CUBE[0], 7)]), step_ms=2)).columns["label"].tolist() == [7]
    torch = pytest.importorskip("torch")
    tensors = torch.utils.data.TensorDataset(torch.as_tensor(CUBE), torch.tensor([1, 0]))
    assert read(dse.data.from_dataset(tensors, step_ms=2)).columns["label"].tolist() == [1, 0]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: dse.data.from_arrays(CUBE, [1], step_ms=1), r"each of the 2 recordings, got shape \(1,\)"),
        (lambda: dse.data.from_arrays(CUBE, [1, np.nan], step_ms=1), "'label' is NaN for recording 1"),
        (lambda: dse.data.from_arrays(CUBE, [{}, []], step_ms=1), "must hold numbers or texts, got object"),
        (lambda: dse.data.from_arrays(CUBE, step_ms=0), "step_ms must be a number > 0, got 0"),
        (lambda: dse.data.from_arrays(CUBE[0, 0], step_ms=1), r"got shape \(3,\)"),
        (lambda: dse.data.from_arrays([CUBE[0], CUBE[1, :, :2]], step_ms=1), "3 in recording 0 and 2 in rec"),
        (lambda: dse.data.from_arrays([CUBE], step_ms=1), r"recording 0 must be \(step, channel\)"),
        (lambda: dse.data.from_arrays([], step_ms=1), "at least one recording"),
        (lambda: dse.data.from_arrays([["a"], ["b"]], step_ms=1), "recording 0 must hold numbers, got <U1"),
        (lambda: dse.data.from_arrays(CUBE * np.nan, step_ms=1), "recording 0 is empty"),
        (lambda: dse.data.from_events([EVENTS[::-1]]), "times must not decrease .* event 1 of recording 0"),
        (lambda: dse.data.from_events([EVENTS[["t", "y"]]]), "must have fields t and x, got t, y without x"),
        (lambda: dse.data.from_events([EVENTS], width=2), r"address must be in \[0, 1\], got 3 at event 1"),
        (lambda: dse.data.from_events([np.ones((2, 3))]), r"or \(event, 4\), got float64 of shape \(2, 3\)"),
        (lambda: dse.data.from_events([np.full((1, 4), 0.5)]), "whole numbers as x, got 0.5"),
        (lambda: dse.data.from_events([]), "at least one recording"),
        (lambda: dse.data.from_dataset([CUBE]), r"item 0 must be \(sample, label\), got ndarray"),
        (lambda: dse.data.from_dataset(Torch([CUBE[0]])), "step_ms is required for signals"),
    ],
)
def test_each_fault_is_one_clear_line(call, message):
    with pytest.raises(RecordingError, match=message) as error:
        call()
    assert "\n" not in str(error.value)
    assert not list(Path().rglob("*.npz"))
