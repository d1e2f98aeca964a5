"""Rigid motions of groups of tracks over windows of a clip.

A window is a few frames, some frames apart: noise of trackers drifts, so neighbouring
frames tell little more than one, and motions differ more the longer they are watched.
"""

from __future__ import annotations

from copy import copy
from typing import NamedTuple

import numpy as np

from .camera import LEAST_NOISE, REFERENCE_WIDTH
from .poses import Poses, refocused
from .rigid_motion import (
    fit_rigid_motions,
    inverse_depths,
    refine_rigid_motions,
    squared_residuals,
)
from .tracks import covered

# Frames per window, and frames from one to the next, unless tracks live too briefly.
WINDOW_FRAMES = 6
WINDOW_STRIDE = 3
# The same in the longer windows that judge what was found: they tell better what moves
# slowly, but of what turns or drives fast, fits are harder to reach.
JUDGING_STRIDE = 5
# Frames of the longest clip that is shorter than a window of frames so far apart.
LONGEST_SHORT = WINDOW_STRIDE * (WINDOW_FRAMES - 1)
# Frames of a window in which a track must be seen, and tracks that make a motion.
FEWEST_SEEN = 3
FEWEST_TRACKS = 5
# Windows that are added at most for tracks that are seen too little in the usual ones,
# such tracks that one is added for, and the share of their links that is to each other.
MOST_MORE, FEWEST_MISSED, MOST_LINKS = 3, 10, 0.75
# A reference frame sees this share of a group's tracks that any frame sees, or more.
SHARE_IN_REFERENCE = 0.8
# Tracks of a group that its motion is fitted to, and problems solved at a time.
MOST_FITTED = 40
BATCH = 16
# Standard deviation of residuals per distance that a track moves from frame to frame:
# what moves fast before a camera comes near or goes away, and is tracked less well, and
# lens and shutter make it look not quite rigid. In clips that are filmed from cars, the
# rank correlation of speeds and residuals within the static scene is 0.4 to 0.8.
NOISE_PER_MOTION = 0.01
# Focal lengths that are tried, as shares of the larger side of what tracks cover, and
# factors by which the best of them is improved.
FOCAL_LENGTHS = (0.4, 0.6, 1.0, 1.7)
FOCAL_STEPS = (1.25, 1.12, 1.06)


class FitRequest(NamedTuple):
    """A motion of a group that is asked for.

    Attributes
    ----------
    group : ndarray of int
    starts : tuple of RigidMotion
        As :meth:`Windows.refine` takes them; none for a fit from several starts of its
        own, as by :meth:`Windows.fit`.
    most_tracks : int
    """

    group: np.ndarray
    starts: tuple = ()
    most_tracks: int = MOST_FITTED

    @property
    def key(self):
        """The same for the same fit, as long as its starts are not thrown away."""
        return self.group.tobytes(), tuple(map(id, self.starts)), self.most_tracks


class RigidMotion(NamedTuple):
    """The motion of a group in each window, and how far all tracks are from it.

    Attributes
    ----------
    poses : tuple of Poses or None
        Of one motion per window; None where too few of the group's tracks are seen.
    squares : ndarray of shape (n_tracks, n_windows)
        Squared residuals in calibrated coordinates, summed over the window; NaN where
        there is no motion, or the track is seen too little.
    tracks : ndarray of int
        The group.
    deviations : ndarray of shape (2, n_tracks)
        Root mean square residuals in calibrated coordinates, and those over what is
        usual at a track's speed; 0 where nothing is known.
    known : ndarray of int, shape (n_tracks,)
        Of how many residuals, less the numbers that place a track.
    """

    poses: tuple[Poses | None, ...]
    squares: np.ndarray
    tracks: np.ndarray
    deviations: np.ndarray
    known: np.ndarray

    def refocused(self, ratio):
        """To start from with another focal length: that in use is so many times it."""
        return self.with_poses(each and refocused(each, ratio) for each in self.poses)

    def with_poses(self, poses):
        """To start from with other poses, of which no residuals are known yet."""
        return self._replace(poses=tuple(poses))


