"""Partitions by rigid motion over windows: who belongs where, and what is apart.

A motion that is rigid over many frames leaves each track one free number, so tracks of
another motion are off by far more than the noise. Tracks are assigned to the motion
that explains them in all windows, their neighbours in the graph having a say; two
groups are different motions if one rigid motion explains both much worse than two do,
or has to place one at infinity, and the graph has few links between them.
"""

from __future__ import annotations

from copy import copy
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from ..geometry.camera import USUAL_FOCAL_LENGTH
from ..geometry.joint_depths import infinitely_far
from ..geometry.rigid_motion import FREEDOM
from ..geometry.windows import (
    FEWEST_TRACKS,
    FOCAL_STEPS,
    FitRequest,
    RigidMotion,
    best_focal_length,
)
from ..labels import groups_of, indicator
from .local_search import split
from .side_by_side import run, side_by_side

# The scale of residuals, in units of what over-segments leave.
SCALE_OF_NOISE = 2.0
# Where over-segments leave noise above this, in pixels of a video 640 pixels wide, they
# may mix motions, of which there are more. They do if twice as many leave less than
# this share of it: twelve that move apart leave 0.19, and scenes of two to eight, of
# which hardly any is that rough, 0.35 and more.
ROUGH, LESS_ROUGH = 0.3, 0.6
# Nats per track by which a focal length must explain tracks better, for each unit of
# the log of its ratio to the usual one. On simulated scenes, whose focal lengths are
# within 0.6 and 1.45 by construction, the weight hardly matters: from 0.2 to 1, errors
# are 0.16 to 0.21 on average. With 1, clips of wide cameras stay at the usual one
# whatever they show.
NATS_OF_FOCAL_LENGTH = 0.3
# Nats per residual that a track costs at most, whatever its motion.
MOST_NATS = 3.0
# What it is worth, in nats, that all of a track's links are to its own motion.
NATS_OF_LINKS = 4.0
# Log odds of two groups being different motions, for each kind of :func:`evidence`, and
# without any: what the number of motions is told by. By a logistic regression on pairs
# of groups that decide in simulated scenes (``python -m benchmarks.apartness``), before
# fits were kept in front of the camera, and had a term for what is behind.
GAIN_WEIGHT, LINK_WEIGHT, FAR_WEIGHT, CROSS_WEIGHT = 0.72, 1.3, 5.15, 1.36
PRIOR = -8.46
# The same for their distance, by which they are merged: what counts there is which of
# several pairs is one motion rather than whether any is, and links tell that better,
# those of all tracks. By a regression, too, on scenes of rigid bodies and relief.
MERGING_WEIGHTS, MERGING_PRIOR = (1.65, 1.85, 5.0), -7.0
# Links over chance below which fewer say no more: of the odds, and of the distance.
FEWEST_LINKS, FEWEST_MERGING_LINKS = 0.06, 0.01
# Distances by one of two motions below which no joint motion is fitted.
SURELY_ONE = -4.0
# Gains above this, in nats per track, bring two groups no farther apart.
MOST_GAIN = 5.0
# A motion by which tracks of another group cost so many nats more, on average, than by
# their own does not explain them at all.
MOST_CROSS = 4.0
# Deviations, in pixels of a video 640 pixels wide, below which all are alike.
ALIKE = 0.1
# Pairs of groups that a joint motion is fitted to before the others, and the tracks of
# a group that motions are fitted to where two are compared with one.
JOINTLY_FITTED = 3
MOST_COMPARED = 160
# Changes of a partition that are made at most; one or two are usual.
MOST_CHANGES = 5
# Rounds of assigning and fitting that a partition is settled in, at most.
ROUNDS = 6
# Nats per track that a partition costs beside its energy: for each unit by which the
# log odds of its motions being different are less, and for each nat that labels tell.
# By which partitions of simulated scenes are then the best.
NATS_OF_ODDS = 0.3
NATS_OF_LABELS = 0.5
# Log odds above this, and below its negative, count as this.
SURE = 4.0
# Numbers of motions beyond the one chosen so far that are searched, too, unless by the
# log odds there are hardly as many (one in twenty): where two are missing, their tracks
# are mixed until both are there.
LOOKAHEAD, HOPELESS = 2, -3.0
# Groups of linked tracks that no motion explains, of which new motions are tried.
MOST_UNEXPLAINED = 3
# Inliers are within so many scales.
INLIER_SCALES = 2.5


