"""The ordered residual kernel: how often two tracks prefer the same hypotheses."""

from __future__ import annotations

from copy import copy

import numpy as np
import pytest
from helpers import textbook
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg._core.graph.residual_kernel import (
    Preferences,
    blocks_of_matrix,
    co_occurrence,
    common_pairs,
    covisible_affinity,
    own_affinity,
)

N_HYPOTHESES, N_TOP, N_PAIRS = 20, 5, 6


def random_residuals(n_tracks=30, missing=0.3, seed=0):
    """Residuals without ties; some tracks unseen in some pairs."""
    rng = np.random.default_rng(seed)
    R = rng.chisquare(1, size=(n_tracks, N_PAIRS, N_HYPOTHESES)).astype(np.float32)
    R[rng.uniform(size=(n_tracks, N_PAIRS)) < missing] = np.nan
    return R.reshape(n_tracks, -1)


def coarse_residuals(seed=0):
    """Residuals of three values only: ties everywhere."""
    return np.floor(3 * random_residuals(seed=seed) / 4)


def prefer(R, n_hypotheses=N_HYPOTHESES, n_top=N_TOP):
    """What the tracks of a residual matrix prefer."""
    blocks = blocks_of_matrix(R, n_hypotheses)
    return Preferences.from_blocks(len(R), blocks, n_top)


def marks(R, n_hypotheses=N_HYPOTHESES, n_top=N_TOP):
    """Unpacked marks, bool (n_tracks, n_columns)."""
    preferences = prefer(R, n_hypotheses, n_top)
    unpacked = np.zeros((len(R), len(preferences.rows), n_hypotheses), dtype=bool)
    for pair, rows in enumerate(preferences.rows):
        unpacked[rows, pair] = np.unpackbits(
            preferences.marks[pair], axis=1, count=n_hypotheses
        )
    return unpacked.reshape(R.shape)


def kernel(R, others=None, n_hypotheses=N_HYPOTHESES, n_top=N_TOP, prior=2.0):
    """Affinities of the rows of R to those of ``others``, as ORKKernel chains them."""
    first = prefer(R, n_hypotheses, n_top)
    second = first if others is None else prefer(others, n_hypotheses, n_top)
    return covisible_affinity(
        co_occurrence(first, second), common_pairs(first, second), n_top, prior
    )


# ------------------------------------------------------------------------- preference


def test_the_smallest_residuals_of_each_pair_are_marked():
    R = np.array([[3, 1, 2, 0, 9, 8, 7, 6]], dtype=np.float32)
    assert_array_equal(marks(R, 4, 2), [[0, 1, 0, 1, 0, 0, 1, 1]])


@pytest.mark.parametrize(
    ("residuals", "expected"),
    [
        ([5, 5, 5, 5, 5, 1, 5, 5], [1, 1, 0, 0, 0, 1, 0, 0]),
        ([9, 2, 0, 2, 2, 9, 9, 9], [0, 1, 1, 1, 0, 0, 0, 0]),  # one tie too many
        ([4, 4, 4, 9, 9, 9, 9, 9], [1, 1, 1, 0, 0, 0, 0, 0]),
        ([0, 0, 0, 0, 0, 0, 0, 0], [1, 1, 1, 0, 0, 0, 0, 0]),
    ],
)
def test_of_equal_residuals_the_first_are_marked(residuals, expected):
    assert_array_equal(marks(np.array([residuals], dtype=np.float32), 8, 3), [expected])


@pytest.mark.parametrize("make", [random_residuals, coarse_residuals])
def test_each_track_marks_as_many_in_each_pair_that_sees_it(make):
    R = make()
    seen = prefer(R).seen
    counts = marks(R).reshape(len(R), N_PAIRS, N_HYPOTHESES).sum(axis=2)
    assert_array_equal(counts, N_TOP * seen)


def test_a_single_nan_makes_a_track_unseen_in_the_pair():
    R = random_residuals(missing=0)
    R[4, N_HYPOTHESES + 3] = np.nan
    seen = prefer(R).seen
    assert_array_equal(np.argwhere(~seen), [[4, 1]])
    assert not marks(R)[4, N_HYPOTHESES : 2 * N_HYPOTHESES].any()


def test_all_hypotheses_can_be_preferred():
    R = random_residuals(missing=0)
    assert marks(R, n_top=N_HYPOTHESES).all()


def test_only_the_order_within_a_pair_counts():
    R = random_residuals()
    stretched = R.reshape(-1, N_PAIRS, N_HYPOTHESES) ** 3 * np.arange(1, 7)[:, None]
    assert_array_equal(kernel(stretched.reshape(R.shape)), kernel(R))


def test_the_order_of_the_hypotheses_of_a_pair_does_not_count():
    R = random_residuals()
    order = np.random.default_rng(1).permutation(N_HYPOTHESES)
    shuffled = R.reshape(-1, N_PAIRS, N_HYPOTHESES)[:, :, order]
    assert_array_equal(kernel(shuffled.reshape(R.shape)), kernel(R))


def test_the_order_of_the_pairs_does_not_count():
    R = random_residuals()
    backwards = R.reshape(-1, N_PAIRS, N_HYPOTHESES)[:, ::-1]
    assert_array_equal(kernel(backwards.reshape(R.shape)), kernel(R))


