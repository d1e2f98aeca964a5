"""Partitions by rigid motion over windows: who belongs where, and what is apart.

A motion that is rigid over many frames leaves each track one free number, so tracks of
another motion are off by far more than the noise. Tracks are assigned to the motion
that explains them in all windows, their neighbours in the graph having a say; two
groups are different motions if one rigid motion explains both much worse than two do,
and the graph has few links between them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..geometry.rigid_motion import FREEDOM
from ..geometry.windows import FEWEST_TRACKS, FOCAL_LENGTHS, RigidMotion
from ..labels import groups_of, indicator
from .local_search import split

# The scale of residuals, in units of what over-segments leave.
SCALE_OF_NOISE = 2.0
# Nats per residual that a track costs at most, whatever its motion.
MOST_NATS = 3.0
# What it is worth, in nats, that all of a track's links are to its own motion.
NATS_OF_LINKS = 4.0
# Log odds of two groups being different motions: the log of how much worse one motion
# is than two, per track of the smaller group, and the log of the links between them
# over those that chance would give. A logistic regression on pairs of groups in
# simulated scenes (``python -m benchmarks.apartness``).
GAIN_WEIGHT, LINK_WEIGHT, PRIOR = 1.41, 3.17, -7.66
# Links over chance below which fewer say no more.
FEWEST_LINKS = 0.01
# Gains above this, in nats per track, say no more.
MOST_GAIN = 5.0
# Deviations, in pixels of a video 640 pixels wide, below which all are alike.
ALIKE = 0.1
# Log odds by which a number of motions must be surer than the one it replaces.
SURE = 2.0
# Nats per track that another partition into as many motions must save.
LEAST_SAVED = 0.3
# Pairs of groups that a joint motion is fitted to before the others.
JOINTLY_FITTED = 3
# Changes of a partition that are made at most; one or two are usual.
MOST_CHANGES = 5
# Inliers are within so many scales.
INLIER_SCALES = 2.5


class Apartness(NamedTuple):
    """Whether two groups are different motions.

    Attributes
    ----------
    log_odds : float
    joint : RigidMotion
        The motion that explains both best.
    gain : float
        By how much worse it does than their own two (see ``_gain``).
    links : float
        The links between them over those that chance would give.
    """

    log_odds: float
    joint: RigidMotion
    gain: float
    links: float


def _log_odds(apartness):
    return apartness.log_odds


class _Pair(NamedTuple):
    """Two groups of a partition, and their motions."""

    i: int
    j: int
    groups: tuple
    motions: tuple

    @property
    def key(self):
        return tuple(group.tobytes() for group in self.groups)


class RigidSearch:
    """Rigid motions of groups of a clip's tracks, and partitions by them.

    Parameters
    ----------
    windows : Windows
    affinity : ndarray of shape (n, n)
        Sparse; its diagonal does not count.

    Attributes
    ----------
    apart : dict of (bytes, bytes) to Apartness
        Of all pairs of groups, by their positions, to which a joint motion was fitted.
    """

    def __init__(self, windows, affinity):
        self.windows = windows
        self.affinity = affinity - np.diag(np.diagonal(affinity))
        self.degrees = self.affinity.sum(axis=1)
        self.scale = windows.least_noise
        self._motions, self.apart, self._apart_by_own = {}, {}, {}

    def calibrate(self, labels):
        """Choose focal length and scale of the noise by the larger groups of labels."""
        groups = sorted(groups_of(labels), key=len)[-4:]
        least, share, noise = np.inf, self.windows.focal_length, 0.0
        for focal_length in FOCAL_LENGTHS:
            self.windows.set_focal_length(focal_length)
            self.scale = self.windows.least_noise
            motions = self.windows.fit(groups)
            costs = self.costs(motions)
            total = sum(costs[group, k].sum() for k, group in enumerate(groups))
            if total < least:
                own = [
                    self.windows.deviations(*each)[0]
                    for each in zip(motions, groups, strict=True)
                ]
                least, share = total, focal_length
                noise = float(np.median(np.concatenate(own)))
        self.windows.set_focal_length(share)
        self.scale = max(self.windows.least_noise, SCALE_OF_NOISE * noise)

    def costs(self, motions):
        """Nats (n, M) of each track by each motion."""
        freedom = self.windows.freedom
        most = MOST_NATS * freedom
        costs = []
        for motion in motions:
            ratio = motion.squares / (FREEDOM * self.scale**2)
            nats = (FREEDOM + freedom) / 2 * np.log1p(ratio)
            nats = np.where(np.isnan(nats), most, np.minimum(nats, most))
            costs.append(np.where(freedom > 0, nats, 0).sum(axis=1))
        return np.stack(costs, axis=1)

    def motions(self, labels):
        """Rigid motions of the groups of a partition, each fitted once."""
        groups = groups_of(labels)
        new = [group for group in groups if group.tobytes() not in self._motions]
        for group, motion in zip(new, self.windows.fit(new), strict=True):
            self._motions[group.tobytes()] = motion
        return [self._motions[group.tobytes()] for group in groups]

    def energy(self, labels, motions):
        """Nats of a partition: of its tracks, and of links that it cuts."""
        tracks = np.arange(len(labels))
        own = self.costs(motions)[tracks, labels].sum()
        return float(own - NATS_OF_LINKS * self._linked(labels)[tracks, labels].sum())

    def fitted_energy(self, labels):
        """The energy of a partition as it is, its motions fitted to their inliers."""
        motions = self.motions(labels)
        refitted = self._refitted(labels, motions)
        return min(self.energy(labels, each) for each in (motions, refitted))

    def settled(self, labels, motions=None, rounds=2):
        """Assign tracks and fit motions in turn, for as long as that saves nats.

        Parameters
        ----------
        labels : ndarray of int, shape (n,)
            ``0..M - 1``, none empty.
        motions : list of RigidMotion, optional
        rounds : int, default=2

        Returns
        -------
        energy : float
        labels : ndarray of int, shape (n,)
            Of as many groups.
        motions : list of RigidMotion
        """
        motions = self.motions(labels) if motions is None else motions
        best = self.energy(labels, motions), labels, motions
        for _ in range(rounds):
            new = self._assigned(self.costs(motions), labels)
            if np.bincount(new, minlength=len(motions)).min() < FEWEST_TRACKS:
                break
            motions = self._refitted(new, motions)
            energy = self.energy(new, motions)
            if energy < best[0]:
                best = energy, new, motions
            if np.array_equal(new, labels):
                break
            labels = new
        return best

    def least_apart(self, labels, motions, enough):
        """The two groups that are least apart, and their :class:`Apartness`.

        A joint motion is fitted to two groups only where neither's own motion shows
        that they are one: at first to the few that are least apart by these, and to all
        where none of those is one within ``enough``.

        Returns
        -------
        (i, j), Apartness
            ``j < i``.
        """
        groups = groups_of(labels)
        pairs = [
            _Pair(i, j, (groups[i], groups[j]), (motions[i], motions[j]))
            for i in range(len(groups))
            for j in range(i)
        ]
        pairs.sort(key=lambda pair: self._by_own_motions(pair).log_odds)
        some = pairs[:JOINTLY_FITTED]
        if self._by_own_motions(pairs[0]).log_odds < 0:
            some = pairs[:1]
        least = min(some, key=lambda pair: self._apartness(pair).log_odds)
        if self._apartness(least).log_odds > enough:
            least = min(pairs, key=lambda pair: self._apartness(pair).log_odds)
        return (least.i, least.j), self._apartness(least)

    def descent(self, labels, fewest, enough):
        """Merge the two groups that are least apart until all are apart enough.

        Parameters
        ----------
        labels : ndarray of int, shape (n,)
        fewest : int
            Groups that are left in any case.
        enough : float
            Log odds of being apart.

        Returns
        -------
        energy, labels, motions
            As of :meth:`settled`.
        """
        _, labels, motions = self.settled(labels, rounds=1)
        while labels.max() + 1 > fewest:
            (i, j), least = self.least_apart(labels, motions, enough)
            if least.log_odds > enough:
                break
            motions = [*motions]
            motions[j] = least.joint
            del motions[i]
            labels = np.where(labels == i, j, labels)
            labels = labels - (labels > i)
            _, labels, motions = self.settled(labels, motions, rounds=1)
        return self.settled(labels, motions)

    def _assigned(self, costs, labels, sweeps=6):
        """Labels of least cost, links to others of the label being worth something."""
        for _ in range(sweeps):
            new = (costs - NATS_OF_LINKS * self._linked(labels, costs.shape[1])).argmin(
                axis=1
            )
            if np.array_equal(new, labels):
                break
            labels = new
        return labels

    def _linked(self, labels, n_groups=None):
        """The share of each track's links that go to each group: (n, M)."""
        X = indicator(labels)
        if n_groups is not None:
            X = np.pad(X, ((0, 0), (0, n_groups - X.shape[1])))
        links = self.affinity @ X
        degrees = self.degrees[:, None]
        return np.divide(links, degrees, out=np.zeros_like(links), where=degrees > 0)

    def _refitted(self, labels, motions):
        """Motions of groups, fitted again to their inliers."""
        groups = [
            self._inliers(*each)
            for each in zip(groups_of(labels), motions, strict=True)
        ]
        return self.windows.refine(groups, [[motion] for motion in motions])

    def _inliers(self, group, motion):
        """The tracks of a group that its motion explains; at least half of them."""
        deviations, freedom = self.windows.deviations(motion, group)
        deviations = np.where(freedom > 0, deviations, np.inf)
        limit = max(np.median(deviations), INLIER_SCALES * self.scale)
        kept = group[deviations <= limit]
        return kept if len(kept) >= FEWEST_TRACKS else group

    def _by_own_motions(self, pair):
        """The :class:`Apartness` of two groups if one of their motions is the joint."""
        key = pair.key
        if key not in self._apart_by_own:
            self._apart_by_own[key] = self._apartness_by(pair, pair.motions)
        return self._apart_by_own[key]

    def _apartness(self, pair):
        """The :class:`Apartness` of two groups, computed once."""
        if pair.key not in self.apart:
            best = self._by_own_motions(pair)
            both = [np.union1d(*pair.groups)]
            if best.log_odds > 0:
                joint = self.windows.refine(both, [pair.motions])
                best = min(best, self._apartness_by(pair, joint), key=_log_odds)
            if best.log_odds > 0:
                joint = self.windows.fit(both)
                best = min(best, self._apartness_by(pair, joint), key=_log_odds)
            self.apart[pair.key] = best
        return self.apart[pair.key]

    def _apartness_by(self, pair, joints):
        """The :class:`Apartness` of two groups for the best of some joint motions."""
        gain, joint = self._gain(pair.groups, pair.motions, joints)
        links = self._links(*pair.groups)
        log_odds = (
            GAIN_WEIGHT * min(gain, MOST_GAIN)
            - LINK_WEIGHT * np.log(links + FEWEST_LINKS)
            + PRIOR
        )
        return Apartness(float(log_odds), joint, float(gain), links)

    def _links(self, first, second):
        """The links between two groups over those that chance would give."""
        found = self.affinity[np.ix_(first, second)].sum()
        chance = self.degrees[first].sum() * self.degrees[second].sum()
        total = self.degrees.sum()
        return float(found * total / chance) if chance > 0 else 0.0

    def _gain(self, groups, own, joints):
        """How much worse the best of some motions is for two groups than their own.

        The log of the ratio of squared deviations, summed over the tracks, per track of
        the smaller group; and that motion.
        """
        alike = (ALIKE / self.windows.pixels) ** 2
        totals = np.zeros(len(joints))
        for group, motion in zip(groups, own, strict=True):
            apart, known = self.windows.deviations(motion, group)
            apart = (apart * self.windows.shrinkage(motion, group)) ** 2 + alike
            for k, joint in enumerate(joints):
                together, also = self.windows.deviations(joint, group)
                ratio = (together**2 + alike) / apart
                totals[k] += np.log(ratio[(known > 0) & (also > 0)]).sum()
        k = int(totals.argmin())
        return totals[k] / min(map(len, groups)), joints[k]


