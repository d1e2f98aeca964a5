"""Rigid motions over the last frames of a stream."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import plain_rigid
from helpers.windows import two_windows
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg._core.geometry.camera import Camera
from skmotionseg._core.stream.assignment import measure
from skmotionseg._core.stream.window import Window


@pytest.fixture(scope="module")
def windows():
    return two_windows()


def medians(window, fits, groups):
    scale = window.camera.noise
    return [
        np.nanmedian(measure(window, [fit], scale, rows).deviations())
        for fit, rows in zip(fits, groups, strict=True)
    ]


def test_motions_explain_their_tracks_and_go_on(windows):
    (first, second), groups = windows
    fits = first.fit(groups)
    assert max(medians(first, fits, groups)) < 0.6
    later = second.advance(groups, fits)
    assert not later[0].valid[-1]
    refined = second.fit(groups, later)
    assert refined[0].valid[-1]
    assert max(medians(second, refined, groups)) < 0.6


def test_group_of_few_tracks_has_no_motion(windows):
    (first, _), groups = windows
    assert first.fit([groups[0][:3]]) == [None]


def test_residuals_of_few_tracks_are_corrected_the_most(windows):
    (first, _), groups = windows
    (fit,) = first.fit(groups[:1])
    few, some = (first.inflation(groups[0][:n], fit) for n in (5, 20))
    assert few > 3 > some > 1
    assert first.inflation(groups[0][:1], fit) < np.inf


def test_squares_are_the_least_over_rays_and_depths(windows):
    (first, _), groups = windows
    fits = first.fit(groups)
    rows = np.concatenate([group[:3] for group in groups])
    squares, freedom = first.squares(fits, rows)
    assert np.isfinite(squares).any()
    for row, found, free in zip(rows, squares, freedom, strict=True):
        for fit, square, n_free in zip(fits, found, free, strict=True):
            seen = first.seen[row] & fit.valid
            if seen.sum() < 3:
                assert np.isnan(square)
                assert n_free == 0
                continue
            assert n_free == 2 * seen.sum() - 3
            expected = plain_rigid.least_square(first.x[row], seen, *fit.poses)
            assert_allclose(square, expected, rtol=0.02, atol=1e-9)


def test_tracks_that_are_seen_twice_are_not_judged():
    seen = np.arange(4) < np.array([[2], [3], [4]])
    window = Window(np.ones((3, 4, 2)), seen, Camera(np.zeros(2), 1.0, 1e-3))
    assert_array_equal(window.freedom, [0, 3, 5])
    assert (window.x[~seen] == 0).all()


def test_residuals_are_over_a_variance_that_grows_with_speed(windows):
    (first, _), groups = windows
    steps = np.array([0.0, 3.0, 4.0])
    points = np.arange(12)[:, None] * steps[:, None, None] * [1.0, 1.0]
    camera = Camera(np.zeros(2), 640.0, 0.15 / 640)
    seen = np.ones((3, 12), dtype=bool)
    seen[1, 4:6] = False
    window = Window(points, seen, camera)
    speeds = np.sqrt(2) * steps
    assert_allclose(window.variances, 1 + (0.01 * speeds / 0.15) ** 2)
    fits = first.fit(groups)
    rows = groups[1]
    one, other = (
        measure(first, fits, 1e-3, rows, relative=is_so) for is_so in (True, False)
    )
    variances = first.variances[rows, None]
    assert variances.max() > 1
    assert_allclose(one.squares * variances, other.squares)
    assert_array_equal(other.variances, 1)
