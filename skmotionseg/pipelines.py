"""The paper's method as a plain scikit-learn pipeline."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, Self

import numpy as np
import numpy.typing as npt
from joblib import Memory
from sklearn.base import clone
from sklearn.pipeline import FeatureUnion, Pipeline
from sklearn.utils import check_random_state

from ._core.geometry.motion_models import MotionModel
from ._core.graph.fusion import check_fusion
from ._segmenter.views import (
    DEFAULT_MODELS,
    check_models,
    list_models,
    make_view,
    view_seeds,
)
from ._utils.caching import check_cacheable
from ._utils.validation import N_JOBS, check_estimator_parameters, unmasked
from .cluster import MultiModelSpectralClustering
from .kernels import ORKKernel
from .model_selection import Fusing, NCREModelSelector

__all__ = ["ModelUnion", "make_motion_pipeline"]


class ModelUnion(FeatureUnion):
    """Affinities of several motion models, side by side; ``models`` says of which.

    A :class:`~sklearn.pipeline.FeatureUnion`, whose views can be set to ``"drop"``,
    with a parameter by which one key of a grid sweeps subsets of the models.

    Parameters
    ----------
    transformer_list : list of (str, transformer)
        By the name of the model.
    models : sequence of str or MotionModel, or None, default=None
        Those that take part, by name or as objects; None is all.
    n_jobs : int or None, default=None
        Number of models to fit in parallel. ``None`` means 1 unless in a
        :obj:`joblib.parallel_backend` context. ``-1`` means using all processors. See
        :term:`Glossary <n_jobs>` for more details.
    transformer_weights : dict or None, default=None
    verbose : bool, default=False
    verbose_feature_names_out : bool, default=True
        As for :class:`~sklearn.pipeline.FeatureUnion`.

    Attributes
    ----------
    n_features_in_ : int
        Two columns per frame.

    See Also
    --------
    skmotionseg.make_motion_pipeline : Makes a pipeline that begins with such a union.

    Examples
    --------
    >>> from sklearn.pipeline import make_pipeline
    >>> from skmotionseg import HypothesisSampler, ORKKernel
    >>> from skmotionseg.datasets import make_rigid_motions
    >>> from skmotionseg.pipelines import ModelUnion
    >>> X, y = make_rigid_motions(n_tracks=60, n_frames=5, random_state=0)
    >>> views = [
    ...     (name, make_pipeline(HypothesisSampler(name, random_state=0), ORKKernel()))
    ...     for name in ("affine", "homography", "fundamental")
    ... ]
    >>> union = ModelUnion(views)
    >>> union.fit_transform(X).shape  # three views of 60 columns
    (60, 180)
    >>> union.set_params(models=("affine", "homography")).fit_transform(X).shape
    (60, 120)
    """

    _parameter_constraints: dict = {
        "transformer_list": [list],
        "models": ["array-like", str, MotionModel, None],
        "n_jobs": N_JOBS,
        "transformer_weights": [dict, None],
        "verbose": ["verbose"],
        "verbose_feature_names_out": ["boolean"],
    }

    def __init__(
        self,
        transformer_list: list[tuple[str, Any]],
        *,
        models: str | MotionModel | Sequence[str | MotionModel] | None = None,
        n_jobs: int | None = None,
        transformer_weights: dict[str, float] | None = None,
        verbose: bool = False,
        verbose_feature_names_out: bool = True,
    ) -> None:
        super().__init__(
            transformer_list,
            n_jobs=n_jobs,
            transformer_weights=transformer_weights,
            verbose=verbose,
            verbose_feature_names_out=verbose_feature_names_out,
        )
        self.models = models

    def _chosen(self) -> FeatureUnion:
        """The same without the models that do not take part."""
        names = [name for name, _ in self.transformer_list]
        chosen = names if self.models is None else _names_of(self.models)
        if not chosen or not all(name in names for name in chosen):
            raise ValueError(f"models must be some of {names}; got {chosen}")
        if len(set(chosen)) < len(chosen):
            raise ValueError(f"models must differ; got {chosen}")
        union = FeatureUnion(
            [
                (name, view if name in chosen else "drop")
                for name, view in self.transformer_list
            ],
            n_jobs=self.n_jobs,
            transformer_weights=self.transformer_weights,
            verbose=self.verbose,
            verbose_feature_names_out=self.verbose_feature_names_out,
        )
        config = getattr(self, "_sklearn_output_config", None)
        if config is not None:
            union._sklearn_output_config = config
        return union

    def _to_fit(self) -> FeatureUnion:
        """The models that take part, of which some must not be dropped."""
        self._validate_params()
        union = self._chosen()
        if all(view == "drop" for _, view in union.transformer_list):
            names = [name for name, _ in self.transformer_list]
            raise ValueError(
                f"a union needs at least one view; of {names}, all are dropped or not "
                f"among models={self.models!r}"
            )
        return union

    def _keep(self, union: FeatureUnion) -> None:
        """Take over the views that were fitted; forget earlier fits of the others."""
        self.transformer_list[:] = [
            (name, clone(view, safe=False) if fitted == "drop" else fitted)
            for (name, view), (_, fitted) in zip(
                self.transformer_list, union.transformer_list, strict=True
            )
        ]

    def fit(self, X: npt.ArrayLike, y: object = None, **fit_params: Any) -> Self:
        """Fit the views that take part.

        Parameters
        ----------
        X : array-like of shape (n_tracks, 2 * n_frames)
            Tracks in pixels; NaN where a point was not seen.
        y : ignored
        **fit_params : dict
            As for :class:`~sklearn.pipeline.FeatureUnion`.

        Returns
        -------
        self

        Raises
        ------
        ValueError
            If ``models`` are none of the union, or no view is left.
        """
        union = self._to_fit().fit(unmasked(X), y, **fit_params)
        self._keep(union)
        return self

    def fit_transform(
        self, X: npt.ArrayLike, y: object = None, **params: Any
    ) -> npt.NDArray[np.floating]:
        """Fit, and give the affinities of the same tracks.

        Parameters
        ----------
        X : array-like of shape (n_tracks, 2 * n_frames)
        y : ignored
        **params : dict
            As for :class:`~sklearn.pipeline.FeatureUnion`.

        Returns
        -------
        ndarray of shape (n_tracks, n_views * n_tracks)
            The views side by side.
        """
        union = self._to_fit()
        affinities = union.fit_transform(unmasked(X), y, **params)
        self._keep(union)
        return affinities

    def transform(self, X: npt.ArrayLike, **params: Any) -> npt.NDArray[np.floating]:
        """Affinities of tracks to the fitted tracks.

        Parameters
        ----------
        X : array-like of shape (n, 2 * n_frames)
        **params : dict
            As for :class:`~sklearn.pipeline.FeatureUnion`.

        Returns
        -------
        ndarray of shape (n, n_views * n_tracks)
        """
        return self._chosen().transform(unmasked(X), **params)

    def get_feature_names_out(
        self, input_features: npt.ArrayLike | None = None
    ) -> npt.NDArray[np.object_]:
        """Names of the columns, which begin with the name of the model.

        Parameters
        ----------
        input_features : array-like of str or None, default=None
            Names of the columns of the tracks.

        Returns
        -------
        ndarray of str, shape (n_views * n_tracks,)
        """
        return self._chosen().get_feature_names_out(input_features)

    @property
    def n_features_in_(self) -> int:
        """Two columns per frame."""
        return self._first_view().n_features_in_

    @property
    def feature_names_in_(self) -> npt.NDArray[np.object_]:
        """Names of the columns, where the tracks that were fitted had some."""
        return self._first_view().feature_names_in_

    def _first_view(self):
        """The first of the views that take part."""
        try:
            chosen = self._to_fit().transformer_list
        except ValueError as error:  # which hasattr would not take for an answer
            raise AttributeError(str(error)) from error
        return next(view for _, view in chosen if view != "drop")

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "n_features_in_") and (
            self._chosen().__sklearn_is_fitted__()
        )


def _names_of(models):
    """Names of models, which may be objects; what is neither stays."""
    return [
        model.name if isinstance(model, MotionModel) else model
        for model in list_models(models)
    ]


def make_motion_pipeline(
    models: str | MotionModel | Sequence[str | MotionModel] = DEFAULT_MODELS,
    n_clusters: int | str = "auto",
    *,
    n_hypotheses: int = 500,
    frame_gap: int = 1,
    top: float = 0.1,
    sparsity: float | None = 6.0,
    covisibility_prior: float = 2.0,
    fusion: Fusing = "kernel_addition",
    lam: float = 1e-2,
    gamma: float = 1e-2,
    delta: float = 0.2,
    min_clusters: int = 1,
    max_clusters: int = 10,
    memory: str | os.PathLike[str] | Memory | None = None,
    n_jobs: int | None = None,
    random_state: int | np.random.RandomState | None = None,
) -> Pipeline:
    """Build the paper's method as a plain scikit-learn pipeline.

    Parameters
    ----------
    models : sequence of str or MotionModel
        One view per model, named after it.
    n_clusters : int or "auto"
        Number of motions; "auto" chooses it by normalised cut and reconstruction error.
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
        Caches each view, so that a sweep over the last step, or over models, fits each
        sampler and kernel once.
    n_jobs : int or None
        Number of views to fit in parallel. ``None`` means 1 unless in a
        :obj:`joblib.parallel_backend` context. ``-1`` means using all processors. See
        :term:`Glossary <n_jobs>` for more details.
    random_state : int, RandomState instance or None
        Seeds every step; with None, each fit draws other hypotheses.

    Returns
    -------
    Pipeline
        Steps "affinity", a :class:`~skmotionseg.pipelines.ModelUnion` of views
        ``sampler`` - ``kernel``, and "cluster", an :class:`NCREModelSelector`. Keys of
        a grid are the same whether or not the number of motions is known:
        ``affinity__models`` (or ``affinity__affine="drop"``), ``cluster__fusion``,
        ``cluster__lam``, ``cluster__gamma``, ``cluster__delta``,
        ``cluster__n_clusters``, ``affinity__affine__sampler__n_hypotheses``, ...

    Raises
    ------
    TypeError, ValueError
        If a parameter is none that its step takes.

    Examples
    --------
    >>> from skmotionseg import make_motion_pipeline
    >>> from skmotionseg.datasets import make_rigid_motions
    >>> X, y = make_rigid_motions(n_tracks=70, n_frames=6, random_state=0)
    >>> pipeline = make_motion_pipeline(n_clusters=3, n_hypotheses=100, random_state=0)
    >>> labels = pipeline.fit_predict(X)
    >>> pipeline.set_params(affinity__models=("affine", "homography")).fit_predict(
    ...     X
    ... ).shape
    (70,)
    """
    kernel = ORKKernel(
        top=top, sparsity=sparsity, covisibility_prior=covisibility_prior
    )
    given = {"n_hypotheses": n_hypotheses, "frame_gap": frame_gap, "kernel": kernel}
    views, seed = _make_views(models, random_state, memory, given)
    clusterer = NCREModelSelector(
        MultiModelSpectralClustering(random_state=seed),
        n_clusters=n_clusters,
        fusion=fusion,
        lam=lam,
        gamma=gamma,
        delta=delta,
        min_clusters=min_clusters,
        max_clusters=max_clusters,
    )
    pipeline = Pipeline(
        [("affinity", ModelUnion(views, n_jobs=n_jobs)), ("cluster", clusterer)]
    )
    _check_parts(pipeline)
    return pipeline


def _check_parts(pipeline):
    """Refuse parameters of the steps as their fits would, before any work."""
    check_estimator_parameters(pipeline)
    clusterer = pipeline["cluster"]
    clusterer._range_of_counts()
    if clusterer.fusion is not None:
        check_fusion(clusterer.fusion)


def _make_views(models, random_state, memory, given):
    """Pipelines of sampler and kernel by model, and the seed of what clusters them."""
    records = check_models(models)
    check_cacheable(memory, 0 if random_state is not None else None, "random_state")
    seeds = view_seeds(check_random_state(random_state), records)
    if random_state is None:
        seeds = dict.fromkeys(seeds)
    views = [
        (model.name, _view_pipeline(model, seeds[model.name], memory, given))
        for model in records
    ]
    return views, seeds["clustering"]


def _view_pipeline(model, seed, memory, given):
    sampler, kernel = make_view(model, seed, **given)
    # Pipeline never caches its last step, so the kernel must not be the last.
    return Pipeline(
        [("sampler", sampler), ("kernel", kernel), ("affinity", "passthrough")],
        memory=os.fspath(memory) if isinstance(memory, os.PathLike) else memory,
    )
