"""Text of MoSeg: tracks, and definitions of ground truth, of the Freiburg benchmarks.

The formats are those that the benchmark's own program reads (``MoSegEval_PR.cpp``,
version 2.0, of P. Ochs, J. Malik and T. Brox).
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from ._sizes import check_table


def read_moseg_tracks(path, n_frames=None):
    """Tracks of a ``Tracks10.dat``.

    Parameters
    ----------
    path : Path
        Numbers, whatever the space between them: that of the frames, that of the
        tracks, and for each track a label, its number of points, and for each point x,
        y (pixels) and the frame, counted from 0 and rising.
    n_frames : int, optional
        Read those of the first frames only, and the tracks seen in them.

    Returns
    -------
    dict
        ``data`` (n_tracks, 2 * n_frames); ``track_labels`` (n_tracks,): what the file's
        writer found, not the truth, and -1 if it is negative.

    Raises
    ------
    ValueError
        If the text is not of this form, with its line.
    """
    text = Path(path).read_text(encoding="ascii", errors="replace")
    numbers = _numbers(text)
    if len(numbers) < 2:
        raise ValueError("it has no number of frames and of tracks")
    length, n_tracks = (
        _whole(text, numbers, place, what)
        for place, what in enumerate(("number of frames", "number of tracks"))
    )
    starts = _track_starts(text, numbers, n_tracks)
    labels = numbers[starts].astype(int)
    sizes = numbers[starts + 1].astype(int)
    track = np.repeat(np.arange(n_tracks), sizes)
    step = np.arange(len(track)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    places = starts[track] + 2 + 3 * step  # of each point's x
    if length > len(places):  # nobody films frames of which nothing is tracked
        raise ValueError(f"line 1: {length} frames, but only {len(places)} points")
    frame = _frames(text, numbers, places + 2, track, length)
    length = length if n_frames is None else min(length, n_frames)
    check_table(n_tracks, length, len(text))
    points = np.full((n_tracks, length, 2), np.nan)
    inside = frame < length
    points[track[inside], frame[inside]] = numbers[places[inside, None] + np.arange(2)]
    kept = np.bincount(track[inside], minlength=n_tracks) > 0
    return {
        "data": points[kept].reshape(kept.sum(), 2 * length),
        "track_labels": np.maximum(labels[kept], -1),
    }


def _numbers(text):
    tokens = text.split()
    try:
        numbers = np.array([float(token) for token in tokens])
    except ValueError:
        numbers = np.array([_or_nan(token) for token in tokens])
    bad = np.flatnonzero(~np.isfinite(numbers))
    if len(bad):
        place = int(bad[0])
        raise ValueError(
            f"line {_line(text, place)}: expected a number; got {tokens[place][:40]!r}"
        )
    return numbers


def _or_nan(token):
    try:
        return float(token)
    except ValueError:
        return np.nan


def _line(text, place):
    """The line, counted from 1, of a number."""
    ends = np.cumsum([len(content.split()) for content in text.splitlines()])
    return int(np.searchsorted(ends, place, side="right")) + 1


def _whole(text, numbers, place, what, least=1):
    number = numbers[place]
    if number != np.round(number) or not least <= number < 2**53:
        raise ValueError(
            f"line {_line(text, place)}: the {what} must be a whole number of {least} "
            f"or more; got {number:.15g}"
        )
    return int(number)


def _track_starts(text, numbers, n_tracks):
    """Where the label of each track is among the numbers."""
    starts: list[int] = []
    start = 2
    while len(starts) < n_tracks:
        if start + 2 > len(numbers):
            raise ValueError(
                f"line {_line(text, len(numbers) - 1)}: the file ends after "
                f"{len(starts)} of {n_tracks} tracks"
            )
        track = f"track {len(starts) + 1}"
        _whole(text, numbers, start, f"label of {track}", least=-(2**31))
        size = _whole(text, numbers, start + 1, f"number of points of {track}")
        if start + 2 + 3 * size > len(numbers):
            raise ValueError(
                f"line {_line(text, start + 1)}: {track} has {size} points, but the "
                f"file ends after {(len(numbers) - start - 2) // 3} of them"
            )
        starts.append(start)
        start += 2 + 3 * size
    if start < len(numbers):
        raise ValueError(
            f"line {_line(text, start)}: the file continues after the last of "
            f"{n_tracks} tracks"
        )
    return np.array(starts)


def _frames(text, numbers, places, track, length):
    """The frame of each point, rising within a track."""
    frame = numbers[places]
    wrong = (frame != np.round(frame)) | (frame < 0) | (frame >= length)
    if wrong.any():
        place = int(places[wrong][0])
        raise ValueError(
            f"line {_line(text, place)}: frames are whole numbers from 0 to "
            f"{length - 1}; got {numbers[place]:.15g}"
        )
    back = (np.diff(frame) <= 0) & (np.diff(track) == 0)
    if back.any():
        place = int(places[1:][back][0])
        raise ValueError(
            f"line {_line(text, place)}: the frames of a track must be in ascending "
            f"order; got {numbers[place]:.15g} after {numbers[place - 3]:.15g}"
        )
    return frame.astype(int)


class Definition(NamedTuple):
    """What a ``NAMEDef.dat`` says.

    ``scales``: what a region's pixels hold, region by region: a grey value, or
    ``65536 red + 256 green + blue``. ``masks``: (frame, file name) of each labelled
    frame, frames counted from 0.
    """

    scales: list[int]
    n_frames: int
    masks: list[tuple[int, str]]


def read_definition(path):
    """Read a ``NAMEDef.dat``.

    Parameters
    ----------
    path : Path

    Returns
    -------
    Definition

    Raises
    ------
    ValueError
        If the text is not of this form, with its file and line.
    """
    text = Path(path).read_text(encoding="ascii", errors="replace")
    lines = _Lines(path, text)
    lines.title("Ground truth definition file")
    lines.title("Total number of regions")
    n_regions = lines.number("number of regions", least=1)
    scales: list[int] = []
    while len(scales) < n_regions:  # a count of billions ends with the file
        scales.append(lines.titled_number(f"scale of region {len(scales)}", most=2**24))
    if len(set(scales)) < n_regions:
        raise ValueError(f"{path}: two regions have the same scale; got {scales}")
    lines.title("Confusion")
    n_penalties = 0  # of confusing regions, which newer scores do without
    while n_penalties < n_regions**2:
        n_penalties += len(lines.next("row of the confusion matrix").split())
    lines.title("Total number of frames")
    n_frames = lines.number("number of frames", least=1)
    lines.title("Total number of labeled frames")
    n_masks = lines.number("number of labeled frames", least=1)
    masks: list[tuple[int, str]] = []
    while len(masks) < n_masks:
        lines.title("Frame number")
        frame = lines.number("frame number")
        lines.title("File name")
        masks.append((frame, lines.next("file name")))
        lines.title("Input file name")
        lines.next("input file name")
    return Definition(scales, n_frames, masks)


class _Lines:
    """The lines of a file that are not blank, one after the other."""

    def __init__(self, path, text):
        self.path = path
        self.lines = enumerate(text.splitlines(), start=1)
        self.line = 0

    def next(self, what):
        for line, content in self.lines:
            self.line = line
            if content.strip():
                return content.strip()
        raise ValueError(f"{self.path}, line {self.line}: it ends before the {what}")

    def title(self, title):
        content = self.next(f"line {title!r}")
        if not content.lower().startswith(title.lower()):
            raise ValueError(
                f"{self.path}, line {self.line}: expected {title!r}; got "
                f"{content[:60]!r}"
            )

    def number(self, what, least=0, most=2**31):
        return self._as_number(self.next(what), what, least, most)

    def titled_number(self, what, most):
        """A number after a title, of which files differ in words."""
        content = self.next(what)
        content = content if content.isdecimal() else self.next(what)
        return self._as_number(content, what, 0, most - 1)

    def _as_number(self, content, what, least, most):
        number = int(content) if content.isdecimal() and len(content) < 12 else -1
        if not least <= number <= most:
            raise ValueError(
                f"{self.path}, line {self.line}: the {what} must be a whole number "
                f"from {least} to {most}; got {content[:40]!r}"
            )
        return number
