"""Numbers at the edge: ill-conditioned fits, many magnitudes, degenerate scenes.

The reference is the textbook in fifty digits (extended.py), where double precision
would not tell who is wrong.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from helpers import extended
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg import MotionSegmenter, MultiModelSpectralClustering, NCREModelSelector
from skmotionseg._core.geometry.hypotheses import draw_hypotheses, residual_matrix
from skmotionseg._core.geometry.motion_models import MOTION_MODELS, rank_two
from skmotionseg._core.geometry.tracks import (
    frame_pairs,
    unpack_tracks,
    working_coordinates,
)
from skmotionseg._core.graph.cuts import normalized_cut, reconstruction_error
from skmotionseg._core.graph.kmeans import kmeans
from skmotionseg._core.graph.neighbourhood import neighbourhood_thresholds
from skmotionseg._core.graph.spectral import leading_eigenvectors, normalized_affinity
from skmotionseg.datasets import make_rigid_motions
from skmotionseg.metrics import misclassification_error

EPS = np.finfo(float).eps
MODELS = tuple(MOTION_MODELS)
every_model = pytest.mark.parametrize("name", MODELS)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def up_to_sign(actual, expected):
    return actual * np.sign(np.sum(actual * expected))


# --------------------------------------------------------------------------------- fits


def nearly_degenerate(name, height, rng):
    """A minimal set whose points lie on a line but for ``height``."""
    size = MOTION_MODELS[name].minimal_size
    x, y = rng.normal(size=(2, size, 2))
    x[:, 1] = 0.3 * x[:, 0] + height * rng.normal(size=size)
    return x, y


@every_model
@pytest.mark.parametrize("height", [1, 1e-1, 1e-2, 1e-3, 1e-4])
def test_fits_lose_no_more_than_their_conditioning(name, height, rng):
    """Half of the digits are left where the equations lose the other half."""
    model, judged = MOTION_MODELS[name], 0
    for _ in range(7):
        x, y = nearly_degenerate(name, height, rng)
        fitted = model.fit(x, y)
        if np.isnan(fitted).any():
            continue
        expected, condition = extended.fit(name, x, y)
        if name == "fundamental":
            expected = extended.rank_two(expected)
        actual = up_to_sign(fitted / np.linalg.norm(fitted), expected)
        assert np.abs(actual - expected).max() < 100 * EPS * condition
        judged += 1
    assert judged >= 5


@pytest.mark.parametrize("second", [1.0, 1e-3, 1e-6])
@pytest.mark.parametrize("ratio", [0, 1e-12, 1e-6, 1e-3, 0.5, 0.95])
def test_the_nearest_matrix_of_rank_two_is_found(second, ratio, rng):
    for _ in range(5):
        U, V = np.linalg.qr(rng.normal(size=(2, 3, 3)))[0]
        F = U @ np.diag([1, second, ratio * second]) @ V.T
        actual, expected = rank_two(F), extended.rank_two(F)
        assert_allclose(up_to_sign(actual, expected), expected, atol=1e-13 / second)


@pytest.mark.parametrize("ratio", [0.97, 0.99, 0.999, 1 - 1e-9, 1])
def test_nearly_equal_singular_values_still_give_rank_two_and_next_to_nearest(
    ratio, rng
):
    """Which of two nearly equal ones is dropped hardly matters."""
    for _ in range(5):
        U, V = np.linalg.qr(rng.normal(size=(2, 3, 3)))[0]
        F = U @ np.diag([1, 0.5, 0.5 * ratio]) @ V.T
        F /= np.linalg.norm(F)
        near = rank_two(F)
        near *= np.sum(near * F)  # undoes the scaling to unit norm
        assert abs(np.linalg.det(near)) < 1e-15
        least = np.linalg.svd(F)[1][2]
        assert np.linalg.norm(F - near) <= 1.03 * least


# ----------------------------------------------------------------------- Sampson errors


def models_of(name, K, rng):
    M = rng.normal(size=(K, 3, 3))
    if name == "affine":
        M[:, 2] = 0, 0, 1
    return rank_two(M) if name == "fundamental" else M


@every_model
@pytest.mark.parametrize(("dtype", "eps"), [(float, EPS), (np.float32, 2.0**-23)])
def test_distances_are_right_to_rounding(name, dtype, eps, rng):
    """A distance is the root of an error; it is right to some roundings of a place."""
    model = MOTION_MODELS[name]
    M, x, y = models_of(name, 8, rng), *rng.normal(size=(2, 12, 2))
    M, x, y = (array.astype(dtype) for array in (M, x, y))
    actual = np.sqrt(model.residuals(M, x, y))
    for (i, (a, b)), k in product(enumerate(zip(x, y, strict=True)), range(len(M))):
        expected = extended.sampson_distance(name, M[k], a, b)
        assert abs(actual[i, k] - expected) < 200 * eps * (1 + expected)


@every_model
def test_distances_of_tracks_that_obey_the_model_are_next_to_zero(name, rng):
    """The place in the image does not cancel more than its own rounding."""
    x = rng.normal(size=(40, 2))
    M = models_of(name, 1, rng)
    if name == "fundamental":
        lines = np.column_stack([x, np.ones(40)]) @ M[0].T
        normal = lines[:, :2]
        y = -normal * (lines[:, 2:] / (normal**2).sum(axis=1, keepdims=True))
    else:
        y = np.column_stack([x, np.ones(40)]) @ M[0].T
        y = y[:, :2] / y[:, 2:]
    near = np.abs(y).max(axis=1) < 10
    assert near.sum() > 20
    distances = np.sqrt(MOTION_MODELS[name].residuals(M, x[near], y[near]))
    assert distances.max() < 1e-13


# ----------------------------------------------------------------------- affinities


def of_many_magnitudes(n, decades, rng):
    K = 10 ** rng.uniform(-decades, 0, (n, n))
    return np.maximum(K, K.T)


@pytest.mark.parametrize("alpha", [0.5, 1, 4, 6, 8, 17.3])
@pytest.mark.parametrize("decades", [1e-5, 1e-3, 0.1, 1, 4])
def test_neighbours_are_those_of_fifty_digits(alpha, decades, rng):
    """Also where a row is nearly constant; ties, within rounding of float32, aside."""
    affinity = 10 ** -rng.uniform(0, decades, (20, 30))
    affinity[:, 0] = own = np.ones(20)
    thresholds = neighbourhood_thresholds(affinity, alpha, own)
    n_judged = 0
    for row, threshold in zip(affinity, thresholds, strict=True):
        margin = extended.kept_neighbours(row, 1.0, alpha)
        clear = np.abs(row / threshold - 1) > 5e-6
        assert_array_equal((row > threshold)[clear], (margin > 0)[clear])
        n_judged += clear.sum()
    assert n_judged > 300 or decades < 1e-3


@pytest.mark.parametrize("scale", [1e-300, 1e-170, 1e-20, 1, 1e20, 1e170, 1e300])
@pytest.mark.parametrize("decades", [1, 8, 16])
def test_costs_are_those_of_fifty_digits_at_any_scale(decades, scale, rng):
    K = of_many_magnitudes(9, decades, rng) * scale
    K[8] = K[:, 8] = 0
    for labels in ([0] * 9, [0, 0, 0, 1, 1, 1, 2, 2, 2], [0, 1, 0, 1, 0, 1, 0, -1, -1]):
        labels = np.array(labels)
        assert_allclose(
            normalized_cut(K, labels), extended.normalized_cut(K, labels), atol=1e-14
        )
        assert_allclose(
            reconstruction_error(K, labels),
            extended.reconstruction_error(K, labels),
            atol=1e-14,
        )


@pytest.mark.parametrize("bridge", [0, 1e-15, 1e-12, 1e-6, 1e-3])
def test_nearly_repeated_eigenvalues_have_the_leading_space(bridge, rng):
    """Three components, linked ever so weakly: eigenvalues 1, nearly 1, nearly 1."""
    K = np.full((9, 9), bridge)
    for start in (0, 3, 6):
        block = rng.uniform(0.5, 1, (3, 3))
        K[start : start + 3, start : start + 3] = block + block.T
    values, U = leading_eigenvectors(normalized_affinity(K), 3)
    projection, expected = extended.leading_projection(K, 3)
    assert_allclose(values, expected[:3], atol=1e-14)
    assert_allclose(U @ U.T, projection, atol=1e-13 / (expected[2] - expected[3]))


@pytest.mark.parametrize("scale", [1e-300, 1e-150, 1e150, 1e300])
def test_clusters_do_not_depend_on_the_scale_of_the_affinities(scale):
    group = np.repeat([0, 1, 2], 4)
    K = np.where(group[:, None] == group, 1.0, 0.01) * scale
    labels = MultiModelSpectralClustering(3, random_state=0).fit_predict(K)
    assert_array_equal(labels, group)
    selector = NCREModelSelector(random_state=0).fit(np.hstack([K, K]))
    assert_array_equal(selector.labels_, group)
    assert_array_equal(selector.predict(np.hstack([K, K])), group)


# ------------------------------------------------------------------------------ k-means


def least_inertia(features, n_clusters):
    """By trying all partitions."""
    best = np.inf
    for labels in product(range(n_clusters), repeat=len(features)):
        labels = np.array(labels)
        total = 0.0
        for k in set(labels):
            members = features[labels == k]
            total += ((members - members.mean(axis=0)) ** 2).sum()
        best = min(best, total)
    return best


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("n_clusters", [2, 3])
@pytest.mark.parametrize("n_different", [2, 3, 7])
def test_small_problems_are_solved_exactly(n_different, n_clusters, seed):
    """Also where rows are repeated, and clusters run empty on the way."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(n_different, 2))
    features = rows[np.arange(7) % n_different]
    labels, centres = kmeans(features, n_clusters, 40, np.random.RandomState(seed))
    found = ((features - centres[labels]) ** 2).sum()
    assert_allclose(found, least_inertia(features, n_clusters), atol=1e-12)


