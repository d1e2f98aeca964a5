"""What speaks for which motion at a pixel: tracks, optical flow and colour."""

from __future__ import annotations

import numpy as np

from .._utils.optional import require
from ._pixels import nearest_pixels

# Side, in pixels of the working size, of the cells in which tracks are averaged.
CELL = 8
# Standard deviation, pixels, of optical flow about the motion it belongs to; the share
# of its length that is added; and what each pixel to the nearest track adds.
FLOW_NOISE, FLOW_SHARE, FIELD_DRIFT = 0.3, 0.05, 0.02
# Gradient, grey levels per pixel, at which optical flow is half believed.
FLOW_TEXTURE = 2.0
# Standard deviation of grey values from frame to frame; side of the window, pixels, in
# which pictures are compared; squared deviations from which on they are all the same;
# and how many pixels a window is worth, as neighbours repeat each other.
GREY_NOISE, LOOK, MOST_MISS, LOOK_WORTH = 3.0, 5, 9.0, 25.0
# Side of the window, pixels, whose texture a track is taken to follow: somewhat more
# than that of the tracker, as what is begun by dense optical flow follows more.
TRACK_WINDOW = 15
# Pixels from its nearest track at which a motion is as likely as on it; and over which
# it becomes less so beyond, by a factor e.
NEAR, REACH = 48.0, 10.0
# Side of the cells of a colour grid: pixels, and levels of the CIELAB channels.
COLOUR_CELL, COLOUR_STEPS = 32, (20, 10, 10)
# The most, in nats, that one kind of evidence may speak against a motion.
MOST_FLOW, MOST_DISTANCE, MOST_COLOUR, MOST_LOOK, MOST_EXTENT = 4.0, 4.0, 3.0, 4.0, 3.0


def pixels(shape):
    """Columns (1, width) and rows (height, 1) of a picture's pixels, float32."""
    height, width = shape[:2]
    return (
        np.arange(width, dtype=np.float32)[None],
        np.arange(height, dtype=np.float32)[:, None],
    )


def warp(values, flow):
    """Values (height, width) or (height, width, n) of where the flow leads."""
    cv2 = require("cv2", extra="video")
    x, y = pixels(flow.shape)
    return cv2.remap(
        values,
        x + flow[..., 0],
        y + flow[..., 1],
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )


def squared_length(vectors):
    """Of the last axis; much quicker than by ``sum``, as that axis is short."""
    return np.einsum("...k,...k->...", vectors, vectors)


def flow_agreement(flow, back):
    """How far flow there and back again can be believed, pixel by pixel: 0 to 1."""
    miss = squared_length(flow + warp(back, flow))
    allowed = 0.5 + 0.05 * np.hypot(flow[..., 0], flow[..., 1])
    return np.exp(-miss / (2 * allowed**2))


def gradient_energy(grey):
    """Squared gradient (height, width), of grey levels per pixel, float32."""
    cv2 = require("cv2", extra="video")
    grey = grey.astype(np.float32)
    x, y = (cv2.Sobel(grey, -1, *axis, scale=1 / 8) for axis in ((1, 0), (0, 1)))
    return x * x + y * y


def texture_trust(energy):
    """How far the texture of a picture lets flow be believed: 0 to 1."""
    cv2 = require("cv2", extra="video")
    energy = cv2.boxFilter(energy, -1, (7, 7))
    return energy / (energy + FLOW_TEXTURE**2)


# ------------------------------------------------------------------------------- flow


def motion_fields(points, steps, labels, n_labels, shape):
    """Fields of motions: :func:`motion_field` of each, None where tracks are few.

    Parameters
    ----------
    points, steps : ndarray of shape (n, 2)
        Tracks, and how far they move from one frame to another; pixels.
    labels : ndarray of int, shape (n,)
        Their motions, 0 to ``n_labels - 1``.
    n_labels : int
    shape : tuple of int
        (height, width)

    Returns
    -------
    list of (field, distance) or None
    """
    groups = (labels == label for label in range(n_labels))
    return [
        motion_field(points[rows], steps[rows], shape) if rows.sum() >= 3 else None
        for rows in groups
    ]


def flow_evidence(flow, trust, fields):
    """Log-likelihood of the flow at each pixel under each motion, relative to the best.

    The flow is normal about the field of the motion it belongs to, more widely where no
    track of it is near.

    Parameters
    ----------
    flow : ndarray of float32, shape (height, width, 2)
    trust : ndarray of float32, shape (height, width)
        How far to believe it: 0 to 1.
    fields : list of (field, distance) or None
        As of :func:`motion_fields`.

    Returns
    -------
    ndarray of float32, shape (n_labels, height, width)
        From ``-MOST_FLOW`` to 0.
    """
    middle = np.median(flow, axis=(0, 1))
    noise = FLOW_NOISE + FLOW_SHARE * np.hypot(*np.moveaxis(flow - middle, 2, 0))
    logs = np.full((len(fields), *flow.shape[:2]), -50, dtype=np.float32)
    for label, known in enumerate(fields):
        if known is not None:
            field, distance = known
            variance = noise**2 + (FIELD_DRIFT * distance) ** 2
            misses = squared_length(flow - field)
            logs[label] = -misses / (2 * variance) - np.log(variance) / 2
    return np.maximum(logs - logs.max(axis=0), -MOST_FLOW) * trust


