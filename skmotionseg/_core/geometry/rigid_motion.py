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

from .poses import (
    Poses,
    image_derivatives,
    kept_away,
    lower_medians,
    relative_to,
    rotations_of,
    solve_three,
)
from .starts import starting_motions

# Iterations from each start and from the best.
FIRST_ITERATIONS, LAST_ITERATIONS = 4, 8
# Nats: a step that changes the cost by less is the last.
CONVERGED = 0.01
# Degrees of freedom of the Student-t distribution of a track's residuals.
FREEDOM = 3.0
# A standard deviation over the median of residuals is about this.
SCALE_OF_MEDIAN = 1.2
# Tracks times motions whose residuals are found at a time.
SIZE_OF_BLOCK = 4096
# Columns whose products are the normal equations of three unknowns: six of the matrix,
# and three of what is on the right.
PAIRS = np.array([[0, 0, 0, 1, 1, 2, 0, 1, 2], [0, 1, 2, 1, 2, 2, 3, 3, 3]])


class Problems(NamedTuple):
    """Observations of a batch, in all frames but the reference; points are last."""

    x: np.ndarray  # (B, L, 2, n)
    seen: np.ndarray  # (B, L, n), 0 or 1
    rays: np.ndarray  # (B, 3, n), in the reference frame
    weights: np.ndarray  # (B, n), 0 for tracks that do not count
    floor: np.ndarray  # (B,), least scale of residuals
    counted: np.ndarray  # (B, n), whether a track has a weight and a residual
    freedom: np.ndarray  # (B, n), residuals per track, less its depth
    reference: np.ndarray  # (B,), frame in which depths are measured
    ahead: np.ndarray  # (B, L), frames from the reference to each

    def of(self, some):
        """Some of the problems, or all of them some times over."""
        return Problems(*(each[some] for each in self))


