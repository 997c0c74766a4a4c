"""Runs -> design points, and what they cost on hardware that the study was never run with."""

import dataclasses
import json

import numpy as np
import pandas as pd
import pytest

from dse import store
from dse.base.records import Operations, Workload
from dse.config import ConfigError
from dse.measure.hardware.profile import load
from dse.measure.numbers import Numbers
from dse.study import held, points, precision, pricing
from dse.study.record import RunRecord, load_record, load_records
from tests import tiny_study

LOIHI, OPERATIONS = load("loihi1_silicon"), load("op_4.6_0.9")
PER_ADDITION_UJ = 0.9e-6


@pytest.fixture
def space(tmp_path):
    model = {"kind": "fake", "hidden": {"choice": [[4], [8, 4]]}, "mood": {"choice": ["fine", "raise"]}}
    yield tiny_study.make_space(tmp_path, model=model)


def counted(*additions):
    """Return the work of a classifier that only adds."""
    n = len(additions)
    zeros = np.zeros(n)
    return Operations(zeros, np.array(additions), zeros, np.full(n, 28.0), np.full(n, 4.0))


def published(folder, trial=0, repeat=0, accuracy=0.5, work=None, heads=(), **files):
    """Write a run with one read-out, after 4 ms, unless a file says otherwise; return its record."""
    columns = {"accuracy": accuracy, "accuracy_se": 0.1, "t_c_ms": 4.0, "itr_bits": 1.5, "n_weights": 28}
    read_out = {
        "decision_latency_ms": np.array([4.0]),
        "accuracy": np.array([accuracy]),
        **store.work_arrays(work or counted(100.0)),
    }
    arrays = {f"read_out_{head}": read_out for head in heads} or {"read_out": read_out}
    arrays |= files
    record = {
        **{"trial": trial, "repeat": repeat, "status": "finished", "reason": "", "hardware": {}},
        "design": {"model.hidden": [4] if trial == 0 else [8, 4], "model.mood": "fine"},
        "columns": columns,
        "of_heads": {head: {"columns": columns, "hardware": {}} for head in heads},
    }
    run = store.run_file(folder, trial, repeat)
    store.save_run(run, record, {f"{name}.npz": content for name, content in arrays.items()})
    loaded = load_record(run)
    assert loaded is not None
    return loaded


def evaluated(run):
    """Write what stands for an evaluation of a run at another precision."""
    path = precision.file_of(run, (4, 0.0))
    path.parent.mkdir(parents=True)
    store.save_arrays(path, {"schema": np.array("none")})


def test_full_read_outs_on_every_chip(space, tmp_path):
    runs = [published(tmp_path, 0, r, 0.5 + 0.2 * r, counted(100.0 + 100 * r)) for r in (0, 1)]
    frame = points.PointsTable(space, tmp_path, [OPERATIONS, LOIHI]).table({0: runs})
    assert list(frame["hardware"]) == ["op_4.6_0.9", "loihi1_silicon"]
    assert frame["accuracy"].tolist() == [pytest.approx(0.6)] * 2
    assert frame["energy_uj"].iloc[0] == pytest.approx(150 * PER_ADDITION_UJ)
    assert np.isnan(frame["energy_uj"].iloc[1]), "Loihi runs no such classifier"
    assert frame["point"].tolist() == [0, 0]
    assert not {"phi", "theta"} & set(frame)


def test_without_hardware_points_have_no_costs(space, tmp_path):
    accurate = dataclasses.replace(space, objectives=(("accuracy", "max"),))
    frame = points.PointsTable(accurate, tmp_path, []).table({0: [published(tmp_path)]})
    assert len(frame) == 1 and not {"hardware", "energy_uj"} & set(frame)


def test_objectives_that_no_run_measures_are_columns(space, tmp_path):
    searched = dataclasses.replace(space, objectives=(("accuracy", "max"), ("energy_uj", "min")))
    table = points.PointsTable(searched, tmp_path, [LOIHI]).table({0: [published(tmp_path)]})
    assert table["energy_uj"].isna().all() and list(table["hardware"]) == ["loihi1_silicon"]
    assert points.PointsTable(searched, tmp_path, [LOIHI]).table({}).empty


