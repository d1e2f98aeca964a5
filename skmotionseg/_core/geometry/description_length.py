"""How well one epipolar geometry per frame pair explains a group of tracks.

The measure is a description length in nats: what it takes to write down where the
tracks of a group went, given where they were. A track that obeys the group's
fundamental matrix costs its distance from the epipolar line, in units of the noise, and
its place along the line; a track that does not costs its place in the plane. The noise
is that of the group, so precise and sloppy motions are judged alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .epipolar import MINIMAL_SIZE, nearest_rank_two, robust_fits
from .tracks import frame_pairs, non_empty_frames, working_coordinates

# Frame pairs that are looked at: neighbours, where tracks are many, and pairs some
# frames apart, where motions differ more than noise. So many for the time that a track
# usually lasts, and more in a longer clip.
FRAME_GAPS = (1, 4)
MAX_PAIRS = 24
# Standard deviations in a median of absolute values, for Gaussian noise.
OF_MEDIAN = 1.4826
# Standard deviations of the noise to choose from, as shares of the mean distance of
# the tracks from their centre: about 0.02 to 0.3 pixels in a video of 640 x 480.
NOISE_LEVELS = 2e-4 * 2.0 ** np.arange(5)
# Observations whose groups are fitted at a time: many small groups take as long as one.
BATCH = 4096


@dataclass(frozen=True)
class WorkingFrames:
    """Frame pairs that are looked at, and the coordinates in which they are.

    Attributes
    ----------
    pairs : ndarray of int, shape (n_pairs, 2)
    centres : ndarray of shape (n_frames, 2)
        Pixels; the origin in each frame.
    scale : float
        Pixels per working unit.
    """

    pairs: np.ndarray
    centres: np.ndarray
    scale: float

    def observe(self, points, visibility):
        """Where tracks are in the pairs that see them.

        Parameters
        ----------
        points : ndarray of shape (n_tracks, n_frames, 2)
        visibility : ndarray of bool, shape (n_tracks, n_frames)

        Returns
        -------
        seen : ndarray of bool, shape (n_pairs, n_tracks)
        x, y : ndarray of shape (n_observations, 2)
            Where ``seen`` is true, pair by pair, in working units.
        """
        points = ((points - self.centres) / self.scale).swapaxes(0, 1)
        seen = visibility.T[self.pairs].all(axis=1)
        pair, track = np.nonzero(seen)
        first, second = self.pairs[pair].T
        return seen, points[first, track], points[second, track]


@dataclass(frozen=True)
class ClipGeometry:
    """The tracks of a clip in the frame pairs that are looked at.

    Attributes
    ----------
    frames : WorkingFrames
    seen : ndarray of bool, shape (n_pairs, n_tracks)
    pair, track : ndarray of int, shape (n_observations,)
        Where ``seen`` is true, pair by pair.
    x, y : ndarray of shape (n_observations, 2)
        Where tracks are in the first and second frame, in coordinates centred in each
        frame and scaled alike in all.
    log_range : ndarray of shape (n_pairs,)
        Log of the range of displacements per axis: what a free coordinate costs, but
        for the noise.
    model_share : float
        Motions from frame to frame over frame pairs, at most 1: the motion between
        distant frames follows from those between, so it must not be paid for again.
    """

    frames: WorkingFrames
    seen: np.ndarray
    pair: np.ndarray
    track: np.ndarray
    x: np.ndarray
    y: np.ndarray
    log_range: np.ndarray
    model_share: float

    @property
    def n_observations(self):
        return max(1, len(self.pair))

    def of_group(self, members):
        """Observations of some tracks, the pairs side by side.

        Parameters
        ----------
        members : ndarray of int

        Returns
        -------
        x, y : ndarray of shape (n_pairs, n_most, 2)
            0 after the last of a pair.
        seen : ndarray of bool, shape (n_pairs, n_most)
        """
        return self.of_groups([members])

    def of_groups(self, groups):
        """Observations of several groups of tracks, the pairs of each below the last's.

        Parameters
        ----------
        groups : list of ndarray of int
            At least one.

        Returns
        -------
        x, y : ndarray of shape (n_groups * n_pairs, n_most, 2)
            0 after the last of a pair.
        seen : ndarray of bool, shape (n_groups * n_pairs, n_most)
        """
        n_pairs = len(self.seen)
        own = [self._places_of(members) for members in groups]
        row = np.concatenate(
            [self.pair[some] + k * n_pairs for k, some in enumerate(own)]
        )
        chosen = np.concatenate(own)
        counts = np.bincount(row, minlength=len(groups) * n_pairs)
        place = np.arange(len(row)) - (np.cumsum(counts) - counts)[row]
        seen = np.arange(counts.max(initial=0)) < counts[:, None]
        x, y = np.zeros((2, *seen.shape, 2))
        x[row, place], y[row, place] = self.x[chosen], self.y[chosen]
        return x, y, seen

    def _places_of(self, members):
        """Positions of the observations of some tracks."""
        inside = np.zeros(self.seen.shape[1], dtype=bool)
        inside[members] = True
        return np.flatnonzero(inside[self.track])


def clip_geometry(points, visibility):
    """Choose frame pairs and put the tracks into working coordinates.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)

    Returns
    -------
    ClipGeometry
    """
    frames = _working_frames(points, visibility)
    seen, x, y = frames.observe(points, visibility)
    pair, track = np.nonzero(seen)
    ends = np.cumsum(seen.sum(axis=1))[:-1]
    log_range = np.array([_log_range(moved) for moved in np.split(y - x, ends)])
    share = min(1, np.ptp(frames.pairs) / len(frames.pairs))
    return ClipGeometry(frames, seen, pair, track, x, y, log_range, share)


def _working_frames(points, visibility):
    # A clip begins and ends where something is seen.
    first, last = non_empty_frames(visibility, fewest=2)[[0, -1]]
    n_frames = last + 1 - first
    pairs = np.concatenate([frame_pairs(n_frames, gap) for gap in FRAME_GAPS])
    lifetime = max(1.0, np.median(visibility.sum(axis=1)))
    most = MAX_PAIRS * max(1, int(n_frames / lifetime))
    if len(pairs) > most:
        pairs = pairs[np.linspace(0, len(pairs) - 1, most).astype(int)]
    centres, scale = working_coordinates(points, visibility)
    return WorkingFrames(pairs + first, centres, scale)


def _log_range(displacements):
    floor = 20 * NOISE_LEVELS[0]  # a still camera: there is nothing to describe
    if len(displacements) == 0:
        return np.log(floor)
    low, high = np.percentile(displacements, [10, 90], axis=0)
    return np.log(np.maximum(high - low, floor)).mean()


def track_medians(seen, distances, lower=True):
    """Median of each track's distances over the frame pairs that judge it.

    Parameters
    ----------
    seen : ndarray of bool, shape (n_pairs, n)
    distances : ndarray of shape (n_observations,)
        Where ``seen`` is true, pair by pair; infinite where a pair does not judge.
    lower : bool, default=True
        Whether it is the lower of the two in the middle, and not their mean, where the
        number is even.

    Returns
    -------
    ndarray of shape (n,)
        NaN where no pair judges a track.
    """
    dense = np.full(seen.shape, np.inf)
    dense[seen] = distances
    counts = np.isfinite(dense).sum(axis=0)
    dense = np.sort(dense, axis=0)
    tracks = np.arange(len(counts))
    medians = dense[np.maximum(counts - 1, 0) // 2, tracks]
    if not lower:
        higher = dense[np.minimum(counts // 2, len(dense) - 1), tracks]
        medians = np.where(counts % 2, medians, (medians + higher) / 2)
    return np.where(counts > 0, medians, np.nan)


@dataclass(frozen=True)
class DescriptionLength:
    """Nats to describe a group of tracks.

    Attributes
    ----------
    tracks : ndarray of shape (n_pairs,)
        For the tracks in each frame pair, given the models.
    models : float
        For the models: one free coordinate of each of the seven tracks that determine
        one, for the motions that do not follow from others.
    modelled : ndarray of bool, shape (n_pairs,)
        Pairs that see at least eight of the tracks, so that there is a model.
    """

    tracks: np.ndarray
    models: float
    modelled: np.ndarray

    @property
    def total(self):
        return float(self.tracks.sum() + self.models)


def description_lengths(geometry, groups, lower_rank=nearest_rank_two):
    """Nats to describe groups of tracks by one fundamental matrix per frame pair each.

    At the noise level that makes the whole of a group least. In a pair that sees fewer
    than eight of its tracks there is no model, and each costs its place in the plane.

    Parameters
    ----------
    geometry : ClipGeometry
    groups : list of ndarray of int
        Tracks of each.
    lower_rank : callable
        As for :func:`~skmotionseg._core.geometry.epipolar.robust_fits`.

    Returns
    -------
    list of DescriptionLength
    """
    lengths: dict[int, DescriptionLength] = {}
    most = BATCH / len(geometry.seen)
    for some in by_size([len(members) for members in groups], most):
        x, y, seen = geometry.of_groups([groups[k] for k in some])
        _, residuals = robust_fits(x, y, seen, lower_rank)
        by_group = (np.split(each, len(some)) for each in (residuals, seen))
        for k, errors, own in zip(some, *by_group, strict=True):
            lengths[k] = shortest_length(geometry, errors, own, 1, 7)
    return [lengths[k] for k in range(len(groups))]


def by_size(sizes, most):
    """Yield positions of about one size, as many as a batch may hold, one at least.

    Parameters
    ----------
    sizes : list of int
    most : float
        Of the largest size in a batch times its length.

    Yields
    ------
    list of int
    """
    some: list[int] = []
    for k in sorted(range(len(sizes)), key=sizes.__getitem__):
        if some and (len(some) + 1) * sizes[k] > most:
            yield some
            some = []
        some.append(k)
    if some:
        yield some


def shortest_length(geometry, residuals, seen, n_constraints, n_parameters):
    """Nats to describe tracks by a model per frame pair, given their distances from it.

    At the noise level that makes the whole least. In a pair that sees fewer than eight
    of the tracks none is expected to obey a model.

    Parameters
    ----------
    geometry : ClipGeometry
    residuals : ndarray of shape (n_pairs, n)
        Squared Sampson errors, in working units.
    seen : ndarray of bool, shape (n_pairs, n)
    n_constraints : int
        Coordinates of a track, of the two, that the model leaves to noise alone.
    n_parameters : int
        Free coordinates that a model costs.

    Returns
    -------
    DescriptionLength
    """
    modelled = seen.sum(axis=1) >= MINIMAL_SIZE
    lengths = []
    for noise in NOISE_LEVELS:
        unit = np.log(noise * np.sqrt(2 * np.pi))
        free = np.maximum(geometry.log_range - unit, 1)  # nats of a free coordinate
        off_model = np.minimum(
            residuals / (2 * noise**2), n_constraints * free[:, None]
        )
        along = (2 - n_constraints) * free[:, None]
        tracks = np.where(seen, off_model + along + 2 * unit, 0).sum(axis=1)
        models = n_parameters * geometry.model_share * free[modelled].sum()
        lengths.append(DescriptionLength(tracks, float(models), modelled))
    return min(lengths, key=lambda length: length.total)
