"""From labels of tracks to a label for every pixel of every frame."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from numbers import Integral
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .._core.geometry.tracks import tracks_by_frame, unpack_tracks
from .._utils.optional import require
from .._utils.validation import check_frames, check_label_each
from ._checks import check_number, make_reporter
from ._evidence import (
    LOOK_WORTH,
    MOST_LOOK,
    ColourGrid,
    appearance,
    distance_evidence,
    extent_evidence,
    flow_agreement,
    flow_evidence,
    gradient_energy,
    motion_fields,
    texture_centres,
    texture_trust,
    track_counts,
    track_hulls,
    warp,
)
from ._frames import SMALLEST_SIDE, Progress, Source, first_frames, open_frames
from ._grid import sample_field
from ._pixels import at_scale
from ._random_walk import edge_weights, random_walk

# How strongly neighbours of one colour are tied, and the share that an edge leaves.
TIES, TIES_ACROSS_EDGES = 10.0, 0.005
# How strongly pixels are drawn to what the evidence says of them, and to their tracks.
EVIDENCE, TRACK_EVIDENCE = 0.3, 2.0
# Weight of the log-odds by colours, which repeat what flow and tracks have said.
COLOUR_WEIGHT = 1.0
# The most, in nats, that the last frame may speak against a motion.
MOST_PAST = 3.0
MOST_LABELS = 255
# Frames of a longer side are shrunk to it.
MAX_SIDE = 480
# Nothing moves from one frame to the next if half of each motion's tracks stay within
# so many pixels; nor has it since the first, if within so many.
MOST_STILL, MOST_SINCE_FIRST = 0.05, 0.25


def dense_masks(
    source: Source,
    X: npt.ArrayLike,
    labels: npt.ArrayLike,
    *,
    max_side: int = MAX_SIDE,
    progress: Progress | None = None,
) -> Iterator[npt.NDArray[np.uint8]]:
    """Give every pixel of every frame the label of a motion.

    A pixel belongs to a motion if its optical flow, to the frames before and after, is
    that of the motion's tracks around it; if it looks as the place does to which these
    lead in one of those frames; if it is at the texture that one of them follows, and
    not far from all of them; if its colour is one that the motion has there; and if it
    did in the frame before. Where none of these tell, as on a plain road beside a car,
    it more likely belongs to the motion that has more tracks. A random walker weighs
    all this, and lets masks end where the picture has edges.

    Frames are read one at a time and no more than three are held. Those before anything
    moves all have the mask of the last of them, by what moves then.

    Parameters
    ----------
    source : path or iterable of arrays
        The video of the tracks, as for :func:`track_video`.
    X : array-like of shape (n_tracks, 2 * n_frames)
        Tracks in pixels of the video; NaN where unseen.
    labels : array-like of int, shape (n_tracks,)
        Motion of each track, 0 to 254; negative for none, which is ignored.
    max_side : int, default=480
        Frames of a longer side are shrunk to it; edges are placed in the whole frame.
    progress : callable, optional
        Called after each frame with the number done and the number there will be.

    Returns
    -------
    iterator of ndarray of uint8, shape (height, width)
        A label of ``labels`` for each pixel of a frame, for ``n_frames`` frames; each
        is computed when it is asked for.

    Raises
    ------
    FileNotFoundError, TypeError, ValueError
        If the source is not as described or has fewer frames than the tracks, no
        track has a label, or there is not one label per track.
    ImportError
        If opencv-python-headless is missing.

    References
    ----------
    L. Grady, "Multilabel Random Walker Image Segmentation Using Prior Models", CVPR
    2005.

    Examples
    --------
    A square that moves to the right, tracked:

    >>> import numpy as np
    >>> from scipy.ndimage import gaussian_filter
    >>> from skmotionseg.video import dense_masks, track_video
    >>> noise = gaussian_filter(np.random.default_rng(0).normal(size=(96, 96)), 1.5)
    >>> frames = np.repeat([128 + 250 * noise], 6, axis=0).clip(0, 255).astype(np.uint8)
    >>> for f in range(6):
    ...     frames[f, 30:60, 20 + 4 * f : 50 + 4 * f] = frames[0, 60:90, 10:40]
    >>> X = track_video(frames).tracks
    >>> labels = (X[:, -2] - X[:, 0] > 10).astype(int)
    >>> mask = list(dense_masks(frames, X, labels))[3]
    >>> bool(mask[36:54, 38:56].all()), bool(mask[:, 75:].any())
    (True, False)
    """
    points, visibility = unpack_tracks(X)
    check_frames(X, points)
    labels = check_label_each(labels, len(points))
    check_number("max_side", max_side, Integral, SMALLEST_SIDE)
    seen = tracks_by_frame(points, visibility)
    return paint_masks(source, points.shape[1], seen, labels, max_side, progress)


def paint_masks(source, n_frames, tracked, labels, max_side=MAX_SIDE, progress=None):
    """As :func:`dense_masks`, of tracks that come frame by frame.

    Parameters
    ----------
    source : path or iterable of arrays
    n_frames : int
    tracked : iterator of (rows, points)
        For each frame, which tracks it sees, ascending, and where: ndarray of int,
        shape (n,), and (n, 2).
    labels : ndarray of int, shape (n_tracks,)
    max_side : int
    progress : callable, optional

    Returns
    -------
    iterator of ndarray of uint8, shape (height, width)
    """
    if not (labels >= 0).any():
        raise ValueError("masks need one labelled track or more; all labels are -1")
    if labels.max() >= MOST_LABELS:
        raise ValueError(f"labels must be below {MOST_LABELS}; got {labels.max()}")
    frames = open_frames(source)
    report = make_reporter(progress, n_frames)
    names, known = np.unique(labels[labels >= 0]), labels >= 0
    tracked = ((rows[known[rows]], points[known[rows]]) for rows, points in tracked)
    painter = _Painter(tracked, np.searchsorted(names, labels), max_side)
    shown = first_frames(frames, n_frames, report)
    return _paint(painter, shown, n_frames, names)


def _paint(painter, frames, n_frames, names):
    """Masks of frames, each once the one after it has been read.

    Those before anything moves have the mask of the last of these.
    """
    current = next(frames)
    view, number = painter.look(current), painter.last_at_rest(n_frames)
    if number:
        current = next(islice(frames, number - 1, None))
        view = painter.look(current)
    n_alike = number + 1
    while current is not None:
        following = next(frames, None)
        next_view = None if following is None else painter.look(following)
        present, walk = painter.paint(view, next_view, number)
        mask = names[present][_enlarged(walk, current)].astype(np.uint8)
        for _ in range(n_alike):
            yield mask.copy()
        current, view, number, n_alike = following, next_view, number + 1, 1


class _View:
    """A frame at the working size, and its flow to and from the one after it."""

    def __init__(self, picture, grey):
        self.picture, self.grey = picture, grey
        self.ahead = self.back = self.following = None
        self.ahead_trust = self.back_trust = None

    def set_flow(self, ahead, back):
        """The flow to and from the frame after it, and how far to believe it."""
        self.ahead, self.back = ahead, back
        self.ahead_trust = flow_agreement(ahead, back)
        self.back_trust = flow_agreement(back, ahead)


class _Neighbour(NamedTuple):
    """A frame beside one that is painted.

    Attributes
    ----------
    flow : ndarray of shape (height, width, 2)
        To it.
    trust, grey : ndarray of shape (height, width)
        How far to believe the flow, and the frame itself.
    labels : ndarray of int, shape (n,)
        Of the tracks that both frames see.
    points, steps : ndarray of shape (n, 2)
        Where these are, and where they go, at the working size.
    """

    flow: np.ndarray
    trust: np.ndarray
    grey: np.ndarray
    labels: np.ndarray
    points: np.ndarray
    steps: np.ndarray

    def moves(self):
        """Whether a motion does; none does where a frame is shown twice."""
        return largest_movement(self.labels, self.steps) >= MOST_STILL


def largest_movement(labels, steps):
    """The largest of the motions' medians of lengths of steps (n, 2); 0 if none is."""
    lengths = np.linalg.norm(steps, axis=1)
    moved = [np.median(lengths[labels == label]) for label in np.unique(labels)]
    return max(moved, default=0.0)


