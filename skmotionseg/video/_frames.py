"""Frames one at a time, from a video file, a folder of pictures or arrays."""

from __future__ import annotations

import math
import os
import re
import struct
from collections.abc import Callable, Iterable
from copy import copy
from functools import partial
from itertools import islice
from numbers import Integral
from pathlib import Path
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from .._utils.optional import require
from .._utils.warning import warn_user

# What frames are read from, and what is told how many are done, of how many.
Source: TypeAlias = str | os.PathLike[str] | Iterable[npt.NDArray[np.uint8]] | int
Progress: TypeAlias = Callable[[int, int | None], object]

# Optical flow needs pictures of this many pixels per side.
SMALLEST_SIDE = 16
VIDEO_ENDINGS = (".mp4", ".m4v", ".mov", ".avi", ".mkv", ".webm")
# Those that do not say how many frames they have: OpenCV takes how long they last, with
# their sound, times the rate.
UNCOUNTED = (".mkv", ".webm")
PICTURE_ENDINGS = (".png", ".jpg", ".jpeg")
# Of a frame: twice those of 8K. A few bytes may claim more, and OpenCV believe them.
MOST_PIXELS = 2**26
PNG, JPEG = b"\x89PNG\r\n\x1a\n", b"\xff\xd8"
# Marker segments of JPEG that start a frame, and those that nothing follows.
JPEG_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
JPEG_BARE = {0x01, *range(0xD0, 0xD9)}


