"""Models of minimal sets that are given, where the package draws them."""

from __future__ import annotations

import numpy as np

from skmotionseg._core.geometry.hypotheses import _NormalizedPairs


def fit_minimal_sets(points, visibility, pairs, model, sets):
    """Fit a motion model to minimal sets that are given.

    Parameters
    ----------
    points : ndarray of shape (n_tracks, n_frames, 2)
    visibility : ndarray of bool, shape (n_tracks, n_frames)
    pairs : ndarray of int, shape (n_pairs, 2)
    model : MotionModel
    sets : ndarray of int, shape (n_pairs, n_sets, model.minimal_size)
        Positions of tracks that are seen in the pair.

    Returns
    -------
    ndarray of shape (n_pairs, n_sets, 3, 3), float64
        Models of pixel coordinates; NaN for degenerate sets.
    """
    seen = visibility[:, pairs].all(axis=2).T  # (n_pairs, n_tracks)
    scenes = _NormalizedPairs.from_tracks(points, seen, pairs)
    n_pairs, n_sets, size = sets.shape
    scene = np.repeat(np.arange(n_pairs), n_sets)
    among_seen = np.cumsum(seen, axis=1) - 1
    sets = among_seen[scene[:, None], sets.reshape(-1, size)]
    fitted = scenes.fit(model, scene, sets).reshape(n_pairs, n_sets, 3, 3)
    return scenes.in_pixels(model, fitted)
