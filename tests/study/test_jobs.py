"""What a run is said to ask of a worker, and what a worker takes."""

import dataclasses
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from dse import store
from dse.base.records import Dataset, Head, Spikes
from dse.config.space import DecisionGrid
from dse.measure.hardware.profile import load
from dse.measure.on_chips import columns_on
from dse.models.counts.knn import KNN
from dse.models.snn.family import SNN
from dse.models.training import Training
from dse.study import jobs
from dse.study.workers import Workers
from tests.joint_data import joint
from tests.saved_data import in_a_row, save
from tests.spaces import design_of


def made(n, n_steps, n_channels, rate):
    """Return n random samples of two classes: half to train on, half to validate."""
    rng = np.random.default_rng(0)
    raster = rng.random((n * n_steps, n_channels)) < rate
    offsets = np.concatenate([[0], raster.sum(axis=1).cumsum()]).astype(np.int64)
    spikes = Spikes(offsets, np.nonzero(raster)[1].astype(np.int32), n_steps, n_channels, 1.0)
    start, parts = np.zeros(n, np.int32), np.split(np.arange(n), 2)
    return Dataset(
        spikes, np.arange(n) % 2, ("a", "b"), start, start, start, n_steps, *parts, np.zeros(0, np.int64),
        in_a_row(n_channels),
    )  # fmt: skip


def run(folder, model, number=0, **training):
    return jobs.Run(
        trial=number,
        repeat=0,
        design={"number": number},
        seed=1,
        sections=design_of(model, Training(**training)),
        data=folder / "data",
        base=folder,
        folder=store.run_file(folder, number, 0),
        decision=DecisionGrid(np.array([0, 4]), np.array([0.5, 0.9])),
        hardware=(),
    )


def peak_bytes(cohort):
    """Train a cohort; yield the largest resident size that the process had since it began."""
    ended = list(jobs.train(cohort))
    assert ended == [(number, None) for number in range(len(cohort.runs))]
    # Not ru_maxrss: the system hands that down from the process that started this one.
    [kilobytes] = re.findall(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
    yield int(kilobytes) * 1024


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="no /proc: the peak cannot be read")
def test_a_worker_takes_no_more_than_its_cohort_is_said_to_need(tmp_path, workers):
    data = made(48, 200, 1600, 0.02)
    save(data, tmp_path / "data")
    runs = tuple(run(tmp_path, SNN((450,)), k, epochs=1, batch_size=16) for k in range(4))
    demands = [jobs.demand(one, data) for one in runs]
    assert len({one.key for one in demands}) == 1
    said = sum(one.memory_bytes for one in demands) + max(one.workspace_bytes for one in demands)
    with Workers(1) as worker:
        [(_, peak)] = worker.stream(peak_bytes, [jobs.TrainingJob(runs, "cpu")])
    assert isinstance(peak, int), peak
    assert peak <= said
    assert said < 3 * peak  # a bound that is of use


def test_what_a_family_is_asked(tmp_path):
    data = made(6, 10, 5, 0.3)
    unused = dataclasses.replace(data, validation=data.validation[:1], n_steps=4)
    asked = {}

    def note(name, answer):
        def asked_for(*arguments):
            asked[name] = arguments
            return answer

        return asked_for

    model = SimpleNamespace(
        fit_cohort=None,
        input_delays=(0, 2),
        steps_per_sample=3,
        shares=note("shares", 7),
        memory_bytes=note("memory", 1000),
        workspace_bytes=note("workspace", 200),
        cost=note("cost", 2.5),
    )
    one = run(tmp_path, model, epochs=3, batch_size=2)
    found = jobs.demand(one, unused, 3)
    assert asked["memory"] == (5, 2, 4, one.sections.training)
    assert asked["workspace"] == (5, 2, 4, one.sections.training, 3)
    per_window = len(data.spikes.channel) / (4 * 10) * 4  # four samples in use, windows of 4 of 10 steps
    assert asked["cost"] == (5, 2, 4, per_window, 3, one.sections.training)
    assert (found.memory_bytes, found.cost, found.key) == (1000, 2.5, (one.data, 0, SimpleNamespace, 7))
    heads = tuple(Head(name, ("x", "y"), np.array([0, 1])) for name in "abc")
    jobs.demand(one, dataclasses.replace(unused, heads=heads))
    assert asked["memory"][1] == 6  # outputs, not joint classes
    beside = found.workspace_bytes - jobs.PROCESS_BYTES - 200
    assert beside >= 2 * per_window * 2 * 8  # a batch's spikes, twice delayed, as rows and channels