def test_failed_trials_have_no_points(space, tmp_path):
    good = published(tmp_path, 1)
    failed = RunRecord(trial=0, repeat=0, design=good.design, seed=0, reason="NaN loss")
    runs = {0: [failed], 1: [good, failed], 2: [good]}
    assert list(points.PointsTable(space, tmp_path, []).table(runs)["trial"]) == [2]


def test_a_grid_is_averaged_point_by_point(space, tmp_path):
    grid = {"phi": np.array([0, 4]), "theta": np.array([0.5, 0.7, 1.0])}
    runs = []
    for repeat in (0, 1):
        zeros = np.zeros((2, 3))
        work = Operations(zeros, np.arange(6.0).reshape(2, 3) * (1 + repeat), zeros, zeros, zeros)
        surface = {
            **grid,
            "accuracy": np.arange(6.0).reshape(2, 3) + repeat,
            "spikes_total": np.full((2, 3), 7),
            **store.work_arrays(work),
        }
        read_out = {
            "decision_latency_ms": np.array([4.0]),
            "accuracy": np.array([0.5]),
            "spikes_total": np.array([9]),
            **store.work_arrays(counted(100.0)),
        }
        run = published(tmp_path, 0, repeat, surface=surface, read_out=read_out)
        numbers = Numbers({**run.measured.columns, "spikes_total": 9}, {})
        runs.append(dataclasses.replace(run, numbers=numbers))
    frame = points.PointsTable(space, tmp_path, [OPERATIONS]).table({0: runs})
    assert frame["point"].tolist() == list(range(7))
    end, rows = frame.iloc[0], frame.iloc[1:]
    assert np.isnan(end["phi"]) and np.isnan(end["theta"])
    assert (end["accuracy"], end["spikes_total"]) == (0.5, 9)
    assert rows["phi"].tolist() == [0, 0, 0, 4, 4, 4]
    assert rows["theta"].tolist() == [0.5, 0.7, 1.0] * 2
    assert rows["accuracy"].tolist() == [0.5, 1.5, 2.5, 3.5, 4.5, 5.5]
    assert rows["accuracy_se"].tolist() == pytest.approx([0.5] * 6)
    assert rows["energy_uj"].tolist() == pytest.approx([1.5 * k * PER_ADDITION_UJ for k in range(6)])
    assert frame["spikes_total"].dtype == np.int64


def test_runs_share_the_settings_that_all_of_them_have(space, tmp_path):
    def surface(*phi):
        shape = len(phi), 2
        grid = {"phi": np.array(phi), "theta": np.array([0.5, 1.0])}
        values = np.arange(2.0 * len(phi)).reshape(shape) * len(phi)
        return grid | {"accuracy": values, **store.work_arrays(work_of(values))}

    def work_of(additions):
        zeros = np.zeros_like(additions)
        return Operations(zeros, additions, zeros, zeros, zeros)

    runs = [published(tmp_path, 0, r, surface=surface(*phi)) for r, phi in enumerate([(0, 25, 50), (0, 25)])]
    for order in (runs, runs[::-1]):
        rows = points.PointsTable(space, tmp_path, [OPERATIONS]).table({0: order}).iloc[1:]
        assert rows["phi"].tolist() == [0, 0, 25, 25]
        assert rows["accuracy"].tolist() == [0.0, 2.5, 5.0, 7.5]
        expected = [x * PER_ADDITION_UJ for x in (0.0, 2.5, 5.0, 7.5)]
        assert rows["energy_uj"].tolist() == pytest.approx(expected)


