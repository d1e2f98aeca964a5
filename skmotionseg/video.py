"""From video to tracks and back. Needs OpenCV: ``pip install "skmotionseg[video]"``."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import islice
from numbers import Integral, Real
from pathlib import Path
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from ._core.geometry.tracks import pack_tracks, unpack_tracks
from ._core.tracking import (
    TrackLog,
    field_gradient,
    is_inside,
    sample_field,
    seed_points,
)
from ._frames import open_frames
from ._utils.colours import motion_colour
from ._utils.optional import require
from ._utils.validation import check_label_each
from ._utils.writing import check_output, replacing_path

# Side, in pixels, of the window in which texture is measured and flow is refined.
WINDOW = 11
# Where flow changes by more, in pixels a pixel, one thing covers another, and tracks of
# the covered one would go on with the other. Sundaram et al. let the limit grow with
# the flow, which lets such tracks through in quick scenes.
MAX_FLOW_GRADIENT = 0.22
# Optical flow needs pictures of this many pixels a side.
SMALLEST_SIDE = 16
# Frames a second of a rendered clip whose source does not say.
DEFAULT_FPS = 25.0
RENDER_ENDINGS = (".mp4", ".png")
# Frames on a contact sheet, and how wide one is drawn at most.
SHEET_FRAMES, SHEET_COLUMNS, SHEET_TILE = 9, 3, 640
# Pixels from the corner at which points are drawn at most: no picture is as wide, and
# OpenCV counts in 32 bits.
FARTHEST = 2**24

# What frames are read from, and what is told how many are done, of how many.
Source: TypeAlias = str | os.PathLike[str] | Iterable[npt.NDArray[np.uint8]]
Progress: TypeAlias = Callable[[int, int | None], object]


@dataclass(frozen=True, eq=False)
class VideoTracks:
    """Tracks of a video, and what there is to know about it.

    Attributes
    ----------
    tracks : ndarray of shape (n_tracks, 2 * n_frames), float32
        In pixels of the video; NaN where unseen. The ``X`` of the estimators.
    n_frames : int
    width, height : int
        Of a frame, in pixels.
    fps : float or None
        Frames a second, where the source says.

    Examples
    --------
    >>> import numpy as np
    >>> from skmotionseg.video import VideoTracks
    >>> VideoTracks(np.zeros((1, 4)), n_frames=2, width=64, height=48, fps=25.0).fps
    25.0
    """

    tracks: np.ndarray
    n_frames: int
    width: int
    height: int
    fps: float | None


# --------------------------------------------------------------------------- tracking


def track_video(
    source: Source,
    *,
    grid_spacing: int = 8,
    max_error: float = 1.0,
    min_length: int = 5,
    min_texture: float = 0.03,
    max_frames: int | None = None,
    max_side: int | None = None,
    progress: Progress | None = None,
) -> VideoTracks:
    """Track points on a dense grid through a video.

    In each frame, each cell of the grid that no track is in or near gets a new one, at
    its best textured pixel. A track follows the optical flow (DIS, then
    Lucas-Kanade to a few hundredths of a pixel) for as long as the flow leads back to
    where it came from, away from edges of moving things, and inside the picture.

    Frames are read one at a time and no more than three are held; memory grows with
    the tracks alone.

    Parameters
    ----------
    source : path or iterable of arrays
        A video file (.mp4, .avi, .mov, .mkv), a folder of frames (.png, .jpg, in the
        order of the numbers in their names), or frames as uint8 arrays of shape
        (height, width) or (height, width, 3), blue first.
    grid_spacing : int, default=8
        Side of the square cells, pixels.
    max_error : float, default=1.0
        A track ends where going forward and back again misses by more pixels than
        this.
    min_length : int, default=5
        Tracks seen in fewer frames are dropped.
    min_texture : float, default=0.03
        Tracks start where the smaller eigenvalue of the structure tensor exceeds this
        share of its mean over the frame: elsewhere the flow is a guess. (Sundaram et
        al. take 1/8, which leaves few tracks on things that are plainer than the rest.)
    max_frames : int, optional
        Stop after so many.
    max_side : int, optional
        Frames of a longer side are shrunk to it to be tracked, which is faster;
        ``grid_spacing`` and ``max_error`` are pixels of the shrunk frame, the tracks
        those of the video.
    progress : callable, optional
        Called after each frame with the number done and the number there should be
        (None if the source does not say).

    Returns
    -------
    VideoTracks

    Raises
    ------
    FileNotFoundError, TypeError, ValueError
        If the source is not as described, is damaged, has fewer than two frames,
        or frames of different sizes or of sides under 16 pixels.
    ImportError
        If opencv-python-headless is missing.

    Warns
    -----
    UserWarning
        If a video ends before it should: how many frames were read of how many.

    References
    ----------
    N. Sundaram, T. Brox and K. Keutzer, "Dense Point Trajectories by GPU-accelerated
    Large Displacement Optical Flow", ECCV 2010: the grid, the check and the texture.
    T. Kroeger et al., "Fast Optical Flow using Dense Inverse Search", ECCV 2016.

    Examples
    --------
    A picture that moves two pixels to the right and one down in each frame:

    >>> import numpy as np
    >>> from scipy.ndimage import gaussian_filter
    >>> from skmotionseg.video import track_video
    >>> noise = np.random.default_rng(0).normal(size=(100, 100))
    >>> scene = np.uint8(128 + 300 * gaussian_filter(noise, 2))
    >>> frames = [scene[20 - f : 84 - f, 20 - 2 * f : 84 - 2 * f] for f in range(6)]
    >>> result = track_video(frames)
    >>> result.n_frames, result.width, result.height
    (6, 64, 64)
    >>> whole = result.tracks[np.isfinite(result.tracks).all(axis=1)]
    >>> np.median(whole[:, -2:] - whole[:, :2], axis=0).round()
    array([10.,  5.], dtype=float32)
    """
    _check_number("grid_spacing", grid_spacing, Integral, 2)
    _check_number("max_error", max_error, Real, 0)
    _check_number("min_length", min_length, Integral, 1)
    _check_number("min_texture", min_texture, Real, 0)
    if max_frames is not None:
        _check_number("max_frames", max_frames, Integral, 2)
    if max_side is not None:
        _check_number("max_side", max_side, Integral, SMALLEST_SIDE)
    frames = open_frames(source)
    report = _make_reporter(progress, _least(frames.n_announced, max_frames))
    sower, flow, log = (
        _Sower(grid_spacing, min_texture),
        _PointFlow(max_error),
        TrackLog(),
    )
    points, ids, previous = np.empty((0, 2)), np.empty(0, dtype=int), None
    for frame in islice(frames, max_frames):
        height, width = frame.shape[:2]
        picture, scale = _shrunk_grey(frame, max_side)
        if previous is not None:
            points, followed = flow.follow(previous, picture, points)
            ids = ids[followed]
        points, ids = sower.sow(picture, points, ids)
        log.record(ids, (points + 0.5) / scale - 0.5)  # pixels have their centre at 0
        previous = picture
        report(log.n_frames)
    if log.n_frames < 2:
        raise ValueError(
            f"tracks need two frames or more; {frames.name} has {log.n_frames}"
        )
    return VideoTracks(
        pack_tracks(log.assemble(min_length)), log.n_frames, width, height, frames.fps
    )


def _check_number(name, value, kind, least):
    good = isinstance(value, kind) and not isinstance(value, bool)
    if not good or not least <= value < np.inf:
        noun = "an integer" if kind is Integral else "a number"
        error = ValueError if good else TypeError
        raise error(f"{name} must be {noun} of {least} or more; got {value!r}")


def _check_fps(fps):
    if fps is None:
        return
    good = isinstance(fps, Real) and not isinstance(fps, bool)
    if not good or not 0 < fps < np.inf:
        error = ValueError if good else TypeError
        raise error(f"fps must be a number above 0; got {fps!r}")


def _least(*numbers):
    return min((number for number in numbers if number is not None), default=None)


def _make_reporter(progress, total):
    return (
        (lambda done: None) if progress is None else lambda done: progress(done, total)
    )


def _shrunk_grey(frame, max_side):
    """A frame in grey, its longer side at most so long, and by how much it shrank."""
    cv2 = require("cv2", extra="video")
    height, width = frame.shape[:2]
    if min(height, width) < SMALLEST_SIDE:
        raise ValueError(
            f"frames need {SMALLEST_SIDE} pixels a side or more to be tracked; got "
            f"{width} x {height}"
        )
    grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
    scale = 1.0 if max_side is None else min(1.0, max_side / max(height, width))
    if scale == 1.0:
        return grey, scale
    size = [max(SMALLEST_SIDE, round(side * scale)) for side in (width, height)]
    return cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.divide(
        size, (width, height)
    )


class _Sower:
    """Starts tracks where there are none."""

    def __init__(self, spacing, min_texture):
        self._spacing = spacing
        self._min_texture = min_texture
        self._n_born = 0

    def sow(self, picture, points, ids):
        """Add new points, with new ids, to those that live."""
        cv2 = require("cv2", extra="video")
        texture = cv2.cornerMinEigenVal(picture, WINDOW)
        threshold = self._min_texture * texture.mean()
        born = seed_points(texture, self._spacing, threshold, points)
        born_ids = self._n_born + np.arange(len(born))
        self._n_born += len(born)
        return np.concatenate([points, born]), np.concatenate([ids, born_ids])


class _PointFlow:
    """Moves points from picture to picture."""

    def __init__(self, max_error):
        cv2 = require("cv2", extra="video")
        self._max_error = max_error
        # The preset "medium" takes four times as long. Once refined, both are as exact.
        self._dense = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_FAST)

    def follow(self, first, second, points):
        """Points in the second picture, and which of those in the first they are."""
        if len(points) == 0:
            return points, np.zeros(0, dtype=bool)
        flow = self._dense.calc(first, second, None)
        moved = _refine(first, second, points, points + sample_field(flow, points))
        back = self._dense.calc(second, first, None)
        returned = _refine(second, first, moved, moved + sample_field(back, moved))
        good = np.hypot(*(returned - points).T) <= self._max_error
        good &= is_inside(moved, second.shape)
        good &= field_gradient(flow, points) <= MAX_FLOW_GRADIENT
        return moved[good], good


def _refine(first, second, points, coarse):
    """Better places in the second picture of points of the first (Lucas-Kanade)."""
    cv2 = require("cv2", extra="video")
    fine, found, _ = cv2.calcOpticalFlowPyrLK(
        first,
        second,
        points.astype(np.float32),
        coarse.astype(np.float32),
        winSize=(WINDOW, WINDOW),
        maxLevel=0,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        criteria=(cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 10, 0.01),
    )
    return np.where(found == 1, fine, coarse)


# -------------------------------------------------------------------------- rendering


def render_segmentation(
    source: Source,
    X: npt.ArrayLike,
    labels: npt.ArrayLike,
    out: str | os.PathLike[str],
    *,
    trail: int = 5,
    fps: float | None = None,
    progress: Progress | None = None,
) -> None:
    """Draw the points of a segmentation on the frames of their video.

    Each point has the colour of its motion, the one it has in
    :func:`skmotionseg.plotting.plot_motions`, and a tail over the last frames; a point
    of no motion is a hollow grey circle. Frames are read one at a time, and the file
    is put in its place once it is whole.

    Parameters
    ----------
    source : path or iterable of arrays
        The video of the tracks, as for :func:`track_video`.
    X : array-like of shape (n_tracks, 2 * n_frames)
        Tracks in pixels of the video; NaN where unseen.
    labels : array-like of int, shape (n_tracks,)
        Motion of each track; -1 for none.
    out : path
        ``.mp4``: a video (MPEG-4 Part 2) of ``n_frames``; odd widths and heights,
        which it cannot have, grow by a pixel. ``.png``: a contact sheet of up to nine
        frames spread over the clip, with their numbers.
    trail : int, default=5
        Frames that tails go back; 0 for none.
    fps : float, optional
        Frames a second; by default the source's, or 25 if it has none.
    progress : callable, optional
        Called after each frame with the number done and the number there will be.

    Returns
    -------
    None

    Raises
    ------
    FileNotFoundError, TypeError, ValueError
        If the source is not as described or has fewer frames than the tracks, these
        have none, there is not a label a track, ``fps`` is no positive number, or
        ``out`` has another ending or no folder.
    OSError
        If the video cannot be written.
    ImportError
        If opencv-python-headless is missing.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import numpy as np
    >>> from skmotionseg.video import render_segmentation, track_video
    >>> frames = np.full((3, 48, 64), 200, dtype=np.uint8)  # n_frames, height, width
    >>> X = [[10, 10, 12, 10, 14, 10], [40, 30, 40, 30, 40, 30]]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     out = pathlib.Path(folder, "motions.mp4")
    ...     render_segmentation(frames, X, [0, 1], out)
    ...     out.stat().st_size > 0
    True
    """
    points, visibility = unpack_tracks(X)
    if not points.shape[1]:
        raise ValueError("tracks of one frame or more are needed; got none")
    labels = check_label_each(labels, len(points))
    out = Path(out)
    check_output(out, RENDER_ENDINGS)
    _check_number("trail", trail, Integral, 0)
    _check_fps(fps)
    frames = open_frames(source)
    fps = fps or frames.fps or DEFAULT_FPS
    n_frames = points.shape[1]
    report = _make_reporter(progress, n_frames)
    frames = _first_frames(frames, n_frames, report)
    pen = _Pen(points, visibility, labels, trail)
    with replacing_path(out) as part:
        if out.suffix.lower() == ".png":
            _write_sheet(_draw_tiles(frames, pen, n_frames), part)
        else:
            _write_video(map(pen.draw, frames, range(n_frames)), part, fps)


def _first_frames(frames, n_frames, report):
    """Exactly so many frames, or an error."""
    done = 0
    for done, frame in enumerate(islice(frames, n_frames), start=1):
        yield frame
        report(done)
    if done < n_frames:
        raise ValueError(f"the tracks have {n_frames} frames, but {frames.name} {done}")


class _Pen:
    """Draws the points of a frame.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    labels : ndarray of int, shape (n_tracks,)
    trail : int
    """

    def __init__(self, points, visibility, labels, trail):
        self._points = points
        self._visibility = visibility
        self._trail = trail
        # Points of no motion are drawn first, small motions last: on top of others.
        self._motions = [(m, np.flatnonzero(labels == m)) for m in np.unique(labels)]

    def draw(self, frame, number, scale=1.0):
        """A paler copy of a frame, scaled, with its points and their tails."""
        cv2 = require("cv2", extra="video")
        if scale != 1:
            frame = cv2.resize(
                frame, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA
            )
        canvas = cv2.convertScaleAbs(frame, alpha=0.6, beta=80)
        radius = max(2, round(min(canvas.shape[:2]) / 240))
        for motion, rows in self._motions:
            colour = _blue_green_red(motion_colour(motion))
            tails = self._tails(rows, number, scale)
            cv2.polylines(canvas, tails, False, colour, 1)
            seen = rows[self._visibility[rows, number]]
            thickness = 1 if motion < 0 else cv2.FILLED
            for x, y in _to_canvas(self._points[seen, number], scale).tolist():
                cv2.circle(canvas, (x, y), radius, colour, thickness, cv2.LINE_AA)
        return canvas

    def _tails(self, rows, number, scale):
        """Steps of tracks that are seen now, over the last frames: (n, 2, 2)."""
        rows = rows[self._visibility[rows, number]]
        first = max(0, number - self._trail)
        points = self._points[rows, first : number + 1]
        seen = self._visibility[rows, first : number + 1]
        steps = np.stack([points[:, :-1], points[:, 1:]], axis=2)  # (n, trail, 2, 2)
        return _to_canvas(steps[seen[:, :-1] & seen[:, 1:]], scale)


def _to_canvas(points, scale):
    """Nearest pixels, their centres being whole numbers, of a scaled frame."""
    pixels = np.rint((points + 0.5) * scale - 0.5)
    return pixels.clip(-FARTHEST, FARTHEST).astype(np.int32)


def _blue_green_red(colour):
    return tuple(int(colour[i : i + 2], 16) for i in (5, 3, 1))


def _write_video(pictures, path, fps):
    cv2 = require("cv2", extra="video")
    writer = cv2.VideoWriter()
    try:
        for picture in pictures:
            picture = _padded_to_even(picture)
            if not writer.isOpened():
                size = picture.shape[1::-1]
                codec = cv2.VideoWriter_fourcc(*"mp4v")  # every build of OpenCV has it
                writer.open(str(path), cv2.CAP_FFMPEG, codec, fps, size)
                if not writer.isOpened():
                    raise OSError(
                        f"OpenCV cannot write a video of {size[0]} x {size[1]} pixels "
                        f"at {fps:g} frames a second to {path.parent}"
                    )
            writer.write(picture)
    finally:
        writer.release()


def _padded_to_even(picture):
    cv2 = require("cv2", extra="video")
    height, width = picture.shape[:2]
    return cv2.copyMakeBorder(
        picture, 0, height % 2, 0, width % 2, cv2.BORDER_REPLICATE
    )


def _draw_tiles(frames, pen, n_frames):
    """Numbered pictures of some frames, from the first to the last."""
    cv2 = require("cv2", extra="video")
    chosen = np.linspace(0, n_frames - 1, min(n_frames, SHEET_FRAMES)).round()
    for number, frame in enumerate(frames):
        if number not in chosen:
            continue
        scale = min(1.0, SHEET_TILE / max(frame.shape))
        tile = pen.draw(frame, number, scale)
        for colour, thickness in (((0, 0, 0), 4), ((255, 255, 255), 1)):
            cv2.putText(
                tile,
                f"frame {number}",
                (8, 22),
                cv2.FONT_HERSHEY_SIMPLEX,
                0.6,
                colour,
                thickness,
                cv2.LINE_AA,
            )
        yield tile


def _write_sheet(tiles, path):
    cv2 = require("cv2", extra="video")
    tiles = list(tiles)
    blank = np.full_like(tiles[0], 255)
    tiles += [blank] * (-len(tiles) % SHEET_COLUMNS)
    rows = zip(*[iter(tiles)] * SHEET_COLUMNS, strict=True)
    sheet = np.vstack([np.hstack(row) for row in rows])
    if not cv2.imwrite(str(path), sheet):
        raise OSError(f"OpenCV cannot write a picture to {path.parent}")
