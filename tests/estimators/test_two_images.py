"""Two images: mismatches, one motion among them, planes, and a number that is given."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.two_images import SIZE, two_images
from numpy.testing import assert_allclose, assert_array_equal

from benchmarks.static_scenes import street
from skmotionseg import MotionSegmenter
from skmotionseg.datasets import make_scene
from skmotionseg.metrics import misclassification_error

QUICK = {"n_hypotheses": 100, "random_state": 0}


def segment(X, n_motions="auto", **parameters):
    return MotionSegmenter(n_motions, **QUICK | parameters).fit(X)


def judge(y, segmenter, lost=0.1, kept=0.1):
    """All is well but for some tracks."""
    labels = segmenter.labels_
    assert segmenter.n_motions_ == y.max() + 1
    assert misclassification_error(y, labels) <= lost
    if (y < 0).any():
        assert (labels[y < 0] >= 0).mean() <= kept


@pytest.mark.parametrize("mismatches", [60, 120])  # three fifths, three quarters
def test_one_motion_among_mismatches(mismatches):
    X, y = two_images([40], mismatches)
    judge(y, segment(X))


def test_three_motions_and_as_many_mismatches():
    X, y = two_images([40, 30, 20], 90)
    segmenter = segment(X)
    judge(y, segmenter)
    assert set(segmenter.label_reasons_[segmenter.labels_ < 0]) == {"outlier"}


def test_planes():
    X, y = two_images([40, 30], 40, flat=True, seed=1)
    judge(y, segment(X))


def before_a_still_camera(n_tracks, n_moving, shift, grows=1.0):
    """A scene that rests, and a thing before it that goes to the side or grows."""
    rng = np.random.RandomState(0)
    thing = [150, 200] + rng.rand(n_moving, 2) * [120, 90]
    x = np.vstack([rng.rand(n_tracks, 2) * SIZE, thing])
    y = x.copy()
    y[n_tracks:] = thing.mean(axis=0) + grows * (thing - thing.mean(axis=0)) + shift
    X = np.hstack([x, y]) + 0.15 * rng.randn(len(x), 4)
    return X, np.repeat([0, 1], [n_tracks, n_moving])


@pytest.mark.parametrize("n_tracks, n_moving", [(40, 20), (150, 60)])
@pytest.mark.parametrize("shift", [(20, 0), (60, 12), (0, -150)])
def test_what_moves_before_a_still_camera_is_found(n_tracks, n_moving, shift):
    """However far: one epipolar geometry explains both, but no motion of a camera."""
    X, y = before_a_still_camera(n_tracks, n_moving, shift)
    judge(y, segment(X))


def test_what_comes_nearer_before_a_still_camera_is_found():
    X, y = before_a_still_camera(100, 50, (0, 0), grows=1.1)
    judge(y, segment(X))


@pytest.mark.parametrize("seed, n_frames", [(0, 3), (1, 5)])
def test_steps_of_a_few_pixels_before_a_still_camera_are_found(seed, n_frames):
    kind = {"random_state": seed, "n_tracks": 200, "n_frames": n_frames}
    scene = make_scene("still_camera", **kind)
    ends = scene.data.reshape(200, -1, 2)[:, [0, -1]].reshape(200, 4)
    seen = np.isfinite(ends).all(axis=1)
    labels = segment(ends[seen]).labels_
    assert misclassification_error(scene.target[seen], labels) < 0.1


@pytest.fixture(scope="module")
def pair():
    """Two motions among mismatches: X, y, and a segmenter of them."""
    X, y = two_images([30, 24], 20, seed=2)
    return X, y, segment(X)


@pytest.mark.parametrize("away", [1e5, 1e9])
def test_a_track_astray_takes_no_motion_from_the_others(pair, away):
    X, y, segmenter = pair
    judge(y, segmenter)
    astray = np.vstack([X, away * np.array([[0.3, 0.9, 0.7, 0.1]])])
    judge(np.append(y, -1), segment(astray))


@pytest.mark.parametrize("noise", [0.0, 1.5])
def test_exact_and_noisy_tracks(noise):
    X, y = two_images([40, 30], 20, noise=noise, seed=2)
    judge(y, segment(X))


@pytest.mark.slow
def test_the_number_is_obeyed():
    X, y = two_images([40, 30, 20], 30)
    judge(y, segment(X, 3))
    X, _ = two_images([24, 20], 12, seed=2)
    for n_motions in (1, 4, 6):
        assert segment(X, n_motions).n_motions_ == n_motions
    segmenter = segment(X, min_motions=2, max_motions=4)
    assert set(segmenter.counts_) <= {2, 3, 4}


@pytest.mark.slow
def test_a_mirrored_image_and_tracks_in_another_order(pair):
    X, y, segmenter = pair
    judge(y, segment(np.tile(SIZE * [1, 0], 2) + X * [-1, 1, -1, 1]))
    judge(y, segment(X[:, [2, 3, 0, 1]]))  # the images in the other order
    order = np.random.default_rng(0).permutation(len(X))
    again = segment(X[order]).labels_
    assert misclassification_error(segmenter.labels_[order], again) < 0.05


@pytest.mark.slow
def test_scale_does_not_matter(pair):
    X, _, segmenter = pair
    for scale in (0.01, 100):
        labels = segment(scale * X).labels_
        assert misclassification_error(segmenter.labels_, labels) < 0.05


@pytest.mark.slow
def test_a_seed_gives_its_labels():
    X, _ = two_images([24, 20], 12, seed=2)
    once, again = segment(X), segment(X, n_jobs=2)
    assert_array_equal(once.labels_, again.labels_)
    assert_array_equal(once.costs_, again.costs_)


def test_what_is_known_of_the_number_and_of_each_label(pair):
    X, _, segmenter = pair
    best = segmenter.best_index_
    assert segmenter.counts_[best] == 2
    assert np.isnan(segmenter.log_odds_[0])
    assert np.isfinite(segmenter.log_odds_[1:]).all()
    assert_allclose(segmenter.count_probabilities_.sum(), 1)
    assert segmenter.count_probabilities_.argmax() == best
    assert segmenter.costs_[:, 2].argmin() == best
    assert_allclose(segmenter.costs_[:, :2].sum(axis=1), segmenter.costs_[:, 2])
    inside = segmenter.labels_ >= 0
    assert (segmenter.probabilities_[~inside] == 0).all()
    assert (segmenter.probabilities_[inside] > 1 / 3).all()
    assert "2 motions in 74 tracks" in str(segmenter.report(X))


def test_matrices_are_those_of_the_tracks(pair):
    X, _, segmenter = pair
    assert segmenter.matrices_.shape == (2, 1, 3, 3)
    for motion, F in enumerate(segmenter.matrices_[:, 0]):
        own = np.flatnonzero(segmenter.labels_ == motion)
        x, y = (np.insert(X[own, i : i + 2], 2, 1, axis=1) for i in (0, 2))
        lines, back = x @ F.T, y @ F
        gradient = (lines[:, :2] ** 2).sum(axis=1) + (back[:, :2] ** 2).sum(axis=1)
        distances = np.abs((y * lines).sum(axis=1)) / np.sqrt(gradient)
        assert np.median(distances) < 1
        assert_allclose(segmenter.residuals_[0, own], distances, rtol=1e-2, atol=1e-3)


@pytest.mark.slow
def test_new_tracks_are_placed_and_rejected():
    X, y = two_images([60, 50], 60, seed=7)
    fitted = np.arange(len(X)) % 3 > 0
    segmenter = segment(X[fitted])
    labels = segmenter.predict(X[~fitted])
    assert misclassification_error(y[~fitted], labels) < 0.1
    assert (labels[y[~fitted] < 0] < 0).mean() > 0.9
    assert_array_equal(segmenter.predict(X[fitted]), segmenter.labels_)
    judge(y, segment(X, n_landmarks=120))
    kept = segment(X, reject_outliers=False)
    assert (kept.labels_ >= 0).all() and kept.n_motions_ == 2


def test_tracks_that_one_image_misses_are_too_short():
    X, y = two_images([40, 30], 20, seed=8)
    X[:5, :2], X[5:10, 2:] = np.nan, np.nan
    segmenter = segment(X)
    assert (segmenter.label_reasons_[:10] == "too short").all()
    judge(np.where(np.arange(len(y)) < 10, -1, y), segmenter)


@pytest.mark.slow
@pytest.mark.parametrize("n_tracks", [12, 15, 16, 20])
def test_few_tracks_are_segmented_too(n_tracks):
    X, _ = two_images([n_tracks], seed=n_tracks)
    assert segment(X).n_motions_ >= 1
    assert segment(X, 2).n_motions_ == 2


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in (1, 2))]
)
def test_ground_and_houses_are_one_motion(seed):
    segmenter = segment(street(seed=seed)[0])
    assert segmenter.n_motions_ == 1
    assert (segmenter.labels_ == 0).mean() > 0.95
    X, surfaces = street(n_moving=40, seed=seed)
    segmenter = segment(X)
    judge((surfaces == 3).astype(int), segmenter)
    # New tracks are placed by whichever of its surfaces explains them best.
    again = X + 0.1 * np.random.default_rng(seed).standard_normal(X.shape)
    assert (segmenter.predict(again) == segmenter.labels_).mean() > 0.95
