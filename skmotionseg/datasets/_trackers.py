"""Archives of arrays, as this package and point trackers write them."""

from __future__ import annotations

import numpy as np
from scipy.special import expit

from .._core.geometry.tracks import pack_tracks
from ._npz import NpzArrays
from ._sizes import whole_numbers

# Shares of an image's size are in [0, 1] where a point is seen, or a little outside.
LARGEST_SHARE = 2


def read_npz(path, *, layout=None, image_size=None, visible_above=None):
    """Tracks, and labels if any, of a .npz file.

    Parameters
    ----------
    path : Path
    layout, visible_above
        As of :func:`pack_tracks`; None takes the layout that the names imply.
    image_size : (int, int) or None
        Width and height in pixels, if coordinates are shares of them.

    Returns
    -------
    dict
        ``data`` (n_tracks, 2 * n_frames) and ``target`` (n_tracks,) or None.

    Raises
    ------
    ValueError
        If the names are of no layout known, or what they hold does not fit.
    """
    with NpzArrays(path) as arrays:
        if "X" in arrays and "points" not in arrays:
            data = _real(arrays, "X")
        else:
            name = _points_name(arrays)
            layout = layout or _implied_layout(name, arrays)
            visibility, visible_above = _visibility(arrays, visible_above)
            data = pack_tracks(
                arrays[name], visibility, layout=layout, visible_above=visible_above
            )
        if image_size is None and {"points", "occluded"} <= set(arrays):
            image_size = _tap_vid_size(data, arrays)
        if image_size is not None:
            data = _in_pixels(data, image_size)
        labels = None
        if "labels" in arrays:
            labels = whole_numbers(arrays["labels"], "labels")
    return {"data": data, "target": labels}


def _real(arrays, name):
    array = arrays[name]
    if array.dtype.kind not in "fiub":
        raise ValueError(f"{name!r} must be real numbers; got dtype {array.dtype}")
    return array.astype(float, copy=False)


def _points_name(arrays):
    for name in ("points", "pred_tracks", "tracks"):
        if name in arrays:
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
    if {"visibles", "occluded", "occlusion"} & set(arrays):
        return "tracks_first"
    if name == "tracks":
        raise ValueError(
            f"'tracks' of shape {arrays[name].shape}, in a file of {sorted(arrays)}, "
            'may have tracks or frames first: say layout="tracks_first" or '
            'layout="frames_first"'
        )
    return None


def _visibility(arrays, visible_above):
    """What tells which points are seen, or None, and what of it counts as seen."""
    for name in ("visibility", "pred_visibility", "visibles"):
        if name in arrays:
            return arrays[name], visible_above
    if "occluded" in arrays:
        return 1.0 - _real(arrays, "occluded"), visible_above
    if "occlusion" in arrays:  # logits; seen as in tapnet's postprocess_occlusions
        seen = expit(-_real(arrays, "occlusion"))
        if "expected_dist" in arrays:
            seen *= expit(-_real(arrays, "expected_dist"))
        return seen, 0.5 if visible_above is None else visible_above
    return None, visible_above


def _tap_vid_size(data, arrays):
    """Width and height of TAP-Vid's video, or None if the points are in pixels."""
    if data.size == 0 or _largest(data) > LARGEST_SHARE:
        return None
    if "video" not in arrays:
        raise ValueError(
            "all points lie in [0, 1], as shares of the image's size, and there is no "
            "'video': say image_size=(width, height)"
        )
    shape = arrays.shape("video")
    if len(shape) != 4:
        raise ValueError(
            f"'video' must have shape (n_frames, height, width, 3); got {shape}"
        )
    return shape[2], shape[1]


def _largest(data):
    return np.nanmax(np.abs(data), initial=0)


def _in_pixels(data, image_size):
    size = np.asarray(image_size)
    good = size.shape == (2,) and size.dtype.kind in "fiu"
    if not good or not ((size > 0) & (size < np.inf)).all():
        raise ValueError(
            f"image_size must be width and height in pixels; got {image_size!r}"
        )
    largest = _largest(data)
    if largest > LARGEST_SHARE:
        raise ValueError(
            "image_size is for points that are shares of it, in [0, 1]; got "
            f"coordinates of up to {largest:.6g}"
        )
    return data * np.tile(size, data.shape[1] // 2)
