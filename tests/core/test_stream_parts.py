"""Parts of a stream: resection, labels that are kept, numbers that last."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg._core.geometry.resection import inverse_depths, next_poses, resect
from skmotionseg._core.geometry.rigid_motion import Poses, relative_to, rotations_of
from skmotionseg._core.stream.history import TRACKS_PER_BLOCK, History
from skmotionseg._core.stream.identities import MOST_ABSENT, Numbers, Trace


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


def test_history_has_the_last_label_of_each_track():
    rng, history, expected = np.random.default_rng(0), History(), {}
    for _ in range(60):
        ids = rng.choice(20_000, size=400, replace=False) - 5000
        labels = rng.integers(-1, 5, size=400)
        history.add(ids, labels)
        expected |= dict(zip(ids.tolist(), labels.tolist(), strict=True))
    ids, labels = history.everything(np.array([3, 1]), np.array([8, 9]))
    expected |= {3: 8, 1: 9}
    assert dict(zip(ids.tolist(), labels.tolist(), strict=True)) == expected
    assert (np.diff(ids) > 0).all()
    del expected[3], expected[1]
    some = np.array([*expected, 99_999])
    assert_array_equal(history.labels_of(some), [*expected.values(), -1])


def test_history_takes_a_few_bits_per_track():
    history, rng = History(), np.random.default_rng(0)
    n = 256 * TRACKS_PER_BLOCK
    labels = (rng.uniform(size=n) < 0.1).astype(int)
    for start in range(0, n, 100):
        ids = np.arange(start, min(start + 100, n))
        history.add(ids, labels[ids])
    assert sum(len(block.packed) for block in history._blocks) < n
    assert len(history._blocks) < 24


def at(frame, x, y, velocity=(0.0, 0.0), radius=20.0):
    return Trace(frame, np.array([x, y]), np.array(velocity), radius)


def test_numbers_come_back_where_they_are_expected():
    numbers = Numbers()
    assert [numbers.new() for _ in range(3)] == [0, 1, 2]
    numbers.hide(1, at(10, 100.0, 100.0, (10.0, 0.0)))
    numbers.hide(2, at(10, 500.0, 100.0))
    assert numbers.of(at(18, 175.0, 100.0), 1.0, {0}) == (1, True)
    assert numbers.of(at(18, 175.0, 100.0), 1.0, {0, 1}) == (3, False)
    assert numbers.of(at(18, 300.0, 400.0), 1.0, {0, 1, 3}, former=2) == (2, True)
    assert numbers.hidden == {}


def test_numbers_that_are_all_given_come_back_anywhere():
    numbers = Numbers()
    numbers.new(), numbers.new()
    assert numbers.of(at(5, 0.0, 0.0), 1.0, {0, 1}, most=2) == (None, False)
    numbers.hide(1, at(6, 0.0, 0.0))
    assert numbers.of(at(9, 600.0, 400.0), 1.0, {0}, most=2) == (1, True)


def test_numbers_are_forgotten_and_merged():
    numbers = Numbers()
    for _ in range(4):
        numbers.new()
    numbers.hide(1, at(0, 0.0, 0.0))
    assert numbers.forget(MOST_ABSENT) == []
    assert numbers.forget(MOST_ABSENT + 1) == [1]
    numbers.merge(3, 2)
    numbers.merge(2, 0)
    assert_array_equal(numbers.final(np.array([-1, 0, 1, 2, 3])), [-1, 0, 1, 0, 0])
