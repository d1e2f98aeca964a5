"""Poses of one more frame, the points being known: resection.

Sudden motion of the camera would take an adjustment of all poses and depths at once far
from where it converges. With depths known from the frames before, a pose has six
unknowns, and Gauss-Newton with weights that follow the median residual finds it from
the pose before.

Coordinates are calibrated, as in :mod:`.rigid_motion`.
"""

from __future__ import annotations

import numpy as np

from .poses import image_derivatives, kept_away, lower_medians, rotations_of

ITERATIONS = 6
# Residuals are weighted by Cauchy's function of this many medians.
MEDIANS = 2.0
# Share of the diagonal that is added, as few points may leave a pose undetermined.
DAMPING = 1e-4


def inverse_depths(rays, x, seen, poses):
    """Inverse depths of tracks in a reference frame, by least algebraic error.

    Parameters
    ----------
    rays : ndarray of shape (B, n, 3)
        Of the tracks in the reference frame.
    x : ndarray of shape (B, n, L, 2)
        Calibrated coordinates; 0 where unseen.
    seen : ndarray of bool, shape (B, n, L)
        Observations that count.
    poses : Poses
        Of B motions, the identity in the reference frame.

    Returns
    -------
    ndarray of shape (B, n)
    """
    turned = rays[:, None] @ poses.rotations.swapaxes(-1, -2)  # (B, L, n, 3)
    t = poses.translations[:, :, None]
    observed, counted = x.swapaxes(1, 2), seen.swapaxes(1, 2)[..., None]
    slope = (observed * t[..., 2:] - t[..., :2]) * counted
    left = (turned[..., :2] - observed * turned[..., 2:]) * counted
    top, bottom = (slope * left).sum(axis=(1, 3)), (slope**2).sum(axis=(1, 3))
    return top / (bottom + 1e-12)


def resect(rays, depths, x, weights, starts, floor, iterations=ITERATIONS):
    """Rotations and translations to a frame in which known points are seen.

    Parameters
    ----------
    rays : ndarray of shape (..., n, 3)
        Of the points in a reference frame. The first axes of all arguments broadcast.
    depths : ndarray of shape (..., n)
        Inverse, in the reference frame.
    x : ndarray of shape (..., n, 2)
        Calibrated coordinates in the new frame.
    weights : ndarray of shape (..., n)
        0 for points that are not seen in it.
    starts : (ndarray of shape (..., 3, 3), ndarray of shape (..., 3))
        Rotations and translations to begin with, of all axes.
    floor : float or ndarray of shape (...)
        Least scale of the residuals.
    iterations : int, optional

    Returns
    -------
    rotations : ndarray of shape (..., 3, 3)
    translations : ndarray of shape (..., 3)
    medians : ndarray of shape (...)
        Of the residuals' lengths; infinite where no point is seen.
    """
    rotations, translations = starts
    rays, x = rays.swapaxes(-1, -2), x.swapaxes(-1, -2)
    for _ in range(iterations):
        image, turned, distance = _seen_from(rays, depths, rotations, translations)
        residuals = x - image
        sizes = np.sqrt(residuals[..., 0, :] ** 2 + residuals[..., 1, :] ** 2)
        scale = MEDIANS * np.maximum(lower_medians(sizes, weights > 0), floor)
        scale = np.where(np.isfinite(scale), scale, 1)[..., None]
        root = np.sqrt(weights / (1 + (sizes / scale) ** 2))
        rows = image_derivatives(image, turned, depths, root / distance)
        change = _least_squares(rows, residuals * root[..., None, :])
        rotations = rotations_of(change[..., :3]) @ rotations
        translations = translations + change[..., 3:]
    residuals = x - _seen_from(rays, depths, rotations, translations)[0]
    sizes = np.sqrt(residuals[..., 0, :] ** 2 + residuals[..., 1, :] ** 2)
    return rotations, translations, lower_medians(sizes, weights > 0)


def next_poses(poses, valid):
    """Poses in the frame after the last, at constant speed where that is known.

    Parameters
    ----------
    poses : Poses
        Of B motions in L frames.
    valid : ndarray of bool, shape (B, L)
        Where poses are known.

    Returns
    -------
    rotations : ndarray of shape (B, 3, 3)
    translations : ndarray of shape (B, 3)
    """
    R, t = poses
    turn = R[:, -1] @ R[:, -2].swapaxes(-1, -2)
    step = t[:, -1] - (turn @ t[:, -2, :, None])[..., 0]
    known = (valid[:, -1] & valid[:, -2])[:, None]
    moved = (turn @ t[:, -1, :, None])[..., 0] + step
    return (
        np.where(known[..., None], turn @ R[:, -1], R[:, -1]),
        np.where(known, moved, t[:, -1]),
    )


def _seen_from(rays, depths, rotations, translations):
    """Images (..., 2, n), turned rays (..., 3, n) and distances (..., n) of points."""
    turned = rotations @ rays
    points = turned + depths[..., None, :] * translations[..., None]
    distance = kept_away(points[..., 2, :])
    return points[..., :2, :] / distance[..., None, :], turned, distance


def _least_squares(rows, left):
    """Damped least squares (..., 6) from (..., 6, 2, n) and (..., 2, n)."""
    rows = rows.reshape(*rows.shape[:-2], -1)
    left = left.reshape(*left.shape[:-2], -1, 1)
    normal = rows @ rows.swapaxes(-1, -2)
    diagonal = np.diagonal(normal, axis1=-2, axis2=-1)
    more = DAMPING * (diagonal + diagonal.mean(axis=-1, keepdims=True)) + 1e-12
    return np.linalg.solve(normal + more[..., None] * np.eye(6), rows @ left)[..., 0]
