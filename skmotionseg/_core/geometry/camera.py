"""The camera that all motions of a video share: its focal length and its lens.

A lens bends lines by the division model of Fitzgibbon [1]_: with ``d`` the place of a
pixel from the principal point, in units of a radius, the same ray would be seen at ``d
/ (1 + bend |d|^2)`` without distortion. A negative ``bend`` is that of a barrel.

References
----------
.. [1] A. Fitzgibbon, "Simultaneous linear estimation of multiple view geometry and lens
   distortion", CVPR 2001. https://doi.org/10.1109/CVPR.2001.990465
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .tracks import covered

# Least standard deviation of the noise: pixels in a video 640 pixels wide.
REFERENCE_WIDTH = 640
LEAST_NOISE = 0.15
# The focal length of a usual camera, as a share of the larger side of what tracks cover
# (24 to 50 mm in front of 36 mm are 0.67 to 1.4; of phones and cars, 0.5 to 0.8).
USUAL_FOCAL_LENGTH = 0.85
# Least and greatest ones that differ from others: beyond, tracks show no perspective,
# or nothing else, and numbers lose their digits.
SHORTEST, LONGEST = 0.05, 10.0
# Values under a root are at least this: beyond, a lens shows nothing.
LEAST_ROOT = 0.05


def log_ratio(one, other=USUAL_FOCAL_LENGTH):
    """How far a focal length is from another, by default a usual one: 0 if the same."""
    return abs(np.log(one / other))


def share_of_width(focal_length, width):
    """A focal length that was given in pixels, in widths of what tracks cover."""
    return float(np.clip(focal_length / width, SHORTEST, LONGEST))


class Camera(NamedTuple):
    """How pixels are calibrated.

    Attributes
    ----------
    middle : ndarray of shape (2,)
        Principal point, pixels.
    unit : float
        Focal length, pixels.
    noise : float
        Least standard deviation of the noise, in calibrated coordinates.
    radius : float
        Distance from the middle at which the lens moves what is seen by ``bend``,
        pixels.
    bend : float
        0 for a lens that keeps lines straight.
    """

    middle: np.ndarray
    unit: float
    noise: float
    radius: float = 1.0
    bend: float = 0.0

    @classmethod
    def around(cls, points, share, seen=None):
        """A camera that looks at the middle of points, as :func:`.tracks.covered`.

        Its focal length is a share of the larger side of what they cover, and its
        radius half of the diagonal.
        """
        low, high = covered(points, seen)
        size = float((high - low).max()) or 1.0
        noise = LEAST_NOISE / (REFERENCE_WIDTH * share)
        radius = float(np.hypot(*(high - low)) / 2) or 1.0
        return cls((low + high) / 2, share * size, noise, radius)

    def straightened(self, points):
        """Pixels (..., 2) at which a lens without distortion would show points."""
        away = points - self.middle
        squares = (away**2).sum(axis=-1, keepdims=True) / self.radius**2
        return self.middle + away / np.maximum(1 + self.bend * squares, LEAST_ROOT)

    def calibrated(self, points):
        """Calibrated coordinates of points (..., 2), pixels."""
        return (self.straightened(points) - self.middle) / self.unit

    def of_focal_length(self, unit):
        """The same camera with another focal length, pixels."""
        return self._replace(unit=unit, noise=self.noise * self.unit / unit)

    def changed(self, log_focal_length, bend):
        """The same camera with another focal length, in logarithm, and lens."""
        camera = self.of_focal_length(float(np.exp(log_focal_length)))
        return camera._replace(bend=float(bend))

    def derivatives(self, x):
        """By how much calibrated coordinates of a pixel change with the camera.

        Parameters
        ----------
        x : ndarray of shape (2, ...)
            Calibrated coordinates.

        Returns
        -------
        ndarray of shape (2, 2, ...)
            By the logarithm of the focal length, and by the bend.
        """
        squares = (x**2).sum(axis=0) * (self.unit / self.radius) ** 2
        root = np.sqrt(np.maximum(1 - 4 * self.bend * squares, LEAST_ROOT))
        # With d = x (1 + bend |d|^2), |d|^2 / (1 + bend |d|^2):
        return np.stack([-x, -x * (2 * squares / (1 + root))])
