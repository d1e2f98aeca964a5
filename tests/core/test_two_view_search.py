"""Motions of two images are found, and what each number of them costs."""

from __future__ import annotations

import numpy as np
from helpers.two_images import two_images
from numpy.testing import assert_allclose

from skmotionseg._core.partition.two_view_search import (
    MOST_MOTIONS,
    _different,
    search_two_views,
)
from skmotionseg.metrics import misclassification_error


def test_different_sets_are_taken_in_order():
    sets = np.array([[1, 1, 1, 0], [1, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1]], bool)
    assert _different(sets, 4) == [0, 2]
    assert _different(sets, 1) == [0]
    assert _different(sets[1:], 3) == [0, 1]


def test_a_search_knows_the_costs_of_several_numbers():
    X, true = two_images([40, 30, 20], 60)
    x, y = ((X.reshape(-1, 2, 2) - 300) / 100).swapaxes(0, 1)
    rng = np.random.RandomState(0)
    search = search_two_views(x, y, np.arange(1, 11), rng)
    costs = {count: found.cost for count, found in search.best.items()}
    assert min(costs, key=costs.get) == 3
    assert {1, 2, 3, 4} <= set(costs) <= set(range(1, MOST_MOTIONS + 1))
    labels = np.where(search.best[3].labels == 3, -1, search.best[3].labels)
    assert misclassification_error(true, labels) < 0.1
    for count, found in search.best.items():
        assert len(found.motions) == count
        assert_allclose(found.shares.sum(axis=0), 1)
    assert search_two_views(x[:10], y[:10], np.arange(1, 3), rng) is None
