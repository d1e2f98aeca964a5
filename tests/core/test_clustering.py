"""Clusters of a graph, and labels of the tracks that it leaves out."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.testing import assert_array_equal

from skmotionseg import MultiModelSpectralClustering
from skmotionseg._core.graph.clustering import (
    cluster_connected,
    cluster_graph,
    labels_of_all,
)
from skmotionseg._core.graph.fusion import kernel_addition
from skmotionseg._core.graph.spectral import ViewGraph


def groups_and_a_loner():
    """Affinity of groups of five and three tracks, and of one that meets no other."""
    affinity = np.zeros((9, 9))
    affinity[:3, :3] = affinity[4:, 4:] = 1
    return affinity


def graph():
    return ViewGraph.from_affinities(groups_and_a_loner()[None], 2)


def rng():
    return np.random.RandomState(0)


def test_the_largest_group_comes_first_and_loners_have_none():
    labels = cluster_graph(graph(), 2, kernel_addition, 5, rng())
    assert_array_equal(labels, [1, 1, 1, -1, 0, 0, 0, 0, 0])


def test_connected_tracks_are_clustered():
    fused, labels, centres = cluster_connected(graph(), 2, kernel_addition, 5, rng())
    assert fused.embeddings.shape == (1, 8, 2)
    assert centres.shape == (2, 2)
    assert labels.shape == (8,)
    assert len(set(labels[:3])) == len(set(labels[3:])) == 1


def test_labels_of_all_are_canonical():
    found = labels_of_all(graph(), np.array([7, 7, 7, 2, 2, 2, 2, 2]))
    assert_array_equal(found, [1, 1, 1, -1, 0, 0, 0, 0, 0])


def test_the_estimator_clusters_alike():
    estimator = MultiModelSpectralClustering(2, n_init=5, random_state=0)
    fitted = estimator.fit_predict(groups_and_a_loner())
    fuse = partial(kernel_addition, lam=0.1)  # it has no use for weights
    assert_array_equal(cluster_graph(graph(), 2, fuse, 5, rng()), fitted)
