"""What the depths that a common motion gives two groups say of its being true."""

from __future__ import annotations

import numpy as np

from .description_length import OF_MEDIAN
from .windows import FEWEST_TRACKS

# Standard deviations by which an inverse depth is no longer that of infinity.
NEAR = 3.0
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
        if weight >= FEWEST_TRACKS and max(map(_from_infinity, sides)) > NEAR:
            found.append(_far_in_window(*sides))
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
    farther = min(map(_from_infinity, sides))
    return np.log(max(gap, 1)) / (1 + farther)


def _from_infinity(side):
    """The median inverse depth of a group, in standard deviations."""
    depths, errors = side
    return np.median(np.abs(depths) / errors)
