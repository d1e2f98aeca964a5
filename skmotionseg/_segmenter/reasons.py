"""Why each track has the label that it has."""

from __future__ import annotations

import numpy as np

ASSIGNED = "assigned"
OUTLIER = "outlier"  # no motion has it as an inlier
TOO_SHORT = "too short"  # no frame pair sees it
ISOLATED = "isolated"  # frame pairs see it, and it has no affinity to another
NO_MOTIONS = "no motions yet"  # a stream has found none
CANDIDATE = "candidate"  # a stream will say soon whether this is a new motion


def label_reasons(labels, before_rejection, seen_in_pairs):
    """Why each track has its label.

    Parameters
    ----------
    labels : ndarray of int, shape (n_tracks,)
    before_rejection : ndarray of int, shape (n_tracks,)
        With the labels of outliers.
    seen_in_pairs : ndarray of bool, shape (n_tracks,)
        Whether a frame pair sees the track.

    Returns
    -------
    ndarray of str, shape (n_tracks,)
    """
    return np.select(
        [labels >= 0, before_rejection >= 0, ~seen_in_pairs],
        [ASSIGNED, OUTLIER, TOO_SHORT],
        ISOLATED,
    )


def stream_reasons(labels, outlying, candidates, any_motion):
    """Why each track of a frame of a stream has its label.

    Parameters
    ----------
    labels : ndarray of int, shape (n,)
        As given.
    outlying, candidates : ndarray of bool, shape (n,)
        Tracks that their own motion does not explain, and those of candidates.
    any_motion : bool
        Whether there are motions.

    Returns
    -------
    ndarray of str, shape (n,)
    """
    none = np.full(len(labels), not any_motion)
    return np.select(
        [labels >= 0, none, outlying, candidates],
        [ASSIGNED, NO_MOTIONS, OUTLIER, CANDIDATE],
        TOO_SHORT,
    )
