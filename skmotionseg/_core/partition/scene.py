"""Which motion is the static scene, and which parts of others are one thing."""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, KDTree, QhullError

from ..geometry.tracks import covered
from .reappearing import reappeared

# Cells per side of the picture in which tracks are counted for the extent of a motion.
N_CELLS = 12
# That a motion encloses the others counts for so many times its shares of margin and
# area: in follow shots, what is followed takes more of both than the scene does.
ENCLOSING = 2.0
# Sides of what tracks cover that are all at one height, say, pixels.
LEAST_SIDE = 1e-9
# Tracks of the static scene by which its motion at a place is told.
N_NEIGHBOURS = 48
# Frames over which movements are compared, and how many such windows at most.
WINDOW, MOST_WINDOWS = 6, 16
# Noise of a track's displacement, pixels; a track moves if its displacement is so many
# times the noise and the spread of the scene around.
NOISE, MOVES = 0.5, 1.5
# Tracks touch within so many times the distance to the nearest other one.
TOUCH = 4.0
# The smaller of two parts that touch has this share of its tracks near the other, and
# two that go together differ by this share of their own movement at most.
TOUCH_SHARE, TOGETHER = 0.1, 0.5
# Share of the tracks where two parts touch that are at a joint, if there is one.
JOINT_SHARE = 0.25
# Tracks further from the motion of a part than so many times the median are left out:
# at its edge, some go with what is behind.
DRAGGED = 2.5
# Fewer rejected tracks that move are no thing, and fewer tracks tell no affine motion.
LEAST_TRACKS = 6


def background_motion(points, visibility, labels, size=None):
    """The motion that is the static scene: what frames the picture and spans it.

    A scene reaches further than what moves before it: its tracks take most of the
    picture's margin, and their convex hull is large and encloses the others, even where
    the camera follows something that fills most of the picture. How many tracks it has
    does not count.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
        Pixels; NaN where unseen.
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    labels : ndarray of int, shape (n_tracks,)
        Motion of each track; negative for none.
    size : tuple of (width, height), optional
        Of the picture, pixels; if not given, it is what the tracks cover.

    Returns
    -------
    int
        A label of ``labels``; -1 if all are negative.
    """
    names = np.unique(labels[labels >= 0])
    if len(names) == 0:
        return -1
    if size is None:
        low, high = covered(points, visibility)
        points, size = points - low, np.maximum(high - low, LEAST_SIDE)
    extents = np.zeros(len(names))
    for frame in spread_frames(points.shape[1]):
        seen = visibility[:, frame] & (labels >= 0)
        if seen.any():
            places = np.searchsorted(names, labels[seen])
            extents += _extents(points[seen, frame], places, len(names), size)
    return int(names[extents.argmax()])


def spread_frames(n_frames):
    """Frames, evenly spread, in which extents are compared: no more than 25."""
    return np.unique(
        np.linspace(0, n_frames - 1, min(n_frames, 25)).round().astype(int)
    )


def _extents(points, labels, n_labels, size):
    """How far each motion reaches: in the margin, by its hull, and around others."""
    hulls = [_hull(points[labels == label]) for label in range(n_labels)]
    areas = np.array([hull.volume if hull else 0.0 for hull in hulls])
    extents = _margins(points, labels, n_labels, size) + areas / np.prod(size)
    return extents + ENCLOSING * _enclosing(points, labels, hulls)


def _margins(points, labels, n_labels, size):
    """The share of the picture's margin that each motion takes."""
    cell = (points / size * N_CELLS).astype(int).clip(0, N_CELLS - 1)
    counts = np.zeros((N_CELLS, N_CELLS, n_labels))
    np.add.at(counts, (*cell.T, labels), 1)
    margin = np.ones((N_CELLS, N_CELLS), dtype=bool)
    margin[1:-1, 1:-1] = False
    total = counts.sum(axis=2)
    taken = margin & (total > 0)
    if not taken.any():
        return np.zeros(n_labels)
    return (counts[taken] / total[taken][:, None]).mean(axis=0)