class _State(NamedTuple):
    """Poses and depths of a batch, and what they leave."""

    rotations: np.ndarray  # (B, L, 3, 3)
    translations: np.ndarray  # (B, L, 3)
    depths: np.ndarray  # (B, n), inverse
    image: np.ndarray  # (B, L, 2, n)
    turned: np.ndarray  # (B, L, 3, n), rays in the other frames
    distance: np.ndarray  # (B, L, n), along the optical axis
    residuals: np.ndarray  # (B, L, 2, n)
    squares: np.ndarray  # (B, n), summed over the frames

    def replace(self, some, other):
        """Replace the states of some problems, in place."""
        for old, new in zip(self, other, strict=True):
            old[some] = new

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
    reference : int or ndarray of shape (B,)
        Frame in which depths are measured; its pose is the identity.

    Returns
    -------
    Poses
    """
    problems = observed(x, seen, weights, floor, reference)
    starts = starting_motions(problems)
    times = starts[2].shape[1]
    repeated = problems.of(np.repeat(np.arange(len(x)), times))
    state = _state(repeated, *(each.reshape(-1, *each.shape[2:]) for each in starts))
    state = _minimise(repeated, state, FIRST_ITERATIONS)
    # Compared at one scale per problem, the least of its starts'.
    scale = _scale(repeated, state).reshape(-1, times).min(axis=1)
    costs = _cost(repeated, state, np.repeat(scale, times)).reshape(-1, times)
    best = np.arange(len(x)) * times + costs.argmin(axis=1)
    return _poses(problems, _minimise(problems, state.of(best), LAST_ITERATIONS))


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
    problems = observed(x, seen, weights, floor, reference)
    poses = relative_to(poses, problems.reference)
    others = problems.reference[:, None] + problems.ahead
    rotations, translations = (
        each[np.arange(len(x))[:, None], others] for each in poses
    )
    depths = _depths(problems, rotations, translations)
    state = _state(problems, rotations, translations, depths)
    state = _minimise(problems, state, iterations)
    return _poses(problems, state), _cost(problems, state, problems.floor)


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
    x, seen = x.transpose(1, 2, 0), seen.T.astype(float)  # (L, 2, n), (L, n)
    rotations, translations = poses
    # A point (a, b, 1) / c of the reference frame is at P (a, b, c, 1) in another.
    P = np.concatenate(
        [rotations[..., :2], translations[..., None], rotations[..., 2:]], axis=-1
    )  # (B, L, 3, 4)
    n = seen.shape[1]
    size = max(1, SIZE_OF_BLOCK // len(P))
    blocks = [
        _squares_of(P, x[..., k : k + size], seen[:, k : k + size])
        for k in range(0, n, size)
    ]
    return np.concatenate(blocks, axis=1) if blocks else np.zeros((len(P), 0))


def _squares_of(P, x, seen):
    """Squared residuals (B, n) of some tracks, (L, 2, n) and (L, n)."""
    equations = _equations(P, x, seen)
    points = _solve_points(equations, -equations[:, 6:], 1e-11)
    image, distance, residuals = _image_of(points, P, x, seen)
    squares = (residuals**2).sum(axis=(1, 2))
    near = seen / distance
    residuals *= near[:, :, None]
    across = (image * residuals).sum(axis=2)  # (B, L, n)
    left = np.concatenate([residuals, -across[:, :, None]], axis=2)  # (B, L, 3, n)
    right = _flat(P[..., :3]).swapaxes(-1, -2) @ _flat(left)
    points += _solve_points(_equations(P[..., :3], image, near**2), right, 1e-9)
    residuals = _image_of(points, P, x, seen)[2]
    return np.minimum(squares, (residuals**2).sum(axis=(1, 2)))


def _equations(P, image, weights):
    """Normal equations of least squares of ``(u P_2 - P_0) p`` and ``(v P_2 - P_1) p``.

    Products of two columns of these, weighted and summed over frames, are linear in
    the products of P: (B, 6, n) or, of a fourth column, (B, 9, n).
    """
    pairs = PAIRS if P.shape[-1] == 4 else PAIRS[:, :6]
    (a, b, c), (d, e, f) = np.moveaxis(P[..., pairs], (3, 2), (0, 1))  # (B, L, 9) each
    factors = np.stack([a * d + b * e, -a * f - c * d, -b * f - c * e, c * f], axis=2)
    u, v = image[..., 0, :], image[..., 1, :]
    # Per frame and point: (..., L, 4, n).
    terms = np.stack([weights, weights * u, weights * v, weights * (u**2 + v**2)], -2)
    return _flat(factors).swapaxes(-1, -2) @ _flat(terms)


def _flat(values):
    """Two axes before the last as one."""
    return values.reshape(*values.shape[:-3], -1, values.shape[-1])


def _image_of(points, P, x, seen):
    """Images (B, L, 2, n), distances (B, L, n) and residuals of points (B, 3, n)."""
    p = _flat(P[..., :3]) @ points
    p = p.reshape(*P.shape[:3], -1) + P[..., 3:]
    distance = kept_away(p[:, :, 2])
    image = p[:, :, :2] / distance[:, :, None]
    return image, distance, (x - image) * seen[:, None]


def _solve_points(matrix, right, damping):
    """Damped least squares for (B, 3, n)."""
    a, b, c, d, e, f = np.moveaxis(matrix[:, :6], 1, 0)
    more = damping * (a + d + f) + 1e-14
    matrix = a + more, b, c, d + more, e, f + more
    return np.stack(solve_three(matrix, np.moveaxis(right, 1, 0)), axis=1)


def observed(x, seen, weights, floor, reference):
    """The :class:`Problems` of the arguments of :func:`fit_rigid_motions`."""
    B, n, L = seen.shape
    batch = np.arange(B)
    reference = np.broadcast_to(reference, B)
    others = np.arange(L - 1) + (np.arange(L - 1) >= reference[:, None])  # (B, L - 1)
    there = seen[batch, :, reference] & (weights > 0)
    seen = seen.swapaxes(1, 2)[batch[:, None], others] & there[:, None]
    x = x.transpose(0, 2, 3, 1)
    rays = np.concatenate([x[batch, reference], np.ones((B, 1, n))], axis=1)
    times_seen = seen.sum(axis=1)
    return Problems(
        x=x[batch[:, None], others],
        seen=seen.astype(float),
        rays=rays,
        weights=weights * there,
        floor=floor,
        counted=there & (times_seen > 0),
        freedom=np.maximum(2 * times_seen - 1, 1),
        reference=reference,
        ahead=others - reference[:, None],
    )


def _poses(problems, state):
    """Poses in all frames, the reference one too."""
    B, L = problems.ahead.shape
    rotations = np.tile(np.eye(3), (B, L + 1, 1, 1))
    translations = np.zeros((B, L + 1, 3))
    places = np.arange(B)[:, None], problems.reference[:, None] + problems.ahead
    rotations[places], translations[places] = state.rotations, state.translations
    return Poses(rotations, translations)


def _state(problems, rotations, translations, depths):
    turned = rotations @ problems.rays[:, None]  # (B, L, 3, n)
    points = turned + depths[:, None, None] * translations[..., None]
    distance = kept_away(points[:, :, 2])
    image = points[:, :, :2] / distance[:, :, None]
    residuals = (problems.x - image) * problems.seen[:, :, None]
    squares = (residuals**2).sum(axis=(1, 2))
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
    follows. Problems that have converged are left out of further steps."""
    found = _State(*map(np.array, state))
    left = np.arange(len(problems.x))
    damping = np.full(len(left), 1e-2)
    for _ in range(iterations):
        scale = _scale(problems, state)
        change = -_cost(problems, state, scale)
        new = _stepped(problems, state, scale, damping)
        change += _cost(problems, new, scale)
        better = change < 0
        damping = np.clip(np.where(better, 0.2 * damping, 8 * damping), 1e-9, 1e6)
        found.replace(left[better], new.of(better))
        going = np.abs(change) >= CONVERGED
        if not going.any():
            break
        left, damping, problems = left[going], damping[going], problems.of(going)
        state = found.of(left)
    return found


