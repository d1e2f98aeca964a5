"""Two images of things that moved between them, with mismatches."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_array_equal

SIZE = np.array([640.0, 480.0])
FOCAL = 600.0


def two_images(sizes, mismatches=0, *, noise=0.5, flat=False, seed=0):
    """Tracks of things side by side that each moved by itself: X (n, 4), y (n,).

    Parameters
    ----------
    sizes : sequence of int
        Tracks of each thing.
    mismatches : int
        Tracks labelled -1, anywhere in both images.
    noise : float
        Pixels.
    flat : bool
        Whether things are planes.
    seed : int
    """
    rng = np.random.default_rng(seed)
    parts, labels = [], []
    for motion, size in enumerate(sizes):
        centre = np.array([(motion + 0.5) / len(sizes) - 0.5, rng.uniform(-0.2, 0.2)])
        points = rng.uniform(-1, 1, (size, 3)) * [0.35 / len(sizes), 0.2, 0.1]
        if flat:
            points[:, 2] = 0.2 * points[:, 0]
        moved = points @ rotation(rng.uniform(-0.3, 0.3, 3)).T
        middle = np.array([*centre, 1.2])
        shift = rng.uniform(-0.08, 0.08, 3)
        both = [project(points + middle), project(moved + middle + shift)]
        parts.append(np.hstack(both) + noise * rng.standard_normal((size, 4)))
        labels.append(np.full(size, motion))
    parts.append(rng.uniform(0, 1, (mismatches, 4)) * np.tile(SIZE, 2))
    labels.append(np.full(mismatches, -1))
    order = rng.permutation(sum(sizes) + mismatches)
    return np.concatenate(parts)[order], np.concatenate(labels)[order]


def project(points):
    """Pixels (n, 2) of points (n, 3) before the camera."""
    return FOCAL * points[:, :2] / points[:, 2:] + SIZE / 2


def rotation(vector):
    """Rotation matrix of a rotation vector (Rodrigues)."""
    angle = np.linalg.norm(vector)
    a, b, c = vector / angle
    K = np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def assert_places_and_rejects(partitions, points, seen):
    """An explanation of two motions places and rejects what they were found in.

    Returns
    -------
    ndarray of int, shape (n,)
        Where it places the tracks; -1 where it knows nothing of one.
    """
    explanation, labels = partitions.explanation, partitions.best[2][1]
    nobody = np.full(len(labels), -1)
    inside = ~partitions.outliers
    placed = explanation.nearest(points, seen, nobody)
    assert (placed == labels)[inside].mean() > 0.95
    rejected = explanation.reject(points, seen, placed)
    assert ((rejected < 0) == partitions.outliers).mean() > 0.95
    turned, known = explanation.reordered([1, 0]), placed >= 0
    again = turned.nearest(points, seen, nobody)
    assert_array_equal(again, np.where(known, 1 - placed, -1))
    assert_array_equal(turned.motions.noise, explanation.motions.noise[::-1])
    return placed
