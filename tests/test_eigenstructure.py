"""The number of groups by eigenvalues and by eigenvectors, and its estimators."""

from __future__ import annotations

import numpy as np
import pytest
import textbook
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.cluster import AgglomerativeClustering

from skmotionseg import (
    EigengapModelSelector,
    MotionSegmenter,
    MultiModelSpectralClustering,
    NCREModelSelector,
    SelfTuningModelSelector,
)
from skmotionseg._core import eigenstructure
from skmotionseg._core.eigenstructure import (
    ALIGNMENT_TOLERANCE,
    aligning_rotation,
    alignment_costs,
    angle_gradient,
    best_aligned,
    eigengap_costs,
    row_cost,
)
from skmotionseg._core.spectral import ViewGraph, normalize_rows
from skmotionseg.metrics import misclassification_error

SELECTORS = [EigengapModelSelector, SelfTuningModelSelector]
every_selector = pytest.mark.parametrize("selector", SELECTORS)
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
        monkeypatch.setattr(eigenstructure, "MAX_STEPS", n_steps)
        rotation = eigenstructure._descend(rows)
        assert_allclose(rotation.T @ rotation, np.eye(4), atol=1e-12)
        costs.append(eigenstructure.row_cost(rows @ rotation))
    assert costs[0] == eigenstructure.row_cost(rows)
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


# -------------------------------------------------------------------------- estimators


@every_selector
@every_size
@pytest.mark.parametrize("between", [0, 0.1])
def test_groups_are_counted(selector, sizes, between):
    K, labels = blocks(sizes, between)
    fitted = selector(random_state=0).fit(K)
    assert fitted.n_clusters_ == len(sizes)
    assert misclassification_error(labels, fitted.labels_) == 0


@every_selector
def test_views_are_joined(selector):
    """One view does not tell the first two groups apart, the other the last two."""
    K, labels = blocks((10, 9, 8))
    views = [
        blocks((19, 8))[0] * (1 - 0.9 * (K == 0)) + 0.01,
        blocks((10, 17))[0] * (1 - 0.9 * (K == 0)) + 0.01,
    ]
    fitted = selector(random_state=0).fit(np.hstack(views))
    assert fitted.n_clusters_ == 3
    assert misclassification_error(labels, fitted.labels_) == 0


@every_selector
def test_equal_affinities_repeat_eigenvalues(selector):
    """The Laplacian has 0 four times, and 1 sixteen times."""
    K = np.kron(np.eye(4), np.ones((5, 5)))
    fitted = selector(max_clusters=6, random_state=0).fit(K)
    assert fitted.n_clusters_ == 4
    least = {EigengapModelSelector: -1, SelfTuningModelSelector: 0}[selector]
    assert_allclose(fitted.costs_[fitted.best_index_, 2], least, atol=1e-3)


@every_selector
def test_rows_without_affinity_belong_to_no_group(selector):
    K, _ = blocks((8, 7, 6), 0.05)
    K[[0, 12]], K[:, [0, 12]] = 0, 0
    fitted = selector(random_state=0).fit(K)
    assert fitted.n_clusters_ == 3
    assert_array_equal(np.flatnonzero(fitted.labels_ == -1), [0, 12])


def test_a_single_group_is_one_by_its_gap():
    K, _ = blocks((30,))
    fitted = EigengapModelSelector(random_state=0).fit(K)
    assert fitted.n_clusters_ == 1
    assert_array_equal(fitted.labels_, 0)


def test_alignment_takes_one_only_where_there_is_no_other():
    K, _ = blocks((30,))
    selector = SelfTuningModelSelector(min_clusters=1, random_state=0)
    assert_array_equal(selector.fit(K).counts_, range(2, 11))
    alone = selector.set_params(max_clusters=1).fit(K)
    assert_array_equal(alone.counts_, [1])
    assert alone.n_clusters_ == 1
    single = selector.set_params(max_clusters=10).fit([[1.0]])
    assert_array_equal(single.labels_, [0])


@every_selector
def test_counts_stop_at_the_rows(selector):
    K, _ = blocks((2, 2))
    fitted = selector(random_state=0).fit(K)
    assert fitted.counts_[-1] == 4
    assert fitted.costs_.shape == (len(fitted.counts_), 3)
    assert fitted.candidate_labels_.shape == (len(fitted.counts_), 4)


@every_selector
def test_the_choice_is_among_the_counts_that_are_open(selector):
    K, _ = blocks((9, 8, 7))
    fitted = selector(min_clusters=4, max_clusters=6, random_state=0).fit(K)
    assert fitted.n_clusters_ in (4, 5, 6)
    assert_array_equal(fitted.counts_, [4, 5, 6])


@pytest.mark.parametrize("selector", [NCREModelSelector, *SELECTORS])
def test_the_best_index_is_that_of_the_labels(selector):
    K, _ = blocks((9, 8, 7), 0.3)
    fitted = selector(random_state=0).fit(K)
    assert_array_equal(fitted.labels_, fitted.candidate_labels_[fitted.best_index_])
    assert fitted.n_clusters_ == fitted.counts_[fitted.best_index_]
    assert fitted.clusterer_.n_clusters == fitted.n_clusters_


@every_selector
def test_fitted_rows_are_placed_where_they_were(selector):
    K, _ = blocks((9, 8, 7), 0.1)
    fitted = selector(random_state=0).fit(K)
    assert_array_equal(fitted.predict(K), fitted.labels_)


@every_selector
def test_the_choice_does_not_depend_on_the_clusterer(selector):
    K, _ = blocks((9, 8, 7), 0.1)
    ours = selector(MultiModelSpectralClustering(fusion="subset")).fit(K)
    other = AgglomerativeClustering(metric="precomputed", linkage="average")
    fitted = selector(other).fit(K)
    assert_array_equal(fitted.costs_, ours.costs_)
    assert fitted.n_clusters_ == 3
    assert not hasattr(fitted, "predict")


@every_selector
@pytest.mark.parametrize("low", [2, 7])
def test_counts_that_cannot_be_are_refused(selector, low):
    K, _ = blocks((3, 3))
    message = "min_clusters must not exceed" if low == 2 else "more than the 6 tracks"
    with pytest.raises(ValueError, match=message):
        selector(min_clusters=low, max_clusters=1 if low == 2 else 9).fit(K)


@pytest.mark.parametrize(
    ("selection", "selector"),
    list(zip(["eigengap", "self_tuning"], SELECTORS, strict=True)),
)
def test_the_segmenter_chooses_as_the_selector(scene, selection, selector):
    X, y = scene
    segmenter = MotionSegmenter(selection=selection, random_state=0).fit(X)
    assert segmenter.n_motions_ == 3
    assert misclassification_error(y, segmenter.labels_) < 0.05
    affinities = np.hstack(
        [
            kernel.fit_transform(sampler.transform(X))
            for sampler, kernel in segmenter.branches_.values()
        ]
    )
    fitted = selector(MultiModelSpectralClustering(fusion="kernel_addition")).fit(
        affinities
    )
    assert_array_equal(segmenter.counts_, fitted.counts_)
    assert_allclose(segmenter.costs_, fitted.costs_, atol=1e-6)


@pytest.mark.parametrize("selection", ["eigengap", "self_tuning"])
@pytest.mark.parametrize("n_motions", [1, 3])
def test_a_known_number_is_taken(scene, selection, n_motions):
    segmenter = MotionSegmenter(
        n_motions, selection=selection, n_hypotheses=50, random_state=0
    ).fit(scene[0])
    assert segmenter.n_motions_ == n_motions