def test_read_outs_before_the_end_are_points(space, tmp_path):
    read_out = {
        "decision_latency_ms": np.array([2.0, 4.0]),
        "accuracy": np.array([0.25, 0.5]),
        "n_weights": np.array([14, 28]),
        **store.work_arrays(counted(30.0, 100.0)),
    }
    runs = {0: [published(tmp_path, 0, read_out=read_out)], 1: [published(tmp_path, 1)]}
    frame = points.PointsTable(space, tmp_path, [OPERATIONS]).table(runs)
    first = frame[frame["trial"] == 0]
    assert first["read_out_ms"].isna().tolist() == [True, False]
    assert first["read_out_ms"].iloc[1] == first["decision_latency_ms"].iloc[1] == 2.0
    assert first["accuracy"].tolist() == [0.5, 0.25] and first["n_weights"].tolist() == [28, 14]
    assert first["energy_uj"].tolist() == pytest.approx([100 * PER_ADDITION_UJ, 30 * PER_ADDITION_UJ])
    assert first["t_c_ms"].tolist() == [4.0, 4.0]  # of the design
    assert first["itr_bits"].isna().tolist() == [False, True]  # of one answer, which this row is not
    assert first["model.hidden"].tolist() == ["[4]"] * 2
    assert frame["read_out_ms"].isna().sum() == 2


def test_earlier_read_outs_have_ranges_of_their_own(space, tmp_path):
    def read_out(*t_p_ms):
        return {
            "decision_latency_ms": np.array([2.0, 4.0]),
            "accuracy": np.array([0.25, 0.5]),
            "t_p_test_ms": np.array(t_p_ms),
            **store.work_arrays(counted(30.0, 100.0)),
        }

    runs = [published(tmp_path, 0, r, read_out=read_out(1.0 + 2 * r, 9.0)) for r in (0, 1)]
    frame = points.PointsTable(space, tmp_path, [OPERATIONS]).table({0: runs})
    assert frame.loc[1, ["t_p_test_ms", "t_p_test_ms_min", "t_p_test_ms_max"]].tolist() == [2.0, 1.0, 3.0]


def test_a_joint_net_has_points_of_each_head(space, tmp_path):
    surface = {
        **{"phi": np.array([0]), "theta": np.array([0.5]), "accuracy": np.array([[0.7]])},
        **store.work_arrays(counted(60.0).mapped(lambda x: x.reshape(1, 1))),
    }
    run = published(tmp_path, heads=("texture", "profile"), surface_texture=surface)
    frame = points.PointsTable(space, tmp_path, [OPERATIONS]).table({0: [run]})
    assert frame["task"].tolist() == ["texture", "texture", "profile"]
    assert frame["point"].tolist() == [0, 1, 2]
    assert frame["accuracy"].tolist() == [0.5, 0.7, 0.5]
    assert frame["energy_uj"].tolist() == pytest.approx([k * PER_ADDITION_UJ for k in (100, 60, 100)])


def spiking(*spikes):
    """Return the work of a 3-5-2 network after so many input spikes."""
    n = len(spikes)
    counts = np.array([[s, s / 2, 1.0] for s in spikes])
    return Workload((3, 5, 2), (False, False), np.full(n, 4.0), counts, np.ones((n, 2)), 1.0)


@pytest.fixture
def study(space, tmp_path):
    """A folder with two trials, one of them of two runs, with points on one chip."""
    folder = tmp_path / "study"
    trials = {
        0: [published(folder, 0, r, work=spiking(10.0 + r)) for r in (0, 1)],
        1: [published(folder, 1, work=spiking(40.0))],
    }
    points.PointsTable(space, folder, [LOIHI]).table(trials).to_parquet(folder / "points.parquet")
    return folder


def test_arrays_that_disagree_are_named_with_their_trial(space, tmp_path):
    runs = [published(tmp_path, work=spiking(10.0))]
    run = store.run_file(tmp_path, 0, 0)
    record, arrays = store.read_record(run), store.load_arrays(run / "read_out.npz")
    torn = arrays | {"work/awake": np.zeros((0, 3))}
    store.save_run(run, record, {"read_out.npz": torn}, replaces=True)
    with pytest.raises(store.StoreError, match=r"runs/00000-0.npz: its arrays cannot be evaluated \("):
        points.PointsTable(space, tmp_path, [LOIHI]).table({0: runs})


def test_points_are_priced_on_other_hardware_without_training(study):
    found = pricing.points(study, ["op_4.6_0.9", "loihi1_silicon"])
    assert found["hardware"].tolist() == ["op_4.6_0.9"] * 2 + ["loihi1_silicon"] * 2
    additions = np.array([10.5 * 5 + 5.25 * 2, 40 * 5 + 20 * 2])
    assert found["energy_uj"].tolist()[:2] == pytest.approx((additions * PER_ADDITION_UJ).tolist())
    assert found["n_cores"].isna().tolist() == [True, True, False, False]
    before = pd.read_parquet(study / "points.parquet")
    on_chip = found[found["hardware"] == "loihi1_silicon"].reset_index(drop=True)
    pd.testing.assert_frame_equal(on_chip[before.columns], before, check_dtype=False)


