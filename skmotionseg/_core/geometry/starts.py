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

from .poses import lower_medians, rotations_of
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


def starting_motions(x, problems, reference):
    """Rotations, translations and depths to start fits from.

    Of two kinds: from the farthest frame, which shows small motions best, and from the
    next frame, which shows large ones best.

    Parameters
    ----------
    x : ndarray of shape (B, n, L, 2)
        Calibrated coordinates; 0 where unseen.
    problems : Problems
    reference : int

    Returns
    -------
    rotations : ndarray of shape (B, S, L - 1, 3, 3)
        In all frames but the reference.
    translations : ndarray of shape (B, S, L - 1, 3)
    depths : ndarray of shape (B, S, n)
        Inverse.
    """
    n_frames = x.shape[2]
    next_frame = reference + 1 if reference + 1 < n_frames else reference - 1
    far_frame = n_frames - 1 if reference <= n_frames // 2 else 0
    there = problems.weights > 0
    others = np.delete(np.arange(n_frames), reference)
    seen = np.insert(problems.seen, reference, there, axis=1)  # (B, L, n)
    parts = []
    for frame in (far_frame, next_frame):
        few = (there & seen[:, frame]).sum(axis=1) < np.minimum(6, there.sum(axis=1))
        frames = np.where(few, next_frame, frame)
        some = np.arange(len(x))
        both = there & seen[some, frames]
        speed = (others - reference) / (frames - reference)[:, None]  # (B, L')
        motion = _instantaneous(x[:, :, reference], x[some, :, frames], both)
        turns, directions, depths = motion
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
    shape = (*rotations.shape[:3], depths.shape[-1])  # (B, S, L', n)
    flat = (np.prod(shape[:3]), shape[3])
    weights = problems.seen * problems.weights[:, None]
    found = resect(
        np.broadcast_to(problems.rays[:, None, None], (*shape, 3)).reshape(*flat, 3),
        np.broadcast_to(depths[:, :, None], shape).reshape(flat),
        np.broadcast_to(problems.x[:, None], (*shape, 2)).reshape(*flat, 2),
        np.broadcast_to(weights[:, None], shape).reshape(flat),
        (rotations.reshape(-1, 3, 3), translations.reshape(-1, 3)),
        np.repeat(problems.floor, shape[1] * shape[2]),
        STEPS,
    )
    return found[0].reshape(rotations.shape), found[1].reshape(translations.shape)


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
    turning, moving = _flow_matrices((x + y) / 2)
    flow = y - x
    batch = np.arange(len(x))[:, None]
    coarse = _directions(N_DIRECTIONS)
    every = np.broadcast_to(coarse, (len(x), *coarse.shape))
    turns, along, scores = _turns_for(every, turning, moving, flow, both)
    order = _best_apart(scores, coarse, STARTS_PER_KIND)
    directions, turns, along = coarse[order], turns[batch, order], along[batch, order]
    for degrees in NEIGHBOURING:
        near = _around(directions, degrees)  # (B, k, 1 + N, 3)
        every = near.reshape(len(x), -1, 3)
        turns, along, scores = _turns_for(every, turning, moving, flow, both)
        order = scores.reshape(near.shape[:3]).argmin(axis=-1)
        order = order + near.shape[2] * np.arange(near.shape[1])
        directions, turns, along = (
            each[batch, order] for each in (every, turns, along)
        )
    rest = flow[:, None] - np.einsum("bnij,bkj->bkni", turning, turns)
    depths = (rest * along).sum(axis=-1) / ((along**2).sum(axis=-1) + 1e-4)
    sign = np.sign(np.where(both[:, None], depths, 0).sum(axis=-1, keepdims=True))
    sign[sign == 0] = 1
    size = lower_medians(np.abs(depths), both[:, None])[..., None]
    size = np.where(np.isfinite(size), np.maximum(size, 1e-6), 1e-6)
    depths = np.where(both[:, None], sign * depths / size, 1).clip(-3, 10)
    return turns, directions * sign * size, depths


def _turns_for(directions, turning, moving, flow, both):
    """Rotation vectors for directions (B, D, 3), ways of points, and scores (B, D)."""
    along = np.einsum("bnij,bdj->bdni", moving, directions)  # (B, D, n, 2)
    length = np.linalg.norm(along, axis=-1) + 1e-3
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1) / length[..., None]
    rows = np.einsum("bdni,bnij->bdnj", across, turning)
    left = np.einsum("bdni,bni->bdn", across, flow)
    turns, scores = _robust_turns(rows, left, both)
    return turns, along, scores


def _robust_turns(rows, left, both, sweeps=4, floor=1e-5):
    """Rotation vectors (B, D, 3) from (B, D, n, 3) and (B, D, n), and their medians."""
    weights = np.broadcast_to(both[:, None].astype(float), left.shape)
    for _ in range(sweeps):
        weighted = (rows * weights[..., None]).swapaxes(-1, -2)
        normal = weighted @ rows + 1e-9 * np.eye(3)
        turns = np.linalg.solve(normal, weighted @ left[..., None])
        errors = np.abs(left - (rows @ turns)[..., 0])
        medians = lower_medians(errors, both[:, None])
        scale = np.where(np.isfinite(medians), np.maximum(medians, floor), 1)
        weights = both[:, None] / (1 + (errors / (2 * scale[..., None])) ** 2)
    return turns[..., 0], medians


def _flow_matrices(x):
    """Matrices (..., 2, 3) that take rotation and translation over depth to flow."""
    a, b = np.moveaxis(x, -1, 0)
    one, zero = np.ones_like(a), np.zeros_like(a)
    turning = [[-a * b, 1 + a**2, -b], [-(1 + b**2), a * b, a]]
    moving = [[one, zero, -a], [zero, one, -b]]
    return (
        np.stack([np.stack(row, axis=-1) for row in turning], axis=-2),
        np.stack([np.stack(row, axis=-1) for row in moving], axis=-2),
    )
