import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.recordings import RecordingError
from dse.recordings.splits import LeaveOut, Split, Stratified, split

COLUMNS = {
    "repetition": np.array([0, 1, 2, 0, 1, 2], dtype=np.int8),
    "part": np.array(["train", "val", "train", "val", "train", "train"]),
    "force": np.array([150, 150, 200, 200, 200, 150]),
}
CODES, CLASSES = np.array([0, 0, 0, 1, 1, 1]), ("silk", "wool")


def parts(settings, columns=COLUMNS, codes=CODES, classes=CLASSES):
    return [x.tolist() for x in split(columns, codes, classes, settings)]


def test_by_column_leaves_the_rest_out():
    rule = Split({"repetition": (0,)}, {"repetition": [1]})
    assert parts(rule) == [[0, 3], [1, 4], []]
    assert all(x.dtype == np.int64 for x in split(COLUMNS, CODES, CLASSES, rule))
    assert parts(Split({"repetition": [0]}, {"repetition": 1}, {"repetition": 2})) == [[0, 3], [1, 4], [2, 5]]
    assert parts(Split({"part": "train"}, {"part": "val"})) == [[0, 2, 4, 5], [1, 3], []]
    assert parts(Split({"repetition": [0, 2]}, {"repetition": 1, "force": 150})) == [[0, 2, 3, 5], [1], []]


def test_one_group_left_out():
    rule = Split(leave_out=LeaveOut("repetition", 2))
    assert parts(rule) == [[0, 1, 3, 4], [2, 5], []] and rule.columns() == ("repetition",)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            Split({"repetition": 0}, {"repetition": [0, 1]}),
            "split: recording 0 is in train and in validation",
        ),
        (Split({"rep": 0}, {"repetition": 1}), "split.train: no column 'rep' among data.columns; known: "),
        (
            Split({"repetition": 0}, {"repetition": [1, 7]}),
            "column 'repetition' holds no 7; it holds 0, 1, 2",
        ),
        (Split({"part": "trian"}, {"part": "val"}), "column 'part' holds no 'trian'; it holds train, val"),
        (Split(leave_out=LeaveOut("force", 7)), "split.leave_out: column 'force' holds no 7"),
        (Split({"repetition": 2, "part": "val"}, {"repetition": 1}), "split.train holds no recording"),
        (Split({"repetition": 0}, {"repetition": 2, "part": "val"}), "split.validation holds no recording"),
    ],
)
def test_faults(settings, message):
    with pytest.raises(RecordingError, match=message):
        parts(settings)


@pytest.mark.parametrize("name", ["validation", "test"])
def test_a_class_missing_from_train_is_named(name):
    groups = {"group": np.array([0, 0, 1, 2, 1, 2])}
    chosen = {"train": {"group": 0}, "validation": {"group": 1}, "test": {"group": 2}}
    codes = np.array([0, 0, 0, 1, 0, 1]) if name == "test" else np.array([0, 0, 1, 0, 1, 0])
    with pytest.raises(RecordingError, match=f"split: class 'wool' is in {name} but missing from train"):
        parts(Split(**chosen), groups, codes)


@pytest.mark.parametrize(
    "keys",
    [
        {},
        {"train": {"part": "train"}},
        {"validation": {"part": "val"}},
        {"train": {}, "validation": {"part": "val"}},
        {"train": {"part": "train"}, "validation": {"part": "val"}, "stratified": Stratified(0.2)},
        {"stratified": Stratified(0.2), "leave_out": LeaveOut("force", 150)},
    ],
)
def test_exactly_one_form(keys):
    with pytest.raises(RecordingError, match="split must"):
        Split(**keys)


@given(
    sizes=st.lists(st.integers(5, 40), min_size=1, max_size=4),
    validation=st.floats(0.2, 0.4),
    test=st.sampled_from([0.0, 0.2, 0.4]),
    seed=st.integers(0, 99),
)
def test_a_drawn_split_takes_the_same_share_of_every_class(sizes, validation, test, seed):
    codes = np.random.default_rng(seed).permutation(np.repeat(np.arange(len(sizes)), sizes))
    classes = tuple("abcd")[: len(sizes)]
    settings = Split(stratified=Stratified(validation, test, seed))
    drawn = split({}, codes, classes, settings)
    assert sorted(np.concatenate(drawn).tolist()) == list(range(len(codes)))
    for code, size in enumerate(sizes):
        held = [(codes[part] == code).sum() for part in drawn]
        assert held[1:] == [round(validation * size), round(test * size)] and held[0] > 0
    again = split({}, codes, classes, settings)
    assert all(np.array_equal(a, b) for a, b in zip(drawn, again, strict=True))


def test_the_seed_of_a_drawn_split_matters():
    codes = np.zeros(40, dtype=int)
    first, second = (
        split({}, codes, ("a",), Split(stratified=Stratified(0.5, seed=seed)))[1] for seed in (0, 1)
    )
    assert first.tolist() != second.tolist()


def test_a_class_too_small_to_draw_from_is_named():
    with pytest.raises(
        RecordingError, match=r"class 'wool' has 2 recordings, too few for validation 0\.2 and test 0"
    ):
        parts(Split(stratified=Stratified(0.2)), {}, np.array([0] * 10 + [1] * 2))
    with pytest.raises(
        RecordingError, match=r"class 'silk' has 4 recordings, too few for validation 0\.5 and test 0\.5"
    ):
        parts(Split(stratified=Stratified(0.5, 0.5)), {}, np.array([0] * 4 + [1] * 4))
