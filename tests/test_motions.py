"""Motions of a partition, what they explain, and partitions on the way down."""

from __future__ import annotations

import numpy as np
import pytest

from skmotionseg import MotionSegmenter, make_motion_pipeline, pack_tracks
from skmotionseg._core.geometry import clip_geometry
from skmotionseg._core.judging import Judge
from skmotionseg._core.motions import explained, fit_motions, usual
from skmotionseg._core.refinement import merged, moved, refine, split
from skmotionseg._core.selection import canonical_labels, nearest_votes, own_shares
from skmotionseg._core.tracks import unpack_tracks
from skmotionseg._partition_search import _Clip, _refine
from skmotionseg.cluster import MultiModelSpectralClustering
from skmotionseg.datasets import make_rigid_motions
from skmotionseg.metrics import misclassification_error

QUICK = {"n_hypotheses": 150, "max_motions": 5}


def scene_with(outliers, seed=0, n_frames=12, **scene):
    X, y = make_rigid_motions(
        240, n_frames, outliers=outliers, random_state=seed, **scene
    )
    return X, y, unpack_tracks(X)


def linked(y, within=1.0, across=0.02):
    """An affinity that knows the motions; rubbish is linked to all alike."""
    affinity = np.where(y[:, None] == y, within, across)
    affinity[y < 0] = affinity[:, y < 0] = 0.2
    return affinity


@pytest.mark.parametrize("shapes", ["general", "planar"])
def test_a_motion_stays_what_it_is_among_two_fifths_of_rubbish(shapes):
    _, y, tracks = scene_with(0.3, n_frames=20, shapes=shapes, n_motions=1)
    motions = fit_motions(clip_geometry(*tracks), np.zeros_like(y), linked(y))
    (distances,) = motions.distances(*tracks)
    pixels = distances * motions.frames.scale
    # Half a pixel of noise in each coordinate; rubbish takes steps of ten pixels.
    assert np.nanmedian(pixels[y == 0]) < 0.6
    assert np.nanmedian(pixels[y < 0]) > 5
    (inside,) = explained(motions, distances[None])
    assert inside[y == 0].all()
    assert inside[y < 0].mean() < 0.1


def test_distances_are_medians_over_the_pairs_that_see_a_track():
    _, y, (points, visibility) = scene_with(0, n_motions=1, missing=0)
    motions = fit_motions(clip_geometry(points, visibility), y, linked(y))
    (distances,) = motions.distances(points, visibility)
    assert np.isfinite(distances).all()
    torn = points.copy()
    torn[0, 0] += 500  # one of twelve frames is wrong
    (others,) = motions.distances(torn, visibility)
    assert others[0] < 5 * distances[0] + 0.01
    unseen = visibility.copy()
    unseen[0, 1:] = False
    assert np.isnan(motions.distances(points, unseen)[0, 0])


def test_a_motion_of_seven_tracks_judges_none():
    _, y, tracks = scene_with(0, n_motions=1)
    few = np.where(np.arange(len(y)) < 7, 0, -1)
    motions = fit_motions(clip_geometry(*tracks), few, linked(y))
    distances = motions.distances(*tracks)
    assert np.isnan(distances).all()
    assert explained(motions, distances).all()


def test_unusual_noise_is_against_that_of_the_median_track():
    noise = np.array([0.01, 0.012, 0.05])
    assert usual(noise, np.array([0] * 5 + [1] * 3 + [2] * 3)).tolist() == [1, 1, 0]
    assert usual(noise, np.array([2, 2, 2, 0, -1])).all()


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("outliers", [0.05, 0.1, 0.2, 0.3])
def test_outliers_are_found_with_and_without_the_number_of_motions(outliers, known):
    hit = rejected = rubbish = 0
    for seed in range(2):
        X, y = make_rigid_motions(300, 20, 3, outliers=outliers, random_state=seed)
        segmenter = MotionSegmenter(
            3 if known else "auto", random_state=seed, **QUICK
        ).fit(X)
        outside = segmenter.labels_ < 0
        hit += (outside & (y < 0)).sum()
        rejected += outside.sum()
        rubbish += (y < 0).sum()
    assert hit >= 0.9 * rejected
    assert hit >= 0.9 * rubbish


def test_clean_tracks_are_kept_and_rejection_can_be_turned_off():
    X, _ = make_rigid_motions(200, 10, random_state=0)
    outside = MotionSegmenter(3, random_state=0, **QUICK).fit(X).labels_ < 0
    assert outside.mean() <= 0.01
    X, _ = make_rigid_motions(200, 10, outliers=0.1, random_state=0)
    assert (MotionSegmenter(3, random_state=0, **QUICK).fit(X).labels_ < 0).any()
    keep = MotionSegmenter(3, reject_outliers=False, random_state=0, **QUICK)
    assert (keep.fit(X).labels_ >= 0).all()


def test_new_rubbish_is_rejected_and_new_tracks_are_placed():
    X, y = make_rigid_motions(300, 10, outliers=0.1, random_state=1)
    fitted = np.arange(300) % 3 > 0
    segmenter = MotionSegmenter(3, random_state=0, **QUICK).fit(X[fitted])
    labels = segmenter.predict(X[~fitted])
    rubbish = y[~fitted] < 0
    assert (labels[rubbish] < 0).mean() > 0.8
    assert misclassification_error(y[~fitted], labels) < 0.05


