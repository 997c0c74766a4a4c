import dataclasses

import numpy as np

from dse.base.records import Outcome, Response
from dse.measure.confusion import confusion
from dse.measure.objectives.first_spike import FirstSpike, by_class, first_spike, first_spike_ms
from dse.testing import small


def response(output):
    counts = np.zeros((*output.shape[:2], 2), np.int32)
    return Response(output, counts, counts[..., :1], 20.0, 0)


def outputs():
    output = np.zeros((4, 5, 3), np.uint8)
    output[0, [1, 2, 4], [0, 2, 2]] = 1  # the winner, 2, fires at step 2, after 0 did
    output[1, [0, 3], [2, 1]] = 1  # a tie: class 1
    output[2, 4, 0] = 1
    return output


def test_first_spike_is_that_of_the_winner():
    assert first_spike(outputs()).tolist() == [2, 3, 4, -1]
    times_ms = first_spike_ms(response(outputs()))
    assert times_ms[:3].tolist() == [60, 80, 100] and np.isnan(times_ms[3])


def test_times_by_class_leave_silent_samples_and_classes_out():
    times_ms = np.array([20.0, np.nan, 140.0, 30.0, 100.0, np.nan])
    medians = by_class(times_ms, np.array([0, 0, 2, 2, 2, 3]), 4)
    assert medians[[0, 2]].tolist() == [20, 100] and np.isnan(medians[[1, 3]]).all()
    assert np.isnan(by_class(np.full(2, np.nan), np.array([0, 1]), 2)).all()


def full_read_out(output, test=None):
    """Return what a run answers whose samples are of the classes 0, 0, 1, 2."""
    target = np.array([0, 0, 1, 2])
    made = next(x for needs, x in _records() if needs == "full_read_out")
    outcome = dataclasses.replace(
        made.outcome, validation=response(output), test=None if test is None else response(test)
    )
    assert isinstance(outcome, Outcome)
    return dataclasses.replace(
        made, outcome=outcome, target=target, confusion=confusion(target, target, 3),
        target_test=None if test is None else target,
    )  # fmt: skip


def _records():
    return [(needs, x) for needs, some in small.records().items() for x in some]


def test_columns_by_hand():
    columns = FirstSpike().measure(full_read_out(outputs()))
    # Class 0: 60 and 80; class 1: 100; class 2 is silent.
    assert columns == {
        "first_spike_ms": 80.0,
        "first_spike_median_ms": 80.0,
        "first_spike_class_median_ms": 85.0,
        "first_spike_class_min_ms": 70.0,
        "first_spike_class_max_ms": 100.0,
    }
    tested = FirstSpike().measure(full_read_out(outputs(), outputs()[[3, 0, 1, 2]]))
    assert {name: x for name, x in tested.items() if "_test" in name} == {
        "first_spike_test_ms": 80.0,
        "first_spike_test_class_median_ms": 80.0,
        "first_spike_test_class_min_ms": 60.0,
        "first_spike_test_class_max_ms": 100.0,
    }
    assert {name: tested[name] for name in columns} == columns


def test_silence_has_no_times_and_heads_have_none_of_classes():
    assert FirstSpike().measure(full_read_out(np.zeros((4, 5, 3), np.uint8))) == {}
    silent_test = FirstSpike().measure(full_read_out(outputs(), np.zeros((4, 5, 3), np.uint8)))
    assert len(silent_test) == 5
    of_head = FirstSpike().measure(full_read_out(np.ones((4, 5, 7), np.uint8)))  # 7 outputs, 3 classes
    assert of_head == {"first_spike_ms": 20.0, "first_spike_median_ms": 20.0}
