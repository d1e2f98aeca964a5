"""Spectral embeddings of views and of their fusions."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import textbook
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg._core.graph.spectral import (
    FUSIONS,
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

every_fusion = pytest.mark.parametrize("fusion", sorted(FUSIONS))
alternating = pytest.mark.parametrize("fusion", ["coreg", "subset"])


def random_affinity(n=24, seed=0, inside=1.0, across=0.3):
    """Symmetric, three groups of a size, weak affinities between them."""
    rng = np.random.default_rng(seed)
    group = np.arange(n) % N_CLUSTERS
    K = np.where(group[:, None] == group, inside, across) * rng.uniform(size=(n, n))
    return K + K.T


def views(n_views=3, **kwargs):
    return np.stack([random_affinity(seed=seed, **kwargs) for seed in range(n_views)])


def fuse(fusion, kernels, n_leading=6, n_clusters=N_CLUSTERS, **given):
    graph = ViewGraph.from_affinities(np.asarray(kernels), n_leading)
    settings = {"lam": 0.3, "gamma": 0.3, "max_iter": 4, "tol": 0.0} | given
    return FUSIONS[fusion](graph, n_clusters, **settings)


def projections(embeddings):
    """``U U^T``: the same for all bases of a space."""
    return [U @ U.T for U in embeddings]


def assert_same_spaces(actual, expected, atol=1e-9):
    assert_allclose(projections(actual), projections(expected), atol=atol)


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


@every_fusion
def test_eigenvectors_for_more_clusters_serve_for_fewer(fusion):
    many, few = (fuse(fusion, views(), n_leading=n) for n in (10, N_CLUSTERS))
    assert_same_spaces(many.embeddings, few.embeddings)


@every_fusion
def test_a_fusion_leaves_the_graph_as_it_was(fusion):
    graph = ViewGraph.from_affinities(views(), 4)

    def arrays():
        spectra = [array for spectrum in graph.view_spectra for array in spectrum]
        return [graph.normalized, *graph.sum_spectrum, *spectra]

    before = [array.copy() for array in arrays()]
    FUSIONS[fusion](graph, 3, lam=0.3, gamma=0.3, max_iter=3, tol=0)
    for a, b in zip(before, arrays(), strict=True):
        assert_array_equal(a, b)


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


# ------------------------------------------------------------------------------ fusions


@pytest.mark.parametrize("n_views", [1, 2, 3])
def test_kernel_addition_equals_the_textbook(n_views):
    expected = textbook.kernel_addition(views(n_views), N_CLUSTERS)
    assert_same_spaces(fuse("kernel_addition", views(n_views)).embeddings, expected)


@pytest.mark.parametrize("n_views", [1, 2, 3])
@pytest.mark.parametrize("weight", [1e-2, 0.3])
@pytest.mark.parametrize("n_sweeps", [1, 5])
def test_co_regularization_equals_the_textbook(n_views, weight, n_sweeps):
    n_needed = n_sweeps if n_views > 1 else 0
    expected = textbook.co_regularization(views(n_views), N_CLUSTERS, weight, n_needed)
    fused = fuse("coreg", views(n_views), lam=weight, max_iter=n_sweeps)
    assert_same_spaces(fused.embeddings, expected)


@pytest.mark.parametrize("n_views", [1, 2, 3, 4])
@pytest.mark.parametrize("weight", [1e-2, 0.3])
@pytest.mark.parametrize("n_sweeps", [1, 5])
def test_the_subset_constraint_equals_the_textbook(n_views, weight, n_sweeps):
    expected = textbook.subset_constraint(views(n_views), N_CLUSTERS, weight, n_sweeps)
    fused = fuse("subset", views(n_views), gamma=weight, max_iter=n_sweeps)
    assert_same_spaces(fused.embeddings, expected)


@every_fusion
@pytest.mark.parametrize("n_views", [1, 2, 3])
def test_embeddings_are_orthonormal(fusion, n_views):
    embeddings = fuse(fusion, views(n_views)).embeddings
    assert embeddings.shape == (n_views, 24, N_CLUSTERS)
    for U in embeddings:
        assert_allclose(U.T @ U, np.eye(N_CLUSTERS), atol=1e-12)


@every_fusion
def test_one_view_is_embedded_by_itself_at_once(fusion):
    fused = fuse(fusion, views(1))
    assert_same_spaces(fused.embeddings, [single(K) for K in views(1)])
    assert len(fused.objective) == 1


@every_fusion
def test_views_that_are_alike_are_embedded_like_one(fusion):
    K = random_affinity()
    fused = fuse(fusion, [K, 2 * K], lam=1.0, gamma=1e-3)
    atol = 1e-2 if fusion == "subset" else 1e-9  # Q is not U U^T but its positive part
    assert_same_spaces(fused.embeddings, [single(K)] * 2, atol=atol)


@alternating
def test_without_weight_each_view_is_embedded_by_itself(fusion):
    fused = fuse(fusion, views(), lam=0, gamma=0)
    assert_same_spaces(fused.embeddings, [single(K) for K in views()])


@every_fusion
@pytest.mark.parametrize("n_views", [1, 2, 3])
def test_components_of_the_graph_are_recovered(fusion, n_views):
    """Rows at length 1: equal within a component, orthogonal between two."""
    kernels = views(n_views, across=0)
    component = np.arange(24) % N_CLUSTERS
    together = component[:, None] == component
    for U in fuse(fusion, kernels).embeddings:
        rows = normalize_rows(U)
        assert_allclose(rows @ rows.T, together, atol=1e-9)


@every_fusion
@pytest.mark.parametrize("n_views", [1, 3])
def test_directions_without_affinity_are_not_embedded(fusion, n_views):
    """One group has one direction: any other would tell apart tracks that are alike."""
    fused = fuse(fusion, np.ones((n_views, 12, 12)))
    assert_allclose(np.abs(fused.embeddings[:, :, 0]), 12**-0.5)
    assert_array_equal(fused.embeddings[:, :, 1:], 0)


@every_fusion
def test_tracks_that_are_alike_have_the_same_features(fusion):
    kernels = views()[:, :, np.arange(24) // 2][:, np.arange(24) // 2]  # rank 12
    features = cluster_features(fuse(fusion, kernels, 24, n_clusters=20).embeddings)
    assert_array_equal(features[::2], features[1::2])


@every_fusion
def test_tracks_in_another_order_are_embedded_alike(fusion):
    order = np.random.default_rng(0).permutation(24)
    kernels = views()
    shuffled = fuse(fusion, kernels[:, order[:, None], order]).embeddings
    assert_same_spaces(shuffled, fuse(fusion, kernels).embeddings[:, order])


def test_the_order_of_the_views_does_not_count_for_kernel_addition():
    backwards = fuse("kernel_addition", views()[::-1]).embeddings
    assert_same_spaces(backwards, fuse("kernel_addition", views()).embeddings)


@pytest.mark.parametrize("n_views", [2, 3])
def test_views_agree_where_agreement_outweighs_all(n_views):
    kernels = views(n_views, across=0.8)
    apart, *rest = projections(fuse("coreg", kernels, lam=0).embeddings)
    assert np.abs(apart - rest[0]).max() > 0.1
    fused = fuse("coreg", kernels, lam=1e7, max_iter=100)
    first, *rest = projections(fused.embeddings)
    for other in rest:
        assert_allclose(other, first, atol=1e-6)


def test_more_weight_brings_views_closer():
    def disagreement(lam):
        P = projections(fuse("coreg", views(2, across=0.8), lam=lam).embeddings)
        return np.sum((P[0] - P[1]) ** 2)

    apart = [disagreement(lam) for lam in (0, 0.01, 0.1, 1)]
    assert apart == sorted(apart, reverse=True)
    assert apart[-1] < 0.5 * apart[0]


def noise_and_blocks():
    """A view without groups, and one of three groups that have nothing in common."""
    noise = random_affinity(seed=7, across=1.0)
    group = np.arange(24) % N_CLUSTERS
    return noise, (group[:, None] == group).astype(float)


def test_a_richer_view_joins_what_a_simpler_one_joins():
    noise, clear = noise_and_blocks()
    target = projections([single(clear)])[0]
    before, after = (
        projections(fuse("subset", [clear, noise], gamma=gamma).embeddings)[1]
        for gamma in (0, 1)
    )
    assert np.trace(before @ target) < 0.5 * N_CLUSTERS
    assert np.trace(after @ target) > 0.95 * N_CLUSTERS


def test_a_simpler_view_need_not_join_what_a_richer_one_joins():
    noise, clear = noise_and_blocks()
    simple, _ = fuse("subset", [noise, clear], gamma=100, max_iter=1).embeddings
    assert_same_spaces([simple], [single(noise)])


def test_a_simpler_view_keeps_apart_what_a_richer_one_keeps_apart():
    noise, other = random_affinity(seed=7), random_affinity(seed=8, across=1.0)
    apart = projections([single(other)])[0].clip(max=0)
    before, after = (
        fuse("subset", [noise, other], gamma=gamma, max_iter=1).embeddings[0]
        for gamma in (0, 100)
    )
    assert np.sum(before * (apart @ before)) < 0.1
    assert np.sum(after * (apart @ after)) > 0.5


# ----------------------------------------------------------------------- the objective


def cut_cost(kernels, embeddings):
    return sum(
        np.trace(U.T @ textbook.laplacian(K) @ U)
        for K, U in zip(kernels, embeddings, strict=True)
    )


@every_fusion
def test_the_objective_without_weights_is_the_trace_of_the_laplacians(fusion):
    fused = fuse(fusion, views(), lam=0, gamma=0)
    assert_allclose(fused.objective, cut_cost(views(), fused.embeddings))


def test_the_co_regularized_objective_is_that_of_the_paper():
    """Each pair of views once: the alternation of eq. 6 lowers that."""
    fused = fuse("coreg", views(), lam=0.3)
    P = projections(fused.embeddings)
    agreement = sum(np.trace(P[v] @ P[w]) for v, w in [(0, 1), (0, 2), (1, 2)])
    expected = cut_cost(views(), fused.embeddings) - 0.3 * agreement
    assert_allclose(fused.objective[-1], expected)


def test_the_subset_objective_is_that_of_the_paper():
    fused = fuse("subset", views(), gamma=0.3)
    U, (A, H, F) = fused.embeddings, projections(fused.embeddings)
    Q = [H.clip(max=0), A.clip(min=0) + F.clip(max=0), H.clip(min=0)]
    pull = sum(np.trace(U[v].T @ Q[v] @ U[v]) for v in range(3))
    expected = cut_cost(views(), fused.embeddings) - 0.3 * pull
    assert_allclose(fused.objective[-1], expected)


@pytest.mark.parametrize("n_views", [2, 3, 5])
@pytest.mark.parametrize("lam", [1e-3, 0.1, 1, 30])
def test_the_co_regularized_objective_never_rises(n_views, lam):
    for seed in range(5):
        rng = np.random.default_rng(seed)
        kernels = rng.uniform(size=(n_views, 15, 15)) ** 4
        kernels += kernels.transpose(0, 2, 1)
        objective = fuse("coreg", kernels, lam=lam, max_iter=10).objective
        assert len(objective) == 11
        assert (np.diff(objective) < 1e-12 * (1 + lam)).all()
        assert objective[-1] < objective[0]


@alternating
def test_sweeps_stop_where_the_objective_settles(fusion):
    slow = fuse(fusion, views(), max_iter=30, tol=0).objective
    tol = 1.5 * abs(slow[2] - slow[1]) / N_CLUSTERS
    assert abs(slow[1] - slow[0]) > 2 * tol * N_CLUSTERS
    fast = fuse(fusion, views(), max_iter=30, tol=tol)
    assert_allclose(fast.objective, slow[:3])


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
