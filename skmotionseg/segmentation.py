"""The main estimator: tracks in, motion labels out."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from contextlib import contextmanager
from functools import partial
from hashlib import blake2b
from numbers import Integral, Real
from typing import Any, Self

import numpy as np
import numpy.typing as npt
from joblib import Memory
from sklearn.base import BaseEstimator, ClusterMixin, _fit_context, clone
from sklearn.utils import check_random_state
from sklearn.utils._param_validation import HasMethods, Interval, StrOptions
from sklearn.utils.validation import check_is_fitted

from ._core.geometry.description_length import clip_geometry
from ._core.geometry.motion_models import MotionModel
from ._core.geometry.shutter import AT_ONCE, find_shutter
from ._core.geometry.tracks import (
    covisible_pairs,
    frame_pairs,
    non_empty_frames,
    unpack_tracks,
)
from ._core.graph.clustering import cluster_graph
from ._core.graph.fusion import check_fusion
from ._core.graph.spectral import connected_tracks
from ._core.labels import canonical_labels, follow_pairs
from ._core.partition.apartness import FEW_TRACKS
from ._core.partition.motions import fit_motions
from ._core.partition.scene import background_motion, spread_frames
from ._core.partition.search import SPARSITIES, count_probabilities, search_partitions
from ._parallel.threads import single_threaded
from ._segmenter.landmarks import choose_landmarks
from ._segmenter.long_clips import (
    LONG_CLIP,
    LongClip,
    points_in_batches,
    segment_in_windows,
)
from ._segmenter.memory import number_of_landmarks
from ._segmenter.motions import motions_in_pixels
from ._segmenter.reasons import OUTLIER, label_reasons
from ._segmenter.report import SegmentationReport, make_report, report_of_windows
from ._segmenter.selection import SELECTIONS, make_selector, select_by_graph, set_counts
from ._segmenter.views import (
    DEFAULT_MODELS,
    check_models,
    fit_views,
    make_view,
    place_by_landmarks,
    place_tracks,
    view_seeds,
)
from ._utils.caching import check_cacheable
from ._utils.validation import (
    LARGEST_SHARE,
    N_JOBS,
    TooFewTracksError,
    TracksInput,
    are_shares,
    check_estimator_parameters,
    forget_fit,
    placeholder_of,
)
from ._utils.warning import warn_of_unexplained, warn_user
from ._utils.words import counted
from .cluster import MultiModelSpectralClustering
from .kernels import ORKKernel
from .model_selection import Fusing

__all__ = ["MotionSegmenter"]

# What a fit keeps beside its fitted attributes.
OWN_STATE = ("_frames", "_known", "_explanation", "_shutter")
# Restarts of k-means for each of many candidates; a single partition gets more.
SEARCH_RESTARTS = 8


class MotionSegmenter(TracksInput, ClusterMixin, BaseEstimator):
    """Segment the tracks of a moving camera by their motion.

    For each motion model, hypotheses are drawn in all frame pairs, and tracks that
    prefer the same hypotheses get a high affinity. Partitions of the tracks are found
    by clustering these affinities, and are compared and improved by how well rigid
    motions over windows of several frames explain the tracks. The number of motions is
    the largest of which a partition is found whose motions are all likelier different
    than one, and the partition is the best that is found of so many. Two images, and
    clips with few or short tracks, are segmented by rules of their own (see
    ``selection``).

    A clip of more than 100 frames is segmented in windows of 30 frames that overlap by
    at least ten. Windows are segmented independently, in parallel, and then joined: a
    motion keeps its label as long as most of its tracks continue, and an object that
    was out of view gets its label back if it reappears where it is expected. If the
    number of motions is given, it is that of the whole clip, fewer of which may be in
    view at a time; windows that together show fewer are asked for more, and there is a
    warning if they do not tell so many apart.

    Parameters
    ----------
    n_motions : int or "auto", default="auto"
        Number of motions, the static scene being one.
    models : sequence of str or MotionModel, \
default=("affine", "homography", "fundamental")
        Motion models to combine, by name or as :class:`MotionModel`, in any order.
    n_hypotheses : int, default=500
        Hypotheses per frame pair and model.
    frame_gap : int, default=1
        Distance between the two frames of a pair, in frames, for the hypotheses.
        (Description lengths are computed at distances of one and four frames.) If it is
        1 and consecutive frames see fewer than four fifths of the tracks together, as
        in unordered photographs, the pairs are those that see most of them.
    kernel : ORKKernel or None, default=None
        Kernel that computes affinities from residuals. ``None`` means ``ORKKernel()``.
        Its ``sparsity="auto"`` is 4 and 8 for ``selection="description_length"``, which
        tries both, and 6 otherwise.
    fusion : {"kernel_addition", "coreg", "subset"} or callable, \
default="kernel_addition"
        How the models are fused (see :class:`MultiModelSpectralClustering`).
    lam, gamma : float, default=1e-2
        Weights of the fusions "coreg" and "subset".
    selection : {"description_length", "ncre", "eigengap", "self_tuning"} or \
