import dataclasses
import os

import numpy as np
import pytest

from dse.base.records import Dataset, Head, Spikes
from dse.config import Sections
from dse.data.dataset import as_prepared, load, read_meta
from dse.data.dataset.files import Meta, read_spikes, write_dataset, write_spikes
from dse.data.recordings import RecordingError
from dse.store import heads_document
from tests.data.dataset.encoders import Levels, encoders  # noqa: F401
from tests.saved_data import part_of, save

NONE = np.zeros(0, dtype=np.int64)
DATASET = Dataset(
    spikes=Spikes(np.array([0, 1, 1, 3, 3]), np.array([2, 0, 1], dtype=np.int32), 2, 3, 5.0),
    target=np.array([1, 0]), classes=("a", "b"), start=np.array([0, 1], dtype=np.int32),
    start_low=np.array([0, 0], dtype=np.int32), start_high=np.array([1, 1], dtype=np.int32), n_steps=1,
    train=np.array([0]), validation=np.array([1]), test=NONE,
    positions=np.array([[0, 3, 0], [1, 3, 0], [0, 3, 1]], dtype=np.int32),
)  # fmt: skip


DESIGN = {
    "data": {"kind": "raster", "file": "x.npz", "step_ms": 5},
    "task": {"target": "letter"},
    "split": {"stratified": {"validation": 0.2}},
    "model": {"kind": "snn"},
    "training": {},
}


def same(a, b):
    for field in dataclasses.fields(a):
        x, y = getattr(a, field.name), getattr(b, field.name)
        if dataclasses.is_dataclass(x):
            same(x, y)
        elif isinstance(x, np.ndarray):
            assert np.array_equal(x, y) and x.dtype == y.dtype, field.name
        else:
            assert x == y, field.name


def test_a_data_set_comes_back_mapped_and_read_only(tmp_path):
    save(DATASET, tmp_path / "key")
    found = load(tmp_path / "key")
    same(DATASET, found)
    assert isinstance(found.spikes.channel, np.memmap) and not found.spikes.channel.flags.writeable
    assert read_meta(tmp_path / "key").warnings == ["too easy"]


def test_sources_are_laid_end_to_end_with_rows_for_the_longest(tmp_path):
    longer = Spikes(np.array([0, 2, 2, 4]), np.array([0, 2, 1, 2], dtype=np.int32), 3, 3, 5.0)
    window = np.array([1], dtype=np.int32)
    second = dataclasses.replace(
        DATASET, spikes=longer, start=window, start_low=window, start_high=window, n_steps=1
    )
    sentences = []
    write_spikes([part_of(DATASET), part_of(second)], tmp_path, progress=sentences.append)
    assert sentences == [f"preparing data: {i} of 3 recordings" for i in (1, 2, 3)]
    found = read_spikes(tmp_path)
    assert found.spikes.n_steps == 3
    assert found.spikes.row_offsets.tolist() == [0, 1, 1, 1, 3, 3, 3, 5, 5, 7]
    assert found.spikes.channel.tolist() == [2, 0, 1, 0, 2, 1, 2]
    assert found.start.tolist() == [0, 1, 1]
    assert found.lengths.tolist() == [2, 2]


@pytest.mark.parametrize("damage", ["absent", "no meta", "cut", "no spikes"])
def test_a_damaged_folder_is_named(tmp_path, damage):
    if damage != "absent":
        save(DATASET, tmp_path / "key")
    if damage == "no meta":
        (tmp_path / "key" / "meta.json").unlink()
    if damage == "cut":
        (tmp_path / "key" / "target.npy").write_bytes(b"\x93NUMPY")
    if damage == "no spikes":
        os.rename(tmp_path / "key spikes", tmp_path / "elsewhere")
    what = (
        "spikes: the spikes cannot be read" if damage == "no spikes" else "key: the data set cannot be read"
    )
    with pytest.raises(RecordingError, match=what):
        load(tmp_path / "key")


@pytest.mark.usefixtures("encoders")
def test_heads_and_reasons_come_back(tmp_path):
    head = Head("texture", ("x", "y"), np.array([1, 0]))
    save(DATASET, tmp_path / "key")
    split = DATASET.train, DATASET.validation, DATASET.test
    fitted = {"encoder": {"peeks": True, "levels": ((1.5, 2.0), (0.0, -1.0))}}
    meta = Meta(spikes="key spikes", classes=["a", "b"], fitted=fitted, warnings=[],
                heads=heads_document((head,)), transductive="reads")  # fmt: skip
    write_dataset(tmp_path / "key", DATASET.target, split, meta)
    same(dataclasses.replace(DATASET, heads=()), dataclasses.replace(load(tmp_path / "key"), heads=()))
    [found] = load(tmp_path / "key").heads
    same(head, found)
    assert read_meta(tmp_path / "key").transductive == "reads"
    design = Sections.from_plain({**DESIGN, "encoder": {"kind": "levels"}}, "a design")
    prepared = as_prepared(design, tmp_path / "key")
    assert prepared.encoder == Levels(peeks=True, levels=((1.5, 2.0), (0.0, -1.0)))
    assert dataclasses.replace(prepared, encoder=design.encoder) == design