def _enclosing(points, labels, hulls):
    """How much of another motion is within each one's hull, less the reverse.

    Shares of tracks, on average over the others.
    """
    n = len(hulls)
    sizes, shares = np.maximum(np.bincount(labels, minlength=n), 1), np.zeros((n, n))
    for share, hull in zip(shares, hulls, strict=True):
        if hull:
            normals, offsets = hull.equations[:, :2], hull.equations[:, 2]
            within = (points @ normals.T + offsets <= 0).all(axis=1)
            share[:] = np.bincount(labels, within, n) / sizes
    return (shares - shares.T).sum(axis=1) / max(n - 1, 1)


def covered_share(points, visibility, size):
    """The share of the picture that the convex hull of tracks takes, in most frames.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
        Pixels; NaN where unseen.
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    size : tuple of (width, height)
        Of the picture, pixels.

    Returns
    -------
    float
        The median over frames.
    """
    hulls = [
        _hull(points[visibility[:, frame], frame])
        for frame in spread_frames(points.shape[1])
    ]
    areas = [hull.volume if hull else 0.0 for hull in hulls]
    return float(np.median(areas) / np.prod(size))


def _hull(points):
    """The convex hull of points (n, 2); None if it has no area."""
    try:
        return ConvexHull(points) if len(points) > 2 else None
    except QhullError:  # all on a line
        return None


# ---------------------------------------------------------------------------- objects


def moving_objects(points, visibility, labels, background):
    """One label per moving thing, rigid or not.

    Parts that touch, and over time go together against the static scene, are one thing:
    the limbs of a body that came apart. Tracks of no motion that move against the scene
    and have others like them around are parts, too. What goes behind something and
    comes out again is one thing as well.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
        Pixels; NaN where unseen.
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    labels : ndarray of int, shape (n_tracks,)
        Rigid motion of each track; negative for none.
    background : int
        The label that is the static scene.

    Returns
    -------
    ndarray of int, shape (n_tracks,)
        0 for the static scene, 1, 2, ... for things, most often seen first, and -1 for
        tracks of none.
    """
    static = labels == background
    windows = _windows(points.shape[1])
    judged = ~static | (labels < 0)
    moved, noise = _movements(points, visibility, static, judged, windows)
    parts = _parts(points, visibility, labels, static, windows, moved, noise)
    n_parts = int(parts.max(initial=-1)) + 1
    objects = np.where(static, 0, -1)
    if n_parts == 0:
        return objects
    joined = _joined(points, visibility, parts, n_parts, windows, moved, noise)
    objects = np.where(parts >= 0, joined[parts] + 1, objects)
    times = visibility.sum(axis=1)
    objects = ranked(objects, times)
    was = reappeared(points, visibility, objects)
    return ranked(np.where(objects > 0, was[objects], objects), times)


def ranked(objects, times):
    """The same with things numbered 1, 2, ..., those seen most often first.

    Parameters
    ----------
    objects, times : ndarray of int, shape (n_tracks,)
        The thing of each track, and how many frames see it.

    Returns
    -------
    ndarray of int, shape (n_tracks,)
    """
    things = objects > 0
    names, places = np.unique(objects[things], return_inverse=True)
    sizes = np.bincount(places, times[things], len(names))
    rank = np.empty(len(names), dtype=int)
    rank[np.argsort(-sizes, kind="stable")] = np.arange(1, len(names) + 1)
    ranked = objects.copy()
    ranked[things] = rank[places]
    return ranked


