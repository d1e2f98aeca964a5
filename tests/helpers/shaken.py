"""A room before a camera that shakes, and reads each frame from top to bottom."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

SIZE = np.array([1280.0, 720.0])
FOCAL = 1000.0


def shaken(readout, *, n_tracks=150, n_moving=0, n_frames=24, shake=0.02, seed=0):
    """Tracks of a room, and of a thing that drives across it.

    Parameters
    ----------
    readout : float
        Frames that it takes to read the rows of a frame, the middle one at its time.
    n_tracks, n_moving : int
    n_frames : int
    shake : float
        Radians by which the camera turns to and fro.
    seed : int

    Returns
    -------
    X : ndarray of shape (n, 2 * n_frames)
    y : ndarray of int, shape (n,)
    """
    rng = np.random.default_rng(seed)
    away = rng.uniform(4, 30, n_tracks)
    spread = rng.uniform([-0.65, -0.36], [0.65, 0.36], (n_tracks, 2))
    room = np.column_stack([spread, np.ones(n_tracks)]) * away[:, None]
    thing = rng.uniform(-1, 1, (n_moving, 3)) * [1, 0.7, 0.7] + [-3, 0.5, 9]
    points = np.concatenate([room, thing])
    y = np.repeat([0, 1], [n_tracks, n_moving])
    rates, phases = rng.uniform(0.3, 1, (5, 3)), rng.uniform(0, 2 * np.pi, (5, 3))
    sizes = shake / np.sqrt(5) * rng.standard_normal((5, 3))

    def seen(times):
        """Images of the points at a time each."""
        angles = (sizes * np.sin(rates * times[:, None, None] + phases)).sum(axis=1)
        moved = points + np.outer(times, [0.02, 0, 0.02])
        moved += np.outer(times * y, [0.25, 0, 0.03])
        turned = Rotation.from_rotvec(angles).apply(moved)
        return FOCAL * turned[:, :2] / turned[:, 2:] + SIZE / 2

    frames = []
    for frame in range(n_frames):
        times = np.full(len(points), float(frame))
        for _ in range(4):  # what is seen when its own row is read
            image = seen(times)
            times = frame + readout * (image[:, 1] / SIZE[1] - 0.5)
        frames.append(image)
    tracks = np.stack(frames, axis=1)
    tracks += 0.2 * rng.standard_normal(tracks.shape)
    inside = ((tracks >= 0) & (tracks < SIZE)).all(axis=2)
    tracks[~inside] = np.nan
    often = inside.sum(axis=1) >= 3
    return tracks[often].reshape(often.sum(), -1), y[often]