class Windows:
    """The tracks of a clip in the windows in which rigid motions are fitted.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
        Pixels.
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    focal_length : float
        As a share of the larger side of what the tracks cover. The principal point is
        taken to be its middle.
    frames : ndarray of int, shape (n_windows, n_frames_per_window), optional
        By default as of :func:`window_frames`.

    Attributes
    ----------
    frames : ndarray of int, shape (n_windows, n_frames_per_window)
    size : float
        The larger side of what the tracks cover, pixels.
    seen : ndarray of bool, shape (n_windows, n_tracks, n_frames_per_window)
    freedom : ndarray of int, shape (n_tracks, n_windows)
        Residuals of each track less the three numbers that place it; 0 where it is seen
        too little.
    variances : ndarray of shape (n_tracks, n_windows)
        Of residuals, over that of a track that is at rest in the image.
    pixels : float
        Pixels, in a video 640 pixels wide, per calibrated unit.
    """

    def __init__(self, points, visibility, focal_length=1.0, frames=None):
        self.frames = window_frames(visibility) if frames is None else frames
        low, high = covered(points, visibility)
        self._middle, self.size = (low + high) / 2, float((high - low).max()) or 1.0
        self._look_at(points, visibility)
        self.set_focal_length(focal_length)

    def of(self, points, visibility):
        """The same windows and camera with other tracks.

        Parameters
        ----------
        points : ndarray of shape (m, n_frames, 2)
        visibility : ndarray of bool, shape (m, n_frames)

        Returns
        -------
        Windows
        """
        other = copy(self)
        other._look_at(points, visibility)
        other.set_focal_length(self.focal_length)
        return other

    def longer(self):
        """The same tracks in windows of frames that are farther apart.

        Together they see the whole clip: something may move in its last frames alone.
        So they are stretched, by a third at most, where they would leave some out.

        Returns
        -------
        Windows or None
            None where the clip, or the life of its tracks, is too short for any.
        """
        frames = self._longer_frames()
        if frames is None:
            return None
        longer = copy(self)
        longer.frames = _stretched(frames, self.visibility.shape[1])
        return longer.of(self.points, self.visibility)

    @property
    def are_longest(self):
        """Whether there are no :meth:`longer` ones."""
        return self._longer_frames() is None

    def _longer_frames(self):
        """Frames farther apart, before they are stretched; None if there are none."""
        frames = window_frames(self.visibility, JUDGING_STRIDE)
        return frames if np.ptp(frames[0]) > np.ptp(self.frames[0]) else None

    def motions_again(self, motions):
        """Motions found with other tracks, with the residuals of these tracks."""
        poses = [motion.poses for motion in motions]
        return self._motions([motion.tracks for motion in motions], poses)

    def _look_at(self, points, visibility):
        """Take tracks."""
        self.points, self.visibility = points, visibility
        self.seen = np.stack([visibility[:, frames] for frames in self.frames])
        self.freedom = freedom_of_tracks(self.seen).T
        speeds = np.stack([self._speeds(k) for k in range(len(self.frames))], axis=1)
        noise = NOISE_PER_MOTION * speeds * REFERENCE_WIDTH / self.size
        self.variances = 1 + (noise / LEAST_NOISE) ** 2

    def _speeds(self, window):
        """Mean distances (n,) of tracks from one frame to the next, pixels."""
        frames, seen = self.frames[window], self.seen[window]
        places = np.where(seen[..., None], self.points[:, frames], 0)
        both = seen[:, 1:] & seen[:, :-1]
        steps = np.linalg.norm(np.diff(places, axis=1), axis=2) / np.diff(frames)
        return np.where(both, steps, 0).sum(axis=1) / np.maximum(both.sum(axis=1), 1)

    def set_focal_length(self, share):
        """Calibrate coordinates with another focal length."""
        self.focal_length = share
        unit = share * self.size
        self.pixels = REFERENCE_WIDTH * share
        self.least_noise = LEAST_NOISE / self.pixels
        calibrated = (self.points - self._middle) / unit
        self.x = np.stack(
            [
                np.where(seen[..., None], calibrated[:, frames], 0)
                for frames, seen in zip(self.frames, self.seen, strict=True)
            ]
        )  # (W, n, L, 2)

    def fit(self, groups, most_tracks=MOST_FITTED):
        """Motions of groups of tracks, from several starts each.

        Parameters
        ----------
        groups : list of ndarray of int
        most_tracks : int or list of int
            Tracks of a group that its motion is fitted to, by group where they differ.

        Returns
        -------
        list of RigidMotion
        """
        jobs = self._jobs(groups, most_tracks)
        return self._motions(groups, self._poses_anew(jobs, len(groups)))

    def _poses_anew(self, jobs, n_groups):
        """Poses of each group in each window, from several starts; None of no job."""
        poses = [[None] * len(self.frames) for _ in range(n_groups)]
        for some in _batches(jobs):
            x, seen, weights, floor, references = self._stacked(some)
            fitted = fit_rigid_motions(x, seen, weights, floor, references, MOST_FITTED)
            for job, *pose in zip(some, *fitted, strict=True):
                poses[job.group][job.window] = Poses(*pose)
        return poses

    def refine(self, groups, starts, most_tracks=MOST_FITTED):
        """Motions of groups, from the motions of others.

        Parameters
        ----------
        groups : list of ndarray of int
        starts : list of list of RigidMotion
            For each group.
        most_tracks : int
            As for :meth:`fit`.

        Returns
        -------
        list of RigidMotion
            The best of the starts, for each group and window. Where none of these has
            poses, fitted anew: the tracks that they come from may not be seen there.
        """
        jobs = self._jobs(groups, most_tracks)
        silent = [job for job in jobs if not _poses_in(job.window, starts[job.group])]
        poses = self._poses_anew(silent, len(groups))
        begun = [
            job._replace(start=start)
            for job in jobs
            for start in _poses_in(job.window, starts[job.group])
        ]
        least: dict[tuple[int, int], float] = {}
        for some in _batches(begun):
            x, seen, weights, floor, references = self._stacked(some)
            stacked = Poses(
                *map(np.stack, zip(*(job.start for job in some), strict=True))
            )
            fitted, costs = refine_rigid_motions(
                x, seen, weights, floor, references, stacked
            )
            for job, cost, *pose in zip(some, costs, *fitted, strict=True):
                place = job.group, job.window
                if cost < least.get(place, np.inf):
                    least[place] = cost
                    poses[job.group][job.window] = Poses(*pose)
        return self._motions(groups, poses)

    def found(self, fits):
        """The motions of several :class:`FitRequest`, found in common batches.

        Parameters
        ----------
        fits : list of FitRequest

        Returns
        -------
        list of RigidMotion
        """
        new = [fit for fit in fits if not fit.starts]
        old = [fit for fit in fits if fit.starts]
        fitted = iter(self.fit([fit.group for fit in new], _most_tracks(new)))
        starts = [fit.starts for fit in old]
        refined = iter(
            self.refine([fit.group for fit in old], starts, _most_tracks(old))
        )
        return [next(refined if fit.starts else fitted) for fit in fits]

    def composed(self, group, motions):
        """The motion of a group that is, in each window, that of another.

        Parameters
        ----------
        group : ndarray of int
        motions : list of RigidMotion
            One per window.

        Returns
        -------
        RigidMotion
        """
        poses = tuple(motion.poses[k] for k, motion in enumerate(motions))
        squares = np.stack(
            [each.squares[:, k] for k, each in enumerate(motions)], axis=1
        )
        return RigidMotion(poses, squares, group, *self._deviations(squares))

    def _motions(self, groups, poses):
        """Motions with the residuals of all tracks from them."""
        squares = np.full((len(poses), *self.freedom.shape), np.nan)
        for window, (x, seen) in enumerate(zip(self.x, self.seen, strict=True)):
            have = [k for k, each in enumerate(poses) if each[window] is not None]
            rows = np.flatnonzero(self.freedom[:, window])
            if have and len(rows):
                stacked = Poses(
                    *map(np.stack, zip(*(poses[k][window] for k in have), strict=True))
                )
                found = squared_residuals(x[rows], seen[rows], stacked)
                for k, some in zip(have, found, strict=True):
                    squares[k, rows, window] = some
        return [
            RigidMotion(tuple(each), some, group, *self._deviations(some))
            for group, each, some in zip(groups, poses, squares, strict=True)
        ]

    def _deviations(self, squares):
        """Root mean squares of residuals of all tracks, and of how many numbers."""
        unknown = np.isnan(squares)
        known = np.where(unknown, 0, self.freedom).sum(axis=1)
        squares = np.where(unknown, 0, squares)
        totals = np.stack([squares.sum(axis=1), (squares / self.variances).sum(axis=1)])
        return np.sqrt(totals / np.maximum(known, 1)), known

    def relative_squares(self, motion, tracks=slice(None)):
        """Squared residuals of tracks, over their variances.

        Parameters
        ----------
        motion : RigidMotion
        tracks : ndarray of int, default=all

        Returns
        -------
        ndarray of shape (n_tracks, n_windows)
            As :attr:`RigidMotion.squares`, of fast tracks as if they were at rest.
        """
        return motion.squares[tracks] / self.variances[tracks]

    def deviations(self, motion, tracks, relative=True):
        """Root mean square residuals of some tracks, and of how many numbers.

        Parameters
        ----------
        motion : RigidMotion
        tracks : ndarray of int, shape (n,)
        relative : bool, default=True
            Over what is usual at their speed.

        Returns
        -------
        deviations : ndarray of shape (n,)
            In calibrated coordinates; 0 where nothing is known.
        freedom : ndarray of shape (n,)
        """
        return motion.deviations[int(relative), tracks], motion.known[tracks]

    def own_deviations(self, motions, groups, relative=True):
        """Those of :meth:`deviations` of groups by their motions, one after another.

        Parameters
        ----------
        motions : list of RigidMotion
        groups : list of ndarray of int
        relative : bool, default=True

        Returns
        -------
        ndarray
        """
        pairs = zip(motions, groups, strict=True)
        return np.concatenate([self.deviations(*pair, relative)[0] for pair in pairs])

    def deviations_in_stretches(self, motion, length):
        """Root mean square residuals of all tracks in consecutive frames of windows.

        Parameters
        ----------
        motion : RigidMotion
        length : int
            Frames of a stretch; all of a window, if it has fewer.

        Returns
        -------
        ndarray of shape (n_tracks, n_stretches)
            In calibrated coordinates, over what is usual at their speed in the window;
            NaN where a track is seen too little, or the motion was not fitted.
        """
        length = min(length, self.frames.shape[1])
        n_starts = self.frames.shape[1] - length + 1
        found = np.full((len(self.points), len(self.frames), n_starts), np.nan)
        for window, start in np.ndindex(found.shape[1:]):
            pose, stretch = motion.poses[window], slice(start, start + length)
            x, seen = self.x[window, :, stretch], self.seen[window, :, stretch]
            freedom = freedom_of_tracks(seen)
            some = np.flatnonzero(freedom)
            if pose is not None and len(some):
                here = Poses(*(each[None, stretch] for each in pose))
                squares = squared_residuals(x[some], seen[some], here)[0]
                squares /= freedom[some] * self.variances[some, window]
                found[some, window, start] = np.sqrt(squares)
        return found.reshape(len(self.points), -1)

    def explained(self, motion, tracks, most):
        """Those of some tracks that a motion explains with deviations of at most this.

        Parameters
        ----------
        motion : RigidMotion
        tracks : ndarray of int, shape (n,)
        most : float

        Returns
        -------
        ndarray of int
        """
        deviations, freedom = self.deviations(motion, tracks)
        return tracks[(freedom > 0) & (deviations <= most)]

    def wanders(self, tracks):
        """How far some tracks go from their mean places, where they go farthest.

        Parameters
        ----------
        tracks : ndarray of int, shape (n,)

        Returns
        -------
        float
            Root mean square distance along an axis, by the median track of the window
            in which that is most, in calibrated coordinates; 0 where nothing is known.
        """
        medians = [0.0]
        for window in range(len(self.frames)):
            some = tracks[self.freedom[tracks, window] > 0]
            if len(some) >= FEWEST_TRACKS:
                medians.append(float(np.median(self._wandered(window, some))))
        return max(medians)

    def _wandered(self, window, tracks):
        x, seen = self.x[window, tracks], self.seen[window, tracks, :, None]
        times = seen.sum(axis=1)
        means = x.sum(axis=1) / times  # where they are not seen, x is 0
        squares = np.where(seen, (x - means[:, None]) ** 2, 0)
        return np.sqrt(squares.sum(axis=(1, 2)) / (2 * times[:, 0]))

    def inverse_depths(self, motion, tracks):
        """Inverse depths of some tracks by a motion, window by window.

        Returns
        -------
        depths, errors : ndarray of shape (n, n_windows)
            In units of each window's own, and their standard deviations where that of
            a calibrated coordinate is 1; NaN where nothing is known.
        """
        found = np.full((2, len(tracks), len(self.frames)), np.nan)
        for window, pose in enumerate(motion.poses):
            known = self.freedom[tracks, window] > 0
            if pose is not None and known.any():
                rows = tracks[known]
                one = Poses(*(each[None] for each in pose))
                x, seen = self.x[window, rows], self.seen[window, rows]
                found[:, known, window] = np.concatenate(inverse_depths(x, seen, one))
        return tuple(found)

    def shrinkage(self, motion, tracks):
        """By how much residuals of fitted tracks are too small: the parameters' part.

        Returns
        -------
        float
            Deviations times this are comparable with those of other tracks.
        """
        counted = (self.freedom[tracks] > 0) & ~np.isnan(motion.squares[tracks])
        n_parameters = counted.any(axis=0).sum() * (6 * (self.frames.shape[1] - 1) - 1)
        n_residuals = np.where(counted, self.freedom[tracks], 0).sum()
        return np.sqrt(1 / max(1 - n_parameters / max(n_residuals, 1), 0.1))

    def _jobs(self, groups, most_tracks):
        """What there is to fit: tracks of a group in a window."""
        jobs = []
        most_tracks = np.broadcast_to(most_tracks, len(groups))
        for group, (members, most) in enumerate(zip(groups, most_tracks, strict=True)):
            for window in range(len(self.frames)):
                reference, tracks = self._some(members, window, most)
                if len(tracks) >= FEWEST_TRACKS:
                    jobs.append(_Job(group, window, reference, tracks))
        return jobs

    def _some(self, members, window, most_tracks):
        """A reference frame, and tracks seen in it that a motion is fitted to.

        Of the frames that see most of a group the one nearest to the window's middle;
        of its tracks some at all distances from their middle.
        """
        members = members[self.freedom[members, window] > 0]
        seen = self.seen[window, members]
        often = seen.sum(axis=0) >= SHARE_IN_REFERENCE * seen.sum(axis=0).max()
        middle = (self.frames.shape[1] - 1) // 2
        frames = np.flatnonzero(often)
        reference = int(frames[np.abs(frames - middle).argmin()])
        members = members[seen[:, reference]]
        if len(members) <= most_tracks:
            return reference, members
        offsets = self._from_middle(window, members, reference)
        return reference, members[at_all_distances(offsets, most_tracks)]

    def _from_middle(self, window, tracks, frame):
        x = self.x[window, tracks, frame]
        return x - x.mean(axis=0)

    def _stacked(self, jobs):
        """Coordinates, visibility, weights, floors and references of a batch."""
        most = max(len(job.tracks) for job in jobs)
        x = np.zeros((len(jobs), most, self.frames.shape[1], 2))
        seen = np.zeros(x.shape[:3], dtype=bool)
        weights = np.zeros(x.shape[:2])
        for k, job in enumerate(jobs):
            n = len(job.tracks)
            x[k, :n] = self.x[job.window, job.tracks]
            seen[k, :n] = self.seen[job.window, job.tracks]
            weights[k, :n] = 1
        references = np.array([job.reference for job in jobs])
        return x, seen, weights, np.full(len(jobs), self.least_noise), references


