"""The ordered residual kernel: how often two tracks prefer the same hypotheses.

Chin, Wang and Suter (2009); Xu, Cheong and Li (2021), sec. 3.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .lazy import lazy


@dataclass(frozen=True)
class Preferences:
    """The hypotheses that each track fits best, frame pair by frame pair.

    Attributes
    ----------
    n_tracks : int
    rows : list of ndarray of int, shape (n_seen,)
        For each pair, the tracks that are seen in it.
    marks : list of ndarray of uint8, shape (n_seen, ceil(n_hypotheses / 8))
        Their marks, packed as by :func:`numpy.packbits`.
    """

    n_tracks: int
    rows: list[np.ndarray]
    marks: list[np.ndarray]

    @classmethod
    def from_blocks(cls, n_tracks, blocks, n_top):
        """Mark the hypotheses of each pair's residuals.

        Parameters
        ----------
        n_tracks : int
        blocks : iterable of (rows, residuals)
            For each pair, the tracks seen in it, (n_seen,), and their residuals to its
            hypotheses, (n_seen, n_hypotheses).
        n_top : int
            Hypotheses marked per track and pair; of equal residuals, the first.
        """
        rows, marks = [], []
        for seen, residuals in blocks:
            rows.append(seen)
            marks.append(np.packbits(_mark_smallest(residuals, n_top), axis=1))
        return cls(n_tracks, rows, marks)

    @lazy
    def seen(self):
        """Whether each track is seen in each pair: bool, (n_tracks, n_pairs)."""
        seen = np.zeros((self.n_tracks, len(self.rows)), dtype=bool)
        for pair, rows in enumerate(self.rows):
            seen[rows, pair] = True
        return seen

    def of_pairs(self, pairs):
        """Those of some of the pairs, given as ascending positions."""
        if len(pairs) == len(self.rows):
            return self
        rows, marks = (
            [side[pair] for pair in pairs] for side in (self.rows, self.marks)
        )
        return Preferences(self.n_tracks, rows, marks)

    @lazy
    def rank(self):
        """Place of each track in the order of the first pair that sees them."""
        first = np.full(self.n_tracks, len(self.rows))
        for pair, rows in reversed(list(enumerate(self.rows))):
            first[rows] = pair
        return np.argsort(np.argsort(first, kind="stable"))

    def unpacked(self, pair):
        """Marks of the tracks seen in a pair as 0 and 1, by rank.

        Returns
        -------
        ranks : ndarray of int, shape (n_seen,)
            Ascending.
        marks : ndarray of shape (n_seen, 8 * n_bytes), float32
        """
        ranks = self.rank[self.rows[pair]]
        order = np.argsort(ranks)
        marks = np.unpackbits(self.marks[pair][order], axis=1)
        return ranks[order], marks.astype(np.float32)


def blocks_of_matrix(residuals, n_hypotheses):
    """Yield the tracks seen in each frame pair, and their residuals.

    Parameters
    ----------
    residuals : ndarray of shape (n_tracks, n_pairs * n_hypotheses)
        Pair-major. A pair in which a track has any NaN counts as unseen.
    n_hypotheses : int
        Columns of a pair.

    Yields
    ------
    rows : ndarray of int, shape (n_seen,)
    block : ndarray of shape (n_seen, n_hypotheses)
    """
    for start in range(0, residuals.shape[1], n_hypotheses):
        block = residuals[:, start : start + n_hypotheses]
        rows = np.flatnonzero(~np.isnan(block).any(axis=1))
        yield rows, block[rows]


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
    """Count the marks two tracks share, for all pairs of tracks.

    A frame pair is one product of the tracks that are seen in it, so the time goes
    with what was seen and not with the length of the video.

    Parameters
    ----------
    first, second : Preferences
        The product of one with itself is exactly symmetric.

    Returns
    -------
    ndarray of shape (n, m), float32
        Whole numbers; exact below 2 ** 24.
    """
    # By rank, the tracks of a pair lie close together: its product goes to one block.
    counts = np.zeros((first.n_tracks, second.n_tracks), dtype=np.float32)
    for pair in range(len(first.rows)):
        rows, a = first.unpacked(pair)
        columns, b = (rows, a) if second is first else second.unpacked(pair)
        if len(rows) and len(columns):
            _add_block(counts, rows, columns, a @ b.T)
    return counts.take(first.rank, axis=0).take(second.rank, axis=1)


def _add_block(counts, rows, columns, block):
    """``counts[np.ix_(rows, columns)] += block`` for ascending positions, faster."""
    start, stop = columns[0], columns[-1] + 1
    if len(columns) < stop - start:  # zeros for the columns between
        place = np.full(stop - start, len(columns))
        place[columns - start] = np.arange(len(columns))
        zero = np.zeros((len(rows), 1), dtype=block.dtype)
        block = np.hstack([block, zero]).take(place, axis=1)
    if len(rows) == rows[-1] + 1 - rows[0]:
        rows = slice(rows[0], rows[-1] + 1)
    counts[rows, start:stop] += block


def common_pairs(first, second):
    """Frame pairs in which two tracks are both seen: float32, shape (n, m)."""
    return first.seen.astype(np.float32) @ second.seen.T.astype(np.float32)


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
