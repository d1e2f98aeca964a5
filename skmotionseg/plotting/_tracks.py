"""Tracks over the picture plane, coloured by motion."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator

from .._core.geometry.tracks import unpack_tracks
from .._utils.colours import motion_colour
from .._utils.optional import require
from .._utils.validation import check_frames, check_label_each
from .._utils.warning import warn_user
from ._drawing import (
    figure_and_ax,
    last_step,
    legend_below,
    require_pyplot,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# How much of an image is left under the tracks.
PALE = 0.6


def plot_motions(
    X: npt.ArrayLike,
    labels: npt.ArrayLike,
    *,
    frames: Sequence[int] | None = None,
    ax: Axes | None = None,
    title: str | None = None,
) -> Any:
    """Draw tracks between two frames, coloured by motion.

    Parameters
    ----------
    X : array-like of shape (n_tracks, 2 * n_frames)
        Tracks in pixels; NaN where unseen.
    labels : array-like of int, shape (n_tracks,)
        Motion of each track; -1 is drawn as a grey cross.
    frames : (int, int), optional
        A line goes from the position in the first to a dot in the second. By default
        the two that most tracks share, of those a quarter of the clip apart.
    ax : matplotlib axes, optional
    title : str, optional

    Returns
    -------
    matplotlib axes

    Raises
    ------
    ImportError
        If matplotlib is missing.
    ValueError
        If the tracks have no frame, there is not one label per track, or ``frames`` are
        not two of the clip.

    Examples
    --------
    >>> from skmotionseg.datasets import make_rigid_motions
    >>> from skmotionseg.plotting import plot_motions
    >>> X, y = make_rigid_motions(n_tracks=70, n_frames=6, random_state=0)
    >>> ax = plot_motions(X, y)
    >>> ax.get_xlabel()
    'x (pixels)'
    """
    plt = require("matplotlib.pyplot", extra="plot")
    points, visibility = unpack_tracks(X)
    check_frames(X, points)
    labels = check_label_each(labels, len(points))
    first, second = _two_frames(frames, visibility)
    shared = visibility[:, first] & visibility[:, second]
    if frames is not None and not shared.any():
        warn_user(f"no track is seen in both frames, {first} and {second}")
    if ax is None:
        ax = plt.subplots(figsize=(6.4, 4.2), layout="constrained")[1]
    shown = np.unique(labels)
    for label in shown:
        rows = shared & (labels == label)
        ends = points[rows, first], points[rows, second]
        _draw_between(ax, *ends, label, int((labels == label).sum()))
    ax.set(xlabel="x (pixels)", ylabel="y (pixels)", aspect="equal", title=title or "")
    if not ax.yaxis_inverted():
        ax.invert_yaxis()
    legend_below(ax, min(4, len(shown)))
    return ax


def _two_frames(frames, visibility):
    """Numbers of the frames to draw, or of those that most tracks share."""
    if frames is None:
        return _shared_frames(visibility)
    if np.shape(frames) != (2,):
        raise ValueError(f"frames must be two of the clip; got {frames!r}")
    return [_check_frame(frame, visibility) for frame in frames]


def _shared_frames(visibility):
    """The frames a quarter of the clip apart that see most tracks in both.

    Or half of a usual track's life apart, if that is less.
    """
    n_frames = visibility.shape[1]
    life = int(np.median(visibility.sum(axis=1))) if len(visibility) else n_frames
    gap = min(max(1, min(n_frames // 4, life // 2)), n_frames - 1)
    both = (visibility[:, : n_frames - gap] & visibility[:, gap:]).sum(axis=0)
    first = int(both.argmax())
    return first, first + gap


class MotionDisplay:
    """Tracks in one frame, coloured by motion, each with a trail.

    Make it by :meth:`from_estimator` or :meth:`from_predictions`.

    Parameters
    ----------
    X : array-like of shape (n_tracks, 2 * n_frames)
        Tracks in pixels; NaN where unseen.
    labels : array-like of int, shape (n_tracks,)
        Motion of each track; -1, no motion, is a hollow grey circle.
    frame : int, optional
        Frame to draw, 0 being the first, negative ones from the end. By default the
        one in which most tracks are seen.
    image : array-like of shape (height, width) or (height, width, 3 or 4), optional
        That frame, drawn pale under the tracks: grey or RGB.
    trail : int, default=5
        Frames that trails go back; 0 for none.

    Attributes
    ----------
    frame_ : int
        The frame drawn.
    points_ : dict of int to matplotlib PathCollection
        The tracks seen in the frame, by motion.
    trails_ : dict of int to matplotlib LineCollection
        Their trails, by motion.
    image_ : matplotlib AxesImage or None
    legend_ : matplotlib Legend
        With the tracks of each motion, those that the frame does not show included.
    ax_ : matplotlib axes
    figure_ : matplotlib figure

    See Also
    --------
    plot_motions : Two frames and a line between them.
    skmotionseg.video.render_segmentation : All frames, as a video.

    Examples
    --------
    >>> from skmotionseg.datasets import make_rigid_motions
    >>> from skmotionseg.plotting import MotionDisplay
    >>> X, y = make_rigid_motions(n_tracks=70, n_frames=6, random_state=0)
    >>> display = MotionDisplay.from_predictions(X, y, frame=3)
    >>> sorted(display.points_)
    [0, 1, 2]
    """

    def __init__(
        self,
        X: npt.ArrayLike,
        labels: npt.ArrayLike,
        *,
        frame: int | None = None,
        image: npt.ArrayLike | None = None,
        trail: int = 5,
    ) -> None:
        self.X: Any = X
        self.labels: Any = labels
        self.frame = frame
        self.image: Any = image
        self.trail = trail

    @classmethod
    def from_estimator(
        cls,
        segmenter: BaseEstimator,
        X: Any,
        *,
        fitted: npt.ArrayLike = True,
        frame: int | None = None,
        image: npt.ArrayLike | None = None,
        trail: int = 5,
        ax: Axes | None = None,
        title: str | None = None,
    ) -> Self:
        """Draw what a fitted estimator found.

        Parameters
        ----------
        segmenter : fitted estimator or Pipeline
            With ``labels_``, such as :class:`~skmotionseg.MotionSegmenter`.
        X : array-like of shape (n_tracks, 2 * n_frames)
            Tracks in pixels; NaN where unseen.
        fitted : bool, default=True
            Whether these are the tracks it was fitted to, whose labels it has. Others
            of the same video are placed by its ``predict``.
        frame, image, trail
            As for :class:`MotionDisplay`.
        ax : matplotlib axes, optional
        title : str, optional
            By default the frame and how many tracks it shows.

        Returns
        -------
        MotionDisplay

        Raises
        ------
        NotFittedError, ValueError
            If it is not fitted, was fitted to another number of tracks, or as
            :meth:`plot` has it.
        """
        require_pyplot()
        last = last_step(segmenter)
        if fitted and len(last.labels_) != len(X):
            raise ValueError(
                f"the estimator was fitted to {len(last.labels_)} tracks; got "
                f"{len(X)}. fitted=False places other tracks of the same video"
            )
        labels = last.labels_ if fitted else segmenter.predict(X)
        display = cls(X, labels, frame=frame, image=image, trail=trail)
        return display.plot(ax=ax, title=title)

    @classmethod
    def from_predictions(
        cls,
        X: npt.ArrayLike,
        labels: npt.ArrayLike,
        *,
        frame: int | None = None,
        image: npt.ArrayLike | None = None,
        trail: int = 5,
        ax: Axes | None = None,
        title: str | None = None,
    ) -> Self:
        """Draw labels that are at hand.

        Parameters
        ----------
        X, labels, frame, image, trail
            As for :class:`MotionDisplay`.
        ax, title
            As for :meth:`plot`.

        Returns
        -------
        MotionDisplay

        Raises
        ------
        ValueError
            As :meth:`plot` has it.
        """
        display = cls(X, labels, frame=frame, image=image, trail=trail)
        return display.plot(ax=ax, title=title)

    def plot(self, *, ax: Axes | None = None, title: str | None = None) -> Self:
        """Draw.

        Parameters
        ----------
        ax : matplotlib axes, optional
            By default those of a new figure.
        title : str, optional
            By default the frame and how many tracks it shows.

        Returns
        -------
        MotionDisplay

        Raises
        ------
        ImportError
            If matplotlib is missing.
        TypeError, ValueError
            If ``X`` are no tracks, there is not one label per track, or no such frame,
            or the image is none. Nothing is drawn then.
        """
        points, visibility, labels, frame, image = self._read()
        collections = require("matplotlib.collections", extra="plot")
        shown = visibility[:, frame]
        self.frame_ = frame
        self.figure_, self.ax_ = figure_and_ax(
            ax, _figure_size(points[shown, frame], image), layout="compressed"
        )
        self.image_ = None
        if image is not None:
            self.image_ = self.ax_.imshow(image, cmap="gray", alpha=PALE)
        self.points_, self.trails_ = {}, {}
        for label in _motions_first(labels):
            rows = shown & (labels == label)
            colour = motion_colour(label)
            # Large motions, drawn first, must not hide small ones.
            order = 2 + 0.01 * label
            self.trails_[label] = self.ax_.add_collection(
                collections.LineCollection(
                    _trail_segments(points[rows], frame, self.trail),
                    colors=colour,
                    linewidths=0.9,
                    alpha=0.7,
                    zorder=order,
                )
            )
            n_tracks = int((labels == label).sum())
            self.points_[label] = _draw_points(
                self.ax_, points[rows, frame], label, n_tracks, order + 1
            )
        if title is None:
            title = f"frame {frame}: {int(shown.sum())} of {len(points)} tracks"
        self.ax_.set(
            xlabel="x (pixels)", ylabel="y (pixels)", aspect="equal", title=title
        )
        if not self.ax_.yaxis_inverted():
            self.ax_.invert_yaxis()
        self.legend_ = legend_below(self.ax_, min(4, len(self.points_)))
        return self

    def _read(self):
        """Points, visibility, labels, number of the frame and image, all checked."""
        points, visibility = unpack_tracks(self.X)
        check_frames(self.X, points)
        labels = check_label_each(self.labels, len(points))
        frame = _check_frame(self.frame, visibility)
        image = _check_image(self.image)
        if not isinstance(self.trail, Integral) or self.trail < 0:
            raise ValueError(f"trail must be a number of frames; got {self.trail!r}")
        return points, visibility, labels, frame, image


def _draw_points(ax, points, label, n_tracks, order):
    """The points of one motion in a frame."""
    colour, inside = motion_colour(label), label >= 0
    return ax.scatter(
        points[:, 0],
        points[:, 1],
        s=13,
        facecolors=colour if inside else "none",
        edgecolors="white" if inside else colour,
        linewidths=0.3 if inside else 0.9,
        label=f"{f'motion {label}' if inside else 'no motion'} ({n_tracks})",
        zorder=order,
    )


def _draw_between(ax, start, end, label, n_tracks):
    """Lines from the first positions to dots, or crosses, at the second."""
    outlier = label < 0
    colour = motion_colour(label)
    x, y = np.stack([start, end]).T.swapaxes(1, 2)
    ax.plot(x, y, color=colour, lw=0.8)
    name = "no motion" if outlier else f"motion {label}"
    ax.scatter(
        end[:, 0],
        end[:, 1],
        s=14 if outlier else 7,
        color=colour,
        marker="x" if outlier else "o",
        linewidths=0.8 if outlier else 0,
        label=f"{name} ({n_tracks})",
        zorder=3,
    )


def _motions_first(labels):
    """The labels that occur, in order, but -1 last."""
    return sorted(map(int, np.unique(labels)), key=lambda label: (label < 0, label))


def _check_frame(frame, visibility):
    """Number of the frame to draw, counted from the first."""
    n_frames = visibility.shape[1]
    if frame is None:
        return int(visibility.sum(axis=0).argmax())
    if not isinstance(frame, Integral) or not -n_frames <= frame < n_frames:
        raise ValueError(f"frame must be one of 0 to {n_frames - 1}; got {frame!r}")
    return int(frame) % n_frames


def _check_image(image):
    if image is None:
        return None
    image = np.asarray(image)
    if image.ndim != 2 and not (image.ndim == 3 and image.shape[2] in (3, 4)):
        raise ValueError(
            "image must have shape (height, width) or (height, width, 3 or 4); got "
            f"{image.shape}"
        )
    return image


def _figure_size(points, image):
    """Inches: seven wide, and as high as the picture at that width, and its texts."""
    if image is not None:
        height, width = image.shape[:2]
    else:
        width, height = np.ptp(points, axis=0) if len(points) else (1, 1)
    ratio = height / width if width > 0 else 1
    return 7, 1.3 + 6.3 * min(max(ratio, 0.2), 1)


def _trail_segments(points, frame, trail):
    """Lines (n, 2, 2) between consecutive frames that both see the point."""
    recent = points[:, max(0, frame - trail) : frame + 1]
    steps = np.stack([recent[:, :-1], recent[:, 1:]], axis=2).reshape(-1, 2, 2)
    return steps[~np.isnan(steps).any(axis=(1, 2))]
