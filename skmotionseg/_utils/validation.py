"""Reading and checking input: the one place where matrices and labels enter."""

from __future__ import annotations

from numbers import Integral, Real

import numpy as np
import numpy.typing as npt
from sklearn.utils import gen_batches
from sklearn.utils._param_validation import Interval
from sklearn.utils.validation import check_non_negative, validate_data

from .._core.geometry.tracks import stack_masked
from .column_names import check_columns

# Constraint of the parameter ``n_jobs``: 0 has no meaning.
N_JOBS = [
    Interval(Integral, 1, None, closed="left"),
    Interval(Integral, None, -1, closed="right"),
    None,
]
# Where stacked affinities are not square or not symmetric, this is the usual cause.
OF_A_FOLD = (
    "the rows of a fold are no stacked affinities: cross-validate tracks, with "
    "make_motion_pipeline, or use one split of all rows"
)
# Shares of an image's size are in [0, 1] where a point is seen, or a little outside.
LARGEST_SHARE = 2
# Tracks from which on points of just (0, 0) are no coincidence, and share of all.
FEWEST_LEAPS, SHARE_OF_LEAPS = 3, 0.02
# Pixels from there to all else of a track: whole pixels may pass by (0, 0).
LEAP = 2
# Tracks of a matrix that are unpacked, or looked at, at a time: of one of a long clip,
# which holds hardly any points, nothing of its size fits beside it.
BATCH = 1000
# Fewer tracks than a fundamental matrix needs may be anything.
FEWEST_TO_WARN = 8
# Pixels beyond which a number is no place in an image.
FARTHEST = 1e12


class TooFewTracksError(ValueError):
    """There are fewer tracks than the motions or their hypotheses need."""


class TracksInput:
    """Mixin of the estimators whose rows are tracks.

    All of them read their input through :meth:`_read_tracks` alone.
    """

    def _read_tracks(self, X, *, reset):
        """Check tracks, and leave them packed.

        Parameters
        ----------
        X : array-like of shape (n_tracks, 2 * n_frames)
        reset : bool
            Whether this is ``fit``, which sets ``n_features_in_``.

        Returns
        -------
        ndarray of shape (n_tracks, 2 * n_frames), float64
            ``X`` itself where it is such.

        Raises
        ------
        TypeError, ValueError
            If ``X`` is not a dense real matrix, has an odd number of columns or
            fewer than four, or holds infinities; or if it is a data frame whose columns
            have names that are not of x and y of each frame, in this order.
        """
        _check_packed(X)
        X = read_matrix(
            self,
            X,
            reset=reset,
            dtype=np.float64,
            ensure_all_finite="allow-nan",
        )
        if X.shape[1] % 2 or X.shape[1] < 4:
            one_frame = ", which is one frame" if X.shape[1] == 2 else ""
            raise ValueError(
                "tracks need two columns per frame and at least two frames; "
                f"got {X.shape[1]} columns{one_frame}"
            )
        check_farthest(X)
        return X

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()  # type: ignore[misc]
        tags.input_tags.allow_nan = True
        return tags


def _check_packed(X):
    """Refuse points that were not packed, and tracks of which there are none."""
    shape: tuple[int, ...] = getattr(X, "shape", ())
    if len(shape) in (3, 4):
        kind = "(n_tracks, n_frames, 2)" if len(shape) == 3 else "one video in a batch"
        layout = "" if len(shape) == 3 else ", layout=..."
        raise ValueError(
            "X must be a matrix (n_tracks, 2 * n_frames); got an array of shape "
            f"{tuple(shape)}: convert points of {kind} by "
            f"pack_tracks(points, visibility{layout})"
        )
    if len(shape) == 2 and shape[0] == 0 and shape[1] > 0:
        raise TooFewTracksError(
            f"there are no tracks: X has 0 samples, shape={tuple(shape)}"
        )
    names = list(getattr(X, "columns", ()))
    if names and all(isinstance(name, str) for name in names):
        check_columns([name.strip().lower() for name in names])


def unmasked(points):
    """The points, NaN where a masked array, or one of a list, is masked: unseen."""
    points = stack_masked(points)
    if np.ma.isMaskedArray(points) and points.dtype.kind in "fiu":
        return np.ma.filled(points.astype(float), np.nan)
    return points


def farthest_from_zero(points):
    """The largest absolute coordinate; 0 where there is none."""
    # As floats: half precision ends below FARTHEST, and integers are not all negated.
    return max(
        float(np.fmax.reduce(points, axis=None, initial=0)),
        -float(np.fmin.reduce(points, axis=None, initial=0)),
    )


def are_shares(points):
    """Whether coordinates can be no pixels: they seem to be shares of a size."""
    enough = len(points) >= FEWEST_TO_WARN
    return enough and 0 < farthest_from_zero(points) <= LARGEST_SHARE


