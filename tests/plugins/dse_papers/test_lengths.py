import numpy as np
import pandas as pd
import pytest

from dse_papers.figures.lengths import LengthsFigure, gather_lengths, longest


@pytest.fixture
def trials():
    nan = np.nan
    return pd.DataFrame(
        {
            "trial": [0, 1, 2, 3, 4],
            "window.n_steps": [50, 10, 50, 10, 90],
            "accuracy": [0.8, 0.6, 0.9, 0.6, nan],
            "accuracy_se": [0.01, 0.02, 0.03, 0.04, nan],
            "decision_latency_ms": [500.0, 100.0, 500.0, 100.0, nan],
            "t_p_ms": [300.0, 90.0, 250.0, 80.0, nan],
            "t_h_ms": [100.0, nan, 90.0, 70.0, nan],
        }
    )


def read_out(accuracy, t_h):
    return {
        "decision_latency_ms": np.array([250.0, 500.0]),
        "accuracy": np.array(accuracy),
        "t_p_ms": np.array([200.0, 250.0]),
        "t_h_ms": np.array(t_h),
    }


def test_the_best_trial_of_every_length_beside_the_mean_of_the_read_outs(trials):
    runs = [read_out([0.4, 0.8], [np.nan, 90.0]), read_out([0.6, 1.0], [100.0, 90.0])]
    found = gather_lengths(trials, runs)
    assert longest(trials) == 2
    assert found.trial.tolist() == [1, 2] and found.trained_ms.tolist() == [100, 500]
    assert found.trained["accuracy"].tolist() == [0.6, 0.9] and not found.on_test
    assert found.low["accuracy"].tolist() == found.high["accuracy"].tolist() == [0.02, 0.03]
    assert not found.low["t_p_ms"].any()
    assert found.trained["t_p_ms"].tolist() == [90, 250]
    assert np.isnan(found.trained["t_h_ms"][0]) and found.trained["t_h_ms"][1] == 90
    assert found.early_ms.tolist() == [250, 500]
    assert found.early["accuracy"].tolist() == [0.5, 0.9]
    assert np.isnan(found.early["t_h_ms"][0]) and found.early["t_h_ms"][1] == 90


def test_a_net_without_decision_grid_has_no_times(trials):
    bare = {name: read_out([0.4, 0.8], [1, 2])[name] for name in ("decision_latency_ms", "accuracy")}
    assert np.isnan(gather_lengths(trials, [bare]).early["t_p_ms"]).all()
    never = LengthsFigure().draw(gather_lengths(trials.assign(t_h_ms=np.nan), [bare]))
    assert [note.text for note in never.layout.annotations[3:]] == ["none"]


def test_drawing_has_a_panel_for_each_quantity(trials):
    figure = LengthsFigure().draw(gather_lengths(trials, [read_out([0.4, 0.8], [np.nan, 90.0])]))
    assert [note.text for note in figure.layout.annotations] == ["accuracy", "t_p (ms)", "t_h (ms)"]
    traces = [(trace.name, list(trace.x), list(trace.y)) for trace in figure.data[:2]]
    assert traces == [
        ("trained per length, validation set", [100, 500], [0.6, 0.9]),
        ("one network, read out early, validation set", [250, 500], [0.4, 0.8]),
    ]
    assert [trace.error_y.array is not None for trace in figure.data] == [True] + [False] * 5
    assert [trace.showlegend for trace in figure.data] == [True, True] + [False] * 4


def test_times_of_the_test_set_with_their_range_over_the_runs(trials):
    tested = trials.assign(
        accuracy_test=[0.7, 0.5, 0.85, 0.5, np.nan],
        t_p_test_ms=[310.0, 95.0, 260.0, 85.0, np.nan],
        t_p_test_ms_min=[300.0, 90.0, 200.0, 80.0, np.nan],
        t_p_test_ms_max=[320.0, 99.0, 300.0, 90.0, np.nan],
    )
    early = {"accuracy_test": np.array([0.3, 0.7]), "t_p_test_ms": np.array([220.0, 270.0])}
    found = gather_lengths(tested, [read_out([0.4, 0.8], [1, 2]) | early])
    assert found.on_test and found.trained["accuracy"].tolist() == [0.5, 0.85]
    assert found.trained["t_p_ms"].tolist() == [95, 260]
    assert found.low["t_p_ms"].tolist() == [5, 60] and found.high["t_p_ms"].tolist() == [4, 40]
    assert np.isnan(found.trained["t_h_ms"]).all() and np.isnan(found.early["t_h_ms"]).all()
    assert found.early["accuracy"].tolist() == [0.3, 0.7] and found.early["t_p_ms"].tolist() == [220, 270]
    assert LengthsFigure().draw(found).data[0].name == "trained per length, test set"


def test_nothing_to_show(trials):
    one = read_out([0.4, 0.8], [1, 2])
    with pytest.raises(ValueError, match=r"trials must differ in window\.n_steps"):
        gather_lengths(trials.drop(columns="window.n_steps"), [one])
    with pytest.raises(ValueError, match="at least one finished trial"):
        gather_lengths(trials.iloc[4:], [one])
    with pytest.raises(ValueError, match="read_outs must hold at least one run"):
        gather_lengths(trials, [])
