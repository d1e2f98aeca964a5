"""Rotations, poses in other frames, and medians of what counts."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from skmotionseg._core.geometry.poses import (
    NEAREST,
    UPPER,
    Poses,
    image_derivatives,
    images_of,
    kept_away,
    lower_medians,
    normal_equations,
    refocused,
    relative_to,
    rotations_of,
    solve_three,
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


def test_images_are_nearly_the_same_with_another_focal_length():
    rng = np.random.default_rng(5)
    vectors = rng.normal(0, [0.03, 0.03, 0.3], (1, 4, 3))
    poses = Poses(rotations_of(vectors), rng.normal(0, 0.05, (1, 4, 3)))
    rays = np.append(rng.uniform(-0.2, 0.2, (2, 1, 20)), np.ones((1, 1, 20)), axis=0)
    depths = rng.uniform(0.5, 1, (1, 20))

    def images(ratio, poses):
        R, t = (each.swapaxes(0, 1) for each in poses)
        scaled = rays * np.array([ratio, ratio, 1])[:, None, None]
        return images_of(scaled, depths, R, t)[0] / ratio

    before = images(1, poses)
    there = images(1.3, refocused(poses, 1.3)) - before
    assert np.abs(there).max() < 0.005
    assert np.abs(images(1.3, poses) - before).max() > 0.02
    assert_allclose(images(1.0, refocused(poses, 1.0)), before, atol=1e-12)


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


def test_derivatives_of_images_are_those_of_small_steps():
    rng = np.random.default_rng(2)
    L, B, n = 2, 3, 4
    rays = np.concatenate([rng.uniform(-0.5, 0.5, (2, B, n)), np.ones((1, B, n))])
    depths = rng.uniform(0.3, 1, (B, n))
    R, t = (
        rotations_of(0.1 * rng.normal(size=(L, B, 3))),
        0.1 * rng.normal(size=(L, B, 3)),
    )
    image, turned, distance = images_of(rays, depths, R, t)
    assert_allclose(turned, np.einsum("lbij,jbn->ilbn", R, rays))
    weights = rng.uniform(0.5, 2, (L, B, n))
    found = image_derivatives(image, turned, depths, weights / distance)
    assert found.shape == (2, 6, L, B, n)
    for k, step in enumerate(1e-6 * np.eye(6)):
        moved = [
            images_of(
                rays, depths, rotations_of(sign * step[:3]) @ R, t + sign * step[3:]
            )
            for sign in (1, -1)
        ]
        slope = weights * (moved[0][0] - moved[1][0]) / 2e-6
        assert_allclose(found[:, k], slope, atol=1e-8)


def test_normal_equations_are_sums_over_points_and_coordinates():
    rng = np.random.default_rng(3)
    rows, left = rng.normal(size=(2, 6, 3, 4, 5)), rng.normal(size=(2, 3, 4, 5))
    normal, right = normal_equations(rows, left)
    assert_allclose(normal, np.einsum("kilbn,kjlbn->lbij", rows, rows))
    assert_allclose(right[..., 0], np.einsum("kilbn,klbn->lbi", rows, left))


def test_systems_of_three_are_solved():
    rng = np.random.default_rng(4)
    roots = rng.normal(size=(20, 3, 5))
    matrices, right = roots @ roots.swapaxes(1, 2), rng.normal(size=(20, 3))
    found = solve_three(np.moveaxis(matrices[UPPER], -1, 0), right.T)
    expected = np.linalg.solve(matrices, right[..., None])[..., 0]
    assert_allclose(np.stack(found, axis=-1), expected, rtol=1e-8)


def test_of_singular_systems_the_solutions_are_bounded():
    """Rounding makes some determinants negative, or far too small."""
    rng = np.random.default_rng(5)
    roots = rng.normal(size=(500, 3, 2)) * 10.0 ** rng.integers(-4, 5, size=(500, 3, 1))
    matrices = roots @ roots.swapaxes(1, 2)
    right = (matrices @ rng.normal(size=(500, 3, 1)))[..., 0]
    found = np.stack(solve_three(np.moveaxis(matrices[UPPER], -1, 0), right.T))
    assert np.abs(found).max() < 1e30
