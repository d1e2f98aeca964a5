"""The motions of a partition, and their inliers.

A motion is fitted to those of its tracks that it explains best, so that it stays what
it is when nearly half of the tracks that were given to it are outliers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..geometry.description_length import OF_MEDIAN, WorkingFrames, track_medians
from ..geometry.epipolar import ROBUST_SCALE, cheapest_rank_two, robust_fits
from ..geometry.motion_models import homogeneous
from ..labels import groups_of
from .outliers import RigidOutliers

# Rounds in which the half of the tracks that is explained best is fitted again
# (Rousseeuw and Van Driessen 2006, concentration steps). From half of a group of which
# two fifths are outliers, three reach the rest. A last fit is to all inliers.
CONCENTRATIONS = 3
# Inliers are within so many standard deviations of a motion's noise, which is
# taken to be a fifth of a pixel (in 640 x 480) at least: on precise tracks, what is
# left is not noise but what a model leaves out. Halved, it costs KT3DMoSeg a point of
# error with the number of motions known; doubled, a clip its number.
INLIER_THRESHOLD = 6.0
# Motions this much noisier than that of the median track are none. Halved or doubled,
# nothing changes on KT3DMoSeg.
USUAL_NOISE = 2.0
# Sums below this share of their terms are rounding errors.
ROUNDING = 1e-13


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

    def __getitem__(self, chosen):
        """Some of the motions."""
        return Motions(self.frames, self.fundamental[chosen], self.noise[chosen])

    @property
    def inlier_thresholds(self):
        """Distances, (M,) in working units, of the farthest inliers."""
        return inlier_threshold(self.noise)

    def distances(self, points, visibility):
        """How far tracks are from each motion.

        Parameters
        ----------
        points : ndarray of shape (n_tracks, n_frames, 2)
        visibility : ndarray of bool, shape (n_tracks, n_frames)

        Returns
        -------
        ndarray of shape (M, n_tracks)
            Median over the frame pairs of Sampson distances, in working units (not the
            lower: an outlier that is seen in two pairs is near in one of them by
            chance); NaN where no pair sees both the track and enough of the motion.
        """
        seen, x, y = self.frames.observe(points, visibility)
        ends = np.cumsum(seen.sum(axis=1))[:-1]
        by_pair = [np.split(homogeneous(side), ends) for side in (x, y)]
        return np.stack(
            [
                track_medians(
                    seen,
                    np.concatenate([*map(sampson_distances, F, *by_pair)]),
                    lower=False,
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
    for step in range(CONCENTRATIONS + 1):
        fitted = np.zeros_like(packed)
        fitted[packed] = np.broadcast_to(trusted, seen.shape)[seen]
        F, errors = robust_fits(x, y, packed, cheapest_rank_two, trusted=fitted)
        distances = track_medians(seen, np.sqrt(errors[packed]))
        judged = distances[np.isfinite(distances)]
        median = np.median(judged) if len(judged) else 0.0
        noise = noise_of_inliers(judged)
        last = step + 1 == CONCENTRATIONS
        trusted = distances <= (inlier_threshold(noise) if last else median)
    return F, noise


def noise_of_inliers(distances):
    """Standard deviation of distances (n,), some of which may be those of outliers.

    By the median of the inliers, again as long as that excludes more: among two fifths
    of outliers, the median of all would be twice that of the others.
    """
    noise, close = np.inf, distances
    while len(close) and (smaller := OF_MEDIAN * np.median(close)) < noise:
        noise = smaller
        close = distances[distances <= inlier_threshold(noise)]
    return noise if len(distances) else 0.0


def inlier_threshold(noise):
    """Distances of the farthest inliers of motions of that noise; working units."""
    return INLIER_THRESHOLD * np.maximum(noise, ROBUST_SCALE)


def sampson_distances(F, x, y):
    """Sampson distances of homogeneous points (n, 3); infinite if F is zero."""
    lines, back = x @ F.T, y @ F
    gradient = (lines[:, :2] ** 2 + back[:, :2] ** 2).sum(axis=1)
    if not F.any():
        return np.full(len(x), np.inf)
    algebraic = np.abs((y * lines).sum(axis=1))
    # In an epipole the gradient is a rounding error as well, and all is on a line.
    largest = (np.abs(y) * (np.abs(x) @ np.abs(F.T))).sum(axis=1)
    algebraic = np.where(algebraic > ROUNDING * largest, algebraic, 0)
    return algebraic / np.sqrt(np.maximum(gradient, np.finfo(float).tiny))


def usual(noise, of_tracks):
    """Which motions are no noisier than motions of some tracks usually are.

    A group of outliers has a fundamental matrix, too, but far from its tracks. As long
    as outliers are not the rule, it is much farther than that of the median track.

    Parameters
    ----------
    noise : ndarray of shape (M,)
    of_tracks : ndarray of shape (n,)
        Noise of the motion of each of these tracks.

    Returns
    -------
    ndarray of bool, shape (M,)
    """
    median = max(np.median(of_tracks), ROBUST_SCALE)
    return np.maximum(noise, ROBUST_SCALE) <= USUAL_NOISE * median


def inliers(motions, distances):
    """Which tracks are inliers of each motion.

    Parameters
    ----------
    motions : Motions
    distances : ndarray of shape (M, n)

    Returns
    -------
    ndarray of bool, shape (M, n)
        True, too, for tracks that no motion can judge.
    """
    unjudged = np.isnan(distances).all(axis=0)
    return (distances <= motions.inlier_thresholds[:, None]) | unjudged


@dataclass(frozen=True)
class Explanation:
    """The motions that were found, and over-segments of what was not.

    Attributes
    ----------
    motions : Motions
    spare : Motions
        Of over-segments most of whose tracks are inliers of no motion. They are no
        outliers, for they have a motion in common; but it was not worth its number.
    odd : RigidOutliers or None
        Of rigid motions over windows, where these were found.
    """

    motions: Motions
    spare: Motions
    odd: RigidOutliers | None = None

    def nearest(self, points, visibility, labels):
        """The labels as they are: whom a track moves with, the graph knows better."""
        return labels

    def reject(self, points, visibility, labels):
        """Labels with -1 for the tracks that are inliers of nothing.

        A track that is no inlier of its own motion, but of another, stays what it is: a
        fundamental matrix leaves a line free, and neighbours had a say.

        Parameters
        ----------
        points : ndarray of shape (n, n_frames, 2)
        visibility : ndarray of bool, shape (n, n_frames)
        labels : ndarray of int, shape (n,)

        Returns
        -------
        ndarray of int, shape (n,)
        """
        labels = labels.copy()
        labels[self._unexplained(points, visibility, labels)] = -1
        if self.odd is not None:
            labels[self.odd.outside(points, visibility)] = -1
        return labels

    def doubtful(self, points, visibility, labels):
        """Which tracks motions are searched again without, if they are many.

        Parameters
        ----------
        points, visibility, labels
            As for :meth:`reject`.

        Returns
        -------
        ndarray of bool, shape (n,)
        """
        doubtful = self._unexplained(points, visibility, labels)
        if self.odd is not None:
            doubtful |= self.odd.doubtful(points, visibility)
        return doubtful

    def _unexplained(self, points, visibility, labels):
        """Which tracks (n,) are inliers of nothing that frame pairs tell."""
        distances = self.motions.distances(points, visibility)
        own = distances[labels, np.arange(len(labels))]
        unexplained = ~np.isnan(own) & ~inliers(self.motions, distances).any(axis=0)
        left = np.flatnonzero(unexplained)
        if len(left) and len(self.spare.noise):
            distances = self.spare.distances(points[left], visibility[left])
            unexplained[left] = ~inliers(self.spare, distances).any(axis=0)
        return unexplained

    def among(self, points, visibility):
        """The same for more tracks than those that were searched."""
        odd = self.odd and self.odd.among(points, visibility)
        return replace(self, odd=odd)

    def reordered(self, order):
        """The same with the motions in another order."""
        return replace(self, motions=self.motions[order])
