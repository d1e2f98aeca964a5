"""A page to look at a segmentation: one file that needs no network."""

from __future__ import annotations

import base64
import html
import json
import os
from collections.abc import Iterable
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from .._core.geometry.tracks import unpack_tracks
from .._utils.colours import COLOURS, OUTLIER_COLOUR, SHADES, motion_colour
from .._utils.optional import require
from .._utils.png import encode_grey
from .._utils.validation import check_frames, check_label_each
from .._utils.writing import check_output, replacing
from ._checks import make_reporter
from ._frames import Progress, Source, first_frames, open_frames
from ._rendering import DEFAULT_FPS, with_masks

# Longer side of the pictures in a page, pixels; their quality as JPEG; tracks at most.
VIEW_SIDE, QUALITY, MOST_TRACKS = 640, 75, 3000
# Colours of motions that differ.
N_COLOURS = len(COLOURS) * len(SHADES)
# Tracks of its motion with which a track is compared.
N_NEIGHBOURS = 8


def write_viewer(
    source: Source,
    X: npt.ArrayLike,
    labels: npt.ArrayLike,
    out: str | os.PathLike[str],
    *,
    masks: Iterable[npt.NDArray[np.uint8]] | None = None,
    probabilities: npt.ArrayLike | None = None,
    progress: Progress | None = None,
) -> None:
    """Write a page with the video, its masks and its tracks, for any browser.

    The page has a scrubber, masks and trails of each motion to switch on and off, and
    says of a point that is clicked on which motion it has, by how much it moves unlike
    the tracks of its motion around it, and how probable its label is.

    Parameters
    ----------
    source : path or iterable of arrays
        The video of the tracks, as for :func:`track_video`.
    X : array-like of shape (n_tracks, 2 * n_frames)
        Tracks in pixels of the video; NaN where unseen. Of very many, 3,000 are drawn.
    labels : array-like of int, shape (n_tracks,)
        Motion of each track, 0 being the static scene; -1 for none.
    out : path
        ``.html``.
    masks : iterable of ndarray of uint8, shape (height, width), optional
        A label per pixel for each frame, as from :func:`dense_masks`.
    probabilities : array-like of shape (n_tracks,), optional
        Of the labels; NaN where none is known.
    progress : callable, optional
        Called after each frame with the number done and the number there will be.

    Returns
    -------
    None

    Raises
    ------
    FileNotFoundError, TypeError, ValueError
        If the source is not as described or has fewer frames than the tracks, these
        have none, there is not one label, or one probability from 0 to 1, per track, a
        mask is missing, or ``out`` has another ending or no folder.
    ImportError
        If opencv-python-headless is missing.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import numpy as np
    >>> from skmotionseg.video import write_viewer
    >>> frames = np.full((3, 48, 64), 200, dtype=np.uint8)  # n_frames, height, width
    >>> X = [[10, 10, 12, 10, 14, 10], [40, 30, 40, 30, 40, 30]]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     out = pathlib.Path(folder, "motions.html")
    ...     write_viewer(frames, X, [1, 0], out)
    ...     "http" in out.read_text()
    False
    """
    points, visibility = unpack_tracks(X)
    check_frames(X, points)
    labels = check_label_each(labels, len(points))
    sure = None if probabilities is None else _shares(probabilities, len(labels))
    out = Path(out)
    check_output(out, (".html",))
    frames = open_frames(source)
    n_frames = points.shape[1]
    read = first_frames(frames, n_frames, make_reporter(progress, n_frames))
    pairs = ((f, None) for f in read) if masks is None else with_masks(read, masks)
    images, layers, scale = _encode(pairs)
    motions = sorted({*labels.tolist(), *images["labels"], 0})
    data: dict[str, Any] = {
        "images": images["urls"],
        "masks": layers,
        "width": images["width"],
        "height": images["height"],
        "fps": frames.fps or DEFAULT_FPS,
        "motions": motions,
        "colours": [motion_colour(motion) for motion in range(N_COLOURS)],
        "outlier": OUTLIER_COLOUR,
        "tracks": _describe(points, visibility, labels, sure, scale),
    }
    _write_page(out, data)


