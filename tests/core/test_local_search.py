"""Changes of a partition, and the way down to a cheaper one."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_array_equal

from skmotionseg._core.partition.local_search import (
    MOST_CHANGES,
    merged,
    moved,
    refine,
    split,
)


def test_refining_ends_where_no_change_is_cheaper_or_after_many():
    def one_on(labels):
        yield labels
        yield labels + 1

    start = np.zeros(3, dtype=int)
    assert_array_equal(refine(start, lambda x: abs(x[0] - 7), one_on), [7, 7, 7])
    last = refine(start, lambda x: -x[0], one_on)  # whose cost falls for ever
    assert_array_equal(last, np.full(3, MOST_CHANGES))


def test_each_change_is_taken_only_if_it_is_cheaper():
    costs = {0: 5.0, 1: 7.0, 2: 3.0, 3: 3.0}
    labels = {state: np.array([state]) for state in costs}
    tried = []

    def changes(state):
        tried.append(int(state[0]))
        return [labels[1], labels[2], labels[3]]

    end = refine(labels[0], lambda state: costs[int(state[0])], changes)
    assert end is labels[2]
    assert tried == [0, 2]


def test_tracks_move_to_the_motion_that_explains_them():
    labels = np.array([0, 0, 1, 1, -1])
    relative = np.array([[0.5, 3, 2, 0.1, 0.1], [2, 0.4, 0.5, 0.2, np.nan]])
    first, *_ = moved(labels, relative)
    np.testing.assert_array_equal(first, [0, 1, 1, 1, -1])
    some = np.array([[1.5, 9, 1, 9], [1.2, 0.1, 1, 1]])  # 1 is explained, more is not
    assert not list(moved(np.array([0, 1, 0, 1]), some))
    edge = np.array([[1.5, 9, 0.1, 2], [1.0, 0.1, 9, 1]])
    first, *_ = moved(np.array([0, 1, 0, 0]), edge)
    np.testing.assert_array_equal(first, [1, 1, 0, 1])
    empty = np.array([[3.0, 3.0, 3.0], [0.5, 0.5, 0.5]])
    assert not list(moved(np.array([0, 0, 1]), empty))  # a motion would be empty


def test_merged_and_split_partitions_have_no_gaps():
    labels = np.array([0, 1, 2, 2, 1])
    for joined in merged(labels):
        assert set(joined) == {0, 1}
    assert len(list(merged(labels))) == 3
    parted = list(split(labels, lambda group: np.arange(len(group)) > 0))
    assert len(parted) == 2  # a group of one cannot be parted
    assert all(set(new) == {0, 1, 2, 3} for new in parted)
    assert not list(split(labels, lambda group: None))