def _windows(n_frames):
    """First and last frames of windows that overlap by half."""
    length = min(WINDOW, n_frames) - 1
    starts = np.arange(0, n_frames - length, max(1, length // 2))
    if len(starts) > MOST_WINDOWS:
        starts = starts[np.linspace(0, len(starts) - 1, MOST_WINDOWS).astype(int)]
    return [(start, start + length) for start in starts] if length else []


def _movements(points, visibility, static, judged, windows):
    """Displacement of each track against the scene around it, window by window.

    Parameters
    ----------
    points, visibility
        Of all tracks.
    static : ndarray of bool, shape (n_tracks,)
        Tracks of the scene.
    judged : ndarray of bool, shape (n_tracks,)
        Tracks whose displacement is asked for.
    windows : list of (first, last)

    Returns
    -------
    moved : ndarray of shape (n_tracks, n_windows, 2)
        NaN where a track is not judged, or it or the scene is not seen.
    noise : ndarray of shape (n_tracks, n_windows)
    """
    moved = np.full((len(points), len(windows), 2), np.nan)
    noise = np.full((len(points), len(windows)), np.nan)
    for number, (first, last) in enumerate(windows):
        seen = visibility[:, first] & visibility[:, last]
        scene = np.flatnonzero(seen & static)
        rows = np.flatnonzero(seen & judged)
        if len(scene) < 3 or len(rows) == 0:
            continue
        steps = points[:, last] - points[:, first]
        n_neighbours = min(N_NEIGHBOURS, len(scene))
        _, near = KDTree(points[scene, first]).query(points[rows, first], n_neighbours)
        around = steps[scene[near]]  # (n_rows, n_neighbours, 2)
        middle = np.median(around, axis=1)
        spread = np.median(np.abs(around - middle[:, None]).sum(axis=2), axis=1)
        moved[rows, number] = steps[rows] - middle
        noise[rows, number] = NOISE + spread
    return moved, noise


def _parts(points, visibility, labels, static, windows, moved, noise):
    """Motions, and groups of rejected tracks that move: 0, 1, ...; -1 for no part."""
    rigid = (labels >= 0) & ~static
    names = np.unique(labels[rigid])
    parts = np.full(len(labels), -1)
    parts[rigid] = np.searchsorted(names, labels[rigid])
    length = np.hypot(moved[..., 0], moved[..., 1])
    judged = np.isfinite(length).any(axis=1)
    strength = np.zeros(len(labels))
    if judged.any():
        strength[judged] = np.nanmedian((length / noise)[judged], axis=1)
    rows = np.flatnonzero((labels < 0) & (strength > MOVES))
    groups = _groups(points, visibility, rows, windows, moved)
    sizes = np.bincount(groups, minlength=1)
    kept = np.flatnonzero(sizes >= LEAST_TRACKS)
    number = np.full(len(sizes), -1)
    number[kept] = len(names) + np.arange(len(kept))
    parts[rows] = number[groups]
    return parts


def _groups(points, visibility, rows, windows, moved):
    """Components of tracks that touch and move alike: (n_rows,)."""
    pairs = [np.empty((0, 2), dtype=int)]
    for number, (first, last) in enumerate(windows):
        here = rows[np.isfinite(moved[rows, number, 0])]
        if len(here) < 2:
            continue
        reach = _reach(points[visibility[:, first], first])
        touching = KDTree(points[here, first]).query_pairs(reach, output_type="ndarray")
        near = here[touching]
        steps = points[near, last] - points[near, first]  # (n_pairs, 2, 2)
        apart = np.linalg.norm(steps[:, 0] - steps[:, 1], axis=1)
        longest = np.linalg.norm(moved[near, number], axis=2).max(axis=1)
        pairs.append(near[apart < TOGETHER * longest])
    first, second = np.searchsorted(rows, np.concatenate(pairs)).T
    return _components(first, second, len(rows))


def _components(first, second, n):
    graph = coo_array((np.ones(len(first)), (first, second)), shape=(n, n))
    return connected_components(graph, directed=False)[1]


def _reach(points):
    """Distance within which tracks of a frame touch."""
    if len(points) < 2:
        return 0.0
    return TOUCH * float(np.median(KDTree(points).query(points, 2)[0][:, 1]))


def _joined(points, visibility, parts, n_parts, windows, moved, noise):
    """Thing of each part: numbers from 0."""
    sums = _sums(points, visibility, parts, n_parts, windows, moved, noise)
    length = np.linalg.norm(sums.path, axis=2)
    apart = np.linalg.norm(sums.apart, axis=2)
    alike = apart < TOGETHER * np.maximum(length, length.T)
    # At a joint, limb and body go together even where the limb turns.
    jointed = (sums.moves > 0) & (sums.together > sums.moves / 2)
    touch = (sums.both > 0) & (sums.touches >= sums.both / 2)
    one = touch & (alike | jointed)
    np.fill_diagonal(one, False)
    first, second = np.nonzero(one)
    return _components(first, second, n_parts)


class _Sums(NamedTuple):
    """What pairs of parts do in all windows.

    Attributes
    ----------
    both, touches : ndarray of shape (n_parts, n_parts)
        Windows in which both are seen, and touch.
    moves, together : ndarray of shape (n_parts, n_parts)
        Windows in which they touch and one or both move against the scene there, and
        in which they go together there.
    apart, path : ndarray of shape (n_parts, n_parts, 2)
        Sums of the difference of their movements, and of the first one's own against
        the scene, while both are seen.
    """

    both: np.ndarray
    touches: np.ndarray
    moves: np.ndarray
    together: np.ndarray
    apart: np.ndarray
    path: np.ndarray


def _sums(points, visibility, parts, n_parts, windows, moved, noise):
    flat = np.zeros((4, n_parts, n_parts))
    sums = _Sums(*flat, *np.zeros((2, n_parts, n_parts, 2)))
    for number, (first, last) in enumerate(windows):
        rows = np.flatnonzero((parts >= 0) & np.isfinite(moved[:, number, 0]))
        if len(rows) == 0:
            continue
        present = np.unique(parts[rows])
        pair = np.ix_(present, present)
        steps, own = points[rows, last] - points[rows, first], moved[rows, number]
        of = [parts[rows] == part for part in present]
        middle, against = (
            np.array([np.median(v[some], axis=0) for some in of]) for v in (steps, own)
        )
        sums.both[pair] += 1
        sums.apart[pair] += middle[:, None] - middle[None]
        sums.path[pair] += against[:, None]
        strength = np.linalg.norm(own, axis=1) / noise[rows, number]
        reach = _reach(points[visibility[:, first], first])
        joints = _Joints(points[rows, first], parts[rows], steps, own, strength)
        for values, found in zip(sums[1:4], joints.of(present, reach), strict=True):
            values[pair] += found
    return sums


class _Joints(NamedTuple):
    """Tracks of parts in a window: places, parts, movements and their strength."""

    places: np.ndarray
    parts: np.ndarray
    steps: np.ndarray
    own: np.ndarray
    strength: np.ndarray

    def of(self, present, reach):
        """Which parts touch, move where they do, and go together: (3, n, n)."""
        found = np.zeros((3, len(present), len(present)))
        rows = [np.flatnonzero(self.parts == part) for part in present]
        trees = [KDTree(self.places[some]) for some in rows]
        for i, j in combinations(range(len(present)), 2):
            if len(rows[i]) > len(rows[j]):
                i, j = j, i
            distance, nearest = trees[j].query(trees[i].data, 1)
            near = distance <= reach
            if near.mean() >= TOUCH_SHARE:
                answer = 1, *self._together(rows[i][near], rows[j][nearest[near]])
                found[:, i, j] = found[:, j, i] = answer
        return found

    def _together(self, first, second):
        """Whether tracks that touch move, and are at a joint.

        A joint is where the motions of both parts carry the picture to one place.
        """
        sides = np.stack([first, second])
        moves = np.median(self.strength[sides], axis=1).max() > MOVES
        middle = self.places[sides].mean(axis=0)
        carried = [self._carry(self.parts[side[0]], middle) for side in sides]
        apart = np.linalg.norm(carried[0] - carried[1], axis=1)
        length = np.linalg.norm(self.own[sides], axis=2).max(axis=0)
        joint = np.quantile(apart, JOINT_SHARE) < TOGETHER * np.median(length)
        return moves, moves and joint

    def _carry(self, part, places):
        """Movement (n, 2) at some places by the affine motion of a part."""
        own = self.parts == part
        steps, middle = self.steps[own], self.places[own].mean(axis=0)
        if len(steps) < LEAST_TRACKS:
            return np.broadcast_to(np.median(steps, axis=0), places.shape)
        at = np.column_stack([self.places[own] - middle, np.ones(len(steps))])
        affine = np.linalg.lstsq(at, steps, rcond=None)[0]
        misses = np.linalg.norm(at @ affine - steps, axis=1)
        well = misses <= max(NOISE, DRAGGED * np.median(misses))
        affine = np.linalg.lstsq(at[well], steps[well], rcond=None)[0]
        return np.column_stack([places - middle, np.ones(len(places))]) @ affine