class _Painter:
    """Probabilities of motions at the pixels of one frame after another.

    Parameters
    ----------
    tracked : iterator of (rows, points)
        Of each frame, as for :func:`paint_masks`.
    labels : ndarray of int, shape (n_tracks,)
        From 0, none missing.
    max_side : int
    """

    def __init__(self, tracked, labels, max_side):
        cv2 = require("cv2", extra="video")
        self._tracked, self._labels = tracked, labels
        self._near: dict[int, tuple] = {}  # of the last frames that were asked for
        self._max_side = max_side
        self._flow = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
        self._last: Any = None
        self._last_walk: Any = None
        self._last_present = np.empty(0, dtype=int)
        self._grid: Any = None

    def look(self, frame):
        """A frame at the working size."""
        cv2 = require("cv2", extra="video")
        height, width = frame.shape[:2]
        if min(height, width) < SMALLEST_SIDE:
            raise ValueError(
                f"frames need {SMALLEST_SIDE} pixels per side or more for masks; got "
                f"{width} x {height}"
            )
        scale = min(1.0, self._max_side / max(height, width))
        if scale < 1:
            size = [max(SMALLEST_SIDE, round(side * scale)) for side in (width, height)]
            frame = cv2.resize(frame, size, interpolation=cv2.INTER_AREA)
        self._scale = np.divide(frame.shape[1::-1], (width, height))
        return _View(frame, cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY))

    def last_at_rest(self, n_frames):
        """The last frame before which nothing has moved, and that has one after it.

        Nor has a motion come into view, or gone.
        """
        first = before = self._tracks_in(0)
        shown = np.unique(self._labels[first[0]])
        for number in range(1, n_frames):
            now = self._tracks_in(number)
            rests = self._movement(before, now) < MOST_STILL
            rests &= self._movement(first, now) < MOST_SINCE_FIRST
            if not (rests and np.array_equal(np.unique(self._labels[now[0]]), shown)):
                return number - 1
            before = now
        return max(n_frames - 2, 0)

    def _movement(self, before, now):
        """Pixels that the tracks of some motion move by; infinity if none is seen."""
        labels, _, steps = self._steps_between(before, now, self._labels)
        return largest_movement(labels, steps) if len(labels) else np.inf

    def paint(self, view, following, number):
        """Labels in the frame of that number, and their probabilities.

        Returns
        -------
        present : ndarray of int, shape (n,)
            Labels with tracks in the frame, or pixels in the last one.
        walk : ndarray of float32, shape (n, height, width)
        """
        if following is not None:
            view.following = following.grey
            view.set_flow(
                self._flow.calc(view.grey, following.grey, None),
                self._flow.calc(following.grey, view.grey, None),
            )
        if self._grid is None:
            self._grid = ColourGrid(view.grey.shape)
        view.colours = self._grid.colours(view.picture)
        seen, points = self._tracks_in(number)
        present = self._present(seen)
        labels = np.searchsorted(present, self._labels)  # of what is seen, at least
        pairs = self._neighbours(view, number, labels)
        # Where a frame is shown twice, the other of the two tells no motions apart, and
        # any of them explains how it looks.
        moving = [pair for pair in pairs if pair.moves()]
        if not moving and self._go_on(pairs, present):
            walk = self._carried(self._of_last(present))
        else:
            own = self._place(points), labels[seen]
            walk = self._decide(view, moving or pairs, own, present)
        self._last, self._last_walk, self._last_present = view, walk, present
        return present, walk

    def _go_on(self, pairs, present):
        """Whether tracks go on from the last frame, and no motion is new.

        Where nothing moves, there is nothing else to tell motions by: masks stay.
        """
        if self._last is None or not np.isin(present, self._last_present).all():
            return False
        return len(pairs[-1].labels) > 0

    def _present(self, seen):
        """Labels (n,) with tracks that are seen, or pixels in the last frame."""
        known = [np.flatnonzero(np.bincount(self._labels[seen]))]
        if self._last is not None:
            best = self._last_walk.argmax(axis=0).ravel()
            known.append(self._last_present[np.flatnonzero(np.bincount(best))])
        present = np.unique(np.concatenate(known))
        return present if len(present) else np.zeros(1, dtype=int)

    def _of_last(self, present):
        """Probabilities in the last frame: 0 for labels that were not there."""
        walk = np.zeros((len(present), *self._last_walk.shape[1:]), dtype=np.float32)
        _, new, old = np.intersect1d(present, self._last_present, return_indices=True)
        walk[new] = self._last_walk[old]
        return walk

    def _carried(self, known):
        """Probabilities in the last frame, where its flow takes them."""
        return np.stack([warp(part, self._last.back) for part in known])

    def _tracks_in(self, number):
        """Tracks that a frame sees, and where: of this frame, the last and the next."""
        while number not in self._near:
            latest = max(self._near, default=-1)
            self._near[latest + 1] = next(self._tracked)
            self._near.pop(latest - 2, None)
        return self._near[number]

    def _place(self, points):
        """Points at the working size."""
        return at_scale(points, self._scale)

    def _evidence(self, view, pairs, own, n_labels):
        """Log odds of labels at the pixels by motion and place; tracks of each."""
        (places, labels), shape = own, view.grey.shape
        energy = gradient_energy(view.grey)
        places = places + sample_field(texture_centres(energy), places)
        counts = track_counts(places, labels, n_labels, shape)
        hulls = track_hulls(places, labels, n_labels, shape)
        logs = self._flow_evidence(view, pairs, n_labels, energy)
        logs += distance_evidence(counts, hulls) + extent_evidence(counts, hulls)
        return logs, counts

    def _flow_evidence(self, view, pairs, n_labels, energy):
        """By the flows to the frames after and before, and by how these look there.

        Flow counts as the mean of both; a picture is explained by a motion if it is
        from one of both, as what is hidden in one can mostly be seen in the other.
        """
        logs = np.zeros((n_labels, *view.grey.shape), dtype=np.float32)
        looks = np.full_like(logs, -np.inf)
        trust, grey = texture_trust(energy), view.grey.astype(np.float32)
        for pair in pairs:
            tracked = pair.points, pair.steps, pair.labels
            fields = motion_fields(*tracked, n_labels, grey.shape)
            logs += flow_evidence(pair.flow, trust * pair.trust, fields) / len(pairs)
            other_grey = pair.grey.astype(np.float32)
            looks = np.maximum(looks, appearance(grey, other_grey, energy, fields))
        if pairs:
            looks = LOOK_WORTH * (looks - looks.max(axis=0))
            logs += np.maximum(looks, -MOST_LOOK)
        return logs

    def _neighbours(self, view, number, labels):
        """The frames after and before, as far as there are any."""
        pairs = []
        if view.ahead is not None:
            tracked = self._steps(number, number + 1, labels)
            flow = view.ahead, view.ahead_trust, view.following
            pairs.append(_Neighbour(*flow, *tracked))
        if self._last is not None:
            tracked = self._steps(number, number - 1, labels)
            flow = self._last.back, self._last.back_trust, self._last.grey
            pairs.append(_Neighbour(*flow, *tracked))
        return pairs

    def _steps(self, number, other, labels):
        """Of the tracks that two frames see: labels, places in the first, and steps."""
        one, another = self._tracks_in(number), self._tracks_in(other)
        return self._steps_between(one, another, labels)

    def _steps_between(self, one, another, labels):
        """As of :meth:`_steps`, of the tracks, and where they are, in two frames."""
        (seen, here), (also, there) = one, another
        rows, first, second = np.intersect1d(
            seen, also, assume_unique=True, return_indices=True
        )
        points = self._place(here[first])
        return labels[rows], points, self._place(there[second]) - points

    def _decide(self, view, pairs, own, present):
        """Probabilities (n, height, width) by all evidence.

        Parameters
        ----------
        view : _View
        pairs : list of _Neighbour
        own : tuple of ndarray
            Places (n, 2) and labels (n,) of the tracks in the frame.
        present : ndarray of int
        """
        logs, counts = self._evidence(view, pairs, own, len(present))
        across, down = edge_weights(view.picture, TIES, TIES_ACROSS_EDGES)
        seeds = TRACK_EVIDENCE * np.minimum(counts, 2)
        cells = self._grid.cells(view.colours)
        if self._last is None:  # colours are learnt from a first walk without them
            walk = random_walk(
                _drawn(logs) + seeds, across, down, np.full_like(logs, 0.5)
            )
            for _ in range(2):
                colour = COLOUR_WEIGHT * self._grid.evidence(cells, walk, cells)
                walk = random_walk(_drawn(logs + colour) + seeds, across, down, walk)
            return walk
        last = self._last
        known = self._of_last(present)
        past = self._carried(known)
        odds = np.log(past + 0.03)
        logs = logs + last.back_trust * np.maximum(odds - odds.max(axis=0), -MOST_PAST)
        moved = self._grid.cells(last.colours, last.ahead)
        logs += COLOUR_WEIGHT * self._grid.evidence(moved, known, cells)
        return random_walk(_drawn(logs) + seeds, across, down, past)


