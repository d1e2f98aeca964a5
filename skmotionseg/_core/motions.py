"""The motions of a partition, and the tracks that they explain.

A motion is fitted to those of its tracks that it explains best, so that it stays what
it is when nearly half of the tracks that were given to it are rubbish.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .epipolar import ROBUST_SCALE, cheapest_rank_two, robust_fits
from .geometry import WorkingFrames
from .motion_models import homogeneous
from .selection import groups_of

# Rounds in which the half of the tracks that is explained best is fitted again
# (Rousseeuw and Van Driessen 2006, concentration steps). From half of a group of which
# two fifths are rubbish, three reach the rest.
CONCENTRATIONS = 3
# A track is explained up to so many standard deviations of a motion's noise, which is
# taken to be half a pixel (in 640 x 480) at least: on precise tracks, what is left is
# not noise but what a model leaves out. See ``benchmarks/sensitivity.py``.
LIMIT = 5.0
# Standard deviations in a median of absolute values, for Gaussian noise.
OF_MEDIAN = 1.4826


@dataclass(frozen=True)
class Motions:
    """A fundamental matrix for each motion and frame pair.

    Attributes
    ----------
    frames : WorkingFrames
    fundamental : ndarray of shape (M, n_pairs, 3, 3)
        Zero where a pair sees fewer than eight tracks of the motion.
    noise : ndarray of shape (M,)
        Standard deviations, in working units.
    """

    frames: WorkingFrames
    fundamental: np.ndarray
    noise: np.ndarray

    @property
    def limits(self):
        """Distances, (M,) in working units, up to which a track is explained."""
        return LIMIT * np.maximum(self.noise, ROBUST_SCALE)

    def distances(self, points, visibility):
        """How far tracks are from each motion.

        Parameters
        ----------
        points : ndarray of shape (n_tracks, n_frames, 2)
        visibility : ndarray of bool, shape (n_tracks, n_frames)

        Returns
        -------
        ndarray of shape (M, n_tracks)
            Median over the frame pairs of Sampson distances, in working units; NaN
            where no pair sees both the track and enough of the motion.
        """
        seen, x, y = self.frames.observe(points, visibility)
        ends = np.cumsum(seen.sum(axis=1))[:-1]
        by_pair = [np.split(homogeneous(side), ends) for side in (x, y)]
        return np.stack(
            [
                _medians(
                    seen, [_sampson(*pair) for pair in zip(F, *by_pair, strict=True)]
                )
                for F in self.fundamental
            ]
        )


def fit_motions(geometry, labels, affinity):
    """Fit a motion to each group of tracks.

    Parameters
    ----------
    geometry : ClipGeometry
    labels : ndarray of int, shape (n,)
        -1 is in no group.
    affinity : ndarray of shape (n, n)
        The half of a group that is linked most to the rest of it is fitted first.

    Returns
    -------
    Motions
    """
    fits = [
        _fit_motion(geometry, group, affinity[np.ix_(group, group)])
        for group in groups_of(labels)
    ]
    fundamental, noise = zip(*fits, strict=True)
    return Motions(geometry.frames, np.stack(fundamental), np.array(noise))


def _fit_motion(geometry, members, affinity):
    """Fundamental matrices (n_pairs, 3, 3) and noise of one motion."""
    x, y, packed = geometry.of_group(members)
    seen = geometry.seen[:, members]
    links = affinity.sum(axis=1) - np.diagonal(affinity)
    trusted = links >= np.median(links)
    for _ in range(CONCENTRATIONS):
        fitted = np.zeros_like(packed)
        fitted[packed] = np.broadcast_to(trusted, seen.shape)[seen]
        F, errors = robust_fits(x, y, packed, cheapest_rank_two, trusted=fitted)
        distances = _medians(seen, [np.sqrt(errors[packed])])
        judged = distances[np.isfinite(distances)]
        median = np.median(judged) if len(judged) else 0.0
        trusted = distances <= median
    return F, OF_MEDIAN * median


def _sampson(F, x, y):
    """Sampson distances of homogeneous points (n, 3); infinite if F is zero."""
    lines, back = x @ F.T, y @ F
    gradient = (lines[:, :2] ** 2 + back[:, :2] ** 2).sum(axis=1)
    if not F.any():
        return np.full(len(x), np.inf)
    algebraic = np.abs((y * lines).sum(axis=1))
    return algebraic / np.sqrt(np.maximum(gradient, np.finfo(float).tiny))


def _medians(seen, distances):
    """Median for each track (n,) over its finite distances; NaN if there is none."""
    dense = np.full(seen.shape, np.inf)
    dense[seen] = np.concatenate(distances)
    counts = np.isfinite(dense).sum(axis=0)
    dense = np.sort(dense, axis=0)
    middle = dense[np.maximum(counts - 1, 0) // 2, np.arange(len(counts))]
    return np.where(counts > 0, middle, np.nan)


def explained_labels(motions, distances, labels):
    """Labels of what the motions explain: tracks stay, move or are rejected.

    A track that its motion does not explain goes to the one that explains it best, or
    is an outlier if none does. One that cannot be judged stays.

    Parameters
    ----------
    motions : Motions
    distances : ndarray of shape (M, n)
    labels : ndarray of int, shape (n,)

    Returns
    -------
    ndarray of int, shape (n,)
        -1 for outliers.
    """
    relative = distances / motions.limits[:, None]
    own = relative[labels, np.arange(len(labels))]
    stays = ~(own > 1) | (labels < 0)
    relative = np.where(np.isnan(relative), np.inf, relative)
    nearest = np.where(relative.min(axis=0) <= 1, relative.argmin(axis=0), -1)
    return np.where(stays, labels, nearest)
