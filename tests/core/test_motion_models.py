"""Minimal fits and Sampson errors: theorems, the textbook, and scikit-image."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from helpers import textbook
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg import MotionModel
from skmotionseg._core.geometry.motion_models import MOTION_MODELS, null_vectors
from skmotionseg.datasets import make_rigid_motions

MODELS = list(MOTION_MODELS.values())
MAPS = [MOTION_MODELS["affine"], MOTION_MODELS["homography"]]
AFFINE, HOMOGRAPHY, FUNDAMENTAL = MODELS

every_model = pytest.mark.parametrize("model", MODELS, ids=lambda m: m.name)
every_map = pytest.mark.parametrize("model", MAPS, ids=lambda m: m.name)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def random_sets(rng, size, n_sets=60):
    """Correspondences (n_sets, size, 2) that no motion links."""
    return rng.normal(size=(2, n_sets, size, 2))


def normalized_views(shape="general", camera="general", n_tracks=60):
    """One rigid motion without noise in two normalised frames, (n_tracks, 2) each."""
    X, _ = make_rigid_motions(
        n_tracks=n_tracks,
        n_frames=10,
        n_motions=1,
        shapes=shape,
        camera=camera,
        missing=0,
        noise=0,
        random_state=0,
    )
    return [move(textbook.normalization(x), x) for x in (X[:, :2], X[:, -2:])]


def exact_motion(model):
    """Correspondences that the model explains without error."""
    if model.name == "affine":
        x, _ = normalized_views()
        return x, x @ np.array([[1.1, -0.3], [0.2, 0.8]]) + [0.4, -0.1]
    if model.name == "homography":
        return normalized_views("planar")
    return normalized_views()


def fit_exact(model):
    """Its points, and the model through the first few of them."""
    x, y = exact_motion(model)
    return x, y, model.fit(x[: model.minimal_size], y[: model.minimal_size])


def assert_same_models(actual, expected, atol):
    """Equal but for scale and sign, entries compared at unit Frobenius norm."""
    assert np.isfinite(actual).all()
    actual, expected = (
        M / np.linalg.norm(M, axis=(-2, -1), keepdims=True) for M in (actual, expected)
    )
    signs = np.sign(np.sum(actual * expected, axis=(-2, -1), keepdims=True))
    assert_allclose(signs * actual, expected, atol=atol)


def similarity(scale, angle, shift):
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    return np.array([[c, -s, shift[0]], [s, c, shift[1]], [0, 0, 1.0]])


def move(T, points):
    return points @ T[:2, :2].T + T[:2, 2]


# ---------------------------------------------------------------- minimal fits


@every_map
def test_a_map_goes_through_its_minimal_set(model, rng):
    x, y = random_sets(rng, model.minimal_size)
    fitted = model.fit(x, y)
    for M, a, b in zip(fitted, x, y, strict=True):
        mapped = [textbook.transform(M, point) for point in a]
        assert_allclose(mapped, b, atol=1e-7)


@every_model
def test_eight_or_fewer_points_of_a_motion_explain_all_of_it(model):
    x, y, M = fit_exact(model)
    assert_allclose(model.residuals(M[None], x, y), 0, atol=1e-18)


@every_model
def test_fits_equal_the_textbook(model, rng):
    x, y = random_sets(rng, model.minimal_size)
    expected = [textbook.FITS[model.name](a, b) for a, b in zip(x, y, strict=True)]
    assert_same_models(model.fit(x, y), np.array(expected), atol=1e-9)


@every_model
def test_the_order_of_a_minimal_set_does_not_matter(model, rng):
    x, y = random_sets(rng, model.minimal_size)
    backwards = model.fit(x[:, ::-1], y[:, ::-1])
    assert_same_models(backwards, model.fit(x, y), atol=1e-9)


@every_model
def test_fits_keep_the_shape_of_the_stack(model, rng):
    x, y = random_sets(rng, model.minimal_size, n_sets=6)
    flat = model.fit(x, y)
    stacked = model.fit(x.reshape(2, 3, *x.shape[1:]), y.reshape(2, 3, *y.shape[1:]))
    assert stacked.shape == (2, 3, 3, 3)
    assert_array_equal(stacked.reshape(6, 3, 3), flat)
    assert model.fit(x[0], y[0]).shape == (3, 3)


@every_model
def test_fitting_leaves_the_points_alone(model, rng):
    x, y = random_sets(rng, model.minimal_size)
    before = x.copy(), y.copy()
    model.fit(x, y)
    assert_array_equal((x, y), before)


def test_the_last_row_of_an_affine_map_is_exact(rng):
    A = AFFINE.fit(*random_sets(rng, 3))
    assert_array_equal(A[:, 2], np.tile([0, 0, 1], (len(A), 1)))


@pytest.mark.parametrize("model", [HOMOGRAPHY, FUNDAMENTAL], ids=lambda m: m.name)
def test_projective_models_have_unit_norm(model, rng):
    M = model.fit(*random_sets(rng, model.minimal_size))
    assert_allclose(np.linalg.norm(M, axis=(1, 2)), 1)


def test_fundamental_matrices_have_rank_two(rng):
    F = FUNDAMENTAL.fit(*random_sets(rng, 8))
    singular = np.linalg.svd(F, compute_uv=False)
    assert singular[:, 2].max() < 1e-15
    assert singular[:, 1].min() > 1e-3


def test_the_fundamental_matrix_of_known_cameras_is_found(rng):
    """``F = [t]_x R`` for calibrated cameras ``[I 0]`` and ``[R t]`` (HZ, 9.12)."""
    R = similarity(1, 0.2, (0, 0))
    t = np.array([0.3, -0.1, 0.2])
    world = rng.uniform([-1, -1, 3], [1, 1, 5], size=(8, 3))
    moved = world @ R.T + t
    F = FUNDAMENTAL.fit(world[:, :2] / world[:, 2:], moved[:, :2] / moved[:, 2:])
    t_cross = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
    assert_same_models(F, t_cross @ R, atol=1e-10)


# ------------------------------------------------------------ degenerate minimal sets


def put_on_a_line(points, which):
    """The points named by ``which`` on one line, the others where they were."""
    points = points.copy()
    points[which, 1] = 2 * points[which, 0] - 1
    return points


@pytest.mark.parametrize("frame", [0, 1])
@every_model
def test_collinear_sets_are_nan_and_spoil_no_other(model, frame, rng):
    sets = random_sets(rng, model.minimal_size, n_sets=3)
    sound = model.fit(*sets)
    n_collinear = 8 if model is FUNDAMENTAL else 3
    sets[frame, 1] = put_on_a_line(sets[frame, 1], slice(0, n_collinear))
    fitted = model.fit(*sets)
    assert np.isnan(fitted[1]).all()
    assert_array_equal(fitted[[0, 2]], sound[[0, 2]])


@pytest.mark.parametrize("left_out", range(4))
def test_any_three_collinear_points_spoil_a_homography(left_out, rng):
    x, y = random_sets(rng, 4, n_sets=1)
    x[0] = put_on_a_line(x[0], np.delete(np.arange(4), left_out))
    assert np.isnan(HOMOGRAPHY.fit(x, y)).all()


@every_model
def test_a_correspondence_that_is_there_twice_is_degenerate(model, rng):
    x, y = random_sets(rng, model.minimal_size, n_sets=1)
    x[:, -1], y[:, -1] = x[:, 0], y[:, 0]
    assert np.isnan(model.fit(x, y)).all()


def test_seven_points_on_a_line_still_determine_a_fundamental_matrix(rng):
    x, y = random_sets(rng, 8, n_sets=1)
    x[0] = put_on_a_line(x[0], slice(0, 7))
    assert np.isfinite(FUNDAMENTAL.fit(x, y)).all()


@pytest.mark.parametrize(
    ("shape", "camera"),
    [("planar", "general"), ("general", "rotation"), ("general", "still")],
)
def test_eight_points_of_a_homography_give_an_f_that_all_its_points_obey(shape, camera):
    """Any null vector of such a set is ``[e]_x H``, of rank 2 by itself."""
    x, y = normalized_views(shape, camera)
    F = FUNDAMENTAL.fit(x[:8], y[:8])
    assert_allclose(FUNDAMENTAL.residuals(F[None], x, y), 0, atol=1e-16)
    assert np.linalg.svd(F, compute_uv=False)[1] > 1e-6


def test_a_still_camera_gives_the_identity():
    x, y = normalized_views(camera="still")
    for model in MAPS:
        M = model.fit(x[: model.minimal_size], y[: model.minimal_size])
        assert_allclose(M / M[2, 2], np.eye(3), atol=1e-10)


# --------------------------------------------------------------------- null vectors


def rank_deficient(rng):
    A = rng.normal(size=(20, 8, 9))
    A[:, 5:] = A[:, :3] + A[:, 3:4]
    return A


def with_zero_rows(rng):
    A = rng.normal(size=(20, 8, 9))
    A[:, [0, 4]] = 0
    return A


@pytest.mark.parametrize(
    "make",
    [
        lambda rng: rng.normal(size=(20, 8, 9)),
        lambda rng: rng.normal(size=(20, 2, 5)),
        lambda rng: np.zeros((20, 3, 4)),
        rank_deficient,
        with_zero_rows,
    ],
    ids=["full rank", "two rows", "zero", "rank deficient", "zero rows"],
)
def test_null_vectors_are_unit_and_orthogonal_to_the_rows(make, rng):
    A = make(rng)
    v = null_vectors(A)
    assert v.shape == (20, A.shape[2])
    assert_allclose(np.linalg.norm(v, axis=1), 1)
    assert_allclose(np.einsum("bmn,bn->bm", A, v), 0, atol=1e-13)


def test_null_vectors_of_full_rank_are_those_of_the_svd(rng):
    A = rng.normal(size=(20, 8, 9))
    expected = np.linalg.svd(A)[2][:, -1]
    cosine = np.sum(null_vectors(A) * expected, axis=1)
    assert_allclose(np.abs(cosine), 1)


# ------------------------------------------------------------------ Sampson errors


@every_model
def test_residuals_equal_the_textbook(model, rng):
    models = model.fit(*random_sets(rng, model.minimal_size, n_sets=15))
    x, y = rng.normal(size=(2, 12, 2))
    expected = textbook.residuals(model.name, models, x, y)
    assert_allclose(model.residuals(models, x, y), expected, rtol=1e-8, atol=1e-18)


@every_model
def test_single_precision_residuals_are_right_to_rounding(model, rng):
    """Of the distance, not of its square: that is where rounding enters."""
    models = model.fit(*random_sets(rng, model.minimal_size, n_sets=200))
    x, y = rng.normal(size=(2, 30, 2))
    exact = np.sqrt(model.residuals(models, x, y))
    single = model.residuals(*(a.astype(np.float32) for a in (models, x, y)))
    assert single.dtype == np.float32
    error = np.abs(np.sqrt(single) - exact)
    assert np.quantile(error, 0.99) < 2e-6
    assert error.max() < 1e-3


@pytest.mark.parametrize("stretch", [1e2, 1e3, 1e4, 1e5])
def test_affine_maps_that_flatten_the_image_keep_their_residuals(stretch, rng):
    """Three points almost on a line, with a random partner each, give such a map."""
    turned = similarity(1, 0.7, (0, 0))
    A = similarity(1, 0.4, (0.3, -0.2)) @ np.diag([stretch, 0.5, 1]) @ turned
    x, y = rng.normal(size=(2, 40, 2))
    expected = textbook.residuals("affine", [A], x, y)
    single = AFFINE.residuals(*(a.astype(np.float32) for a in (A[None], x, y)))
    assert_allclose(np.sqrt(single), np.sqrt(expected), atol=1e-4 + stretch * 2e-7)


@every_model
def test_residuals_are_finite_for_every_model_that_is_not_nan(model, rng):
    models = model.fit(*random_sets(rng, model.minimal_size, n_sets=20_000))
    models = models[np.isfinite(models[:, 0, 0])].astype(np.float32)
    x, y = rng.normal(size=(2, 5, 2)).astype(np.float32)
    r = model.residuals(models, x, y)
    assert np.isfinite(r).all()
    assert (r >= 0).all()


@pytest.mark.parametrize(("name", "n_equations"), [
    ("affine", 2), ("homography", 2), ("fundamental", 1),
])  # fmt: skip
def test_the_true_model_has_the_noise_as_its_error(name, n_equations, rng):
    """The error is chi-squared, with a degree of freedom for each equation."""
    model, noise = MOTION_MODELS[name], 1e-3
    x, y, M = fit_exact(model)
    x, y = np.tile(x, (500, 1)), np.tile(y, (500, 1))  # 30,000 tracks
    x = x + noise * rng.normal(size=x.shape)
    y = y + noise * rng.normal(size=y.shape)
    r = model.residuals(M[None], x, y) / noise**2
    assert_allclose(r.mean(), n_equations, rtol=0.03)
    assert_allclose(r.var(), 2 * n_equations, rtol=0.1)


def test_the_affine_error_is_the_squared_distance_to_the_nearest_exact_match(rng):
    A = AFFINE.fit(*random_sets(rng, 3, n_sets=1))
    x, y = rng.normal(size=(2, 10, 2))
    linear, shift = A[0, :2, :2], A[0, :2, 2]
    stacked = np.vstack([np.eye(2), linear])  # (x', A x') nearest to (x, y)
    targets = np.hstack([x, y - shift])
    distances = [np.linalg.lstsq(stacked, t, rcond=None)[1][0] for t in targets]
    assert_allclose(AFFINE.residuals(A, x, y)[:, 0], distances)


@pytest.mark.parametrize("model", [HOMOGRAPHY, FUNDAMENTAL], ids=lambda m: m.name)
@pytest.mark.parametrize("factor", [-1, 1e-4, 300])
def test_the_scale_of_a_projective_model_means_nothing(model, factor, rng):
    models = model.fit(*random_sets(rng, model.minimal_size))
    x, y = rng.normal(size=(2, 10, 2))
    expected = model.residuals(models, x, y)
    assert_allclose(model.residuals(factor * models, x, y), expected, rtol=1e-9)


@pytest.mark.parametrize("model", [HOMOGRAPHY, FUNDAMENTAL], ids=lambda m: m.name)
@pytest.mark.parametrize("factor", [2.0**-80, 2.0**80])
def test_models_of_any_scale_have_their_residuals_in_single_precision(
    model, factor, rng
):
    M, x, y = (
        array.astype(np.float32)
        for array in (rng.normal(size=(5, 3, 3)), *rng.normal(size=(2, 9, 2)))
    )
    scaled = M * np.float32(factor)
    assert_array_equal(model.residuals(scaled, x, y), model.residuals(M, x, y))


def test_swapping_the_frames_transposes_a_fundamental_matrix(rng):
    F = FUNDAMENTAL.fit(*random_sets(rng, 8))
    x, y = rng.normal(size=(2, 10, 2))
    swapped = FUNDAMENTAL.residuals(F.transpose(0, 2, 1), y, x)
    assert_allclose(swapped, FUNDAMENTAL.residuals(F, x, y))


def test_swapping_the_frames_inverts_an_affine_map(rng):
    A = AFFINE.fit(*random_sets(rng, 3))
    x, y = rng.normal(size=(2, 10, 2))
    swapped = AFFINE.residuals(np.linalg.inv(A), y, x)
    assert_allclose(swapped, AFFINE.residuals(A, x, y), rtol=1e-6)


def test_swapping_the_frames_inverts_a_homography_to_first_order(rng):
    x, y, H = fit_exact(HOMOGRAPHY)
    y = y + 1e-5 * rng.normal(size=y.shape)
    swapped = HOMOGRAPHY.residuals(np.linalg.inv(H)[None], y, x)
    assert_allclose(swapped, HOMOGRAPHY.residuals(H[None], x, y), rtol=1e-3)


def test_a_homography_that_is_affine_has_the_error_of_the_affine_map(rng):
    A = AFFINE.fit(*random_sets(rng, 3))
    x, y = rng.normal(size=(2, 10, 2))
    assert_allclose(HOMOGRAPHY.residuals(A, x, y), AFFINE.residuals(A, x, y), rtol=1e-6)


def test_at_both_epipoles_the_epipolar_error_is_zero():
    F = np.array([[[0.0, 1, 0], [-1, 0, 0], [0, 0, 0]]])  # a camera driving forward
    origin = np.zeros((1, 2))
    assert_array_equal(FUNDAMENTAL.residuals(F, origin, origin), [[0]])


@every_model
def test_residuals_keep_the_shape_of_the_stack(model, rng):
    models = model.fit(*random_sets(rng, model.minimal_size, n_sets=7))
    x, y = rng.normal(size=(2, 3, 5, 2))
    stacked = model.residuals(models, x, y)
    assert stacked.shape == (3, 5, 7)
    for block, a, b in zip(stacked, x, y, strict=True):
        assert_allclose(block, model.residuals(models, a, b), rtol=1e-9)


# ------------------------------------------------------------ changes of coordinates


@every_model
@pytest.mark.parametrize("scale", [1, 0.01, 250])
def test_residuals_grow_with_the_square_of_a_common_scale(model, scale, rng):
    models = model.fit(*random_sets(rng, model.minimal_size))
    x, y = rng.normal(size=(2, 10, 2))
    S, T = similarity(scale, 0.3, (5, -2)), similarity(scale, -1.1, (0, 7))
    changed = model.residuals(
        model.change_coordinates(models, S, T), move(S, x), move(T, y)
    )
    expected = scale**2 * model.residuals(models, x, y)
    assert_allclose(changed, expected, rtol=1e-5, atol=1e-12 * scale**2)


@every_model
def test_an_exact_model_stays_exact_in_any_coordinates(model):
    x, y, M = fit_exact(model)
    S, T = similarity(3, 0.3, (5, -2)), similarity(0.5, -1.1, (0, 7))
    changed = model.change_coordinates(M[None], S, T)
    assert_allclose(model.residuals(changed, move(S, x), move(T, y)), 0, atol=1e-18)


@every_model
def test_changing_back_undoes_a_change(model, rng):
    models = model.fit(*random_sets(rng, model.minimal_size))
    S, T = similarity(3, 0.3, (5, -2)), similarity(0.5, -1.1, (0, 7))
    there = model.change_coordinates(models, S, T)
    back = model.change_coordinates(there, np.linalg.inv(S), np.linalg.inv(T))
    assert_allclose(back, models, atol=1e-10 * np.abs(models).max())


# --------------------------------------------------------------------- translations


@every_model
def test_the_model_of_a_translation_explains_it(model, rng):
    x, shift = rng.normal(size=(20, 2)), np.array([0.3, -2.0])
    M = model.from_translation(shift)
    assert_allclose(model.residuals(M[None], x, x + shift), 0, atol=1e-28)


@every_model
def test_the_model_of_a_translation_is_worse_across_it(model, rng):
    """A step of 1 across the translation: half of it in either frame."""
    x, shift = rng.normal(size=(20, 2)), np.array([0.0, 2.0])
    M = model.from_translation(shift)
    across = model.residuals(M[None], x, x + shift + [1, 0])
    assert_allclose(across, 0.5)


@every_model
def test_translations_come_in_stacks(model, rng):
    shifts = rng.normal(size=(4, 5, 2))
    M = model.from_translation(shifts)
    assert M.shape == (4, 5, 3, 3)
    assert_array_equal(M[1, 2], model.from_translation(shifts[1, 2]))
    shifts[1, 2] = 0
    some = model.from_translation(shifts)
    assert_array_equal(some[0], M[0])
    assert_array_equal(some[1, 2], model.from_translation(np.zeros(2)))


def test_epipolar_geometries_of_translations_are_of_one_size():
    F = FUNDAMENTAL.from_translation(np.array([[3.0, 4], [0, 0], [1e-3, 0]]))
    assert_allclose(np.linalg.norm(F, axis=(1, 2)), np.sqrt(2))


@every_model
def test_standing_still_is_a_translation_too(model, rng):
    x = rng.normal(size=(20, 2))
    M = model.from_translation(np.zeros(2))
    assert_allclose(model.residuals(M[None], x, x), 0, atol=1e-28)
    assert_array_equal(
        FUNDAMENTAL.from_translation(np.zeros(2)),
        FUNDAMENTAL.from_translation(np.array([1.0, 0])),
    )


# ------------------------------------------------------------------------- registry


def test_the_models_are_in_the_order_of_the_views():
    assert list(MOTION_MODELS) == ["affine", "homography", "fundamental"]
    assert [name for name, m in MOTION_MODELS.items() if m.name != name] == []
    assert [m.minimal_size for m in MODELS] == [3, 4, 8]


def test_a_motion_model_is_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        AFFINE.minimal_size = 4


# --------------------------------------------------------------------- scikit-image


@pytest.fixture
def skimage_estimate():
    """Estimate one of scikit-image's transforms, in its old and its new way."""
    transform = pytest.importorskip("skimage.transform")

    def estimate(name, x, y):
        kind = getattr(transform, name)
        if hasattr(kind, "from_estimate"):
            return kind.from_estimate(x, y)
        fitted = kind()
        assert fitted.estimate(x, y)
        return fitted

    return estimate