@pytest.mark.parametrize("n_clusters", [3, 6, 12])
def test_clusters_that_run_empty_take_rows_far_from_their_centres(n_clusters):
    """Two tight groups and a few strays: no cluster is lost for good."""
    rng = np.random.default_rng(0)
    tight = np.repeat([[0.0, 0], [1, 0]], 40, axis=0) + 1e-9 * rng.normal(size=(80, 2))
    strays = 10 * rng.normal(size=(12, 2))
    features = np.vstack([tight, strays])
    for seed in range(10):
        labels, centres = kmeans(features, n_clusters, 1, np.random.RandomState(seed))
        assert len(set(labels)) == n_clusters
        assert np.isfinite(centres).all()


# ------------------------------------------------------------------ degenerate geometry


def exact_scene(**scene):
    """One motion without noise, all of it seen."""
    scene = {"n_tracks": 40, "n_frames": 4, "n_motions": 1} | scene
    X, _ = make_rigid_motions(missing=0, noise=0, random_state=0, **scene)
    return X


SCENES = {
    "pure rotation": lambda: exact_scene(camera="rotation"),
    "a plane": lambda: exact_scene(shapes="planar"),
    "nothing moves": lambda: np.tile(exact_scene()[:, :2], 4),
    "all shift alike": lambda: (
        np.tile(exact_scene()[:, :2], 4) + np.repeat(range(4), 2)
    ),
    "one spot": lambda: np.tile(exact_scene()[:1], (40, 1)),
}


