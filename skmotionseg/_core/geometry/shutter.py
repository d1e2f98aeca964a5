"""A camera that reads its sensor row by row, while it moves: a rolling shutter.

What is lower in a frame is seen a little later. Where the camera shakes, a static scene
is then bent from frame to frame, by several pixels, and looks like two motions, an
upper and a lower one. But each track shows how it moves, so it can be moved back to
where it was when the middle of the frame was read; how long that takes is the same in
all of a video, and is found as what makes the motion of most of the tracks rigid
(compare Ringaby and Forssen [1]_, who find the camera's rotation instead).

References
----------
.. [1] E. Ringaby and P.-E. Forssen, "Efficient video rectification and stabilisation
   for cell-phones", IJCV 96, 2012. https://doi.org/10.1007/s11263-011-0465-8
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .camera import log_ratio
from .rigid_motion import nats_of_residuals
from .tracks import covered
from .windows import (
    FOCAL_LENGTHS,
    WINDOW_FRAMES,
    RigidMotion,
    Windows,
    at_all_distances,
)

# Tracks that are looked at, and those of them that a motion is fitted to.
MOST_SEEN, MOST_FITTED = 400, 80
FEWEST_SEEN = 12
# Times that the half of the tracks that a motion explains best is chosen again.
ROUNDS = 4
# Times of reading are tried in steps of so many frames, so often at most. They are less
# than a frame, and one that gets better still in the end is none.
STEP, MOST_STEPS = 0.2, 6
# Nats per track that they must save: with twice as many, 43 of 48 simulated videos of
# cameras that shake get theirs instead of 46, and four times as many, 34; of cameras
# that do not read row by row, next to none do.
LEAST_SAVED = 0.5
# Scales of the noise, by which costs are computed, over the least noise; and above
# which the median residual of that half shows that it is not one motion.
SCALE_OF_NOISE, MOST_LEFT = 2.0, 2.5
# Slopes at the ends of a track, by those of its first two or last two steps.
OUTER, INNER = 1.5, -0.5


class Shutter(NamedTuple):
    """When a camera reads each place of a frame.

    Attributes
    ----------
    middle : ndarray of shape (2,)
        What is read at the time of the frame, pixels.
    size : ndarray of shape (2,)
        What tracks cover, pixels.
    readout : ndarray of shape (2,)
        From when the left edge of what they cover is read to when the right one is, and
        from the upper to the lower, as shares of the time from a frame to the next: at
        least one of them 0.
    """

    middle: np.ndarray
    size: np.ndarray
    readout: np.ndarray

    def at_once(self, points, visibility):
        """Tracks as if all of a frame had been read at once.

        Parameters
        ----------
        points : ndarray of shape (n_tracks, n_frames, 2)
            Pixels.
        visibility : ndarray of bool, shape (n_tracks, n_frames)

        Returns
        -------
        ndarray of shape (n_tracks, n_frames, 2)
            The points themselves where nothing is read later.
        """
        if not self.readout.any():
            return points
        places = np.where(visibility[..., None], points, self.middle)
        rate = self.readout / self.size
        delays = ((places - self.middle) * rate).sum(axis=2)  # frames
        return points - delays[..., None] * velocities(places, visibility)

    def later(self, step):
        """The same, reading for so much longer."""
        return self._replace(readout=self.readout + step)


# What leaves all tracks as they are.
AT_ONCE = Shutter(np.zeros(2), np.ones(2), np.zeros(2))


def find_shutter(points, visibility):
    """How a camera reads its frames, by the motion that most tracks have.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
        Pixels.
    visibility : ndarray of bool, shape (n_tracks, n_frames)
        Of frames that follow each other at equal times.

    Returns
    -------
    Shutter
        That reads all at once, unless the motion of half of the tracks is clearly more
        rigid otherwise.
    """
    low, high = covered(points, visibility)
    at_once = Shutter((low + high) / 2, np.maximum(high - low, 1e-9), np.zeros(2))
    some = _spread(points, visibility, at_once.middle)
    if visibility.shape[1] < WINDOW_FRAMES or len(some) < FEWEST_SEEN:
        return at_once
    return _best_shutter(points[some], visibility[some], at_once) or at_once


class _Tried(NamedTuple):
    """A shutter, and the motion of some tracks as it would then be seen."""

    shutter: Shutter
    windows: Windows
    motion: RigidMotion
    tracks: np.ndarray
    nats: float

    @property
    def left(self):
        """The median residual of the tracks, in scales of the noise."""
        left, known = self.windows.deviations(self.motion, self.tracks)
        return np.median(left[known > 0]) / _scale(self.windows)


def _tried(shutter, windows, motion, tracks):
    """With the nats of the tracks."""
    squares = windows.relative_squares(motion, tracks)
    freedom = windows.freedom[tracks]
    total = float(np.nansum(nats_of_residuals(squares, freedom, _scale(windows))))
    return _Tried(shutter, windows, motion, tracks, total)


def _scale(windows):
    return SCALE_OF_NOISE * windows.least_noise


def _best_shutter(points, visibility, at_once):
    """A shutter that is better by enough; None if there is none."""
    path = _line_search(points, visibility, at_once)
    nats = [tried.nats for tried in path]
    k = int(np.argmin(nats))
    if not 0 < k < len(path) - 1:
        return None
    saved = (nats[0] - nats[k]) / len(path[0].tracks)
    if saved < LEAST_SAVED or path[k].left > MOST_LEFT:
        return None
    step = path[1].shutter.readout
    return path[k].shutter.later(step * _vertex(*nats[k - 1 : k + 2]))


def _line_search(points, visibility, at_once):
    """What is tried, the time of reading longer by a step each time.

    Upwards, downwards or to a side: the way in which the first step is best. The last
    step makes it no better, if there are not too many.
    """
    before = _by_best_focal_length(points, visibility, at_once)

    def after(tried, step):
        """What is tried next, its motion fitted from that of the last."""
        shutter = tried.shutter.later(step)
        windows = tried.windows.of(shutter.at_once(points, visibility), visibility)
        (motion,) = windows.refine([tried.tracks], [[tried.motion]], MOST_FITTED)
        return _tried(shutter, windows, motion, tried.tracks)

    first = [after(before, way * STEP) for way in (*np.eye(2), *-np.eye(2))]
    path = [before, min(first, key=_nats_of)]
    step = path[1].shutter.readout
    while path[-1].nats < path[-2].nats and len(path) <= MOST_STEPS:
        path.append(after(path[-1], step))
    return path


def _nats_of(tried):
    return tried.nats


def velocities(points, visibility):
    """Velocities of tracks, pixels per frame.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
        Finite everywhere.
    visibility : ndarray of bool, shape (n_tracks, n_frames)

    Returns
    -------
    ndarray of shape (n_tracks, n_frames, 2)
        By central differences; at the ends of what is seen, by the parabola through the
        last three points, or the line through two; 0 where a frame is alone.
    """
    steps = np.diff(points, axis=1)
    known = visibility[:, 1:] & visibility[:, :-1]
    before, after = (_padded(steps, known, side) for side in (1, 0))
    (s0, k0), (s1, k1) = before, after
    (s00, k00), (s11, k11) = _shifted(before, 1), _shifted(after, -1)
    first, last = k1 & ~k0, k0 & ~k1
    return np.select(
        [each[..., None] for each in (k0 & k1, first & k11, last & k00, first, last)],
        [(s0 + s1) / 2, OUTER * s1 + INNER * s11, OUTER * s0 + INNER * s00, s1, s0],
        0.0,
    )


def _padded(steps, known, before):
    """Steps to each frame, or from it, and whether they are known."""
    pad = (1, 0) if before else (0, 1)
    return np.pad(steps, ((0, 0), pad, (0, 0))), np.pad(known, ((0, 0), pad))


def _shifted(some, by):
    """The same of the frame before, or after."""
    steps, known = (np.roll(each, by, axis=1) for each in some)
    return steps, known


def _by_best_focal_length(points, visibility, shutter):
    """The half of the tracks that one motion explains best, and the motion.

    With a wrong focal length, what turns is not rigid, either. So the half by a usual
    one is explained by others, too, and is chosen again by the one that does it best.
    """
    first, *others = (
        Windows(points, visibility, share)
        for share in sorted(FOCAL_LENGTHS, key=log_ratio)
    )
    everyone = np.arange(len(points))
    (motion,) = first.fit([everyone], MOST_FITTED)
    usual = best = _half_of_one_motion(shutter, first, motion)
    for windows in others:
        ratio = first.focal_length / windows.focal_length
        start = usual.motion.refocused(ratio)
        (motion,) = windows.refine([usual.tracks], [[start]], MOST_FITTED)
        tried = _tried(shutter, windows, motion, usual.tracks)
        best = min(best, tried, key=_nats_of)
    if best is not usual:
        best = _half_of_one_motion(shutter, best.windows, best.motion)
    return best


def _half_of_one_motion(shutter, windows, motion):
    """The half of the tracks that a motion explains best, and the one fitted to it.

    Least trimmed squares: the half is chosen again by the motion that is fitted to it.
    """
    everyone = np.arange(len(windows.freedom))
    half = everyone
    for _ in range(ROUNDS):
        left, known = windows.deviations(motion, everyone)
        order = np.argsort(np.where(known > 0, left, np.inf), kind="stable")
        new = np.sort(order[: (np.count_nonzero(known) + 1) // 2])
        if np.array_equal(new, half):
            break
        half = new
        (motion,) = windows.refine([half], [[motion]], MOST_FITTED)
    return _tried(shutter, windows, motion, half)


def _vertex(before, at, after):
    """Steps from the least of three costs to where a parabola through them is least."""
    return 0.5 * (before - after) / (before - 2 * at + after)


def _spread(points, visibility, middle):
    """Positions of some tracks that are seen in three frames, at all distances."""
    often = np.flatnonzero(visibility.sum(axis=1) >= 3)
    if len(often) <= MOST_SEEN:
        return often
    places = np.nanmean(np.where(visibility[..., None], points, np.nan)[often], axis=1)
    return np.sort(often[at_all_distances(places - middle, MOST_SEEN)])
