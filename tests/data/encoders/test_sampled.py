"""What holds for every shipped encoder: spans of recordings, and where copies of a channel lie."""

import dataclasses

import numpy as np
import pytest

from dse.data.encoders.receptors import Receptors
from dse.data.encoders.send_on_delta import REFERENCES, SendOnDelta
from dse.data.encoders.threshold import Threshold
from dse.testing import check_encoder
from tests.data.encoders.plain import dense, recorded


@pytest.mark.parametrize(
    "encoder", [*(SendOnDelta((2.0, 5.0), x) for x in REFERENCES), Receptors(spikes_per_step=2)], ids=repr
)
def test_spans_of_recordings_are_encoded_as_whole_ones_are(encoder):
    check_encoder(encoder)


def test_the_level_of_threshold_is_that_of_the_steps_that_are_kept():
    recordings = [np.random.default_rng(4).integers(0, 9, (n, 2)) for n in (30, 19)]
    first, length = np.array([10, 4]), np.array([12, 9])
    found = dense(Threshold("none", smoothing_ms=30).encode_all(recorded(*recordings), first, length))
    for i, values in enumerate(recordings):
        smooth = np.stack([values[max(0, t - 2) : t + 1].mean(axis=0) for t in range(len(values))])
        piece = smooth[first[i] : first[i] + length[i]]
        assert np.array_equal(found[i, : length[i]], piece >= piece.mean(axis=0))


@pytest.mark.parametrize(
    ("encoder", "planes"),
    [
        (SendOnDelta((1.0, 2.0)), [0, 0, 4, 1, 1, 5, 2, 2, 6, 3, 3, 7]),
        (SendOnDelta((1.0, 2.0), polarity="merged"), [0, 0, 2, 1, 1, 3]),
        (Receptors(), [0, 0, 3, 1, 1, 4, 2, 2, 5]),
        (dataclasses.replace(Threshold(), n_classes=2), [0, 0, 2, 1, 1, 3]),
        (Threshold("none"), [0, 0, 1]),
    ],
)
def test_copies_of_a_channel_lie_where_it_does_in_planes_of_their_own(encoder, planes):
    inputs = np.array([[5, 2, 0], [7, 3, 0], [5, 2, 1]], dtype=np.int32)
    positions = encoder.positions(inputs)
    assert positions.shape == (encoder.n_channels(3), 3) and positions.dtype == np.int32
    assert positions[:, :2].tolist() == inputs[:, :2].tolist() * (len(planes) // 3)
    assert positions[:, 2].tolist() == planes
    assert inputs[2].tolist() == [5, 2, 1], "the input is left as it was"
