"""Tracks as arrays: packing, visibility, frame pairs and normalised coordinates."""

from __future__ import annotations

import warnings
from itertools import pairwise
from numbers import Real
from typing import Any

import numpy as np
import numpy.typing as npt

# Points are in one spot when they lie closer than this share of their coordinates: the
# mean of equal numbers is not always that number.
ROUNDING = 1e-12
# Points are astray if they are so many times farther out than the usual ones are apart:
# in simulated scenes and real clips, those that are farthest out are 0.4 times.
ASTRAY = 2.0
# Share of the points at either side that are not usual; more if one track may be it.
OUTERMOST = 0.02
# Share of the tracks that the usual frame pairs must see, or other pairs are taken, and
# how many of those with most tracks in common; as many again at most for tracks that
# these miss.
ENOUGH_REACHED, MOST_COVISIBLE = 0.8, 24
# Pairs that are added at most for tracks that the usual ones do not see, and tracks
# that must be seen in each: those of a fundamental matrix.
MOST_MORE, FEWEST_IN_PAIR = 4, 8
# Share of the tracks below which those that go on are chance: the picture is another.
FEWEST_GO_ON = 0.25
# Tracks that move over more than so many times what all of them cover are suspicious,
# if there are so many.
FARTHEST_MOVED, FEWEST_COVERING = 2, 3
# Steps of points in no order, in standard deviations of their places: those of normal
# ones are 0.95 in the median. And the fewest points that tell.
LEAPS, FEWEST_LEAPS = 0.4, 8


LAYOUTS = ("tracks_first", "frames_first")
AXES = {
    "tracks_first": "(n_tracks, n_frames)",
    "frames_first": "(n_frames, n_tracks)",
}


def pack_tracks(
    points: npt.ArrayLike,
    visibility: npt.ArrayLike | None = None,
    *,
    layout: str | None = None,
    visible_above: float | None = None,
) -> npt.NDArray[np.floating]:
    """Put point tracks into the two-columns-per-frame matrix the estimators take.

    Parameters
    ----------
    points : array-like of shape (n_tracks, n_frames, 2)
        Pixel coordinates (x, y). Where a point was not seen, any value will do
        as long as ``visibility`` says so; NaN needs no ``visibility``, nor do the
        masked entries of a masked array. A leading batch axis of one video is
        dropped. Tensors of PyTorch are taken from any device.
    visibility : array-like of shape (n_tracks, n_frames), optional
        True (or 1) where the point was seen. May have the batch axis, and a last axis
        of length 1.
    layout : {"tracks_first", "frames_first"}, optional
        Whether the axes of ``points`` and ``visibility`` are tracks, then frames (as
        TAPIR has them), or frames, then tracks (as CoTracker has them). Three axes are
        taken as "tracks_first" if nothing is said, and warned of where they do not look
        like it; with a batch axis it must be said.
    visible_above : float, optional
        Needed if ``visibility`` holds probabilities: a point with a larger one was
        seen.

    Returns
    -------
    X : ndarray of shape (n_tracks, 2 * n_frames), float64 or float32
        Columns ``x_0, y_0, x_1, y_1, ...``; both are NaN where the point was
        not seen.

    Raises
    ------
    TypeError
        If ``points`` are not real numbers.
    ValueError
        If the shapes do not fit, there is more than one video in the batch, or a point
        marked as seen is infinite.

    Warns
    -----
    UserWarning
        If nothing is said of the layout, and the points look as if frames came first.

    Examples
    --------
    >>> import numpy as np
    >>> from skmotionseg import pack_tracks
    >>> points = np.array([[[1.0, 2.0], [3.0, 4.0]]])
    >>> pack_tracks(points, visibility=[[True, False]])
    array([[ 1.,  2., nan, nan]])

    What CoTracker returns, ``pred_tracks`` (1, n_frames, n_tracks, 2) and
    ``pred_visibility`` (1, n_frames, n_tracks):

    >>> pred_tracks, pred_visibility = np.ones((1, 5, 3, 2)), np.ones((1, 5, 3), bool)
    >>> pack_tracks(pred_tracks, pred_visibility, layout="frames_first").shape
    (3, 10)

    What TAPIR returns, ``tracks`` (1, n_tracks, n_frames, 2) and the logits
    ``occlusion`` and ``expected_dist``, seen as its authors have it:

    >>> from scipy.special import expit
    >>> tracks = np.ones((1, 3, 5, 2))
    >>> occlusion = expected_dist = np.full((1, 3, 5), -9.0)
    >>> seen = expit(-occlusion) * expit(-expected_dist)
    >>> pack_tracks(tracks, seen, layout="tracks_first", visible_above=0.5).shape
    (3, 10)
    """
    if layout is not None and layout not in LAYOUTS:
        raise ValueError(f"layout must be one of {LAYOUTS}; got {layout!r}")
    if visible_above is not None and visibility is None:
        raise ValueError("visible_above is about visibility; got no visibility")
    if visible_above is not None and not isinstance(visible_above, Real):
        raise TypeError(f"visible_above must be a number; got {visible_above!r}")
    if visible_above is not None and not 0 <= visible_above < 1:
        raise ValueError(
            "visible_above must be a probability, of 0 or more and less than 1; got "
            f"{visible_above}"
        )
    points = _drop_batch(_as_numbers(points, "points"), layout)
    said, layout = layout is not None, layout or "tracks_first"
    if visibility is not None:
        visibility = _as_visibility(visibility, points.shape[:2], layout, visible_above)
        points[~visibility] = np.nan
    if layout == "frames_first":
        points = points.swapaxes(0, 1)
    if np.isinf(points).any():
        raise ValueError(
            "points must be finite where they are seen and NaN where they are not; "
            f"got {int(np.isinf(points).any(axis=2).sum())} infinite points"
        )
    points[np.isnan(points).any(axis=2)] = np.nan
    doubt = "" if said else look_swapped(points)
    if doubt:
        warnings.warn(f'{doubt}; if not, layout="tracks_first"', stacklevel=2)
    return points.reshape(len(points), 2 * points.shape[1])


