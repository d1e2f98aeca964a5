"""The last frames of a stream: tracks in them, and rigid motions fitted to groups."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..geometry.poses import Poses, relative_to
from ..geometry.resection import inverse_depths, next_poses, resect
from ..geometry.rigid_motion import (
    camera_information,
    fit_rigid_motions,
    refine_rigid_motions,
    squared_residuals,
)
from ..geometry.rigid_motion import inverse_depths as track_depths
from ..geometry.windows import FEWEST_SEEN, NOISE_PER_MOTION, freedom_of_tracks

# Frames that are looked at: those in which a usual track lives on, and depth shows.
LENGTH = 12
# Tracks that determine a motion, and to how many it is fitted at most.
FEWEST_TRACKS = 4
MOST_FITTED = 40
# Iterations from given poses, which are nearly right.
ITERATIONS = 4
# Share of the numbers that it is fitted to that a motion has of its own, at most.
MOST_LEVERAGE = 0.8
# A reference frame sees this share of a group's tracks that the newest frame sees.
SHARE_IN_REFERENCE = 0.7


class Fit(NamedTuple):
    """A rigid motion over the window.

    Attributes
    ----------
    poses : Poses
        Of one motion: rotations (L, 3, 3) and translations (L, 3).
    valid : ndarray of bool, shape (L,)
        Frames in which enough of its tracks are seen.
    """

    poses: Poses
    valid: np.ndarray


class Window:
    """Tracks in the last frames, calibrated.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, L, 2)
        Pixels.
    seen : ndarray of bool, shape (n_tracks, L)
    camera : Camera

    Attributes
    ----------
    freedom : ndarray of int, shape (n_tracks,)
        Residuals of each track less the three numbers that place it; 0 where it is seen
        too little to be judged.
    variances : ndarray of shape (n_tracks,)
        Of residuals, over that of a track that is at rest in the image.
    """

    def __init__(self, points, seen, camera):
        self.camera, self.seen, self._points = camera, seen, points
        self.x = np.where(seen[..., None], camera.calibrated(points), 0)
        self.freedom = freedom_of_tracks(seen)
        noise = NOISE_PER_MOTION * self._speeds() / (camera.unit * camera.noise)
        self.variances = 1 + noise**2

    def _speeds(self):
        """Mean distances (n,) of tracks from one frame to the next, pixels."""
        both = self.seen[:, 1:] & self.seen[:, :-1]
        steps = np.linalg.norm(np.diff(self._points, axis=1), axis=2)
        return np.where(both, steps, 0).sum(axis=1) / np.maximum(both.sum(axis=1), 1)

    def seen_by(self, camera):
        """The same tracks, as another camera sees them."""
        return Window(self._points, self.seen, camera)

    def fit(self, groups, starts=None):
        """Motions of groups of tracks, from several starts or from given poses.

        Parameters
        ----------
        groups : list of ndarray of int
        starts : list of Fit, optional

        Returns
        -------
        list of Fit or None
            None where too few tracks are seen.
        """
        return fit_motions([(self, rows) for rows in groups], starts)

    def camera_information(self, groups, fits):
        """What motions of groups tell of the focal length and of the lens.

        Parameters
        ----------
        groups : list of ndarray of int
        fits : list of Fit

        Returns
        -------
        information : ndarray of shape (2, 2)
            Of the logarithm of the focal length and the bend of the lens.
        gradient : ndarray of shape (2,)
            As of :func:`~..geometry.rigid_motion.camera_information`.
        """
        which, problems = _problems([(self, rows) for rows in groups])
        if not which:
            return np.zeros((2, 2)), np.zeros(2)
        found = camera_information(
            **problems,
            poses=_stack([fits[k].poses for k in which]),
            derivatives=self.camera.derivatives,
        )
        return tuple(each.sum(axis=0) for each in found)

    def advance(self, groups, fits):
        """Motions with a pose in the newest frame, which was none of theirs.

        Parameters
        ----------
        groups : list of ndarray of int
            Tracks of each motion.
        fits : list of Fit
            Over the frames before: the last of them is the one before the newest.

        Returns
        -------
        list of Fit
            The newest frame is not valid yet. By resection, from constant speed and
            from rest; constant speed where too few tracks are seen.
        """
        if not fits:
            return []
        stacked, before = _stack([fit.poses for fit in fits]), _valid(fits)
        moved = next_poses(stacked, before)
        slid = Poses(
            *(
                np.concatenate([old[:, 1:], new[:, None]], axis=1)
                for old, new in zip(stacked, moved, strict=True)
            )
        )
        valid = np.pad(before[:, 1:], ((0, 0), (0, 1)))
        jobs = [
            (k, *job)
            for k, rows in enumerate(groups)
            if (job := self._resectable(rows, valid[k])) is not None
        ]
        if jobs:
            self._resect(jobs, slid, valid)
        each = zip(*slid, valid, strict=True)
        return [Fit(Poses(*pose), some) for *pose, some in each]

    def squares(self, fits, rows=None):
        """Squared residuals of tracks from motions, and of how many numbers.

        Parameters
        ----------
        fits : list of Fit
        rows : ndarray of int, optional
            All tracks if not given.

        Returns
        -------
        squares : ndarray of shape (n, M)
            NaN where a track is seen too little in the frames of a motion.
        freedom : ndarray of shape (n, M)
        """
        rows = np.arange(len(self.x)) if rows is None else rows
        squares = np.full((len(rows), len(fits)), np.nan)
        freedom = np.zeros(squares.shape)
        alike: dict[bytes, list[int]] = {}
        for k, fit in enumerate(fits):
            alike.setdefault(fit.valid.tobytes(), []).append(k)
        for some in alike.values():
            seen = self.seen[rows] & fits[some[0]].valid
            times = seen.sum(axis=1)
            known = np.flatnonzero(times >= FEWEST_SEEN)
            if len(known) == 0:
                continue
            x = np.where(seen[known, :, None], self.x[rows[known]], 0)
            poses = _stack([fits[k].poses for k in some])
            place = np.ix_(known, np.array(some))
            squares[place] = squared_residuals(x, seen[known], poses).T
            freedom[place] = (2 * times[known] - 3)[:, None]
        return squares, freedom

    def inverse_depths(self, fit, rows):
        """Inverse depths of some tracks by a motion.

        Returns
        -------
        depths, errors : ndarray of shape (n,)
            In units of its own, and their standard deviations where that of a residual
            is 1; NaN where a track is seen too little.
        """
        found = np.full((2, len(rows)), np.nan)
        seen = self.seen[rows] & fit.valid
        known = seen.sum(axis=1) >= FEWEST_SEEN
        if known.any():
            x = np.where(seen[known, :, None], self.x[rows[known]], 0)
            depths = track_depths(x, seen[known], _stack([fit.poses]))
            found[:, known] = np.concatenate(depths)
        return tuple(found)

    def inflation(self, rows, fit):
        """How many times larger squared residuals are than those of a fit to tracks.

        A motion of few tracks follows their noise. What is left of a residual is one
        less its leverage: on average the share of the numbers fitted to that the motion
        has of its own.

        Parameters
        ----------
        rows : ndarray of int
            Tracks that the motion was fitted to.
        fit : Fit

        Returns
        -------
        float
        """
        numbers = self.freedom[rows].sum()
        numbers *= min(1.0, MOST_FITTED / max(len(rows), 1))
        leverage = self.own_numbers(fit) / max(numbers, 1)
        return 1 / (1 - min(leverage, MOST_LEVERAGE)) ** 2

    @staticmethod
    def own_numbers(fit):
        """Numbers that a motion has: six per frame but the first, less its scale."""
        return max(6 * (int(fit.valid.sum()) - 1) - 1, 0)

    def some(self, rows):
        """A reference frame, and tracks seen in it that a motion is fitted to."""
        seen = self.seen[rows]
        frames = np.flatnonzero(seen.any(axis=0))
        if len(frames) < FEWEST_SEEN:
            return 0, rows[:0]
        reference = _reference(seen, frames[-1], frames)
        rows = rows[seen[:, reference] & (seen.sum(axis=1) >= FEWEST_SEEN)]
        if len(rows) > MOST_FITTED:  # spread over the image
            x, y = self.x[rows, reference].T
            places = np.linspace(0, len(rows) - 1, MOST_FITTED).astype(int)
            rows = rows[np.lexsort((y, x))][places]
        return reference, rows

    def _resectable(self, rows, valid):
        """A reference frame and tracks seen in it and in the newest; None if few."""
        rows = rows[self.seen[rows, -1]]
        frames = np.flatnonzero(valid)
        if len(frames) < FEWEST_SEEN or len(rows) < FEWEST_TRACKS:
            return None
        seen = self.seen[rows]
        reference = _reference(seen, frames[-1], frames)
        rows = rows[seen[:, reference] & ((seen & valid).sum(axis=1) >= FEWEST_SEEN)]
        return (reference, rows) if len(rows) >= FEWEST_TRACKS else None

    def _resect(self, jobs, poses, valid):
        """Set the newest poses of some motions, in place."""
        which = np.array([job[0] for job in jobs])
        references = np.array([job[1] for job in jobs])
        x, seen, weights = _stacked([(self, job[2]) for job in jobs])
        batch = np.arange(len(which))
        some = relative_to(Poses(*(each[which] for each in poses)), references)
        rays = np.ones((*x.shape[:2], 3))
        rays[..., :2] = x[batch, :, references]
        depths = inverse_depths(rays, x, seen & valid[which][:, None], some)
        starts = [np.concatenate([each[:, -1], each[:, -2]]) for each in some]
        R, t, medians = resect(
            _twice(rays),
            _twice(depths),
            _twice(x[:, :, -1]),
            _twice(weights * seen[..., -1]),
            starts,
            self.camera.noise,
        )
        best = batch + len(which) * (medians[len(which) :] < medians[: len(which)])
        some.rotations[:, -1], some.translations[:, -1] = R[best], t[best]
        for all_poses, new in zip(poses, some, strict=True):
            all_poses[which] = new


def fit_motions(jobs, starts=None):
    """Motions of groups of tracks, each of a window: all are fitted at once.

    Parameters
    ----------
    jobs : list of (Window, ndarray of int)
    starts : list of Fit, optional
        As of :meth:`Window.fit`.

    Returns
    -------
    list of Fit or None
    """
    found: list = [None] * len(jobs)
    which, problems = _problems(jobs)
    if not which:
        return found
    if starts is None:
        poses = fit_rigid_motions(**problems)
    else:
        begin = _stack([starts[k].poses for k in which])
        poses, _ = refine_rigid_motions(**problems, poses=begin, iterations=ITERATIONS)
    valid = problems["seen"].sum(axis=1) >= FEWEST_TRACKS  # (B, L)
    for k, some, *pose in zip(which, valid, *poses, strict=True):
        found[k] = Fit(Poses(*pose), some)
    return found


def _problems(jobs) -> tuple[list[int], dict[str, Any]]:
    """What rigid motions are fitted to, and of which jobs: those of enough tracks."""
    some = [(window, *window.some(rows)) for window, rows in jobs]
    which = [k for k, job in enumerate(some) if len(job[2]) >= FEWEST_TRACKS]
    if not which:
        return which, {}
    x, seen, weights = _stacked([(some[k][0], some[k][2]) for k in which])
    return which, {
        "x": x,
        "seen": seen,
        "weights": weights,
        "floor": np.array([some[k][0].camera.noise for k in which]),
        "reference": np.array([some[k][1] for k in which]),
    }


def _stacked(jobs):
    """Coordinates, visibility and weights of some groups of windows, padded."""
    most = max(len(rows) for _, rows in jobs)
    x = np.zeros((len(jobs), most, *jobs[0][0].x.shape[1:]))
    seen = np.zeros(x.shape[:3], dtype=bool)
    weights = np.zeros(x.shape[:2])
    for k, (window, rows) in enumerate(jobs):
        x[k, : len(rows)] = window.x[rows]
        seen[k, : len(rows)] = window.seen[rows]
        weights[k, : len(rows)] = 1
    return x, seen, weights


def _reference(seen, newest, frames):
    """Of the frames with most tracks that the newest sees, the one in the middle."""
    often = (seen & seen[:, [newest]]).sum(axis=0)[frames]
    often = frames[often >= SHARE_IN_REFERENCE * often.max()]
    return int(often[np.abs(often - (seen.shape[1] - 1) // 2).argmin()])


def _twice(values):
    return np.concatenate([values, values])


def _valid(fits):
    return np.array([fit.valid for fit in fits])


def _stack(poses):
    return Poses(*map(np.stack, zip(*poses, strict=True)))