class Apartness(NamedTuple):
    """Whether two groups are different motions.

    Attributes
    ----------
    log_odds : float
    distance : float
        By which the two that are merged are chosen.
    joint : RigidMotion
        The motion that explains both best.
    size : int
        Tracks of the smaller.
    gain : float
        By how much worse it does than their own two (see ``_gain``).
    links : float
        The links between the tracks that their motions explain, over those that chance
        would give.
    far : float
        How clearly the joint motion places one of them at infinity, and one not (see
        :func:`infinitely_far`).
    cross : float
        By how much worse the motion of either explains the other (see ``_cross``).
    """

    log_odds: float
    distance: float
    joint: RigidMotion
    size: int
    gain: float
    links: float
    far: float
    cross: float


def _log_odds(apartness):
    return apartness.log_odds


def _distance(apartness):
    return apartness.distance


class Step(NamedTuple):
    """A partition, and what would be merged next.

    Attributes
    ----------
    energy : float
    labels : ndarray of int, shape (n,)
    motions : list of RigidMotion
    pair : (int, int) or None
        The two groups that are least apart, the smaller label first.
    log_odds : float
        Of all groups being different motions: of the two that are likeliest one.
        Infinite where there is no pair.
    distance : float
        Of the two groups that are least apart.
    """

    energy: float
    labels: np.ndarray
    motions: list
    pair: tuple[int, int] | None = None
    log_odds: float = np.inf
    distance: float = np.inf

    @property
    def n_motions(self):
        return int(self.labels.max()) + 1