def test_a_study_keeps_the_figures_that_it_was_run_with(study):
    pricing.keep([LOIHI], study)
    kept = study / "hardware" / "loihi1_silicon.yaml"
    cheap = store.read_text(kept).replace("value: 35.5, low: 30.175", "value: 31.0, low: 30.175")
    store.write_text(kept, cheap)
    cheaper, shipped = pricing.profile(study, "loihi1_silicon"), pricing.profile(study, "op_4.6_0.9")
    assert cheaper.at("value")["synaptic_event_pj"] == 31.0 and shipped == OPERATIONS
    changed = pricing.points(study, ["loihi1_silicon"])["energy_uj"]
    assert (changed < pd.read_parquet(study / "points.parquet")["energy_uj"]).all()
    with pytest.raises(ConfigError, match=r"no such hardware profile; .* Did you mean 'loihi1_silicon'"):
        pricing.points(study, ["loihi1_silico"])


def test_draws_are_the_same_for_every_design_and_every_call(study):
    rows = pricing.points(study, ["loihi1_silicon"])
    drawn = pricing.drawn(study, rows, ("energy_uj",), 64)["energy_uj"]
    assert drawn.shape == (64, 2)
    again = pricing.drawn(study, rows.iloc[::-1], ("energy_uj",), 64)["energy_uj"]
    assert np.array_equal(drawn, again[:, ::-1])
    assert (drawn[:, 0] < drawn[:, 1]).all(), "less of everything is less in every draw"
    low, high = rows["energy_uj_low"].to_numpy(), rows["energy_uj_high"].to_numpy()
    assert ((drawn >= low) & (drawn <= high)).all() and (np.ptp(drawn, axis=0) > 0).all()
    figures = LOIHI.draws(4000)
    static = figures["static_mw"]
    assert abs(np.mean(static < 104.0) - 0.5) < 0.03, "the value is the median"


def test_a_table_is_priced_as_it_was_written(space, study):
    def evaluated(bits):
        for repeat in (0, 1):
            run = store.run_file(study, 0, repeat)
            numbers = Numbers({"accuracy": 0.4}, {})
            record = dataclasses.replace(load_record(run), numbers=numbers)
            read_out = {"decision_latency_ms": np.array([4.0]), "accuracy": np.array([0.4])}
            load = dataclasses.replace(spiking(10.0 * bits), weight_bits=bits)
            parts = {"read_out.npz": read_out | store.work_arrays(load)}
            precision.save(run, (bits, 0.0), record, parts)

    evaluated(4)
    records = {trial: load_records(study, trial) for trial in (0, 1)}
    table = points.PointsTable(space, study, [LOIHI]).table(records)
    assert table["weight_bits"].tolist() == [8, 4, 8]
    table.to_parquet(study / "points.parquet")
    drawn = pricing.drawn(study, table, ["energy_uj"], 8)["energy_uj"]
    # Another precision and another run since then: what the rows are does not change.
    evaluated(2)
    published(study, 0, 2, work=spiking(90.0))
    assert np.array_equal(pricing.drawn(study, table, ["energy_uj"], 8)["energy_uj"], drawn)
    again = pricing.points(study, ["loihi1_silicon"])
    assert again["energy_uj"].tolist() == table["energy_uj"].tolist()
    precision.file_of(store.run_file(study, 0, 1), (4, 0.0)).unlink()
    with pytest.raises(store.StoreError, match="no evaluation at 4 bits with 0 pruned"):
        pricing.points(study, ["loihi1_silicon"])


