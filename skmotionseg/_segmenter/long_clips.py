"""Long clips: windows that overlap, segmented each for itself, and joined."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from sklearn.base import clone

from .._core.geometry.tracks import pack_tracks
from .._core.labels import canonical_labels
from .._core.stream.joining import Joiner, parts_of
from .._parallel.engine import run_tasks
from .._parallel.tasks import Task
from .._utils.validation import as_memory
from .._version import __version__

# Frames above which a clip is taken in windows.
LONG_CLIP = 100
# Pictures in which distances between motions are measured are so many pixels wide.
REFERENCE_WIDTH = 640


class WindowedLabels(NamedTuple):
    """What windows say together.

    Attributes
    ----------
    labels : ndarray of int, shape (n_tracks,)
        The largest motion first; -1 for tracks of none.
    shares : ndarray of shape (n_tracks,)
        Of the frames in which windows gave a track some motion, those with this one.
    windows : ndarray of int, shape (n_windows, 2)
        First and last frame of each.
    """

    labels: np.ndarray
    shares: np.ndarray
    windows: np.ndarray


def segment_in_windows(points, visibility, segmenter, rng):
    """Labels of the tracks of a long clip.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    segmenter : MotionSegmenter
        Whose parameters the windows are segmented with. Their number of motions is
        open, as some may be out of view: ``n_motions`` is that of the whole.
    rng : RandomState

    Returns
    -------
    WindowedLabels
    """
    parts = parts_of(visibility)
    seeds = rng.randint(2**31 - 1, size=len(parts))
    most = None if segmenter.n_motions == "auto" else segmenter.n_motions
    estimator = clone(segmenter).set_params(
        n_motions="auto",
        max_motions=segmenter.max_motions if most is None else most,
        min_motions=1 if most is not None else segmenter.min_motions,
        memory=None,
        n_jobs=None,
    )
    memory = as_memory(segmenter.memory)
    found = run_tasks(
        (
            Task(
                f"segmenting frames {part.start} to {part.stop - 1}",
                _recall,
                memory,
                clone(estimator).set_params(random_state=int(seed)),
                pack_tracks(*_of(part, points, visibility)),
            )
            for part, seed in zip(parts, seeds, strict=True)
        ),
        n_jobs=segmenter.n_jobs,
    )
    some = points[visibility]
    width = (some.max(axis=0) - some.min(axis=0)).max()
    joiner = Joiner(len(points), most, float(width) / REFERENCE_WIDTH)
    for part, labels in zip(parts, found, strict=True):
        here, seen = _of(part, points, visibility)
        joiner.add(part, here, seen, labels)
    labels, shares = joiner.labels()
    frames = np.array([[part.start, part.stop - 1] for part in parts])
    return WindowedLabels(canonical_labels(labels), shares, frames)


def _of(part, points, visibility):
    """Points and visibility of the tracks of a window, in its frames."""
    frames = slice(part.start, part.stop)
    return points[part.tracks, frames], visibility[part.tracks, frames]


def _recall(memory, estimator, X):
    """Labels of a window from memory, or else put there."""
    return memory.cache(_segment)(estimator, np.asarray(X), __version__)


def _segment(estimator, X, version):
    """Labels; the version says of what code they are, where they are kept."""
    try:
        return estimator.fit(X).labels_
    except ValueError:  # hardly any tracks
        return np.full(len(X), -1)