def _with_odds_of(step, i, j, least):
    """A step with the two groups that are least apart, and their :class:`Apartness`."""
    return step._replace(pair=(j, i), log_odds=least.log_odds, distance=least.distance)


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

    What fits motions is a search as in :mod:`.side_by_side`: a generator, which
    :meth:`run` runs to its end, several side by side.

    Parameters
    ----------
    windows : Windows
    affinity : ndarray of shape (n, n)
        Few of its entries are not 0; its diagonal does not count.
    simplest : ndarray of shape (n, n), optional
        The part of it that is by the simplest motion model, by which the links between
        two groups are compared with chance: they say the same of all videos, while the
        parts of other models depend on how much depth there is. Default: all of it.
    focal_length : float, optional
        As a share of the larger side of what the tracks cover. If not given, the one
        that explains the larger groups best.

    Attributes
    ----------
    apart : dict of (bytes, bytes) to Apartness
        Of all pairs of groups, by their positions, to which a joint motion was fitted.
    """

    def __init__(self, windows, affinity, simplest=None, focal_length=None):
        self.windows, self.focal_length = windows, focal_length
        self.affinity = _links_of(affinity)
        self.degrees = self.affinity.sum(axis=1)
        self.simplest = _links_of(affinity if simplest is None else simplest)
        self.scale = windows.least_noise
        self._fitted, self.apart, self._distances_by_own = {}, {}, {}
        self._total, self._links_to = self.simplest.sum(), {}

    def run(self, *searches):
        """What each of some searches returns, run side by side."""
        return run(side_by_side(searches), self._found)

    def _found(self, fits):
        """The motions that are asked for, each fitted once."""
        new = {fit.key: fit for fit in fits if fit.key not in self._fitted}
        motions = self.windows.found(list(new.values()))
        for (key, fit), motion in zip(new.items(), motions, strict=True):
            self._fitted[key] = fit, motion
        return [self._fitted[fit.key][1] for fit in fits]

    @property
    def noise(self):
        """What the over-segments leave, in pixels of a video 640 pixels wide."""
        return self.scale / SCALE_OF_NOISE * self.windows.pixels

    def over_longer_windows(self):
        """The same search over longer windows, with its camera and noise to begin with.

        Links do not depend on windows, and those that are summed are shared.

        Returns
        -------
        RigidSearch or None
            None where there are no longer ones.
        """
        windows = self.windows.longer()
        if windows is None:
            return None
        other = copy(self)
        other.windows = windows
        other._fitted, other.apart, other._distances_by_own = {}, {}, {}
        return other

    def restart(self, labels):
        """Forget focal length and motions, and choose them by other groups."""
        self._fitted = {}
        self.calibrate(labels)

    def calibrate(self, labels, steps=(), motions=None):
        """Choose focal length and scale of the noise by the larger groups of labels.

        Of focal lengths that explain them nearly as well, the one nearest to that of a
        usual camera: by chance one is better here and another there. One that was given
        stays.

        Parameters
        ----------
        labels : ndarray of int, shape (n,)
        steps : sequence of float
            Factors by which the best of a few focal lengths is improved.
        motions : list of RigidMotion, optional
            Of all groups, by the focal length that is in use. Those by another are
            fitted from the ones by the nearest, which costs less than anew and leaves
            less to chance: that a fit is at another optimum.

        Returns
        -------
        bool
            Whether the focal length is another than before. If not, the scale stays,
            too, and with it all that was fitted.
        """
        before = self.windows.focal_length, self.scale
        groups = groups_of(labels)
        larger = sorted(range(len(groups)), key=lambda k: len(groups[k]))[-4:]
        groups = [groups[k] for k in larger]
        fitted = {} if motions is None else {before[0]: [motions[k] for k in larger]}
        nats: dict[float, float] = {}

        def cost(focal_length):
            if focal_length not in nats:
                starts: list[tuple] = [()] * len(groups)
                if motions is not None:
                    nearest = min(fitted, key=partial(_log_ratio, focal_length))
                    ratio = nearest / focal_length
                    starts = [(m.refocused(ratio),) for m in fitted[nearest]]
                new = self._by_focal_length(focal_length, groups, starts)
                nats[focal_length], fitted[focal_length] = new
            return nats[focal_length]

        best = self.focal_length or best_focal_length(cost, steps)
        if self._fitted and best == before[0]:
            self.windows.set_focal_length(best)
            self.scale = before[1]
            return False
        cost(best)  # if it was given, it is the only one
        self.windows.set_focal_length(best)
        self._begin_with(groups, fitted[best])
        return True

    def _begin_with(self, groups, motions):
        """Take the scale of the noise from some motions, and forget all others."""
        own = [
            self.windows.deviations(*each)[0]
            for each in zip(motions, groups, strict=True)
        ]
        noise = float(np.median(np.concatenate(own)))
        self.scale = max(self.windows.least_noise, SCALE_OF_NOISE * noise)
        fits = [FitRequest(group) for group in groups]
        self._fitted = {
            fit.key: (fit, motion) for fit, motion in zip(fits, motions, strict=True)
        }
        self.apart, self._distances_by_own = {}, {}

    def _by_focal_length(self, focal_length, groups, starts):
        """Nats of some groups with a focal length, and their motions from starts."""
        self.windows.set_focal_length(focal_length)
        self.scale = self.windows.least_noise
        motions = self.windows.found(list(map(FitRequest, groups, starts)))
        costs = self.costs(motions)
        total = sum(costs[group, k].sum() for k, group in enumerate(groups))
        unusual = _log_ratio(focal_length, USUAL_FOCAL_LENGTH)
        total += NATS_OF_FOCAL_LENGTH * sum(map(len, groups)) * unusual
        return total, motions

    def costs(self, motions):
        """Nats (n, M) of each track by each motion."""
        freedom = self.windows.freedom
        most = MOST_NATS * freedom
        costs = []
        for motion in motions:
            squares = self.windows.relative_squares(motion)
            ratio = squares / (FREEDOM * self.scale**2)
            nats = (FREEDOM + freedom) / 2 * np.log1p(ratio)
            nats = np.where(np.isnan(nats), most, np.minimum(nats, most))
            costs.append(np.where(freedom > 0, nats, 0).sum(axis=1))
        return np.stack(costs, axis=1)

    def motions(self, labels):
        """Search for rigid motions of the groups of a partition."""
        return (yield [FitRequest(group) for group in groups_of(labels)])

    def energy(self, labels, motions):
        """Nats of a partition: of its tracks, links to other motions, and labels."""
        cut, nats = self.terms(labels, motions)
        return _energy(labels, cut, nats)

    def terms(self, labels, motions):
        """Share of the links that a partition cuts, and nats, both per track."""
        linked = self._linked(labels, len(motions))
        return _terms(labels, self.costs(motions), linked)

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
        Step
            Of as many groups; which of them are least apart is left open.
        """
        if motions is None:
            motions = yield from self.motions(labels)
        costs, linked = self.costs(motions), self._linked(labels, len(motions))
        best = _step(labels, motions, costs, linked)
        for _ in range(rounds):
            new, linked = self._assigned(costs, labels, linked)
            if np.bincount(new, minlength=len(motions)).min() < FEWEST_TRACKS:
                break
            motions = yield from self._refitted(new, motions)
            costs = self.costs(motions)
            best = min(best, _step(new, motions, costs, linked), key=_energy_of)
            if np.array_equal(new, labels):
                break
            labels = new
        return best

    def least_apart(self, labels, motions):
        """The two groups that are least apart, and their :class:`Apartness`.

        A joint motion is fitted to two groups only where neither's own motion shows
        that they are one: at first to the few that are least apart by these, and to all
        where none of those is one, by their distance or by their log odds.

        Returns
        -------
        (i, j), Apartness
            ``j < i``. With the least log odds of any two that were compared.
        """
        groups = groups_of(labels)
        pairs = [
            _Pair(i, j, (groups[i], groups[j]), (motions[i], motions[j]))
            for i in range(len(groups))
            for j in range(i)
        ]
        pairs.sort(key=self._distance_by_own)
        some = pairs[:JOINTLY_FITTED]
        if self._distance_by_own(pairs[0]) < 0:
            some = pairs[:1]
        apart = yield from self._apartnesses(some)
        if min(map(_distance, apart)) > 0 or min(map(_log_odds, apart)) > 0:
            some, apart = pairs, (yield from self._apartnesses(pairs))
        k = min(range(len(some)), key=lambda k: apart[k].distance)
        least = apart[k]._replace(log_odds=min(map(_log_odds, apart)))
        return (some[k].i, some[k].j), least

    def descent(self, labels, fewest):
        """Merge the two groups that are least apart, again and again.

        Parameters
        ----------
        labels : ndarray of int, shape (n,)
        fewest : int
            Groups that are left in the end.

        Returns
        -------
        list of Step
            One per number of groups, the most first.
        """
        step = yield from self.settled(labels, rounds=1)
        steps = []
        while step.n_motions > fewest:
            (i, j), least = yield from self.least_apart(step.labels, step.motions)
            steps.append(_with_odds_of(step, i, j, least))
            motions = [*step.motions]
            motions[j] = least.joint
            del motions[i]
            labels = np.where(step.labels == i, j, step.labels)
            labels = labels - (labels > i)
            step = yield from self.settled(labels, motions, 1)
        return [*steps, step]

    def unexplained(self, labels, motions):
        """Yield partitions with a group of linked tracks that no motion explains.

        Parameters
        ----------
        labels : ndarray of int, shape (n,)
        motions : list of RigidMotion

        Yields
        ------
        ndarray of int, shape (n,)
        """
        lost = np.zeros(len(labels), dtype=bool)
        for group, motion in zip(groups_of(labels), motions, strict=True):
            deviations, freedom = self.windows.deviations(motion, group)
            lost[group] = (freedom > 0) & (deviations > INLIER_SCALES * self.scale)
        lost = np.flatnonzero(lost)
        links = self.simplest[lost][:, lost]
        _, components = connected_components(links, directed=False)
        sizes = np.bincount(components, minlength=1)
        for component in np.argsort(-sizes, kind="stable")[:MOST_UNEXPLAINED]:
            if sizes[component] >= FEWEST_TRACKS:
                new = labels.copy()
                new[lost[components == component]] = labels.max() + 1
                if np.bincount(new).min() >= FEWEST_TRACKS:
                    yield new

    def _assigned(self, costs, labels, linked, sweeps=6):
        """Labels of least energy, and the share of links that go to each group.

        Links to others of the label are worth something, and so is that it is the
        label of many: what fits a small motion and a large one is rather of the large.
        """
        for _ in range(sweeps):
            told = NATS_OF_LABELS * _nats_of_labels(labels, costs.shape[1])
            new = (costs - NATS_OF_LINKS * linked + told).argmin(axis=1)
            if np.array_equal(new, labels):
                break
            labels, linked = new, self._linked(new, costs.shape[1])
        return labels, linked

    def _linked(self, labels, n_groups):
        """The share of each track's links that go to each group: (n, M)."""
        X = indicator(labels)
        links = self.affinity @ np.pad(X, ((0, 0), (0, n_groups - X.shape[1])))
        degrees = self.degrees[:, None]
        return np.divide(links, degrees, out=np.zeros_like(links), where=degrees > 0)

    def _refitted(self, labels, motions):
        """Motions of groups, fitted again to their inliers where these are others.

        A motion that explains less than half of its group comes from other tracks, and
        refining it may lead nowhere: it is also fitted from the start.
        """
        members = groups_of(labels)
        groups = [self._inliers(*each) for each in zip(members, motions, strict=True)]
        changed = [
            k
            for k, (group, motion) in enumerate(zip(groups, motions, strict=True))
            if not np.array_equal(group, motion.tracks)
        ]
        strange = [k for k in changed if self._strange(members[k], motions[k])]
        requests = [FitRequest(groups[k], (motions[k],)) for k in changed]
        requests += [FitRequest(members[k]) for k in strange]
        motions = [*motions]
        for k, motion in zip(changed + strange, (yield requests), strict=True):
            old, new = self.costs([motions[k], motion])[members[k]].sum(axis=0)
            if k not in strange or new < old:
                motions[k] = motion
        return motions

    def _strange(self, group, motion):
        """Whether a motion explains less than half of a group."""
        return 2 * len(self._explained(group, motion)) < len(group)

    def _inliers(self, group, motion):
        """The tracks of a group that its motion explains; at least half of them."""
        deviations, freedom = self.windows.deviations(motion, group)
        deviations = np.where(freedom > 0, deviations, np.inf)
        limit = max(np.median(deviations), INLIER_SCALES * self.scale)
        kept = group[deviations <= limit]
        return kept if len(kept) >= FEWEST_TRACKS else group

    def _distance_by_own(self, pair):
        """The distance of two groups if one of their motions is the joint.

        Where it places them is left open: this is to tell whom to compare, and is asked
        of all pairs.
        """
        key = pair.key
        if key not in self._distances_by_own:
            gain, _ = self._gain(pair.groups, pair.motions, pair.motions)
            self._distances_by_own[key] = self._merging_distance(pair.groups, gain)
        return self._distances_by_own[key]

    def _apartnesses(self, pairs):
        """The :class:`Apartness` of pairs of groups, each computed once."""
        new = [pair for pair in pairs if pair.key not in self.apart]
        found = yield from side_by_side(map(self._compared, new))
        self.apart.update(zip((pair.key for pair in new), found, strict=True))
        return [self.apart[pair.key] for pair in pairs]

    def _compared(self, pair):
        """The :class:`Apartness` of two groups, all motions fitted to more tracks."""
        if self._distance_by_own(pair) <= SURELY_ONE:
            return self._apartness_by(pair, pair.motions, told=False)
        own = yield [
            FitRequest(group, (motion,), MOST_COMPARED)
            for group, motion in zip(pair.groups, pair.motions, strict=True)
        ]
        pair = pair._replace(motions=tuple(own))
        both = np.union1d(*pair.groups)
        joint = yield [FitRequest(both, pair.motions, MOST_COMPARED)]
        best = self._apartness_by(pair, [*own, *joint])
        if best.log_odds > 0 or best.distance > 0:
            anew = yield [FitRequest(both, most_tracks=MOST_COMPARED)]
            best = self._apartness_by(pair, [*own, *joint, *anew])
        return best

    def _apartness_by(self, pair, joints, told=True):
        """The :class:`Apartness` of two groups for the best of some joint motions."""
        gain, joint = self._gain(pair.groups, pair.motions, joints)
        explained = list(map(self._explained, pair.groups, pair.motions))
        links = self._links(*map(_telling, explained, pair.groups))
        far = infinitely_far(*self._placed(explained, joint)) if told else 0.0
        cross = self._cross(pair)
        weights = GAIN_WEIGHT, LINK_WEIGHT, FAR_WEIGHT, CROSS_WEIGHT
        size = min(map(len, pair.groups))
        known = evidence(size, gain, links, far, cross)
        log_odds = np.dot(weights, known) + PRIOR
        distance = self._merging_distance(pair.groups, gain, far)
        if self._at_other_times(*pair.groups):
            log_odds = distance  # by links alone: that one motion explains both is idle
        return Apartness(
            float(log_odds),
            distance,
            joint,
            size,
            float(gain),
            links,
            far,
            cross,
        )

    def _merging_distance(self, groups, gain, far=0.0):
        """The distance of two groups, by which they are merged."""
        few = _fewness(self._links(*groups), FEWEST_MERGING_LINKS)
        known = min(gain, MOST_GAIN), few, far
        return float(np.dot(MERGING_WEIGHTS, known) + MERGING_PRIOR)

    def _placed(self, inliers, joint):
        """Inverse depths of the inliers of two groups by a joint motion, and errors."""
        found = self.windows.inverse_depths(joint, np.concatenate(inliers))
        depths, errors = (np.split(each, [len(inliers[0])]) for each in found)
        return depths, [error * self.scale for error in errors]

    def _at_other_times(self, first, second):
        """Whether each of two groups is seen in some frame, but both in none.

        By enough tracks that their windows tell something of: a group that has as many
        in no frame has no motion that could be another.
        """
        one, other = self._shown(first), self._shown(second)
        return bool(one.any() and other.any() and not (one & other).any())

    def _shown(self, group):
        """Frames (W, L) of windows in which enough tracks of a group are seen."""
        told = self.windows.freedom[group].T > 0
        seen = self.windows.seen[:, group] & told[..., None]
        return np.count_nonzero(seen, axis=1) >= FEWEST_TRACKS

    def _explained(self, group, motion):
        """The tracks of a group that its motion explains."""
        deviations, freedom = self.windows.deviations(motion, group)
        return group[(freedom > 0) & (deviations <= INLIER_SCALES * self.scale)]

    def _links(self, first, second):
        """The links between two groups over those that chance would give."""
        one, other = self._links_from(first), self._links_from(second)
        chance = one.sum() * other.sum()
        return float(one[second].sum() * self._total / chance) if chance > 0 else 0.0

    def _links_from(self, group):
        """The links of each track to those of a group, summed once."""
        key = group.tobytes()
        if key not in self._links_to:
            inside = np.zeros(len(self.degrees))
            inside[group] = 1
            self._links_to[key] = self.simplest @ inside
        return self._links_to[key]

    def _cross(self, pair):
        """How much worse the motion of either group explains the other than its own.

        A joint motion of two that move apart is often found, if they are small or seen
        for a short time; but it is neither's own. The log of the ratio of squared
        deviations, as in nats of tracks, per track that both motions say something of,
        at most MOST_CROSS; of the two groups, where it is less.
        """
        swapped = zip(pair.groups, pair.motions, pair.motions[::-1], strict=True)
        return min(self._worse(*each) for each in swapped)

    def _worse(self, group, own, other):
        """By how many nats per track another motion explains a group worse."""
        (apart, known), (across, also) = (
            self.windows.deviations(motion, group) for motion in (own, other)
        )
        both = (known > 0) & (also > 0)
        nats = [np.log1p((each[both] / self.scale) ** 2) for each in (across, apart)]
        worse = np.clip(nats[0] - nats[1], 0, MOST_CROSS)
        return float(worse.mean()) if both.any() else 0.0

    def _gain(self, groups, own, joints):
        """How much worse the best of some motions is for two groups than their own.

        The log of the ratio of squared deviations, summed over the tracks, per track of
        the smaller group; and that motion.
        """
        windows, alike = self.windows, (ALIKE / self.windows.pixels) ** 2
        totals = np.zeros(len(joints))
        for group, motion in zip(groups, own, strict=True):
            apart, known = windows.deviations(motion, group, relative=False)
            apart = (apart * windows.shrinkage(motion, group)) ** 2 + alike
            for k, joint in enumerate(joints):
                together, also = windows.deviations(joint, group, relative=False)
                ratio = (together**2 + alike) / apart
                totals[k] += np.log(ratio[(known > 0) & (also > 0)]).sum()
        k = int(totals.argmin())
        return totals[k] / min(map(len, groups)), joints[k]


