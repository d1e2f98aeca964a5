"""The scores against brute force and by their properties."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from skmotionseg.metrics import (
    FBMSScores,
    boundary_f_measure,
    fbms_mean,
    fbms_objects,
    fbms_scores,
    misclassification_error,
    motion_count_accuracy,
    region_similarity,
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


def program(true, found, weight=None, sizes=None):
    """``MoSegEval_PR.cpp``, version 2.0, step by step: the matches of largest sum of F.

    Yields (precision, recall, F of each region, density) of all best matchings.
    """
    weight = np.ones(len(true)) if weight is None else np.asarray(weight)
    n_clusters = len(np.unique(found[found >= 0]))
    n_regions = true.max() + 1 if sizes is None else len(sizes)
    overlap = np.zeros((n_regions, n_clusters))
    for t, f, w in zip(true, found, weight, strict=True):
        if t >= 0 and f >= 0:
            overlap[t, f] += w
    if sizes is None:
        sizes = [weight[true == region].sum() for region in range(n_regions)]
    cluster_size, region_size = overlap.sum(axis=0), overlap.sum(axis=1)
    visible = [j for j in range(n_regions) if sizes[j] >= 1e-4]
    density = np.mean([region_size[j] / sizes[j] for j in visible])
    side = max(len(visible), n_clusters)  # the cost matrix is square, filled with 0
    P, R = np.zeros((side, side)), np.zeros((side, side))
    for row, j in enumerate(visible):
        for i in range(n_clusters):
            P[row, i] = overlap[j, i] / cluster_size[i] if cluster_size[i] else 0
            R[row, i] = overlap[j, i] / region_size[j] if region_size[j] else 0
    F = np.divide(2 * P * R, P + R, out=np.zeros_like(P), where=P + R > 0)
    totals = {
        columns: sum(F[row, i] for row, i in enumerate(columns))
        for columns in permutations(range(side))
    }
    best = max(totals.values())
    for columns, total in totals.items():
        if not np.isclose(total, best):
            continue
        pairs = []
        for row, i in enumerate(columns[: len(visible)]):
            empty = n_clusters < len(visible) and i >= n_clusters
            pairs.append((1, 0, 0) if empty else (P[row, i], R[row, i], F[row, i]))
        precision, recall, each = zip(*pairs, strict=True)
        yield np.mean(precision), np.mean(recall), each, density


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("n_found", [1, 2, 3, 5])
@pytest.mark.parametrize("seed", range(5))
def test_fbms_scores_are_the_programs(seed, n_found, weighted):
    true, found = labellings(seed, n_found=n_found)
    rng = np.random.default_rng(seed)
    given = {}
    if weighted:
        given["sample_weight"] = rng.uniform(size=len(true))
        given["region_sizes"] = np.array([30.0, 0.0, 25.0, 40.0, 0.0])[: true.max() + 3]
    scores = fbms_scores(true, found, **given)
    best = list(program(true, found, *given.values()))
    assert any(np.allclose(scores[1:3], pair[:2]) for pair in best)
    precision, recall = scores.precision, scores.recall
    assert_allclose(scores.f_measure, 2 * precision * recall / (precision + recall))
    assert_allclose(scores.density, best[0][3])
    objects = fbms_objects(true, found, threshold=0.4, **given)
    counts = {max(sum(f > 0.4 for f in each) - 1, 0) for *_, each, _ in best}
    assert objects.extracted in counts
    assert objects.visible == len(best[0][2]) - 1


@pytest.mark.parametrize(
    "true, found, scores",
    [
        pytest.param([0, 0, 1, 1], [1, 1, 0, 0], (1, 1, 1, 1), id="perfect"),
        # Each region is missed by an empty group: precision 1, recall 0.
        pytest.param([0, 0, 1, 1], [-1] * 4, (0, 1, 0, 0), id="nothing"),
        # One region has precision 2/4 and recall 1, the other 1 and 0.
        pytest.param([0, 0, 1, 1], [0] * 4, (1, 3 / 4, 1 / 2, 3 / 5), id="merged"),
        # The second group has no region left, and does not count.
        pytest.param([0] * 4, [0, 0, 1, 1], (1, 1, 1 / 2, 2 / 3), id="split"),
        # Recall is of the points that have a group; the density tells the others.
        pytest.param([0, 0, 1, 1], [0, -1, 1, -1], (1 / 2, 1, 1, 1), id="half"),
        pytest.param([0, 0, 1, 1], [0, 0, 0, -1], (3 / 4, 5 / 6, 1 / 2, 5 / 8), id="m"),
        pytest.param([0, 0, -1, -1], [0, 0, 0, 1], (1, 1, 1, 1), id="not annotated"),
        # A group that no annotated point has takes the region that is left: 0 and 0.
        pytest.param([0, 1, -1], [0, 0, 1], (1, 1 / 4, 1 / 2, 1 / 3), id="elsewhere"),
        pytest.param([9, 9, 5, 5], [1, 1, 0, 0], (1, 1, 1, 1), id="other numbers"),
    ],
)
def test_fbms_scores_by_hand(true, found, scores):
    assert_allclose(fbms_scores(true, found), scores)


def test_the_density_is_the_mean_over_visible_regions():
    given = {"region_sizes": [10, 4, 0, 8]}
    scores = fbms_scores([0, 0, 1, 1, 3], [0, 0, 1, -1, -1], **given)
    assert scores.density == pytest.approx((2 / 10 + 1 / 4 + 0 / 8) / 3)
    # Regions 0 and 1 are found; region 3 has no group of its own: 1 and 0.
    assert scores.precision == 1
    assert scores.recall == pytest.approx(2 / 3)
    assert fbms_objects([0, 0, 1, 1, 3], [0, 0, 1, -1, -1], **given) == (1, 2)


def test_an_object_is_found_above_the_threshold_and_the_background_is_none():
    true = np.repeat([0, 1, 2], [6, 4, 4])
    found = true.copy()
    found[-2:] = 0  # region 2: precision 1, recall 1/2, F 2/3
    assert fbms_objects(true, found) == (1, 2)
    assert fbms_objects(true, found, threshold=0.66) == (2, 2)
    assert fbms_objects(true, np.full(14, -1)) == (0, 2)


def test_the_mean_f_measure_is_that_of_mean_precision_and_recall():
    """As in the table of Ochs et al.: 92.77 and 65.44 make 76.75."""
    mean = fbms_mean(
        [FBMSScores(0.9, 1.0, 0.4, 0.57), FBMSScores(1.0, 0.8554, 0.9088, 0.88)]
    )
    assert_allclose(mean, (0.95, 0.9277, 0.6544, 0.7674), atol=1e-4)
    with pytest.raises(ValueError, match="one sequence at least; got none"):
        fbms_mean([])


@pytest.mark.parametrize(
    "true, given, words",
    [
        ([0, 1], {"sample_weight": [1]}, "one weight per point; got 1 for 2 points"),
        ([0, 1], {"sample_weight": [1, -1]}, "sample_weight must be .* 0 or more"),
        ([0, 1], {"sample_weight": [0, 0]}, "no region is visible"),
        ([0, 1], {"region_sizes": [4]}, "each region; got 1 for region 1"),
        ([0, 1], {"region_sizes": [[4, 4]]}, r"got shape \(1, 2\)"),
        ([0, 1], {"region_sizes": [0, 0]}, "no region is visible"),
        ([-1, -1], {}, "true label of 0 or above"),
    ],
)
def test_bad_points_of_regions(true, given, words):
    with pytest.raises(ValueError, match=words):
        fbms_scores(true, [0, 1], **given)


def test_large_region_numbers_take_no_room():
    assert fbms_scores([10**12, 0], [0, 10**12]).f_measure == 1


def test_masks_in_which_there_is_nothing():
    """As DAVIS counts them: nothing that is found as nothing is right."""
    nothing = np.zeros((6, 8), dtype=bool)
    something = nothing.copy()
    something[2:4, 2:5] = True
    for score in (region_similarity, boundary_f_measure):
        assert score(nothing, nothing) == 1
        assert score(nothing, something) == score(something, nothing) == 0
        assert score(nothing[:0], nothing[:0]) == 1


@pytest.mark.parametrize("score", [region_similarity, boundary_f_measure])
def test_masks_of_different_shapes_are_refused(score):
    words = r"two masks of one shape.*got \(6, 8\) and \(8, 6\)"
    with pytest.raises(ValueError, match=words):
        score(np.zeros((6, 8)), np.zeros((8, 6)))
