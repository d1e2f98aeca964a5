"""Tracks of a room, and of what moves in it."""

from __future__ import annotations

import numpy as np

SIZE = np.array([640, 480])
FOCAL = 640.0
N_FRAMES = 12


def pixels(X):
    """Images of points (..., 3) before the camera."""
    return FOCAL * X[..., :2] / X[..., 2:] + SIZE / 2


def seen_at(spacing, box=((0, 0), (640, 480))):
    """Places (n, 2) on a grid inside a box of the first image."""
    (left, top), (right, bottom) = box
    x, y = np.meshgrid(
        np.arange(left + 4, right, spacing), np.arange(top + 4, bottom, spacing)
    )
    return np.column_stack([x.ravel(), y.ravel()]).astype(float)


def tracks(places, depth, steps, turn=0.0, noise=0.05, seed=0):
    """Tracks (n, N_FRAMES, 2) of points at depths, which move by steps (3,)."""
    rays = np.column_stack([(places - SIZE / 2) / FOCAL, np.ones(len(places))])
    X = rays * np.broadcast_to(depth, len(places))[:, None]
    frames = np.arange(N_FRAMES)
    X = X[:, None] + frames[:, None] * np.asarray(steps)
    angle = turn * frames
    x = np.cos(angle) * X[..., 0] + np.sin(angle) * X[..., 2]
    z = np.cos(angle) * X[..., 2] - np.sin(angle) * X[..., 0]
    points = pixels(np.stack([x, X[..., 1], z], axis=-1))
    rng = np.random.default_rng(seed)
    return points + noise * rng.standard_normal(points.shape)


def ground_and_wall(places):
    """Depths of a room: far above the horizon, nearer below it, and continuous."""
    return np.where(places[:, 1] < 280, 12.0, 12.0 / (1 + (places[:, 1] - 280) / 200))


def clip(box, steps, camera=(-0.03, 0, 0), turn=0.004, spacing=12, depth=6.0):
    """A room, a thing in a box of the image that moves, and which tracks are of it."""
    places = seen_at(spacing)
    (left, top), (right, bottom) = box
    inside = (places > (left, top)).all(axis=1) & (places < (right, bottom)).all(axis=1)
    room = tracks(places[~inside], ground_and_wall(places[~inside]), camera, turn)
    own = np.add(camera, steps)
    thing = tracks(seen_at(spacing, box), depth, own, turn, seed=1)
    points = np.concatenate([room, thing])
    visibility = ((points >= 0) & (points < SIZE)).all(axis=2)
    points = np.where(visibility[..., None], points, np.nan)
    return points, visibility, np.arange(len(points)) >= len(room)


BOX = ((260, 200), (400, 340))
