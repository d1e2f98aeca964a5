"""The focal length, looked at again while a stream goes on."""

from __future__ import annotations

import numpy as np

from .assignment import measure
from .window import Window

# Frames from one comparison to the next, and the factor between focal lengths.
FRAMES_PER_COMPARISON, STEP = 10, 1.25
# Tracks of a motion that has a say.
FEWEST_TELLING = 10
# Times that poses are refined for another focal length.
ROUNDS = 2
# Comparisons that are remembered and that it takes to change, standard errors of their
# mean by which the other is better, and nats.
REMEMBERED, FEWEST, ERRORS, NATS = 10, 3, 2.0, 20.0
# Focal lengths that are possible, in widths of the picture.
SHORTEST, LONGEST = 0.3, 5.0


class FocalLength:
    """Compares a focal length with a longer and a shorter one.

    The first frames, in which a camera has hardly moved, may suggest a wrong one. Parts
    of a scene are then not quite one rigid motion.
    """

    def __init__(self):
        self._gains = {}

    def compare(self, buffer, camera, scale, groups, fits, width):
        """The camera that explains motions best, and the motions it makes of them.

        Parameters
        ----------
        buffer : TrackBuffer
        camera : Camera
        scale : float
            Of the residuals, in calibrated coordinates.
        groups : list of ndarray of int
            Tracks of the motions.
        fits : list of Fit
        width : float
            Of the picture, pixels.

        Returns
        -------
        camera : Camera
            The same one, unless several comparisons in succession say otherwise.
        fits : list of Fit
        """
        telling = [k for k, rows in enumerate(groups) if len(rows) >= FEWEST_TELLING]
        if not telling:
            return camera, fits
        some = [groups[k] for k in telling], [fits[k] for k in telling]
        nats = _nats(buffer, camera, scale, *some)
        for factor in (1 / STEP, STEP):
            other = _changed(camera, factor)
            if not SHORTEST <= other.unit / width <= LONGEST:
                continue
            gain = nats - _nats(buffer, other, scale / factor, *some)
            self._gains.setdefault(factor, []).append(gain)
            del self._gains[factor][:-REMEMBERED]
        better = [f for f, gains in self._gains.items() if _is_better(gains)]
        if not better:
            return camera, fits
        best = max(better, key=lambda factor: np.mean(self._gains[factor]))
        self._gains = {}
        other = _changed(camera, best)
        return other, _refined(Window(buffer.points, buffer.seen, other), groups, fits)


def _changed(camera, factor):
    """A camera whose focal length is so many times as long."""
    return camera._replace(unit=camera.unit * factor, noise=camera.noise / factor)


def _nats(buffer, camera, scale, groups, fits):
    """What the tracks of motions cost, as a camera sees them."""
    window = Window(buffer.points, buffer.seen, camera)
    fits = _refined(window, groups, fits)
    rows = np.sort(np.concatenate(groups))
    return float(measure(window, fits, scale, rows).nats.min(axis=1).sum())


def _refined(window, groups, fits):
    for _ in range(ROUNDS):
        found = window.fit(groups, fits)
        fits = [new or old for new, old in zip(found, fits, strict=True)]
    return fits


def _is_better(gains):
    """Whether gains of a focal length are no accident."""
    if len(gains) < FEWEST:
        return False
    error = np.std(gains, ddof=1) / np.sqrt(len(gains))
    return np.mean(gains) > max(NATS, ERRORS * error)
