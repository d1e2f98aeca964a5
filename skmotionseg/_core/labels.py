"""Labels: their canonical order, groups, what became of them, votes of neighbours."""

from __future__ import annotations

import numpy as np

# Nearest rows that are looked for beyond those that vote, as some have no vote.
SPARE_VOTERS = 19


def canonical_labels(labels):
    """Number the labels 0, 1, ... from the largest group down; negative ones stay -1.

    Groups of one size are numbered in the order in which they first appear.

    Parameters
    ----------
    labels : ndarray of int, shape (n,)

    Returns
    -------
    ndarray of int, shape (n,)
    """
    labels = np.asarray(labels)
    inside = labels >= 0
    _, first, inverse, counts = np.unique(
        labels[inside], return_index=True, return_inverse=True, return_counts=True
    )
    rank = np.empty(len(counts), dtype=int)
    rank[np.lexsort((first, -counts))] = np.arange(len(counts))
    canonical = np.full(len(labels), -1)
    canonical[inside] = rank[inverse]
    return canonical


def follow_pairs(pairs, before, after):
    """Labels of two groups of each partition in partitions that came of them.

    Parameters
    ----------
    pairs : ndarray of int, shape (n_partitions, 2), or None
        Labels in ``before``; -1 stays. None is -1 throughout.
    before, after : ndarray of int, shape (n_partitions, n)
        Groups may have been renumbered, and have lost or won tracks.

    Returns
    -------
    ndarray of int, shape (n_partitions, 2)
        What most tracks of each group are labelled after.
    """
    followed = np.full((len(before), 2), -1)
    if pairs is None:
        return followed
    for row, side in np.argwhere(pairs >= 0):
        group = after[row][before[row] == pairs[row, side]]
        followed[row, side] = np.bincount(group + 1).argmax() - 1
    return np.sort(followed, axis=1)


def nearest_labels(affinity, labels, n_nearest=5):
    """Labels of new rows by a k-nearest-neighbour vote, weighted by affinity.

    On the benchmarks, half of the tracks placed so among the other half, correctly
    labelled, are wrong in 0.5 %; with 3 or 10 neighbours that is the same, with 20 it
    is worse, as small motions have no more.

    Parameters
    ----------
    affinity : ndarray of shape (m, n)
        Of new rows to fitted rows.
    labels : ndarray of int, shape (n,)
        Of the fitted rows; those labelled -1 have no vote.
    n_nearest : int
        More, where there are ties.

    Returns
    -------
    ndarray of int, shape (m,)
        -1 for a row without affinity to any fitted row that has a vote.
    """
    return nearest_votes(affinity, labels, n_nearest)[0]


def nearest_votes(affinity, labels, n_nearest=5):
    """As :func:`nearest_labels`, with the share of the votes that each label has.

    Parameters
    ----------
    affinity, labels, n_nearest
        As for :func:`nearest_labels`.

    Returns
    -------
    labels : ndarray of int, shape (m,)
    shares : ndarray of shape (m,)
        0 where the label is -1.
    """
    if labels.max(initial=-1) < 0:
        return np.full(len(affinity), -1), np.zeros(len(affinity))
    affinity = np.where(labels >= 0, affinity, 0).astype(float)  # sums are exact
    n_nearest = min(n_nearest, affinity.shape[1])
    last = np.partition(affinity, -n_nearest, axis=1)[:, -n_nearest, None]
    return _winners(np.where(affinity >= last, affinity, 0) @ indicator(labels))


def nearest_votes_in_each(affinity, partitions, n_nearest=5):
    """:func:`nearest_votes` for several partitions of the same rows.

    The nearest of each row are looked for once, with some to spare for those that have
    no vote in one partition or another; rows for which these do not suffice, or which
    have ties beyond them, are left to :func:`nearest_votes`.

    Parameters
    ----------
    affinity : ndarray of shape (m, n)
        Of new rows to fitted rows.
    partitions : ndarray of int, shape (n_partitions, n)
        Labels of the fitted rows.
    n_nearest : int

    Returns
    -------
    labels : ndarray of int, shape (n_partitions, m)
    shares : ndarray of shape (n_partitions, m)
    """
    n_spared = n_nearest + SPARE_VOTERS
    if len(partitions) == 1 or n_spared >= affinity.shape[1]:
        votes = [nearest_votes(affinity, labels, n_nearest) for labels in partitions]
        return tuple(map(np.stack, zip(*votes, strict=True)))
    found = np.empty((len(partitions), len(affinity)), dtype=int)
    shares, nearest = np.empty(found.shape), _nearest(affinity, n_spared)
    for k, labels in enumerate(partitions):
        found[k], shares[k], few = _votes_of(nearest, labels, n_nearest)
        if few.any():
            found[k, few], shares[k, few] = nearest_votes(
                affinity[few], labels, n_nearest
            )
    return found, shares


def _nearest(affinity, n_nearest):
    """Positions and affinities (m, n_nearest) of the nearest rows, nearest first."""
    nearest = np.argpartition(affinity, -n_nearest, axis=1)[:, -n_nearest:]
    nearest.sort(axis=1)  # whatever the order that they were found in
    values = np.take_along_axis(affinity, nearest, 1).astype(float)
    order = np.argsort(-values, axis=1, kind="stable")
    return np.take_along_axis(nearest, order, 1), np.take_along_axis(values, order, 1)


def _votes_of(nearest, labels, n_nearest):
    """Labels and shares (m,) by the votes of the nearest, and whether they are few."""
    positions, affinity = nearest
    labels_near = labels[positions]
    voters = labels_near >= 0
    n_voters = voters.cumsum(axis=1)
    rows = np.arange(len(positions))
    last = affinity[rows, (n_voters >= n_nearest).argmax(axis=1)]
    few = (n_voters[:, -1] < n_nearest) | (last <= affinity[:, -1])
    chosen = voters & (affinity >= last[:, None])
    n_labels = max(labels.max(), 0) + 1
    votes = np.bincount(
        (rows[:, None] * n_labels + labels_near)[chosen],
        affinity[chosen],
        minlength=len(rows) * n_labels,
    ).reshape(-1, n_labels)
    return *_winners(votes), few


def _winners(votes):
    """Labels with the most votes, -1 where there are none, and their shares."""
    most = votes.max(axis=1)
    shares = most / np.where(most > 0, votes.sum(axis=1), 1)
    return np.where(most > 0, votes.argmax(axis=1), -1), shares


def groups_of(labels):
    """Positions of the members of each group, by label.

    Parameters
    ----------
    labels : ndarray of int, shape (n,)
        ``0..M - 1``, none empty.

    Returns
    -------
    list of ndarray of int
    """
    return [np.flatnonzero(labels == label) for label in range(labels.max() + 1)]


def indicator(labels):
    """The assignment matrix X, (n, M); rows of negative labels are zero."""
    return (labels[:, None] == np.arange(labels.max(initial=-1) + 1)).astype(float)
