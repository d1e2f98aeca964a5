"""Which model explains a motion, and what a segmenter says of itself."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg import MotionSegmenter, pack_tracks
from skmotionseg._core.geometry.description_length import (
    clip_geometry,
    description_lengths,
)
from skmotionseg._core.geometry.epipolar import cheapest_rank_two
from skmotionseg._core.geometry.model_choice import (
    EXPLAINING_MODELS,
    choose_model,
    robust_errors,
)
from skmotionseg._core.geometry.motion_models import MOTION_MODELS
from skmotionseg._core.geometry.tracks import unpack_tracks
from skmotionseg._core.partition.search import count_probabilities
from skmotionseg.datasets import make_rigid_motions

MODELS = [name for name, *_ in EXPLAINING_MODELS]
SELECTIONS = ["description_length", "ncre", "eigengap", "self_tuning"]


def explanation(**scene):
    """What explains the only motion of a scene, and what its noise is."""
    X, _ = make_rigid_motions(n_frames=8, n_motions=1, **scene)
    return choose_model(clip_geometry(*unpack_tracks(X)), np.arange(len(X)))


def affine_tracks(noise, n_tracks=60, n_frames=6, seed=0):
    """Points of which each frame is an affine map of the first, in pixels."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, 500, size=(n_tracks, 2))
    shears = np.eye(2) + 0.05 * rng.standard_normal((n_frames, 2, 2))
    shifts = 20 * rng.standard_normal((n_frames, 1, 2))
    moved = (points @ shears + shifts).swapaxes(0, 1)
    return moved + noise * rng.standard_normal(moved.shape)


def seen_everywhere(points):
    return clip_geometry(points, np.ones(points.shape[:2], dtype=bool))


# ------------------------------------------------------------------- explaining models


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("noise", [0.1, 0.5])
@pytest.mark.parametrize(
    ("shapes", "camera", "model"),
    [
        ("general", "general", "fundamental"),
        ("planar", "general", "homography"),
        ("general", "rotation", "homography"),
        ("general", "still", "affine"),
    ],
)
def test_the_background_is_explained_by_what_moves_it(
    shapes, camera, model, noise, seed
):
    found = explanation(
        n_tracks=150, shapes=shapes, camera=camera, noise=noise, random_state=seed
    )
    assert found.model == model
    assert min(found.lengths, key=found.lengths.get) == model


@pytest.mark.parametrize("seed", range(3))
def test_planar_objects_are_explained_by_a_point_map(seed):
    X, y = make_rigid_motions(shapes="planar", n_frames=8, random_state=seed)
    geometry = clip_geometry(*unpack_tracks(X))
    for motion in (1, 2):
        found = choose_model(geometry, np.flatnonzero(y == motion))
        assert found.model in ("affine", "homography")


@pytest.mark.parametrize("noise", [0.05, 0.5])
def test_affine_tracks_are_explained_by_an_affine_map(noise):
    found = choose_model(seen_everywhere(affine_tracks(noise)), np.arange(60))
    assert found.model == "affine"
    # Two coordinates of noise: a Rayleigh distance, whose median is 1.18.
    assert np.median(found.residuals) == pytest.approx(1.18 * noise, rel=0.15)


def test_residuals_are_pixels():
    found = explanation(n_tracks=200, noise=0.5, random_state=0)
    # One coordinate of noise: the median of its size is 0.67.
    assert np.median(found.residuals) == pytest.approx(0.67 * 0.5, rel=0.15)
    X, _ = make_rigid_motions(200, 8, 1, noise=0.5, random_state=0)
    larger = choose_model(clip_geometry(*unpack_tracks(10 * X + 3000)), np.arange(200))
    assert larger.model == found.model
    assert_allclose(larger.residuals, 10 * found.residuals, rtol=1e-5)


def test_the_length_by_a_fundamental_matrix_is_the_description_length():
    X, _ = make_rigid_motions(80, 8, 1, missing=0, random_state=0)
    geometry, members = clip_geometry(*unpack_tracks(X)), np.arange(80)
    geometry = replace(geometry, log_range=geometry.log_range + 2)  # they move far
    (length,) = description_lengths(geometry, [members], cheapest_rank_two)
    found = choose_model(geometry, members)
    assert found.lengths["fundamental"] * geometry.n_observations == pytest.approx(
        length.total
    )


