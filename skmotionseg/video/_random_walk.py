"""Random walker with priors on the pixels of a picture."""

from __future__ import annotations

import numpy as np

from .._utils.optional import require
from ._evidence import squared_length

# Steps of conjugate gradients at most, and the residual, relative to that of zero, at
# which they stop: from the last frame's solution, a dozen suffice.
MAX_STEPS, TOLERANCE = 40, 2e-3


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
    # All but the first label: what is left is the first's.
    solved = _conjugate_gradients(evidence[1:], start[1:], degree, across, down)
    walk = np.concatenate([1 - solved.sum(axis=0, keepdims=True), solved]).clip(0, 1)
    return walk / walk.sum(axis=0)


def _conjugate_gradients(target, start, degree, across, down):
    solution = start.astype(np.float32)
    residual = target - _laplacian(solution, degree, across, down)
    scaled = residual / degree
    step = scaled.copy()
    size = _products(residual, scaled)
    small = TOLERANCE**2 * _products(target, target / degree) + 1e-12
    for _ in range(MAX_STEPS):
        if (size < small).all():
            break
        moved = _laplacian(step, degree, across, down)
        length = (size / (_products(step, moved) + 1e-20))[:, None, None]
        solution += length * step
        residual -= length * moved
        scaled = residual / degree
        size, last = _products(residual, scaled), size
        step *= (size / (last + 1e-20))[:, None, None]
        step += scaled
    return solution


def _laplacian(values, degree, across, down):
    """Degree times values, less the weighted neighbours, for stacks of pictures.

    One picture at a time, which stays in the processor's cache.
    """
    result = np.empty_like(values)
    wide, high = np.empty_like(across), np.empty_like(down)
    for value, out in zip(values, result, strict=True):
        np.multiply(degree, value, out=out)
        out[:, :-1] -= np.multiply(across, value[:, 1:], out=wide)
        out[:, 1:] -= np.multiply(across, value[:, :-1], out=wide)
        out[:-1] -= np.multiply(down, value[1:], out=high)
        out[1:] -= np.multiply(down, value[:-1], out=high)
    return result


def _products(first, second):
    """Inner product of each pair of pictures: (n,)."""
    return np.einsum("mhw,mhw->m", first, second)
