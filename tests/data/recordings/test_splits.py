import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dse.config.settings import KFold, LeaveOut, Split, Stratified, Window
from dse.data.recordings import splits
from dse.data.recordings.splits import Labelled, split

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
    rule = Split(leave_out=LeaveOut("repetition", 2))
    assert parts(rule) == [[0, 1, 3, 4], [2, 5], []] and rule.columns() == ("repetition",)


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


def fold(f, columns=None, codes=CODES, classes=CLASSES, **keys):
    return split(columns or {}, codes, classes, Split(k_fold=KFold(fold=f, **keys)))


def test_the_seed_matters_and_nothing_else():
    codes = np.zeros(40, dtype=int)
    for kind, rule in (
        ("stratified", lambda seed: Stratified(0.5, seed=seed)),
        ("k_fold", lambda s: KFold(seed=s)),
    ):
        one, same, other = (
            split({}, codes, ("a",), Split(**{kind: rule(seed)}))[1].tolist() for seed in (1, 1, 2)
        )
        assert one == same != other


def grouped(rng, k):
    """Codes and groups of one to four classes; every class has at least k groups, which classes may share."""
    n_classes = rng.integers(1, 5)
    rows = [
        (code, group)
        for code in range(n_classes)
        for group in rng.choice(30, rng.integers(k, 31), replace=False)
        for _ in range(rng.integers(1, 5))
    ]
    codes, groups = rng.permutation(np.array(rows)).T
    return codes, np.char.add("g", groups.astype(str)), tuple("abcd"[:n_classes])


@given(st.integers(2, 6), st.integers(0, 999))
def test_folds_are_a_partition_and_groups_stay_whole(k, seed):
    codes, groups, classes = grouped(np.random.default_rng(seed), k)
    columns = {"plate": groups}
    validated = []
    for f in range(k):
        train, validation, test = fold(f, columns, codes, classes, k=k, group="plate", seed=seed)
        assert not len(test)
        assert sorted([*train, *validation]) == list(range(len(codes)))
        assert not set(groups[train]) & set(groups[validation])
        validated += validation.tolist()
    assert sorted(validated) == list(range(len(codes)))


@given(
    sizes=st.lists(st.integers(10, 30), min_size=1, max_size=4),
    k=st.integers(2, 5),
    test=st.sampled_from([None, 0.1, 0.2, 0.4]),
    seed=st.integers(0, 9),
)
def test_folds_are_as_even_as_classes_divide_and_share_a_test_set(sizes, k, test, seed):
    codes = np.random.default_rng(seed).permutation(np.repeat(np.arange(len(sizes)), sizes))
    classes = tuple("abcd")[: len(sizes)]
    parts = [fold(f, {}, codes, classes, k=k, test=test, seed=seed) for f in range(k)]
    held = parts[0][2]
    for train, validation, tested in parts:
        assert tested.tolist() == held.tolist()
        assert sorted(np.concatenate([train, validation, tested]).tolist()) == list(range(len(codes)))
        for code, size in enumerate(sizes):
            n_test = (codes[held] == code).sum()
            assert abs(n_test - (test or 0) * size) <= 1
            assert (codes[validation] == code).sum() in {
                int(np.floor((size - n_test) / k)),
                int(np.ceil((size - n_test) / k)),
            }
    validated = np.concatenate([validation for _, validation, _ in parts])
    assert sorted([*validated, *held]) == list(range(len(codes)))
    assert max(len(x[1]) for x in parts) - min(len(x[1]) for x in parts) <= len(sizes)


def test_groups_of_one_class_each_are_spread_evenly():
    codes = np.repeat([0, 1, 2], 40)
    plate = np.repeat(np.arange(30), 4)
    for f in range(5):
        _, validation, _ = fold(f, {"plate": plate}, codes, tuple("abc"), k=5, group="plate")
        assert np.bincount(codes[validation]).tolist() == [8, 8, 8]


def test_a_drawn_test_set_keeps_groups_whole():
    codes, plate = np.tile([0, 1], 30), np.repeat(np.arange(15), 4)
    train, validation, test = fold(2, {"plate": plate}, codes, CLASSES, k=3, group="plate", test=0.2)
    assert np.bincount(codes[test]).tolist() == [6, 6] and np.bincount(codes[validation]).tolist() == [8, 8]
    assert not set(plate[test]) & {*plate[train], *plate[validation]}
    assert not set(plate[train]) & set(plate[validation])


