import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from dse.config import values
from dse.data.encoders.sampled import moving_average
from dse.data.encoders.threshold import Threshold, statistics
from tests.data.encoders import plain
from tests.data.encoders.plain import dense, recorded


def encoded(encoder, signals):
    return plain.encoded(encoder, signals).astype(int)


def fitted(encoder, signals, target, train):
    n = signals.n_recordings
    target = np.asarray(target)
    return encoder.fitted(
        signals, np.zeros(n, int), int(np.diff(signals.offsets).min()), target, target.max() + 1, train
    )


def test_a_trace_by_hand():
    rising = recorded([1, 2, 3, 6])  # mean 3; means until now 1, 1.5, 2, 3
    assert encoded(Threshold("none"), rising)[0, :, 0].tolist() == [0, 0, 1, 1]
    assert encoded(Threshold("none", level="past"), rising)[0, :, 0].tolist() == [1, 1, 1, 1]


def algorithm_1(values, means, tolerance, deviations, own):
    """Return Algorithm 1 for one recording, (step, class * channel): loops over classes and channels."""
    n_steps, n_in = values.shape
    out = np.zeros((n_steps, len(means) * n_in), dtype=int)
    for n in range(len(means)):
        for c in range(n_in):
            mean = sum(values[:, c].tolist()) / n_steps
            distances = [abs(mean - other[c]) for other in means]
            if own is not None:
                active = n == own
            elif tolerance is None:
                active = distances.index(min(distances)) == n
            else:
                active = distances[n] <= tolerance * deviations[n][c]
            if active:
                out[:, n * n_in + c] = values[:, c] >= mean
    return out


@given(
    values=arrays.arrays(np.float32, (5, 4, 2), elements=st.integers(-4, 4).map(float)),
    target=st.permutations([0, 0, 1, 1, 2]),
    tolerance=st.sampled_from([None, 0.0, 0.5, 2.0]),
)
def test_it_is_algorithm_1(values, target, tolerance):
    signals, target = recorded(*(values + np.float32([3, 7]))), np.array(target)
    values = values + np.float32([3, 7])
    levels = values.mean(axis=1, dtype=np.float64)
    means = [levels[target == n].mean(axis=0) for n in range(3)]
    deviations = [levels[target == n].std(axis=0) for n in range(3)]
    matching = "nearest" if tolerance is None else "tolerance"
    encoder = Threshold(matching, tolerance=tolerance or 0.0)
    encoder = fitted(encoder, signals, target, np.arange(5))
    encoded_spikes = encoded(encoder, signals)
    as_printed = encoded(fitted(Threshold("own_label"), signals, target, np.arange(5)), signals)
    for i in range(5):
        assert np.array_equal(encoded_spikes[i], algorithm_1(values[i], means, tolerance, deviations, None))
        assert np.array_equal(as_printed[i], algorithm_1(values[i], means, None, None, target[i]))


def test_a_tie_goes_to_the_lowest_class():
    signals = recorded([1, 1], [3, 3], [2, 2])
    encoder = fitted(Threshold(), signals, [0, 1, 1], np.array([0, 1]))
    assert encoder.means == (1.0, 3.0)
    assert encoded(encoder, signals).tolist() == [[[1, 0]] * 2, [[0, 1]] * 2, [[1, 0]] * 2]


@pytest.mark.parametrize("matching", ["nearest", "tolerance"])
def test_what_is_learnt_comes_from_training_recordings_alone(matching):
    rng = np.random.default_rng(1)
    values = rng.integers(5, 50, (8, 12, 3))
    train, target = np.arange(4), np.array([0, 1, 0, 1, 1, 0, 1, 0])
    encoder = fitted(Threshold(matching), recorded(*values), target, train)
    values[4:] += 1000
    target[4:] = [0, 1, -1, 1]
    assert fitted(Threshold(matching), recorded(*values), target, train) == encoder
    assert not encoder.transductive and not encoder.labels


def test_own_label_reads_the_label_and_says_so():
    signals = recorded([1, 2, 3], [1, 2, 3])
    encoder = fitted(Threshold("own_label"), signals, [0, 1], np.array([0]))
    assert encoder.transductive
    first, second = encoded(encoder, signals)
    assert first.tolist() == [[0, 0], [1, 0], [1, 0]]
    assert second.tolist() == [[0, 0], [0, 1], [0, 1]], "the same recording, another label"
    with pytest.raises(ValueError, match=r"^encoder.matching must be .*, got own_label, which reads their"):
        encoded(encoder, recorded([1, 2, 3], [1, 2, 4]))
    nameless = fitted(Threshold("own_label"), signals, [0, -1], np.array([0]))
    with pytest.raises(ValueError, match="needs the label of recording 1"):
        encoded(nameless, signals)
    kept = dense(nameless.encode_all(signals, np.zeros(2, int), np.array([3, 0])))
    assert kept.sum(axis=(1, 2)).tolist() == [2, 0]


