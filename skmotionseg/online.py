"""From tracks to motions, a frame at a time."""

from __future__ import annotations

from numbers import Integral, Real
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator
from sklearn.exceptions import NotFittedError
from sklearn.utils import Bunch, check_random_state
from sklearn.utils._param_validation import Interval, StrOptions

from ._core.geometry.tracks import as_array, pack_tracks
from ._core.labels import canonical_labels
from ._core.partition.scene import background_motion
from ._core.stream.buffer import UNKNOWN
from ._core.stream.stream import Event, MotionStream
from ._parallel.threads import single_threaded
from ._segmenter.reasons import stream_reasons
from ._utils.validation import (
    TooFewTracksError,
    check_farthest,
    nothing_masked,
    unmasked,
)
from .segmentation import MotionSegmenter

__all__ = ["Event", "OnlineMotionSegmenter"]

# Motions that are looked for in the first frames, if their number is not given.
MOST_AT_FIRST = 10
# Probability of fewer motions than live by which some are merged: what is missing is
# found later, what is merged is not told apart again before it moves otherwise.
SURE_OF_FEWER = 0.8


class OnlineMotionSegmenter(BaseEstimator):
    """Say which tracks move together while the camera films, a frame at a time.

    The first ten frames are segmented by :class:`MotionSegmenter`. From then on each
    motion, a rigid one before a calibrated camera, is carried from frame to frame: its
    pose in a new frame is found by resection from the depths of its tracks, and
    adjusted together with those of the eleven frames before. Tracks follow the motion
    that explains them best, in these frames and, less and less, in earlier ones;
    neighbours in the picture that go the same way have a say where that is open. Tracks
    that no motion explains make a new one, if it explains several of them much better
    than a motion that is there could, and still does so five frames later. What a joint
    motion explains again and again, until it has been a motion of its own for long
    enough, is joined, unless a segmentation of the last frames tells it apart. The
    focal length and one coefficient of lens distortion are estimated at the start, and
    again in every sixth frame.

    Ten frames do not show all motions, and noise may look like one: after 15, 22, 33
    and 50 frames, all frames so far are segmented again. That adds motions, places
    tracks and joins what is one motion with 80 % or more, unless it was found apart
    twice. What has just come into view is often explained together with something else
    that moves. So the last twelve frames are segmented, too, where two motions may be
    one, or where one has tracks in a new place. Such updates take seconds, all others a
    fraction of one.

    Labels are identities that last. A motion keeps its number as long as it lives, and
    a number is given once. 0 is the static scene. What stops keeps its number, and what
    was out of view gets its own back if its tracks do, or if, within 100 frames, it is
    likelier to be the same than a new one: by its size, and by the places where it was
    last and used to be.

    Parameters
    ----------
    n_motions : int or "auto", default="auto"
        Number of motions that there are in the whole video, the static scene being one:
        no more numbers are given, and what comes back, however late, gets one of these.
        In view may be fewer. After a cut there are as many again.
    keep_history : bool, default=True
        Whether labels of tracks that are out of view are kept, for :meth:`result` and
        for tracks that come back after more than twelve frames. That takes about a bit
        or two per track; all else depends only on what is in view.
    focal_length : float or None, default=None
        Focal length of the camera in pixels, if it is known. ``None`` means that it is
        estimated. Lens distortion is estimated in any case. Limits are those of
        :class:`MotionSegmenter`.
    random_state : int, RandomState instance or None, default=None
        Drives the segmentations of the first frames, and where new motions are looked
        for.

    Attributes
    ----------
    labels_ : ndarray of int, shape (n_seen,)
        Of the tracks of the newest frame, in their order: 0 for the static scene, 1, 2,
        ... for other motions; -1 for a track that belongs to no motion, that is too
        short to judge and has no neighbours, or that came before motions were found.
    track_ids_ : ndarray of int, shape (n_seen,)
        Of the same tracks, as they were given.
    label_reasons_ : ndarray of str, shape (n_seen,)
        Reason for each of these labels: "assigned"; or, for -1, "outlier" if the motion
        of the track does not explain it and its neighbours go elsewhere, "no motions
        yet" before motions are found, "candidate" if the track belongs to what will be
        a new motion or be dropped within ten frames, and had no label before, and "too
        short" if the track is seen in too few of the last frames to judge, and has no
        neighbours.
    n_motions_ : int
        Motions in view.
    motions_ : ndarray of int, shape (n_motions,)
        Their numbers, ascending.
    background_ : int
        0 once there is a static scene, -1 before.
    n_frames_ : int
        Frames so far.
    events_ : list of Event
        What happened in the newest frame: each has ``frame``, ``kind`` and ``words``.
        Kinds are "start" (the first motions are found), "new", "again" (a motion that
        was out of view), "hidden" (it is out of view), "gone" (it is given up),
        "merged" (it is the same as another), "empty" (a frame without tracks), "break"
        (none of the tracks before goes on), "resumed" (they do again) and "cut" (they
        do not).

    See Also
    --------
    MotionSegmenter : The same for a clip that is there as a whole.

    Notes
    -----
    The estimator can be pickled between any two frames, and goes on as it would have.
    The order of the tracks within a frame does not matter.

    Parameters are those of the first frame; :meth:`update` raises an error if they have
    changed. ``sklearn.base.clone(segmenter)`` starts a new video.

    A label that was given is not taken back. Where two motions turn out to be one, and
    where a track changes sides, :meth:`result` has the last label.

    Examples
    --------
    >>> import numpy as np
    >>> from skmotionseg import OnlineMotionSegmenter, unpack_tracks
    >>> from skmotionseg.datasets import make_rigid_motions
    >>> X, y = make_rigid_motions(n_tracks=120, n_frames=14, random_state=0)
    >>> points, seen = unpack_tracks(X)
    >>> segmenter = OnlineMotionSegmenter(random_state=0)
    >>> for frame in range(14):
    ...     ids = np.flatnonzero(seen[:, frame])
    ...     labels = segmenter.update(points[ids, frame], ids)
    >>> segmenter.n_motions_, segmenter.background_
    (3, 0)
    >>> bool(np.mean(labels == y[ids]) > 0.9)
    True
    """

    _parameter_constraints: dict = {
        "n_motions": [
            Interval(Integral, 1, None, closed="left"),
            StrOptions({"auto"}),
        ],
        "keep_history": ["boolean"],
        "focal_length": [Interval(Real, 0, None, closed="neither"), None],
        "random_state": ["random_state"],
    }

    def __init__(
        self,
        n_motions: int | str = "auto",
        *,
        keep_history: bool = True,
        focal_length: float | None = None,
        random_state: int | np.random.RandomState | None = None,
    ) -> None:
        self.n_motions = n_motions
        self.keep_history = keep_history
        self.focal_length = focal_length
        self.random_state = random_state

    @single_threaded
    def update(
        self, points: npt.ArrayLike, track_ids: npt.ArrayLike
    ) -> npt.NDArray[np.intp]:
        """Take in a frame.

        Parameters
        ----------
        points : array-like of shape (n_seen, 2)
            Where the tracks of the new frame are, pixels.
        track_ids : array-like of int, shape (n_seen,)
            Which tracks these are. An id that was seen before is the same track, even
            after a gap.

        Returns
        -------
        labels : ndarray of int, shape (n_seen,)

        Raises
        ------
        TypeError, ValueError
            If the points are not pairs of finite real numbers, or there is not one
            whole number for each, or one comes twice, or a parameter is not what it was
            in the first frame. Nothing has changed then.
        KeyboardInterrupt
            As ever; the frame then counts as taken in, and must not be given again.
        """
        points, ids = _checked_frame(points, track_ids)
        if not hasattr(self, "_stream"):
            self._validate_params()
            self._stream, self._parameters = self._begin(), self.get_params()
        self._check_unchanged()
        labels, events = self._stream.step(points, ids, self._partition)
        self.labels_, self.track_ids_, self.events_ = labels, ids, events
        self.label_reasons_ = self._reasons(labels, ids)
        # What comes back is known by its tracks before its motion is.
        living = [m.number for m in self._stream.motions if not m.is_candidate]
        self.motions_ = np.union1d(living, labels[labels >= 0]).astype(int)
        self.n_motions_ = len(self.motions_)
        self.background_ = 0 if self._stream.numbers.next else -1
        self.n_frames_ = self._stream.frame + 1
        return labels.copy()

    def result(self) -> Bunch:
        """All tracks so far, and their motions.

        Returns
        -------
        result : Bunch
            ``track_ids``, ndarray of int, shape (n_tracks,), ascending; ``labels``,
            ndarray of int, shape (n_tracks,): the last label of each, in which motions
            that turned out to be one have one number, and tracks that were gone before
            motions were found have that of theirs; ``n_motions``, int: different
            labels, without -1. Without history, of the tracks of the last frames only.

        Raises
        ------
        NotFittedError
            Before the first frame.
        """
        if not hasattr(self, "_stream"):
            raise NotFittedError("no frame has been given to update yet")
        ids, labels = self._stream.result()
        n_motions = len(np.unique(labels[labels >= 0]))
        return Bunch(track_ids=ids, labels=labels, n_motions=n_motions)

    def _begin(self):
        rng = check_random_state(self.random_state)
        rng = np.random.RandomState(rng.randint(2**31 - 1))
        most = None if self.n_motions == "auto" else self.n_motions
        return MotionStream(most, rng, self.keep_history, self.focal_length)

    def _check_unchanged(self):
        """Refuse parameters that are not those of the first frame."""
        for name, new in self.get_params().items():
            old = self._parameters[name]
            if new is not old and new != old:
                raise ValueError(
                    f"parameters cannot change after the first frame; {name} was "
                    f"{old!r} and is {new!r}: clone(segmenter) starts a new video"
                )

    def _reasons(self, labels, ids):
        buffer = self._stream.buffer
        rows = np.searchsorted(buffer.ids, ids)
        return stream_reasons(
            labels,
            buffer.outlying[rows],
            buffer.labels[rows] < UNKNOWN,
            bool(self._stream.motions),
        )

    def _partition(self, points, seen, n_living):
        """Motions of the tracks of the first frames, the static scene first.

        No fewer than live, unless it is sure that there are fewer.
        """
        most: Any = MOST_AT_FIRST if self.n_motions == "auto" else self.n_motions
        seed = self._stream.rng.randint(2**31 - 1)
        segmenter = MotionSegmenter(
            max_motions=most, focal_length=self.focal_length, random_state=seed
        )
        try:
            labels = _with_living(
                segmenter.fit(pack_tracks(points, seen, layout="tracks_first")),
                n_living,
            )
        except TooFewTracksError:  # seen together
            return np.full(len(points), -1)
        static = background_motion(points, seen, labels)
        return _with_first(canonical_labels(labels), static)