def _stepped(problems, state, scale, damping):
    """The state after one damped Gauss-Newton step, the depths eliminated."""
    B, L, n = problems.seen.shape
    spread = FREEDOM * scale[:, None] ** 2 + state.squares
    root = np.sqrt(problems.weights * (FREEDOM + problems.freedom) / spread)  # (B, n)
    left = (state.residuals * root[:, None, None]).reshape(B, L, 2 * n, 1)
    poses, depths = _jacobians(problems, state, root)  # (B, L, 6, 2, n), (B, L, 2, n)
    mixed = (poses * depths[:, :, None]).sum(axis=3).reshape(B, 6 * L, n)
    of_depths = (depths**2).sum(axis=(1, 2))  # (B, n)
    right_depths = (depths * left.reshape(B, L, 2, n)).sum(axis=(1, 2))
    of_depths = of_depths * (1 + damping[:, None])
    of_depths += 1e-9 * of_depths.max(axis=1, keepdims=True) + 1e-30
    shares = mixed / of_depths[:, None]
    poses = poses.reshape(B, L, 6, 2 * n)
    normal = poses @ poses.swapaxes(-1, -2)  # (B, L, 6, 6)
    reduced = _damped_blocks(normal, damping) - shares @ mixed.swapaxes(-1, -2)
    right = (poses @ left).reshape(B, 6 * L, 1) - shares @ right_depths[..., None]
    change = np.linalg.solve(reduced, right)[..., 0]  # (B, 6 L)
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
    diagonal = np.diagonal(normal, axis1=2, axis2=3)
    more = damping[:, None, None] * diagonal
    more = more + 1e-7 * diagonal.mean(axis=(1, 2), keepdims=True) + 1e-30
    blocks = np.zeros((B, L, 6, L, 6))
    frames = np.arange(L)
    blocks[:, frames, :, frames] = (normal + more[..., None] * np.eye(6)).swapaxes(0, 1)
    return blocks.reshape(B, 6 * L, 6 * L)


def _jacobians(problems, state, root):
    """Derivatives of images by poses, (B, L, 6, 2, n), and by depths, (B, L, 2, n),
    times a root of a weight per track."""
    factor = problems.seen * root[:, None] / state.distance
    depths = state.depths[:, None]
    poses = image_derivatives(state.image, state.turned, depths, factor)
    t = state.translations[..., None]  # (B, L, 3, 1)
    moved = (t[:, :, :2] - state.image * t[:, :, 2:]) * factor[:, :, None]
    return poses, moved


def _depths(problems, rotations, translations):
    """Inverse depths (B, n) of least algebraic error for given poses."""
    turned = rotations @ problems.rays[:, None]  # (B, L, 3, n)
    t = translations[..., None]
    seen = problems.seen[:, :, None]
    slope = (problems.x * t[:, :, 2:] - t[:, :, :2]) * seen
    left = (turned[:, :, :2] - problems.x * turned[:, :, 2:]) * seen
    top, bottom = (slope * left).sum(axis=(1, 2)), (slope**2).sum(axis=(1, 2))
    return top / (bottom + 1e-12)