def at_all_distances(offsets, n):
    """Positions of some points at all distances to the left and right of a middle.

    Along one axis alone, so that a mirrored image has the same.

    Parameters
    ----------
    offsets : ndarray of shape (m, 2)
    n : int

    Returns
    -------
    ndarray of int, shape (n,)
        The nearest first.
    """
    x, y = np.abs(offsets).T
    order = np.lexsort((y, x))
    return order[np.linspace(0, len(order) - 1, n).astype(int)]


def freedom_of_tracks(seen):
    """Residuals of tracks less the three numbers that place each; 0 for too few.

    Parameters
    ----------
    seen : ndarray of bool, shape (..., n_frames)

    Returns
    -------
    ndarray of int, shape (...)
    """
    times_seen = seen.sum(axis=-1)
    return np.where(times_seen >= FEWEST_SEEN, 2 * times_seen - 3, 0)


class _Job(NamedTuple):
    """A motion to fit, and where to start, if that is known."""

    group: int
    window: int
    reference: int
    tracks: np.ndarray
    start: Poses | None = None


def _poses_in(window, motions):
    """The poses of those of some motions that have any in a window."""
    poses = (motion.poses[window] for motion in motions)
    return [each for each in poses if each is not None]


def _most_tracks(fits):
    return [fit.most_tracks for fit in fits]


