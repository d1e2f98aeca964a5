"""From tracks to motions: the estimator most people use, and the plain pipeline."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from numbers import Integral, Real
from typing import Self

import numpy as np
import numpy.typing as npt
from joblib import Memory
from sklearn.base import BaseEstimator, ClusterMixin, _fit_context
from sklearn.pipeline import FeatureUnion, Pipeline
from sklearn.utils import check_random_state
from sklearn.utils._param_validation import Interval, StrOptions
from sklearn.utils.validation import check_is_fitted

from ._core.geometry.tracks import filled_frames, pack_tracks
from ._core.graph.cuts import own_shares
from ._core.graph.spectral import connected_tracks
from ._core.labels import canonical_labels
from ._core.partition.search import PartitionSearch, search_partitions
from ._parallel.threads import single_threaded
from ._segmenter.landmarks import landmarks_of
from ._segmenter.memory import check_batch_size, number_of_landmarks
from ._segmenter.report import SegmentationReport, follow_pairs, make_report
from ._segmenter.views import (
    ALL_MODELS,
    check_models,
    fit_branches,
    make_branch,
    model_seeds,
    place_tracks,
)
from ._utils.validation import TracksInput, get_fusion
from .cluster import MultiModelSpectralClustering
from .model_selection import (
    EigengapModelSelector,
    NCREModelSelector,
    SelfTuningModelSelector,
)

# One exponent of the epsilon-neighbourhood for all data, where the graph is to choose.
GRAPH_SPARSITY = 6.0
# Restarts of k-means for each of many candidates; a single partition gets more.
SEARCH_RESTARTS = 8


class MotionSegmenter(TracksInput, ClusterMixin, BaseEstimator):
    """Say which tracks of a moving camera move together.

    For each motion model, hypotheses are drawn in all frame pairs, tracks that prefer
    the same ones get a high affinity, and the affinities of all models are clustered
    together: several times, and for each number of motions that is possible. Of all
    these partitions one is taken that describes the motion of the tracks in few words
    and cuts few affinities.

    Parameters
    ----------
    n_motions : int or "auto", default="auto"
        Number of motions, the static scene being one.
    models : sequence of str, default=("affine", "homography", "fundamental")
        Motion models to combine; their order does not matter.
    n_hypotheses : int, default=500
        Hypotheses a frame pair and model.
    frame_gap : int, default=1
        Frames between the two of a pair, for the hypotheses. (Description lengths are
        measured at gaps of one and four frames.)
    top : float, default=0.1
        Share of a pair's hypotheses a track keeps (see :class:`ORKKernel`).
    sparsity : float or "auto", default="auto"
        Exponent of the epsilon-neighbourhood (see :class:`ORKKernel`). "auto" is 4
        and 8 for ``selection="description_length"``, and 6 otherwise.
    covisibility_prior : float, default=2
        How little few common frames count (see :class:`ORKKernel`).
    fusion : {"kernel_addition", "coreg", "subset"}, default="kernel_addition"
        How the models are joined (see :class:`MultiModelSpectralClustering`).
    lam, gamma : float, default=1e-2
        Weights of the fusions "coreg" and "subset".
    selection : {"description_length", "ncre", "eigengap", "self_tuning"}, \
