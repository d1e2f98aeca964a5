"""What comes of tracks that are short, apart, alone, unseen, still or degenerate."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from sklearn.base import clone

from skmotionseg import (
    HypothesisSampler,
    MotionSegmenter,
    ORKKernel,
    make_motion_pipeline,
)
from skmotionseg._core.geometry.description_length import clip_geometry
from skmotionseg._core.geometry.tracks import unpack_tracks
from skmotionseg.datasets import make_rigid_motions
from skmotionseg.metrics import misclassification_error

MODELS = ("affine", "homography", "fundamental")
FUSIONS = ("kernel_addition", "coreg", "subset")
SMALL = {"n_hypotheses": 200, "random_state": 0}

every_selection = pytest.mark.parametrize(
    "selection", ["description_length", "ncre", "eigengap", "self_tuning"]
)
# The default as it comes; other fusions by the rule that has labels of nothing else.
every_fusion = pytest.mark.parametrize(
    ("fusion", "selection"),
    [
        ("kernel_addition", "description_length"),
        *((fusion, "ncre") for fusion in FUSIONS),
    ],
)
every_count = pytest.mark.parametrize("n_motions", [2, "auto"])


@pytest.fixture
def two_motions():
    """Two motions, all of them seen in 7 frames: (X, y)."""
    return make_rigid_motions(
        n_tracks=60, n_frames=7, n_motions=2, missing=0, random_state=1
    )


@pytest.fixture
def one_motion():
    """A static scene before a moving camera, all of it seen in 10 frames."""
    return make_rigid_motions(
        n_tracks=60, n_frames=10, n_motions=1, missing=0, random_state=0
    )[0]


def hide(X, rows, frames):
    """A copy in which the tracks are not seen in the frames."""
    points = X.reshape(len(X), -1, 2).copy()
    points[np.ix_(np.atleast_1d(rows), np.atleast_1d(frames))] = np.nan
    return points.reshape(X.shape)


def all_frames_but(X, *frames):
    return np.setdiff1d(np.arange(X.shape[1] // 2), frames)


def assert_valid(labels, n_tracks):
    """One whole number per track: -1, or 0, 1, ... from the largest motion down."""
    assert labels.shape == (n_tracks,)
    assert labels.dtype.kind == "i"
    assert labels.min() >= -1
    sizes = np.bincount(labels[labels >= 0])
    assert len(sizes) > 0
    assert (sizes > 0).all()
    assert (np.diff(sizes) <= 0).all()


# ------------------------------------------------------------------- short tracks


@every_fusion
def test_a_track_seen_in_two_frames_joins_its_motion(two_motions, fusion, selection):
    X, y = two_motions
    of_motion = [np.flatnonzero(y == motion) for motion in (0, 1)]
    short = np.concatenate([tracks[:3] for tracks in of_motion])
    X = hide(X, short, all_frames_but(X, 3, 4))
    segmenter = MotionSegmenter(2, fusion=fusion, selection=selection, **SMALL)
    labels = segmenter.fit_predict(X)
    for tracks in of_motion:
        largest = np.bincount(labels[tracks[3:]]).argmax()
        assert set(labels[tracks[:3]]) == {largest}
    assert misclassification_error(y, labels) < 0.05


def test_motions_are_found_where_a_third_is_unseen():
    X, y = make_rigid_motions(150, 12, 2, missing=0.35, random_state=0)
    labels = MotionSegmenter(2, **SMALL).fit_predict(X)
    assert misclassification_error(y, labels) < 0.05


def test_one_coordinate_of_a_point_is_not_enough_to_see_it(two_motions):
    X, _ = two_motions
    both, one = hide(X, 7, 3), X.copy()
    one[7, 6] = np.nan
    segmenter = MotionSegmenter(2, selection="ncre", **SMALL)
    assert_array_equal(*(segmenter.fit_predict(seen) for seen in (both, one)))


# ----------------------------------------------------------- pairs with few tracks


@pytest.fixture
def few_in_frame_4(two_motions):
    """Only five tracks are seen in frame 4, so in the pairs 3 and 4."""
    X, y = two_motions
    return hide(X, np.arange(5, len(X)), 4), y


def test_a_pair_with_too_few_tracks_has_no_hypotheses(few_in_frame_4):
    X, _ = few_in_frame_4
    sampler = HypothesisSampler("fundamental", **SMALL).fit(X)
    usable = np.isfinite(sampler.hypotheses_).all(axis=(1, 2, 3))
    assert_array_equal(np.flatnonzero(~usable), [3, 4])
    assert np.isnan(sampler.hypotheses_[~usable]).all()


def test_a_pair_with_too_few_tracks_has_no_residuals(few_in_frame_4):
    X, _ = few_in_frame_4
    residuals = HypothesisSampler("fundamental", **SMALL).fit_transform(X)
    residuals = residuals.reshape(len(X), 6, 200)
    assert np.isnan(residuals[:, [3, 4]]).all()
    assert np.isfinite(np.delete(residuals, [3, 4], axis=1)).all()


def test_simpler_models_use_the_pair_that_has_too_few_for_a_richer_one(few_in_frame_4):
    X, _ = few_in_frame_4
    hypotheses = HypothesisSampler("homography", **SMALL).fit(X).hypotheses_
    assert np.isfinite(hypotheses).all()


@pytest.mark.parametrize("models", [("fundamental",), MODELS], ids=len)
def test_the_other_pairs_still_tell_the_motions(few_in_frame_4, models):
    X, y = few_in_frame_4
    labels = MotionSegmenter(2, models=models, **SMALL).fit_predict(X)
    assert_valid(labels, len(X))
    assert misclassification_error(y, labels) < 0.05


@pytest.mark.parametrize("model", MODELS)
def test_no_pair_with_enough_tracks_is_an_error(one_motion, model):
    needed = {"affine": 3, "homography": 4, "fundamental": 8}[model]
    X = one_motion.copy()
    for frame in range(1, 10, 2):  # every pair has one odd frame
        X = hide(X, np.arange(needed - 1, len(X)), frame)
    message = f"{model} model needs {needed} tracks .* has {needed - 1}"
    with pytest.raises(ValueError, match=message):
        HypothesisSampler(model).fit(X)
    for frame in range(10):  # nor are any two others seen together
        rows = np.arange(needed - 1, len(X))
        X = hide(X, rows[rows % 10 != frame], frame)
    with pytest.raises(ValueError, match=message):
        MotionSegmenter(models=[model]).fit(X)


# ---------------------------------------------------------------- tracks set apart


@every_fusion
def test_groups_that_never_meet_are_motions_of_their_own(one_motion, fusion, selection):
    early = np.arange(len(one_motion)) < 40
    X = hide(one_motion, np.flatnonzero(early), np.arange(5, 10))
    X = hide(X, np.flatnonzero(~early), np.arange(5))
    segmenter = MotionSegmenter(2, fusion=fusion, selection=selection, **SMALL)
    assert_array_equal(segmenter.fit_predict(X), np.where(early, 0, 1))


def test_groups_that_meet_through_others_can_be_one_motion(one_motion):
    X = hide(one_motion, np.arange(20), np.arange(5, 10))
    X = hide(X, np.arange(20, 40), np.arange(5))
    assert_array_equal(MotionSegmenter(1, **SMALL).fit_predict(X), 0)


@pytest.fixture(params=["meets no other", "one frame", "never seen"])
def with_a_stray(request, two_motions):
    """Two motions and, in row 11, a track of which nothing can be said: (X, y)."""
    X, y = two_motions
    y[11] = -1
    if request.param == "meets no other":
        others = np.delete(np.arange(len(X)), 11)
        X = hide(hide(X, others, [5, 6]), 11, np.arange(5))
    else:
        seen = [3] if request.param == "one frame" else []
        X = hide(X, 11, all_frames_but(X, *seen))
    return X, y


@every_count
@every_selection
def test_a_stray_track_belongs_to_no_motion(with_a_stray, n_motions, selection):
    X, y = with_a_stray
    segmenter = MotionSegmenter(
        n_motions, selection=selection, max_motions=3, **SMALL
    ).fit(X)
    assert_valid(segmenter.labels_, len(X))
    assert_array_equal(np.flatnonzero(segmenter.labels_ == -1), [11])
    if n_motions == 2:
        assert misclassification_error(y, segmenter.labels_) < 0.05


@pytest.mark.parametrize("model", MODELS)
def test_a_stray_track_has_no_affinity(with_a_stray, model):
    X, _ = with_a_stray
    residuals = HypothesisSampler(model, **SMALL).fit_transform(X)
    K = ORKKernel(n_hypotheses=200).fit_transform(residuals)
    assert np.isfinite(K).all()
    assert (np.delete(K[11], 11) == 0).all()


@pytest.mark.parametrize("fusion", FUSIONS)
def test_a_stray_track_belongs_to_no_cluster(with_a_stray, fusion):
    X, y = with_a_stray
    pipeline = make_motion_pipeline(n_clusters=2, fusion=fusion, **SMALL)
    labels = pipeline.fit_predict(X)
    assert_array_equal(np.flatnonzero(labels == -1), [11])
    assert misclassification_error(y, labels) < 0.05
    assert np.isfinite(pipeline["cluster"].clusterer_.view_embeddings_).all()


@pytest.mark.parametrize(
    "estimator", [MotionSegmenter(2, **SMALL), make_motion_pipeline(**SMALL)]
)
def test_a_stray_track_is_not_placed_either(with_a_stray, two_motions, estimator):
    stray = with_a_stray[0][[11]]
    X = hide(two_motions[0], np.arange(60), [5, 6])
    assert_array_equal(clone(estimator).fit(X).predict(stray), [-1])


def test_a_count_above_the_tracks_that_meet_others_is_an_error(two_motions):
    X, _ = two_motions
    X = hide(X, np.arange(4, len(X)), np.arange(7))
    with pytest.raises(ValueError, match="5 motions are more than the 4 tracks that"):
        MotionSegmenter(5, models=["affine"], **SMALL).fit(X)


# ------------------------------------------------------- simple and degenerate scenes


@every_count
@every_selection
@pytest.mark.parametrize(
    "points",
    [
        pytest.param(lambda x, t: x + 0 * t, id="static"),
        pytest.param(lambda x, t: x[:1] + 0 * x + 0 * t, id="one spot"),
        pytest.param(lambda x, t: x + 3 * t, id="one translation"),
        pytest.param(lambda x, t: x * [1, 0] + 2 * t, id="one row"),
        pytest.param(lambda x, t: x[..., :1] * [1, 0.3] + 2 * t, id="one slope"),
    ],
)
def test_degenerate_points_get_valid_labels(points, n_motions, selection):
    x = np.random.default_rng(0).uniform(0, 500, size=(40, 1, 2))
    X = points(x, np.arange(4)[:, None]).reshape(40, 8)
    segmenter = MotionSegmenter(
        n_motions, selection=selection, max_motions=3, **SMALL
    ).fit(X)
    assert_valid(segmenter.labels_, 40)
    assert segmenter.n_motions_ == segmenter.labels_.max() + 1
    assert set(segmenter.predict(X)) <= set(range(-1, segmenter.n_motions_))


@every_selection
def test_a_still_camera(selection):
    X, y = make_rigid_motions(
        60, 6, n_motions=2, camera="still", missing=0.2, random_state=0
    )
    labels = MotionSegmenter(2, selection=selection, **SMALL).fit_predict(X)
    assert misclassification_error(y, labels) < 0.05


@every_selection
def test_one_motion_is_all_zeros(one_motion, selection):
    segmenter = MotionSegmenter(1, selection=selection, **SMALL).fit(one_motion)
    assert segmenter.n_motions_ == 1
    assert_array_equal(segmenter.labels_, 0)
    assert_array_equal(segmenter.predict(one_motion), 0)


@every_selection
@pytest.mark.parametrize("noise", [0, 0.5])
def test_identical_tracks_get_the_same_label(noise, selection):
    X, _ = make_rigid_motions(n_tracks=40, n_frames=4, noise=noise, random_state=0)
    segmenter = MotionSegmenter(3, selection=selection, **SMALL)
    labels = segmenter.fit_predict(np.vstack([X, X]))
    assert_array_equal(labels[:40], labels[40:])


@every_selection
@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(s, marks=pytest.mark.long) for s in (2, 3, 4))]
)
@pytest.mark.parametrize("n_motions", [2, 3, "auto"])
def test_identical_still_tracks_get_the_same_label(selection, n_motions, seed):
    x = np.random.default_rng(seed).uniform(0, 500, size=(8, 2))
    X = np.tile(np.vstack([x, x[:4]]), 2)
    segmenter = MotionSegmenter(
        n_motions, models=MODELS[:2], selection=selection, random_state=seed
    )
    labels = segmenter.fit_predict(X)
    assert_array_equal(labels[8:], labels[:4])


@pytest.mark.parametrize("seed", [1, 9])
def test_tracks_that_have_next_to_nothing_in_common_get_valid_labels(seed):
    """No affinity among them outlives the epsilon-neighbourhood."""
    X = np.random.default_rng(seed).uniform(-300, 300, size=(4, 6))
    segmenter = MotionSegmenter(models="affine", n_hypotheses=20, random_state=0)
    assert_valid(segmenter.fit_predict(X), 4)


def test_pixels_far_from_the_origin(two_motions):
    X, y = two_motions
    labels = MotionSegmenter(2, **SMALL).fit_predict(X + 1e5)
    assert misclassification_error(y, labels) < 0.05


@pytest.mark.parametrize(
    "n_tracks", [40, 100, pytest.param(300, marks=pytest.mark.long)]
)
def test_halves_of_a_scene_that_are_never_seen_together_stay_apart(n_tracks):
    X, _ = make_rigid_motions(
        n_tracks=n_tracks, n_frames=10, n_motions=1, missing=0, random_state=0
    )
    half = n_tracks // 2
    X[:half, 10:] = np.nan
    X[half:, :10] = np.nan
    labels = MotionSegmenter(n_hypotheses=100, random_state=0).fit_predict(X)
    assert set(labels[:half]).isdisjoint(labels[half:])


def test_a_motion_seen_briefly_in_a_long_clip_is_looked_at():
    X, y = make_rigid_motions(
        n_tracks=120, n_frames=120, n_motions=2, missing=0, random_state=3
    )
    frames = np.arange(120)
    brief = np.repeat((frames < 56) | (frames > 64), 2)
    X[np.ix_(y == 1, brief)] = np.nan
    births = np.random.default_rng(0).integers(0, 105, (y == 0).sum())
    for row, birth in zip(np.flatnonzero(y == 0), births, strict=True):
        X[row, np.repeat((frames < birth) | (frames > birth + 15), 2)] = np.nan
    geometry = clip_geometry(*unpack_tracks(X))
    assert geometry.seen[:, y == 1].any(axis=0).all()


def test_masked_points_are_unseen():
    X, _ = make_rigid_motions(60, 5, 2, missing=0.2, random_state=0)
    masked = np.ma.masked_invalid(X)
    masked.data[masked.mask] = 7.0  # what is under a mask does not count
    segmenter = MotionSegmenter(2, selection="ncre", n_hypotheses=50, random_state=0)
    expected = segmenter.fit_predict(X)
    for tracks in (masked, list(masked)):
        assert_array_equal(segmenter.fit_predict(tracks), expected)
        assert_array_equal(segmenter.predict(tracks), expected)


def test_masked_residuals_are_of_pairs_that_do_not_see_the_track():
    X, _ = make_rigid_motions(60, 5, 2, missing=0.2, random_state=0)
    sampler = HypothesisSampler("affine", n_hypotheses=50, random_state=0)
    residuals = np.asarray(sampler.fit_transform(X))
    masked = np.ma.masked_invalid(residuals)
    masked.data[masked.mask] = 0  # of a track that would fit all hypotheses
    kernel = ORKKernel(n_hypotheses=50)
    expected = kernel.fit_transform(residuals)
    assert_array_equal(kernel.fit_transform(masked), expected)
    assert_array_equal(kernel.transform(list(masked)), expected)


def test_tracks_of_photographs_are_seen_in_pairs_of_any_distance():
    X, y = make_rigid_motions(80, 6, 2, missing=0, random_state=0)
    visibility = np.zeros((80, 6), dtype=bool)
    for track in range(80):  # in two or three of six, mostly not consecutive
        visibility[
            track, [track % 6, (track + 2) % 6, (track + 4) % 6][: 2 + y[track]]
        ] = 1
    X = np.where(np.repeat(visibility, 2, axis=1), X, np.nan)
    segmenter = MotionSegmenter(2, n_hypotheses=50, random_state=0).fit(X)
    assert "too short" not in segmenter.label_reasons_
    gap = MotionSegmenter(2, n_hypotheses=50, frame_gap=2, random_state=0)
    sampler, _ = gap.fit(X).views_["affine"]
    assert_array_equal(np.diff(sampler.frame_pairs_).ravel(), 2)  # as it was asked for
