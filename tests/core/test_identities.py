"""Numbers of motions that last."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_array_equal

from skmotionseg._core.stream.identities import MOST_ABSENT, Numbers, Trace


def at(frame, x, y, velocity=(0.0, 0.0), radius=20.0):
    return Trace(frame, np.array([x, y]), np.array(velocity), radius)


def test_numbers_come_back_where_they_are_expected():
    numbers = Numbers()
    assert [numbers.new() for _ in range(3)] == [0, 1, 2]
    numbers.hide(1, at(10, 100.0, 100.0, (10.0, 0.0)))
    numbers.hide(2, at(10, 500.0, 100.0))
    assert numbers.of(at(18, 175.0, 100.0), 1.0, {0}) == (1, True)
    assert numbers.of(at(18, 175.0, 100.0), 1.0, {0, 1}) == (3, False)
    assert numbers.of(at(18, 300.0, 400.0), 1.0, {0, 1, 3}, former=2) == (2, True)
    assert numbers.hidden == {}


def test_numbers_that_are_all_given_come_back_anywhere():
    numbers = Numbers()
    numbers.new(), numbers.new()
    assert numbers.of(at(5, 0.0, 0.0), 1.0, {0, 1}, most=2) == (None, False)
    numbers.hide(1, at(6, 0.0, 0.0))
    assert numbers.of(at(9, 600.0, 400.0), 1.0, {0}, most=2) == (1, True)


def test_numbers_are_forgotten_and_merged():
    numbers = Numbers()
    for _ in range(4):
        numbers.new()
    numbers.hide(1, at(0, 0.0, 0.0))
    assert numbers.forget(MOST_ABSENT) == []
    assert numbers.forget(MOST_ABSENT + 1) == [1]
    numbers.merge(3, 2)
    numbers.merge(2, 0)
    assert_array_equal(numbers.final(np.array([-1, 0, 1, 2, 3])), [-1, 0, 1, 0, 0])


def test_motion_that_has_lost_its_tracks_may_be_the_one_that_appears():
    numbers = Numbers()
    numbers.new(), numbers.new()
    fading = {1: at(10, 100.0, 100.0)}
    near, far = at(12, 110.0, 100.0), at(12, 500.0, 400.0)
    assert numbers.of(near, 1.0, {0}, fading=fading) == (1, True)
    assert numbers.of(far, 1.0, {0}, fading=fading) == (2, False)
    assert list(fading) == [1]
