"""Rigid motion of groups of tracks before a calibrated camera, over several frames.

A group moves by a rotation and a translation per frame, and each of its tracks has one
free number: its inverse depth in the reference frame. All problems of a batch, one per
group and window of frames, are solved at a time. Poses start as in :mod:`.starts` and
are refined by Levenberg-Marquardt with the depths eliminated (Triggs et al. [1]_, sec.
6), under a Student-t cost of each track's residuals, so that a track counts less the
worse it fits.

Coordinates are calibrated: pixels from the principal point over the focal length.

References
----------
.. [1] B. Triggs, P. McLauchlan, R. Hartley and A. Fitzgibbon, "Bundle adjustment: a
   modern synthesis", 1999. https://doi.org/10.1007/3-540-44480-7_21
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .poses import Poses, kept_away, lower_medians, relative_to, rotations_of
from .starts import starting_motions

# Iterations from each start and from the best.
FIRST_ITERATIONS, LAST_ITERATIONS = 4, 8
# Nats: a step that changes the cost by less is the last.
CONVERGED = 0.01
# Degrees of freedom of the Student-t distribution of a track's residuals.
FREEDOM = 3.0
# A standard deviation over the median of residuals is about this.
SCALE_OF_MEDIAN = 1.2


class Problems(NamedTuple):
    """Observations of a batch, frames before tracks."""

    x: np.ndarray  # (B, L, n, 2), in all frames but the reference
    seen: np.ndarray  # (B, L, n)
    rays: np.ndarray  # (B, n, 3), in the reference frame
    weights: np.ndarray  # (B, n), 0 for tracks that do not count
    floor: np.ndarray  # (B,), least scale of residuals
    counted: np.ndarray  # (B, n), whether a track has a weight and a residual
    freedom: np.ndarray  # (B, n), residuals per track, less its depth

    def repeated(self, times):
        return Problems(*(np.repeat(each, times, axis=0) for each in self))


class _State(NamedTuple):
    """Poses and depths of a batch, and what they leave."""

    rotations: np.ndarray  # (B, L, 3, 3)
    translations: np.ndarray  # (B, L, 3)
    depths: np.ndarray  # (B, n), inverse
    image: np.ndarray  # (B, L, n, 2)
    turned: np.ndarray  # (B, L, n, 3), rays in the other frames
    distance: np.ndarray  # (B, L, n), along the optical axis
    residuals: np.ndarray  # (B, L, n, 2)
    squares: np.ndarray  # (B, n), summed over the frames

    def chosen(self, other, better):
        """Of each problem the other state where it is better."""
        if better.all():
            return other
        return _State(
            *(
                np.where(better.reshape(-1, *(1,) * (new.ndim - 1)), new, old)
                for old, new in zip(self, other, strict=True)
            )
        )

    def of(self, some):
        """Of some of the problems."""
        return _State(*(each[some] for each in self))


def fit_rigid_motions(x, seen, weights, floor, reference):
    """Fit the poses of groups of tracks, from several starts.

    Parameters
    ----------
    x : ndarray of shape (B, n, L, 2)
        Calibrated coordinates; 0 where unseen.
    seen : ndarray of bool, shape (B, n, L)
    weights : ndarray of shape (B, n)
        0 for tracks that do not count.
    floor : ndarray of shape (B,)
        Least standard deviation of the residuals, in calibrated coordinates.
    reference : int
        Frame in which depths are measured; its pose is the identity.

    Returns
    -------
    Poses
    """
    problems = _problems(x, seen, weights, floor, reference)
    starts = starting_motions(x, problems, reference)
    times = starts[2].shape[1]
    repeated = problems.repeated(times)
    state = _state(repeated, *(each.reshape(-1, *each.shape[2:]) for each in starts))
    state = _minimise(repeated, state, FIRST_ITERATIONS)
    # Compared at one scale per problem, the least of its starts'.
    scale = _scale(repeated, state).reshape(-1, times).min(axis=1)
    costs = _cost(repeated, state, np.repeat(scale, times)).reshape(-1, times)
    best = np.arange(len(x)) * times + costs.argmin(axis=1)
    return _poses(_minimise(problems, state.of(best), LAST_ITERATIONS), reference)


def refine_rigid_motions(
    x, seen, weights, floor, reference, poses, iterations=LAST_ITERATIONS
):
    """Fit as :func:`fit_rigid_motions`, from given poses.

    Returns
    -------
    poses : Poses
    costs : ndarray of shape (B,)
        By which starts for the same tracks compare.
    """
    problems = _problems(x, seen, weights, floor, reference)
    others = np.delete(np.arange(x.shape[2]), reference)
    poses = relative_to(poses, reference)
    rotations, translations = (each[:, others] for each in poses)
    depths = _depths(problems, rotations, translations)
    state = _state(problems, rotations, translations, depths)
    state = _minimise(problems, state, iterations)
    return _poses(state, reference), _cost(problems, state, problems.floor)


def squared_residuals(x, seen, poses):
    """Squared residuals of tracks from motions, each at its best ray and depth.

    Parameters
    ----------
    x : ndarray of shape (n, L, 2)
        Calibrated coordinates; 0 where unseen.
    seen : ndarray of bool, shape (n, L)
    poses : Poses
        Of B motions.

    Returns
    -------
    ndarray of shape (B, n)
        Summed over frames and coordinates. A linear fit and one Gauss-Newton step.
    """
    x = np.ascontiguousarray(x.transpose(1, 2, 0))  # (L, 2, n)
    seen = np.ascontiguousarray(seen.T.astype(float))  # (L, n)
    rotations, translations = poses
    # A point (a, b, 1) / c of the reference frame is at M (a, b, c) + r in another.
    M = np.concatenate([rotations[..., :2], translations[..., None]], axis=-1)
    r = rotations[..., 2]  # (B, L, 3)
    observed = x * seen[:, None]
    jacobian = (
        observed[:, :, None] * M[:, :, None, 2, :, None]
        - M[:, :, :2, :, None] * seen[:, None, None]
    )  # (B, L, 2, 3, n)
    left = r[:, :, :2, None] * seen[:, None] - observed * r[:, :, None, 2:]
    points = _solve_points(jacobian, left, 1e-11)
    image, distance, residuals = _image_of(points, M, r, x, seen)
    squares = (residuals**2).sum(axis=(1, 2))
    jacobian = M[:, :, :2, :, None] - image[:, :, :, None] * M[:, :, 2:, :, None]
    jacobian *= (seen / distance)[:, :, None, None]
    points = points + _solve_points(jacobian, residuals, 1e-9)
    return np.minimum(
        squares, (_image_of(points, M, r, x, seen)[2] ** 2).sum(axis=(1, 2))
    )


def _image_of(points, M, r, x, seen):
    """Images (B, L, 2, n), distances (B, L, n) and residuals of points (B, 3, n)."""
    p = M @ points[:, None] + r[..., None]  # (B, L, 3, n)
    distance = kept_away(p[:, :, 2])
    image = p[:, :, :2] / distance[:, :, None]
    return image, distance, (x - image) * seen[:, None]


def _solve_points(jacobian, left, damping):
    """Least squares for (B, 3, n) from (B, L, 2, 3, n) and (B, L, 2, n), in closed
    form: many systems of three unknowns."""
    rows = jacobian.reshape(len(jacobian), -1, *jacobian.shape[3:])  # (B, 2 L, 3, n)
    left = left.reshape(len(left), -1, left.shape[-1])
    a, b, c, d, e, f = (
        (rows[:, :, i] * rows[:, :, j]).sum(axis=1)
        for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    )
    g = (rows * left[:, :, None]).sum(axis=1)  # (B, 3, n)
    more = damping * (a + d + f) + 1e-14
    a, d, f = a + more, d + more, f + more
    minors = np.array(
        [
            [d * f - e * e, c * e - b * f, b * e - c * d],
            [c * e - b * f, a * f - c * c, b * c - a * e],
            [b * e - c * d, b * c - a * e, a * d - b * b],
        ]
    )  # (3, 3, B, n)
    determinant = a * minors[0, 0] + b * minors[0, 1] + c * minors[0, 2]
    determinant = np.maximum(determinant, np.finfo(float).tiny)
    return np.einsum("ijbn,bjn->bin", minors, g) / determinant[:, None]


def _problems(x, seen, weights, floor, reference):
    others = np.delete(np.arange(x.shape[2]), reference)
    rays = np.concatenate([x[:, :, reference], np.ones((*x.shape[:2], 1))], axis=-1)
    there = seen[:, :, reference] & (weights > 0)
    seen = (seen[:, :, others] & there[..., None]).swapaxes(1, 2)
    times_seen = seen.sum(axis=1)
    return Problems(
        x=x[:, :, others].swapaxes(1, 2),
        seen=seen,
        rays=rays,
        weights=weights * there,
        floor=floor,
        counted=there & (times_seen > 0),
        freedom=np.maximum(2 * times_seen - 1, 1),
    )


def _poses(state, reference):
    """Poses in all frames, the reference one too."""
    return Poses(
        np.insert(state.rotations, reference, np.eye(3), axis=1),
        np.insert(state.translations, reference, 0, axis=1),
    )


def _state(problems, rotations, translations, depths):
    turned = problems.rays[:, None] @ rotations.swapaxes(-1, -2)  # (B, L, n, 3)
    points = turned + depths[:, None, :, None] * translations[:, :, None]
    distance = kept_away(points[..., 2])
    image = points[..., :2] / distance[..., None]
    residuals = np.where(problems.seen[..., None], problems.x - image, 0)
    squares = (residuals**2).sum(axis=(1, 3))
    return _State(
        rotations, translations, depths, image, turned, distance, residuals, squares
    )


def _scale(problems, state):
    """Robust standard deviation of the residuals, at least the floor: (B,)."""
    medians = lower_medians(state.squares / problems.freedom, problems.counted)
    medians = np.where(np.isfinite(medians), medians, 0)
    return np.maximum(problems.floor, SCALE_OF_MEDIAN * np.sqrt(medians))


def _cost(problems, state, scale):
    """Student-t cost of the residuals of all tracks, in nats: (B,)."""
    unit = FREEDOM * scale[:, None] ** 2
    costs = (FREEDOM + problems.freedom) * np.log1p(state.squares / unit)
    return (problems.weights * costs).sum(axis=1)


def _minimise(problems, state, iterations):
    """Levenberg-Marquardt, until a step changes little; the scale of the residuals
    follows."""
    damping = np.full(len(problems.x), 1e-2)
    converged = np.zeros(len(problems.x), dtype=bool)
    scale = _scale(problems, state)
    for _ in range(iterations):
        change = -_cost(problems, state, scale)
        new = _stepped(problems, state, scale, damping)
        change += _cost(problems, new, scale)
        better = change < 0
        damping = np.clip(np.where(better, 0.2 * damping, 8 * damping), 1e-9, 1e6)
        state = state.chosen(new, better & ~converged)
        converged |= np.abs(change) < CONVERGED
        if converged.all():
            break
        scale = _scale(problems, state)
    return state


def _stepped(problems, state, scale, damping):
    """The state after one damped Gauss-Newton step, the depths eliminated."""
    B, L, n = problems.seen.shape
    spread = FREEDOM * scale[:, None] ** 2 + state.squares
    weights = problems.weights * (FREEDOM + problems.freedom) / spread  # (B, n)
    poses, depths = _jacobians(problems, state)  # (B, L, 6, 2, n), (B, L, 2, n)
    left = state.residuals.swapaxes(2, 3)  # (B, L, 2, n)
    weighted = poses * weights[:, None, None, None]
    flat = weighted.reshape(B, L, 6, 2 * n)
    normal = flat @ poses.reshape(B, L, 6, 2 * n).swapaxes(-1, -2)  # (B, L, 6, 6)
    right = (flat @ left.reshape(B, L, 2 * n, 1)).reshape(B, 6 * L)
    mixed = (weighted * depths[:, :, None]).sum(axis=3).reshape(B, 6 * L, n)
    of_depths = (weights[:, None, None] * depths**2).sum(axis=(1, 2))  # (B, n)
    right_depths = (weights[:, None, None] * depths * left).sum(axis=(1, 2))
    of_depths = of_depths * (1 + damping[:, None])
    of_depths += 1e-9 * of_depths.max(axis=1, keepdims=True) + 1e-30
    shares = mixed / of_depths[:, None]
    reduced = _damped_blocks(normal, damping) - shares @ mixed.swapaxes(-1, -2)
    right = right - (shares @ right_depths[..., None])[..., 0]
    change = np.linalg.solve(reduced, right[..., None])[..., 0]  # (B, 6 L)
    change_depths = (right_depths - (change[:, None] @ mixed)[:, 0]) / of_depths
    change = change.reshape(B, L, 6)
    return _state(
        problems,
        rotations_of(change[..., :3]) @ state.rotations,
        state.translations + change[..., 3:],
        state.depths + change_depths,
    )


def _damped_blocks(normal, damping):
    """Block-diagonal matrices (B, 6 L, 6 L) of damped blocks (B, L, 6, 6)."""
    B, L = normal.shape[:2]
    diagonal = np.einsum("blii->bli", normal)
    more = damping[:, None, None] * diagonal
    more = more + 1e-7 * diagonal.mean(axis=(1, 2), keepdims=True) + 1e-30
    blocks = np.zeros((B, L, 6, L, 6))
    frames = np.arange(L)
    blocks[:, frames, :, frames] = (normal + more[..., None] * np.eye(6)).swapaxes(0, 1)
    return blocks.reshape(B, 6 * L, 6 * L)


def _jacobians(problems, state):
    """Derivatives of images by poses, (B, L, 6, 2, n), and by depths, (B, L, 2, n)."""
    u, v = state.image[..., 0], state.image[..., 1]
    a, b, c = (state.turned[..., i] for i in range(3))
    inverse = np.where(problems.seen, 1 / state.distance, 0)
    moved = state.depths[:, None] * inverse
    poses = np.zeros((*u.shape[:2], 6, 2, u.shape[2]))
    poses[:, :, 0, 0], poses[:, :, 0, 1] = -u * b * inverse, -(c + v * b) * inverse
    poses[:, :, 1, 0], poses[:, :, 1, 1] = (c + u * a) * inverse, v * a * inverse
    poses[:, :, 2, 0], poses[:, :, 2, 1] = -b * inverse, a * inverse
    poses[:, :, 3, 0] = poses[:, :, 4, 1] = moved
    poses[:, :, 5, 0], poses[:, :, 5, 1] = -u * moved, -v * moved
    t = state.translations[..., None]  # (B, L, 3, 1)
    depths = (t[:, :, :2] - state.image.swapaxes(2, 3) * t[:, :, 2:]) * inverse[
        :, :, None
    ]
    return poses, depths


def _depths(problems, rotations, translations):
    """Inverse depths (B, n) of least algebraic error for given poses."""
    turned = problems.rays[:, None] @ rotations.swapaxes(-1, -2)
    t = translations[:, :, None]
    seen = problems.seen[..., None]
    slope = (problems.x * t[..., 2:] - t[..., :2]) * seen
    left = (turned[..., :2] - problems.x * turned[..., 2:]) * seen
    top, bottom = (slope * left).sum(axis=(1, 3)), (slope**2).sum(axis=(1, 3))
    return top / (bottom + 1e-12)
