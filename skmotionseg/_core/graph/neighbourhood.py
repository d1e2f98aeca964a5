"""The epsilon-neighbourhood: which affinities of a row are worth keeping.

Lai, Wang, Zhang, Yan and Suter (2017), "Motion segmentation via a sparsity
constraint". In row i, with ``s_j = max^alpha - a_ij^alpha`` and ``p_j = s_j / sum s``,
entry j stays where ``log p_j < sum_k p_k log p_k``. That is the same as
``a_ij > t_i`` for a threshold per row, so a row that was not there in ``fit`` is
treated like one that was.
"""

from __future__ import annotations

import numpy as np
from scipy.special import logsumexp

# Affinities that differ by less than this share are equal: they are float32.
TIE = 1e-6
# Levels below this are computed by logarithms, as powers may be 0.
TINY = 1e-200


def neighbourhood_thresholds(affinity, alpha, own):
    """The affinity above which a row keeps an entry.

    Parameters
    ----------
    affinity : ndarray of shape (n, m)
        Non-negative.
    alpha : float
        The larger, the fewer entries are kept.
    own : ndarray of shape (n,)
        The affinity of each row to itself, the largest it can have.

    Returns
    -------
    ndarray of shape (n,)
        0, which keeps all that is positive, for a row in which nothing stands out:
        one that is constant, or zero.
    """
    thresholds = np.zeros(len(affinity))
    rows = np.flatnonzero(own > 0)
    relative = affinity[rows] / own[rows, None].astype(float)
    relative[relative > 1 - TIE] = 1  # the own affinity, but for rounding
    similarity = _power(relative, alpha)
    distance = 1 - similarity  # s_j in units of the row's largest
    total = distance.sum(axis=1)
    varied = total > 0
    rows, similarity, distance = rows[varied], similarity[varied], distance[varied]
    p = distance / total[varied, None]
    # With log s_j for log p_j the sum over s drops out: stay where
    # log s_j < sum_k p_k log s_k.
    log_distance = np.log1p(-np.where(distance > 0, similarity, 0))
    level = -np.expm1((p * log_distance).sum(axis=1))
    share = level ** (1 / alpha)
    tiny = np.flatnonzero(level < TINY)
    if len(tiny):
        some = np.flatnonzero(varied)[tiny]
        share[tiny] = _threshold_by_logs(relative[some], p[tiny], alpha)
    thresholds[rows] = own[rows] * share * (1 + TIE)
    return thresholds


def _threshold_by_logs(relative, p, alpha):
    """The threshold, over the own affinity, of rows whose powers may be out of range.

    Where all are tiny, s differs from 1 by them, and the level is their mean.
    """
    with np.errstate(divide="ignore"):  # what is 0 stays so
        logs = alpha * np.log(relative) + np.log(p)
    return np.exp(logsumexp(logs, axis=1) / alpha)


def _power(x, exponent):
    """``x ** exponent``, by products where the exponent is a small whole number."""
    if exponent != int(exponent) or exponent > 16:
        return x**exponent
    power = x.copy()
    for bit in format(int(exponent), "b")[1:]:
        power *= power
        if bit == "1":
            power *= x
    return power


def sparsify(affinity, row_thresholds, column_thresholds):
    """Halve an entry for each of its two ends that would not keep it.

    Parameters
    ----------
    affinity : ndarray of shape (n, m)
    row_thresholds : ndarray of shape (n,)
    column_thresholds : ndarray of shape (m,)

    Returns
    -------
    ndarray of shape (n, m)
        ``affinity`` times the average of the mask and its transpose.
    """
    votes = (affinity > row_thresholds[:, None]).astype(affinity.dtype)
    votes += affinity > column_thresholds
    votes *= affinity
    votes /= 2
    return votes


def strongest(affinity, n_links):
    """Keep the largest entries of each row: links to so many others.

    Of an epsilon-neighbourhood, rows keep the more entries the more there are, and one
    of a small group then keeps some that are not of it.

    Parameters
    ----------
    affinity : ndarray of shape (n, n)
        Symmetric and non-negative; its diagonal does not count.
    n_links : int
        Equal ones are kept together.

    Returns
    -------
    ndarray of shape (n, n)
        With entries halved that only one of their two ends keeps, and a diagonal of 0.
    """
    links = affinity.copy()
    np.fill_diagonal(links, 0)
    place = max(len(links) - n_links, 0)
    least = np.partition(links, place, axis=1)[:, place] * (1 - TIE)
    return sparsify(links, least, least)
