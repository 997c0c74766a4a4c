import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from dse.base.records import Signals
from dse.data.encoders.send_on_delta import POLARITIES, REFERENCES, STARTS, SendOnDelta
from dse.data.recordings.time_series import TimeSeries
from dse.testing import check_encoder
from tests.data.encoders.plain import encoded, fitted, recorded, send_on_delta


@pytest.mark.parametrize(
    ("reference", "off", "on"),
    [
        # x = 10 10 11 13 18 18 17 12, threshold 2, by hand. Level sent last:
        #     value 10 10 10 13 18 18 18 12,  step 10 10 10 12 14 16 16 14,  level 10 10 10 12 18 18 18 12
        ("value", [0, 0, 0, 0, 0, 0, 0, 1], [0, 0, 0, 1, 1, 0, 0, 0]),
        ("step", [0, 0, 0, 0, 0, 0, 0, 1], [0, 0, 0, 1, 1, 1, 0, 0]),
        ("level", [0, 0, 0, 0, 0, 0, 0, 1], [0, 0, 0, 1, 1, 0, 0, 0]),
    ],
)
def test_a_trace_by_hand(reference, off, on):
    values = np.array([10, 10, 11, 13, 18, 18, 17, 12])[:, None]
    assert send_on_delta(values, (2.0,), reference).astype(int).T.tolist() == [off, on]


def test_where_the_rules_differ():
    values = np.array([0, 3, 4, 4, 4])[:, None]
    on = {rule: send_on_delta(values, (2.0,), rule)[:, 1].astype(int).tolist() for rule in REFERENCES}
    assert on == {"value": [0, 1, 0, 0, 0], "step": [0, 1, 1, 0, 0], "level": [0, 1, 1, 0, 0]}
    values = np.array([0, 6, 6, 6])[:, None]
    on = {rule: send_on_delta(values, (2.0,), rule)[:, 1].astype(int).tolist() for rule in REFERENCES}
    assert on == {"value": [0, 1, 0, 0], "step": [0, 1, 1, 1], "level": [0, 1, 0, 0]}


def test_channels_are_threshold_then_polarity_then_channel():
    values = np.array([[0, 0, 0], [1, -5, 0]])
    spikes = send_on_delta(values, (1.0, 4.0), "value")
    assert np.flatnonzero(spikes[1]).tolist() == [1, 3, 7]  # OFF of channel 1; ON of 0; OFF of 1 at 4
    encoder = SendOnDelta((1.0, 4.0), "value")
    assert encoder.n_channels(3) == 12
    found = encoder.encode_all(recorded(values), np.array([0]), np.array([2]))
    assert (found.channel.tolist(), found.row_offsets.tolist()) == ([1, 3, 7], [0, 0, 3])
    assert (found.n_channels, found.step_ms) == (12, 10.0)
    assert (found.channel.dtype, found.row_offsets.dtype) == (np.int32, np.int64)


@given(
    values=arrays.arrays(
        np.float32, arrays.array_shapes(min_dims=2, max_dims=2, max_side=12),
        elements=st.integers(-40, 40).map(lambda x: x / 4),
    ),
    thresholds=st.lists(st.sampled_from([0.25, 0.3, 1.0, 2.5, 7.0]), min_size=1, max_size=3),
    reference=st.sampled_from(REFERENCES),
    polarity=st.sampled_from(POLARITIES),
    start=st.sampled_from(STARTS),
)  # fmt: skip
def test_the_fast_path_is_the_definition(values, thresholds, reference, polarity, start):
    encoder = SendOnDelta(tuple(thresholds), reference, polarity, start)
    encoder = fitted(encoder, recorded(values + 7), len(values))
    first = encoder.means if start == "mean" else None
    wanted = send_on_delta(values, tuple(thresholds), reference, polarity, first)
    assert np.array_equal(encoded(encoder, recorded(values))[0], wanted)


