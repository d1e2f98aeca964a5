"""What a tracker makes of a scene: lifetimes, gaps, noise that drifts, wrong tracks."""

from __future__ import annotations

import numpy as np

BENDS = 0.5, 2.0  # standard deviations of where a thing's tracks are: alike within
STEADY = 0.8  # correlation of a step of what bends with the next
KINDS = ("wander", "jump", "slide", "mismatch")


def lifetimes(visible, births, ends, min_seen):
    """Frames in which tracks are seen that begin somewhere and are lost once hidden.

    Parameters
    ----------
    visible : ndarray of bool, shape (n_tracks, n_frames)
        Inside the image and in front of everything else.
    births : ndarray of int, shape (n_tracks,)
        First frames.
    ends : ndarray of shape (n_tracks,)
        Frames after which the tracker gives up.
    min_seen : int
        Shorter tracks are not seen at all.

    Returns
    -------
    seen : ndarray of bool, shape (n_tracks, n_frames)
    """
    frames = np.arange(visible.shape[1])
    born = frames >= births[:, None]
    seen = np.logical_and.accumulate(visible | ~born, axis=1) & born
    seen &= frames < ends[:, None]
    seen[seen.sum(axis=1) < min_seen] = False
    return seen


def photographs(visible, share, min_seen, rng):
    """Frames in which points are found that have no order: most in few, some in all."""
    shares = np.minimum(share * rng.exponential(size=(len(visible), 1)), 1)
    seen = visible & (rng.uniform(size=visible.shape) < shares)
    seen[seen.sum(axis=1) < min_seen] = False
    return seen


def with_gaps(seen, share, min_seen, rng):
    """Hide one to three frames inside a share of the tracks."""
    n_tracks, n_frames = seen.shape
    start = (rng.uniform(size=n_tracks) * n_frames).astype(int)
    stop = start + rng.randint(1, 4, size=n_tracks)
    frames = np.arange(n_frames)
    hidden = (frames >= start[:, None]) & (frames < stop[:, None])
    hidden &= (rng.uniform(size=n_tracks) < share)[:, None]
    left = seen & ~hidden
    enough = left.sum(axis=1) >= min_seen
    return np.where(enough[:, None], left, seen)


def tracker_noise(
    points, seen, noise, drift, inertia, spread, shared, motion_noise, rng
):
    """Errors of a tracker, (n_tracks, n_frames, 2), pixels.

    White noise plus a walk that begins where the track does. Each track has a scale of
    its own, log-normal, and neighbours have a share of both in common. What moves fast
    before the camera comes near or goes away, and is tracked less well.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
        Pixels, for who is a neighbour of whom.
    seen : ndarray of bool, shape (n_tracks, n_frames)
    noise : float
        Median over tracks of the standard deviation of a coordinate, pixels, one frame
        after the beginning.
    drift : float
        Share of its variance that is a step of the walk, in [0, 1].
    inertia : float
        Correlation of a step with the one before, in [0, 1].
    spread : float
        Standard deviation of the logarithm of a track's scale.
    shared : float
        Share of the variance that neighbours have in common, in [0, 1].
    motion_noise : float
        Pixels of noise, for the usual track, per pixel that it moves per frame.
    rng : RandomState
    """
    shape = points.shape
    errors = np.zeros(shape)
    common = _neighbours_draw_alike(points, rng) if shared > 0 else None
    if drift < 1:
        errors += np.sqrt(1 - drift) * _partly_shared(shape, shared, common, rng)
    if drift > 0:
        walk = _inert(_partly_shared(shape, shared, common, rng), inertia)
        errors += np.sqrt(drift) * _begun_at(seen.argmax(axis=1), walk.cumsum(axis=1))
    level = np.hypot(noise, motion_noise * _steps(points, seen))[:, None, None]
    errors *= level * np.exp(spread * rng.standard_normal((shape[0], 1, 1)))
    return errors


def bending(points, seen, target, levels, rng):
    """Errors (n_tracks, n_frames, 2), pixels, because things are not quite rigid.

    What moves by itself seldom is, and tracks slide on it as it turns and gleams: those
    on one side of it unlike those on the other, by walks that vary smoothly over it and
    begin where a track does.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
        Pixels.
    seen : ndarray of bool, shape (n_tracks, n_frames)
    target : ndarray of int, shape (n_tracks,)
    levels : dict of int to float
        Standard deviation of a coordinate from one frame to the next, pixels, for each
        label that bends.
    rng : RandomState
    """
    errors = np.zeros(points.shape)
    first = seen.argmax(axis=1)
    for label, level in levels.items():
        own = np.flatnonzero(target == label)
        places = points[own, first[own]]
        reach = np.exp(rng.uniform(*np.log(BENDS))) * places.std() if len(own) else 1
        walk = _inert(_alike(places, max(reach, 1e-9), rng)(points.shape[1]), STEADY)
        errors[own] = level * walk.cumsum(axis=1)
    return _begun_at(first, errors)