estimator, default="description_length"
        How the partition is chosen. "description_length" generates several candidates,
        with 8 initialisations of k-means each, and judges them by how well their
        motions explain the tracks. In clips of at least three frames and twelve tracks,
        these are rigid motions over windows of up to six frames, and the number of
        motions is the largest whose motions are all more likely different than the
        same. Two images, where most tracks may be mismatches, are segmented by the
        densities of the points of the second along and across the epipolar lines of
        each motion, by a description length of points, labels and motions together, and
        unordered photographs by those of pairs of images. In other clips, the partition
        has the lowest sum of its description length, by a fundamental matrix per motion
        and frame pair, and its weighted normalised cut. The other rules select the
        number of motions by the graph alone: "ncre", the paper's rule, by normalised
        cut and reconstruction error (see :class:`NCREModelSelector`); "eigengap" and
        "self_tuning", with which the paper compares it, by eigenvalues
        (:class:`EigengapModelSelector`) and by eigenvectors
        (:class:`SelfTuningModelSelector`, which never selects 1). An estimator is
        fitted to the affinities of all models side by side, ``(n, n_models * n)``, and
        sets ``labels_``. If ``n_motions`` is given and the estimator has a parameter
        ``n_clusters``, it is set to ``n_motions``. An estimator has its own fusion,
        ``delta`` and range of counts.
    delta : float, default=0.2
        Weight of the reconstruction error, for ``selection="ncre"`` (see
        :class:`NCREModelSelector`).
    min_motions, max_motions : int, default=1 and 10
        Range of the number of motions if ``n_motions="auto"``; in a clip of more than
        100 frames, of those in each window, of which the whole may have more.
    reject_outliers : bool, default=True
        Whether tracks that are inliers of no motion are labelled -1, for
        ``selection="description_length"``; the other rules keep all tracks. Motions are
        fitted robustly. Their inliers have residuals within six standard deviations of
        the noise of the motion, which is at least a fifth of a pixel in an image of
        640 x 480. Where rigid motions are compared, tracks are outliers, too, that none
        of these explains and that do not go with their neighbours. Between two images,
        and in unordered photographs, a track is an outlier if it is less likely to
        follow any motion than to be a mismatch.
    focal_length : float or None, default=None
        Focal length of the camera in pixels, for rigid motions over windows of frames;
        the principal point is assumed to be the centre of the area that the tracks
        cover. ``None`` means that the focal length is estimated: of several common
        ones, the one that explains the motions of the clip best. Beyond ten times the
        larger side of this area, tracks show no perspective, so longer ones count as
        that; shorter ones than a twentieth of it, as that.
    n_landmarks : int, "auto" or None, default="auto"
        Number of tracks that are fitted; each other track gets the label of the fitted
        tracks that are nearest in position and displacement. "auto" fits all tracks if
        there are at most 1,500 (2,250 if most are seen in few of the frames), and
        otherwise 1,000 (1,500), the same number from each of 30 over-segments of the
        video, so that small motions are represented. ``None`` fits all tracks; memory
        then grows with the square of their number.
    memory : str, joblib.Memory or None, default=None
        Caches the affinities of each model, so that they are not computed again when
        the same tracks are fitted with another ``n_motions``, ``models``, ``fusion``,
        ``lam``, ``gamma`` or ``delta``; and the labels of each window of a long clip,
        so that an interrupted fit continues. Requires an integer ``random_state``;
        otherwise there is a warning.
    n_jobs : int or None, default=None
        Number of models to fit, of batches of tracks to label, and of windows of a long
        clip to segment, in parallel.
        ``None`` means 1 unless in a :obj:`joblib.parallel_backend` context. ``-1``
        means using all processors. See :term:`Glossary <n_jobs>` for more details.
    random_state : int, RandomState instance or None, default=None
        Determines the hypotheses and the initialisations of k-means. The hypotheses of
        a model do not depend on the other models; which tracks are landmarks does not
        depend on the seed.

    Attributes
    ----------
    labels_ : ndarray of int, shape (n_tracks,)
        ``0..n_motions_ - 1``, the largest motion first; -1 for a track that belongs to
        no motion.
    label_reasons_ : ndarray of str, shape (n_tracks,)
        Reason for each label: "assigned"; or, for tracks labelled -1, "outlier" if the
        track is an inlier of no motion, "too short" if it is seen in no frame pair (for
        example, in a single frame), and "isolated" if it shares no preferred hypothesis
        with another track, as where a window of a long clip has too few for any, or if
        a selection rule of your own gives it -1.
    probabilities_ : ndarray of shape (n_tracks,)
        Confidence of each label, from 0 to 1: the share of a track's affinities that
        belongs to tracks of its own motion, averaged over the models. If the number of
        motions was not given, this is multiplied by the probability that the motion is
        a separate one (``log_odds_``). Tracks labelled -1 have the value 0, as have the
        few whose affinities belong to other motions alone. Between two images, it is
        the probability that a track follows its motion, and neither another motion nor
        none. The results in the documentation show how often labels of each level of
        confidence are correct on benchmarks.
    n_motions_ : int
        Motions that have tracks; fewer than ``n_motions`` if all tracks of one are
        outliers, which is warned of.
    background_ : int
        The label of the static scene: the motion whose tracks cover most of the border
        of the image, extend over most of the image and surround the other motions,
        whatever their number; -1 if no track has a motion. The image is assumed to be
        the area that the tracks cover.
    frame_pairs_ : ndarray of int, shape (n_pairs, 2)
        Frame pairs to which the motions were finally fitted.
    matrices_ : ndarray of shape (n_motions, n_pairs, 3, 3)
        Fundamental matrix of each motion and frame pair, ``y^T F x = 0`` for pixels x
        in the first and y in the second frame, of unit norm. NaN where too few of the
        fitted tracks (``landmarks_``) of the motion are seen, mostly fewer than eight,
        outliers included that are rejected later; in unordered photographs that are
        searched by pairs, fewer than five.
    residuals_ : ndarray of shape (n_pairs, n_tracks), float32
        Sampson distance of each track from its own motion, in pixels. NaN where the
        pair does not see it, for tracks of no motion, and where there is no matrix.
    inlier_thresholds_ : ndarray of shape (n_motions,)
        Six standard deviations of a motion's noise, in pixels.
    inliers_ : ndarray of bool, shape (n_pairs, n_tracks)
        Whether the residual is within the threshold of the track's own motion. The
        mask of motion m is ``inliers_ & (labels_ == m)``.
    counts_ : ndarray of int, shape (n_counts,)
        The numbers of motions of which a partition was compared, ascending. They may
        end before ``max_motions``, where more motions are not worth a search.
    costs_ : ndarray of shape (n_counts, 3)
        For each number, two terms, such as the share of affinities between different
        motions and the nats per track, and their weighted sum. With
        ``selection="description_length"`` in clips of at least three frames and twelve
        tracks, the number is chosen by ``log_odds_``, whatever the sums are. Otherwise,
        and in unordered photographs, the number with the lowest sum is chosen; where
        partitions are compared by frame pairs, only if each two of its motions gain
        from being separate.
    cost_names_ : (str, str)
        Names of the two terms.
    cost_weights_ : (float, float)
        Their weights in the total.
    cost_tolerance_ : float
        Totals that differ by no more are considered equal.
    candidate_labels_ : ndarray of int, shape (n_counts, n_tracks)
        The best partition for each number.
    best_index_ : int
        Index of the chosen count.
    gainless_pairs_ : ndarray of int, shape (n_counts, 2)
        For each number, two motions of its partition that are likelier one than two or,
        by frame pairs, gain too little from being separate, if it was rejected for this
        reason; otherwise -1.
    log_odds_ : ndarray of shape (n_counts,)
        For each number, the log odds that the two most similar motions of its partition
        are two and not one; between two images, and in unordered photographs, that
        there are so many motions and not fewer. NaN where they are not computed: for
        one motion; for the fewest, between images; and where partitions are compared by
        fundamental matrices of frame pairs (fewer than 12 tracks, or tracks seen in
        fewer than three frames of a window; in two images, fewer than 16 tracks).
    count_probabilities_ : ndarray of shape (n_counts,)
        Probability of each number of motions, from ``log_odds_``; they sum to 1. NaN
        where frame pairs are used. ``n_motions_`` is their median, for which that many
        or more are likelier than fewer: another number may be likelier than it alone.
    landmarks_ : ndarray of int, shape (n_landmarks,)
        Indices of the tracks that were fitted.
    readout_ : ndarray of shape (2,)
        Time that the camera's rolling shutter takes from the left edge of what the
        tracks cover to the right one, and from the upper to the lower, as shares of the
        time between two frames; negative if it goes the other way. ``(0, 0)`` where it
        makes too little difference to tell, and unless ``selection`` is
        "description_length". Otherwise all else is of the tracks as they would be if
        each frame had been read at once.
    windows_ : ndarray of int, shape (n_windows, 2)
        Only for clips of more than 100 frames: first and last frame of each. Such a fit
        has ``labels_``, ``label_reasons_``, ``probabilities_`` (shares of the frames in
        which a track was found in its motion), ``n_motions_``, ``background_``,
        ``stage_seconds_`` ("windows" and "total"), this and the two that follow, and
        none of the others.
    window_counts_ : ndarray of int, shape (n_windows,)
        Number of motions found in each window. Others may be out of view.
    window_confidences_ : ndarray of shape (n_windows,)
        Probability that each window has no fewer motions than were found in it; of one
        that was segmented again, as it contradicts those beside it, theirs. NaN where
        it has too few tracks to look for any, and 1 where no probability is computed.
    views_ : dict of str to (HypothesisSampler, ORKKernel)
        The estimators of each model, fitted to the landmarks in the frames in which any
        track is seen. If there are at most a hundred, and ``selection`` is
        "description_length", each prefers hypotheses among those that were fitted to
        others (``minimal_sets_``), which the kernels do not know of other tracks.
    selector_ : estimator or None
        The selector that was fitted to the affinities, unless ``selection`` is
        "description_length".
    stage_seconds_ : dict
        Seconds for the choice of "landmarks", for "hypotheses" and "kernel" (summed
        over the models, whether or not they ran at the same time, and as first computed
        if they are from ``memory``), "clustering", "placing" of tracks that are no
        landmarks, and "total" of this fit.
    n_features_in_ : int
        Two columns per frame.

    See Also
    --------
    make_motion_pipeline : The paper's method as a plain pipeline.

    Notes
    -----
    Groups of tracks that are never seen together, not even through other tracks, are
    assigned to different motions, unless ``n_motions`` forbids it. "description_length"
    may assign them to one motion if they have about a dozen tracks each, seen in three
    or four frames.

    Lenses are assumed to keep straight lines straight. Corners that are moved by a few
    percent do little harm; but if lines in the images are visibly bent, undistort the
    tracks first (for example with ``cv2.undistortImagePoints``), or parts of the static
    scene near the border may be taken for other motions, most of all where the camera
    drives fast.

    In a grid search, set ``scoring``, for example to
    ``make_scorer(misclassification_error, greater_is_better=False)``.

    References
    ----------
    .. [1] X. Xu, L.-F. Cheong and Z. Li, "3D Rigid Motion Segmentation with Mixed and
       Unknown Number of Models", IEEE TPAMI 43(1), 2021.
       https://doi.org/10.1109/TPAMI.2019.2929146

    Examples
    --------
    >>> from skmotionseg import MotionSegmenter
    >>> from skmotionseg.datasets import make_rigid_motions
    >>> from skmotionseg.metrics import misclassification_error
    >>> X, y = make_rigid_motions(random_state=0)
    >>> segmenter = MotionSegmenter(random_state=0).fit(X)
    >>> segmenter.n_motions_
    3
    >>> misclassification_error(y, segmenter.labels_) < 0.05
    True

    Which motion is the static scene:

    >>> segmenter.background_
    0
    """

    _parameter_constraints: dict = {
        "n_motions": [
            Interval(Integral, 1, None, closed="left"),
            StrOptions({"auto"}),
        ],
        "models": ["array-like", str, MotionModel],
        "n_hypotheses": [Interval(Integral, 1, None, closed="left")],
        "frame_gap": [Interval(Integral, 1, None, closed="left")],
        "kernel": [ORKKernel, None],
        "fusion": [str, callable],
        "lam": [Interval(Real, 0, None, closed="left")],
        "gamma": [Interval(Real, 0, None, closed="left")],
        "selection": [
            StrOptions(set(SELECTIONS)),
            HasMethods(["fit", "get_params", "set_params"]),
        ],
        "delta": [Interval(Real, 0, None, closed="left")],
        "min_motions": [Interval(Integral, 1, None, closed="left")],
        "max_motions": [Interval(Integral, 1, None, closed="left")],
        "reject_outliers": ["boolean"],
        "focal_length": [Interval(Real, 0, None, closed="neither"), None],
        "n_landmarks": [
            Interval(Integral, 1, None, closed="left"),
            StrOptions({"auto"}),
            None,
        ],
        "memory": [str, os.PathLike, Memory, None],
        "n_jobs": N_JOBS,
        "random_state": ["random_state"],
    }

    def __init__(
        self,
        n_motions: int | str = "auto",
        *,
        models: str | MotionModel | Sequence[str | MotionModel] = DEFAULT_MODELS,
        n_hypotheses: int = 500,
        frame_gap: int = 1,
        kernel: ORKKernel | None = None,
        fusion: Fusing = "kernel_addition",
        lam: float = 1e-2,
        gamma: float = 1e-2,
        selection: str | BaseEstimator = "description_length",
        delta: float = 0.2,
        min_motions: int = 1,
        max_motions: int = 10,
        reject_outliers: bool = True,
        focal_length: float | None = None,
        n_landmarks: int | str | None = "auto",
        memory: str | os.PathLike[str] | Memory | None = None,
        n_jobs: int | None = None,
        random_state: int | np.random.RandomState | None = None,
    ) -> None:
        self.n_motions = n_motions
        self.models = models
        self.n_hypotheses = n_hypotheses
        self.frame_gap = frame_gap
        self.kernel = kernel
        self.fusion = fusion
        self.lam = lam
        self.gamma = gamma
        self.selection = selection
        self.delta = delta
        self.min_motions = min_motions
        self.max_motions = max_motions
        self.reject_outliers = reject_outliers
        self.focal_length = focal_length
        self.n_landmarks = n_landmarks
        self.memory = memory
        self.n_jobs = n_jobs
        self.random_state = random_state

    @_fit_context(prefer_skip_nested_validation=True)
    @single_threaded
    def fit(self, X: npt.ArrayLike, y: object = None) -> Self:
        """Segment tracks.

        Parameters
        ----------
        X : array-like of shape (n_tracks, 2 * n_frames)
            Tracks in pixels; NaN where a point was not seen.
        y : ignored

        Returns
        -------
        self

        Raises
        ------
        ValueError
            If ``X`` contains infinities or is not of an even number of columns; if
            parameters do not go together, such as ``min_motions`` above
            ``max_motions``; if ``frame_gap`` is so large that there is no frame pair;
            if every frame pair has fewer tracks than a model needs; if ``n_landmarks``
            is more than the tracks (of a clip of at most 100 frames; windows of longer
            ones fit all that they have), or fewer than a model needs; if ``n_motions``,
            or ``min_motions``, is more than the tracks, or than those that share a
            preferred hypothesis with another.
        MemoryError
            If ``n_landmarks`` asks for more tracks than fit into memory.

        Warns
        -----
        UserWarning
            If the tracks are not in pixels, unseen points seem to be (0, 0) or another
            number twice, half of the tracks are far from the motion that they are
            assigned to, fewer motions are found than ``n_motions``, or ``memory`` has
            no effect.
        """
        tracks, models = self._prepare(X)
        check_cacheable(self.memory, self.random_state, "random_state")
        if are_shares(tracks):
            warn_user(
                f"all coordinates are between -{LARGEST_SHARE} and {LARGEST_SHARE}, so "
                "they are not pixels, in which noise is measured: if they are shares "
                "of the image's size, multiply them by its width and height",
            )
        placeholder = placeholder_of(tracks)
        if placeholder is not None:
            warn_user(
                f"some tracks are at ({placeholder:g}, {placeholder:g}) in some frames "
                "and elsewhere in others: if they are not seen there, these points "
                "must be NaN",
            )
        if tracks.shape[1] > 2 * LONG_CLIP:
            clip = LongClip(tracks, self.frame_gap + 1)
            if clip.n_frames > LONG_CLIP:
                return self._fit_in_windows(clip, tracks)
        unexplained = self._fit_whole(tracks, models)
        if unexplained:
            warn_of_unexplained(unexplained)
        fewer = self.n_motions != "auto" and self.n_motions_ < self.n_motions
        if fewer and (self.label_reasons_ == OUTLIER).any():
            warn_user(
                f"n_motions={self.n_motions} was asked for, and "
                f"{counted(self.n_motions_, 'motion')} found: all tracks of others are "
                "outliers",
            )
        return self

    def _fit_window(self, X):
        """Fit a window of a longer clip, whose fit says what there is to warn of.

        Returns
        -------
        unexplained : float
            As of :class:`~skmotionseg._core.partition.search.PartitionSearch`.
        """
        return self._fit_whole(*self._prepare(X))

    def _prepare(self, X):
        """Checked tracks and motion models; nothing is left of an earlier fit."""
        models = self._check_parameters()
        forget_fit(self, OWN_STATE)
        tracks = self._read_tracks(X, reset=True)
        self._check_counts(len(tracks))
        return tracks, models

    def _fit_whole(self, tracks, models):
        """Fit landmarks of all frames at once, and place the other tracks.

        What is returned is as of :meth:`_fit_window`.
        """
        points, visibility = unpack_tracks(tracks)
        # The paper's rules take tracks as they are.
        self._shutter = find_shutter(points, visibility) if self._by_length else AT_ONCE
        self.readout_ = self._shutter.readout.copy()
        # A frame that sees nothing must not part its neighbours.
        self._frames = non_empty_frames(visibility, self.frame_gap + 1)
        points = self._shutter.at_once(points, visibility)
        points, visibility = points[:, self._frames], visibility[:, self._frames]
        n_landmarks = number_of_landmarks(self.n_landmarks, visibility, len(models))
        seeds = view_seeds(check_random_state(self.random_state), models)
        clock = _Stopwatch()
        with clock.measure("landmarks"):
            self.landmarks_ = choose_landmarks(
                points,
                visibility,
                n_landmarks,
                models,
                n_jobs=self.n_jobs,
                memory=self.memory,
            )
        fitted = points[self.landmarks_], visibility[self.landmarks_]
        self.views_, affinities, seconds = fit_views(
            {model.name: self._make_view(model, seeds) for model in models},
            *fitted,
            self.n_jobs,
            self.memory,
            self._covisible_pairs(visibility),
            by_others=self._by_length and len(fitted[0]) <= FEW_TRACKS,
        )
        clock.seconds["hypotheses"], clock.seconds["kernel"] = seconds.tolist()
        with clock.measure("clustering"):
            found = self._partition(*fitted, affinities, seeds, len(points))
        with clock.measure("placing"):
            self._keep(points, visibility, affinities, found)
        self.stage_seconds_ = clock.with_total()
        return found.unexplained

    def _unpack(self, tracks):
        """Points, as if the camera had read each frame at once, and visibility."""
        points, visibility = unpack_tracks(tracks)
        return self._shutter.at_once(points, visibility), visibility

    def _fit_in_windows(self, clip, X):
        """Set what is known of the tracks of a long clip."""
        clock, rng = _Stopwatch(), check_random_state(self.random_state)
        with clock.measure("windows"):
            found = segment_in_windows(clip, self._plain(), rng)
        self._frames = clip.frames
        self.labels_, self.probabilities_ = found.labels, found.shares
        self.windows_, self.window_counts_ = found.windows, found.counts
        self.window_confidences_ = found.surely
        self.n_motions_ = found.n_motions
        some = clip.frames[spread_frames(clip.n_frames)]
        points = np.concatenate([*points_in_batches(X, some)])
        visibility = ~np.isnan(points[..., 0])
        self.background_ = background_motion(points, visibility, found.labels)
        seen_often = clip.times > self.frame_gap
        placed = np.where(seen_often & clip.are_in(found.counts > 0), 0, -1)
        self.label_reasons_ = label_reasons(found.labels, placed, seen_often)
        digests = self._digests_of_long(X)
        self._known = dict(zip(digests, found.labels.tolist(), strict=True))
        self.stage_seconds_ = clock.with_total()
        return self

    def _plain(self):
        """The same without what a subclass adds, such as a ``fit`` that changes tracks.

        That has been done of the whole clip, and is not for its windows again; nor need
        a subclass have all the parameters that are set for windows.
        """
        names = MotionSegmenter._get_param_names()
        return MotionSegmenter(**{name: getattr(self, name) for name in names})

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "labels_")

    def _check_parameters(self):
        """Refuse parameters that do not go together; give the motion models."""
        models = check_models(self.models)
        check_fusion(self.fusion)
        for own in (self.kernel, self.selection):
            check_estimator_parameters(own)
        if self.n_motions == "auto" and self.min_motions > self.max_motions:
            raise ValueError(
                "min_motions must not exceed max_motions; got "
                f"{self.min_motions} and {self.max_motions}"
            )
        largest = max(models, key=lambda model: model.minimal_size)
        some = self.n_landmarks
        if isinstance(some, Integral) and some < largest.minimal_size:
            raise ValueError(
                f"n_landmarks must be at least the {largest.minimal_size} tracks that "
                f"the {largest.name} model needs; got {some}"
            )
        return models

    def _check_counts(self, n_tracks):
        """Refuse more motions than there are tracks, before any work."""
        fewest = self.min_motions if self.n_motions == "auto" else self.n_motions
        if fewest > n_tracks:
            raise TooFewTracksError(
                f"{fewest} motions are more than the tracks (n_samples={n_tracks})"
            )

    def _make_view(self, model, seeds):
        """Sampler and kernel of a model; the search by length sparsifies by itself."""
        kernel = ORKKernel() if self.kernel is None else clone(self.kernel)
        if self._by_length:
            kernel.set_params(sparsity=None)
        return make_view(
            model,
            seeds[model.name],
            n_hypotheses=self.n_hypotheses,
            frame_gap=self.frame_gap,
            kernel=kernel,
        )

    def _covisible_pairs(self, visibility):
        """Frame pairs where the usual ones miss some tracks; None elsewhere."""
        usual = frame_pairs(visibility.shape[1], self.frame_gap)
        pairs = covisible_pairs(visibility, usual)
        return None if pairs is usual or self.frame_gap > 1 else pairs

    @property
    def _by_length(self):
        selection = self.selection
        return isinstance(selection, str) and selection == "description_length"

    def _partition(self, points, visibility, affinities, seeds, n_tracks):
        """Search the counts that are open by the rule that is asked for."""
        fewest, most = self._open_counts(affinities)
        clusterer = MultiModelSpectralClustering(
            fusion=self.fusion,
            lam=self.lam,
            gamma=self.gamma,
            n_jobs=self.n_jobs,
            random_state=seeds["clustering"],
        )
        self.selector_ = None
        if not self._by_length:
            self.selector_ = make_selector(self.selection, clusterer, self.delta)
            if self.n_motions != "auto":
                set_counts(self.selector_, n_clusters=fewest)
            elif isinstance(self.selection, str):
                set_counts(self.selector_, min_clusters=fewest, max_clusters=most)
            return select_by_graph(self.selector_, affinities)
        return search_partitions(
            points,
            visibility,
            affinities,
            np.arange(fewest, most + 1),
            self._sparsities(),
            partial(_cluster, clusterer._fuse(), seeds["clustering"]),
            self.reject_outliers,
            stratified=len(self.landmarks_) < n_tracks,
            seed=seeds["clustering"],
            focal_length=self.focal_length,
        )

    def _sparsities(self):
        """Exponents of the epsilon-neighbourhood that a search tries."""
        sparsity = "auto" if self.kernel is None else self.kernel.sparsity
        return SPARSITIES if sparsity == "auto" else (sparsity,)

    def _open_counts(self, affinities):
        """The fewest and the most motions that can be."""
        n_connected = len(connected_tracks(affinities))
        fewest: Any = self.min_motions
        most: Any = min(self.max_motions, n_connected)
        if self.n_motions != "auto":
            fewest = most = self.n_motions
        if fewest > n_connected:
            raise TooFewTracksError(
                f"{fewest} motions are more than the {n_connected} tracks that share "
                f"a preference with another (n_samples={affinities.shape[1]})"
            )
        return fewest, most

    def _keep(self, points, visibility, affinities, found):
        """Set what the search has found, for all tracks."""
        self.counts_, self.costs_, self.best_index_ = (
            found.counts,
            found.costs,
            found.best,
        )
        self.cost_names_, self.cost_weights_ = found.cost_names, found.cost_weights
        self.cost_tolerance_ = found.cost_tolerance
        candidates, shares = self._label_all(points, visibility, found)
        before_rejection = candidates[found.best].copy()
        if found.distinct is not None:
            shares = shares * found.distinct[before_rejection]
        labels = _reject(points, visibility, before_rejection, found.explanation)
        if found.outliers is not None:
            fitted = before_rejection[self.landmarks_]
            labels[self.landmarks_] = np.where(found.outliers, -1, fitted)
        self._explanation = _in_order(found.explanation, labels)
        candidates[found.best] = labels
        self.candidate_labels_ = np.stack([canonical_labels(c) for c in candidates])
        self.labels_ = self.candidate_labels_[found.best]
        self.label_reasons_ = label_reasons(
            self.labels_, before_rejection, self._seen_in_pairs(visibility)
        )
        self.probabilities_ = np.where(self.labels_ >= 0, shares, 0)
        self.gainless_pairs_ = follow_pairs(
            found.gainless, found.labels, self.candidate_labels_[:, self.landmarks_]
        )
        self.log_odds_ = _or_unknown(found.log_odds, found.counts)
        self.count_probabilities_ = count_probabilities(found.counts, self.log_odds_)
        self.n_motions_ = int(self.labels_.max()) + 1
        self.background_ = background_motion(points, visibility, self.labels_)
        self._keep_motions(points, visibility, affinities)
        self._known = dict(zip(_digests(points), self.labels_.tolist(), strict=True))

    def _keep_motions(self, points, visibility, affinities):
        """Set matrices, residuals and inliers of the motions."""
        if self._explanation is not None:
            motions = self._explanation.motions
        else:
            some = self.landmarks_
            geometry = clip_geometry(points[some], visibility[some])
            motions = fit_motions(geometry, self.labels_[some], affinities.mean(axis=0))
        (
            self.frame_pairs_,
            self.matrices_,
            self.inlier_thresholds_,
            self.residuals_,
            self.inliers_,
        ) = motions_in_pixels(motions, points, visibility, self.labels_, self._frames)

    def _seen_in_pairs(self, visibility):
        """Whether a frame pair of the hypotheses sees each track: bool, (n_tracks,)."""
        sampler, _ = next(iter(self.views_.values()))
        return visibility[:, sampler.frame_pairs_].all(axis=2).any(axis=1)

    def _label_all(self, points, visibility, found):
        """Labels (n_partitions, n_tracks), and shares (n_tracks,) of the chosen."""
        n_tracks = len(points)
        if n_tracks == len(self.landmarks_):
            return found.labels.copy(), found.shares
        labels, votes = place_by_landmarks(
            self.views_, points, visibility, self.landmarks_, found.labels, self.n_jobs
        )
        shares = votes[found.best]
        shares[self.landmarks_] = found.shares
        others = np.setdiff1d(np.arange(n_tracks), self.landmarks_)
        if found.explanation is not None:
            labels[found.best, others] = found.explanation.nearest(
                points[others], visibility[others], labels[found.best, others]
            )
        # Landmarks also place what is seen in frames that no frame pair joins.
        labels[:, ~self._seen_in_pairs(visibility)] = -1
        return labels, shares

    @single_threaded
    def predict(self, X: npt.ArrayLike) -> npt.NDArray[np.intp]:
        """Predict the motions of tracks of the same video.

        A track that was fitted gets its label in ``labels_``. Any other track gets the
        label of the fitted tracks with the highest affinity to it. In clips of more
        than 100 frames, only tracks that were fitted can be labelled.

        Parameters
        ----------
        X : array-like of shape (m, 2 * n_frames)

        Returns
        -------
        ndarray of int, shape (m,)
            -1 for a track that is an inlier of no motion, or shares no preferred
            hypothesis with a fitted track.

        Raises
        ------
        NotFittedError, ValueError
            If the segmenter is not fitted, the number of frames is another, or a track
            of a clip of more than 100 frames was not fitted.
        """
        check_is_fitted(self)
        tracks = self._read_tracks(X, reset=False)
        if hasattr(self, "windows_"):
            return self._recall(tracks)
        points, visibility = self._unpack(tracks)
        points, visibility = points[:, self._frames], visibility[:, self._frames]
        (labels,), _ = place_tracks(
            self.views_,
            points,
            visibility,
            self.labels_[None, self.landmarks_],
            self.n_jobs,
        )
        if self._explanation is not None:
            labels = self._explanation.nearest(points, visibility, labels)
        labels = _reject(points, visibility, labels, self._explanation)
        pairs = zip(_digests(points), labels.tolist(), strict=True)
        return np.array([self._known.get(key, new) for key, new in pairs], dtype=int)

    def _digests_of_long(self, X):
        """Digests of the tracks of a long clip."""
        parts = points_in_batches(X, self._frames)
        return [digest for points in parts for digest in _digests(points)]

    def _recall(self, X):
        """Labels of tracks of a long clip that were fitted."""
        labels = [self._known.get(digest) for digest in self._digests_of_long(X)]
        if None in labels:
            raise ValueError(
                f"in clips of more than {LONG_CLIP} frames only tracks that were "
                f"fitted can be placed; {labels.count(None)} of {len(labels)} were not"
            )
        return np.array(labels, dtype=int)

    @single_threaded
    def report(self, X: npt.ArrayLike) -> SegmentationReport:
        """Report what was found, and why.

        For each motion, the report gives the number of its tracks, the simplest motion
        model that explains it and the residuals of its tracks. For each number of
        motions that was tried, it gives the costs and the reason why it was chosen or
        not. Of a clip of more than 100 frames it gives instead how many motions each
        window has found, and models are fitted in each window.

        Parameters
        ----------
        X : array-like of shape (n_tracks, 2 * n_frames)
            The tracks that were fitted, which a fitted segmenter does not keep.

        Returns
        -------
        SegmentationReport
            Its string is a table.

        Raises
        ------
        NotFittedError, ValueError
            If the segmenter is not fitted, or fitted to other tracks.

        Notes
        -----
        In each frame pair an affine map, a homography and a fundamental matrix are
        fitted robustly to the landmarks of a motion. The model of lowest description
        length, including its parameters, explains the motion. A plane, a distant
        object, or the static scene of a camera that only turns is explained by a
        homography, or by an affine map if it is distant or small.

        Examples
        --------
        >>> from skmotionseg import MotionSegmenter
        >>> from skmotionseg.datasets import make_rigid_motions
        >>> X, _ = make_rigid_motions(n_tracks=140, n_frames=8, random_state=0)
        >>> print(MotionSegmenter(max_motions=4, random_state=0).fit(X).report(X))
        3 motions in 140 tracks, 0 unassigned, 8 frames
        <BLANKLINE>
        motion  tracks  share  frames  explained by  residual     90 %
        --------------------------------------------------------------
             0      80  57.1%  8 of 8  fundamental    0.2... px  0.5... px
             1      40  28.6%  8 of 8  affine         0.5... px  0.7... px
             2      20  14.3%  8 of 8  fundamental    0.1... px  0.3... px
        <BLANKLINE>
                      links to  nats per
        motions  other motions     track   total
        ---...---
              1         0.0...    9...     9...   cost higher by ...
              2         0.0...    4...     4...   cost higher by ...
              3         0.0...    2...     2...   chosen
              4         0.0...    2...     2...   motions ... are one (9... %)
        total = 4 x links to other motions + nats per track
        Number of motions: 3 with 9... %; next, ...
        """
        check_is_fitted(self)
        tracks = self._read_tracks(X, reset=False)
        if hasattr(self, "windows_"):
            self._check_fitted_to(self._digests_of_long(tracks), "a report")
            return report_of_windows(self, LongClip(tracks, self.frame_gap + 1))
        return make_report(self, *self._unpack_fitted(tracks, "a report"))

    def _fitted_affinities(self, X):
        """Affinities (n_landmarks, n_landmarks) that were clustered, by model.

        The tracks are only checked: kernels keep what they were fitted to, which are
        landmarks as if the camera had read each frame at once.
        """
        self._unpack_fitted(self._read_tracks(X, reset=False), "a display")
        views = self.views_.items()
        return {model: kernel._fitted_affinity() for model, (_, kernel) in views}

    def _unpack_fitted(self, tracks, what):
        """What :meth:`_unpack` gives, of the tracks of the fit; others are refused."""
        points, visibility = self._unpack(tracks)
        self._check_fitted_to(_digests(points[:, self._frames]), what)
        return points, visibility

    def _check_fitted_to(self, digests, what):
        """Refuse tracks that are not those of the fit, in their order."""
        n_tracks = len(self.labels_)
        if len(digests) != n_tracks:
            raise ValueError(
                f"{what} needs the {n_tracks} tracks that were fitted; got "
                f"{len(digests)}"
            )
        if [*dict.fromkeys(digests)] != [*self._known]:  # a track may come twice
            raise ValueError(
                f"{what} needs the tracks that were fitted, in their order; these are "
                "others, or in another order"
            )


class _Stopwatch:
    """Seconds of each stage of a fit."""

    def __init__(self):
        self.seconds = {}
        self._started = time.perf_counter()

    @contextmanager
    def measure(self, stage):
        started = time.perf_counter()
        yield
        self.seconds[stage] = time.perf_counter() - started

    def with_total(self):
        return {**self.seconds, "total": time.perf_counter() - self._started}


def _cluster(fuse, seed, graph, n_clusters):
    """Labels of a graph's tracks for a candidate, always from the same seed."""
    rng = np.random.RandomState(seed)
    return cluster_graph(graph, n_clusters, fuse, SEARCH_RESTARTS, rng)


def _in_order(explanation, labels):
    """The explanation in the order that the labels will get; None stays."""
    if explanation is None:
        return None
    canonical = canonical_labels(labels)
    order = [labels[canonical == m][0] for m in range(canonical.max() + 1)]
    return explanation.reordered(order)


def _or_unknown(log_odds, counts):
    return np.full(len(counts), np.nan) if log_odds is None else log_odds


def _reject(points, visibility, labels, explanation):
    """Labels with -1 for the inliers of no motion; the same if nothing is known."""
    if explanation is None:
        return labels
    placed = labels >= 0
    labels = labels.copy()
    labels[placed] = explanation.reject(
        points[placed], visibility[placed], labels[placed]
    )
    return labels


def _digests(points):
    """A short digest of each track, (n, n_frames, 2), by which it is known again."""
    points = np.ascontiguousarray(points)
    return [blake2b(track.tobytes(), digest_size=16).digest() for track in points]
