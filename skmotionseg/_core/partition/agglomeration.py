"""From too many groups of tracks to fewer, by geometry and affinity."""

from __future__ import annotations

import numpy as np

from ..labels import groups_of, indicator


def merge_path(labels, affinity, lengths, n_last):
    """Merge two groups at a time; yield the partition before each merge and at the end.

    The pair is merged for which the nats that the common model costs, an observation of
    the smaller group, less the log of how linked the two are, is least.
    An observation of the smaller group, because a small motion that is swallowed by a
    large one costs little in all. The link is the mean affinity between the groups,
    relative to that within them.

    Parameters
    ----------
    labels : ndarray of int, shape (n,)
        ``0..M - 1``, none empty; those of -1 are in no group and stay so.
    affinity : ndarray of shape (n, n)
    lengths : GroupLengths
    n_last : int
        Groups at which to stop.

    Yields
    ------
    ndarray of int, shape (n,)
    """
    groups = groups_of(labels)
    X = indicator(labels)
    sums = X.T @ affinity @ X  # affinity between groups
    while True:
        yield _labels_of(groups, len(labels))
        if len(groups) <= n_last:
            return
        i, j = _cheapest_merge(groups, sums, lengths)
        union = np.union1d(groups[i], groups[j])
        keep = [k for k in range(len(groups)) if k not in (i, j)]
        merge = np.zeros((len(keep) + 1, len(groups)))
        merge[np.arange(len(keep)), keep] = 1
        merge[-1, [i, j]] = 1
        sums = merge @ sums @ merge.T
        groups = [groups[k] for k in keep] + [union]


def _cheapest_merge(groups, sums, lengths):
    """The two groups that cost least to merge, of those that are tried.

    A common model hardly ever explains tracks better than their own does, so a merge
    costs no less than its link tells: pairs are tried from the most linked on, until
    the link alone costs more than the best so far. Groups too small for a model gain
    one by a merge, and may be passed over so; trying all pairs takes a third more time
    and changes no result on the benchmarks by more than a tenth of a point.
    """
    links = sorted(
        (-np.log(_link(sums, i, j)), i, j) for i in range(len(groups)) for j in range(i)
    )
    least, cheapest = np.inf, None
    for link, i, j in links:
        if link >= least:
            break
        cost = _merge_cost(groups[i], groups[j], lengths) + link
        if cost < least:
            least, cheapest = cost, (i, j)
    return cheapest


def _merge_cost(first, second, lengths):
    """Nats an observation of the smaller group that its tracks lose by a merge."""
    together = lengths(np.union1d(first, second)).tracks.sum()
    rise = together - lengths(first).tracks.sum() - lengths(second).tracks.sum()
    seen = lengths.geometry.seen
    return rise / max(1, min(seen[:, first].sum(), seen[:, second].sum()))


def _link(sums, i, j):
    """Mean affinity between two groups, relative to that within them."""
    within = np.sqrt(sums[i, i] * sums[j, j])
    # Groups that never meet are not impossible to merge, only the last choice.
    return max(sums[i, j] / within if within > 0 else 0.0, 1e-3)


def _labels_of(groups, n):
    labels = np.full(n, -1)
    for label, group in enumerate(groups):
        labels[group] = label
    return labels
