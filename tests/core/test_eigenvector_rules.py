"""Eigengap and alignment equal the textbook and theorems."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import textbook
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg import (
    EigengapModelSelector,
)
from skmotionseg._core.graph import eigenvector_rules
from skmotionseg._core.graph.eigenvector_rules import (
    ALIGNMENT_TOLERANCE,
    aligning_rotation,
    alignment_costs,
    angle_gradient,
    best_aligned,
    eigengap_costs,
    row_cost,
)
from skmotionseg._core.graph.spectral import ViewGraph, normalize_rows

SIZES = [(20, 20), (9, 8, 7), (30, 6, 4), (20,) * 4, (12,) * 8]


every_size = pytest.mark.parametrize("sizes", SIZES, ids=str)


def blocks(sizes, between=0.0, seed=0):
    """Labels, and affinities near 1 within each group and up to ``between`` across."""
    labels = np.repeat(np.arange(len(sizes)), sizes)
    noise = np.random.default_rng(seed).uniform(size=(len(labels),) * 2)
    noise = (noise + noise.T) / 2
    together = labels[:, None] == labels
    return np.where(together, 0.5 + noise / 2, between * noise), labels


def random_rotation(n, seed=0):
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(n, n)))[0]


def random_rows(n=12, n_groups=3, seed=0):
    return normalize_rows(np.random.default_rng(seed).normal(size=(n, n_groups)))


def indicators(sizes):
    """Orthonormal eigenvectors of groups without an affinity between them."""
    labels = np.repeat(np.arange(len(sizes)), sizes)
    return (labels[:, None] == np.arange(len(sizes))) / np.sqrt(sizes)


def least_cost(vectors):
    return row_cost(normalize_rows(vectors @ aligning_rotation(vectors)))


# --------------------------------------------------------------------------- eigengap


@pytest.mark.parametrize("n_views", [1, 3])
def test_gaps_equal_the_textbook(n_views):
    views = [blocks((8, 6, 5), 0.5, seed=seed)[0] for seed in range(n_views)]
    selector = EigengapModelSelector(max_clusters=6, random_state=0)
    selector.fit(np.hstack(views))
    expected = textbook.eigengaps(views, range(1, 7))
    assert_allclose(selector.costs_[:, 2], -np.array(expected), atol=1e-12)
    assert selector.n_clusters_ == np.argmax(expected) + 1


def test_costs_are_an_eigenvalue_less_the_next():
    costs = eigengap_costs(np.array([0, 0.1, 0.5, 0.6]), np.array([1, 2, 3]))
    expected = [[0, 0.1, -0.1], [0.1, 0.5, -0.4], [0.5, 0.6, -0.1]]
    assert_allclose(costs, expected)


def test_no_eigenvalue_follows_that_of_every_row():
    costs = eigengap_costs(np.array([0, 0.7]), np.array([1, 2]))
    assert_allclose(costs, [[0, 0.7, -0.7], [0.7, 0.7, 0]])


def test_of_equal_gaps_the_smallest_count_is_taken():
    K = np.array([[1.0, 1.0], [1.0, 1.0]])
    assert EigengapModelSelector(random_state=0).fit(K).n_clusters_ == 1


# -------------------------------------------------------------------- cost of alignment


@pytest.mark.parametrize("n_groups", [1, 2, 5])
def test_the_cost_of_rows_equals_the_textbook(n_groups):
    Z = np.random.default_rng(0).normal(size=(15, n_groups))
    expected = textbook.alignment_cost(Z.tolist()) / 15
    assert_allclose(row_cost(normalize_rows(Z)), expected)


@pytest.mark.parametrize("n_groups", [1, 2, 4, 10])
def test_a_row_costs_between_one_and_the_number_of_groups(n_groups):
    for seed in range(10):
        assert 1 <= row_cost(random_rows(n_groups=n_groups, seed=seed)) <= n_groups
    assert row_cost(np.eye(n_groups)) == 1
    even = np.full((3, n_groups), n_groups**-0.5)
    assert_allclose(row_cost(even), n_groups)


def test_rows_that_no_vector_is_for_cost_the_most():
    rows = normalize_rows(np.array([[1.0, 0, 0], [0, 0, 0], [1e-17, 0, 0]]))
    assert_allclose(row_cost(rows), (1 + 3 + 3) / 3)


@pytest.mark.parametrize("seed", range(5))
def test_costs_never_fall_below_zero(seed):
    rng = np.random.default_rng(seed)
    K = rng.uniform(size=(30, 30)) ** 8
    _, vectors = ViewGraph.from_affinities((K + K.T)[None], 10).sum_spectrum
    for kept in (vectors, indicators((7, 3, 1))):
        counts = np.arange(1, kept.shape[1] + 1)
        alignment, least, excess = alignment_costs(kept, counts).T
        assert (excess >= 0).all()
        assert (alignment <= 1).all()
        assert_allclose(least, 1 / counts)
        assert_allclose(excess, alignment - least)


def test_one_vector_is_always_aligned():
    vector = np.random.default_rng(0).uniform(0.1, 1, size=(9, 1))
    assert_array_equal(alignment_costs(vector, np.array([1])), [[1, 1, 0]])


# ------------------------------------------------------------------------- the rotation


@pytest.mark.parametrize("n_groups", [1, 2, 3, 7])
def test_a_rotation_is_orthogonal(n_groups):
    R = aligning_rotation(random_rows(n_groups=n_groups))
    assert_allclose(R.T @ R, np.eye(n_groups), atol=1e-12)
    assert_allclose(np.linalg.det(R), 1)


@pytest.mark.parametrize("seed", range(3))
def test_the_gradient_is_that_of_givens_rotations(seed):
    rows, step = random_rows(n_groups=4, seed=seed), 1e-6
    gradient = angle_gradient(rows)
    assert_array_equal(gradient, -gradient.T)
    for i in range(3):
        for j in range(i + 1, 4):
            more, less = (
                textbook.alignment_cost(rows @ textbook.givens(4, i, j, angle))
                for angle in (step, -step)
            )
            slope = (more - less) / (2 * step) / len(rows)
            assert_allclose(gradient[i, j], slope, rtol=1e-5)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("n_groups", "n_angles"), [(2, 2000), (3, 16)])
def test_no_rotation_of_a_grid_is_better(n_groups, n_angles, seed):
    vectors = np.random.default_rng(seed).normal(size=(10, n_groups)) ** 3
    expected = textbook.least_alignment_cost(vectors, n_angles) / 10
    assert least_cost(vectors) <= expected + 1e-2
    if n_groups == 2:  # the grid has the best of all
        assert_allclose(least_cost(vectors), expected, atol=1e-3)


@every_size
@pytest.mark.parametrize("seed", range(5))
def test_rotated_indicators_are_found_again(sizes, seed):
    rotated = indicators(sizes) @ random_rotation(len(sizes), seed)
    assert_allclose(least_cost(rotated), 1, atol=1e-3)


def test_equal_groups_begin_on_a_ridge_and_leave_it():
    """Half of the rows (1, 1), half (1, -1): each entry of each row is the largest."""
    rows = normalize_rows(np.repeat([[1.0, 1.0], [1.0, -1.0]], 5, axis=0))
    assert_allclose(angle_gradient(rows), 0, atol=1e-12)
    assert row_cost(rows) == pytest.approx(2)
    assert_allclose(least_cost(rows), 1, atol=1e-12)


@pytest.mark.parametrize("n_groups", [2, 3, 5])
def test_the_cost_does_not_depend_on_a_rotation(n_groups):
    sizes = (15, 12, 9, 7, 5)[:n_groups]
    K, _ = blocks(sizes, between=0.1)
    _, vectors = ViewGraph.from_affinities(K[None], n_groups).sum_spectrum
    for seed in range(5):
        turned = vectors @ random_rotation(n_groups, seed)
        assert_allclose(least_cost(turned), least_cost(vectors), atol=2e-3)


def test_each_step_of_the_descent_lowers_the_cost(monkeypatch):
    """And it stops after the last one that it may take."""
    rows = normalize_rows(random_rows(n_groups=4))
    costs = []
    for n_steps in range(6):
        monkeypatch.setattr(eigenvector_rules, "MAX_STEPS", n_steps)
        rotation = eigenvector_rules._descend(rows)
        assert_allclose(rotation.T @ rotation, np.eye(4), atol=1e-12)
        costs.append(eigenvector_rules.row_cost(rows @ rotation))
    assert costs[0] == eigenvector_rules.row_cost(rows)
    assert (np.diff(costs) < 0).all()


def test_the_length_of_a_row_does_not_matter():
    vectors = random_rows(n_groups=3)
    lengths = np.random.default_rng(1).uniform(0.1, 10, size=(12, 1))
    assert_allclose(least_cost(lengths * vectors), least_cost(vectors))


def test_each_count_starts_from_the_rotation_before():
    """What the counts before have turned, is turned in the next."""
    vectors = indicators((9, 7, 5, 3)) @ random_rotation(4)
    together = alignment_costs(vectors, np.array([2, 3, 4]))
    assert_allclose(together[2, 2], 0, atol=1e-3)
    assert_allclose(together[0], alignment_costs(vectors, np.array([2]))[0])
    assert_allclose(alignment_costs(vectors, np.array([4]))[0, 2], 0, atol=1e-3)


@pytest.mark.parametrize(
    ("costs", "expected"),
    [([0.3, 0.1, 0.2], 1), ([0.1, 0.1, 0.2], 1), ([0.0, 0.0, 0.0], 2), ([0.4], 0)],
)
def test_of_equal_costs_the_largest_count_is_taken(costs, expected):
    costs = np.array(costs)
    assert best_aligned(costs) == expected
    costs[expected] += 0.9 * ALIGNMENT_TOLERANCE
    assert best_aligned(costs) == expected
