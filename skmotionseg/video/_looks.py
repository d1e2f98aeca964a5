"""What is around the points of tracks, and whether it is still the same."""

from __future__ import annotations

from collections import deque

import numpy as np
from scipy.spatial import KDTree

from .._utils.optional import require

# Side, in pixels, of the window in which texture is measured, flow is refined, and what
# is around a point is compared.
WINDOW = 11
# Frames after which what is around all points is looked at anew. It is compared with
# what it was between so many and twice as many frames ago.
RENEWED = 4
# Frames in which a point may have slid before that is seen.
SLIDING = 2 * RENEWED
# What has changed in half of the window correlates by about a half with what it was.
# In rendered videos of things on a wall, after four frames, it is less than this around
# four fifths of the points on outlines, and around one in fifty of the others.
LEAST_ALIKE = 0.8
# Standard deviation, in pixels, of the weights of what is around a point: near an
# outline, what belongs to a point is nearer than what does not.
NEARNESS = 2.5
# Root mean square difference of grey values that is noise, whatever correlates.
NOISE_OF_GREY = 5.0
# Points that were around one, of which some are of what it has slid onto; pixels by
# which it has moved away from the others; and the share that these are at least.
N_AROUND, APART, SHARE_LEFT = 12, 1.5, 0.25
# Rows that OpenCV takes at once.
MOST_ROWS = 16384


def without_sliding(tracked):
    """Frames of tracks without the points that were sliding.

    Parameters
    ----------
    tracked : iterable of (ids, points, slid)
        Of each frame, in order: the points there, and the ids of those that were seen
        to have slid.

    Yields
    ------
    ids : ndarray of int, shape (n,)
    points : ndarray of shape (n, 2)
        Of each frame, ``SLIDING`` frames late.
    """
    late: deque = deque()
    for ids, points, slid in tracked:
        if len(slid):
            kept = [~np.isin(before, slid) for before, _ in late]
            late = deque(
                (before[some], places[some])
                for (before, places), some in zip(late, kept, strict=True)
            )
        late.append((ids, points))
        if len(late) > SLIDING:
            yield late.popleft()
    yield from late


class Looks:
    """What was around each of some points, by which it is told that one has slid.

    Where a thing passes slowly, points of what is behind it are taken along by its
    outline, by less in each frame than the way back misses. Over some frames the
    windows around them fill with the thing, and they leave some of the points that were
    around them. What changes where it is leaves none, and a limb that moves looks as it
    did.

    Parameters
    ----------
    patches : ndarray of uint8, shape (n_points, 2, WINDOW ** 2)
        What was around each point when all were looked at last but one, and last.
    places : ndarray of shape (n_points, 2, 2)
        Where it was then; NaN where it was not there.
    n_frames : int
        That were seen.
    """

    def __init__(self, patches=None, places=None, n_frames=0):
        self.patches = np.empty((0, 2, WINDOW**2), np.uint8)
        self.places = np.empty((0, 2, 2))
        if patches is not None:
            self.patches, self.places = patches, places
        self.n_frames = n_frames

    def follow(self, picture, points, followed):
        """Which points have not slid in the next picture.

        Parameters
        ----------
        picture : ndarray of uint8, shape (height, width)
        points : ndarray of shape (n, 2)
            Where those are that were followed; the others are forgotten, and so are
            those that have slid.
        followed : ndarray of bool, shape (n_points,)

        Returns
        -------
        ndarray of bool, shape (n,)
        """
        self._keep(followed)
        now = patches_around(picture, points)
        slid = np.zeros(len(points), dtype=bool)
        older = np.isfinite(self.places[:, 0, 0])
        for which, known in enumerate((older, ~older)):
            there = self.places[:, which]
            rows = known & np.isfinite(there[:, 0])
            changed = rows & ~alike(self.patches[:, which], now)
            slid[changed] = moved_apart(there, points, np.flatnonzero(changed))
        self._keep(~slid)
        return ~slid

    def begin(self, picture, points):
        """Take up the points that come after those that are known."""
        n_new = len(points) - len(self.places)
        self.places = np.concatenate([self.places, np.full((n_new, 2, 2), np.nan)])
        blank = np.zeros((n_new, 2, WINDOW**2), dtype=np.uint8)
        self.patches = np.concatenate([self.patches, blank])
        if self.n_frames % RENEWED == 0:
            now = patches_around(picture, points)
            self.patches = np.stack([self.patches[:, 1], now], axis=1)
            self.places = np.stack([self.places[:, 1], points], axis=1)
        self.n_frames += 1

    def _keep(self, some):
        self.patches, self.places = self.patches[some], self.places[some]


def moved_apart(before, now, asked):
    """Whether points have moved away from some of those that were around them.

    Parameters
    ----------
    before, now : ndarray of shape (n, 2)
        NaN before for points that were not there.
    asked : ndarray of int, shape (m,)
        Rows of those that were.

    Returns
    -------
    ndarray of bool, shape (m,)
    """
    others = np.flatnonzero(np.isfinite(before[:, 0]))
    if len(others) <= N_AROUND or not len(asked):
        return np.zeros(len(asked), dtype=bool)
    near = others[KDTree(before[others]).query(before[asked], N_AROUND + 1)[1][:, 1:]]
    steps = now - before
    apart = np.linalg.norm(steps[near] - steps[asked, None], axis=2) > APART
    return apart.mean(axis=1) >= SHARE_LEFT


def patches_around(picture, points):
    """Grey values around points, between pixels: (n, WINDOW ** 2), uint8.

    Parameters
    ----------
    picture : ndarray of uint8, shape (height, width)
        It goes on beyond its edges as it ends there.
    points : ndarray of shape (n, 2)
    """
    cv2 = require("cv2", extra="video")
    steps = np.arange(WINDOW) - WINDOW // 2
    down, across = (each.ravel() for each in np.meshgrid(steps, steps, indexing="ij"))
    x, y = (
        (points[:, axis, None] + step).astype(np.float32)
        for axis, step in enumerate((across, down))
    )
    found = np.empty(x.shape, dtype=np.uint8)
    for start in range(0, len(x), MOST_ROWS):
        some = slice(start, start + MOST_ROWS)
        found[some] = cv2.remap(
            picture,
            x[some],
            y[some],
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
    return found


def alike(first, second):
    """Whether grey values correlate, or differ by noise alone.

    Parameters
    ----------
    first, second : ndarray of uint8, shape (n, WINDOW ** 2)
        Those near the middle count most.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    steps = np.arange(WINDOW) - WINDOW // 2
    weights = np.exp(-np.add.outer(steps**2, steps**2) / (2 * NEARNESS**2)).ravel()
    weights = (weights / weights.sum()).astype(np.float32)
    first, second = first.astype(np.float32), second.astype(np.float32)
    by_noise = np.square(first - second) @ weights < NOISE_OF_GREY**2
    first -= (first @ weights)[:, None]
    second -= (second @ weights)[:, None]
    lengths = np.sqrt((first**2 @ weights) * (second**2 @ weights))
    return by_noise | ((first * second) @ weights >= LEAST_ALIKE * lengths)