@pytest.mark.parametrize("name", ["affine", "homography"])
def test_errors_of_exact_maps_are_zero_and_others_stand_out(name):
    rng = np.random.default_rng(0)
    x = rng.uniform(-1, 1, size=(3, 40, 2))
    maps = np.eye(3) + 0.1 * rng.standard_normal((3, 3, 3))
    if name == "affine":
        maps[:, 2] = 0, 0, 1
    y = np.dstack([x, np.ones((3, 40))]) @ maps.swapaxes(1, 2)
    y = y[..., :2] / y[..., 2:]
    seen = rng.random((3, 40)) < 0.8
    y[:, :2] += 0.3  # two of forty
    errors = robust_errors(name, x, y, seen)
    inside = seen.copy()
    inside[:, :2] = False
    assert np.sqrt(errors[inside]).max() < 1e-3
    assert np.sqrt(errors[seen & ~inside]).min() > 0.1


@pytest.mark.parametrize("name", ["affine", "homography"])
def test_a_robust_map_of_clean_tracks_is_as_good_as_the_true_one(name):
    points = affine_tracks(0.3, n_frames=2, n_tracks=400)
    x, y = points[:, 0], points[:, 1]
    errors = robust_errors(name, x[None], y[None], np.ones((1, 400), dtype=bool))
    clean = affine_tracks(0, n_frames=2, n_tracks=400)
    start, end = (
        np.column_stack([side, np.ones(400)]) for side in clean.swapaxes(0, 1)
    )
    true = np.linalg.lstsq(start, end, rcond=None)[0].T
    expected = MOTION_MODELS["affine"].residuals(true[None], x, y)
    assert 0.95 < errors.sum() / expected.sum() < 1


@pytest.mark.parametrize("name", MODELS)
def test_pairs_that_see_fewer_than_eight_have_no_model(name):
    points = affine_tracks(0.1, n_tracks=20, n_frames=3)
    seen = np.ones((2, 20), dtype=bool)
    seen[1, 7:] = False
    x = np.stack([points[:, 0]] * 2)
    errors = robust_errors(name, x, x + 1, seen)
    assert np.isfinite(errors[0]).all()
    assert np.isinf(errors[1]).all()
    assert np.isinf(robust_errors(name, x[1:], x[1:], seen[1:])).all()


def test_too_few_tracks_have_no_model():
    found = choose_model(seen_everywhere(affine_tracks(0.1)), np.arange(7))
    assert found.model is None
    assert found.lengths == {}
    assert len(found.residuals) == 0
    assert choose_model(seen_everywhere(affine_tracks(0.1)), np.arange(0)).model is None


@pytest.mark.parametrize("spread", [(0, 0), (500, 0), (500, 500)])
def test_tracks_in_a_spot_on_a_line_or_at_rest_are_explained_by_the_simplest(spread):
    start = np.random.default_rng(0).uniform(size=(30, 1, 2)) * spread + 100
    for points in (np.repeat(start, 5, axis=1), start + np.arange(5)[:, None]):
        found = choose_model(seen_everywhere(points), np.arange(30))
        assert found.model == "affine"
        assert_allclose(found.residuals, 0, atol=1e-6)


# ----------------------------------------------------------------------------- reports


@pytest.fixture(scope="module", params=SELECTIONS)
def reported(request):
    """A segmenter, its tracks, one of them of no motion, and its report."""
    X, _ = make_rigid_motions(140, 8, random_state=0)
    X[5, 2:] = np.nan  # seen in a single frame
    segmenter = MotionSegmenter(
        selection=request.param, n_hypotheses=100, max_motions=4, random_state=0
    ).fit(X)
    return segmenter, X, segmenter.report(X)


def test_a_report_counts_every_track(reported):
    segmenter, X, report = reported
    labels = segmenter.labels_
    assert [motion.label for motion in report.motions] == [*range(segmenter.n_motions_)]
    for motion in report.motions:
        members = labels == motion.label
        assert motion.n_tracks == members.sum()
        assert motion.share == members.mean()
        seen = np.isfinite(X[members, ::2]).any(axis=0)
        assert_array_equal(motion.frames, np.flatnonzero(seen))
    n_inside = sum(motion.n_tracks for motion in report.motions)
    assert report.n_outliers == (labels < 0).sum() == 140 - n_inside > 0
    assert (report.n_tracks, report.n_frames, report.n_judged) == (140, 8, 140)


def test_a_report_says_what_explains_each_motion(reported):
    segmenter, X, report = reported
    geometry = clip_geometry(*unpack_tracks(X))
    for motion in report.motions:
        found = choose_model(
            geometry, np.flatnonzero(segmenter.labels_ == motion.label)
        )
        assert motion.model == found.model
        # A report limits the threads of BLAS, so the last digits may differ.
        assert motion.description_lengths == pytest.approx(found.lengths)
        assert motion.residual == pytest.approx(np.median(found.residuals))
        assert motion.residual_90 == pytest.approx(np.percentile(found.residuals, 90))


