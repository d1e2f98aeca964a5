"""What a fit keeps of its motions, in pixels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._core.geometry.motion_models import homogeneous
from .._core.geometry.tracks import similarity
from .._core.partition.motions import sampson_distances


class FittedMotions(NamedTuple):
    """The motions of a partition in pixels."""

    frame_pairs: np.ndarray  # (n_pairs, 2)
    matrices: np.ndarray  # (n_motions, n_pairs, 3, 3)
    thresholds: np.ndarray  # (n_motions,)
    residuals: np.ndarray  # (n_pairs, n_tracks)
    inliers: np.ndarray  # (n_pairs, n_tracks)


def motions_in_pixels(motions, points, visibility, labels, frames):
    """Matrices of pixel coordinates, and how far each track is from its own motion.

    Parameters
    ----------
    motions : Motions
        In the order of the labels.
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    labels : ndarray of int, shape (n_tracks,)
    frames : ndarray of int, shape (n_frames,)
        Their numbers in the video.

    Returns
    -------
    FittedMotions
        NaN where a motion has no matrix in a pair, or a pair does not see a track.
    """
    working = motions.frames
    pairs, scale = working.pairs, working.scale
    residuals = np.full((len(pairs), len(points)), np.nan, dtype=np.float32)
    seen, x, y = working.observe(points, visibility)
    ends = np.cumsum(seen.sum(axis=1))[:-1]
    for pair, sides in enumerate(
        zip(*(np.split(homogeneous(side), ends) for side in (x, y)), strict=True)
    ):
        tracks = np.flatnonzero(seen[pair])
        for motion, fundamental in enumerate(motions.fundamental[:, pair]):
            own = labels[tracks] == motion
            distances = sampson_distances(fundamental, *(side[own] for side in sides))
            # A degenerate matrix gives more than float32 holds: infinite, as by none.
            with np.errstate(over="ignore"):
                residuals[pair, tracks[own]] = scale * distances
    residuals[np.isinf(residuals)] = np.nan
    thresholds = scale * motions.inlier_thresholds
    own = np.append(thresholds, np.nan)[labels]  # the last is that of -1
    return FittedMotions(
        frames[pairs],
        _matrices_in_pixels(motions),
        thresholds,
        residuals,
        residuals <= own,
    )


def _matrices_in_pixels(motions):
    """``y^T F x = 0`` of pixels; unit norm, NaN where there is no matrix."""
    working = motions.frames
    to_working = np.stack([similarity(1 / working.scale, c) for c in working.centres])
    first, second = (to_working[working.pairs[:, side]] for side in (0, 1))
    F = np.swapaxes(second, 1, 2) @ motions.fundamental @ first
    norm = np.linalg.norm(F, axis=(-2, -1), keepdims=True)
    return np.divide(F, norm, out=np.full_like(F, np.nan), where=norm > 0)
