"""Outliers among tracks that move rigidly: unexplained, and unlike their neighbours.

How far tracks are from the rigid motion of their group differs from video to video:
some trackers drift, some groups bend. So what is far is decided by all tracks of a
clip, as a mixture of two: residuals of inliers, whose logarithms are normally
distributed, and of outliers, which may be anything up to the size of the image. A track
that goes with its neighbours is none, however badly it is explained: people and
animals are not rigid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.coverage import Neighbours
from ..geometry.description_length import OF_MEDIAN
from ..geometry.windows import Windows

# Probability of being an outlier from which on a residual is one of an outlier, and the
# standard deviations of the least noise that it is at least.
SURELY = 0.99
FEWEST_DEVIATIONS = 8.0
# Remoteness from neighbours of tracks that do not go with them, and what residual, in
# those standard deviations, times remoteness is at least: real trackers drift, so that
# neither alone says enough. On simulated scenes 45 % of the outliers are found so, and
# 0.05 % of the others, as with a remoteness of 2 and no product; but where real
# trackers are right, half as many are taken for outliers.
REMOTE = 1.5
STRANGE = 48.0
# Iterations of the mixture, the least spread of logarithms, and the largest share of
# outliers.
ITERATIONS = 60
LEAST_SPREAD = 0.15
MOST_OUTLIERS = 0.6
# Residuals below this share of the least noise are as good as none.
LEAST_RESIDUAL = 0.02


@dataclass(frozen=True)
class RigidOutliers:
    """Tells tracks that no rigid motion explains, and that do not go with others.

    Attributes
    ----------
    windows : Windows
        Of the tracks that motions were fitted to.
    motions : list of RigidMotion
    limit : float
        Residual of outliers, in calibrated coordinates.
    neighbours : Neighbours
        Of the same tracks.
    """

    windows: Windows
    motions: list
    limit: float
    neighbours: Neighbours

    @classmethod
    def of(cls, windows, motions):
        """Those of motions that were found."""
        residuals, scale = least_residuals(windows, motions), windows.least_noise
        # What tracks cover is the inverse of the focal length across.
        largest = 1 / (windows.focal_length * scale)
        limit = outlier_limit(residuals[np.isfinite(residuals)] / scale, largest)
        neighbours = Neighbours(windows.points, windows.visibility)
        return cls(windows, motions, scale * limit, neighbours)

    def outside(self, points, visibility):
        """Which tracks (n,) are outliers.

        Parameters
        ----------
        points : ndarray of shape (n, n_frames, 2)
        visibility : ndarray of bool, shape (n, n_frames)

        Returns
        -------
        ndarray of bool, shape (n,)
        """
        windows = self.windows.of(points, visibility)
        residuals = least_residuals(windows, windows.motions_again(self.motions))
        far = np.isfinite(residuals) & (residuals > self.limit)
        remoteness = self.neighbours.remoteness(points[far], visibility[far])
        strange = residuals[far] * remoteness > STRANGE * self.windows.least_noise
        far[far] = strange & (remoteness > REMOTE)
        return far


def least_residuals(windows, motions):
    """Root mean square residuals of tracks from the motion that is nearest.

    Parameters
    ----------
    windows : Windows
    motions : list of RigidMotion

    Returns
    -------
    ndarray of shape (n,)
        In calibrated coordinates; infinite where no window judges a track.
    """
    tracks = np.arange(len(windows.points))
    least = np.full(len(tracks), np.inf)
    for motion in motions:
        residuals, freedom = windows.deviations(motion, tracks)
        least = np.where(freedom > 0, np.minimum(least, residuals), least)
    return least


def outlier_limit(residuals, largest):
    """The residual above which tracks are surely outliers.

    Parameters
    ----------
    residuals : ndarray of shape (n,)
        In standard deviations of the least noise.
    largest : float
        That there can be.

    Returns
    -------
    float
        Infinite if there are no outliers.
    """
    x = np.log(np.clip(residuals, LEAST_RESIDUAL, largest))
    if not len(x):
        return np.inf
    probabilities, centre = _outlier_probabilities(x, np.log(largest))
    least = x[(probabilities > SURELY) & (x > centre)].min(initial=np.inf)
    # Halfway to the largest of the others, so that rounding decides nothing.
    limit = np.exp((least + x[x < least].max()) / 2)
    return max(float(limit), FEWEST_DEVIATIONS)


def _outlier_probabilities(x, largest):
    """Of logarithms being those of outliers (n,), and the centre of the others.

    Expectation maximisation of a normal distribution and one that is uniform from its
    centre to the largest.
    """
    centre = np.median(x)
    spread = max(OF_MEDIAN * np.median(np.abs(x - centre)), LEAST_SPREAD)
    share = 0.1
    for _ in range(ITERATIONS):
        normal = np.exp(-0.5 * ((x - centre) / spread) ** 2) / (
            spread * np.sqrt(2 * np.pi)
        )
        uniform = (x > centre) / max(largest - centre, LEAST_SPREAD)
        odd = share * uniform
        odd = odd / (odd + (1 - share) * normal + np.finfo(float).tiny)
        total = max((1 - odd).sum(), 1e-9)
        centre = ((1 - odd) * x).sum() / total
        spread = np.sqrt(((1 - odd) * (x - centre) ** 2).sum() / total)
        spread, share = max(spread, LEAST_SPREAD), min(odd.mean(), MOST_OUTLIERS)
    return odd, centre
