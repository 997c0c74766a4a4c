"""Recordings that are not in memory: trials that are simulated, and events that stay in their files."""

import dataclasses
import os
import time
import tracemalloc
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from dse.base import registry
from dse.base.records import Array, Block, Signals
from dse.config.settings import Preprocessing
from dse.data import preprocessing
from dse.data.dataset import cache, find, load, read_meta, stages
from dse.data.dataset.encoding import as_signals
from dse.data.dataset.files import write_spikes
from dse.data.dataset.parts import Part, Rows, in_order
from dse.data.recordings import RecordingError
from dse.data.recordings.pooling import pooling
from tests.data.dataset.encoders import encoders  # noqa: F401
from tests.data.dataset.plain import (
    as_prepared,
    build,
    build_for,
    dense,
    entries,
    load_or_prepare,
    placed,
    prepare,
)
from tests.saved_data import in_a_row
from tests.spaces import sections

SIZE = 12
COLUMNS = {"texture": "texture", "speed": "speed", "part": "part"}


def block(seed, n=400, duration_us=20_000, first_us=0):
    """Return random events in the middle of the frame, and a few anywhere; most come after 5 ms or later."""
    rng = np.random.default_rng(seed)
    contact_us = 5000 + 1000 * (seed % 3)
    early = rng.integers(first_us, contact_us, 5)
    t_us = np.sort(np.concatenate([early, rng.integers(contact_us, duration_us, n - 5)]))
    x, y = (np.where(rng.random(n) < 0.05, rng.integers(0, SIZE, n), rng.integers(4, 8, n)) for _ in "xy")
    return Block(t_us, x.astype(np.int32), y.astype(np.int32), rng.integers(0, 2, n).astype(np.uint8))


