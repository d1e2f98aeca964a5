"""Partitions by rigid motion: assignment, what is apart, and the search."""

from __future__ import annotations

import numpy as np
import pytest

from skmotionseg import unpack_tracks
from skmotionseg._core.geometry.windows import Windows
from skmotionseg._core.labels import canonical_labels
from skmotionseg._core.partition.rigid_search import RigidSearch, rigid_partition
from skmotionseg.datasets import make_rigid_motions
from skmotionseg.metrics import misclassification_error


@pytest.fixture(scope="module")
def scene():
    """Tracks, true labels, and a graph of neighbours in place and displacement."""
    X, y = make_rigid_motions(n_tracks=160, n_frames=12, random_state=1)
    points, visibility = unpack_tracks(X)
    place = np.nanmean(points, axis=1)
    moved = 20 * np.nanmean(np.diff(points, axis=1), axis=1)
    features = np.column_stack([place, np.nan_to_num(moved)])
    distance = np.linalg.norm(features[:, None] - features, axis=2)
    affinity = np.exp(-((distance / np.partition(distance, 8, axis=1)[:, 8:9]) ** 2))
    affinity[affinity < 0.1] = 0
    return points, visibility, affinity + affinity.T, canonical_labels(y)


def search_of(scene):
    points, visibility, affinity, _ = scene
    return RigidSearch(Windows(points, visibility), affinity)


def test_the_truth_costs_less_than_the_truth_disturbed(scene):
    y, search = scene[-1], search_of(scene)
    search.calibrate(y)
    motions = search.motions(y)
    truth = search.energy(y, motions)
    rng = np.random.RandomState(0)
    for share in (0.05, 0.2):
        wrong = y.copy()
        some = rng.random(len(y)) < share
        wrong[some] = rng.randint(y.max() + 1, size=some.sum())
        assert search.energy(wrong, motions) > truth


def test_settling_mends_labels_and_never_costs_more(scene):
    y, search = scene[-1], search_of(scene)
    search.calibrate(y)
    rng = np.random.RandomState(1)
    wrong = y.copy()
    some = rng.random(len(y)) < 0.1
    wrong[some] = rng.randint(y.max() + 1, size=some.sum())
    before = search.energy(wrong, search.motions(wrong))
    energy, labels, motions = search.settled(wrong)
    assert energy <= before
    assert energy == pytest.approx(search.energy(labels, motions))
    assert misclassification_error(y, labels) < 0.03


def test_halves_of_a_motion_are_one_and_motions_are_apart(scene):
    points, y, search = scene[0], scene[-1], search_of(scene)
    search.calibrate(y)
    background = np.flatnonzero(y == 0)
    x = np.nanmean(points[background], axis=1)[:, 0]
    torn = y.copy()
    torn[background[x > np.median(x)]] = y.max() + 1
    pair, least = search.least_apart(torn, search.motions(torn), 0.0)
    assert set(pair) == {0, y.max() + 1}
    assert least.log_odds < 0
    _, whole = search.least_apart(y, search.motions(y), 0.0)
    assert whole.log_odds > 2


def test_motions_are_found_that_a_partition_lacks(scene):
    points, y = scene[0], scene[-1]
    side = np.nanmean(points, axis=1)[:, 0]
    pieces = canonical_labels(2 * y + (side > np.median(side)))
    labels = rigid_partition(
        search_of(scene),
        np.zeros_like(y),
        [pieces],
        np.arange(1, 9),
        lambda n_motions: [],
        lambda group: None,
    )
    assert labels.max() == y.max()
    assert misclassification_error(y, labels) < 0.03


def test_the_number_that_is_asked_for_is_kept(scene):
    points, y = scene[0], scene[-1]
    side = np.nanmean(points, axis=1)[:, 0]
    pieces = canonical_labels(2 * y + (side > np.median(side)))
    for count in (2, y.max() + 1):
        labels = rigid_partition(
            search_of(scene),
            pieces,
            [pieces],
            np.array([count]),
            lambda n_motions: [],
            lambda group: None,
        )
        assert labels.max() + 1 == count
