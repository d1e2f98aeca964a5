"""Fusions equal the textbook, and theorems of each."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import textbook
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg._core.graph.fusion import FUSIONS
from skmotionseg._core.graph.spectral import (
    ViewGraph,
    cluster_features,
    normalize_rows,
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
