"""Random minimal sets, the models through them, and the residuals to those."""

from __future__ import annotations

import dataclasses
from itertools import combinations

import numpy as np
import pytest
from helpers import textbook
from helpers.minimal_sets import fit_minimal_sets
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.utils import check_random_state

from skmotionseg._core.geometry import hypotheses
from skmotionseg._core.geometry.hypotheses import (
    draw_hypotheses,
    draw_minimal_sets,
    of_others,
    residual_blocks,
    residual_matrix,
)
from skmotionseg._core.geometry.motion_models import MOTION_MODELS
from skmotionseg._core.geometry.tracks import (
    frame_pairs,
    unpack_tracks,
    working_coordinates,
)
from skmotionseg.datasets import make_rigid_motions

AFFINE, HOMOGRAPHY, FUNDAMENTAL = MODELS = list(MOTION_MODELS.values())
FIRST_PAIR = np.array([[0, 1]])

every_model = pytest.mark.parametrize("model", MODELS, ids=lambda m: m.name)
every_map = pytest.mark.parametrize("model", MODELS[:2], ids=lambda m: m.name)


def tracks(n_tracks=40, n_frames=4, **scene):
    """Points, visibility and frame pairs of a synthetic scene."""
    scene = {"n_motions": 2, "missing": 0.2, "random_state": 0} | scene
    X, _ = make_rigid_motions(n_tracks=n_tracks, n_frames=n_frames, **scene)
    return *unpack_tracks(X), frame_pairs(n_frames)


def rigid_motion(shape="general", camera="general"):
    """One motion, all of it seen, without noise."""
    return tracks(
        n_frames=3, n_motions=1, shapes=shape, camera=camera, missing=0, noise=0
    )


def two_frames(x, y):
    """Tracks of two frames, all seen."""
    points = np.stack([x, y], axis=1).astype(float)
    return points, np.ones(points.shape[:2], dtype=bool), FIRST_PAIR


def line(n, shift=(0.0, 0.0)):
    """Points (n, 2) on one line."""
    steps = np.arange(n)
    return np.column_stack([10 + 7 * steps, 300 - 4 * steps]) + shift


def draw(scene, model, n_hypotheses=20, seed=0):
    return drawn(scene, model, n_hypotheses, seed)[0]


def drawn(scene, model, n_hypotheses=20, seed=0):
    """Hypotheses, and their minimal sets."""
    return draw_hypotheses(*scene, model, n_hypotheses, check_random_state(seed))


def residuals_of(scene, found, model):
    """Residuals in pixels, in the working coordinates that the sampler takes."""
    return residual_matrix(*scene, found, model, *working_coordinates(*scene[:2]))


# --------------------------------------------------------------------- minimal sets


@pytest.mark.parametrize("size", [1, 3, 4, 8])
def test_the_points_of_a_set_are_distinct_and_in_range(size):
    n_available = np.repeat([size, size + 1, 20, 500], 200)
    sets = draw_minimal_sets(n_available, size, check_random_state(0))
    assert sets.shape == (800, size)
    assert sets.min() >= 0
    assert (sets < n_available[:, None]).all()
    assert all(len(set(s)) == size for s in sets.tolist())


def test_a_set_of_all_points_is_all_points():
    sets = draw_minimal_sets(np.full(50, 8), 8, check_random_state(0))
    assert_array_equal(np.sort(sets, axis=1), np.tile(np.arange(8), (50, 1)))


def test_all_sets_are_equally_likely():
    sets = draw_minimal_sets(np.full(40_000, 6), 3, check_random_state(0))
    drawn, counts = np.unique(np.sort(sets, axis=1), axis=0, return_counts=True)
    assert_array_equal(drawn, list(combinations(range(6), 3)))
    five_sigma = 5 * np.sqrt(40_000 / 20 * 19 / 20)
    assert np.abs(counts - 40_000 / 20).max() < five_sigma


def test_a_seed_gives_its_sets():
    n_available = np.full(30, 50)
    once, again, other = (
        draw_minimal_sets(n_available, 4, check_random_state(seed))
        for seed in (0, 0, 1)
    )
    assert_array_equal(once, again)
    assert (once != other).any()


# ----------------------------------------------------------------------- hypotheses