def test_chips_of_one_name_do_not_mix(study, tmp_path):
    (tmp_path / "a.yaml").write_text(LOIHI.text.replace("name: loihi1_silicon", "name: mine"))
    (tmp_path / "b.yaml").write_text(
        (tmp_path / "a.yaml").read_text().replace("value: 104.0", "value: 100.0")
    )
    one, other = str(tmp_path / "a.yaml"), str(tmp_path / "b.yaml")
    assert len(pricing.points(study, [one, one])) == 2
    with pytest.raises(ConfigError, match="another profile has the name 'mine' too"):
        pricing.points(study, [one, other])


def test_points_that_the_study_does_not_hold_any_more_are_named(study):
    frame = pd.read_parquet(study / "points.parquet").assign(phi=7.0, theta=0.5)
    frame.to_parquet(study / "points.parquet")
    with pytest.raises(store.StoreError, match="points of trial 0 have changed; run the study again"):
        pricing.points(study, ["loihi1_silicon"])
    with pytest.raises(store.StoreError, match="points of trial 0 have changed"):
        pricing.drawn(study, frame, ["energy_uj"], 8)


def answered(n, design, **columns):
    return points.Answered(
        design, {"accuracy": np.zeros(n)} | {k: np.array(x) for k, x in columns.items()}, []
    )


def test_a_point_is_known_by_what_it_was_evaluated_at():
    at = {bits: {"weight_bits": bits, "pruned_after": 0.0} for bits in (8, 4)}
    answers = [
        piece
        for bits in (8, 4)
        for piece in (
            answered(1, at[bits], phi=[np.nan], theta=[np.nan], read_out_ms=[np.nan]),
            answered(4, at[bits], phi=[0, 0, 2, 2], theta=[0.2, 0.4, 0.2, 0.4]),
            answered(2, at[bits], read_out_ms=[12.5, 25.0]),
        )
    ]
    table = pd.DataFrame(
        [
            *((8, 0.0, 2, 0.2, np.nan), (8, 0.0, np.nan, np.nan, np.nan), (4, 0.0, np.nan, np.nan, 25.0)),
            *((4, 0.0, 0, 0.4, np.nan), (4, 0.25, 0, 0.4, np.nan), (8, 0.0, 1, 0.4, np.nan)),
        ],
        columns=["weight_bits", "pruned_after", "phi", "theta", "read_out_ms"],
    ).assign(task="texture", point=99)
    assert points.places(answers, table).tolist() == [3, 0, 13, 9, -1, -1]
    assert points.places(answers, table.iloc[::-1]).tolist() == [-1, -1, 9, 13, 0, 3]
    alone = [answered(1, {}, read_out_ms=[np.nan]), answered(2, {}, read_out_ms=[5.0, 10.0])]
    assert points.places(alone, pd.DataFrame({"read_out_ms": [10.0, np.nan, 5.0]})).tolist() == [2, 0, 1]
    heads = [
        answered(2, {"task": task}, phi=[np.nan, 1.0], theta=[np.nan, 0.5]) for task in ("texture", "speed")
    ]
    joint = pd.DataFrame(
        {"task": ["speed", "texture", "speed"], "phi": [1, 1, np.nan], "theta": [0.5, 0.5, np.nan]}
    )
    assert points.places(heads, joint).tolist() == [3, 1, 2]


def test_work_is_written_and_read_back(tmp_path):
    pruned = dataclasses.replace(spiking(3.0, 4.0), synapses=(2.0, 1.5, 0.0), stored=(6, 4), weight_bits=4)
    for work in (pruned, spiking(1.0), counted(5.0), dataclasses.replace(spiking(1.0), updates=None)):
        store.save_arrays(tmp_path / "x.npz", store.work_arrays(work) | {"accuracy": np.zeros(1)})
        again = store.work_of(store.load_arrays(tmp_path / "x.npz"))
        assert json.dumps(vars(again), default=np.ndarray.tolist) == json.dumps(
            vars(work), default=np.ndarray.tolist
        )
    with pytest.raises(store.StoreError, match="Workload needs the array 'work/sizes'"):
        store.work_of({"accuracy": np.zeros(1)})


def digests(folder, trials):
    return held.digests(folder, {trial: [run.repeat for run in runs] for trial, runs in trials.items()})