def row_batches(tracks):
    """Some rows of a matrix of tracks after the other."""
    return (tracks[batch] for batch in gen_batches(len(tracks), BATCH))


def placeholder_of(tracks):
    """What unseen points seem to have for both coordinates; None if they are NaN.

    Some tools write them as (0, 0), some as (-1, -1) or another number that is below or
    above all others.

    Parameters
    ----------
    tracks : ndarray of shape (n_tracks, 2 * n_frames)
        So it seems if several of them, and not very few, are just there at times, and
        never near.

    Returns
    -------
    float or None
    """
    lowest = float(np.fmin.reduce(tracks, axis=None, initial=np.inf))
    highest = float(np.fmax.reduce(tracks, axis=None, initial=-np.inf))
    values = 0.0, -1.0, lowest, highest
    held = np.zeros(len(values), dtype=int)
    for some in row_batches(tracks):
        some = some[(some[:, ::2] == some[:, 1::2]).any(axis=1)]  # hardly any
        held += [_leaping_to(value, some) for value in values]
    fewest = max(FEWEST_LEAPS, SHARE_OF_LEAPS * len(tracks))
    return next((v for v, n in zip(values, held, strict=True) if n >= fewest), None)


def _leaping_to(value, tracks):
    """How many tracks are at a value in both coordinates at times, and else far off."""
    there = (tracks[:, ::2] == value) & (tracks[:, 1::2] == value)
    tracks = tracks[there.any(axis=1)]
    distance = np.fmax(np.abs(tracks[:, ::2] - value), np.abs(tracks[:, 1::2] - value))
    nearest = np.where(distance > 0, distance, np.inf).min(axis=1, initial=np.inf)
    return int((np.isfinite(nearest) & (nearest > LEAP)).sum())


def check_farthest(points):
    """Refuse numbers that are no pixels, and of which products overflow."""
    farthest = farthest_from_zero(points)
    if farthest > FARTHEST:
        raise ValueError(
            f"tracks must be in pixels, of up to {FARTHEST:.0e}; got {farthest:.3g}"
        )


def check_frames(X, points):
    """Refuse tracks (n_tracks, n_frames, 2) that have no frame."""
    if not points.shape[1]:
        raise ValueError(
            "tracks need two columns per frame, of one frame or more; got an array of "
            f"shape {np.shape(X)}"
        )


def check_estimator_parameters(estimator):
    """Refuse bad parameters of an estimator, and of those that it holds.

    Parameters
    ----------
    estimator : object
        What has no check of its own, as estimators of others may, is left alone.

    Raises
    ------
    InvalidParameterError
    TypeError
        If it is a class.
    """
    check_instance(estimator)
    inner = estimator.get_params() if hasattr(estimator, "get_params") else {}
    for each in (estimator, *inner.values()):
        if hasattr(each, "_parameter_constraints"):
            each._validate_params()


def check_instance(estimator):
    """Refuse the class of an estimator, which has the methods of one."""
    if isinstance(estimator, type):
        name = estimator.__name__
        raise TypeError(f"an estimator is needed, such as {name}(); got its class")


def forget_fit(estimator, private=()):
    """Remove what a fit has found, before another begins.

    That may set less, and one that fails must not leave some of either.

    Parameters
    ----------
    estimator : estimator
    private : sequence of str
        What a fit keeps beside attributes that end in an underscore.
    """
    for name in [*vars(estimator)]:
        if name in private or (name.endswith("_") and not name.startswith("_")):
            delattr(estimator, name)


def read_matrix(estimator, X, **checks):
    """What :func:`~sklearn.utils.validation.validate_data` gives, without a warning.

    It looks for infinities in the sum of all numbers, and NumPy warns where there are
    some of both signs; the error that is due is the same. It takes what is under the
    mask of a masked array for a number, which here is NaN.
    """
    with np.errstate(invalid="ignore"):
        return validate_data(estimator, unmasked(X), **checks)


def read_affinities(estimator, X):
    """Check stacked affinities for ``fit`` and split them into views.

    Parameters
    ----------
    estimator : estimator
        Whose ``n_features_in_`` is set.
    X : array-like of shape (n, n_views * n)
        Symmetric, non-negative affinities side by side.

    Returns
    -------
    ndarray of shape (n_views, n, n), float64

    Raises
    ------
    ValueError
        If ``X`` is not made of square, symmetric, non-negative, finite blocks.
    """
    X = read_matrix(estimator, X, dtype=np.float64)
    check_non_negative(X, type(estimator).__name__)
    n, width = X.shape
    if width % n:
        raise ValueError(
            "stacked affinities need shape (n, n_views * n), square blocks side by "
            f"side; got {X.shape} ({OF_A_FOLD})"
        )
    views = np.ascontiguousarray(X.reshape(n, -1, n).swapaxes(0, 1))
    check_symmetric(views)
    return views