@dataclasses.dataclass(frozen=True)
class Recorded:
    """Event recordings that are read when they are asked for; every reading of one is noted."""

    n_recordings: int
    first_us: int = 0
    read: list[int] = dataclasses.field(default_factory=list)
    width: int = SIZE
    height: int = SIZE
    front_end: ClassVar[str] = "preprocessing"
    simulated: ClassVar[bool] = False

    @property
    def columns(self) -> Mapping[str, Array]:
        i = np.arange(self.n_recordings)
        return {"texture": i % 2, "speed": i // 2 % 2, "part": i // 4 % 4}

    def blocks(self, i: int) -> Iterator[Block]:
        self.read.append(i)
        whole = block(i, first_us=self.first_us * (i + 1), duration_us=20_000 + 1000 * (i % 3))
        for part in np.array_split(np.arange(len(whole.t_us)), 3):
            yield Block(*(getattr(whole, f.name)[part] for f in dataclasses.fields(Block)))

    def notes(self) -> list[str]:
        return [f"recording {i} was repaired" for i in sorted(set(self.read)) if i == 1]


@dataclasses.dataclass(frozen=True)
class Scene:
    """Trials of 20 ms; the first of every four takes longest."""

    n_recordings: int = 16
    made: list[int] = dataclasses.field(default_factory=list)
    width: int = SIZE
    height: int = SIZE
    duration_us: int = 20_000
    front_end: ClassVar[str] = "preprocessing"
    simulated: ClassVar[bool] = True

    columns = Recorded.columns

    def notes(self) -> list[str]:
        return []

    def pins(self) -> tuple[int, int, int, int]:
        return 4, 4, 4, 4

    def blocks(self, i: int) -> Iterator[Block]:
        time.sleep(0.004 * (i % 4 == 0))
        self.made.append(i)
        yield block(i)


@dataclasses.dataclass(frozen=True)
class Kind:
    """A component whose recordings a test has put here by name."""

    file: str
    columns: Mapping[str, str] = dataclasses.field(default_factory=dict)
    there: ClassVar[dict[str, Any]] = {}

    def content(self, base: Path) -> str:
        return self.file

    def with_columns_found(self, base: Path) -> "Kind":
        return self

    def channel_positions(self, base: Path) -> None:
        """Return None: an event's position is its address."""

    def read(self, base: Path) -> Any:
        return self.there[self.file]


@pytest.fixture(autouse=True)
def kind():
    registry.known("recordings")
    registry._components["recordings"]["fake"] = Kind
    yield
    registry._components["recordings"].pop("fake")
    Kind.there.clear()


DESIGN = {
    "data": {"kind": "fake", "file": "scene", "columns": COLUMNS},
    "task": {"target": "texture"},
    "window": {"n_steps": 8, "at": "middle", "jitter_steps": 2},
    "split": {"train": {"part": [0, 1]}, "validation": {"part": 2}, "test": {"part": 3}},
    "preprocessing": {"bin_ms": 1, "pool": 2},
}
OF_FILES = {"data": {**DESIGN["data"], "file": "files"}}


def expected(source, i, design, first, n, t0_us=0):
    """Return the channels of bins first .. first + n - 1, pooled from the whole event list."""
    settings = Preprocessing(**design["preprocessing"])
    found = pooling(settings, SIZE, SIZE, (4, 4, 4, 4))
    counts, channels = preprocessing.pool(source.blocks(i), found, t0_us, first, n)
    return [part.tolist() for part in np.split(channels, np.cumsum(counts)[:-1])]


def window_of(data, i, first, n):
    return [np.repeat(np.arange(len(row)), row).tolist() for row in dense(data, i, first, n)]


def test_trials_of_a_scene_are_its_events_pooled():
    scene = Kind.there["scene"] = Scene()
    data, notes = build(DESIGN, Path())
    assert notes == []
    assert (data.n_steps, data.spikes.n_steps, data.spikes.n_channels) == (8, 12, 2 * 36)
    assert (data.train.size, data.validation.size, data.test.size) == (8, 4, 4)
    assert sorted(scene.made) == list(range(16)), "each trial is simulated once"
    for i in range(16):
        assert (data.start[i], data.start_low[i], data.start_high[i]) == (2, 0, 4)
        assert window_of(data, i, 0, 12) == expected(scene, i, DESIGN, 4, 12)
    contact = DESIGN | {"window": {"n_steps": 5, "at": "contact_onset", "onset_threshold": 10}}
    data, _ = build(contact, Path())
    for i in range(16):
        onset = int(np.argmax(np.bincount(block(i).t_us // 1000) >= 10))
        assert window_of(data, i, 0, 5) == expected(Scene(), i, DESIGN, onset, 5)


@pytest.mark.parametrize(
    "settings", [{"rate_floor_hz": 120}, {"crop": [3, 2, 6, 7]}, {"time_ms": [3, 19]}, {"pool_threshold": 2}]
)
def test_settings_mean_the_same_for_scenes_and_files(settings):
    design = DESIGN | {"preprocessing": {**DESIGN["preprocessing"], **settings}}
    Kind.there["scene"] = Scene()
    Kind.there["files"] = Recorded(16)
    simulated, _ = build(design, Path())
    first = 2 if "time_ms" in settings else 4
    for i in range(16):
        assert window_of(simulated, i, 0, 12) == expected(Scene(), i, design, first, 12)
    recorded, _ = build(design | OF_FILES, Path())
    pools = pooling(Preprocessing(**design["preprocessing"]), SIZE, SIZE)
    for i in range(16):
        source = Recorded(16)
        t0_us = int(next(source.blocks(i)).t_us[0])
        first = (preprocessing.survey(source.blocks(i), pools, 1).n_bins - 8) // 2 - 2
        assert window_of(recorded, i, 0, 12) == expected(source, i, design, first, 12, t0_us)


@pytest.mark.parametrize("file", ["scene", "files"])
def test_every_event_is_stored_with_its_time(file):
    Kind.there["scene"], Kind.there["files"] = Scene(), Recorded(16)
    design = DESIGN | {
        "data": {**DESIGN["data"], "file": file},
        "preprocessing": {"bin_ms": 1, "pool": 2, "every_event": True},
    }
    data, _ = build(design, Path())
    binned, _ = build(design | {"preprocessing": {"bin_ms": 1, "pool": 2}}, Path())
    spikes = data.spikes
    assert spikes.t_us is not None and spikes.t_us.dtype == np.int32
    assert spikes.channel.shape == spikes.t_us.shape and len(spikes.channel) > len(binned.spikes.channel)
    step = np.repeat(np.arange(len(spikes.row_offsets) - 1) % spikes.n_steps, np.diff(spikes.row_offsets))
    assert np.array_equal(step, spikes.t_us // 1000), "within the step whose row holds it"
    for i in range(16):
        events, bins = window_of(data, i, 0, 12), window_of(binned, i, 0, 12)
        assert [sorted(set(row)) for row in events] == bins
    new, _ = build_for(design, Path(), data.classes)
    assert np.array_equal(new.spikes.t_us, spikes.t_us) and new.test.size == 16


def test_an_encoder_sees_how_many_events_there_are(encoders):  # noqa: F811
    Kind.there["scene"] = Scene()
    preprocessing = {"bin_ms": 1, "pool": 4, "polarity": "merge", "every_event": True}
    bare, _ = build(DESIGN | {"preprocessing": preprocessing}, Path())
    stored = bare.spikes
    signals = as_signals(stored, np.arange(2), np.full(2, 12))
    for i in range(2):
        for t, channels in enumerate(window_of(bare, i, 0, 12)):
            assert signals.values[12 * i + t].tolist() == np.bincount(channels, minlength=9).tolist()
    assert signals.values.max() > 1
    encoder = {"kind": "threshold", "matching": "none"}
    encoded, _ = build(DESIGN | {"preprocessing": preprocessing, "encoder": encoder}, Path())
    assert encoded.spikes.t_us is None, "what an encoder makes is binary"


def test_files_are_read_twice_at_most_and_only_those_in_use():
    source = Kind.there["files"] = Recorded(16, first_us=50)
    design = DESIGN | OF_FILES | {"split": {"train": {"part": 0}, "validation": {"part": 2}}}
    used = [*range(4), *range(8, 12)]
    data, notes = build(design, Path())
    assert sorted(source.read) == sorted(used * 2) and notes == ["recording 1 was repaired"]
    n_spikes = np.diff(data.spikes.row_offsets).reshape(16, -1).sum(axis=1)
    assert np.flatnonzero(n_spikes).tolist() == used
    sentences = []
    placed(source, DESIGN, np.isin(np.arange(16), used), progress=sentences.append)
    assert sentences == [f"reading data: {done} of 8 recordings" for done in range(1, 9)]
    placed(Scene(), DESIGN, n_spikes > 0, progress=lambda _: pytest.fail("a scene has nothing to read"))

    class Silent(Recorded):
        def blocks(self, i):
            yield from () if i == 5 else super().blocks(i)

    Kind.there["files"] = Silent(16)
    with pytest.raises(RecordingError, match="recording 5 must have events, got none"):
        build(DESIGN | OF_FILES, Path())


def tree(folder):
    return {p.name: p.read_bytes() for p in folder.iterdir() if p.name != "lock"}


def test_any_number_of_threads_gives_the_same_bytes(tmp_path):
    Kind.there["scene"] = Scene()
    design = DESIGN | {"window": {"n_steps": 5, "at": "contact_onset", "onset_threshold": 10}}
    found = []
    for threads in (1, 2, 5):
        root = tmp_path / str(threads)
        root.mkdir()
        prepare(design, Path(), root, threads)
        found.append({path.name: tree(path) for path in root.iterdir() if path.is_dir()})
    assert len(found[0]) == 2
    assert found[0] == found[1] == found[2]


def test_results_come_in_order_and_few_wait():
    begun, taken = [], 0

    def slow(i):
        begun.append(i)
        time.sleep(0.002 * (i % 5 == 0))
        return i

    for result in in_order(slow, range(40), 3):
        assert result == taken
        taken += 1
        assert len(begun) - taken <= 2 * 3
    assert taken == 40


def test_a_fault_in_a_thread_ends_the_others():
    begun = []

    def fails(i):
        begun.append(i)
        if i == 3:
            raise RecordingError("recording 3 is bad")
        time.sleep(0.001)
        return i

    with pytest.raises(RecordingError, match="recording 3 is bad"):
        list(in_order(fails, range(1000), 2))
    assert len(begun) < 20


@pytest.mark.parametrize("threads", [1, 2])
def test_memory_does_not_follow_from_the_number_of_recordings(tmp_path, threads):
    n, n_spikes = 100, 100_000
    silent = np.zeros(n, np.int32)

    def large(i):
        return Rows(np.full(100, n_spikes // 100), np.full(n_spikes, i, np.int32))

    part = Part(
        silent, silent, silent, 100, 100, in_a_row(n), 1.0, np.full(n, 100), None,
        lambda k: in_order(large, range(n), k),
    )  # fmt: skip
    tracemalloc.start()
    try:
        write_spikes([part], tmp_path, threads)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    one = 4 * n_spikes
    assert (tmp_path / "channel.npy").stat().st_size > n * one
    assert peak < 2 * (2 * threads + 2) * one, "a few recordings of a hundred"


def test_texture_and_speed_share_their_spikes(tmp_path):
    scene = Kind.there["scene"] = Scene()
    design = DESIGN | {"split": {"stratified": {"validation": 0.25, "test": 0.25}}}
    speed = design | {"task": {"target": "speed"}, "split": {"stratified": {"validation": 0.5}}}
    cache.tidy(tmp_path)
    found = []
    for each in (design, speed, design):
        prepared = prepare(each, Path(), tmp_path)
        found.append(load(prepared))
    assert len(scene.made) == 16
    assert {name: len(keys) for name, keys in entries(tmp_path).items()} == {"spikes": 1, "dataset": 2}
    texture, speeds, again = found
    assert texture.target.tolist() == again.target.tolist() != speeds.target.tolist()
    assert texture.spikes.channel.filename == speeds.spikes.channel.filename
    prepare(design | {"preprocessing": {"bin_ms": 2}}, Path(), tmp_path)
    assert len(scene.made) == 32


@pytest.mark.parametrize("which", ["dataset", "spikes"])
@pytest.mark.parametrize("damage", ["discarded", "meta.json", "array"])
def test_what_is_not_there_or_cannot_be_read_is_made_again(tmp_path, which, damage):
    scene = Kind.there["scene"] = Scene()
    cache.tidy(tmp_path)
    folder = prepare(DESIGN, Path(), tmp_path)
    before = np.array(load_or_prepare(DESIGN, Path(), folder).spikes.channel)
    assert len(scene.made) == 16 and find(tmp_path, "unknown") is None
    (name,) = entries(tmp_path)[which]
    if damage == "discarded":
        cache.discard(tmp_path, name)
    else:
        array = {"dataset": "target.npy", "spikes": "channel.npy"}[which]
        file = tmp_path / name / (array if damage == "array" else damage)
        file.write_bytes(b"?" * file.stat().st_size)  # of the right size: only reading it tells
    assert find(tmp_path, folder.name) is None
    after = load_or_prepare(DESIGN, Path(), folder)
    assert np.array_equal(after.spikes.channel, before)
    assert {name: len(keys) for name, keys in entries(tmp_path).items()} == {"spikes": 1, "dataset": 1}
    for name in (folder.name, read_meta(folder).spikes):
        os.utime(tmp_path / name / "entry.json", (0, 0))
        load_or_prepare(DESIGN, Path(), folder)
        assert (tmp_path / name / "entry.json").stat().st_mtime > 0, "a load is a use"
    with pytest.raises(RecordingError, match="the recordings have changed since they were prepared"):
        load_or_prepare(DESIGN, Path(), tmp_path / "of_others")


PINS = DESIGN | OF_FILES | {"preprocessing": {"bin_ms": 1, "crop": "pins"}}


def test_a_crop_is_fitted_to_training_recordings_and_recorded(tmp_path):
    source = Kind.there["files"] = Recorded(16)
    cache.tidy(tmp_path)
    prepared = prepare(PINS, Path(), tmp_path)
    data, used = load(prepared), as_prepared(PINS, prepared)
    assert read_meta(prepared).warnings == ["recording 1 was repaired"]
    assert used.preprocessing == Preprocessing(bin_ms=1.0, crop=(4, 4, 4, 4))
    assert used.data == sections(PINS).data
    assert data.spikes.n_channels == 2 * 16
    assert source.read[:8] == list(range(8)), "the crop is fitted to the training recordings alone"
    fixed, _ = build(used, Path())
    assert np.array_equal(fixed.spikes.channel, data.spikes.channel)
    new, notes = build_for(used, Path(), data.classes)
    assert notes == ["recording 1 was repaired"]
    assert new.test.size == 16 and new.spikes.n_channels == 32
    with pytest.raises(RecordingError, match=r"crop must be .* because the positions of pins are unknown"):
        build_for(PINS, Path(), data.classes)


def test_a_scene_knows_its_pins(tmp_path):
    Kind.there["scene"] = Scene()
    cache.tidy(tmp_path)
    design = PINS | {"data": DESIGN["data"]}
    prepared = prepare(design, Path(), tmp_path)
    assert as_prepared(design, prepared).preprocessing.crop == (4, 4, 4, 4)
    assert load(prepared).spikes.n_channels == 32
    plain = DESIGN | {"preprocessing": {"bin_ms": 1, "crop": [2, 2, 3, 3]}}
    prepared = prepare(plain, Path(), tmp_path)
    assert as_prepared(plain, prepared) == sections(plain)


@pytest.mark.usefixtures("encoders")
def test_a_scene_is_simulated_once_for_all_encoders(tmp_path):
    scene = Kind.there["scene"] = Scene()
    cache.tidy(tmp_path)
    plain, _ = build(DESIGN, Path())
    assert len(scene.made) == 16
    for number, encoder in enumerate(
        ({"kind": "counting"}, {"kind": "counting", "every": 2}, {"kind": "levels"})
    ):
        prepared = prepare(DESIGN | {"encoder": encoder}, Path(), tmp_path, threads=2)
        data = load(prepared)
        assert len(scene.made) == 32
        assert np.array_equal(data.start, plain.start) and data.n_steps == plain.n_steps
        if not number:
            assert np.array_equal(data.spikes.channel, plain.spikes.channel)
            assert np.array_equal(data.positions, plain.positions)
    assert data.spikes.n_channels == 2 * 72 and data.positions[:, 2].max() == 3


@pytest.mark.parametrize("settings", [{}, {"crop": [3, 2, 6, 7]}, {"time_ms": [3, 19]}, {"crop": "pins"}])
@pytest.mark.parametrize("file", ["scene", "files"])
def test_stages_end_with_what_the_data_set_holds(file, settings):
    preprocess = {**DESIGN["preprocessing"], **settings}
    design = DESIGN | {"data": {**DESIGN["data"], "file": file}, "preprocessing": preprocess}
    source = Kind.there[file] = Scene() if file == "scene" else Recorded(16, first_us=300)
    if settings.get("crop") == "pins":
        design |= {"preprocessing": preprocess | {"crop": [4, 4, 4, 4]}}  # as it is recorded once fitted
    data, _ = build(design, Path())
    for i in (0, 5, 15):
        seen = stages(sections(design), Path(), i)
        assert seen.end_us - seen.begin_us == 1000 * data.n_steps
        bins = np.repeat(np.arange(len(seen.counts)), seen.counts)
        first = seen.begin_us // 1000
        window = [seen.channels[bins == first + k].tolist() for k in range(data.n_steps)]
        assert window == window_of(data, i, int(data.start[i]), data.n_steps)
        whole = [event for part in source.blocks(i) for event in part.t_us.tolist()]
        assert seen.events.t_us.tolist() == [t - (0 if file == "scene" else whole[0]) for t in whole]
        assert seen.name == f"recording {i}" and seen.frame == (SIZE, SIZE)


def test_stages_of_what_is_not_there():
    Kind.there["scene"] = Scene()
    with pytest.raises(RecordingError, match="recording must be below 16, got 16"):
        stages(sections(DESIGN), Path(), 16)
    Kind.there["scene"] = Signals(np.zeros((8, 1), np.float32), np.array([0, 8]), 1.0, {})
    with pytest.raises(RecordingError, match="data must be events to be preprocessed, got kind 'fake'"):
        stages(sections(DESIGN), Path(), 0)
