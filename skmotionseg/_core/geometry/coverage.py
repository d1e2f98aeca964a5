"""Landmarks: a few tracks that stand for very many.

Drawn like the starts of k-means++ (Arthur and Vassilvitskii 2007), in rounds (Bahmani
et al. 2012): a track is the likelier, the farther it is from those drawn before, in
place and in displacement, over the frames that see both. A small thing that moves by
itself is far from its surroundings, and tracks of frames that no landmark sees are far
from all, so neither is missed as it would be by plain chance.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from .tracks import covered

ROUNDS = 16
# Tracks that are compared with the landmarks at a time.
TRACKS_PER_BATCH = 8192
# Squared distances above this quantile count as that: gross outliers are the farthest
# tracks of all, and must not take all landmarks.
FARTHEST = 0.9
# Squared distance, in spreads, of tracks that no frame sees together with a landmark.
NEVER_MET = 100.0
# Squared distance, in spreads, below which tracks are as good as one.
LEAST_DISTANCE = 1e-6
# Which neighbour says how far a track is from others.
NEIGHBOUR = 3
# The share of the tracks that are nearest to their neighbours, by which a limit is set
# to what is usual, and how many tracks are asked for it.
NEAREST, MOST_ASKED = 0.25, 1000


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
    labels : ndarray of int, shape (n_levels, n)
        Those of -1 are a group, too. Of the members of a group by the first labels, as
        many are drawn of each group by the second, and so on.
    n_drawn : int
        At most ``n``.
    random_state : numpy.random.RandomState

    Returns
    -------
    ndarray of int, shape (n_drawn,)
        Ascending.
    """
    if not len(labels):
        return np.sort(random_state.permutation(labels.shape[1])[:n_drawn])
    names, sizes = np.unique(labels[0], return_counts=True)
    drawn: list[np.ndarray] = []
    order = np.argsort(sizes, kind="stable")
    for n_left, group in zip(range(len(names), 0, -1), order, strict=True):
        share = min(
            sizes[group], (n_drawn - sum(len(each) for each in drawn)) // n_left
        )
        members = np.flatnonzero(labels[0] == names[group])
        within = draw_stratified(labels[1:, members], share, random_state)
        drawn.append(members[within])
    return np.sort(np.concatenate(drawn))


def resemblance(points, visibility, landmarks, tracks):
    """How alike tracks are to landmarks, by where they are and where they go.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    landmarks : ndarray of int, shape (n_landmarks,)
    tracks : ndarray of int, shape (m,)

    Yields
    ------
    ndarray of shape (n_batch, n_landmarks)
        Of a batch of the tracks, in order. The inverse of the mean squared distance in
        place and in displacement over the frames that see both, in units of their
        spread; 0 where no two consecutive frames see both.
    """
    for squared in _distances_in_batches(
        _channels(points, visibility), tracks, landmarks
    ):
        yield 1 / np.maximum(squared, LEAST_DISTANCE)


class Neighbours:
    """Tracks, and how far others are from their neighbours among them.

    Parameters
    ----------
    points : ndarray of shape (n, n_frames, 2)
    visibility : ndarray of bool, shape (n, n_frames)
    most_times : float, default=inf
        How many times the distance of the nearest quarter of the tracks from their
        neighbours is usual, at most: outliers, where they are many, have each other as
        neighbours.
    """

    def __init__(self, points, visibility, most_times=np.inf):
        self._most_times = most_times
        self._scaling = _scaling(points, visibility)
        self._channels = _scaled(points, visibility, self._scaling)

    def remoteness(self, points, visibility):
        """How much farther tracks are from their neighbours than these are from theirs.

        The local outlier factor (Breunig et al. 2000) of the third neighbour, in place
        and displacement.

        Parameters
        ----------
        points : ndarray of shape (m, n_frames, 2)
            Tracks at no distance from one of the others are taken to be that.
        visibility : ndarray of bool, shape (m, n_frames)

        Returns
        -------
        ndarray of shape (m,)
            1 for a track as the others are; infinite if no two consecutive frames see
            it with enough of them.
        """
        if not len(points):
            return np.zeros(0)
        channels = _scaled(points, visibility, self._scaling)
        squared = _squared_distances(channels, self._channels)
        squared[squared < LEAST_DISTANCE] = np.inf
        distance, neighbour = _kth(squared)
        near, which = np.unique(neighbour, return_inverse=True)
        usual = np.clip(self._distances(near), LEAST_DISTANCE, self._most)[which]
        farther = np.full(len(distance), np.inf)
        np.divide(distance, usual, out=farther, where=np.isfinite(distance))
        return np.sqrt(farther)

    @cached_property
    def _most(self):
        """The largest squared distance from neighbours that is usual."""
        if np.isinf(self._most_times):
            return np.inf
        n = len(self._channels[0][0])
        some = self._distances(np.linspace(0, n - 1, min(n, MOST_ASKED)).astype(int))
        known = some[np.isfinite(some)]
        nearest = np.quantile(known, NEAREST) if len(known) else np.inf
        return max(self._most_times**2 * nearest, LEAST_DISTANCE)

    def _distances(self, tracks):
        """Squared distances (m,) of some of the tracks from their neighbours."""
        some = [tuple(each[tracks] for each in channel) for channel in self._channels]
        squared = _squared_distances(some, self._channels)
        squared[np.arange(len(tracks)), tracks] = np.inf
        return _kth(squared)[0]


