"""Where fits of rigid motions start: from the flow between two frames.

The instantaneous motion of Heeger and Jepson [1]_ between a reference frame and another
is searched over directions of translation, first coarsely over half a sphere and then
around the best that differ. With the depths that it leaves, the poses in all other
frames are found by resection, so that they need not be those of a constant speed.

What is straight ahead is one of the directions: most cameras that drive go there, and
their tracks say little of depth if it is missed by a few degrees.

References
----------
.. [1] D. J. Heeger and A. D. Jepson, "Subspace methods for recovering rigid motion I",
   IJCV 7(2), 1992. https://doi.org/10.1007/BF00128130
"""

from __future__ import annotations

from functools import cache

import numpy as np

from .poses import UPPER, lower_medians, rotations_of, solve_three
from .resection import resect

# Directions of translation that are tried first, besides the three axes: a multiple of
# four.
N_DIRECTIONS = 96
# Of those the best that are so many degrees apart, and the degrees by which their
# neighbours are, in which they are improved.
STARTS_PER_KIND, DEGREES_APART = 3, 20.0
NEIGHBOURING = (8.0, 3.0)
N_NEIGHBOURS = 8
# Gauss-Newton steps of resection.
STEPS = 3


def starting_motions(problems):
    """Rotations, translations and depths to start fits from.

    Of two kinds: from the farthest frame, which shows small motions best, and from the
    next frame, which shows large ones best.

    Parameters
    ----------
    problems : Problems

    Returns
    -------
    rotations : ndarray of shape (B, S, L - 1, 3, 3)
        In all frames but the reference.
    translations : ndarray of shape (B, S, L - 1, 3)
    depths : ndarray of shape (B, S, n)
        Inverse.
    """
    n_others = problems.x.shape[1]
    reference = problems.reference
    there = problems.weights > 0
    # Places among the frames but the reference: its successor has its own number.
    next_frame = np.minimum(reference, n_others - 1)
    far_frame = np.where(reference <= (n_others + 1) // 2, n_others - 1, 0)
    batch = np.arange(len(reference))
    parts = []
    for frame in (far_frame, next_frame):
        few = (problems.seen[batch, frame] > 0).sum(axis=1)
        few = few < np.minimum(6, there.sum(axis=1))
        frame = np.where(few, next_frame, frame)
        speed = problems.ahead / problems.ahead[batch, frame, None]  # (B, L')
        turns, directions, depths = _instantaneous(
            problems.rays[:, :2], problems.x[batch, frame], problems.seen[batch, frame]
        )
        parts.append(
            (
                rotations_of(turns[:, :, None] * speed[:, None, :, None]),
                directions[:, :, None] * speed[:, None, :, None],
                depths,
            )
        )
    rotations, translations, depths = (
        np.concatenate(part, axis=1) for part in zip(*parts, strict=True)
    )
    return *_resected(problems, rotations, translations, depths), depths


def _resected(problems, rotations, translations, depths):
    """Poses in each frame, the depths being known."""
    weights = problems.seen * problems.weights[:, None]
    found = resect(
        problems.rays[:, None, None].swapaxes(-1, -2),
        depths[:, :, None],
        problems.x[:, None].swapaxes(-1, -2),
        weights[:, None],
        (rotations, translations),
        problems.floor[:, None, None],
        STEPS,
    )
    return found[:2]


@cache
def _directions(n):
    """The axes, and n unit vectors over half a sphere, the same in a mirrored image."""
    k = np.arange(n // 4) + 0.5
    z, phi = 4 * k / n, np.pi / 2 * ((1 + np.sqrt(5)) / 2 * k % 1)
    r = np.sqrt(1 - z**2)
    quarter = np.column_stack([r * np.cos(phi), r * np.sin(phi), z])
    mirrors = np.array([(1, 1, 1), (-1, 1, 1), (1, -1, 1), (-1, -1, 1)])
    return np.vstack([np.eye(3), (mirrors[:, None] * quarter).reshape(-1, 3)])


def _around(directions, degrees):
    """Directions (B, K, 3) and their neighbours: (B, K, 1 + N, 3).

    Neighbours of a mirrored direction are the mirrored neighbours.
    """
    x, y = directions[..., 0], directions[..., 1]
    one = np.stack([y, -x, np.zeros_like(x)], axis=-1)
    length = np.linalg.norm(one, axis=-1, keepdims=True)
    one = np.where(length < 1e-6, (1.0, 0, 0), one / np.maximum(length, 1e-6))
    two = np.cross(directions, one)
    angles = 2 * np.pi * np.arange(N_NEIGHBOURS) / N_NEIGHBOURS
    aside = np.cos(angles)[:, None] * one[:, :, None]
    aside = aside + np.sin(angles)[:, None] * two[:, :, None]
    far, middle = np.radians(degrees), directions[:, :, None]
    near = np.cos(far) * middle + np.sin(far) * aside
    return np.concatenate([middle, near], axis=2)


def _best_apart(scores, directions, n):
    """Places (B, n) of the least scores (B, D) whose directions (D, 3) differ."""
    near = np.abs(directions @ directions.T) > np.cos(np.radians(DEGREES_APART))
    taken, found = np.zeros(scores.shape, dtype=int), []
    for _ in range(n):
        order = np.lexsort((scores, taken), axis=-1)
        found.append(order[:, 0])
        taken = taken + near[found[-1]]
    return np.stack(found, axis=1)


def _instantaneous(x, y, both):
    """Rotation vectors, translations (B, k, 3) and depths (B, k, n) of small motions.

    For each direction of translation the rotation of least squares, weighted robustly,
    from the flow across the direction in which the translation moves each point; the
    best few of these (Heeger and Jepson 1992).
    """
    middle, flow = (x + y) / 2, y - x  # (B, 2, n)
    equations = _equations(middle, flow)
    batch = np.arange(len(x))[:, None]
    coarse = _directions(N_DIRECTIONS)
    every = np.broadcast_to(coarse, (len(x), *coarse.shape))
    turns, scores = _turns_for(every, equations, both)
    order = _best_apart(scores, coarse, STARTS_PER_KIND)
    directions, turns = coarse[order], turns[batch, order]
    for degrees in NEIGHBOURING:
        near = _around(directions, degrees)  # (B, k, 1 + N, 3)
        every = near.reshape(len(x), -1, 3)
        turns, scores = _turns_for(every, equations, both)
        order = scores.reshape(near.shape[:3]).argmin(axis=-1)
        order = order + near.shape[2] * np.arange(near.shape[1])
        directions, turns = every[batch, order], turns[batch, order]
    return turns, *_translations(directions, turns, middle, flow, both)


def _translations(directions, turns, middle, flow, both):
    """Translations (B, k, 3) along directions, and depths whose median is one."""
    along = _moved(directions, middle)  # (B, k, 2, n)
    by_turning = np.swapaxes(_turned(middle), 1, 2)  # (B, 2, 3, n)
    rest = flow[:, None] - (turns[:, :, None, :, None] * by_turning[:, None]).sum(3)
    depths = (rest * along).sum(axis=2) / ((along**2).sum(axis=2) + 1e-4)
    both = both[:, None] > 0
    sign = np.sign(np.where(both, depths, 0).sum(axis=-1, keepdims=True))
    sign[sign == 0] = 1
    size = lower_medians(np.abs(depths), both)[..., None]
    size = np.where(np.isfinite(size), np.maximum(size, 1e-6), 1e-6)
    depths = np.where(both, sign * depths / size, 1).clip(-3, 10)
    return directions * sign * size, depths


def _equations(x, flow):
    """What the flow across a direction of translation says of the rotation.

    It is linear in the direction: (B, 3, 4 n) of three factors of the rotation and what
    they sum to, per point.
    """
    terms = np.concatenate([_turned(x), flow[:, None]], axis=1)  # (B, 4, 2, n)
    u, v = terms[:, :, 0], terms[:, :, 1]
    a, b = x[:, 0, None], x[:, 1, None]
    found = np.stack([v, -u, b * u - a * v], axis=1)  # (B, 3, 4, n)
    return found.reshape(len(x), 3, -1), x


def _turned(x):
    """Flow (B, 3, 2, n) of points (B, 2, n) by a unit of each rotation."""
    a, b = x[:, 0], x[:, 1]
    flow = [[-a * b, -(1 + b**2)], [1 + a**2, a * b], [-b, a]]
    return np.stack([np.stack(each, axis=1) for each in flow], axis=1)


def _moved(directions, x):
    """Flow (B, D, 2, n) of points (B, 2, n) of depth one by translations (B, D, 3)."""
    return directions[..., :2, None] - directions[..., 2:, None] * x[:, None]


def _turns_for(directions, equations, both):
    """Rotation vectors for directions (B, D, 3), and scores (B, D)."""
    linear, x = equations
    rows = (directions @ linear).reshape(*directions.shape[:2], 4, -1)
    along = _moved(directions, x)
    rows /= (np.sqrt(along[:, :, 0] ** 2 + along[:, :, 1] ** 2) + 1e-3)[:, :, None]
    return _robust_turns(rows, both)


def _robust_turns(rows, both, sweeps=4, floor=1e-5):
    """Rotation vectors (B, D, 3) by equations (B, D, 4, n), and median errors."""
    both = both[:, None]
    weights = np.broadcast_to(both, rows.shape[:2] + rows.shape[3:])
    turns = np.full((*rows.shape[:2], 1, 4), -1.0)
    for _ in range(sweeps):
        normal = (rows[:, :, :3] * weights[:, :, None]) @ rows.swapaxes(-1, -2)
        matrix = np.moveaxis((normal[..., :3] + 1e-9 * np.eye(3))[UPPER], -1, 0)
        found = solve_three(matrix, np.moveaxis(normal[..., 3], -1, 0))
        turns[..., 0, :3] = np.stack(found, axis=-1)
        errors = np.abs(turns @ rows)[:, :, 0]
        medians = lower_medians(errors, both > 0)
        scale = 2 * np.where(np.isfinite(medians), np.maximum(medians, floor), 1)
        weights = both / (1 + (errors / scale[..., None]) ** 2)
    return turns[..., 0, :3], medians
