"""Choosing among partitions, and placing tracks by their neighbours."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from skmotionseg import MotionSegmenter
from skmotionseg._core.geometry import clip_geometry
from skmotionseg._core.judging import CUT_WEIGHT, Cost, GroupLengths, Judge
from skmotionseg._core.refinement import MOST_CHANGES, refine
from skmotionseg._core.selection import cuts_between, nearest_labels, normalized_cut
from skmotionseg._core.tracks import unpack_tracks
from skmotionseg._partition_search import _choose
from skmotionseg.datasets import make_rigid_motions
from skmotionseg.metrics import misclassification_error


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


@pytest.mark.parametrize(
    "selection", ["description_length", "ncre", "eigengap", "self_tuning"]
)
def test_the_labels_are_those_of_the_chosen_count(scene, selection):
    segmenter = MotionSegmenter(
        selection=selection, max_motions=4, n_hypotheses=200, random_state=0
    ).fit(scene[0])
    chosen = list(segmenter.counts_).index(segmenter.n_motions_)
    candidates = segmenter.candidate_labels_
    np.testing.assert_array_equal(segmenter.labels_, candidates[chosen])
    np.testing.assert_array_equal(candidates.max(axis=1) + 1, segmenter.counts_)


def test_ncre_chooses_the_cheapest_count(scene):
    segmenter = MotionSegmenter(selection="ncre", n_hypotheses=200, random_state=0)
    segmenter.fit(scene[0])
    cheapest = segmenter.costs_[:, 2].argmin()
    assert segmenter.n_motions_ == segmenter.counts_[cheapest]


def test_total_is_length_plus_the_weighted_cut(scene):
    segmenter = MotionSegmenter(max_motions=3, n_hypotheses=100, random_state=0)
    costs = segmenter.fit(scene[0]).costs_
    np.testing.assert_allclose(costs[:, 2], CUT_WEIGHT * costs[:, 0] + costs[:, 1])
    assert costs[0, 0] == pytest.approx(0, abs=1e-9)  # one motion cuts nothing


@pytest.fixture
def judged():
    """A scene, its judge on a graph with few links between motions, and the truth."""
    X, y = make_rigid_motions(random_state=0)
    graph = np.where(y[:, None] == y, 1, 0.02)
    return Judge(clip_geometry(*unpack_tracks(X)), graph[None]), y


def test_a_partition_is_chosen_only_if_its_motions_gain(judged):
    judge, y = judged
    halves = np.random.default_rng(0).integers(0, 2, len(y))
    torn = np.where(y == 0, 3 * halves, y)  # the background torn in two
    one = np.zeros_like(y)
    assert judge.each_gains(y)
    assert not judge.each_gains(torn)
    assert judge.each_gains(one)  # there is no pair
    assert judge.gainless_pair(torn) == (0, 3)  # the halves of the background
    best = {1: one, 3: y, 4: torn}
    best = {n: (Cost(0, 5 - n, 5 - n), labels) for n, labels in best.items()}
    assert _choose(best, judge) == (3, {4: (0, 3)})
    assert _choose({4: best[4]}, judge) == (4, {})  # there is no other
    none_gains = {4: best[4], 5: best[4]}
    assert _choose(none_gains, judge) == (4, {4: (0, 3), 5: (0, 3)})


def test_a_gain_is_that_of_the_pairs_in_which_both_have_a_model():
    X, y = make_rigid_motions(n_tracks=100, n_motions=2, missing=0, random_state=0)
    first, second = np.flatnonzero(y == 0), np.flatnonzero(y == 1)
    few = second[:7]
    assert gain_of(X, first, second) > 1
    assert gain_of(X, first, few) == 0  # no pair in which seven have a model
    apart = X.copy()
    apart[first, 20:] = np.nan
    apart[second, :20] = np.nan
    assert gain_of(apart, first, second) == np.inf
    # Where the second is seen eight times or more it is judged, and only there.
    rare = X.copy()
    rare[second[7:], 20:] = np.nan
    early = np.where(np.arange(40) < 20, X, np.nan)
    late = gain_of(rare, first, second), gain_of(early, first, second)
    assert late[0] == pytest.approx(late[1], rel=0.5)


def gain_of(X, first, second):
    return GroupLengths(clip_geometry(*unpack_tracks(X))).gain(first, second)


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


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("shapes", "camera"),
    [("general", "general"), ("planar", "general"), ("general", "rotation")],
)
def test_one_motion_is_an_answer(shapes, camera, seed):
    X, _ = make_rigid_motions(
        n_tracks=120,
        n_frames=8,
        n_motions=1,
        shapes=shapes,
        camera=camera,
        random_state=seed,
    )
    segmenter = MotionSegmenter(max_motions=4, n_hypotheses=200, random_state=seed)
    assert segmenter.fit(X).n_motions_ == 1


@pytest.mark.parametrize("seed", range(3))
def test_three_motions_are_found_with_their_number_unknown(seed):
    X, y = make_rigid_motions(n_frames=10, random_state=seed)
    segmenter = MotionSegmenter(n_hypotheses=200, random_state=seed).fit(X)
    assert segmenter.n_motions_ == 3
    assert misclassification_error(y, segmenter.labels_) < 0.01


def test_a_known_count_is_kept(scene):
    for count in (1, 2, 5):
        segmenter = MotionSegmenter(count, n_hypotheses=50, random_state=0)
        assert segmenter.fit(scene[0]).n_motions_ == count


def test_predict_gives_fitted_tracks_their_own_label(scene):
    X, _ = scene
    segmenter = MotionSegmenter(3, n_hypotheses=200, random_state=0).fit(X)
    assert np.mean(segmenter.predict(X) == segmenter.labels_) > 0.98


def test_refining_ends_where_no_change_is_cheaper_or_after_many():
    def one_on(labels):
        yield labels
        yield labels + 1

    start = np.zeros(3, dtype=int)
    assert_array_equal(refine(start, lambda x: abs(x[0] - 7), one_on), [7, 7, 7])
    last = refine(start, lambda x: -x[0], one_on)  # whose cost falls for ever
    assert_array_equal(last, np.full(3, MOST_CHANGES))
