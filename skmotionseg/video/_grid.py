"""Bookkeeping of a tracker that sows points on a grid: positions, no pictures."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import binary_dilation, map_coordinates, median_filter
from scipy.spatial import KDTree

from ._looks import without_sliding

# A new point keeps this many grid spacings away from live ones: less, and points pile
# up where the picture moves across the grid; more, and gaps stay open.
CLEARANCE = 0.75
# Cells, per side, among which a cell's flow is compared; by how much it must differ
# from their median, pixels; and how many times the usual difference is added to that.
AROUND = 15
LEAST_CONTRAST, CONTRAST_SHARE = 0.4, 3.0


class TrackLog:
    """Where which track was, frame by frame; grows with observations only.

    Attributes
    ----------
    n_frames : int
        Frames recorded so far.
    """

    def __init__(self):
        self._ids, self._points, self._slid = [], [], []

    @property
    def n_frames(self):
        return len(self._ids)

    def record(self, ids, points, slid=()):
        """Append a frame.

        Parameters
        ----------
        ids : ndarray of int, shape (n_live,)
            Each at most once.
        points : ndarray of shape (n_live, 2)
        slid : sequence of int
            Tracks that were seen to have slid (see :func:`without_sliding`).
        """
        self._slid.append(slid)
        self._ids.append(ids.astype(np.int32))
        self._points.append(points.astype(np.float32))

    def assemble(self, min_length):
        """All tracks of at least so many frames, by id.

        Parameters
        ----------
        min_length : int

        Returns
        -------
        ndarray of shape (n_tracks, n_frames, 2), float32
            NaN where a track was not seen.
        """
        tracked = zip(self._ids, self._points, self._slid, strict=True)
        frames = list(without_sliding(tracked))
        known = [ids for ids, _ in frames]
        lengths = np.bincount(np.concatenate([*known, np.empty(0, np.int32)]))
        long = lengths >= min_length
        row = np.cumsum(long) - 1
        tracks = np.full((long.sum(), self.n_frames, 2), np.nan, dtype=np.float32)
        for frame, (ids, points) in enumerate(frames):
            kept = long[ids]
            tracks[row[ids[kept]], frame] = points[kept]
        return tracks


def seed_points(texture, spacing, threshold, live):
    """The best textured pixel of each grid cell that no track is in or near.

    Parameters
    ----------
    texture : ndarray of shape (height, width)
        How well the picture tells a point's place, pixel by pixel.
    spacing : int
        Side of the square cells, pixels; the last ones may be cut by the picture's
        edge.
    threshold : float
        The texture must exceed it.
    live : ndarray of shape (n, 2)
        Points (x, y) of live tracks, inside the picture.

    Returns
    -------
    ndarray of shape (m, 2), float64
        At least ``CLEARANCE * spacing`` from every live point.
    """
    height, width = texture.shape
    n_rows, n_columns = -(-height // spacing), -(-width // spacing)
    cells = np.full((n_rows * spacing, n_columns * spacing), -np.inf)
    cells[:height, :width] = texture
    cells = cells.reshape(n_rows, spacing, n_columns, spacing).swapaxes(1, 2)
    cells = cells.reshape(n_rows, n_columns, spacing**2)
    open_cells = cells.max(axis=2) > threshold
    x, y = np.rint(live).astype(int).T // spacing
    open_cells[y, x] = False
    row, column = np.nonzero(open_cells)
    down, right = np.divmod(cells[row, column].argmax(axis=1), spacing)
    seeds = np.column_stack([column * spacing + right, row * spacing + down])
    seeds = seeds.astype(float)
    if len(live) == 0 or len(seeds) == 0:
        return seeds
    distance, _ = KDTree(live).query(seeds)
    return seeds[distance >= CLEARANCE * spacing]


def sample_field(field, points):
    """Values of a vector field between pixels, bilinear.

    Parameters
    ----------
    field : ndarray of shape (height, width, 2)
    points : ndarray of shape (n, 2)
        Places (x, y); outside, the nearest edge counts.

    Returns
    -------
    ndarray of shape (n, 2)
    """
    x, y = points.T
    parts = [
        map_coordinates(field[..., axis], [y, x], order=1, mode="nearest")
        for axis in range(2)
    ]
    return np.column_stack(parts)


def field_gradient(field, points):
    """How fast a vector field changes at some places, a pixel.

    Parameters
    ----------
    field : ndarray of shape (height, width, 2)
    points : ndarray of shape (n, 2)

    Returns
    -------
    ndarray of shape (n,)
        Frobenius norm of the Jacobian, by differences over two pixels.
    """
    across, down = (
        (sample_field(field, points + step) - sample_field(field, points - step)) / 2
        for step in ([1.0, 0.0], [0.0, 1.0])
    )
    return np.sqrt((across**2 + down**2).sum(axis=1))


def stands_out(field, cell):
    """Where a vector field differs from what it is around.

    Parameters
    ----------
    field : ndarray of shape (height, width, 2)
    cell : int
        Side of the square cells in which it is compared, pixels.

    Returns
    -------
    ndarray of bool, shape (height, width)
        Cells whose median differs by more than ``LEAST_CONTRAST``, and a share of how
        far the field is spread, from the median of the ``AROUND`` x ``AROUND`` cells
        around, grown by a cell on each side.
    """
    height, width = field.shape[:2]
    top, left = (min(cell // 2, side - 1) for side in (height, width))
    middle = field[top::cell, left::cell]
    around = np.stack([_median_around(part) for part in np.moveaxis(middle, 2, 0)])
    contrast = np.hypot(*(np.moveaxis(middle, 2, 0) - around))
    limit = LEAST_CONTRAST + CONTRAST_SHARE * np.median(contrast)
    apart = binary_dilation(median_filter(contrast, 3) > limit, np.ones((3, 3)))
    row, column = (
        np.minimum(np.arange(n) // cell, m - 1)
        for n, m in zip((height, width), apart.shape, strict=True)
    )
    return apart[row[:, None], column]


def _median_around(values):
    """Median of the cells around each; slopes go on beyond the edges."""
    margin = AROUND // 2
    if min(values.shape) <= margin:
        return median_filter(values, AROUND)
    padded = np.pad(values, margin, mode="reflect", reflect_type="odd")
    # All windows of a row of cells at once: several times as quick as median_filter,
    # which takes cell by cell.
    windows = sliding_window_view(padded, (AROUND, AROUND))
    middle = AROUND**2 // 2
    rows = (row.reshape(-1, AROUND**2) for row in windows)
    return np.stack([np.partition(row, middle, axis=1)[:, middle] for row in rows])


def is_inside(points, shape):
    """Which points (n, 2) lie in a picture of that shape (height, width)."""
    height, width = shape
    x, y = points.T
    return (x >= 0) & (y >= 0) & (x <= width - 1) & (y <= height - 1)
