"""Partitions of the tracks of two images, as a search over partitions hands them on."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..geometry.description_length import WorkingFrames
from ..geometry.two_views import TwoViewMotions, two_views
from ..labels import canonical_labels
from .cost import Cost
from .motions import Motions
from .two_view_energy import log_shares
from .two_view_search import MOST_MOTIONS, search_two_views
from .two_view_surfaces import Surfaces, with_fewer_motions

# The terms of a cost.
TWO_VIEW_COST_NAMES = ("nats of labels and motions per track", "nats of places")
# Nats that count as evidence against one: tails, neighbours and noise are not quite as
# they are taken to be, and what was searched for is found more often than by chance.
# On simulated pairs of images, probabilities are about as often right as they say.
TEMPERATURE = 8.0


class ByDensity:
    """What places and rejects tracks by log densities of motions and of mismatches."""

    def nearest(self, points, visibility, labels):
        """Labels of the most probable motions, where enough is known of the track.

        Parameters
        ----------
        points : ndarray of shape (n, n_frames, 2)
        visibility : ndarray of bool, shape (n, n_frames)
        labels : ndarray of int, shape (n,)

        Returns
        -------
        ndarray of int, shape (n,)
        """
        known, logarithms, motion_of = self._log_probabilities(points, visibility)
        labels = labels.copy()
        labels[known] = motion_of[logarithms[:-1].argmax(axis=0)]
        return labels

    def reject(self, points, visibility, labels):
        """Labels with -1 for the tracks that are more likely to be mismatches.

        Parameters
        ----------
        points : ndarray of shape (n, n_frames, 2)
        visibility : ndarray of bool, shape (n, n_frames)
        labels : ndarray of int, shape (n,)

        Returns
        -------
        ndarray of int, shape (n,)
        """
        known, logarithms, _ = self._log_probabilities(points, visibility)
        mismatched = logarithms[-1] > logarithms[:-1].max(axis=0)
        labels = labels.copy()
        labels[np.flatnonzero(known)[mismatched]] = -1
        return labels

    def _log_probabilities(self, points, visibility):
        """Tracks that something is known of, and log probabilities of these.

        Parameters
        ----------
        points : ndarray of shape (n, n_frames, 2)
        visibility : ndarray of bool, shape (n, n_frames)

        Returns
        -------
        known : ndarray of bool, shape (n,)
        logarithms : ndarray of shape (S + 1, n_known)
            The last row is of mismatches.
        motion_of : ndarray of int, shape (S,)
            The motion of each other row.
        """
        raise NotImplementedError


@dataclass(frozen=True)
class TwoViewExplanation(ByDensity):
    """The motions of two images, which place and reject tracks by their densities.

    Attributes
    ----------
    frames : WorkingFrames
        Of one frame pair.
    side : float
        As of :class:`TwoViews`.
    found : TwoViewMotions
        Of S surfaces.
    log_shares : ndarray of shape (S + 1,)
        Logarithms of the shares of the tracks; the last is that of mismatches.
    motion_of : ndarray of int, shape (S,)
        The motion of each surface.
    """

    frames: WorkingFrames
    side: float
    found: TwoViewMotions
    log_shares: np.ndarray
    motion_of: np.ndarray

    @property
    def motions(self):
        """The motions as fundamental matrices and noise."""
        _, first = np.unique(self.motion_of, return_index=True)
        fundamental = self.found.fundamental[first, None]
        return Motions(self.frames, fundamental, self.found.noise[first])

    def reordered(self, order):
        """The same with the motions in another order."""
        places = np.full(self.motion_of.max() + 1, -1)
        places[order] = np.arange(len(order))
        motion_of = places[self.motion_of]
        kept = motion_of >= 0
        return replace(
            self,
            found=self.found[kept],
            log_shares=self.log_shares[np.append(kept, True)],
            motion_of=motion_of[kept],
        )

    def _log_probabilities(self, points, visibility):
        seen, x, y = self.frames.observe(points, visibility)
        densities = self.found.with_mismatches(two_views(x, y, self.side))
        return seen[0], densities + self.log_shares[:, None], self.motion_of


class TwoViewPartitions(NamedTuple):
    """The best partitions of the tracks of two images, or of several, by pairs of two.

    Attributes
    ----------
    best : dict of int to (Cost, ndarray)
        Cost and labels of all tracks for each number of motions.
    chosen : int
    log_odds : dict of int to float
        Of so many motions against fewer.
    outliers : ndarray of bool, shape (n,)
        Mismatches of the chosen partition.
    probabilities : ndarray of shape (n,)
        Of the labels in the chosen partition.
    explanation : ByDensity
    """

    best: dict[int, tuple[Cost, np.ndarray]]
    chosen: int
    log_odds: dict[int, float]
    outliers: np.ndarray
    probabilities: np.ndarray
    explanation: ByDensity


def two_view_partitions(geometry, counts, rng):
    """Partition the tracks of two images.

    Parameters
    ----------
    geometry : ClipGeometry
        Of two frames, in which all tracks are seen.
    counts : ndarray of int, shape (n_counts,)
        Numbers of motions that are open, ascending.
    rng : RandomState

    Returns
    -------
    TwoViewPartitions or None
        None if there are too few tracks, or if what they tell is not of such numbers.
    """
    first, second = geometry.frames.centres[geometry.frames.pairs[0]]
    at_rest = (first - second) / geometry.frames.scale
    views = two_views(geometry.x, geometry.y, at_rest=at_rest)
    search = search_two_views(views, counts, rng)
    best = {} if search is None else best_by_number_of_motions(search)

    def explain(found):
        return TwoViewExplanation(
            geometry.frames,
            search.scene.views.side,
            found.motions,
            log_shares(found.shares),
            found.motion_of,
        )

    scale = geometry.frames.scale
    return partitions_of(best, counts, len(geometry.x), scale, explain)


def partitions_of(best, counts, n_places, scale, explain):
    """What was found between images, as a search over partitions hands it on.

    Parameters
    ----------
    best : dict of int to Surfaces or Mixture
        By the number of motions.
    counts : ndarray of int, shape (n_counts,)
        Numbers of motions that are open.
    n_places : int
        Places that are told, of all tracks.
    scale : float
        Pixels per working unit.
    explain : callable
        Takes what was found of one number to what explains it.

    Returns
    -------
    TwoViewPartitions or None
        None where nothing was found of an open number.
    """
    labels = {count: _complete(best[count]) for count in sorted(best)}
    # A motion may be the most probable one of no track.
    labels = {
        count: each
        for count, each in labels.items()
        if count in counts and each.max() + 1 == count
    }
    if not labels:
        return None
    costs = {count: _cost(best[count], n_places, scale) for count in labels}
    chosen = min(labels, key=lambda count: costs[count].total)
    found = best[chosen]
    order = [labels[chosen].tolist().index(label) for label in range(chosen)]
    order = found.shares_of_motions.argmax(axis=0)[order]
    return TwoViewPartitions(
        {count: (costs[count], labels[count]) for count in labels},
        chosen,
        _log_odds(best),
        found.labels == len(found.shares) - 1,
        np.maximum(found.shares_of_motions.max(axis=0), found.shares[-1]),
        explain(found).reordered(order),
    )


def parted_images(views, rng):
    """Labels of the tracks of two images of several, whose number of motions is open.

    By a search that is begun once and only takes motions away afterwards: what one pair
    has wrong, others have right.

    Parameters
    ----------
    views : TwoViews
    rng : RandomState

    Returns
    -------
    ndarray of int, shape (n,)
        -1 for mismatches, which all are where there are too few tracks.
    """
    counts = np.arange(1, MOST_MOTIONS + 1)
    search = search_two_views(views, counts, rng, n_begun=1, sweeps=0)
    best = {} if search is None else best_by_number_of_motions(search)
    if not best:
        return np.full(len(views), -1)
    found = min(best.values(), key=lambda surfaces: surfaces.cost)
    return np.append(found.motion_of, -1)[found.labels]


def best_by_number_of_motions(search):
    """Surfaces of least cost for each number of motions: dict of int to Surfaces."""
    best: dict[int, Surfaces] = {}
    for segmentation in search.best.values():
        for found in with_fewer_motions(search.scene, segmentation):
            count = found.n_motions
            if count not in best or found.cost < best[count].cost:
                best[count] = found
    return best


def _complete(found):
    """Labels of all tracks, mismatches as of their most probable motion."""
    return canonical_labels(found.shares_of_motions.argmax(axis=0))


def _cost(found, n_places, scale):
    """Cost per track; places are known to a square pixel."""
    n = len(found.labels)
    places = (found.data_cost + n_places * 2 * np.log(scale)) / n
    others = (found.cost - found.data_cost) / n
    return Cost(others, places, others + places)


def _log_odds(best):
    """Log odds of each number against the best of fewer motions."""
    counts = sorted(best)
    return {
        count: (min(best[fewer].cost for fewer in counts[:position]) - best[count].cost)
        / TEMPERATURE
        for position, count in enumerate(counts)
        if position
    }