def evidence(size, gain, links, far, cross):
    """What says that two groups are different motions: what :class:`Apartness` has.

    Returns
    -------
    ndarray of shape (4,)
        The logarithm of one plus the gain, times that of the size; minus the logarithm
        of the links; the square root of how clearly one of the groups is at infinity;
        and how much worse either's motion explains the other. Log odds are a sum of
        these, each with its weight.
    """
    gained = np.log(size) * np.log1p(max(gain, 0.0))
    apart = _fewness(links, FEWEST_LINKS)
    return np.array([gained, apart, np.sqrt(far), cross])


def _fewness(links, fewest):
    """Minus the logarithm of links over chance, not told apart near none and above it.

    More than by chance say no more: two small motions of which some tracks are linked
    have many times as many, halves of a large one hardly twice as many.
    """
    return -np.log(min(links, 1.0) + fewest)


def _telling(explained, group):
    """The tracks of a group whose links say something: outliers link anything."""
    return explained if len(explained) >= FEWEST_TRACKS else group


def _links_of(affinity):
    """An affinity without its diagonal, as a sparse matrix."""
    return csr_array(affinity - np.diag(np.diagonal(affinity)))


def _step(labels, motions, costs, linked):
    cut, nats = _terms(labels, costs, linked)
    return Step(_energy(labels, cut, nats), labels, motions)