default="description_length"
        How the partition is chosen. "description_length" tries several and takes the
        one that describes the tracks best by a fundamental matrix a motion and frame
        pair and cuts the graph little. The others choose the number of motions by the
        graph alone: "ncre", as the paper, by normalised cut and reconstruction error
        (see :class:`NCREModelSelector`); "eigengap" and "self_tuning", with which the
        paper compares it, by eigenvalues (:class:`EigengapModelSelector`) and by
        eigenvectors (:class:`SelfTuningModelSelector`, which does not take 1).
    delta : float, default=0.2
        Weight of the reconstruction error, for ``selection="ncre"`` (see
        :class:`NCREModelSelector`).
    min_motions, max_motions : int, default=1 and 10
        Numbers to choose from when ``n_motions="auto"``.
    reject_outliers : bool, default=True
        Whether a track that no motion explains gets -1, for
        ``selection="description_length"``; the other rules keep all tracks. Motions are
        fitted to those of their tracks that they explain best, and explain what stays
        within six standard deviations of their noise (a fifth of a pixel in 640 x 480,
        if it is less).
    n_landmarks : int, "auto" or None, default="auto"
        Tracks that are fitted; all others are placed by :meth:`predict`. "auto" fits
        all tracks up to 1,200 (3,000 where most are seen in few of the frames), and
        above that 600 (1,500): as many from each of 30 pieces into which a first look
        at tracks from all places and frames has cut the video, so that a small thing
        is not outvoted.
        None fits all, whatever memory that takes: with the square of their number.
    batch_size : int or "auto", default="auto"
        Tracks that are placed at a time; "auto" is 2,048.
    memory : str, joblib.Memory or None, default=None
        Caches the affinities of each model, so that fitting the same tracks with
        another ``n_motions``, ``models``, ``fusion``, ``lam``, ``gamma`` or ``delta``
        does not compute them again. Needs an integer ``random_state``.
    n_jobs : int or None, default=None
        Models, and batches of tracks to place, at a time, as in joblib, whose
        ``parallel_config`` says where.
    random_state : int, RandomState instance or None, default=None
        Drives hypotheses and k-means. A model's hypotheses do not depend on which
        other models there are.

    Attributes
    ----------
    labels_ : ndarray of int, shape (n_tracks,)
        ``0..n_motions_ - 1``, the largest motion first; -1 for a track that no motion
        explains, or that shares no preference with another, such as one that is seen in
        a single frame.
    probabilities_ : ndarray of shape (n_tracks,)
        How sure each label is, from 0 to 1: the share of a track's affinity that is to
        tracks of its own motion; 0 for -1. On KT3DMoSeg the tenth of the tracks that
        are least sure holds four fifths of a clip's errors.
    n_motions_ : int
    counts_ : ndarray of int, shape (n_counts,)
        The numbers of motions that were tried.
    costs_ : ndarray of shape (n_counts, 3)
        For each, the normalised cut, the description length (nats an observation) or
        the reconstruction error, and the total. The cheapest count is taken, but by
        description length only if each two motions gain from being apart. For
        "eigengap" and "self_tuning" see the ``costs_`` of their estimators.
    candidate_labels_ : ndarray of int, shape (n_counts, n_tracks)
        For each, the best partition.
    best_index_ : int
        Position of the chosen count.
    gainless_pairs_ : ndarray of int, shape (n_counts, 2)
        For each, two motions of its partition that gain too little from being apart, if
        it was passed over for that; else -1.
    landmarks_ : ndarray of int, shape (n_landmarks,)
        The tracks that were fitted, by their position.
    branches_ : dict of str to (HypothesisSampler, ORKKernel)
        The estimators of each model, fitted on the landmarks, in the frames that see
        any track.
    stage_seconds_ : dict
        Seconds for the choice of "landmarks", for "hypotheses" and "kernel" (summed
        over the models, whether or not they ran at the same time, and as first computed
        if they are from ``memory``), "clustering", "placing" of tracks that are no
        landmarks, and "total" of this fit.
    n_features_in_ : int
        Two columns a frame.

    See Also
    --------
    make_motion_pipeline : The same as a plain pipeline, to sweep every step.

    Notes
    -----
    Tracks that are never seen together, not even through others, cannot be told to
    move alike: unless ``n_motions`` forbids it, they end up in motions of their own.

    In a grid search, give ``scoring``, such as
    ``make_scorer(misclassification_error, greater_is_better=False)``.

    References
    ----------
    X. Xu, L.-F. Cheong and Z. Li, "3D Rigid Motion Segmentation with Mixed and Unknown
    Number of Models", IEEE TPAMI 43(1), 2021.

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
    """

    _parameter_constraints: dict = {
        "n_motions": [
            Interval(Integral, 1, None, closed="left"),
            StrOptions({"auto"}),
        ],
        "models": ["array-like", str],
        "n_hypotheses": [Interval(Integral, 1, None, closed="left")],
        "frame_gap": [Interval(Integral, 1, None, closed="left")],
        "top": [Interval(Real, 0, 1, closed="right")],
        "sparsity": [Interval(Real, 0, None, closed="neither"), StrOptions({"auto"})],
        "covisibility_prior": [Interval(Real, 0, None, closed="left")],
        "fusion": [str],
        "lam": [Interval(Real, 0, None, closed="left")],
        "gamma": [Interval(Real, 0, None, closed="left")],
        "selection": [
            StrOptions({"description_length", "ncre", "eigengap", "self_tuning"})
        ],
        "delta": [Interval(Real, 0, None, closed="left")],
        "min_motions": [Interval(Integral, 1, None, closed="left")],
        "max_motions": [Interval(Integral, 1, None, closed="left")],
        "reject_outliers": ["boolean"],
        "n_landmarks": [
            Interval(Integral, 1, None, closed="left"),
            StrOptions({"auto"}),
            None,
        ],
        "batch_size": [
            Interval(Integral, 1, None, closed="left"),
            StrOptions({"auto"}),
        ],
        "memory": [str, os.PathLike, Memory, None],
        "n_jobs": [Integral, None],
        "random_state": ["random_state"],
    }

    def __init__(
        self,
        n_motions: int | str = "auto",
        *,
        models: str | Sequence[str] = ALL_MODELS,
        n_hypotheses: int = 500,
        frame_gap: int = 1,
        top: float = 0.1,
        sparsity: float | str = "auto",
        covisibility_prior: float = 2.0,
        fusion: str = "kernel_addition",
        lam: float = 1e-2,
        gamma: float = 1e-2,
        selection: str = "description_length",
        delta: float = 0.2,
        min_motions: int = 1,
        max_motions: int = 10,
        reject_outliers: bool = True,
        n_landmarks: int | str | None = "auto",
        batch_size: int | str = "auto",
        memory: str | os.PathLike[str] | Memory | None = None,
        n_jobs: int | None = None,
        random_state: int | np.random.RandomState | None = None,
    ) -> None:
        self.n_motions = n_motions
        self.models = models
        self.n_hypotheses = n_hypotheses
        self.frame_gap = frame_gap
        self.top = top
        self.sparsity = sparsity
        self.covisibility_prior = covisibility_prior
        self.fusion = fusion
        self.lam = lam
        self.gamma = gamma
        self.selection = selection
        self.delta = delta
        self.min_motions = min_motions
        self.max_motions = max_motions
        self.reject_outliers = reject_outliers
        self.n_landmarks = n_landmarks
        self.batch_size = batch_size
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
            If there are fewer tracks in each frame pair than a model needs, or fewer
            than ``n_motions`` that share a preference with another.
        """
        models = check_models(self.models)
        get_fusion(self.fusion)
        points, visibility = self._read_tracks(X, reset=True)
        # A frame that sees nothing must not part its neighbours.
        self._frames = filled_frames(visibility, self.frame_gap + 1)
        points, visibility = points[:, self._frames], visibility[:, self._frames]
        self._check_counts(len(points))
        check_batch_size(self.batch_size, len(points))
        n_landmarks = number_of_landmarks(self.n_landmarks, visibility, len(models))
        started = time.perf_counter()
        seeds = model_seeds(check_random_state(self.random_state))
        tracks = pack_tracks(points)
        self.landmarks_ = landmarks_of(
            tracks,
            n_landmarks,
            models,
            seeds,
            batch_size=self.batch_size,
            n_jobs=self.n_jobs,
            memory=self.memory,
        )
        choosing = time.perf_counter()
        self.branches_, views, seconds = fit_branches(
            {model: self._make_branch(model, seeds[model]) for model in models},
            tracks[self.landmarks_],
            self.n_jobs,
            self.memory,
        )
        selecting = time.perf_counter()
        search = self._select(
            points[self.landmarks_],
            visibility[self.landmarks_],
            views,
            seeds["clustering"],
            len(tracks),
        )
        placing = time.perf_counter()
        self._keep(points, visibility, tracks, search)
        done = time.perf_counter()
        self.stage_seconds_ = {
            "landmarks": choosing - started,
            "hypotheses": seconds[0],
            "kernel": seconds[1],
            "clustering": placing - selecting,
            "placing": done - placing,
            "total": done - started,
        }
        return self

    def _keep(self, points, visibility, tracks, search):
        """Set what the search has found, for all tracks."""
        self.counts_, self.costs_ = search.counts, search.costs
        candidates, shares = self._label_all(tracks, search)
        labels, self._explanation = _explained(
            points, visibility, candidates[search.best], search.explanation
        )
        candidates[search.best] = labels
        self.candidate_labels_ = np.stack([canonical_labels(c) for c in candidates])
        self.labels_ = self.candidate_labels_[search.best]
        self.probabilities_ = np.where(self.labels_ >= 0, shares, 0)
        self.best_index_ = search.best
        self.gainless_pairs_ = follow_pairs(
            search.gainless, search.labels, self.candidate_labels_[:, self.landmarks_]
        )
        self.n_motions_ = int(self.labels_.max()) + 1

    def _label_all(self, tracks, search):
        """Labels (n_partitions, n_tracks), and shares (n_tracks,) of the chosen."""
        n_tracks = len(tracks)
        if n_tracks == len(self.landmarks_):
            return search.labels.copy(), search.shares
        labels = np.empty((len(search.labels), n_tracks), dtype=search.labels.dtype)
        shares = np.empty(n_tracks)
        labels[:, self.landmarks_], shares[self.landmarks_] = (
            search.labels,
            search.shares,
        )
        others = np.setdiff1d(np.arange(n_tracks), self.landmarks_)
        labels[:, others], votes = self._place(tracks[others], search.labels)
        shares[others] = votes[search.best]
        return labels, shares

    def _place(self, tracks, labels):
        return place_tracks(
            self.branches_, tracks, labels, self.batch_size, self.n_jobs
        )

    def _check_counts(self, n_tracks):
        """Refuse numbers of motions that cannot be, before any work."""
        if self.n_motions == "auto" and self.min_motions > self.max_motions:
            raise ValueError(
                "min_motions must not exceed max_motions; got "
                f"{self.min_motions} and {self.max_motions}"
            )
        fewest = self.min_motions if self.n_motions == "auto" else self.n_motions
        if fewest > n_tracks:
            raise ValueError(
                f"{fewest} motions are more than the tracks (n_samples={n_tracks})"
            )

    def _make_branch(self, model, seed):
        return make_branch(
            model,
            seed,
            n_hypotheses=self.n_hypotheses,
            frame_gap=self.frame_gap,
            top=self.top,
            sparsity=self._kernel_sparsity,
            covisibility_prior=self.covisibility_prior,
        )

    @property
    def _kernel_sparsity(self):
        if self.selection == "description_length":
            return None  # the search sparsifies, in several ways
        return GRAPH_SPARSITY if self.sparsity == "auto" else self.sparsity

    def _select(self, points, visibility, views, seed, n_tracks):
        """Search the counts that are open by the rule that is asked for."""
        clusterer = MultiModelSpectralClustering(
            fusion=self.fusion,
            lam=self.lam,
            gamma=self.gamma,
            n_jobs=self.n_jobs,
            random_state=seed,
        )
        if self.selection == "description_length":
            clusterer.set_params(n_init=SEARCH_RESTARTS)
        n_connected = len(connected_tracks(views))
        fewest, most = self.min_motions, min(self.max_motions, n_connected)
        if self.n_motions != "auto":
            fewest = most = self.n_motions
        if fewest > n_connected:
            raise ValueError(
                f"{fewest} motions are more than the {n_connected} tracks that share "
                f"a preference with another (n_samples={len(points)})"
            )
        if self.selection != "description_length":
            selector = self._make_selector(clusterer, fewest, most)
            selector.fit(np.hstack(views))
            return PartitionSearch(
                selector.counts_,
                selector.costs_,
                selector.candidate_labels_,
                selector.best_index_,
                own_shares(views, selector.labels_),
            )
        return search_partitions(
            points,
            visibility,
            views,
            np.arange(fewest, most + 1),
            self.sparsity,
            clusterer,
            self.reject_outliers,
            evenly_drawn=len(self.landmarks_) < n_tracks,
        )

    def _make_selector(self, clusterer, fewest, most):
        """The estimator that chooses the number of motions by the graph."""
        counts = {"min_clusters": fewest, "max_clusters": most}
        if self.selection == "ncre":
            return NCREModelSelector(clusterer, delta=self.delta, **counts)
        if self.selection == "eigengap":
            return EigengapModelSelector(clusterer, **counts)
        return SelfTuningModelSelector(clusterer, **counts)

    @single_threaded
    def predict(self, X: npt.ArrayLike) -> npt.NDArray[np.intp]:
        """Place tracks of the same video, fitted or not, in the motions found.

        Each goes where the fitted tracks of most affinity to it are.

        Parameters
        ----------
        X : array-like of shape (m, 2 * n_frames)

        Returns
        -------
        ndarray of int, shape (m,)
            -1 for a track that no motion explains, or that shares no preference with a
            fitted one.
        """
        check_is_fitted(self)
        points, visibility = self._read_tracks(X, reset=False)
        points, visibility = points[:, self._frames], visibility[:, self._frames]
        tracks = pack_tracks(points)
        (labels,), _ = self._place(tracks, self.labels_[None, self.landmarks_])
        return _reject(points, visibility, labels, self._explanation)

    @single_threaded
    def report(self, X: npt.ArrayLike) -> SegmentationReport:
        """Say what was found, and why.

        For each motion, how many tracks it has, the simplest motion model that explains
        it and how far its tracks are from this model; for each number of motions that
        was tried, what it costs and why it was taken or not.

        Parameters
        ----------
        X : array-like of shape (n_tracks, 2 * n_frames)
            The tracks that were fitted, which a fitted segmenter does not keep.

        Returns
        -------
        SegmentationReport
            Printed, it is a table.

        Raises
        ------
        NotFittedError, ValueError
            If there was no fit, or one to another number of tracks.

        Notes
        -----
        In each frame pair an affine map, a homography and a fundamental matrix are
        fitted to the landmarks of a motion, robustly, and the model that describes them
        in the fewest nats, its parameters included, explains the motion. A plane, a
        distant thing, or all that is at rest before a camera that only turns, is
        explained by a homography, or by an affine map if it is far or small.

        Examples
        --------
        >>> from skmotionseg import MotionSegmenter
        >>> from skmotionseg.datasets import make_rigid_motions
        >>> X, _ = make_rigid_motions(n_tracks=140, n_frames=8, random_state=0)
        >>> print(MotionSegmenter(max_motions=4, random_state=0).fit(X).report(X))
        3 motions in 140 tracks, 0 of no motion, 8 frames
        <BLANKLINE>
        motion  tracks  share  frames  explained by  residual     90 %
        --------------------------------------------------------------
             0      80  57.1%  8 of 8  fundamental    0.2... px  0.5... px
             1      40  28.6%  8 of 8  affine         0.5... px  0.7... px
             2      20  14.3%  8 of 8  fundamental    0.1... px  0.3... px
        <BLANKLINE>
                 normalised      nats an
        motions         cut  observation    total
        ---------------------------------------------------------
              1      0.0...      -4.1...  -4.1...  dearer by ...
              2      0.0...      -5.6...  -5.6...  dearer by ...
              3      0.1...      -6.0...  -6.0...  chosen
              4      0.4...      -5.9...  -5.7...  dearer by ...
        total = 0.3 x normalised cut + nats an observation
        """
        check_is_fitted(self)
        return make_report(self, *self._read_tracks(X, reset=False))