def appearance(grey, other, energy, fields):
    """Log-likelihood of a picture under each motion, given another of the same video.

    Where a motion carries the other picture to this one, grey values agree, but for
    noise and for gradients times what the motion's field may be wrong by. Unlike
    optical flow, which is smooth, this says something of pixels next to an outline.

    Parameters
    ----------
    grey, other : ndarray of float32, shape (height, width)
        The picture and that to which the fields lead.
    energy : ndarray of float32, shape (height, width)
        As of :func:`gradient_energy`, of the picture.
    fields : list of (field, distance) or None
        As of :func:`motion_fields`.

    Returns
    -------
    ndarray of float32, shape (n_labels, height, width)
        Mean per pixel over a small window; up to a constant.
    """
    cv2 = require("cv2", extra="video")
    logs = np.empty((len(fields), *grey.shape), dtype=np.float32)
    for label, known in enumerate(fields):
        variance, misses = GREY_NOISE**2 + FLOW_NOISE**2 * energy, MOST_MISS
        if known is not None:
            field, distance = known
            variance = variance + (FIELD_DRIFT * distance) ** 2 * energy
            squares = np.square(grey - warp(other, field))
            misses = np.minimum(squares / variance, MOST_MISS)
        each = -(misses + np.log(variance)) / 2
        logs[label] = cv2.boxFilter(each, -1, (LOOK, LOOK))
    return logs


