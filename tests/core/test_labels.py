"""Labels, their canonical order, and votes of neighbours."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from skmotionseg._core.labels import (
    canonical_labels,
    follow_pairs,
    indicator,
    nearest_labels,
    nearest_votes,
    nearest_votes_in_each,
)


def random_labels(n=20, n_groups=3, seed=0, outliers=False):
    """Each group has a track at least."""
    rng = np.random.default_rng(seed)
    lowest = -1 if outliers else 0
    labels = rng.integers(lowest, n_groups, size=n)
    labels[rng.permutation(n)[: n_groups - lowest]] = range(lowest, n_groups)
    return labels


def test_the_indicator_has_a_column_a_group():
    X = indicator(np.array([1, -1, 0, 1]))
    assert_array_equal(X, [[0, 1], [0, 0], [1, 0], [0, 1]])
    assert indicator(np.array([-1, -1])).shape == (2, 0)


# ----------------------------------------------------------------------------- labels


@pytest.mark.parametrize(
    ("labels", "expected"),
    [
        ([7, 3, 3], [1, 0, 0]),
        ([0, 1, 1, 2, 2, 2], [2, 1, 1, 0, 0, 0]),
        ([5, 2, 5, 2], [0, 1, 0, 1]),  # of one size: who comes first
        ([-1, 4, -1, -1], [-1, 0, -1, -1]),
        ([-3, 1, -1], [-1, 0, -1]),
        ([-1, -1], [-1, -1]),
        ([], []),
    ],
)
def test_labels_are_numbered_from_the_largest_group_down(labels, expected):
    assert_array_equal(canonical_labels(np.array(labels, dtype=int)), expected)


@pytest.mark.parametrize("seed", range(5))
def test_canonical_labels_are_the_same_partition(seed):
    labels = random_labels(n=30, n_groups=5, seed=seed, outliers=True)
    canonical = canonical_labels(labels)
    together, apart = labels[:, None] == labels, canonical[:, None] == canonical
    assert_array_equal(together, apart)
    assert_array_equal(canonical == -1, labels == -1)


@pytest.mark.parametrize("seed", range(5))
def test_canonical_groups_shrink(seed):
    canonical = canonical_labels(random_labels(n=30, n_groups=5, seed=seed))
    sizes = np.bincount(canonical)
    assert len(sizes) == 5
    assert (np.diff(sizes) <= 0).all()


@pytest.mark.parametrize("seed", range(5))
def test_canonical_labels_do_not_depend_on_the_names(seed):
    labels = random_labels(n=30, n_groups=5, seed=seed)
    renamed = np.random.default_rng(seed).permutation(50)[labels]
    expected = canonical_labels(labels)
    assert_array_equal(canonical_labels(renamed), expected)
    assert_array_equal(canonical_labels(expected), expected)


def test_labels_are_left_alone():
    labels = np.array([2, 0, 0, -1])
    canonical_labels(labels)
    assert_array_equal(labels, [2, 0, 0, -1])


def test_nearest_labels_vote_by_affinity():
    affinity = np.array([[0.9, 0.1, 0.1, 0.1], [0, 0, 0, 0], [0.3, 0.2, 0.2, 0]])
    labels = np.array([0, 1, 1, -1])
    np.testing.assert_array_equal(nearest_labels(affinity, labels), [0, -1, 1])


def test_rows_labelled_minus_one_have_no_vote():
    labels = np.array([-1, 0])
    np.testing.assert_array_equal(nearest_labels(np.array([[1.0, 0.1]]), labels), [0])
    np.testing.assert_array_equal(nearest_labels(np.array([[1.0, 0.0]]), labels), [-1])
    np.testing.assert_array_equal(
        nearest_labels(np.ones((2, 2)), np.array([-1, -1])), [-1, -1]
    )


def test_ties_vote_and_those_of_no_motion_do_not():
    labels = np.array([1, 0, 0, -1, 1, 0, 0])
    affinity = np.array(
        [
            [0.5, 0.2, 0.2, 9, 0.4, 0.2, 0.2],  # the third is tied with three others
            [0.1, 0.3, 0.2, 9, 0.1, 0.0, 0.0],
            [0.0, 0.0, 0.0, 9, 0.0, 0.0, 0.0],
            [0.9, 0.0, 0.0, 0, 0.0, 0.5, 0.3],
        ]
    )
    found, shares = nearest_votes(affinity, labels, n_nearest=3)
    assert found.tolist() == [1, 0, -1, 1]
    np.testing.assert_allclose(shares, [0.9 / 1.7, 0.5 / 0.7, 0, 0.9 / 1.7])
    found, shares = nearest_votes(affinity, np.full(7, -1))
    assert found.tolist() == [-1] * 4
    assert shares.tolist() == [0] * 4


def test_votes_are_shared():
    labels, shares = nearest_votes(
        np.array([[3.0, 1, 0], [0, 0, 0]]), np.array([0, 1, 1])
    )
    assert labels.tolist() == [0, -1]
    np.testing.assert_allclose(shares, [0.75, 0])


@pytest.mark.parametrize("levels", [3, 40, None])
@pytest.mark.parametrize("n_fitted", [8, 24, 25, 200])
@pytest.mark.parametrize("outliers", [0.0, 0.5, 0.95, 1.0])
def test_votes_in_each_partition_are_those_in_one(levels, n_fitted, outliers):
    rng = np.random.default_rng(n_fitted)
    affinity = rng.uniform(size=(60, n_fitted))
    if levels is not None:  # with ties, and rows that have no affinity at all
        affinity = np.floor(levels * affinity) / levels
        affinity[::7] = 0
    partitions = rng.integers(5, size=(4, n_fitted))
    partitions[rng.uniform(size=partitions.shape) < outliers] = -1
    partitions[0] = 0
    found, shares = nearest_votes_in_each(affinity, partitions)
    for k, labels in enumerate(partitions):
        expected = nearest_votes(affinity, labels)
        np.testing.assert_allclose(shares[k], expected[1], rtol=1e-12)
        # Where several have most votes, rounding may decide.
        unequal = np.flatnonzero(found[k] != expected[0])
        votes = _votes_by_sorting(affinity[unequal], labels)
        for row, label in zip(votes, found[k][unequal], strict=True):
            np.testing.assert_allclose(row[label], row.max(), rtol=1e-12)


def _votes_by_sorting(affinity, labels, n_nearest=5):
    """Votes (m, M), one row and one voter after another."""
    votes = np.zeros((len(affinity), labels.max(initial=-1) + 1))
    voters = np.flatnonzero(labels >= 0)
    for row, own in zip(votes, affinity[:, voters], strict=True):
        last = np.sort(own)[-n_nearest:][0]
        for value, voter in zip(own, voters, strict=True):
            row[labels[voter]] += value if value >= last else 0
    return votes


def test_pairs_follow_their_groups():
    before = np.array([[0, 0, 0, 1, 1, 2], [0, 0, 0, 1, 1, 2]])
    after = np.array([[1, 1, -1, 0, 0, 2], [0, 0, 0, -1, -1, 1]])
    pairs = np.array([[0, 2], [-1, -1]])
    assert_array_equal(follow_pairs(pairs, before, after), [[1, 2], [-1, -1]])
    assert_array_equal(follow_pairs(None, before, after), np.full((2, 2), -1))
