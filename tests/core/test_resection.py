"""Depths and poses of one more frame, the points being known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from skmotionseg._core.geometry.poses import Poses, relative_to, rotations_of
from skmotionseg._core.geometry.resection import inverse_depths, next_poses, resect


@pytest.fixture
def filmed():
    """Rays, inverse depths, images (B, n, L, 2) and poses of two motions."""
    rng = np.random.default_rng(0)
    B, n, L = 2, 30, 6
    rotations = rotations_of(0.05 * rng.standard_normal((B, L, 3)))
    translations = 0.2 * rng.standard_normal((B, L, 3))
    rotations[:, 2], translations[:, 2] = np.eye(3), 0
    rays = np.concatenate([rng.uniform(-0.5, 0.5, (B, n, 2)), np.ones((B, n, 1))], 2)
    depths = rng.uniform(0.5, 1.5, (B, n))
    points = rays[:, None] @ rotations.swapaxes(-1, -2)
    points = points + depths[:, None, :, None] * translations[:, :, None]
    x = (points[..., :2] / points[..., 2:]).swapaxes(1, 2)
    return rays, depths, x, Poses(rotations, translations)


def test_depths_and_poses_are_found_again(filmed):
    rays, depths, x, poses = filmed
    seen = np.ones(x.shape[:3], dtype=bool)
    seen[..., -1] = False
    found = inverse_depths(rays, x, seen, poses)
    assert_allclose(found, depths, rtol=1e-6)
    start = np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3))
    R, t, medians = resect(rays, found, x[:, :, -1], np.ones((2, 30)), start, 1e-6)
    assert_allclose(R, poses.rotations[:, -1], atol=1e-4)
    assert_allclose(t, poses.translations[:, -1], atol=1e-4)
    assert (medians < 1e-4).all()


def test_outliers_do_not_move_a_pose(filmed):
    rays, depths, x, poses = filmed
    seen = x[:, :, -1].copy()
    seen[:, :5] += 0.2
    start = poses.rotations[:, -2], poses.translations[:, -2]
    R, t, _ = resect(rays, depths, seen, np.ones((2, 30)), start, 1e-4)
    assert_allclose(R, poses.rotations[:, -1], atol=4e-3)
    assert_allclose(t, poses.translations[:, -1], atol=4e-3)


def test_poses_go_on_at_constant_speed():
    angles = np.arange(5)[:, None] * [0.0, 0.02, 0.0]
    places = np.arange(5)[:, None] * [0.1, 0.0, 0.05]
    rotations = rotations_of(angles)
    poses = Poses(rotations[None], -(rotations @ places[..., None])[None, ..., 0])
    before = Poses(*(each[:, :-1] for each in poses))
    known = np.ones((1, 4), dtype=bool)
    R, _ = next_poses(before, known)
    assert_allclose(R, poses.rotations[:, -1], atol=1e-12)
    known[:, -2] = False  # then as in the last frame
    R, t = next_poses(before, known)
    assert_allclose(R, poses.rotations[:, -2])
    assert_allclose(t, poses.translations[:, -2])


def test_poses_relative_to_frames_of_their_own(filmed):
    _, _, _, poses = filmed
    moved = relative_to(poses, [1, 4])
    for motion, reference in enumerate([1, 4]):
        alone = relative_to(Poses(*(each[[motion]] for each in poses)), reference)
        assert_allclose(moved.rotations[motion], alone.rotations[0])
        assert_allclose(moved.translations[motion, reference], 0, atol=1e-15)
