"""How a stream begins: the camera that explains the motions of its first tracks."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..geometry.camera import Camera, share_of_width
from ..geometry.windows import best_focal_length
from .assignment import measure
from .calibration import CameraEstimate
from .window import Window

# The scale of residuals, in units of their median.
SCALE_OF_NOISE = 2.0
# Steps in which the first camera is improved.
FIRST_STEPS = 5
# Frames after which a young stream is searched again, as a clip of all of its frames.
SEARCHED_AGAIN = 15, 22, 33, 50


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


class Beginning:
    """The frames of a stream that is young.

    Attributes
    ----------
    frames : list of (ndarray of shape (n_seen, 2), ndarray of int, shape (n_seen,))
        Points, in pixels, and ids.
    """

    def __init__(self):
        self.frames: list[Any] = []

    @classmethod
    def of(cls, buffer, n_frames):
        """The newest frames of a buffer."""
        own = cls()
        for column in range(buffer.seen.shape[1])[-n_frames:]:
            seen = buffer.seen[:, column]
            own.push(buffer.points[seen, column], buffer.ids[seen])
        return own

    def __len__(self):
        return len(self.frames)

    @property
    def is_over(self):
        """Whether it will not be searched again."""
        return len(self) >= SEARCHED_AGAIN[-1]

    def is_searched_within(self, n_frames):
        """Whether the next search of all is in fewer frames."""
        return any(0 <= due - len(self) < n_frames for due in SEARCHED_AGAIN)

    def push(self, points, ids):
        """Go on by a frame."""
        self.frames.append((points, ids))

    def tracks(self):
        """All tracks so far.

        Returns
        -------
        ids : ndarray of int, shape (n,)
            Ascending.
        points : ndarray of shape (n, n_frames, 2)
            Pixels; 0 where unseen.
        seen : ndarray of bool, shape (n, n_frames)
        """
        ids = np.unique(np.concatenate([ids for _, ids in self.frames]))
        points = np.zeros((len(ids), len(self), 2))
        seen = np.zeros(points.shape[:2], dtype=bool)
        for frame, (places, names) in enumerate(self.frames):
            rows = np.searchsorted(ids, names)
            points[rows, frame], seen[rows, frame] = places, True
        return ids, points, seen


def calibrate(points, seen, rows, groups, focal_length=None):
    """The camera by which the motions of groups explain tracks best.

    Parameters
    ----------
    points : ndarray of shape (n, L, 2)
        Pixels; 0 where unseen.
    seen : ndarray of bool, shape (n, L)
    rows : ndarray of int
        Tracks to be explained.
    groups : list of ndarray of int
    focal_length : float, optional
        Pixels, if it is known.

    Returns
    -------
    found : Calibration
        The best of a few focal lengths, improved in ever smaller steps; and then
        together with the lens, as far as these frames tell it.
    estimate : CameraEstimate
    """
    tried: dict[float, Calibration] = {}
    usual = Camera.around(points, 1.0, seen)
    width = usual.unit

    def nats(share):
        if share not in tried:
            camera = usual.of_focal_length(share * width)
            tried[share] = _seen_by(camera, points, seen, rows, groups)
        return tried[share].nats

    if focal_length is None:
        share = best_focal_length(nats)
    else:
        share = share_of_width(focal_length, width)
        focal_length = share * width
    nats(share)  # if it was given, it is the only one
    best, estimate = tried[share], CameraEstimate(width, focal_length)
    known = [k for k, fit in enumerate(best.fits) if fit]
    told = estimate.values, estimate.precision
    for _ in range(FIRST_STEPS if known else 0):
        window = Window(points, seen, best.camera)
        camera, told = estimate.improved(
            window, [groups[k] for k in known], [best.fits[k] for k in known]
        )
        best = _seen_by(camera, points, seen, rows, groups)
    estimate.add(*told)
    return best, estimate


def _seen_by(camera, points, seen, rows, groups):
    """What a camera makes of the groups."""
    window = Window(points, seen, camera)
    fits = window.fit(groups)
    known = [fit for fit in fits if fit]
    if not known:
        return Calibration(np.inf, camera, fits, camera.noise)
    measured = measure(window, known, camera.noise, rows)
    deviations = measured.deviations().min(axis=1)
    judged = deviations[np.isfinite(deviations)]  # none, if tracks live two frames
    deviation = float(np.median(judged)) if len(judged) else 0.0
    scale = camera.noise * max(1.0, SCALE_OF_NOISE * deviation)
    return Calibration(float(measured.nats.min(axis=1).sum()), camera, fits, scale)