def rigid_partition(search, labels, over_segments, counts, candidates, bisect):
    """The partition that rigid motion prefers to a given one.

    Parameters
    ----------
    search : RigidSearch
    labels : ndarray of int, shape (n,)
        The partition to improve on: ``0..M - 1``, none empty.
    over_segments : list of ndarray of int, shape (n,)
    counts : ndarray of int, shape (n_counts,)
        Numbers of motions that may be.
    candidates : callable
        ``n_motions -> iterable of labels (n,)``: more partitions to start from.
    bisect : callable
        Takes the positions of a group to booleans, or to None if it cannot be parted.

    Returns
    -------
    ndarray of int, shape (n,)
        There are more motions than in ``labels`` where the groups that are left of an
        over-segmentation are surely apart. Of the partitions of that number the one of
        the lowest energy, after local search; ``labels`` if that saves too little to be
        sure, as where depth could be motion.
    """
    fewest, most = int(counts[0]), int(counts[-1])
    search.calibrate(over_segments[0])
    found = [search.settled(labels)]
    if fewest < most:
        found += [search.descent(some, fewest, SURE) for some in over_segments]
    sizes = [int(some.max()) + 1 for _, some, _ in found]
    n_motions = max((size for size in sizes if size <= most), default=most)
    starts = [some for _, some, _ in found]
    if fewest == most:
        starts += over_segments
    partitions = [
        search.descent(some, n_motions, np.inf)
        for some in starts
        if some.max() + 1 >= n_motions
    ]
    partitions += [search.settled(some) for some in candidates(n_motions)]
    partitions = [each for each in partitions if each[1].max() + 1 == n_motions]
    if not partitions:
        return labels
    best = min(partitions, key=lambda each: each[0])
    energy, improved, _ = _improved(search, best, bisect)
    if n_motions == labels.max() + 1:
        saved = search.fitted_energy(labels) - energy
        return improved if saved > LEAST_SAVED * len(labels) else labels
    return improved


def _improved(search, best, bisect):
    """A partition of lower energy: a group is split, and two others merged."""
    n_motions = int(best[1].max()) + 1
    for _ in range(MOST_CHANGES):
        new = [
            search.descent(some, n_motions, np.inf) for some in split(best[1], bisect)
        ]
        new = [each for each in new if each[1].max() + 1 == n_motions]
        better = min(new, key=lambda each: each[0], default=best)
        if not better[0] < best[0] - 1e-6 * abs(best[0]):
            break
        best = better
    return best
