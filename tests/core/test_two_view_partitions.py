"""Partitions of two images: complete labels, their order, and who is placed where."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.two_images import assert_places_and_rejects, two_images
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg._core.geometry.description_length import clip_geometry
from skmotionseg._core.partition.two_view_partitions import (
    TEMPERATURE,
    two_view_partitions,
)
from skmotionseg.metrics import misclassification_error


@pytest.fixture(scope="module")
def found():
    X, y = two_images([40, 30], 30)
    points, seen = X.reshape(-1, 2, 2), np.ones((100, 2), dtype=bool)
    geometry = clip_geometry(points, seen)
    rng = np.random.RandomState(0)
    return points, seen, y, two_view_partitions(geometry, np.arange(1, 4), rng)


def test_labels_are_complete_and_the_largest_comes_first(found):
    _, _, y, partitions = found
    assert partitions.chosen == 2
    assert set(partitions.best) <= {1, 2, 3}
    for count, (cost, labels) in partitions.best.items():
        sizes = np.bincount(labels)
        assert len(sizes) == count and (np.diff(sizes) <= 0).all()
        assert_allclose(cost.cut + cost.length, cost.total)
    labels = np.where(partitions.outliers, -1, partitions.best[2][1])
    assert misclassification_error(y, labels) < 0.05


def test_odds_are_of_costs(found):
    _, _, y, partitions = found
    costs = {count: cost.total for count, (cost, _) in partitions.best.items()}
    expected = len(y) * (costs[1] - costs[2]) / TEMPERATURE
    assert_allclose(partitions.log_odds[2], expected)


def test_tracks_are_placed_and_rejected_by_the_motions_in_their_order(found):
    points, seen, _, partitions = found
    placed = assert_places_and_rejects(partitions, points, seen)
    assert (placed >= 0).all()
    explanation, labels = partitions.explanation, partitions.best[2][1]
    nobody = np.full(len(labels), -1)
    inside = ~partitions.outliers
    half = seen.copy()
    half[:50, 1] = False
    assert (explanation.nearest(points, half, nobody)[:50] == -1).all()
    assert_array_equal(explanation.reject(points, half, labels)[:50], labels[:50])
    distances = explanation.motions.distances(points, seen)
    own = distances[labels[inside], np.flatnonzero(inside)]
    assert (own <= explanation.motions.inlier_thresholds[labels[inside]]).mean() > 0.9


def test_numbers_that_are_not_found_are_left_to_others(found):
    points, seen, _, _ = found
    geometry = clip_geometry(points, seen)
    none = two_view_partitions(geometry, np.array([40]), np.random.RandomState(0))
    assert none is None
