"""What a new search says of the motions that live."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from skmotionseg._core.stream.living import LivingMotion
from skmotionseg._core.stream.renewing import (
    in_order,
    recognised,
    rows_of_groups,
    shared_tracks,
)


def living(*numbers):
    return [LivingMotion(number, None, 0) for number in numbers]


def following(*numbers_and_sizes):
    """A buffer whose tracks follow motions: so many each."""
    numbers, sizes = zip(*numbers_and_sizes, strict=True)
    labels = np.repeat(numbers, sizes)
    n = len(labels)
    return SimpleNamespace(ids=10 * np.arange(n), labels=labels, followed=np.full(n, 9))


def test_groups_are_of_tracks_that_are_in_view():
    buffer = SimpleNamespace(ids=np.array([2, 3, 5, 8]))
    ids, labels = np.array([1, 3, 4, 5, 8]), np.array([0, 1, 0, -1, 1])
    groups = rows_of_groups(buffer, ids, labels)
    assert [rows.tolist() for rows in groups] == [[], [1, 3]]


def test_tracks_are_shared_by_groups_and_motions():
    buffer = following((0, 4), (7, 3), (-1, 2))
    groups = [np.array([0, 1, 4]), np.array([5, 7, 8])]
    shared, numbers = shared_tracks(buffer, living(7, 0), groups)
    assert_array_equal(shared, [[1, 2], [1, 0]])
    assert numbers == [7, 0]
    for motions, found in (([], groups), (living(0), [])):
        shared, _ = shared_tracks(buffer, motions, found)
        assert shared.shape == (len(found), len(motions))


def test_groups_have_numbers_of_motions_and_leave_alone_what_the_search_missed():
    buffer = following((0, 30), (4, 20), (7, 15))
    scene = np.arange(30)
    with_some_of_7 = np.arange(30, 55)
    groups, numbers = recognised(buffer, living(0, 4, 7), [scene, with_some_of_7])
    assert_array_equal(numbers, [0, 4])
    assert_array_equal(groups[0], scene)
    assert_array_equal(groups[1], np.arange(30, 50))
    _, numbers = recognised(buffer, living(0), [scene, with_some_of_7])
    assert_array_equal(numbers, [0, -1])


def test_a_motion_goes_on_in_those_that_have_followed_it_for_longer():
    buffer = following((0, 30), (4, 45))
    scene, old, new = np.arange(30), np.arange(30, 50), np.arange(50, 75)
    buffer.followed[old] = 20
    _, numbers = recognised(buffer, living(0, 4), [scene, new, old])
    assert_array_equal(numbers, [0, -1, 4])


@pytest.mark.parametrize(
    ("n_new", "order"), [(-1, [1]), (0, [1]), (1, [1, 3]), (2, [1, 0, 3])]
)
def test_what_goes_on_is_renewed_first_and_then_the_largest(n_new, order):
    groups = [np.arange(size) for size in (5, 2, 3, 9)]
    assert in_order(groups, np.array([-1, 4, -1, -1]), n_new) == order
