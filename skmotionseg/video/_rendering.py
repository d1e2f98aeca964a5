"""Labels drawn on the frames of their video."""

from __future__ import annotations

import os
from collections.abc import Iterable
from numbers import Integral
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from .._core.geometry.tracks import unpack_tracks
from .._utils.colours import motion_colour, red_green_blue
from .._utils.optional import require
from .._utils.validation import check_frames, check_label_each
from .._utils.writing import check_output, replacing_path
from ._checks import check_fps, check_number, make_reporter
from ._frames import Progress, Source, first_frames, open_frames, silence_codecs
from ._pixels import at_scale

# Frames per second of a rendered clip whose source does not say.
DEFAULT_FPS = 25.0
# H.264 and VP9, which browsers play, and MPEG-4 Part 2, which every build can write.
CODECS = ("avc1", "vp09", "mp4v")
SILENT = 0  # a log level of OpenCV, which has no name in all versions
RENDER_ENDINGS = (".mp4", ".png")
# Frames on a contact sheet, and how wide one is drawn at most.
SHEET_FRAMES, SHEET_COLUMNS, SHEET_TILE = 9, 3, 640
# Pixels to which narrower frames are enlarged there, and those of "frame 123".
NARROWEST_TILE, CAPTION_WIDTH = 80, 112
BLACK, WHITE = (0, 0, 0), (255, 255, 255)
MOST_LABEL = 255  # of a mask of bytes
# Share of a mask's colour in what is drawn of it: the image shows through.
COVER = 0.4
# Pixels from the corner at which points are drawn at most: no picture is as wide, and
# OpenCV counts in 32 bits.
FARTHEST = 2**24


def render_segmentation(
    source: Source,
    X: npt.ArrayLike,
    labels: npt.ArrayLike,
    out: str | os.PathLike[str],
    *,
    masks: Iterable[npt.NDArray[np.uint8]] | None = None,
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
        ``.mp4``: a video of ``n_frames``, in H.264 or VP9 where OpenCV can write them;
        odd widths and heights, which it cannot have, grow by a pixel. ``.png``: a
        contact sheet of up to nine frames spread over the clip, with their numbers.
    masks : iterable of ndarray of uint8, shape (height, width), optional
        A label per pixel for each frame, as from :func:`dense_masks`: drawn as a
        translucent layer with contours, instead of the points; 0 is left as it is.
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
        have none, there is not one label per track, ``fps`` is no positive number, or
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
    check_frames(X, points)
    labels = check_label_each(labels, len(points))
    out = Path(out)
    check_output(out, RENDER_ENDINGS)
    check_number("trail", trail, Integral, 0)
    check_fps(fps)
    frames = open_frames(source)
    fps = fps or frames.fps or DEFAULT_FPS
    n_frames = points.shape[1]
    report = make_reporter(progress, n_frames)
    frames = first_frames(frames, n_frames, report)
    pen: Any = _Pen(points, visibility, labels, trail)
    if masks is not None:
        frames, pen = with_masks(frames, masks), _Brush()
    with replacing_path(out) as part:
        if out.suffix.lower() == ".png":
            _write_sheet(_draw_tiles(frames, pen, n_frames), part)
        else:
            _write_video(map(pen.draw, frames, range(n_frames)), part, fps)


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
            colour = red_green_blue(motion_colour(motion))[::-1]
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


def write_points(labelled, path, fps):
    """Write a video of frames with their points, as these come.

    If they fail after some frames, the video of these is there before that is raised.
    Of no frame, nothing is written.

    Parameters
    ----------
    labelled : iterable of (frame, points, labels)
        Points (n, 2) in pixels of the frame, and a label for each.
    path : Path
        Ending in ``.mp4``.
    fps : float
    """
    pictures = (with_points(*each) for each in labelled)
    first = next(pictures, None)
    if first is None:
        return
    failures: list[BaseException] = []
    with replacing_path(path) as part:
        _write_video(_until_failure(first, pictures, failures), part, fps)
    for failure in failures:
        raise failure


def _until_failure(first, others, failures):
    """Yield pictures; what fails after the first is appended to a list instead."""
    yield first
    try:
        yield from others
    except (Exception, KeyboardInterrupt) as failure:
        failures.append(failure)


def with_points(frame, points, labels):
    """A copy of a frame with its points (n, 2) in the colours of their labels."""
    seen = np.ones((len(points), 1), dtype=bool)
    return _Pen(points[:, None], seen, labels, trail=0).draw(frame, 0)


def with_masks(frames, masks):
    """Pairs of a frame and its mask, checked."""
    masks = iter(masks)
    for number, frame in enumerate(frames):
        mask = next(masks, None)
        if mask is None or np.shape(mask) != frame.shape[:2]:
            got = "none" if mask is None else f"one of shape {np.shape(mask)}"
            raise ValueError(
                f"frame {number} needs a mask of shape {frame.shape[:2]}; got {got}"
            )
        mask = np.asarray(mask)
        if mask.dtype.kind not in "biu" or mask.min() < 0 or mask.max() > MOST_LABEL:
            raise ValueError(
                f"a mask has whole numbers from 0 to {MOST_LABEL}; got, of frame "
                f"{number}, {mask.min()} to {mask.max()}, dtype {mask.dtype}"
            )
        yield frame, mask.astype(np.uint8)


class _Brush:
    """Draws masks on frames: translucent, with contours."""

    def draw(self, pair, number, scale=1.0):
        """A copy of a frame, scaled, with its mask laid over it."""
        cv2 = require("cv2", extra="video")
        frame, mask = pair
        if scale != 1:
            size = [round(side * scale) for side in frame.shape[1::-1]]
            frame = cv2.resize(frame, size, interpolation=cv2.INTER_AREA)
            mask = cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST)
        canvas = frame.copy()
        for motion in np.unique(mask[mask > 0]).tolist():
            colour = red_green_blue(motion_colour(motion))[::-1]
            inside = mask == motion
            layer = np.multiply(colour, COVER) + (1 - COVER) * frame[inside]
            canvas[inside] = layer.astype(np.uint8)
            outline = cv2.findContours(
                inside.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE
            )[0]
            for thickness, shade in ((3, WHITE), (1, colour)):
                cv2.drawContours(canvas, outline, -1, shade, thickness, cv2.LINE_AA)
        return canvas