def test_means_that_were_removed_match_nothing():
    rng = np.random.default_rng(2)
    values = rng.normal(0, 1 + np.arange(6).reshape(6, 1, 1) % 2, (6, 40, 2))
    centred = recorded(*(values - values.mean(axis=1, keepdims=True)))
    with pytest.raises(ValueError, match=r"^encoder.statistic must be std if the mean of every channel is"):
        fitted(Threshold(), centred, [0, 1, 0, 1, 0, 1], np.arange(4))
    std = Threshold(statistic="std")
    encoder = fitted(std, centred, [0, 1, 0, 1, 0, 1], np.arange(4))
    assert (
        encoded(encoder, centred).reshape(6, 40, 2, 2).any(axis=(1, 3)).tolist()
        == [[True, False], [False, True]] * 3
    )
    shifted = recorded(*(values + np.array([300.0, -20.0])))
    same = fitted(std, shifted, [0, 1, 0, 1, 0, 1], np.arange(4))
    np.testing.assert_allclose(same.means, encoder.means, rtol=1e-4)


def test_a_class_without_training_recordings_is_never_matched():
    signals = recorded([1, 1], [5, 5], [9, 9])
    encoder = fitted(Threshold(), signals, [0, 2, 1], np.array([0, 1]))
    assert (encoder.n_classes, encoder.classes) == (3, (0, 2))
    assert encoded(encoder, signals)[2].tolist() == [[0, 0, 1]] * 2
    wide = fitted(Threshold("tolerance", tolerance=1e9), recorded([1, 1], [2, 2]), [0, 2], np.array([0, 1]))
    assert encoded(wide, recorded([7, 7]))[0].sum() == 0, "one recording has no deviation: equality is asked"


@pytest.mark.parametrize("matching", ["nearest", "tolerance", "none"])
@pytest.mark.parametrize("statistic", ["mean", "std"])
def test_level_past_is_causal(matching, statistic):
    rng = np.random.default_rng(3)
    values = rng.integers(0, 40, (6, 30, 2))
    encoder = Threshold(matching, statistic, 2.0, "past", 35.0)
    encoder = fitted(encoder, recorded(*values), [0, 1, 2, 0, 1, 2], np.arange(6))
    whole = encoded(encoder, recorded(*values))
    for end in (1, 2, 17, 29):
        assert np.array_equal(encoded(encoder, recorded(*values[:, :end])), whole[:, :end])


def test_constant_channels_are_at_their_mean():
    signals = recorded(np.full((57, 3), 0.1), np.zeros((57, 3)))
    for level in ("window", "past"):
        for smoothing_ms in (0.0, 70.0):
            assert encoded(Threshold("none", level=level, smoothing_ms=smoothing_ms), signals).all()


def test_no_steps_have_no_spikes():
    empty = Threshold("none").encode_all(recorded([1, 2]), np.zeros(1, int), np.zeros(1, int))
    assert (empty.channel.size, empty.row_offsets.tolist()) == (0, [0])


@given(
    values=arrays.arrays(np.float32, (9, 2), elements=st.integers(-20, 20).map(float)),
    window=st.integers(0, 12),
    first=st.integers(0, 8),
)
def test_moving_average(values, window, first):
    average = moving_average(values, window, first, 9 - first)
    for t in range(first, 9):
        expected = values[max(0, t + 1 - max(window, 1)) : t + 1].mean(axis=0, dtype=np.float64)
        assert average[t - first] == pytest.approx(expected, abs=1e-12)


@given(values=arrays.arrays(np.float64, (7, 2), elements=st.integers(-9, 9).map(lambda x: x / 4 + 1e5)))
def test_statistics_until_now_end_at_those_of_all(values):
    mean, spread = statistics(values, past=True)
    for t in range(7):
        one = statistics(values[: t + 1], past=False)
        assert mean[t] == pytest.approx(one[0][0], rel=1e-14)
        assert spread[t] == pytest.approx(one[1][0], abs=1e-7)


def test_it_knows_its_channels():
    with pytest.raises(ValueError, match="matching nearest must be fitted to training recordings first"):
        Threshold().n_channels(19)
    assert dataclasses.replace(Threshold(), n_classes=20).n_channels(19) == 380, "as published"


def test_what_is_learnt_survives_json():
    signals = recorded([1, 1], [3, 4], [2, 2])
    for matching in ("nearest", "tolerance", "own_label"):
        encoder = fitted(Threshold(matching), signals, [0, 1, 1], np.array([0, 1]))
        stored = json.loads(json.dumps(values.plain(encoder)))
        assert values.read_object(Threshold, stored, (), pytest.fail) == encoder
