"""Partitions of windows of a video, joined by their tracks and by the motions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import logit

from .identities import SHARED_TRACKS, Numbers, Trace, going_on, pixel_of

# Frames of a window, and frames that it shares with the next.
WINDOW, OVERLAP = 30, 10
# Frames of a window in which its tracks are seen, if they are anywhere.
FEWEST_SEEN = 5
# Probability of no fewer motions from which on a window is sure of them, and below
# which a motion is part of another, if windows before or after its own say so; and what
# a window says at most.
SURE, MOST_SURE = 0.95, 0.999


class Part(NamedTuple):
    """A window of a video.

    Attributes
    ----------
    start, stop : int
        Its frames.
    tracks : ndarray of int
        Those that are seen enough in it.
    """

    start: int
    stop: int
    tracks: np.ndarray


def window_ends(n_frames):
    """First frame of each window of so many frames, and the frame after its last."""
    n_windows = 1 + int(np.ceil(max(n_frames - WINDOW, 0) / (WINDOW - OVERLAP)))
    starts = np.linspace(0, max(n_frames - WINDOW, 0), n_windows).round().astype(int)
    return [(int(start), int(min(start + WINDOW, n_frames))) for start in starts]


def parts_of(visibility):
    """Windows that overlap and cover a video, and their tracks.

    Parameters
    ----------
    visibility : ndarray of bool, shape (n_tracks, n_frames)

    Returns
    -------
    list of Part
        Each track that is seen is in one of them.
    """
    ends = window_ends(visibility.shape[1])
    times = [visibility[:, start:stop].sum(axis=1) for start, stop in ends]
    most = np.maximum.reduce(times)
    return [
        Part(
            start,
            stop,
            np.flatnonzero((n >= np.minimum(most, FEWEST_SEEN)) & (n > 0)),
        )
        for (start, stop), n in zip(ends, times, strict=True)
    ]


class Joiner:
    """Numbers for the motions of one window after the other.

    Parameters
    ----------
    n_tracks : int
    most : int or None
        Motions at most.
    size : ndarray of shape (2,)
        Of the picture, pixels.
    cuts : sequence of int
        First frames after cuts, ascending.

    Attributes
    ----------
    numbers : Numbers
    """

    def __init__(self, n_tracks, most, size, cuts=()):
        self.numbers, self.most, self.size = Numbers(), most, size
        self._cuts = np.array(cuts, dtype=int)
        self._last = np.full(n_tracks, -1)  # number of each track in the last window
        self._votes = np.zeros((n_tracks, 0), dtype=np.int32)
        self._living: list[int] = []  # motions of the last window, ascending
        self._log_odds: dict[int, float] = {}  # that each is one of its own

    def add(self, part, points, seen, labels, surely=1.0):
        """Join the next window.

        Parameters
        ----------
        part : Part
        points : ndarray of shape (n, L, 2)
            Of its tracks, in its frames.
        seen : ndarray of bool, shape (n, L)
        labels : ndarray of int, shape (n,)
            ``0..M - 1``, none empty; -1 for none.
        surely : float
            Probability that there are no fewer motions in the window.
        """
        groups = [
            np.flatnonzero(labels == k) for k in range(labels.max(initial=-1) + 1)
        ]
        going_on = self._going_on([part.tracks[rows] for rows in groups])
        gone = set(self._living) - set(going_on.values())
        for number in sorted(gone):
            self.numbers.hide(number)
        order = sorted(range(len(groups)), key=lambda k: (k not in going_on, k))
        names = np.full(len(groups) + 1, -1)  # the last is of no motion
        pixel = pixel_of(self.size)
        for k in order:
            where = part.start, points[groups[k]], seen[groups[k]]
            names[k] = going_on.get(k, -1)
            if k not in going_on:
                living = {int(name) for name in names if name >= 0}
                first = Trace.of(*where, first=True, least_radius=pixel)
                names[k] = self._number_of(part.tracks[groups[k]], first, living)
            if names[k] >= 0:
                self.numbers.see(int(names[k]), Trace.of(*where, least_radius=pixel))
        self._living = sorted({int(name) for name in names if name >= 0})
        for number in self._living:
            known = self._log_odds.get(number, 0.0)
            self._log_odds[number] = known + logit(min(surely, MOST_SURE))
        self._vote(part.tracks, names[labels], seen.sum(axis=1))
        if self.most is None:  # else, what comes back is one of so many
            self.numbers.forget(part.start)

    def labels(self):
        """The number that each track had in most frames, and in which share of them.

        Returns
        -------
        labels : ndarray of int, shape (n_tracks,)
            -1 for none.
        shares : ndarray of shape (n_tracks,)
        """
        votes = self._votes.copy()
        for number, other in self._parts():
            votes[:, other] += votes[:, number]
            votes[:, number] = 0
        votes = np.pad(votes, ((0, 0), (0, 1)))  # argmax needs one
        total = votes.sum(axis=1)
        shares = votes.max(axis=1) / np.maximum(total, 1)
        return np.where(total > 0, votes.argmax(axis=1), -1), shares

    def _parts(self):
        """Motions that may be none of their own, and those that they are part of.

        Tracks that are seen in several windows have followed both.
        """
        unsure = [n for n, odds in self._log_odds.items() if odds < logit(SURE)]
        found = []
        for number in unsure:
            rows = self._votes[:, number] > 0
            shared = (self._votes[rows] > 0).sum(axis=0)
            shared[unsure] = 0
            if shared.max(initial=0) >= SHARED_TRACKS:
                found.append((number, int(shared.argmax())))
        return found

    def _going_on(self, groups):
        """Number of each group that goes on from the last window: {group: number}."""
        living = self._living
        if not living or not groups:
            return {}
        shared = np.array(
            [
                [np.sum(self._last[rows] == number) for number in living]
                for rows in groups
            ]
        )
        return going_on(shared, living)

    def _number_of(self, tracks, first, living):
        """Number of a group that does not go on; -1 of one that nothing tells.

        A motion that left the picture before the group came into it may be the same,
        unless the video was cut between: places say nothing then. Where only so many
        motions may be, it is one of these all the same.
        """
        last = {
            n: self.numbers.traces[n].frame for n in living & set(self.numbers.traces)
        }
        ended = [n for n, frame in last.items() if first and frame <= first.frame]
        shared, former = self._shared_most(tracks), self._former(tracks)
        since = 0
        if first is not None and self.most is None:
            since = self._cuts[self._cuts <= first.frame].max(initial=0)
        number, _ = self.numbers.of(
            first, self.size, living, former, self.most, ended, shared, since
        )
        return -1 if number is None else number

    def _former(self, tracks):
        """The number that most of some tracks have had; None if they had none."""
        votes = self._votes[tracks].sum(axis=0)
        return int(votes.argmax()) if votes.any() else None

    def _shared_most(self, tracks):
        """The number that most of some tracks had in the last window, if any did."""
        known = self._last[tracks]
        counts = np.bincount(known[known >= 0], minlength=1)
        return int(counts.argmax()) if counts.max() >= SHARED_TRACKS else None

    def _vote(self, tracks, names, times):
        more = self.numbers.next - self._votes.shape[1]
        self._votes = np.pad(self._votes, ((0, 0), (0, max(more, 0))))
        voting = names >= 0
        self._votes[tracks[voting], names[voting]] += times[voting]
        self._last[:] = -1
        self._last[tracks] = names
