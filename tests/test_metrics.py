"""The scores against brute force and by their properties."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from skmotionseg.metrics import (
    fbms_scores,
    misclassification_error,
    motion_count_accuracy,
)


def labellings(seed, n=24, n_true=3, n_found=3, outliers=True):
    rng = np.random.default_rng(seed)
    lowest = -1 if outliers else 0
    true = rng.integers(lowest, n_true, size=n)
    true[:n_true] = np.arange(n_true)
    found = rng.integers(lowest, n_found, size=n)
    found[:n_found] = np.arange(n_found)
    return true, found


def matchings(true, found):
    """All ways to match labels one to one, as dicts from found to true."""
    true, found = np.unique(true[true >= 0]), np.unique(found[found >= 0])
    if len(found) <= len(true):
        for chosen in permutations(true, len(found)):
            yield dict(zip(found, chosen, strict=True))
    else:
        for chosen in permutations(found, len(true)):
            yield dict(zip(chosen, true, strict=True))


# ----------------------------------------------------------- misclassification error


@pytest.mark.parametrize("n_found", [1, 2, 3, 5])
@pytest.mark.parametrize("seed", range(5))
def test_the_error_is_that_of_the_best_matching(seed, n_found):
    true, found = labellings(seed, n_found=n_found)
    judged = true >= 0
    errors = [
        np.mean([match.get(f) != t for t, f in zip(true, found, strict=True) if t >= 0])
        for match in matchings(true, found[judged])
    ]
    assert_allclose(misclassification_error(true, found), min(errors))


@pytest.mark.parametrize(
    "true, found, error",
    [
        pytest.param([0, 0, 1, 1], [0, 0, 1, 1], 0, id="equal"),
        pytest.param([0, 0, 1, 1], [7, 7, 3, 3], 0, id="other numbers"),
        pytest.param([0, 0, 1, 1], [0, 0, 0, 0], 1 / 2, id="merged"),
        pytest.param([0, 0, 0, 0], [0, 0, 1, 2], 1 / 2, id="split"),
        pytest.param([0, 0, 1, 1], [0, -1, 1, 1], 1 / 4, id="found no motion"),
        pytest.param([0, 0, 1, 1], [-1, -1, -1, -1], 1, id="found nothing"),
        pytest.param([0, 0, 1, -1], [0, 0, 1, 0], 0, id="outlier in a motion"),
        pytest.param([0, 0, 1, -1, -1], [0, 0, 1, 2, 2], 0, id="outliers together"),
        pytest.param([0, 1, 1, 1], [0, 0, 0, 1], 1 / 2, id="one to one"),
        pytest.param([5], [2], 0, id="one track"),
        pytest.param([0.0, 1.0], [True, False], 0, id="whole numbers of other types"),
    ],
)
def test_errors_by_hand(true, found, error):
    assert misclassification_error(true, found) == error


def test_the_error_does_not_depend_on_names_or_order():
    true, found = labellings(0)
    rng = np.random.default_rng(1)
    expected = misclassification_error(true, found)
    order = rng.permutation(len(true))
    renamed = np.where(found >= 0, np.array([9, 4, 6])[found], -1)
    assert misclassification_error(true[order], renamed[order]) == expected


def test_the_error_is_a_plain_float():
    assert type(misclassification_error([0, 1], [0, 0])) is float


# ------------------------------------------------------------- motion count accuracy


@pytest.mark.parametrize(
    "true, found, accuracy",
    [
        ([2, 3, 4], [2, 3, 5], 2 / 3),
        ([[0, 0, 1], [0, 1, 2]], [[1, 0, 0], [0, 0, 1]], 1 / 2),
        ([[0, 1, -1]], [[0, 0, 1]], 1),
        ([[0, 1]], [[0, -1]], 0),
        ([[-1, -1]], [[0, 0]], 0),
        ([2, [0, 1, 2]], [[5, 7], 3], 1),
    ],
)
def test_motion_count_accuracy(true, found, accuracy):
    assert motion_count_accuracy(true, found) == accuracy


# ------------------------------------------------------------------------ FBMS scores


def fbms_by_brute_force(true, found):
    """Precision and recall of each matching of the largest sum of F-measures."""
    true, found = true[true >= 0], found[true >= 0]
    n_regions, n_groups = (len(np.unique(x[x >= 0])) for x in (true, found))
    scores = []
    for match in matchings(true, found):
        shares = [
            (np.mean(true[found == f] == t), np.mean(found[true == t] == f))
            for f, t in match.items()
        ]
        total = sum(2 * p * r / (p + r) if p + r else 0 for p, r in shares)
        precision, recall = np.sum(shares, axis=0) / [n_groups, n_regions]
        scores.append((total, precision, recall))
    best = max(scores)[0]
    return [score[1:] for score in scores if np.isclose(score[0], best)]


@pytest.mark.parametrize("n_found", [1, 3, 5])
@pytest.mark.parametrize("seed", range(5))
def test_fbms_scores_are_those_of_the_best_matching(seed, n_found):
    true, found = labellings(seed, n_found=n_found)
    density, precision, recall, f_measure = fbms_scores(true, found)
    best = fbms_by_brute_force(true, found)
    assert any(np.allclose((precision, recall), scores) for scores in best)
    assert_allclose(f_measure, 2 * precision * recall / (precision + recall))
    assert_allclose(density, np.mean(found[true >= 0] >= 0))


@pytest.mark.parametrize(
    "true, found, scores",
    [
        pytest.param([0, 0, 1, 1], [1, 1, 0, 0], (1, 1, 1, 1), id="perfect"),
        pytest.param([0, 0, 1, 1], [-1] * 4, (0, 0, 0, 0), id="nothing"),
        pytest.param([0, 0, 1, 1], [0] * 4, (1, 1 / 2, 1 / 2, 1 / 2), id="merged"),
        pytest.param([0] * 4, [0, 0, 1, 1], (1, 1 / 2, 1 / 2, 1 / 2), id="split"),
        pytest.param([0, 0, 1, 1], [0, -1, 1, -1], (1 / 2, 1, 1 / 2, 2 / 3), id="half"),
        pytest.param([0, 0, -1, -1], [0, 0, 0, 1], (1, 1, 1, 1), id="not annotated"),
    ],
)
def test_fbms_scores_by_hand(true, found, scores):
    assert_allclose(fbms_scores(true, found), scores)
