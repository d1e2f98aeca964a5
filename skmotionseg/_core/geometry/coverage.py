"""Landmarks: a few tracks that stand for very many.

Drawn like the starts of k-means++ (Arthur and Vassilvitskii 2007), in rounds (Bahmani
et al. 2012): a track is the likelier, the farther it is from those drawn before, in
place and in displacement, over the frames that see both. A small thing that moves by
itself is far from its surroundings, and tracks of frames that no landmark sees are far
from all, so neither is missed as it would be by plain chance.
"""

from __future__ import annotations

from typing import Any

import numpy as np

ROUNDS = 16
# Tracks that are compared with the landmarks at a time.
TRACKS_PER_BATCH = 8192
# Squared distances above this quantile count as that: gross outliers are the farthest
# tracks of all, and must not take all landmarks.
FARTHEST = 0.9
# Squared distance, in spreads, of tracks that no frame sees together with a landmark.
NEVER_MET = 100.0


def draw_covering(points, visibility, n_landmarks, random_state):
    """Draw tracks that cover all places, displacements and frames.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    n_landmarks : int
        At most ``n_tracks``.
    random_state : numpy.random.RandomState

    Returns
    -------
    ndarray of int, shape (n_landmarks,)
        Ascending. Tracks that are seen in no two consecutive frames come last of all.
    """
    channels = _channels(points, visibility)
    moving = visibility[:, 1:] & visibility[:, :-1]
    # Each frame has the same say, however few tracks it sees.
    say = moving @ (1 / np.maximum(moving.sum(axis=0), 1))
    distance = np.full(len(points), NEVER_MET)
    free = np.ones(len(points), dtype=bool)
    for n_new in np.diff(np.linspace(0, n_landmarks, ROUNDS + 1).astype(int)):
        new = _draw(say * distance * free, free, n_new, random_state)
        free[new] = False
        if n_new:
            np.minimum(distance, _distance_to(channels, new), out=distance)
    return np.flatnonzero(~free)


def draw_stratified(labels, n_drawn, random_state):
    """Draw as many members of each group, or all where a group has not so many.

    Parameters
    ----------
    labels : ndarray of int, shape (n,)
        Those of -1 are a group, too.
    n_drawn : int
        At most ``n``.
    random_state : numpy.random.RandomState

    Returns
    -------
    ndarray of int, shape (n_drawn,)
        Ascending.
    """
    names, sizes = np.unique(labels, return_counts=True)
    drawn: list[np.ndarray] = []
    order = np.argsort(sizes, kind="stable")
    for n_left, group in zip(range(len(names), 0, -1), order, strict=True):
        share = min(
            sizes[group], (n_drawn - sum(len(each) for each in drawn)) // n_left
        )
        members = np.flatnonzero(labels == names[group])
        drawn.append(random_state.permutation(members)[:share])
    return np.sort(np.concatenate(drawn))


def _channels(points, visibility):
    """Places and displacements in units of their spread, 0 where unseen, and masks.

    Each is (n_tracks, n_frames, 2) and (n_tracks, n_frames), float32.
    """
    moving = visibility[:, 1:] & visibility[:, :-1]
    channels = []
    for values, seen in ((points, visibility), (np.diff(points, axis=1), moving)):
        mask = seen[..., None]
        values = np.where(mask, values, 0)
        centre = values.sum(axis=0) / np.maximum(mask.sum(axis=0), 1)
        values = np.where(mask, values - centre, 0)
        spread = np.median(np.abs(values[seen])) if seen.any() else 0
        channels.append(
            (
                (values / (spread if spread > 0 else 1)).astype(np.float32),
                seen.astype(np.float32),
            )
        )
    return channels


def _draw(weights, free, n_new, random_state):
    """Draw so many tracks without replacement, those of no weight last."""
    # The largest of u^(1/w) are a draw with weights w (Efraimidis and Spirakis 2006).
    with np.errstate(divide="ignore"):
        keys = np.log(random_state.random_sample(len(weights))) / weights
    keys[weights == 0] = -np.finfo(float).max
    keys[~free] = -np.inf
    return np.argsort(-keys, kind="stable")[:n_new]


def _distance_to(channels, landmarks):
    """Mean squared distance of each track to the nearest landmark."""
    n_tracks = len(channels[0][0])
    nearest = np.empty(n_tracks)
    for start in range(0, n_tracks, TRACKS_PER_BATCH):
        batch = slice(start, start + TRACKS_PER_BATCH)
        total: Any = 0
        for values, seen in channels:
            squares, marks = (values**2).sum(axis=2), seen[landmarks].T
            flat = values.reshape(n_tracks, -1)
            common = seen[batch] @ marks
            squared = squares[batch] @ marks + seen[batch] @ squares[landmarks].T
            squared -= 2 * (flat[batch] @ flat[landmarks].T)
            total = total + np.where(
                common > 0, squared / np.maximum(common, 1), np.inf
            )
        nearest[batch] = total.min(axis=1)
    met = np.isfinite(nearest)
    if met.any():
        nearest = np.minimum(nearest, np.quantile(nearest[met], FARTHEST))
    nearest[~met] = NEVER_MET
    return np.maximum(nearest, 0)
