"""Partitions of few tracks to start from, by motions that are grown from neighbours.

Of few tracks, most samples mix motions, each is linked to most others, and
over-segments are too small to say which are of one. But the neighbours of nearly each
track can be tried: their motion is fitted again and again to the tracks that it
explains best, ever more of them, and of all that are grown, those are taken by which
the tracks cost least.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ..geometry.windows import FEWEST_TRACKS, FitRequest

# Tracks whose neighbours are tried, at most, each with the nearest and with every other
# of twice as many.
N_SEEDS, NEIGHBOURS = 30, 4
# Tracks that are added in each round of growth.
ADDED, ROUNDS = 2, 3
# Sets of motions that are begun with, and partitions by the best of them.
N_BEGUN, N_STARTS = 10, 4
MOST_SWAPS = 5


class GrownMotions:
    """Motions that are grown from neighbours, once, with the camera that is in use.

    Parameters
    ----------
    search : RigidSearch
        When it is calibrated.
    affinity : ndarray of shape (n, n)
    """

    def __init__(self, search, affinity):
        self._search, self._affinity = search, affinity

    def partitions(self, n_motions):
        """The partitions into so many motions that cost least, each once.

        Returns
        -------
        list of ndarray of int, shape (n,)
            None of fewer tracks per motion than one needs.
        """
        found: dict[bytes, np.ndarray] = {}
        for chosen in _cheapest_sets(self._costs, n_motions):
            labels = self._costs[:, chosen].argmin(axis=1)
            if np.bincount(labels, minlength=n_motions).min() >= FEWEST_TRACKS:
                found.setdefault(labels.tobytes(), labels)
        return [*found.values()][:N_STARTS]

    @cached_property
    def _costs(self):
        """Nats (n, n_grown) of each track by each motion."""
        (motions,) = self._search.run(self._grown())
        return self._search.costs(motions)

    def _grown(self):
        """Search for motions of neighbours, and of the tracks that they explain."""
        motions = yield [FitRequest(group) for group in _neighbours(self._affinity)]
        for size in NEIGHBOURS + 1 + ADDED * np.arange(1, ROUNDS + 1):
            order = np.argsort(self._search.costs(motions), axis=0, kind="stable")
            groups = np.sort(order[:size], axis=0).T
            motions = yield [
                FitRequest(group, (motion,))
                for group, motion in zip(groups, motions, strict=True)
            ]
        return motions


def _neighbours(affinity):
    """Groups (n_groups, 1 + NEIGHBOURS) of tracks and of some of their nearest."""
    n = len(affinity)
    seeds = np.unique(np.linspace(0, n - 1, min(n, N_SEEDS)).round().astype(int))
    others = affinity[seeds].astype(float)
    others[np.arange(len(seeds)), seeds] = -np.inf
    nearest = np.argsort(-others, axis=1, kind="stable")[:, : 2 * NEIGHBOURS]
    near, wide = nearest[:, :NEIGHBOURS], nearest[:, 1::2]
    groups = [np.column_stack([seeds, some]) for some in (near, wide)]
    return np.sort(np.concatenate(groups), axis=1)


def _cheapest_sets(costs, n_motions):
    """Sets of motions by which tracks cost least, the cheapest first.

    Each is begun with one that explains many tracks; the one that saves most is added
    until they are so many, and then each is replaced by what saves most.
    """
    first = np.argsort(costs.sum(axis=0), kind="stable")[:N_BEGUN]
    sets = [_swapped(costs, _completed(costs, [k], n_motions)) for k in first]
    return sorted(sets, key=lambda chosen: costs[:, chosen].min(axis=1).sum())


def _completed(costs, chosen, n_motions):
    """A set of motions with those that save most beside it, one after another."""
    while len(chosen) < n_motions:
        chosen = [*chosen, _best_beside(costs, chosen)]
    return chosen


def _swapped(costs, chosen):
    """A set of motions of which none can be replaced by one that saves more."""
    for _ in range(MOST_SWAPS):
        before = [*chosen]
        for place in range(len(chosen)):
            others = chosen[:place] + chosen[place + 1 :]
            chosen[place] = _best_beside(costs, others)
        if chosen == before:
            break
    return chosen


def _best_beside(costs, others):
    """The motion by which tracks cost least beside others."""
    least = costs[:, others].min(axis=1, initial=np.inf)
    return int(np.minimum(costs, least[:, None]).sum(axis=0).argmin())
