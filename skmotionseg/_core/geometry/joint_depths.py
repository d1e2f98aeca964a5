"""What the depths that a common motion gives two groups say of its being true."""

from __future__ import annotations

import numpy as np

from .description_length import OF_MEDIAN
from .windows import FEWEST_TRACKS

# The least spread and error of inverse depths, against division by zero.
LEAST_SPREAD = 1e-9
# Inverse depths of a group are between these quantiles: few are of outliers. A gap
# between two groups is at most so many times as wide as both where a scene is cut in
# two: an eighth if its inverse depths are evenly spread, and more where it is empty.
RANGE = (0.1, 0.9)
USUAL_GAP = 0.25


def infinitely_far(depths, errors):
    """How clearly one of two groups is at infinity, by a common motion, and one is not.

    One rigid motion explains more than it should: what stands still before a camera
    that only turns, as if it were infinitely far, together with what moves past it, as
    if it were near. A scene is spread in depth: its parts are not at one and the same,
    and that is not infinity.

    Parameters
    ----------
    depths, errors : pair of ndarray of shape (n_tracks, n_windows)
        Inverse depths of the tracks of each group, and their standard deviations; NaN
        where nothing is known.

    Returns
    -------
    float
        The log of the distance between the medians over the sum of the standard
        deviations (by median absolute deviations) within the groups, where positive,
        over one plus the median inverse depth, in its standard deviations, of the group
        that is farther; its mean over the windows, weighted by the tracks of the
        smaller group.
    """
    return _mean_over_windows(_far_in_window, depths, errors)


def behind(depths, errors):
    """How clearly one of two groups is behind the camera, by a common motion.

    Residuals do not tell on which side of the camera a point is, but nothing behind it
    is seen. Where a common motion explains both groups only if one of them is, they are
    different motions: a car that drives away in front of a moving camera shrinks
    towards the point from which all that stands still grows, as if it were behind.

    Where there is little parallax, inverse depths are known up to a number that is
    added to all, and a scene may seem to reach behind the camera; but then it does so
    without much of a gap.

    Parameters
    ----------
    depths, errors : pair of ndarray of shape (n_tracks, n_windows)
        As in :func:`infinitely_far`.

    Returns
    -------
    float
        Between 0 and 1: the gap between the inverse depths of the groups, from their
        10th to their 90th percentiles, over the sum of these ranges, less 1/4, where
        one is in front and the other behind; its mean over the windows, weighted by the
        tracks of the smaller group.
    """
    return _mean_over_windows(_behind_in_window, depths, errors)


def _mean_over_windows(measure, depths, errors):
    """The mean of a measure of what is known of two groups in each window."""
    found, weights = [], []
    for window in range(depths[0].shape[1]):
        sides = []
        for side, error in zip(depths, errors, strict=True):
            known = np.isfinite(side[:, window])
            least = np.maximum(error[known, window], LEAST_SPREAD)
            sides.append((side[known, window], least))
        weight = min(len(side) for side, _ in sides)
        if weight >= FEWEST_TRACKS:
            found.append(measure(*sides))
            weights.append(weight)
    return float(np.average(found, weights=weights)) if found else 0.0


def _far_in_window(*sides):
    """What a window says of groups, each as inverse depths and their errors."""
    medians = [np.median(depths) for depths, _ in sides]
    spread = sum(
        OF_MEDIAN * np.median(np.abs(depths - median))
        for (depths, _), median in zip(sides, medians, strict=True)
    )
    gap = abs(medians[0] - medians[1]) / (spread + LEAST_SPREAD)
    farther = min(np.median(np.abs(depths) / error) for depths, error in sides)
    return np.log(max(gap, 1)) / (1 + farther)


def _behind_in_window(*sides):
    """As :func:`_far_in_window`; which side is the front is not known."""
    ranges = sorted(tuple(np.quantile(depths, RANGE)) for depths, _ in sides)
    (least, back), (front, most) = ranges
    if not back < 0 < front:
        return 0.0
    gap = (front - back) / (back - least + most - front + LEAST_SPREAD)
    return float(np.clip(gap - USUAL_GAP, 0, 1))
