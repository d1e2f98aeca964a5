"""Cuts and reconstruction errors equal the textbook and obey their bounds."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import textbook
from numpy.testing import assert_allclose

from skmotionseg._core.graph.cuts import (
    cuts_between,
    normalized_cut,
    own_shares,
    partition_costs,
    reconstruction_error,
)
from skmotionseg._core.labels import (
    indicator,
)

COSTS = [normalized_cut, reconstruction_error]


every_cost = pytest.mark.parametrize("cost", COSTS)


def random_affinity(n=20, seed=0):
    K = np.random.default_rng(seed).uniform(size=(n, n))
    return K + K.T


def random_labels(n=20, n_groups=3, seed=0, outliers=False):
    """Each group has a track at least."""
    rng = np.random.default_rng(seed)
    lowest = -1 if outliers else 0
    labels = rng.integers(lowest, n_groups, size=n)
    labels[rng.permutation(n)[: n_groups - lowest]] = range(lowest, n_groups)
    return labels


def components(n_groups=3, size=4):
    """Labels, and an affinity of 1 within each group and 0 across."""
    labels = np.repeat(np.arange(n_groups), size)
    return (labels[:, None] == labels).astype(float), labels


# --------------------------------------------------------------- equality with the book


@pytest.mark.parametrize("outliers", [False, True])
@pytest.mark.parametrize("n_groups", [1, 2, 5])
@pytest.mark.parametrize("name", ["normalized_cut", "reconstruction_error"])
def test_costs_equal_the_textbook(name, n_groups, outliers):
    K, labels = random_affinity(), random_labels(n_groups=n_groups, outliers=outliers)
    cost = {c.__name__: c for c in COSTS}[name](K, labels)
    assert isinstance(cost, float)
    assert_allclose(cost, getattr(textbook, name)(K, labels), atol=1e-12)


@pytest.mark.parametrize("n_views", [1, 3])
@pytest.mark.parametrize("delta", [0, 0.2, 1])
def test_the_costs_of_a_partition_are_sums_over_views(n_views, delta):
    views = np.stack([random_affinity(seed=seed) for seed in range(n_views)])
    labels = random_labels()
    expected = textbook.ncre_costs(views, labels, delta)
    assert_allclose(partition_costs(views, labels, delta), expected)


def test_the_total_is_that_of_the_paper_but_for_a_constant():
    """Eq. 13 has traces for norms, and drops ``2 delta`` a view."""
    views = np.stack([random_affinity(seed=seed) for seed in range(3)])
    labels, delta = random_labels(), 0.3
    X = indicator(labels)
    expected = sum(
        normalized_cut(K, labels)
        - delta
        * 2
        * np.trace(X @ X.T @ K)
        / (np.linalg.norm(X @ X.T) * np.linalg.norm(K))
        for K in views
    )
    total = partition_costs(views, labels, delta)[2]
    assert_allclose(total - 2 * delta * len(views), expected)


# ----------------------------------------------------------------------- normalised cut


def test_the_cut_of_connected_components_is_zero():
    K, labels = components()
    assert normalized_cut(K, labels) == 0


def test_the_cut_of_one_group_is_zero():
    assert_allclose(normalized_cut(random_affinity(), np.zeros(20, int)), 0, atol=1e-15)


def test_splitting_a_component_in_half_costs_one():
    """Each half cuts as much as it keeps: 1/2 + 1/2."""
    K, labels = components(n_groups=2)
    assert_allclose(normalized_cut(K, labels * 0 + [0, 0, 1, 1, 2, 2, 2, 2]), 1)


def test_tracks_of_no_group_are_cut_off_but_have_no_cost_of_their_own():
    K = np.ones((4, 4))
    assert_allclose(normalized_cut(K, np.array([0, 0, -1, -1])), 0.5)


@pytest.mark.parametrize("n_groups", [1, 2, 6])
@pytest.mark.parametrize("outliers", [False, True])
def test_a_cut_costs_at_most_one_a_group(n_groups, outliers):
    for seed in range(10):
        labels = random_labels(n_groups=n_groups, seed=seed, outliers=outliers)
        K = random_affinity(seed=seed)
        K[labels[:, None] == labels] = 0  # the worst: nothing is kept
        assert normalized_cut(K, labels) <= n_groups
    assert normalized_cut(1 - np.eye(2), np.arange(2)) == 2


@pytest.mark.parametrize("n_groups", [1, 2, 6])
def test_a_positive_semidefinite_affinity_costs_at_most_one_a_group_less_one(n_groups):
    for seed in range(10):
        features = np.random.default_rng(seed).uniform(size=(20, 3)) ** 6
        labels = random_labels(n_groups=n_groups, seed=seed)
        cost = normalized_cut(features @ features.T, labels)
        assert -1e-12 <= cost <= n_groups - 1 + 1e-12


def test_groups_without_affinity_cut_nothing():
    K, labels = components(n_groups=2)
    K[labels == 1] = 0
    assert normalized_cut(K, labels) == 0
    assert normalized_cut(np.zeros((4, 4)), np.array([0, 0, 1, -1])) == 0


# ----------------------------------------------------------------- reconstruction error


def test_the_affinity_of_a_partition_is_reconstructed_without_error():
    K, labels = components()
    assert_allclose(reconstruction_error(K, labels), 0, atol=1e-15)


def test_a_partition_without_any_affinity_inside_has_error_two():
    K, labels = components(n_groups=2)
    assert reconstruction_error(1 - K, labels) == 2


def test_any_other_partition_reconstructs_worse():
    K, labels = components()
    for moved in range(len(labels)):
        other = labels.copy()
        other[moved] = (labels[moved] + 1) % 3
        assert reconstruction_error(K, other) > 0.1
    assert reconstruction_error(K, labels * 0) > 0.1


def test_the_error_is_between_0_and_2():
    for seed in range(10):
        labels = random_labels(n_groups=4, seed=seed, outliers=True)
        assert 0 <= reconstruction_error(random_affinity(seed=seed), labels) <= 2


def test_nothing_to_reconstruct_has_error_two():
    assert reconstruction_error(np.zeros((3, 3)), np.array([0, 0, 1])) == 2
    assert reconstruction_error(np.ones((3, 3)), np.full(3, -1)) == 2


# ---------------------------------------------------------------------------- both


@every_cost
def test_costs_ignore_the_scale_of_the_affinity(cost):
    K, labels = random_affinity(), random_labels()
    assert_allclose(cost(40 * K, labels), cost(K, labels))


@every_cost
def test_costs_ignore_the_numbers_of_the_groups(cost):
    K, labels = random_affinity(), random_labels()
    assert_allclose(cost(K, np.array([2, 0, 1])[labels]), cost(K, labels))


@every_cost
def test_costs_ignore_the_order_of_the_tracks(cost):
    K, labels = random_affinity(), random_labels()
    order = np.random.default_rng(1).permutation(20)
    assert_allclose(cost(K[order][:, order], labels[order]), cost(K, labels))


@every_cost
def test_costs_of_a_single_track_are_zero(cost):
    assert cost(np.array([[0.7]]), np.array([0])) == 0


@pytest.mark.parametrize("seed", range(3))
def test_the_cut_between_two_groups_is_what_merging_them_saves(seed):
    rng = np.random.default_rng(seed)
    K = rng.uniform(size=(12, 12))
    K = K + K.T
    labels = np.arange(12) % 4
    found = cuts_between(K, labels)
    assert (np.diagonal(found) == 0).all()
    for i in range(4):
        for j in range(i):
            merged = np.where(labels == i, j, labels)
            merged = np.unique(merged, return_inverse=True)[1]
            fall = textbook.normalized_cut(K, labels)
            fall -= textbook.normalized_cut(K, merged)
            assert found[i, j] == pytest.approx(fall)
            assert found[j, i] == pytest.approx(fall)


def test_cuts_between_are_what_a_merge_saves():
    rng = np.random.default_rng(0)
    affinity = rng.random((30, 30))
    affinity += affinity.T
    labels = np.arange(30) % 4
    saved = cuts_between(affinity, labels)
    for i in range(4):
        assert saved[i, i] == 0
        for j in range(i):
            merged = np.where(labels == i, j, labels)
            merged = np.unique(merged, return_inverse=True)[1]
            expected = normalized_cut(affinity, labels) - normalized_cut(
                affinity, merged
            )
            assert saved[i, j] == saved[j, i] == pytest.approx(expected)


def test_own_shares_are_one_step_of_a_walk():
    affinity = np.array([[9, 1, 3], [1, 9, 0], [3, 0, 9.0]])
    shares = own_shares(affinity[None], np.array([0, 0, 1]))
    np.testing.assert_allclose(shares, [1 / 4, 1, 0])
    assert (own_shares(np.eye(3)[None], np.array([0, 0, 1])) == 0).all()
    assert own_shares(affinity[None], np.array([-1, 0, 0]))[0] == 0


def test_shares_are_means_over_the_views_that_link_a_track():
    first = np.array([[9, 1, 3], [1, 9, 0], [3, 0, 9.0]])
    second = np.array([[9, 0.2, 0.2], [0.2, 9, 0], [0.2, 0, 9]])
    third = np.eye(3)  # links none
    labels = np.array([0, 0, 1])
    shares = own_shares(np.stack([first, second, third]), labels)
    np.testing.assert_allclose(shares, [(1 / 4 + 1 / 2) / 2, 1, 0])
    second[0, 1:] = second[1:, 0] = 0  # the first track has no link here
    shares = own_shares(np.stack([first, second]), labels)
    np.testing.assert_allclose(shares, [1 / 4, 1, 0])
