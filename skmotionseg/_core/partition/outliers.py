"""Outliers among tracks that move rigidly: unexplained, and unlike their neighbours.

How far tracks are from the rigid motion of their group differs from video to video:
some trackers drift, some groups bend. So what is far is decided by all tracks of a
clip, as a mixture of two: residuals of inliers, whose logarithms are normally
distributed, and of outliers. These may be few, and anything up to the size of the
image, or many, and of about one size. A track that goes with its neighbours is none,
however badly it is explained: people and animals are not rigid. Nor is one that follows
a motion and slips at times: trackers lose points, and find them again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from ..geometry.coverage import Neighbours
from ..geometry.description_length import OF_MEDIAN
from ..geometry.windows import Windows

# Probability of being an outlier from which on a residual is one of an outlier, and the
# standard deviations of the least noise that it is at least.
SURELY = 0.99
FEWEST_DEVIATIONS = 8.0
# Remoteness from neighbours of tracks that do not go with them, and what residual, in
# those standard deviations, times remoteness is at least: real trackers drift, so that
# neither alone says enough. With a remoteness of 2 and no product as many outliers of
# simulated scenes are found, but where real trackers are right, twice as many tracks
# are taken for outliers. In 112 scenes 37 % of the outliers are rejected, and 0.04 % of
# the others; most of what is left slips, or is near a motion.
REMOTE = 1.5
STRANGE = 48.0
# What is usual for a neighbour, over what is for the nearest quarter of all, at most.
MOST_TIMES = 4.0
# Frames of a window in which a track that slips follows its motion, at no more than the
# least deviation of outliers; and the share of all such stretches that this takes.
STRETCH, FOLLOWED = 4, 0.25
# Of the mixture with few outliers: iterations. Of that with many: shares of inliers to
# begin with, iterations at most, and nats per track by which the last of them makes it
# likelier. Of both: the least spread of logarithms, and the largest share of outliers.
ITERATIONS = 60
BEGINNINGS, MOST_ITERATIONS, CONVERGED = (0.8, 0.55, 0.3), 100, 1e-3
LEAST_SPREAD, MOST_OUTLIERS = 0.15, 0.6
# Tracks that a mixture is fitted to, at least.
FEWEST_FITTED = 5
# Residuals below this share of the least noise are as good as none.
LEAST_RESIDUAL = 0.02


class Limits(NamedTuple):
    """Residuals above which tracks are outliers, if they do not go with others.

    Attributes
    ----------
    sure : float
        Infinite if there are none.
    doubtful : float
        Above which they are left out where motions are searched again; at most
        ``sure``.
    """

    sure: float
    doubtful: float


@dataclass(frozen=True)
class RigidOutliers:
    """Tells tracks that no rigid motion explains, and that do not go with others.

    Attributes
    ----------
    windows : Windows
        Of the tracks that motions were fitted to.
    motions : list of RigidMotion
    limits : Limits
        Residuals of outliers, in calibrated coordinates.
    neighbours : Neighbours
        Of the same tracks.
    """

    windows: Windows
    motions: list
    limits: Limits
    neighbours: Neighbours

    @classmethod
    def of(cls, windows, motions):
        """Those of motions that were found."""
        limits = _limits_in(windows, motions)
        neighbours = Neighbours(windows.points, windows.visibility, MOST_TIMES)
        return cls(windows, motions, limits, neighbours)

    def among(self, points, visibility):
        """The same, its limits being those of more tracks than were searched.

        Parameters
        ----------
        points : ndarray of shape (n, n_frames, 2)
        visibility : ndarray of bool, shape (n, n_frames)

        Returns
        -------
        RigidOutliers
        """
        windows = self.windows.of(points, visibility)
        limits = _limits_in(windows, windows.motions_again(self.motions))
        return replace(self, limits=limits)

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
        outside = self._far_and_remote(points, visibility, self.limits.sure, STRANGE)
        outside[outside] = ~self._followed(points[outside], visibility[outside])
        return outside

    def doubtful(self, points, visibility):
        """Which tracks (n,) may be outliers, however strange they are.

        Parameters
        ----------
        points, visibility
            As for :meth:`outside`.

        Returns
        -------
        ndarray of bool, shape (n,)
        """
        return self._far_and_remote(points, visibility, self.limits.doubtful, 0.0)

    def _followed(self, points, visibility):
        """Which tracks follow one motion in enough of their stretches: they slipped."""
        if not len(points):
            return np.zeros(0, dtype=bool)
        windows = self.windows.of(points, visibility)
        deviations = np.stack(
            [
                windows.deviations_in_stretches(motion, STRETCH)
                for motion in windows.motions_again(self.motions)
            ]
        )
        n_stretches = (~np.isnan(deviations)).any(axis=0).sum(axis=1)
        near = deviations <= FEWEST_DEVIATIONS * windows.least_noise
        most = near.sum(axis=2).max(axis=0)
        return (most > 0) & (most >= FOLLOWED * n_stretches)

    def _far_and_remote(self, points, visibility, limit, strange):
        """Which tracks are above a limit, and at least so strange."""
        windows = self.windows.of(points, visibility)
        residuals = least_residuals(windows, windows.motions_again(self.motions))
        far = np.isfinite(residuals) & (residuals > limit)
        remoteness = self.neighbours.remoteness(points[far], visibility[far])
        enough = residuals[far] * remoteness > strange * self.windows.least_noise
        far[far] = enough & (remoteness > REMOTE)
        return far


def _limits_in(windows, motions):
    """The limits of the tracks of some windows, in calibrated coordinates."""
    residuals, scale = least_residuals(windows, motions), windows.least_noise
    # What tracks cover is the inverse of the focal length across.
    largest = 1 / (windows.focal_length * scale)
    limits = outlier_limits(residuals[np.isfinite(residuals)] / scale, largest)
    return Limits(*(scale * limit for limit in limits))


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


def outlier_limits(residuals, largest):
    """Residuals above which tracks are outliers.

    Parameters
    ----------
    residuals : ndarray of shape (n,)
        In standard deviations of the least noise.
    largest : float
        That there can be.

    Returns
    -------
    Limits
    """
    x = np.log(np.clip(residuals, LEAST_RESIDUAL, largest))
    if len(x) < FEWEST_FITTED or np.ptp(x) == 0:
        return Limits(np.inf, np.inf)
    few = _limit(x, *_few_outliers(x, np.log(largest)))
    probabilities, centre, are_sure = _many_outliers(x)
    many = _limit(x, probabilities, centre)
    return Limits(min(few, many if are_sure else np.inf), min(few, many))


def _limit(x, probabilities, centre):
    """The residual above which outliers are sure, by logarithms (n,) of residuals."""
    sure = (probabilities > SURELY) & (x > centre)
    if not sure.any():
        return np.inf
    # Halfway to the largest of the others, so that rounding decides nothing.
    least = x[sure].min()
    limit = np.exp((least + x[x < least].max()) / 2)
    return max(float(limit), FEWEST_DEVIATIONS)


def _few_outliers(x, largest):
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


def _many_outliers(x):
    """The same by two normal distributions, and whether the farther is of outliers.

    Where one distribution has the lower Bayesian information criterion, there are none.
    From the spread of all, the mixture would end at one that is wide, and says that
    nothing is far; so it begins with several shares.
    """
    splits = [x <= np.quantile(x, share) for share in BEGINNINGS]
    alone = _Normals.fitted(x, [x])
    mixtures = [
        _Normals.fitted(x, [x[near], x[~near]]) for near in splits if not near.all()
    ]
    best = min([alone, *mixtures], key=lambda mixture: mixture.criterion(x))
    if best is alone:
        return np.zeros(len(x)), np.inf, False
    near, far = np.argsort(best.means)
    logs = best.log_densities(x)
    probabilities = np.exp(logs[far] - logsumexp(logs, axis=0))
    # If they are usually near, or most of the tracks, they are inliers of another kind.
    are_sure = np.exp(best.means[far]) >= FEWEST_DEVIATIONS
    are_sure &= best.shares[far] <= MOST_OUTLIERS
    return probabilities, best.means[near], are_sure


class _Normals(NamedTuple):
    """A mixture of normal distributions, without scikit-learn: each (K,)."""

    shares: np.ndarray
    means: np.ndarray
    variances: np.ndarray

    @classmethod
    def fitted(cls, x, parts):
        """By expectation maximisation, from parts of the values (n,)."""
        mixture = cls(
            np.array([len(part) / len(x) for part in parts]),
            np.array([part.mean() for part in parts]),
            np.array([part.var() for part in parts]) + LEAST_SPREAD**2,
        )
        before = -np.inf
        for _ in range(MOST_ITERATIONS):
            logs = mixture.log_densities(x)
            totals = logsumexp(logs, axis=0)
            mixture = cls._of_shares(x, np.exp(logs - totals))
            if totals.mean() - before < CONVERGED:
                break
            before = totals.mean()
        return mixture

    @classmethod
    def _of_shares(cls, x, shares):
        """The likeliest of values that are of each by these shares (K, n)."""
        sizes = shares.sum(axis=1) + np.finfo(float).eps
        means = shares @ x / sizes
        squares = (shares * (x - means[:, None]) ** 2).sum(axis=1)
        return cls(sizes / len(x), means, squares / sizes + LEAST_SPREAD**2)

    def log_densities(self, x):
        """Of each distribution at values (n,), times its share: (K, n)."""
        shares, means, variances = (each[:, None] for each in self)
        logs = (x - means) ** 2 / variances + np.log(2 * np.pi * variances)
        return np.log(shares) - logs / 2

    def criterion(self, x):
        """The Bayesian information criterion."""
        n_parameters = 3 * len(self.shares) - 1
        likelihood = logsumexp(self.log_densities(x), axis=0).sum()
        return n_parameters * np.log(len(x)) - 2 * likelihood
