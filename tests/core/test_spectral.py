"""Normalised affinities, eigenvectors, features and rows that were not in fit."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import textbook
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg._core.graph.fusion import FUSIONS
from skmotionseg._core.graph.spectral import (
    ViewGraph,
    cluster_features,
    connected_tracks,
    extend_embedding,
    inverse_sqrt,
    leading_eigenvectors,
    leading_of_perturbed,
    normalize_rows,
    normalized_affinity,
    spectrum,
)

N_CLUSTERS = 3


def random_affinity(n=24, seed=0, inside=1.0, across=0.3):
    """Symmetric, three groups of a size, weak affinities between them."""
    rng = np.random.default_rng(seed)
    group = np.arange(n) % N_CLUSTERS
    K = np.where(group[:, None] == group, inside, across) * rng.uniform(size=(n, n))
    return K + K.T


def views(n_views=3, **kwargs):
    return np.stack([random_affinity(seed=seed, **kwargs) for seed in range(n_views)])


def single(K):
    """First eigenvectors of a view by itself."""
    return textbook.first_eigenvectors(textbook.laplacian(K), N_CLUSTERS)


# ------------------------------------------------------------------ normalised affinity


def with_a_zero_row():
    K = random_affinity()
    K[5] = K[:, 5] = 0
    return K


@pytest.mark.parametrize("make", [random_affinity, with_a_zero_row])
def test_the_normalised_affinity_is_one_minus_the_laplacian(make):
    K = make()
    expected = np.eye(len(K)) - textbook.laplacian(K)
    assert_allclose(normalized_affinity(K), expected, atol=1e-15)


def test_its_largest_eigenvalue_is_one_for_the_roots_of_the_degrees():
    K = random_affinity()
    N, root = normalized_affinity(K), np.sqrt(K.sum(axis=1))
    assert_allclose(N @ root, root)
    values = np.linalg.eigvalsh(N)
    assert values[0] >= -1
    assert_allclose(values[-1], 1)


def test_the_normalised_affinity_is_double_and_ignores_the_scale():
    K = random_affinity().astype(np.float32)
    N = normalized_affinity(K)
    assert N.dtype == np.float64
    assert_allclose(normalized_affinity(8 * K), N)


def test_a_degree_of_zero_has_no_inverse():
    assert_array_equal(inverse_sqrt(np.array([4.0, 0.0, 0.25])), [0.5, 0, 2])


# ----------------------------------------------------------------- leading eigenvectors


def blocks(n_blocks=4, size=5):
    """Eigenvalue 1 once a block, 0 for all the rest."""
    return normalized_affinity(np.kron(np.eye(n_blocks), np.ones((size, size))))


@pytest.mark.parametrize("n_vectors", [1, 3, 24])
def test_leading_eigenvectors_are_those_of_the_full_decomposition(n_vectors):
    N = normalized_affinity(random_affinity())
    values, vectors = leading_eigenvectors(N, n_vectors)
    full_values, full_vectors = np.linalg.eigh(N)
    assert vectors.shape == (24, n_vectors)
    assert_allclose(values, full_values[::-1][:n_vectors], atol=1e-13)
    cosine = np.sum(vectors * full_vectors[:, ::-1][:, :n_vectors], axis=0)
    assert_allclose(np.abs(cosine), 1)


@pytest.mark.parametrize("n_vectors", [2, 4, 7])
def test_repeated_eigenvalues_have_orthonormal_eigenvectors(n_vectors):
    N = blocks()
    values, vectors = leading_eigenvectors(N, n_vectors)
    assert_allclose(values, np.repeat([1.0, 0], [4, 3])[:n_vectors], atol=1e-12)
    assert_allclose(vectors.T @ vectors, np.eye(n_vectors), atol=1e-12)
    assert_allclose(N @ vectors, vectors * values, atol=1e-12)


@pytest.mark.parametrize("n_vectors", range(1, 9))
@pytest.mark.parametrize("n", range(2, 40))
def test_no_eigenvector_is_lost_where_all_eigenvalues_but_one_are_equal(n, n_vectors):
    n_vectors = min(n, n_vectors)
    N = np.eye(n) + np.full((n, n), 1 / n)
    values, vectors = leading_eigenvectors(N, n_vectors)
    assert_allclose(values, [2.0] + [1.0] * (n_vectors - 1))
    assert_allclose(vectors.T @ vectors, np.eye(n_vectors), atol=1e-12)
    assert_allclose(N @ vectors, vectors * values, atol=1e-12)


def test_all_eigenvectors_are_found_where_inverse_iteration_does_not_converge(
    monkeypatch,
):
    def fail(*arguments, **options):
        raise np.linalg.LinAlgError("1 eigenvectors failed to converge.")

    N = normalized_affinity(random_affinity())
    expected = leading_eigenvectors(N, 3)
    monkeypatch.setattr("scipy.linalg.eigh", fail)
    for found, known in zip(leading_eigenvectors(N, 3), expected, strict=True):
        assert_allclose(found, known, atol=1e-12)


def test_the_largest_entry_of_an_eigenvector_is_positive():
    _, vectors = leading_eigenvectors(-normalized_affinity(random_affinity()), 10)
    largest = np.abs(vectors).argmax(axis=0)
    assert (vectors[largest, np.arange(10)] > 0).all()


def test_a_matrix_of_one_has_one_eigenvector():
    values, vectors = leading_eigenvectors(np.array([[0.5]]), 1)
    assert_array_equal(values, [0.5])
    assert_array_equal(vectors, [[1]])


# ---------------------------------------------------------------------------- the graph


def test_a_track_is_connected_by_any_view_but_not_by_its_own_affinity():
    kernels = np.zeros((2, 5, 5))
    kernels[:, range(5), range(5)] = 1
    kernels[0, 0, 2] = kernels[0, 2, 0] = 0.1
    kernels[1, 2, 3] = kernels[1, 3, 2] = 0.1
    assert_array_equal(connected_tracks(kernels), [0, 2, 3])


@pytest.mark.parametrize("affinity", [0.0, 1.0])
def test_a_single_track_is_connected(affinity):
    assert_array_equal(connected_tracks(np.full((2, 1, 1), affinity)), [0])


def test_the_graph_leaves_out_tracks_that_meet_no_other():
    kernels = views()
    expected = ViewGraph.from_affinities(kernels, 4)
    with_loners = np.zeros((3, 26, 26))
    with_loners[:, 1:25, 1:25] = kernels
    with_loners[:, 0, 0] = 1
    graph = ViewGraph.from_affinities(with_loners, 30)
    assert graph.n_samples == 26
    assert graph.n_leading == 24
    assert_array_equal(graph.connected, np.arange(1, 25))
    assert_array_equal(graph.normalized, expected.normalized)
    assert_allclose(graph.degrees, kernels.sum(axis=2))


def test_the_graph_has_no_more_eigenvectors_than_tracks():
    graph = ViewGraph.from_affinities(views(n=9), 20)
    assert graph.n_leading == 9
    assert [len(values) for values, _ in graph.view_spectra] == [9, 9, 9]
    assert graph.sum_spectrum[1].shape == (9, 9)


@pytest.mark.parametrize("size", [1e-3, 0.1, 10])
@pytest.mark.parametrize("n", [5, 20, 90])
def test_eigenvectors_of_a_perturbed_matrix_are_those_of_the_sum(n, size):
    rng = np.random.default_rng(n)
    known, other = (A + A.T for A in rng.standard_normal((2, n, n)))
    other *= size / np.sqrt(n)
    values, found = leading_of_perturbed(*spectrum(known), lambda X: other @ X, 3)
    expected_values, expected = leading_eigenvectors(known + other, 3)
    assert_allclose(values, expected_values)
    assert_allclose(np.abs(found.T @ expected), np.eye(3), atol=1e-7)


def test_eigenvectors_of_a_perturbed_matrix_with_equal_eigenvalues():
    n = 40
    direction = np.random.default_rng(0).standard_normal((n, 1))
    _, found = leading_of_perturbed(
        *spectrum(np.eye(n)), lambda X: direction @ (direction.T @ X), 1
    )
    assert_allclose(np.abs(found.T @ direction), np.linalg.norm(direction), rtol=1e-9)


# ---------------------------------------------------------------------------- features


def test_rows_have_length_one_and_zero_rows_stay():
    rows = normalize_rows(np.array([[3.0, 4.0], [0, 0], [0, -2]]))
    assert_allclose(rows, [[0.6, 0.8], [0, 0], [0, -1]])


def test_rows_that_are_zero_but_for_rounding_have_no_features():
    """As in a component of the graph that no eigenvector is about."""
    U = np.linalg.qr(np.random.default_rng(0).standard_normal((9, 2)))[0]
    U[4:] = 1e-17 * np.random.default_rng(1).standard_normal((5, 2))
    features = cluster_features([U, U])
    assert_allclose(np.linalg.norm(features[:4], axis=1), 1)
    assert_array_equal(features[4:], 0)


def test_features_put_the_views_side_by_side():
    first, second = np.array([[3.0, 4.0]]), np.array([[0.0, 0.1]])
    expected = np.array([[0.6, 0.8, 0, 1]]) / np.sqrt(2)
    assert_allclose(cluster_features([first, second]), expected)


def test_features_of_a_row_that_one_view_lacks_are_those_of_the_other():
    first, second = np.array([[3.0, 4.0]]), np.zeros((1, 2))
    assert_allclose(cluster_features([first, second]), [[0.6, 0.8, 0, 0]])


# --------------------------------------------------------------------- rows not in fit


def fitted(kernels):
    """Degrees, embedding and shrinkage of each view under kernel addition."""
    graph = ViewGraph.from_affinities(kernels, N_CLUSTERS)
    U = FUSIONS["kernel_addition"](graph, N_CLUSTERS).embeddings
    shrinkage = np.sum(U * (graph.normalized @ U), axis=1)
    return list(zip(graph.degrees, U, shrinkage, strict=True))


def test_fitted_rows_are_embedded_where_they_were():
    K = random_affinity()
    [(degrees, U, shrinkage)] = fitted(K[None])
    assert_allclose(extend_embedding(K, degrees, U, shrinkage), U)
    assert_allclose(extend_embedding(K[:5], degrees, U, shrinkage), U[:5])


def test_added_kernels_embed_fitted_rows_where_they_were_on_the_whole():
    """The joint embedding is an eigenvector of the sum only: views answer by share."""
    kernels = views()
    parts = fitted(kernels)
    total = sum(shrinkage for _, _, shrinkage in parts)
    joint = sum(
        extend_embedding(K, *part) * part[2] / total
        for K, part in zip(kernels, parts, strict=True)
    )
    assert_allclose(joint, parts[0][1], atol=1e-12)


def test_the_scale_of_a_new_row_does_not_count():
    K = random_affinity()
    [(degrees, U, shrinkage)] = fitted(K[None])
    once = extend_embedding(K[:3], degrees, U, shrinkage)
    directions = normalize_rows(extend_embedding(9 * K[:3], degrees, U, shrinkage))
    assert_allclose(directions, normalize_rows(once))


def test_a_new_row_without_affinity_is_embedded_at_zero():
    [(degrees, U, shrinkage)] = fitted(random_affinity()[None])
    assert_array_equal(extend_embedding(np.zeros((2, 24)), degrees, U, shrinkage), 0)


def test_a_fitted_track_of_degree_zero_has_no_say():
    K = with_a_zero_row()
    degrees, U, shrinkage = K.sum(axis=1), single(K), np.ones(N_CLUSTERS)
    rows = np.random.default_rng(0).uniform(size=(4, 24))
    expected = extend_embedding(rows, degrees, U, shrinkage)
    U[5] = 99
    assert_array_equal(extend_embedding(rows, degrees, U, shrinkage), expected)


def test_directions_that_the_affinity_does_not_support_are_zero():
    K = random_affinity()
    [(degrees, U, _)] = fitted(K[None])
    embedded = extend_embedding(K, degrees, U, np.array([1.0, 0.0, -0.2]))
    assert embedded[:, 0].all()
    assert_array_equal(embedded[:, 1:], 0)