def _kth(squared):
    """The distance (m,) to the K-th nearest, and which that is."""
    k = min(NEIGHBOUR, squared.shape[1]) - 1
    nearest = np.argpartition(squared, k, axis=1)[:, k]
    return squared[np.arange(len(squared)), nearest], nearest


def _channels(points, visibility):
    """Places and displacements in units of their spread, 0 where unseen, and masks.

    Each is (n_tracks, n_frames, 2) and (n_tracks, n_frames), float32. What is astray is
    at the edge of what the others cover: single precision would not hold it and them.
    """
    points = np.clip(points, *covered(points, visibility))
    scaled = _scaled(points, visibility, _scaling(points, visibility))
    return [tuple(each.astype(np.float32) for each in channel) for channel in scaled]


def _values(points, visibility):
    """Places and displacements, and where they are seen."""
    moving = visibility[:, 1:] & visibility[:, :-1]
    return (points, visibility), (np.diff(points, axis=1), moving)


def _scaling(points, visibility):
    """Centres per frame and spreads of places and displacements."""
    scaling = []
    for values, seen in _values(points, visibility):
        mask = seen[..., None]
        values = np.where(mask, values, 0)
        centre = values.sum(axis=0) / np.maximum(mask.sum(axis=0), 1)
        spread = np.median(np.abs((values - centre)[seen])) if seen.any() else 0
        scaling.append((centre, spread if spread > 0 else 1))
    return scaling


def _scaled(points, visibility, scaling):
    """Channels of tracks, float64, by the scaling of these or of others."""
    return [
        (
            np.where(seen[..., None], (values - centre) / spread, 0),
            seen.astype(float),
        )
        for (values, seen), (centre, spread) in zip(
            _values(points, visibility), scaling, strict=True
        )
    ]


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
    tracks = np.arange(len(channels[0][0]))
    batches = _distances_in_batches(channels, tracks, landmarks)
    nearest = np.concatenate([squared.min(axis=1) for squared in batches])
    met = np.isfinite(nearest)
    if met.any():
        nearest = np.minimum(nearest, np.quantile(nearest[met], FARTHEST))
    nearest[~met] = NEVER_MET
    return np.maximum(nearest, 0)


def _distances_in_batches(channels, tracks, landmarks):
    """Yield squared distances (n_batch, n_landmarks) of tracks, some at a time."""
    others = _of(channels, landmarks)
    for start in range(0, len(tracks), TRACKS_PER_BATCH):
        batch = tracks[start : start + TRACKS_PER_BATCH]
        yield _squared_distances(_of(channels, batch), others)


def _of(channels, tracks):
    return [tuple(each[tracks] for each in channel) for channel in channels]


def _squared_distances(some, others):
    """Mean squared distances (m, n) of channels; infinite where no frames see both."""
    total: Any = 0
    for (near, seen_near), (far, seen_far) in zip(some, others, strict=True):
        common = seen_near @ seen_far.T
        squared = (near**2).sum(axis=2) @ seen_far.T
        squared += seen_near @ (far**2).sum(axis=2).T
        squared -= 2 * np.tensordot(near, far, axes=((1, 2), (1, 2)))
        total = total + np.where(common > 0, squared / np.maximum(common, 1), np.inf)
    return total
