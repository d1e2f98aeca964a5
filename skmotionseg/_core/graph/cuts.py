"""What a partition cuts of an affinity, and how well it reconstructs it."""

from __future__ import annotations

import numpy as np

from ..labels import indicator


def own_shares(views, labels):
    """Share of each track's affinity to others that is to tracks of its own label.

    The probability that one step of a random walk on the graph does not leave the
    motion.

    Parameters
    ----------
    views : ndarray of shape (n_views, n, n)
    labels : ndarray of int, shape (n,)

    Returns
    -------
    ndarray of shape (n,)
        Mean over the views in which a track is linked to another with a label; 0 where
        there is none, or the label is -1.
    """
    X = indicator(labels)
    total, n_views = np.zeros(len(labels)), np.zeros(len(labels))
    for view in views:
        links = view @ X - np.diagonal(view)[:, None] * X
        linked = links.sum(axis=1)
        own = (links * X).sum(axis=1)
        total += np.divide(own, linked, out=np.zeros_like(own), where=linked > 0)
        n_views += linked > 0
    return np.clip(total / np.maximum(n_views, 1), 0, 1)


def normalized_cut(affinity, labels):
    """``sum_m cut(A_m, rest) / vol(A_m)`` (Xu, Cheong and Li 2021, eq. 11, first line).

    Parameters
    ----------
    affinity : ndarray of shape (n, n)
    labels : ndarray of int, shape (n,)
        -1 is in no group.

    Returns
    -------
    float
        Between 0 and the number of groups.
    """
    X = indicator(labels)
    inside = np.einsum("im,im->m", X, affinity @ X)
    volume = X.T @ affinity.sum(axis=1)
    return float(_share_cut(inside, volume).sum())


def cuts_between(affinity, labels):
    """By how much the normalised cut falls when two groups become one.

    Parameters
    ----------
    affinity : ndarray of shape (n, n)
    labels : ndarray of int, shape (n,)
        ``0..M - 1``, none empty.

    Returns
    -------
    ndarray of shape (M, M)
        Symmetric, and not negative.
    """
    X = indicator(labels)
    sums = X.T @ affinity @ X
    volume = sums.sum(axis=1)
    inside = np.diagonal(sums)
    apart = _share_cut(inside, volume)
    joint = _share_cut(inside[:, None] + inside + 2 * sums, volume[:, None] + volume)
    falls = apart[:, None] + apart - joint
    return np.where(np.eye(len(sums)) == 1, 0, np.maximum(falls, 0))


def _share_cut(inside, volume):
    """The part of groups' volumes that leaves them; 0 for groups without any."""
    cut = np.maximum(volume - inside, 0)
    return np.divide(cut, volume, out=np.zeros_like(cut), where=volume > 0)


def reconstruction_error(affinity, labels):
    """``|X X^T / |X X^T| - K / |K||_F^2`` (Xu, Cheong and Li 2021, eq. 9).

    Parameters
    ----------
    affinity : ndarray of shape (n, n)
    labels : ndarray of int, shape (n,)

    Returns
    -------
    float
        Between 0 and 2.
    """
    X = indicator(labels)
    largest = affinity.max(initial=0)
    affinity = affinity / (largest if largest > 0 else 1)  # squares must not overflow
    norms = np.sqrt(np.sum(X.sum(axis=0) ** 2)) * np.linalg.norm(affinity)
    return float(2 - 2 * np.sum(X * (affinity @ X)) / norms) if norms > 0 else 2.0


def partition_costs(views, labels, delta):
    """Normalised cut, reconstruction error and total (Xu, Cheong and Li 2021, eq. 13).

    Parameters
    ----------
    views : ndarray of shape (n_views, n, n)
    labels : ndarray of int, shape (n,)
    delta : float

    Returns
    -------
    ndarray of shape (3,)
        Each summed over the views; the total is the first plus ``delta`` times the
        second.
    """
    cut = sum(normalized_cut(view, labels) for view in views)
    reconstruction = sum(reconstruction_error(view, labels) for view in views)
    return np.array([cut, reconstruction, cut + delta * reconstruction])