def assert_same_models(actual, expected, rtol):
    """Equal but for scale and sign, each entry to its own magnitude."""
    assert np.isfinite(actual).all()
    largest = np.abs(expected).argmax()
    factor = expected.flat[largest] / actual.flat[largest]
    assert_allclose(factor * actual, expected, rtol=rtol)


@every_model
def test_hypotheses_equal_the_textbook(model):
    """Of the same sets of tracks, in pixels."""
    points, visibility, pairs = scene = tracks()
    seen = visibility[:, pairs].all(axis=2)
    sizes = np.repeat(seen.sum(axis=0), 5)
    sets = draw_minimal_sets(sizes, model.minimal_size, check_random_state(0))
    found = draw(scene, model, n_hypotheses=5).reshape(-1, 3, 3)
    for b, chosen in enumerate(sets):
        pair = b // 5
        x, y = points[seen[:, pair]][:, pairs[pair]].transpose(1, 0, 2)
        expected = textbook.hypothesis(model.name, x, y, chosen)
        assert_same_models(found[b], expected, rtol=1e-4)


@every_model
def test_minimal_sets_that_are_given_are_those_that_are_fitted(model):
    """By the positions of tracks, whichever of them a pair does not see."""
    _, visibility, pairs = scene = tracks()
    seen = visibility[:, pairs].all(axis=2)
    sizes = np.repeat(seen.sum(axis=0), 5)
    sets = draw_minimal_sets(sizes, model.minimal_size, check_random_state(0))
    sets = sets.reshape(len(pairs), 5, -1)
    of_tracks = [np.flatnonzero(seen[:, p])[sets[p]] for p in range(len(pairs))]
    found = fit_minimal_sets(*scene, model, np.stack(of_tracks))
    hypotheses, their_sets = drawn(scene, model, n_hypotheses=5)
    assert_array_equal(found, hypotheses)
    assert_array_equal(of_tracks, their_sets)


@every_model
def test_degenerate_sets_that_are_given_are_nan(model):
    points, _, pairs = scene = rigid_motion()
    points[1] = points[0]  # the same track twice
    sets = np.tile(np.arange(model.minimal_size), (len(pairs), 2, 1))
    sets[:, 1] += 1
    found = fit_minimal_sets(*scene, model, sets)
    assert np.isnan(found[:, 0]).all()
    assert np.isfinite(found[:, 1]).all()


@every_model
def test_hypotheses_of_one_motion_explain_all_its_tracks(model):
    shape = {"affine": "planar"}.get(model.name, "general")
    camera = "general" if model is FUNDAMENTAL else "rotation"
    if model is AFFINE:  # the scene itself, sheared
        x = rigid_motion(shape)[0][:, 0]
        scene = two_frames(x, x @ np.array([[1.1, 0.2], [-0.1, 0.9]]) + [20, -4])
    else:
        scene = rigid_motion(shape, camera)
    found = draw(scene, model)
    for p, (f, g) in enumerate(scene[2]):
        x, y = scene[0][:, f], scene[0][:, g]
        assert_allclose(model.residuals(found[p], x, y), 0, atol=1e-9)


@every_model
def test_hypotheses_come_pair_by_pair(model):
    found = draw(tracks(), model, n_hypotheses=7)
    assert found.shape == (3, 7, 3, 3)
    assert found.dtype == np.float64
    assert np.isfinite(found).all()


def test_fundamental_hypotheses_keep_rank_two_in_pixels():
    found = draw(tracks(), FUNDAMENTAL).reshape(-1, 3, 3)
    singular = np.linalg.svd(found, compute_uv=False)
    assert (singular[:, 2] < 1e-14 * singular[:, 0]).all()
    assert (singular[:, 1] > 1e-12 * singular[:, 0]).all()


@every_model
def test_a_seed_gives_its_hypotheses(model):
    once, again, other = (draw(tracks(), model, seed=seed) for seed in (0, 0, 1))
    assert_array_equal(once, again)
    assert (once != other).any()


@every_model
def test_tracks_that_a_pair_does_not_see_have_no_part_in_it(model):
    points, visibility, pairs = tracks()
    visibility[:10, 1] = False
    expected = draw((points, visibility, pairs), model)
    points[:10, 1] = 1e6
    assert_array_equal(draw((points, visibility, pairs), model), expected)
    without = points[10:], visibility[10:], pairs[:2]
    assert_array_equal(draw(without, model), expected[:2])