def test_landmarks_reject_as_all_tracks_do():
    X, y = make_rigid_motions(400, 10, outliers=0.1, random_state=2)
    segmenter = MotionSegmenter(3, n_landmarks=200, random_state=0, **QUICK).fit(X)
    rubbish = y < 0
    assert (segmenter.labels_[rubbish] < 0).mean() > 0.8
    assert misclassification_error(y, segmenter.labels_) < 0.03
    sizes = np.bincount(segmenter.labels_[segmenter.labels_ >= 0])
    assert (np.diff(sizes) <= 0).all()  # the largest first
    np.testing.assert_array_equal(
        segmenter.labels_, segmenter.candidate_labels_[list(segmenter.counts_).index(3)]
    )


def test_a_motion_that_was_not_found_is_not_rubbish():
    X, y = make_rigid_motions(240, 10, 2, random_state=0)
    labels = MotionSegmenter(1, random_state=0, **QUICK).fit(X).labels_
    assert (labels[y == 1] >= 0).mean() > 0.9


def test_probabilities_are_shares_and_none_for_outliers():
    X, _ = make_rigid_motions(300, 8, 3, outliers=0.1, random_state=0)
    segmenter = MotionSegmenter(3, random_state=0, **QUICK).fit(X)
    probabilities = segmenter.probabilities_
    assert ((probabilities >= 0) & (probabilities <= 1)).all()
    assert (segmenter.labels_ < 0).any()
    np.testing.assert_array_equal(probabilities == 0, segmenter.labels_ < 0)


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


# ------------------------------------------------------------------- refinement


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("counts", [[3], range(1, 6)])
def test_refinement_never_raises_the_cost(counts, seed):
    _, y, (points, visibility) = scene_with(0, seed)
    rng = np.random.default_rng(seed)
    clip = _Clip(points, visibility, linked(y)[None] * rng.uniform(0.5, 1), (4.0,))
    clusterer = MultiModelSpectralClustering(random_state=seed)
    start = canonical_labels(np.where(rng.random(len(y)) < 0.1, (y + 1) % 3, y))
    end = _refine(start, clip, np.array(list(counts)), clusterer)
    assert clip.judge.cost(end).total <= clip.judge.cost(start).total
    assert misclassification_error(y, end) < misclassification_error(y, start)


def test_each_change_is_taken_only_if_it_is_cheaper():
    costs = {0: 5.0, 1: 7.0, 2: 3.0, 3: 3.0}
    labels = {state: np.array([state]) for state in costs}
    tried = []

    def changes(state):
        tried.append(int(state[0]))
        return [labels[1], labels[2], labels[3]]

    end = refine(labels[0], lambda state: costs[int(state[0])], changes)
    assert end is labels[2]
    assert tried == [0, 2]


def test_tracks_move_to_the_motion_that_explains_them():
    labels = np.array([0, 0, 1, 1, -1])
    relative = np.array([[0.5, 3, 2, 0.1, 0.1], [2, 0.4, 0.5, 0.2, np.nan]])
    first, *_ = moved(labels, relative)
    np.testing.assert_array_equal(first, [0, 1, 1, 1, -1])
    some = np.array([[1.5, 9, 1, 9], [1.2, 0.1, 1, 1]])  # 1 is explained, more is not
    assert not list(moved(np.array([0, 1, 0, 1]), some))
    edge = np.array([[1.5, 9, 0.1, 2], [1.0, 0.1, 9, 1]])
    first, *_ = moved(np.array([0, 1, 0, 0]), edge)
    np.testing.assert_array_equal(first, [1, 1, 0, 1])
    empty = np.array([[3.0, 3.0, 3.0], [0.5, 0.5, 0.5]])
    assert not list(moved(np.array([0, 0, 1]), empty))  # a motion would be empty


def test_merged_and_split_partitions_have_no_gaps():
    labels = np.array([0, 1, 2, 2, 1])
    for joined in merged(labels):
        assert set(joined) == {0, 1}
    assert len(list(merged(labels))) == 3
    parted = list(split(labels, lambda group: np.arange(len(group)) > 0))
    assert len(parted) == 2  # a group of one cannot be parted
    assert all(set(new) == {0, 1, 2, 3} for new in parted)
    assert not list(split(labels, lambda group: None))


def test_the_paper_keeps_all_tracks():
    X, _ = make_rigid_motions(150, 8, outliers=0.2, random_state=0)
    paper = MotionSegmenter(3, selection="ncre", random_state=0, **QUICK).fit(X)
    assert (paper.labels_ >= 0).all()
    pipeline = make_motion_pipeline(n_clusters=3, n_hypotheses=50, random_state=0)
    assert (pipeline.fit_predict(X) >= 0).all()


def test_a_still_camera_and_copies_have_no_outliers():
    rng = np.random.default_rng(0)
    points = np.repeat(rng.uniform(0, 500, (40, 1, 2)), 6, axis=1)
    still = pack_tracks(points)
    assert (MotionSegmenter(random_state=0, **QUICK).fit(still).labels_ >= 0).all()
    judge = Judge(clip_geometry(*unpack_tracks(still)), np.ones((1, 40, 40)))
    assert np.isfinite(judge.cost(np.arange(40) % 2).total)


@pytest.mark.long
@pytest.mark.parametrize(
    ("shapes", "camera"),
    [("planar", "general"), ("general", "rotation"), ("general", "general")],
)
def test_one_motion_is_found_in_nearly_all_scenes(shapes, camera):
    found = [
        MotionSegmenter(random_state=seed)
        .fit(
            make_rigid_motions(
                200, 15, 1, shapes=shapes, camera=camera, random_state=seed
            )[0]
        )
        .n_motions_
        for seed in range(100)
    ]
    assert found.count(1) >= 95