def _drawn(logs):
    """How strongly pixels are drawn to each label by log-odds."""
    shares = np.exp(logs - logs.max(axis=0))
    return EVIDENCE * shares / shares.sum(axis=0)


def _enlarged(walk, frame):
    """Most probable label (height, width) of each pixel of the whole frame.

    Where the frame was shrunk, probabilities follow its grey values in small windows:
    guided filtering (He, Sun and Tang, ECCV 2010).
    """
    cv2 = require("cv2", extra="video")
    height, width = frame.shape[:2]
    if walk.shape[1:] == (height, width):
        return walk.argmax(axis=0)
    side = 2 * round(2 * width / walk.shape[2]) + 1
    grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY).astype(np.float32) / 255

    def mean(values):
        return cv2.boxFilter(values, -1, (side, side))

    grey_mean = mean(grey)
    spread = mean(grey * grey) - grey_mean**2 + 1e-3
    best = np.zeros((height, width), int)
    left, best_value = 1.0, -np.inf  # the last label has what the others leave
    for label, part in enumerate(walk[:-1]):
        part = cv2.resize(part, (width, height))
        part_mean = mean(part)
        slope = (mean(grey * part) - grey_mean * part_mean) / spread
        value = mean(slope) * grey + mean(part_mean - slope * grey_mean)
        best[value > best_value] = label
        best_value, left = np.maximum(best_value, value), left - value
    best[left > best_value] = len(walk) - 1
    return best
