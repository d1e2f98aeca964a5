"""What a partition costs, and labels in their canonical order."""

from __future__ import annotations

import numpy as np


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


def indicator(labels):
    """The assignment matrix X, (n, M); rows of negative labels are zero."""
    return (labels[:, None] == np.arange(labels.max(initial=-1) + 1)).astype(float)


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
    cut = np.maximum(volume - inside, 0)
    return float(np.divide(cut, volume, out=np.zeros_like(cut), where=volume > 0).sum())


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
    norms = np.sqrt(np.sum(X.sum(axis=0) ** 2)) * np.linalg.norm(affinity)
    return float(2 - 2 * np.sum(X * (affinity @ X)) / norms) if norms > 0 else 2.0
