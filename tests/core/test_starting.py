"""How a stream begins."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg._core.geometry.camera import Camera
from skmotionseg._core.geometry.windows import FOCAL_LENGTHS
from skmotionseg._core.stream import starting
from skmotionseg._core.stream.buffer import TrackBuffer
from skmotionseg._core.stream.calibration import SPREADS
from skmotionseg._core.stream.window import LENGTH

FOCAL, SIZE = 700.0, np.array([640, 480])


@pytest.fixture(scope="module")
def first_frames():
    """A camera that turns about a scene: what only translates tells no focal length."""
    rng = np.random.default_rng(0)
    world = rng.uniform([-3, -2, -2], [3, 2, 2], size=(120, 3))
    angles = 0.05 * np.arange(LENGTH)
    across = world[:, None, 0] * np.cos(angles) - world[:, None, 2] * np.sin(angles)
    away = world[:, None, 0] * np.sin(angles) + world[:, None, 2] * np.cos(angles) + 6
    up = np.repeat(world[:, 1:2], LENGTH, axis=1)
    points = FOCAL * np.stack([across, up], axis=2) / away[..., None] + SIZE / 2
    points += 0.05 * rng.standard_normal(points.shape)
    seen = ((points > 0) & (points < SIZE)).all(axis=2)
    rows = np.flatnonzero(seen.sum(axis=1) >= 4)
    return np.where(seen[..., None], points, 0), seen, rows, [rows[::2], rows[1::2]]


def test_focal_length_is_found_between_those_that_are_tried_first(first_frames):
    points, seen, rows, groups = first_frames
    found, estimate = starting.calibrate(points, seen, rows, groups)
    assert abs(np.log(found.camera.unit / FOCAL)) < np.log(1.05)
    assert abs(found.camera.bend) < 0.01
    for share in FOCAL_LENGTHS:
        camera = Camera.around(points[seen], share)
        other = starting._seen_by(camera, points, seen, rows, groups)
        assert found.nats <= other.nats
    assert all(fit is not None for fit in found.fits)
    assert found.scale >= found.camera.noise
    assert_allclose(np.exp(estimate.values[0]), found.camera.unit)
    assert np.linalg.det(estimate.precision) > 4 / np.prod(np.square(SPREADS))


def test_a_focal_length_that_is_given_is_taken(first_frames):
    points, seen, rows, groups = first_frames
    found, estimate = starting.calibrate(points, seen, rows, groups, 600.0)
    assert found.camera.unit == pytest.approx(600)
    assert np.exp(estimate.values[0]) == pytest.approx(600)


def test_steps_are_taken_towards_the_best(first_frames, monkeypatch):
    points, seen, rows, groups = first_frames
    sizes = np.ptp(points[seen], axis=0).max()

    def nats(camera, *others):
        cost = abs(np.log(camera.unit / sizes / 1.3))
        return starting.Calibration(cost, camera, [], 1.0)

    monkeypatch.setattr(starting, "_seen_by", nats)
    monkeypatch.setattr(starting, "FIRST_STEPS", 0)
    found, _ = starting.calibrate(points, seen, rows, groups)
    assert found.camera.unit / sizes == pytest.approx(1.3, rel=0.04)


def test_groups_of_few_tracks_tell_no_camera(first_frames):
    points, seen, rows, groups = first_frames
    found, _ = starting.calibrate(points, seen, rows, [groups[0][:3]])
    assert found.nats == np.inf
    assert found.fits == [None]


def test_beginning_has_all_tracks(first_frames):
    points, seen, *_ = first_frames
    beginning, buffer = starting.Beginning(), TrackBuffer(LENGTH)
    names = 3 * np.arange(len(points))[::-1]  # in no order
    for frame in range(LENGTH):
        some = seen[:, frame]
        beginning.push(points[some, frame], names[some])
        buffer.push(points[some, frame], names[some])
    often = seen.any(axis=1)
    for each in (beginning, starting.Beginning.of(buffer, LENGTH)):
        ids, places, visible = each.tracks()
        assert_array_equal(ids, names[often][::-1])
        assert_array_equal(places, points[often][::-1])
        assert_array_equal(visible, seen[often][::-1])
    newest = starting.Beginning.of(buffer, 3)
    assert len(newest) == 3
    assert_array_equal(newest.frames[-1][0], beginning.frames[-1][0][::-1])
    assert not newest.is_over