def _to_canvas(points, scale):
    """Nearest pixels, their centres being whole numbers, of a scaled frame."""
    pixels = np.rint(at_scale(points, scale))
    return pixels.clip(-FARTHEST, FARTHEST).astype(np.int32)


def _write_video(pictures, path, fps):
    cv2 = require("cv2", extra="video")
    writer = cv2.VideoWriter()
    try:
        for picture in pictures:
            picture = _padded_to_even(picture)
            if not writer.isOpened():
                _open_writer(writer, path, fps, picture.shape[1::-1])
            writer.write(picture)
    finally:
        writer.release()


def _open_writer(writer, path, fps, size):
    """Open a writer with the first codec that this build of OpenCV can write."""
    cv2 = require("cv2", extra="video")
    silence_codecs()
    logging = getattr(cv2.utils, "logging", cv2)  # 4.8 has them in cv2
    level = logging.getLogLevel()
    logging.setLogLevel(SILENT)  # a missing codec is no news
    try:
        for codec in CODECS:
            code = cv2.VideoWriter_fourcc(*codec)
            if writer.open(str(path), cv2.CAP_FFMPEG, code, fps, size):
                return
    finally:
        logging.setLogLevel(level)
    raise OSError(
        f"OpenCV cannot write a video of {size[0]} x {size[1]} pixels at {fps:g} "
        f"frames per second to {path.parent}"
    )


def _padded_to_even(picture):
    cv2 = require("cv2", extra="video")
    height, width = picture.shape[:2]
    return cv2.copyMakeBorder(
        picture, 0, height % 2, 0, width % 2, cv2.BORDER_REPLICATE
    )


def _draw_tiles(frames, pen, n_frames):
    """Numbered pictures of some frames, from the first to the last."""
    chosen = np.linspace(0, n_frames - 1, min(n_frames, SHEET_FRAMES)).round()
    for number, frame in enumerate(frames):
        if number not in chosen:
            continue
        height, width = np.shape(frame[0] if isinstance(frame, tuple) else frame)[:2]
        scale = min(1.0, SHEET_TILE / max(height, width))
        scale = max(scale, NARROWEST_TILE / width)
        tile = pen.draw(frame, number, scale)
        _write_caption(tile, f"frame {number}")
        yield tile


def _write_caption(tile, text):
    """Write in white with a black outline: the same letters, moved by a pixel.

    Thicker ones are wider, too, in OpenCV 5, and stand beside the white ones.
    """
    cv2 = require("cv2", extra="video")
    size = min(1.0, tile.shape[1] / CAPTION_WIDTH)
    left, bottom = round(8 * size), round(22 * size)
    around = [(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1) if (x, y) != (0, 0)]
    outline = [(*moved, BLACK) for moved in around]
    for right, down, colour in [*outline, (0, 0, WHITE)]:
        cv2.putText(
            tile,
            text,
            (left + right, bottom + down),
            cv2.FONT_HERSHEY_SIMPLEX,
            0.6 * size,
            colour,
            1,
            cv2.LINE_AA,
        )


def _write_sheet(tiles, path):
    cv2 = require("cv2", extra="video")
    tiles = list(tiles)
    blank = np.full_like(tiles[0], 255)
    tiles += [blank] * (-len(tiles) % SHEET_COLUMNS)
    rows = zip(*[iter(tiles)] * SHEET_COLUMNS, strict=True)
    sheet = np.vstack([np.hstack(row) for row in rows])
    if not cv2.imwrite(str(path), sheet):
        raise OSError(f"OpenCV cannot write a picture to {path.parent}")
