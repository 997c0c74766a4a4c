import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from dse.data.encoders.quantised import Quantised
from dse.data.encoders.send_on_delta import STARTS
from dse.testing import check_encoder
from tests.data.encoders.plain import encoded, fitted, recorded

SAMPLES = arrays.arrays(np.int16, (12, 3), elements=st.integers(-60, 60))


def digits_of(values, encoder, first):
    """Return the spikes of one recording, (step, copy, channel), digit by digit."""
    spikes = np.zeros((len(values), encoder.digits, 2, values.shape[1]), bool)
    r = np.array(first, float)
    for t, x in enumerate(values.astype(float)):
        steps = np.minimum(np.abs(x - r) // encoder.step, 2**encoder.digits - 1).astype(int)
        for j in range(encoder.digits):
            is_one = (steps >> (encoder.digits - 1 - j)) & 1 == 1
            spikes[t, j, 0], spikes[t, j, 1] = is_one & (x < r), is_one & (x > r)
        r += np.sign(x - r) * steps * encoder.step
    return spikes.reshape(len(values), -1)


def test_a_trace_by_hand():
    # x = 10 12.5 20 9: 5 steps up; 15 up, of which 7 can be told; 22 down less those 8, so 14, of which 7
    encoder = Quantised(step=0.5, digits=3)
    spikes = encoded(encoder, recorded(np.array([[10], [12.5], [20], [9]])))[0]
    off, on = spikes[:, ::2].astype(int).tolist(), spikes[:, 1::2].astype(int).tolist()
    assert on == [[0, 0, 0], [1, 0, 1], [1, 1, 1], [0, 0, 0]]
    assert off == [[0, 0, 0], [0, 0, 0], [0, 0, 0], [1, 1, 1]]
    assert encoder.rises(1).tolist() == [-4, 4, -2, 2, -1, 1]
    assert encoder.n_channels(2) == 12 and encoder.rises(2).tolist()[:4] == [-4, -4, 4, 4]


@given(
    values=SAMPLES,
    digits=st.integers(1, 6),
    step=st.sampled_from([0.5, 1.0, 3.0]),
    start=st.sampled_from(STARTS),
)
def test_the_fast_path_is_the_definition(values, digits, step, start):
    encoder = fitted(Quantised(step, digits, start), recorded(values + 7), len(values))
    first = encoder.means if start == "mean" else values[0]
    assert np.array_equal(encoded(encoder, recorded(values))[0], digits_of(values, encoder, first))


@given(values=SAMPLES, start=st.sampled_from(STARTS))
def test_spikes_add_up_to_the_signal(values, start):
    encoder = fitted(Quantised(1.0, 7, start), recorded(values + 3), len(values))
    spikes = encoded(encoder, recorded(values))[0]
    rises = (spikes * encoder.rises(3)).reshape(12, -1, 3).sum(axis=1)
    first = encoder.means if start == "mean" else values[0]
    assert np.array_equal(np.cumsum(rises, axis=0), values - first)


@pytest.mark.parametrize("start", STARTS)
def test_the_contract(start):
    check_encoder(Quantised(2.0, 4, start))