def _explained(points, visibility, labels, explanation):
    """Labels without outliers, and the explanation in the order that they will get."""
    labels = _reject(points, visibility, labels, explanation)
    if explanation is not None:
        canonical = canonical_labels(labels)
        order = [labels[canonical == m][0] for m in range(canonical.max() + 1)]
        explanation = explanation.reordered(order)
    return labels, explanation


def _reject(points, visibility, labels, explanation):
    """Labels with -1 for tracks that nothing explains; the same if nothing is known."""
    if explanation is None:
        return labels
    placed = labels >= 0
    labels = labels.copy()
    labels[placed] = explanation.reject(
        points[placed], visibility[placed], labels[placed]
    )
    return labels


def _make_clusterer(
    n_clusters, *, delta, min_clusters, max_clusters, random_state, **fusion
):
    """A clusterer for a known or unknown number of motions.

    Parameters
    ----------
    n_clusters : int or "auto"
    delta, min_clusters, max_clusters
        For ``n_clusters="auto"``.
    random_state : int, RandomState instance or None
    **fusion
        ``fusion``, ``lam`` and ``gamma``.

    Returns
    -------
    MultiModelSpectralClustering or NCREModelSelector
    """
    clusterer = MultiModelSpectralClustering(random_state=random_state, **fusion)
    if isinstance(n_clusters, str) and n_clusters != "auto":
        raise ValueError(f"n_clusters must be a number or 'auto'; got {n_clusters!r}")
    if n_clusters == "auto":
        return NCREModelSelector(
            clusterer,
            delta=delta,
            min_clusters=min_clusters,
            max_clusters=max_clusters,
        )
    return clusterer.set_params(n_clusters=n_clusters)


