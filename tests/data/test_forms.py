"""Recordings as strangers keep them: folders of tables, logs with dates, groups of HDF5, padded cubes."""

import numpy as np
import pandas as pd
import pytest

import dse
from dse.base.records import Rasters, Signals, Spikes
from dse.config.settings import Window
from dse.data.recordings import RecordingError
from dse.data.recordings.windows import cut

LENGTHS = [60 + 7 * (k % 4) for k in range(24)]
LABELS = np.array(["denim", "silk"] * 12)
VALUES = [np.random.default_rng(k).normal(size=(n, 2)).round(4) for k, n in enumerate(LENGTHS)]


def folder(path):
    for k, (label, values) in enumerate(zip(LABELS, VALUES, strict=True)):
        (path / "touch" / label).mkdir(parents=True, exist_ok=True)
        pd.DataFrame(values, columns=["x", "y"]).to_csv(path / "touch" / label / f"{k:02}.csv", index=False)
    return path / "touch", np.argsort(LABELS, kind="stable")


def log(path):
    n = sum(LENGTHS)
    dates = pd.Timestamp("2026-03-01T12:00:00") + pd.to_timedelta(10 * np.arange(n), unit="ms")
    table = pd.DataFrame(np.concatenate(VALUES), columns=["x", "y"])
    table = table.assign(timestamp=dates.map(pd.Timestamp.isoformat), activity=np.repeat(LABELS, LENGTHS))
    table.to_csv(path / "log.csv", index=False)
    return path / "log.csv", np.arange(24)


def groups(path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path / "touch.h5", "w") as file:
        for k, (label, values) in enumerate(zip(LABELS, VALUES, strict=True)):
            file[f"touch{k:02}/signal"], file[f"touch{k:02}/force"] = values, k % 3
            file[f"touch{k:02}"].attrs["label"] = str(label)
    return path / "touch.h5", np.arange(24)


def padded(path):
    cube = np.full((24, max(LENGTHS), 2), np.nan)
    for k, values in enumerate(VALUES):
        cube[k, : len(values)] = values
    np.savez(path / "touch.npz", signal=cube, label=LABELS)
    return path / "touch.npz", np.arange(24)


def commas(path):
    table = pd.DataFrame(np.concatenate(VALUES), columns=["x", "y"])
    table = table.assign(trial=np.repeat(np.arange(24), LENGTHS), label=np.repeat(LABELS, LENGTHS))
    table.to_csv(path / "touch.csv", index=False, sep=";", decimal=",")
    return path / "touch.csv", np.arange(24)


@pytest.mark.parametrize("written", [folder, log, groups, padded, commas])
def test_every_form_holds_the_same_recordings(tmp_path, written):
    file, order = written(tmp_path)
    space = dse.load_space(dse.init(file, tmp_path / "space.yaml", step_ms=10.0), check_data=True)
    found = space.data.read(tmp_path)
    assert found.step_ms == 10
    assert found.lengths.tolist() == [LENGTHS[k] for k in order]
    np.testing.assert_array_equal(found.values, np.concatenate([VALUES[k] for k in order]).astype(np.float32))
    target = space.parts["task"].values["target"]
    (name,) = [target] if isinstance(target, str) else target
    assert found.columns[name].tolist() == LABELS[order].tolist()
    window = space.parts["window"].values
    assert window["n_steps"] == max(LENGTHS) and window["pad"]  # no recording is cut to the shortest one
    before = space.data.content(tmp_path)
    if file.is_dir():
        (file / "silk" / "01.csv").write_text("x,y\n0,1\n1,1\n")
        assert space.data.content(tmp_path) != before