def motion_field(points, steps, shape):
    """Displacements of a motion over the picture, from those of its tracks.

    It is an affine one, fitted robustly, and what that leaves of the tracks, averaged
    in cells and filled in between.

    Parameters
    ----------
    points, steps : ndarray of shape (n, 2)
    shape : tuple of int
        (height, width)

    Returns
    -------
    field : ndarray of float32, shape (height, width, 2)
    distance : ndarray of float32, shape (height, width)
        Pixels to the nearest track, to within a cell.
    """
    cv2 = require("cv2", extra="video")
    n_rows, n_columns = -(-shape[0] // CELL), -(-shape[1] // CELL)
    affine = fit_affine(points, steps)
    left = steps - _affine_at(points, affine)
    column, row = (points // CELL).astype(int).T
    row, column = row.clip(0, n_rows - 1), column.clip(0, n_columns - 1)
    cells = row * n_columns + column
    sums = [
        np.bincount(cells, weight, n_rows * n_columns).reshape(n_rows, n_columns)
        for weight in (*left.T, None)
    ]
    count = sums[2].astype(np.float32)
    means = np.dstack(sums[:2]).astype(np.float32) / np.maximum(count, 1)[..., None]
    y, x = np.mgrid[:n_rows, :n_columns] * CELL + (CELL - 1) / 2
    smooth = _affine_at(np.stack([x, y], axis=2), affine)
    field = fill(means, 0.7 * np.minimum(count, 1)) + smooth.astype(np.float32)
    distance = cv2.distanceTransform(np.uint8(count == 0), cv2.DIST_L2, 3) * CELL
    size = (n_columns * CELL, n_rows * CELL)
    field, distance = (cv2.resize(each, size) for each in (field, distance))
    return field[: shape[0], : shape[1]], distance[: shape[0], : shape[1]]


def fit_affine(points, steps, n_rounds=5):
    """Affine displacements (3, 2) of tracks, weighing them down by what they miss."""
    if len(points) < 6:
        return np.vstack([np.zeros((2, 2)), np.median(steps, axis=0)])
    design = np.column_stack([points, np.ones(len(points))])
    root = np.ones((len(points), 1))
    for _ in range(n_rounds):
        affine = np.linalg.lstsq(design * root, steps * root, rcond=1e-6)[0]
        miss = np.hypot(*(steps - design @ affine).T)
        scale = 2 * (1.48 * np.median(miss) + 0.05)
        root = np.sqrt(1 / (1 + np.square(miss / scale)))[:, None]
    return affine


def _affine_at(points, affine):
    return points @ affine[:2] + affine[2]


def fill(values, weight, n_levels=6):
    """Fill the gaps of a field from coarser and coarser averages of it.

    Parameters
    ----------
    values : ndarray of float32, shape (height, width, n)
    weight : ndarray of float32, shape (height, width)
        0 in gaps, up to 1 where the values are to be kept.

    Returns
    -------
    ndarray of float32, shape (height, width, n)
    """
    cv2 = require("cv2", extra="video")
    levels = [np.dstack([values * weight[..., None], weight]).astype(np.float32)]
    while len(levels) <= n_levels and min(levels[-1].shape[:2]) > 1:
        levels.append(4 * cv2.pyrDown(levels[-1]))
    total = levels[-1].sum(axis=(0, 1))
    filled = np.broadcast_to(
        total[:-1] / max(total[-1], 1e-6), (*levels[-1].shape[:2], values.shape[2])
    ).astype(np.float32)
    for level in levels[::-1]:
        size = level.shape[1::-1]
        filled = cv2.resize(np.ascontiguousarray(filled), size)
        kept = np.minimum(level[..., -1:], 1)
        mean = level[..., :-1] / np.maximum(level[..., -1:], 1e-6)
        filled = kept * mean + (1 - kept) * filled
    return filled


# ----------------------------------------------------------------------------- tracks


def track_counts(points, labels, n_labels, shape):
    """Tracks of each motion at each pixel: (n_labels, height, width), float32."""
    counts = np.zeros((n_labels, *shape), dtype=np.float32)
    np.add.at(counts, (labels, *nearest_pixels(points, shape)), 1)
    return counts


def texture_centres(energy):
    """Steps from each pixel to the middle of the texture around: (height, width, 2).

    The movement of a window is that of what can be seen to move in it. Where a thing
    moves before a plain wall, points of the wall next to its outline go with it; their
    texture is the outline's, and they are moved there.

    Parameters
    ----------
    energy : ndarray of float32, shape (height, width)
        As of :func:`gradient_energy`.
    """
    cv2 = require("cv2", extra="video")
    r = TRACK_WINDOW // 2  # the picture goes on beyond its edges, lest these pull
    energy = cv2.copyMakeBorder(energy + 1e-2, r, r, r, r, cv2.BORDER_REFLECT_101)
    x, y = pixels(energy.shape)

    def total(values):
        return cv2.boxFilter(values, -1, (TRACK_WINDOW, TRACK_WINDOW))

    mass = total(energy)
    steps = np.dstack([total(energy * at) / mass - at for at in (x, y)])
    return steps[r:-r, r:-r]


def track_hulls(points, labels, n_labels, shape):
    """Where the convex hull of the tracks of each motion is.

    Parameters
    ----------
    points : ndarray of shape (n, 2)
        Tracks, pixels.
    labels : ndarray of int, shape (n,)
        Their motions, 0 to ``n_labels - 1``.
    n_labels : int
    shape : tuple of int
        (height, width)

    Returns
    -------
    ndarray of uint8, shape (n_labels, height, width)
        1 inside, 0 outside.
    """
    cv2 = require("cv2", extra="video")
    hulls = np.zeros((n_labels, *shape), dtype=np.uint8)
    places = np.rint(points).astype(np.int32)
    for label, hull in enumerate(hulls):
        own = places[labels == label]
        if len(own):
            cv2.fillConvexPoly(hull, cv2.convexHull(own), 1)
    return hulls


def distance_evidence(counts, hulls):
    """Log-odds of each motion by how far its nearest track is, to the best's.

    Within ``NEAR`` distances do not count: next to a thing, tracks of what is behind it
    end, and it would reach out to where these begin again. Nor do they count against
    the motion of most tracks where nothing else extends: a plain road is far from the
    tracks of the scene, but not for the car on it.

    Parameters
    ----------
    counts : ndarray of float32, shape (n_labels, height, width)
        As of :func:`track_counts`.
    hulls : ndarray of uint8, shape (n_labels, height, width)
        As of :func:`track_hulls`.

    Returns
    -------
    ndarray of float32, shape (n_labels, height, width)
        From ``-MOST_DISTANCE`` to 0.
    """
    if not counts.any():
        return np.zeros_like(counts)
    cv2 = require("cv2", extra="video")
    far = np.full_like(counts, sum(counts.shape[1:]))
    for label, count in enumerate(counts):
        if count.any():
            far[label] = cv2.distanceTransform(np.uint8(count == 0), cv2.DIST_L2, 3)
    logs = np.maximum(far - NEAR, 0) / -REACH
    largest = counts.sum(axis=(1, 2)).argmax()
    others = np.delete(hulls, largest, axis=0).max(axis=0, initial=0)
    window = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (TRACK_WINDOW, TRACK_WINDOW))
    logs[largest] *= cv2.dilate(others, window)
    return np.maximum(logs - logs.max(axis=0), -MOST_DISTANCE)


def extent_evidence(counts, hulls):
    """Log-odds of each motion by its share of the tracks, to those of the largest.

    Where nothing else tells, as on a plain road beside a car, a pixel is more likely of
    the motion that has more of the picture. In the convex hull of a motion's tracks
    that does not count against it: things have plain surfaces, too.

    Parameters
    ----------
    counts : ndarray of float32, shape (n_labels, height, width)
        As of :func:`track_counts`.
    hulls : ndarray of uint8, shape (n_labels, height, width)
        As of :func:`track_hulls`.

    Returns
    -------
    ndarray of float32, shape (n_labels, height, width)
        From ``-MOST_EXTENT`` to 0.
    """
    shares = np.log(counts.sum(axis=(1, 2)) + 1)  # one more: never none
    odds = np.maximum(shares - shares.max(), -MOST_EXTENT)
    return np.where(hulls, 0, odds[:, None, None]).astype(np.float32)


# ----------------------------------------------------------------------------- colour


class ColourGrid:
    """Colours of each motion, each place of the picture by itself.

    A histogram over place and colour, five-dimensional and coarse, smoothed along each
    axis: the bilateral grid.

    Parameters
    ----------
    shape : tuple of int
        (height, width) of the picture.

    References
    ----------
    N. Maerki et al., "Bilateral Space Video Segmentation", CVPR 2016.
    """

    def __init__(self, shape):
        self._y, self._x = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
        colours = (
            256 // COLOUR_STEPS[0] + 1,
            *(128 // s + 1 for s in COLOUR_STEPS[1:]),
        )
        self._shape = (
            shape[0] // COLOUR_CELL + 2,
            shape[1] // COLOUR_CELL + 2,
            *colours,
        )

    def colours(self, picture):
        """Cells of the colours of a picture: three arrays (height, width)."""
        cv2 = require("cv2", extra="video")
        lab = cv2.cvtColor(picture, cv2.COLOR_BGR2Lab).astype(np.int32)
        light, red, blue = np.moveaxis(lab, 2, 0)
        return (
            light // COLOUR_STEPS[0],
            (red - 64).clip(0, 127) // COLOUR_STEPS[1],
            (blue - 64).clip(0, 127) // COLOUR_STEPS[2],
        )

    def cells(self, colours, flow=None):
        """Cell of each pixel (height, width), as one number, moved by the flow."""
        y, x = self._y, self._x
        if flow is not None:
            x, y = x + flow[..., 0], y + flow[..., 1]
        places = (
            np.rint(at / COLOUR_CELL).astype(np.int32).clip(0, n - 1)
            for at, n in zip((y, x), self._shape[:2], strict=True)
        )
        return np.ravel_multi_index((*places, *colours), self._shape)

    def evidence(self, seen, probabilities, cells):
        """Log-odds of each motion by the colours around, relative to the best.

        Pixels count by how much more likely they are of a motion than not.

        Parameters
        ----------
        seen : ndarray of int, shape (height, width)
            Cells of pixels whose motions are known ...
        probabilities : ndarray of float32, shape (n_labels, height, width)
            ... by these probabilities.
        cells : ndarray of int, shape (height, width)
            Those of the pixels that are asked for.

        Returns
        -------
        ndarray of float32, shape (n_labels, height, width)
            From ``-MOST_COLOUR`` to 0.
        """
        n_cells = int(np.prod(self._shape))
        sure = np.maximum(2 * probabilities - 1, 0)
        counts = np.stack(
            [np.bincount(seen.ravel(), p.ravel(), n_cells) for p in sure]
        ).astype(np.float32)
        if not counts.any():  # no pixel is likelier of one motion than not
            return np.zeros_like(probabilities)
        counts = counts.reshape(-1, *self._shape)
        filled = self._filled(counts)
        counts[filled] = _smoothed(counts[filled])
        found = counts.reshape(len(probabilities), -1)[:, cells]
        total = found.sum(axis=0)
        logs = np.log(found / (total + 1e-6) + 0.02)
        logs = np.maximum(logs - logs.max(axis=0), -MOST_COLOUR)
        return logs * np.minimum(total / 5, 1)

    def _filled(self, counts):
        """Slices of counts (n, ...) outside which they are, and stay, 0.

        A picture has few of the colours that there are.
        """
        places = np.unravel_index(np.flatnonzero(counts.any(axis=0)), counts.shape[1:])
        return (
            slice(None),
            *(slice(max(at.min() - 1, 0), at.max() + 2) for at in places),
        )


def _smoothed(counts):
    """Counts (n, ...) averaged with their neighbours along all axes but the first."""
    for axis in range(1, counts.ndim):
        ahead = (slice(None),) * axis
        result = counts / 2
        result[(*ahead, slice(1, None))] += counts[(*ahead, slice(None, -1))] / 4
        result[(*ahead, slice(None, -1))] += counts[(*ahead, slice(1, None))] / 4
        counts = result
    return counts
