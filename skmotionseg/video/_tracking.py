"""Tracks of points through a video."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from numbers import Integral, Real
from typing import NamedTuple

import numpy as np

from .._core.geometry.tracks import FEWEST_GO_ON, pack_tracks
from .._utils.optional import require
from ._checks import check_number, make_reporter
from ._frames import SMALLEST_SIDE, Progress, Source, open_frames
from ._grid import (
    TrackLog,
    field_gradient,
    is_inside,
    sample_field,
    seed_points,
    stands_out,
)
from ._looks import NOISE_OF_GREY, WINDOW, Looks
from ._pixels import nearest_pixels

# Where flow changes by more, in pixels per pixel, one thing covers another, and tracks
# of the covered one would go on with the other. Sundaram et al. let the limit grow with
# the flow, which lets such tracks through in quick scenes.
MAX_FLOW_GRADIENT = 0.22
# Cells of the grid that frames have by default, and the sides that these have.
N_CELLS = 4800
SMALLEST_SPACING, LARGEST_SPACING = 5, 8
# Share of the cells that may be added where things move.
EXTRA_CELLS = 0.25
# Pixels of the shorter side for which DIS has all the scales that it uses: its patches
# of eight, at its finest scale of a quarter.
SMALLEST_FOR_FLOW = 32
# By default, pixels that a point may miss on the way back, and the least texture of a
# new one, as a share of the mean.
MAX_ERROR, MIN_TEXTURE = 1.0, 0.03


@dataclass(frozen=True, eq=False)
class VideoTracks:
    """Tracks of a video, and what there is to know about it.

    Parameters
    ----------
    tracks : ndarray of shape (n_tracks, 2 * n_frames), float32
        In pixels of the video; NaN where unseen. The ``X`` of the estimators.
    n_frames : int
    width, height : int
        Of a frame, in pixels.
    fps : float or None
        Frames per second, where the source says.

    Examples
    --------
    >>> import numpy as np
    >>> from skmotionseg.video import VideoTracks
    >>> VideoTracks(np.zeros((1, 4)), n_frames=2, width=64, height=48, fps=25.0).fps
    25.0
    """

    tracks: np.ndarray
    n_frames: int
    width: int
    height: int
    fps: float | None


@dataclass(frozen=True, eq=False)
class TrackedFrame:
    """A frame, and the points that are tracked in it.

    Parameters
    ----------
    frame : ndarray of shape (height, width, 3), uint8
        Blue first.
    points : ndarray of shape (n_points, 2)
        In pixels of the frame.
    ids : ndarray of int, shape (n_points,)
        Of their tracks.

    Examples
    --------
    >>> import numpy as np
    >>> from skmotionseg.video import TrackedFrame
    >>> frame = np.zeros((48, 64, 3), np.uint8)
    >>> TrackedFrame(frame, np.ones((1, 2)), np.array([7])).ids
    array([7])
    """

    frame: np.ndarray
    points: np.ndarray
    ids: np.ndarray


def track_video(
    source: Source,
    *,
    grid_spacing: int | None = None,
    max_error: float = MAX_ERROR,
    min_length: int = 5,
    min_texture: float = MIN_TEXTURE,
    max_frames: int | None = None,
    max_side: int | None = None,
    progress: Progress | None = None,
) -> VideoTracks:
    """Track points on a dense grid through a video.

    In each frame, each cell of the grid that no track is in or near gets a new one, at
    its best textured pixel. Where the flow differs from that around, as on a small
    thing that moves, cells have half the side, or as much as adds no more than a
    quarter to their number. A track follows the optical flow (DIS, then
    Lucas-Kanade to a few hundredths of a pixel) for as long as the flow leads back to
    where it came from, away from edges of moving things, and inside the picture. It
    ends, too, where it has left points that were around it four to eight frames before,
    and what is around it no longer looks as it did: the outline of a thing takes points
    of what is behind along. Its last eight frames are then left out. If fewer than a
    quarter of the tracks can go on, and the grey value is as it was at fewer than a
    quarter of them, the picture has been cut, and all end.

    Frames are read one at a time and no more than three are held; memory grows with
    the tracks alone.

    Parameters
    ----------
    source : path or iterable of arrays
        A video file (.mp4, .mov, .avi, .mkv, .webm), a folder of frames (.png, .jpg, in
        the order of the numbers in their names), or frames as uint8 arrays of shape
        (height, width) or (height, width, 3), blue first.
    grid_spacing : int, optional
        Side of the square cells, pixels. By default 8, or less, down to 5, in frames of
        fewer than 640 x 480 pixels, so that they get as many tracks.
    max_error : float, default=1.0
        A track ends where going forward and back again misses by more pixels than
        this.
    min_length : int, default=5
        Tracks seen in fewer frames are dropped; of a source of fewer frames, those that
        are not seen in all.
    min_texture : float, default=0.03
        Tracks start where the smaller eigenvalue of the structure tensor exceeds this
        share of its mean over the frame: elsewhere the flow is a guess. (Sundaram et
        al. take 1/8, which leaves few tracks on things that are plainer than the rest.)
    max_frames : int, optional
        Stop after so many.
    max_side : int, optional
        Frames of a longer side are shrunk to it to be tracked, which is faster;
        ``grid_spacing`` and ``max_error`` are pixels of the shrunk frame, the tracks
        those of the video.
    progress : callable, optional
        Called after each frame with the number done and the number there should be
        (None if the source does not say).

    Returns
    -------
    VideoTracks

    Raises
    ------
    FileNotFoundError, TypeError, ValueError
        If the source is not as described, is damaged, has fewer than two frames,
        or frames of different sizes or of sides under 16 pixels.
    ImportError
        If opencv-python-headless is missing.

    Warns
    -----
    UserWarning
        If a video ends before it should: how many frames were read of how many.

    References
    ----------
    N. Sundaram, T. Brox and K. Keutzer, "Dense Point Trajectories by GPU-accelerated
    Large Displacement Optical Flow", ECCV 2010: the grid, the check and the texture.
    T. Kroeger et al., "Fast Optical Flow using Dense Inverse Search", ECCV 2016.
    J. Shi and C. Tomasi, "Good Features to Track", CVPR 1994: that what is around a
    point is watched.

    Examples
    --------
    A picture that moves two pixels to the right and one down in each frame:

    >>> import numpy as np
    >>> from scipy.ndimage import gaussian_filter
    >>> from skmotionseg.video import track_video
    >>> noise = np.random.default_rng(0).normal(size=(100, 100))
    >>> scene = np.uint8(128 + 300 * gaussian_filter(noise, 2))
    >>> frames = [scene[20 - f : 84 - f, 20 - 2 * f : 84 - 2 * f] for f in range(6)]
    >>> result = track_video(frames)
    >>> result.n_frames, result.width, result.height
    (6, 64, 64)
    >>> whole = result.tracks[np.isfinite(result.tracks).all(axis=1)]
    >>> np.median(whole[:, -2:] - whole[:, :2], axis=0).round()
    array([10.,  5.], dtype=float32)
    """
    _check_parameters(
        grid_spacing, max_error, min_length, min_texture, max_frames, max_side
    )
    frames = open_frames(source)
    report = make_reporter(progress, _least(frames.n_announced, max_frames))
    log, height, width = TrackLog(), 0, 0
    tracker = PointTracker(grid_spacing, max_error, min_texture, max_side)
    for each in map(tracker.step, islice(frames, max_frames)):
        height, width = each.frame.shape[:2]
        log.record(each.ids, each.points, tracker.slid)
        report(log.n_frames)
    if log.n_frames < 2:
        raise ValueError(
            f"tracks need two frames or more; {frames.name} has {log.n_frames}"
        )
    points = log.assemble(min(min_length, log.n_frames))
    tracks = pack_tracks(points, layout="tracks_first")
    return VideoTracks(tracks, log.n_frames, width, height, frames.fps)


def follow_points(
    source: Source,
    *,
    grid_spacing: int | None = None,
    max_error: float = MAX_ERROR,
    min_texture: float = MIN_TEXTURE,
    max_frames: int | None = None,
    max_side: int | None = None,
) -> Iterator[TrackedFrame]:
    """Track points through a video, and hand over each frame as it comes.

    The tracks are those of :func:`track_video`, but for the frames that it leaves out
    where it sees later that a track had slid. Nothing is kept but the last frame, its
    points and what was around them, so a source may go on for as long as it likes.

    Parameters
    ----------
    source, grid_spacing, max_error, min_texture, max_frames, max_side
        As of :func:`track_video`; a whole number is a camera.

    Returns
    -------
    frames : iterator of TrackedFrame

    Raises
    ------
    FileNotFoundError, TypeError, ValueError, ImportError
        As :func:`track_video`, but for the number of frames.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.ndimage import gaussian_filter
    >>> from skmotionseg.video import follow_points
    >>> noise = np.random.default_rng(0).normal(size=(100, 100))
    >>> scene = np.uint8(128 + 300 * gaussian_filter(noise, 2))
    >>> frames = [scene[20 - f : 84 - f, 20 - 2 * f : 84 - 2 * f] for f in range(3)]
    >>> for frame in follow_points(frames):
    ...     points, ids = frame.points, frame.ids
    >>> points.shape == (len(ids), 2)
    True
    """
    _check_parameters(grid_spacing, max_error, 1, min_texture, max_frames, max_side)
    frames = islice(open_frames(source, cameras=True), max_frames)
    tracker = PointTracker(grid_spacing, max_error, min_texture, max_side)
    return map(tracker.step, frames)


class TrackerState(NamedTuple):
    """All that a tracker keeps from frame to frame, but the last frame itself.

    Attributes
    ----------
    points : ndarray of shape (n_points, 2)
        In pixels of the frame as it was tracked, perhaps shrunk.
    ids : ndarray of int, shape (n_points,)
    n_born : int
        Ids that were given.
    spacing : int or None
        Of the grid; None before the first frame.
    patches : ndarray of uint8, shape (n_points, 2, n_pixels)
        What was around the points, as :class:`Looks` keeps it.
    places : ndarray of shape (n_points, 2, 2)
        Where they were then.
    n_frames : int
        That were tracked.
    """

    points: np.ndarray
    ids: np.ndarray
    n_born: int
    spacing: int | None
    patches: np.ndarray | None = None
    places: np.ndarray | None = None
    n_frames: int = 0


class PointTracker:
    """Tracks points from frame to frame.

    Parameters
    ----------
    grid_spacing, max_error, min_texture, max_side
        As of :func:`track_video`.
    state : TrackerState, optional
        To go on from.
    last : ndarray of shape (height, width, 3), uint8, optional
        The frame after which that was the state.

    Attributes
    ----------
    slid : ndarray of int
        Ids of the tracks that have ended in the last frame because they had slid.
    """

    def __init__(
        self, grid_spacing, max_error, min_texture, max_side, state=None, last=None
    ):
        state = state or TrackerState(
            np.empty((0, 2)), np.empty(0, dtype=int), 0, grid_spacing
        )
        self._points, self._ids = state.points, state.ids
        self._sower = _Sower(state.spacing, min_texture, state.n_born)
        self._looks = Looks(state.patches, state.places, state.n_frames)
        self._flow, self._max_side = _PointFlow(max_error), max_side
        self._previous = None if last is None else _shrunk_grey(last, max_side)[0]
        self.slid = np.empty(0, dtype=int)

    @property
    def state(self):
        sower, looks = self._sower, self._looks
        return TrackerState(
            self._points,
            self._ids,
            sower.n_born,
            sower.spacing,
            looks.patches,
            looks.places,
            looks.n_frames,
        )

    def step(self, frame):
        """The next frame with its points, a TrackedFrame."""
        picture, scale = _shrunk_grey(frame, self._max_side)
        points, ids = self._points, self._ids
        if self._previous is not None:
            before = points
            points, followed = self._flow.follow(self._previous, picture, before)
            if _is_cut(self._previous, picture, before, followed):
                points, followed = points[:0], np.zeros_like(followed)
            same = self._looks.follow(picture, points, followed)
            self.slid = ids[followed][~same]
            points, ids = points[same], ids[followed][same]
        points, ids = self._sower.sow(picture, points, ids, self._flow.back)
        self._looks.begin(picture, points)
        self._points, self._ids, self._previous = points, ids, picture
        # Pixels have their centre at 0.
        return TrackedFrame(frame, (points + 0.5) / scale - 0.5, ids)


def _is_cut(first, second, points, followed):
    """Whether the second picture is of another shot.

    Few points of the first go on, and few are where the grey value is as it was. Where
    a man walks by close before the camera, in a film of BMS-26, no more go on, but the
    lower quartile of how the grey values at points change is 1 to 3; between shots of
    its films it is 14 to 31.
    """
    if followed.sum() >= FEWEST_GO_ON * len(points):
        return False
    pixels = nearest_pixels(points, first.shape)
    change = first[pixels].astype(float) - second[pixels]
    return (abs(change) < NOISE_OF_GREY).sum() < FEWEST_GO_ON * len(points)


def _shrunk_grey(frame, max_side):
    """A frame in grey, its longer side at most so long, and by how much it shrank."""
    cv2 = require("cv2", extra="video")
    height, width = frame.shape[:2]
    if min(height, width) < SMALLEST_SIDE:
        raise ValueError(
            f"frames need {SMALLEST_SIDE} pixels a side or more to be tracked; got "
            f"{width} x {height}"
        )
    grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
    scale = 1.0 if max_side is None else min(1.0, max_side / max(height, width))
    if scale == 1.0:
        return grey, scale
    size = [max(SMALLEST_SIDE, round(side * scale)) for side in (width, height)]
    return cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.divide(
        size, (width, height)
    )


class _Sower:
    """Starts tracks where there are none."""

    def __init__(self, spacing, min_texture, n_born):
        self.spacing = spacing  # None until a picture tells it
        self._min_texture = min_texture
        self.n_born = n_born

    def sow(self, picture, points, ids, flow):
        """Add new points, with new ids, to those that live.

        ``flow`` leads from the picture to that before; None in the first.
        """
        cv2 = require("cv2", extra="video")
        texture = cv2.cornerMinEigenVal(picture, WINDOW)
        threshold = self._min_texture * texture.mean()
        if self.spacing is None:
            side = round(np.sqrt(picture.size / N_CELLS))
            self.spacing = min(max(side, SMALLEST_SPACING), LARGEST_SPACING)
        born = seed_points(texture, self.spacing, threshold, points)
        if flow is not None:
            live = np.concatenate([points, born])
            more = self._sow_finely(texture, threshold, live, flow)
            born = np.concatenate([born, more])
        born_ids = self.n_born + np.arange(len(born))
        self.n_born += len(born)
        return np.concatenate([points, born]), np.concatenate([ids, born_ids])

    def _sow_finely(self, texture, threshold, live, flow):
        """New points where the flow differs from that around."""
        apart = stands_out(flow, self.spacing)
        budget = EXTRA_CELLS * apart.size / self.spacing**2
        side = np.sqrt(apart.sum() / budget)
        side = max(int(np.ceil(side)), self.spacing // 2, 2)
        if side >= self.spacing or not apart.any():
            return np.empty((0, 2))
        return seed_points(np.where(apart, texture, -np.inf), side, threshold, live)


class _PointFlow:
    """Moves points from picture to picture."""

    def __init__(self, max_error):
        self._max_error = max_error
        self.back = None  # the flow from the last picture to the one before it

    def follow(self, first, second, points):
        """Points in the second picture, and which of those in the first they are."""
        cv2 = require("cv2", extra="video")
        if len(points) == 0:
            self.back = None
            return points, np.zeros(0, dtype=bool)
        # Sizes that are not whole multiples of its patches make what it gives depend on
        # pictures of before, so it is made anew. The preset "medium" takes four times
        # as long. Once refined, both are as exact.
        dense = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
        flow = _dense_flow(dense, first, second)
        moved = _refine(first, second, points, points + sample_field(flow, points))
        back = self.back = _dense_flow(dense, second, first)
        returned = _refine(second, first, moved, moved + sample_field(back, moved))
        good = np.hypot(*(returned - points).T) <= self._max_error
        good &= is_inside(moved, second.shape)
        good &= field_gradient(flow, points) <= MAX_FLOW_GRADIENT
        return moved[good], good


def _dense_flow(dense, first, second):
    """The flow (height, width, 2) between two pictures, however low they are.

    Of pictures lower than ``SMALLEST_FOR_FLOW``, the scales that DIS chooses by their
    longer side do not fit the shorter, and it may read beyond its memory. So they are
    continued by their last rows or columns.
    """
    cv2 = require("cv2", extra="video")
    height, width = first.shape
    below, right = (max(SMALLEST_FOR_FLOW - side, 0) for side in first.shape)
    if below or right:
        first, second = (
            cv2.copyMakeBorder(each, 0, below, 0, right, cv2.BORDER_REPLICATE)
            for each in (first, second)
        )
    return dense.calc(first, second, None)[:height, :width]


def _refine(first, second, points, coarse):
    """Better places in the second picture of points of the first (Lucas-Kanade)."""
    cv2 = require("cv2", extra="video")
    fine, found, _ = cv2.calcOpticalFlowPyrLK(
        first,
        second,
        points.astype(np.float32),
        coarse.astype(np.float32),
        winSize=(WINDOW, WINDOW),
        maxLevel=0,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        criteria=(cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 10, 0.01),
    )
    return np.where(found == 1, fine, coarse)


def _check_parameters(
    grid_spacing, max_error, min_length, min_texture, max_frames, max_side
):
    if grid_spacing is not None:
        check_number("grid_spacing", grid_spacing, Integral, 2)
    check_number("max_error", max_error, Real, 0)
    check_number("min_length", min_length, Integral, 1)
    check_number("min_texture", min_texture, Real, 0)
    if max_frames is not None:
        check_number("max_frames", max_frames, Integral, 2)
    if max_side is not None:
        check_number("max_side", max_side, Integral, SMALLEST_SIDE)


def _least(*numbers):
    return min((number for number in numbers if number is not None), default=None)
