"""Windows of a film."""

from __future__ import annotations

import numpy as np

from skmotionseg._core.geometry.camera import Camera
from skmotionseg._core.stream.window import LENGTH, Window

from .films import FOCAL, SIZE, film


def two_windows():
    """Two windows, the second a frame later, and the tracks of each thing."""
    movie = film(n_frames=LENGTH + 1, noise=0.05)
    camera = Camera(SIZE / 2, FOCAL, 0.15 / FOCAL)
    groups = [np.flatnonzero(movie.things == thing) for thing in (0, 1)]
    frames = slice(0, LENGTH), slice(1, LENGTH + 1)
    return [
        Window(movie.points[:, f], movie.seen[:, f], camera) for f in frames
    ], groups
