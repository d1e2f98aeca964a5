"""Choose among many partitions of the tracks by description length and graph cut."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np

from ._core.geometry import clip_geometry
from ._core.judging import Judge
from ._core.merging import merge_path
from ._core.neighbourhood import neighbourhood_thresholds, sparsify
from ._core.selection import canonical_labels, nearest_labels
from ._core.spectral import ViewGraph, connected_tracks

# Exponents of the epsilon-neighbourhood: candidates come from all, and the last is the
# graph on which partitions are cut and over-segmented.
SPARSITIES = (4.0, 8.0)
# Groups that are merged again, unless more motions are looked for.
OVERSEGMENTATION = 8


@dataclass(frozen=True)
class PartitionSearch:
    """The best partition for each number of motions, and the best of all.

    Attributes
    ----------
    counts : ndarray of int, shape (n_counts,)
    costs : ndarray of shape (n_counts, 3)
        Normalised cut (summed over the views), the other cost (description length in
        nats an observation, or reconstruction error) and total.
    labels : ndarray of int, shape (n_counts, n)
        -1 for tracks without affinity to another.
    best : int
        Position of the count that was chosen.
    """

    counts: np.ndarray
    costs: np.ndarray
    labels: np.ndarray
    best: int


def search_partitions(points, visibility, views, counts, sparsity, clusterer):
    """Find the best partition for each of several numbers of motions.

    Candidates are spectral clusterings for several sparsities, with and without the
    simplest motion model, and what is left when an over-segmentation is merged step by
    step. A candidate costs the nats an observation that its motions take to describe,
    each by a fundamental matrix a frame pair, plus its weighted normalised cut. The
    count of least cost is chosen, of those in which all motions gain from being apart.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    views : ndarray of shape (n_views, n_tracks, n_tracks)
        Affinities before sparsification, the simplest model first.
    counts : ndarray of int, shape (n_counts,)
        Ascending; none above the tracks with an affinity to another.
    sparsity : float or "auto"
        Exponent of the epsilon-neighbourhood; "auto" tries several.
    clusterer : MultiModelSpectralClustering
        Gives fusion, weights and seed; its ``n_clusters`` is ignored.

    Returns
    -------
    PartitionSearch
    """
    connected = connected_tracks(views)
    views = views[:, connected[:, None], connected]
    sparsities = SPARSITIES if sparsity == "auto" else (sparsity,)
    most = max(int(counts[-1]), min(OVERSEGMENTATION, len(connected)))
    sparse = [_sparse_views(views, alpha) for alpha in sparsities]
    geometry = clip_geometry(points[connected], visibility[connected])
    judge = Judge(geometry, sparse[-1])
    mean_affinity = views.mean(axis=0)
    best, tried = {}, set()
    for labels in _candidates(sparse, mean_affinity, counts, most, judge, clusterer):
        if labels.tobytes() in tried:
            continue
        tried.add(labels.tobytes())
        count = labels.max() + 1
        cost = judge.cost(labels)
        if count not in best or cost.total < best[count][0].total:
            best[count] = (cost, labels)
    # Identical tracks may give fewer groups than were asked for.
    found = np.array([count for count in counts if count in best] or [max(best)])
    costs = np.array([best[count][0] for count in found])
    partitions = [best[count][1] for count in found]
    everything = np.full((len(found), len(points)), -1)
    everything[:, connected] = [canonical_labels(labels) for labels in partitions]
    return PartitionSearch(found, costs, everything, _choose(costs, partitions, judge))


def _choose(costs, partitions, judge):
    """Position of the cheapest partition whose motions gain; else the first.

    Of equal costs, as of groups that are never seen together, the larger count.
    """
    if len(costs) == 1:
        return 0
    order = np.lexsort((-np.arange(len(costs)), np.round(costs[:, 2], 9)))
    for position in order:
        if judge.each_gains(partitions[position]):
            return int(position)
    return 0


def _sparse_views(views, alpha):
    sparse = []
    for view in views:
        thresholds = neighbourhood_thresholds(view, alpha, np.diagonal(view))
        sparse.append(sparsify(view, thresholds, thresholds))
    return np.stack(sparse)


def _candidates(sparse, affinity, counts, most, judge, clusterer):
    """Yield partitions (n,) of all tracks, some of them more than once."""
    yield np.zeros(len(affinity), dtype=int)
    if counts[-1] == 1:
        return
    graphs = [
        [ViewGraph.from_affinities(views, most) for views in _model_subsets(stack)]
        for stack in sparse
    ]
    # Sparse enough, a graph joins no two tracks: it has nothing to say.
    graphs = [[graph for graph in some if graph.n_leading > 0] for some in graphs]
    for graph in chain(*graphs):
        for count in counts[(counts > 1) & (counts <= graph.n_leading)]:
            yield _cluster(graph, int(count), affinity, clusterer)
    for graph in graphs[-1]:
        oversegmented = _cluster(graph, graph.n_leading, affinity, clusterer)
        yield from merge_path(
            oversegmented, affinity, judge.lengths[0], max(2, int(counts[0]))
        )


def _model_subsets(views):
    """All models, and all but the simplest where that leaves two."""
    return [views, views[1:]] if len(views) > 2 else [views]


def _cluster(graph, count, affinity, clusterer):
    """Labels of all tracks, those the sparse graph leaves alone by their nearest."""
    clusterer.set_params(n_clusters=count)
    labels = clusterer.cluster_graph(graph)
    alone = labels < 0
    if alone.any():
        labels[alone] = nearest_labels(affinity[alone][:, ~alone], labels[~alone])
    return canonical_labels(labels)