def _energy(labels, cut, nats):
    """Nats of a partition, of which its tracks cost so many, and cut so much.

    Tracks of no motion are many where there are outliers, and what parts them saves
    more than what parts two small motions. But labels that part many tracks tell more.
    """
    told = _nats_of_labels(labels, labels.max() + 1)[labels].mean()
    return len(labels) * (nats + NATS_OF_LINKS * cut + NATS_OF_LABELS * float(told))


def _log_ratio(one, other):
    """How far two focal lengths are from each other: 0 if they are the same."""
    return abs(np.log(one / other))


def _energy_of(step):
    return step.energy


def _terms(labels, costs, linked):
    tracks = np.arange(len(labels))
    cut = 1 - float(linked[tracks, labels].mean())
    return cut, float(costs[tracks, labels].mean())


class RigidPartitions(NamedTuple):
    """Partitions by rigid motion, and the number of motions.

    Attributes
    ----------
    steps : dict of int to Step
        The best partition for each number of motions that was met. The log odds of
        those that were searched as if their number had been given are by longer windows
        where there are some.
    chosen : int
        The number of motions.
    """

    steps: dict[int, Step]
    chosen: int


def rigid_partitions(search, over_segments, counts, candidates, bisect, finer=None):
    """Partitions of least energy, and how many motions there are.

    The number of motions is the largest of which a partition is found whose motions
    are all likelier different than one, by longer windows where there are some; its
    partition is the best of so many that are met, as if the number had been given. So
    are those of the numbers next to it.

    Parameters
    ----------
    search : RigidSearch
    over_segments : list of ndarray of int, shape (n,)
        Partitions to merge.
    counts : ndarray of int, shape (n_counts,)
        Numbers of motions that may be.
    candidates : callable
        ``n_motions -> iterable of labels (n,)``: more partitions to start from.
    bisect : callable
        Takes the positions of a group to booleans, or to None if it cannot be parted.
    finer : callable, optional
        ``n_groups -> list of labels (n,)``: over-segments, perhaps fewer groups.

    Returns
    -------
    RigidPartitions or None
        None where no partition has as many motions as there must be.
    """
    fewest, most = int(counts[0]), int(counts[-1])
    bisect = _once_per_group(bisect)
    search.calibrate(over_segments[0])
    if finer is not None:
        over_segments = _fine_enough(search, over_segments, most, finer)
    paths = calibrated_paths(search, over_segments)
    steps: dict[int, Step] = {}
    for step in (step for path in paths for step in path):
        n = step.n_motions
        if fewest <= n <= most and (n not in steps or step.energy < steps[n].energy):
            steps[n] = step

    def best_into(n_motions, *others):
        starts = _of_number(search, n_motions, paths, candidates, bisect)
        (best,) = search.run(_best_improved(search, starts, bisect, others))
        is_open = best is not None and fewest < most
        return _judged_by_longer_windows(search, best) if is_open else best

    chosen = max(_n_apart(path, fewest, most) for path in paths)
    while True:
        found = best_into(chosen)
        if found is None:
            return None
        steps[chosen] = found
        if chosen == fewest or found.log_odds > 0:
            break
        chosen -= 1
    tried = chosen
    while tried < min(chosen + LOOKAHEAD, most):
        (grown,) = search.run(_split_best(search, steps[tried], bisect))
        if grown is None or grown.log_odds < HOPELESS:
            break
        tried += 1
        steps[tried] = found = best_into(tried, grown)
        if found.log_odds > 0:
            chosen = tried
        elif found.log_odds < HOPELESS:
            break
    return RigidPartitions(steps, chosen)


