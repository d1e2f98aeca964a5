"""Tracks as arrays: packing, visibility, frame pairs and normalised coordinates."""

from __future__ import annotations

import numpy as np

# Points are in one spot when they lie closer than this share of their coordinates: the
# mean of equal numbers is not always that number.
ROUNDING = 1e-12


def pack_tracks(points, visibility=None):
    """Put point tracks into the two-columns-a-frame matrix the estimators take.

    Parameters
    ----------
    points : array-like of shape (n_tracks, n_frames, 2)
        Pixel coordinates (x, y). Where a point was not seen, any value will do
        as long as ``visibility`` says so; NaN needs no ``visibility``.
    visibility : array-like of bool, shape (n_tracks, n_frames), optional
        True where the point was seen.

    Returns
    -------
    X : ndarray of shape (n_tracks, 2 * n_frames), float64 or float32
        Columns ``x_0, y_0, x_1, y_1, ...``; both are NaN where the point was
        not seen.

    Raises
    ------
    ValueError
        If the shapes do not fit, or a point marked as seen is infinite.

    Examples
    --------
    >>> import numpy as np
    >>> from skmotionseg import pack_tracks
    >>> points = np.array([[[1.0, 2.0], [3.0, 4.0]]])
    >>> pack_tracks(points, visibility=[[True, False]])
    array([[ 1.,  2., nan, nan]])
    """
    points = np.asarray(points)
    if points.dtype.kind not in "fiub":
        raise TypeError(f"points must be real numbers; got dtype {points.dtype}")
    if points.ndim != 3 or points.shape[2] != 2:
        raise ValueError(
            f"points must have shape (n_tracks, n_frames, 2); got {points.shape}"
        )
    points = points.astype(np.result_type(points.dtype, np.float32), copy=True)
    if visibility is not None:
        visibility = _as_visibility(visibility, points.shape[:2])
        points[~visibility] = np.nan
    if np.isinf(points).any():
        raise ValueError(
            "points must be finite where they are seen and NaN where they are not; "
            f"got {int(np.isinf(points).any(axis=2).sum())} infinite points"
        )
    points[np.isnan(points).any(axis=2)] = np.nan
    return points.reshape(len(points), 2 * points.shape[1])


def _as_visibility(visibility, shape):
    visibility = np.asarray(visibility)
    if visibility.shape != shape:
        raise ValueError(
            f"visibility must have shape (n_tracks, n_frames) = {shape}; "
            f"got {visibility.shape}"
        )
    if visibility.dtype.kind == "b":
        return visibility
    if visibility.dtype.kind not in "iuf" or not np.isin(visibility, (0, 1)).all():
        raise ValueError(
            "visibility must be boolean, or numbers that are 0 or 1; "
            f"got dtype {visibility.dtype} with other values"
        )
    return visibility.astype(bool)


def unpack_tracks(X):
    """Undo :func:`pack_tracks`.

    Parameters
    ----------
    X : array-like of shape (n_tracks, 2 * n_frames)
        Tracks; NaN where a point was not seen.

    Returns
    -------
    points : ndarray of shape (n_tracks, n_frames, 2)
        Pixel coordinates; both are NaN where either was.
    visibility : ndarray of bool, shape (n_tracks, n_frames)
        True where both coordinates are finite.

    Raises
    ------
    ValueError
        If ``X`` is not a matrix of an even number of columns.

    Examples
    --------
    >>> import numpy as np
    >>> from skmotionseg import unpack_tracks
    >>> points, visibility = unpack_tracks([[1.0, 2.0, np.nan, 4.0]])
    >>> visibility
    array([[ True, False]])
    """
    X = np.asarray(X)
    if X.ndim != 2 or X.shape[1] % 2:
        raise ValueError(
            "tracks need two columns a frame; got "
            + (f"{X.shape[1]} columns" if X.ndim == 2 else f"an array of {X.ndim} axes")
        )
    points = np.array(X, dtype=np.result_type(X.dtype, np.float32))
    points = points.reshape(len(X), -1, 2)
    visibility = np.isfinite(points).all(axis=2)
    points[~visibility] = np.nan
    return points, visibility


def frame_pairs(n_frames, frame_gap=1):
    """Index pairs ``(f, f + frame_gap)``; shape (n_frames - frame_gap, 2)."""
    first = np.arange(n_frames - frame_gap)
    return np.column_stack([first, first + frame_gap])


def normalization(points):
    """Similarity that moves points to centroid 0 and mean distance sqrt(2).

    Parameters
    ----------
    points : ndarray of shape (n, 2)

    Returns
    -------
    ndarray of shape (3, 3)
        Hartley's normalisation (Hartley and Zisserman 2004, sec. 4.4.4). Points
        that all coincide are only shifted.
    """
    centroid = points.mean(axis=0)
    distance = np.hypot(*(points - centroid).T).mean()
    coincide = distance <= ROUNDING * np.abs(points).max()
    return similarity(1.0 if coincide else np.sqrt(2) / distance, centroid)


def similarity(scale, centroid):
    """The 3x3 map ``x -> scale * (x - centroid)``."""
    x, y = centroid
    return np.array([[scale, 0, -scale * x], [0, scale, -scale * y], [0, 0, 1.0]])


def apply_similarity(T, points):
    """Map points (n, 2) by a similarity made by :func:`similarity`."""
    return points * T[0, 0] + T[:2, 2]


def working_coordinates(points, visibility):
    """Centre of each frame and one scale for all, to compute residuals in.

    Shifting each frame by itself and scaling all alike conditions float32 arithmetic
    and leaves residuals in pixels what they are.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)

    Returns
    -------
    centres : ndarray of shape (n_frames, 2)
        Centroid of the tracks seen; 0 in a frame in which none is.
    scale : float
        Mean distance from the centres along one axis; positive.
    """
    seen = visibility.sum(axis=0)[:, None]
    filled = np.where(visibility[..., None], points, 0)
    centres = filled.sum(axis=0) / np.maximum(seen, 1)
    distance = np.abs(points - centres)[visibility]
    scale = distance.mean() if len(distance) else 0.0
    coincide = scale <= ROUNDING * np.abs(filled).max(initial=0)
    return centres, 1.0 if coincide else float(scale)
