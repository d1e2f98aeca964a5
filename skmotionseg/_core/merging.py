"""From too many groups of tracks to fewer, by geometry and affinity."""

from __future__ import annotations

import numpy as np

from .geometry import description_length
from .selection import indicator


class GroupLengths:
    """Description lengths of groups of tracks, each computed once.

    Parameters
    ----------
    geometry : ClipGeometry
    """

    def __init__(self, geometry):
        self.geometry = geometry
        self._known = {}

    def __call__(self, members):
        """Nats to describe a group, given as sorted positions: tracks and models."""
        key = members.tobytes()
        if key not in self._known:
            self._known[key] = description_length(self.geometry, members)
        return self._known[key]

    def of_partition(self, labels):
        """Nats an observation to describe all groups of a partition."""
        total = sum(sum(self(group)) for group in groups_of(labels))
        return total / self.geometry.n_observations


def groups_of(labels):
    """Positions of the members of each group, by label."""
    return [np.flatnonzero(labels == label) for label in range(labels.max() + 1)]


def each_gains(labels, lengths, least):
    """Whether each of two motions gains from not being the other.

    Two that are never seen in the same frame pair have nothing to gain or lose by a
    common model; nothing says that they are one, so they may stay apart.

    Parameters
    ----------
    labels : ndarray of int, shape (n,)
    lengths : GroupLengths
    least : float
        Nats an observation of the smaller motion that the two must save, against a
        common model, for every pair of motions.

    Returns
    -------
    bool
    """
    groups = groups_of(labels)
    seen = lengths.geometry.seen
    pairs = [seen[:, group].any(axis=1) for group in groups]
    return all(
        not (pairs[i] & pairs[j]).any()
        or _merge_cost(groups[i], groups[j], lengths) >= least
        for i in range(len(groups))
        for j in range(i)
    )


def merge_path(labels, affinity, lengths, n_last):
    """Merge two groups at a time; yield the partition before each merge and at the end.

    Of all pairs, the one is merged for which the nats that the common model costs, an
    observation of the smaller group, less the log of how linked the two are, is least.
    An observation of the smaller group, because a small motion that is swallowed by a
    large one costs little in all. The link is the mean affinity between the groups,
    relative to that within them.

    Parameters
    ----------
    labels : ndarray of int, shape (n,)
        ``0..M - 1``, none empty.
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
    """The two groups that cost least to merge.

    A common model explains no track better than its own does, so a merge costs no less
    than its link tells: pairs are tried from the most linked on, until none can win.
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
    together, _ = lengths(np.union1d(first, second))
    rise = together - lengths(first)[0] - lengths(second)[0]
    seen = lengths.geometry.seen
    return rise / max(1, min(seen[:, first].sum(), seen[:, second].sum()))


def _link(sums, i, j):
    """Mean affinity between two groups, relative to that within them."""
    within = np.sqrt(sums[i, i] * sums[j, j])
    # Groups that never meet are not impossible to merge, only the last choice.
    return max(sums[i, j] / within if within > 0 else 0.0, 1e-3)


def _labels_of(groups, n):
    labels = np.empty(n, dtype=int)
    for label, group in enumerate(groups):
        labels[group] = label
    return labels
