"""The focal length and the lens, estimated as long as a stream goes on."""

from __future__ import annotations

import numpy as np

from ..geometry.camera import USUAL_FOCAL_LENGTH

# Frames from one estimate to the next.
FRAMES_PER_ESTIMATE = 6
# Tracks of a motion that has a say.
FEWEST_TELLING = 10
# Of usual cameras, standard deviations of the logarithm of the focal length and of the
# bend of the lens.
SPREADS = 0.5, 0.03
# Residuals that say as much as one that is independent: windows overlap, and noise of
# trackers drifts and is shared by neighbours.
ALIKE = 12.0
# However much was seen, standard deviations are at least these, so that a lens that
# zooms is followed.
SUREST = 0.01, 0.002
# What an estimate may change at a time: motions are to follow.
MOST_CHANGED = 0.25, 0.03
# Focal lengths that are possible, in widths of the picture, and bends of a lens.
SHORTEST, LONGEST, MOST_BENT = 0.3, 5.0, 0.2


class CameraEstimate:
    """What motions have told of the focal length and of the lens so far.

    One Gauss-Newton step per estimate, in which what is known from before, and at first
    of usual cameras, is one more observation. What nothing is told of, such as the lens
    of a camera that stands still, remains that of a usual one.

    Parameters
    ----------
    width : float
        Of the picture, pixels.
    focal_length : float, optional
        Pixels; if it is given, it stays, and only the lens is estimated.

    Attributes
    ----------
    values : ndarray of shape (2,)
        Logarithm of the focal length in pixels, and bend of the lens.
    precision : ndarray of shape (2, 2)
        Inverse of their covariance.
    """

    def __init__(self, width, focal_length=None):
        shares, spreads = np.array([USUAL_FOCAL_LENGTH, SHORTEST, LONGEST]), SPREADS
        first, low, high = np.log(shares * width)
        if focal_length is not None:
            first = low = high = np.log(focal_length)
            spreads = SUREST[0], SPREADS[1]
        self.values = np.array([first, 0.0])
        self.precision = np.diag(1 / np.square(spreads))
        self._range = np.array([[low, -MOST_BENT], [high, MOST_BENT]])

    def improved(self, window, groups, fits):
        """A camera that explains motions better.

        Parameters
        ----------
        window : Window
        groups : list of ndarray of int
            Tracks of the motions.
        fits : list of Fit

        Returns
        -------
        camera : Camera
            The window's, changed by no more than motions follow.
        known : tuple of (ndarray of shape (2,), ndarray of shape (2, 2))
            What :meth:`add` takes in: the likeliest values, and their precision.
        """
        telling = [k for k, rows in enumerate(groups) if len(rows) >= FEWEST_TELLING]
        information, gradient = window.camera_information(
            [groups[k] for k in telling], [fits[k] for k in telling]
        )
        camera = window.camera
        present = np.array([np.log(camera.unit), camera.bend])
        precision = self.precision + information / ALIKE
        gradient = gradient / ALIKE + self.precision @ (self.values - present)
        change = np.linalg.solve(precision, gradient)
        values = np.clip(present + change, *self._range)
        shorter = np.max(np.abs(change) / MOST_CHANGED)
        changed = np.clip(present + change / max(shorter, 1), *self._range)
        return camera.changed(*changed), (values, precision)

    def add(self, values, precision):
        """Take what :meth:`improved` found as what is known from now on."""
        self.values = values
        scale = np.array(SUREST)
        sizes, axes = np.linalg.eigh(precision * np.outer(scale, scale))
        self.precision = (axes * np.minimum(sizes, 1)) @ axes.T / np.outer(scale, scale)