def _begun_at(first, walks):
    """Walks that are 0 in some frame each."""
    return walks - walks[np.arange(len(walks)), first][:, None]


def _inert(steps, inertia):
    """Steps that are correlated with the one before, of the same variance."""
    steps[:, 1:] *= np.sqrt(1 - inertia**2)
    for frame in range(1, steps.shape[1]):
        steps[:, frame] += inertia * steps[:, frame - 1]
    return steps


def _steps(points, seen):
    """Mean distance (n_tracks,) from one frame to the next, pixels."""
    both = seen[:, 1:] & seen[:, :-1]
    steps = np.linalg.norm(np.diff(points, axis=1), axis=2)
    return np.where(both, steps, 0).sum(axis=1) / np.maximum(both.sum(axis=1), 1)


def _partly_shared(shape, shared, common, rng):
    own = rng.standard_normal(shape)
    if shared > 0:
        own *= np.sqrt(1 - shared)
        own += np.sqrt(shared) * common(shape[1])
    return own


def _neighbours_draw_alike(points, rng):
    """Draw for all tracks from normal distributions that vary smoothly over the image.

    The first place of a track counts; the distance over which draws are alike is
    random, from a sixteenth to a quarter of the image.
    """
    first = points[:, 0] - points[:, 0].min(axis=0)
    first = first / max(first.max(), 1e-9)
    return _alike(first, np.exp(rng.uniform(np.log(0.06), np.log(0.25))), rng)


def _alike(places, reach, rng, n_waves=16):
    """Draw for places from normal distributions, alike for those within reach."""
    angles = places @ (rng.standard_normal((2, n_waves)) / reach)
    basis = np.concatenate([np.cos(angles), np.sin(angles)], axis=1) / np.sqrt(n_waves)

    def draw(n_frames):
        weights = rng.standard_normal((2 * n_waves, 2 * n_frames))
        return (basis @ weights).reshape(len(places), n_frames, 2)

    return draw


def wrong_tracks(points, seen, others, shares, size, rng):
    """Tracks that follow no motion, made from tracks that do.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
        Pixels of tracks of some motion.
    seen : ndarray of bool, shape (n_tracks, n_frames)
    others : ndarray of shape (n_tracks, n_frames, 2)
        Tracks of other motions, for those that slide along the edge of two things.
    shares : sequence of 4 floats
        How many wander, jump, slide and are mismatched.
    size : ndarray of shape (2,)
        Width and height, pixels.
    rng : RandomState

    Returns
    -------
    points : ndarray of shape (n_tracks, n_frames, 2)
        Not always inside the image.
    """
    n_tracks, n_frames = seen.shape
    if n_tracks == 0:
        return points
    kinds = rng.choice(len(KINDS), size=n_tracks, p=shares)
    width = size[0]
    first = seen.argmax(axis=1)
    places = points[np.arange(n_tracks), first][:, None]

    def log_uniform(low, high):
        return np.exp(rng.uniform(np.log(low), np.log(high), size=(n_tracks, 1, 1)))

    # Some hold on to the thing they were found on, some do not.
    holds = rng.uniform(size=(n_tracks, 1, 1)) < 0.5
    walk = (log_uniform(0.002, 0.02) * width) * rng.standard_normal(points.shape)
    wander = np.where(holds, points, places) + _begun_at(first, walk.cumsum(axis=1))

    length = np.maximum(seen.sum(axis=1), 2)
    turn = first + 1 + (rng.uniform(size=n_tracks) * (length - 1)).astype(int)
    late = np.arange(n_frames) >= turn[:, None]
    jumps = log_uniform(0.01, 0.15) * width * _directions(n_tracks, rng)
    jump = points + late[..., None] * jumps

    mix = rng.uniform(0.25, 0.75, size=(n_tracks, 1, 1))
    other_places = others[np.arange(n_tracks), first][:, None]
    slide = points + mix * ((others - other_places) - (points - places))

    mismatch = rng.uniform(size=points.shape) * size
    wrong_in = rng.uniform(size=(n_tracks, n_frames)) < rng.uniform(0.2, 1)
    wrong_in[np.arange(n_tracks), _a_seen_frame(seen, rng)] = True
    mismatch = np.where(wrong_in[..., None], mismatch, points)

    return np.choose(kinds[:, None, None], [wander, jump, slide, mismatch])


def _directions(n, rng):
    angles = rng.uniform(0, 2 * np.pi, size=n)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)[:, None]


def _a_seen_frame(seen, rng):
    return (seen * rng.uniform(0.5, 1, size=seen.shape)).argmax(axis=1)
