"""k-means with all restarts in one batch."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.cluster import KMeans
from sklearn.metrics import adjusted_rand_score

from skmotionseg._core.graph.kmeans import _assign, _means, kmeans, nearest_centres


def blobs(n_clusters, seed=0, spread=0.1):
    rng = np.random.default_rng(seed)
    centres = rng.standard_normal((n_clusters, 4))
    labels = rng.integers(n_clusters, size=200)
    return centres[labels] + spread * rng.standard_normal((200, 4)), labels


def run(features, n_clusters, n_init=10, seed=0):
    return kmeans(features, n_clusters, n_init, np.random.RandomState(seed))


def inertia(features, labels, centres):
    return ((features - centres[labels]) ** 2).sum()


@pytest.mark.parametrize("n_clusters", [1, 2, 5, 8])
def test_groups_are_found(n_clusters):
    features, truth = blobs(n_clusters, spread=0.03)
    labels, _ = run(features, n_clusters)
    assert adjusted_rand_score(truth, labels) == 1


@pytest.mark.parametrize("n_clusters", [2, 4, 9])
def test_it_is_as_good_as_that_of_scikit_learn(n_clusters):
    ratios = []
    for seed in range(10):
        features = np.random.default_rng(seed).standard_normal((150, 3))
        theirs = KMeans(n_clusters, n_init=10, random_state=seed).fit(features)
        ours = inertia(features, *run(features, n_clusters, seed=seed))
        ratios.append(ours / theirs.inertia_)
    assert np.mean(ratios) < 1.02


def test_the_result_is_a_fixed_point():
    features, _ = blobs(5, spread=0.5)
    labels, centres = run(features, 5)
    assert_array_equal(nearest_centres(features, centres), labels)
    for k in range(5):
        assert_allclose(centres[k], features[labels == k].mean(axis=0))


def test_more_restarts_are_never_worse():
    features = np.random.default_rng(0).standard_normal((100, 2))
    few, many = (inertia(features, *run(features, 8, n)) for n in (1, 30))
    assert many <= few


def test_the_same_seed_gives_the_same_labels():
    features, _ = blobs(4, spread=0.6)
    assert_array_equal(run(features, 4)[0], run(features, 4)[0])


def test_as_many_clusters_as_rows():
    features = np.arange(6.0)[:, None]
    labels, _ = run(features, 6)
    assert sorted(labels) == list(range(6))


@pytest.mark.parametrize("n_clusters", [2, 3, 5])
def test_fewer_distinct_rows_than_clusters(n_clusters):
    features = np.repeat([[0.0, 1.0], [2.0, 0.0]], 3, axis=0)
    labels, centres = run(features, n_clusters)
    assert set(labels[:3]).isdisjoint(labels[3:])
    assert np.isfinite(centres).all()


@pytest.mark.parametrize("seed", range(130, 230))
def test_equal_rows_have_the_same_label(seed):
    """Also where there are more clusters than rows that differ."""
    rng = np.random.default_rng(seed)
    n_different, n_columns = rng.integers(1, 8), rng.integers(1, 30)
    n = rng.integers(n_different + 1, 200)
    which = rng.integers(n_different, size=n)
    features = rng.standard_normal((n_different, n_columns))[which]
    labels, _ = run(features, min(n, n_different + 5), n_init=3, seed=seed)
    assert len(set(zip(which, labels, strict=True))) == len(set(which))


def test_features_are_left_alone():
    features, _ = blobs(3)
    before = features.copy()
    run(features, 3)
    assert_array_equal(features, before)


def test_empty_clusters_take_the_farthest_rows():
    rng = np.random.default_rng(0)
    features, distance = rng.normal(size=(9, 2)), rng.uniform(size=(3, 9))
    labels = np.array([np.arange(9) % 4, np.arange(9) % 3, 2 * (np.arange(9) % 2)])
    centres = _means(features, labels, distance, 4)
    for run in range(3):
        members = [set(np.flatnonzero(labels[run] == k)) for k in range(4)]
        farthest = iter(np.argsort(-distance[run]))
        for k in range(4):
            if not (labels[run] == k).any():
                row = next(farthest)
                members = [each - {row} for each in members]
                members[k] = {row}
        expected = [features[sorted(each)].mean(axis=0) for each in members]
        assert_allclose(centres[run], expected)


def test_a_cluster_that_runs_empty_is_filled_again():
    """Two starts in one spot: one of them gets no row."""
    features = np.array([[0.0], [0.1], [5.0], [5.2], [9.0]])
    labels, distance = _assign(
        features, features[:, 0] ** 2, np.array([[[0.0], [0.0], [5.0]]])
    )
    assert set(labels[0]) == {0, 2}
    centres = _means(features, labels, distance, 3)
    assert_allclose(centres[0], [[0.05], [9.0], [5.1]])
