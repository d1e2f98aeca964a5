"""Robust fundamental matrices for many frame pairs at once.

A matrix that fits tracks best has rank three, for they carry noise, and there are two
ways to take its third rank away. The nearest matrix of rank two is as good where the
tracks determine all entries. Where they do not (a plane, a distant thing, few tracks),
it may be far from all of them, and the cheapest correction, the one that raises the
squared error least, stays close. But two motions that are joined into one group leave
a matrix with much freedom too, and the cheapest correction then finds one that hides
it. Neither is the better judge by itself (see :mod:`skmotionseg._core.partition.cost`).
"""

from __future__ import annotations

import numpy as np

from .motion_models import (
    MOTION_MODELS,
    cofactors3,
    dominant_eigenvectors,
    epipolar_equations,
    homogeneous,
    rank_two,
)
from .tracks import frame_pairs, working_coordinates

# Weights of the robust fit fall to a half at this residual, as a share of the mean
# distance of the tracks from their centre: a fifth of a pixel in a video of 640 x 480.
ROBUST_SCALE = 2e-3
ROBUST_SWEEPS = 4
# Moments that obey a model exactly are singular; this share of their trace, far below
# any noise, is added to invert them.
SINGULAR = 1e-14
# Newton steps to rank two; 10 or 20 change next to nothing.
CORRECTIONS = 5
ROUNDING = np.finfo(float).eps
MINIMAL_SIZE = MOTION_MODELS["fundamental"].minimal_size


def nearest_rank_two(inverse):
    """The matrix of rank two nearest to the one of least squared error.

    Parameters
    ----------
    inverse : ndarray of shape (P, 9, 9)
        Inverse moments of the epipolar equations.

    Returns
    -------
    ndarray of shape (P, 3, 3)
        Of unit norm.
    """
    return rank_two(dominant_eigenvectors(inverse).reshape(-1, 3, 3))


def cheapest_rank_two(inverse):
    """The matrix of rank two that raises the least squared error least.

    Newton steps on the determinant, along the direction in which a change of it costs
    least (Kanatani and Sugaya, "High accuracy fundamental matrix computation and its
    performance evaluation", BMVC 2006, optimal correction). Where tracks leave two
    entries open, the steps miss the root for a few matrices in a hundred, which are
    then corrected to the nearest.

    Parameters
    ----------
    inverse : ndarray of shape (P, 9, 9)
        Inverse moments of the epipolar equations.

    Returns
    -------
    ndarray of shape (P, 3, 3)
        Of unit norm.
    """
    f = dominant_eigenvectors(inverse)  # (P, 9)
    along = f[:, None, :] @ inverse @ f[:, :, None]  # (P, 1, 1)
    # A step along f is none: it changes the scale alone.
    inverse = inverse - along * f[:, :, None] * f[:, None, :]
    for _ in range(CORRECTIONS):
        slope = cofactors3(f.reshape(-1, 3, 3)).reshape(-1, 9)  # of the determinant
        determinant = (slope * f).sum(axis=1) / 3
        step = (inverse @ slope[..., None])[..., 0]
        rate = (slope * step).sum(axis=1)
        # Below rounding, the rate is none, and the step must not overflow.
        least = ROUNDING * np.linalg.norm(slope, axis=1) * np.linalg.norm(step, axis=1)
        rate = np.maximum(rate, np.maximum(least, np.finfo(float).tiny))
        f = f - (determinant / rate)[:, None] * step
        f = f / np.linalg.norm(f, axis=1, keepdims=True)
    return rank_two(f.reshape(-1, 3, 3))