@every_model
def test_a_pair_with_too_few_tracks_has_no_hypotheses(model):
    points, visibility, pairs = tracks(missing=0)
    visibility[model.minimal_size - 1 :, 1] = False  # pairs 0 and 1
    found = draw((points, visibility, pairs), model)
    assert np.isnan(found[:2]).all()
    assert np.isfinite(found[2]).all()


@every_model
def test_no_pair_with_enough_tracks_gives_nan_throughout(model):
    points, visibility, pairs = tracks(n_tracks=model.minimal_size - 1, n_motions=1)
    found = draw((points, visibility, pairs), model)
    assert found.shape == (3, 20, 3, 3)
    assert np.isnan(found).all()


@every_model
def test_a_pair_with_just_enough_tracks_has_one_hypothesis(model):
    scene = tracks(n_tracks=model.minimal_size, n_motions=1, missing=0)
    found = draw(scene, model)
    for pair in found:
        for other in pair[1:]:
            assert_same_models(other, pair[0], rtol=1e-4)


@every_map
def test_a_still_camera_gives_identities(model):
    found = draw(rigid_motion(camera="still"), model)
    found /= found[..., 2:, 2:]
    assert_allclose(found, np.broadcast_to(np.eye(3), found.shape), atol=1e-6)


def test_a_still_camera_gives_epipolar_geometries_that_its_points_obey():
    scene = rigid_motion(camera="still")
    found = draw(scene, FUNDAMENTAL)
    assert np.isfinite(found).all()
    assert_allclose(residuals_of(scene, found, FUNDAMENTAL), 0, atol=1e-6)


# ------------------------------------------------------------ degenerate minimal sets


def mostly_on_a_line():
    """24 of 30 tracks on a line: most sets of three or four have three of them."""
    x, y = np.random.default_rng(0).uniform(0, 500, size=(2, 30, 2))
    x[:24] = line(24)
    return two_frames(x, y)


@every_model
def test_degenerate_sets_are_drawn_again(model):
    found = draw(mostly_on_a_line(), model, n_hypotheses=40)[0]
    assert np.isfinite(found).all()
    assert len(np.unique(found, axis=0)) >= 38  # hardly one stands in for another


@every_model
def test_sets_that_stay_degenerate_take_the_model_of_another(model, monkeypatch):
    redrawn = np.unique(draw(mostly_on_a_line(), model, n_hypotheses=200)[0], axis=0)
    monkeypatch.setattr(hypotheses, "MAX_REDRAWS", 0)
    found = draw(mostly_on_a_line(), model, n_hypotheses=200)[0]
    assert np.isfinite(found).all()
    assert 1 < len(np.unique(found, axis=0)) < 0.95 * len(redrawn)


@every_map
def test_a_pair_of_collinear_tracks_gets_their_translations(model):
    """Two groups on a line, each with a translation of its own."""
    x = line(12)
    shifts = np.repeat([[3.0, 1.0], [30.0, 60.0]], 6, axis=0)
    found = draw(two_frames(x, x + shifts), model, n_hypotheses=50)[0]
    linear, shift = found[:, :2, :2], found[:, :2, 2]
    assert_allclose(found[:, 2], np.tile([0, 0, 1], (50, 1)))
    assert_allclose(linear, np.tile(np.eye(2), (50, 1, 1)), atol=1e-9)
    assert_allclose(np.unique(shift.round(6), axis=0), np.unique(shifts, axis=0))


def test_collinear_tracks_get_the_epipolar_geometries_of_their_translations():
    x = line(12)
    shifts = np.repeat([[3.0, 1.0], [30.0, 60.0]], 6, axis=0)
    scene = two_frames(x, x + shifts)
    found = draw(scene, FUNDAMENTAL, n_hypotheses=50)
    r = residuals_of(scene, found, FUNDAMENTAL)
    for group in (r[:6], r[6:]):  # a hypothesis explains all of one group
        assert_array_equal(group < 1e-6, np.tile(group[0] < 1e-6, (6, 1)))
    assert_array_equal(r[0] < 1e-6, r[6] > 1e-3)


@every_model
def test_a_translation_of_collinear_tracks_is_found_exactly(model):
    scene = two_frames(line(12), line(12, shift=(-5, 2)))
    found = draw(scene, model)
    assert np.isfinite(found).all()
    assert_allclose(residuals_of(scene, found, model), 0, atol=1e-9)


