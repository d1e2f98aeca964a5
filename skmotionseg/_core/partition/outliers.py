"""Outliers among tracks that move rigidly: unexplained, and unlike their neighbours.

How far tracks are from the rigid motion of their group differs from video to video:
some trackers drift, some groups bend. So what is far is decided by all tracks of a
clip, as a mixture of two normal distributions of the logarithms of residuals. A track
that goes with its neighbours is none, however badly it is explained: people and
animals are not rigid.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from warnings import catch_warnings, simplefilter

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.mixture import GaussianMixture

from ..geometry.coverage import Neighbours
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
# Shares of the tracks that are inliers by the mixture to begin with, and the standard
# deviation of logarithms that is added to both distributions.
BEGINNINGS = (0.8, 0.55, 0.3)
LEAST_SPREAD = 0.15
# Tracks that a mixture is fitted to, at least.
FEWEST_TOLD = 5
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
        limit = _limit_in(windows, motions)
        neighbours = Neighbours(windows.points, windows.visibility)
        return cls(windows, motions, limit, neighbours)

    def among(self, points, visibility):
        """The same, its limit being that of more tracks than were searched.

        Parameters
        ----------
        points : ndarray of shape (n, n_frames, 2)
        visibility : ndarray of bool, shape (n, n_frames)

        Returns
        -------
        RigidOutliers
        """
        windows = self.windows.of(points, visibility)
        limit = _limit_in(windows, windows.motions_again(self.motions))
        return replace(self, limit=limit)

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
        return self._lost(points, visibility, STRANGE)

    def doubtful(self, points, visibility):
        """Which tracks (n,) may be outliers: how strange they are is left open.

        Parameters
        ----------
        points, visibility
            As for :meth:`outside`.

        Returns
        -------
        ndarray of bool, shape (n,)
        """
        return self._lost(points, visibility, 0.0)

    def _lost(self, points, visibility, strange):
        windows = self.windows.of(points, visibility)
        residuals = least_residuals(windows, windows.motions_again(self.motions))
        far = np.isfinite(residuals) & (residuals > self.limit)
        remoteness = self.neighbours.remoteness(points[far], visibility[far])
        enough = residuals[far] * remoteness > strange * self.windows.least_noise
        far[far] = enough & (remoteness > REMOTE)
        return far


def _limit_in(windows, motions):
    """The limit of the tracks of some windows, in calibrated coordinates."""
    residuals = least_residuals(windows, motions)
    known = residuals[np.isfinite(residuals)]
    return windows.least_noise * outlier_limit(known / windows.least_noise)


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


def outlier_limit(residuals):
    """The residual above which tracks are surely outliers.

    Parameters
    ----------
    residuals : ndarray of shape (n,)
        In standard deviations of the least noise.

    Returns
    -------
    float
        Infinite if there are no outliers.
    """
    x = np.log(np.maximum(residuals, LEAST_RESIDUAL))
    mixture = _mixture(x[:, None])
    if mixture is None:
        return np.inf
    near, far = np.argsort(mixture.means_[:, 0])
    probabilities = mixture.predict_proba(x[:, None])[:, far]
    sure = (probabilities > SURELY) & (x > mixture.means_[near, 0])
    least = x[sure].min(initial=np.inf)
    # Halfway to the largest of the others, so that rounding decides nothing.
    limit = np.exp((least + x[x < least].max()) / 2)
    return max(float(limit), FEWEST_DEVIATIONS)


def _mixture(x):
    """Two normal distributions that explain values (n, 1) better than one, or None.

    By the Bayesian information criterion. Where nearly half are outliers, expectation
    maximisation from the spread of all ends at one that is wide; so it begins with
    several shares of them.
    """
    if len(x) < FEWEST_TOLD or np.ptp(x) == 0:
        return None
    splits = [x[:, 0] <= np.quantile(x, share) for share in BEGINNINGS]
    mixtures = [
        _normals(x, parts)
        for parts in ([x], *([x[near], x[~near]] for near in splits))
        if all(map(len, parts))
    ]
    best = min(mixtures, key=lambda mixture: mixture.bic(x))
    return None if best is mixtures[0] else best


def _normals(x, parts):
    """A mixture of normal distributions, fitted from parts of the values (n, 1)."""
    spreads = np.array([part.var() for part in parts]) + LEAST_SPREAD**2
    mixture = GaussianMixture(
        len(parts),
        reg_covar=LEAST_SPREAD**2,
        init_params="random",  # replaced by what follows
        random_state=0,
        weights_init=[len(part) / len(x) for part in parts],
        means_init=[part.mean(axis=0) for part in parts],
        precisions_init=1 / spreads[:, None, None],
    )
    with catch_warnings():
        simplefilter("ignore", ConvergenceWarning)
        return mixture.fit(x)
