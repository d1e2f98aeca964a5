"""Poses of one more frame, the points being known: resection.

Sudden motion of the camera would take an adjustment of all poses and depths at once far
from where it converges. With depths known from the frames before, a pose has six
unknowns, and Gauss-Newton with weights that follow the median residual finds it from
the pose before.

Coordinates are calibrated, as in :mod:`.rigid_motion`.
"""

from __future__ import annotations

import numpy as np

from .poses import kept_away, lower_medians, rotations_of

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
    rotations, translations = starts
    for _ in range(iterations):
        residuals, jacobian = _linearised(rays, depths, x, rotations, translations)
        sizes = np.linalg.norm(residuals, axis=-1)
        scale = MEDIANS * np.maximum(lower_medians(sizes, weights > 0), floor)
        scale = np.where(np.isfinite(scale), scale, 1)
        robust = weights / (1 + (sizes / scale[:, None]) ** 2)
        change = _solved(jacobian, residuals, robust)
        rotations = rotations_of(change[:, :3]) @ rotations
        translations = translations + change[:, 3:]
    residuals, _ = _linearised(rays, depths, x, rotations, translations)
    sizes = np.linalg.norm(residuals, axis=-1)
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


def _linearised(rays, depths, x, rotations, translations):
    """Residuals (B, n, 2), and the images' derivatives by the pose (B, n, 2, 6)."""
    turned = rays @ rotations.swapaxes(-1, -2)
    points = turned + depths[..., None] * translations[:, None]
    far = kept_away(points[..., 2])
    image = points[..., :2] / far[..., None]
    (u, v), (a, b, c) = np.moveaxis(image, -1, 0), np.moveaxis(turned, -1, 0)
    zero = np.zeros_like(u)
    rows = [
        [-u * b, c + u * a, -b, depths, zero, -u * depths],
        [-(c + v * b), v * a, a, zero, depths, -v * depths],
    ]
    jacobian = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    return x - image, jacobian / far[..., None, None]


def _solved(jacobian, residuals, weights):
    """Weighted least squares for the six unknowns of each pose: (B, 6)."""
    B = len(jacobian)
    rows = jacobian.reshape(B, -1, 6)
    weighted = rows * np.repeat(weights, 2, axis=1)[..., None]
    normal = weighted.swapaxes(-1, -2) @ rows
    right = weighted.swapaxes(-1, -2) @ residuals.reshape(B, -1, 1)
    diagonal = np.einsum("bii->bi", normal)
    more = DAMPING * (diagonal + diagonal.mean(axis=1, keepdims=True)) + 1e-12
    return np.linalg.solve(normal + more[..., None] * np.eye(6), right)[..., 0]
