"""The ordered residual kernel: how often two tracks prefer the same hypotheses.

Chin, Wang and Suter (2009); Xu, Cheong and Li (2021), sec. 3.2.
"""

from __future__ import annotations

import numpy as np

# Columns of marks that are unpacked and multiplied at a time: 2,000 tracks then need
# 32 MB of float32, whatever the length of the video.
COLUMNS_A_BATCH = 4096


def preferred_hypotheses(residuals, n_hypotheses, n_top):
    """Mark, in each frame pair, the hypotheses that a track fits best.

    Parameters
    ----------
    residuals : ndarray of shape (n_tracks, n_pairs * n_hypotheses)
        Pair-major. A pair in which a track has any NaN counts as unseen.
    n_hypotheses : int
        Columns of a pair.
    n_top : int
        Hypotheses marked a track and pair; of equal residuals, the first.

    Returns
    -------
    preferred : ndarray of uint8, shape (n_tracks, ceil(n_columns / 8))
        The marks, packed as by :func:`numpy.packbits`.
    seen : ndarray of bool, shape (n_tracks, n_pairs)
    """
    groups = residuals.reshape(len(residuals), -1, n_hypotheses)
    marks = np.zeros(groups.shape, dtype=bool)
    seen = np.empty(groups.shape[:2], dtype=bool)
    for pair in range(groups.shape[1]):
        seen[:, pair] = ~np.isnan(groups[:, pair]).any(axis=1)
        rows = np.flatnonzero(seen[:, pair])
        marks[rows, pair] = _mark_smallest(groups[rows, pair], n_top)
    return np.packbits(marks.reshape(residuals.shape), axis=1), seen


def _mark_smallest(values, n_top):
    """Mark the ``n_top`` smallest entries of each row; ties by position."""
    threshold = np.partition(values, n_top - 1, axis=1)[:, n_top - 1, None]
    marks = values <= threshold
    tied = np.flatnonzero(marks.sum(axis=1) > n_top)
    if len(tied):
        order = np.argsort(values[tied], axis=1, kind="stable")[:, :n_top]
        marks[tied] = False
        marks[tied[:, None], order] = True
    return marks


def co_occurrence(first, second):
    """Count the marks two rows share, for all pairs of rows.

    Parameters
    ----------
    first, second : ndarray of uint8, shapes (n, n_bytes) and (m, n_bytes)
        Packed marks. The product of an array with itself is exactly symmetric.

    Returns
    -------
    ndarray of shape (n, m), float32
        Whole numbers; exact below 2 ** 24.
    """
    counts = np.zeros((len(first), len(second)), dtype=np.float32)
    for start in range(0, first.shape[1], COLUMNS_A_BATCH // 8):
        columns = slice(start, start + COLUMNS_A_BATCH // 8)
        a = np.unpackbits(first[:, columns], axis=1).astype(np.float32)
        if second is first:
            counts += a @ a.T
        else:
            counts += a @ np.unpackbits(second[:, columns], axis=1).astype(np.float32).T
    return counts


def covisible_affinity(counts, n_common, n_top, prior):
    """Turn co-occurrence counts into affinities between 0 and 1.

    ``k_ij / (n_top (c_ij + prior))``, with ``c_ij`` the frame pairs in which both
    tracks are seen. The paper divides by ``c_ij`` alone, which trusts one common pair
    as much as thirty; the prior adds that many pairs in which the two agree on
    nothing, so few common pairs give a small affinity.

    Parameters
    ----------
    counts : ndarray of shape (n, m)
    n_common : ndarray of shape (n, m)
        Frame pairs in which both tracks are seen.
    n_top : int
    prior : float
        In frame pairs.

    Returns
    -------
    ndarray of shape (n, m)
        0 where two tracks never meet.
    """
    denominator = n_top * (n_common + prior)
    return np.divide(
        counts, denominator, out=np.zeros_like(counts), where=denominator > 0
    )


def own_affinity(n_seen, prior):
    """Affinity of tracks to themselves, given the frame pairs they are seen in."""
    n_seen = np.asarray(n_seen, dtype=float)
    return np.divide(
        n_seen, n_seen + prior, out=np.zeros_like(n_seen), where=n_seen > 0
    )
