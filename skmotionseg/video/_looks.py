"""What is around the points of tracks, and whether it is still the same."""

from __future__ import annotations

import numpy as np

from .._utils.optional import require

# Side, in pixels, of the window in which texture is measured, flow is refined, and what
# is around a point is compared.
WINDOW = 11
# Frames after which what is around a point is looked at anew. It is compared with what
# it was between so many and twice as many frames ago, or when the track began.
RENEWED = 8
# What has changed in half of the window correlates by about a half with what it was.
LEAST_ALIKE = 0.7
# Root mean square difference of grey values that is noise, whatever correlates.
NOISE_OF_GREY = 5.0
# Rows that OpenCV takes at once.
MOST_ROWS = 16384


class Looks:
    """What was around each of some points, by which it is told that one has slid.

    Where a thing passes slowly, points of what is behind it are taken along by its
    outline, by less in each frame than the way back misses. Over some frames the
    windows around them fill with the thing.

    Parameters
    ----------
    patches : ndarray of uint8, shape (n_points, 2, WINDOW ** 2)
        What was around each point when it was looked at last but one, and last.
    ages : ndarray of int, shape (n_points,)
        Frames since each began.
    """

    def __init__(self, patches=None, ages=None):
        if patches is None:
            patches = np.empty((0, 2, WINDOW**2), dtype=np.uint8)
        self.patches = patches
        self.ages = np.empty(0, dtype=int) if ages is None else ages

    def follow(self, picture, points, followed):
        """Which points look in the next picture as they did.

        Parameters
        ----------
        picture : ndarray of uint8, shape (height, width)
        points : ndarray of shape (n, 2)
            Where those are that were followed; the others are forgotten, and so are
            those that look different.
        followed : ndarray of bool, shape (n_points,)

        Returns
        -------
        ndarray of bool, shape (n,)
        """
        patches, ages = self.patches[followed], self.ages[followed] + 1
        now = patches_around(picture, points)
        same = alike(patches[:, 0], now)
        due = ages % RENEWED == 0
        patches[due] = np.stack([patches[due, 1], now[due]], axis=1)
        self.patches, self.ages = patches[same], ages[same]
        return same

    def begin(self, picture, points):
        """Take up the points that come after those that are known."""
        new = patches_around(picture, points[len(self.ages) :])
        self.patches = np.concatenate([self.patches, np.stack([new, new], axis=1)])
        self.ages = np.concatenate([self.ages, np.zeros(len(new), dtype=int)])


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
    first, second : ndarray of uint8, shape (n, m)

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    first, second = first.astype(np.float32), second.astype(np.float32)
    by_noise = np.square(first - second).mean(axis=1) < NOISE_OF_GREY**2
    first -= first.mean(axis=1, keepdims=True)
    second -= second.mean(axis=1, keepdims=True)
    lengths = np.sqrt((first**2).sum(axis=1) * (second**2).sum(axis=1))
    return by_noise | ((first * second).sum(axis=1) >= LEAST_ALIKE * lengths)
