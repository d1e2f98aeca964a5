"""Parts of the picture that do not move as the static scene does.

Each track has log odds of moving by how far it is from the scene's rigid motion, and by
how its depth differs from those around. A minimal cut of the graph of neighbouring
tracks makes of these connected regions, and a region stays a part only if a motion of
its own, or the movement of the tracks around each one, explains it much better than the
scene: noise, and water, are explained by neither. What a part's rigid motion leaves
unexplained, as limbs that bend, is of the part where it goes together with it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import (
    breadth_first_order,
    connected_components,
    maximum_flow,
)
from scipy.spatial import Delaunay, KDTree, QhullError

from ..geometry.windows import (
    FEWEST_TRACKS,
    LEAST_NOISE,
    LONGEST_SHORT,
    REFERENCE_WIDTH,
    Windows,
    spread_window_frames,
)
from .static_scene import fit_static_scene, view_of

# Log odds of moving: per e-fold of a residual, and of a step of depth, in deviations,
# beyond so many; at least and at most so much, per window and in all.
SLOPE, RESIDUALS, STEPS = 3.0, 2.5, 4.0
LEAST_ODDS, MOST_BY_RESIDUAL, MOST_BY_STEP, MOST_ODDS = -2.0, 4.0, 3.0, 6.0
# Log odds by a label that is not the background's: less than two windows at rest say.
# Where labels part the scene, they do not count.
ODDS_OF_LABEL = 0.7
# Log odds that the motion of a label is not the scene's: constant, per e-fold of the
# scene's residuals over its own, and over the noise, both medians over its tracks. By
# regression on motions of partitions of simulated scenes of ten frames.
ODDS_OF_MOTION = (-2.9, 4.0, 1.1)
# A track that moves does so in this share of the windows.
SHARE_MOVING = 0.5
# Correlation of what two windows tell of a track: its patch stays with it.
ALIKE = 0.5
# Noise grows with a track's jitter, taken over that of the scene's tracks and within
# limits, to this power; frames by which jitter is told.
NOISE_OF_JITTER, JITTERS, FRAMES_OF_JITTER = 0.3, (0.1, 10.0), 4
# What it costs to part two neighbours, in nats, by how far they move from each other,
# in pixels of a video 640 pixels wide; and the share that is left in any case.
LINK, LINK_SCALE, LEAST_LINK = 1.0, 2.0, 0.1
# Neighbours are within so many times the usual distance; frames from one
# triangulation to the next.
REACH, FRAMES_BETWEEN = 4.0, 3
# Fewer tracks are no part.
LEAST_TRACKS = 12
# Residuals from the scene are so many times those from a part's own motion, which are
# below so many standard deviations, as those from the scene are not.
OWN_RATIO, MOST_OWN, LEAST_SCENE = 3.0, 5.0, 2.0
# Steps of depth count from so many deviations on.
LARGE_STEP = 3.0
# Share of the tracks that is enough for a part to be whole.
WHOLE = 0.8
# Share of the tracks that is most of them: of a rigid motion's that move, if it does,
# of those that are explained, if it is a part, and of a part's that go together.
MOST = 0.5
# A part that encloses another has so many times its tracks.
ENCLOSING = 5.0
# Pairs of neighbours by which what bends touches a rigid part.
LEAST_TOUCHING = 3
# Regions are taken apart so many times at most.
MOST_DEPTH = 6
# Tracks around one that tell its movement, by residuals so many times smaller: those of
# independent noise are larger.
N_AROUND, AROUND_RATIO = 8, 1.25
# Log odds of a track that it is of a limb, at least and at most; and what it costs to
# part two neighbours, in nats.
LIMB_ODDS, LIMB_LINK = (-2.0, 2.0), 0.3


def moving_parts(points, visibility, labels, background, size):
    """Regions that move against the static scene, and which is which.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
        Pixels; NaN where unseen.
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    labels : ndarray of int, shape (n_tracks,)
        Rigid motion of each track; negative for none.
    background : int
        The label that may be the scene.
    size : tuple of (width, height)
        Of the picture, pixels.

    Returns
    -------
    ndarray of int, shape (n_tracks,), or None
        -1 for the scene, 0, 1, ... for parts that move. None where the clip is too
        short, or has too few tracks, for rigid motion.
    """
    if points.shape[1] < 3 or visibility.shape[0] < LEAST_TRACKS:
        return None
    windows = Windows(points, visibility, frames=spread_window_frames(visibility))
    groups = [np.flatnonzero(labels == k) for k in np.unique(labels[labels >= 0])]
    scene = fit_static_scene(windows, size, groups)
    if not scene.members.any():
        return None
    noise = relative_noise(points, visibility, scene.members.any(axis=1))
    scene = scene._replace(noise=scene.noise * noise[:, None])
    graph = track_graph(points, visibility, REFERENCE_WIDTH / max(size))
    parts = _Parts(windows, scene, graph.pairs)
    motions = np.where(labels == background, -1, labels)
    # In short clips, motions tell as wholes (the odds are of such), and what are
    # neighbours at some time are so throughout.
    is_short = points.shape[1] <= LONGEST_SHORT
    odds, sure = moving_odds(scene), []
    for motion in np.unique(motions[motions >= 0]):
        own = np.flatnonzero(motions == motion)
        by_motion = parts.odds_of_motion(own) if is_short else -np.inf
        odds[own] += np.clip(by_motion, ODDS_OF_LABEL, -LEAST_ODDS)
        if by_motion > 0:
            sure.append(motion)
    links = LINK * np.maximum(np.exp(-graph.apart / LINK_SCALE), LEAST_LINK)
    moving = least_cut(odds, graph.pairs, links)
    return parts.of(moving, motions, sure, is_short)


def moving_odds(scene):
    """Log odds (n_tracks,) of moving in one or more windows, by each by itself."""
    residuals = np.log(np.maximum(scene.deviations / scene.noise, 1e-3) / RESIDUALS)
    steps = np.log(np.maximum(scene.steps / scene.noise, 1e-3) / STEPS)
    odds = np.maximum(
        (SLOPE * residuals).clip(LEAST_ODDS, MOST_BY_RESIDUAL),
        (SLOPE * steps).clip(LEAST_ODDS, MOST_BY_STEP),
    )
    odds = np.where(scene.members, np.minimum(odds, 0), odds)
    known = ~np.isnan(scene.deviations)
    n_known = known.sum(axis=1)
    often = np.log(SHARE_MOVING * np.exp(np.where(known, odds, 0)) + 1 - SHARE_MOVING)
    total = np.where(known, np.where(n_known[:, None] > 1, often, odds), 0).sum(axis=1)
    total /= 1 + ALIKE * np.maximum(n_known - 1, 0)
    return total.clip(LEAST_ODDS, MOST_ODDS)


def relative_noise(points, visibility, static):
    """Noise (n_tracks,) of each track over that which is usual in the scene.

    A track's noise changes from frame to frame, and the paths of things hardly do: the
    third difference of its places, less that which all have as the camera shakes, is
    nearly noise alone. Poor patches have more of it.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    static : ndarray of bool, shape (n_tracks,)
        Tracks of the scene.

    Returns
    -------
    ndarray of shape (n_tracks,)
        1 where a track is seen too briefly to tell.
    """
    squares, counts = np.zeros((2, len(points)))
    for first in range(points.shape[1] - FRAMES_OF_JITTER + 1):
        frames = slice(first, first + FRAMES_OF_JITTER)
        rows = np.flatnonzero(visibility[:, frames].all(axis=1))
        if len(rows):
            jerk = np.diff(points[rows, frames], n=FRAMES_OF_JITTER - 1, axis=1)[:, 0]
            jerk = jerk - np.median(jerk, axis=0)
            squares[rows] += (jerk**2).sum(axis=1)
            counts[rows] += 1
    jitter, known = np.sqrt(squares / np.maximum(counts, 1)), static & (counts > 0)
    usual = np.median(jitter[known]) if known.any() else 0.0
    if usual == 0:
        return np.ones(len(points))
    relative = np.where(counts > 0, jitter / usual, 1)
    return relative.clip(*JITTERS) ** NOISE_OF_JITTER


class TrackGraph(NamedTuple):
    """Pairs of tracks that were neighbours.

    Attributes
    ----------
    pairs : ndarray of int, shape (m, 2)
    apart : ndarray of shape (m,)
        How far the two moved from where they usually are to each other, at most: pixels
        of a video 640 pixels wide.
    """

    pairs: np.ndarray
    apart: np.ndarray


def track_graph(points, visibility, unit):
    """Tracks that were neighbours in a triangulation of some frame, and are near.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    unit : float
        Pixels, in a video 640 pixels wide, per pixel.

    Returns
    -------
    TrackGraph
    """
    n_tracks, n_frames = visibility.shape
    keys = [np.empty(0, dtype=np.int64)]
    for frame in range(0, n_frames, FRAMES_BETWEEN):
        rows = np.flatnonzero(visibility[:, frame])
        pairs = np.sort(rows[_triangulated(points[rows, frame])], axis=1)
        keys.append(np.unique(pairs[:, 0] * n_tracks + pairs[:, 1]))
    pairs = np.column_stack(np.divmod(np.unique(np.concatenate(keys)), n_tracks))
    apart, distance = np.empty(len(pairs)), np.empty(len(pairs))
    step = max(1, 2_000_000 // n_frames)
    for start in range(0, len(pairs), step):
        some = slice(start, start + step)
        apart[some], distance[some] = _relative(points, visibility, pairs[some])
    usual = np.median(distance) if len(pairs) else 0.0
    near = distance <= REACH * usual
    return TrackGraph(pairs[near], unit * apart[near])


def _triangulated(points):
    """Pairs (m, 2) of neighbours among points (n, 2)."""
    try:
        corners = Delaunay(points).simplices
    except (QhullError, ValueError):  # too few, or on a line
        return np.empty((0, 2), dtype=int)
    return np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [0, 2]]])


def _relative(points, visibility, pairs):
    """How far pairs move from their usual difference at most, and how far it is."""
    first, second = pairs.T
    both = visibility[first] & visibility[second]
    difference = np.moveaxis(points[first] - points[second], 2, 0)  # (2, m, F)
    apart = np.where(both, difference, np.nan)
    usual = _known_medians(apart, both.sum(axis=1))
    most = np.nanmax(np.hypot(*(apart - usual[..., None])), axis=1)
    return most, np.hypot(*usual)


def _known_medians(values, n_known):
    """Medians (..., m) of values (..., m, n), NaN aside; quicker than nanmedian.

    ``n_known`` of each row, one or more, are not NaN.
    """
    ordered = np.sort(values, axis=-1)  # NaN last
    low, high = (
        np.take_along_axis(
            ordered, np.broadcast_to(at, ordered.shape[:-1])[..., None], -1
        )
        for at in ((n_known - 1) // 2, n_known // 2)
    )
    return (low[..., 0] + high[..., 0]) / 2


def least_cut(odds, pairs, links, steps=1000):
    """The labelling of least cost by a minimal cut: (n,), bool.

    Parameters
    ----------
    odds : ndarray of shape (n,)
        Log odds of being True.
    pairs : ndarray of int, shape (m, 2)
    links : ndarray of shape (m,)
        Nats that it costs to part a pair.
    steps : int
        Per nat, in which costs are counted.

    Returns
    -------
    ndarray of bool, shape (n,)

    References
    ----------
    D. M. Greig, B. T. Porteous and A. H. Seheult, "Exact Maximum A Posteriori
    Estimation for Binary Images", J. R. Statist. Soc. B 51(2), 1989.
    """
    n = len(odds)
    every = np.arange(n)
    first = np.concatenate([*pairs.T, np.full(n, n), every])
    second = np.concatenate([*pairs.T[::-1], every, np.full(n, n + 1)])
    costs = np.concatenate([links, links, np.maximum(odds, 0), np.maximum(-odds, 0)])
    costs = np.rint(steps * costs).astype(np.int32)
    # The flow of SciPy 1.11 takes no indices of 64 bits.
    ends = first.astype(np.int32), second.astype(np.int32)
    capacity = csr_array((costs, ends), shape=(n + 2, n + 2))
    capacity.sum_duplicates()
    left = csr_array(capacity - maximum_flow(capacity, n, n + 1).flow)
    left.data = (left.data > 0).astype(np.int32)
    left.eliminate_zeros()
    reached = np.zeros(n + 2, dtype=bool)
    reached[breadth_first_order(left, n, return_predecessors=False)] = True
    return reached[:n]


class _Parts:
    """Takes regions of moving tracks apart into what moves by itself."""

    def __init__(self, windows, scene, pairs):
        self._windows, self._pairs = windows, pairs
        self._judged = np.isfinite(scene.deviations).any(axis=1)
        freedom = np.where(np.isnan(scene.deviations), 0, windows.freedom)
        over = np.maximum(scene.steps - LARGE_STEP * scene.noise, 0)
        self._scene, self._noise = (
            _root_mean(np.where(freedom > 0, squares, 0), freedom)
            for squares in (scene.deviations**2 + over**2, scene.noise**2)
        )

    def odds_of_motion(self, tracks):
        """Log odds that the motion of some tracks is not the scene's.

        One track is nearer to a motion of its own by chance; most of many are not.
        """
        own, scene = self._own(tracks, smooth=False), self._scene[tracks]
        known = np.isfinite(own) & (scene > 0)
        if known.sum() < LEAST_TRACKS:
            return -np.inf
        rivals = np.maximum(own, LEAST_NOISE), self._noise[tracks]
        usual = [np.median(np.log(scene[known] / rival[known])) for rival in rivals]
        return float(np.dot(ODDS_OF_MOTION, [1, *usual]))

    def of(self, moving, motions, sure=(), is_short=False):
        """Parts (n,) of moving tracks: 0, 1, ...; -1 for none.

        Rigid motions whose tracks move, as most do, are looked at first; those in
        ``sure`` are known not to be the scene's. In a short clip, what bends is one
        with the rigid parts that it touches: in longer ones, movements over time tell
        what is one, and what only passes has touched it, too.
        """
        known: list[np.ndarray] = []
        for motion in np.unique(motions[motions >= 0]):
            own = motions == motion
            if moving[own].mean() > MOST:
                regions = self._regions(moving & own)
                known += regions if motion in sure else map(self._moved, regions)
        left = moving.copy()
        for part in known:
            left[part] = False
        parts, rest = self._rigid_parts(left)
        parts += [part for part in known if len(part)]
        bent = [
            region
            for region in self._regions(rest)
            if self._goes_together(region).mean() >= MOST
        ]
        labels, n_parts = self._numbered(parts, bent, is_short)
        return self._with_limbs(self._absorbed(labels, n_parts), moving)

    def _numbered(self, rigid, bent, is_short):
        """Number of each track's part, the largest being 0, and how many there are.

        What no rigid motion explains bends, and, if ``is_short``, is one with the rigid
        parts that it touches: a body between its head and its hands.
        """
        regions = [*rigid, *bent]
        labels, n_regions = np.full(len(self._scene), -1), len(regions)
        if not regions:
            return labels, 0
        for number, region in enumerate(regions):
            labels[region] = number
        pairs = labels[self._pairs]
        pairs = pairs[(pairs.min(axis=1) >= 0) & (pairs.max(axis=1) >= len(rigid))]
        links = np.zeros((n_regions, n_regions))
        np.add.at(links, tuple(pairs.T), 1)
        touching = is_short & (links + links.T >= LEAST_TOUCHING)
        n_parts, names = connected_components(csr_array(touching), directed=False)
        sizes = np.bincount(names, [len(region) for region in regions], n_parts)
        rank = np.empty(n_parts, dtype=int)
        rank[np.argsort(-sizes, kind="stable")] = np.arange(n_parts)
        return np.where(labels >= 0, rank[names][labels], -1), n_parts

    def _with_limbs(self, labels, moving):
        """The same, with what goes together with a part that it touches.

        Only in regions of which most are parts or go together. Elsewhere, what moves
        around a part is more likely what it moves in: water.
        """
        taken = labels >= 0
        odds = np.full(len(moving), MOST_ODDS)
        for region in self._regions(moving):
            left = labels[region] < 0
            if left.all() or not left.any():
                continue
            scene, around = self._scene[region], self._from_around(region)
            together = ~left | self._is_together(region, around)
            if together.mean() >= MOST:
                taken[region] = True
                known = np.isfinite(around) & (scene > 0)
                ratio = np.where(known, scene, 1) / np.where(known, around, 1).clip(
                    1e-9
                )
                by_ratio = (SLOPE * np.log(ratio / AROUND_RATIO)).clip(*LIMB_ODDS)
                still = scene <= LEAST_SCENE * self._noise[region]
                by_ratio = np.where(still, LIMB_ODDS[0], by_ratio)
                odds[region[left]] = np.where(known, by_ratio, 0)[left]
        pairs = self._pairs[taken[self._pairs].all(axis=1)]
        odds[~taken] = LEAST_ODDS
        limbs = least_cut(odds, pairs, np.full(len(pairs), LIMB_LINK)) & (labels < 0)
        return self._attached(labels, limbs, pairs)

    def _attached(self, labels, limbs, pairs):
        """The same, each connected limb having the label that it touches most."""
        n = len(labels)
        inside = pairs[limbs[pairs].all(axis=1)]
        graph = csr_array((np.ones(len(inside)), tuple(inside.T)), shape=(n, n))
        names = connected_components(graph, directed=False)[1]
        across = pairs[limbs[pairs[:, 0]] != limbs[pairs[:, 1]]]
        own, other = np.where(limbs[across[:, :1]], across, across[:, ::-1]).T
        touching = labels[other] >= 0
        votes = np.zeros((names.max() + 1, labels.max() + 2), dtype=int)
        np.add.at(votes, (names[own[touching]], labels[other[touching]]), 1)
        touched = limbs & (votes.max(axis=1)[names] > 0)
        return np.where(touched, votes.argmax(axis=1)[names], labels)

    def _absorbed(self, labels, n_parts):
        """The same, but that parts which much larger ones enclose are of these."""
        first, second = labels[self._pairs].T
        links = np.zeros((n_parts + 1, n_parts + 1))  # the last is what moves not
        np.add.at(links, (first, second), 1)
        np.add.at(links, (second, first), 1)
        np.fill_diagonal(links, 0)
        sizes = np.bincount(labels[labels >= 0], minlength=n_parts)
        owner = np.arange(n_parts)
        for part in range(n_parts):
            other = links[part].argmax()
            enclosed = links[part, other] > MOST * links[part].sum()
            if other < n_parts and enclosed and sizes[other] > ENCLOSING * sizes[part]:
                owner[part] = owner[other]  # larger, so that its owner is known
        if not n_parts:
            return labels
        _, names = np.unique(owner, return_inverse=True)
        return np.where(labels >= 0, names[labels], -1)

    def _rigid_parts(self, moving):
        """Parts that one motion explains, and a mask of the tracks that are left."""
        parts, rest = [], np.zeros(len(moving), dtype=bool)
        regions = [(region, 0) for region in self._regions(moving)]
        while regions:
            region, depth = regions.pop()
            own = self._explained(region)
            if own.mean() >= WHOLE:
                parts.append(region)
                continue
            found = self._regions(self._mask(region[own]))
            left = self._mask(region)
            for part in found:
                parts.append(part)
                left[part] = False
            if found and depth < MOST_DEPTH:
                regions += [(some, depth + 1) for some in self._regions(left)]
            else:
                rest |= left
        return parts, rest

    def _moved(self, region):
        """A region of one motion if most of it moves by itself; none of it otherwise.

        Whole: the cut has told which tracks move, and a body's may bend, or be seen too
        briefly to be judged. Their depths may differ from those around: it took
        many tracks to find the motion, so that these depths explain no noise.
        """
        own = self._explained(region, smooth=False) | self._goes_together(region)
        judged = own[self._judged[region]]
        return region if len(judged) and judged.mean() >= MOST else region[:0]

    def _goes_together(self, region):
        """Which tracks move as those around them do, and not as the scene does."""
        return self._is_together(region, self._from_around(region))

    def _is_together(self, region, around):
        scene = self._scene[region]
        return (scene > AROUND_RATIO * around) & (
            scene > LEAST_SCENE * self._noise[region]
        )

    def _mask(self, tracks):
        mask = np.zeros(len(self._scene), dtype=bool)
        mask[tracks] = True
        return mask

    def _regions(self, mask):
        """Connected components of some tracks, those that are large enough."""
        pairs = self._pairs[mask[self._pairs].all(axis=1)]
        n = len(mask)
        graph = csr_array((np.ones(len(pairs)), tuple(pairs.T)), shape=(n, n))
        names = connected_components(graph, directed=False)[1]
        rows = np.flatnonzero(mask)
        _, names, counts = np.unique(
            names[rows], return_inverse=True, return_counts=True
        )
        return [rows[names == k] for k in np.flatnonzero(counts >= LEAST_TRACKS)]

    def _explained(self, region, smooth=True):
        """Which tracks of a region are explained by its own motion, not the scene's.

        If ``smooth``, at depths like those of the tracks around.
        """
        own, scene = self._own(region, smooth), self._scene[region]
        noise = self._noise[region]
        return (
            (scene > OWN_RATIO * np.maximum(own, LEAST_NOISE))
            & (scene > LEAST_SCENE * noise)
            & (own < MOST_OWN * noise)
        )

    def _own(self, region, smooth):
        """Root mean square residuals of a region's tracks from its own motion."""
        windows = self._windows
        motion = windows.fit([region])[0]
        squares, freedom = np.zeros((2, len(region), len(windows.frames)))
        for number, poses in enumerate(motion.poses):
            there = np.flatnonzero(windows.freedom[region, number])
            if poses is None or len(there) < FEWEST_TRACKS:
                continue
            rows = region[there]
            view = view_of(windows, number, rows, poses)
            squares[there, number] = view.deviations**2
            if smooth:
                squares[there, number] += self._steps_around(rows, number, view) ** 2
            freedom[there, number] = windows.freedom[rows, number]
        own = _root_mean(squares, freedom)
        own[freedom.sum(axis=1) == 0] = np.inf
        return own

    def _steps_around(self, rows, number, view):
        """By how many pixels depths differ from those of the tracks around."""
        near = self._near(rows, number)
        steps = np.abs(view.depths[near] - view.depths[:, None])
        steps = np.median(steps, axis=1) * view.shifts
        return np.maximum(steps - LARGE_STEP * LEAST_NOISE, 0)

    def _near(self, rows, number):
        """Places (n, N_AROUND) of the tracks around each one."""
        windows = self._windows
        places = windows.points[rows][:, windows.frames[number]]
        centres = np.nanmean(places, axis=1)
        n_around = min(N_AROUND, len(rows) - 1)
        return KDTree(centres).query(centres, n_around + 1)[1][:, 1:]

    def _from_around(self, region):
        """Root mean square difference of each track's movement from those around it."""
        windows = self._windows
        squares, freedom = np.zeros((2, len(region), len(windows.frames)))
        for number in range(len(windows.frames)):
            there = np.flatnonzero(windows.freedom[region, number])
            if len(there) <= N_AROUND:
                continue
            rows = region[there]
            x = np.where(
                windows.seen[number][rows][..., None], windows.x[number][rows], np.nan
            )
            x = windows.pixels * (x - np.nanmean(x, axis=1, keepdims=True))
            near = x[self._near(rows, number)]  # (n, N_AROUND, L, 2)
            seen = np.isfinite(x) & np.isfinite(near).any(axis=1)
            near = np.where(np.isfinite(near).any(axis=1, keepdims=True), near, 0)
            apart = np.where(seen, x - np.nanmedian(near, axis=1), 0)
            squares[there, number] = (apart**2).sum(axis=(1, 2))
            freedom[there, number] = windows.freedom[rows, number]
            squares[there, number] /= freedom[there, number]
        around = _root_mean(squares, freedom)
        around[freedom.sum(axis=1) == 0] = np.inf
        return around


def _root_mean(squares, weights):
    """Root of the weighted mean over the last axis; 0 where nothing has weight."""
    total = (squares * weights).sum(axis=-1)
    return np.sqrt(total / np.maximum(weights.sum(axis=-1), 1))
