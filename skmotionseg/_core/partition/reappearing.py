"""Things that go behind others and come out again."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

# Frames over which movements are taken, for which a thing may be hidden, and before
# its return from which on it is followed, at most.
STEP, LONGEST_HIDDEN, LONGEST_FOLLOWED = 3, 12, 40
# Fewer tracks are no thing; fewer of the scene do not tell how it moves, and so many
# around a place do.
LEAST_TRACKS, FEWEST_STATIC, N_NEIGHBOURS = 12, 20, 48
# Share of its tracks by which the motion of a thing is told: those that are left at
# the end are at the edge of what hides it, and some go with that.
WELL_SEEN = 0.25
# Share of the tracks that one thing and its return are seen together at most.
MOST_TOGETHER = 0.3
# What comes out is where the thing is expected, within so many times the distance
# between its tracks, by this share of the tracks; and moves as it did, to this share.
REACH, MOST, ALIKE = 4.0, 0.5, 0.5


def reappeared(points, visibility, things):
    """Which thing each one was before it was hidden.

    Where a thing is hidden part by part, and comes out on the other side of what hides
    it, its tracks end and new ones begin that touch none of them. The old ones are
    carried on by its last motion against the scene. What begins among them, and moves
    like them, is the same thing.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
        Pixels; NaN where unseen.
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    things : ndarray of int, shape (n_tracks,)
        0 for the static scene, 1, 2, ... for things, -1 for none.

    Returns
    -------
    ndarray of int, shape (n_things + 1,)
        For each label the one that it was at first, mostly itself.
    """
    n_things = int(things.max(initial=0))
    rows = [np.flatnonzero(things == k) for k in range(n_things + 1)]
    counts = [visibility[own].sum(axis=0) for own in rows]
    known = [k for k in range(1, n_things + 1) if counts[k].max() >= LEAST_TRACKS]
    begins = {k: int((counts[k] >= LEAST_TRACKS).argmax()) for k in known}
    was = np.arange(n_things + 1)
    scene = _Tracks(points, visibility, rows[0])
    for new in sorted(known, key=lambda k: (begins[k], k)):
        begin = begins[new]
        for old in known:
            if old == new or not _may_be(counts[old], counts[new], begin):
                continue
            before = _Tracks(points, visibility, rows[old])
            after = _Tracks(points, visibility, rows[new])
            if _is_there(_carried(before, scene, begin), after, scene, begin):
                was[new] = was[old]
                break
    return was


def _may_be(old, new, begin):
    """Whether a thing was there before another begins, and gives way to it."""
    there = np.flatnonzero(old >= LEAST_TRACKS)
    return (
        there[0] <= begin - STEP
        and there[-1] >= begin - LONGEST_HIDDEN
        and begin + STEP < len(old)
        and hardly_together(old, new)
    )


def hardly_together(first, second):
    """Whether two things, by their tracks in each frame, are hardly seen together.

    Parameters
    ----------
    first, second : ndarray of int, shape (n_frames,)
        Some of each.

    Returns
    -------
    bool
    """
    together = np.minimum(first, second).sum() / min(first.sum(), second.sum())
    return bool(together <= MOST_TOGETHER)


class _Tracks:
    """Some of the tracks of a clip."""

    def __init__(self, points, visibility, rows):
        self._points, self._visibility, self._rows = points, visibility, rows

    def count(self, frame):
        return self._visibility[self._rows, frame].sum()

    def steps(self, first, last):
        """Places (n, 2) in one frame, and movements from there to another."""
        both = self._visibility[self._rows][:, [first, last]].all(axis=1)
        rows = self._rows[both]
        places = self._points[rows, first]
        return places, self._points[rows, last] - places

    def places(self, frame):
        rows = self._rows[self._visibility[self._rows, frame]]
        return self._points[rows, frame]

    def step_at(self, place, first, last):
        """Median movement (2,) of the tracks around a place; NaN for too few."""
        places, steps = self.steps(first, last)
        if len(places) < FEWEST_STATIC or not np.isfinite(place).all():
            return np.full(2, np.nan)
        distance = np.linalg.norm(places - place, axis=1)
        near = distance <= np.sort(distance)[min(N_NEIGHBOURS, len(places)) - 1]
        return np.median(steps[near], axis=0)


def _carried(tracks, scene, begin):
    """Where a thing's tracks are in a frame, and its movement per step, or None."""
    first = max(0, begin - LONGEST_FOLLOWED)
    counts = [tracks.count(frame) for frame in range(first, begin + 1)]
    frame = first + int(np.argmax(counts))
    full, places, own = max(counts), tracks.places(frame), None
    while frame < begin:
        following = min(frame + STEP, begin)
        length = following - frame
        here, steps = tracks.steps(frame, following)
        if len(here) >= max(LEAST_TRACKS, WELL_SEEN * full):
            around = scene.step_at(np.median(here, axis=0), frame, following)
            own = (np.median(steps, axis=0) - around) * STEP / length
        if own is None:
            return None
        around = scene.step_at(np.median(places, axis=0), frame, following)
        places = places + around + own * length / STEP
        frame = following
    return None if own is None else (places, own)


def _is_there(carried, after, scene, begin):
    """Whether what begins is where a thing is expected, and moves like it."""
    if carried is None or not np.isfinite(carried[0]).all() or len(carried[0]) < 2:
        return False
    expected, own = carried
    places, steps = after.steps(begin, begin + STEP)
    if len(places) < LEAST_TRACKS:
        return False
    tree = KDTree(expected)
    reach = REACH * np.median(tree.query(expected, 2)[0][:, 1])
    near = tree.query(places)[0] <= reach
    around = scene.step_at(np.median(places, axis=0), begin, begin + STEP)
    moved = np.median(steps, axis=0) - around
    apart = np.linalg.norm(moved - own)
    longer = max(np.linalg.norm(moved), np.linalg.norm(own))
    return bool(near.mean() >= MOST and apart < ALIKE * longer)
