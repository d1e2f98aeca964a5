"""Poses of one more frame, the points being known: resection.

Sudden motion of the camera would take an adjustment of all poses and depths at once far
from where it converges. With depths known from the frames before, a pose has six
unknowns, and Gauss-Newton with weights that follow the median residual finds it from
the pose before.

Coordinates are calibrated, as in :mod:`.rigid_motion`.
"""

from __future__ import annotations

import numpy as np

from .poses import (
    image_derivatives,
    images_of,
    lower_medians,
    normal_equations,
    rotations_of,
)

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
    rays : ndarray of shape (B, n, 3)
        Of the points in a reference frame.
    depths : ndarray of shape (B, n)
        Inverse, in the reference frame.
    x : ndarray of shape (B, n, 2)
        Calibrated coordinates in the new frame.
    weights : ndarray of shape (B, n)
        0 for points that are not seen in it.
    starts : (ndarray of shape (B, 3, 3), ndarray of shape (B, 3))
        Rotations and translations to begin with.
    floor : float or ndarray of shape (B,)
        Least scale of the residuals.
    iterations : int, optional

    Returns
    -------
    rotations : ndarray of shape (B, 3, 3)
    translations : ndarray of shape (B, 3)
    medians : ndarray of shape (B,)
        Of the residuals' lengths; infinite where no point is seen.
    """
    rays, x = (np.ascontiguousarray(np.moveaxis(each, -1, 0)) for each in (rays, x))
    starts = [each[None] for each in starts]
    found = resect_frames(
        rays, depths, x[:, None], weights[None], starts, floor, iterations
    )
    return tuple(each[0] for each in found)


def resect_frames(rays, depths, x, weights, starts, floor, iterations):
    """Poses as by :func:`resect` in several frames at once.

    Parameters
    ----------
    rays : ndarray of shape (3, B, n)
    depths : ndarray of shape (B, n)
    x : ndarray of shape (2, L, B, n)
    weights : ndarray of shape (L, B, n)
    starts : (ndarray of shape (L, B, 3, 3), ndarray of shape (L, B, 3))
    floor : float or ndarray of shape (B,)
    iterations : int

    Returns
    -------
    rotations : ndarray of shape (L, B, 3, 3)
    translations : ndarray of shape (L, B, 3)
    medians : ndarray of shape (L, B)
    """
    rotations, translations = starts
    counted = weights > 0
    for _ in range(iterations):
        image, turned, distance = images_of(rays, depths, rotations, translations)
        residuals, sizes = _residuals(x, image)
        scale = MEDIANS * np.maximum(lower_medians(sizes, counted), floor)
        scale = np.where(np.isfinite(scale), scale, 1)[..., None]
        root = np.sqrt(weights / (1 + (sizes / scale) ** 2))
        rows = image_derivatives(image, turned, depths, root / distance)
        change = _least_squares(rows, residuals * root)
        rotations = rotations_of(change[..., :3]) @ rotations
        translations = translations + change[..., 3:]
    _, sizes = _residuals(x, images_of(rays, depths, rotations, translations)[0])
    return rotations, translations, lower_medians(sizes, counted)


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


def _residuals(x, image):
    residuals = x - image
    return residuals, np.sqrt(residuals[0] ** 2 + residuals[1] ** 2)


def _least_squares(rows, left):
    """Damped least squares (L, B, 6) from (2, 6, L, B, n) and (2, L, B, n)."""
    normal, right = normal_equations(rows, left)
    diagonal = np.diagonal(normal, axis1=-2, axis2=-1)
    more = DAMPING * (diagonal + diagonal.mean(axis=-1, keepdims=True)) + 1e-12
    return np.linalg.solve(normal + more[..., None] * np.eye(6), right)[..., 0]