@every_model
@pytest.mark.parametrize("spot", [(100.0, 50.0), (0.1, 0.2), (1e3 / 3, 7.7)])
def test_tracks_in_one_spot_get_its_translation(model, spot):
    """The mean of equal numbers is not always that number."""
    x, shift = np.tile(spot, (9, 1)), np.array([2, 3])
    found = draw(two_frames(x, x + shift), model)
    elsewhere = np.random.default_rng(0).uniform(0, 400, size=(9, 2))
    scene = two_frames(elsewhere, elsewhere + shift)
    assert_allclose(residuals_of(scene, found, model), 0, atol=1e-6)


@every_model
def test_hypotheses_are_those_of_their_minimal_sets(model):
    """Also where sets were drawn again; there is none where there are few tracks."""
    points, visibility, pairs = tracks()
    points[:20], visibility[:20] = points[20:], visibility[20:]  # sets may have twins
    visibility[model.minimal_size - 1 :, 0] = False
    scene = points, visibility, pairs
    found, sets = drawn(scene, model, n_hypotheses=30)
    assert (sets[0] == -1).all()
    some = points, visibility, pairs[1:]
    assert_array_equal(fit_minimal_sets(*some, model, sets[1:]), found[1:])


@every_model
def test_a_hypothesis_that_stands_in_for_another_has_its_own_set(model, monkeypatch):
    monkeypatch.setattr(hypotheses, "MAX_REDRAWS", 0)
    scene = mostly_on_a_line()
    found, sets = drawn(scene, model, n_hypotheses=200)
    assert_array_equal(fit_minimal_sets(*scene, model, sets), found)


@every_model
def test_the_set_of_a_translation_is_its_track(model):
    x = line(12)
    scene = two_frames(x, x + np.arange(12)[:, None] ** 2)
    found, sets = drawn(scene, model)
    assert (sets == sets[..., :1]).all()
    own = residuals_of(scene, found, model)[sets[0, :, 0], np.arange(20)]
    assert_allclose(own, 0, atol=1e-6)


# ------------------------------------------------------------------------- residuals


@every_model
def test_residuals_to_hypotheses_of_others_are_infinite_at_their_own(model):
    """And at copies of these; not where a pair sees a handful of tracks."""
    points, visibility, pairs = scene = tracks(n_tracks=30)
    points[0], visibility[0] = points[1], visibility[1]
    visibility[hypotheses.FEWEST_OTHERS - 1 :, 0] = False
    found, sets = drawn(scene, model)
    blocks = residual_blocks(*scene, found, model, *working_coordinates(*scene[:2]))
    expected = residuals_of(scene, found, model).reshape(len(points), len(pairs), -1)
    for p, (rows, residuals) in enumerate(of_others(blocks, sets, points, pairs)):
        assert len(rows) > 0
        for row, of_track in zip(rows, residuals, strict=True):
            itself = {0, 1} if row < 2 else {row}
            own = np.array([bool(itself & set(tracks)) for tracks in sets[p].tolist()])
            assert_array_equal(of_track == np.inf, own & (p > 0))
            assert_array_equal(of_track[~own], expected[row, p][~own])


@every_model
def test_residuals_equal_the_textbook_to_single_precision(model):
    points, visibility, pairs = scene = tracks()
    found = draw(scene, model, n_hypotheses=10)
    r = residuals_of(scene, found, model).reshape(len(points), len(pairs), 10)
    for p, (f, g) in enumerate(pairs):
        seen = visibility[:, f] & visibility[:, g]
        expected = textbook.residuals(
            model.name, found[p], points[seen, f], points[seen, g]
        )
        # The distance is rounded at the size of the image, 1e3 pixels.
        assert_allclose(np.sqrt(r[seen, p]), np.sqrt(expected), rtol=1e-4, atol=2e-3)


@every_model
def test_residuals_are_nan_just_where_a_track_is_unseen(model):
    points, visibility, pairs = scene = tracks()
    points[~visibility] = 7.0  # whatever a tracker leaves behind
    r = residuals_of(scene, draw(scene, model, n_hypotheses=6), model)
    assert r.dtype == np.float32
    assert r.shape == (len(points), len(pairs) * 6)
    seen = visibility[:, pairs].all(axis=2)
    assert 0 < seen.sum() < seen.size
    assert_array_equal(np.isfinite(r), np.repeat(seen, 6, axis=1))


