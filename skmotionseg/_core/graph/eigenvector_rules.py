"""How many groups a graph has, by its eigenvalues or by its eigenvectors.

In a graph of connected groups without an affinity between them, the Laplacian has the
eigenvalue 0 once for each, and its eigenvectors can be rotated so that each lives on
one group. Here is by how much a graph falls short of either, for each number of groups.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from .spectral import normalize_rows

# Costs of alignment that differ by no more are equal: as in the program of Zelnik-Manor
# and Perona.
ALIGNMENT_TOLERANCE = 1e-3
# Angles at which a plane is searched before the descent; a quarter turn swaps its axes.
SEARCH_ANGLES = np.linspace(-np.pi / 4, np.pi / 4, 12, endpoint=False)
# A descent ends when a step promises to lower the mean cost of a row by less, or after
# so many.
LEAST_DESCENT = 1e-5
MAX_STEPS = 100


def eigengap_costs(eigenvalues, counts):
    """What each count costs by the gap that follows its eigenvalue.

    Gaps are absolute, ``lambda_{k+1} - lambda_k``, as von Luxburg (2007, sec. 8.3) has
    them, and Xu, Cheong and Li (2021) in their comparison.

    Parameters
    ----------
    eigenvalues : ndarray of shape (n_eigenvalues,)
        Of the Laplacian, the smallest first; one more than the largest count, unless
        there are no more.
    counts : ndarray of int, shape (n_counts,)

    Returns
    -------
    ndarray of shape (n_counts, 3)
        The eigenvalue, the next, and the first less the second. None follows the last
        of all: it counts as its own next.
    """
    own = eigenvalues[counts - 1]
    following = eigenvalues[np.minimum(counts, len(eigenvalues) - 1)]
    return np.column_stack([own, following, own - following])


def alignment_costs(vectors, counts):
    """What each count costs by how far its eigenvectors are from indicators of groups.

    For each count C the first C eigenvectors are rotated to ``Z`` such that
    ``J = sum_ij Z_ij^2 / max_j Z_ij^2`` is small (Zelnik-Manor and Perona 2004, sec.
    3).
    Over n rows J is at least n, where each has one entry that is not zero, and at most
    n C. Each count starts from the rotation of the one before.

    Parameters
    ----------
    vectors : ndarray of shape (n, n_vectors)
        Leading eigenvectors.
    counts : ndarray of int, shape (n_counts,)
        Ascending; none above ``n_vectors``.

    Returns
    -------
    ndarray of shape (n_counts, 3)
        ``J / (n C)``, its least value ``1 / C``, and the first less the second: never
        negative, and 0 where each row has one entry.
    """
    rotated = vectors[:, :0]
    costs = []
    for count in counts:
        grown = np.hstack([rotated, vectors[:, rotated.shape[1] : count]])
        rotated = grown @ aligning_rotation(grown)
        costs.append((row_cost(normalize_rows(rotated)) / count, 1 / count))
    alignment, least = np.array(costs).T
    return np.column_stack([alignment, least, alignment - least])


def best_aligned(costs):
    """Position of the largest count that aligns as well as any.

    Parameters
    ----------
    costs : ndarray of shape (n_counts,)

    Returns
    -------
    int
    """
    return int(np.flatnonzero(costs <= costs.min() + ALIGNMENT_TOLERANCE)[-1])


def row_cost(rows):
    """Mean over the rows of ``sum_j Z_ij^2 / max_j Z_ij^2``.

    Parameters
    ----------
    rows : ndarray of shape (n, n_groups)
        Of length 1, or zero: those are of groups that no vector is for, and cost as
        much as a row can.

    Returns
    -------
    float
        Between 1 and ``n_groups``.
    """
    return float(_inverse_squares(np.abs(rows).max(axis=1), rows.shape[1]).mean())


def _inverse_squares(largest, n_groups):
    """``1 / max_j Z_ij^2``, the cost of a row of length 1, within its bounds."""
    return 1 / np.clip(largest**2, 1 / n_groups, 1)


def aligning_rotation(vectors):
    """A rotation after which each row has, as nearly as can be, one entry.

    Where two entries of a row tie, the cost has a ridge, along which the gradient says
    nothing: eigenvectors of equal groups begin on one. So each plane of two axes is
    searched at some angles first, and only then the gradient is followed.

    Parameters
    ----------
    vectors : ndarray of shape (n, n_groups)

    Returns
    -------
    ndarray of shape (n_groups, n_groups)
    """
    rows = normalize_rows(vectors)
    searched = _search_planes(rows)
    return searched @ _descend(rows @ searched)


def _search_planes(rows):
    """Product of the Givens rotations that are best in one plane after another."""
    n_groups = rows.shape[1]
    rotation = np.eye(n_groups)
    cosine, sine = np.cos(SEARCH_ANGLES), np.sin(SEARCH_ANGLES)
    for i in range(n_groups):
        for j in range(i + 1, n_groups):
            x, y = rows[:, [i]], rows[:, [j]]
            others = np.abs(np.delete(rows, [i, j], axis=1)).max(axis=1, initial=0)
            largest = np.maximum(  # (n, n_angles)
                np.abs(x * cosine - y * sine), np.abs(x * sine + y * cosine)
            )
            largest = np.maximum(largest, others[:, None])
            best = _inverse_squares(largest, n_groups).mean(axis=0).argmin()
            c, s = cosine[best], sine[best]
            givens = np.array([[c, s], [-s, c]])
            rows = rows.copy()
            rows[:, [i, j]] = rows[:, [i, j]] @ givens
            rotation[:, [i, j]] = rotation[:, [i, j]] @ givens
    return rotation


def _descend(rows):
    """Rotation to which gradient descent with halved steps leads."""
    rotation = np.eye(rows.shape[1])
    cost, step = row_cost(rows), 1.0
    for _ in range(MAX_STEPS):
        slope = angle_gradient(rows)
        fall = np.sum(slope**2) / 2  # of the cost, per unit of step
        while step * fall > LEAST_DESCENT:
            turn = scipy.linalg.expm(-step * slope)
            turned = rows @ turn
            lower = row_cost(turned)
            if lower < cost - step * fall / 2:
                break
            step /= 2
        else:
            break
        rows, rotation, cost, step = turned, rotation @ turn, lower, 2 * step
    return rotation


def angle_gradient(rows):
    """Derivatives of the cost of the rows by the angles in all planes of two axes.

    Zelnik-Manor and Perona descend by the angles of a product of Givens rotations: at
    angles of 0, which each step starts from, the derivatives are these.

    Parameters
    ----------
    rows : ndarray of shape (n, n_groups)
        Of length 1, or zero.

    Returns
    -------
    ndarray of shape (n_groups, n_groups)
        Skew: entry (i, j) is for ``Z -> Z exp(t (e_i e_j^T - e_j e_i^T))``.
    """
    n = len(rows)
    peak = np.abs(rows).argmax(axis=1)
    at_peak = rows[np.arange(n), peak]
    by_entry = np.zeros_like(rows)
    by_entry[np.arange(n), peak] = np.divide(
        -2, n * at_peak**3, out=np.zeros(n), where=at_peak != 0
    )
    product = rows.T @ by_entry
    return product - product.T