def robust_fits(x, y, seen, lower_rank=nearest_rank_two, trusted=None):
    """A fundamental matrix fitted robustly to each pair, and its Sampson errors.

    Iteratively reweighted least squares with Cauchy weights, from equal ones. It stands
    a few tracks in a hundred of another motion; a group with more of them is described
    badly, as it should be.

    Parameters
    ----------
    x, y : ndarray of shape (n_pairs, n, 2)
    seen : ndarray of bool, shape (n_pairs, n)
    lower_rank : callable
        Takes inverse moments (P, 9, 9) to matrices (P, 3, 3) of rank two.
    trusted : ndarray of bool, shape (n_pairs, n), optional
        What is fitted, where it is eight tracks or more; else all.

    Returns
    -------
    F : ndarray of shape (n_pairs, 3, 3)
        For points in working units; zero in pairs that see fewer than eight.
    errors : ndarray of shape (n_pairs, n)
        Squared, in working units; infinite in pairs that see fewer than eight.
    """
    fits, residuals = np.zeros((len(seen), 3, 3)), np.full(seen.shape, np.inf)
    pairs = np.flatnonzero(seen.sum(axis=1) >= MINIMAL_SIZE)
    if len(pairs) == 0:
        return fits, residuals
    fitted = _enough(seen if trusted is None else seen & trusted, seen)[pairs]
    x, y, frames, spread = normalize_pairs(x[pairs], y[pairs], seen[pairs])
    rows = epipolar_equations(x, y)  # (P, n, 9)
    weights = fitted
    for _ in range(ROBUST_SWEEPS):
        moments = (rows * weights[..., None]).swapaxes(1, 2) @ rows  # (P, 9, 9)
        F = lower_rank(_inverse(moments))
        lines, back = x @ F.swapaxes(1, 2), y @ F
        gradient = sum(side[..., i] ** 2 for side in (lines, back) for i in (0, 1))
        gradient = np.maximum(gradient, np.finfo(float).tiny)
        errors = (rows @ F.reshape(-1, 9, 1))[..., 0] ** 2 / gradient
        weights = fitted / (1 + errors * (spread / ROBUST_SCALE) ** 2)
        least = 1e-9 * gradient.max(axis=1, keepdims=True)
        weights /= np.maximum(gradient, least)
        weights /= weights.max(axis=1, keepdims=True)
    fits[pairs] = frames[1].swapaxes(1, 2) @ F @ frames[0]
    residuals[pairs] = errors * spread**2
    return fits, residuals


def _enough(trusted, seen):
    """The trusted tracks (n_pairs, n) of each pair, or all where they are too few."""
    few = trusted.sum(axis=1) < MINIMAL_SIZE
    return np.where(few[:, None], seen, trusted).astype(float)


def _inverse(moments):
    trace = np.trace(moments, axis1=1, axis2=2)[:, None, None]
    return np.linalg.inv(moments / trace + SINGULAR * np.eye(moments.shape[1]))


def mean_sampson_errors(points, visibility):
    """How far tracks of one motion are from its epipolar geometry, frame by frame.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)

    Returns
    -------
    ndarray of shape (n_tracks,)
        Squared Sampson errors to the fundamental matrix of each two consecutive frames,
        in squared working units, mean over the frame pairs that see the track and
        seven others; NaN where there is none.
    """
    centres, scale = working_coordinates(points, visibility)
    total, n_judged = np.zeros(len(points)), np.zeros(len(points), dtype=int)
    for i, j in frame_pairs(visibility.shape[1]):  # one by one: tracks may be many
        seen = np.flatnonzero(visibility[:, i] & visibility[:, j])
        x = (points[seen, i] - centres[i]) / scale
        y = (points[seen, j] - centres[j]) / scale
        everywhere = np.ones((1, len(seen)), dtype=bool)
        _, (errors,) = robust_fits(x[None], y[None], everywhere)
        if np.isfinite(errors).all():
            total[seen] += errors
            n_judged[seen] += 1
    return np.divide(
        total, n_judged, out=np.full(len(points), np.nan), where=n_judged > 0
    )


def normalize_pairs(x, y, seen):
    """Homogeneous points of each pair about their centroids, one scale per pair.

    Parameters
    ----------
    x, y : ndarray of shape (P, n, 2)
    seen : ndarray of bool, shape (P, n)

    Returns
    -------
    x, y : ndarray of shape (P, n, 3)
        The centroid where they are not seen.
    frames : ndarray of shape (2, P, 3, 3)
        What took the points of the first and of the second frame there.
    spread : ndarray of shape (P, 1)
        The scale.
    """
    n_seen = seen.sum(axis=1)[:, None, None]
    mask = seen[..., None]
    centres = [(side * mask).sum(axis=1, keepdims=True) / n_seen for side in (x, y)]
    x, y = (x - centres[0]) * mask, (y - centres[1]) * mask
    spread = np.sqrt((x**2 + y**2).sum(axis=(1, 2)) / (4 * n_seen[:, 0, 0]))[:, None]
    spread = np.maximum(spread, 1e-6)
    scale = spread[..., None]
    frames = np.zeros((2, len(x), 3, 3))
    frames[..., 2, 2] = 1
    for frame, centre in zip(frames, centres, strict=True):
        frame[:, 0, 0] = frame[:, 1, 1] = 1 / spread[:, 0]
        frame[:, :2, 2] = -centre[:, 0] / spread
    return homogeneous(x / scale), homogeneous(y / scale), frames, spread
