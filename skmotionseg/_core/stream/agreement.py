"""Windows of a video that agree with those beside them on how many motions there are.

A window sees its tracks for a second or so. Two things that move alike for so long, or
that pass one after the other, are one motion in it; a thing that bends may be two. The
windows before and after it see some of the same tracks, and may be sure of the
contrary.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .identities import CONTAINED, SHARED_TRACKS
from .joining import SURE

# Times that a window is segmented again at most, from other random numbers.
ATTEMPTS = 3


class WindowMotions(NamedTuple):
    """What was found in a window.

    Attributes
    ----------
    labels : ndarray of int, shape (n,)
        ``0..M - 1``, none empty; -1 for none.
    surely : float
        Probability that there are no fewer motions; NaN where there are too few tracks
        to look for any.
    """

    labels: np.ndarray
    surely: float

    @property
    def n_motions(self):
        return int(self.labels.max(initial=-1)) + 1

    @property
    def is_sure(self):
        return self.surely >= SURE


def agreeing(parts, found, again, fewest, most):
    """Windows of which those that contradict a sure one beside them are changed.

    They are segmented again, into as many motions as that one says, and this is kept
    if it agrees with all that are sure.

    Parameters
    ----------
    parts : list of Part
    found : list of WindowMotions
        Of each.
    again : callable
        ``(k, n_motions, attempt) -> labels (n,)`` of the tracks of window ``k``.
        Attempts are 0, 1, ...
    fewest, most : int
        Motions that a window may have.

    Returns
    -------
    list of WindowMotions
    """
    found = list(found)
    for k, part in enumerate(parts):
        own, window = found[k], (part.tracks, found[k].labels)
        sure = [
            (parts[j].tracks, found[j].labels)
            for j in (k - 1, k + 1)
            if 0 <= j < len(parts) and found[j].is_sure
        ]
        missing, spare = _differences(window, sure)
        change = missing if own.is_sure else missing - spare
        n_motions = own.n_motions + change
        if change and fewest <= n_motions <= most:
            attempts = (again(k, n_motions, attempt) for attempt in range(ATTEMPTS))
            agree = (
                WindowMotions(labels, max(own.surely, SURE))
                for labels in attempts
                if not any(_differences((part.tracks, labels), sure))
            )
            found[k] = next(agree, own)
    return found


def _differences(window, others):
    """How many motions a window lacks by others, and how many it has more, at most."""
    missing = [_sharing(window, other) for other in others]
    spare = [_sharing(other, window) for other in others]
    return max(missing, default=0), max(spare, default=0)


def _sharing(window, other):
    """How many motions of another window share one of a window, but for one of each."""
    shared = _shared_tracks(window, other)
    held = shared >= np.maximum(CONTAINED * shared.sum(axis=0), SHARED_TRACKS)
    return int(np.maximum(held.sum(axis=1) - 1, 0).sum())


def _shared_tracks(window, other):
    """Tracks that each two motions of two windows have in common, (M, N).

    Windows are tracks and their labels, those of no motion -1.
    """
    (tracks, labels), (others, their) = window, other
    _, rows, columns = np.intersect1d(tracks, others, return_indices=True)
    rows, columns = labels[rows], their[columns]
    known = (rows >= 0) & (columns >= 0)
    shared = np.zeros((labels.max(initial=-1) + 1, their.max(initial=-1) + 1), int)
    np.add.at(shared, (rows[known], columns[known]), 1)
    return shared
