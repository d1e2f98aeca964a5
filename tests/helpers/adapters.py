"""Estimators that read any matrix as tracks, for scikit-learn's own checks.

Those checks feed matrices of 1 to 10 columns, which are no tracks. Each class here
overrides only the method through which its parent reads input.
"""

from __future__ import annotations

import numpy as np
from sklearn.utils.validation import validate_data

from skmotionseg import (
    EigengapModelSelector,
    HypothesisSampler,
    MotionSegmenter,
    MultiModelSpectralClustering,
    NCREModelSelector,
    PerSequence,
    SelfTuningModelSelector,
)

N_FRAMES = 3


def spread(X):
    """Any matrix as tracks: a row says how its point moves, so blobs are motions.

    Where the point starts is a hash of the row, spread over a square.
    """
    X = np.asarray(X, dtype=float)
    velocity = X[:, [0, min(1, X.shape[1] - 1)]]
    weights = 100 * np.sqrt([[2, 3], [5, 7], [11, 13]])[np.arange(X.shape[1]) % 3]
    # No product of matrices: on some processors, a row of it depends on the others.
    start = 100 * np.sin((X[:, :, None] * weights).sum(axis=1))
    tracks = start[:, None] + np.arange(N_FRAMES)[:, None] * velocity[:, None]
    return tracks.reshape(len(X), -1)


class ReadsAnyMatrix:
    def _read_tracks(self, X, *, reset):
        X = validate_data(
            self, X, reset=reset, dtype=np.float64, ensure_all_finite="allow-nan"
        )
        return spread(X)


class AnySampler(ReadsAnyMatrix, HypothesisSampler):
    pass


class AnySegmenter(ReadsAnyMatrix, MotionSegmenter):
    pass


class OneView:
    """Says that its matrix is a square kernel, which is true of one view."""

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.input_tags.pairwise = True
        return tags


class OneViewClustering(OneView, MultiModelSpectralClustering):
    pass


class OneViewNCRE(OneView, NCREModelSelector):
    pass


class OneViewEigengap(OneView, EigengapModelSelector):
    pass


class OneViewSelfTuning(OneView, SelfTuningModelSelector):
    pass


class AnyPerSequence(PerSequence):
    """Takes each row of a matrix for a short sequence of tracks."""

    def _read_sequences(self, X, *, reset):
        X = validate_data(self, X, reset=reset, dtype=np.float64)
        tracks = np.arange(12)[:, None]
        return [spread(np.sin(tracks + row)) for row in X]

    def _read_labels(self, y, sequences):
        return [np.zeros(len(x), dtype=int) for x in sequences]
