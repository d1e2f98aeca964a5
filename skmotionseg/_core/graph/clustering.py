"""Clusters of a graph: the views are fused, and k-means parts the embedding."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..labels import canonical_labels
from .fusion import Fusion
from .kmeans import kmeans
from .spectral import cluster_features


class Clustering(NamedTuple):
    """Clusters of the tracks that meet another, and what they were found by."""

    fused: Fusion
    labels: np.ndarray  # (n,), of the connected tracks
    centres: np.ndarray  # (n_clusters, n_views * n_clusters)


def cluster_connected(graph, n_clusters, fuse, n_init, random_state):
    """Cluster the tracks of a graph that meet another.

    Parameters
    ----------
    graph : ViewGraph
    n_clusters : int
    fuse : callable
        ``(graph, n_clusters) -> Fusion``.
    n_init : int
        Number of initialisations of k-means.
    random_state : numpy.random.RandomState

    Returns
    -------
    Clustering
    """
    fused = fuse(graph, n_clusters)
    features = cluster_features(fused.embeddings)
    return Clustering(fused, *kmeans(features, n_clusters, n_init, random_state))


def labels_of_all(graph, labels):
    """Labels of all tracks in canonical order, given those of the connected ones.

    Parameters
    ----------
    graph : ViewGraph
    labels : ndarray of int, shape (n,)

    Returns
    -------
    ndarray of int, shape (n_samples,)
        -1 for tracks that meet no other.
    """
    everything = np.full(graph.n_samples, -1)
    everything[graph.connected] = labels
    return canonical_labels(everything)


def cluster_graph(graph, n_clusters, fuse, n_init, random_state):
    """Labels of all tracks of a graph.

    Parameters
    ----------
    graph, n_clusters, fuse, n_init, random_state
        As for :func:`cluster_connected`.

    Returns
    -------
    ndarray of int, shape (n_samples,)
        In canonical order; -1 for tracks that meet no other.
    """
    found = cluster_connected(graph, n_clusters, fuse, n_init, random_state)
    return labels_of_all(graph, found.labels)
