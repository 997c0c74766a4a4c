"""The designs at the ends of a front, by hand."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.skyline.constraints import ExpressionError
from dse.skyline.front import skyline
from dse_papers.report.ends import ENDS, front_ends

SPIKES = "spikes_per_inference"


def published():
    return pd.DataFrame(
        {
            "accuracy": [0.87, 0.95, 0.68, 0.66],
            SPIKES: [0.75, 9.07, 0.13, 0.13],
            "n_weights": [15, 259, 15, 14],
        }
    )


def test_ties_are_broken_by_accuracy():
    assert front_ends(published(), SPIKES) == dict(zip(ENDS, (1, 2, 3), strict=True))
    # of equal W_t, the better accuracy
    assert list(front_ends(published().drop(index=3), SPIKES).values()) == [1, 2, 0]


def test_what_cannot_be_compared_and_what_saw_its_labels_is_left_out():
    frame = published().assign(transductive=[False, True, False, False])
    frame.loc[2, SPIKES] = np.nan
    assert list(front_ends(frame, SPIKES).values()) == [0, 3, 3]
    assert front_ends(frame.iloc[:0], SPIKES) == {}
    with pytest.raises(ExpressionError, match="size"):
        front_ends(frame, "size")


@given(
    st.lists(
        st.tuples(st.sampled_from([0.5, 0.7, 0.9]), st.sampled_from([1.0, 2.0]), st.sampled_from([10, 20])),
        min_size=1,
        max_size=12,
    )
)
def test_ends_are_on_the_front(rows):
    frame = pd.DataFrame(rows, columns=["accuracy", SPIKES, "n_weights"])
    ends = front_ends(frame, SPIKES)
    goals = [("accuracy", "max"), (SPIKES, "min"), ("n_weights", "min")]
    assert set(ends.values()) <= set(skyline(frame, goals).rows.index)
    assert frame["accuracy"][ends["best accuracy"]] == frame["accuracy"].max()
    assert frame[SPIKES][ends["least spikes"]] == frame[SPIKES].min()
    assert frame["n_weights"][ends["least weights"]] == frame["n_weights"].min()