def test_a_family_that_trains_alone_has_no_company(tmp_path):
    data = made(4, 5, 3, 0.5)
    demands = [jobs.demand(run(tmp_path, SimpleNamespace(), k), data) for k in (0, 1)]
    assert demands[0].key != demands[1].key
    assert {one.alone_bytes for one in demands} == {jobs.PROCESS_BYTES}


def test_a_run_of_a_joint_target_records_every_head(tmp_path):
    data = joint(n_steps=20)
    save(data, tmp_path / "data")
    grid = {"decision": DecisionGrid(np.array([0]), np.array([0.5, 0.9])), "hardware": (load("op_4.6_0.9"),)}
    spiking = dataclasses.replace(run(tmp_path, SNN((6,)), 0, epochs=1, batch_size=16), **grid)
    counting = dataclasses.replace(run(tmp_path, KNN(window_ms=20.0, channels="each"), 1), **grid)
    for one in (spiking, counting):
        assert list(jobs.train(jobs.TrainingJob((one,)))) == [(0, None)]
        record = store.load_run(one.folder)
        assert record["samples"] == {"train": 40, "validation": 30, "test": 10}
        assert record["transductive"] == "" and record["columns"]["transductive"] is False
        assert record["heads"] == {
            "texture": {"classes": ["a", "b", "c"], "of_class": [0, 0, 1, 1, 2]},
            "profile": {"classes": ["p", "q"], "of_class": [0, 1, 0, 1, 0]},
        }
        assert set(record["of_heads"]) == {"texture", "profile"}
        for name, own in record["of_heads"].items():
            read_out = store.load_arrays(one.folder / f"read_out_{name}.npz")
            assert read_out["accuracy"][-1] == own["columns"]["accuracy"]
            energy_uj = columns_on(load("op_4.6_0.9"), store.work_of(read_out))["energy_uj"]
            assert energy_uj[-1] == own["hardware"]["op_4.6_0.9"]["energy_uj"]
            assert own["columns"]["accuracy"] == record["columns"][f"accuracy_{name}"]
            confusion = store.load_arrays(one.folder / f"confusion_{name}.npz")
            assert confusion["validation"].sum() == 30 and confusion["test"].sum() == 10
            assert (f"surface_{name}.npz" in record["files"]) == (one is spiking)
        assert "read_out.npz" not in record["files"], "both heads together have no earlier read-outs"
        assert store.load_arrays(one.folder / "confusion.npz")["validation"].shape == (5, 5)
        said = store.load_arrays(one.folder / "response.npz")
        assert said["index"].tolist() == data.validation.tolist()
        assert ("label" in said) == (one is counting)
    fitted = store.fitted_of(store.load_arrays(counting.folder / "weights.npz"))
    again = KNN(window_ms=20.0, channels="each").respond(fitted, data, data.test)
    stored = store.load_arrays(counting.folder / "response_test.npz")
    assert np.array_equal(again.label, stored["label"])


def test_phi_reaches_what_the_outputs_of_training_samples_reach(tmp_path, monkeypatch):
    monkeypatch.setattr(jobs, "_SAMPLES", 7)
    data = joint(n_steps=20)
    save(data, tmp_path / "data")
    grid = DecisionGrid(theta=np.array([0.5, 0.9]), phi_step=3)
    one = dataclasses.replace(run(tmp_path, SNN((6,)), epochs=1, batch_size=16), decision=grid)
    list(jobs.train(jobs.TrainingJob((one,))))
    network = store.fitted_of(store.load_arrays(one.folder / "weights.npz"))
    output = SNN((6,)).respond(network, data, data.train).output
    most = max(output[..., :3].sum(axis=(1, 2)).max(), output[..., 3:].sum(axis=(1, 2)).max())
    for name in ("texture", "profile"):
        phi = store.load_arrays(one.folder / f"surface_{name}.npz")["phi"]
        assert phi[0] == 0 and set(np.diff(phi)) <= {3}
        assert phi[-1] - 3 < most <= phi[-1] or most == 0