@every_model
def test_columns_are_pair_major(model):
    points, visibility, pairs = scene = tracks(missing=0)
    found = draw(scene, model, n_hypotheses=6)
    whole = residuals_of(scene, found, model)
    centres, scale = working_coordinates(points, visibility)
    for p in range(len(pairs)):
        alone = residual_matrix(
            points, visibility, pairs[[p]], found[[p]], model, centres, scale
        )
        assert_array_equal(whole[:, 6 * p : 6 * (p + 1)], alone)


@every_model
def test_a_pair_without_hypotheses_has_no_residuals(model):
    points, visibility, pairs = scene = tracks(missing=0)
    found = draw(scene, model)
    found[1] = np.nan
    r = residuals_of((points, visibility, pairs), found, model)
    r = r.reshape(len(points), len(pairs), -1)
    assert np.isnan(r[:, 1]).all()
    assert np.isfinite(r[:, [0, 2]]).all()


def test_residuals_are_squared_pixels():
    """6 pixels off a translation are 3 in each frame: 9 + 9."""
    x = np.random.default_rng(0).uniform(0, 1000, size=(20, 2))
    scene = two_frames(x, x + np.array([6, 0]))
    still = np.eye(3)[None, None]
    assert_allclose(residuals_of(scene, still, AFFINE), 18, rtol=1e-4)
    assert_allclose(residuals_of(scene, still, HOMOGRAPHY), 18, rtol=1e-4)
    upwards = FUNDAMENTAL.from_translation(np.array([[[0.0, 1.0]]]))
    assert_allclose(residuals_of(scene, upwards, FUNDAMENTAL), 18, rtol=1e-4)


@every_model
@pytest.mark.parametrize("scale", [30.0, 900.0])
def test_working_coordinates_do_not_show(model, scale):
    scene = tracks()
    found = draw(scene, model)
    centres = np.full((4, 2), 500.0)
    other = residual_matrix(*scene, found, model, centres, scale)
    expected = residuals_of(scene, found, model)
    assert_allclose(np.sqrt(other), np.sqrt(expected), rtol=1e-3, atol=0.05)


@every_model
def test_the_residuals_of_a_track_do_not_depend_on_its_company(model):
    points, visibility, pairs = scene = tracks(n_tracks=150)
    found = draw(scene, model)
    centres, scale = working_coordinates(points, visibility)
    whole = residual_matrix(*scene, found, model, centres, scale)
    for rows in ([0], [149, 3, 77], np.arange(70)):
        few = residual_matrix(
            points[rows], visibility[rows], pairs, found, model, centres, scale
        )
        assert_array_equal(few, whole[rows])


@every_model
def test_errors_as_large_as_single_precision_has_them_stay_finite(model):
    """In pixels, where an image of working size 1 is ten thousand wide."""
    points, visibility, pairs = tracks(n_frames=2)
    found = draw((points, visibility, pairs), model)

    def huge(models, x, y):
        return np.full((*x.shape[:-1], len(models)), 3e38, dtype=np.float32)

    model = dataclasses.replace(model, residuals=huge)
    centres = np.zeros((2, 2))
    R = residual_matrix(points, visibility, pairs, found, model, centres, 1e4)
    seen = visibility.all(axis=1)
    assert np.isfinite(R[seen]).all()
    assert (R[seen] > 1e38).all()


@every_model
@pytest.mark.parametrize("far", [1e6, 1e9, 1e12])
def test_points_far_outside_the_image_have_large_finite_residuals(model, far):
    points, visibility, pairs = tracks(n_tracks=80, n_frames=2)
    found = draw((points, visibility, pairs), model)
    centres, scale = working_coordinates(points, visibility)
    visibility[:3] = True
    points[:3] = far * np.array(
        [[[1, 2], [-3, 1]], [[0, 1], [1, 0]], [[2, 2], [-1, 0]]]
    )
    R = residual_matrix(points, visibility, pairs, found, model, centres, scale)
    assert np.isfinite(R[visibility.all(axis=1)]).all()
    assert np.median(R[:3], axis=1).min() > 1e3
