"""The simplest model of a group, and robust fits of maps."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import plain_geometry as plain
from helpers import textbook
from numpy.testing import assert_allclose

from skmotionseg._core.geometry.description_length import (
    clip_geometry,
)
from skmotionseg._core.geometry.model_choice import choose_model, robust_errors
from skmotionseg._core.geometry.tracks import unpack_tracks
from skmotionseg.datasets import make_rigid_motions


def noisy_pairs(n_pairs=4, n_tracks=30, seed=0):
    """Points of a rigid scene in pairs of frames, some unseen and some wrong."""
    X, _ = make_rigid_motions(n_tracks, 2 * n_pairs, 1, missing=0, random_state=seed)
    points = unpack_tracks(X)[0].swapaxes(0, 1) / 250 - 1
    x, y = points[::2], points[1::2]
    rng = np.random.default_rng(seed)
    y[:, :3] += 0.1 * rng.standard_normal((n_pairs, 3, 2))
    seen = rng.random((n_pairs, n_tracks)) < 0.7
    x[~seen], y[~seen] = 0, 0
    return x, y, seen


@pytest.mark.parametrize("name", ["affine", "homography"])
@pytest.mark.parametrize("seed", range(3))
def test_robust_maps(name, seed):
    x, y, seen = noisy_pairs(seed=seed)
    errors = robust_errors(name, x, y, seen)
    for pair, which in enumerate(seen):
        expected = plain.robust_map(
            name, x[pair, which], y[pair, which], textbook.SAMPSON[name]
        )
        assert_allclose(errors[pair, which], expected, rtol=1e-4, atol=1e-12)


@pytest.mark.parametrize("name", ["affine", "homography"])
def test_tracks_on_a_line_have_a_map_that_explains_them(name):
    """They leave open what happens beside the line."""
    x = np.linspace(-1, 1, 12)[:, None] * [1.0, 0.5]
    y = 1.1 * x + [0.1, -0.2]
    seen = np.ones((1, 12), dtype=bool)
    assert robust_errors(name, x[None], y[None], seen).max() < 1e-12


@pytest.mark.parametrize("n_seen", [7, 8])
def test_pairs_that_see_seven_are_not_asked_for_a_model(n_seen):
    """Of twenty tracks, one is seen in the last two frames only."""
    X, _ = make_rigid_motions(20, 6, 1, missing=0, random_state=0)
    points, visibility = unpack_tracks(X)
    visibility[0, :4] = False
    visibility[n_seen:, 4:] = False
    found = choose_model(clip_geometry(points, visibility), np.arange(20))
    assert len(found.residuals) == (20 if n_seen == 8 else 19)
    assert np.isfinite(found.residuals).all()


def test_pairs_that_see_too_few_tracks_choose_no_model():
    X, _ = make_rigid_motions(30, 6, 1, missing=0, random_state=0)
    geometry = clip_geometry(*unpack_tracks(X))
    few = choose_model(geometry, np.arange(7))
    assert (few.model, few.lengths, few.residuals.shape) == (None, {}, (0,))
    assert choose_model(geometry, np.arange(8)).model is not None
    x, y, seen = noisy_pairs()
    seen &= seen.cumsum(axis=1) <= 7
    for name in ("affine", "homography", "fundamental"):
        assert np.isinf(robust_errors(name, x, y, seen)).all()
