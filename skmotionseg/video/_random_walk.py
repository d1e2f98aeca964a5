"""Random walker with priors on the pixels of a picture."""

from __future__ import annotations

import numpy as np

from .._utils.optional import require
from ._evidence import squared_length

# Steps of conjugate gradients at most, and the residual, relative to that of zero, at
# which they stop: from the last frame's solution, a dozen suffice.
MAX_STEPS, TOLERANCE = 40, 2e-3
# Share of a pixel below which a label need not be looked for there, and pixels around
# all others within which it is.
NEGLIGIBLE, AROUND = 0.02, 24


def edge_weights(picture, strength, floor):
    """How strongly pixels are tied to their neighbours: weakly across edges.

    Parameters
    ----------
    picture : ndarray of uint8, shape (height, width, 3)
    strength : float
        Weight between pixels of one colour.
    floor : float
        Share of it that remains across the strongest edge.

    Returns
    -------
    across : ndarray of float32, shape (height, width - 1)
        Weights between pixels and their right neighbours.
    down : ndarray of float32, shape (height - 1, width)
        Weights between pixels and their lower neighbours.
    """
    cv2 = require("cv2", extra="video")
    smooth = cv2.GaussianBlur(picture, (0, 0), 0.8).astype(np.float32)
    across, down = (squared_length(np.diff(smooth, axis=axis)) for axis in (1, 0))
    contrast = across.mean() + down.mean() + 1e-6  # twice the mean square difference
    return (
        strength * (floor + np.exp(-across / contrast)),
        strength * (floor + np.exp(-down / contrast)),
    )


def random_walk(evidence, across, down, start):
    """Probability that a walk from each pixel ends at each label.

    Minimises ``sum_p c_p (u_p - q_p)^2 + sum_pq w_pq (u_p - u_q)^2`` for each label,
    where ``evidence = c q``: a sparse, positive definite, linear system, by conjugate
    gradients with the diagonal as preconditioner.

    Parameters
    ----------
    evidence : ndarray of float32, shape (n_labels, height, width)
        Strength with which each pixel is drawn to each label; not negative.
    across, down : ndarray of float32
        As of :func:`edge_weights`.
    start : ndarray of float32, shape (n_labels, height, width)
        Where to begin: the nearer to the solution, the quicker.

    Returns
    -------
    ndarray of float32, shape (n_labels, height, width)
        Adds to 1 over the labels.

    References
    ----------
    L. Grady, "Multilabel Random Walker Image Segmentation Using Prior Models", CVPR
    2005.
    """
    if len(evidence) == 1:
        return np.ones_like(evidence)
    degree = evidence.sum(axis=0)
    degree[:, :-1] += across
    degree[:, 1:] += across
    degree[:-1] += down
    degree[1:] += down
    degree += 1e-6
    # All but the label that has most: this has what the others leave.
    shares = evidence / (evidence.sum(axis=0) + 1e-9)
    most = int(shares.sum(axis=(1, 2)).argmax())
    walk = np.zeros_like(evidence)
    for label in range(len(evidence)):
        window = _window(np.maximum(shares[label], start[label]) > NEGLIGIBLE)
        if label == most or window is None:
            continue
        rows, columns = window
        walk[label, rows, columns] = _conjugate_gradients(
            evidence[label, rows, columns],
            start[label, rows, columns],
            degree[rows, columns],
            across[rows, columns.start : columns.stop - 1],
            down[rows.start : rows.stop - 1, columns],
        )
    walk[most] = 1 - walk.sum(axis=0)
    walk = walk.clip(0, 1)
    return walk / walk.sum(axis=0)


def _window(mask):
    """Slices (rows, columns) of what is around some pixels; None without any."""
    if not mask.any():
        return None
    ends = [np.flatnonzero(mask.any(axis=axis))[[0, -1]] for axis in (1, 0)]
    return tuple(
        slice(max(first - AROUND, 0), min(last + AROUND + 1, n))
        for (first, last), n in zip(ends, mask.shape, strict=True)
    )


def _conjugate_gradients(target, start, degree, across, down):
    """Solution (height, width) with this target, 0 around."""
    solution = start.copy()
    residual = target - _laplacian(solution, degree, across, down)
    scaled = residual / degree
    step = scaled.copy()
    size = np.vdot(residual, scaled)
    small = TOLERANCE**2 * np.vdot(target, target / degree) + 1e-12
    for _ in range(MAX_STEPS):
        if size < small:
            break
        moved = _laplacian(step, degree, across, down)
        length = size / (np.vdot(step, moved) + 1e-20)
        solution += length * step
        residual -= length * moved
        scaled = residual / degree
        size, last = np.vdot(residual, scaled), size
        step *= size / (last + 1e-20)
        step += scaled
    return solution


def _laplacian(values, degree, across, down):
    """Degree times values, less the weighted neighbours."""
    result = degree * values
    result[:, :-1] -= across * values[:, 1:]
    result[:, 1:] -= across * values[:, :-1]
    result[:-1] -= down * values[1:]
    result[1:] -= down * values[:-1]
    return result
