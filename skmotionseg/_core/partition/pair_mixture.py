"""Motions that are the same in all pairs of images, and what they cost, in nats.

Each motion has a fundamental matrix, and an affine map along its epipolar lines, in
each pair that sees enough of it; a track has the same motion in all pairs. So the
evidence of all pairs adds up, for a track and for a partition, where one pair alone
tells too little. Of the motions of several surfaces, one map is right for some tracks
alone: half of the density along the line is that of a track that may be anywhere on it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..geometry.two_views import (
    TwoViewMotions,
    TwoViews,
    fit_two_view_motions,
    log_student,
    squared_distances,
    two_views,
)
from .two_view_energy import (
    NATS_OF_MOTION,
    log_shares,
    nats_of_labels,
    normalized,
)

# Share of the tracks of a motion that may be anywhere on their epipolar line.
ANYWHERE = 0.5
# Tracks of a motion that a pair must see to say something of it: one more than
# determine the geometry of an affine camera. With the eight that determine a
# fundamental matrix, tracks of small motions stay where they are in the pairs that see
# fewer: in simulated photographs, the number is right in 86 % instead of all.
FEWEST_TOLD = 5
# Steps in which motions are fitted where there are none to begin with.
FIRST_FITS = 3


class ImagePair(NamedTuple):
    """The tracks that two images see: their positions, and where they are."""

    tracks: np.ndarray
    views: TwoViews


class PairMotions(NamedTuple):
    """The motions that a pair of images says something of; None if there are none."""

    told: np.ndarray
    motions: TwoViewMotions | None


class Mixture(NamedTuple):
    """Motions of pairs of images, the tracks that have them, and what both cost.

    Attributes
    ----------
    cost, data_cost : float
        Nats in all, and those of the places of the tracks.
    models : list of PairMotions
        Of each pair.
    shares : ndarray of shape (M + 1, n)
        Probabilities of the motions; the last row is that of a mismatch.
    labels : ndarray of int, shape (n,)
        ``0..M``, of which M is a mismatch, or a track that no pair tells anything of.
    """

    cost: float
    data_cost: float
    models: list
    shares: np.ndarray
    labels: np.ndarray

    @property
    def n_motions(self):
        return len(self.shares) - 1

    @property
    def shares_of_motions(self):
        """Probabilities (M, n) of the motions."""
        return self.shares[:-1]


def image_pairs(frames, points, visibility, sides=None):
    """The tracks in each pair of images.

    Parameters
    ----------
    frames : WorkingFrames
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    sides : ndarray of shape (n_pairs,), optional
        As of :class:`TwoViews`, of the tracks that motions were fitted to.

    Returns
    -------
    list of ImagePair
    """
    seen, *both = frames.observe(points, visibility)
    ends = np.cumsum(seen.sum(axis=1))[:-1]
    places = zip(*(np.split(each, ends) for each in both), strict=True)
    sides = [None] * len(seen) if sides is None else sides
    return [
        ImagePair(np.flatnonzero(there), two_views(x, y, side))
        for there, (x, y), side in zip(seen, places, sides, strict=True)
    ]


def settled(pairs, shares, rounds):
    """The mixture that is reached from the shares of the motions in the tracks.

    Parameters
    ----------
    pairs : list of ImagePair
    shares : ndarray of shape (M + 1, n)
    rounds : int
        Of fitting motions and assigning tracks.

    Returns
    -------
    Mixture
    """
    models = [None] * len(pairs)
    for _ in range(rounds):
        models = [
            _fitted(pair, shares, before)
            for pair, before in zip(pairs, models, strict=True)
        ]
        evidence = log_evidence(pairs, models, shares.shape)
        shares = normalized(evidence + log_shares(shares)[:, None])
    return _judged(pairs, models, shares, evidence)


def _fitted(pair, shares, before):
    """The motions of a pair, from those before if it tells of the same."""
    shares = shares[:-1, pair.tracks]
    told = np.flatnonzero(shares.sum(axis=1) >= FEWEST_TOLD)
    if not len(told):
        return PairMotions(told, None)
    same = before is not None and np.array_equal(told, before.told)
    motions = before.motions if same else None
    for _ in range(1 if same else FIRST_FITS):
        motions = fit_two_view_motions(pair.views, shares[told], motions)
    return PairMotions(told, motions)


def log_evidence(pairs, models, shape):
    """Log densities of tracks by motions, over those of mismatches, of all pairs.

    Parameters
    ----------
    pairs : list of ImagePair
    models : list of PairMotions
    shape : (int, int)
        M + 1 and n.

    Returns
    -------
    ndarray of shape (M + 1, n)
        0 where no pair tells anything, and for mismatches.
    """
    evidence = np.zeros(shape)
    for pair, (told, motions) in zip(pairs, models, strict=True):
        if len(told):
            at = np.ix_(told, pair.tracks)
            least = pair.views.log_density_of_mismatches
            evidence[at] += _log_densities(pair.views, motions) - least
    return evidence


def _log_densities(views, motions):
    """Of a point of the second image, (M, n), which may be anywhere on its line."""
    across, along, _ = squared_distances(motions.fundamental, motions.affine, views)
    near = log_student(along, motions.parallax) + np.log(1 - ANYWHERE)
    anywhere = np.log(ANYWHERE) + views.log_density_of_mismatches / 2
    return log_student(across, motions.noise) + np.logaddexp(near, anywhere)


def _judged(pairs, models, shares, evidence):
    """The mixture with its most probable labels and its cost."""
    n_motions = len(shares) - 1
    labels = np.where(evidence.any(axis=0), shares.argmax(axis=0), n_motions)
    names = nats_of_labels(labels, len(shares))
    unknowns = NATS_OF_MOTION * n_motions
    anywhere = 0.0
    for pair, (told, motions) in zip(pairs, models, strict=True):
        anywhere -= len(pair.tracks) * pair.views.log_density_of_mismatches
        if len(told):
            unknowns += motions.costs_of_geometry(pair.views).sum()
    data = anywhere - evidence[labels, np.arange(len(labels))].sum()
    return Mixture(float(data + names + unknowns), float(data), models, shares, labels)
