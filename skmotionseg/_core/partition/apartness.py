"""Which groups of tracks are different motions, by rigid motion over windows.

Two groups are different motions if one rigid motion explains both much worse than two
do, or has to place one at infinity, if the motion of either does not explain the other,
and if the graph has few links between them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..geometry.joint_depths import infinitely_far
from ..geometry.windows import FEWEST_TRACKS, FitRequest, RigidMotion
from ..labels import groups_of
from .side_by_side import side_by_side

# Log odds of two groups being different motions, for each kind of :func:`evidence`, and
# without any: what the number of motions is told by. By a logistic regression on pairs
# of groups that decide in simulated scenes (``python -m benchmarks.apartness``), before
# fits were kept in front of the camera, and had a term for what is behind.
GAIN_WEIGHT, LINK_WEIGHT, FAR_WEIGHT, CROSS_WEIGHT = 0.72, 1.3, 5.15, 1.36
PRIOR = -8.46
# Tracks at most of a clip that is looked at more closely: they prefer hypotheses that
# were fitted to others, and more numbers of motions are sought. From a hundred on,
# there is hardly a difference in simulated clips. The same evidence says more, the
# fewer they are, as what is gained counts by the size of a group; by the same
# regression.
FEW_TRACKS, FEW_WEIGHT = 100, 1.35
# The same for their distance, by which they are merged: what counts there is which of
# several pairs is one motion rather than whether any is, and links tell that better,
# those of all tracks. By a regression, too, on scenes of rigid bodies and relief.
MERGING_WEIGHTS, MERGING_PRIOR = (1.65, 1.85, 5.0), -7.0
# Links over chance below which fewer say no more: of the odds, and of the distance.
FEWEST_LINKS, FEWEST_MERGING_LINKS = 0.06, 0.01
# What is added to the odds where the joint motion places a group at infinity that rests
# in the image while the other moves: that a camera goes straight on and does not turn
# at all, before something that is all infinitely far, is rarer than that it stands
# still. With this, and without the windows in which both are at infinity, a car that
# drives off late in a clip is found in 75 of 80 simulated clips; without, in 52. Groups
# rest and move by so many scales of the noise.
REST_WEIGHT, AT_REST, MOVES = 4.0, 1.0, 4.0
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


class Pair(NamedTuple):
    """Two groups of a partition, and their motions."""

    i: int
    j: int
    groups: tuple
    motions: tuple

    @property
    def key(self):
        return tuple(group.tobytes() for group in self.groups)


class Links:
    """Links between groups of tracks, over those that chance would give.

    Parameters
    ----------
    affinity : sparse array of shape (n, n)
        Without a diagonal.
    """

    def __init__(self, affinity):
        self._affinity, self._total = affinity, affinity.sum()
        self._to: dict[bytes, np.ndarray] = {}

    def among(self, tracks):
        """The links of some tracks with each other."""
        return self._affinity[tracks][:, tracks]

    def between(self, first, second):
        """The links between two groups over those that chance would give."""
        one, other = self._from(first), self._from(second)
        chance = one.sum() * other.sum()
        return float(one[second].sum() * self._total / chance) if chance > 0 else 0.0

    def _from(self, group):
        """The links of each track to those of a group, summed once."""
        key = group.tobytes()
        if key not in self._to:
            inside = np.zeros(self._affinity.shape[0])
            inside[group] = 1
            self._to[key] = self._affinity @ inside
        return self._to[key]


class Comparisons:
    """Comparisons of groups of tracks, each made once.

    What fits motions is a search as in :mod:`.side_by_side`, which the caller runs.

    Parameters
    ----------
    windows : Windows
        With the focal length that is in use.
    links : Links
    scale : float
        Of residuals.

    Attributes
    ----------
    found : dict of (bytes, bytes) to Apartness
        Of all pairs of groups, by their positions, to which a joint motion was fitted.
    """

    def __init__(self, windows, links, scale):
        self.windows, self.links, self.scale = windows, links, scale
        self.found: dict[tuple, Apartness] = {}
        self._distances_by_own: dict[tuple, float] = {}

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
            Pair(i, j, (groups[i], groups[j]), (motions[i], motions[j]))
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
        new = [pair for pair in pairs if pair.key not in self.found]
        found = yield from side_by_side(map(self._compared, new))
        self.found.update(zip((pair.key for pair in new), found, strict=True))
        return [self.found[pair.key] for pair in pairs]

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
        limit = INLIER_SCALES * self.scale
        explained = [
            self.windows.explained(motion, group, limit)
            for group, motion in zip(pair.groups, pair.motions, strict=True)
        ]
        links = self.links.between(*map(_telling, explained, pair.groups))
        far = infinitely_far(*self._placed(explained, joint)) if told else 0.0
        cross = self._cross(pair)
        weights = GAIN_WEIGHT, LINK_WEIGHT, FAR_WEIGHT, CROSS_WEIGHT, FEW_WEIGHT
        size = min(map(len, pair.groups))
        known = evidence(size, gain, links, far, cross, len(self.windows.points))
        log_odds = np.dot(weights, known) + PRIOR
        if far > 0 and self._one_rests(explained):
            log_odds += REST_WEIGHT * min(far, 1.0)
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

    def _one_rests(self, groups):
        """Whether one of two groups rests in the image, and the other does not."""
        most = [self.windows.wanders(group) / self.scale for group in groups]
        return min(most) <= AT_REST and max(most) >= MOVES

    def _merging_distance(self, groups, gain, far=0.0):
        """The distance of two groups, by which they are merged."""
        few = _fewness(self.links.between(*groups), FEWEST_MERGING_LINKS)
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


def evidence(size, gain, links, far, cross, n_tracks):
    """What says that two groups are different motions: what :class:`Apartness` has.

    Returns
    -------
    ndarray of shape (5,)
        The logarithm of one plus the gain, times that of the size; minus the logarithm
        of the links; the square root of how clearly one of the groups is at infinity;
        how much worse either's motion explains the other; and the logarithm of how many
        times fewer tracks than ``FEW_TRACKS`` there are. Log odds are a sum of these,
        each with its weight.
    """
    gained = np.log(size) * np.log1p(max(gain, 0.0))
    apart = _fewness(links, FEWEST_LINKS)
    few = np.log(FEW_TRACKS / min(n_tracks, FEW_TRACKS))
    return np.array([gained, apart, np.sqrt(far), cross, few])


def _fewness(links, fewest):
    """Minus the logarithm of links over chance, not told apart near none and above it.

    More than by chance say no more: two small motions of which some tracks are linked
    have many times as many, halves of a large one hardly twice as many.
    """
    return -np.log(min(links, 1.0) + fewest)


def _telling(explained, group):
    """The tracks of a group whose links say something: outliers link anything."""
    return explained if len(explained) >= FEWEST_TRACKS else group
