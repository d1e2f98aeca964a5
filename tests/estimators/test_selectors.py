"""Rules that choose the number of clusters, as estimators."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.cluster import AgglomerativeClustering, KMeans

from skmotionseg import (
    EigengapModelSelector,
    MotionSegmenter,
    MultiModelSpectralClustering,
    NCREModelSelector,
    SelfTuningModelSelector,
)
from skmotionseg.metrics import misclassification_error

SELECTORS = [EigengapModelSelector, SelfTuningModelSelector]


every_selector = pytest.mark.parametrize("selector", SELECTORS)
every_selector_and_ncre = pytest.mark.parametrize(
    "selector", [*SELECTORS, NCREModelSelector]
)


SIZES = [(20, 20), (9, 8, 7), (30, 6, 4), (20,) * 4, (12,) * 8]


every_size = pytest.mark.parametrize("sizes", SIZES, ids=str)


def blocks(sizes, between=0.0, seed=0):
    """Labels, and affinities near 1 within each group and up to ``between`` across."""
    labels = np.repeat(np.arange(len(sizes)), sizes)
    noise = np.random.default_rng(seed).uniform(size=(len(labels),) * 2)
    noise = (noise + noise.T) / 2
    together = labels[:, None] == labels
    return np.where(together, 0.5 + noise / 2, between * noise), labels


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


@pytest.mark.parametrize("scale", [0.1, 1, 3])
@pytest.mark.parametrize("size", [2, 5, 7, 11])
def test_of_gaps_that_rounding_alone_tells_apart_the_first_decides(size, scale):
    """The eigenvalues are 1, 1/2 and 0, in whatever order the rows are."""
    K = scale * np.kron(np.array([[3.0, 1], [1, 3]]), np.ones((size, size)))
    selector = EigengapModelSelector(max_clusters=4, random_state=0)
    rng = np.random.default_rng(0)
    for order in (np.arange(2 * size), *(rng.permutation(2 * size) for _ in range(4))):
        assert selector.fit(K[np.ix_(order, order)]).n_clusters_ == 1


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
def test_rows_may_have_names_of_columns(selector):
    pandas = pytest.importorskip("pandas")
    K, _ = blocks((9, 8, 7), 0.1)
    K = pandas.DataFrame(K, columns=[f"row{i}" for i in range(len(K))])
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
            for sampler, kernel in segmenter.views_.values()
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


def with_a_lonely_row(order):
    """Affinities of two groups of four, and of a row that has none, in that order."""
    K = np.zeros((9, 9))
    K[:8, :8] = np.kron(np.eye(2), np.ones((4, 4)))
    return K[np.ix_(order, order)]


@every_selector_and_ncre
@pytest.mark.parametrize("order", [range(9), range(9)[::-1]], ids=["last", "first"])
@pytest.mark.parametrize("clusterer", [None, KMeans(n_init=1, random_state=0)], ids=str)
def test_rows_without_affinity_are_in_no_cluster(selector, order, clusterer):
    K = with_a_lonely_row(np.array(order))
    fitted = selector(clusterer, n_clusters=2, random_state=0).fit(K)
    assert sorted(fitted.labels_) == [-1, 0, 0, 0, 0, 1, 1, 1, 1]
    assert_array_equal(fitted.predict(K), fitted.labels_)


@pytest.mark.parametrize("max_iter", [1, 3])
@pytest.mark.parametrize("fusion", ["coreg", "subset"])
def test_iterations_of_a_fusion_are_counted(fusion, max_iter):
    K, _ = blocks((9, 8, 7), between=0.4)
    clustering = MultiModelSpectralClustering(
        3, fusion=fusion, max_iter=max_iter, tol=0, random_state=0
    ).fit(np.hstack([K, K**2]))
    assert clustering.n_iter_ == max_iter
    assert clustering.objective_.shape == (max_iter + 1,)