def check_symmetric(views):
    """Refuse affinities (n_views, n, n) of which one is not symmetric."""
    for v, view in enumerate(views):
        asymmetry = np.abs(view - view.T).max()
        if asymmetry > 1e-5 * view.max():
            raise ValueError(
                f"affinities need to be symmetric; entries of view {v} differ from "
                f"their transposes by up to {asymmetry:.3g} ({OF_A_FOLD})"
            )


def split_views(X, n_views):
    """Stacked rows (m, n_views * n) as views (n_views, m, n)."""
    return X.reshape(len(X), n_views, -1).swapaxes(0, 1)


def check_n_groups(name, count, graph):
    """Raise if a number of groups exceeds the tracks that can be grouped."""
    if count > len(graph.connected):
        raise ValueError(
            f"{name}={count} is more than the {len(graph.connected)} tracks that have "
            f"an affinity to another (n_samples={graph.n_samples})"
        )


def nothing_masked(numbers: npt.ArrayLike, name: str) -> npt.NDArray:
    """Labels or ids as an array, if no mask hides any of them."""
    if np.ma.is_masked(numbers):
        raise ValueError(f"{name} must be known throughout; some are masked")
    return np.asarray(numbers)


def check_labels(
    labels: npt.ArrayLike, name: str = "labels"
) -> npt.NDArray[np.integer]:
    """Labels as a vector of integers.

    Parameters
    ----------
    labels : array-like of int, shape (n_tracks,)
    name : str, default="labels"
        What they are, for the message.

    Raises
    ------
    ValueError
        If they are no vector, or no whole numbers.
    """
    labels = nothing_masked(labels, name)
    if labels.ndim != 1:
        raise ValueError(f"{name} must be a vector; got shape {labels.shape}")
    if not labels.size:
        return labels.astype(int)  # an empty list has no integers
    if labels.dtype.kind not in "iu":
        raise ValueError(f"{name} must be whole numbers; got dtype {labels.dtype}")
    return labels


def check_label_each(
    labels: npt.ArrayLike, n_tracks: int, name: str = "labels"
) -> npt.NDArray[np.integer]:
    """Labels as an array of integers, one per track.

    Parameters
    ----------
    labels : array-like of int, shape (n_tracks,)
    n_tracks : int
    name : str, default="labels"
        What they are, for the message.

    Raises
    ------
    ValueError
        If there are more or fewer, or they are no whole numbers.
    """
    labels = nothing_masked(labels, name)
    if labels.shape != (n_tracks,):
        raise ValueError(
            f"{n_tracks} tracks need one label each; got {name} of shape {labels.shape}"
        )
    return check_labels(labels, name)


def check_ids(track_ids: npt.ArrayLike, n_tracks: int) -> npt.NDArray[np.integer]:
    """Names of tracks as an array of integers, one per track.

    Parameters
    ----------
    track_ids : array-like of shape (n_tracks,)
        Integers, also as objects, or floats that are whole and, below 2^53, exact.
    n_tracks : int

    Raises
    ------
    ValueError
        If there are more or fewer, one is no such number, or one comes twice.
    """
    ids = nothing_masked(track_ids, "track_ids")
    if ids.shape != (n_tracks,):
        raise ValueError(f"{n_tracks} tracks need an id each; got shape {ids.shape}")
    if ids.dtype.kind not in "iu":
        others = [name for name in ids.tolist() if not _is_whole(name)]
        if others:
            raise ValueError(
                "track_ids must be whole numbers that fit in 64 bits; got "
                f"{others[0]!r} (dtype {ids.dtype})"
            )
        ids = np.array([int(name) for name in ids.tolist()], dtype=np.int64)
    check_each_once(ids)
    return ids


def check_each_once(ids):
    """Refuse names of tracks, as a table may have them, that do not tell these apart.

    Parameters
    ----------
    ids : ndarray of numbers, shape (n_tracks,)

    Raises
    ------
    ValueError
        If one comes twice, or is NaN.
    """
    names, times = np.unique(ids, return_counts=True)
    if (names != names).any():
        raise ValueError("track_ids must be numbers; one is missing")
    if (times > 1).any():
        raise ValueError(
            f"track_ids must each come once; got {names[times > 1][0]} more often"
        )


def _is_whole(number):
    """Whether it is an integer of 64 bits, or a float that stands for one alone."""
    if isinstance(number, bool):  # an Integral, too
        return False
    if isinstance(number, Integral):
        return -(2**63) <= int(number) < 2**63
    if not isinstance(number, Real):
        return False
    return float(number).is_integer() and abs(float(number)) < 2**53
