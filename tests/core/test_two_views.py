"""Densities of motions between two images, against the formulas term by term."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.two_images import two_images
from numpy.testing import assert_allclose
from scipy.stats import multivariate_t
from scipy.stats import t as student

from skmotionseg._core.geometry.motion_models import homogeneous
from skmotionseg._core.geometry.two_views import (
    AFFINE_UNKNOWNS,
    FREEDOM,
    LEAST_NOISE,
    MOST_NOISE,
    PERSPECTIVE_UNKNOWNS,
    TwoViewMotions,
    fit_two_view_motions,
    log_student,
    two_views,
)


def views_of(X):
    """Correspondences in working units."""
    points = X.reshape(-1, 2, 2)
    x, y = ((points - points.mean(axis=0)) / 100).swapaxes(0, 1)
    return two_views(x, y)


def fitted(views, shares, rounds=6):
    motions = None
    for _ in range(rounds):
        motions = fit_two_view_motions(views, shares, motions)
    return motions


@pytest.fixture(scope="module")
def one_thing():
    X, _ = two_images([60])
    views = views_of(X)
    return X, views, fitted(views, np.ones((1, 60)))


@pytest.mark.parametrize("dimension", [1, 2])
def test_student_is_that_of_scipy(dimension):
    rng = np.random.default_rng(0)
    gaps, scale = rng.standard_normal((3, 5, dimension)), np.array([0.1, 1, 4.0])
    ours = log_student((gaps**2).sum(axis=2), scale, dimension)
    for k in range(3):
        shape = scale[k] ** 2 * np.eye(dimension)
        expected = multivariate_t(shape=shape, df=FREEDOM).logpdf(gaps[k])
        assert_allclose(ours[k], expected, atol=1e-12)


def plain_log_density(F, A, noise, parallax, x, y):
    """Log density of one point, from Hartley and Zisserman's formulas."""
    line, back = F @ x, F.T @ y
    sampson = (y @ F @ x) ** 2 / (line[:2] @ line[:2] + back[:2] @ back[:2])
    along = np.array([-line[1], line[0]]) / np.hypot(*line[:2])
    off = along @ (y[:2] - x @ A)
    return sum(
        student(FREEDOM, scale=scale).logpdf(gap)
        for gap, scale in ((np.sqrt(sampson), noise), (off, parallax))
    )


def test_densities_are_the_textbook_s(one_thing):
    _, views, motions = one_thing
    twice = motions + TwoViewMotions(
        motions.fundamental.swapaxes(1, 2),
        motions.affine + 0.1,
        3 * motions.noise,
        2 * motions.parallax,
        motions.n_unknowns,
    )
    ours = twice.log_densities(views)
    for k in range(2):
        motion = (part[k] for part in twice._parts[:4])
        F, A, noise, parallax = motion
        plain = [
            plain_log_density(F, A, noise, parallax, x, y)
            for x, y in zip(views.x, views.y, strict=True)
        ]
        assert_allclose(ours[k], plain, rtol=1e-9)


def test_each_unknown_costs_a_free_coordinate(one_thing):
    _, views, motions = one_thing
    (noise,), (parallax,) = motions.noise, motions.parallax
    entropy = np.log(np.sqrt(2 * np.pi * np.e))
    per_geometry = np.log(views.side) - np.log(noise) - entropy
    per_map = max(np.log(views.side) - np.log(parallax) - entropy, 1)
    expected = motions.n_unknowns[0] * per_geometry + 3 * per_map
    assert_allclose(motions.costs(views), [expected])


def test_noise_is_that_of_the_tracks(one_thing):
    _, _, motions = one_thing
    assert motions.n_unknowns[0] in (AFFINE_UNKNOWNS, PERSPECTIVE_UNKNOWNS)
    assert 0.3 < 100 * motions.noise[0] < 0.7  # half a pixel was added
    assert motions.parallax[0] > 2 * motions.noise[0]  # it is no plane
    F = motions.fundamental[0]
    assert abs(np.linalg.det(F / np.linalg.norm(F))) < 1e-9


def test_a_plane_has_no_parallax():
    X, _ = two_images([60], flat=True)
    views = views_of(X)
    plane = fitted(views, np.ones((1, 60)))
    X, _ = two_images([60])
    solid = fitted(views_of(X), np.ones((1, 60)))
    assert plane.parallax[0] < 0.5 * solid.parallax[0]


def test_the_noise_stays_within_its_limits():
    rng = np.random.default_rng(0)
    X = rng.uniform(0, 500, (50, 4))
    views = views_of(X)
    noise = fitted(views, np.ones((1, 50))).noise
    assert_allclose(noise, MOST_NOISE * views.pixel)
    exact = views_of(np.hstack([X[:, :2], X[:, :2]]))
    still = fitted(exact, np.ones((1, 50)))
    assert LEAST_NOISE * exact.pixel <= still.noise[0] < exact.pixel
    assert np.isfinite(still.log_densities(exact)).all()


@pytest.mark.parametrize("seed", [0, 1])
def test_each_motion_has_the_epipolar_geometry_that_is_best_for_it(seed):
    X, y = two_images([60, 60, 12], seed=seed)
    views, shares = views_of(X), np.eye(3)[y].T
    together = fit_two_view_motions(views, shares, common_noise=False).n_unknowns
    alone = [
        fit_two_view_motions(views, share[None], common_noise=False).n_unknowns[0]
        for share in shares
    ]
    assert_allclose(together, alone)
    assert set(alone) == {AFFINE_UNKNOWNS, PERSPECTIVE_UNKNOWNS}


def test_outliers_with_no_share_change_nothing(one_thing):
    _, views, motions = one_thing
    X, _ = two_images([60])
    more = np.vstack([X, [[0, 0, 640, 480], [640, 0, 0, 480]]])
    centre = X.reshape(-1, 2, 2).mean(axis=0)
    x, y = ((more.reshape(-1, 2, 2) - centre) / 100).swapaxes(0, 1)
    with_more = type(views)(homogeneous(x), homogeneous(y), views.side)
    shares = np.append(np.ones(60), [0, 0])[None]
    same = fitted(with_more, shares)
    assert_allclose(same.noise, motions.noise, rtol=1e-6)
    assert_allclose(same.affine, motions.affine, rtol=1e-6, atol=1e-9)


def test_points_in_one_spot_or_on_one_line_give_numbers():
    for X in (np.ones((20, 4)), np.outer(np.arange(20.0), [1, 0, 1, 0])):
        views = views_of(X)
        motions = fitted(views, np.ones((1, 20)))
        assert np.isfinite(motions.log_densities(views)).all()
        assert np.isfinite(motions.costs(views)).all()
