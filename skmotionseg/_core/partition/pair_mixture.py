"""Motions that are the same in all pairs of images, and what they cost, in nats.

Each motion has a fundamental matrix, and an affine map along its epipolar lines, in
each pair that sees enough of it; a track has the same motion in all pairs. So the
evidence of all pairs adds up, for a track and for a partition, where one pair alone
tells too little. Of the motions of several surfaces, one map is right for some tracks
alone: half of the density along the line is that of a track that may be anywhere on it.

Pairs that see about as many tracks are fitted side by side: of a few dozen tracks each,
many pairs take hardly longer than one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..geometry.description_length import by_size
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
# Places of tracks in pairs that are fitted at a time.
BATCH = 4096


class ImagePair(NamedTuple):
    """The tracks that two images see: their positions, and where they are."""

    tracks: np.ndarray
    views: TwoViews


class PairBatch(NamedTuple):
    """Pairs of images that see about as many tracks.

    Attributes
    ----------
    pairs : ndarray of int, shape (p,)
        Positions of the pairs.
    tracks : ndarray of int, shape (p, n_most)
        Where the tracks are; -1 after the last of a pair.
    views : TwoViews
        Of as many pairs and tracks; 0 after the last.
    """

    pairs: np.ndarray
    tracks: np.ndarray
    views: TwoViews


class PairMotions(NamedTuple):
    """Motions in pairs of images.

    Attributes
    ----------
    told : ndarray of bool, shape (P, M)
        Whether a pair says something of a motion.
    motions : TwoViewMotions
        Of P pairs and M motions each; any where a pair says nothing.
    """

    told: np.ndarray
    motions: TwoViewMotions

    def of_pairs(self, pairs):
        """The same of some pairs."""
        return PairMotions(self.told[pairs], self.motions[pairs])

    def reordered(self, order):
        """The same with some of the motions, in another order."""
        return PairMotions(self.told[:, order], self.motions[:, order])


class Mixture(NamedTuple):
    """Motions of pairs of images, the tracks that have them, and what both cost.

    Attributes
    ----------
    cost, data_cost : float
        Nats in all, and those of the places of the tracks.
    models : PairMotions
        Of all pairs.
    shares : ndarray of shape (M + 1, n)
        Probabilities of the motions; the last row is that of a mismatch.
    labels : ndarray of int, shape (n,)
        ``0..M``, of which M is a mismatch, or a track that no pair tells anything of.
    """

    cost: float
    data_cost: float
    models: PairMotions
    shares: np.ndarray
    labels: np.ndarray

    @property
    def n_motions(self):
        return len(self.shares) - 1

    @property
    def is_full(self):
        """Whether each motion has tracks, not only shares in them."""
        counts = np.bincount(self.labels, minlength=len(self.shares))
        return bool(counts[:-1].all())

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


def in_batches(pairs):
    """Put pairs of images side by side.

    Parameters
    ----------
    pairs : list of ImagePair

    Returns
    -------
    list of PairBatch
    """
    batches = []
    counts = np.array([len(pair.tracks) for pair in pairs])
    for some in by_size(counts.tolist(), BATCH):
        all_tracks, views = zip(*(pairs[k] for k in some), strict=True)
        seen = np.arange(counts[some].max()) < counts[some, None]
        tracks = np.full(seen.shape, -1)
        x, y = np.zeros((2, *seen.shape, 3))
        tracks[seen] = np.concatenate(all_tracks)
        x[seen] = np.concatenate([each.x for each in views])
        y[seen] = np.concatenate([each.y for each in views])
        side = np.array([each.side for each in views])
        batches.append(PairBatch(np.array(some), tracks, TwoViews(x, y, side)))
    return batches


def settled(batches, shares, rounds):
    """The mixture that is reached from the shares of the motions in the tracks.

    Parameters
    ----------
    batches : list of PairBatch
    shares : ndarray of shape (M + 1, n)
    rounds : int
        Of fitting motions and assigning tracks.

    Returns
    -------
    Mixture
    """
    models = None
    for _ in range(rounds):
        models = _fitted(batches, shares, models)
        evidence = log_evidence(batches, models, shares.shape)
        shares = normalized(evidence + log_shares(shares)[:, None])
    return _judged(batches, models, shares, evidence)


def _fitted(batches, shares, before):
    """The motions of all pairs, from those before where they tell of the same."""
    found = [
        _fitted_to(batch, shares, before and before.of_pairs(batch.pairs))
        for batch in batches
    ]
    told = np.concatenate([each.told for each in found])
    motions = sum((each.motions for each in found[1:]), found[0].motions)
    place = np.argsort(np.concatenate([batch.pairs for batch in batches]))
    return PairMotions(told, motions).of_pairs(place)


def _fitted_to(batch, shares, before):
    """The motions of the pairs of a batch."""
    shares = np.where(batch.tracks < 0, 0, shares[:-1, batch.tracks]).swapaxes(0, 1)
    told = shares.sum(axis=-1) >= FEWEST_TOLD
    shares = shares * told[..., None]
    if before is None:
        return PairMotions(told, _begun(batch.views, shares))
    motions = fit_two_view_motions(batch.views, shares, before.motions)
    new = np.flatnonzero((told != before.told).any(axis=1))
    if len(new):
        begun = _begun(batch.views.of_pairs(new), shares[new])
        motions = motions.with_rows(new, begun)
    return PairMotions(told, motions)


def _begun(views, shares):
    """Motions where there are none to begin with."""
    motions = None
    for _ in range(FIRST_FITS):
        motions = fit_two_view_motions(views, shares, motions)
    return motions


def log_evidence(batches, models, shape):
    """Log densities of tracks by motions, over those of mismatches, of all pairs.

    Parameters
    ----------
    batches : list of PairBatch
    models : PairMotions
        Of all pairs.
    shape : (int, int)
        M + 1 and n.

    Returns
    -------
    ndarray of shape (M + 1, n)
        0 where no pair tells anything, and for mismatches.
    """
    n_rows, n_tracks = shape
    evidence = np.zeros((n_rows, n_tracks + 1))  # the last is what pairs do not see
    for pairs, tracks, views in batches:
        told, motions = models.of_pairs(pairs)
        gained = np.where(told[..., None], _over_mismatches(views, motions), 0)
        for places, some in zip(tracks, gained, strict=True):
            evidence[:-1, places] += some
    return evidence[:, :-1]


def _over_mismatches(views, motions):
    """Log densities (p, M, n) of points, which may be anywhere on their lines.

    Over those of mismatches.
    """
    across, along, _ = squared_distances(motions.fundamental, motions.affine, views)
    near = log_student(along, motions.parallax) + np.log(1 - ANYWHERE)
    least = np.reshape(views.log_density_of_mismatches, (-1, 1, 1))
    anywhere = np.log(ANYWHERE) + least / 2
    return log_student(across, motions.noise) + np.logaddexp(near, anywhere) - least


def _judged(batches, models, shares, evidence):
    """The mixture with its most probable labels and its cost."""
    n_motions = len(shares) - 1
    labels = np.where(evidence.any(axis=0), shares.argmax(axis=0), n_motions)
    names = nats_of_labels(labels, len(shares))
    unknowns = NATS_OF_MOTION * n_motions
    anywhere = 0.0
    for pairs, tracks, views in batches:
        told, motions = models.of_pairs(pairs)
        unknowns += motions.costs_of_geometry(views)[told].sum()
        n_seen = np.count_nonzero(tracks >= 0, axis=1)
        anywhere -= (n_seen * views.log_density_of_mismatches).sum()
    data = anywhere - evidence[labels, np.arange(len(labels))].sum()
    return Mixture(float(data + names + unknowns), float(data), models, shares, labels)
