"""From residuals to affinities: the ordered residual kernel."""

from __future__ import annotations

from numbers import Integral, Real
from typing import Self

import numpy as np
import numpy.typing as npt
from sklearn.base import (
    BaseEstimator,
    ClassNamePrefixFeaturesOutMixin,
    TransformerMixin,
    _fit_context,
)
from sklearn.utils._param_validation import Interval, StrOptions
from sklearn.utils.validation import check_is_fitted

from ._core.graph.neighbourhood import neighbourhood_thresholds, sparsify
from ._core.graph.residual_kernel import (
    Preferences,
    blocks_of_matrix,
    co_occurrence,
    common_pairs,
    covisible_affinity,
    own_affinity,
)
from ._parallel.threads import single_threaded
from ._utils.caching import StateOfCode
from ._utils.residuals import sent_group_size
from ._utils.validation import forget_fit, read_matrix

__all__ = ["ORKKernel"]

# Of residuals that do not say how many hypotheses each frame pair has.
USUAL_HYPOTHESES = 500
# One exponent of the epsilon-neighbourhood for all data.
GRAPH_SPARSITY = 6.0


class ORKKernel(
    StateOfCode, ClassNamePrefixFeaturesOutMixin, TransformerMixin, BaseEstimator
):
    """Ordered residual kernel: affinities of tracks that prefer the same hypotheses.

    Within each frame pair, a track keeps the share ``top`` of the hypotheses with the
    lowest residuals. The affinity of two tracks is the number of hypotheses that both
    keep, summed over the pairs and divided by its maximum (see ``covisibility_prior``).
    Affinities are sparsified by the epsilon-neighbourhood (see ``sparsity``). Like
    :class:`~sklearn.kernel_approximation.Nystroem`, it computes affinities of any rows
    to the fitted rows.

    Parameters
    ----------
    n_hypotheses : int or "auto", default="auto"
        Hypotheses per frame pair, which is the size of the consecutive groups of
        columns. "auto" is the number that :class:`HypothesisSampler` attaches to its
        residuals, and 500 for residuals without it.
    top : float, default=0.1
        Share of a pair's hypotheses that a track keeps, in (0, 1]; at least one.
    sparsity : float, "auto" or None, default="auto"
        Exponent alpha of the epsilon-neighbourhood; the larger, the fewer entries of a
        row are kept. "auto" is 6 (4 and 8 in :class:`MotionSegmenter`, whose search by
        description length compares both). None keeps all entries.
    covisibility_prior : float, default=2
        ``p`` in ``k_ij / (top * n_hypotheses * (c_ij + p))``, where ``c_ij`` is the
        number of frame pairs in which both tracks are seen. It reduces affinities of
        tracks with few common frames. 0 divides by the common frame pairs alone, as the
        paper does.

    Attributes
    ----------
    n_hypotheses_ : int
        Hypotheses per frame pair.
    thresholds_ : ndarray of shape (n_fit,)
        The affinity above which each fitted row keeps an entry.
    n_features_in_ : int

    See Also
    --------
    HypothesisSampler : Computes the residuals.
    MultiModelSpectralClustering : Clusters the affinities of one or several kernels.

    Notes
    -----
    A track that shares no frame pair with another has affinity 0 to it; one that is
    seen in no pair has affinity 0 to all, itself included.

    References
    ----------
    .. [1] T.-J. Chin, H. Wang and D. Suter, "The ordered residual kernel for robust
       motion subspace clustering", NIPS 2009.
    .. [2] T. Lai, H. Wang, Y. Yan, T.-J. Chin and W.-L. Zhao, "Motion Segmentation Via
       a Sparsity Constraint", IEEE T-ITS 18(4), 2017.
    .. [3] X. Xu, L.-F. Cheong and Z. Li, "3D Rigid Motion Segmentation with Mixed and
       Unknown Number of Models", IEEE TPAMI 43(1), 2021, sec. 3.2.
       https://doi.org/10.1109/TPAMI.2019.2929146

    Examples
    --------
    >>> from sklearn.pipeline import make_pipeline
    >>> from skmotionseg import HypothesisSampler, ORKKernel
    >>> from skmotionseg.datasets import make_rigid_motions
    >>> X, y = make_rigid_motions(n_tracks=60, n_frames=5, random_state=0)
    >>> affinity = make_pipeline(
    ...     HypothesisSampler(n_hypotheses=100, random_state=0),
    ...     ORKKernel(),
    ... )
    >>> K = affinity.fit_transform(X)
    >>> K.shape
    (60, 60)
    >>> bool(K[y == 0][:, y == 0].mean() > 3 * K[y == 0][:, y != 0].mean())
    True
    """

    _parameter_constraints: dict = {
        "n_hypotheses": [
            Interval(Integral, 1, None, closed="left"),
            StrOptions({"auto"}),
        ],
        "top": [Interval(Real, 0, 1, closed="right")],
        "sparsity": [
            Interval(Real, 0, None, closed="neither"),
            StrOptions({"auto"}),
            None,
        ],
        "covisibility_prior": [Interval(Real, 0, None, closed="left")],
    }

    def __init__(
        self,
        *,
        n_hypotheses: int | str = "auto",
        top: float = 0.1,
        sparsity: float | str | None = "auto",
        covisibility_prior: float = 2.0,
    ) -> None:
        self.n_hypotheses = n_hypotheses
        self.top = top
        self.sparsity = sparsity
        self.covisibility_prior = covisibility_prior

    @_fit_context(prefer_skip_nested_validation=True)
    @single_threaded
    def fit(self, X: npt.ArrayLike, y: object = None) -> Self:
        """Remember which hypotheses each track prefers.

        Parameters
        ----------
        X : array-like of shape (n_fit, n_pairs * n_hypotheses)
            Residuals, pair-major; NaN where a track is unseen in a pair.
        y : ignored

        Returns
        -------
        self

        Raises
        ------
        ValueError
            If the columns do not split into groups of ``n_hypotheses``, or the sampler
            drew another number.
        """
        self._fit_affinity(self._read_preferences(X, reset=True))
        return self

    @_fit_context(prefer_skip_nested_validation=True)
    @single_threaded
    def fit_transform(
        self, X: npt.ArrayLike, y: object = None
    ) -> npt.NDArray[np.float32]:
        """Fit, and give the affinities of the fitted rows to one another.

        Parameters
        ----------
        X : array-like of shape (n_fit, n_pairs * n_hypotheses)
        y : ignored

        Returns
        -------
        ndarray of shape (n_fit, n_fit), float32
            Symmetric, in [0, 1].
        """
        return self._fit_affinity(self._read_preferences(X, reset=True))

    @single_threaded
    def transform(self, X: npt.ArrayLike) -> npt.NDArray[np.float32]:
        """Affinities of rows to the fitted rows.

        Parameters
        ----------
        X : array-like of shape (n, n_pairs * n_hypotheses)
            Residuals to the same hypotheses as in :meth:`fit`.

        Returns
        -------
        ndarray of shape (n, n_fit), float32
            In [0, 1]. The fitted rows give what :meth:`fit_transform` gave.
        """
        check_is_fitted(self)
        preferences = self._read_preferences(X, reset=False)
        return self._affinity_to_fitted(preferences, self._preferences)

    @single_threaded
    def _fit_blocks(self, n_tracks, blocks, n_hypotheses):
        """What ``fit_transform`` does, from a frame pair's residuals at a time."""
        self._take_parameters(self._group_size(n_hypotheses, n_hypotheses))
        preferences = Preferences.from_blocks(n_tracks, blocks, self._n_top)
        self.n_features_in_ = len(preferences.rows) * n_hypotheses
        return self._fit_affinity(preferences)

    @single_threaded
    def _transform_blocks(self, n_tracks, blocks, pairs):
        """What ``transform`` does, from residuals of some of the frame pairs."""
        preferences = Preferences.from_blocks(n_tracks, blocks, self._n_top)
        fitted = self._preferences.of_pairs(pairs)
        return self._affinity_to_fitted(preferences, fitted)

    def _spread_pairs(self, n_pairs):
        """Positions of frame pairs: all, or every so many of those that see something.

        So many that half of the fitted rows are seen in about ``n_pairs`` of them, or
        up to twice as many.
        """
        fitted = self._preferences
        every = int(np.median(fitted.seen.sum(axis=1)) // n_pairs)
        if every < 2:
            return np.arange(len(fitted.rows))
        return np.flatnonzero(fitted.seen.any(axis=0))[::every]

    def _fit_affinity(self, preferences):
        self._preferences = preferences
        affinity = self._affinity(preferences, preferences)
        self.thresholds_ = self._thresholds(affinity, preferences)
        return self._sparsify(affinity, self.thresholds_)

    @single_threaded
    def _fitted_affinity(self):
        """What ``fit_transform`` gave."""
        return self._affinity_to_fitted(self._preferences, self._preferences)

    def _affinity_to_fitted(self, preferences, fitted):
        affinity = self._affinity(preferences, fitted)
        return self._sparsify(affinity, self._thresholds(affinity, preferences))

    @property
    def _n_features_out(self):
        return self._preferences.n_tracks

    def _take_parameters(self, n_hypotheses):
        """Keep what a fit goes by: other rows are compared with its rows alike."""
        self.n_hypotheses_ = n_hypotheses
        self._n_top = max(1, round(self.top * n_hypotheses))
        self._prior = self.covisibility_prior
        self._alpha = GRAPH_SPARSITY if self.sparsity == "auto" else self.sparsity

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "thresholds_")

    def _read_preferences(self, X, *, reset):
        if reset:
            forget_fit(self, ["_preferences"])
        sent = sent_group_size(X)
        X = read_matrix(
            self,
            X,
            reset=reset,
            dtype=[np.float32, np.float64],
            ensure_all_finite="allow-nan",
        )
        if reset:
            self._take_parameters(self._group_size(sent, X.shape[1]))
        elif sent not in (None, self.n_hypotheses_):
            raise ValueError(
                f"the kernel was fitted to {self.n_hypotheses_} hypotheses per frame "
                f"pair; got residuals of {sent}"
            )
        blocks = blocks_of_matrix(X, self.n_hypotheses_)
        return Preferences.from_blocks(len(X), blocks, self._n_top)

    def _group_size(self, sent, width):
        """Columns per frame pair, of what was asked for and what was sent."""
        asked = None if self.n_hypotheses == "auto" else self.n_hypotheses
        if asked is not None and sent is not None and asked != sent:
            raise ValueError(
                f"the sampler drew {sent} hypotheses per frame pair, and the kernel "
                f"has n_hypotheses={asked}; 'auto' takes the number of the sampler"
            )
        size = asked or sent or USUAL_HYPOTHESES
        if width % size:
            raise ValueError(
                "residual columns come in groups of n_hypotheses="
                f"{size}, one per frame pair; got {width} columns"
            )
        return size

    def _affinity(self, preferences, others):
        return covisible_affinity(
            co_occurrence(preferences, others),
            common_pairs(preferences, others),
            self._n_top,
            self._prior,
        )

    def _thresholds(self, affinity, preferences):
        if self._alpha is None:
            return np.zeros(len(affinity))
        own = own_affinity(preferences.seen.sum(axis=1), self._prior)
        return neighbourhood_thresholds(affinity, self._alpha, own)

    def _sparsify(self, affinity, thresholds):
        if self._alpha is None:
            return affinity
        return sparsify(affinity, thresholds, self.thresholds_)

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.input_tags.allow_nan = True
        tags.transformer_tags.preserves_dtype = ["float32"]
        return tags