def _with_living(segmenter, n_living):
    """Labels of as many motions as live, if a search has fewer and is not sure."""
    reached = min(n_living, len(segmenter.candidate_labels_)) - 1
    if reached > segmenter.best_index_:
        fewer = 1 - segmenter.count_probabilities_[reached:].sum()
        if fewer <= SURE_OF_FEWER:
            return segmenter.candidate_labels_[reached]
    return segmenter.labels_


def _with_first(labels, first):
    """Labels in which a certain one is 0, and the others are after it."""
    moved = np.where((labels >= 0) & (labels < first), labels + 1, labels)
    return np.where(labels == first, 0, moved) if first >= 0 else labels


def _checked_frame(points, track_ids):
    """Points (n, 2) and ids (n,) of a frame, if they are such."""
    points = np.asarray(unmasked(as_array(points)))
    ids = nothing_masked(track_ids, "track_ids")
    if points.size == 0 and ids.size == 0:
        return np.empty((0, 2)), np.empty(0, dtype=np.int64)
    if points.dtype.kind not in "fiu":
        raise TypeError(f"points must be real numbers; got dtype {points.dtype}")
    if points.ndim != 2 or points.shape[1] != 2:
        raise ValueError(f"points must have shape (n_seen, 2); got {points.shape}")
    if ids.dtype.kind not in "iu":
        raise TypeError(f"track_ids must be whole numbers; got dtype {ids.dtype}")
    if ids.size and ids.max() > np.iinfo(np.int64).max:
        raise ValueError(f"track_ids must be below 2**63; got {ids.max()}")
    if ids.shape != (len(points),):
        raise ValueError(
            f"{len(points)} points need one track id each; got shape {ids.shape}"
        )
    if not np.isfinite(points).all():
        where = np.flatnonzero(~np.isfinite(points).all(axis=1))
        raise ValueError(
            "points must be finite: leave out tracks that are not seen; got "
            f"{points[where[0]]} for track {ids[where[0]]}"
        )
    check_farthest(points)
    names, counts = np.unique(ids, return_counts=True)
    if (counts > 1).any():
        raise ValueError(
            f"track_ids must each come once per frame; got {names[counts > 1][0]} "
            f"{counts.max()} times"
        )
    return points.astype(np.float64), ids.astype(np.int64)