@pytest.mark.parametrize("far", [0, 1e4])
@pytest.mark.parametrize("model", MOTION_MODELS.values(), ids=lambda m: m.name)
@pytest.mark.parametrize("name", SCENES)
def test_degenerate_scenes_have_finite_hypotheses_and_residuals(name, model, far):
    """And next to no error, where the model covers the scene."""
    points, visibility = unpack_tracks(SCENES[name]() + far)
    pairs = frame_pairs(4)
    rng = np.random.RandomState(0)
    found, _ = draw_hypotheses(points, visibility, pairs, model, 30, rng)
    working = working_coordinates(points, visibility)
    R = residual_matrix(points, visibility, pairs, found, model, *working)
    assert np.isfinite(found).all()
    assert np.isfinite(R).all()
    maps = {"nothing moves", "all shift alike", "one spot"}
    covered = {
        "affine": maps,
        "homography": maps | {"pure rotation", "a plane"},
        "fundamental": SCENES.keys(),
    }
    if name in covered[model.name]:
        assert np.median(R) < 1e-4  # squared pixels


@pytest.mark.parametrize("selection", ["description_length", "ncre"])
@pytest.mark.parametrize("camera", ["still", "rotation", "general"])
@pytest.mark.parametrize("shapes", ["planar", "general"])
def test_motions_are_told_apart_by_any_camera(camera, shapes, selection):
    X, y = make_rigid_motions(
        80, 6, 2, camera=camera, shapes=shapes, missing=0.1, random_state=0
    )
    labels = MotionSegmenter(
        2, selection=selection, n_hypotheses=200, random_state=0
    ).fit_predict(X)
    assert misclassification_error(y, labels) < 0.05


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in (1, 2))]
)
def test_two_things_of_the_same_motion_are_one(seed):
    """Two clouds of points that keep apart, and move as one body does."""
    X, _ = make_rigid_motions(
        200, 8, 1, shapes="general", missing=0.1, noise=0.3, random_state=seed
    )
    x = np.nanmean(X[:, ::2], axis=1)
    apart = (x < np.nanquantile(x, 0.35)) | (x > np.nanquantile(x, 0.65))
    segmenter = MotionSegmenter(n_hypotheses=200, random_state=0).fit(X[apart])
    assert segmenter.n_motions_ == 1
