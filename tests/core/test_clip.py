"""The tracks of a clip, their affinities, and clusters of them."""

from __future__ import annotations

import numpy as np
from helpers.affinities import linked
from numpy.testing import assert_array_equal

from skmotionseg._core.geometry.tracks import unpack_tracks
from skmotionseg._core.partition.clip import Clip, cluster_all, sparse_views
from skmotionseg.datasets import make_rigid_motions


def scene(cluster=None):
    X, y = make_rigid_motions(60, 6, 2, random_state=0)
    views = np.stack([linked(y), linked(y, 0.6, 0.1)])
    return Clip(*unpack_tracks(X), views, (2.0, None), cluster, stratified=True), y


def test_a_part_of_a_clip_has_the_affinities_of_its_tracks():
    clip, _ = scene()
    kept = np.array([3, 5, 8, 13, 21, 34])
    part = clip.of(kept)
    assert_array_equal(part.affinity, clip.affinity[np.ix_(kept, kept)])
    assert_array_equal(part.points, clip.points[kept])
    assert (part.sparsities, part.cluster) == (clip.sparsities, clip.cluster)
    assert part.stratified


def test_the_sparsest_graph_comes_first_and_has_as_many_clusters_as_asked_for():
    clip, y = scene(lambda graph, count: y % count)
    graphs = list(clip.graphs(4))
    assert len(graphs) == 2
    assert all(1 < graph.n_leading <= 4 for graph in graphs)
    for graph in graphs:
        assert clip.over_segments(graph).shape == y.shape


def test_halves_of_a_group_are_by_the_graph_of_its_tracks():
    clip, y = scene(lambda graph, count: y[group])
    group = np.arange(10, 50)
    smaller = np.bincount(y[group]).argmin()
    assert_array_equal(clip.bisect(group), y[group] == smaller)
    clip.sparse[-1] = np.tile(np.eye(60), (2, 1, 1))  # nothing is linked
    assert clip.bisect(group) is None


def test_tracks_that_a_graph_leaves_alone_have_the_label_of_their_nearest():
    affinity = np.full((7, 7), 0.1)
    affinity[5, 2:4] = affinity[6, :2] = 1  # the last two
    first = np.array([1, 1, 0, 0, 0, -1, -1])
    labels = cluster_all(None, 2, affinity, lambda graph, count: first.copy())
    assert_array_equal(labels, [1, 1, 0, 0, 0, 0, 1])
    # What is near to nothing that has a label is in the largest group.
    affinity[5:, :5] = 0
    labels = cluster_all(None, 2, affinity, lambda graph, count: first.copy())
    assert_array_equal(labels, [1, 1, 0, 0, 0, 0, 0])


def test_without_sparsity_all_affinities_are_kept():
    views = np.random.default_rng(0).uniform(size=(2, 9, 9))
    assert sparse_views(views, None) is views
    assert (sparse_views(views, 4.0) == 0).any()
