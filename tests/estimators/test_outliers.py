"""Outliers get the label -1, and nothing else does."""

from __future__ import annotations

import numpy as np
import pytest

from skmotionseg import MotionSegmenter, make_motion_pipeline, pack_tracks
from skmotionseg._core.geometry.description_length import clip_geometry
from skmotionseg._core.geometry.tracks import unpack_tracks
from skmotionseg._core.partition import search
from skmotionseg._core.partition.cost import Judge
from skmotionseg.datasets import make_rigid_motions
from skmotionseg.metrics import misclassification_error

QUICK = {"n_hypotheses": 150, "max_motions": 5}


def repeat(value):
    """Good tracks are rejected with few outliers first, and outliers kept with many."""
    return pytest.param(value, marks=pytest.mark.long)


@pytest.mark.parametrize("seed", [0, repeat(1)])
@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("outliers", [0.05, repeat(0.1), repeat(0.2), 0.3])
def test_outliers_are_found_with_and_without_the_number_of_motions(
    outliers, known, seed
):
    X, y = make_rigid_motions(300, 20, 3, outliers=outliers, random_state=seed)
    n_motions = 3 if known else "auto"
    labels = MotionSegmenter(n_motions, random_state=seed, **QUICK).fit(X).labels_
    hit = ((labels < 0) & (y < 0)).sum()
    assert hit >= 0.9 * (labels < 0).sum()
    assert hit >= 0.9 * (y < 0).sum()


@pytest.mark.parametrize("place", [-9999.0, 1e6])
def test_a_track_that_is_lost_far_outside_changes_no_other(place):
    X, y = make_rigid_motions(150, 12, missing=0, random_state=3)
    X[5] = place
    labels = MotionSegmenter(random_state=0, **QUICK).fit(X).labels_
    assert labels[5] == -1
    assert misclassification_error(np.delete(y, 5), np.delete(labels, 5)) < 0.03


def test_clean_tracks_are_kept_and_rejection_can_be_turned_off():
    X, _ = make_rigid_motions(200, 5, random_state=0)
    outside = MotionSegmenter(3, random_state=0, **QUICK).fit(X).labels_ < 0
    assert outside.mean() <= 0.01
    X, _ = make_rigid_motions(100, 4, 2, outliers=0.1, random_state=0)
    assert (MotionSegmenter(2, random_state=0, **QUICK).fit(X).labels_ < 0).any()
    keep = MotionSegmenter(2, reject_outliers=False, random_state=0, **QUICK)
    assert (keep.fit(X).labels_ >= 0).all()


def test_new_rubbish_is_rejected_and_new_tracks_are_placed():
    X, y = make_rigid_motions(210, 6, 2, outliers=0.1, random_state=1)
    fitted = np.arange(210) % 3 > 0
    segmenter = MotionSegmenter(2, random_state=0, **QUICK).fit(X[fitted])
    labels = segmenter.predict(X[~fitted])
    rubbish = y[~fitted] < 0
    assert (labels[rubbish] < 0).mean() > 0.8
    assert misclassification_error(y[~fitted], labels) < 0.05


def test_landmarks_reject_as_all_tracks_do():
    X, y = make_rigid_motions(240, 10, outliers=0.1, random_state=2)
    segmenter = MotionSegmenter(3, n_landmarks=120, random_state=0, **QUICK).fit(X)
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
    X, _ = make_rigid_motions(100, 5, 2, outliers=0.1, random_state=0)
    segmenter = MotionSegmenter(2, random_state=0, **QUICK).fit(X)
    probabilities = segmenter.probabilities_
    assert ((probabilities >= 0) & (probabilities <= 1)).all()
    assert (segmenter.labels_ < 0).any()
    np.testing.assert_array_equal(probabilities == 0, segmenter.labels_ < 0)


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


@pytest.mark.parametrize("outliers, n_searches", [(0.01, 1), (0.2, 2)])
def test_motions_are_searched_again_without_many_outliers(
    outliers, n_searches, monkeypatch
):
    X, y = make_rigid_motions(150, 8, 2, outliers=outliers, random_state=0)
    by_rigid_motion, searched = search._by_rigid_motion, []

    def noted(clip, *args):
        kept = pack_tracks(clip.points, clip.visibility)
        same = (kept[:, None] == X) | (np.isnan(kept)[:, None] & np.isnan(X))
        searched.append(same.all(axis=2).any(axis=0))
        return by_rigid_motion(clip, *args)

    monkeypatch.setattr(search, "_by_rigid_motion", noted)
    labels = MotionSegmenter(random_state=0, **QUICK).fit(X).labels_
    assert misclassification_error(y, labels) < 0.02
    assert len(searched) == n_searches
    last = searched[-1]
    assert last[y >= 0].mean() > 0.98
    assert (last[y < 0].mean() < 0.15) == (n_searches > 1)


@pytest.mark.parametrize("outliers, is_warned_of", [(0.3, False), (0.8, True)])
def test_tracks_that_are_mostly_outliers_are_warned_of(outliers, is_warned_of):
    X, _ = make_rigid_motions(80, 8, 2, outliers=outliers, random_state=1)
    segmenter = MotionSegmenter(random_state=0)
    if is_warned_of:
        with pytest.warns(
            UserWarning, match="half of the tracks are .* pixels or more"
        ):
            segmenter.fit(X)
    else:
        segmenter.fit(X)  # warnings are errors
    assert segmenter.n_motions_ >= 1


def test_rejection_changes_no_other_label():
    X, _ = make_rigid_motions(150, 6, 2, outliers=0.2, random_state=0)
    rejected = MotionSegmenter(random_state=0, **QUICK).fit(X)
    kept = MotionSegmenter(reject_outliers=False, random_state=0, **QUICK).fit(X)
    inside = rejected.labels_ >= 0
    assert inside.mean() < 0.9
    assert rejected.n_motions_ == kept.n_motions_
    assert misclassification_error(rejected.labels_[inside], kept.labels_[inside]) == 0
