"""Some tracks are fitted, and the others are placed."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from skmotionseg import MotionSegmenter, unpack_tracks
from skmotionseg._segmenter import landmarks, views
from skmotionseg._segmenter.memory import number_of_landmarks
from skmotionseg._segmenter.views import PAIRS_TO_PLACE, check_models
from skmotionseg.datasets import make_rigid_motions, make_scene
from skmotionseg.metrics import misclassification_error


@pytest.fixture(scope="module")
def scene():
    """800 tracks: a background and two motions."""
    return make_rigid_motions(800, 5, 3, missing=0.1, random_state=0)


@pytest.fixture(scope="module")
def fitted(scene):
    return MotionSegmenter(3, n_landmarks=160, n_hypotheses=100, random_state=0).fit(
        scene[0]
    )


def test_a_small_motion_in_a_dense_scene_is_found():
    X, y = make_rigid_motions(3200, 6, 2, missing=0, random_state=0)
    small = np.r_[np.flatnonzero(y == 0)[:1568], np.flatnonzero(y == 1)[:32]]
    labels = MotionSegmenter(2, random_state=0).fit_predict(X[small])
    assert misclassification_error(y[small], labels) < 0.002


def test_a_background_of_many_pieces_leaves_landmarks_to_what_moves(monkeypatch):
    """93 of 3,000 tracks move by themselves."""
    scene = make_scene("dense_small", n_tracks=3000, n_frames=8, random_state=12)
    tracks, models = unpack_tracks(scene.data), check_models(("affine", "homography"))

    def n_that_move():
        chosen = landmarks.choose_landmarks(*tracks, 1000, models)
        return np.count_nonzero(scene.target[chosen] > 0)

    assert n_that_move() > 0.9 * np.count_nonzero(scene.target > 0)
    monkeypatch.setattr(landmarks, "OVER_SEGMENTS", (30,))
    assert n_that_move() < 0.6 * np.count_nonzero(scene.target > 0)


def test_outliers_have_no_more_landmarks_than_their_share(monkeypatch):
    scene = make_scene(
        "dense_small", n_tracks=1200, n_motions=3, outliers=0.3, random_state=0
    )
    outliers = scene.target < 0

    def share():
        params = {"n_hypotheses": 50, "n_landmarks": 400, "random_state": 0}
        segmenter = MotionSegmenter(3, selection="ncre", **params)  # it takes no part
        return outliers[segmenter.fit(scene.data).landmarks_].mean()

    assert share() < 2 / 3 * outliers.mean()
    monkeypatch.setattr(landmarks, "ISOLATED", np.inf)
    assert share() > outliers.mean()


def test_all_tracks_are_fitted_where_that_is_asked_for():
    assert number_of_landmarks(None, np.ones((2000, 3), dtype=bool), 3) == 2000


def test_of_a_long_clip_every_so_many_frame_pairs_place_the_others():
    """Of 48 frame pairs, every fourth."""
    X, y = make_rigid_motions(160, 49, 2, missing=0.1, random_state=0)
    segmenter = MotionSegmenter(
        2, selection="ncre", n_hypotheses=50, random_state=0
    ).fit(X[:80])
    for _, kernel in segmenter.views_.values():
        assert_array_equal(kernel._spread_pairs(PAIRS_TO_PLACE), range(0, 48, 4))
    assert misclassification_error(y[80:], segmenter.predict(X[80:])) < 0.05


def test_a_track_that_no_frame_pair_sees_gets_no_label_from_landmarks():
    """Its neighbours are seen in the same frames, but these make no pair."""
    X, _ = make_rigid_motions(60, 3, 1, missing=0, random_state=0)
    X[50:, 4:] = np.nan
    segmenter = MotionSegmenter(
        frame_gap=2, n_landmarks=30, n_hypotheses=20, random_state=0
    ).fit(X)
    assert set(segmenter.label_reasons_[50:]) == {"too short"}
    assert (segmenter.candidate_labels_[:, 50:] == -1).all()
    assert (segmenter.labels_[:50] >= 0).all()


@pytest.mark.parametrize("value", [0, -1, 7, 801, 2.5, "all"])
def test_bad_numbers_are_errors(scene, value):
    segmenter = MotionSegmenter(n_landmarks=value)
    with pytest.raises(ValueError, match=rf"n_landmarks.*{value}"):
        segmenter.fit(scene[0])


def test_landmarks_that_share_no_frame_are_named_in_the_error(monkeypatch):
    """Ten tracks in each two frames of a long video: fewer are too few."""
    monkeypatch.setattr("skmotionseg.segmentation.LONG_CLIP", 1000)  # taken whole
    points = np.full((2000, 401, 2), np.nan)
    for pair in range(200):
        place = np.random.default_rng(pair).uniform(0, 500, size=(10, 1, 2))
        points[10 * pair : 10 * pair + 10, 2 * pair : 2 * pair + 2] = place
    segmenter = MotionSegmenter(2, models="fundamental", n_landmarks=20, random_state=0)
    with pytest.raises(ValueError, match="needs 8 tracks") as caught:
        segmenter.fit(points.reshape(2000, -1))
    assert "looking at 600 tracks of 2000; n_landmarks" in "".join(
        caught.value.__notes__
    )


# ------------------------------------------------------------------------- the placing


def test_tracks_that_are_not_fitted_are_placed(scene, fitted):
    X, y = scene
    assert len(fitted.landmarks_) == 160
    assert fitted.labels_.shape == y.shape
    assert misclassification_error(y, fitted.labels_) < 0.02
    assert fitted.candidate_labels_.shape == (1, len(X))


def test_another_seed_fits_the_same_landmarks(scene, fitted):
    other = MotionSegmenter(3, n_landmarks=160, n_hypotheses=100, random_state=1)
    assert_array_equal(other.fit(scene[0]).landmarks_, fitted.landmarks_)


def test_the_largest_motion_comes_first(fitted):
    assert (np.diff(np.bincount(fitted.labels_)) <= 0).all()


def test_tracks_are_placed_by_predict_where_fit_put_them(scene, fitted):
    X, _ = scene
    others = np.setdiff1d(np.arange(len(X)), fitted.landmarks_)
    assert_array_equal(fitted.predict(X[others]), fitted.labels_[others])


@pytest.mark.parametrize("batch_size", [1, 63, 64, 400])
def test_labels_do_not_depend_on_the_batch(scene, fitted, batch_size, monkeypatch):
    points, visibility = unpack_tracks(scene[0][: 50 if batch_size == 1 else None])
    known = fitted.labels_[None, fitted.landmarks_]
    given = fitted.views_, points, visibility, known, None
    expected = views.place_tracks(*given)
    monkeypatch.setattr(views, "TRACKS_PER_BATCH", batch_size)
    for placed, at_once in zip(views.place_tracks(*given), expected, strict=True):
        assert_array_equal(placed, at_once)


def test_a_fit_does_not_depend_on_the_batch(scene, fitted, monkeypatch):
    monkeypatch.setattr(views, "TRACKS_PER_BATCH", 63)
    segmenter = MotionSegmenter(**fitted.get_params()).fit(scene[0])
    assert_array_equal(segmenter.labels_, fitted.labels_)
    assert_array_equal(segmenter.probabilities_, fitted.probabilities_)


@pytest.mark.parametrize("n_jobs", [2, pytest.param(-1, marks=pytest.mark.long)])
def test_labels_do_not_depend_on_the_jobs(scene, fitted, n_jobs):
    many = MotionSegmenter(**{**fitted.get_params(), "n_jobs": n_jobs})
    assert_array_equal(many.fit(scene[0]).labels_, fitted.labels_)


def test_all_tracks_as_landmarks_are_the_exact_fit(scene):
    X = scene[0][:60]
    exact, all_of_them = (
        MotionSegmenter(3, n_landmarks=n, n_hypotheses=100, random_state=0).fit(X)
        for n in (None, 60)
    )
    assert_array_equal(exact.labels_, all_of_them.labels_)
    assert_array_equal(exact.landmarks_, np.arange(60))


def test_a_track_seen_once_is_placed_nowhere(scene):
    X = scene[0].copy()
    X[7, 2:] = np.nan
    segmenter = MotionSegmenter(3, n_landmarks=60, n_hypotheses=50, random_state=0)
    assert segmenter.fit(X[:120]).labels_[7] == -1


def test_tracks_seen_in_no_consecutive_frames_are_placed_by_affinities(scene):
    X, y = scene
    X = X.copy().reshape(len(X), -1, 2)
    X[::5, 1::2] = np.nan
    segmenter = MotionSegmenter(
        3, n_landmarks=160, n_hypotheses=200, frame_gap=2, random_state=0
    ).fit(X.reshape(len(X), -1))
    others = np.setdiff1d(np.arange(0, len(X), 5), segmenter.landmarks_)
    assert len(others) > 80
    assert misclassification_error(y[others], segmenter.labels_[others]) < 0.1
