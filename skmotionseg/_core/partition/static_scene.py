"""The static scene of a clip: the rigid motion that frames the picture.

In each window of frames the scene moves by one rigid motion, that of the camera, which
leaves each track one free number, its depth. That is too free where the camera hardly
moves: what moves before it is then explained by a depth. But the depths of a scene are
continuous from the margin of the picture inwards, if for nothing else along the ground,
and those that moving things seem to have are not.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from ..geometry.poses import Poses, lower_medians
from ..geometry.rigid_motion import (
    fit_rigid_motions,
    refine_rigid_motions,
)
from ..geometry.windows import LEAST_NOISE, REFERENCE_WIDTH, Windows

# Cells per side of the picture, over which tracks are spread to be fitted, and in which
# what a motion explains is counted; and tracks that are fitted.
N_CELLS, MOST_FITTED = 12, 120
# Tracks by which a motion is judged while it is still being found, twice.
MOST_SEEN = 500
# Tracks around one whose depths are compared with its own, and how many of them must be
# of the scene already to tell.
N_AROUND, FEWEST_AROUND = 16, 4
# Tracks with which a motion of the scene can begin, and share of the picture's side
# that is its margin.
FEWEST_TO_START, MARGIN = 20, 1 / 8
# A residual is large from so many deviations on, and pixels below which it never is.
LARGE, NEVER_LARGE = 3.0, 0.4
# Lens and shutter make a static scene look not quite rigid: by this share of the way
# that a track goes.
NOISE_PER_MOTION = 0.005
# A standard deviation over the median of residuals, and over that of absolute values.
SCALE_OF_MEDIAN, SCALE_OF_SPREAD = 1.2, 1.48


class StaticScene(NamedTuple):
    """How far tracks are from the static scene, window by window.

    Pixels are those of a video 640 pixels wide.

    Attributes
    ----------
    deviations : ndarray of shape (n_tracks, n_windows)
        Root mean square residuals from the scene's rigid motion, pixels; NaN where a
        track is seen too little, or there is no scene.
    steps : ndarray of shape (n_tracks, n_windows)
        By how much a track's depth differs from those of the scene around it, as the
        pixels by which that displaces it.
    noise : ndarray of shape (n_tracks, n_windows)
        Standard deviation of both for a track of the scene.
    members : ndarray of bool, shape (n_tracks, n_windows)
        Tracks that the motion explains, at depths that continue those of others.
    """

    deviations: np.ndarray
    steps: np.ndarray
    noise: np.ndarray
    members: np.ndarray


def fit_static_scene(windows: Windows, size, starts=()):
    """Find the static scene in each window of a clip.

    Its motion starts from all tracks, from those near the margin of the picture, from
    those near each of three of its sides, and from given groups. Of the motions found
    that one is taken whose members are the largest share of the picture and of its
    margin, by area and not by number.

    Parameters
    ----------
    windows : Windows
    size : tuple of (width, height)
        Of the picture, pixels.
    starts : sequence of ndarray of int
        Groups of tracks, one of which may be the scene.

    Returns
    -------
    StaticScene
    """
    shape = windows.freedom.shape
    scene = StaticScene(
        np.full(shape, np.nan),
        np.full(shape, np.nan),
        np.full(shape, LEAST_NOISE),
        np.zeros(shape, dtype=bool),
    )
    for number in range(shape[1]):
        window = _Window(windows, number, np.asarray(size))
        best = window.best_scene(starts)
        if best is not None:
            rows = window.rows
            scene.deviations[rows, number] = best.view.deviations
            scene.members[rows, number] = best.members
            scene.noise[rows, number] = window.noise(best.view)
            scene.steps[rows, number] = window.steps(best)
    return scene


class View(NamedTuple):
    """Tracks of a window as one rigid motion explains them.

    Attributes
    ----------
    deviations : ndarray of shape (n,)
        Root mean square residuals, pixels of a video 640 pixels wide.
    depths : ndarray of shape (n,)
        Inverse depths.
    shifts : ndarray of shape (n,)
        Pixels by which a unit of inverse depth displaces a track.
    """

    deviations: np.ndarray
    depths: np.ndarray
    shifts: np.ndarray


def view_of(windows, number, rows, poses):
    """Tracks of a window under given poses: :class:`View`.

    The point of each track is found by least squares, linear ones of which each
    observation is weighted by the distance that the sweep before has found.
    """
    x, seen = windows.x[number][rows], windows.seen[number][rows]
    rotations, translations = poses
    # A point (a, b, 1) / c of the reference frame is at M (a, b, c) + r in another.
    M = np.concatenate([rotations[:, :, :2], translations[:, :, None]], axis=2)
    r = rotations[:, :, 2]
    rays = [x * M[:, None, 2, k] - M[:, :2, k] for k in range(3)]  # (n, L, 2) each
    left = r[:, :2] - x * r[:, 2:]
    products = {(i, j): _dot(rays[i], rays[j]) for i in range(3) for j in range(i + 1)}
    sides = [_dot(ray, left) for ray in rays]  # (n, L) each
    weights = seen.astype(float)
    for _ in range(2):
        points = _weighted_solution(products, sides, weights**2)
        distance = points @ M[:, 2].T + r[:, 2]  # (n, L)
        distance = np.where(np.abs(distance) < 0.05, 0.05, distance)
        weights = seen / distance
    residuals = -left
    for ray, each in zip(rays, points.T, strict=True):
        residuals += ray * each[:, None, None]
    residuals *= weights[..., None]
    image = (points @ M[:, :2].reshape(-1, 3).T).reshape(*x.shape) + r[:, :2]
    image = image / distance[..., None]
    moved = (M[:, :2, 2] - image * M[:, 2:, 2]) * weights[..., None]
    moved = moved - seen[..., None] * (
        moved.sum(axis=1, keepdims=True) / seen.sum(axis=1)[:, None, None]
    )  # the same shift in all frames is no motion
    freedom = windows.freedom[rows, number]
    deviations, shifts = (
        windows.pixels * np.sqrt(np.einsum("nlk,nlk->n", values, values) / freedom)
        for values in (residuals, moved)
    )
    return View(deviations, points[:, 2], shifts)


def _dot(first, second):
    return first[..., 0] * second[..., 0] + first[..., 1] * second[..., 1]


def _weighted_solution(products, sides, weights):
    """Solutions (n, 3) of normal equations whose observations have weights (n, L)."""
    normal = {
        place: np.einsum("nl,nl->n", product, weights)
        for place, product in products.items()
    }
    damping = 1e-11 * sum(normal[i, i] for i in range(3)) + 1e-14
    for i in range(3):
        normal[i, i] += damping
    right = [np.einsum("nl,nl->n", side, weights) for side in sides]
    return np.stack(_solved(normal, right), axis=1)


def _solved(normal, right):
    """Solutions of 3 x 3 positive definite systems, by L D L'; stacks of these.

    Written out, as a call of LAPACK for each takes several times as long.
    """
    d0 = normal[0, 0]
    l1, l2 = normal[1, 0] / d0, normal[2, 0] / d0
    d1 = normal[1, 1] - l1 * normal[1, 0]
    left = normal[2, 1] - l2 * normal[1, 0]
    l21 = left / d1
    d2 = normal[2, 2] - l2 * normal[2, 0] - l21 * left
    y1 = right[1] - l1 * right[0]
    z = (right[2] - l2 * right[0] - l21 * y1) / d2
    y = y1 / d1 - l21 * z
    return right[0] / d0 - l1 * y - l2 * z, y, z


class _Found(NamedTuple):
    """A motion that may be the scene's."""

    score: float
    view: View
    members: np.ndarray
    tolerance: float