def look_swapped(points, place=""):
    """Why what should be tracks looks like the points of frames, and what to do.

    A track moves over less of the image than all tracks of a frame cover, or, if all
    of it moves and there are few, not over much more.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
        NaN where they are not seen.
    place : str
        Where they are, after " in ", if that is to be said.

    Returns
    -------
    str
        Empty if it does not, or there are so few tracks that they cover little in any
        case. No fewer than there are frames may follow a thing that crosses the image:
        these are suspected only if they leap to and fro, as no track does.
    """
    n_tracks, n_frames = points.shape[:2]
    if n_tracks < FEWEST_COVERING:
        return ""
    if n_tracks >= n_frames and not (n_frames >= FEWEST_LEAPS and leap(points)):
        return ""
    of_track, of_frame = spreads(points)
    if not of_track > FARTHEST_MOVED * of_frame:  # nor where nothing is known
        return ""
    return (
        f"the {n_tracks} tracks of {n_frames} frames{place} each move over more than "
        f"{FARTHEST_MOVED} times what all of them cover in a frame: if tracks and "
        'frames are in each other\'s place, pass layout="frames_first"'
    )


def leap(points):
    """Whether points, along the second axis, go about as far in a step as in all.

    Not so those that are sorted by their places.
    """
    if points.dtype.kind not in "fiub":
        return False
    steps = np.abs(np.diff(points, axis=1))
    if not np.isfinite(steps).any():
        return False
    along, _ = spreads(points)
    return bool(np.nanmedian(steps) > LEAPS * along)


