import numpy as np
from sklearn.neighbors import KNeighborsClassifier

from dse.config.settings import Column, Split, Window
from dse.data.recordings import doubts
from dse.data.recordings.splits import split
from dse.data.recordings.targets import target
from dse.data.recordings.time_series import TimeSeries
from dse.data.recordings.windows import mean_levels, place

RNG = np.random.default_rng(11)
CODES = np.repeat([0, 1, 2], 30)
TRAIN, VALIDATION = np.arange(0, 90, 2), np.arange(1, 90, 2)


def warned(lengths, levels, follow=True):
    return doubts.shortcuts(lengths, levels, CODES, TRAIN, VALIDATION, "fabric", lambda: follow)


def test_a_label_read_off_the_length_is_reported():
    sentences = warned(100 + 50 * CODES + RNG.integers(0, 5, 90), None)
    assert len(sentences) == 1
    assert sentences[0].startswith(
        "recording length alone predicts fabric with accuracy 1.000 on validation (largest class 0.333)"
    )
    assert sentences[0].endswith("windows of one length hide it")


def test_a_label_read_off_the_level_is_reported():
    levels = RNG.normal(size=(90, 4)) + 5 * CODES[:, None]
    sentences = warned(np.full(90, 100), levels)
    assert (
        len(sentences) == 1 and "resting level (mean of each channel) alone predicts fabric" in sentences[0]
    )
    assert "window.remove_mean: true or an encoder of changes" in sentences[0]
    assert warned(np.full(90, 100), levels, follow=False)[0].endswith("the encoder drops it already")


def test_honest_data_is_left_in_peace():
    assert warned(RNG.integers(100, 200, 90), RNG.normal(size=(90, 4))) == []
    assert warned(np.full(90, 100), np.zeros((90, 4))) == []


def test_neighbours_agree_with_scikit_learn():
    features = RNG.normal(size=(600, 3)) * [1, 10, 100] + CODES.repeat(7)[:600, None]
    codes = RNG.integers(0, 4, 300)
    guess = doubts.nearest_neighbours(features[:300], codes, features[300:])
    scaled = (features - features[:300].mean(axis=0)) / features[:300].std(axis=0)
    peer = KNeighborsClassifier(5).fit(scaled[:300], codes).predict(scaled[300:])
    assert np.array_equal(guess, peer)


def test_few_training_rows_and_a_constant_feature():
    train = np.array([[0.0, 7.0], [1.0, 7.0]])
    assert doubts.nearest_neighbours(train, np.array([0, 1]), np.array([[3.0, 7.0], [-1, 7]])).tolist() == [
        1,
        0,
    ]


def test_three_lucky_guesses_are_no_evidence():
    codes = np.array([0, 0, 1, 1, 0, 1, 1])
    lengths = np.array([10, 11, 20, 21, 10, 20, 20])
    assert doubts.shortcuts(lengths, None, codes, np.arange(4), np.arange(4, 7), "fabric", bool) == []


def test_the_traps_of_public_recordings_are_found(shared_data):
    source = TimeSeries(
        "fabric_slide/fabric_slide_train_val.npz", 28, offsets="offsets",
        columns={"fabric": "label", "velocity": "velocity_mm_s", "force": "force_setting",
                 "repetition": "repetition"}, class_names={"fabric": "class_names"},
    )  # fmt: skip
    signals = source.read(shared_data)
    lengths = np.diff(signals.offsets)
    start, _, _, n_steps = place(Window(128), lengths, np.ones(644, dtype=bool))
    levels = mean_levels(signals, start, n_steps)
    # The README of the data gives kNN on the mean level 0.960 for fabric, 0.230 for speed.
    for name, settings, what, accuracy in (
        ("fabric", "fabric", "resting level", "0.960"),
        ("force", "force", "resting level", ""),
        ("speed", Column("velocity", abs=True), "recording length", "1.000"),
    ):
        codes, classes = target(signals.columns, settings)
        parts = split(signals.columns, codes, classes, Split({"repetition": 0}, {"repetition": 1}))
        (sentence,) = doubts.shortcuts(lengths, levels, codes, *parts[:2], name, bool)
        assert what in sentence and accuracy in sentence