def test_what_of_these_forms_is_refused(tmp_path):
    other, _ = folder(tmp_path)
    (other / "silk" / "01.csv").write_text("x,z\n0,1\n")
    with pytest.raises(RecordingError, match=r"touch: silk/01\.csv: must have the columns of denim/00\.csv"):
        dse.init(other, tmp_path / "space.yaml", step_ms=10.0)
    gap = np.zeros((8, 30, 2))
    gap[3, 10:14, 0] = np.nan
    np.savez(tmp_path / "gap.npz", signal=gap, label=LABELS[:8])
    with pytest.raises(RecordingError, match="recording 3, sample 10, channel 0, before its end: fill gaps"):
        dse.init(tmp_path / "gap.npz", tmp_path / "space.yaml", step_ms=10.0)
    gap[3] = np.nan
    np.savez(tmp_path / "none.npz", signal=gap, label=LABELS[:8])
    with pytest.raises(RecordingError, match="recording 3 is empty"):
        dse.init(tmp_path / "none.npz", tmp_path / "space.yaml", step_ms=10.0)


def test_groups_of_hdf5_that_are_no_recordings_stay_apart(tmp_path):
    h5py = pytest.importorskip("h5py")
    from dse.data.recordings import arrays

    with h5py.File(tmp_path / "parts.h5", "w") as file:
        for part in ("left", "right"):
            file[f"{part}/x"], file[f"{part}/y"] = np.zeros((5, 9, 2)), np.arange(5)
    assert {*arrays.headers(tmp_path / "parts.h5")} == {"left/x", "left/y", "right/x", "right/y"}
    assert arrays.load(tmp_path / "parts.h5", ["right/y"])["right/y"].tolist() == [0, 1, 2, 3, 4]


def test_padding_holds_the_last_sample():
    signals = Signals(np.arange(10, dtype=np.float32).reshape(5, 2), np.array([0, 2, 5]), 1.0, {})
    found = cut(signals, Window(n_steps=3, pad=True))
    assert found.lengths.tolist() == [3, 3]
    assert found.values[:, 0].tolist() == [0, 2, 2, 4, 6, 8]
    rasters = Rasters(Spikes(np.zeros(5, np.int64), np.zeros(0, np.int32), 4, 2, 1.0), {})
    with pytest.raises(RecordingError, match=r"window\.pad is for sampled signals"):
        cut(rasters, Window(n_steps=9, pad=True))
    for keys in {"pad": True}, {"pad": True, "n_steps": 3, "cut_steps": 9}:
        with pytest.raises(ValueError, match=r"window\.pad needs window\.n_steps"):
            Window(**keys)


def test_a_folder_of_events_of_taxels_is_no_folder_of_samples(tmp_path):
    for label in ("denim", "silk"):
        for k in range(4):
            (tmp_path / "touch" / label).mkdir(parents=True, exist_ok=True)
            times = np.arange(1, 30) * 1000 * (2 if label == "silk" else 1)
            table = pd.DataFrame({"t": times, "taxel": np.arange(29) % 4, "p": np.arange(29) % 2})
            table.to_csv(tmp_path / "touch" / label / f"{k}.csv", index=False)
    space = dse.load_space(dse.init(tmp_path / "touch", tmp_path / "space.yaml"))
    assert space.parts["data"].kind == "event_files"


@pytest.mark.parametrize("n_steps", [2, 3, 7, 8, 9, 130])
def test_a_first_network_has_every_delay_once(tmp_path, n_steps):
    rng = np.random.default_rng(1)
    signal = rng.normal(size=(20, n_steps, 2))
    np.savez(tmp_path / "touch.npz", signal=signal, label=np.tile(["a", "b"], 10))
    space = dse.load_space(dse.init(tmp_path / "touch.npz", tmp_path / "space.yaml", step_ms=10.0))
    delays = [space.axes[name].values for name in space.axes if name.endswith("input_delays")]
    for each in (x for values in delays for x in values):
        assert each[0] == 0 and list(each) == sorted(set(each)) and max(each) < n_steps
    assert delays
    assert ("steps_per_sample: 2" in (tmp_path / "space.yaml").read_text()) == (n_steps < 50)