def _fine_enough(search, over_segments, most, finer):
    """Over-segments that mix no motions, and the search calibrated by them."""
    while search.noise > ROUGH:
        noise, n_groups = search.noise, int(over_segments[0].max()) + 1
        more = finer(2 * n_groups) if n_groups < most else []
        if not more or more[0].max() < n_groups:
            break
        search.restart(more[0])
        if search.noise > LESS_ROUGH * noise:
            search.restart(over_segments[0])
            break
        over_segments = more
    return over_segments


def calibrated_paths(search, over_segments):
    """Descents from over-segments to one group, seen by a calibrated camera.

    Over-segments are small and nearly flat, so they tell little of the focal length;
    with a wrong one, a scene is not quite one rigid motion, and is torn where it is
    large. So it is looked at again when the first of them are merged, and if it has
    changed, they are merged once more.

    Parameters
    ----------
    search : RigidSearch
        Calibrated by the first of them.
    over_segments : list of ndarray of int, shape (n,)

    Returns
    -------
    list of list of Step
    """
    first, *others = over_segments
    (path,) = _descents(search, [first])
    last = _last_apart(path)
    if search.calibrate(last.labels, FOCAL_STEPS[:2], last.motions):
        return _descents(search, over_segments)
    return [path, *_descents(search, others)]


