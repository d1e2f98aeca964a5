"""From affinities to labels: spectral clustering of several views at once."""

from __future__ import annotations

from collections.abc import Callable
from numbers import Integral, Real
from typing import Self

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, ClusterMixin, _fit_context
from sklearn.utils import check_random_state
from sklearn.utils._param_validation import Interval
from sklearn.utils.validation import check_is_fitted, check_non_negative

from ._core.graph.clustering import cluster_connected, labels_of_all
from ._core.graph.fusion import bind_fusion, check_fusion
from ._core.graph.kmeans import nearest_centres
from ._core.graph.spectral import ViewGraph, cluster_features, extend_embedding
from ._parallel.engine import thread_map
from ._parallel.threads import single_threaded
from ._utils.validation import (
    N_JOBS,
    check_n_groups,
    forget_fit,
    read_affinities,
    read_matrix,
    split_views,
)

__all__ = ["MultiModelSpectralClustering"]


class AffinityInput:
    """Mixin of the clusterers whose rows are stacked, precomputed affinities.

    They are not tagged as pairwise: scikit-learn then takes a fold's rows *and*
    columns, which is right for one square view and an error for several side by side.
    """

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "labels_")

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()  # type: ignore[misc]
        tags.input_tags.positive_only = True
        return tags


class MultiModelSpectralClustering(AffinityInput, ClusterMixin, BaseEstimator):
    """Spectral clustering of the affinities of several motion models.

    Parameters
    ----------
    n_clusters : int, default=2
        Number of motions.
    fusion : {"kernel_addition", "coreg", "subset"} or callable, \
default="kernel_addition"
        How the views are fused: one embedding of the sum of their Laplacians
        ("kernel_addition"), one embedding per view with a penalty on disagreement
        ("coreg", co-regularisation), or one per view with the constraint that tracks
        joined by a simpler model are joined by a more general one, too ("subset"). A
        callable ``(views, n_clusters) -> embeddings`` takes normalised affinities
        ``(n_views, n, n)`` of the tracks that have an affinity to another, and returns
        one embedding per view, ``(n_views, n, n_clusters)``.
    lam : float, default=1e-2
        Weight of the agreement between the views, for ``fusion="coreg"``.
    gamma : float, default=1e-2
        Weight of the subset constraint, for ``fusion="subset"``.
    max_iter : int, default=20
        Maximum number of iterations over the views.
    tol : float, default=1e-5
        Tolerance for convergence: the change of the objective in an iteration,
        relative to ``n_clusters``.
    n_init : int, default=20
        Number of initialisations of k-means.
    n_jobs : int or None, default=None
        Number of views to decompose in parallel, in threads. ``None`` means 1 unless in
        a :obj:`joblib.parallel_backend` context. ``-1`` means using all processors. See
        :term:`Glossary <n_jobs>` for more details.
    random_state : int, RandomState instance or None, default=None
        Determines the initialisations of k-means.

    Attributes
    ----------
    labels_ : ndarray of int, shape (n,)
        ``0..n_clusters - 1``, the largest motion first; -1 for a track that has no
        affinity to another in any view. Tracks with identical affinities have the same
        label, so there are fewer labels than clusters if fewer tracks differ.
    view_embeddings_ : ndarray of shape (n_views, n, n_clusters)
        Each view's own embedding after fusion; zero rows for tracks labelled -1.
    objective_ : ndarray of shape (``n_iter_ + 1``,)
        The objective for separate views, and after each iteration. If the solution is
        direct, the objective of it alone; empty for a callable.
    n_iter_ : int
        Iterations over the views; 1 if the solution is direct.
    n_views_ : int
    n_features_in_ : int

    See Also
    --------
    NCREModelSelector, EigengapModelSelector, SelfTuningModelSelector : Choose the
        number of clusters.

    Notes
    -----
    The number of views follows from the width of the input; their order is affine,
    homography, fundamental. Tracks without direct or indirect affinity belong to
    separate components of the graph: with as many clusters as components, each
    component is a cluster.

    References
    ----------
    .. [1] X. Xu, L.-F. Cheong and Z. Li, "3D Rigid Motion Segmentation with Mixed and
       Unknown Number of Models", IEEE TPAMI 43(1), 2021, sec. 3.3.
       https://doi.org/10.1109/TPAMI.2019.2929146
    .. [2] A. Kumar, P. Rai and H. Daume, "Co-regularized Multi-view Spectral
       Clustering", NIPS 2011.

    Examples
    --------
    >>> import numpy as np
    >>> from skmotionseg import MultiModelSpectralClustering
    >>> block = np.kron(np.eye(2), np.ones((3, 3)))  # two groups of three
    >>> views = np.hstack([block, block + 0.1])
    >>> clustering = MultiModelSpectralClustering(n_clusters=2, random_state=0)
    >>> clustering.fit_predict(views)
    array([0, 0, 0, 1, 1, 1])
    """

    _parameter_constraints: dict = {
        "n_clusters": [Interval(Integral, 1, None, closed="left")],
        "fusion": [str, callable],
        "lam": [Interval(Real, 0, None, closed="left")],
        "gamma": [Interval(Real, 0, None, closed="left")],
        "max_iter": [Interval(Integral, 1, None, closed="left")],
        "tol": [Interval(Real, 0, None, closed="left")],
        "n_init": [Interval(Integral, 1, None, closed="left")],
        "n_jobs": N_JOBS,
        "random_state": ["random_state"],
    }

    def __init__(
        self,
        n_clusters: int = 2,
        *,
        fusion: str | Callable[..., npt.ArrayLike] = "kernel_addition",
        lam: float = 1e-2,
        gamma: float = 1e-2,
        max_iter: int = 20,
        tol: float = 1e-5,
        n_init: int = 20,
        n_jobs: int | None = None,
        random_state: int | np.random.RandomState | None = None,
    ) -> None:
        self.n_clusters = n_clusters
        self.fusion = fusion
        self.lam = lam
        self.gamma = gamma
        self.max_iter = max_iter
        self.tol = tol
        self.n_init = n_init
        self.n_jobs = n_jobs
        self.random_state = random_state

    @_fit_context(prefer_skip_nested_validation=True)
    @single_threaded
    def fit(self, X: npt.ArrayLike, y: object = None) -> Self:
        """Cluster the rows.

        Parameters
        ----------
        X : array-like of shape (n, n_views * n)
            Symmetric, non-negative affinities of the views, side by side.
        y : ignored

        Returns
        -------
        self

        Raises
        ------
        ValueError
            If ``X`` is not made of such blocks, or fewer than ``n_clusters`` rows have
            an affinity to another.
        """
        check_fusion(self.fusion)
        forget_fit(self)
        views = read_affinities(self, X)
        graph = ViewGraph.from_affinities(
            views, self.n_clusters, thread_map(self.n_jobs)
        )
        check_n_groups("n_clusters", self.n_clusters, graph)
        return self._fit_graph(graph)

    def _fuse(self):
        """The fusion with its weights, as a function of a graph."""
        return bind_fusion(
            self.fusion,
            lam=self.lam,
            gamma=self.gamma,
            max_iter=self.max_iter,
            tol=self.tol,
        )

    def _fit_graph(self, graph):
        """Cluster the tracks that meet another, and put them back in their rows."""
        connected, n = graph.connected, graph.n_samples
        fused, labels, self._centres = cluster_connected(
            graph,
            self.n_clusters,
            self._fuse(),
            self.n_init,
            check_random_state(self.random_state),
        )
        self.labels_ = labels_of_all(graph, labels)
        self._label_of_centre = np.zeros(self.n_clusters, dtype=int)
        self._label_of_centre[labels] = self.labels_[connected]
        self.n_views_ = len(graph.degrees)
        self.view_embeddings_ = np.zeros((self.n_views_, n, self.n_clusters))
        self.view_embeddings_[:, connected] = fused.embeddings
        self.objective_ = fused.objective
        self.n_iter_ = max(1, len(fused.objective) - 1)
        self._degrees = np.zeros((self.n_views_, n))
        self._degrees[:, connected] = graph.degrees
        self._shrinkage = np.sum(
            fused.embeddings * (graph.normalized @ fused.embeddings), axis=1
        )
        return self

    @single_threaded
    def predict(self, X: npt.ArrayLike) -> npt.NDArray[np.intp]:
        """Place rows, fitted or not, in the clusters.

        Parameters
        ----------
        X : array-like of shape (m, n_views * n)
            Affinities of each row to the fitted rows, the views side by side.

        Returns
        -------
        ndarray of int, shape (m,)
            -1 for a row without affinity to any clustered row.
        """
        check_is_fitted(self)
        X = read_matrix(self, X, reset=False, dtype=np.float64)
        check_non_negative(X, f"{type(self).__name__}.predict")
        rows = split_views(X, self.n_views_) * (self._degrees[:, None] > 0)
        features = cluster_features(
            [
                extend_embedding(*view)
                for view in zip(
                    rows,
                    self._degrees,
                    self.view_embeddings_,
                    self._shrinkage,
                    strict=True,
                )
            ]
        )
        labels = self._label_of_centre[nearest_centres(features, self._centres)]
        labels[~(rows > 0).any(axis=(0, 2))] = -1
        return labels