def spreads(points):
    """Median standard deviations along the second axis, and along the first."""
    if points.dtype.kind not in "fiub" or not points.size:
        return 0.0, 0.0
    points = np.where(np.isfinite(points), points, np.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # where all are unseen
        return tuple(np.nanmedian(np.nanstd(points, axis=axis)) for axis in (1, 0))


def _as_numbers(values: npt.ArrayLike, name: str) -> npt.NDArray[np.floating]:
    """A copy in float32 where that is exact, else float64; NaN where it is masked."""
    values = as_array(values)
    if values.dtype.kind not in "fiub":
        raise TypeError(f"{name} must be real numbers; got dtype {values.dtype}")
    is_exact = np.can_cast(values.dtype, np.float32)
    dtype: type[np.floating] = np.float32 if is_exact else np.float64
    numbers = np.array(values, dtype=dtype)
    numbers[np.ma.getmaskarray(values)] = np.nan
    return numbers


def as_array(values: Any) -> np.ndarray:
    """An array, its mask kept, of whatever holds numbers.

    Of a list, a masked array, a tensor of PyTorch, or a data frame of pandas, in which
    what is missing becomes NaN; of an array of objects, if these are numbers.
    """
    if hasattr(values, "detach"):  # on another device, or with a gradient
        values = values.detach().cpu().numpy()
    values = stack_masked(values)
    array = values if np.ma.isMaskedArray(values) else np.asarray(values)
    if array.dtype.kind != "O":
        return array
    if hasattr(values, "notna"):  # a data frame, whose missing values are no numbers
        array = values.astype(object).where(values.notna(), np.nan).to_numpy()
    numbers = all(isinstance(each, Real) for each in array.flat)
    return array.astype(float) if numbers else array


def stack_masked(values: Any) -> Any:
    """A masked array, of a list of some; all else as it is.

    An array that is made of such a list otherwise holds what is under the masks.
    """
    if isinstance(values, list | tuple) and any(map(np.ma.isMaskedArray, values)):
        return np.ma.stack(values)
    return values


def _drop_batch(
    points: npt.NDArray[np.floating], layout: str | None
) -> npt.NDArray[np.floating]:
    """Points of three axes, of the one video there is."""
    axes = AXES[layout or "tracks_first"][:-1] + ", 2)"
    if points.ndim not in (3, 4) or points.shape[-1] != 2:
        raise ValueError(
            f"points must have shape {axes}; got {points.shape}{_hint(points.shape)}"
        )
    if points.ndim == 3:
        return points
    if len(points) != 1:
        raise ValueError(
            f"points must have shape {axes}; got {points.shape}, a batch of "
            f"{len(points)} videos: pack one at a time"
        )
    if layout is None:
        raise ValueError(
            f"points of shape {points.shape} may have tracks first (as from "
            "TAPIR) or frames first (as from CoTracker): pass "
            'layout="tracks_first" or layout="frames_first"'
        )
    return points[0]


def _hint(shape: tuple[int, ...]) -> str:
    """What is likely to be wrong with the shape of points, to end a message with."""
    if len(shape) == 2 and shape[1] % 2 == 0:
        return ": a matrix with two columns per frame is already packed"
    if len(shape) not in (3, 4):
        return ""
    if shape[-1] == 3:
        return (
            ": the last axis holds three numbers instead of x and y; if they are "
            "homogeneous coordinates or x, y and a confidence, pass points[..., :2]"
        )
    for axis in (-3, -2):
        if shape[axis] in (2, 3):
            return (
                f": x and y must be the last axis, as np.moveaxis(points, {axis}, -1)"
            )
    return ""


def _as_visibility(
    visibility: npt.ArrayLike,
    shape: tuple[int, ...],
    layout: str,
    visible_above: float | None,
) -> npt.NDArray[np.bool_]:
    visibility = as_array(visibility)
    visibility = _fit_axes(visibility, shape, layout)
    seen = ~np.ma.getmaskarray(visibility)
    visibility = np.ma.getdata(visibility)
    kind = visibility.dtype.kind
    if kind == "b":
        return visibility & seen
    if kind in "iuf" and visible_above is not None:
        if np.isnan(visibility[seen]).any():
            raise ValueError("visibility must be numbers throughout; got NaN")
        return (visibility > visible_above) & seen
    if kind not in "iuf" or not np.isin(visibility[seen], (0, 1)).all():
        raise ValueError(
            "visibility must be boolean, or numbers that are 0 or 1; "
            f"got dtype {visibility.dtype} with other values (if these are "
            "probabilities, pass a threshold, as in visible_above=0.5)"
        )
    return (visibility == 1) & seen


def _fit_axes(
    visibility: np.ndarray, shape: tuple[int, ...], layout: str
) -> np.ndarray:
    """Visibility of that shape, without the axes of length 1 around it."""
    inner = visibility
    if inner.ndim > 2 and inner.shape != shape and inner.shape[0] == 1:
        inner = inner[0]
    if inner.ndim > 2 and inner.shape[-1] == 1:
        inner = inner[..., 0]
    if inner.shape == shape:
        return inner
    message = (
        f"visibility must have shape {AXES[layout]} = {shape}; got {visibility.shape}"
    )
    if inner.shape == shape[::-1]:
        message += (
            ": one has tracks first, the other frames first; pass visibility.T if the "
            "points are right"
        )
    raise ValueError(message)


def unpack_tracks(
    X: npt.ArrayLike,
) -> tuple[npt.NDArray[np.floating], npt.NDArray[np.bool_]]:
    """Undo :func:`pack_tracks`.

    Parameters
    ----------
    X : array-like of shape (n_tracks, 2 * n_frames)
        Tracks; NaN (or masked) where a point was not seen.

    Returns
    -------
    points : ndarray of shape (n_tracks, n_frames, 2)
        Pixel coordinates; both are NaN where either was.
    visibility : ndarray of bool, shape (n_tracks, n_frames)
        True where both coordinates are finite.

    Raises
    ------
    TypeError
        If ``X`` are not real numbers.
    ValueError
        If ``X`` is not a matrix of an even number of columns, or holds infinities.

    Examples
    --------
    >>> import numpy as np
    >>> from skmotionseg import unpack_tracks
    >>> points, visibility = unpack_tracks([[1.0, 2.0, np.nan, 4.0]])
    >>> visibility
    array([[ True, False]])
    """
    X = _as_numbers(X, "tracks")
    if X.ndim != 2 or X.shape[1] % 2:
        raise ValueError(
            "tracks need two columns per frame; got "
            + (f"{X.shape[1]} columns" if X.ndim == 2 else f"an array of {X.ndim} axes")
        )
    if np.isinf(X).any():
        raise ValueError(
            "tracks must be finite where they are seen and NaN where they are not; "
            f"got {int(np.isinf(X).sum())} infinite numbers"
        )
    points = X.reshape(len(X), X.shape[1] // 2, 2)
    visibility = ~np.isnan(points).any(axis=2)
    points[~visibility] = np.nan
    return points, visibility


def frame_pairs(n_frames, frame_gap=1):
    """Index pairs ``(f, f + frame_gap)``; shape (n_frames - frame_gap, 2)."""
    first = np.arange(n_frames - frame_gap)
    return np.column_stack([first, first + frame_gap])


def covisible_pairs(visibility, usual):
    """Frame pairs that see the tracks, where the usual ones see too few of them.

    The images of unordered photographs have no neighbours: what is seen in two of them
    may be seen in no two that follow one another. If the usual pairs see fewer than
    four fifths of the tracks that some pair sees, the pairs are those with most tracks
    in common, each frame with at least one other, and those that see what these miss.
    If they see most, but not all, a few pairs are added that see the others, such as
    tracks with a gap in every other frame.

    Parameters
    ----------
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    usual : ndarray of int, shape (n_pairs, 2)

    Returns
    -------
    ndarray of int, shape (n_pairs, 2)
        The first frame of a pair before the second.
    """
    joinable = visibility[visibility.sum(axis=1) > 1]
    reached = _reached(joinable, usual)
    if reached.all():
        return usual
    if reached.mean() >= ENOUGH_REACHED:
        return _with_more(usual, joinable, ~reached)
    common = _n_common(joinable)
    pairs = _with_most(common, 1, MOST_COVISIBLE)
    np.fill_diagonal(common, -1)
    nearest = np.column_stack([np.arange(len(common)), common.argmax(axis=1)])
    chosen = np.unique(np.concatenate([pairs, np.sort(nearest, axis=1)]), axis=0)
    chosen = chosen[common[tuple(chosen.T)] > 0]
    missed = ~_reached(joinable, chosen)
    return np.unique(_with_more(chosen, joinable, missed, MOST_COVISIBLE), axis=0)


def pairs_with_most_tracks(visibility, fewest, most):
    """Frame pairs with most tracks in common.

    Parameters
    ----------
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    fewest : int
        Tracks that a pair must see.
    most : int
        Pairs.

    Returns
    -------
    ndarray of int, shape (n_pairs, 2)
        In the order of their frames, the first before the second.
    """
    return _with_most(_n_common(visibility), fewest, most)


def _with_most(common, fewest, most):
    """The same by the tracks (n_frames, n_frames) that each two frames see."""
    pairs = np.column_stack(np.triu_indices(len(common), 1))
    common = common[tuple(pairs.T)]
    order = np.argsort(-common, kind="stable")[:most]
    return pairs[np.sort(order[common[order] >= fewest])]


def _reached(visibility, pairs):
    """Whether some frame pair sees a track: bool, (n_tracks,)."""
    reached = np.zeros(len(visibility), dtype=bool)
    for first, second in pairs:
        reached |= visibility[:, first] & visibility[:, second]
    return reached


def _with_more(pairs, visibility, missed, most=MOST_MORE):
    """Frame pairs, and those that see most of the tracks that were missed so far."""
    n_seen, left = _n_common(visibility), visibility[missed]
    more: list[tuple] = []
    while len(left) and len(more) < most:
        n_left = np.triu(np.where(n_seen >= FEWEST_IN_PAIR, _n_common(left), 0), 1)
        first, second = np.unravel_index(n_left.argmax(), n_left.shape)
        if n_left[first, second] == 0:
            break
        more.append((first, second))
        left = left[~(left[:, first] & left[:, second])]
    return np.concatenate([pairs, more]).astype(int) if more else pairs


def _n_common(visibility):
    """Tracks (n_frames, n_frames) that each two frames see."""
    return visibility.T.astype(np.intp) @ visibility


def non_empty_frames(visibility, fewest):
    """Positions of the frames that see something; of all, if those are fewer."""
    filled = np.flatnonzero(visibility.any(axis=0))
    return filled if len(filled) >= fewest else np.arange(visibility.shape[1])


def covered(points, visibility=None):
    """Least and greatest coordinates of points, but for those that are astray.

    A lost track may be anywhere, and a picture as large as it would take all motions
    in it for one. Astray is what lies farther from the middle 96 % of the points, or
    from all but what one track may be, than ``ASTRAY`` times the larger side of what
    these cover.

    Parameters
    ----------
    points : ndarray of shape (n, 2) or (n_tracks, n_frames, 2)
        Of one frame, or tracks.
    visibility : ndarray of bool, shape (n_tracks, n_frames), optional
        Of tracks.

    Returns
    -------
    low, high : ndarray of shape (2,)
        Zeros if there are no points.
    """
    n_tracks = len(points)
    if visibility is not None:
        n_tracks, points = visibility.any(axis=1).sum(), points[visibility]
    if not len(points):
        return np.zeros(2), np.zeros(2)
    share = max(OUTERMOST, min(1.5 / n_tracks, 0.25))
    low, high = np.quantile(points, [share, 1 - share], axis=0)
    reach = ASTRAY * (high - low).max()
    if reach > 0:
        near = ((points >= low - reach) & (points <= high + reach)).all(axis=1)
        points = points[near]
    return points.min(axis=0), points.max(axis=0)


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
        Mean distance from the centres along one axis; positive. What is astray (see
        :func:`covered`) counts for neither.
    """
    low, high = covered(points, visibility)
    near = visibility & ((points >= low) & (points <= high)).all(axis=-1)
    filled = np.where(near[..., None], points, 0)
    centres = filled.sum(axis=0) / np.maximum(near.sum(axis=0)[:, None], 1)
    distance = np.abs(points - centres)[near]
    scale = distance.mean() if len(distance) else 0.0
    coincide = scale <= ROUNDING * np.abs(filled).max(initial=0)
    return centres, 1.0 if coincide else float(scale)


def shots(visibility):
    """Frames between cuts: [(start, stop), ...].

    Parameters
    ----------
    visibility : ndarray of bool, shape (n_tracks, n_frames)

    Returns
    -------
    list of (int, int)
        A cut is where fewer than a quarter (``FEWEST_GO_ON``) of the tracks before it
        go on after it, and of those after it are of before. In videos without cuts,
        more than a half do, even where a camera is shaken.
    """
    n_frames = visibility.shape[1]
    first, last = first_and_last(visibility)
    cuts = first_after_cuts(first, last, n_frames)
    return list(pairwise([0, *cuts, n_frames]))


def first_and_last(visibility):
    """Frames (n_seen,) that see each track first and last, but for unseen tracks."""
    seen = visibility[visibility.any(axis=1)]
    return seen.argmax(axis=1), seen.shape[1] - 1 - seen[:, ::-1].argmax(axis=1)


def first_after_cuts(first, last, n_frames, fewest=1):
    """The first frame after each cut, as of :func:`shots`.

    Parameters
    ----------
    first, last : ndarray of int, shape (n_tracks,)
        Frames that see each track first and last.
    n_frames : int
    fewest : int
        Tracks before a cut, and after it, at least. Where there are few, they may
        have been lost, and the picture be the same.

    Returns
    -------
    list of int
    """
    begun = np.cumsum(np.bincount(first, minlength=n_frames))[:-1]
    ended = np.cumsum(np.bincount(last, minlength=n_frames))[:-1]
    going_on = begun - ended  # from each frame to the next
    before = begun - np.append(0, ended[:-1])
    after = np.append(begun[1:], len(first)) - ended
    there = np.minimum(before, after)
    is_cut = (going_on < FEWEST_GO_ON * there) & (there >= fewest)
    return (1 + np.flatnonzero(is_cut)).tolist()


def tracks_by_frame(points, visibility):
    """Yield which tracks each frame sees, ascending, and where.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)

    Yields
    ------
    rows : ndarray of int, shape (n,)
    points : ndarray of shape (n, 2)
    """
    for number, rows in enumerate(map(np.flatnonzero, visibility.T)):
        yield rows, points[rows, number]
