"""A focal length that is looked at again."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.films import FOCAL, SIZE, film

from skmotionseg._core.stream.buffer import TrackBuffer
from skmotionseg._core.stream.focal_length import FEWEST, STEP, FocalLength, _is_better
from skmotionseg._core.stream.window import LENGTH, Camera, Window


def after_comparisons(factor, n_times=18, noise=0.05):
    """The camera after some comparisons, from a focal length that is wrong by a factor.

    The thing turns before the camera, so that it tells the focal length.
    """
    unit = factor * FOCAL
    camera, scale = Camera(SIZE / 2, unit, 0.15 / unit), 0.3 / unit
    told, fits, groups = FocalLength(), None, None
    for seed in range(n_times):
        buffer = turning(seed, noise)
        groups = [np.arange(len(buffer.ids))]
        window = Window(buffer.points, buffer.seen, camera)
        fits, before = window.fit(groups), camera
        camera, fits = told.compare(window, scale, groups, fits, SIZE.max())
        scale *= before.unit / camera.unit
        assert camera.unit * camera.noise == pytest.approx(0.15)
        assert all(fit is not None for fit in fits)
    return camera


def turning(seed, noise):
    """Tracks of something that turns before the camera."""
    rng = np.random.default_rng(seed)
    thing = rng.uniform(-2, 2, size=(60, 3))
    angles = 0.04 * np.arange(LENGTH)
    x = thing[:, None, 0] * np.cos(angles) - thing[:, None, 2] * np.sin(angles)
    z = thing[:, None, 0] * np.sin(angles) + thing[:, None, 2] * np.cos(angles) + 6
    y = np.repeat(thing[:, 1:2], LENGTH, axis=1)
    points = FOCAL * np.stack([x, y], axis=2) / z[..., None] + SIZE / 2
    points += noise * rng.standard_normal(points.shape)
    buffer = TrackBuffer(LENGTH)
    for frame in range(LENGTH):
        buffer.push(points[:, frame], np.arange(60))
    return buffer


@pytest.mark.parametrize("factor", [1 / STEP**2, STEP**2])
def test_focal_length_that_is_wrong_is_changed(factor):
    found = after_comparisons(factor)
    assert abs(np.log(found.unit / FOCAL)) <= np.log(STEP) / 2 + 1e-9


def test_focal_length_that_is_right_is_kept():
    assert after_comparisons(1.0).unit == FOCAL
    assert after_comparisons(STEP, 2 * FEWEST - 2).unit == STEP * FOCAL  # not yet


def test_motions_of_few_tracks_tell_nothing():
    movie = film(n_frames=LENGTH)
    buffer = TrackBuffer(LENGTH)
    for frame in range(LENGTH):
        buffer.push(*movie.frame(frame))
    camera = Camera(SIZE / 2, FOCAL, 0.15 / FOCAL)
    groups = [np.arange(6)]
    window = Window(buffer.points, buffer.seen, camera)
    fits = window.fit(groups)
    found = FocalLength().compare(window, 1e-3, groups, fits, SIZE.max())
    assert found == (camera, fits)


def test_gains_that_vary_are_no_reason():
    assert _is_better([50.0, 60.0, 55.0])
    assert not _is_better([50.0, 60.0])
    assert not _is_better([5.0, 6.0, 5.5])
    assert not _is_better([400.0, -300.0, 60.0])
