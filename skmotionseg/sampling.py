"""From tracks to residuals: random hypotheses of a motion model in each frame pair."""

from __future__ import annotations

from numbers import Integral
from typing import Self

import numpy as np
import numpy.typing as npt
from sklearn.base import (
    BaseEstimator,
    TransformerMixin,
    _fit_context,
)
from sklearn.utils import check_random_state
from sklearn.utils._param_validation import Interval
from sklearn.utils.validation import _check_feature_names_in, check_is_fitted

from ._core.geometry.hypotheses import draw_hypotheses, residual_blocks, residual_matrix
from ._core.geometry.motion_models import MotionModel, get_motion_model
from ._core.geometry.tracks import frame_pairs, unpack_tracks, working_coordinates
from ._parallel.threads import single_threaded
from ._utils.caching import StateOfCode
from ._utils.residuals import Residuals, column_names
from ._utils.validation import TooFewTracksError, TracksInput, forget_fit

__all__ = ["HypothesisSampler"]


class HypothesisSampler(StateOfCode, TracksInput, TransformerMixin, BaseEstimator):
    """Residuals of tracks to random hypotheses of one motion model.

    In each pair of frames ``(f, f + frame_gap)``, minimal sets of the tracks seen in
    both are drawn at random and a model is fitted to each by the direct linear
    transform. Degenerate sets (such as three collinear points for a homography) are
    drawn again. :meth:`transform` returns the squared Sampson error of each track for
    each hypothesis.

    Parameters
    ----------
    model : {"affine", "homography", "fundamental"} or MotionModel, \
default="homography"
        Motion model. The named ones are fitted to 3, 4 and 8 tracks.
    n_hypotheses : int, default=500
        Hypotheses per frame pair.
    frame_gap : int, default=1
        Distance between the two frames of a pair, in frames.
    random_state : int, RandomState instance or None, default=None
        Determines the minimal sets, which are drawn in :meth:`fit` only.

    Attributes
    ----------
    hypotheses_ : ndarray of shape (n_pairs, n_hypotheses, 3, 3), float64
        Models of pixel coordinates: ``y ~ H x`` for the maps, ``y^T F x = 0`` for
        fundamental matrices, with ``x`` in the first and ``y`` in the second frame.
        NaN for a pair in which fewer tracks are seen than the model needs.
    minimal_sets_ : ndarray of int, shape (n_pairs, n_hypotheses, minimal_size)
        The tracks that each was fitted to; -1 where there is no model. Where the tracks
        of a pair allow nothing but translations, each is that of a single track, which
        is repeated.
    frame_pairs_ : ndarray of int, shape (n_pairs, 2)
    n_features_in_ : int
        Two columns per frame.

    See Also
    --------
    ORKKernel : Computes affinities from the residuals.

    References
    ----------
    .. [1] X. Xu, L.-F. Cheong and Z. Li, "3D Rigid Motion Segmentation with Mixed and
       Unknown Number of Models", IEEE TPAMI 43(1), 2021, sec. 3.1.
       https://doi.org/10.1109/TPAMI.2019.2929146
    .. [2] R. Hartley and A. Zisserman, "Multiple View Geometry", 2nd ed., 2004, ch. 4
       and 11.
       https://doi.org/10.1017/CBO9780511811685

    Examples
    --------
    >>> from skmotionseg import HypothesisSampler
    >>> from skmotionseg.datasets import make_rigid_motions
    >>> X, y = make_rigid_motions(n_tracks=60, n_frames=5, random_state=0)
    >>> sampler = HypothesisSampler("homography", n_hypotheses=100, random_state=0)
    >>> sampler.fit_transform(X).shape  # 4 frame pairs of 100 hypotheses
    (60, 400)
    """

    _parameter_constraints: dict = {
        "model": [str, MotionModel],
        "n_hypotheses": [Interval(Integral, 1, None, closed="left")],
        "frame_gap": [Interval(Integral, 1, None, closed="left")],
        "random_state": ["random_state"],
    }

    def __init__(
        self,
        model: str | MotionModel = "homography",
        *,
        n_hypotheses: int = 500,
        frame_gap: int = 1,
        random_state: int | np.random.RandomState | None = None,
    ) -> None:
        self.model = model
        self.n_hypotheses = n_hypotheses
        self.frame_gap = frame_gap
        self.random_state = random_state

    @_fit_context(prefer_skip_nested_validation=True)
    @single_threaded
    def fit(self, X: npt.ArrayLike, y: object = None) -> Self:
        """Draw the hypotheses.

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
            If there are too few frames for ``frame_gap``, or no frame pair in which
            as many tracks are seen as the model needs.
        """
        forget_fit(self)
        return self._fit(*unpack_tracks(self._read_tracks(X, reset=True)))

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "hypotheses_")

    def _fit(self, points, visibility, pairs=None):
        """Draw hypotheses for tracks that were read, in those pairs if given."""
        model = get_motion_model(self.model)
        pairs = self._check_pairs(model, visibility, pairs)
        self.frame_pairs_ = pairs
        self.hypotheses_, self.minimal_sets_ = draw_hypotheses(
            points,
            visibility,
            pairs,
            model,
            self.n_hypotheses,
            check_random_state(self.random_state),
        )
        self._model = model
        self._centres, self._scale = working_coordinates(points, visibility)
        return self

    def _check_pairs(self, model, visibility, pairs):
        """Frame pairs, of which one sees as many tracks as the model needs."""
        n_tracks, n_frames = visibility.shape
        if n_frames <= self.frame_gap:
            raise ValueError(
                f"frame_gap={self.frame_gap} needs at least {self.frame_gap + 1} "
                f"frames; got {n_frames}"
            )
        if pairs is None:
            pairs = frame_pairs(n_frames, self.frame_gap)
        most = visibility[:, pairs].all(axis=2).sum(axis=0).max()
        if most < model.minimal_size:
            raise TooFewTracksError(
                f"the {model.name} model needs {model.minimal_size} tracks that are "
                f"seen in the same two frames; the best frame pair has {most} "
                f"(n_samples={n_tracks})"
            )
        return pairs

    def get_feature_names_out(
        self, input_features: npt.ArrayLike | None = None
    ) -> npt.NDArray[np.object_]:
        """Names of the residual columns, such as ``pair0_hypothesis3``.

        Parameters
        ----------
        input_features : array-like of str or None, default=None
            Checked against the names of the columns in ``fit``, and not used.

        Returns
        -------
        ndarray of str, shape (n_pairs * n_hypotheses,)
        """
        check_is_fitted(self)
        _check_feature_names_in(self, input_features, generate_names=False)
        n_pairs, n_hypotheses = self.hypotheses_.shape[:2]
        return column_names(n_pairs, n_hypotheses)

    @_fit_context(prefer_skip_nested_validation=True)
    @single_threaded
    def fit_transform(
        self, X: npt.ArrayLike, y: object = None
    ) -> npt.NDArray[np.float32]:
        """Draw the hypotheses and give the residuals of the same tracks.

        Parameters
        ----------
        X : array-like of shape (n_tracks, 2 * n_frames)
        y : ignored

        Returns
        -------
        ndarray of shape (n_tracks, n_pairs * n_hypotheses), float32
            As :meth:`transform` gives them.
        """
        forget_fit(self)
        points, visibility = unpack_tracks(self._read_tracks(X, reset=True))
        return self._fit(points, visibility)._residuals(points, visibility)

    @single_threaded
    def transform(self, X: npt.ArrayLike) -> npt.NDArray[np.float32]:
        """Residuals of tracks, these or others of the same video.

        Parameters
        ----------
        X : array-like of shape (n_tracks, 2 * n_frames)

        Returns
        -------
        ndarray of shape (n_tracks, n_pairs * n_hypotheses), float32
            Squared Sampson errors in squared pixels, pair-major: the columns of the
            first frame pair, then those of the second. NaN where the track is unseen
            in the pair. The number of hypotheses per pair travels with them, for
            :class:`ORKKernel`.
        """
        check_is_fitted(self)
        return self._residuals(*unpack_tracks(self._read_tracks(X, reset=False)))

    def _residuals(self, points, visibility):
        matrix = residual_matrix(points, visibility, *self._residual_arguments)
        return Residuals.of_groups(matrix, self.hypotheses_.shape[1])

    def _blocks(self, points, visibility, chosen=slice(None)):
        """What ``transform`` gives, a frame pair at a time, of all or some."""
        pairs, hypotheses, *others = self._residual_arguments
        return residual_blocks(
            points, visibility, pairs[chosen], hypotheses[chosen], *others
        )

    @property
    def _residual_arguments(self):
        return (
            self.frame_pairs_,
            self.hypotheses_,
            self._model,
            self._centres,
            self._scale,
        )

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.transformer_tags.preserves_dtype = ["float32"]
        return tags