def test_a_written_table_holds_the_same_points(space, tmp_path):
    zeros = np.zeros((2, 3))
    surface = {
        **{"phi": np.array([0, 4]), "theta": np.array([0.5, 0.7, 1.0])},
        "accuracy": np.arange(6.0).reshape(2, 3),
        **store.work_arrays(Operations(zeros, np.arange(6.0).reshape(2, 3), zeros, zeros, zeros)),
    }
    trials = {2: [published(tmp_path, trial=2, surface=surface)], 5: [published(tmp_path, trial=5)]}
    whole = points.PointsTable(space, tmp_path, [OPERATIONS, LOIHI]).table(trials)
    now = digests(tmp_path, trials)
    points.PointsTable(space, tmp_path, [OPERATIONS, LOIHI]).write(tmp_path / "points.parquet", trials, now)
    written = pd.read_parquet(tmp_path / "points.parquet")
    assert len(written) == 16
    pd.testing.assert_frame_equal(written, whole)


def test_a_table_is_written_again_only_where_it_would_differ(space, tmp_path, monkeypatch):
    path, chips = tmp_path / "points.parquet", [OPERATIONS, LOIHI]
    store.Book(tmp_path, writes=True).close()
    trials = {2: [published(tmp_path, trial=2)], 5: [published(tmp_path, trial=5)]}

    def is_written():
        before = path.stat().st_ino if path.exists() else None
        points.PointsTable(space, tmp_path, chips).write(path, trials, digests(tmp_path, trials))
        return path.stat().st_ino != before

    assert is_written() and not is_written()
    store.remove(store.run_file(tmp_path, 5, 0))
    trials[5] = [published(tmp_path, trial=5, accuracy=0.75)]
    assert is_written() and not is_written()
    chips.pop()
    assert is_written() and not is_written()
    evaluated(store.run_file(tmp_path, 2, 0))
    assert is_written() and not is_written()
    del trials[2]
    assert is_written() and not is_written()
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    assert is_written() and not is_written()
    pd.read_parquet(path).to_parquet(path)  # of an earlier version
    assert is_written() and not is_written()
    monkeypatch.setattr(points, "_code", lambda: b"of another version")
    assert is_written() and not is_written()
    assert pd.read_parquet(path)["accuracy"].tolist() == [0.75]


def test_rows_of_unchanged_trials_are_taken_over(space, tmp_path, monkeypatch):
    path, chips = tmp_path / "points.parquet", [OPERATIONS, LOIHI]
    zeros = np.zeros((1, 2))
    surface = {
        **{"phi": np.array([3]), "theta": np.array([0.5, 0.7]), "accuracy": np.array([[0.25, 0.5]])},
        "spikes_total": np.array([[7, 9]]),
        **store.work_arrays(Operations(zeros, zeros + 2.0, zeros, zeros, zeros)),
    }
    trials = {
        1: [published(tmp_path, 1, surface=surface)],
        2: [published(tmp_path, 2, r, 0.5 + 0.1 * r) for r in (0, 1)],
        3: [published(tmp_path, 3, work=spiking(4.0))],
        5: [published(tmp_path, 5)],
    }
    going, read = points.PointsTable(space, tmp_path, chips), []
    of_trial = points.PointsTable._of_trial

    def counted_trial(self, trial, runs):
        read.append(trial)
        yield from of_trial(self, trial, runs)

    monkeypatch.setattr(points.PointsTable, "_of_trial", counted_trial)

    def read_again():
        read.clear()
        now = digests(tmp_path, trials)
        going.write(path, trials, now)
        trials_read = list(read)
        points.PointsTable(space, tmp_path, chips).write(tmp_path / "anew.parquet", trials, now)
        assert path.read_bytes() == (tmp_path / "anew.parquet").read_bytes()
        (tmp_path / "anew.parquet").unlink()
        return trials_read

    assert read_again() == [1, 2, 3, 5]
    for trial in (1, 3):  # afterwards no row has phi
        store.remove(store.run_file(tmp_path, trial, 0))
        trials[trial] = [published(tmp_path, trial, accuracy=0.75)]
        assert read_again() == [trial]
    trials[4] = [published(tmp_path, 4, surface=surface)]
    assert read_again() == [4]
    evaluated(store.run_file(tmp_path, 2, 1))
    assert read_again() == [2]
    del trials[1], trials[4]
    assert read_again() == []
