"""Cameras: what they make of pixels, and how that changes with them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg._core.geometry.camera import (
    LEAST_NOISE,
    REFERENCE_WIDTH,
    Camera,
)

MIDDLE = np.array([320.0, 240.0])


def camera(bend=0.0, unit=500.0):
    return Camera(MIDDLE, unit, 1e-3, 400.0, bend)


def test_a_camera_looks_at_the_middle_of_what_it_sees():
    seen = Camera.around(np.array([[0.0, 10], [640, 50], [320, 300]]), 0.5)
    assert_allclose(seen.middle, [320, 155])
    assert seen.unit == 320
    assert seen.radius == pytest.approx(np.hypot(320, 145))
    assert seen.bend == 0
    assert seen.noise * seen.unit == pytest.approx(LEAST_NOISE * 640 / REFERENCE_WIDTH)
    assert Camera.around(np.ones((3, 2)), 0.5).unit == 0.5  # a single spot


def test_a_barrel_is_straightened_outwards_and_its_middle_stays():
    points = np.array([MIDDLE, [0.0, 0], [640, 480], [320, 0]])
    assert_allclose(camera().straightened(points), points)
    straight = camera(-0.05).straightened(points)
    assert_array_equal(straight[0], MIDDLE)
    assert_allclose(straight[1], MIDDLE - MIDDLE / 0.95)  # the corner, at the radius
    assert_allclose(straight[2], MIDDLE + MIDDLE / 0.95)
    assert_allclose(straight[3], MIDDLE - [0, 240 / (1 - 0.05 * 0.36)])
    assert (np.abs(camera(0.05).straightened(points) - MIDDLE) <= MIDDLE).all()


def test_a_straight_lens_only_scales():
    points = np.random.default_rng(0).uniform(0, 640, size=(5, 3, 2))
    assert_allclose(camera().calibrated(points), (points - MIDDLE) / 500)


def test_whatever_the_lens_no_place_is_infinite():
    far = MIDDLE + np.array([[4000.0, 0], [0, -9000]])
    for bend in (-0.2, 0.2):
        assert np.isfinite(camera(bend).calibrated(far)).all()
        assert np.isfinite(camera(bend).derivatives(np.array([[90.0], [3]]))).all()


def test_changed_cameras_have_the_same_noise_in_pixels():
    other = camera().changed(np.log(700.0), -0.02)
    assert other.unit == pytest.approx(700)
    assert other.bend == -0.02
    assert other.noise * other.unit == pytest.approx(1e-3 * 500)
    assert other.radius == 400
    assert_array_equal(other.middle, MIDDLE)


@pytest.mark.parametrize("bend", [-0.1, 0.0, 0.06])
def test_derivatives_are_those_of_fixed_pixels(bend):
    points = np.random.default_rng(1).uniform([0, 0], [640, 480], size=(20, 2))
    here, step = camera(bend), 1e-6
    around = [
        (here.changed(np.log(500) + s, bend), here.changed(np.log(500), bend + s))
        for s in (step, -step)
    ]
    expected = [
        (more.calibrated(points) - less.calibrated(points)).T / (2 * step)
        for more, less in zip(*around, strict=True)
    ]
    assert_allclose(here.derivatives(here.calibrated(points).T), expected, atol=1e-7)
