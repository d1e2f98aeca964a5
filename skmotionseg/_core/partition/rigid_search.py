"""Partitions by rigid motion over windows: who belongs where, and what is apart.

A motion that is rigid over many frames leaves each track one free number, so tracks of
another motion are off by far more than the noise. Tracks are assigned to the motion
that explains them in all windows, their neighbours in the graph having a say; two
groups that are not different motions (see :mod:`.apartness`) are merged.
"""

from __future__ import annotations

from copy import copy
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from ..geometry.camera import log_ratio
from ..geometry.windows import (
    FEWEST_TRACKS,
    FitRequest,
    best_focal_length,
)
from ..labels import groups_of, indicator
from .apartness import INLIER_SCALES, Comparisons, Links
from .known_motions import KnownMotions, nats_in_windows
from .side_by_side import run, side_by_side

# The scale of residuals, in units of what over-segments leave.
SCALE_OF_NOISE = 2.0
# The median deviation is the noise of a clip, but no more than so many times the lower
# quartile: over it, it is 1.3 to 1.8 in simulated scenes with few outliers, and ten
# where half of the tracks of larger groups are outliers.
MOST_OVER_QUARTILE = 2.5
# Nats per track by which a focal length must explain tracks better, for each unit of
# the log of its ratio to the usual one. On simulated scenes, whose focal lengths are
# within 0.6 and 1.45 by construction, the weight hardly matters: from 0.2 to 1, errors
# are 0.16 to 0.21 on average. With 1, clips of wide cameras stay at the usual one
# whatever they show.
NATS_OF_FOCAL_LENGTH = 0.3
# What it is worth, in nats, that all of a track's links are to its own motion.
NATS_OF_LINKS = 4.0
# Nats that a partition costs for each nat that its labels tell: with this, and with
# what odds are worth where partitions are compared, the best of simulated scenes cost
# least.
NATS_OF_LABELS = 0.5
# Groups of linked tracks that no motion explains, of which new motions are tried.
MOST_UNEXPLAINED = 3


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

    def compared(self, i, j, least):
        """This step, with the two groups that are least apart, and how far they are."""
        return self._replace(
            pair=(j, i), log_odds=least.log_odds, distance=least.distance
        )


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
    comparisons : Comparisons
        Of groups, by the focal length and the scale of the noise that are in use.
    """

    def __init__(self, windows, affinity, simplest=None, focal_length=None):
        self.windows, self.focal_length = windows, focal_length
        self.affinity = _links_of(affinity)
        self.degrees = self.affinity.sum(axis=1)
        self.links = Links(_links_of(affinity if simplest is None else simplest))
        self.scale, self._left = windows.least_noise, 0.0
        self._begin()

    def run(self, *searches):
        """What each of some searches returns, run side by side."""
        return run(side_by_side(searches), self._found)

    def _found(self, fits):
        """The motions that are asked for, each fitted once."""
        new = {fit.key: fit for fit in fits if fit.key not in self._fitted}
        motions = self._known.found(list(new.values()))
        for (key, fit), motion in zip(new.items(), motions, strict=True):
            self._fitted[key] = fit, motion
        return [self._fitted[fit.key][1] for fit in fits]

    @property
    def noise(self):
        """What the over-segments leave, in pixels of a video 640 pixels wide."""
        return self._left * self.windows.pixels

    @cached_property
    def decides(self):
        """Whether no longer windows judge what is found."""
        return self.windows.are_longest

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
        other.windows, other.decides = windows, windows.are_longest
        other._begin()
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
                    nearest = min(fitted, key=partial(log_ratio, focal_length))
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
        own = self.windows.own_deviations(motions, groups)
        self._left, quartile = np.quantile(own, [0.5, 0.25]).tolist()
        noise = min(self._left, MOST_OVER_QUARTILE * quartile)
        self.scale = max(self.windows.least_noise, SCALE_OF_NOISE * noise)
        self._begin(map(FitRequest, groups), motions)

    def _begin(self, fits=(), motions=()):
        """Know nothing but some fits, by the camera and the scale that are in use."""
        self._fitted = {
            fit.key: (fit, motion) for fit, motion in zip(fits, motions, strict=True)
        }
        self._known = KnownMotions(self.windows, self.scale, motions)
        self.comparisons = Comparisons(self.windows, self.links, self.scale)

    def _by_focal_length(self, focal_length, groups, starts):
        """Nats of some groups with a focal length, and their motions from starts."""
        self.windows.set_focal_length(focal_length)
        self.scale = self.windows.least_noise
        motions = self.windows.found(list(map(FitRequest, groups, starts)))
        total = sum(
            nats_in_windows(self.windows, motion, self.scale, group).sum(axis=1).sum()
            for motion, group in zip(motions, groups, strict=True)
        )
        unusual = log_ratio(focal_length)
        total += NATS_OF_FOCAL_LENGTH * sum(map(len, groups)) * unusual
        return total, motions

    def costs(self, motions):
        """Nats (n, M) of each track by each motion."""
        return np.stack(list(map(self._known.nats, motions)), axis=1)

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
        """Assign tracks and fit motions in turn, and keep what costs fewest nats.

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
        motions = list(map(self._known.improved, motions, groups_of(labels)))
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
            (i, j), least = yield from self.comparisons.least_apart(
                step.labels, step.motions
            )
            steps.append(step.compared(i, j, least))
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
        links = self.links.among(lost)
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
        limit = INLIER_SCALES * self.scale
        return 2 * len(self.windows.explained(motion, group, limit)) < len(group)

    def _inliers(self, group, motion):
        """The tracks of a group that its motion explains; at least half of them."""
        deviations, freedom = self.windows.deviations(motion, group)
        deviations = np.where(freedom > 0, deviations, np.inf)
        limit = max(np.median(deviations), INLIER_SCALES * self.scale)
        kept = group[deviations <= limit]
        return kept if len(kept) >= FEWEST_TRACKS else group


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


def _nats_of_labels(labels, n_groups):
    """Nats (M,) that each label tells, given the sizes of the groups."""
    sizes = np.maximum(np.bincount(labels, minlength=n_groups), 1)
    return np.log(len(labels) / sizes)


def _energy_of(step):
    return step.energy


def _terms(labels, costs, linked):
    tracks = np.arange(len(labels))
    cut = 1 - float(linked[tracks, labels].mean())
    return cut, float(costs[tracks, labels].mean())
