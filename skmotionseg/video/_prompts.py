"""Points on each motion, for programs that segment what they are pointed at."""

from __future__ import annotations

from numbers import Integral

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from .._core.geometry.tracks import unpack_tracks
from .._utils.validation import check_label_each
from ._checks import check_number

# Neighbours of a track, most of which are of a motion if the track is on it.
N_NEIGHBOURS = 4


def prompt_points(
    X: npt.ArrayLike, labels: npt.ArrayLike, *, n_points: int = 5
) -> list[dict[str, object]]:
    """Points on and off each motion in each frame, for a promptable segmenter.

    Positive points are spread over the tracks of the motion, away from tracks of
    others; negative ones are the tracks of others that are nearest to it, spread, too,
    without those among its own, which are on it whatever their label.

    Parameters
    ----------
    X : array-like of shape (n_tracks, 2 * n_frames)
        Tracks in pixels; NaN where unseen.
    labels : array-like of int, shape (n_tracks,)
        Motion of each track: 0 the static scene, which gets no points of its own; -1
        for none.
    n_points : int, default=5
        Positive points, and negative ones, per motion and frame at most.

    Returns
    -------
    list of dict
        One per motion and frame in which it is seen, frame by frame: ``"frame"``,
        ``"motion"``, and ``"positive"`` and ``"negative"``, lists of ``[x, y]`` in
        pixels.

    Raises
    ------
    ValueError
        If the tracks are malformed, there is not one label per track, or
        ``n_points`` is less than 1.

    Examples
    --------
    >>> from skmotionseg.video import prompt_points
    >>> prompt_points([[10, 10], [12, 10], [40, 30]], [1, 1, 0], n_points=1)
    [{'frame': 0, 'motion': 1, 'positive': [[10.0, 10.0]], 'negative': [[40.0, 30.0]]}]
    """
    points, visibility = unpack_tracks(X)
    labels = check_label_each(labels, len(points))
    check_number("n_points", n_points, Integral, 1)
    prompts: list[dict[str, object]] = []
    for frame in range(points.shape[1]):
        seen = visibility[:, frame] & (labels >= 0)
        here, names = points[seen, frame], labels[seen]
        for motion in np.unique(names[names > 0]).tolist():
            positive, negative = _choose(here[names == motion], here[names != motion])
            prompts.append(
                {
                    "frame": frame,
                    "motion": motion,
                    "positive": _spread(positive, n_points),
                    "negative": _spread(negative, n_points),
                }
            )
    return prompts


def _choose(own, others):
    """Half of the own points, farthest from others, and the nearest eighth of these."""
    if len(others) == 0:
        return own, others
    margin, _ = KDTree(others).query(own)
    inner = own[np.argsort(-margin, kind="stable")[: -(-len(own) // 2)]]
    others = _outside(own, others)
    distance, _ = KDTree(own).query(others)
    nearest = others[np.argsort(distance, kind="stable")[: -(-len(others) // 8)]]
    return inner, nearest


def _outside(own, others):
    """The others that are not among the own points; all of them if none is not."""
    k = min(N_NEIGHBOURS + 1, len(own) + len(others))
    _, near = KDTree(np.concatenate([own, others])).query(others, k)
    is_own = near.reshape(len(others), k)[:, 1:] < len(own)
    outside = 2 * is_own.sum(axis=1) <= k - 1
    return others[outside] if outside.any() else others


def _spread(points, n_points):
    """The first point, then always the one farthest from those chosen: lists."""
    if len(points) == 0:
        return []
    chosen = [0]
    distance = np.linalg.norm(points - points[0], axis=1)
    while len(chosen) < min(n_points, len(points)) and distance.max() > 0:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(
            distance, np.linalg.norm(points - points[chosen[-1]], axis=1)
        )
    return np.round(points[chosen], 2).tolist()
