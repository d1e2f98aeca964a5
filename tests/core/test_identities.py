"""Numbers of motions that last."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import norm

from skmotionseg._core.stream.identities import (
    ANY_SIZE,
    MOST_ABSENT,
    SIZE_CHANGES,
    SIZES,
    Numbers,
    Trace,
    going_on,
    parts,
    pixel_of,
)

SIZE = np.array([640.0, 480.0])


def at(frame, x, y, radius=20.0):
    place = np.array([x, y])
    return Trace(frame, place, 1, place, np.zeros(2), np.log(radius))


def test_numbers_come_back_where_they_are_expected():
    numbers = Numbers()
    assert [numbers.new() for _ in range(3)] == [0, 1, 2]
    numbers.see(1, at(10, 100.0, 100.0))
    numbers.see(2, at(10, 500.0, 100.0))
    numbers.hide(1), numbers.hide(2)
    assert numbers.of(at(18, 175.0, 100.0), SIZE, {0}) == (1, True)
    assert numbers.of(at(18, 175.0, 100.0), SIZE, {0, 1}) == (3, False)
    assert numbers.of(at(18, 300.0, 400.0), SIZE, {0, 1, 3}, former=2) == (2, True)
    assert numbers.hidden == set()


def test_what_was_elsewhere_long_ago_comes_back_where_it_used_to_be():
    places = 100 + np.array([[0.0, 0.0], [30.0, 0.0], [0.0, 30.0], [30.0, 30.0]])
    often = at(0, *places[0])
    for frame in range(1, 200):
        often = at(frame, *places[frame % 4]).after(often)
    assert often.n_frames == 200
    assert_allclose(often.mean, places.mean(axis=0))
    assert_allclose(often.variance, places.var(axis=0), rtol=1e-9)
    numbers = Numbers()
    numbers.new()
    numbers.see(0, at(204, 400.0, 100.0).after(often))  # and then it left
    numbers.hide(0)
    gone = numbers.traces[0]
    assert gone.evidence(at(210, 400.0, 100.0), SIZE) > 0
    assert gone.evidence(at(290, 400.0, 100.0), SIZE) < 0
    there = gone.evidence(at(290, 120.0, 110.0), SIZE)
    assert there > 0
    assert gone.evidence(at(290, 120.0, 110.0, 60.0), SIZE) < there


def test_evidence_is_the_ratio_of_two_densities():
    # A motion that was always at one place and of one size, as one that appears there.
    seen = at(0, 0.0, 0.0, 640 * ANY_SIZE)._replace(n_frames=10**9)
    nats = seen.evidence(at(1, 0.0, 0.0, 640 * ANY_SIZE), SIZE)
    places = norm.pdf(0, scale=640 * ANY_SIZE) ** 2 * 640 * 480
    sizes = norm.pdf(0, scale=SIZE_CHANGES) / norm.pdf(0, scale=SIZES)
    assert_allclose(nats, np.log(places * sizes), rtol=1e-6)


def test_trace_of_tracks_is_where_three_are_seen():
    points = np.zeros((5, 6, 2)) + np.arange(6)[:, None]
    seen = np.ones((5, 6), dtype=bool)
    seen[:3, 4:] = seen[2:, 0] = False  # two tracks at the ends
    last, first = (Trace.of(10, points, seen, first=first) for first in (False, True))
    assert (last.frame, first.frame, last.n_frames) == (13, 11, 3)
    assert_array_equal(last.place, [3, 3])
    assert_array_equal(first.place, [1, 1])
    assert_array_equal(last.mean, [2, 2])
    assert last.log_radius == 0  # no less than a pixel
    assert Trace.of(10, points, seen[:2], first=True) is None


@pytest.mark.parametrize("unit", [1e-3, 1e-5, 100.0])
def test_evidence_does_not_depend_on_the_unit(unit):
    """What was large is not what appears elsewhere and is small, however measured."""
    rng = np.random.default_rng(0)
    large, small = (
        np.array(place) + radius * rng.standard_normal((30, 5, 2))
        for place, radius in (((100, 100), 60), ((500, 300), 15))
    )
    seen = np.ones((30, 5), dtype=bool)

    def evidence(unit):
        size = unit * SIZE
        of = partial(Trace.of, least_radius=pixel_of(size))
        gone, new = of(0, unit * large, seen), of(34, unit * small, seen, first=True)
        return gone.evidence(new, size)

    assert evidence(1.0) < 0
    assert_allclose(evidence(unit), evidence(1.0))


def test_numbers_that_are_all_given_come_back_anywhere():
    numbers = Numbers()
    numbers.new(), numbers.new()
    assert numbers.of(at(5, 0.0, 0.0), SIZE, {0, 1}, most=2) == (None, False)
    numbers.see(1, at(6, 0.0, 0.0))
    numbers.hide(1)
    assert numbers.of(at(9, 600.0, 400.0), SIZE, {0}, most=2) == (1, True)


def test_numbers_are_forgotten_and_merged():
    numbers = Numbers()
    for _ in range(4):
        numbers.new()
    numbers.see(1, at(0, 0.0, 0.0))
    numbers.hide(1)
    numbers.proven = {0, 1}
    assert numbers.forget(MOST_ABSENT) == []
    assert numbers.forget(MOST_ABSENT + 1) == [1]
    assert numbers.proven == {0}
    numbers.merge(3, 2)
    numbers.merge(2, 0)
    assert_array_equal(numbers.final(np.array([-1, 0, 1, 2, 3])), [-1, 0, 1, 0, 0])


def test_motion_that_has_lost_its_tracks_may_be_the_one_that_appears():
    numbers = Numbers()
    numbers.new(), numbers.new()
    numbers.see(1, at(10, 100.0, 100.0))
    near, far = at(12, 110.0, 100.0), at(12, 500.0, 400.0)
    assert numbers.of(near, SIZE, {0}, fading=[1]) == (1, True)
    assert numbers.of(far, SIZE, {0}, fading=[1]) == (2, False)
    assert list(numbers.traces) == [1]


def test_part_of_a_motion_is_that_motion_rather_than_a_hidden_one():
    numbers = Numbers()
    for place in (100.0, 400.0):
        number = numbers.new()
        numbers.see(number, at(10, place, 100.0))
    numbers.hide(1)
    near, far = at(12, 400.0, 100.0), at(60, 300.0, 100.0)
    assert numbers.of(far, SIZE, {0}, most=2) == (1, True)
    numbers.hide(1)
    assert numbers.of(far, SIZE, {0}, most=2, shared=0) == (0, True)
    # Of something large that covers the picture, anything may be a part.
    numbers.see(0, at(11, 100.0, 100.0, 10**6.0).after(numbers.traces[0]))
    assert numbers.of(near, SIZE, {0}, most=2, shared=0) == (1, True)


def test_what_has_come_again_is_likely_to_come_again():
    numbers = Numbers()
    for place in (100.0, 500.0):
        numbers.see(numbers.new(), at(0, place, 100.0))

    place = at(60, 220.0, 240.0)  # which says little
    numbers.hide(1)
    assert numbers.of(place, SIZE, {0}) == (2, False)
    assert numbers.n_new > numbers.n_again
    for _ in range(9):
        numbers.hide(1)
        assert numbers.of(at(2, 500.0, 100.0), SIZE, {0}) == (1, True)
    numbers.hide(1)
    assert numbers.of(place, SIZE, {0}) == (1, True)


def test_groups_go_on_with_what_most_of_their_tracks_had():
    shared = np.array([[40, 2, 0], [3, 30, 0], [0, 0, 2]])
    assert going_on(shared, [0, 4, 7]) == {0: 0, 1: 4}  # two tracks tell nothing
    # A part of a larger motion is new.
    assert going_on(np.array([[40, 0], [12, 0]]), [0, 4]) == {0: 0}
    assert going_on(np.zeros((0, 2), dtype=int), [0, 4]) == {}
    assert going_on(np.zeros((2, 0), dtype=int), []) == {}


def test_what_tells_which_group_goes_on_may_be_another_thing_than_tracks():
    shared, evidence = np.array([[1, 20], [0, 25]]), np.array([[9, 400], [0, 175]])
    assert going_on(shared, [0, 4]) == {1: 4}
    assert going_on(shared, [0, 4], evidence) == {0: 4}
    few = np.array([[1, 2], [0, 25]])
    assert going_on(few, [0, 4], evidence) == {}  # too few tracks, whatever they tell


def test_where_all_are_given_and_none_is_likely_it_is_the_likeliest():
    numbers = Numbers()
    for number, x in enumerate((0.0, 10.0, 600.0)):
        numbers.see(numbers.new(), at(0, x, 10.0, 1.0))
        if number:
            numbers.hide(number)
    first = at(3, 640.0, 480.0, 300.0)
    nats = {n: numbers.traces[n].evidence(first, SIZE) for n in (1, 2)}
    assert nats[1] < nats[2] < 0
    assert numbers.of(first, SIZE, {0}, most=3) == (2, True)
    assert numbers.hidden == {1}


def test_of_a_motion_that_was_nowhere_nothing_is_expected():
    numbers = Numbers()
    numbers.see(numbers.new(), None)
    numbers.hide(0)
    assert numbers.hidden == set() and numbers.traces == {}
    numbers.see(numbers.new(), at(0, 1.0, 1.0))
    numbers.hide(1)
    numbers.proven.add(1)
    numbers.forget_all()
    assert (numbers.hidden, numbers.traces, numbers.proven) == (set(), {}, set())
    assert numbers.next == 2  # no number is given twice
    assert numbers.of(None, SIZE, {0}, most=2) == (2, False)  # one of two was given up
    assert numbers.of(None, SIZE, {0, 2}, most=2) == (None, False)


def test_a_part_that_was_seen_nowhere_is_of_what_it_shares():
    numbers = Numbers()
    numbers.see(numbers.new(), at(0, 1.0, 1.0))
    assert numbers.of(None, SIZE, {0}, most=1, shared=0) == (0, True)
    assert numbers.of(None, SIZE, {0}, most=1) == (None, False)


def test_what_is_in_the_group_of_another_is_a_part_of_the_older():
    shared = np.array([[90, 0, 16], [3, 20, 4]])
    assert parts(shared, [0, 4, 7]) == [(0, 7)]
    shared[1, 2] = 6  # no three quarters any more
    assert parts(shared, [0, 4, 7]) == []
    assert parts(np.array([[10, 30, 0]]), [0, 4, 7]) == [(0, 4)]
    assert parts(np.zeros((0, 2), dtype=int), [0, 4]) == []
    assert parts(np.zeros((1, 2), dtype=int), [0, 4]) == []