def test_a_test_set_by_column_is_the_same_in_all_folds():
    columns = {"force": np.tile([1, 2, 3], 8), "plate": np.tile(np.arange(12), 2)}
    codes = np.repeat([0, 1], 12)
    rule = KFold(k=2, test={"force": 3}, group="plate")
    assert Split(k_fold=rule).columns() == ("plate", "force")
    for f in range(2):
        _, _, test = fold(f, columns, codes, k=2, test={"force": 3}, group="plate")
        assert test.tolist() == np.flatnonzero(columns["force"] == 3).tolist()


@given(st.integers(0, 999))
def test_a_drawn_split_can_keep_groups_whole(seed):
    codes, groups, classes = grouped(np.random.default_rng(seed), 12)
    rule = Split(stratified=Stratified(0.2, 0.2, seed, "plate"))
    assert rule.columns() == ("plate",)
    drawn = split({"plate": groups}, codes, classes, rule)
    assert sorted(np.concatenate(drawn).tolist()) == list(range(len(codes)))
    for one, other in itertools.combinations(drawn, 2):
        assert not set(groups[one]) & set(groups[other])
    assert abs(len(drawn[1]) / len(codes) - 0.2) < 0.15 > abs(len(drawn[2]) / len(codes) - 0.2)


def leak(columns, settings, train, validation, test, window):
    return splits.leak(Labelled(columns, None, None, (), train, validation, test), settings, window)


def columns_of(*n_windows):
    return {
        "recording": np.repeat(np.arange(len(n_windows)), n_windows),
        "window": np.concatenate([np.arange(n) for n in n_windows]),
    }


def test_windows_that_share_steps_must_not_be_in_two_parts():
    columns, none = columns_of(2, 2, 2), np.zeros(0, dtype=int)
    drawn, by_column = Split(stratified=Stratified(0.2)), Split({"part": "a"}, {"part": "b"})
    overlap = Window(cut_steps=4, every_steps=2)
    whole = [np.array([0, 1]), np.array([2, 3]), np.array([4, 5])]
    assert leak(columns, drawn, *whole, overlap) == ""
    assert leak({}, drawn, np.array([0]), np.array([1]), none, Window(4)) == ""
    torn = np.array([0, 1, 2]), np.array([3, 4, 5])
    sentence = leak(columns, drawn, *torn, none, overlap)
    assert sentence.startswith(
        "windows with common steps of one recording are in train and in validation (1 of"
    )
    assert sentence.endswith("split.stratified.group: recording prevents this")
    late = leak(columns, by_column, np.array([0, 1]), np.array([2, 3, 4]), np.array([5]), overlap)
    assert "are in validation and in test (1 of the 1 in test)" in late
    assert late.endswith("a split by column 'recording' prevents this")


@pytest.mark.parametrize(("every", "shares"), [(None, False), (4, False), (5, False), (3, True), (1, True)])
def test_windows_share_steps_where_they_overlap(every, shares):
    window = Window(cut_steps=4, every_steps=every)
    halves = np.array([0, 1, 2]), np.array([3, 4, 5]), np.zeros(0, dtype=int)
    assert bool(leak(columns_of(6), Split(stratified=Stratified(0.2)), *halves, window)) == shares


@given(
    st.lists(st.integers(0, 6), min_size=1, max_size=4),
    st.integers(1, 6),
    st.integers(1, 6),
    st.integers(0, 99),
)
def test_leak_is_the_comparison_of_all_windows(n_windows, cut_steps, every, seed):
    columns = columns_of(*n_windows)
    part = np.random.default_rng(seed).choice(3, sum(n_windows), p=[0.8, 0.1, 0.1])
    starts = columns["window"] * every
    shared = [
        (i, j)
        for i, j in itertools.combinations(range(sum(n_windows)), 2)
        if part[i] != part[j]
        and columns["recording"][i] == columns["recording"][j]
        and abs(starts[i] - starts[j]) < cut_steps
    ]
    sentence = leak(
        columns,
        Split(stratified=Stratified(0.2)),
        *(np.flatnonzero(part == p) for p in range(3)),
        Window(cut_steps=cut_steps, every_steps=every),
    )
    assert bool(sentence) == bool(shared)
