"""Rigid motion over several frames: poses, residuals, and a textbook's of both."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import plain_rigid
from numpy.testing import assert_allclose
from scipy.optimize import least_squares

from skmotionseg._core.geometry import rigid_motion
from skmotionseg._core.geometry.rigid_motion import (
    Poses,
    camera_information,
    fit_rigid_motions,
    inverse_depths,
    refine_rigid_motions,
    rotations_of,
    squared_residuals,
)

N_FRAMES, REFERENCE = 6, 2


def scene(rng, n=30, noise=1e-4, direction=(0, 0, 1.0), speed=0.04):
    """Calibrated tracks (n, L, 2) of one rigid motion, and its true poses."""
    rays = np.column_stack([rng.uniform(-0.5, 0.5, (n, 2)), np.ones(n)])
    depths = rng.uniform(0.3, 1, n)
    time = np.arange(N_FRAMES) - REFERENCE
    rotations = rotations_of(0.01 * rng.standard_normal(3) * time[:, None])
    translations = speed * np.array(direction) * time[:, None]
    points = np.einsum("lij,nj->nli", rotations, rays)
    points += depths[:, None, None] * translations
    x = points[..., :2] / points[..., 2:]
    x = x + noise * rng.standard_normal(x.shape)
    return x, Poses(rotations[None], translations[None])


def mirrored(x, reference):
    """Tracks as of points behind the camera, nearly."""
    return x - 2.3 * (x - x[:, reference, None])


def deviation(squares, seen):
    return np.sqrt(np.median(squares / (2 * seen.sum(axis=1) - 3)))


@pytest.mark.parametrize(
    "direction", [(0, 0, 1.0), (0, 0, -1.0), (1.0, 0, 0), (0.5, -0.7, 0.3)]
)
def test_a_motion_is_fitted_to_the_noise(direction):
    rng = np.random.RandomState(1)
    x, _ = scene(rng, direction=direction)
    seen = np.ones(x.shape[:2], dtype=bool)
    poses = fit_rigid_motions(
        x[None], seen[None], np.ones((1, len(x))), np.array([1e-5]), REFERENCE
    )
    assert deviation(squared_residuals(x, seen, poses)[0], seen) < 1.3e-4


def informed(x, poses, derivatives=lambda x: np.stack([-x, -x * (x**2).sum(axis=0)])):
    """What one motion tells of a focal length's logarithm and of a lens."""
    seen = np.ones((1, *x.shape[:2]), dtype=bool)
    floor = np.array([1e-4])
    problem = x[None], seen, np.ones((1, len(x))), floor, REFERENCE
    found = camera_information(*problem, poses, derivatives)
    return tuple(each[0] for each in found)


def test_a_step_leads_to_the_camera_that_explains_a_motion():
    x, poses = scene(np.random.RandomState(5), n=60, noise=1e-5)
    poses = poses._replace(rotations=rotations_of(0.05 * turned_by())[None])
    x = seen_by_poses(x, poses)
    # Pixels are calibrated with a focal length 3 % too short, and a lens of 0.02.
    wrong = x * 1.03 * (1 - 0.02 * (x**2).sum(axis=2, keepdims=True))
    information, gradient = informed(wrong, poses)
    assert (np.linalg.eigvalsh(information) > 0).all()
    step = np.linalg.solve(information, gradient)
    assert_allclose(step, [np.log(1.03), -0.02], atol=3e-3)


def turned_by():
    """Rotation vectors about all axes, none in the reference frame."""
    vectors = np.random.RandomState(6).standard_normal((N_FRAMES, 3))
    vectors[REFERENCE] = 0
    return vectors


def seen_by_poses(x, poses):
    """Images of points whose rays are those of tracks in the reference frame."""
    rays = np.pad(x[:, REFERENCE], ((0, 0), (0, 1)), constant_values=1)
    points = np.einsum("lij,nj->nli", poses.rotations[0], rays)
    points += np.linspace(0.3, 1, len(x))[:, None, None] * poses.translations[0]
    return points[..., :2] / points[..., 2:]


