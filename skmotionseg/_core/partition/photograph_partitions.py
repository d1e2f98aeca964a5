"""Partitions of the tracks of photographs: few images, far apart and in no order.

Windows of frames that follow each other tell little of them. But the images of each
pair are parted as two images are; groups of tracks that the pairs agree on are the
motions to begin with, and are dropped and joined for as long as what they cost in all
pairs falls.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..geometry.description_length import WorkingFrames
from ..geometry.tracks import covered, pairs_with_most_tracks, working_coordinates
from .motions import Motions
from .pair_agreement import agreed_groups
from .pair_mixture import (
    Mixture,
    PairMotions,
    image_pairs,
    in_batches,
    log_evidence,
    settled,
)
from .two_view_energy import log_shares
from .two_view_partitions import ByDensity, parted_images, partitions_of
from .two_view_search import FEWEST_TRACKS

# Photographs are images between which the usual track moves by this share of what
# tracks cover, and in which so many tracks come back after images that do not see them;
# in more images, it is a video in which tracks are lost now and then. In simulated and
# real videos less than a tenth of the tracks come back, and the usual track moves by a
# thirtieth at most from frame to frame; in photographs, half come back.
FEWEST_MOVED, FEWEST_BACK, MOST_IMAGES = 0.04, 0.15, 30
# Pairs that are looked at, and those that are parted: the ones with most tracks in
# common. More than are parted, as some tracks of twelve images are in none of these.
MOST_PAIRS, MOST_PARTED = 100, 24
# Agreements above which groups are merged, the next where fewer groups are left than
# there must be.
AGREEMENTS = (0.3, 0.5, 0.7, 0.9)
# Rounds in which changes are compared, and those that cost least are settled.
FIRST_ROUNDS, ROUNDS, N_SETTLED = 1, 12, 2
# Times that motions are fitted anew from their surest tracks: from groups that pairs
# agree on, some tracks of which are of other motions, fits do not reach the best. In
# simulated photographs, the error falls from 3.7 to 3.1 %.
MOST_CONCENTRATIONS = 3
# Numbers of motions that cost more than the next that are still looked at.
MORE = 1


def are_photographs(points, visibility):
    """Whether images are far apart and in no order.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)

    Returns
    -------
    bool
    """
    n_frames = visibility.shape[1]
    if not 2 < n_frames <= MOST_IMAGES:
        return False
    both = visibility[:, 1:] & visibility[:, :-1]
    steps = np.linalg.norm(np.diff(points, axis=1), axis=2)[both]
    low, high = covered(points, visibility)
    if len(steps) and np.median(steps) < FEWEST_MOVED * (high - low).max():
        return False
    some = visibility[visibility.sum(axis=1) > 1]
    life = n_frames - some.argmax(axis=1) - some[:, ::-1].argmax(axis=1)
    back = np.count_nonzero(life > some.sum(axis=1))
    return len(some) > 0 and back >= FEWEST_BACK * len(some)


@dataclass(frozen=True)
class PhotographExplanation(ByDensity):
    """The motions of photographs, which place and reject tracks by their densities.

    Attributes
    ----------
    frames : WorkingFrames
    sides : ndarray of shape (n_pairs,)
        As of :class:`TwoViews`.
    models : PairMotions
        Of all pairs.
    log_shares : ndarray of shape (M + 1,)
        Logarithms of the shares of the tracks; the last is that of mismatches.
    """

    frames: WorkingFrames
    sides: np.ndarray
    models: PairMotions
    log_shares: np.ndarray

    @property
    def n_motions(self):
        return len(self.log_shares) - 1

    @property
    def motions(self):
        """The motions as fundamental matrices and noise, that of the usual pair."""
        told, found = self.models
        noise = np.where(told, found.noise, np.nan).T
        silent = ~told.any(axis=0)
        if silent.any():  # as noisy as the others
            noise[silent] = np.nanmedian(noise)
        fundamental = np.where(told[..., None, None], found.fundamental, 0)
        usual = np.nanmedian(noise, axis=1)
        return Motions(self.frames, fundamental.swapaxes(0, 1), usual)

    def reordered(self, order):
        """The same with the motions in another order."""
        return replace(
            self,
            models=self.models.reordered(order),
            log_shares=self.log_shares[[*order, -1]],
        )

    def _log_probabilities(self, points, visibility):
        pairs = image_pairs(self.frames, points, visibility, self.sides)
        shape = len(self.log_shares), len(points)
        evidence = log_evidence(in_batches(pairs), self.models, shape)
        known = evidence.any(axis=0)
        logarithms = evidence[:, known] + self.log_shares[:, None]
        return known, logarithms, np.arange(self.n_motions)


def photograph_partitions(points, visibility, counts, rng):
    """Partition the tracks of photographs.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    counts : ndarray of int, shape (n_counts,)
        Numbers of motions that are open, ascending.
    rng : RandomState

    Returns
    -------
    TwoViewPartitions or None
        None if no pair sees enough tracks, or there are not so many motions in them.
    """
    chosen = pairs_with_most_tracks(visibility, FEWEST_TRACKS, MOST_PAIRS)
    if not len(chosen):
        return None
    frames = WorkingFrames(chosen, *working_coordinates(points, visibility))
    pairs = image_pairs(frames, points, visibility)
    batches = in_batches(pairs)
    begun = _begun(pairs, batches, len(points), int(counts[0]), rng)
    if begun is None:
        return None
    sides = np.array([pair.views.side for pair in pairs])

    def explain(found):
        shares = log_shares(found.shares)
        return PhotographExplanation(frames, sides, found.models, shares)

    n_places = sum(len(pair.tracks) for pair in pairs)
    best = _with_fewer(batches, begun, counts)
    return partitions_of(best, counts, n_places, frames.scale, explain)


def _begun(pairs, batches, n_tracks, fewest, rng):
    """The mixture of the groups that pairs agree on; None if there are too few."""
    some = sorted(pairs, key=lambda pair: -len(pair.tracks))[:MOST_PARTED]
    parted = [(pair.tracks, parted_images(pair.views, rng)) for pair in some]
    for least in AGREEMENTS:
        labels = agreed_groups(n_tracks, parted, least)
        n_motions = int(labels.max()) + 1
        if n_motions >= max(fewest, 1):
            rows = np.where(labels < 0, n_motions, labels)
            shares = (rows == np.arange(n_motions + 1)[:, None]).astype(float)
            return _concentrated(batches, settled(batches, shares, ROUNDS))
    return None


def _concentrated(batches, found):
    """A mixture fitted anew from its surest tracks, for as long as that costs less."""
    for _ in range(MOST_CONCENTRATIONS):
        better = settled(batches, _of_surest(batches, found), ROUNDS)
        if not better.cost < found.cost:
            break
        found = better
    return found


def _of_surest(batches, found):
    """Shares of the half of the tracks of each motion that lead most before another."""
    shares = np.zeros_like(found.shares)
    evidence = log_evidence(batches, found.models, shares.shape)
    for motion, own in enumerate(evidence[:-1]):
        tracks = np.flatnonzero(found.labels == motion)
        others = np.delete(evidence[:, tracks], motion, axis=0).max(axis=0)
        lead = own[tracks] - others
        if len(tracks):
            shares[motion, tracks[lead >= np.median(lead)]] = 1
    shares[-1] = 1 - shares[:-1].sum(axis=0)
    return shares


def _with_fewer(batches, found, counts):
    """Mixtures of open numbers of motions, by their number, and ever fewer.

    Those in which all motions have tracks. Until the number is the least, or costs have
    risen.
    """
    best: dict[int, Mixture] = {}
    rises, fewest, most = 0, int(counts[0]), int(counts[-1])
    while True:
        if found.n_motions <= most and found.is_full:
            best[found.n_motions] = found
        if found.n_motions <= fewest or (rises > MORE and found.n_motions <= most):
            return best
        fewer = _fewer(batches, found)
        rises += fewer.cost >= found.cost
        found = fewer


def _fewer(batches, found):
    """The mixture of least cost with one motion dropped, or two made one."""
    tried = [
        settled(batches, shares, FIRST_ROUNDS) for shares in _changed(found.shares)
    ]
    tried = sorted(tried, key=_cost_of)[:N_SETTLED]
    again = (settled(batches, each.shares, ROUNDS) for each in tried)
    return min(again, key=_cost_of)


def _changed(shares):
    """Yield shares with those of one motion added to another's, or to mismatches."""
    n_motions = len(shares) - 1
    for motion in range(n_motions):
        for other in (*range(motion), n_motions):
            changed = shares.copy()
            changed[other] += changed[motion]
            yield np.delete(changed, motion, axis=0)


def _cost_of(mixture):
    return mixture.cost