def _descents(search, over_segments):
    return search.run(*(search.descent(some, 1) for some in over_segments))


def _last_apart(path):
    """The step of a path with the most groups that are all apart; else its last.

    By their distance, which rather leaves a motion in parts than mixes two.
    """
    return next((step for step in path if step.distance > 0), path[-1])


def rank(step):
    """What a partition costs when partitions into as many are compared: nats per track.

    One motion is not likely to explain two that are true, as it explains halves of a
    background, whatever these save.
    """
    odds = min(max(step.log_odds, -SURE), SURE)
    return step.energy / len(step.labels) - NATS_OF_ODDS * odds


def _nats_of_labels(labels, n_groups):
    """Nats (M,) that each label tells, given the sizes of the groups."""
    sizes = np.maximum(np.bincount(labels, minlength=n_groups), 1)
    return np.log(len(labels) / sizes)


def _n_apart(path, fewest, most):
    """The largest number of groups on a path that are all apart."""
    apart = (step.n_motions for step in path if step.log_odds > 0)
    return max((n for n in apart if fewest <= n <= most), default=fewest)


def _once_per_group(bisect):
    """The same function, remembering what it returned."""
    known = {}

    def remembered(group):
        key = group.tobytes()
        if key not in known:
            known[key] = bisect(group)
        return known[key]

    return remembered


