import numpy as np
import pytest

from dse.data.recordings import RecordingError
from tests.data.dataset.plain import dataset_key, same_spikes, spikes_key

DESIGN = {
    "data": {"kind": "raster", "file": "x.npz", "step_ms": 5, "columns": {"letter": "label"}},
    "task": {"name": "letters", "target": "letter"},
    "split": {"stratified": {"validation": 0.2}},
    "window": {"n_steps": 20},
    "model": {"kind": "snn", "hidden": [100]},
}
ENCODER = {"kind": "send_on_delta", "thresholds": [1]}
OF_SPIKES = (
    {"window": {"n_steps": 21}},
    {"data": {**DESIGN["data"], "step_ms": 6}},
    {"data": {**DESIGN["data"], "positions": [[0, 1]]}},
    {"test": {"file": "x.npz"}},
    {"encoder": ENCODER},
    {"preprocessing": {"bin_ms": 1}},
)
OF_LABELS = (
    {"task": {"target": "word"}},
    {"task": {**DESIGN["task"], "joint": True}},
    {"split": {"stratified": {"validation": 0.3}}},
    {"data": {**DESIGN["data"], "columns": {"letter": "other"}}},
)
USED = [np.array([True, True, False])]


@pytest.fixture
def folders(tmp_path):
    for folder, content in (("a", b"one"), ("b", b"one"), ("c", b"two")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "x.npz").write_bytes(content)
    return tmp_path


def test_the_key_follows_content_and_sections_alone(folders):
    key = dataset_key(DESIGN, folders / "a")
    assert dataset_key(DESIGN, folders / "b") == key != dataset_key(DESIGN, folders / "c")
    assert dataset_key(DESIGN | {"model": {"kind": "snn", "hidden": [7]}}, folders / "a") == key
    for task in ({"name": "x", "target": "letter"}, {**DESIGN["task"], "joint": False}):
        assert dataset_key(DESIGN | {"task": task}, folders / "a") == key
    for change in (*OF_SPIKES, *OF_LABELS):
        assert dataset_key(DESIGN | change, folders / "a") != key, change


def test_spikes_do_not_follow_from_labels(folders):
    key = spikes_key(DESIGN, folders / "a", USED)
    assert key != dataset_key(DESIGN, folders / "a")
    assert spikes_key(DESIGN, folders / "b", USED) == key != spikes_key(DESIGN, folders / "c", USED)
    for change in OF_LABELS:
        assert spikes_key(DESIGN | change, folders / "a", USED) == key, change
    for change in OF_SPIKES:
        assert spikes_key(DESIGN | change, folders / "a", USED) != key, change
    for used in ([np.array([True, True, True])], [np.array([True, True])]):
        assert spikes_key(DESIGN, folders / "a", used) != key


def test_what_may_share_spikes_is_known_without_recordings():
    text = same_spikes(DESIGN)
    for change in OF_LABELS[:3]:
        assert same_spikes(DESIGN | change) == text, change
    for change in OF_SPIKES:
        assert same_spikes(DESIGN | change) != text, change
    events = DESIGN | {"preprocessing": {"bin_ms": 1}}
    assert same_spikes(events | {"encoder": ENCODER}) == same_spikes(events), "pooling is most of the work"


def test_files_count_by_their_content(folders):
    key = dataset_key(DESIGN, folders / "a")
    (folders / "a" / "x.npz").write_bytes(b"three")
    assert dataset_key(DESIGN, folders / "a") != key
    design = DESIGN | {"test": {"file": str(folders / "c" / "x.npz")}}
    same = DESIGN | {"test": {"file": "../c/x.npz"}}
    assert dataset_key(design, folders / "a") == dataset_key(same, folders / "a")
    other = DESIGN | {"test": {"file": "../b/x.npz"}}
    assert dataset_key(design, folders / "a") != dataset_key(other, folders / "a")
    (folders / "a" / "x.npz").unlink()
    with pytest.raises(RecordingError, match="not found"):
        dataset_key(DESIGN, folders / "a")


def test_keys_that_came_later_leave_the_names_of_older_data_sets(folders):
    events = DESIGN | {"preprocessing": {"bin_ms": 1}, "encoder": {"kind": "receptors"}}
    every = events | {"preprocessing": {"bin_ms": 1, "every_event": True}}
    scaled = events | {"encoder": {"kind": "receptors", "full_scale": 2.0}}
    for key in (dataset_key, lambda *args: spikes_key(*args, USED)):
        assert len({key(design, folders / "a") for design in (events, every, scaled)}) == 3
    # As it was named before there were such keys.
    assert dataset_key(events, folders / "a") == (
        "1d3049d8db6d2e0fa14bac8f51a4f0a68c525cd0e7e5da35b96f1ce1799512a7"
    )