def make_motion_pipeline(
    models: str | Sequence[str] = ALL_MODELS,
    n_clusters: int | str = "auto",
    *,
    n_hypotheses: int = 500,
    frame_gap: int = 1,
    top: float = 0.1,
    sparsity: float | None = 6.0,
    covisibility_prior: float = 2.0,
    fusion: str = "kernel_addition",
    lam: float = 1e-2,
    gamma: float = 1e-2,
    delta: float = 0.2,
    min_clusters: int = 1,
    max_clusters: int = 10,
    memory: str | os.PathLike[str] | Memory | None = None,
    n_jobs: int | None = None,
    random_state: int | np.random.RandomState | None = None,
) -> Pipeline:
    """The paper's method as a plain scikit-learn pipeline.

    Parameters
    ----------
    models : sequence of str
        One branch each, named after the model.
    n_clusters : int or "auto"
        Number of motions; "auto" puts an :class:`NCREModelSelector` at the end.
    n_hypotheses, frame_gap
        As for :class:`HypothesisSampler`.
    top, sparsity, covisibility_prior
        As for :class:`ORKKernel`.
    fusion, lam, gamma
        As for :class:`MultiModelSpectralClustering`.
    delta
        As for :class:`NCREModelSelector`.
    min_clusters, max_clusters : int
        Counts to choose from when ``n_clusters="auto"``.
    memory : str, joblib.Memory or None
        Caches each branch, so that a sweep over the last step, or over branches set to
        ``"drop"``, fits each sampler and kernel once. Needs an integer
        ``random_state``.
    n_jobs : int or None
        Branches at a time.
    random_state : int, RandomState instance or None
        Seeds every step.

    Returns
    -------
    Pipeline
        Steps "affinity", a :class:`~sklearn.pipeline.FeatureUnion` of branches
        ``sampler`` - ``kernel``, and "cluster".

    Examples
    --------
    >>> from skmotionseg import make_motion_pipeline
    >>> from skmotionseg.datasets import make_rigid_motions
    >>> X, y = make_rigid_motions(n_tracks=70, n_frames=6, random_state=0)
    >>> pipeline = make_motion_pipeline(n_clusters=3, n_hypotheses=100, random_state=0)
    >>> labels = pipeline.fit_predict(X)
    >>> pipeline.set_params(affinity__affine="drop").fit_predict(X).shape
    (70,)
    """
    seeds = model_seeds(check_random_state(random_state))
    branch_parameters = {
        "n_hypotheses": n_hypotheses,
        "frame_gap": frame_gap,
        "top": top,
        "sparsity": sparsity,
        "covisibility_prior": covisibility_prior,
    }
    branches = [
        (model, _branch_pipeline(model, seeds[model], memory, **branch_parameters))
        for model in check_models(models)
    ]
    clusterer = _make_clusterer(
        n_clusters,
        fusion=fusion,
        lam=lam,
        gamma=gamma,
        delta=delta,
        min_clusters=min_clusters,
        max_clusters=max_clusters,
        random_state=seeds["clustering"],
    )
    return Pipeline(
        [("affinity", FeatureUnion(branches, n_jobs=n_jobs)), ("cluster", clusterer)]
    )


def _branch_pipeline(model, seed, memory, **parameters):
    sampler, kernel = make_branch(model, seed, **parameters)
    # Pipeline never caches its last step, so the kernel must not be the last.
    return Pipeline(
        [("sampler", sampler), ("kernel", kernel), ("affinity", "passthrough")],
        memory=memory,
    )
