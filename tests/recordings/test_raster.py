import numpy as np
import pytest

from dse.recordings import RecordingError
from dse.recordings.raster import RasterFile, sparse
from dse.records import Spikes

RASTER = (np.random.default_rng(5).random((3, 11, 4)) < 0.3).astype(np.uint8)


def dense(spikes: Spikes) -> np.ndarray:
    out = np.zeros((spikes.n_samples * spikes.n_steps, spikes.n_channels), dtype=np.uint8)
    for row in range(len(out)):
        out[row, spikes.channel[spikes.row_offsets[row] : spikes.row_offsets[row + 1]]] += 1
    return out.reshape(spikes.n_samples, spikes.n_steps, spikes.n_channels)


def test_a_raster_becomes_sparse_and_back(write, tmp_path):
    write("x.npz", spikes=RASTER, label=[1, 2, 3])
    source = RasterFile("x.npz", step_ms=5, columns={"letter": "label"})
    assert source.check(tmp_path) == []
    rasters = source.read(tmp_path)
    assert np.array_equal(dense(rasters.spikes), RASTER)
    assert rasters.spikes.row_offsets.dtype == np.int64 and rasters.spikes.channel.dtype == np.int32
    assert (rasters.spikes.step_ms, rasters.columns["letter"].tolist()) == (5.0, [1, 2, 3])


@pytest.mark.parametrize("steps", [{"n_steps": 11}, {"shape": "shape"}])
@pytest.mark.parametrize("axes", ["sample step channel", "channel sample step", "step channel sample"])
def test_packed_rasters_in_any_order_of_axes(write, tmp_path, steps, axes):
    order = [("sample", "step", "channel").index(name) for name in axes.split()]
    raster = RASTER.transpose(order)
    packed = np.packbits(raster, axis=axes.split().index("step"))
    write("x.npz", spikes=packed, shape=np.array(raster.shape))
    source = RasterFile("x.npz", 5, axes=axes, packed=True, **steps)
    assert np.array_equal(dense(source.read(tmp_path).spikes), RASTER)


def test_further_axes_are_flattened_in_the_order_of_the_file(write, tmp_path):
    raster = (np.random.default_rng(6).random((2, 3, 2, 5)) < 0.5).astype(bool)
    write("x.npz", spikes=raster)
    spikes = RasterFile("x.npz", 5, axes="sample taxel polarity step").read(tmp_path).spikes
    assert np.array_equal(dense(spikes), raster.transpose(0, 3, 1, 2).reshape(2, 5, 6))


@pytest.mark.parametrize(
    ("arrays", "keys", "message"),
    [
        ({"spikes": RASTER * 2}, {}, "must be 0 or 1, got 2 in recording 0, step"),
        ({"spikes": RASTER - 0.5}, {}, "must be 0 or 1, got -0.5 in recording 0, step 0, channel 0"),
        ({"spikes": RASTER.astype(str)}, {}, "must hold 0 and 1, got <U"),
        ({"spikes": RASTER[:0]}, {}, r"must hold samples, steps and channels, got shape \(0, 11, 4\)"),
        ({"spikes": RASTER[0]}, {}, r"must have the axes 'sample step channel', got shape \(11, 4\)"),
        ({"spikes": RASTER}, {"n_steps": 12}, "must hold 12 steps, got 11"),
        ({"spikes": RASTER.astype(int)}, {"packed": True}, "must be uint8 to be packed bits, got int64"),
        (
            {"spikes": RASTER, "shape": np.array([3, 11])},
            {"shape": "shape"},
            "'shape' must hold 3 integers > 0",
        ),
        (
            {"spikes": RASTER, "shape": np.array([3, -1, 4])},
            {"shape": "shape"},
            "'shape' must hold 3 integers > 0",
        ),
    ],
)
def test_each_fault_is_one_clear_line(write, tmp_path, arrays, keys, message):
    write("x.npz", **arrays)
    with pytest.raises(RecordingError, match=message) as error:
        RasterFile("x.npz", 5, **keys).read(tmp_path)
    assert str(error.value).startswith("x.npz: ") and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"axes": "step channel"}, "data.axes must name each axis once"),
        ({"axes": "sample step step"}, "each axis once"),
        ({"n_steps": 3, "shape": "shape"}, "data must have n_steps or shape, not both"),
    ],
)
def test_keys_that_contradict(keys, message):
    with pytest.raises(RecordingError, match=message):
        RasterFile("x.npz", 5, **keys)


