"""Poses of rigid motions before a calibrated camera."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

# Points are kept this far, in units of the reference depth, from a camera's plane,
# where their image is infinite.
NEAREST = 0.05
# The six entries that tell a symmetric matrix of three unknowns.
UPPER = ..., *np.triu_indices(3)
# Of a determinant, relative to the product of the diagonal.
ROUNDING = 8 * np.finfo(float).eps


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
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
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


def refocused(poses, ratio):
    """Poses that give nearly the same images with another focal length.

    Parameters
    ----------
    poses : Poses
        Of one motion or several.
    ratio : float
        The focal length that was, over the other.

    Returns
    -------
    Poses
        Turned and moved across the optical axis by so many times as much: the same
        where the field of view is small.
    """
    scale = np.array([ratio, ratio, 1.0])
    turns = Rotation.from_matrix(poses.rotations.reshape(-1, 3, 3)).as_rotvec()
    turns = (turns * scale).reshape(poses.translations.shape)
    return Poses(rotations_of(turns), poses.translations * scale)


def kept_away(distance):
    """Distances from the camera's plane that are not nearly zero."""
    return np.where(
        np.abs(distance) < NEAREST, np.where(distance < 0, -NEAREST, NEAREST), distance
    )


def images_of(rays, depths, rotations, translations):
    """Images of points in other frames.

    Coordinates come first and points last, so that what is done to all of them is done
    in long loops.

    Parameters
    ----------
    rays : ndarray of shape (3, B, n)
        Of the points in a reference frame.
    depths : ndarray of shape (B, n)
        Inverse, in the reference frame.
    rotations : ndarray of shape (L, B, 3, 3)
    translations : ndarray of shape (L, B, 3)

    Returns
    -------
    image : ndarray of shape (2, L, B, n)
    turned : ndarray of shape (3, L, B, n)
        Rays in the other frames.
    distance : ndarray of shape (L, B, n)
        Along the optical axis.
    """
    rows = rotations.transpose(2, 0, 1, 3)[..., None, :]  # (3, L, B, 1, 3)
    turned = (rows @ rays.swapaxes(0, 1))[..., 0, :]
    points = turned + depths * translations.transpose(2, 0, 1)[..., None]
    distance = kept_away(points[2])
    return points[:2] / distance, turned, distance


def image_derivatives(image, turned, depths, factor):
    """Derivatives of images by their poses, times a factor per point.

    Parameters
    ----------
    image, turned
        As from :func:`images_of`.
    depths : ndarray of shape (B, n)
    factor : ndarray of shape (L, B, n)
        One over the distance along the optical axis, times any weight.

    Returns
    -------
    ndarray of shape (2, 6, L, B, n)
        By a rotation vector, applied after the rotation, and by the translation.
    """
    (u, v), (a, b, c), moved = image, turned * factor, depths * factor
    found = np.empty((2, 6, *factor.shape))
    found[0, 0], found[1, 0] = -u * b, -(c + v * b)
    found[0, 1], found[1, 1] = c + u * a, v * a
    found[0, 2], found[1, 2] = -b, a
    found[0, 3], found[1, 3] = moved, 0
    found[0, 4], found[1, 4] = 0, moved
    np.multiply(image, -moved, out=found[:, 5])
    return found


def normal_equations(rows, left):
    """Products of the rows of derivatives, and with what they are to explain.

    Parameters
    ----------
    rows : ndarray of shape (2, 6, L, B, n)
    left : ndarray of shape (2, L, B, n)

    Returns
    -------
    normal : ndarray of shape (L, B, 6, 6)
    right : ndarray of shape (L, B, 6, 1)
    """
    rows = rows.transpose(0, 2, 3, 1, 4)  # (2, L, B, 6, n)
    normal = rows @ rows.swapaxes(-1, -2)
    right = rows @ left[..., None]
    return normal[0] + normal[1], right[0] + right[1]


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
    # Below this it is rounding: of a singular matrix, solutions of 1e200 would follow.
    least = ROUNDING * (a * d * f)  # their product bounds the determinant (Hadamard)
    inverse = 1 / np.maximum(determinant, np.maximum(least, np.finfo(float).tiny))
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
    values = np.where(counted, values, np.inf)
    values.sort(axis=-1)
    middle = np.maximum(counted.sum(axis=-1) - 1, 0) // 2
    flat = values.reshape(-1, values.shape[-1])
    middle = np.broadcast_to(middle, values.shape[:-1]).ravel()
    return flat[np.arange(len(flat)), middle].reshape(values.shape[:-1])
