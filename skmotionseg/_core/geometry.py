"""How well one epipolar geometry a frame pair explains a group of tracks.

The measure is a description length in nats: what it takes to write down where the
tracks of a group went, given where they were. A track that obeys the group's
fundamental matrix costs its distance from the epipolar line, in units of the noise, and
its place along the line; a track that does not costs its place in the plane. The noise
is that of the group, so precise and sloppy motions are judged alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .motion_models import (
    MOTION_MODELS,
    dominant_eigenvectors,
    epipolar_equations,
    homogeneous,
    rank_two,
)
from .tracks import frame_pairs, working_coordinates

# Frame pairs that are looked at: neighbours, where tracks are many, and pairs some
# frames apart, where motions differ more than noise. So many for the time that a track
# usually lasts, and more in a longer clip.
FRAME_GAPS = (1, 4)
MAX_PAIRS = 24
# Standard deviations of the noise to choose from, as shares of the mean distance of
# the tracks from their centre: about 0.05 to 0.8 pixels in a video of 640 x 480.
NOISE_LEVELS = 2e-4 * 2.0 ** np.arange(5)
# Weights of the robust fit fall to a half at this residual (same unit).
ROBUST_SCALE = 2e-3
ROBUST_SWEEPS = 4
# Moments that obey a model exactly are singular; this share of their trace, far below
# any noise, is added to invert them.
SINGULAR = 1e-14


@dataclass(frozen=True)
class ClipGeometry:
    """The tracks of a clip in the frame pairs that are looked at.

    Attributes
    ----------
    seen : ndarray of bool, shape (n_pairs, n_tracks)
    pair, track : ndarray of int, shape (n_observations,)
        Where ``seen`` is true, pair by pair.
    x, y : ndarray of shape (n_observations, 2)
        Where tracks are in the first and second frame, in coordinates centred in each
        frame and scaled alike in all.
    log_range : ndarray of shape (n_pairs,)
        Log of the range of displacements, an axis: what a free coordinate costs, but
        for the noise.
    model_share : float
        Motions from frame to frame over frame pairs, at most 1: the motion between
        distant frames follows from those between, so it must not be paid for again.
    """

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
        inside = np.zeros(self.seen.shape[1], dtype=bool)
        inside[members] = True
        chosen = np.flatnonzero(inside[self.track])
        pair = self.pair[chosen]
        counts = np.bincount(pair, minlength=len(self.seen))
        place = np.arange(len(chosen)) - (np.cumsum(counts) - counts)[pair]
        seen = np.arange(counts.max(initial=0)) < counts[:, None]
        x, y = np.zeros((2, *seen.shape, 2))
        x[pair, place], y[pair, place] = self.x[chosen], self.y[chosen]
        return x, y, seen


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
    filled = np.flatnonzero(visibility.any(axis=0))
    if len(filled) > 1:  # a clip begins and ends where something is seen
        clip = slice(filled[0], filled[-1] + 1)
        points, visibility = points[:, clip], visibility[:, clip]
    n_frames = visibility.shape[1]
    pairs = np.concatenate([frame_pairs(n_frames, gap) for gap in FRAME_GAPS])
    lifetime = max(1.0, np.median(visibility.sum(axis=1)))
    most = MAX_PAIRS * max(1, int(n_frames / lifetime))
    if len(pairs) > most:
        pairs = pairs[np.linspace(0, len(pairs) - 1, most).astype(int)]
    centres, scale = working_coordinates(points, visibility)
    points = ((points - centres) / scale).swapaxes(0, 1)  # (n_frames, n_tracks, 2)
    seen = visibility.T[pairs].all(axis=1)
    pair, track = np.nonzero(seen)
    x, y = points[pairs[pair, 0], track], points[pairs[pair, 1], track]
    ends = np.cumsum(seen.sum(axis=1))[:-1]
    log_range = np.array([_log_range(moved) for moved in np.split(y - x, ends)])
    share = min(1, (n_frames - 1) / len(pairs))
    return ClipGeometry(seen, pair, track, x, y, log_range, share)


def _log_range(displacements):
    floor = 20 * NOISE_LEVELS[0]  # a still camera: there is nothing to describe
    if len(displacements) == 0:
        return np.log(floor)
    low, high = np.percentile(displacements, [10, 90], axis=0)
    return np.log(np.maximum(high - low, floor)).mean()


def description_length(geometry, members):
    """Nats to describe a group of tracks by one fundamental matrix a frame pair.

    Parameters
    ----------
    geometry : ClipGeometry
    members : ndarray of int
        Tracks of the group.

    Returns
    -------
    tracks : float
        Nats for the tracks, given the models, at the noise level that makes the whole
        least. In a pair that sees fewer than eight of them there is no model, and each
        costs its place in the plane.
    models : float
        Nats for the models: a free coordinate more of the seven tracks that determine
        one, for the motions that do not follow from others.
    """
    x, y, seen = geometry.of_group(members)
    residuals = robust_residuals(x, y, seen)
    modelled = seen.sum(axis=1) >= MOTION_MODELS["fundamental"].minimal_size
    lengths = []
    for noise in NOISE_LEVELS:
        unit = np.log(noise * np.sqrt(2 * np.pi))
        free = np.maximum(geometry.log_range - unit, 1)  # nats of a free coordinate
        off_line = np.minimum(residuals / (2 * noise**2), free[:, None])
        tracks = np.where(seen, off_line + free[:, None] + 2 * unit, 0).sum()
        models = 7 * geometry.model_share * free[modelled].sum()
        lengths.append((float(tracks), float(models)))
    return min(lengths, key=sum)


def mean_sampson_errors(points, visibility):
    """How far tracks of one motion are from its epipolar geometry, frame by frame.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)

    Returns
    -------
    ndarray of shape (n_tracks,)
        Squared Sampson errors to the fundamental matrix of each two consecutive frames,
        in squared working units, mean over the frame pairs that see the track and
        seven others; NaN where there is none.
    """
    centres, scale = working_coordinates(points, visibility)
    total, n_judged = np.zeros(len(points)), np.zeros(len(points), dtype=int)
    for i, j in frame_pairs(visibility.shape[1]):  # one by one: tracks may be many
        seen = np.flatnonzero(visibility[:, i] & visibility[:, j])
        x = (points[seen, i] - centres[i]) / scale
        y = (points[seen, j] - centres[j]) / scale
        everywhere = np.ones((1, len(seen)), dtype=bool)
        (errors,) = robust_residuals(x[None], y[None], everywhere)
        if np.isfinite(errors).all():
            total[seen] += errors
            n_judged[seen] += 1
    return np.divide(
        total, n_judged, out=np.full(len(points), np.nan), where=n_judged > 0
    )


def robust_residuals(x, y, seen):
    """Squared Sampson errors to a fundamental matrix fitted robustly to each pair.

    Iteratively reweighted least squares with Cauchy weights, from equal ones. It stands
    a few tracks in a hundred of another motion; a group with more of them is described
    badly, as it should be.

    Parameters
    ----------
    x, y : ndarray of shape (n_pairs, n, 2)
    seen : ndarray of bool, shape (n_pairs, n)

    Returns
    -------
    ndarray of shape (n_pairs, n)
        In squared working units; infinite in pairs that see fewer than eight.
    """
    residuals = np.full(seen.shape, np.inf)
    pairs = np.flatnonzero(
        seen.sum(axis=1) >= MOTION_MODELS["fundamental"].minimal_size
    )
    if len(pairs) == 0:
        return residuals
    seen = seen[pairs].astype(float)
    x, y, spread = _normalize_pairs(x[pairs], y[pairs], seen)
    rows = epipolar_equations(x, y)  # (P, n, 9)
    weights = seen
    for _ in range(ROBUST_SWEEPS):
        moments = (rows * weights[..., None]).swapaxes(1, 2) @ rows  # (P, 9, 9)
        F = rank_two(_least_eigenvectors(moments).reshape(-1, 3, 3))
        lines, back = x @ F.swapaxes(1, 2), y @ F
        gradient = sum(side[..., i] ** 2 for side in (lines, back) for i in (0, 1))
        gradient = np.maximum(gradient, np.finfo(float).tiny)
        errors = (rows @ F.reshape(-1, 9, 1))[..., 0] ** 2 / gradient
        weights = seen / (1 + errors * (spread / ROBUST_SCALE) ** 2)
        weights /= np.maximum(gradient, 1e-9 * gradient.max())
        weights /= weights.max(axis=1, keepdims=True)
    residuals[pairs] = errors * spread**2
    return residuals


def _least_eigenvectors(moments):
    """Unit eigenvectors (P, n) of the least eigenvalues of moments (P, n, n)."""
    trace = np.trace(moments, axis1=1, axis2=2)[:, None, None]
    ridge = SINGULAR * np.eye(moments.shape[1])
    return dominant_eigenvectors(np.linalg.inv(moments / trace + ridge))


def _normalize_pairs(x, y, seen):
    """Homogeneous points of each pair about their centroids, one scale a pair."""
    n_seen = seen.sum(axis=1)[:, None, None]
    mask = seen[..., None]
    x = (x - (x * mask).sum(axis=1, keepdims=True) / n_seen) * mask
    y = (y - (y * mask).sum(axis=1, keepdims=True) / n_seen) * mask
    spread = np.sqrt((x**2 + y**2).sum(axis=(1, 2)) / (4 * n_seen[:, 0, 0]))[:, None]
    spread = np.maximum(spread, 1e-6)
    scale = spread[..., None]
    return homogeneous(x / scale), homogeneous(y / scale), spread