def _batches(jobs):
    """Jobs of about as many tracks, so many at a time."""
    jobs = sorted(jobs, key=lambda job: len(job.tracks))
    for start in range(0, len(jobs), BATCH):
        yield jobs[start : start + BATCH]


def best_focal_length(cost, steps=FOCAL_STEPS):
    """The best of a few focal lengths, improved in ever smaller steps.

    Parameters
    ----------
    cost : callable
        Of a focal length, as a share of the larger side of what tracks cover.
    steps : sequence of float
        Factors.

    Returns
    -------
    float
    """
    best = min(FOCAL_LENGTHS, key=cost)
    for step in steps:
        best = min((best, best * step, best / step), key=cost)
    return best


def window_frames(visibility, most_apart=WINDOW_STRIDE):
    """Frames of each window: as many as cover the clip, evenly.

    Parameters
    ----------
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    most_apart : int
        From one frame of a window to the next.

    Returns
    -------
    ndarray of int, shape (n_windows, n_frames_per_window)
        Frames are further apart in a longer clip, up to ``most_apart``, as long as the
        usual track is seen throughout.
    """
    n_frames = visibility.shape[1]
    n = min(WINDOW_FRAMES, n_frames)
    stride = max(1, min(most_apart, (n_frames - 1) // max(n - 1, 1)))
    lifetime = np.median(visibility.sum(axis=1))
    while stride > 1 and (n - 1) * stride + 1 > max(lifetime, n):
        stride -= 1
    span = (n - 1) * stride + 1
    n_windows = max(1, int(np.ceil(n_frames / span - 1 / 3)))
    starts = np.linspace(0, n_frames - span, n_windows).round().astype(int)
    return np.unique(starts)[:, None] + stride * np.arange(n)


def reaching_frames(visibility, affinity):
    """Frames of each window, with windows for what the usual ones do not reach.

    What is in view for less than half a second is seen too little in windows of frames
    that are apart, and where they meet: nothing would be known of it. Where only some
    tracks of a motion are so brief, as in any clip, the others tell.

    Parameters
    ----------
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    affinity : ndarray of shape (n_tracks, n_tracks)
        Its diagonal does not count.

    Returns
    -------
    ndarray of int, shape (n_windows, n_frames_per_window)
        Those of :func:`window_frames`, and at most :data:`MOST_MORE` others, each for
        ten tracks or more, whose links are to others that are not reached.
    """
    frames = window_frames(visibility)
    reached = _reached(visibility, frames).any(axis=0)
    missed = _alone(~reached & (visibility.sum(axis=1) >= FEWEST_SEEN), affinity)
    n = frames.shape[1]
    for _ in range(MOST_MORE):
        if np.count_nonzero(missed) < FEWEST_MISSED:
            break
        stride = max(1, (int(np.median(visibility[missed].sum(axis=1))) - 1) // (n - 1))
        starts = np.arange(visibility.shape[1] - stride * (n - 1))
        others = starts[:, None] + stride * np.arange(n)
        found = _reached(visibility, others) & missed
        best = found.sum(axis=1).argmax()
        if np.count_nonzero(found[best]) < FEWEST_MISSED:
            break
        frames = np.concatenate([frames, others[best : best + 1]])
        missed &= ~found[best]
    return frames


def _alone(tracks, affinity):
    """Those of some tracks whose links are to others of them, all but a quarter."""
    own = np.diagonal(affinity)
    inside = affinity @ tracks - own * tracks
    return tracks & (inside > MOST_LINKS * (affinity.sum(axis=1) - own))


def _reached(visibility, frames):
    """Whether windows see enough of tracks: (n_windows, n_tracks)."""
    times = [np.count_nonzero(visibility[:, some], axis=1) for some in frames]
    return np.stack(times) >= FEWEST_SEEN


def _stretched(frames, n_frames):
    """Windows of about as many frames that leave out none of a clip."""
    n_windows, n = frames.shape
    if n_windows * (np.ptp(frames[0]) + 1) >= n_frames:
        return frames
    edges = np.linspace(0, n_frames, n_windows + 1).round()
    return np.linspace(edges[:-1], edges[1:] - 1, n, axis=1).round().astype(int)


def spread_window_frames(visibility):
    """Frames of each window, spread over all of a short clip.

    What moves slowly is apart from the static scene by more, the longer it is watched.
    Two windows, one a frame later, see the frames of a clip that is too short for
    frames that are :data:`WINDOW_STRIDE` apart.

    Parameters
    ----------
    visibility : ndarray of bool, shape (n_tracks, n_frames)

    Returns
    -------
    ndarray of int, shape (n_windows, n_frames_per_window)
        As of :func:`window_frames` in longer clips, and where the usual track is seen
        in less than half of the frames.
    """
    n_frames = visibility.shape[1]
    lifetime = np.median(visibility.sum(axis=1))
    is_short = WINDOW_FRAMES < n_frames <= LONGEST_SHORT
    if not is_short or 2 * lifetime < n_frames:
        return window_frames(visibility)
    first = np.linspace(0, n_frames - 2, WINDOW_FRAMES).round().astype(int)
    return np.stack([first, first + 1])