def _shares(probabilities, n_tracks):
    """Probabilities, checked to be such or unknown."""
    sure = np.asarray(probabilities, dtype=float)
    if sure.shape != (n_tracks,):
        raise ValueError(
            f"{n_tracks} tracks need one probability each; got shape {sure.shape}"
        )
    wrong = sure[~np.isnan(sure) & ~((sure >= 0) & (sure <= 1))]
    if len(wrong):
        raise ValueError(f"probabilities must be from 0 to 1; got {wrong[0]}")
    return sure


def _encode(pairs):
    """Data URLs of pictures and of masks, whose red value is the label."""
    cv2 = require("cv2", extra="video")
    urls, layers, scale, size = [], [], 1.0, (0, 0)
    labels: set[int] = set()
    for frame, mask in pairs:
        scale = min(1.0, VIEW_SIDE / max(frame.shape[:2]))
        size = tuple(max(1, round(side * scale)) for side in frame.shape[1::-1])
        small = cv2.resize(frame, size, interpolation=cv2.INTER_AREA)
        _, content = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        urls.append(_data_url("jpeg", content.tobytes()))
        if mask is not None:
            mask = cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST)
            labels.update(np.unique(mask).tolist())
            layers.append(_data_url("png", encode_grey(mask)))
    images = {"urls": urls, "width": size[0], "height": size[1], "labels": labels}
    return images, layers, scale


def _data_url(kind, content):
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


def _describe(points, visibility, labels, sure, scale):
    """One dict per run of frames that see a track, of some tracks of each motion."""
    residuals = _residuals(points, visibility, labels)
    rows = []
    for motion in np.unique(labels):
        own = np.flatnonzero(labels == motion)
        share = -(-len(own) * MOST_TRACKS // max(len(labels), MOST_TRACKS))
        rows.extend(own[np.linspace(0, len(own) - 1, share).astype(int)].tolist())
    tracks = []
    for row in rows:
        seen = np.flatnonzero(visibility[row])
        for run in np.split(seen, np.flatnonzero(np.diff(seen) > 1) + 1):
            if len(run) == 0:
                continue
            places = ((points[row, run] + 0.5) * scale).round(1)
            tracks.append(
                {
                    "motion": int(labels[row]),
                    "first": int(run[0]),
                    "places": places.tolist(),
                    "residual": _number(residuals[row]),
                    "probability": None if sure is None else _number(sure[row]),
                }
            )
    return tracks


def _number(value):
    return round(float(value), 3) if np.isfinite(value) else None


def _residuals(points, visibility, labels):
    """Median distance of a track's steps from those of its motion around it, pixels."""
    steps = np.diff(points, axis=1)
    seen = visibility[:, 1:] & visibility[:, :-1]
    misses = np.full(seen.shape, np.nan)
    for frame in range(steps.shape[1]):
        for motion in np.unique(labels[labels >= 0]):
            rows = np.flatnonzero(seen[:, frame] & (labels == motion))
            if len(rows) <= N_NEIGHBOURS:
                continue
            tree = KDTree(points[rows, frame])
            _, near = tree.query(points[rows, frame], N_NEIGHBOURS + 1)
            around = np.median(steps[rows[near[:, 1:]], frame], axis=1)
            misses[rows, frame] = np.linalg.norm(steps[rows, frame] - around, axis=1)
    result = np.full(len(points), np.nan)
    judged = np.isfinite(misses).any(axis=1)
    if judged.any():
        result[judged] = np.nanmedian(misses[judged], axis=1)
    return result


def _write_page(out, data):
    page = files(__package__).joinpath("_viewer.html").read_text(encoding="utf-8")
    content = json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
    page = page.replace("__TITLE__", html.escape(out.stem))
    with replacing(out) as file:
        file.write(page.replace("__DATA__", content).encode())
