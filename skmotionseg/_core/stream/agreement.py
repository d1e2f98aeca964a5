"""Windows of a video that agree with those beside them on how many motions there are.

A window sees its tracks for a second or so. Two things that move alike for so long, or
that pass one after the other, are one motion in it; a thing that bends may be two. The
windows before and after it see some of the same tracks, and may be sure of the
contrary.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from .identities import CONTAINED, SHARED_TRACKS
from .joining import SURE

# Times that a window is segmented again at most, from other random numbers.
ATTEMPTS = 3


class WindowMotions(NamedTuple):
    """What was found in a window.

    Attributes
    ----------
    tracks : ndarray of int, shape (n,)
        Those of the video that it has.
    labels : ndarray of int, shape (n,)
        ``0..M - 1``, none empty; -1 for none.
    surely : float
        Probability that there are no fewer motions; NaN where it is not known.
    more : float
        Probability that there are more; NaN where it is not known.
    unexplained : float
        Pixels that half of the tracks are from their motions, if that is much; else 0.
    """

    tracks: np.ndarray
    labels: np.ndarray
    surely: float
    more: float = np.nan
    unexplained: float = 0.0

    @property
    def n_motions(self):
        return int(self.labels.max(initial=-1)) + 1

    @property
    def is_sure(self):
        return self.surely >= SURE


class Contradiction(NamedTuple):
    """A window that contradicts one beside it.

    Attributes
    ----------
    place : int
        Of the window.
    n_motions : int
        That it should have.
    beside : list of WindowMotions
        Those beside it that are sure of their motions.
    """

    place: int
    n_motions: int
    beside: list[WindowMotions]


def agreeing(found, again, fewest, most):
    """Windows of which those that contradict the ones beside them are changed.

    They are segmented again, into as many motions as those beside them say, and this is
    kept if more of their tracks then go together as they do there.

    Parameters
    ----------
    found : list of WindowMotions
        In order.
    again : callable
        ``(places, numbers, attempt) -> list of WindowMotions``: of some windows, each
        with a number of motions. Attempts are 0, 1, ...
    fewest, most : int
        Motions that a window may have.

    Returns
    -------
    list of WindowMotions
        Those that are changed are as sure as the less sure of those beside them.
    """
    changed = list(found)
    left = [each for each in _contradictions(found) if fewest <= each.n_motions <= most]
    for attempt in range(ATTEMPTS):
        if not left:
            break
        places, numbers, _ = zip(*left, strict=True)
        for wrong, new in zip(left, again(places, numbers, attempt), strict=True):
            k, beside = wrong.place, wrong.beside
            enough = _n_alike(found[k], beside) + SHARED_TRACKS
            if _n_alike(new, beside) >= max(enough, _n_alike(changed[k], beside) + 1):
                surely = min(other.surely for other in beside)
                changed[k] = new._replace(surely=surely)
        left = [
            wrong
            for wrong in left
            if any(_differences(changed[wrong.place], wrong.beside))
        ]
    return changed


def _contradictions(found):
    """The windows that have too few motions, or too many, by those beside them."""
    for k, own in enumerate(found):
        near = [found[j] for j in (k - 1, k + 1) if 0 <= j < len(found)]
        beside = [other for other in near if other.is_sure]
        lacking, spare = _differences(own, beside)
        if lacking or spare:
            yield Contradiction(k, own.n_motions + lacking - spare, beside)


def _differences(own, beside):
    """How many motions a window lacks, and how many it has too many.

    It lacks one if two of a window beside it, which is sure of them, are one in it: for
    so long they may move alike. It has one too many if two are one in both windows
    beside it, and it is not sure itself; one of these may see a car that has parked.
    """
    lacking = max((_n_merged(other, own) for other in beside), default=0)
    if own.is_sure or len(beside) < 2:
        return lacking, 0
    return lacking, min(_n_merged(own, other) for other in beside)


def _n_merged(window, other):
    """By how many motions of a window another has fewer: those that share one there."""
    shared = _shared_tracks(other, window)
    held = shared >= np.maximum(CONTAINED * shared.sum(axis=0), SHARED_TRACKS)
    return int(np.maximum(held.sum(axis=1) - 1, 0).sum())


def _n_alike(own, beside):
    """Tracks that a window shares with others, and that go together in it as there."""
    tables = [_shared_tracks(own, other) for other in beside]
    return sum(t[linear_sum_assignment(t, maximize=True)].sum() for t in tables)


def _shared_tracks(window, other):
    """Tracks that each two motions of two windows have in common, (M, N)."""
    _, rows, columns = np.intersect1d(window.tracks, other.tracks, return_indices=True)
    rows, columns = window.labels[rows], other.labels[columns]
    known = (rows >= 0) & (columns >= 0)
    shared = np.zeros((window.n_motions, other.n_motions), dtype=int)
    np.add.at(shared, (rows[known], columns[known]), 1)
    return shared
