"""How a stream begins: the camera that explains the motions of its first tracks."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..geometry.windows import best_focal_length
from .assignment import measure
from .window import Camera, Window

# The scale of residuals, in units of their median.
SCALE_OF_NOISE = 2.0


class Calibration(NamedTuple):
    """A camera, and what it makes of groups of tracks.

    Attributes
    ----------
    nats : float
        Of the tracks; infinite if no group has a motion.
    camera : Camera
    fits : list of Fit or None
        None for groups of too few tracks.
    scale : float
        Of the residuals, in calibrated coordinates.
    """

    nats: float
    camera: Camera
    fits: list[Any]
    scale: float


def calibrate(points, seen, rows, groups):
    """The focal length at which the motions of groups explain tracks best.

    Parameters
    ----------
    points : ndarray of shape (n, L, 2)
        Pixels; 0 where unseen.
    seen : ndarray of bool, shape (n, L)
    rows : ndarray of int
        Tracks to be explained.
    groups : list of ndarray of int

    Returns
    -------
    Calibration
        The best of a few focal lengths, improved in ever smaller steps.
    """
    tried: dict[float, Calibration] = {}

    def nats(share):
        if share not in tried:
            camera = Camera.around(points[seen], share)
            tried[share] = _seen_by(camera, points, seen, rows, groups)
        return tried[share].nats

    return tried[best_focal_length(nats)]


def _seen_by(camera, points, seen, rows, groups):
    """What a camera makes of the groups."""
    window = Window(points, seen, camera)
    fits = window.fit(groups)
    known = [fit for fit in fits if fit]
    if not known:
        return Calibration(np.inf, camera, fits, camera.noise)
    measured = measure(window, known, camera.noise, rows)
    deviations = measured.deviations().min(axis=1)
    deviation = float(np.median(deviations[np.isfinite(deviations)]))
    scale = camera.noise * max(1.0, SCALE_OF_NOISE * deviation)
    return Calibration(float(measured.nats.min(axis=1).sum()), camera, fits, scale)
