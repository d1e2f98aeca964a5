"""What MotionSegmenter chooses, and what it keeps."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.base import BaseEstimator
from sklearn.cluster import KMeans
from sklearn.utils._param_validation import InvalidParameterError

from benchmarks.static_scenes import shaken, turned
from skmotionseg import (
    MotionSegmenter,
    MultiModelSpectralClustering,
    NCREModelSelector,
    pack_tracks,
)
from skmotionseg._core.partition import search
from skmotionseg._utils.validation import placeholder_of
from skmotionseg.datasets import make_rigid_motions
from skmotionseg.metrics import misclassification_error


def further_seed(seed):
    """What one seed has shown, in the long run alone."""
    return pytest.param(seed, marks=pytest.mark.long)


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
    total = costs[:, :2] @ segmenter.cost_weights_
    np.testing.assert_allclose(costs[:, 2], total)
    assert costs[0, 0] == pytest.approx(0, abs=1e-9)  # one motion cuts nothing


@pytest.mark.parametrize("seed", [0, further_seed(1), further_seed(2)])
@pytest.mark.parametrize(
    ("shapes", "camera"),
    [("general", "general"), ("planar", "general"), ("general", "rotation")],
)
def test_one_motion_is_an_answer(shapes, camera, seed):
    X, _ = make_rigid_motions(
        n_tracks=100,
        n_frames=6,
        n_motions=1,
        shapes=shapes,
        camera=camera,
        random_state=seed,
    )
    segmenter = MotionSegmenter(max_motions=4, n_hypotheses=200, random_state=seed)
    assert segmenter.fit(X).n_motions_ == 1


def test_three_motions_are_found_with_their_number_unknown():
    """Though in eight frames, a motion that turns and moves may be that of two bodies.

    Only the links that they do not have tell those apart.
    """
    for seed in range(6):
        X, y = make_rigid_motions(n_tracks=200, n_frames=8, random_state=seed)
        segmenter = MotionSegmenter(n_hypotheses=200, random_state=seed).fit(X)
        assert segmenter.n_motions_ == 3, seed
        assert misclassification_error(y, segmenter.labels_) < 0.01


def two_blobs(n_each, n_frames=30, seed=0):
    """Points (2 * n_each, n_frames, 2) of two things that move apart, and labels."""
    rng = np.random.default_rng(seed)
    corners = ((50, 50), (250, 250)), ((350, 200), (600, 400))
    velocities = np.array([(3, 1), (-2, 4)], dtype=float)
    steps = np.arange(n_frames)[:, None]
    points = np.concatenate(
        [
            rng.uniform(*corner, (n_each, 2))[:, None] + steps * velocity
            for corner, velocity in zip(corners, velocities, strict=True)
        ]
    )
    return points + rng.normal(0, 0.1, points.shape), np.repeat([0, 1], n_each)


@pytest.mark.parametrize("seed", range(3))
def test_few_tracks_of_two_motions_are_parted(seed):
    points, y = two_blobs(12, seed=seed)
    X = points.reshape(len(points), -1)
    segmenter = MotionSegmenter(random_state=0).fit(X)
    assert segmenter.n_motions_ == 2
    assert misclassification_error(y, segmenter.labels_) < 0.1


@pytest.mark.parametrize("seed", range(3))
def test_few_tracks_of_one_motion_are_not(seed):
    points, y = two_blobs(24, n_frames=10, seed=seed)
    X = points[y == 0].reshape((y == 0).sum(), -1)
    assert MotionSegmenter(random_state=0).fit(X).n_motions_ == 1


def test_a_known_count_is_kept():
    X, _ = make_rigid_motions(60, 4, 2, random_state=0)
    for count in (1, 2, 4):
        segmenter = MotionSegmenter(count, n_hypotheses=50, random_state=0)
        assert segmenter.fit(X).n_motions_ == count


def test_predict_gives_fitted_tracks_their_own_label(scene):
    X, _ = scene
    segmenter = MotionSegmenter(3, n_hypotheses=200, random_state=0).fit(X)
    assert np.mean(segmenter.predict(X) == segmenter.labels_) > 0.98


def test_the_background_frames_the_image_though_it_has_fewer_tracks():
    rng = np.random.default_rng(0)
    steps = np.arange(8)[:, None]
    scene = rng.uniform(0, 300, size=(90, 2))
    scene = scene[(np.abs(scene - 150) > 70).any(axis=1)]
    thing = rng.uniform(100, 200, size=(120, 2))
    X = np.concatenate(
        [
            (scene[:, None] + steps * (1.0, 0.5)).reshape(len(scene), -1),
            (thing[:, None] + steps * (-3.0, 2.0)).reshape(len(thing), -1),
        ]
    )
    X += 0.05 * rng.standard_normal(X.shape) - 1000  # the image is what tracks cover
    segmenter = MotionSegmenter(2, n_hypotheses=100, random_state=0).fit(X)
    labels = segmenter.labels_
    assert (
        segmenter.background_ == 1 == np.bincount(labels[: len(scene)] + 1)[1:].argmax()
    )


def test_a_focal_length_reaches_the_search_for_rigid_motions(monkeypatch):
    given, whole = [], search.RigidSearch

    def watched(windows, *args):
        given.append(args[-1] and args[-1] * windows.size)
        return whole(windows, *args)

    monkeypatch.setattr(search, "RigidSearch", watched)
    X, _ = make_rigid_motions(60, 6, 2, random_state=0)
    for focal_length in (600.0, None):
        MotionSegmenter(2, focal_length=focal_length, n_hypotheses=50).fit(X)
    assert given == [pytest.approx(600), None]


@pytest.mark.parametrize("focal_length", [1e-300, 1e300])
def test_a_focal_length_beyond_all_lenses_is_the_limit(focal_length):
    X, y = make_rigid_motions(80, 6, 2, random_state=0)
    found = MotionSegmenter(focal_length=focal_length, random_state=0).fit(X)
    assert misclassification_error(y, found.labels_) == 0


@pytest.mark.parametrize("value", [0, -1, -999, 65535])
def test_numbers_where_nothing_is_seen_are_warned_of(value):
    X, _ = make_rigid_motions(60, 6, 2, missing=0.1, random_state=0)
    segmenter = MotionSegmenter(2, n_hypotheses=20, random_state=0)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        segmenter.fit(np.nan_to_num(X, nan=value))
    words = f"at ({value}, {value}) in some frames"
    assert any(words in str(each.message) for each in told)


def test_where_nothing_is_seen():
    X, _ = make_rigid_motions(60, 6, 2, missing=0.1, random_state=0)
    assert placeholder_of(X) is None
    assert placeholder_of(np.full((9, 8), np.nan)) is None
    assert placeholder_of(np.zeros((9, 8))) is None  # never elsewhere
    for value in (0.0, X[np.isfinite(X)].min() - 9, X[np.isfinite(X)].max() + 9):
        assert placeholder_of(np.nan_to_num(X, nan=value)) == value
    few = X.copy()
    few[:2, :2] = -1000
    assert placeholder_of(few) is None


def test_whole_pixels_that_pass_by_zero_are_not():
    """Where the origin is the image's centre."""
    X, _ = make_rigid_motions(60, 6, 2, random_state=0)
    X[:6] = np.kron(np.arange(6) - 3, [1, 0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        MotionSegmenter(2, n_hypotheses=20, random_state=0).fit(X)


def test_motions_that_lose_all_tracks_are_warned_of():
    """Fourteen points jump about, which are then a motion and outliers as well."""
    rng = np.random.RandomState(0)
    still = rng.rand(40, 1, 2) * [640, 480] + np.zeros((6, 1))
    steps = np.arange(6)[:, None] * [8.0, 3.0]
    moving = [150, 200] + rng.rand(15, 1, 2) * [120, 90] + steps
    points = np.concatenate([still, moving, rng.rand(14, 6, 2) * [640, 480]])
    points += 0.15 * rng.standard_normal(points.shape)
    segmenter = MotionSegmenter(3, random_state=0)
    with pytest.warns(UserWarning, match="=3 was asked for, and 2 motions found"):
        segmenter.fit(points.reshape(69, -1))
    assert segmenter.n_motions_ == 2


@pytest.mark.parametrize("seed", [0, 2])
def test_what_goes_straight_on_before_a_panning_camera_is_found(seed):
    """Whatever the focal length is taken for, which the clip hardly tells."""
    X, y = turned(0.01, n_moving=30, seed=seed)
    segmenter = MotionSegmenter(random_state=0).fit(X)
    assert misclassification_error(y, segmenter.labels_) < 0.02


def room_and_car(seed, begins=0, speed=12.0):
    """A room that stands still, and a car that drives off, in 30 frames."""
    rng = np.random.RandomState(seed)
    points = rng.uniform([0, 0], [1280, 720], size=(140, 1, 2)) + np.zeros((30, 1))
    car = np.arange(140) >= 120
    points[car] = rng.uniform([100, 300], [260, 400], size=(20, 1, 2))
    depth = rng.uniform(0.9, 1.1, size=(20, 1))
    drives = np.maximum(np.arange(30) - begins, 0)
    points[car, :, 0] += speed * depth * drives
    points += 0.2 * rng.standard_normal(points.shape)
    return points, car


def assert_found(segmenter, X, car):
    assert segmenter.fit(X).n_motions_ == 2
    assert misclassification_error(car.astype(int), segmenter.labels_) < 0.02
    assert not (segmenter.labels_[car] == segmenter.background_).any()


@pytest.mark.parametrize("first, n_seen", [(11, 5), (10, 10), (13, 3)])
def test_what_is_in_view_for_a_moment_is_found(first, n_seen):
    points, car = room_and_car(0, speed=60.0)
    seen = np.ones(points.shape[:2], dtype=bool)
    seen[car] = False
    seen[car, first : first + n_seen] = True
    points[car, :, 0] -= 60 * first
    assert_found(MotionSegmenter(random_state=0), pack_tracks(points, seen), car)


@pytest.mark.parametrize("seed", [0, further_seed(1), further_seed(2)])
def test_what_drives_off_late_is_found(seed):
    points, car = room_and_car(seed, begins=22)
    assert_found(MotionSegmenter(random_state=0), pack_tracks(points), car)


@pytest.mark.parametrize(
    "selection",
    [
        NCREModelSelector(min_clusters=0),
        NCREModelSelector(MultiModelSpectralClustering(n_init=0)),
        MultiModelSpectralClustering(n_clusters=0),
        KMeans(2, init="anyhow"),
    ],
    ids=repr,
)
def test_parameters_of_a_selection_are_checked_before_any_work(scene, selection):
    segmenter = MotionSegmenter(selection=selection)
    with pytest.raises(InvalidParameterError, match=r"parameter of .* must be"):
        segmenter.fit(scene[0])
    assert not hasattr(segmenter, "views_")


class _Says(BaseEstimator):
    """A selection of given labels."""

    def __init__(self, labels):
        self.labels = labels

    def fit(self, X, y=None):
        self.labels_ = np.resize(self.labels, len(X))
        return self


def test_labels_of_a_selection_are_checked(scene):
    def fitted(labels):
        segmenter = MotionSegmenter(selection=_Says(labels), n_hypotheses=20)
        return segmenter.fit(scene[0])

    assert fitted([0, 1, -1]).n_motions_ == 2
    with pytest.raises(ValueError, match="labels_ of _Says must be whole numbers"):
        fitted([0.5, 1.5])
    with pytest.raises(ValueError, match="_Says found no motion"):
        fitted([-1])


class _Compares(BaseEstimator):
    """A selection that compares two counts, but for attributes that are others."""

    def __init__(self, others):
        self.others = others

    def fit(self, X, y=None):
        self.labels_ = np.arange(len(X)) % 2
        self.counts_, self.best_index_ = np.array([1, 2]), 1
        self.costs_ = np.zeros((2, 3))
        self.candidate_labels_ = np.stack([np.zeros_like(self.labels_), self.labels_])
        vars(self).update(self.others)
        return self


@pytest.mark.parametrize(
    "others, words",
    [
        (
            {"costs_": np.zeros((2, 2))},
            r"costs_ .* must have shape \(2, 3\), .*\(2, 2\)",
        ),
        ({"candidate_labels_": np.zeros((2, 5))}, r"candidate_labels_ .* got \(2, 5\)"),
        ({"counts_": np.ones((2, 1))}, r"counts_ .* \(2,\), .*; got \(2, 1\)"),
        ({"best_index_": 7}, "best_index_ of _Compares .* among 2 counts; got 7"),
        ({"best_index_": None}, "best_index_ of _Compares .*; got None"),
    ],
)
def test_what_a_selection_says_of_counts_is_checked(scene, others, words):
    def fitted(others):
        selection = _Compares(others)
        return MotionSegmenter(selection=selection, n_hypotheses=20).fit(scene[0])

    assert fitted({}).counts_.tolist() == [1, 2]
    with pytest.raises(ValueError, match=words):
        fitted(others)


def test_a_selection_without_labels_is_refused(scene):
    class Silent(_Says):
        def fit(self, X, y=None):
            return self

    with pytest.raises(AttributeError, match="Silent must set labels_ in fit"):
        MotionSegmenter(selection=Silent([0]), n_hypotheses=20).fit(scene[0])


def test_coordinates_that_are_no_pixels_are_warned_of():
    points, _ = room_and_car(0)
    X = pack_tracks(points / [1280, 720])
    with pytest.warns(UserWarning, match="multiply them by its width and height"):
        MotionSegmenter(2, n_hypotheses=20, random_state=0).fit(X)


@pytest.mark.parametrize("n_moving", [0, 30])
def test_a_room_before_a_rolling_shutter_is_one_motion(n_moving):
    X, y = shaken(0.7, n_moving=n_moving, seed=1)
    segmenter = MotionSegmenter(random_state=0).fit(X)
    assert segmenter.n_motions_ == 1 + bool(n_moving)
    assert misclassification_error(y, segmenter.labels_) < 0.02
    assert_allclose(segmenter.readout_, [0, 0.7], atol=0.15)
    assert_array_equal(segmenter.predict(X), segmenter.labels_)
    assert_array_equal(segmenter.predict(X[7:9]), segmenter.labels_[7:9])
    residuals = [motion.residual for motion in segmenter.report(X).motions]
    assert max(residuals) < 0.8  # pixels: as before a shutter that reads at once
    by_graph = MotionSegmenter(selection="ncre", random_state=0).fit(X)
    assert_array_equal(by_graph.readout_, 0)