def test_a_report_has_the_costs_of_every_count(reported):
    segmenter, _, report = reported
    assert_array_equal([each.n_motions for each in report.counts], segmenter.counts_)
    costs = [[*each.terms, each.total] for each in report.counts]
    assert_array_equal(costs, segmenter.costs_)
    for each in report.counts:
        assert each.total == pytest.approx(np.dot(report.weights, each.terms))
    (chosen,) = (each for each in report.counts if each.chosen)
    assert chosen.n_motions == segmenter.n_motions_
    assert chosen.verdict == "chosen"
    assert chosen is report.counts[segmenter.best_index_]
    for each in report.counts:
        if each.gainless_pair is None and each.total > chosen.total + 2e-3:
            assert each.verdict == f"cost higher by {each.total - chosen.total:.2g}"


def test_a_printed_report_fits_a_terminal_and_holds_it_all(reported):
    _, _, report = reported
    lines = str(report).splitlines()
    assert max(map(len, lines)) <= 80
    assert lines[0].endswith(", 8 frames")
    assert f" {report.n_outliers} unassigned" in lines[0]
    for motion in report.motions:
        (line,) = (line for line in lines if line.split()[:1] == [str(motion.label)]
                   and "px" in line)  # fmt: skip
        assert f" {motion.n_tracks} " in line
        assert f" {motion.model} " in line
        assert f"{motion.residual:.2f} px" in line
        assert line.endswith(f"{motion.residual_90:.2f} px")
    for each in report.counts:
        row = [str(each.n_motions), f"{each.terms[0]:.4f}", f"{each.terms[1]:.4f}"]
        (line,) = (line for line in lines if line.split()[:3] == row)
        assert line.endswith(f"{each.total:.4f}  {each.verdict}")
    (formula,) = (line for line in lines if line.startswith("total = "))
    assert all(part in formula for part in report.term_names)
    assert "unassigned" in report._repr_html_()


def test_a_count_is_passed_over_for_the_motions_that_gain_too_little(reported):
    segmenter, X, _ = reported
    passed = pickle.loads(pickle.dumps(segmenter))
    passed.gainless_pairs_ = np.full((len(passed.counts_), 2), -1)
    passed.gainless_pairs_[-1] = 1, 3
    passed.log_odds_[-1] = np.nan
    last = passed.report(X).counts[-1]
    assert last.gainless_pair == (1, 3)
    assert last.verdict == "motions 1 and 3 gain too little"
    passed.best_index_ = len(passed.counts_) - 1
    assert passed.report(X).counts[-1].verdict == "chosen: the first, as none gains"


def test_counts_that_are_of_the_same_cost_are_told_from_others(reported):
    segmenter, X, _ = reported
    equal = pickle.loads(pickle.dumps(segmenter))
    equal.gainless_pairs_[:] = -1
    equal.costs_[:] = equal.costs_[0]
    equal.best_index_ = 1
    verdicts = [each.verdict for each in equal.report(X).counts]
    assert verdicts[0] == "same cost, but fewer motions"
    assert set(verdicts[2:]) == {"same cost, but more motions"}


def test_frame_pairs_say_which_counts_they_passed_over(monkeypatch):
    """Where motions must gain more than they can, one motion is the answer."""
    monkeypatch.setattr("skmotionseg._core.partition.cost.GAIN_OF_CUT", 1e9)
    monkeypatch.setattr("skmotionseg._core.partition.search.FEWEST_FOR_RIGID", 1000)
    X, _ = make_rigid_motions(140, 8, random_state=0)
    segmenter = MotionSegmenter(n_hypotheses=100, max_motions=4, random_state=0).fit(X)
    report = segmenter.report(X)
    assert report.counts[0].chosen
    assert np.isnan(segmenter.count_probabilities_).all()
    cheaper = segmenter.costs_[:, 2] < segmenter.costs_[0, 2]
    assert cheaper.any()
    for each, is_cheaper in zip(report.counts, cheaper, strict=True):
        assert (each.gainless_pair is not None) == is_cheaper
        if is_cheaper:
            first, second = each.gainless_pair
            assert 0 <= first < second < each.n_motions
            assert each.verdict == f"motions {first} and {second} gain too little"


