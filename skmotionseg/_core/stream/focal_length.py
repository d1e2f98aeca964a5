"""The focal length, looked at again while a stream goes on."""

from __future__ import annotations

import numpy as np

from .assignment import measure
from .window import fit_motions

# Frames from one comparison to the next, with a shorter and a longer one in turn, and
# the factor between focal lengths.
FRAMES_PER_COMPARISON, STEP = 6, 1.25
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
        self._gains: dict[float, list[float]] = {1 / STEP: [], STEP: []}

    def compare(self, window, scale, groups, fits, width):
        """The camera that explains motions best, and the motions it makes of them.

        Parameters
        ----------
        window : Window
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
        # In turn, so that no frame takes the time of both.
        factor, self._gains = _first_last(self._gains)
        other = _changed(window.camera, factor)
        if not telling or not SHORTEST <= other.unit / width <= LONGEST:
            return window.camera, fits
        gains = self._gains[factor]
        some = [groups[k] for k in telling], [fits[k] for k in telling]
        gains.append(_gain((window, window.seen_by(other)), scale, *some))
        del gains[:-REMEMBERED]
        if not _is_better(gains):
            return window.camera, fits
        self._gains = {each: [] for each in self._gains}
        return other, _refined([window.seen_by(other)], groups, fits)[0]


def _changed(camera, factor):
    """A camera whose focal length is so many times as long."""
    return camera._replace(unit=camera.unit * factor, noise=camera.noise / factor)


def _first_last(values):
    """The first key of a dict, and the dict with it behind the others."""
    first, *others = values
    return first, {key: values[key] for key in (*others, first)}


def _gain(windows, scale, groups, fits):
    """Nats that tracks of motions cost less as the second of two cameras sees them."""
    rows = np.sort(np.concatenate(groups))
    pixels = scale * windows[0].camera.unit
    nats = []
    for window, found in zip(windows, _refined(windows, groups, fits), strict=True):
        measured = measure(window, found, pixels / window.camera.unit, rows)
        nats.append(measured.nats.min(axis=1).sum())
    return float(nats[0] - nats[1])


def _refined(windows, groups, fits):
    """Motions of groups in each of some windows, refined from the same ones."""
    jobs = [(window, rows) for window in windows for rows in groups]
    every = list(fits) * len(windows)
    for _ in range(ROUNDS):
        found = fit_motions(jobs, every)
        every = [new or old for new, old in zip(found, every, strict=True)]
    return [every[k : k + len(fits)] for k in range(0, len(every), len(fits))]


def _is_better(gains):
    """Whether gains of a focal length are no accident."""
    if len(gains) < FEWEST:
        return False
    error = np.std(gains, ddof=1) / np.sqrt(len(gains))
    return np.mean(gains) > max(NATS, ERRORS * error)