class Frames:
    """Frames to iterate over, as often as one likes, each read when it is due.

    Attributes
    ----------
    name : str
        What error messages call the source.
    fps : float or None
        Frames a second, where the source knows.
    n_announced : int or None
        Frames there should be, where the source says.
    """

    def __init__(self, name, make_iterator, *, fps=None, n_announced=None, names=None):
        self.name = name
        self.fps = fps
        self.n_announced = n_announced
        self._make_iterator = make_iterator
        self._names = names
        self._stride = 1

    @property
    def names(self):
        """File names of the frames, or None if they are in no files."""
        return None if self._names is None else self._names[:: self._stride]

    def every(self, stride):
        """Every so many of the frames, from the first on."""
        fewer = copy(self)
        fewer._stride = self._stride * stride
        if stride > 1:
            fewer.name = f"{self.name}, one frame of {stride},"
        fewer.fps = None if self.fps is None else self.fps / stride
        if self.n_announced is not None:
            fewer.n_announced = -(-self.n_announced // stride)
        return fewer

    def name_of(self, number):
        """File name of a frame; of a video, its number in it, from 0."""
        number *= self._stride
        return f"{number:05d}.png" if self._names is None else self._names[number]

    def __iter__(self):
        """Frames (height, width, 3), uint8, blue first; all of one size.

        Raises
        ------
        ValueError
            If a frame cannot be read, is no picture, or differs in size from the
            first.

        Warns
        -----
        UserWarning
            If a video ends before it should: how many frames were read of how many.
        """
        shape = None
        frames = islice(self._make_iterator(), None, None, self._stride)
        for number, frame in enumerate(frames):
            frame = _as_picture(frame, f"frame {number} of {self.name}")
            if shape is not None and frame.shape != shape:
                raise ValueError(
                    f"frames of one size are needed; in {self.name} the first is "
                    f"{shape[1]} x {shape[0]} pixels and frame {number} is "
                    f"{frame.shape[1]} x {frame.shape[0]}"
                )
            shape = frame.shape
            yield frame
            del frame  # the caller decides how long a frame lives


def is_video(path):
    """Whether a path names a video or a folder of frames, rather than a track file."""
    return path.is_dir() or path.suffix.lower() in VIDEO_ENDINGS


def open_frames(source, cameras=False):
    """Make a source of frames, reading no more than is needed to know it is one.

    Parameters
    ----------
    source : path of a video or of a folder of pictures, iterable of arrays, or int
    cameras : bool, default=False
        Whether a whole number is a camera, which has no end.

    Returns
    -------
    Frames

    Raises
    ------
    FileNotFoundError, TypeError, ValueError
        If there is no such file, or it is none of these, or is damaged or empty.
    ImportError
        If opencv-python-headless is missing.
    """
    require("cv2", extra="video")
    if isinstance(source, Frames):
        return source
    if cameras and isinstance(source, Integral) and not isinstance(source, bool):
        return _open_camera(int(source))
    if isinstance(source, (str, Path)) or hasattr(source, "__fspath__"):
        path = Path(source)
        return _open_folder(path) if path.is_dir() else _open_video(path)
    try:
        iter(source)
    except TypeError:
        raise TypeError(
            "expected the path of a video or of a folder of frames, or arrays; got "
            f"{type(source).__name__}"
        ) from None
    n_announced = len(source) if hasattr(source, "__len__") else None
    if isinstance(source, list | tuple | np.ndarray):
        return Frames("the arrays", lambda: iter(source), n_announced=n_announced)
    copied = partial(np.array, subok=True)  # others may fill one again and again
    return Frames("the arrays", lambda: map(copied, source), n_announced=n_announced)


def first_frames(frames, n_frames, report):
    """Exactly so many frames, or an error."""
    done = 0
    for done, frame in enumerate(islice(frames, n_frames), start=1):
        yield frame
        report(done)
    if done < n_frames:
        raise ValueError(f"the tracks have {n_frames} frames, but {frames.name} {done}")


def _as_picture(frame, name):
    frame = np.asarray(frame)
    grey = frame.ndim == 2
    is_shaped = grey or (frame.ndim == 3 and frame.shape[2] == 3)
    if frame.dtype != np.uint8 or not is_shaped or not frame.size:
        raise ValueError(
            f"{name} must be uint8 of shape (height, width) or (height, width, 3), not "
            f"empty; got {frame.dtype} of shape {frame.shape}"
        )
    return np.repeat(frame[..., None], 3, axis=2) if grey else frame


# ----------------------------------------------------------------------------- videos


def _open_video(path):
    if not path.exists():
        raise FileNotFoundError(f"no video or folder of frames at {path}")
    if not path.is_file():
        raise ValueError(
            f"{path} is no file, and videos are read more than once: save it to a file"
        )
    if path.suffix.lower() not in VIDEO_ENDINGS:
        raise ValueError(f"videos end in {', '.join(VIDEO_ENDINGS)}; got {path.name!r}")
    if path.stat().st_size == 0:
        raise ValueError(f"{path} is not a video: it has no bytes")
    cv2 = require("cv2", extra="video")
    capture = _capture(path)
    fps = capture.get(cv2.CAP_PROP_FPS)
    count = capture.get(cv2.CAP_PROP_FRAME_COUNT)
    size = [
        capture.get(p) for p in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
    ]
    capture.release()
    _check_size(path, *map(int, size))
    n_expected = int(count) if math.isfinite(count) and count > 0 else None
    is_counted = path.suffix.lower() not in UNCOUNTED
    return Frames(
        str(path),
        lambda: _read_video(path, n_expected, is_counted),
        fps=fps if math.isfinite(fps) and fps > 0 else None,
        n_announced=n_expected if is_counted else None,
    )


def _check_size(path, width, height):
    """Refuse frames of no pixels, or more than any camera's, before they are read."""
    if not 0 < width * height <= MOST_PIXELS:
        raise ValueError(
            f"{path} claims frames of {width} x {height} pixels; expected 1 to "
            f"{MOST_PIXELS} in all"
        )


def silence_codecs():
    """Print nothing of what FFmpeg says of videos, unless the user has asked for it.

    Codecs that are missing are no news, and errors are told in one line. It heeds this
    only before it is first used.
    """
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")


def _capture(path):
    cv2 = require("cv2", extra="video")
    silence_codecs()
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    if not capture.isOpened():
        raise ValueError(
            f"{path} cannot be read as a video: it is damaged, cut short before its "
            "index, or of an unknown kind"
        )
    return capture


def _read_video(path, n_expected, is_counted):
    capture = _capture(path)
    n_read = 0
    try:
        while True:
            good, frame = capture.read()
            if not good:
                break
            n_read += 1
            yield frame
            del frame
    finally:
        capture.release()
    if n_expected is not None and n_read < n_expected:
        if n_read == 0:
            raise ValueError(f"none of the {n_expected} frames of {path} can be read")
        if is_counted:
            warn_user(
                f"{path} is cut short or damaged: {n_read} of {n_expected} frames "
                "could be read"
            )
        elif n_read < n_expected - 1:  # which is rounded
            warn_user(
                f"{n_read} frames of {path} were read, and it lasts as long as "
                f"{n_expected}: its sound may be longer than its pictures, or its rate "
                "vary; or it is cut short"
            )


# ---------------------------------------------------------------------------- cameras


def _open_camera(number):
    cv2 = require("cv2", extra="video")
    capture = cv2.VideoCapture(number)
    if not capture.isOpened():
        raise FileNotFoundError(f"there is no camera {number}")
    fps = capture.get(cv2.CAP_PROP_FPS)
    return Frames(f"camera {number}", lambda: _read_camera(capture), fps=fps or None)


def _read_camera(capture):
    try:
        while True:
            good, frame = capture.read()
            if not good:
                return
            yield frame
    finally:
        capture.release()


# ---------------------------------------------------------------------------- folders


def _open_folder(folder):
    paths = sorted(filter(_is_frame, folder.iterdir()), key=_natural_order)
    if not paths:
        raise ValueError(
            f"no frames ({', '.join(PICTURE_ENDINGS)}) are in the folder {folder}"
        )
    return Frames(
        str(folder),
        lambda: map(_read_picture, paths),
        n_announced=len(paths),
        names=[path.name for path in paths],
    )


def _is_frame(path):
    """Whether this is a picture: no folder, and no hidden file, as ``._0.png`` is."""
    is_named_so = path.suffix.lower() in PICTURE_ENDINGS
    return is_named_so and not path.name.startswith(".") and not path.is_dir()


def _natural_order(path):
    """Sorts frame2 before frame10."""
    parts = re.split(r"(\d+)", path.name)
    # Not isdigit, which takes superscripts for numbers.
    return [int(part) if part.isdecimal() else part for part in parts]


def _read_picture(path):
    cv2 = require("cv2", extra="video")
    # Not cv2.imread, which knows no names beyond ASCII on some systems.
    content = np.fromfile(path, dtype=np.uint8)
    size = _picture_size(content.tobytes())
    if size is not None:
        _check_size(path, *size)
    try:
        frame = None if size is None else cv2.imdecode(content, cv2.IMREAD_COLOR)
    except cv2.error:  # of what its own reader does not bear
        frame = None
    if frame is None:
        raise ValueError(
            f"{path} is not a picture that can be read: expected a whole .png or .jpg"
        )
    return frame


def _picture_size(content):
    """Width and height that a PNG or JPEG claims; None if it is neither."""
    if content.startswith(PNG) and len(content) >= 24:
        return struct.unpack_from(">II", content, 16)
    if not content.startswith(JPEG):
        return None
    at = len(JPEG)
    while at + 9 <= len(content):
        if content[at] != 0xFF:
            return None
        marker = content[at + 1]
        if marker in JPEG_FRAMES:
            return struct.unpack_from(">HH", content, at + 5)[::-1]
        if marker == 0xFF:  # padding
            at += 1
        elif marker in JPEG_BARE:
            at += 2
        else:
            at += 2 + struct.unpack_from(">H", content, at + 2)[0]
    return None
