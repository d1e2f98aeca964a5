"""Find the motions between two images, and how many they are.

Tracks that are near each other in both images mostly have one motion, however many
mismatches there are: those are far from all. Affine maps of a few such neighbours are
the hypotheses. What explains most that is not explained yet is grown to a motion and
taken, one after another, until the cost rises, several times from other hypotheses;
then motions are dropped, joined, added and split as long as a cost falls, that of the
best number or of a number beside it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..geometry.two_views import fit_two_view_motions, log_student
from .two_view_energy import (
    RESTING,
    Scene,
    Segmentation,
    assign,
    best_log_densities,
    judged,
    settle,
    two_view_scene,
)

# Tracks below which there is too little to sample from.
FEWEST_TRACKS = 16
# Hypotheses of a proposal, and how many nearest neighbours they are drawn from: small
# things are dense, and of a large one few tracks determine little.
N_HYPOTHESES = 1200
NEIGHBOURHOODS = (6, 12, 25, 60)
# Tracks that determine a hypothesis: a map of three, and one that checks them.
SAMPLE = 4
# Widths of the density about the map of a hypothesis, as shares of the side.
WIDTHS = 0.0025 * 2.0 ** np.arange(5)
# Nats by which a new motion must explain a track better than it is, to win it.
MARGIN = 1.0
# Hypotheses that are grown: of those that explain most, in this order, the ones that
# share less than that part of their tracks with any before.
BEST, SHARED = 200, 0.7
N_GROWN, ROUNDS_OF_GROWTH = 20, 4
# A motion that costs so many nats more than it explains is not taken, and after so many
# that raised the cost there is no other.
HOPELESS, RISES = 5.0, 2
# Motions that are found one after another, at most, if no more are asked for.
MOST_MOTIONS = 9
# How often they are, from other hypotheses: what is taken first decides what is left.
# In 59 simulated pairs of images, the number of motions is right in 71 % instead of 66
# if it is done once, and the error 4.8 % instead of 5.7.
N_BEGUN = 3
# Of changes of one kind, those that are settled, and rounds of it; and how often all
# are tried again.
N_DROPPED, N_JOINED, ROUNDS_OF_CHANGE, SWEEPS = 2, 2, 4, 2


class TwoViewSearch(NamedTuple):
    """What was found, and in what.

    Attributes
    ----------
    scene : Scene
    best : dict of int to Segmentation
        The one of least cost for each number of motions.
    """

    scene: Scene
    best: dict[int, Segmentation]


def search_two_views(views, counts, rng, n_begun=N_BEGUN, sweeps=SWEEPS):
    """Segmentations of least cost for numbers of motions.

    Parameters
    ----------
    views : TwoViews
    counts : ndarray of int, shape (n_counts,)
        Numbers of motions that are open, ascending.
    rng : RandomState
    n_begun : int
        How often motions are found one after another.
    sweeps : int
        How often all changes are tried again, at most.

    Returns
    -------
    TwoViewSearch or None
        Not every number needs to be there. None if there are too few tracks, or no
        motion in them.
    """
    if len(views) < FEWEST_TRACKS:
        return None
    search = _Search(two_view_scene(views, max(NEIGHBOURHOODS)), rng)
    most = max(MOST_MOTIONS, int(counts[0]) + 1)
    fewest = int(counts[0]) if len(counts) > 1 else 0
    for first in [None] * n_begun + search.resting():
        search.find_one_by_one(most, fewest, first)
    if not search.best:
        return None
    for count in range(max(search.best), 1, -1):
        search.take_away(count)
    for _ in range(sweeps):
        if not search.improve(counts):
            break
    return TwoViewSearch(search.scene, search.best)


class _Search:
    """The best segmentation for each number of motions, so far."""

    def __init__(self, scene, rng):
        self.scene, self.rng = scene, rng
        self.best: dict[int, Segmentation] = {}

    def keep(self, found):
        """Whether a segmentation is the best of its number; it is kept then."""
        if found is None:
            return False
        count = len(found.motions)
        if count in self.best and found.cost >= self.best[count].cost - 1e-6:
            return False
        self.best[count] = found
        return True

    def resting(self):
        """The motion of what rests in the images, if there is that, beside others."""
        views = self.scene.views
        if views.at_rest is None:
            return []
        rests = views.moved <= RESTING
        if min(rests.sum(), (~rests).sum()) < SAMPLE:
            return []
        return [fit_two_view_motions(views, rests[None].astype(float))]

    def find_one_by_one(self, most, fewest, first=None):
        """Add the motion that explains most, until there is none or cost rises.

        Parameters
        ----------
        most, fewest : int
            Numbers of motions.
        first : TwoViewMotions, optional
            What others are found beside.
        """
        found, rises = None, 0
        while found is None or len(found.motions) < most:
            motions = first if found is None else found.motions
            added, gains = self.propose(motions)
            if motions is not None and gains[0] < -HOPELESS:
                break
            more = added[:1] if motions is None else motions + added[:1]
            after = settle(self.scene, more)
            if after is None or (motions and len(after.motions) <= len(motions)):
                break
            self.keep(after)
            rises = rises + 1 if found and after.cost > found.cost else 0
            found = after
            if rises >= RISES and len(found.motions) >= fewest:
                break

    def propose(self, motions, among=None, n_grown=N_GROWN):
        """New motions beside others, those that explain most first, and gains in nats.

        Parameters
        ----------
        motions : TwoViewMotions or None
        among : ndarray of bool, shape (n,), optional
            Tracks that the new ones are to explain.
        n_grown : int
        """
        known = best_log_densities(self.scene, () if motions is None else motions)
        known = known + MARGIN
        among = np.ones(len(known), dtype=bool) if among is None else among
        starts = _starts(self.scene, known, among, n_grown, self.rng)
        return _grown(self.scene.views, starts, known, among)

    def improve(self, counts):
        """Whether some change of segmentations near the chosen one was for the better.

        Parameters
        ----------
        counts : ndarray of int
            Numbers that are open.
        """
        open_counts = [count for count in self.best if count in counts]
        centre = min(open_counts or self.best, key=lambda count: self.best[count].cost)
        if not open_counts:  # then those that are wanted are more, or fewer
            centre = int(counts[np.abs(counts - centre).argmin()])
        changed = [self.add_to(c) for c in (centre - 1, centre) if c in self.best]
        changed += [self.take_away(c) for c in (centre + 1, centre) if c in self.best]
        return any(changed)

    def take_away(self, count):
        """Drop or join motions of the best segmentation of so many."""
        if count < 2 or count not in self.best:
            return False
        starts = [*self._dropped(self.best[count]), *self._joined(self.best[count])]
        kept = [self.keep(self._settle(*start)) for start in starts]
        return any(kept)

    def _settle(self, motions, shares=None):
        return settle(self.scene, motions, shares, ROUNDS_OF_CHANGE)

    def _dropped(self, found):
        """Motions without one, and shares, where that costs least at first."""
        tried = []
        for motion in range(len(found.motions)):
            motions = found.motions[np.arange(len(found.motions)) != motion]
            shares, densities = assign(self.scene, motions)
            judgement = judged(self.scene, motions, shares, densities)
            tried.append((judgement.cost, motion, motions))
        return [(motions,) for _, _, motions in sorted(tried, key=_first)[:N_DROPPED]]

    def _joined(self, found):
        """Motions and shares with two made one, where that costs least at first."""
        views, motions = self.scene.views, found.motions
        of_motions = found.shares[:-1]
        i, j = np.tril_indices(len(motions), -1)
        union = of_motions[i] + of_motions[j]
        together = fit_two_view_motions(views, union)
        together = fit_two_view_motions(views, union, together)
        least = views.log_density_of_mismatches
        densities = np.maximum(together.log_densities(views), least)
        joined = together.lengths(views, union, densities)
        apart = motions.lengths(views, of_motions, motions.log_densities(views))
        order = np.argsort(joined - apart[i] - apart[j], kind="stable")
        for first, second in zip(i[order][:N_JOINED], j[order][:N_JOINED], strict=True):
            shares = found.shares.copy()
            shares[second] += shares[first]
            kept = np.arange(len(motions)) != first
            yield motions[kept], shares[np.append(kept, True)]

    def add_to(self, count):
        """Add a motion to the best segmentation of so many, or split one of it."""
        found = self.best[count]
        added, _ = self.propose(found.motions)
        changed = self.keep(self._settle(found.motions + added[:1]))
        for motion in range(count):
            members = found.labels == motion
            others = found.motions[np.arange(count) != motion]
            if members.sum() >= 2 * SAMPLE:
                part, _ = self.propose(others, members, N_GROWN // 3)
                changed |= self.keep(self._settle(found.motions + part[:1]))
                # The best for its tracks may be what it is: two in place of it.
                rest, _ = self.propose(others + part[:1], members, N_GROWN // 3)
                changed |= self.keep(self._settle(others + part[:1] + rest[:1]))
        return changed


def _first(values):
    return values[0]


def _starts(scene, known, among, n_starts, rng):
    """Shares (n_starts, n) of the tracks in the hypotheses that explain most."""
    tracks = np.flatnonzero(among)
    squares = _hypotheses(scene, tracks, rng)
    scales = WIDTHS * scene.views.side
    gains = np.stack(
        [_gains(squares, scale, known[tracks]).sum(axis=1) for scale in scales]
    )  # (n_widths, n_hypotheses)
    order = np.argsort(-gains.max(axis=0), kind="stable")[:BEST]
    scale = scales[gains.argmax(axis=0)[order]]
    gain = log_student(squares[order], scale, 2) - known[tracks]
    chosen = _different(gain > 0, n_starts)
    shares = np.zeros((len(chosen), len(known)))
    shares[:, tracks] = _logistic(gain[chosen])
    return shares


def _gains(squares, scale, known):
    """What tracks gain by hypotheses of that scale, (m, n), never less than 0."""
    gain = log_student(squares, np.full(1, scale, squares.dtype), 2)
    gain -= known.astype(squares.dtype)
    return np.maximum(gain, 0, out=gain)


def _hypotheses(scene, tracks, rng):
    """Squared distances of some tracks from affine maps of neighbours, float32.

    There are as many as are drawn among all tracks, but at least a quarter.
    """
    views, n_nearest = scene.views, scene.nearest.shape[1]
    n = int(N_HYPOTHESES * max(0.25, len(tracks) / len(views)))
    seeds = rng.choice(tracks, n)
    sizes = np.minimum(rng.choice(NEIGHBOURHOODS, n), n_nearest)
    drawn = rng.uniform(size=(n, SAMPLE - 1)) * sizes[:, None]
    others = scene.nearest[seeds[:, None], drawn.astype(int)]
    sample = np.column_stack([seeds, others])
    x, y = views.x[sample], views.y[sample, :2]
    moments = x.swapaxes(1, 2) @ x + 1e-9 * np.eye(3)
    maps = np.linalg.solve(moments, x.swapaxes(1, 2) @ y).astype(np.float32)
    x, y = views.x[tracks].astype(np.float32), views.y[tracks].astype(np.float32)
    squares = (y[:, 0] - maps[:, :, 0] @ x.T) ** 2
    squares += (y[:, 1] - maps[:, :, 1] @ x.T) ** 2
    return squares


def _different(sets, most):
    """Positions of the first sets (n_sets, n) that share little with those before."""
    counts = sets.astype(float)  # a product of integers is not left to the BLAS
    shared, sizes = counts @ counts.T, counts.sum(axis=1)
    alike = shared > SHARED * np.minimum(sizes, sizes[:, None])
    chosen: list[int] = []
    for position in range(len(sets)):
        if not alike[position, chosen].any():
            chosen.append(position)
        if len(chosen) == most:
            break
    return chosen


def _grown(views, shares, known, among):
    """Motions from shares (m, n), the best first, and what they gain, in nats."""
    motions = fit_two_view_motions(views, shares, common_noise=False)
    for _ in range(ROUNDS_OF_GROWTH):
        gain = np.where(among, motions.log_densities(views) - known, -np.inf)
        motions = fit_two_view_motions(views, _logistic(gain), motions, False)
    gain = np.where(among, motions.log_densities(views) - known, 0)
    gains = np.maximum(gain, 0).sum(axis=1) - motions.costs(views)
    order = np.argsort(-gains, kind="stable")
    return motions[order], gains[order]


def _logistic(values):
    return 1 / (1 + np.exp(np.clip(-values, -50, 50)))
