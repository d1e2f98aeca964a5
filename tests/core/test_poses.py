"""Rotations, poses in other frames, and medians of what counts."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from skmotionseg._core.geometry.poses import (
    NEAREST,
    Poses,
    kept_away,
    lower_medians,
    relative_to,
    rotations_of,
)


def test_rotations_are_those_of_scipy():
    vectors = np.random.default_rng(0).normal(size=(4, 5, 3))
    vectors[0, 0], vectors[0, 1] = 0, 1e-12
    expected = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix()
    assert_allclose(rotations_of(vectors).reshape(-1, 3, 3), expected, atol=1e-12)


def test_points_stay_where_they_are_relative_to_another_frame():
    """What a pose says of a point of one frame, it says of the point of another."""
    rng = np.random.default_rng(1)
    poses = Poses(rotations_of(rng.normal(size=(2, 4, 3))), rng.normal(size=(2, 4, 3)))
    point = rng.normal(size=3)
    there = poses.rotations @ point + poses.translations  # (2, 4, 3)
    reference = np.array([1, 3])
    moved = relative_to(poses, reference)
    start = there[[0, 1], reference]
    again = (moved.rotations @ start[:, None, :, None])[..., 0] + moved.translations
    assert_allclose(again, there, atol=1e-12)
    assert_allclose(moved.rotations[[0, 1], reference], [np.eye(3)] * 2, atol=1e-12)


def test_distances_keep_their_side_of_the_camera():
    distances = np.array([-2.0, -1e-9, 0.0, 1e-9, 2.0])
    assert_array_equal(kept_away(distances), [-2, -NEAREST, NEAREST, NEAREST, 2])


def test_medians_are_of_what_counts():
    rng = np.random.default_rng(2)
    values, counted = rng.normal(size=(20, 7)), rng.random(size=(20, 7)) < 0.6
    counted[0] = False
    expected = [
        np.sort(row[some])[(some.sum() - 1) // 2] if some.any() else np.inf
        for row, some in zip(values, counted, strict=True)
    ]
    assert_array_equal(lower_medians(values, counted), expected)