def test_noise_is_no_reason_for_another_camera():
    # Coordinates that are made smaller have smaller residuals.
    rng = np.random.RandomState(7)
    nothing = Poses(np.tile(np.eye(3), (1, N_FRAMES, 1, 1)), np.zeros((1, N_FRAMES, 3)))
    gains = []
    for _ in range(10):
        still = rng.uniform(-0.5, 0.5, (40, 1, 2)) + np.zeros((N_FRAMES, 1))
        x = still + 1e-3 * rng.standard_normal((40, N_FRAMES, 2))
        information, gradient = informed(x, nothing)
        gains.append(gradient)
        assert (np.diag(information) < 20).all()  # standard errors of 20 % and more
    error = np.std(gains, axis=0) / np.sqrt(len(gains))
    assert (np.abs(np.mean(gains, axis=0)) < 3 * error + 1).all()


def test_inverse_depths_are_those_of_the_scene():
    rng = np.random.RandomState(3)
    depths = np.random.RandomState(4).uniform(0.3, 1, 30)
    x, poses = scene(rng, noise=1e-6)
    seen = rng.uniform(size=x.shape[:2]) < 0.8
    seen[:, :3] = True
    places = [
        place_by_least_squares(*each, poses) for each in zip(x, seen, strict=True)
    ]
    expected, errors = np.transpose(places)
    found = inverse_depths(np.where(seen[..., None], x, 0), seen, poses)
    np.testing.assert_allclose(found[0][0], expected, atol=2e-4)
    np.testing.assert_allclose(found[1][0], errors, rtol=1e-3)
    assert depths.min() - 0.01 < expected.min() < expected.max() < depths.max() + 0.01
    assert inverse_depths(x[:0], seen[:0], poses)[0].shape == (1, 0)


def place_by_least_squares(image, frames, poses):
    """Inverse depth of a track, whose ray is free as well, and its standard error."""
    pose = poses.rotations[0], poses.translations[0]
    residuals = plain_rigid.residuals_of(image, frames, *pose)
    found = least_squares(residuals, [*image[REFERENCE], 0.5])
    return found.x[2], np.sqrt(np.linalg.inv(found.jac.T @ found.jac)[2, 2])


def test_what_is_behind_the_camera_is_placed_at_infinity():
    x, poses = scene(np.random.RandomState(3), noise=1e-6, direction=(1.0, 0.2, 0))
    x[:10] = mirrored(x[:10], REFERENCE)
    seen = np.ones(x.shape[:2], dtype=bool)
    (squares,) = squared_residuals(x, seen, poses)
    pose = poses.rotations[0], poses.translations[0]
    expected = [
        plain_rigid.least_square(*each, *pose) for each in zip(x, seen, strict=True)
    ]
    assert_allclose(squares[:10], expected[:10], rtol=0.05)
    assert (squares[:10] > 1e4 * squares[10:].max()).all()


@pytest.mark.parametrize("direction", [(0, 0, 1.0), (0, 0, -1.0), (-1.0, 0, 0)])
def test_what_is_fitted_is_before_the_camera(direction):
    x, _ = scene(np.random.RandomState(8), direction=direction)
    seen, weights = np.ones((1, *x.shape[:2]), dtype=bool), np.ones((1, len(x)))
    poses = fit_rigid_motions(x[None], seen, weights, np.array([1e-5]), REFERENCE)
    assert (inverse_depths(x, seen[0], poses)[0] > 0).all()


def test_no_motion_explains_one_half_before_the_camera_and_one_behind():
    x, _ = scene(np.random.RandomState(8), n=40, direction=(0.5, 0.2, 1.0))
    x[::2] = mirrored(x[::2], REFERENCE)
    seen, weights = np.ones((1, *x.shape[:2]), dtype=bool), np.ones((1, len(x)))
    poses = fit_rigid_motions(x[None], seen, weights, np.array([1e-4]), REFERENCE)
    (squares,) = squared_residuals(x, seen[0], poses)
    halves = [deviation(half, seen[0, ::2]) for half in (squares[::2], squares[1::2])]
    assert max(halves) > 20e-4


