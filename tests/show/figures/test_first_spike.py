import numpy as np
import pytest

from dse import store
from dse.base.records import Response
from dse.show.figures import NothingRecorded
from dse.show.figures.first_spike import FirstSpikeFigure
from dse.testing.small import SmallStudy
from tests.figure_data import study

NAN = np.nan


def gathered(steps, target, classes, file="response"):
    """Gather samples that spike once, each in a step of 20 ms for its class; -1: never."""
    output = np.zeros((len(steps), 8, len(classes)), np.uint8)
    for sample, (step, label) in enumerate(zip(steps, target, strict=True)):
        output[sample, step, label] = step >= 0
    response = Response(output, np.zeros((len(steps), 2)), np.zeros(len(steps)), 20.0, 0)
    arrays = store.response_arrays(response, np.arange(len(steps))) | {"target": np.array(target)}
    return FirstSpikeFigure(trial=0).gather(study(classes=classes, **{"response": [arrays], file: [arrays]}))


def test_median_and_range_of_every_class():
    found = gathered([0, 6, 2, -1, 1, -1], [0, 0, 0, 0, 2, 1], ["wood", "carpet", "silk"])
    np.testing.assert_equal(found.median_ms, [60, NAN, 40])
    np.testing.assert_equal(found.least_ms, [20, NAN, 40])
    np.testing.assert_equal(found.most_ms, [140, NAN, 40])
    assert found.n_timed.tolist() == [3, 0, 1] and found.n.tolist() == [4, 1, 1]


def test_a_bar_per_class_with_its_range():
    found = gathered([0, 2, 4], [1, 1, 1], ["a", "<b>"], "response_test")
    [bars] = FirstSpikeFigure().draw(found).data
    np.testing.assert_equal(np.array(bars.x), [NAN, 60])
    assert bars.error_x.array[1] == bars.error_x.arrayminus[1] == 40
    assert bars.customdata[1] == "&lt;b&gt;: median of 3 of 3 samples"
    assert found.on_test


def test_the_test_set_comes_first():
    class Untested(SmallStudy):
        def arrays(self, trial, name):
            return [] if "_test" in name else super().arrays(trial, name)

    assert FirstSpikeFigure().gather(SmallStudy()).on_test
    assert not FirstSpikeFigure().gather(Untested()).on_test


def test_what_it_refuses():
    class Joint(SmallStudy):
        def classes(self, trial):
            return "a", "b"

    class Silent(SmallStudy):
        def arrays(self, trial, name):
            return [{"label": np.zeros(3)}]

    with pytest.raises(NothingRecorded, match="trial 0 must have an output spike, got none"):
        gathered([-1], [0], ["a"])
    with pytest.raises(ValueError, match="trial 0 must have one output per class, got several heads"):
        FirstSpikeFigure(trial=0).gather(Joint())
    with pytest.raises(ValueError, match="trial 0 recorded no 'output' in response"):
        FirstSpikeFigure(trial=0).gather(Silent())
