"""Which motion each track of a stream follows, as frames come."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from ..geometry.rigid_motion import nats_of_residuals

# Nats per residual that a track costs at most, whatever its motion.
MOST_NATS = 3.0
# Neighbours in the picture, and nats that it is worth to go with all of them.
N_NEIGHBOURS, NATS_OF_NEIGHBOURS = 6, 4.0
# Steps that differ by less than so many standard deviations of the least noise are
# alike.
LEAST_STEP = 4.0
# Nats that it takes to change a label.
NATS_TO_CHANGE = 2.0
# Share of what earlier frames say that is left after each frame.
REMEMBERED = 0.95
# Tracks that tell the noise of their motion, and the usual lower quartile of deviations
# of tracks from their motions, in scales.
FEWEST_TELLING, USUAL_QUARTILE = 8, 0.35


class Residuals(NamedTuple):
    """How far tracks are from living motions.

    Attributes
    ----------
    squares, freedom : ndarray of shape (n, M)
        As of :meth:`Window.squares`, over the variances.
    nats : ndarray of shape (n, M)
        Cost of each track by each motion, for all of its residuals.
    scale : float
        Of the residuals, in calibrated coordinates.
    noise : ndarray of shape (M,)
        How many times larger the residuals of a motion's own tracks are, at least 1: as
        far as that, something explains them that is not quite rigid.
    variances : ndarray of shape (n,)
        Of each track's residuals, over that of one at rest in the image.
    """

    squares: np.ndarray
    freedom: np.ndarray
    nats: np.ndarray
    scale: float
    noise: np.ndarray
    variances: np.ndarray

    def deviations(self):
        """Root mean square residuals (n, M), in scales; NaN where unknown."""
        return np.sqrt(self.squares / np.maximum(self.freedom, 1)) / self.scale

    def usual(self):
        """Deviations (n, M) in units of what is usual among the tracks of a motion."""
        return self.deviations() / self.noise

    def with_noise(self, columns, judged):
        """The same with the noise of motions whose tracks are known.

        Parameters
        ----------
        columns : ndarray of int, shape (n,)
            Motion of each track, -1 for none.
        judged : ndarray of bool, shape (n,)
            Tracks that have a say.
        """
        return self._replace(
            noise=np.array(
                [
                    noise_of(deviations[judged & (columns == k)])
                    for k, deviations in enumerate(self.deviations().T)
                ]
            )
        )

    def without(self, column):
        """The same without a motion."""
        left = np.delete(np.arange(self.nats.shape[1]), column)
        squares, freedom, nats = self.squares, self.freedom, self.nats
        some = squares[:, left], freedom[:, left], nats[:, left]
        return Residuals(*some, self.scale, self.noise[left], self.variances)


def noise_of(deviations):
    """How many times larger than usual deviations of a motion's tracks are; at least 1.

    From the lower quartile: others among them, fewer than three quarters, do not count.
    """
    deviations = deviations[np.isfinite(deviations)]
    if len(deviations) < FEWEST_TELLING:
        return 1.0
    return max(1.0, float(np.quantile(deviations, 0.25)) / USUAL_QUARTILE)


def measure(window, fits, scale, rows=None, groups=None, relative=True):
    """Residuals of tracks of a window from motions.

    With ``groups``, the tracks that each motion was fitted to, what the fits have taken
    from these tracks' residuals is given back. Where a motion is known in some of a
    track's frames only, the others cost the same as these; where in none, the track
    costs most. If ``relative``, residuals are of fast tracks as if they were at rest.
    """
    squares, freedom = window.squares(fits, rows)
    every = slice(None) if rows is None else rows
    variances = window.variances[every] if relative else np.ones(len(squares))
    squares = squares / variances[:, None]
    for k, (fit, group) in enumerate(zip(fits, groups or [], strict=False)):
        fitted = group if rows is None else np.isin(rows, group)
        squares[fitted, k] *= window.inflation(group, fit)
    nats = nats_of_residuals(np.where(freedom > 0, squares, 0), freedom, scale)
    per_residual = np.minimum(nats / np.maximum(freedom, 1), MOST_NATS)
    per_residual = np.where(freedom > 0, per_residual, MOST_NATS)
    nats = per_residual * window.freedom[every][:, None]
    return Residuals(squares, freedom, nats, scale, np.ones(len(fits)), variances)


def neighbour_shares(points, steps, columns, n_motions, noise):
    """Shares (n, M) of each track's neighbours that have a motion.

    Neighbours are near in place and go the same way.

    Parameters
    ----------
    points : ndarray of shape (n, 2)
        Newest places, pixels.
    steps : ndarray of shape (n, 2)
        From the frame before; NaN for tracks that it does not see, whose neighbours are
        near in place only.
    columns : ndarray of int, shape (n,)
        Motion of each; negative ones have no vote.
    n_motions : int
    noise : float
        Least standard deviation of places, pixels.

    Returns
    -------
    ndarray of shape (n, M)
    """
    going = np.isfinite(steps).all(axis=1)
    unit = max(_spread(steps[going]), LEAST_STEP * noise)
    both = np.hstack(
        [points / _spread(points), np.where(going[:, None], steps, 0) / unit]
    )
    shares = np.zeros((len(points), n_motions))
    known = columns >= 0
    shares[going] = _votes(both, going, known & going, columns, n_motions)
    shares[~going] = _votes(both[:, :2], ~going, known, columns, n_motions)
    return shares


def _spread(values):
    """The median distance of coordinates from their centre; 1 if there is none."""
    spread = np.median(np.abs(values - np.median(values, axis=0))) if len(values) else 0
    return spread or 1.0


def _votes(space, rows, voters, columns, n_motions):
    """Shares (n_rows, M) of the voters nearest to some rows that have a motion."""
    rows, voters = np.flatnonzero(rows), np.flatnonzero(voters)
    shares = np.zeros((len(rows), n_motions))
    if len(voters) < 2 or len(rows) == 0:
        return shares
    k = min(N_NEIGHBOURS + 1, len(voters))
    _, near = KDTree(space[voters]).query(space[rows], k)
    near = voters[near.reshape(len(rows), k)]
    votes = near != rows[:, None]
    for place in range(k):
        shares[np.arange(len(rows)), columns[near[:, place]]] += votes[:, place]
    return shares / np.maximum(votes.sum(axis=1, keepdims=True), 1)


def assign(nats, memory, shares, columns):
    """Motion of each track: what it costs now and did before, and its neighbours.

    Parameters
    ----------
    nats, memory, shares : ndarray of shape (n, M)
    columns : ndarray of int, shape (n,)
        Motions so far; -1 for none.

    Returns
    -------
    ndarray of int, shape (n,)
    """
    total = nats + memory - NATS_OF_NEIGHBOURS * shares
    known = np.flatnonzero(columns >= 0)
    total[known, columns[known]] -= NATS_TO_CHANGE
    return total.argmin(axis=1)


def remembered(memory, nats, length):
    """Memory after a frame whose window has so many."""
    worse = nats - nats.min(axis=1, keepdims=True)
    return REMEMBERED * memory + worse / length
