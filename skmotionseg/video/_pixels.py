"""Where points of tracks are among pixels, whose centres are at whole numbers."""

from __future__ import annotations

import numpy as np


def at_scale(points, scale):
    """Points (..., 2) in a frame that was made so many times as large.

    Parameters
    ----------
    points : ndarray of shape (..., 2)
    scale : float, or ndarray of shape (2,)
        Of width and height.

    Returns
    -------
    ndarray of shape (..., 2)
    """
    return (points + 0.5) * scale - 0.5


def nearest_pixels(points, shape):
    """Rows and columns of the pixels of a picture that points are nearest to.

    Parameters
    ----------
    points : ndarray of shape (n, 2)
    shape : tuple of (height, width)

    Returns
    -------
    row, column : ndarray of int, shape (n,)
    """
    column, row = np.rint(points).astype(int).T
    return row.clip(0, shape[0] - 1), column.clip(0, shape[1] - 1)
