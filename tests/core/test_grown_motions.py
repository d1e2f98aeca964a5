"""Motions grown from neighbours, and the partitions of few tracks by them."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from skmotionseg import MotionSegmenter
from skmotionseg._core.geometry.windows import FEWEST_TRACKS, Windows
from skmotionseg._core.partition.grown_motions import GrownMotions, _cheapest_sets
from skmotionseg._core.partition.rigid_search import RigidSearch
from skmotionseg.metrics import misclassification_error


def two_blobs(n_each, n_frames=30, seed=0):
    """Points (2 * n_each, n_frames, 2) of two things that move apart, and labels."""
    rng = np.random.default_rng(seed)
    corners = ((50, 50), (250, 250)), ((350, 200), (600, 400))
    velocities = np.array([(3, 1), (-2, 4)], dtype=float)
    steps = np.arange(n_frames)[:, None]
    points = np.concatenate(
        [
            rng.uniform(*corner, (n_each, 2))[:, None] + steps * velocity
            for corner, velocity in zip(corners, velocities, strict=True)
        ]
    )
    return points + rng.normal(0, 0.1, points.shape), np.repeat([0, 1], n_each)


def searched(points, labels):
    """A search of tracks that are all seen, and their affinities by displacement."""
    moved = points[:, -1] - points[:, 0]
    apart = np.linalg.norm(moved[:, None] - moved, axis=2)
    affinity = np.exp(-apart / 100)
    search = RigidSearch(Windows(points, np.ones(points.shape[:2], bool)), affinity)
    search.calibrate(labels)
    return search, affinity


def test_two_motions_of_few_tracks_are_among_the_partitions():
    points, y = two_blobs(8)
    search, affinity = searched(points, y)
    partitions = GrownMotions(search, affinity).partitions(2)
    errors = [misclassification_error(y, labels) for labels in partitions]
    assert min(errors) == 0


@pytest.mark.parametrize("n_motions", [2, 3])
def test_partitions_differ_and_have_enough_tracks_per_motion(n_motions):
    points, y = two_blobs(12)
    found = GrownMotions(*searched(points, y)).partitions(n_motions)
    assert len({labels.tobytes() for labels in found}) == len(found) > 0
    for labels in found:
        sizes = np.bincount(labels)
        assert len(sizes) == n_motions
        assert sizes.min() >= FEWEST_TRACKS


@pytest.mark.parametrize("seed", range(5))
def test_no_pair_of_motions_costs_less_than_the_one_that_is_found(seed):
    costs = np.random.default_rng(seed).exponential(size=(20, 8))

    def cost(chosen):
        return costs[:, [*chosen]].min(axis=1).sum()

    best = min(combinations(range(8), 2), key=cost)
    assert_array_equal(sorted(_cheapest_sets(costs, 2)[0]), best)


@pytest.mark.parametrize("seed", range(3))
def test_few_tracks_of_two_motions_are_parted(seed):
    points, y = two_blobs(12, seed=seed)
    X = points.reshape(len(points), -1)
    segmenter = MotionSegmenter(random_state=0).fit(X)
    assert segmenter.n_motions_ == 2
    assert misclassification_error(y, segmenter.labels_) < 0.1


@pytest.mark.parametrize("seed", range(3))
def test_few_tracks_of_one_motion_are_not(seed):
    points, y = two_blobs(24, n_frames=10, seed=seed)
    X = points[y == 0].reshape((y == 0).sum(), -1)
    assert MotionSegmenter(random_state=0).fit(X).n_motions_ == 1
