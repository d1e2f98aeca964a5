"""Which motion each track follows."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg._core.stream.assignment import (
    NATS_TO_CHANGE,
    REMEMBERED,
    assign,
    neighbour_shares,
    remembered,
)


def test_neighbours_vote_but_not_for_themselves():
    points = np.concatenate([np.arange(8), 100 + np.arange(8)])[:, None] * [1.0, 1.0]
    columns = np.repeat([0, 1], 8)
    columns[0] = -1
    shares = neighbour_shares(points, columns, 2)
    assert_array_equal(shares.argmax(axis=1), np.repeat([0, 1], 8))
    assert_allclose(shares.sum(axis=1), 1)
    alone = neighbour_shares(points[:2], np.array([-1, 0]), 2)
    assert_array_equal(alone, np.zeros((2, 2)))


def test_labels_change_only_for_enough_nats():
    nats = np.array([[1.0, 0.0], [NATS_TO_CHANGE + 0.1, 0.0]])
    chosen = assign(nats, np.zeros((2, 2)), np.zeros((2, 2)), np.zeros(2, dtype=int))
    assert_array_equal(chosen, [0, 1])


def test_what_earlier_frames_say_is_forgotten_by_and_by():
    memory = remembered(np.array([[10.0, 0.0]]), np.array([[3.0, 6.0]]), 3)
    assert_allclose(memory, [[10 * REMEMBERED, 1.0]])