@pytest.mark.parametrize("reported", ["description_length"], indirect=True)
def test_rigid_motion_says_which_motions_of_more_are_one(reported):
    segmenter, _, report = reported
    assert segmenter.count_probabilities_.sum() == pytest.approx(1)
    assert segmenter.count_probabilities_.argmax() == segmenter.best_index_
    for each, log_odds in zip(report.counts, segmenter.log_odds_, strict=True):
        if each.n_motions > segmenter.n_motions_:
            assert log_odds < 0
            assert "are one (" in each.verdict
    lines = str(report).splitlines()
    assert lines[-1].startswith(f"Number of motions: {segmenter.n_motions_} with ")


def test_a_near_tie_is_said_in_words(reported):
    segmenter, X, _ = reported
    tied = pickle.loads(pickle.dumps(segmenter))
    tied.count_probabilities_ = np.zeros(len(tied.counts_))
    tied.best_index_ = 1
    tied.count_probabilities_[:2] = 0.45, 0.55
    last = str(tied.report(X)).splitlines()[-1]
    few = tied.counts_[0]
    assert last.endswith(f"with 55 % (a near tie); next, {few} with 45 %.")
    tied.count_probabilities_[:3] = 0.45, 0.2, 0.35
    last = str(tied.report(X)).splitlines()[-1]
    two = f"{tied.counts_[1]} with 20 %"
    assert f"{two} (a near tie: {tied.counts_[1]} or more with 55 %)" in last
    assert last.endswith(f"; likelier alone: {few} with 45 %.")


def test_no_next_number_is_named_where_none_has_a_percent(reported):
    segmenter, X, _ = reported
    sure = pickle.loads(pickle.dumps(segmenter))
    sure.count_probabilities_ = np.zeros(len(sure.counts_))
    sure.count_probabilities_[sure.best_index_] = 1
    last = str(sure.report(X)).splitlines()[-1]
    assert last == f"Number of motions: {sure.n_motions_} with 100 %."


@pytest.mark.parametrize(
    ("log_odds", "expected"),
    [
        ([np.nan, 0.0, -np.inf], [0.5, 0.5, 0]),
        ([np.nan, -50, 0], [0.5, 0, 0.5]),  # three are at least two
        ([np.nan, np.nan, 0], [np.nan] * 3),
    ],
)
def test_counts_are_as_likely_as_their_motions_are_different(log_odds, expected):
    found = count_probabilities(np.arange(1, 4), np.array(log_odds))
    assert_allclose(found, expected, atol=1e-12)


def test_a_single_count_was_the_only_one_tried():
    X, _ = make_rigid_motions(60, 6, 2, random_state=0)
    report = MotionSegmenter(2, n_hypotheses=50, random_state=0).fit(X).report(X)
    (only,) = report.counts
    assert only.verdict == "chosen: no other was tried"


def test_models_are_those_of_the_landmarks():
    X, _ = make_rigid_motions(140, 8, random_state=0)
    segmenter = MotionSegmenter(
        3, n_hypotheses=100, n_landmarks=70, random_state=0
    ).fit(X)
    report = segmenter.report(X)
    assert (report.n_tracks, report.n_judged) == (140, 70)
    assert sum(motion.n_tracks for motion in report.motions) + report.n_outliers == 140
    assert "those of 70 landmarks" in str(report)
    rows = segmenter.landmarks_
    geometry = clip_geometry(*unpack_tracks(X[rows]))
    found = choose_model(geometry, np.flatnonzero(segmenter.labels_[rows] == 0))
    assert report.motions[0].residual == pytest.approx(np.median(found.residuals))


def test_a_motion_too_small_for_a_model_is_reported():
    far = affine_tracks(0.1, n_tracks=5, seed=1) + 1000
    X = pack_tracks(np.concatenate([affine_tracks(0.1), far]))
    segmenter = MotionSegmenter(1, n_hypotheses=50, random_state=0).fit(X)
    segmenter.labels_ = np.repeat([0, 1], [60, 5])
    segmenter.n_motions_ = 2
    report = segmenter.report(X)
    small = report.motions[1]
    assert small.model is None
    assert np.isnan([small.residual, small.residual_90]).all()
    assert " too few " in str(report)


def test_a_report_needs_the_tracks_that_were_fitted(reported):
    segmenter, X, _ = reported
    with pytest.raises(ValueError, match="140 tracks that were fitted; got 9"):
        segmenter.report(X[:9])
    with pytest.raises(ValueError, match="features"):
        segmenter.report(X[:, :-2])
    with pytest.raises(ValueError, match="not fitted"):
        MotionSegmenter().report(X)


def test_a_report_refuses_other_tracks_and_another_order(reported):
    segmenter, X, _ = reported
    for other in (X[::-1], X + 1.0):
        with pytest.raises(ValueError, match="others, or in another order"):
            segmenter.report(other)
