"""Archives of arrays, as this package and point trackers write them."""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from .._core.geometry.tracks import (
    look_swapped,
    pack_tracks,
    spreads,
    unpack_tracks,
)
from .._utils.validation import LARGEST_SHARE, are_shares, farthest_from_zero
from .._utils.warning import warn_user
from ._npz import NpzArrays
from ._sizes import whole_numbers

# Names of what tells where points are seen, and of logits, or flags, of being hidden.
SEEN = (
    "visibility",
    "pred_visibility",
    "visibles",
    "visible",
    "vis",
    "visibilities",
    "pred_visibilities",
)
OCCLUSION = ("occlusion", "occlusions")


def read_npz(path, *, layout=None, visible_above=None, size_known=False):
    """Tracks, and labels if any, of a .npz file.

    Parameters
    ----------
    path : Path
    layout, visible_above
        As of :func:`pack_tracks`; None takes the layout that the names imply.
    size_known : bool
        Whether the caller knows the size of the image, which is then not looked for.

    Returns
    -------
    dict
        ``data`` (n_tracks, 2 * n_frames), ``target`` (n_tracks,) or None, and
        ``image_size``, width and height of the video where the file tells them and the
        points are shares of them, or None.

    Raises
    ------
    ValueError
        If the names are of no layout known, or what they hold does not fit.
    """
    with NpzArrays(path) as arrays:
        name = _tracks_name(arrays)
        if name == "X" or len(arrays.shape(name)) == 2:
            data = _matrix(arrays, name, layout, visible_above)
        else:
            points = arrays[name]
            layout = layout or _implied_layout(name, arrays) or usual_layout(points)
            visibility, visible_above = _visibility(arrays, visible_above)
            data = pack_tracks(
                points, visibility, layout=layout, visible_above=visible_above
            )
        image_size = None
        if not size_known and {"points", "occluded"} <= set(arrays):
            image_size = _tap_vid_size(data, arrays)
        labels = None
        if "labels" in arrays:
            labels = whole_numbers(arrays["labels"], "labels")
        found = {"data": data, "target": labels, "image_size": image_size}
        if "track_ids" in arrays:
            found["track_ids"] = _ids(arrays["track_ids"], len(data))
    return found


def _real(arrays, name):
    array = arrays[name]
    if array.dtype.kind not in "fiub":
        raise ValueError(f"{name!r} must be real numbers; got dtype {array.dtype}")
    return array.astype(float, copy=False)


def _matrix(arrays, name, layout, visible_above):
    """Tracks as this package writes them, and perhaps where they are seen."""
    data = _real(arrays, name)
    visibility, visible_above = _visibility(arrays, visible_above)
    if layout is not None:
        raise ValueError(
            f"{name!r} has a row per track and two columns per frame: layout is for "
            "points of three axes"
        )
    if visibility is None and visible_above is None:
        return data
    points, _ = unpack_tracks(data)
    return pack_tracks(
        points, visibility, layout="tracks_first", visible_above=visible_above
    )


def _ids(ids, n_tracks):
    if ids.shape != (n_tracks,):
        raise ValueError(
            f"'track_ids' must be one per track, shape ({n_tracks},); got {ids.shape}"
        )
    return ids if ids.dtype.kind in "iu" else whole_numbers(ids, "'track_ids'")


def _first_of(names, arrays):
    return next((name for name in names if name in arrays), None)


def _tracks_name(arrays):
    name = _first_of(("points", "X", "pred_tracks", "tracks"), arrays)
    if name is not None:
        return name
    raise ValueError(
        f"expected the array 'points' or 'X'; got {sorted(arrays)} (of trackers, "
        "'pred_tracks' or 'tracks')"
    )


def _implied_layout(name, arrays):
    """The order of axes that whoever uses these names has; None: pack_tracks decides.

    CoTracker (facebookresearch/co-tracker, ``predictor.py``) has frames first; TAPIR
    and TAP-Vid (google-deepmind/tapnet, ``model_utils.py`` and ``tapvid/README.md``)
    have tracks first.
    """
    if name == "pred_tracks":
        return "frames_first"
    if {"visibles", "occluded", *OCCLUSION} & set(arrays):
        return "tracks_first"
    if name == "tracks":
        return _batch_layout(arrays)
    return None


