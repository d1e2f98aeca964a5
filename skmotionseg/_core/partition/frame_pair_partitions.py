"""Partitions by a fundamental matrix per frame pair, and by the graph."""

from __future__ import annotations

from itertools import chain
from typing import NamedTuple

import numpy as np

from ..graph.spectral import ViewGraph
from ..labels import canonical_labels
from .agglomeration import merge_path
from .clip import OVERSEGMENTATION
from .cost import Cost
from .local_search import merged, moved, refine, split
from .motions import fit_motions


class FramePairPartitions(NamedTuple):
    """The best partitions by the motions of frame pairs.

    Attributes
    ----------
    best : dict of int to (Cost, ndarray)
        Cost and labels of the best partition for each number of motions.
    chosen : int
    gainless : dict of int to (int, int)
        Two motions that gain too little from being apart, for the numbers that were
        passed over for it.
    """

    best: dict[int, tuple[Cost, np.ndarray]]
    chosen: int
    gainless: dict[int, tuple[int, int]]


def frame_pair_partitions(clip, counts):
    """The best partitions by a fundamental matrix per frame pair, and by the graph.

    A candidate costs the nats per observation that its motions take to describe plus
    its weighted normalised cut. The count of least cost is chosen, of those in which
    all motions gain from being apart, and its partition is refined until the cost falls
    no more.

    Parameters
    ----------
    clip : Clip
    counts : ndarray of int, shape (n_counts,)
        Ascending.

    Returns
    -------
    FramePairPartitions
    """
    best = _best_by_count(clip, counts)
    chosen, gainless = _choose(best, clip.judge)
    if len(counts) > 1 or counts[0] > 1:
        refined = _refine(best[chosen][1], clip, counts)
        if not np.array_equal(refined, best[chosen][1]):
            chosen = int(refined.max()) + 1
            best[chosen] = (clip.judge.cost(refined), refined)
            gainless.pop(chosen, None)  # that was another partition
    return FramePairPartitions(best, chosen, gainless)


def _best_by_count(clip, counts):
    """The partition of lowest cost per number of motions: {count: (cost, labels)}."""
    best: dict[int, tuple[Cost, np.ndarray]] = {}
    candidates = {labels.tobytes(): labels for labels in _candidates(clip, counts)}
    for labels, cost in clip.judge.costs(list(candidates.values())):
        count = int(labels.max()) + 1
        if count not in best or cost.total < best[count][0].total:
            best[count] = (cost, labels)
    # Identical tracks may give fewer groups than were asked for.
    return {int(n): best[n] for n in counts if n in best} or {
        max(best): best[max(best)]
    }


def _candidates(clip, counts):
    """Yield partitions (n,) of all tracks, some of them more than once."""
    n_tracks = len(clip.points)
    yield np.zeros(n_tracks, dtype=int)
    if counts[-1] == 1:
        return
    most = max(int(counts[-1]), min(OVERSEGMENTATION, n_tracks))
    graphs = [
        [ViewGraph.from_affinities(views, most) for views in _model_subsets(stack)]
        for stack in clip.sparse
    ]
    # Sparse enough, a graph joins no two tracks: it has nothing to say.
    graphs = [[graph for graph in some if graph.n_leading > 0] for some in graphs]
    for graph in chain(*graphs):
        for count in counts[(counts > 1) & (counts <= graph.n_leading)]:
            yield clip.clusters(graph, int(count))
    for graph in graphs[-1]:
        yield from merge_path(
            clip.over_segments(graph),
            clip.affinity,
            clip.judge.lengths[0],
            max(2, int(counts[0])),
        )


def _model_subsets(views):
    """All models, and all but the simplest where that leaves two."""
    return [views, views[1:]] if len(views) > 2 else [views]


def _choose(best, judge):
    """The count of the lowest cost of those whose motions gain; else the least.

    Of equal costs, as of groups that are never seen together, the larger count. Also
    returns two motions that gain too little for each count that was passed over.
    """
    if len(best) == 1:
        return min(best), {}
    gainless: dict[int, tuple[int, int]] = {}
    for count in sorted(
        best, key=lambda count: (round(best[count][0].total, 9), -count)
    ):
        pair = judge.gainless_pair(best[count][1])
        if pair is None:
            return count, gainless
        gainless[count] = pair
    return min(best), gainless


def _refine(labels, clip, counts):
    """A partition of no higher cost: tracks moved, motions merged or split.

    Motions that gain from being apart are not merged, whatever the cost.
    """

    def changes(labels):
        motions = fit_motions(clip.geometry, labels, clip.affinity)
        relative = clip.distances(motions) / motions.inlier_thresholds[:, None]
        return chain(
            moved(labels, relative),
            merged(labels) if mergeable(labels) else (),
            split(labels, clip.bisect) if labels.max() + 2 <= counts[-1] else (),
        )

    def mergeable(labels):
        return labels.max() >= counts[0] and not clip.judge.each_gains(labels)

    def gaining(labels):
        free = len(counts) == 1 or not clip.judge.each_gains(labels)
        return (
            canonical_labels(new)
            for new in changes(labels)
            if free or clip.judge.each_gains(new)
        )

    return refine(labels, lambda labels: clip.judge.cost(labels).total, gaining)
