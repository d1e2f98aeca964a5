"""k-means with all restarts in one batch.

The features are few rows of few columns, clustered many times over: there the calls
cost more than the arithmetic, and one product serves all restarts.
"""

from __future__ import annotations

import numpy as np

MAX_ITERATIONS = 100


def kmeans(features, n_clusters, n_init, random_state):
    """Lloyd's algorithm from several starts; the one of least inertia.

    Starts are drawn by greedy k-means++ (Arthur and Vassilvitskii 2007).

    Parameters
    ----------
    features : ndarray of shape (n, d), float64
    n_clusters : int
        At most ``n``.
    n_init : int
    random_state : numpy.random.RandomState

    Returns
    -------
    labels : ndarray of int, shape (n,)
        ``0..n_clusters - 1``; fewer where fewer rows differ. Equal rows have the same.
    centres : ndarray of shape (n_clusters, d)
    """
    squares = (features**2).sum(axis=1)
    centres = features[_starts(features, squares, n_clusters, n_init, random_state)]
    labels = np.full((n_init, len(features)), -1)
    moving = np.arange(n_init)
    for _ in range(MAX_ITERATIONS):
        nearest, distance = _assign(features, squares, centres[moving])
        changed = (nearest != labels[moving]).any(axis=1)
        labels[moving] = nearest
        moving = moving[changed]
        if len(moving) == 0:
            break
        centres[moving] = _means(
            features, labels[moving], distance[changed], n_clusters
        )
    labels, distance = _assign(features, squares, centres)
    best = distance.sum(axis=1).argmin()
    return labels[best][_first_equal_row(features)], centres[best]


def nearest_centres(features, centres):
    """Position of the centre (n_clusters, d) that is nearest to each row (n, d)."""
    return _assign(features, (features**2).sum(axis=1), centres[None])[0][0]


def _first_equal_row(features):
    """Position (n,) of the first row that is equal to each.

    A product may round equal rows differently, which tells where two centres are one.
    """
    first: dict[bytes, int] = {}
    return np.array([first.setdefault(x.tobytes(), i) for i, x in enumerate(features)])


def _assign(features, squares, centres):
    """Nearest centre of each row and squared distance to it: (n_init, n) each."""
    n_init, n_clusters, d = centres.shape
    distance = features @ (-2 * centres.reshape(-1, d).T)
    distance += (centres**2).sum(axis=2).ravel()
    distance = distance.reshape(-1, n_init, n_clusters)
    nearest = distance.argmin(axis=2)
    least = np.take_along_axis(distance, nearest[..., None], axis=2)[..., 0]
    return nearest.T, np.maximum(least + squares[:, None], 0).T


def _means(features, labels, distance, n_clusters):
    """Centres (n_init, n_clusters, d); an empty cluster takes the farthest row."""
    member = (labels[:, None, :] == np.arange(n_clusters)[:, None]).astype(float)
    sizes = member.sum(axis=2)
    for run in np.flatnonzero((sizes == 0).any(axis=1)):
        empty = np.flatnonzero(sizes[run] == 0)
        farthest = np.argsort(-distance[run], kind="stable")[: len(empty)]
        member[run][:, farthest] = 0
        member[run, empty, farthest] = 1
        sizes[run] = member[run].sum(axis=1)
    sums = member.reshape(-1, len(features)) @ features
    means = sums.reshape(*sizes.shape, -1) / np.maximum(sizes, 1)[..., None]
    return means


def _starts(features, squares, n_clusters, n_init, random_state):
    """Positions of the rows that start, (n_init, n_clusters)."""
    n = len(features)
    n_trials = 2 + int(np.log(n_clusters))
    between = squares[:, None] + squares - 2 * (features @ features.T)
    np.maximum(between, 0, out=between)
    starts = np.empty((n_init, n_clusters), dtype=int)
    starts[:, 0] = random_state.randint(n, size=n_init)
    closest = between[starts[:, 0]]  # (n_init, n)
    run = np.arange(n_init)
    for k in range(1, n_clusters):
        cumulated = closest.cumsum(axis=1)
        drawn = random_state.random_sample((n_init, n_trials)) * cumulated[:, -1:]
        trials = (cumulated[:, None] <= drawn[..., None]).sum(axis=2)
        trials = np.minimum(trials, n - 1)
        candidates = np.minimum(closest[:, None], between[trials])
        best = candidates.sum(axis=2).argmin(axis=1)
        starts[:, k] = trials[run, best]
        closest = candidates[run, best]
    return starts
