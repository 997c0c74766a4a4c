"""Spikes counted in windows, and what every classifier of counts must do."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.base.records import Parameters, Spikes
from dse.models.counts.knn import KNN
from dse.models.counts.linear import Linear
from dse.models.counts.mlp import MLP
from dse.models.counts.naive_bayes import NaiveBayes
from dse.models.counts.rate_windows import (
    event_counts,
    event_edges_us,
    input_lengths,
    window_counts,
    window_edges,
)
from dse.models.training import Training
from dse.testing.expect import same
from dse.testing.small import spikes_of
from tests.models.counted import data_of, rngs, textures

FAMILIES = [
    KNN(window_ms=50.0, channels="each"),
    NaiveBayes(window_ms=50.0),
    MLP(window_ms=50.0, channels="each", hidden=(8,), epochs=60, learning_rate=0.05),
    MLP(window_ms=50.0, channels="each", hidden=(8,), epochs=60, learning_rate=0.05, precision="int8"),
    Linear(window_ms=50.0),
]
every_family = pytest.mark.parametrize("family", FAMILIES, ids=lambda family: type(family).__name__)


def counted_slowly(x, start, n_steps, step_ms, window_ms, channels):
    """Rep(T) spike by spike: x is (sample, step, channel) bool."""
    n_windows = 1 + int((n_steps - 1) * step_ms / window_ms + 1e-9)
    counts = np.zeros((len(x), n_windows, x.shape[2]), int)
    for n, t, c in np.argwhere(x):
        if start[n] <= t < start[n] + n_steps:
            counts[n, int((t - start[n]) * step_ms / window_ms + 1e-9), c] += 1
    return counts.sum(axis=2, keepdims=True) if channels == "sum" else counts


@given(
    seed=st.integers(0, 10**6),
    shape=st.tuples(st.integers(1, 4), st.integers(1, 30), st.integers(1, 5)),
    step_ms=st.sampled_from([1.0, 5.0, 28.0, 0.1, 1000 / 3]),
    ratio=st.one_of(st.integers(1, 40), st.floats(1, 40)),
    channels=st.sampled_from(["sum", "each"]),
)
def test_counts_are_those_of_the_definition(seed, shape, step_ms, ratio, channels):
    rng = np.random.default_rng(seed)
    x = rng.random(shape) < rng.choice([0.0, 0.05, 0.5, 1.0])
    n_steps = int(rng.integers(1, shape[1] + 1))
    start = rng.integers(0, shape[1] - n_steps + 1, shape[0])
    edges = window_edges(n_steps, step_ms, ratio * step_ms)
    counts = window_counts(spikes_of(x, step_ms), np.arange(shape[0]), start, edges, channels)
    expected = counted_slowly(x, start, n_steps, step_ms, ratio * step_ms, channels)
    assert np.array_equal(counts, expected)
    assert counts.sum() == sum(x[n, s : s + n_steps].sum() for n, s in enumerate(start))


@given(
    seed=st.integers(0, 10**6),
    window_us=st.sampled_from([1, 7, 999, 1000, 2500, 10**6]),
    channels=st.sampled_from(["sum", "each"]),
)
def test_events_count_where_their_microsecond_lies(seed, window_us, channels):
    """Windows begin at stored step 0 to 2 of steps of 1 ms and last 4 steps, whatever a window's length."""
    rng = np.random.default_rng(seed)
    t_us = [np.sort(rng.integers(0, 6000, rng.integers(0, 30))) for _ in range(3)]
    rows = np.concatenate([np.bincount(t // 1000, minlength=6) for t in t_us])
    channel = rng.integers(0, 2, len(np.concatenate(t_us)))
    spikes = Spikes(
        np.concatenate([[0], np.cumsum(rows)]), channel.astype(np.int32), 6, 2, 1.0,
        np.concatenate(t_us).astype(np.int32),
    )  # fmt: skip
    start, edges_us = np.array([2, 0, 1]), event_edges_us(4000, window_us / 1000)
    assert edges_us[0] == 0 and edges_us[-1] == 4000
    order = np.array([2, 0, 1, 0])
    counts = event_counts(spikes, order, start[order], edges_us, channels)
    borders = np.concatenate([[0], np.cumsum([len(t) for t in t_us])])
    expected = np.zeros((4, len(edges_us) - 1, 2), int)
    for n, i in enumerate(order):
        for t, c in zip(t_us[i] - 1000 * start[i], channel[borders[i] : borders[i + 1]], strict=True):
            if 0 <= t < 4000:
                expected[n, t // window_us, c] += 1
    assert np.array_equal(counts, expected.sum(axis=2, keepdims=True) if channels == "sum" else expected)


@every_family
def test_events_at_the_starts_of_their_steps_give_the_same_answers(family):
    data = textures()
    step = np.repeat(np.arange(60 * 25) % 25, np.diff(data.spikes.row_offsets))
    timed = replace(data, spikes=replace(data.spikes, t_us=(10_000 * step).astype(np.int32)))
    binned, by_time = (family.fit(x, Training(), rngs).validation for x in (data, timed))
    assert np.array_equal(binned.label, by_time.label)
    assert binned.time_ms == pytest.approx(by_time.time_ms)
    assert np.array_equal(binned.input_spikes, by_time.input_spikes)
    finer = replace(family, window_ms=2.5)  # shorter than a step of 10 ms
    assert finer.fit(timed, Training(), rngs).validation.time_ms[-1] == 230.0
    with pytest.raises(ValueError, match=r"window_ms must be >= 0\.001, got 0\.0001"):
        replace(family, window_ms=1e-4).fit(timed, Training(), rngs)


def test_samples_in_any_order_and_more_than_once():
    x = np.random.default_rng(0).random((5, 12, 3)) < 0.3
    samples, start = np.array([3, 0, 3]), np.array([1, 0, 2])
    counts = window_counts(spikes_of(x, 10.0), samples, start, window_edges(10, 10, 40), "each")
    assert np.array_equal(counts, counted_slowly(x[samples], start, 10, 10, 40, "each"))


@pytest.mark.parametrize(
    ("n_steps", "step_ms", "window_ms", "expected"),
    [
        (20, 5, 20, [0, 4, 8, 12, 16, 20]),
        (10, 5, 20, [0, 4, 8, 10]),  # the last window is shorter
        # steps begin at 0, 28, 56, 84 | 112, 140, 168, 196 | 224, 252, 280 | 308
        (12, 28, 100, [0, 4, 8, 11, 12]),
        (9, 0.1, 0.3, [0, 3, 6, 9]),  # 3 x 0.1 > 0.3 and 6 x 0.1 < 0.6 in floating point
        (6, 1000 / 6, 500, [0, 3, 6]),
        (5, 10, 10, [0, 1, 2, 3, 4, 5]),
        (5, 10, 1000, [0, 5]),
        (1, 10, 100, [0, 1]),
    ],
)
def test_a_step_belongs_to_the_window_in_which_it_begins(n_steps, step_ms, window_ms, expected):
    assert window_edges(n_steps, step_ms, window_ms).tolist() == expected


def test_windows_must_lie_in_what_is_stored():
    spikes = spikes_of(np.ones((2, 5, 1), bool), 10.0)
    with pytest.raises(ValueError, match="windows of 4 steps must lie within the 5 stored steps"):
        window_counts(spikes, np.arange(2), np.array([0, 2]), window_edges(4, 10, 20), "sum")


@given(st.integers(1, 3000), st.integers(1, 50))
def test_input_lengths_rise_evenly_to_the_whole(n_windows, most):
    lengths = input_lengths(n_windows, most)
    assert len(lengths) == min(n_windows, most)
    assert lengths[-1] == n_windows and lengths[0] >= 1
    assert np.ptp(np.diff(lengths, prepend=0)) <= 1


@every_family
def test_learns_and_answers_again_from_its_parameters(family):
    data = textures()
    before = data.spikes.channel.copy(), data.target.copy()
    outcome = family.fit(data, Training(), rngs)
    label = outcome.validation.label
    assert label.shape == (24, 5) and label.dtype == np.int64
    assert (label[:, -1] == data.target[data.validation]).mean() > 0.6
    assert same(outcome.validation, family.respond(outcome.network, data, data.validation))
    assert same(outcome.test, family.respond(outcome.network, data, data.test))
    assert same(outcome.validation, family.fit(data, Training(), rngs).validation)
    assert np.array_equal(before[0], data.spikes.channel) and np.array_equal(before[1], data.target)


@every_family
def test_a_sample_is_answered_alike_alone_and_among_others(family):
    data = textures()
    outcome = family.fit(data, Training(), rngs)
    alone = [family.respond(outcome.network, data, data.validation[i : i + 1]).label for i in range(24)]
    assert np.array_equal(np.concatenate(alone), outcome.validation.label)


@every_family
def test_fitting_sees_training_samples_only(family):
    data = textures()
    x = np.zeros((60, 25, 4), bool)
    for i in data.train:
        rows = data.spikes.row_offsets[i * 25 : (i + 1) * 25 + 1]
        for t in range(25):
            x[i, t, data.spikes.channel[rows[t] : rows[t + 1]]] = True
    target = data.target.copy()
    target[data.validation] = 0
    other = replace(data, spikes=spikes_of(x, 10.0), target=target)
    a, b = (family.fit(each, Training(), rngs).network.arrays for each in (data, other))
    assert a.keys() == b.keys()
    assert all(np.array_equal(a[name], b[name]) for name in a)


@every_family
def test_a_short_input_is_a_classifier_of_its_own(family):
    """What is answered after two windows is what training on two windows alone gives."""
    data = textures()
    short = replace(data, n_steps=10)
    whole, part = (family.fit(each, Training(), rngs).validation for each in (data, short))
    assert np.array_equal(whole.label[:, 1], part.label[:, -1])
    assert whole.n_weights[1] == part.n_weights[-1] and whole.additions[1] == part.additions[-1]
    thinned = replace(family, read_outs=2).fit(data, Training(), rngs).validation
    assert thinned.time_ms.tolist() == [150, 230]
    assert np.array_equal(thinned.label, whole.label[:, [2, 4]])


@every_family
def test_times_and_spikes_by_hand(family):
    data = textures()
    answers = family.fit(data, Training(), rngs).validation
    assert answers.time_ms.tolist() == [50, 100, 150, 200, 230]
    for row, i in enumerate(data.validation):
        for column, end in enumerate((5, 10, 15, 20, 23)):
            first = i * 25 + data.start[i]
            expected = data.spikes.row_offsets[first + end] - data.spikes.row_offsets[first]
            assert answers.input_spikes[row, column] == expected
    assert np.array_equal(answers.additions, answers.input_spikes.mean(axis=0))
    assert np.array_equal(answers.macs, answers.n_weights)
    assert answers.n_weights.shape == (5,)


@pytest.mark.parametrize(
    ("family", "expected"),
    [
        (KNN(window_ms=50.0), [30, 60, 90, 120, 150]),  # 30 training samples
        (KNN(window_ms=50.0, channels="each"), [120, 240, 360, 480, 600]),
        (NaiveBayes(window_ms=50.0, channels="each"), [24, 48, 72, 96, 120]),  # 2 x 3 classes
        (MLP(window_ms=50.0, hidden=(8, 5), epochs=2), [63, 71, 79, 87, 95]),  # 8 T + 8 x 5 + 5 x 3
        (Linear(window_ms=50.0), [12, 24, 36, 48, 60]),
    ],
)
def test_weights_by_hand(family, expected):
    assert family.fit(textures(), Training(), rngs).validation.n_weights.tolist() == expected


@every_family
def test_a_class_absent_from_training_is_never_answered(family):
    data = textures()
    part = data.train[data.target[data.train] != 1]
    answers = family.fit(replace(data, train=part), Training(), rngs).validation
    assert set(np.unique(answers.label)) <= {0, 2}
    assert (answers.label[:, -1] == 2).any() and (answers.label[:, -1] == 0).any()


@every_family
def test_one_class_or_one_sample_is_answered_always(family):
    data = textures()
    for train in (data.train[data.target[data.train] == 2], data.train[data.target[data.train] == 2][:1]):
        assert (family.fit(replace(data, train=train), Training(), rngs).validation.label == 2).all()


@every_family
def test_no_spikes_at_all(family):
    data = data_of(np.zeros((9, 10, 2), bool), [2, 2, 0, 2, 1, 0, 1, 2, 0], range(6), range(6, 9))
    answers = family.fit(data, Training(), rngs).validation
    assert (answers.label == 2).all()  # the most frequent in training
    assert (answers.input_spikes == 0).all() and (answers.additions == 0).all()


@every_family
def test_features_that_are_constant_in_training(family):
    rng = np.random.default_rng(5)
    x = np.zeros((40, 10, 3), bool)
    x[:, ::2, 0] = True  # always alike
    target = np.arange(40) % 2
    x[:, :, 1] = rng.random((40, 10)) < np.where(target, 0.9, 0.1)[:, None]
    x[20:, :, 2] = True  # never in training
    answers = family.fit(data_of(x, list(target), range(20), range(20, 40)), Training(), rngs).validation
    assert answers.label.shape == (20, 2)
    x[20:, :, 2] = False
    data = data_of(x, list(target), range(20), range(20, 40))
    assert (family.fit(data, Training(), rngs).validation.label[:, -1] == target[20:]).mean() >= 0.95


@every_family
def test_nothing_to_answer(family):
    data = replace(textures(), validation=np.zeros(0, np.int64), test=np.zeros(0, np.int64))
    outcome = family.fit(data, Training(), rngs)
    assert outcome.validation.label.shape == (0, 5) and outcome.test is None
    assert outcome.validation.additions.tolist() == [0] * 5


@every_family
def test_nothing_to_learn_from(family):
    with pytest.raises(ValueError, match="training needs at least one training sample, got none"):
        family.fit(replace(textures(), train=np.zeros(0, np.int64)), Training(), rngs)


@every_family
def test_other_data_than_it_was_trained_on(family):
    data = textures()
    outcome = family.fit(data, Training(), rngs)
    with pytest.raises(ValueError, match=r"4 channels and 5 windows of 50 ms as in training, got 4 and 4"):
        family.respond(outcome.network, replace(data, n_steps=20), data.validation)
    with pytest.raises(ValueError, match="as in training, got 3 and 5"):
        family.respond(outcome.network, textures(n_channels=3), data.validation)


@every_family
def test_windows_shorter_than_a_step_cannot_be_fitted(family):
    with pytest.raises(ValueError, match="window_ms must be >= the step of 10 ms, got 5"):
        replace(family, window_ms=5.0).fit(textures(), Training(), rngs)


# Two recordings of 4 steps and 2 channels, windows of 2 steps: counts (1, 0), (0, 2) and (2, 0), (0, 0).
COUNTED = np.array([[[1, 0], [0, 0], [0, 1], [0, 1]], [[1, 0], [1, 0], [0, 0], [0, 0]]], bool)
COUNTING = {"tally_start": [1, 1], "tally_step": [2, 4], "tally_spike": [1.5, 2.5], "tally_add": [1.5, 2.5]}
COUNTING |= {"tally_word": [1.5, 2.5], "tally_count": [2, 4]}
LAYERS = {  # the first input length; of the other, all features have weights
    **{f"{j}/0/weight": np.ones((2 * j + 2, 3), np.float32) for j in range(2)},
    **{f"{j}/0/bias": np.array([0, 0, -9], np.float32) for j in range(2)},
    **{f"{j}/1/weight": np.ones((3, 2), np.float32) for j in range(2)},
    **{f"{j}/1/bias": np.zeros(2, np.float32) for j in range(2)},
}


@pytest.mark.parametrize(
    ("family", "arrays", "work"),
    [
        (
            KNN(window_ms=10.0, channels="each", k=1),
            {"counts": np.zeros((3, 2, 2), np.int32), "target": np.array([0, 1, 1])},
            {"neighbour": [6, 12], "sample": [3, 3]},
        ),
        (
            NaiveBayes(window_ms=10.0, channels="each"),
            {
                "classes": np.arange(2),
                "log_prior": np.zeros(2),
                "mean": np.array([[1.0, 0, 0, 0], [1.5, 0, 0, 2]]),
                "variance": np.ones((2, 4)),
                "smoothing": np.zeros(2),
            },
            # (1, 0, 0, 2) and (2, 0, 0, 0): 1 and 1, at last 2 and 1 are not 0, of each of two classes; 1 and
            # 2, at last 2 and 3 are not the mean.
            {"feature": [4, 8], "difference": [2, 3], "deviation": [1.5, 2.5]},
        ),
        (
            MLP(window_ms=10.0, channels="each"),
            {"classes": np.arange(2), "mean": np.zeros(4, np.float32), "scale": np.ones(4, np.float32)}
            | LAYERS,
            # 1 and 1 features are not 0, at last 2 and 1; of three hidden units, two.
            {"scale": [2, 4], "single_row": [3, 3.5], "single": [7, 8.5], "single_unit": [5, 5]},
        ),
    ],
    ids=lambda x: type(x).__name__,
)
def test_work_of_a_program_by_hand(family, arrays, work):
    data = data_of(COUNTED, [0, 1], [], [0, 1], step_ms=5.0)
    fitted = Parameters({**arrays, "lengths": np.array([1, 2])}, 2)
    answers = family.respond(fitted, data, np.arange(2))
    assert {kind: times.tolist() for kind, times in answers.program.items()} == COUNTING | work
