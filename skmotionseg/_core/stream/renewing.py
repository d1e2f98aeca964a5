"""Groups that a new search has found, and the motions that live."""

from __future__ import annotations

import numpy as np

from .buffer import UNKNOWN
from .identities import going_on


def rows_of_groups(buffer, ids, labels):
    """Rows of the groups of a partition, of the tracks that are in the buffer.

    Parameters
    ----------
    buffer : TrackBuffer
    ids, labels : ndarray of int, shape (n,)
        Of the partition, by ascending ids.

    Returns
    -------
    list of ndarray of int
    """
    found = np.full(len(buffer.ids), UNKNOWN)
    here = np.isin(ids, buffer.ids)
    found[np.searchsorted(buffer.ids, ids[here])] = labels[here]
    return [np.flatnonzero(found == k) for k in range(labels.max() + 1)]


def shared_tracks(buffer, motions, groups):
    """Tracks of each group that follow each motion.

    Parameters
    ----------
    buffer : TrackBuffer
    motions : list of LivingMotion
    groups : list of ndarray of int

    Returns
    -------
    shared : ndarray of int, shape (n_groups, M)
    living : list of int
        Numbers of the motions.
    """
    living = [motion.number for motion in motions]
    of_groups = [buffer.labels[rows] for rows in groups]
    shared = [[np.sum(own == number) for number in living] for own in of_groups]
    return np.array(shared).reshape(len(groups), len(living)), living


def recognised(buffer, motions, groups):
    """Groups and their numbers, if they are motions that live.

    Of groups that have followed one motion, it goes on in that whose tracks have for
    most frames: another came later, and was taken for it. Tracks of motions that are no
    group remain where they are.

    Parameters
    ----------
    buffer : TrackBuffer
    motions : list of LivingMotion
    groups : list of ndarray of int

    Returns
    -------
    groups : list of ndarray of int
        Without such tracks.
    numbers : ndarray of int, shape (n_groups,)
        -1 for a group that is new.
    """
    shared, living = shared_tracks(buffer, motions, groups)
    frames = [
        [
            buffer.followed[rows[buffer.labels[rows] == number]].sum()
            for number in living
        ]
        for rows in groups
    ]
    known = going_on(shared, living, np.reshape(frames, shared.shape))
    kept = sorted(set(living) - set(known.values()))
    left = [rows[~np.isin(buffer.labels[rows], kept)] for rows in groups]
    return left, np.array([known.get(k, UNKNOWN) for k in range(len(groups))])


def in_order(groups, numbers, n_new):
    """Groups that go on, then the largest of those that are new, so many at most.

    Parameters
    ----------
    groups : list of ndarray of int
    numbers : ndarray of int, shape (n_groups,)
    n_new : int
        None if it is negative.

    Returns
    -------
    list of int
    """
    new = [k for k in range(len(groups)) if numbers[k] == UNKNOWN]
    new = sorted(new, key=lambda k: -len(groups[k]))[: max(n_new, 0)]
    return [k for k in range(len(groups)) if numbers[k] != UNKNOWN] + sorted(new)
