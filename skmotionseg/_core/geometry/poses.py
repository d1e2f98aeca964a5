"""Poses of rigid motions before a calibrated camera."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

# Points are kept this far, in units of the reference depth, from a camera's plane,
# where their image is infinite.
NEAREST = 0.05
# The six entries that tell a symmetric matrix of three unknowns.
UPPER = ..., *np.triu_indices(3)


class Poses(NamedTuple):
    """Camera poses relative to a group, by problem and frame.

    Attributes
    ----------
    rotations : ndarray of shape (B, L, 3, 3)
    translations : ndarray of shape (B, L, 3)
        In units of the depth of which inverse depths are.
    """

    rotations: np.ndarray
    translations: np.ndarray


def rotations_of(vectors):
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3), by Rodrigues."""
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    small = angle < 1e-8
    safe = np.where(small, 1, angle)
    sine = np.where(small, 1, np.sin(safe) / safe)
    cosine = np.where(small, 0.5, (1 - np.cos(safe)) / safe**2)
    cross = np.zeros((*vectors.shape, 3))
    x, y, z = np.moveaxis(vectors, -1, 0)
    cross[..., 0, 1], cross[..., 0, 2], cross[..., 1, 2] = -z, y, -x
    cross -= cross.swapaxes(-1, -2)
    return np.eye(3) + sine * cross + cosine * (cross @ cross)


def relative_to(poses, reference):
    """The same motions, the pose in another frame being the identity.

    Parameters
    ----------
    poses : Poses
        Of B motions.
    reference : int or sequence of B int

    Returns
    -------
    Poses
    """
    batch = np.arange(len(poses.rotations))
    turned = poses.rotations @ poses.rotations[batch, reference, None].swapaxes(-1, -2)
    moved = (turned @ poses.translations[batch, reference, None, :, None])[..., 0]
    return Poses(turned, poses.translations - moved)


def kept_away(distance):
    """Distances from the camera's plane that are not nearly zero."""
    return np.where(
        np.abs(distance) < NEAREST, np.where(distance < 0, -NEAREST, NEAREST), distance
    )


def image_derivatives(image, turned, depths, factor):
    """Derivatives of images by their poses, times a factor per point.

    Parameters
    ----------
    image : ndarray of shape (..., 2, n)
    turned : ndarray of shape (..., 3, n)
        Rays in the frame of the image.
    depths : ndarray of shape (..., n)
        Inverse, in the reference frame.
    factor : ndarray of shape (..., n)
        One over the distance along the optical axis, times any weight.

    Returns
    -------
    ndarray of shape (..., 6, 2, n)
        By a rotation vector, applied after the rotation, and by the translation.
    """
    u, v = image[..., 0, :], image[..., 1, :]
    a, b, c = (turned[..., i, :] * factor for i in range(3))
    moved = depths * factor
    found = np.zeros((*u.shape[:-1], 6, 2, u.shape[-1]))
    found[..., 0, 0, :], found[..., 0, 1, :] = -u * b, -(c + v * b)
    found[..., 1, 0, :], found[..., 1, 1, :] = c + u * a, v * a
    found[..., 2, 0, :], found[..., 2, 1, :] = -b, a
    found[..., 3, 0, :] = found[..., 4, 1, :] = moved
    found[..., 5, 0, :], found[..., 5, 1, :] = -u * moved, -v * moved
    return found


def solve_three(matrix, right):
    """Solutions of many symmetric systems of three unknowns, in closed form.

    Parameters
    ----------
    matrix : sequence of six ndarray
        The entries :data:`UPPER` of positive definite matrices.
    right : sequence of three ndarray

    Returns
    -------
    list of three ndarray
    """
    a, b, c, d, e, f = matrix
    minors = d * f - e * e, c * e - b * f, b * e - c * d
    determinant = a * minors[0] + b * minors[1] + c * minors[2]
    inverse = 1 / np.maximum(determinant, np.finfo(float).tiny)
    rows = (
        minors,
        (minors[1], a * f - c * c, b * c - a * e),
        (minors[2], b * c - a * e, a * d - b * b),
    )
    return [
        (row[0] * right[0] + row[1] * right[1] + row[2] * right[2]) * inverse
        for row in rows
    ]


def lower_medians(values, counted):
    """Lower medians over the last axis of what counts; infinite where nothing does."""
    values = np.sort(np.where(counted, values, np.inf), axis=-1)
    middle = np.maximum(np.broadcast_to(counted, values.shape).sum(axis=-1) - 1, 0) // 2
    return np.take_along_axis(values, middle[..., None], -1)[..., 0]
