"""Streams of tracks of a moving camera, with things that come, stop and go."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

SIZE, FOCAL = np.array([640, 480]), 600.0


class Film(NamedTuple):
    """Tracks of a film.

    Attributes
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
    seen : ndarray of bool, shape (n_tracks, n_frames)
    things : ndarray of int, shape (n_tracks,)
        0 for the static scene.
    """

    points: np.ndarray
    seen: np.ndarray
    things: np.ndarray

    @property
    def n_frames(self):
        return self.seen.shape[1]

    def frame(self, number):
        """Points and ids of a frame."""
        ids = np.flatnonzero(self.seen[:, number])
        return self.points[ids, number], ids


def film(
    n_frames=40, n_static=70, n_moving=24, path=None, life=None, noise=0.1, seed=0
):
    """A camera that sways, and one thing that moves.

    Parameters
    ----------
    n_frames, n_static, n_moving : int
    path : callable, optional
        ``frame -> (3,)``: where the thing is, the camera beginning in the origin.
    life : int, optional
        Frames that tracks live; longer than the film if not given.
    noise : float
        Pixels.
    seed : int

    Returns
    -------
    Film
    """
    rng = np.random.default_rng(seed)
    path = drive if path is None else path
    static = rng.uniform([-5, -3, 5], [5, 3, 14], size=(n_static, 3))
    thing = rng.uniform(-0.8, 0.8, size=(n_moving, 3))
    cameras = camera_path(n_frames)
    world = np.concatenate(
        [
            np.repeat(static[:, None], n_frames, axis=1),
            thing[:, None] + np.array([path(frame) for frame in range(n_frames)]),
        ]
    )
    local = world - cameras
    points = FOCAL * local[..., :2] / local[..., 2:] + SIZE / 2
    seen = (local[..., 2] > 1) & ((points > 0) & (points < SIZE)).all(axis=2)
    if life is not None:
        births = rng.integers(-life, n_frames, size=(len(world), 1))
        age = np.arange(n_frames) - births
        seen &= (age >= 0) & (age < life)
    points = points + noise * rng.standard_normal(points.shape)
    return Film(points, seen, np.repeat([0, 1], [n_static, n_moving]))


def together(one, other):
    """A film, with the thing of another one before the same camera, as thing 2."""
    thing = other.things == 1
    return Film(
        np.concatenate([one.points, other.points[thing]]),
        np.concatenate([one.seen, other.seen[thing]]),
        np.concatenate([one.things, 2 * other.things[thing]]),
    )


def camera_path(n_frames):
    """Sways, so that it can be filmed for as long as one likes."""
    frames = np.arange(n_frames)[:, None]
    return [0.9, 0.3, 1.2] * np.sin(frames / [19.0, 13.0, 29.0])


def drive(frame):
    """To and fro before the camera, up and down."""
    return np.array([1.5 * np.sin(frame / 15), 0.8 * np.cos(frame / 9), 7.0])


def stop_and_go(frame):
    """Drives, stands from frame 12 to frame 42, and drives on."""
    way = min(frame, 12) + max(frame - 42, 0)
    return np.array([-1.5 + 0.05 * way, 0.8 - 0.04 * way, 8.0])


def enter(frame):
    """Comes into the picture in frame 20."""
    if frame < 20:
        return np.array([0.0, 50.0, 8.0])
    return np.array([-2 + 0.06 * frame, 1.0 - 0.05 * (frame - 20), 8.0])
