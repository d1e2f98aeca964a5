"""Rigid motion of groups of tracks before a calibrated camera, over several frames.

A group moves by a rotation and a translation per frame, and each of its tracks has one
free number: its inverse depth in the reference frame. It is not negative, as nothing
behind a camera is seen: without that, depths of a small group explain what a wrong
motion leaves. All problems of a batch, one per group and window of frames, are solved
at a time. Poses start as in :mod:`.starts` and are refined by Levenberg-Marquardt with
the depths eliminated (Triggs et al. [1]_, sec. 6), under a Student-t cost of each
track's residuals, so that a track counts less the worse it fits.

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
    images_of,
    kept_away,
    lower_medians,
    normal_equations,
    relative_to,
    rotations_of,
    solve_three,
)
from .starts import N_STARTS, starting_motions

# Iterations from each start and from the best.
FIRST_ITERATIONS, LAST_ITERATIONS = 4, 8
# Nats: a step that changes the cost by less is the last.
CONVERGED = 0.1
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
    """Observations of a batch, in all frames but the reference."""

    x: np.ndarray  # (2, L, B, n)
    seen: np.ndarray  # (L, B, n), 0 or 1
    rays: np.ndarray  # (3, B, n), in the reference frame
    weights: np.ndarray  # (B, n), 0 for tracks that do not count
    counted: np.ndarray  # (B, n), whether a track has a weight and a residual
    freedom: np.ndarray  # (B, n), residuals per track, less its depth
    floor: np.ndarray  # (B, 1), least scale of residuals
    reference: np.ndarray  # (B, 1), frame in which depths are measured
    ahead: np.ndarray  # (L, B, 1), frames from the reference to each

    def of(self, some):
        """Some of the problems, or all of them some times over."""
        return Problems(*(each.take(some, axis=-2) for each in self))


class _State(NamedTuple):
    """Poses and depths of a batch, and what they leave."""

    rotations: np.ndarray  # (L, B, 3, 3)
    translations: np.ndarray  # (L, B, 3)
    depths: np.ndarray  # (B, n), inverse
    image: np.ndarray  # (2, L, B, n)
    turned: np.ndarray  # (3, L, B, n), rays in the other frames
    distance: np.ndarray  # (L, B, n), along the optical axis
    residuals: np.ndarray  # (2, L, B, n)
    squares: np.ndarray  # (B, n), summed over the frames

    def of(self, some):
        """Of some of the problems."""
        found = zip(self, _AXES_OF_PROBLEMS, strict=True)
        return _State(*(each.take(some, axis=axis) for each, axis in found))

    def replace(self, some, other):
        """Replace the states of some problems, in place."""
        for old, new, axis in zip(self, other, _AXES_OF_PROBLEMS, strict=True):
            old.swapaxes(0, axis)[some] = new.swapaxes(0, axis)


# Of the parts of a state.
_AXES_OF_PROBLEMS = 1, 1, *[-2] * 6


def fit_rigid_motions(x, seen, weights, floor, reference, most_started=None):
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
    most_started : int, optional
        Tracks by which the best of the starts is found, which takes most of the time;
        the motion is then fitted to all. By default, the best is found by all, too.

    Returns
    -------
    Poses
    """
    problems = observed(x, seen, weights, floor, reference)
    if most_started is None or most_started >= seen.shape[1]:
        start = _best_started(problems)
    else:
        at = _some_counted(weights, most_started)
        some = observed(x[at], seen[at], weights[at], floor, reference)
        start = _state_of(problems, _poses(some, _best_started(some)))
    return _poses(problems, _minimise(problems, start, LAST_ITERATIONS))


def _best_started(problems):
    """The best state of each problem after a few iterations from several starts."""
    n_problems = len(problems.weights)
    repeated = problems.of(np.repeat(np.arange(n_problems), N_STARTS))
    state = _in_front(repeated, *starting_motions(problems, repeated))
    state = _minimise(repeated, state, FIRST_ITERATIONS)
    # Compared at one scale per problem, the least of its starts'.
    scale = _scale(repeated, state).reshape(-1, N_STARTS).min(axis=1)
    costs = _cost(repeated, state, np.repeat(scale, N_STARTS)[:, None])
    best = costs.reshape(-1, N_STARTS).argmin(axis=1)
    return state.of(best + N_STARTS * np.arange(n_problems))


