"""Which motion each track follows."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg._core.stream.assignment import (
    FEWEST_TELLING,
    NATS_TO_CHANGE,
    REMEMBERED,
    USUAL_QUARTILE,
    Residuals,
    assign,
    neighbour_shares,
    noise_of,
    remembered,
)


def test_neighbours_vote_but_not_for_themselves():
    points = np.concatenate([np.arange(8), 100 + np.arange(8)])[:, None] * [1.0, 1.0]
    columns = np.repeat([0, 1], 8)
    columns[0] = -1
    shares = neighbour_shares(points, np.zeros((16, 2)), columns, 2, 0.2)
    assert_array_equal(shares.argmax(axis=1), np.repeat([0, 1], 8))
    assert_allclose(shares.sum(axis=1), 1)
    alone = neighbour_shares(points[:2], np.zeros((2, 2)), np.array([-1, 0]), 2, 0.2)
    assert_array_equal(alone, np.zeros((2, 2)))


def test_neighbours_go_the_same_way_where_that_is_known():
    points = np.random.default_rng(0).uniform(0, 100, (60, 2))
    columns = np.arange(60) % 2
    steps = np.where(columns == 1, 9.0, 0.0)[:, None] * [1.0, 0.5]
    steps[50:] = np.nan
    shares = neighbour_shares(points, steps, columns, 2, 0.2)
    assert_array_equal(shares[:50].argmax(axis=1), columns[:50])
    assert shares[:50].max(axis=1).min() > 0.8
    by_place = neighbour_shares(points, np.full((60, 2), np.nan), columns, 2, 0.2)
    assert_allclose(shares[50:], by_place[50:])
    # Steps that differ by less than tells anything are all the same.
    small = neighbour_shares(points, steps / 1e6, columns, 2, 0.2)[:50]
    alike = neighbour_shares(points, np.where(steps > 0, 0, steps), columns, 2, 0.2)
    assert_allclose(small, alike[:50])


def test_labels_change_only_for_enough_nats():
    nats = np.array([[1.0, 0.0], [NATS_TO_CHANGE + 0.1, 0.0]])
    chosen = assign(nats, np.zeros((2, 2)), np.zeros((2, 2)), np.zeros(2, dtype=int))
    assert_array_equal(chosen, [0, 1])


def test_what_earlier_frames_say_is_forgotten_by_and_by():
    memory = remembered(np.array([[10.0, 0.0]]), np.array([[3.0, 6.0]]), 3)
    assert_allclose(memory, [[10 * REMEMBERED, 1.0]])


def test_noise_is_that_of_a_motions_own_tracks():
    usual = np.linspace(0.3, 0.7, 40)
    assert noise_of(usual) == pytest.approx(0.4 / USUAL_QUARTILE)
    assert noise_of(usual / 4) == 1
    assert noise_of(5 * usual) == pytest.approx(5 * noise_of(usual))
    # Others among them, fewer than three quarters, are not taken for noise.
    assert noise_of(np.append(usual, np.full(40, 50.0))) < 1.5 * noise_of(usual)
    assert noise_of(np.full(FEWEST_TELLING - 1, 9.0)) == 1
    assert noise_of(np.append(np.full(FEWEST_TELLING, 0.7), np.nan)) == 2


def test_outliers_are_those_of_their_own_motion():
    squares = np.tile([[0.01, 25.0]], (40, 1))
    squares[20:] = [[25.0, 0.25]]
    squares[39, 1] = 25.0
    freedom = np.ones((40, 2))
    columns = np.repeat([0, 1], 20)
    residuals = Residuals(squares, freedom, squares, 0.1, np.ones(2), np.ones(40))
    quiet, noisy = residuals.with_noise(columns, np.ones(40, dtype=bool)).noise
    assert quiet == pytest.approx(1 / USUAL_QUARTILE)
    assert noisy == pytest.approx(5 / USUAL_QUARTILE)
    found = residuals.with_noise(columns, np.ones(40, dtype=bool))
    usual = np.take_along_axis(found.usual(), columns[:, None], axis=1)[:, 0]
    assert np.flatnonzero(usual > 1).tolist() == [39]
    assert found.without(0).noise == [noisy]
