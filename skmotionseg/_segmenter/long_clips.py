"""Long clips: windows that overlap, segmented each for itself, and joined."""

from __future__ import annotations

from numbers import Integral
from typing import NamedTuple

import numpy as np
from sklearn.base import clone

from .._core.geometry.tracks import (
    covered,
    first_after_cuts,
    first_and_last,
    non_empty_frames,
    pack_tracks,
    unpack_tracks,
)
from .._core.labels import canonical_labels
from .._core.stream.agreement import WindowMotions, agreeing
from .._core.stream.joining import Joiner, parts_of
from .._parallel.engine import run_tasks
from .._parallel.tasks import Task
from .._utils.caching import as_memory, recall
from .._utils.validation import TooFewTracksError, row_batches
from .._utils.warning import warn_of_unexplained, warn_user

# Frames above which a clip is taken in windows.
LONG_CLIP = 100
# Tracks before a cut, and after it, at least: where there are few, they may be lost.
FEWEST_AT_CUT = 8
# Windows that are asked for one motion more, for each that the whole clip lacks.
MOST_ASKED = 5


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
    counts : ndarray of int, shape (n_windows,)
        Motions that each has found.
    surely : ndarray of shape (n_windows,)
        How probable it is that there are no fewer; NaN where there are too few tracks
        to look for any.
    """

    labels: np.ndarray
    shares: np.ndarray
    windows: np.ndarray
    counts: np.ndarray
    surely: np.ndarray

    @property
    def n_motions(self):
        return int(self.labels.max(initial=-1)) + 1


class LongClip:
    """Tracks of a long clip, of which a window at a time is unpacked.

    Tracks are short against such a clip, and their matrix holds hardly any points: it
    may take most of the memory there is, and nothing of its size is made.

    Parameters
    ----------
    X : ndarray of shape (n_tracks, 2 * n_frames)
        As checked by an estimator.
    fewest : int
        Frames that are left at least when those that see nothing are left out.

    Attributes
    ----------
    n_tracks, n_frames : int
        Frames that see nothing are not counted.
    length : int
        Frames of the matrix.
    frames : ndarray of int, shape (n_frames,)
        Which frames of the matrix they are.
    times : ndarray of int, shape (n_tracks,)
        Frames in which each track is seen.
    extent : ndarray of shape (2,)
        Of what the tracks cover, pixels.
    parts : list of Part
        Its windows, in its frames.
    cuts : list of int
        The first of its frames after each cut.
    """

    def __init__(self, X, fewest):
        self._X = X
        seen, corners = [], []
        for points, visibility in map(unpack_tracks, row_batches(X)):
            seen.append(visibility)
            if visibility.any():
                corners += covered(points, visibility)
        visibility = np.concatenate(seen)
        self.frames = non_empty_frames(visibility, fewest)
        self.n_tracks, self.n_frames = len(X), len(self.frames)
        self.length = visibility.shape[1]
        self.extent = extent_of(corners)
        self.times = visibility.sum(axis=1)
        visibility = visibility[:, self.frames]
        self.parts = parts_of(visibility)
        first, last = first_and_last(visibility)
        self.cuts = first_after_cuts(first, last, self.n_frames, FEWEST_AT_CUT)

    def window(self, part):
        """Points (n, L, 2) and visibility (n, L) of the tracks of a window."""
        frames = self.frames[part.start : part.stop]
        return unpack_tracks(self._X[np.ix_(part.tracks, _columns(frames))])

    def ends(self, part):
        """First and last frame of a window, those that see nothing being counted."""
        return self.frames[[part.start, part.stop - 1]].tolist()

    def are_in(self, windows):
        """Whether each track (n_tracks,) is in one of some windows.

        Parameters
        ----------
        windows : ndarray of bool, shape (n_windows,)
        """
        found = np.zeros(self.n_tracks, dtype=bool)
        for position in np.flatnonzero(windows):
            found[self.parts[position].tracks] = True
        return found


def points_in_batches(X, frames):
    """Points (n, n_frames, 2) in some frames of a matrix, some tracks at a time."""
    for batch in row_batches(X):
        yield unpack_tracks(batch[:, _columns(frames)])[0]


def extent_of(corners):
    """Width and height (2,) of what has such corners, pixels; one where it is flat."""
    extent = np.ptp(corners, axis=0) if corners else np.zeros(2)
    return np.where(extent > 0, extent, 1.0)


def _columns(frames):
    return (2 * frames[:, None] + [0, 1]).ravel()


def segment_in_windows(clip, segmenter, rng, report=None):
    """Labels of the tracks of a long clip.

    Parameters
    ----------
    clip : LongClip
        Or what else has its ``n_tracks``, ``extent``, ``parts``, ``cuts``, ``ends`` and
        ``window``.
    segmenter : MotionSegmenter
        Whose parameters the windows are segmented with. Their number of motions is
        open, as some may be out of view: ``n_motions`` is that of the whole, and there
        is a warning where windows do not tell so many apart.
    rng : RandomState
    report : callable, optional
        Called after each window with the number done and the number there will be.

    Returns
    -------
    WindowedLabels

    Raises
    ------
    TooFewTracksError
        If no window has as many tracks as a motion model needs.
    ValueError
        If no frame pair of a window can be as far apart as hypotheses need.
    """
    _check_frame_gap(segmenter.frame_gap, clip.parts)
    fits = _WindowFits(clip, segmenter, rng, report)
    found = fits.of(range(len(clip.parts)))
    _check_searched(found, clip.n_tracks)
    _warn_if_unexplained(found)
    found = agreeing(found, fits.of, *fits.limits)
    joined = _joined(clip, found, fits.most)
    if fits.most is not None and joined.n_motions < fits.most:
        return _with_more(clip, found, joined, fits)
    return joined


def _with_more(clip, found, joined, fits):
    """What windows say together where they have fewer motions than there are.

    One after the other, the window that is likeliest to have more is asked for one
    more, and those beside it to agree.

    Parameters
    ----------
    clip : LongClip
    found : list of WindowMotions
    joined : WindowedLabels
        Of these.
    fits : _WindowFits
    """
    asked: set[int] = set()
    most_asked = MOST_ASKED * (fits.most - joined.n_motions)
    for _ in range(most_asked):
        place = _likeliest_of_more(found, asked, fits.most)
        if joined.n_motions == fits.most or place is None:
            break
        asked.add(place)
        (more,) = fits.of([place], [found[place].n_motions + 1])
        changed = [*found]
        changed[place] = more._replace(surely=1.0)
        changed = agreeing(changed, fits.of, *fits.limits)
        after = _joined(clip, changed, fits.most)
        if after.n_motions > joined.n_motions:
            found, joined = changed, after
            asked.clear()
    if joined.n_motions < fits.most:
        warn_user(
            f"n_motions={fits.most} was asked for, but the windows of the clip tell "
            f"only {joined.n_motions} motions apart: labels are of these"
        )
    return joined


def _likeliest_of_more(found, asked, most):
    """The window of fewer motions, not yet asked, that is likeliest to have more."""
    places = [
        k
        for k, each in enumerate(found)
        if k not in asked and _is_searched(each) and each.n_motions < most
    ]
    return max(places, key=lambda k: np.nan_to_num(found[k].more), default=None)


class _WindowFits:
    """Fits of the windows of a clip, each with a seed of its own, and made once."""

    def __init__(self, clip, segmenter, rng, report):
        self.clip, self.report, self.n_done = clip, report, 0
        self.n_jobs, self.memory = segmenter.n_jobs, as_memory(segmenter.memory)
        self.seeds = rng.randint(2**31 - 1, size=len(clip.parts))
        self.most = None if segmenter.n_motions == "auto" else segmenter.n_motions
        self.estimator = _for_windows(segmenter, self.most)
        self.limits = self.estimator.min_motions, self.estimator.max_motions
        self._found: dict[tuple, WindowMotions] = {}

    def of(self, places, numbers=None, attempt=0):
        """The motions of some windows, their number open unless it is given."""
        numbers = ["auto"] * len(places) if numbers is None else numbers
        asked = [
            (k, number, attempt) for k, number in zip(places, numbers, strict=True)
        ]
        # Windows that did not come to agree are asked again when another has changed.
        new = [fit for fit in asked if fit not in self._found]
        tasks = (self._task(*fit) for fit in new)
        n_before, n_all = self.n_done, self.n_done + len(new)
        report = self.report and (lambda done: self.report(n_before + done, n_all))
        found = run_tasks(tasks, n_jobs=self.n_jobs, done=report)
        self.n_done = n_all
        for fit, each in zip(new, found, strict=True):
            tracks = self.clip.parts[fit[0]].tracks
            self._found[fit] = WindowMotions(tracks, *each)
        return [self._found[fit] for fit in asked]

    def _task(self, place, number, attempt):
        part, seed = self.clip.parts[place], int(self.seeds[place]) + attempt
        first, last = self.clip.ends(part)
        estimator = clone(self.estimator)
        return Task(
            f"segmenting frames {first} to {last}",
            recall,
            self.memory,
            _segment,
            estimator.set_params(n_motions=number, random_state=seed),
            pack_tracks(*self.clip.window(part), layout="tracks_first"),
        )


def _joined(clip, found, most):
    """What windows say together, of at most so many motions."""
    joiner = Joiner(clip.n_tracks, most, clip.extent, clip.cuts)
    counts = np.array([each.n_motions for each in found])
    surely = np.array([each.surely for each in found])
    # What no probability is computed of is relied on.
    surely[np.isnan(surely) & (counts > 0)] = 1.0
    for part, each, sure in zip(clip.parts, found, surely, strict=True):
        points, seen = clip.window(part)
        joiner.add(part, points, seen, each.labels, sure)
    labels, shares = joiner.labels()
    frames = np.array([clip.ends(part) for part in clip.parts])
    return WindowedLabels(canonical_labels(labels), shares, frames, counts, surely)


def _check_frame_gap(frame_gap, parts):
    shortest = min(part.stop - part.start for part in parts)
    if frame_gap >= shortest:
        raise ValueError(
            f"frame_gap={frame_gap} needs at least {frame_gap + 1} frames; clips of "
            f"more than {LONG_CLIP} are taken in windows of {shortest}"
        )


def _check_searched(found, n_tracks):
    """Refuse a clip that has too few tracks for any motion in all of its windows."""
    if not any(map(_is_searched, found)):
        most = max(len(each.tracks) for each in found)
        raise TooFewTracksError(
            "no window of the clip has as many tracks that are seen in the same two "
            f"frames as a motion model needs; the one with most has {most} "
            f"(n_samples={n_tracks})"
        )


def _warn_if_unexplained(found):
    """Say if most tracks of most windows are far from their motions."""
    searched = sorted(window.unexplained for window in found if _is_searched(window))
    usual = searched[(len(searched) - 1) // 2]
    if usual > 0:
        warn_of_unexplained(usual, " of the usual window")


def _is_searched(window):
    return window.n_motions > 0 or not np.isnan(window.surely)


def _for_windows(segmenter, most):
    """The segmenter of a window, which may see fewer motions than there are."""
    return clone(segmenter).set_params(
        n_motions="auto",
        max_motions=segmenter.max_motions if most is None else most,
        min_motions=1 if most is not None else segmenter.min_motions,
        memory=None,
        n_jobs=None,
    )


def _segment(estimator, X, version):
    """Labels, how probable no fewer motions and more are, and what is unexplained.

    Probabilities are NaN if unknown. A window may have fewer tracks than the landmarks
    that are asked for, and too few for any motion. The version says of what code they
    are, where they are kept.
    """
    asked = estimator.n_landmarks
    if isinstance(asked, Integral) and int(asked) > len(X):
        estimator.set_params(n_landmarks=None)  # all of them
    try:
        unexplained = estimator._fit_window(X)
    except TooFewTracksError:
        return np.full(len(X), -1), np.nan, np.nan
    probabilities = estimator.count_probabilities_[estimator.best_index_ :]
    surely, more = float(probabilities.sum()), float(probabilities[1:].sum())
    return estimator.labels_, surely, more, unexplained
