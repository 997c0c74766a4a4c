import numpy as np
import pytest

from dse.figures.first_spike import FirstSpikeFigure, draw_first_spikes, gather_first_spikes
from dse.testing.small import SmallStudy

NAN = np.nan


def test_median_and_range_of_every_class():
    times_ms = np.array([20.0, 140.0, 60.0, NAN, 40.0, NAN])
    found = gather_first_spikes(times_ms, np.array([0, 0, 0, 0, 2, 1]), ["wood", "carpet", "silk"])
    np.testing.assert_equal(found.median_ms, [60, NAN, 40])
    np.testing.assert_equal(found.least_ms, [20, NAN, 40])
    np.testing.assert_equal(found.most_ms, [140, NAN, 40])
    assert found.n_timed.tolist() == [3, 0, 1] and found.n.tolist() == [4, 1, 1]


def test_a_bar_per_class_with_its_range():
    [bars] = draw_first_spikes(
        gather_first_spikes(np.array([20.0, 60.0, 100.0]), np.array([1, 1, 1]), ["a", "<b>"], on_test=True)
    ).data
    np.testing.assert_equal(np.array(bars.x), [NAN, 60])
    assert bars.error_x.array[1] == bars.error_x.arrayminus[1] == 40
    assert bars.customdata[1] == "&lt;b&gt;: median of 3 of 3 samples"


def test_the_test_set_comes_first():
    class Tested(SmallStudy):
        def arrays(self, trial, name):
            return super().arrays(trial, name.replace("_test", ""))

    assert FirstSpikeFigure().gather(Tested()).on_test
    assert not FirstSpikeFigure().gather(SmallStudy()).on_test


def test_what_it_refuses():
    class Joint(SmallStudy):
        def classes(self, trial):
            return "a", "b"

    class Silent(SmallStudy):
        def arrays(self, trial, name):
            return [{"label": np.zeros(3)}]

    with pytest.raises(ValueError, match="a sample must have an output spike, got none"):
        gather_first_spikes(np.array([NAN]), np.array([0]), ["a"])
    with pytest.raises(ValueError, match="trial 0 must have one output per class, got several heads"):
        FirstSpikeFigure(trial=0).gather(Joint())
    with pytest.raises(ValueError, match="trial 0 recorded no 'output' in response"):
        FirstSpikeFigure(trial=0).gather(Silent())