def test_from_the_mean_of_the_training_windows_the_resting_level_is_sent():
    # Means of windows of two steps: 3.25 and -1; in steps of 0.5, half to even: 3 and -1.
    encoder = fitted(
        SendOnDelta((0.5, 4.0), start="mean"), recorded([[4, -1], [3, -1], [90, 90]], [[3, 0], [3, -2]]), 2
    )
    assert encoder.means == (3.0, -1.0)
    values = np.array([[5, -1], [5, -1], [5, -1]])
    on = encoded(encoder, recorded(values))[0]
    assert [np.flatnonzero(row).tolist() for row in on] == [[2], [2], [2]]
    assert not encoded(SendOnDelta((0.5, 4.0)), recorded(values)).any()
    check_encoder(SendOnDelta((2.0, 4.0), start="mean"))
    for wrong in (SendOnDelta((0.5,), start="mean"), encoder):
        with pytest.raises(ValueError, match=r"encoder.start mean must know 3 means, got [02]"):
            wrong.running(3, 10.0)


def test_merged_polarities_by_hand():
    # Thresholds 2 and 4, level sent last by rule 'value': 10 10 13 13 9 9 and 10 10 10 10 10 10
    values = np.array([[10, 0], [11, 0], [13, 0], [13, 0], [9, 0], [8, -5]])
    separate = [[], [], [2], [], [0], [1, 5]]  # OFF 0 1, ON 2 3 of threshold 2; OFF 4 5, ON 6 7 of 4
    merged = [[], [], [0], [], [0], [1, 3]]
    for polarity, wanted in (("separate", separate), ("merged", merged)):
        encoder = SendOnDelta((2.0, 4.0), "value", polarity)
        assert [np.flatnonzero(row).tolist() for row in encoded(encoder, recorded(values))[0]] == wanted
    assert encoder.n_channels(2) == 4


@given(
    values=arrays.arrays(np.int16, (12, 2), elements=st.integers(-30, 30)),
    cut=st.integers(1, 12),
    level=st.integers(-500, 500),
    reference=st.sampled_from(REFERENCES),
)
def test_causal_blind_to_level_and_quiet_at_first(values, cut, level, reference):
    spikes = send_on_delta(values, (1.0, 3.0), reference)
    assert not spikes[0].any()
    assert np.array_equal(send_on_delta(values[:cut], (1.0, 3.0), reference), spikes[:cut])
    assert np.array_equal(send_on_delta(values + level, (1.0, 3.0), reference), spikes)
    mirrored = send_on_delta(-values, (1.0, 3.0), reference).reshape(12, 2, 2, 2)
    assert np.array_equal(mirrored[:, :, ::-1].reshape(12, -1), spikes)


def test_events_of_public_recordings(shared_data):
    """The data's README: 1, 2, 3, 5 counts give a median of about 5000, 2040, 1110, 480 crossings per window.

    Crossings are counted from the window's first sample, several per sample where several levels are crossed;
    rule 'level' sends one spike for them.
    """
    source = TimeSeries("fabric_slide/fabric_slide_train_val.npz", 28, offsets="offsets")
    signals = source.read(shared_data)
    start = signals.offsets[:-1] + (np.diff(signals.offsets) - 128) // 2
    windows = signals.values.reshape(-1, 16)[start[:, None] + np.arange(128)]
    everywhere = Signals(windows.reshape(-1, 16), np.arange(645) * 128, 28.0, {})
    n, whole = np.zeros(644, dtype=np.int64), np.full(644, 128)
    for theta, about in ((1, 5000), (2, 2040), (3, 1110), (5, 480)):
        crossings, spikes = _crossings(windows, theta)
        assert np.median(crossings) == pytest.approx(about, rel=0.01)
        found = SendOnDelta((float(theta),), "level").encode_all(everywhere, n, whole)
        per_window = np.diff(found.row_offsets[::128])
        assert np.array_equal(per_window, spikes)


def _crossings(windows, theta):
    """Return levels crossed and samples with a crossing, per window, by integer arithmetic."""
    sent = windows[:, 0].astype(np.int64)
    crossings, spikes = np.zeros(len(windows), dtype=np.int64), np.zeros(len(windows), dtype=np.int64)
    for t in range(1, windows.shape[1]):
        d = windows[:, t].astype(np.int64) - sent
        levels = np.abs(d) // theta
        sent = sent + np.sign(d) * levels * theta
        crossings += levels.sum(axis=1)
        spikes += (levels > 0).sum(axis=1)
    return crossings, spikes
