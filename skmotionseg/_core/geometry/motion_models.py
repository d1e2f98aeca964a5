"""Motion models: what a minimal set determines, and how well a track fits it.

A model is one frozen record. The built-in ones are in :data:`MOTION_MODELS`; a model of
one's own is handed over as an object wherever the name of one is taken.

All functions work on stacks and never raise on degenerate geometry: a minimal set
that determines no model gives NaN.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import combinations
from numbers import Integral
from types import MappingProxyType

import numpy as np

from .model_checks import check_functions

# A minimal set is degenerate when its points span less than this, in coordinates
# whose mean distance from the centroid is sqrt(2): far below the noise of any
# tracker, far above rounding.
DEGENERATE_SPAN = 1e-5

# Rounds of three squarings that leave the eigenvector of the largest eigenvalue: one
# that is larger by 4 % is then larger by a factor of 10^8, and nothing is lost where
# two are equal.
ROUNDS = 3
# Cofactors of a unit matrix below this are rounding: it is of rank 1.
RANK_ONE = 1e-14


@dataclass(frozen=True)
class MotionModel:
    """A geometric motion model: how it is fitted, and the residuals of tracks.

    The built-in models have names ("affine", "homography", "fundamental"). A custom
    model is an instance of this class, which can be passed as ``models=`` and
    ``model=`` instead of a name. All functions work on stacks of arrays and never raise
    on degenerate geometry.

    Parameters
    ----------
    name : str
        Unique name of the model.
    minimal_size : int
        Correspondences that determine one model. Models are ordered by it, from the
        simplest to the richest.
    fit : callable
        ``(..., p, 2), (..., p, 2) -> (..., 3, 3)``: the model through minimal sets of
        points in the first and second frame, each of which is normalised (all points
        that both see have centroid 0 and mean distance sqrt(2); a set need not); NaN
        where a set is degenerate.
    residuals : callable
        ``(K, 3, 3), (..., n, 2), (..., n, 2) -> (..., n, K)``: squared Sampson errors
        of tracks to K models, in the dtype of the points, which is float32.
    change_coordinates : callable
        ``M, S, T -> M'``: the model of the points ``(S x, T y)``, given that of
        ``(x, y)``; all are stacks of 3x3 matrices.
    from_translation : callable
        ``(..., 2) -> (..., 3, 3)``: the model of a translation, for frame pairs in
        which all minimal sets are degenerate.

    See Also
    --------
    HypothesisSampler : Fits a model to random minimal sets.

    Notes
    -----
    Estimators are sent to other processes, and cached in ``memory``, together with
    their models. Functions of a module can always be sent; functions of a script or a
    notebook with joblib's default backend and with Dask. To be cached, they must belong
    to a module.

    Examples
    --------
    A model that only shifts, with what it shares with the affine map:

    >>> from dataclasses import replace
    >>> from skmotionseg import HypothesisSampler, MotionModel
    >>> from skmotionseg.datasets import make_rigid_motions
    >>> affine = MotionModel.built_in("affine")
    >>> def fit_shift(x, y):
    ...     return affine.from_translation((y - x)[..., 0, :])
    >>> shift = replace(affine, name="shift", minimal_size=1, fit=fit_shift)
    >>> X, y = make_rigid_motions(n_tracks=30, n_frames=4, random_state=0)
    >>> sampler = HypothesisSampler(shift, n_hypotheses=20, random_state=0).fit(X)
    >>> sampler.hypotheses_.shape
    (3, 20, 3, 3)
    """

    name: str
    minimal_size: int
    fit: Callable[[np.ndarray, np.ndarray], np.ndarray]
    residuals: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
    change_coordinates: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
    from_translation: Callable[[np.ndarray], np.ndarray]

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not self.name:
            raise TypeError(f"the name of a motion model is a str; got {self.name!r}")
        if not isinstance(self.minimal_size, Integral) or self.minimal_size < 1:
            raise ValueError(
                f"minimal_size must be an integer of 1 or more; got "
                f"{self.minimal_size!r}"
            )
        for part in ("fit", "residuals", "change_coordinates", "from_translation"):
            if not callable(getattr(self, part)):
                raise TypeError(f"{part} of the {self.name} model must be callable")

    @classmethod
    def built_in(cls, name: str) -> MotionModel:
        """The built-in model of that name.

        Parameters
        ----------
        name : {"affine", "homography", "fundamental"}

        Returns
        -------
        MotionModel

        Raises
        ------
        ValueError
            If there is none.
        """
        if name not in MOTION_MODELS:
            raise ValueError(
                f"unknown motion model {name!r}; expected one of "
                f"{sorted(MOTION_MODELS)}"
            )
        return MOTION_MODELS[name]


# ---------------------------------------------------------------- minimal fits


def fit_affine(x, y):
    """Affine maps through three correspondences each.

    Parameters
    ----------
    x, y : ndarray of shape (..., 3, 2)
        Normalised points in the first and second frame.

    Returns
    -------
    ndarray of shape (..., 3, 3)
        Last row (0, 0, 1). NaN where the three points are collinear in either
        frame.
    """
    edges_x = x[..., 1:, :] - x[..., :1, :]  # (..., 2, 2), a row an edge
    edges_y = y[..., 1:, :] - y[..., :1, :]
    det_x, det_y = _det2(edges_x), _det2(edges_y)
    good = np.minimum(abs(det_x), abs(det_y)) > DEGENERATE_SPAN
    inverse = _adjugate2(edges_x) / np.where(good, det_x, np.nan)[..., None, None]
    linear = np.swapaxes(inverse @ edges_y, -1, -2)
    affine = np.zeros((*det_x.shape, 3, 3))
    affine[..., :2, :2] = linear
    affine[..., :2, 2] = y[..., 0, :] - (linear @ x[..., 0, :, None])[..., 0]
    affine[..., 2, 2] = 1
    affine[~good] = np.nan
    return affine


def fit_homography(x, y):
    """Homographies through four correspondences each.

    The four-point DLT system has one solution, written here in closed form: with
    ``x4 = X a`` for the matrix ``X`` of the first three (homogeneous) points and
    likewise ``y4 = Y b``, it is ``H = Y diag(b / a) X^-1``.

    Parameters
    ----------
    x, y : ndarray of shape (..., 4, 2)

    Returns
    -------
    ndarray of shape (..., 3, 3)
        Unit Frobenius norm. NaN where three of the points are collinear in either
        frame.
    """
    X, x_weights, x_span = _projective_basis(x)
    Y, y_weights, y_span = _projective_basis(y)
    good = np.minimum(x_span, y_span) > DEGENERATE_SPAN
    scale = y_weights / np.where(good[..., None], x_weights, np.nan)
    H = (Y * scale[..., None, :]) @ _adjugate3(X)
    H = _unit_norm(H)
    H[~good] = np.nan
    return H


def _projective_basis(points):
    """First three points as columns, weights of the fourth, smallest area."""
    a, b, c, d = np.moveaxis(points, -2, 0)
    bcd, acd, abd, abc = (
        _area(b, c, d),
        _area(a, c, d),
        _area(a, b, d),
        _area(a, b, c),
    )
    homogeneous = np.ones((*points.shape[:-2], 3, 3))
    homogeneous[..., :2, :] = np.swapaxes(points[..., :3, :], -1, -2)
    # Cramer's rule up to the common factor 1 / abc.
    weights = np.stack([bcd, -acd, abd], axis=-1)
    span = np.min(np.abs([bcd, acd, abd, abc]), axis=0)
    return homogeneous, weights, span


def fit_fundamental(x, y):
    """Fundamental matrices through eight correspondences each, rank 2 enforced.

    The null vector of the 8x9 DLT system (Hartley and Zisserman 2004, eq. 11.3) by
    batched Householder QR. A set of coplanar points leaves the null space more than
    one-dimensional; any vector in it is an epipolar geometry the points do obey, so
    it is kept: rejecting it would leave a planar motion with no hypothesis but those
    that mix it with others.

    Parameters
    ----------
    x, y : ndarray of shape (..., 8, 2)

    Returns
    -------
    ndarray of shape (..., 3, 3)
        Unit Frobenius norm, rank 2. NaN where two correspondences coincide or all
        points of a frame are collinear.
    """
    good = _distinct(x, y) & ~_collinear(x) & ~_collinear(y)
    rows = epipolar_equations(homogeneous(x), homogeneous(y))
    F = null_vectors(rows.reshape(-1, 8, 9)).reshape(*x.shape[:-2], 3, 3)
    F = rank_two(F)
    F[~good] = np.nan
    return F


def epipolar_equations(x, y):
    """Rows (..., 9) whose product with the entries of F is ``y^T F x``.

    Parameters
    ----------
    x, y : ndarray of shape (..., 3)
        Homogeneous points.
    """
    return (y[..., :, None] * x[..., None, :]).reshape(*x.shape[:-1], 9)


def null_vectors(A):
    """A unit vector orthogonal to all rows, for a stack of wide matrices.

    The last column of Q in the Householder QR factorisation of each transpose,
    computed with the stack as the innermost, contiguous axis.

    Parameters
    ----------
    A : ndarray of shape (B, m, n), m < n

    Returns
    -------
    ndarray of shape (B, n)
    """
    n_rows, n = A.shape[1:]
    columns = np.ascontiguousarray(A.transpose(2, 1, 0))  # (n, m, B)
    reflectors = []
    for k in range(n_rows):
        v = columns[k:, k].copy()  # (n - k, B)
        v[0] += np.copysign(np.sqrt((v * v).sum(axis=0)), v[0])
        squared = (v * v).sum(axis=0)
        v *= np.sqrt(2 / np.where(squared > 0, squared, np.inf))
        rest = columns[k:, k + 1 :]
        rest -= v[:, None] * (v[:, None] * rest).sum(axis=0)
        reflectors.append(v)
    q = np.zeros((n, len(A)))
    q[-1] = 1
    for k, v in reversed(list(enumerate(reflectors))):
        q[k:] -= v * (v * q[k:]).sum(axis=0)
    return q.T


def rank_two(F):
    """Nearest matrices of rank 2, scaled to unit Frobenius norm.

    Takes from each row its part along the right singular vector of the least singular
    value, which is that of the largest in the matrix of cofactors. A matrix of rank 1
    stays what it is.

    Parameters
    ----------
    F : ndarray of shape (..., 3, 3)

    Returns
    -------
    ndarray of shape (..., 3, 3)
    """
    F = _unit_norm(F)
    cofactors = cofactors3(F)
    v = dominant_eigenvectors(np.swapaxes(cofactors, -1, -2) @ cofactors)
    v[(cofactors**2).sum(axis=(-2, -1)) < RANK_ONE**2] = 0
    return _unit_norm(F - (F @ v[..., None]) * v[..., None, :])


def dominant_eigenvectors(A):
    """Unit eigenvectors of the largest eigenvalues of positive semidefinite matrices.

    By squaring the matrices, a stack of products, which takes a fraction of the time of
    a decomposition each. Where two eigenvalues are equal it is some vector of their
    plane.

    Parameters
    ----------
    A : ndarray of shape (..., n, n)

    Returns
    -------
    ndarray of shape (..., n)
        Zero for a matrix of zeros.
    """
    for _ in range(ROUNDS):
        trace = np.trace(A, axis1=-2, axis2=-1)[..., None, None]
        A = A / np.where(trace > 0, trace, 1)
        A = A @ A
        A = A @ A
        A = A @ A
    longest = np.diagonal(A, axis1=-2, axis2=-1).argmax(axis=-1)
    v = np.take_along_axis(A, longest[..., None, None], axis=-1)[..., 0]
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return v / np.where(length > 0, length, 1)


# ------------------------------------------------------------ Sampson residuals


def affine_residuals(A, x, y):
    """Squared Sampson errors of tracks under affine maps.

    With ``C = A x - y`` linear in ``(x, y)``, the error is
    ``C^T (A A^T + I)^-1 C`` (Hartley and Zisserman 2004, eq. 4.12).

    Parameters
    ----------
    A : ndarray of shape (K, 3, 3)
    x, y : ndarray of shape (..., n, 2)
        Points in the first and second frame; the unit of the result is theirs,
        squared.

    Returns
    -------
    ndarray of shape (..., n, K)
    """
    A = A.astype(float)  # A A^T + I is close to singular where A flattens the image
    linear = A[:, :2, :2]
    minus_one = np.broadcast_to(-np.eye(2), linear.shape)
    equations = np.concatenate([A[:, :2], minus_one], axis=2)
    # (K, 2, 5), acting on (x0, x1, 1, y0, y1)
    a, b, _ = _symmetric2(linear @ linear.transpose(0, 2, 1) - minus_one)
    determinant = 1 + (linear**2).sum(axis=(1, 2)) + _det2(linear) ** 2
    first = equations[:, 0] / np.sqrt(a)[:, None]
    second = equations[:, 1] - (b / a)[:, None] * equations[:, 0]
    second /= np.sqrt(determinant / a)[:, None]  # Cholesky whitening of A A^T + I
    first, second = first.astype(x.dtype), second.astype(x.dtype)
    features = np.concatenate([homogeneous(x), y], axis=-1)  # (..., n, 5)
    squared = features @ first.T
    squared *= squared
    rest = features @ second.T
    rest *= rest
    squared += rest
    return squared


def homography_residuals(H, x, y):
    """Squared Sampson errors of tracks under homographies.

    The two cross-product equations ``C = (u - y0 w, v - y1 w)``, with
    ``(u, v, w) = H x``, have Jacobian rows ``(p, -w, 0)`` and ``(q, 0, -w)``. Written
    out, ``C^T (J J^T)^-1 C`` is a ratio of sums of squares, so nothing cancels.

    Parameters
    ----------
    H : ndarray of shape (K, 3, 3)
    x, y : ndarray of shape (..., n, 2)

    Returns
    -------
    ndarray of shape (..., n, K)
    """
    H = _unit_norm(H)
    c0, c1, w = _map_points(H, x)  # (..., n, K) each, as all that follow
    c0 -= y[..., :1] * w
    c1 -= y[..., 1:] * w
    (p0, p1), (q0, q1) = _jacobians(H, y)
    w *= w
    numerator = _squared_difference(q0 * c0, p0 * c1)
    numerator += _squared_difference(q1 * c0, p1 * c1)
    c0 *= c0
    c1 *= c1
    c0 += c1
    c0 *= w
    numerator += c0
    determinant = homogeneous(y) @ _jacobian_determinants(H).T
    determinant *= determinant
    denominator = w.copy()
    for part in (p0, p1, q0, q1):
        part *= part
        denominator += part
    denominator *= w
    denominator += determinant
    return _ratio(numerator, denominator)


def _jacobians(H, y):
    """``H[i, j] - y_i H[2, j]`` for i, j in {0, 1}, each (..., n, K)."""
    one_and = [np.stack([np.ones_like(y[..., i]), -y[..., i]], axis=-1) for i in (0, 1)]
    return [[one_and[i] @ H[:, [i, 2], j].T for j in (0, 1)] for i in (0, 1)]


def _jacobian_determinants(H):
    """Coefficients (K, 3) of ``(y0, y1, 1)`` in ``p0 q1 - p1 q0``."""
    a, b, c = (H[:, i, :2].astype(float) for i in range(3))
    coefficients = [_cross2(b, c), _cross2(c, a), _cross2(a, b)]
    return np.stack(coefficients, axis=1).astype(H.dtype)


def _squared_difference(a, b):
    """``(a - b) ** 2``, in the place of ``a``."""
    a -= b
    a *= a
    return a


def fundamental_residuals(F, x, y):
    """Squared Sampson errors of tracks under fundamental matrices.

    ``(y^T F x)^2 / (|F x|_{1,2}^2 + |F^T y|_{1,2}^2)`` (Hartley and Zisserman 2004,
    eq. 11.9).

    Parameters
    ----------
    F : ndarray of shape (K, 3, 3)
    x, y : ndarray of shape (..., n, 2)

    Returns
    -------
    ndarray of shape (..., n, K)
    """
    F = _unit_norm(F)
    l0, l1, l2 = _map_points(F, x)  # epipolar lines in the second frame
    k0, k1, _ = _map_points(F.transpose(0, 2, 1), y)  # (..., n, K) each
    l2 += y[..., :1] * l0
    l2 += y[..., 1:] * l1
    l2 *= l2
    denominator = l0 * l0
    for part in (l1, k0, k1):
        part *= part
        denominator += part
    return _ratio(l2, denominator)


def homogeneous(x):
    """Points (..., 2) with a third coordinate of 1."""
    return np.concatenate([x, np.ones_like(x[..., :1])], axis=-1)


def _map_points(M, x):
    """The three homogeneous coordinates of ``M x``, each (..., n, K)."""
    x = homogeneous(x)
    return [x @ M[:, i].T for i in range(3)]


def _ratio(numerator, denominator):
    tiny = np.finfo(denominator.dtype).tiny
    np.maximum(denominator, tiny, out=denominator)
    return np.divide(numerator, denominator, out=numerator)


# ------------------------------------------------------- changes of coordinates


def change_map_coordinates(M, S, T):
    """``T M S^-1``: a point map after ``x -> S x``, ``y -> T y`` (similarities)."""
    return T @ M @ np.linalg.inv(S)


def change_epipolar_coordinates(F, S, T):
    """``T^-T F S^-1``: an epipolar geometry after ``x -> S x``, ``y -> T y``."""
    return np.swapaxes(np.linalg.inv(T), -1, -2) @ F @ np.linalg.inv(S)


def translation_map(shift):
    """Point maps ``x -> x + shift``; (..., 2) -> (..., 3, 3)."""
    M = np.zeros((*shift.shape[:-1], 3, 3))
    M[...] = np.eye(3)
    M[..., :2, 2] = shift
    return M


def translation_epipolar(shift):
    """Fundamental matrices ``[t]_x`` of a shift in the image plane.

    A shift of zero leaves the direction open; (1, 0) is taken.
    """
    still = (shift == 0).all(axis=-1, keepdims=True)
    shift = np.where(still, [1.0, 0.0], shift)
    shift = shift / np.linalg.norm(shift, axis=-1, keepdims=True)
    F = np.zeros((*shift.shape[:-1], 3, 3))
    F[..., 0, 2], F[..., 1, 2] = shift[..., 1], -shift[..., 0]
    F[..., 2, 0], F[..., 2, 1] = -shift[..., 1], shift[..., 0]
    return F


# ------------------------------------------------------------ small linear algebra


def _det2(M):
    return M[..., 0, 0] * M[..., 1, 1] - M[..., 0, 1] * M[..., 1, 0]


def _adjugate2(M):
    adjugate = np.empty_like(M)
    adjugate[..., 0, 0], adjugate[..., 1, 1] = M[..., 1, 1], M[..., 0, 0]
    adjugate[..., 0, 1], adjugate[..., 1, 0] = -M[..., 0, 1], -M[..., 1, 0]
    return adjugate


def _adjugate3(M):
    return np.swapaxes(cofactors3(M), -1, -2)


def _unit_norm(M):
    # By a power of two first, which is exact: squares of large entries overflow.
    _, exponent = np.frexp(np.abs(M).max(axis=(-2, -1), keepdims=True))
    M = np.ldexp(M, -exponent)
    return M / np.linalg.norm(M, axis=(-2, -1), keepdims=True)


# Entries of the two products of each minor of a matrix of three rows, of which the rows
# and columns follow each other cyclically.
_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
_FACTORS = tuple(
    (3 * rows[:, None] + columns).ravel()
    for rows, columns in [
        (_NEXT, _NEXT),
        (_LAST, _LAST),
        (_NEXT, _LAST),
        (_LAST, _NEXT),
    ]
)


def cofactors3(M):
    """Matrices of cofactors: row i is the cross product of the two rows after it."""
    entries = M.reshape(*M.shape[:-2], 9)
    a, b, c, d = (entries.take(factor, axis=-1) for factor in _FACTORS)
    return (a * b - c * d).reshape(M.shape)


def _cross2(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _symmetric2(M):
    return M[..., 0, 0], M[..., 0, 1], M[..., 1, 1]


def _area(a, b, c):
    """Twice the signed area of triangles, (..., 2) each."""
    return _cross2(b - a, c - a)


def _distinct(x, y):
    """Whether all correspondences of a set differ from one another."""
    four = np.moveaxis(np.concatenate([x, y], axis=-1), (-2, -1), (0, 1))
    four = np.ascontiguousarray(four)  # (p, 4, ...)
    closest = np.full(four.shape[2:], np.inf)
    for i, j in combinations(range(len(four)), 2):
        gap = np.abs(four[i] - four[j]).max(axis=0)
        np.minimum(closest, gap, out=closest)
    return closest > DEGENERATE_SPAN


def _collinear(points):
    """Whether all points of a set lie on one line (or in one spot)."""
    centred = points - points.mean(axis=-2, keepdims=True)
    a, b, c = _symmetric2(np.swapaxes(centred, -1, -2) @ centred)
    spread = a + c
    return a * c - b * b <= DEGENERATE_SPAN**2 * spread * spread


# --------------------------------------------------------------- the built-in models

MOTION_MODELS: Mapping[str, MotionModel] = MappingProxyType(
    {
        model.name: model
        for model in (
            MotionModel(
                "affine",
                minimal_size=3,
                fit=fit_affine,
                residuals=affine_residuals,
                change_coordinates=change_map_coordinates,
                from_translation=translation_map,
            ),
            MotionModel(
                "homography",
                minimal_size=4,
                fit=fit_homography,
                residuals=homography_residuals,
                change_coordinates=change_map_coordinates,
                from_translation=translation_map,
            ),
            MotionModel(
                "fundamental",
                minimal_size=8,
                fit=fit_fundamental,
                residuals=fundamental_residuals,
                change_coordinates=change_epipolar_coordinates,
                from_translation=translation_epipolar,
            ),
        )
    }
)


def get_motion_model(model: str | MotionModel) -> MotionModel:
    """A motion model, of itself or of its name.

    Raises
    ------
    TypeError, ValueError
        If there is none of that name, or a function of one's own gives something else
        than it should.
    """
    if isinstance(model, MotionModel):
        if MOTION_MODELS.get(model.name) is not model:
            check_functions(model)
        return model
    if not isinstance(model, str) or model not in MOTION_MODELS:
        raise ValueError(
            f"unknown motion model {model!r}; expected a MotionModel or one of "
            f"{sorted(MOTION_MODELS)}"
        )
    return MOTION_MODELS[model]
