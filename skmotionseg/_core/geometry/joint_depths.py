"""What the depths that a common motion gives two groups say of its being true."""

from __future__ import annotations

import numpy as np

from .description_length import OF_MEDIAN
from .windows import FEWEST_TRACKS

# Standard deviations by which an inverse depth is no longer that of infinity.
NEAR = 3.0
# By a focal length that is not quite right, a camera that turns before what is far
# seems to go along something at one depth: inverse depths that are spread by less than
# this share of them, and less than that share of the nearer group's. Errors are then at
# least so much of the latter.
ONE_DEPTH, FAR, LEAST_ERROR = 0.05, 0.25, 0.1
# The least spread and error of inverse depths, against division by zero.
LEAST_SPREAD = 1e-9


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
        smaller group. Windows by which both are at infinity tell nothing: something may
        have stood still until then.
    """
    found, weights = [], []
    for window in range(depths[0].shape[1]):
        sides = []
        for side, error in zip(depths, errors, strict=True):
            known = np.isfinite(side[:, window])
            least = np.maximum(error[known, window], LEAST_SPREAD)
            sides.append((side[known, window], least))
        weight = min(len(side) for side, _ in sides)
        if weight < FEWEST_TRACKS:
            continue
        sides = _by_any_focal_length(sides)
        if max(map(_from_infinity, sides)) > NEAR:
            found.append(_far_in_window(*sides))
            weights.append(weight)
    return float(np.average(found, weights=weights)) if found else 0.0


def _by_any_focal_length(sides):
    """Inverse depths of two groups, and errors that leave the focal length open."""
    medians = [np.median(np.abs(depths)) for depths, _ in sides]
    far = int(np.argmin(medians))
    nearest = max(medians)
    at_one_depth = _spread(sides[far][0]) < ONE_DEPTH * medians[far]
    if not at_one_depth or medians[far] >= FAR * nearest:
        return sides
    least = LEAST_ERROR * nearest
    return [(depths, np.maximum(errors, least)) for depths, errors in sides]


def _spread(depths):
    """The standard deviation of inverse depths, by their median absolute deviation."""
    return OF_MEDIAN * np.median(np.abs(depths - np.median(depths)))


def _far_in_window(*sides):
    """What a window says of groups, each as inverse depths and their errors."""
    medians = [np.median(depths) for depths, _ in sides]
    spread = sum(_spread(depths) for depths, _ in sides)
    gap = abs(medians[0] - medians[1]) / (spread + LEAST_SPREAD)
    farther = min(map(_from_infinity, sides))
    return np.log(max(gap, 1)) / (1 + farther)


def _from_infinity(side):
    """The median inverse depth of a group, in standard deviations."""
    depths, errors = side
    return np.median(np.abs(depths) / errors)