def usual_layout(points):
    """The layout of three axes, if nothing is said; None of others.

    Where these look swapped, who reads a file is warned by :func:`warn_if_swapped`.
    """
    return "tracks_first" if points.ndim == 3 else None


def _batch_layout(arrays):
    """The order of axes of "tracks" with "visibility".

    With the batch axis they are as CoTracker gives them, frames first, and must look
    like that: a track moves over less of the image than all tracks of a frame cover.
    """
    shape = arrays.shape("tracks")
    if len(shape) == 4 and shape[0] == 1 and shape[-1] == 2 and "visibility" in arrays:
        of_frame, of_track = spreads(arrays["tracks"][0])
        if of_track <= of_frame:
            return "frames_first"
    raise ValueError(
        f"'tracks' of shape {shape}, in a file of {sorted(arrays)}, may have tracks or "
        'frames first: pass layout="tracks_first" or layout="frames_first" (--layout '
        "of the command)"
    )


def _visibility(arrays, visible_above):
    """What tells which points are seen, or None, and what of it counts as seen."""
    name = _first_of((*SEEN, "occluded", *OCCLUSION), arrays)
    if name is None:
        return None, visible_above
    if name in SEEN:
        return arrays[name], visible_above
    occlusion = _real(arrays, name)
    if name == "occluded" or np.isin(occlusion, (0, 1)).all():  # as no logits are
        return 1.0 - occlusion, visible_above
    seen = expit(-occlusion)  # as in tapnet's postprocess_occlusions
    if "expected_dist" in arrays:
        seen *= expit(-_real(arrays, "expected_dist"))
    return seen, 0.5 if visible_above is None else visible_above


def _tap_vid_size(data, arrays):
    """Width and height of TAP-Vid's video, or None if the points are in pixels."""
    if data.size == 0 or farthest_from_zero(data) > LARGEST_SHARE:
        return None
    if "video" not in arrays:
        raise ValueError(
            "all points lie in [0, 1], as shares of the image's size, and there is no "
            "'video' to take its size from: pass image_size=(width, height)"
        )
    shape = arrays.shape("video")
    if len(shape) != 4:
        raise ValueError(
            f"'video' must have shape (n_frames, height, width, 3); got {shape}"
        )
    return shape[2], shape[1]


def warn_if_normalized(data, name):
    """Warn where tracks cannot be in pixels."""
    if not are_shares(data):
        return
    largest = farthest_from_zero(data)
    warn_user(
        f"all coordinates in {name} are between -{largest:.3g} and {largest:.3g}, so "
        "they are not pixels, and residuals are not in pixels either: if they are "
        "shares of the image's size, pass image_size=(width, height) (--image-size "
        "WIDTH HEIGHT of the command)",
    )


def warn_if_swapped(data, name):
    """Warn where what should be tracks looks like the points of a frame."""
    doubt = look_swapped(unpack_tracks(data)[0], f" in {name}")
    if doubt:
        warn_user(f"{doubt} (--layout frames_first of the command)")


def in_pixels(data, image_size):
    """Tracks in pixels, of tracks in shares of the image's width and height.

    Raises
    ------
    ValueError
        If the size is not two positive numbers, or the tracks are no shares.
    """
    size = np.asarray(image_size)
    good = size.shape == (2,) and size.dtype.kind in "fiu"
    if not good or not ((size > 0) & (size < np.inf)).all():
        raise ValueError(
            f"image_size must be width and height in pixels; got {image_size!r}"
        )
    largest = farthest_from_zero(data)
    if largest > LARGEST_SHARE:
        raise ValueError(
            "image_size is for points that are shares of it, in [0, 1]; got "
            f"coordinates of up to {largest:.6g}"
        )
    return data * np.tile(size, data.shape[1] // 2)