def test_far_tracks_do_not_mirror_a_motion():
    """A rotation that is missing may place all of them behind the camera."""
    rng = np.random.RandomState(9)
    rays = np.column_stack([rng.uniform(-0.5, 0.5, (40, 2)), np.ones(40)])
    depths = np.where(np.arange(40) < 28, 0.01, 1.0)
    time = np.arange(N_FRAMES) - REFERENCE
    translations = 0.05 * time[:, None] * [1.0, 0, 0]
    turns = 0.001 * time[:, None] * [0, 1.0, 0]
    points = np.einsum("lij,nj->nli", rotations_of(turns), rays)
    points += depths[:, None, None] * translations
    x = points[..., :2] / points[..., 2:]
    x += 3e-4 * rng.standard_normal(x.shape)
    seen, weights = np.ones((1, *x.shape[:2]), dtype=bool), np.ones((1, len(x)))
    for sign in (-1, 1):
        wrong = rotations_of(turns + sign * turns)[None]
        poses, _ = refine_rigid_motions(
            x[None],
            seen,
            weights,
            np.array([1e-4]),
            REFERENCE,
            Poses(wrong, translations[None]),
        )
        (squares,) = squared_residuals(x, seen[0], poses)
        assert deviation(squares[28:], seen[0, 28:]) < 5e-4


def test_gaps_and_outliers_leave_the_others_fitted():
    rng = np.random.RandomState(2)
    x, _ = scene(rng, n=40)
    seen = rng.random(x.shape[:2]) > 0.2
    seen[:, REFERENCE] = True
    wrong = np.arange(8)
    x[wrong] += 0.02 * rng.standard_normal(x[wrong].shape)
    filled = np.where(seen[..., None], x, 0)
    poses = fit_rigid_motions(
        filled[None], seen[None], np.ones((1, len(x))), np.array([1e-5]), REFERENCE
    )
    squares = squared_residuals(filled, seen, poses)[0]
    assert deviation(squares[8:], seen[8:]) < 1.5e-4
    assert deviation(squares[:8], seen[:8]) > 1e-3


def test_problems_of_a_batch_are_those_of_one():
    rng = np.random.RandomState(3)
    tracks = [scene(rng, n=25)[0] for _ in range(3)]
    x = np.stack(tracks)
    seen, weights = np.ones(x.shape[:3], dtype=bool), np.ones(x.shape[:2])
    together = fit_rigid_motions(x, seen, weights, np.full(3, 1e-5), REFERENCE)
    for k in range(3):
        one = slice(k, k + 1)
        alone = fit_rigid_motions(
            x[one], seen[one], weights[one], np.full(1, 1e-5), REFERENCE
        )
        assert_allclose(together.rotations[one], alone.rotations, atol=1e-9)
        assert_allclose(together.translations[one], alone.translations, atol=1e-9)


def test_refining_true_poses_costs_no_more_than_fitting():
    rng = np.random.RandomState(4)
    x, truth = scene(rng)
    seen, weights = np.ones((1, *x.shape[:2]), dtype=bool), np.ones((1, len(x)))
    floor = np.array([1e-5])
    refined, cost = refine_rigid_motions(
        x[None], seen, weights, floor, REFERENCE, truth
    )
    _, again = refine_rigid_motions(x[None], seen, weights, floor, REFERENCE, refined)
    assert again <= cost + 1e-9
    assert_allclose(refined.rotations, truth.rotations, atol=2e-3)


def test_residuals_are_those_of_a_general_solver():
    rng = np.random.RandomState(5)
    x, truth = scene(rng, n=12, noise=2e-3)
    seen = rng.random(x.shape[:2]) > 0.2
    seen[:, :4] = True
    x = np.where(seen[..., None], x, 0)
    squares = squared_residuals(x, seen, truth)[0]
    rotations, translations = truth.rotations[0], truth.translations[0]
    for track, found in enumerate(squares):

        def residuals(point, track=track):
            p = rotations @ [point[0], point[1], 1] + point[2] * translations
            error = p[:, :2] / p[:, 2:] - x[track]
            return error[seen[track]].ravel()

        start = [*x[track, REFERENCE], 0.6]
        assert_allclose(found, 2 * least_squares(residuals, start).cost, rtol=1e-3)