def rms_normalized(points):
    """As scikit-image does it: centroid 0 and *root mean square* distance sqrt(2).

    The null vector of eight points is the same in any coordinates, but the nearest
    matrix of rank 2 is not.
    """
    centred = points - points.mean(axis=0)
    return centred * np.sqrt(2 / np.mean(np.sum(centred**2, axis=1)))


@pytest.mark.parametrize(
    ("model", "name"),
    [
        (AFFINE, "AffineTransform"),
        (HOMOGRAPHY, "ProjectiveTransform"),
        (FUNDAMENTAL, "FundamentalMatrixTransform"),
    ],
    ids=lambda p: getattr(p, "name", ""),
)
def test_fits_equal_those_of_scikit_image(model, name, skimage_estimate, rng):
    for x, y in zip(*random_sets(rng, model.minimal_size, n_sets=20), strict=True):
        x, y = rms_normalized(x), rms_normalized(y)
        expected = skimage_estimate(name, x, y).params
        assert_same_models(model.fit(x, y), expected, atol=1e-9)


def test_the_epipolar_error_is_that_of_scikit_image(skimage_estimate, rng):
    a, b = random_sets(rng, 8, n_sets=1)[:, 0]
    theirs = skimage_estimate("FundamentalMatrixTransform", a, b)
    x, y = rng.normal(size=(2, 30, 2))
    ours = FUNDAMENTAL.residuals(theirs.params[None], x, y)[:, 0]
    assert_allclose(np.sqrt(ours), theirs.residuals(x, y))


@pytest.mark.parametrize(
    "change, error, words",
    [
        ({"name": ""}, TypeError, "the name of a motion model is a str; got ''"),
        ({"name": 3}, TypeError, "the name of a motion model is a str; got 3"),
        ({"minimal_size": 0}, ValueError, "integer of 1 or more; got 0"),
        ({"minimal_size": 2.5}, ValueError, "integer of 1 or more; got 2.5"),
        ({"residuals": None}, TypeError, "residuals of the affine model must be"),
        ({"from_translation": 1}, TypeError, "from_translation of the affine model"),
    ],
)
def test_a_model_that_cannot_be_used_is_refused(change, error, words):
    with pytest.raises(error, match=words):
        dataclasses.replace(MOTION_MODELS["affine"], **change)


def test_an_unknown_model_is_told_from_those_that_there_are():
    with pytest.raises(
        ValueError, match=r"unknown motion model 'similarity'.*'affine'"
    ):
        MotionModel.built_in("similarity")
