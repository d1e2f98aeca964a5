"""Robust fundamental matrices agree with the same in loops (plain_geometry.py)."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import plain_geometry as plain
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg._core.geometry.description_length import (
    clip_geometry,
)
from skmotionseg._core.geometry.epipolar import (
    cheapest_rank_two,
    mean_sampson_errors,
    nearest_rank_two,
    normalize_pairs,
    robust_fits,
)
from skmotionseg._core.geometry.model_choice import robust_errors
from skmotionseg._core.geometry.tracks import unpack_tracks
from skmotionseg.datasets import make_rigid_motions


@pytest.mark.parametrize("noise", [0.1, 0.5])
def test_residuals_of_one_motion_are_its_noise(noise):
    X, _ = make_rigid_motions(
        n_tracks=200, n_frames=6, n_motions=1, noise=noise, missing=0, random_state=0
    )
    points = unpack_tracks(X)[0].swapaxes(0, 1)
    x, y = points[:1], points[1:2]
    _, errors = robust_fits(x, y, np.ones((1, 200), dtype=bool))
    assert np.sqrt(np.mean(errors)) == pytest.approx(noise, rel=0.15)


def test_a_fit_is_robust_to_a_few_tracks_of_another_motion():
    X, y = make_rigid_motions(
        n_tracks=150, n_frames=6, n_motions=2, noise=0.1, missing=0, random_state=0
    )
    few = np.sort(np.r_[np.flatnonzero(y == 0), np.flatnonzero(y == 1)[:3]])
    y = y[few]
    geometry = clip_geometry(*unpack_tracks(X[few]))
    _, errors = robust_fits(*geometry.of_group(np.arange(len(few))))
    noise = 0.1 / 250  # a working unit is about so many pixels
    assert np.median(errors[:, y == 0]) < noise**2
    assert np.median(errors[:, y == 1]) > 100 * noise**2


def test_pairs_that_see_fewer_than_eight_are_not_fitted():
    seen = np.ones((2, 20), dtype=bool)
    seen[1, 7:] = False
    points = np.random.default_rng(0).standard_normal((2, 2, 20, 2))
    _, errors = robust_fits(*points, seen)
    assert np.isfinite(errors[0]).all()
    assert np.isinf(errors[1]).all()


def random_moments(rank, n=100):
    """Moments (n, 9, 9) of epipolar equations that leave some directions open."""
    rng = np.random.default_rng(0)
    rows = rng.standard_normal((n, 40, rank)) @ rng.standard_normal((n, rank, 9))
    rows += 1e-3 * rng.standard_normal(rows.shape)
    return rows.swapaxes(1, 2) @ rows


@pytest.mark.parametrize("rank", [6, 7, 8])
@pytest.mark.parametrize("lower_rank", [nearest_rank_two, cheapest_rank_two])
def test_both_corrections_give_rank_two(lower_rank, rank):
    F = lower_rank(np.linalg.inv(random_moments(rank)))
    np.testing.assert_allclose(np.linalg.det(F), 0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(F, axis=(1, 2)), 1)


@pytest.mark.parametrize("rank", [6, 7])
def test_the_cheapest_correction_is_cheaper_where_entries_are_open(rank):
    moments = random_moments(rank)
    nearest, cheapest = (
        np.einsum("pi,pij,pj->p", f, moments, f)
        for lower_rank in (nearest_rank_two, cheapest_rank_two)
        for f in [lower_rank(np.linalg.inv(moments)).reshape(-1, 9)]
    )
    assert np.mean(cheapest < nearest) > 0.85  # some steps lead to no root
    assert np.median(nearest / cheapest) > 1e3


def test_the_two_corrections_agree_where_all_entries_are_determined():
    F = np.linalg.svd(np.random.default_rng(0).standard_normal((5, 3, 3)))
    F = (F[0] * [1, 0.5, 1e-4]) @ F[2]  # all but rank two
    f = F.reshape(5, 9) / np.linalg.norm(F, axis=(1, 2))[:, None]
    inverse = 1e6 * f[:, :, None] * f[:, None, :] + np.eye(9)
    np.testing.assert_allclose(
        nearest_rank_two(inverse), cheapest_rank_two(inverse), atol=1e-6
    )


@pytest.mark.parametrize("other", [-20, 0, 1e-300, 20])
def test_a_correction_never_steps_beyond_all_numbers(other):
    """Rounding may leave inverse moments that are negative in a direction."""
    f = np.diag([1.0, 0.5, 0.4]).reshape(-1) / np.linalg.norm([1, 0.5, 0.4])
    inverse = 100 * np.outer(f, f) + other * (np.eye(9) - np.outer(f, f))
    F = cheapest_rank_two(inverse[None])
    assert np.linalg.norm(F) == pytest.approx(1)


def test_fits_are_those_of_the_residuals_and_of_trusted_tracks_only():
    X, y = make_rigid_motions(
        n_tracks=150, n_frames=3, n_motions=2, noise=0.1, missing=0, random_state=0
    )
    geometry = clip_geometry(*unpack_tracks(X))
    first, second, seen = geometry.of_group(np.arange(150))
    trusted = np.broadcast_to(y == 0, seen.shape)
    F, errors = robust_fits(first, second, seen, trusted=trusted)
    _, background = robust_fits(first[:, y == 0], second[:, y == 0], seen[:, y == 0])
    alone = np.median(background)  # in other normalised coordinates
    assert np.median(errors[:, y == 0]) == pytest.approx(alone, rel=0.05)
    assert np.median(errors[:, y == 1]) > 1e4 * alone
    first, second = (np.dstack([side, np.ones(seen.shape)]) for side in (first, second))
    lines, back = first @ F.swapaxes(1, 2), second @ F
    gradient = (lines[..., :2] ** 2 + back[..., :2] ** 2).sum(axis=-1)
    sampson = (second * lines).sum(axis=-1) ** 2 / gradient
    np.testing.assert_allclose(sampson, errors, rtol=1e-6, atol=1e-15)


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


# ------------------------------------------------------------------------- robust fits


@pytest.mark.parametrize("n_trusted", [None, 20, 8, 7])
@pytest.mark.parametrize("seed", range(3))
def test_robust_fundamental_matrices(seed, n_trusted):
    x, y, seen = noisy_pairs(seed=seed)
    trusted = None
    if n_trusted is not None:
        trusted = np.cumsum(seen, axis=1) <= n_trusted
    F, errors = robust_fits(x, y, seen, trusted=trusted)
    for pair, which in enumerate(seen):
        chosen = None if trusted is None else trusted[pair][which]
        G, expected = plain.robust_fundamental(x[pair, which], y[pair, which], chosen)
        assert_allclose(errors[pair, which], expected, rtol=1e-4, atol=1e-12)
        sign = np.sign(np.sum(F[pair] * G))
        assert_allclose(sign * F[pair], G, rtol=1e-4, atol=1e-5 * np.abs(G).max())


def test_eight_tracks_are_fitted_and_seven_are_not():
    x, y, _ = noisy_pairs(2)
    seen = np.arange(30) < np.array([[8], [7]])
    F, errors = robust_fits(x, y, seen)
    assert np.isfinite(errors[0, :8]).all()
    assert np.linalg.matrix_rank(F[0]) == 2
    assert np.isinf(errors[1]).all()
    assert (F[1] == 0).all()
    for name in ("affine", "homography"):
        errors = robust_errors(name, x, y, seen)
        assert np.isfinite(errors[0, :8]).all()
        assert np.isinf(errors[1]).all()


@pytest.mark.parametrize("scale", [1, 1e-3])
def test_tracks_of_a_pair_are_centred_and_scaled_alike(scale):
    x, y, seen = noisy_pairs()
    x, y = scale * x, scale * y
    starts, ends, frames, spread = normalize_pairs(x, y, seen)
    for pair, which in enumerate(seen):
        first, second, maps, size = plain.normalized(x[pair, which], y[pair, which])
        assert_allclose(starts[pair, which], first, atol=1e-12)
        assert_allclose(ends[pair, which], second, atol=1e-12)
        assert_allclose(frames[:, pair], maps, rtol=1e-10, atol=1e-12)
        assert_allclose(spread[pair], size)
    assert_array_equal(starts[~seen], np.tile([0, 0, 1], (np.sum(~seen), 1)))


def test_tracks_that_coincide_are_not_scaled_up_to_rounding():
    _, _, _, spread = normalize_pairs(
        *np.full((2, 1, 9, 2), 0.3), np.ones((1, 9), bool)
    )
    assert_allclose(spread, 1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_mean_errors_of_tracks(seed):
    X, _ = make_rigid_motions(30, 6, 1, missing=0, random_state=seed)
    points, _ = unpack_tracks(X)
    visibility = np.random.default_rng(seed).random((30, 6)) < 0.8
    visibility[0] = np.arange(6) == 2  # no pair sees it
    visibility[:, 5] = np.arange(30) < 9
    visibility[1:9, 4] = np.arange(1, 9) < 8  # the last pair sees seven tracks
    found = mean_sampson_errors(points, visibility)
    n_frames = visibility.shape[1]
    centres = [points[visibility[:, f], f].mean(axis=0) for f in range(n_frames)]
    scale = np.mean(
        [np.abs(points[i, f] - centres[f]) for i, f in np.argwhere(visibility)]
    )
    errors = [[] for _ in points]
    for f in range(n_frames - 1):
        seen = np.flatnonzero(visibility[:, f] & visibility[:, f + 1])
        x, y = ((points[seen, g] - centres[g]) / scale for g in (f, f + 1))
        if len(seen) >= 8:
            for i, error in zip(seen, plain.robust_fundamental(x, y)[1], strict=True):
                errors[i].append(error)
    expected = [np.mean(each) if each else np.nan for each in errors]
    assert np.isnan(expected[0])
    assert_allclose(found, expected, rtol=1e-3, atol=1e-12)