def test_tracks_at_rest_and_tracks_that_coincide_have_a_motion():
    for x in (np.zeros((1, 9, N_FRAMES, 2)), np.full((1, 9, N_FRAMES, 2), 0.3)):
        seen = np.ones(x.shape[:3], dtype=bool)
        poses = fit_rigid_motions(x, seen, np.ones((1, 9)), np.array([1e-4]), REFERENCE)
        assert np.isfinite(poses.rotations).all()
        assert squared_residuals(x[0], seen[0], poses).max() < 1e-8


@pytest.fixture
def mixed_batch():
    """Problems of several sizes and reference frames, with gaps and an outlier."""
    rng = np.random.RandomState(6)
    sizes, references = (7, 12, 20), (0, 2, 5)
    x = np.zeros((3, max(sizes), N_FRAMES, 2))
    seen = np.zeros(x.shape[:3], dtype=bool)
    weights = np.zeros(x.shape[:2])
    directions = ((0, 0, 1.0), (1.0, 0.2, 0), (0.5, -0.7, 0.3))
    for k, (n, reference) in enumerate(zip(sizes, references, strict=True)):
        there = rng.random((n, N_FRAMES)) > 0.15
        there[:, reference] = True
        found, _ = scene(rng, n, noise=1e-3, direction=directions[k])
        found[0] += 0.02 * rng.standard_normal(found[0].shape)
        found[1:3] = mirrored(found[1:3], reference)
        x[k, :n] = np.where(there[..., None], found, 0)
        seen[k, :n], weights[k, :n] = there, 1
    return x, seen, weights, np.full(3, 2e-4), np.array(references), sizes


def test_a_batch_agrees_with_problems_that_are_solved_one_by_one(mixed_batch):
    x, seen, weights, floor, references, sizes = mixed_batch
    together = fit_rigid_motions(x, seen, weights, floor, references)
    for k, n in enumerate(sizes):
        R, t = plain_rigid.fit(x[k, :n], seen[k, :n], floor[k], references[k])
        assert_allclose(together.rotations[k], R, atol=1e-8)
        assert_allclose(together.translations[k], t, atol=1e-8)
        poses = Poses(R[None], t[None])
        (squares,) = squared_residuals(x[k, :n], seen[k, :n], poses)
        plain = [
            plain_rigid.squared_residual(*each, R, t)
            for each in zip(x[k, :n], seen[k, :n], strict=True)
        ]
        assert_allclose(squares, plain, rtol=1e-5, atol=1e-14)


def test_residuals_do_not_depend_on_how_many_are_found_at_a_time(
    mixed_batch, monkeypatch
):
    x, seen, weights, floor, references, _ = mixed_batch
    poses = fit_rigid_motions(x, seen, weights, floor, references)
    at_once = squared_residuals(x[2], seen[2], poses)
    monkeypatch.setattr(rigid_motion, "SIZE_OF_BLOCK", 9)
    assert_allclose(squared_residuals(x[2], seen[2], poses), at_once, rtol=1e-9)


def test_a_start_found_by_some_tracks_is_fitted_to_all():
    rng = np.random.RandomState(6)
    tracks = [scene(rng, n=90)[0] for _ in range(2)]
    x = np.stack(tracks)
    seen, weights = np.ones(x.shape[:3], dtype=bool), np.ones(x.shape[:2])
    weights[0, ::2] = 0  # those that do not count are none of the forty
    problem = x, seen, weights, np.full(2, 1e-5), REFERENCE
    by_all = fit_rigid_motions(*problem)
    by_some = fit_rigid_motions(*problem, most_started=40)
    for k in range(2):
        expected, found = (
            squared_residuals(
                x[k], seen[k], Poses(*(each[k : k + 1] for each in poses))
            )
            for poses in (by_all, by_some)
        )
        counted = weights[k] > 0
        assert_allclose(found[0, counted].sum(), expected[0, counted].sum(), rtol=1e-3)
