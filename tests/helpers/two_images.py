"""Two images of things that moved between them, with mismatches."""

from __future__ import annotations

import numpy as np

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


def street(n_tracks=300, *, n_moving=0, noise=0.5, seed=0):
    """Two images of a street from beside, which goes away from the camera.

    Parameters
    ----------
    n_tracks : int
        A third each of the ground and of the houses on both sides.
    n_moving : int
        Tracks of a thing on the street that goes up and turns.
    noise, seed
        As for :func:`two_images`.

    Returns
    -------
    X : ndarray of shape (n, 4)
    surfaces : ndarray of int, shape (n,)
        0 to 2 for the street, 3 for the thing.
    """
    rng = np.random.default_rng(seed)
    n = n_tracks // 3
    away = rng.uniform(6, 25, 3 * n)
    side, up = rng.uniform(-1, 1, n), rng.uniform(-1, 1, 2 * n)
    ground = np.column_stack([4 * side, np.full(n, 1.6), away[:n]])
    sides = np.repeat([-4.0, 4.0], n)
    houses = np.column_stack([sides, 1.5 * up, away[n:]])
    thing = rng.uniform(-1, 1, (n_moving, 3)) * [0.8, 0.6, 0.4] + [0, 0.5, 9]
    turned = (thing - [0, 0.5, 9]) @ rotation([0.02, 0.25, 0.1]).T
    turned += [0.1, 0.1, 8.8]
    points = np.concatenate([ground, houses, thing])
    moved = np.concatenate([ground, houses, turned])
    camera = np.array([0.7, 0.05, 0.1])
    both = [project(points), project((moved - camera) @ rotation([0.01, 0.03, 0.02]))]
    X = np.hstack(both)
    X = X + noise * rng.standard_normal(X.shape)
    surfaces = np.repeat(np.arange(4), [n, n, n, n_moving])
    inside = (abs(X - np.tile(SIZE / 2, 2)) <= np.tile(SIZE / 2, 2)).all(axis=1)
    return X[inside], surfaces[inside]
