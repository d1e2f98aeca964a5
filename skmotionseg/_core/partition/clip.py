"""A clip to partition: its tracks, their affinities, and clusters of them."""

from __future__ import annotations

import numpy as np

from ..geometry.description_length import clip_geometry
from ..graph.neighbourhood import neighbourhood_thresholds, sparsify
from ..graph.spectral import ViewGraph
from ..labels import canonical_labels, nearest_labels
from .cost import Judge

# Over-segments that are merged again, unless more motions are looked for. Halved, the
# error with the number known doubles on KT3DMoSeg; doubled, Hopkins12 loses two
# numbers of 4.
OVERSEGMENTATION = 8


class Clip:
    """The tracks of a clip, their affinities, and what partitions of them cost.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    views : ndarray of shape (n_views, n_tracks, n_tracks)
        Affinities before sparsification, the simplest model first.
    sparsities : sequence of float or None
        Exponents of the epsilon-neighbourhood; None keeps all affinities.
    cluster : callable
        ``(graph, n_clusters) -> labels``: clusters of a :class:`ViewGraph`, -1 for
        tracks that meet no other.
    stratified : bool, default=False
        Whether the tracks are landmarks, as many from each over-segment of the video.

    Attributes
    ----------
    affinity : ndarray of shape (n_tracks, n_tracks)
        Mean of the views.
    sparse : list of ndarray of shape (n_views, n_tracks, n_tracks)
        The views, by exponent.
    geometry : ClipGeometry
    judge : Judge
    """

    def __init__(
        self, points, visibility, views, sparsities, cluster, stratified=False
    ):
        self.points, self.visibility = points, visibility
        self.views, self.sparsities = views, sparsities
        self.cluster, self.stratified = cluster, stratified
        self.affinity = views.mean(axis=0)
        self.sparse = [sparse_views(views, alpha) for alpha in sparsities]
        self.geometry = clip_geometry(points, visibility)
        self.judge = Judge(self.geometry, self.sparse[-1], stratified)

    def of(self, tracks):
        """The clip of some of its tracks."""
        return Clip(
            self.points[tracks],
            self.visibility[tracks],
            self.views[:, tracks[:, None], tracks],
            self.sparsities,
            self.cluster,
            self.stratified,
        )

    def distances(self, motions):
        """Distances (M, n) of the tracks from motions."""
        return motions.distances(self.points, self.visibility)

    def graphs(self, most):
        """Yield graphs of so many clusters at most, and some, the sparsest first."""
        most = min(most, len(self.points))
        for views in self.sparse[::-1]:
            graph = ViewGraph.from_affinities(views, most)
            if graph.n_leading > 1:
                yield graph

    def clusters(self, graph, count):
        """Labels of all tracks by a graph of them."""
        return cluster_all(graph, count, self.affinity, self.cluster)

    def over_segments(self, graph):
        """A partition by a graph into as many clusters as it has."""
        return self.clusters(graph, graph.n_leading)

    def bisect(self, group):
        """Which tracks of a group are in the smaller of two halves; None if none are.

        The group is positions of tracks, and so is what is returned among them.
        """
        views = self.sparse[-1][:, group[:, None], group]
        graph = ViewGraph.from_affinities(views, 2)
        if graph.n_leading < 2:
            return None
        affinity = self.affinity[np.ix_(group, group)]
        return cluster_all(graph, 2, affinity, self.cluster) == 1


def sparse_views(views, alpha):
    """Views after the epsilon-neighbourhood; as they are if there is no exponent."""
    if alpha is None:
        return views
    sparse = []
    for view in views:
        thresholds = neighbourhood_thresholds(view, alpha, np.diagonal(view))
        sparse.append(sparsify(view, thresholds, thresholds))
    return np.stack(sparse)


def cluster_all(graph, count, affinity, cluster):
    """Labels of all tracks, those the sparse graph leaves alone by their nearest.

    Those that have an affinity to others that are alone only are in the largest group.
    """
    labels = cluster(graph, count)
    alone = labels < 0
    if alone.any():
        labels[alone] = nearest_labels(affinity[alone][:, ~alone], labels[~alone])
    return np.maximum(canonical_labels(labels), 0)
