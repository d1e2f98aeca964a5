"""Rules that select the number of motions."""

from __future__ import annotations

from collections.abc import Callable
from numbers import Integral, Real
from typing import Self, TypeAlias

import numpy as np
import numpy.typing as npt
from sklearn.base import BaseEstimator, ClusterMixin, _fit_context, clone
from sklearn.utils import check_random_state
from sklearn.utils._param_validation import HasMethods, Interval, StrOptions
from sklearn.utils.metaestimators import available_if
from sklearn.utils.validation import check_is_fitted

from ._core.graph.cuts import partition_costs
from ._core.graph.eigenvector_rules import (
    ALIGNMENT_TOLERANCE,
    alignment_costs,
    best_aligned,
    eigengap_costs,
)
from ._core.graph.spectral import ViewGraph
from ._core.labels import canonical_labels
from ._parallel.engine import thread_map
from ._parallel.threads import single_threaded
from ._utils.validation import (
    check_estimator_parameters,
    check_n_groups,
    forget_fit,
    read_affinities,
    read_matrix,
    split_views,
)
from .cluster import AffinityInput, MultiModelSpectralClustering

__all__ = ["EigengapModelSelector", "NCREModelSelector", "SelfTuningModelSelector"]

Fusing: TypeAlias = str | Callable[..., npt.ArrayLike]


def _clusterer_predicts(selector):
    return selector.clusterer is None or hasattr(selector.clusterer, "predict")


def _labels_of_connected(labels, connected):
    """Labels in canonical order, -1 for rows without affinity to another."""
    kept = np.full(len(labels), -1)
    kept[connected] = labels[connected]
    return canonical_labels(kept)


