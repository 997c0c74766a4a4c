"""Heads of a joint target: which outputs serve them, and what they answer."""

from dataclasses import replace

import numpy as np

from dse.measure import heads
from tests.joint_data import joint


def test_outputs_of_the_heads_lie_side_by_side():
    data = joint()
    assert heads.head_sizes(data) == (3, 2)
    assert heads.head_slices(data) == [slice(0, 3), slice(3, 5)]
    some = np.array([0, 1, 5])
    texture, profile = (head.of_class[data.target[some]] for head in data.heads)
    np.testing.assert_array_equal(heads.head_targets(data, some), np.stack([texture, profile], axis=1))
    np.testing.assert_array_equal(heads.output_labels(data, some), np.stack([texture, profile + 3], axis=1))


def test_a_single_target_is_one_head():
    data = replace(joint(), heads=())
    assert heads.head_sizes(data) == (5,)
    assert heads.head_slices(data) == [slice(0, 5)]
    np.testing.assert_array_equal(heads.head_targets(data, np.arange(4))[:, 0], data.target[:4])
    np.testing.assert_array_equal(heads.output_labels(data, np.arange(4)), data.target[:4])


def test_one_head_of_a_joint_target_has_plain_labels():
    data = joint()
    one = replace(data, heads=data.heads[1:])
    np.testing.assert_array_equal(
        heads.output_labels(one, np.arange(9)), data.heads[1].of_class[data.target[:9]]
    )


def test_answers_are_the_most_active_outputs_of_each_head():
    counts = np.array([[1, 5, 5, 0, 0], [9, 0, 0, 2, 3]])  # ties: the lowest; a busier head takes nothing
    np.testing.assert_array_equal(heads.head_answers(joint(), counts), [[1, 0], [0, 1]])


def test_a_joint_class_that_never_was_is_no_class():
    data = joint()  # five of the six combinations: never the last texture in the last profile
    pairs = np.stack([head.of_class for head in data.heads], axis=1)
    np.testing.assert_array_equal(heads.joint_label(pairs, data.heads), np.arange(5))
    assert heads.joint_label(np.array([[2, 1]]), data.heads).tolist() == [-1]
    assert heads.joint_label(np.zeros((0, 2), np.int64), data.heads).tolist() == []
