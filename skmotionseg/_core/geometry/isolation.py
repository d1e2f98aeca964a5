"""Tracks that go where none of their neighbours goes.

So most outliers are told before any motion is known: a tracker that slips along an edge
or jumps to another corner does so with one track, while the tracks of a small thing go
together wherever it goes.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

# So many tracks nearby are compared with, and how far the third of those that go most
# alike is from going alike says how isolated a track is.
NEIGHBOURS = 12
COMPANIONS = 3
# Frames after which displacements are compared, from each such frame on.
SPAN = 2
# Differences below this share of the median of all are as good as that: where all go
# exactly alike, little is much more than usual.
LEAST_USUAL = 0.5
# Between two images half of the tracks may be mismatches, which have each other as
# neighbours. What is near in both images, they have not: distances from the third
# neighbour there are in units of so many times that of the nearest quarter. Of
# mismatches in simulated pairs, a third to nearly all are four such units away, and of
# what moves hardly any.
NEAREST, TIMES = 0.25, 0.75


def isolation(points, visibility):
    """How much less tracks go with their neighbours than these go with theirs.

    The local outlier factor (Breunig et al. 2000) of displacements, among neighbours in
    the image: a thing that is near, or of which little is seen, has neighbours that go
    less alike than those of a wall, and so have its neighbours. Of two images, the
    distance from neighbours in the joint space of both.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)

    Returns
    -------
    ndarray of shape (n_tracks,)
        The largest of all pairs of frames that are ``SPAN`` apart, and at least 1. That
        is what tracks have that are seen with few others, or too briefly.
    """
    largest = np.ones(len(points))
    last = visibility.shape[1] - 1
    if last == 1:
        seen = np.flatnonzero(visibility.all(axis=1))
        if len(seen) > NEIGHBOURS:
            largest[seen] = np.maximum(1, _in_both_images(points[seen]))
        return largest
    for first in range(0, last, SPAN):
        frames = [first, min(first + SPAN, last)]
        seen = np.flatnonzero(visibility[:, frames].all(axis=1))
        if len(seen) > NEIGHBOURS:
            between = _between(*np.moveaxis(points[np.ix_(seen, frames)], 1, 0))
            largest[seen] = np.maximum(largest[seen], between)
    return largest


def _between(x, y):
    """The isolation (n,) of points (n, 2) that go from here to there."""
    neighbours = KDTree(x).query(x, NEIGHBOURS + 1)[1]
    neighbours = neighbours[:, 1:]  # without the point itself, or one that is there too
    moved = y - x
    apart = np.hypot(*np.moveaxis(moved[neighbours] - moved[:, None], 2, 0))
    alike = np.argsort(apart, axis=1, kind="stable")[:, :COMPANIONS]
    apart = np.take_along_axis(apart, alike, axis=1)[:, -1]
    companions = np.take_along_axis(neighbours, alike, axis=1)
    least = max(LEAST_USUAL * np.median(apart), _no_distance(apart))
    return apart / np.maximum(np.median(apart[companions], axis=1), least)


def _in_both_images(points):
    """The isolation (n,) of points (n, 2, 2) of two images."""
    joint = points.reshape(len(points), 4)
    distance = KDTree(joint).query(joint, COMPANIONS + 1)[0][:, -1]
    usual = max(np.quantile(distance, NEAREST), _no_distance(distance))
    return distance / (TIMES * usual)


def _no_distance(distances):
    """A distance next to which others are as none; ratios to it do not overflow."""
    limits = np.finfo(float)
    return max(limits.eps * distances.max(), limits.tiny)