class CountSelector(AffinityInput, ClusterMixin, BaseEstimator):
    """Cluster into each of several counts and choose one by a rule.

    A rule gives three costs per count (:meth:`_costs_of_counts`): two terms and the
    total that decides, the least unless :meth:`_choose` says otherwise. It also says
    what its terms are called and how they are weighed, for reports and pictures.
    """

    _parameter_constraints: dict = {
        "clusterer": [HasMethods(["fit", "get_params", "set_params"]), None],
        "n_clusters": [
            Interval(Integral, 1, None, closed="left"),
            StrOptions({"auto"}),
        ],
        "fusion": [str, callable, None],
        "lam": [Interval(Real, 0, None, closed="left"), None],
        "gamma": [Interval(Real, 0, None, closed="left"), None],
        "min_clusters": [Interval(Integral, 1, None, closed="left")],
        "max_clusters": [Interval(Integral, 1, None, closed="left")],
        "random_state": ["random_state"],
    }

    # Eigenvectors that the rule needs beyond those of the largest count.
    _n_more_eigenvectors = 0
    # What the two terms are called, their weights, and by how much equal totals differ.
    _cost_names = ("first term", "second term")
    _cost_tolerance = 1e-9

    def __init__(
        self,
        clusterer: BaseEstimator | None = None,
        *,
        n_clusters: int | str = "auto",
        fusion: Fusing | None = None,
        lam: float | None = None,
        gamma: float | None = None,
        min_clusters: int = 1,
        max_clusters: int = 10,
        random_state: int | np.random.RandomState | None = None,
    ) -> None:
        self.clusterer = clusterer
        self.n_clusters = n_clusters
        self.fusion = fusion
        self.lam = lam
        self.gamma = gamma
        self.min_clusters = min_clusters
        self.max_clusters = max_clusters
        self.random_state = random_state

    @_fit_context(prefer_skip_nested_validation=True)
    @single_threaded
    def fit(self, X: npt.ArrayLike, y: object = None) -> Self:
        """Cluster the rows into each count and choose one.

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
            If ``X`` is not made of such blocks, or ``min_clusters`` exceeds
            ``max_clusters`` or the rows that have an affinity to another.
        """
        check_estimator_parameters(self.clusterer)
        fewest, most = self._range_of_counts()
        forget_fit(self)
        views = read_affinities(self, X)
        graph = ViewGraph.from_affinities(
            views,
            most + self._n_more_eigenvectors,
            thread_map(getattr(self.clusterer, "n_jobs", None)),
        )
        known = self.n_clusters != "auto"
        check_n_groups("n_clusters" if known else "min_clusters", fewest, graph)
        self.counts_ = self._open_counts(fewest, min(most, len(graph.connected)))
        candidates = self._fit_candidates(views, graph)
        self.candidate_labels_ = np.stack(
            [_labels_of_connected(c.labels_, graph.connected) for c in candidates]
        )
        self.costs_ = self._costs_of_counts(views, graph)
        self.best_index_ = self._choose(self.costs_[:, 2])
        self.clusterer_ = candidates[self.best_index_]
        self.labels_ = self.candidate_labels_[self.best_index_]
        self.n_clusters_ = int(self.labels_.max()) + 1
        self.cost_names_, self.cost_weights_ = self._cost_names, self._cost_weights
        self.cost_tolerance_ = self._cost_tolerance
        return self

    @property
    def _cost_weights(self):
        return (1, -1)

    def _range_of_counts(self):
        """The fewest and the most clusters that are asked for."""
        if self.n_clusters != "auto":
            return self.n_clusters, self.n_clusters
        if self.min_clusters > self.max_clusters:
            raise ValueError(
                "min_clusters must not exceed max_clusters; got "
                f"{self.min_clusters} and {self.max_clusters}"
            )
        return self.min_clusters, self.max_clusters

    def _open_counts(self, fewest, most):
        """Counts to try, ``most`` being the largest that is possible."""
        return np.arange(fewest, most + 1)

    def _costs_of_counts(self, views, graph):
        """Two terms and the total for each of ``counts_``."""
        raise NotImplementedError

    def _choose(self, totals):
        """Position of the count to take; of equal costs, the smallest."""
        return int(np.argmax(totals <= totals.min() + self._cost_tolerance))

    def _fit_candidates(self, views, graph):
        """A fitted clusterer for each count; ours share the graph's eigenvectors."""
        base = self._base_clusterer()
        candidates = [
            clone(base).set_params(n_clusters=int(count)) for count in self.counts_
        ]
        if isinstance(base, MultiModelSpectralClustering):
            base._validate_params()
            for candidate in candidates:
                candidate.n_features_in_ = self.n_features_in_
                candidate._fit_graph(graph)
            return candidates
        stacked = np.hstack(views)
        return [candidate.fit(stacked) for candidate in candidates]

    def _base_clusterer(self):
        """The clusterer with what is set here, and seeded if it has no seed."""
        if self.clusterer is None:
            base = MultiModelSpectralClustering()
        else:
            base = clone(self.clusterer)
        given = {"fusion": self.fusion, "lam": self.lam, "gamma": self.gamma}
        base.set_params(**{k: value for k, value in given.items() if value is not None})
        if base.get_params().get("random_state", 0) is None:
            seed = check_random_state(self.random_state).randint(np.iinfo(np.int32).max)
            base.set_params(random_state=seed)
        return base

    @available_if(_clusterer_predicts)
    def predict(self, X: npt.ArrayLike) -> npt.NDArray[np.intp]:
        """Place rows, fitted or not, in the chosen clusters.

        Available if the clusterer has it.

        Parameters
        ----------
        X : array-like of shape (m, n_views * n)
            Affinities of each row to the fitted rows, the views side by side.

        Returns
        -------
        ndarray of int, shape (m,)
            -1 for rows without affinity to any row that is in a cluster.
        """
        check_is_fitted(self)
        # The clusterer was fitted to views that had no names of columns.
        rows = read_matrix(self, X, reset=False, dtype=np.float64)
        labels = self.clusterer_.predict(rows)
        # The clusterer's own numbers of the groups, as ours.
        known = self.labels_ >= 0
        ours = dict(
            zip(self.clusterer_.labels_[known], self.labels_[known], strict=True)
        )
        placed = np.array([ours.get(label, -1) for label in labels], dtype=int)
        views = split_views(rows, rows.shape[1] // len(known))
        linked = (views[..., known] > 0).any(axis=(0, 2))
        return np.where(linked, placed, -1)


class NCREModelSelector(CountSelector):
    """Choose the number of clusters by normalised cut and reconstruction error.

    The affinities are clustered into each count of groups. The cost of a partition is
    ``Ncut + delta * reconstruction``, summed over the views: the normalised cut
    increases with the number of groups, and the reconstruction error is high if groups
    without affinity to each other are merged. The count of lowest cost is chosen; of
    equal costs, the smallest count.

    Parameters
    ----------
    clusterer : estimator, default=None
        Estimator that clusters stacked affinities into ``n_clusters`` groups and sets
        ``labels_``. ``None`` means :class:`MultiModelSpectralClustering` with default
        parameters. An estimator that does not accept several views side by side can
        only be used with a single view.
    n_clusters : int or "auto", default="auto"
        Number of clusters, if it is known; "auto" selects it.
    fusion, lam, gamma : default=None
        If given, set on the clusterer (see :class:`MultiModelSpectralClustering`).
    delta : float, default=0.2
        Weight of the reconstruction error: larger values choose more clusters.
    min_clusters, max_clusters : int, default=1 and 10
        Range of counts to try, limited to the number of rows with an affinity to
        another row.
    random_state : int, RandomState instance or None, default=None
        Seed of the clusterer, the same for each count. The clusterer's own
        ``random_state`` takes precedence if it is set.

    Attributes
    ----------
    n_clusters_ : int
    labels_ : ndarray of int, shape (n,)
        Those of the chosen count.
    counts_ : ndarray of int, shape (n_counts,)
        The counts that were tried. Where fewer rows differ than clusters are asked for,
        there are fewer clusters, and ``n_clusters_`` is less than the count.
    costs_ : ndarray of shape (n_counts, 3)
        Normalised cut, reconstruction error and total, for each count.
    candidate_labels_ : ndarray of int, shape (n_counts, n)
        The partition of each count.
    best_index_ : int
        Index of the chosen count.
    clusterer_ : estimator
        The one fitted with the chosen count.
    cost_names_ : (str, str)
        Names of the two terms of the costs.
    cost_weights_ : (float, float)
        Their weights in the total.
    cost_tolerance_ : float
        Totals that differ by no more are considered equal.
    n_features_in_ : int

    See Also
    --------
    EigengapModelSelector, SelfTuningModelSelector : Other rules.

    References
    ----------
    .. [1] X. Xu, L.-F. Cheong and Z. Li, "3D Rigid Motion Segmentation with Mixed and
       Unknown Number of Models", IEEE TPAMI 43(1), 2021, sec. 4, eq. 13. The
       normalised cut is the first line of its eq. 11, ``sum_m cut(A_m) /
       vol(A_m)``.
       https://doi.org/10.1109/TPAMI.2019.2929146

    Examples
    --------
    >>> import numpy as np
    >>> from skmotionseg import NCREModelSelector
    >>> block = np.kron(np.eye(3), np.ones((4, 4)))  # three groups of four
    >>> selector = NCREModelSelector(random_state=0).fit(np.hstack([block, block]))
    >>> selector.n_clusters_
    3
    """

    _parameter_constraints: dict = {
        **CountSelector._parameter_constraints,
        "delta": [Interval(Real, 0, None, closed="left")],
    }

    _cost_names = ("normalised cut", "reconstruction error")

    def __init__(
        self,
        clusterer: BaseEstimator | None = None,
        *,
        n_clusters: int | str = "auto",
        fusion: Fusing | None = None,
        lam: float | None = None,
        gamma: float | None = None,
        delta: float = 0.2,
        min_clusters: int = 1,
        max_clusters: int = 10,
        random_state: int | np.random.RandomState | None = None,
    ) -> None:
        super().__init__(
            clusterer,
            n_clusters=n_clusters,
            fusion=fusion,
            lam=lam,
            gamma=gamma,
            min_clusters=min_clusters,
            max_clusters=max_clusters,
            random_state=random_state,
        )
        self.delta = delta

    @property
    def _cost_weights(self):
        return (1, self.delta)

    def _costs_of_counts(self, views, graph):
        return np.stack(
            [partition_costs(views, y, self.delta) for y in self.candidate_labels_]
        )


class EigengapModelSelector(CountSelector):
    """Choose the number of clusters by the largest gap between eigenvalues.

    If there is no affinity between groups, the normalised Laplacian has the eigenvalue
    0 once per group; if there is little, it has as many small eigenvalues, followed by
    a gap. The count before the largest gap is chosen; of equal gaps, the smallest
    count. Several views are combined into the mean of their Laplacians, as by kernel
    addition, whatever the fusion of the clusterer.

    Parameters
    ----------
    clusterer : estimator, default=None
        Estimator that clusters stacked affinities into ``n_clusters`` groups and sets
        ``labels_``; the choice does not depend on it. ``None`` means
        :class:`MultiModelSpectralClustering` with default parameters.
    n_clusters : int or "auto", default="auto"
        Number of clusters, if it is known; "auto" selects it.
    fusion, lam, gamma : default=None
        If given, set on the clusterer (see :class:`MultiModelSpectralClustering`).
    min_clusters, max_clusters : int, default=1 and 10
        Range of counts to try, limited to the number of rows with an affinity to
        another row.
    random_state : int, RandomState instance or None, default=None
        Seed of the clusterer, the same for each count. The clusterer's own
        ``random_state`` takes precedence if it is set.

    Attributes
    ----------
    n_clusters_ : int
    labels_ : ndarray of int, shape (n,)
        Those of the chosen count.
    counts_ : ndarray of int, shape (n_counts,)
        The counts that were tried. Where fewer rows differ than clusters are asked for,
        there are fewer clusters, and ``n_clusters_`` is less than the count.
    costs_ : ndarray of shape (n_counts, 3)
        For each count k, the k-th eigenvalue, the next one (the same one if there is
        none), and their difference.
    candidate_labels_ : ndarray of int, shape (n_counts, n)
        The partition of each count.
    best_index_ : int
        Index of the chosen count.
    clusterer_ : estimator
        The one fitted with the chosen count.
    cost_names_ : (str, str)
        Names of the two terms of the costs.
    cost_weights_ : (float, float)
        Their weights in the total.
    cost_tolerance_ : float
        Totals that differ by no more are considered equal.
    n_features_in_ : int

    See Also
    --------
    NCREModelSelector, SelfTuningModelSelector : Other rules.

    References
    ----------
    .. [1] U. von Luxburg, "A Tutorial on Spectral Clustering", Statistics and Computing
       17(4), 2007, sec. 8.3.
       https://doi.org/10.1007/s11222-007-9033-z

    Examples
    --------
    >>> import numpy as np
    >>> from skmotionseg import EigengapModelSelector
    >>> block = np.kron(np.eye(3), np.ones((4, 4))) + 0.1  # three groups of four
    >>> selector = EigengapModelSelector(max_clusters=5, random_state=0).fit(block)
    >>> selector.n_clusters_
    3
    >>> selector.costs_[2].round(2)  # the third eigenvalue, the fourth, the gap
    array([ 0.23,  1.  , -0.77])
    """

    _n_more_eigenvectors = 1
    _cost_names = ("eigenvalue", "next eigenvalue")

    def _costs_of_counts(self, views, graph):
        values, _ = graph.sum_spectrum
        return eigengap_costs(1 - values / len(views), self.counts_)


class SelfTuningModelSelector(CountSelector):
    """Choose the number of clusters by how well eigenvectors align with the axes.

    If there is no affinity between groups, the leading eigenvectors, one per group, can
    be rotated so that each row has a single nonzero entry. The best rotation is
    computed for each count, and the largest count is chosen whose cost is within a
    thousandth of the lowest. Several views are combined into the sum of their
    Laplacians, as by kernel addition, whatever the fusion of the clusterer.

    Parameters
    ----------
    clusterer : estimator, default=None
        Estimator that clusters stacked affinities into ``n_clusters`` groups and sets
        ``labels_``; the choice does not depend on it. ``None`` means
        :class:`MultiModelSpectralClustering` with default parameters.
    n_clusters : int or "auto", default="auto"
        Number of clusters, if it is known; "auto" selects it.
    fusion, lam, gamma : default=None
        If given, set on the clusterer (see :class:`MultiModelSpectralClustering`).
    min_clusters, max_clusters : int, default=2 and 10
        Range of counts to try, limited to the number of rows with an affinity to
        another row. A single eigenvector is always aligned, so 1 is only tried if it is
        the only count.
    random_state : int, RandomState instance or None, default=None
        Seed of the clusterer, the same for each count. The clusterer's own
        ``random_state`` takes precedence if it is set.

    Attributes
    ----------
    n_clusters_ : int
    labels_ : ndarray of int, shape (n,)
        Those of the chosen count.
    counts_ : ndarray of int, shape (n_counts,)
        The counts that were tried. Where fewer rows differ than clusters are asked for,
        there are fewer clusters, and ``n_clusters_`` is less than the count.
    costs_ : ndarray of shape (n_counts, 3)
        For each count C, with ``Z`` the n rotated rows,
        ``sum_ij Z_ij^2 / max_j Z_ij^2 / (n C)``, its least value ``1 / C``, and the
        first less the second.
    candidate_labels_ : ndarray of int, shape (n_counts, n)
        The partition of each count.
    best_index_ : int
        Index of the chosen count.
    clusterer_ : estimator
        The one fitted with the chosen count.
    cost_names_ : (str, str)
        Names of the two terms of the costs.
    cost_weights_ : (float, float)
        Their weights in the total.
    cost_tolerance_ : float
        Totals that differ by no more are considered equal.
    n_features_in_ : int

    See Also
    --------
    NCREModelSelector, EigengapModelSelector : Other rules.

    Notes
    -----
    This is how self-tuning spectral clustering selects the number of groups. Its local
    scaling of distances is not used, because affinities are given.

    References
    ----------
    .. [1] L. Zelnik-Manor and P. Perona, "Self-Tuning Spectral Clustering", NIPS 2004,
       sec. 3.

    Examples
    --------
    >>> import numpy as np
    >>> from skmotionseg import SelfTuningModelSelector
    >>> block = np.kron(np.eye(3), np.ones((4, 4))) + 0.1  # three groups of four
    >>> selector = SelfTuningModelSelector(max_clusters=5, random_state=0).fit(block)
    >>> selector.n_clusters_
    3
    """

    _cost_names = ("alignment cost", "its least value")
    _cost_tolerance = ALIGNMENT_TOLERANCE

    def __init__(
        self,
        clusterer: BaseEstimator | None = None,
        *,
        n_clusters: int | str = "auto",
        fusion: Fusing | None = None,
        lam: float | None = None,
        gamma: float | None = None,
        min_clusters: int = 2,
        max_clusters: int = 10,
        random_state: int | np.random.RandomState | None = None,
    ) -> None:
        super().__init__(
            clusterer,
            n_clusters=n_clusters,
            fusion=fusion,
            lam=lam,
            gamma=gamma,
            min_clusters=min_clusters,
            max_clusters=max_clusters,
            random_state=random_state,
        )

    def _open_counts(self, fewest, most):
        return np.arange(min(max(fewest, 2), most), most + 1)

    def _costs_of_counts(self, views, graph):
        _, vectors = graph.sum_spectrum
        return alignment_costs(vectors, self.counts_)

    def _choose(self, totals):
        return best_aligned(totals)
