"""The epsilon-neighbourhood: which affinities of a row stay."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import textbook
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg._core.graph.neighbourhood import (
    neighbourhood_thresholds,
    sparsify,
    strongest,
)

every_alpha = pytest.mark.parametrize("alpha", [0.5, 1, 5, 6, 10])


def random_affinity(n=25, seed=0):
    """Symmetric; no affinity of a row is larger than its own, on the diagonal."""
    rng = np.random.default_rng(seed)
    K = rng.uniform(0.1, 1, size=(n, n))
    K = (K + K.T) / 2
    np.fill_diagonal(K, K.max(axis=0) + rng.uniform(0, 0.1, size=n))
    return K


def sparse(K, alpha):
    t = neighbourhood_thresholds(K, alpha, K.diagonal())
    return sparsify(K, t, t)


def kept(row, alpha, own=None):
    """Which entries of one row are above its threshold."""
    row = np.atleast_2d(row)
    own = row.max(axis=1) if own is None else np.atleast_1d(own)
    return row[0] > neighbourhood_thresholds(row, alpha, own)[0]


@every_alpha
@pytest.mark.parametrize("seed", range(3))
def test_sparse_affinities_equal_the_textbook(alpha, seed):
    K = random_affinity(seed=seed)
    expected = textbook.epsilon_neighbourhood(K, alpha)
    assert 0 < np.mean(expected < K) < 1
    assert_array_equal(sparse(K, alpha), expected)


def test_affinities_far_below_the_own_are_resolved():
    """In doubles, ``1 - 0.01^10`` is 1: the logarithms must see the difference."""
    row = [1, 0.02, 0.01, 0.01, 0.01]
    assert_array_equal(kept(row, 10), [True, True, False, False, False])


def test_the_larger_the_exponent_the_fewer_entries_are_kept():
    """Also where powers are less than the least double that is above 0."""
    K = random_affinity()
    exponents = [2, 50, 300, 400, 1000, 1e6, 1e300]
    shares = [np.mean(sparse(K, alpha) > 0) for alpha in exponents]
    assert (np.diff(shares) <= 0).all()
    assert shares[-1] <= 3 / 25  # itself, and what is nearest


def test_thresholds_do_not_jump_where_logarithms_take_over(monkeypatch):
    K = random_affinity()
    plain = neighbourhood_thresholds(K, 60, K.diagonal())
    monkeypatch.setattr("skmotionseg._core.graph.neighbourhood.TINY", 1e-12)
    assert_allclose(neighbourhood_thresholds(K, 60, K.diagonal()), plain, rtol=1e-6)


@every_alpha
def test_the_mask_is_averaged_with_its_transpose(alpha):
    K = random_affinity()
    S = sparse(K, alpha)
    assert_array_equal(S, S.T)
    assert_array_equal(np.unique((S / K).round(12)), [0, 0.5, 1])


@every_alpha
def test_a_row_keeps_its_own_affinity(alpha):
    K = random_affinity()
    assert_array_equal(sparse(K, alpha).diagonal(), K.diagonal())


@every_alpha
def test_tracks_in_another_order_keep_the_same(alpha):
    K = random_affinity()
    order = np.random.default_rng(1).permutation(len(K))
    assert_array_equal(
        sparse(K[order][:, order], alpha), sparse(K, alpha)[order][:, order]
    )


@every_alpha
@pytest.mark.parametrize("factor", [1e-3, 0.25, 40])
def test_thresholds_scale_with_the_affinity(alpha, factor):
    K = random_affinity()
    assert_allclose(
        neighbourhood_thresholds(factor * K, alpha, factor * K.diagonal()),
        factor * neighbourhood_thresholds(K, alpha, K.diagonal()),
    )


def test_a_larger_alpha_keeps_less():
    K = random_affinity(n=60)
    n_kept = [np.count_nonzero(sparse(K, alpha)) for alpha in (0.5, 1, 2, 5, 10, 15)]
    assert n_kept == sorted(n_kept, reverse=True)
    assert n_kept[0] > 1.5 * n_kept[-1]


def test_a_row_does_not_depend_on_the_others():
    K = random_affinity()
    t = neighbourhood_thresholds(K, 6, K.diagonal())
    alone = [neighbourhood_thresholds(K[[i]], 6, K[[i], [i]])[0] for i in range(len(K))]
    assert_array_equal(t, alone)


def test_single_precision_affinities_have_the_thresholds_of_double():
    K = random_affinity()
    single = K.astype(np.float32)
    t = neighbourhood_thresholds(single, 6, single.diagonal())
    assert_allclose(t, neighbourhood_thresholds(K, 6, K.diagonal()), rtol=1e-5)
    assert sparsify(single, t, t).dtype == np.float32


# ----------------------------------------------------- rows in which nothing stands out


@every_alpha
def test_a_zero_row_has_threshold_zero(alpha):
    K = np.zeros((1, 4))
    assert_array_equal(neighbourhood_thresholds(K, alpha, np.zeros(1)), [0])


@every_alpha
@pytest.mark.parametrize("value", [1.0, 0.3, 1e-6])
def test_a_constant_row_keeps_all(alpha, value):
    assert kept(np.full(5, value), alpha).all()


@every_alpha
@pytest.mark.parametrize("n_seen", [1, 3, 5, 7, 9, 10, 26, 38])
def test_a_row_that_is_constant_but_for_rounding_keeps_all(alpha, n_seen):
    """Affinities are single, the own is double: ``float32(5 / 7) != 5 / 7``."""
    own = n_seen / (n_seen + 2)
    assert kept(np.full(6, own, dtype=np.float32), alpha, own).all()


@every_alpha
@pytest.mark.parametrize("n_seen", [1, 3, 5, 7, 9, 10, 26, 38])
def test_tracks_that_agree_but_for_rounding_stay_together(alpha, n_seen):
    """Two groups that are each of one mind, and have nothing in common."""
    own = n_seen / (n_seen + 2)
    K = np.kron(np.eye(2), np.full((4, 4), own)).astype(np.float32)
    t = neighbourhood_thresholds(K, alpha, np.full(8, own))
    assert_array_equal(sparsify(K, t, t), K)


@every_alpha
@pytest.mark.parametrize("n_others", [1, 2, 3, 6, 11])
def test_equal_affinities_to_all_others_are_at_the_level_and_go(alpha, n_others):
    """``log p_j`` then equals the sum; the inequality is strict, in any rounding."""
    for affinity in np.linspace(0.02, 0.98, 49):
        expected = [True] + n_others * [False]
        assert_array_equal(kept([1] + n_others * [affinity], alpha), expected)


def test_a_single_row_of_one_entry_keeps_it():
    assert_array_equal(sparse(np.array([[0.7]]), 6), [[0.7]])


# ------------------------------------------------------------------------- rectangles


def test_rows_that_were_not_fitted_are_treated_like_those_that_were():
    K = random_affinity()
    t = neighbourhood_thresholds(K, 6, K.diagonal())
    rows = K[:4]
    row_t = neighbourhood_thresholds(rows, 6, K.diagonal()[:4])
    assert_array_equal(sparsify(rows, row_t, t), sparsify(K, t, t)[:4])


def test_each_end_that_lets_go_halves_an_affinity():
    K = np.array([[0.4, 0.4], [0.8, 0.8]])
    S = sparsify(K, np.array([0.5, 0.5]), np.array([0.3, 0.5]))
    assert_array_equal(S, [[0.2, 0], [0.8, 0.8]])


def test_an_affinity_at_the_threshold_goes():
    half = np.array([0.5])
    assert_array_equal(sparsify(np.array([[0.5]]), half, half), [[0]])


# ---------------------------------------------------------------- so many links of each


@pytest.mark.parametrize("n_links", [1, 5, 23])
def test_the_strongest_links_are_kept(n_links):
    K = random_affinity()
    np.fill_diagonal(K, 0)
    expected = np.zeros_like(K)
    for i, row in enumerate(K):
        for j in np.argsort(-row)[:n_links]:
            expected[[i, j], [j, i]] += K[i, j] / 2
    assert_allclose(strongest(random_affinity(), n_links), expected)


@pytest.mark.parametrize("n_links", [24, 25, 100])
def test_with_fewer_others_all_links_are_kept(n_links):
    K = random_affinity()
    np.fill_diagonal(K, 0)
    assert_array_equal(strongest(random_affinity(), n_links), K)


def test_equal_links_are_kept_together():
    K = np.ones((6, 6))
    assert_array_equal(strongest(K, 2), 1 - np.eye(6))


def test_the_affinity_that_is_given_stays():
    K = random_affinity()
    strongest(K, 3)
    assert_array_equal(K, random_affinity())