def _of_number(search, n_motions, paths, candidates, bisect):
    """Searches for partitions into so many motions, from several starts."""
    settled = [
        search.settled(step.labels, step.motions, ROUNDS)
        for path in paths
        for step in path
        if step.n_motions == n_motions
    ]
    settled += [search.settled(some, rounds=ROUNDS) for some in candidates(n_motions)]
    searches = [_step_of(search, each, lambda n: n == n_motions) for each in settled]
    return searches + [
        _apart_and_split(search, path, n_motions, bisect) for path in paths
    ]


def _best_improved(search, searches, bisect, others=()):
    """The best of some steps and those that are found, improved."""
    best = yield from _best(searches, others)
    return None if best is None else (yield from _improved(search, best, bisect))


def _best(searches, others=()):
    """The best of some steps and those that are found; None if there are none."""
    found = yield from side_by_side(searches)
    steps = [*others, *(each for each in found if each is not None)]
    return min(steps, key=rank, default=None)


def _step_of(search, settled, accepted):
    """The step of a partition that is settled, if its number of motions is accepted."""
    step = yield from settled
    return (yield from with_odds(search, step)) if accepted(step.n_motions) else None


def _apart_and_split(search, path, n_motions, bisect):
    """The last groups of a path that are all apart, split to as many as are wanted."""
    apart = [step for step in path if step.log_odds > 0 and step.n_motions < n_motions]
    step = apart[0] if apart else None
    while step is not None and step.n_motions < n_motions:
        step = yield from _split_best(search, step, bisect)
    return step


def _improved(search, best, bisect):
    """A better partition: a group is split, and two others merged."""
    for _ in range(MOST_CHANGES):
        changed = _splits(search, best, bisect)
        better = yield from _best(_merged(search, some, best) for some in changed)
        if better is None or not rank(better) < rank(best):
            break
        best = better
    return best


def _merged(search, labels, best):
    """The step at the end of a descent to as many motions, if it may be better."""
    step = (yield from search.descent(labels, best.n_motions))[-1]
    if step.n_motions == best.n_motions and rank(step) < rank(best):
        return (yield from with_odds(search, step))
    return None


def _split_best(search, step, bisect):
    """The best partition with one group more; None if none can be parted."""
    return _best(
        _step_of(search, search.settled(some), lambda n: n > step.n_motions)
        for some in _splits(search, step, bisect)
    )


def _splits(search, step, bisect):
    """Partitions with one group more: halves of the graph, and what is unexplained."""
    yield from split(step.labels, bisect)
    yield from search.unexplained(step.labels, step.motions)


def _judged_by_longer_windows(search, step):
    """A step with the two groups that are least apart, and log odds, by longer windows.

    With its own motions, and as it is where there are no such windows.
    """
    judge = search.over_longer_windows() if step.n_motions > 1 else None
    if judge is None:
        return step
    (judged,) = judge.run(_judged(judge, step))
    return judged


def _judged(judge, step):
    """Search for what other windows say of a step; itself where they do not tell.

    The focal length is chosen once more: where it is wrong, what turns is torn, the
    more the longer it is watched.
    """
    motions = yield from judge.motions(step.labels)
    if not _all_known(step.labels, motions):
        return step
    if judge.calibrate(step.labels, FOCAL_STEPS[:2], motions):
        motions = yield from judge.motions(step.labels)
    (i, j), least = yield from judge.least_apart(step.labels, motions)
    return _with_odds_of(step, i, j, least)


def _all_known(labels, motions):
    """Whether motions say something of most tracks of each group."""
    return all(
        2 * np.count_nonzero(motion.known[group]) > len(group)
        for group, motion in zip(groups_of(labels), motions, strict=True)
    )


def with_odds(search, step):
    """Search for the two groups of a step that are least apart: the step with them."""
    if step.n_motions == 1:
        return step
    (i, j), least = yield from search.least_apart(step.labels, step.motions)
    return _with_odds_of(step, i, j, least)