def _some_counted(weights, most):
    """Places of so many tracks of each problem, evenly among those that count."""
    order = np.argsort(weights <= 0, axis=1, kind="stable")
    n_counted = np.maximum((weights > 0).sum(axis=1), most)
    places = np.arange(most) * n_counted[:, None] // most
    return np.arange(len(weights))[:, None], np.take_along_axis(order, places, axis=1)


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
    state = _minimise(problems, _state_of(problems, poses), iterations)
    return _poses(problems, state), _cost(problems, state, problems.floor)


def squared_residuals(x, seen, poses):
    """Squared residuals of tracks from motions, each at its best ray and depth.

    What is seen is in front of the camera that sees it: a track that would be explained
    best behind it is placed at infinity.

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
    found = [
        squares + np.where(places.front, 0, _to_infinity(places))
        for places, squares in _placed(x, seen, poses)
    ]
    return np.concatenate(found, axis=1)


def _to_infinity(places):
    """What squared residuals grow by as inverse depths are set to 0: (B, n).

    Quadratic in the depth, each with its best ray: a Schur complement of the normal
    equations.
    """
    a, b, c, d, e, f = places.normal.swapaxes(0, 1)
    minor = np.maximum(a * d - b * b, np.finfo(float).tiny)
    curvature = f - (c * c * d - 2 * b * c * e + e * e * a) / minor
    return places.points[:, 2] ** 2 * np.maximum(curvature, 0)


def nats_of_residuals(squares, freedom, scale):
    """Nats of residuals by a Student-t distribution.

    Parameters
    ----------
    squares : ndarray
        Summed over the residuals of a track.
    freedom : ndarray of int
        How many residuals that are, less what is fitted to the track.
    scale : float

    Returns
    -------
    ndarray
    """
    ratio = squares / (FREEDOM * scale**2)
    return (FREEDOM + freedom) / 2 * np.log1p(ratio)


def inverse_depths(x, seen, poses):
    """Inverse depths at which motions explain tracks best.

    Parameters
    ----------
    x, seen, poses
        As for :func:`squared_residuals`.

    Returns
    -------
    depths : ndarray of shape (B, n)
        In the coordinates of the poses: 0 at infinity, negative behind the camera.
    errors : ndarray of shape (B, n)
        Their standard deviations where that of a residual is 1.
    """
    found = [
        (places.points[:, 2], _error_of_last(places.normal))
        for places, _ in _placed(x, seen, poses)
    ]
    depths, errors = (np.concatenate(each, axis=1) for each in zip(*found, strict=True))
    return depths, errors


def camera_information(x, seen, weights, floor, reference, poses, derivatives):
    """What motions of groups tell of the camera, their poses and depths being free.

    Parameters
    ----------
    x, seen, weights, floor, reference
        As for :func:`fit_rigid_motions`.
    poses : Poses
        Of the groups.
    derivatives : callable
        Of calibrated coordinates (2, ...) of fixed pixels by P parameters of the
        camera: ``x -> (P, 2, ...)``.

    Returns
    -------
    information : ndarray of shape (B, P, P)
        Fisher information, as if residuals were independent.
    gradient : ndarray of shape (B, P)
        Of the log likelihood: times the inverse of the information, it is how far the
        parameters are from the likeliest.

    Notes
    -----
    Derivatives are taken at images as the motions predict them, not at those observed:
    these have the noise of the residuals in them, and would say that everything is to
    be made smaller.
    """
    problems = observed(x, seen, weights, floor, reference)
    state = _minimise(problems, _state_of(problems, poses), LAST_ITERATIONS)
    root = _root_of_weights(problems, state, _scale(problems, state))
    left = state.residuals * root
    some = _reduced(problems, state, root, left, np.zeros(len(x)))
    rows = _camera_rows(problems, state, derivatives) * root  # (P, 2, L, B, n)
    P, _, L, B, _ = rows.shape
    of_depths = (rows * some.depths).sum(axis=(1, 2)).swapaxes(0, 1)  # (B, P, n)
    shares = of_depths / some.of_depths[:, None]
    of_poses = np.einsum("cklbn,pclbn->bklp", some.poses, rows).reshape(B, 6 * L, P)
    of_poses -= some.mixed @ shares.swapaxes(-1, -2)
    flat = np.moveaxis(rows, 3, 0).reshape(B, P, -1)
    information = flat @ flat.swapaxes(-1, -2) - shares @ of_depths.swapaxes(-1, -2)
    gradient = flat @ np.moveaxis(left, 2, 0).reshape(B, -1, 1)
    gradient -= shares @ some.right_depths[..., None]
    both = np.concatenate([of_poses, some.right], axis=2)
    solved = of_poses.swapaxes(-1, -2) @ np.linalg.solve(some.matrix, both)
    return information - solved[..., :P], (gradient - solved[..., P:])[..., 0]


def _camera_rows(problems, state, derivatives):
    """Derivatives of predicted images by the camera, less those of fixed pixels."""
    rays = derivatives(problems.rays[:2])  # (P, 2, B, n)
    turned = np.einsum("lbij,pjbn->pilbn", state.rotations[..., :2], rays)
    moved = (turned[:, :2] - state.image * turned[:, 2:]) / state.distance
    return (moved - derivatives(state.image)) * problems.seen


def _error_of_last(normal):
    """Standard deviation (B, n) of the last of three unknowns, by ``UPPER`` entries."""
    last = np.zeros((len(normal), 3, normal.shape[-1]))
    last[:, 2] = 1
    return np.sqrt(np.maximum(_solve_points(normal, last, 0.0)[:, 2], 0))


class _Places(NamedTuple):
    """Where motions explain tracks best."""

    points: np.ndarray  # (B, 3, n), a ray and an inverse depth
    normal: np.ndarray  # (B, 6, n), UPPER entries of the normal equations
    front: np.ndarray  # (B, n), whether before the camera in the frames that see it


def _placed(x, seen, poses):
    """Yield places and squared residuals (B, n) of some tracks."""
    x, seen = x.transpose(1, 2, 0), seen.T.astype(float)  # (L, 2, n), (L, n)
    rotations, translations = poses
    # A point (a, b, 1) / c of the reference frame is at P (a, b, c, 1) in another.
    P = np.concatenate(
        [rotations[..., :2], translations[..., None], rotations[..., 2:]], axis=-1
    )  # (B, L, 3, 4)
    size = max(1, SIZE_OF_BLOCK // len(P))
    for k in range(0, max(seen.shape[1], 1), size):
        yield _places_of(P, x[..., k : k + size], seen[:, k : k + size])


def _places_of(P, x, seen):
    """What :func:`_placed` yields of some tracks, (L, 2, n) and (L, n)."""
    equations = _equations(P, x, seen)
    points = _solve_points(equations, -equations[:, 6:], 1e-11)
    image, distance, residuals = _image_of(points, P, x, seen)
    squares = (residuals**2).sum(axis=(1, 2))
    near = seen / distance
    residuals *= near[:, :, None]
    across = (image * residuals).sum(axis=2)  # (B, L, n)
    left = np.concatenate([residuals, -across[:, :, None]], axis=2)  # (B, L, 3, n)
    right = _flat(P[..., :3]).swapaxes(-1, -2) @ _flat(left)
    normal = _equations(P[..., :3], image, near**2)
    points += _solve_points(normal, right, 1e-9)
    _, distance, residuals = _image_of(points, P, x, seen)
    # Distances are in units of the depth, which has the sign of its inverse.
    front = points[:, 2] * (distance * seen).sum(axis=1) >= 0
    squares = np.minimum(squares, (residuals**2).sum(axis=(1, 2)))
    return _Places(points, normal, front), squares


def _equations(P, image, weights):
    """Normal equations of least squares of ``(u P_2 - P_0) p`` and ``(v P_2 - P_1) p``.

    Products of two columns of these, weighted and summed over frames, are linear in
    the products of P: (B, 6, n) or, of a fourth column, (B, 9, n).
    """
    pairs = PAIRS if P.shape[-1] == 4 else PAIRS[:, :6]
    (a, b, c), (d, e, f) = P[..., pairs].transpose(3, 2, 0, 1, 4)  # (B, L, 9) each
    factors = np.stack([a * d + b * e, -a * f - c * d, -b * f - c * e, c * f], axis=2)
    u, v = image[..., 0, :], image[..., 1, :]
    # Per frame and point: (..., L, 4, n).
    terms = np.stack([weights, weights * u, weights * v, weights * (u**2 + v**2)], -2)
    return _flat(factors).swapaxes(-1, -2) @ _flat(terms)


def _flat(values):
    """Two axes before the last as one."""
    *batch, first, second, n = values.shape
    return values.reshape(*batch, first * second, n)


def _image_of(points, P, x, seen):
    """Images (B, L, 2, n), distances (B, L, n) and residuals of points (B, 3, n)."""
    p = _flat(P[..., :3]) @ points
    p = p.reshape(*P.shape[:3], -1) + P[..., 3:]
    distance = kept_away(p[:, :, 2])
    image = p[:, :, :2] / distance[:, :, None]
    return image, distance, (x - image) * seen[:, None]


def _solve_points(matrix, right, damping):
    """Damped least squares for (B, 3, n)."""
    a, b, c, d, e, f = matrix[:, :6].swapaxes(0, 1)
    more = damping * (a + d + f) + 1e-14
    matrix = a + more, b, c, d + more, e, f + more
    return np.stack(solve_three(matrix, right.swapaxes(0, 1)), axis=1)


def observed(x, seen, weights, floor, reference):
    """The :class:`Problems` of the arguments of :func:`fit_rigid_motions`."""
    B, n, L = seen.shape
    batch = np.arange(B)
    reference = np.broadcast_to(reference, B)
    ahead = np.arange(L - 1)[:, None]
    ahead = ahead + (ahead >= reference) - reference  # (L - 1, B)
    x, seen = x.transpose(3, 2, 0, 1), seen.transpose(2, 0, 1)  # (2, L, B, n)
    there = seen[reference, batch] & (weights > 0)
    rays = np.concatenate([x[:, reference, batch], np.ones((1, B, n))])
    seen = seen[reference + ahead, batch] & there
    times_seen = seen.sum(axis=0)
    return Problems(
        x=x[:, reference + ahead, batch],
        seen=seen.astype(float),
        rays=rays,
        weights=weights * there,
        counted=there & (times_seen > 0),
        freedom=np.maximum(2 * times_seen - 1, 1),
        floor=floor[:, None],
        reference=reference[:, None],
        ahead=ahead[..., None],
    )


def _frames(problems):
    """The frames (L, B) of the window that are not the reference."""
    return (problems.reference + problems.ahead)[..., 0]


def _poses(problems, state):
    """Poses in all frames, the reference one too."""
    frames = _frames(problems)
    L, B = frames.shape
    rotations = np.tile(np.eye(3), (B, L + 1, 1, 1))
    translations = np.zeros((B, L + 1, 3))
    places = np.arange(B), frames
    rotations[places], translations[places] = state.rotations, state.translations
    return Poses(rotations, translations)


def _state_of(problems, poses):
    """The state of given poses, at the depths of least algebraic error."""
    poses = relative_to(poses, problems.reference[:, 0])
    places = np.arange(len(problems.rays[0])), _frames(problems)
    rotations, translations = (each[places] for each in poses)
    depths = _depths(problems, rotations, translations)
    return _in_front(problems, rotations, translations, depths)


def _in_front(problems, rotations, translations, depths):
    """The state with what would be behind the camera at infinity.

    Poses are not mirrored for it, even if it is most tracks: of distant ones, a small
    rotation that is missing may place all there.
    """
    return _state(problems, rotations, translations, np.maximum(depths, 0))


def _state(problems, rotations, translations, depths):
    image, turned, distance = images_of(problems.rays, depths, rotations, translations)
    residuals = (problems.x - image) * problems.seen
    squares = (residuals**2).sum(axis=(0, 1))
    return _State(
        rotations, translations, depths, image, turned, distance, residuals, squares
    )


def _scale(problems, state):
    """Robust standard deviation of the residuals, at least the floor: (B, 1)."""
    medians = lower_medians(state.squares / problems.freedom, problems.counted)
    medians = np.where(np.isfinite(medians), medians, 0)[:, None]
    return np.maximum(problems.floor, SCALE_OF_MEDIAN * np.sqrt(medians))


def _cost(problems, state, scale):
    """Student-t cost of the residuals of all tracks, in nats: (B,)."""
    costs = np.log1p(state.squares / (FREEDOM * scale**2))
    return (problems.weights * (FREEDOM + problems.freedom) * costs).sum(axis=1)


def _minimise(problems, state, iterations):
    """Levenberg-Marquardt, until a step changes little; the scale of the residuals
    follows. Problems that have converged are left out of further steps."""
    found = _State(*map(np.array, state))
    left = np.arange(len(state.depths))
    damping = np.full(len(left), 1e-2)
    for _ in range(iterations):
        scale = _scale(problems, state)
        change = -_cost(problems, state, scale)
        new = _stepped(problems, state, scale, damping)
        change += _cost(problems, new, scale)
        better = change < 0
        damping = np.where(better, 0.2 * damping, 8 * damping).clip(1e-9, 1e6)
        some = np.flatnonzero(better)
        found.replace(left[some], new.of(some))
        going = np.flatnonzero(np.abs(change) >= CONVERGED)
        if not len(going):
            break
        if len(going) < len(left):
            left, damping, problems = left[going], damping[going], problems.of(going)
        state = found.of(left)
    return found


class _Reduced(NamedTuple):
    """Normal equations of the poses of a batch, the depths eliminated."""

    matrix: np.ndarray  # (B, 6 L, 6 L)
    right: np.ndarray  # (B, 6 L, 1)
    poses: np.ndarray  # (2, 6, L, B, n), derivatives of images by poses
    depths: np.ndarray  # (2, L, B, n), and by depths
    mixed: np.ndarray  # (B, 6 L, n), products of both
    of_depths: np.ndarray  # (B, n), of depths with themselves; infinite if held
    right_depths: np.ndarray  # (B, n)


def _reduced(problems, state, root, left, damping, bounded=False):
    """The equations for some weights (B, n) and weighted residuals.

    Bounded, tracks at infinity that would rather be behind the camera stay there. What
    is told of the camera is not: noise of what stands still would then say something.
    """
    L, B, n = problems.seen.shape
    poses, depths = _jacobians(problems, state, root)
    normal, right = normal_equations(poses, left)  # (L, B, 6, 6), (L, B, 6, 1)
    mixed = poses[0] * depths[0] + poses[1] * depths[1]  # (6, L, B, n)
    mixed = mixed.reshape(6 * L, B, n).swapaxes(0, 1)
    of_depths = (depths**2).sum(axis=(0, 1)) * (1 + damping[:, None])
    of_depths += 1e-9 * of_depths.max(axis=1, keepdims=True) + 1e-30
    right_depths = (depths * left).sum(axis=(0, 1))  # (B, n)
    if bounded:
        held = (state.depths <= 0) & (right_depths < 0)
        of_depths = np.where(held, np.inf, of_depths)
    shares = mixed / of_depths[:, None]
    matrix = _damped_blocks(normal, damping) - shares @ mixed.swapaxes(-1, -2)
    right = right.transpose(1, 2, 0, 3).reshape(B, 6 * L, 1)
    right = right - shares @ right_depths[..., None]
    return _Reduced(matrix, right, poses, depths, mixed, of_depths, right_depths)


def _root_of_weights(problems, state, scale):
    """Square roots (B, n) of the weights of tracks, over the scale of residuals."""
    spread = FREEDOM * scale**2 + state.squares
    return np.sqrt(problems.weights * (FREEDOM + problems.freedom) / spread)


def _stepped(problems, state, scale, damping):
    """The state after one damped Gauss-Newton step, the depths eliminated."""
    L, B, _ = problems.seen.shape
    root = _root_of_weights(problems, state, scale)
    some = _reduced(
        problems, state, root, state.residuals * root, damping, bounded=True
    )
    change = np.linalg.solve(some.matrix, some.right)[..., 0]  # (B, 6 L)
    explained = (change[:, None] @ some.mixed)[:, 0]
    change_depths = (some.right_depths - explained) / some.of_depths
    change = change.reshape(B, 6, L).transpose(2, 0, 1)  # (L, B, 6)
    return _state(
        problems,
        rotations_of(change[..., :3]) @ state.rotations,
        state.translations + change[..., 3:],
        np.maximum(state.depths + change_depths, 0),
    )


def _damped_blocks(normal, damping):
    """Matrices (B, 6 L, 6 L) of damped blocks (L, B, 6, 6), one per frame."""
    L, B = normal.shape[:2]
    diagonal = np.diagonal(normal, axis1=2, axis2=3)  # (L, B, 6)
    more = damping[:, None] * diagonal
    more = more + 1e-7 * diagonal.mean(axis=(0, 2))[:, None] + 1e-30
    blocks = np.zeros((B, 6, L, 6, L))
    frames = np.arange(L)
    blocks[:, :, frames, :, frames] = normal + more[..., None] * np.eye(6)
    return blocks.reshape(B, 6 * L, 6 * L)


def _jacobians(problems, state, root):
    """Derivatives of images by poses, (2, 6, L, B, n), and by depths, (2, L, B, n),
    times a root of a weight per track."""
    factor = problems.seen * root / state.distance
    poses = image_derivatives(state.image, state.turned, state.depths, factor)
    t = state.translations.transpose(2, 0, 1)[..., None]  # (3, L, B, 1)
    return poses, (t[:2] - state.image * t[2]) * factor


def _depths(problems, rotations, translations):
    """Inverse depths (B, n) of least algebraic error for given poses."""
    turned = images_of(problems.rays, 0, rotations, translations)[1]
    t = translations.transpose(2, 0, 1)[..., None]  # (3, L, B, 1)
    slope = (problems.x * t[2] - t[:2]) * problems.seen
    left = turned[:2] - problems.x * turned[2]
    return (slope * left).sum(axis=(0, 1)) / ((slope**2).sum(axis=(0, 1)) + 1e-12)
