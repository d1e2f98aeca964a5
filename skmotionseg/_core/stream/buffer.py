"""Tracks of the last frames of a stream, in the order of their ids."""

from __future__ import annotations

import numpy as np

UNKNOWN = -1
# Tracks of a motion that show which other has taken them.
FEWEST_TAKEN = 6


class TrackBuffer:
    """What is remembered of each track that was seen in the last frames.

    Parameters
    ----------
    length : int
        Frames that are kept.

    Attributes
    ----------
    ids : ndarray of int, shape (n,)
        Ascending, so that nothing depends on the order in which tracks come.
    points : ndarray of shape (n, length, 2)
        Pixels; 0 where unseen.
    seen : ndarray of bool, shape (n, length)
    labels : ndarray of int, shape (n,)
        Number of each track's motion, -1 for none yet; less for a candidate.
    followed : ndarray of int, shape (n,)
        Frames for which each track has had this label.
    before : ndarray of int, shape (n,)
        Label before a candidate took the track.
    former : ndarray of int, shape (n,)
        Another label that the track was shown with until it got its own; -1 for none.
    held : ndarray of bool, shape (n,)
        Whether the motion that the track follows has explained it.
    known : ndarray of int, shape (n,)
        Number of the last motion that has explained the track; -1 for none.
    outlying : ndarray of bool, shape (n,)
        Whether the track was an outlier when it was last seen.
    doubtful : ndarray of bool, shape (n,)
        Whether its motion did not explain it then.
    memory : ndarray of shape (n, M)
        Nats by which earlier frames speak against each living motion.
    """

    def __init__(self, length):
        self.ids = np.empty(0, dtype=np.int64)
        self.points = np.empty((0, length, 2))
        self.seen = np.empty((0, length), dtype=bool)
        self.labels = np.empty(0, dtype=np.int64)
        self.followed = np.empty(0, dtype=np.int64)
        self.before = np.empty(0, dtype=np.int64)
        self.former = np.empty(0, dtype=np.int64)
        self.held = np.empty(0, dtype=bool)
        self.known = np.empty(0, dtype=np.int64)
        self.outlying = np.empty(0, dtype=bool)
        self.doubtful = np.empty(0, dtype=bool)
        self.memory = np.empty((0, 0))

    def push(self, points, ids):
        """Go on by a frame.

        Parameters
        ----------
        points : ndarray of shape (n_seen, 2)
        ids : ndarray of int, shape (n_seen,)

        Returns
        -------
        rows : ndarray of int, shape (n_seen,)
            Where the tracks are now.
        new : ndarray of int
            Rows of those that were not here.
        gone : tuple of (ndarray of int, ndarray of int)
            Ids and labels of those that are here no longer.
        """
        kept = self.seen[:, 1:].any(axis=1) | np.isin(self.ids, ids)
        labels = np.where(self.outlying, UNKNOWN, self.shown())
        gone = self.ids[~kept], labels[~kept]
        n_new = len(new_ids := np.setdiff1d(ids, self.ids))
        every = np.concatenate([self.ids[kept], new_ids])
        order = np.argsort(every, kind="stable")
        self.ids = every[order]
        self.points = _grown(_shifted(self.points[kept]), n_new, 0)[order]
        self.seen = _grown(_shifted(self.seen[kept]), n_new, False)[order]
        self.labels = _grown(self.labels[kept], n_new, UNKNOWN)[order]
        self.followed = _grown(self.followed[kept] + 1, n_new, 0)[order]
        self.before = _grown(self.before[kept], n_new, UNKNOWN)[order]
        self.former = _grown(self.former[kept], n_new, UNKNOWN)[order]
        self.held = _grown(self.held[kept], n_new, False)[order]
        self.known = _grown(self.known[kept], n_new, UNKNOWN)[order]
        self.outlying = _grown(self.outlying[kept], n_new, False)[order]
        self.doubtful = _grown(self.doubtful[kept], n_new, False)[order]
        self.memory = _grown(self.memory[kept], n_new, 0)[order]
        rows = np.searchsorted(self.ids, ids)
        self.points[rows, -1], self.seen[rows, -1] = points, True
        return rows, np.searchsorted(self.ids, new_ids), gone

    def shown(self):
        """Labels in which tracks of candidates have the label of before."""
        return np.where(self.labels < UNKNOWN, self.before, self.labels)

    def follow(self, labels):
        """Set labels; tracks that go to a candidate keep those of before in mind."""
        self.held &= self.labels == labels
        self.followed = np.where(self.labels == labels, self.followed, 0)
        self.before, self.labels = self.shown(), labels
        changed = (self.before != self.shown()) & (self.before > UNKNOWN)
        self.former = np.where(changed, self.before, self.former)

    def hold(self, explained):
        """Note which tracks their motions explain."""
        self.held |= explained
        numbered = self.held & (self.labels > UNKNOWN)
        self.known = np.where(numbered, self.labels, self.known)

    def confirm(self, label, number):
        """Show the tracks of a candidate with its number."""
        own = self.labels == label
        changed = own & (self.before > UNKNOWN)
        self.former = np.where(changed, self.before, self.former)
        self.labels = np.where(own, number, self.labels)

    def taker(self, label):
        """The label with which most tracks are shown that were shown with another.

        Returns
        -------
        int
            -1 if these are few, or fewer than half of all that had the label.
        """
        shown = self.shown()
        taken = shown[(self.former == label) & (shown != label)]
        names, counts = np.unique(taken[taken > UNKNOWN], return_counts=True)
        fewest = max(FEWEST_TAKEN, (len(taken) + np.sum(shown == label)) / 2)
        return int(names[counts.argmax()]) if counts.max(initial=0) >= fewest else -1

    def add_motion(self):
        """Make room for one more living motion, against which nothing speaks yet."""
        self.memory = np.pad(self.memory, ((0, 0), (0, 1)))

    def settle(self, rows, label, column):
        """Give tracks a label against which nothing speaks any longer.

        Parameters
        ----------
        rows : ndarray of int
        label, column : int
            Of the motion, and where it is in the memory.
        """
        self.followed[rows[self.labels[rows] != label]] = 0
        self.labels[rows], self.outlying[rows] = label, False
        self.held[rows] = True
        own = self.memory[rows, column][:, None]
        self.memory[rows] = np.maximum(self.memory[rows] - own, 0)

    def release(self, label):
        """Give the tracks of a candidate the label of before."""
        self.labels = np.where(self.labels == label, self.before, self.labels)


def _shifted(values):
    """Values of one frame less, and room for the next."""
    return np.concatenate([values[:, 1:], np.zeros_like(values[:, :1])], axis=1)


def _grown(values, n, fill):
    return np.concatenate([values, np.full((n, *values.shape[1:]), fill, values.dtype)])