def test_check_and_unlabelled_files(write, tmp_path):
    write("x.npz", spikes=RASTER, label=[1, 2])
    source = RasterFile("x.npz", 5, columns={"letter": "label", "split": "split"})
    faults = source.check(tmp_path)
    assert len(faults) == 2 and "no array 'split'" in faults[0] and "each of the 3 recordings" in faults[1]
    assert source.with_columns_found(tmp_path).columns == {"letter": "label"}


def test_sparse_leaves_its_input_alone():
    raster = RASTER.copy()
    raster.setflags(write=False)
    assert sparse(raster, 1.0, "raster").channel.size == RASTER.sum()


def test_public_recordings(shared_data):
    braille = RasterFile(
        "braille7_events/braille7_train_val.npz", 5, "spikes_packed", packed=True, shape="shape",
        columns={"letter": "label", "split": "split"}, class_names={"letter": "class_names"},
    )  # fmt: skip
    rasters = braille.read(shared_data)
    assert (rasters.spikes.n_samples, rasters.spikes.n_steps, rasters.spikes.n_channels) == (920, 256, 12)
    assert rasters.spikes.channel.size / rasters.spikes.n_samples == pytest.approx(695, abs=1)
    assert (rasters.columns["split"] == "train").sum() == 738
    with np.load(shared_data / braille.file) as z:
        raw = np.unpackbits(z["spikes_packed"], axis=1)[:, :256]
    assert np.array_equal(dense(rasters.spikes), raw)
    objects = RasterFile(
        "evtouch_objects/evtouch_objects.npz",
        20,
        "spikes_packed",
        "sample taxel polarity step",
        True,
        n_steps=250,
    ).read(shared_data)
    assert (objects.spikes.n_samples, objects.spikes.n_steps, objects.spikes.n_channels) == (720, 250, 78)


@pytest.mark.parametrize(
    ("axes", "shape", "expected"),
    [
        ("sample step", (2, 3), [[0, 0, 0]]),
        ("sample step channel", (2, 3, 2), [[0, 0, 0], [1, 0, 0]]),
        ("sample taxel polarity step", (2, 2, 2, 3), [[0, 0, 0], [0, 0, 1], [1, 0, 0], [1, 0, 1]]),
        ("polarity sample taxel step", (2, 2, 2, 3), [[0, 0, 0], [1, 0, 0], [0, 0, 1], [1, 0, 1]]),
        ("sample step polarity", (2, 3, 2), [[0, 0, 0], [0, 0, 1]]),
        ("row sample polarity column step", (2, 1, 1, 3, 4), [[k, 0, 0] for k in range(6)]),
    ],
)
def test_an_axis_of_polarity_is_the_plane(write, tmp_path, axes, shape, expected):
    write("x.npz", spikes=np.zeros(shape, dtype=np.uint8))
    source = RasterFile("x.npz", 5, axes=axes)
    found = source.channel_positions(tmp_path)
    assert (found.dtype, found.tolist()) == (np.int32, expected)
    assert len(found) == source.read(tmp_path).spikes.n_channels


def test_positions_are_of_taxels(write, tmp_path):
    write("x.npz", spikes=np.zeros((2, 2, 3, 4), dtype=np.uint8))
    source = RasterFile("x.npz", 5, axes="sample polarity taxel step", positions=((9, 0), (5, 5), (0, 9)))
    assert source.check(tmp_path) == []
    places = [[9, 0], [5, 5], [0, 9]]
    assert source.channel_positions(tmp_path).tolist() == [[*xy, p] for p in (0, 1) for xy in places]
    source = RasterFile("x.npz", 5, axes="sample plane taxel step", positions=((9, 0), (5, 5)))
    assert source.check(tmp_path) == ["data.positions must hold [x, y] for each of the 6 taxels, got 2"]


@pytest.mark.parametrize("shape", [(2, 3, 0), (2, 3)])
def test_a_raster_without_channels_lies_nowhere(write, tmp_path, shape):
    write("x.npz", spikes=np.zeros(shape, dtype=np.uint8))
    with pytest.raises(
        RecordingError, match="'spikes' must have the axes 'sample step channel', none of length 0"
    ):
        RasterFile("x.npz", 5).channel_positions(tmp_path)
