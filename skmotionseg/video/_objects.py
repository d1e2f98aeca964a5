"""From tracks to things that move before the static scene."""

from __future__ import annotations

from functools import partial
from numbers import Real

import numpy as np
import numpy.typing as npt

from .._core.geometry.tracks import shots, tracks_by_frame, unpack_tracks
from .._core.labels import canonical_labels
from .._core.partition.moving_parts import moving_parts
from .._core.partition.scene import (
    background_motion,
    covered_share,
    moving_objects,
    ranked,
)
from .._utils.validation import check_frames, check_label_each
from .._utils.warning import warn_user
from ._checks import check_number
from ._frames import Progress, Source, open_frames
from ._recognition import known_again

# A static scene whose tracks cover a smaller share of the picture may be none.
SMALL_SCENE = 0.25


def find_objects(
    X: npt.ArrayLike,
    labels: npt.ArrayLike,
    *,
    width: int,
    height: int,
    source: Source | None = None,
    progress: Progress | None = None,
) -> npt.NDArray[np.int64]:
    """Find what moves against the static scene, one thing by one.

    The scene is the rigid motion that frames the image and fills it, however many
    tracks it has, at depths that are continuous. Tracks that are far from its motion,
    or whose depths differ from those around, are gathered to connected regions, and
    kept where a motion of their own, or the movement of the tracks around each one,
    explains them better: noise, and water, are explained by neither. Parts that touch,
    and over time go together against the scene, are one thing, as the limbs of a body
    are. So is what goes behind something and, within twelve frames, comes out where it
    is expected. What is out of view for longer is known again by its texture and its
    colours, if there is the video. Each shot has a scene of its own: where fewer than a
    quarter of the tracks go on, the video has been cut.

    Clips of two frames, and those of which no rigid motion can be told, are judged by
    the labels alone: the scene is the label that frames the image, and the other labels
    are parts.

    Parameters
    ----------
    X : array-like of shape (n_tracks, 2 * n_frames)
        Tracks in pixels; NaN where unseen.
    labels : array-like of int, shape (n_tracks,)
        Rigid motion of each track, as from :class:`~skmotionseg.MotionSegmenter`; -1
        for none. They are a hint: where they miss a motion, it is found all the same,
        and where they part the scene, they do not count.
    width, height : int
        Of the frames, in pixels.
    source : path or iterable of arrays, optional
        The video of the tracks, as for :func:`track_video`. Frames are read, one at a
        time, only if a thing comes after another has gone.
    progress : callable, optional
        Called after each frame that is read, with the number done and the number there
        will be.

    Returns
    -------
    ndarray of int, shape (n_tracks,)
        0 for the static scene; 1, 2, ... for things, those seen in most frames by most
        tracks first; -1 for tracks of none.

    Raises
    ------
    FileNotFoundError, TypeError, ValueError
        If the tracks are malformed, there is not one label per track, the source is not
        as described, or frames are read and are too few or of another size.
    ImportError
        If there is a source and opencv-python-headless is missing.

    Warns
    -----
    UserWarning
        If the tracks of the scene cover less than a quarter of the picture.

    Examples
    --------
    >>> import numpy as np
    >>> from skmotionseg.video import find_objects
    >>> x, y = np.meshgrid(np.arange(0, 100, 5.0), np.arange(0, 80, 5.0))
    >>> start = np.column_stack([x.ravel(), y.ravel()])
    >>> inside = (abs(start - [50, 40]) < 15).all(axis=1)
    >>> steps = np.where(inside, 3.0, 0.0)[:, None, None] * np.arange(6)[:, None]
    >>> X = (start[:, None] + steps).reshape(len(start), -1)
    >>> labels = np.where(inside, -1, 0)  # rejected, but together
    >>> objects = find_objects(X, labels, width=100, height=80)
    >>> bool((objects == inside).all())
    True
    """
    points, visibility = unpack_tracks(X)
    check_frames(X, points)
    labels = check_label_each(labels, len(points))
    for name, side in (("width", width), ("height", height)):
        check_number(name, side, Real, 1)
    frames = None if source is None else open_frames(source)
    size = width, height
    objects = _by_shot(points, visibility, labels, size)
    static = objects == 0
    if covered_share(points[static], visibility[static], size) < SMALL_SCENE:
        warn_user(
            f"what is taken for the static scene covers less than {SMALL_SCENE:.0%} of "
            "the picture by its tracks: where a background is too plain to be tracked, "
            "that may be something that moves before it"
        )
    if frames is None:
        return objects
    seen = partial(tracks_by_frame, points, visibility)
    objects = known_again(frames, seen, objects, size, progress)
    return ranked(objects, visibility.sum(axis=1))


def _by_shot(points, visibility, labels, size):
    """Things of each shot: across a cut, no motion goes on, nor does the scene.

    A track that goes on by chance is of the shot that sees most of it.
    """
    ends = shots(visibility)
    if len(ends) == 1:
        return _things(points, visibility, labels, size)
    times = np.stack([visibility[:, slice(*each)].sum(axis=1) for each in ends])
    objects = np.full(len(points), -1)
    shot = np.where(times.any(axis=0), times.argmax(axis=0), -1)
    for number, each in enumerate(ends):
        rows = np.flatnonzero(shot == number)
        here = np.ix_(rows, np.arange(*each))
        own = canonical_labels(labels[rows])
        found = np.minimum(own, 0)  # one frame shows no motion
        if each[1] - each[0] > 1:
            found = _things(points[here], visibility[here], own, size)
        objects[rows] = found + (found > 0) * max(objects.max(), 0)
    return ranked(objects, visibility.sum(axis=1))


def _things(points, visibility, labels, size):
    """What moves in a shot: as of :func:`find_objects`."""
    background = background_motion(points, visibility, labels, size)
    parts = moving_parts(points, visibility, labels, background, size)
    if parts is not None:
        labels, background = parts + 1, 0
    return moving_objects(points, visibility, labels, background)