@pytest.mark.parametrize("step", [1, 2, 4])
def test_some_pairs_are_those_of_their_columns(step):
    R, pairs = random_residuals(), np.arange(N_PAIRS)[::step]
    columns = R.reshape(len(R), N_PAIRS, N_HYPOTHESES)[:, pairs].reshape(len(R), -1)
    some, expected = prefer(R).of_pairs(pairs), prefer(columns)
    assert_array_equal(some.seen, expected.seen)
    assert_array_equal(co_occurrence(some, some), co_occurrence(expected, expected))


def test_residuals_are_left_alone():
    R = random_residuals()
    before = R.copy()
    kernel(R)
    assert_array_equal(R, before)


# ----------------------------------------------------------------------- co-occurrence


@pytest.mark.parametrize("n_columns", [1, 7, 8, 9, 64, 501])
def test_counts_are_those_of_the_marks(n_columns):
    both = np.random.default_rng(0).uniform(size=(11, 3, n_columns)) < 0.2
    both[2, 1] = both[7, 0] = both[8, 2] = False  # not seen there
    first, second = (
        Preferences(
            len(marks),
            [np.flatnonzero(marks[:, pair].any(axis=1)) for pair in range(3)],
            [
                np.packbits(marks[marks[:, pair].any(axis=1), pair], axis=1)
                for pair in range(3)
            ],
        )
        for marks in (both[:4], both[4:])
    )
    counts = co_occurrence(first, second)
    assert counts.dtype == np.float32
    a, b = both[:4].reshape(4, -1).astype(int), both[4:].reshape(7, -1).astype(int)
    assert_array_equal(counts, a @ b.T)


def test_rows_against_themselves_count_as_against_a_copy():
    first = prefer(random_residuals())
    assert_array_equal(co_occurrence(first, first), co_occurrence(first, copy(first)))


def test_counts_are_positive_semidefinite():
    packed = prefer(random_residuals())
    assert np.linalg.eigvalsh(co_occurrence(packed, packed).astype(float))[0] > -1e-9


# -------------------------------------------------------------------------- the kernel


@pytest.mark.parametrize("make", [random_residuals, coarse_residuals])
@pytest.mark.parametrize("prior", [0, 0.5, 2])
@pytest.mark.parametrize("n_top", [1, 5, 20])
def test_the_kernel_equals_the_textbook(make, prior, n_top):
    R = make()
    expected = textbook.ordered_residual_kernel(R, N_HYPOTHESES, n_top, prior)
    K = kernel(R, n_top=n_top, prior=prior)
    assert_array_equal(K, expected.astype(np.float32))


@pytest.mark.parametrize("prior", [0, 2])
def test_the_kernel_is_symmetric_and_between_0_and_1(prior):
    K = kernel(random_residuals(), prior=prior)
    assert_array_equal(K, K.T)
    assert K.min() == 0
    assert 0.5 < K.max() <= 1


@pytest.mark.parametrize("prior", [0, 0.5, 2])
def test_no_affinity_of_a_row_is_larger_than_its_own(prior):
    K = kernel(random_residuals(), prior=prior)
    assert_array_equal(K.max(axis=1), K.diagonal())


@pytest.mark.parametrize("prior", [0, 0.5, 2])
def test_own_affinities_are_the_diagonal(prior):
    R = random_residuals()
    seen = prefer(R).seen
    own = own_affinity(seen.sum(axis=1), prior)
    assert_allclose(kernel(R, prior=prior).diagonal(), own, rtol=1e-7)


def test_tracks_in_another_order_have_the_same_affinities():
    R = coarse_residuals()
    order = np.random.default_rng(1).permutation(len(R))
    assert_array_equal(kernel(R[order]), kernel(R)[order][:, order])


def test_rows_that_were_not_fitted_have_the_affinities_of_those_that_were():
    R = random_residuals()
    assert_array_equal(kernel(R[:7], R[7:]), kernel(R)[:7, 7:])


def test_tracks_with_the_same_residuals_are_as_close_as_can_be():
    R = np.repeat(random_residuals(n_tracks=1, missing=0), 3, axis=0)
    assert_array_equal(kernel(R, prior=0), np.ones((3, 3)))
    assert_allclose(kernel(R, prior=2), N_PAIRS / (N_PAIRS + 2))


def test_tracks_that_never_meet_have_no_affinity():
    R = random_residuals(n_tracks=2, missing=0)
    R[0, : 3 * N_HYPOTHESES] = np.nan
    R[1, 3 * N_HYPOTHESES :] = np.nan
    for prior in (0, 2):
        K = kernel(R, prior=prior)
        assert K[0, 1] == K[1, 0] == 0
        assert K.diagonal().min() > 0


def test_a_track_that_no_pair_sees_has_no_affinity_to_any():
    R = random_residuals()
    R[3] = np.nan
    for prior in (0, 2):
        K = kernel(R, prior=prior)
        assert not K[3].any()
        assert not K[:, 3].any()
    assert_array_equal(own_affinity([0, 4], 0), [0, 1])
    assert_array_equal(own_affinity([0, 4], 4), [0, 0.5])


def test_the_prior_is_a_number_of_pairs_that_agree_on_nothing():
    counts, n_common = np.array([[10.0, 30.0]]), np.array([[1.0, 6.0]])
    assert_array_equal(covisible_affinity(counts, n_common, 10, 0), [[1, 0.5]])
    assert_array_equal(covisible_affinity(counts, n_common, 10, 4), [[0.2, 0.3]])
