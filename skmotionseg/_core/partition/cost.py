"""What a partition of the tracks costs, in nats per observation.

Geometry and graph judge together. Geometry says what it takes to write down where the
tracks went, a fundamental matrix per motion and frame pair; the graph says how many
preferences for the same hypotheses are cut.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..geometry.description_length import description_lengths
from ..geometry.epipolar import cheapest_rank_two, nearest_rank_two
from ..graph.cuts import cuts_between, normalized_cut
from ..labels import groups_of

# What a normalised cut of 1 is worth, in nats per observation. Halved, the error with
# the number of motions known rises on KT3DMoSeg from 3.1 to 3.9 %; doubled, the number
# is right in 55 % of its clips, not 73 (``python -m benchmarks.sensitivity``).
CUT_WEIGHT = 0.3
# The terms of a cost, and their weights in the total.
COST_NAMES = ("normalised cut", "description length per observation")
COST_WEIGHTS = (CUT_WEIGHT, 1.0)
# Two motions must save so many times the cut between them, in nats per observation of
# the smaller, against being one: a large group that is torn in two saves little per
# track, a small thing that moves by itself saves much. It pulls both ways: halved, the
# number is right in one of the four Hopkins12 sequences, and doubled in 55 % of the
# KT3DMoSeg clips; 9 to 11 differ by a sequence each.
GAIN_OF_CUT = 10.0
# The same where tracks are stratified by over-segments of the video: a small thing has
# more of them than its neighbourhood then, and more of its links are cut. From two
# videos, and scenes of one motion, which stay one.
GAIN_OF_CUT_DRAWN = 3.0


class GroupLengths:
    """Description lengths of groups of tracks, each computed once.

    Parameters
    ----------
    geometry : ClipGeometry
    lower_rank : callable
        As for :func:`~skmotionseg._core.geometry.epipolar.robust_fits`.
    """

    def __init__(self, geometry, lower_rank=nearest_rank_two):
        self.geometry = geometry
        self.lower_rank = lower_rank
        self._known = {}

    def __call__(self, members):
        """The :class:`DescriptionLength` of a group, given as sorted positions."""
        key = members.tobytes()
        if key not in self._known:
            self.know([members])
        return self._known[key]

    def know(self, groups):
        """Compute what is not known of some groups, in common batches."""
        new = {
            key: group
            for group in groups
            if (key := group.tobytes()) not in self._known
        }
        found = description_lengths(self.geometry, list(new.values()), self.lower_rank)
        self._known.update(zip(new, found, strict=True))

    def of_partition(self, labels):
        """Nats an observation to describe all groups of a partition."""
        total = sum(self(group).total for group in groups_of(labels))
        return total / self.geometry.n_observations

    def gain(self, first, second):
        """Nats an observation of the smaller group that two save by being apart.

        In the frame pairs in which each has a model of its own; 0 if there is none, and
        infinite if no pair sees both: nothing says then that they are one.
        """
        seen = self.geometry.seen
        if not (seen[:, first].any(axis=1) & seen[:, second].any(axis=1)).any():
            return np.inf
        apart = self(first), self(second)
        both = apart[0].modelled & apart[1].modelled
        if not both.any():
            return 0.0
        together = self(np.union1d(first, second))
        rise = together.tracks - apart[0].tracks - apart[1].tracks
        n_fewer = min(seen[both][:, first].sum(), seen[both][:, second].sum())
        return rise[both].sum() / n_fewer


class Cost(NamedTuple):
    """Normalised cut (summed over views), nats per observation, and their total."""

    cut: float
    length: float
    total: float


class Judge:
    """Costs of partitions, and whether their motions are worth their number.

    Two description lengths are averaged, for neither is the better one everywhere: by
    the cheapest correction to rank two, a group is described as well as it can be; by
    the nearest matrix, a group whose tracks leave its geometry open, such as two cars
    taken for one, is described worse. Two motions may be apart if either says so.

    Parameters
    ----------
    geometry : ClipGeometry
    views : ndarray of shape (n_views, n, n)
        Sparse affinities, on which partitions are cut.
    stratified : bool, default=False
        Whether the tracks are as many from each over-segment of the video.
    """

    def __init__(self, geometry, views, stratified=False):
        self.geometry = geometry
        self.views = views
        self.stratified = stratified
        self.lengths = [
            GroupLengths(geometry, lower_rank)
            for lower_rank in (nearest_rank_two, cheapest_rank_two)
        ]

    def cost(self, labels):
        """The :class:`Cost` of a partition, ``0..M - 1``, none empty."""
        cut = sum(normalized_cut(view, labels) for view in self.views)
        length = float(np.mean([each.of_partition(labels) for each in self.lengths]))
        return Cost(cut, length, CUT_WEIGHT * cut + length)

    def costs(self, partitions):
        """Yield each partition with its cost, the groups of all fitted together."""
        groups = [group for labels in partitions for group in groups_of(labels)]
        for each in self.lengths:
            each.know(groups)
        for labels in partitions:
            yield labels, self.cost(labels)

    def each_gains(self, labels):
        """Whether each two motions save enough by not being one.

        Parameters
        ----------
        labels : ndarray of int, shape (n,)
            ``0..M - 1``, none empty.

        Returns
        -------
        bool
        """
        return self.gainless_pair(labels) is None

    def gainless_pair(self, labels):
        """Two motions that save too little by not being one, or None.

        Parameters
        ----------
        labels : ndarray of int, shape (n,)
            ``0..M - 1``, none empty.

        Returns
        -------
        (int, int) or None
            The first such pair, the smaller label first.
        """
        groups = groups_of(labels)
        times = GAIN_OF_CUT_DRAWN if self.stratified else GAIN_OF_CUT
        least = times * sum(cuts_between(view, labels) for view in self.views)
        for i in range(len(groups)):
            for j in range(i):
                gains = (each.gain(groups[i], groups[j]) for each in self.lengths)
                if not any(gain >= least[i, j] for gain in gains):
                    return j, i
        return None
