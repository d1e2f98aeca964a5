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
from .resection import resect_frames

# Directions of translation that are tried first, besides the three axes: a multiple of
# four.
N_DIRECTIONS = 96
# Of those the best that are so many degrees apart, and the degrees by which their
# neighbours are, in which they are improved.
STARTS_PER_KIND, DEGREES_APART = 3, 20.0
N_STARTS = 2 * STARTS_PER_KIND
NEIGHBOURING = (8.0, 3.0)
N_NEIGHBOURS = 8
# Least squares for the rotation of each direction, with weights by the last one.
SWEEPS = 4
# Added to normal equations of three unknowns.
REGULAR = 1e-9 * np.eye(3)
# Gauss-Newton steps of resection.
STEPS = 3


def starting_motions(problems, repeated):
    """Rotations, translations and depths to start fits from.

    Of two kinds: from the farthest frame, which shows small motions best, and from the
    next frame, which shows large ones best.

    Parameters
    ----------
    problems : Problems
    repeated : Problems
        The same, each ``N_STARTS`` times.

    Returns
    -------
    rotations : ndarray of shape (L, B * N_STARTS, 3, 3)
        In all frames but the reference.
    translations : ndarray of shape (L, B * N_STARTS, 3)
    depths : ndarray of shape (B * N_STARTS, n)
        Inverse.
    """
    parts = []
    for at in _two_frames(problems):
        speed = (problems.ahead / problems.ahead[at])[..., None]  # (L, B, 1, 1)
        turns, directions, depths = _instantaneous(
            problems.rays[:2], problems.x[:, *at], problems.seen[at]
        )
        parts.append((turns * speed, directions * speed, depths))
    turns, translations, depths = (
        np.concatenate(part, axis=-2) for part in zip(*parts, strict=True)
    )
    shape = len(turns), -1, 3
    depths = depths.reshape(*repeated.weights.shape)
    rotations, translations, _ = resect_frames(
        repeated.rays,
        depths,
        repeated.x,
        repeated.seen * repeated.weights,
        (rotations_of(turns.reshape(shape)), translations.reshape(shape)),
        repeated.floor[:, 0],
        STEPS,
    )
    return rotations, translations, depths


def _two_frames(problems):
    """A far frame of each problem, and the next; as places in (L, B).

    The last frame, or the first where the reference is past the middle.
    """
    reference, n_others = problems.reference[:, 0], len(problems.x[0])
    batch = np.arange(len(reference))
    # The frame after the reference is in its place among the others.
    following = np.minimum(reference, n_others - 1)
    far = np.where(reference <= (n_others + 1) // 2, n_others - 1, 0)
    few = np.minimum(6, (problems.weights > 0).sum(axis=1))
    for frame in (far, following):
        enough = problems.seen[frame, batch].sum(axis=1) >= few
        yield np.where(enough, frame, following), batch


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
    best few of these (Heeger and Jepson 1992). From coordinates (2, B, n).
    """
    turning, moving = _flow_matrices((x + y) / 2)
    flow = y - x
    equations = _equations(turning, moving, flow)
    batch = np.arange(len(both))[:, None]
    coarse = _directions(N_DIRECTIONS)
    every = np.broadcast_to(coarse, (len(both), *coarse.shape))
    turns, scores = _turns_for(every, equations, both)
    order = _best_apart(scores, coarse, STARTS_PER_KIND)
    directions, turns = coarse[order], turns[batch, order]
    for degrees in NEIGHBOURING:
        near = _around(directions, degrees)  # (B, k, 1 + N, 3)
        every = near.reshape(len(both), -1, 3)
        turns, scores = _turns_for(every, equations, both)
        order = scores.reshape(near.shape[:3]).argmin(axis=-1)
        order = order + near.shape[2] * np.arange(near.shape[1])
        directions, turns = every[batch, order], turns[batch, order]
    rest = flow[:, :, None] - turns @ turning.swapaxes(1, 2)  # (2, B, k, n)
    along = directions @ moving.swapaxes(1, 2)
    depths = (rest * along).sum(axis=0) / ((along**2).sum(axis=0) + 1e-4)
    return turns, *_scaled(directions, depths, both[:, None] > 0)


def _scaled(directions, depths, both):
    """Translations, and depths whose median is one and most of which are positive."""
    sign = np.sign(np.where(both, depths, 0).sum(axis=-1, keepdims=True))
    sign[sign == 0] = 1
    size = lower_medians(np.abs(depths), both)[..., None]
    size = np.where(np.isfinite(size), np.maximum(size, 1e-6), 1e-6)
    depths = np.where(both, sign * depths / size, 1).clip(-3, 10)
    return directions * sign * size, depths


def _flow_matrices(x):
    """What takes rotation, and translation over depth, to flow: (2, 3, B, n) each."""
    a, b = x
    one, zero = np.ones_like(a), np.zeros_like(a)
    return (
        np.array([[-a * b, 1 + a**2, -b], [-(1 + b**2), a * b, a]]),
        np.array([[one, zero, -a], [zero, one, -b]]),
    )


def _equations(turning, moving, flow):
    """What directions are to be multiplied by: (6, B, 3, n).

    For three factors of the rotation, for what they sum to by the flow across the
    direction in which a point is moved, and for the two coordinates of that direction.
    """
    u, v = np.concatenate([turning, flow[:, None]], axis=1)[:, :, None]  # (4, 1, B, n)
    equations = np.concatenate([moving[0] * v - moving[1] * u, moving])
    return equations.swapaxes(1, 2)


def _turns_for(directions, equations, both):
    """Rotation vectors for directions (B, D, 3), and scores (B, D)."""
    rows = directions @ equations  # (6, B, D, n)
    rows, along = rows[:4], rows[4:]
    rows /= np.sqrt(along[0] ** 2 + along[1] ** 2) + 1e-3
    return _robust_turns(rows, both[:, None])


def _robust_turns(rows, both, floor=1e-5):
    """Rotation vectors (B, D, 3) from equations (4, B, D, n), and median errors."""
    matrices = rows.transpose(1, 2, 0, 3)  # (B, D, 4, n)
    counted, weights = both > 0, both  # (B, 1, n)
    turns = np.full((*rows.shape[1:3], 1, 4), -1.0)
    for _ in range(SWEEPS):
        weighted = (rows[:3] * weights).transpose(1, 2, 0, 3)
        normal = weighted @ matrices.swapaxes(-1, -2)  # (B, D, 3, 4)
        matrix = (normal[..., :3] + REGULAR)[UPPER].transpose(2, 0, 1)
        found = solve_three(matrix, normal[..., 3].transpose(2, 0, 1))
        for axis, values in enumerate(found):
            turns[..., 0, axis] = values
        errors = np.abs((turns @ matrices)[..., 0, :])
        medians = lower_medians(errors, counted)
        scale = 2 * np.where(np.isfinite(medians), np.maximum(medians, floor), 1)
        weights = both / (1 + (errors / scale[..., None]) ** 2)
    return turns[..., 0, :3], medians
