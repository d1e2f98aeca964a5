"""What the paper does to dense tracks before they are segmented or judged.

Each function says which tracks to keep, so that labels and names can follow:
``X[kept]``, ``labels[kept]``.
"""

from __future__ import annotations

from numbers import Integral, Real

import numpy as np
import numpy.typing as npt
from sklearn.utils import check_random_state

from ._core.geometry.epipolar import mean_sampson_errors
from ._core.geometry.tracks import unpack_tracks
from ._utils.validation import check_label_each, check_labels

__all__ = ["select_balanced_tracks", "select_inliers", "select_long_tracks"]


def select_long_tracks(X: npt.ArrayLike, min_length: int = 5) -> npt.NDArray[np.bool_]:
    """Select tracks that are seen in enough frames.

    Parameters
    ----------
    X : array-like of shape (n_tracks, 2 * n_frames)
        Tracks in pixels; NaN where unseen.
    min_length : int, default=5
        Minimum number of frames in which a track is seen.

    Returns
    -------
    ndarray of bool, shape (n_tracks,)
        True for the tracks to keep.

    Raises
    ------
    ValueError
        If ``X`` is not tracks or ``min_length`` is under 1.

    Examples
    --------
    >>> import numpy as np
    >>> from skmotionseg.preprocessing import select_long_tracks
    >>> X = np.array([[0.0, 0, 1, 0, 2, 0], [5, 5, 6, 5, np.nan, np.nan]])
    >>> select_long_tracks(X, min_length=3)
    array([ True, False])
    """
    if not isinstance(min_length, Integral) or min_length < 1:
        raise ValueError(
            f"min_length must be an integer of 1 or more; got {min_length!r}"
        )
    return unpack_tracks(X)[1].sum(axis=1) >= min_length


def select_balanced_tracks(
    labels: npt.ArrayLike,
    share: float = 0.1,
    *,
    random_state: int | np.random.RandomState | None = None,
) -> npt.NDArray[np.bool_]:
    """Subsample the largest group, such as the background, and keep all others.

    Parameters
    ----------
    labels : array-like of int, shape (n_tracks,)
        Group of each track; -1 for none, which is kept.
    share : float, default=0.1
        Share of the largest group to keep; at least one track is kept.
    random_state : int, RandomState instance or None, default=None
        Determines which tracks are kept.

    Returns
    -------
    ndarray of bool, shape (n_tracks,)
        True for the tracks to keep.

    Raises
    ------
    ValueError
        If ``share`` is not in (0, 1], or ``labels`` is not a vector.

    Examples
    --------
    >>> import numpy as np
    >>> from skmotionseg.preprocessing import select_balanced_tracks
    >>> labels = np.repeat([0, 1], [50, 7])
    >>> kept = select_balanced_tracks(labels, random_state=0)
    >>> np.bincount(labels[kept])
    array([5, 7])
    """
    if not isinstance(share, Real) or not 0 < share <= 1:
        raise ValueError(f"share must be a number in (0, 1]; got {share!r}")
    labels = check_labels(labels)
    kept = np.ones(len(labels), dtype=bool)
    groups, sizes = np.unique(labels[labels >= 0], return_counts=True)
    if len(groups) == 0:
        return kept
    largest = np.flatnonzero(labels == groups[sizes.argmax()])
    n_kept = max(1, round(share * len(largest)))
    kept[largest] = False
    kept[check_random_state(random_state).choice(largest, n_kept, replace=False)] = True
    return kept


def select_inliers(
    X: npt.ArrayLike, labels: npt.ArrayLike, *, whisker: float = 7.0
) -> npt.NDArray[np.bool_]:
    """Select tracks that are inliers of the epipolar geometry of their motion.

    A fundamental matrix is fitted robustly to the tracks of each motion in each two
    consecutive frames. The error of a track is its mean squared Sampson error over the
    frame pairs in which it is seen. It is an outlier if its error exceeds
    ``Q3 + whisker * IQR`` of its motion, with the third quartile and the interquartile
    range (Xu, Cheong and Li 2021, sec. 4.2.1, with robust least squares instead of
    RANSAC).

    Parameters
    ----------
    X : array-like of shape (n_tracks, 2 * n_frames)
        Tracks in pixels; NaN where unseen.
    labels : array-like of int, shape (n_tracks,)
        Motion of each track; -1 for none.
    whisker : float, default=7
        Factor of the interquartile range.

    Returns
    -------
    ndarray of bool, shape (n_tracks,)
        True for inliers. False for tracks of no motion; True for tracks that are never
        seen together with seven others of their motion, which cannot be tested.

    Raises
    ------
    ValueError
        If there is not one label per track, or ``whisker`` is negative.

    Notes
    -----
    The fundamental matrix of a planar motion has two free parameters, which may fit a
    few outliers: these are not found.

    Examples
    --------
    Tracks that slide off their motion get the label -1:

    >>> import numpy as np
    >>> from skmotionseg.datasets import make_rigid_motions
    >>> from skmotionseg.preprocessing import select_inliers
    >>> X, y = make_rigid_motions(missing=0, noise=0.3, random_state=0)
    >>> sliding = np.flatnonzero(y == 0)[:5]
    >>> X[sliding] += 8 * np.sin(np.arange(X.shape[1]) ** 2)
    >>> labels = np.where(select_inliers(X, y), y, -1)
    >>> labels[sliding]
    array([-1, -1, -1, -1, -1])
    """
    points, visibility = unpack_tracks(X)
    labels = check_label_each(labels, len(points))
    if not isinstance(whisker, Real) or not whisker >= 0:
        raise ValueError(f"whisker must be a number of 0 or more; got {whisker!r}")
    kept = labels >= 0
    for motion in np.unique(labels[kept]):
        members = np.flatnonzero(labels == motion)
        errors = mean_sampson_errors(points[members], visibility[members])
        judged = np.isfinite(errors)
        if not judged.any():
            continue
        lower, upper = np.quantile(errors[judged], [0.25, 0.75])
        bad = judged & (errors > upper + whisker * (upper - lower))
        kept[members[bad]] = False
    return kept