class _Window:
    """The tracks of one window, by their places in it.

    Attributes
    ----------
    rows : ndarray of int, shape (n,)
        The tracks that are seen often enough; all else here is of these.
    """

    def __init__(self, windows, number, size):
        self._windows, self._number = windows, number
        self.rows = np.flatnonzero(windows.freedom[:, number])
        frames, seen = windows.frames[number], windows.seen[number][self.rows]
        places = windows.points[self.rows][:, frames]
        self._places = np.where(seen[..., None], places, 0)
        counts = np.maximum(seen.sum(axis=1), 1)[:, None]
        self._centres = self._places.sum(axis=1) / counts
        masked = np.where(seen[..., None], places, np.nan)
        self._ways = np.zeros(len(self.rows))
        if len(self.rows):
            span = np.nanmax(masked, axis=1) - np.nanmin(masked, axis=1)
            self._ways = np.linalg.norm(span, axis=1) * REFERENCE_WIDTH / size.max()
        often = seen.sum(axis=0) >= 0.8 * seen.sum(axis=0).max(initial=0)
        middle = (len(frames) - 1) // 2
        some = np.flatnonzero(often)
        self._reference = int(some[np.abs(some - middle).argmin()])
        self._there = seen[:, self._reference]
        share = (self._centres / size).clip(0, 1 - 1e-9)
        self._share = share
        row_column = (share * N_CELLS).astype(int)
        self._cells = row_column[:, 1] * N_CELLS + row_column[:, 0]

    # ------------------------------------------------------------------------ motions

    def best_scene(self, starts):
        """The motion whose members frame and fill the picture; None without any."""
        if self._there.sum() < FEWEST_TO_START:
            return None
        n_around = min(N_AROUND, len(self.rows) - 1)
        tree = KDTree(self._centres)
        self._around = tree.query(self._centres, n_around + 1)[1][:, 1:]
        self._links = np.argsort(self._around, axis=None, kind="stable")
        counts = np.bincount(self._around.ravel(), minlength=len(self.rows))
        self._first_link = np.append(0, counts.cumsum())
        starts = [
            some for some in self._starts(starts) if some.sum() >= FEWEST_TO_START
        ]
        if not starts:
            return None
        poses = self._begun(starts)
        views = self._views(poses)
        for _ in range(2):
            poses = self._refit([self._members(view)[0] for view in views], poses)
            views = self._views(poses)
        return max(map(self._found, views), key=lambda each: each.score)

    def _found(self, view):
        members, tolerance = self._members(view)
        return _Found(self._extent(members), view, members, tolerance)

    def _starts(self, groups):
        """Which tracks the motion is fitted to at first, in several ways."""
        x, y = self._share.T
        margin = self._margin(MARGIN)
        yield self._there
        for some in (margin, x < 1 / 4, x > 3 / 4, y < 1 / 3):
            yield self._there & some
        for group in groups:
            yield self._there & np.isin(self.rows, group)

    def _margin(self, share):
        return ((self._share < share) | (self._share > 1 - share)).any(axis=1)

    def _begun(self, starts):
        """Poses of the motion from each start, which some of the tracks judge."""
        poses = self._fit(starts)
        some = [self._some_of(start) for start in starts]
        for _ in range(3):
            well = list(map(self._explained, starts, some, poses))
            poses = self._refit(well, poses)
        return poses

    def _explained(self, start, some, poses):
        """Which of some tracks are as near to a motion as most that it began with."""
        deviations = self._view(poses, some).deviations
        own = np.sort(deviations[start[some]])
        usual = np.median(own[: int(0.7 * len(own)) + 1])
        well = np.zeros(len(self.rows), dtype=bool)
        well[some] = deviations < max(NEVER_LARGE, LARGE * usual)
        return well

    def _fit(self, groups):
        """Poses of each of some groups of tracks, from several starts."""
        x, seen, weights, floor = self._problem(groups)
        fitted = fit_rigid_motions(x, seen, weights, floor, self._reference)
        return [Poses(*each) for each in zip(*fitted, strict=True)]

    def _refit(self, groups, poses):
        """Poses of groups of tracks, from given ones; these, where tracks are few."""
        groups = [group & self._there for group in groups]
        enough = [k for k, group in enumerate(groups) if group.sum() >= FEWEST_TO_START]
        poses = list(poses)
        if not enough:
            return poses
        stacked = Poses(*map(np.stack, zip(*(poses[k] for k in enough), strict=True)))
        x, seen, weights, floor = self._problem([groups[k] for k in enough])
        fitted, _ = refine_rigid_motions(
            x, seen, weights, floor, self._reference, stacked
        )
        for k, *pose in zip(enough, *fitted, strict=True):
            poses[k] = Poses(*pose)
        return poses

    def _problem(self, groups):
        """Coordinates, visibility, weights and floor of each group, spread over it."""
        chosen = [self.rows[self._spread(np.flatnonzero(group))] for group in groups]
        windows, most = self._windows, max(map(len, chosen))
        n_frames = windows.frames.shape[1]
        x = np.zeros((len(groups), most, n_frames, 2))
        seen = np.zeros((len(groups), most, n_frames), dtype=bool)
        weights = np.zeros((len(groups), most))
        for k, rows in enumerate(chosen):
            x[k, : len(rows)] = windows.x[self._number][rows]
            seen[k, : len(rows)] = windows.seen[self._number][rows]
            weights[k, : len(rows)] = 1
        return x, seen, weights, np.full(len(groups), windows.least_noise)

    def _spread(self, tracks):
        """At most so many of some tracks, as equally from all cells as can be."""
        if len(tracks) <= MOST_FITTED:
            return tracks
        x, y = self._centres[tracks].T
        cells = self._cells[tracks]
        order = np.lexsort((y, x, cells))
        new = np.append(True, np.diff(cells[order]) != 0)
        places = np.arange(len(tracks))
        rank = places - np.maximum.accumulate(np.where(new, places, 0))
        return np.sort(tracks[order[np.argsort(rank, kind="stable")[:MOST_FITTED]]])

    def _view(self, poses, some=slice(None)):
        return view_of(self._windows, self._number, self.rows[some], poses)

    def _views(self, poses):
        return [self._view(each) for each in poses]

    def _some_of(self, start):
        """Some tracks, half of them of those that a motion starts from."""
        both = [
            tracks[
                np.linspace(0, len(tracks) - 1, min(len(tracks), MOST_SEEN)).astype(int)
            ]
            for tracks in (np.flatnonzero(start), np.arange(len(start)))
        ]
        return np.union1d(*both)

    # ------------------------------------------------------------------------ members

    def _members(self, view):
        """Tracks of the scene (n,), and by how many pixels their depths may step.

        From the margin of the picture inwards: of those that the motion explains, each
        one whose depth is that of most of the scene's tracks around it.
        """
        explained = view.deviations < LARGE * self._noise_of(view)
        steps = np.abs(view.depths[self._around] - view.depths[:, None])
        steps *= view.shifts[:, None]
        usual = lower_medians(steps, explained[self._around])[explained]
        usual = usual[np.isfinite(usual)]
        usual = float(np.median(usual)) if len(usual) else 0.0
        noise = np.hypot(self._noise_of(view), SCALE_OF_SPREAD * usual)
        agree = steps < LARGE * noise
        members = explained & self._margin(2 / 3 * MARGIN)
        n_around, n_agree = self._counts(members, agree)
        members &= (n_around < FEWEST_AROUND) | (2 * n_agree >= n_around)
        return self._grown(members, explained, agree), noise

    def _grown(self, members, explained, agree):
        """Members, and what joins them track by track, most around it agreeing.

        Counts change around those that have just joined, and nowhere else.
        """
        members, fresh = members.copy(), np.flatnonzero(members)
        n, n_here = len(members), self._around.shape[1]
        n_around, n_agree = np.zeros((2, n), dtype=int)
        agree = agree.ravel()
        while len(fresh):
            links = self._links_to(fresh)
            n_around += np.bincount(links // n_here, minlength=n)
            n_agree += np.bincount(links[agree[links]] // n_here, minlength=n)
            joined = explained & ~members & (n_around >= FEWEST_AROUND)
            fresh = np.flatnonzero(joined & (2 * n_agree > n_around))
            members[fresh] = True
        return members

    def _links_to(self, tracks):
        """Places in ``around``, ravelled, where it names one of some tracks."""
        first, last = self._first_link[tracks], self._first_link[tracks + 1]
        lengths = last - first
        ahead = np.repeat(first - (lengths.cumsum() - lengths), lengths)
        return self._links[ahead + np.arange(lengths.sum())]

    def _counts(self, members, agree):
        """How many around each track are members, and how many of these agree."""
        around = members[self._around]
        return around.sum(axis=1), (around & agree).sum(axis=1)

    @staticmethod
    def _noise_of(view):
        """Standard deviation of the residuals of what a motion explains."""
        well = view.deviations < LARGE * LEAST_NOISE
        usual = np.median(view.deviations[well]) if well.any() else 0.0
        return max(LEAST_NOISE, SCALE_OF_MEDIAN * float(usual))

    def _extent(self, members):
        """Share of the picture and of its margin that members are, cell by cell."""
        n_cells = N_CELLS**2
        total = np.bincount(self._cells, minlength=n_cells)
        share = np.bincount(self._cells, members, n_cells) / np.maximum(total, 1)
        known = total > 0
        row, column = np.divmod(np.arange(n_cells), N_CELLS)
        ends = (0, N_CELLS - 1)
        margin = np.isin(row, ends) | np.isin(column, ends)
        at_margin = share[margin & known]
        return share[known].mean() + (at_margin.mean() if len(at_margin) else 0)

    def noise(self, view):
        """Standard deviation of each track's residuals, were it of the scene."""
        return np.hypot(self._noise_of(view), NOISE_PER_MOTION * self._ways)

    def steps(self, found):
        """By how many pixels depths differ from those of the nearest members.

        As much as these differ among themselves does not count.
        """
        view, members = found.view, np.flatnonzero(found.members)
        if len(members) <= N_AROUND:
            return np.zeros(len(self.rows))
        _, near = KDTree(self._centres[members]).query(self._centres, N_AROUND)
        depths = view.depths[members[near]]
        middle = np.median(depths, axis=1)
        spread = np.median(np.abs(depths - middle[:, None]), axis=1)
        steps = np.abs(view.depths - middle) * view.shifts
        usual = np.hypot(SCALE_OF_SPREAD * spread * view.shifts, found.tolerance)
        return steps * self._noise_of(view) / usual
