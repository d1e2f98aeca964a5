"""The focal length and the lens, estimated as a stream goes on."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.films import FOCAL, SIZE

from skmotionseg._core.geometry.camera import Camera
from skmotionseg._core.stream import calibration
from skmotionseg._core.stream.calibration import (
    FEWEST_TELLING,
    MOST_CHANGED,
    SPREADS,
    SUREST,
    CameraEstimate,
)
from skmotionseg._core.stream.window import LENGTH, Window

RADIUS = float(np.hypot(*SIZE) / 2)
WIDTH = float(SIZE.max())


def turning(rng, speed=0.04, bend=0.0, noise=0.05):
    """A window of something that turns before the camera, and all of its tracks."""
    thing = rng.uniform(-2, 2, size=(60, 3))
    angles = speed * np.arange(LENGTH)
    x = thing[:, None, 0] * np.cos(angles) - thing[:, None, 2] * np.sin(angles)
    z = thing[:, None, 0] * np.sin(angles) + thing[:, None, 2] * np.cos(angles) + 6
    y = np.repeat(thing[:, 1:2], LENGTH, axis=1)
    away = FOCAL * np.stack([x, y], axis=2) / z[..., None] / RADIUS
    squares = (away**2).sum(axis=2, keepdims=True)
    away *= 2 / (1 + np.sqrt(1 - 4 * bend * squares))  # bent by the division model
    points = RADIUS * away + SIZE / 2 + noise * rng.standard_normal(away.shape)
    return lambda camera: Window(points, np.ones(points.shape[:2], bool), camera)


def estimated(speed=0.04, bend=0.0, n_times=6, factor=1.0, noise=0.05):
    """The camera after some estimates, at first with a wrong focal length."""
    unit = factor * FOCAL
    camera = Camera(SIZE / 2, unit, 0.15 / unit, RADIUS)
    estimate, groups = CameraEstimate(WIDTH), [np.arange(60)]
    rng = np.random.default_rng(0)
    for _ in range(n_times):
        film = turning(rng, speed, bend, noise)
        before = camera
        window = film(camera)
        camera, known = estimate.improved(window, groups, window.fit(groups))
        estimate.add(*known)
        change = np.log(camera.unit / before.unit), camera.bend - before.bend
        assert (np.abs(change) <= np.array(MOST_CHANGED) + 1e-9).all()
        assert camera.unit * camera.noise == pytest.approx(0.15)
    return camera, estimate


@pytest.mark.parametrize(
    ("bend", "factor"), [(-0.05, 1.6), (0.0, 0.6), (0.04, 1.0), (-0.05, 0.6)]
)
def test_focal_length_and_lens_are_found_together(bend, factor):
    camera, estimate = estimated(bend=bend, factor=factor)
    assert abs(np.log(camera.unit / FOCAL)) < 0.03
    assert abs(camera.bend - bend) < 0.006
    errors = np.sqrt(np.diag(np.linalg.inv(estimate.precision)))
    assert (errors < np.array(SPREADS) / 3).all()


def test_what_stands_still_tells_nothing():
    camera, estimate = estimated(speed=0.0, bend=-0.05, factor=1.0)
    usual = calibration.USUAL_FOCAL_LENGTH * WIDTH
    assert abs(np.log(camera.unit / usual)) < 0.1
    assert abs(camera.bend) < 0.005
    errors = np.sqrt(np.diag(np.linalg.inv(estimate.precision)))
    assert (errors > 0.8 * np.array(SPREADS)).all()


def test_motions_of_few_tracks_tell_nothing():
    film, estimate = turning(np.random.default_rng(0)), CameraEstimate(WIDTH)
    usual = calibration.USUAL_FOCAL_LENGTH * WIDTH
    window = film(Camera(SIZE / 2, usual, 0.15 / usual, RADIUS))
    groups = [np.arange(FEWEST_TELLING - 1)]
    camera, (_, precision) = estimate.improved(window, groups, window.fit(groups))
    assert camera.unit == pytest.approx(usual)
    assert camera.bend == 0
    np.testing.assert_allclose(precision, estimate.precision)


@pytest.mark.parametrize("spread", [0.0, 1e-3])
def test_tracks_in_one_place_tell_nothing(spread):
    rng, estimate = np.random.default_rng(0), CameraEstimate(WIDTH)
    points = np.full((20, LENGTH, 2), 200.0) + spread * rng.standard_normal((20, 1, 2))
    camera = Camera(SIZE / 2, FOCAL, 0.15 / FOCAL, RADIUS)
    window = Window(points, np.ones((20, LENGTH), dtype=bool), camera)
    groups = [np.arange(20)]
    found, (values, precision) = estimate.improved(window, groups, window.fit(groups))
    assert np.isfinite([found.unit, found.bend, *values]).all()
    np.testing.assert_allclose(precision, estimate.precision, rtol=0.05)


def test_a_lens_that_zooms_is_followed():
    _, estimate = estimated(n_times=1)
    for _ in range(200):  # the same again and again
        estimate.add(estimate.values, estimate.precision + np.diag([1e4, 1e5]))
    errors = np.sqrt(np.diag(np.linalg.inv(estimate.precision)))
    np.testing.assert_allclose(errors, SUREST, rtol=0.02)


def test_what_cannot_be_is_not_taken():
    film, estimate = turning(np.random.default_rng(0)), CameraEstimate(WIDTH)
    estimate.values = np.array([np.log(100 * WIDTH), -3.0])
    unit = calibration.LONGEST * WIDTH
    camera = Camera(SIZE / 2, unit, 0.15 / unit, RADIUS, -calibration.MOST_BENT)
    camera, _ = estimate.improved(film(camera), [], [])
    assert camera.unit == pytest.approx(unit)
    assert camera.bend == pytest.approx(-calibration.MOST_BENT)


def test_a_focal_length_that_is_given_stays():
    unit = 0.9 * FOCAL  # not what the tracks say
    camera = Camera(SIZE / 2, unit, 0.15 / unit, RADIUS)
    estimate, groups = CameraEstimate(WIDTH, unit), [np.arange(60)]
    rng = np.random.default_rng(1)
    for _ in range(4):
        window = turning(rng, bend=-0.05)(camera)
        camera, known = estimate.improved(window, groups, window.fit(groups))
        estimate.add(*known)
        assert camera.unit == pytest.approx(unit, rel=1e-12)
    assert camera.bend < -0.02
