"""What the displays draw is what they were given, and bad input draws nothing."""

from __future__ import annotations

import json
import sys
from copy import copy
from dataclasses import replace
from itertools import pairwise

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_hex, to_rgb
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.metrics import make_scorer
from sklearn.model_selection import GridSearchCV, KFold
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer

from benchmarks.static_scenes import shaken
from skmotionseg import (
    MotionModel,
    MotionSegmenter,
    MultiModelSpectralClustering,
    NCREModelSelector,
    PerSequence,
    make_motion_pipeline,
    pack_tracks,
    plotting,
    unpack_tracks,
)
from skmotionseg._core.graph.cuts import reconstruction_error
from skmotionseg._core.partition.apartness import FEW_TRACKS
from skmotionseg._utils.colours import OUTLIER_COLOUR, motion_colour
from skmotionseg.datasets import load_kt3dmoseg, make_rigid_motions
from skmotionseg.metrics import misclassification_error
from skmotionseg.plotting import (
    AffinityDisplay,
    CountDisplay,
    FusionWeightDisplay,
    GridDisplay,
    MotionDisplay,
    ReportDisplay,
    SequenceErrorDisplay,
)
from skmotionseg.plotting._affinities import reconstruction

MODELS = ("affine", "homography", "fundamental")
Y = np.repeat([0, 1], [4, 3])
K = (Y[:, None] == Y) + 0.1  # affinities of two groups
STACKED = np.hstack([K, K + 0.1])


@pytest.fixture(autouse=True)
def no_figure_stays():
    plt.close("all")
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def small():
    """Tracks of two motions, one track of none, and a segmenter fitted to them."""
    X, y = make_rigid_motions(60, 6, 2, missing=0.2, random_state=0)
    segmenter = MotionSegmenter(
        selection="ncre", n_hypotheses=100, max_motions=4, random_state=0
    ).fit(X)
    y[3] = -1
    return X, y, segmenter


@pytest.fixture(scope="module")
def search(small):
    """A grid over three parameters, delta, lambda and models; one sequence a fold."""
    X, y, segmenter = small
    grid = {
        "estimator__delta": [0.1, 0.5, 2.0],
        "estimator__lam": [0.01, 0.1],
        "estimator__models": [MODELS[:2], MODELS[1:]],
    }
    return GridSearchCV(PerSequence(segmenter), grid, cv=KFold(2)).fit([X, X], [y, y])


def texts(legend):
    return [text.get_text() for text in legend.get_texts()]


# ---------------------------------------------------------------------------- motions


def test_points_and_trails_are_those_of_the_tracks(small):
    X, y, _ = small
    display = MotionDisplay.from_predictions(X, y, frame=4, trail=2)
    points = X.reshape(60, 6, 2)
    seen = ~np.isnan(points[:, 4, 0])
    for label in (-1, 0, 1):
        rows = points[seen & (y == label)]
        assert_array_equal(display.points_[label].get_offsets(), rows[:, 4])
        expected = [
            [row[t], row[t + 1]]
            for row in rows
            for t in (2, 3)
            if not np.isnan(row[t : t + 2]).any()
        ]
        segments = np.array(display.trails_[label].get_segments()).reshape(-1, 2, 2)
        assert_array_equal(segments, np.reshape(expected, (-1, 2, 2)))


def test_a_title_that_is_given_is_the_title(small):
    X, y, _ = small
    display = MotionDisplay(X, y, frame=2)
    assert display.plot(title="two cars").ax_.get_title() == "two cars"
    assert display.plot().ax_.get_title().startswith("frame 2: ")


def test_motions_have_their_colours_and_those_of_none_are_hollow(small):
    X, y, _ = small
    points = MotionDisplay.from_predictions(X, y).points_
    for label in (0, 1):
        assert to_hex(points[label].get_facecolor()[0]) == motion_colour(label)
    assert len(points[-1].get_facecolor()) == 0
    assert to_hex(points[-1].get_edgecolor()[0]) == OUTLIER_COLOUR


@pytest.mark.parametrize("height", [2, 4, 9])
@pytest.mark.parametrize("size", [6, 10, 16])
def test_the_legend_of_motions_covers_no_label(small, height, size):
    X, y, _ = small
    with plt.rc_context({"font.size": size}):
        figure, ax = plt.subplots(figsize=(6, height), layout="constrained")
        plotting.plot_motions(X, y, ax=ax)
        figure.draw_without_rendering()
        legend, label = ax.get_legend(), ax.xaxis.label
        assert legend.get_window_extent().y1 < label.get_window_extent().y0


def test_long_clips_of_short_tracks_are_drawn(small):
    """However much longer than their tracks, of which some are in two frames."""
    X, y, _ = small
    n_tracks, n_frames = len(X), X.shape[1] // 2
    times = 40
    long = np.full((times * n_tracks, 2 * times * n_frames), np.nan)
    for k in range(times):
        part = np.s_[2 * k * n_frames : 2 * (k + 1) * n_frames]
        long[k * n_tracks : (k + 1) * n_tracks, part] = X
    ax = plotting.plot_motions(long, np.tile(y, times))
    dots = sum(len(drawn.get_offsets()) for drawn in ax.collections)
    assert dots > n_tracks / 4
    with pytest.warns(UserWarning, match="in both frames, 0 and 200"):
        plotting.plot_motions(long, np.tile(y, times), frames=(0, 200))


def test_the_legend_counts_all_tracks(small):
    X, y, _ = small
    display = MotionDisplay.from_predictions(X, y)
    counts = [int((y == label).sum()) for label in (0, 1, -1)]
    assert texts(display.legend_) == [
        f"motion 0 ({counts[0]})",
        f"motion 1 ({counts[1]})",
        f"no motion ({counts[2]})",
    ]
    assert sum(counts) == 60


@pytest.mark.parametrize(
    "draw", [plotting.plot_motions, MotionDisplay.from_predictions]
)
def test_a_single_frame_and_no_tracks_are_drawn(small, draw):
    X, y, _ = small
    for shown, labels in ((X[:, :2], y), (X[:0], y[:0])):
        drawn = draw(shown, labels)
        ax = getattr(drawn, "ax_", drawn)
        assert len(ax.get_legend().get_texts()) == len(np.unique(labels))


def test_the_frame_drawn_is_the_one_that_shows_most(small):
    X, y, _ = small
    display = MotionDisplay.from_predictions(X, y)
    seen = (~np.isnan(X[:, ::2])).sum(axis=0)
    assert seen[display.frame_] == seen.max()
    title = f"frame {display.frame_}: {seen.max()} of 60 tracks"
    assert display.ax_.get_title() == title
    assert MotionDisplay.from_predictions(X, y, frame=-1).frame_ == 5


def test_an_image_lies_under_the_tracks(small):
    X, y, _ = small
    image = np.arange(12, dtype=np.uint8).reshape(3, 4)
    display = MotionDisplay.from_predictions(X, y, image=image)
    assert_array_equal(display.image_.get_array(), image)
    assert display.image_.get_zorder() < display.trails_[0].get_zorder()
    assert display.ax_.yaxis_inverted()
    assert MotionDisplay.from_predictions(X, y).image_ is None


def test_motions_of_an_estimator(small):
    X, _, segmenter = small
    display = MotionDisplay.from_estimator(segmenter, X)
    assert_array_equal(display.labels, segmenter.labels_)
    placed = MotionDisplay.from_estimator(segmenter, X[:20], fitted=False)
    assert_array_equal(placed.labels, segmenter.predict(X[:20]))
    pipeline = make_motion_pipeline(n_clusters=2, n_hypotheses=50, random_state=0)
    labels = MotionDisplay.from_estimator(pipeline.fit(X), X).labels
    assert_array_equal(labels, pipeline[-1].labels_)


# ------------------------------------------------------------------------- affinities


def test_the_distance_to_a_reconstruction_is_its_error():
    """Eq. 9: both matrices at norm 1, squared Frobenius distance."""
    labels = np.array([0, 0, 1, 1, 1, -1, 0])
    rebuilt = reconstruction(K, labels)
    assert_allclose(np.linalg.norm(rebuilt), np.linalg.norm(K))
    distance = np.linalg.norm(rebuilt - K) ** 2 / np.linalg.norm(K) ** 2
    assert_allclose(distance, reconstruction_error(K, labels))


def test_affinities_are_sorted_by_motion_then_by_partition():
    labels = np.array([1, 0, -1, 0, 1, 0, 0])
    partition = np.array([0, 1, 0, 0, 0, 0, 1])
    affinity = np.arange(49.0).reshape(7, 7)
    affinity += affinity.T
    display = AffinityDisplay.from_predictions([affinity], [partition], labels=labels)
    order = [3, 5, 1, 6, 0, 4, 2]
    assert_array_equal(display.order_, order)
    for image, matrix in zip(
        display.images_[0], [affinity, reconstruction(affinity, partition)], strict=True
    ):
        assert_allclose(image.get_array(), matrix[np.ix_(order, order)])


def test_motions_are_outlined_in_every_matrix():
    labels = np.array([1, 0, -1, 0, 1, 0, 0])
    display = AffinityDisplay.from_predictions([K, K], [Y], labels=labels)
    squares = [(*s.get_xy(), s.get_width(), s.get_height()) for s in display.outlines_]
    assert squares == [(-0.5, -0.5, 4, 4), (3.5, 3.5, 2, 2)] * 4


@pytest.mark.parametrize("last", ["segmenter", "pipeline", "selector"])
def test_affinities_of_an_estimator_are_those_it_clustered(small, last):
    X, y, segmenter = small
    common = {"n_hypotheses": 100, "max_clusters": 4, "random_state": 0}
    pipeline = make_motion_pipeline(**common).fit(X)
    stacked = pipeline[:-1].transform(X)
    estimator, given, names = {
        "segmenter": (segmenter, X, list(MODELS)),
        "pipeline": (pipeline, X, list(MODELS)),
        "selector": (pipeline[-1], stacked, ["view 0", "view 1", "view 2"]),
    }[last]
    display = AffinityDisplay.from_estimator(estimator, given, counts=[1, 3], labels=y)
    assert display.axes_.shape == display.images_.shape == (3, 3)
    assert [ax.get_title() for ax in display.axes_[:, 0]] == names
    order = np.ix_(display.order_, display.order_)
    for image, view in zip(
        display.images_[:, 0], np.split(stacked, 3, axis=1), strict=True
    ):
        assert_allclose(image.get_array(), view[order], atol=1e-6)
    assert_array_equal(display.partitions, pipeline[-1].candidate_labels_[[0, 2]])
    error = reconstruction_error(stacked[:, :60], display.partitions[1])
    assert display.axes_[0, 2].get_title() == (
        f"3 motions\nreconstruction error {error:.2f}"
    )


def test_affinities_of_landmarks_are_drawn_alone(small):
    X, *_ = small
    segmenter = MotionSegmenter(2, n_landmarks=30, n_hypotheses=50, random_state=0)
    display = AffinityDisplay.from_estimator(segmenter.fit(X), X)
    assert display.images_[0, 0].get_array().shape == (30, 30)
    assert_array_equal(display.labels, segmenter.labels_[segmenter.landmarks_])


def test_affinities_are_those_of_tracks_without_a_rolling_shutter():
    X, _ = shaken(0.7, n_moving=30, seed=1)
    some = FEW_TRACKS + 10  # of fewer, views leave out what was fitted to the track
    segmenter = MotionSegmenter(2, n_hypotheses=50, n_landmarks=some, random_state=0)
    segmenter.fit(X)
    assert segmenter.readout_.any() and len(X) > some
    points = segmenter._shutter.at_once(*unpack_tracks(X))
    fitted = pack_tracks(points[segmenter.landmarks_])
    display = AffinityDisplay.from_estimator(segmenter, X)
    for affinity, (sampler, kernel) in zip(
        display.affinities, segmenter.views_.values(), strict=True
    ):
        assert_array_equal(affinity, kernel.transform(sampler.transform(fitted)))


def test_affinities_are_drawn_of_whatever_was_fitted(small):
    """Masked arrays and data frames, clips with an empty frame, and last in a pipeline.

    A step before the segmenter gives it other tracks than the pipeline has.
    """
    X, *_ = small
    X = np.hstack([X[:, :6], np.full((60, 2), np.nan), X[:, 6:]])
    segmenter = MotionSegmenter(2, n_hypotheses=50, random_state=0).fit(X)
    expected = AffinityDisplay.from_estimator(segmenter, X).affinities
    masked = np.ma.masked_array(np.nan_to_num(X, nan=-1), np.isnan(X))
    for given in (masked, pd.DataFrame(X).astype("Float64")):
        shown = AffinityDisplay.from_estimator(segmenter, given)
        assert_array_equal(shown.affinities, expected)
    halved = FunctionTransformer(lambda tracks: tracks / 2)
    for steps, factor in (([segmenter], 1), ([halved, segmenter], 2)):
        pipeline = make_pipeline(*steps)
        shown = AffinityDisplay.from_estimator(pipeline, factor * X)
        assert_array_equal(shown.affinities, expected)
        assert [ax.get_title() for ax in shown.axes_[:, 0]] == list(MODELS)


def test_steps_of_a_pipeline_are_seeded(small):
    X, y, _ = small
    pipeline = make_motion_pipeline(n_clusters=2, n_hypotheses=50)
    one, again = (
        SequenceErrorDisplay.from_estimator(pipeline, [X], [y], seeds=[0, 1])
        for _ in range(2)
    )
    assert np.shape(one.errors) == (1, 1, 2)
    assert_array_equal(one.errors, again.errors)


def test_labels_of_any_integers_are_outlined():
    B = np.kron(np.eye(2), np.ones((3, 3)))
    labels = np.repeat(np.array([3, 255], dtype=np.uint8), 3)
    display = AffinityDisplay.from_predictions([B], [labels])
    plain = AffinityDisplay.from_predictions([B], [np.repeat([0, 1], 3)])
    assert len(display.outlines_) == len(plain.outlines_)


def test_models_of_a_union_may_be_objects(small):
    X, *_ = small
    affine = MotionModel.built_in("affine")
    pipeline = make_motion_pipeline(n_clusters=2, n_hypotheses=50, random_state=0)
    for models in (affine, (affine,)):
        pipeline.set_params(affinity__models=models).fit(X)
        display = AffinityDisplay.from_estimator(pipeline, X)
        assert [ax.get_title() for ax in display.axes_[:, 0]] == ["affine"]


def test_a_dropped_model_has_no_matrix(small):
    X, *_ = small
    pipeline = make_motion_pipeline(n_clusters=2, n_hypotheses=50, random_state=0)
    pipeline.set_params(affinity__affine="drop").fit(X)
    display = AffinityDisplay.from_estimator(pipeline, X)
    assert [ax.get_title() for ax in display.axes_[:, 0]] == list(MODELS[1:])


def test_names_of_models_are_found_behind_other_steps(small):
    X, *_ = small
    pipeline = make_motion_pipeline(n_clusters=2, n_hypotheses=50, random_state=0)
    pipeline.steps.insert(0, ("as they are", FunctionTransformer()))
    pipeline.steps.insert(2, ("too", FunctionTransformer()))
    display = AffinityDisplay.from_estimator(pipeline.fit(X), X)
    assert [ax.get_title() for ax in display.axes_[:, 0]] == list(MODELS)


def test_a_single_view_is_broken_into_rows():
    display = AffinityDisplay.from_predictions([K], [Y] * 6)
    assert display.axes_.shape == (1, 7)
    rows = {ax.get_subplotspec().rowspan.start for ax in display.axes_[0]}
    assert rows == {0, 1}


# ----------------------------------------------------------------------------- counts


def test_costs_are_drawn_with_their_weights(small):
    _, _, segmenter = small
    display = CountDisplay.from_estimator(segmenter)
    cut, other, total = (line.get_ydata() for line in display.lines_)
    assert_array_equal(cut, segmenter.costs_[:, 0])
    assert_allclose(other, 0.2 * segmenter.costs_[:, 1])
    assert_array_equal(total, segmenter.costs_[:, 2])
    for line in display.lines_:
        assert_array_equal(line.get_xdata(), segmenter.counts_)
    assert_array_equal(display.chosen_line_.get_xdata(), segmenter.n_motions_)
    assert texts(display.legend_)[0] == f"chosen: {segmenter.n_motions_}"
    assert texts(display.legend_)[2:] == [
        r"0.2 $\times$ reconstruction error",
        "total",
    ]


@pytest.mark.parametrize(
    "selection", ["ncre", "description_length", "eigengap", "self_tuning"]
)
def test_weighted_terms_add_up_to_the_total(small, selection):
    X, *_ = small
    segmenter = MotionSegmenter(
        selection=selection, n_hypotheses=50, delta=0.7, max_motions=3, random_state=0
    ).fit(X)
    display = CountDisplay.from_estimator(segmenter)
    cut, other, total = (line.get_ydata() for line in display.lines_)
    assert_allclose(cut + other, total)


def test_costs_of_partitions_are_those_of_the_selector():
    n = len(STACKED)
    noise = np.random.default_rng(0).uniform(0, 0.2, (n, n))  # so that no two are alike
    views = STACKED + np.tile(noise + noise.T, STACKED.shape[1] // n)
    selector = NCREModelSelector(max_clusters=4, delta=0.5, random_state=0).fit(views)
    partitions = selector.candidate_labels_[::-1]
    display = CountDisplay.from_predictions(views, partitions, delta=0.5)
    assert_array_equal(display.counts, selector.counts_)
    assert_allclose(display.costs, selector.costs_)
    assert display.chosen == selector.n_clusters_


@pytest.mark.parametrize("delta", [-1, np.nan, np.inf])
def test_a_weight_of_the_reconstruction_is_a_number_of_0_or_more(delta):
    with pytest.raises(ValueError, match=f"delta must be .*; got {float(delta)}"):
        CountDisplay.from_predictions(STACKED, [Y], delta=delta)


def test_counts_that_were_passed_over_are_hollow():
    costs = np.arange(12.0).reshape(4, 3)
    hollow = [False, True, False, True]
    display = CountDisplay([1, 2, 3, 4], costs, 1, passed_over=hollow).plot()
    assert_array_equal(display.passed_over_line_.get_xdata(), [2, 4])
    assert_array_equal(display.passed_over_line_.get_ydata(), costs[[1, 3], 2])
    assert display.passed_over_line_.get_markerfacecolor() == "white"
    assert texts(display.legend_)[-1] == "two of the motions are one"
    assert CountDisplay([1, 2], costs[:2], 1).plot().passed_over_line_ is None


def test_an_estimator_says_which_counts_were_passed_over(small):
    segmenter = copy(small[2])
    segmenter.gainless_pairs_ = np.array([[-1, -1], [0, 1], [-1, -1], [-1, -1]])
    display = CountDisplay.from_estimator(segmenter)
    assert_array_equal(display.passed_over_line_.get_xdata(), [2])
    assert CountDisplay.from_estimator(small[2]).passed_over_line_ is None


# ----------------------------------------------------------------------------- report


def test_a_report_is_drawn_as_it_is_printed(small):
    X, _, segmenter = small
    report = segmenter.report(X)
    display = ReportDisplay.from_estimator(segmenter, X, frame=2)
    assert display.motions_.frame_ == 2
    assert_array_equal(display.motions_.labels, segmenter.labels_)
    assert texts(display.motions_.legend_) == [
        f"motion {m.label} ({m.n_tracks}): {m.model}, {m.residual:.2f} px"
        for m in report.motions
    ]
    of_selector = CountDisplay.from_estimator(segmenter)
    for line, expected in zip(display.counts_.lines_, of_selector.lines_, strict=True):
        assert_allclose(line.get_xydata(), expected.get_xydata())
    assert texts(display.counts_.legend_) == texts(of_selector.legend_)


def test_a_motion_without_a_model_is_drawn_too(small):
    X, _, segmenter = small
    few = replace(segmenter.report(X).motions[0], model=None, residual=np.nan)
    report = replace(segmenter.report(X), motions=(few,))
    display = ReportDisplay(report, X, np.zeros(60, int)).plot()
    (text,) = texts(display.motions_.legend_)
    assert text == f"motion 0 ({few.n_tracks}): too few tracks"


def test_motions_that_are_not_drawn_are_not_in_the_legend(small):
    X, _, segmenter = small
    first = segmenter.report(X).motions[0]
    report = replace(segmenter.report(X), motions=(first, replace(first, label=1)))
    display = ReportDisplay(report, X, np.zeros(60, int)).plot()
    (text,) = texts(display.motions_.legend_)
    assert text.startswith(f"motion 0 ({first.n_tracks}): ")


def test_the_title_of_a_report_is_inside_of_the_figure():
    """Beside other axes, those of equal aspect are placed well by a second layout."""
    X, y = make_rigid_motions(140, 8, random_state=0)
    display = ReportDisplay(DISPLAYS["ReportDisplay"].report, X, y).plot()
    figure = display.figure_
    figure.canvas.draw()
    title = figure.axes[0].title.get_window_extent()
    assert title.y1 <= figure.bbox.height


def test_report_axes_that_are_given_are_used():
    figure, axes = plt.subplots(2, 1)
    display = DISPLAYS["ReportDisplay"].plot(axes=axes)
    assert (display.motions_.ax_, display.counts_.ax_) == tuple(axes)
    assert display.figure_ is figure
    assert plt.get_fignums() == [figure.number]


def test_report_axes_are_an_array_whatever_was_given():
    display = DISPLAYS["ReportDisplay"]
    _, axes = plt.subplots(1, 2, squeeze=False)
    for given in (None, [*axes[0]], axes):
        assert display.plot(axes=given).axes_.shape == (2,)
    assert display.axes_.tolist() == [*axes[0]]


# ----------------------------------------------------------------------------- errors


ERRORS = np.array([[[0.1, 0.3], [0.0, 0.0]], [[0.5, 0.5], [0.2, 0.4]]])


def test_bars_are_means_and_standard_deviations():
    display = SequenceErrorDisplay(ERRORS, ["a", "b"], ["car", "bus"]).plot()
    for bars, errors in zip(display.bars_, ERRORS, strict=True):
        widths = [bar.get_width() for bar in bars]
        assert_allclose(widths, 100 * errors.mean(axis=1))
        (lines,) = bars.errorbar.lines[2]
        halves = [np.ptp(segment[:, 0]) / 2 for segment in lines.get_segments()]
        assert_allclose(halves, 100 * errors.std(axis=1), atol=1e-12)
    assert texts(display.legend_) == ["a (mean 10.0 %)", "b (mean 40.0 %)"]
    labels = [label.get_text() for label in display.ax_.get_yticklabels()]
    assert labels == ["car", "bus"]
    assert display.ax_.yaxis_inverted()


def test_bars_of_two_sequences_do_not_touch():
    errors = np.full((5, 3, 1), 0.5)
    display = SequenceErrorDisplay(errors).plot()
    spans = sorted(
        (bar.get_y(), bar.get_y() + bar.get_height())
        for bars in display.bars_
        for bar in bars
    )
    for (_, end), (start, _) in pairwise(spans):
        assert start > end - 1e-9
    assert spans[5][0] > spans[4][1] + 0.05


def records():
    return [
        {
            "dataset": "KT3DMoSeg",
            "method": method,
            "sequence": sequence,
            "seed": seed,
            "error_known": ERRORS[m, s, seed],
        }
        for m, method in enumerate(["coreg", "subset"])
        for s, sequence in enumerate(["a", "b"])
        for seed in (0, 1)
    ]


def test_records_of_the_bench_in_any_order(tmp_path):
    path = tmp_path / "bench.json"
    path.write_text(json.dumps(records()[::-1]))
    display = SequenceErrorDisplay.from_records(path, methods=["subset", "coreg"])
    assert_allclose(np.sort(display.errors), np.sort(ERRORS[::-1]))
    assert display.method_names == ["subset", "coreg"]
    assert display.sequence_names == ["a", "b"]


def test_errors_of_predictions_and_of_estimators(small):
    X, y, segmenter = small
    display = SequenceErrorDisplay.from_estimator(
        {"ncre": segmenter}, [X, X], [y, y], seeds=[0, 3]
    )
    expected = [
        misclassification_error(
            y, MotionSegmenter(**{**segmenter.get_params(), "random_state": seed})
            .fit_predict(X)
        )
        for seed in (0, 3)
    ]  # fmt: skip
    assert_allclose(display.errors, [[expected, expected]])
    found = {"all one": [np.zeros(60, int)], "true": [y]}
    display = SequenceErrorDisplay.from_predictions([y], found)
    expected = misclassification_error(y, np.zeros(60, int))
    assert_allclose(np.ravel(display.errors), [expected, 0])


def test_errors_of_one_estimator_with_the_seed_it_has(small):
    X, y, segmenter = small
    display = SequenceErrorDisplay.from_estimator(segmenter, [X], [y])
    assert display.method_names == ["MotionSegmenter"]
    expected = misclassification_error(y, clone(segmenter).fit_predict(X))
    assert_allclose(display.errors, [[[expected]]])


# ----------------------------------------------------------------------------- sweeps


def test_weights_are_drawn_in_percent_over_a_log_axis():
    values, errors = [0.01, 0.1, 1], [[0.1, 0.2], [0.2, 0.4], [0.0, 0.0]]
    views = np.array([[0.5, 0.4, 0.3], [0.1, 0.2, 0.3]])
    display = FusionWeightDisplay.from_predictions(
        values, errors, views, view_names=["A", "H"], weight_name="lambda"
    )
    assert_array_equal(display.line_.get_xdata(), values)
    assert_allclose(display.line_.get_ydata(), [15, 30, 0])
    for line, error in zip(display.view_lines_, views, strict=True):
        assert_allclose(line.get_ydata(), 100 * error)
    assert display.ax_.get_xscale() == "log"
    assert display.ax_.get_xlabel() == "lambda"
    assert texts(display.legend_) == ["A", "H", "fused"]
    mixed = FusionWeightDisplay.from_predictions([1, 0.01, 0.1], [0.3, 0.1, 0.2])
    assert_allclose(mixed.line_.get_data(), [[0.01, 0.1, 1], [10, 20, 30]])


@pytest.mark.parametrize(
    ("fusion", "parameter"), [("coreg", "lam"), ("subset", "gamma")]
)
def test_a_sweep_of_weights_is_what_fitting_gives(small, fusion, parameter):
    X, y, _ = small
    pipeline = make_motion_pipeline(n_clusters=2, n_hypotheses=50, random_state=0)
    stacked = pipeline[0].fit_transform(X)
    clusterer = MultiModelSpectralClustering(fusion=fusion, random_state=0)
    values = [0.01, 3.0]
    display = FusionWeightDisplay.from_estimator(
        clusterer, [stacked], [y], values=values
    )
    for value, error in zip(values, display.errors, strict=True):
        fitted = MultiModelSpectralClustering(
            2, fusion=fusion, random_state=0, **{parameter: value}
        ).fit(stacked)
        assert error == misclassification_error(y, fitted.labels_)
    assert np.shape(display.view_errors) == (3, 2, 1)
    assert parameter in display.ax_.get_xlabel()
    assert getattr(clusterer, parameter) == 1e-2  # was cloned


def test_a_single_view_and_its_embedding_err_alike(small):
    """Of one view, the fused result is k-means on that view's embedding."""
    X, y, _ = small
    pipeline = make_motion_pipeline(
        "homography", n_clusters=2, n_hypotheses=50, random_state=0
    )
    stacked = pipeline[0].fit_transform(X)
    clusterer = MultiModelSpectralClustering(fusion="coreg", random_state=0)
    display = FusionWeightDisplay.from_estimator(
        clusterer, [stacked], [y], values=[0.1]
    )
    assert_array_equal(display.view_errors[0], display.errors)


def test_views_that_are_left_alone_err_as_they_do_by_themselves():
    """With next to no weight, co-regularisation changes no view."""
    other = np.array([0, 1, 0, 1, 0, 1, 0])
    views = [K, (other[:, None] == other) + 0.1]
    display = FusionWeightDisplay.from_estimator(
        MultiModelSpectralClustering(fusion="coreg", random_state=0),
        [np.hstack(views)],
        [Y],
        values=[1e-9],
    )
    errors = [0, misclassification_error(Y, other)]
    assert_allclose(np.ravel(display.view_errors), errors)
    assert errors[1] > 0.2


def test_settings_without_a_parameter_that_is_drawn_are_left_out():
    settings = [{"a": 3, "b": 1}, {"a": 4, "b": 1}, {"a": 3, "c": 7}, {"a": 4, "b": 2}]
    results = {"params": settings, "mean_test_score": [0.6, 0.7, 1.0, 0.8]}
    display = GridDisplay.from_cv_results(results, x="a", y="b")
    assert_allclose(display.errors, [[0.4, 0.3], [np.nan, 0.2]])


def test_other_parameters_are_held_at_the_best_setting():
    settings = [
        {"a": a, "b": b, "c": c} for c in ("x", "y") for b in (1, 2) for a in (3, 4, 5)
    ]
    scores = np.array([0.1, 0.2, 0.3, 0.4, 0.9, 0.6, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5])
    results = {"params": settings, "mean_test_score": scores}
    display = GridDisplay.from_cv_results(results, x="a", y="b")
    assert_allclose(display.errors, 1 - scores[:6].reshape(2, 3))
    with pytest.raises(ValueError, match="no setting has a score"):
        GridDisplay.from_cv_results({**results, "mean_test_score": np.nan * scores})


def test_settings_with_a_parameter_that_the_best_one_lacks_are_no_others_of_it():
    settings = [{"a": 1, "b": b, **c} for c in ({}, {"c": 5}) for b in (1, 2)]
    results = {"params": settings, "mean_test_score": [0.9, 0.8, 0.5, 0.4]}
    display = GridDisplay.from_cv_results(results, x="a", y="b")
    assert_allclose(display.errors, [[0.1], [0.2]])


def test_values_of_a_grid_are_told_apart_whatever_they_are():
    """Arrays and functions without a name; True is not 1, but 1.0 is."""
    starts = np.zeros(2), np.ones(2)
    functions = (lambda views: views[0]), (lambda views: views[1])
    for values in (starts, functions, (True, 1), ((True,), (1,)), (None, "None")):
        settings = [{"a": a, "b": b} for a in values for b in (1, 2.0)]
        settings.append({"a": values[0], "b": 2})
        results = {"params": settings, "mean_test_score": [0.9, 0.8, 0.5, 0.4, 0.7]}
        display = GridDisplay.from_cv_results(results)
        assert_allclose(display.errors, [[0.1, 0.5], [0.3, 0.6]])
        assert all(a is b for a, b in zip(display.x_values, values, strict=True))


def test_the_grid_is_that_of_the_search(search):
    display = GridDisplay.from_estimator(
        search, x="estimator__delta", y="estimator__models"
    )
    best = search.best_params_["estimator__lam"]
    results = search.cv_results_
    for (row, column), error in np.ndenumerate(display.errors):
        (i,) = (
            i
            for i, setting in enumerate(results["params"])
            if setting
            == {
                "estimator__delta": display.x_values[column],
                "estimator__models": display.y_values[row],
                "estimator__lam": best,
            }
        )
        assert error == 1 - results["mean_test_score"][i]
        assert display.texts_[row, column].get_text() == f"{100 * error:.1f}"
    assert_allclose(display.image_.get_array(), 100 * display.errors)
    assert display.errors.min() == 1 - search.best_score_
    ticks = [label.get_text() for label in display.ax_.get_xticklabels()]
    assert ticks == ["0.1", "0.5", "2"]
    ticks = [label.get_text() for label in display.ax_.get_yticklabels()]
    assert ticks == ["A+H", "H+F"]
    assert (display.ax_.get_xlabel(), display.ax_.get_ylabel()) == ("delta", "models")


def test_negated_errors_of_a_search(small):
    X, y, segmenter = small
    right = make_scorer(misclassification_error, greater_is_better=False)
    grid = {"delta": [0.1, 1.0], "models": [MODELS[:2], MODELS[1:]]}
    everything = [(np.arange(60), np.arange(60))]
    search = GridSearchCV(segmenter, grid, scoring=right, cv=everything).fit(X, y)
    display = GridDisplay.from_estimator(search, negated=True)
    assert_allclose(display.errors.T.ravel(), -search.cv_results_["mean_test_score"])


def test_of_several_metrics_the_one_of_the_refit_is_drawn(small):
    X, y, segmenter = small
    right = make_scorer(misclassification_error, greater_is_better=False)
    grid = {"delta": [0.1, 1.0], "models": [MODELS[:2], MODELS[1:]]}
    everything = [(np.arange(60), np.arange(60))]
    scoring = {"error": right, "rand": "adjusted_rand_score"}
    search = GridSearchCV(segmenter, grid, scoring=scoring, cv=everything, refit="rand")
    display = GridDisplay.from_estimator(search.fit(X, y))
    score = search.cv_results_["mean_test_rand"]
    assert_allclose(display.errors.T.ravel(), 1 - score)


def test_long_names_of_values_are_turned():
    names = ["description_length", "kernel_addition", "coregularization"]
    display = GridDisplay([[0.1, 0.2, 0.3]], names, [1]).plot()
    display.figure_.canvas.draw()
    ticks = display.ax_.get_xticklabels()
    assert all(label.get_rotation() == 25 for label in ticks)
    upright = GridDisplay([[0.1, 0.2, 0.3]], [0.01, 0.1, 1], [1]).plot()
    assert all(label.get_rotation() == 0 for label in upright.ax_.get_xticklabels())


def test_a_setting_without_a_score_is_left_blank():
    display = GridDisplay([[0.1, np.nan]], [1, 2], [True]).plot(colorbar=False)
    assert [text.get_text() for text in display.texts_[0]] == ["10.0", "-"]
    assert display.texts_[0, 0].get_fontweight() == "bold"
    assert display.colorbar_ is None


def test_thirty_motions_have_colours_of_their_own():
    colours = {motion_colour(motion) for motion in range(30)} | {motion_colour(-1)}
    assert len(colours) == 31
    assert all(to_hex(to_rgb(colour)) == colour for colour in colours)


def test_a_file_of_something_else_is_named(tmp_path):
    journal = tmp_path / "bench.jsonl"
    journal.write_text('{"error_known": 0}\n{"error_known": 0}\n')
    with pytest.raises(ValueError, match=r"bench.jsonl is not what .* --json writes"):
        SequenceErrorDisplay.from_records(journal)


def test_numbers_can_be_read_on_their_colours():
    display = GridDisplay([[0.0, 0.9]], [1, 2], ["all"]).plot()
    assert [text.get_color() for text in display.texts_[0]] == ["black", "white"]


# ---------------------------------------------------------------------- all of them


X0, Y0 = make_rigid_motions(20, 4, missing=0, random_state=0)
DISPLAYS = {
    "MotionDisplay": MotionDisplay(X0, Y0),
    "CountDisplay": CountDisplay([1, 2], np.ones((2, 3)), 2),
    "SequenceErrorDisplay": SequenceErrorDisplay(ERRORS),
    "FusionWeightDisplay": FusionWeightDisplay([0.1, 1], [0.1, 0.2]),
    "GridDisplay": GridDisplay([[0.1, 0.2]], [1, 2], [1]),
    "AffinityDisplay": AffinityDisplay([K], [Y]),
    "ReportDisplay": ReportDisplay(
        MotionSegmenter(2, n_hypotheses=50, random_state=0).fit(X0).report(X0), X0, Y0
    ),
}
SEVERAL_AXES = {"AffinityDisplay", "ReportDisplay"}


def test_all_displays_are_here():
    displays = {name for name in plotting.__all__ if name.endswith("Display")}
    assert displays == set(DISPLAYS)


@pytest.mark.parametrize("name", [n for n in DISPLAYS if n not in SEVERAL_AXES])
def test_axes_that_are_given_are_used(name):
    figure, (ax, other) = plt.subplots(1, 2)
    display = DISPLAYS[name]
    assert display.plot(ax=ax) is display
    assert display.ax_ is ax
    assert display.figure_ is figure
    assert not other.has_data()
    assert plt.get_fignums() == [figure.number]


@pytest.mark.parametrize("name", DISPLAYS)
def test_the_figure_of_axes_in_a_part_of_it_is_the_whole(name):
    figure = plt.figure(figsize=(12, 6))
    part, _ = figure.subfigures(1, 2)
    inner, _ = part.subfigures(2, 1)
    if name in SEVERAL_AXES:
        display = DISPLAYS[name].plot(axes=inner.subplots(1, 2))
    else:
        display = DISPLAYS[name].plot(ax=inner.subplots())
    assert display.figure_ is figure


def test_affinity_axes_that_are_given_are_used():
    figure, axes = plt.subplots(2, 1)
    display = DISPLAYS["AffinityDisplay"].plot(axes=axes, colorbar=False)
    assert display.axes_.ravel().tolist() == axes.tolist()
    assert display.figure_ is figure
    assert len(figure.axes) == 2


@pytest.mark.parametrize("name", DISPLAYS)
def test_a_display_draws_again(name):
    first = DISPLAYS[name].plot().figure_
    second = DISPLAYS[name].plot().figure_
    assert first is not second
    assert len(first.axes) == len(second.axes)


@pytest.mark.parametrize("name", DISPLAYS)
def test_nothing_leaves_the_figure(name):
    """Titles, labels and legends are inside, so that savefig cuts none of them."""
    figure = DISPLAYS[name].plot().figure_
    figure.draw_without_rendering()
    drawn = figure.get_tightbbox()
    width, height = figure.get_size_inches()
    assert drawn.x0 > -0.01
    assert drawn.y0 > -0.01
    assert drawn.x1 < width + 0.01
    assert drawn.y1 < height + 0.01


def case(name, call, words, error=ValueError):
    return pytest.param(call, words, error, id=name)


@pytest.mark.parametrize(
    ("call", "words", "error"),
    [
        case(
            "motions, no frame",
            lambda: MotionDisplay.from_predictions(X0[:, :0], Y0),
            r"two columns per frame, of one frame or more; got .* shape \(20, 0\)",
        ),
        case(
            "two frames, no frame",
            lambda: plotting.plot_motions(X0[:, :0], Y0),
            r"two columns per frame, of one frame or more; got .* shape \(20, 0\)",
        ),
        case(
            "motions, lengths",
            lambda: MotionDisplay.from_predictions(X0, Y0[:-1]),
            r"20 tracks need one label each; got labels of shape \(19,\)",
        ),
        case(
            "motions, halves",
            lambda: MotionDisplay.from_predictions(X0, Y0 / 2),
            "labels must be whole numbers; got dtype float64",
        ),
        case(
            "two frames, one that is not",
            lambda: plotting.plot_motions(X0, Y0, frames=[0, 99]),
            "frame must be one of 0 to 3; got 99",
        ),
        case(
            "two frames, a number",
            lambda: plotting.plot_motions(X0, Y0, frames=3),
            "frames must be two of the clip; got 3",
        ),
        case(
            "motions, frame",
            lambda: MotionDisplay.from_predictions(X0, Y0, frame=4),
            "frame must be one of 0 to 3; got 4",
        ),
        case(
            "motions, image",
            lambda: MotionDisplay.from_predictions(X0, Y0, image=[1, 2]),
            r"image must have shape .* got \(2,\)",
        ),
        case(
            "motions, trail",
            lambda: MotionDisplay.from_predictions(X0, Y0, trail=-1),
            "trail must be a number of frames; got -1",
        ),
        case(
            "motions, not fitted",
            lambda: MotionDisplay.from_estimator(MotionSegmenter(), X0),
            "not fitted",
            NotFittedError,
        ),
        case(
            "motions, other tracks",
            lambda: MotionDisplay.from_estimator(
                MultiModelSpectralClustering().fit(STACKED), X0
            ),
            "fitted to 7 tracks; got 20. fitted=False",
        ),
        case(
            "affinities, not square",
            lambda: AffinityDisplay.from_predictions([K[:3]], [Y]),
            r"need shape \(n_views, n, n\); got \(1, 3, 7\)",
        ),
        case(
            "affinities, negative",
            lambda: AffinityDisplay.from_predictions([-K], [Y]),
            "finite and not negative",
        ),
        case(
            "affinities, not symmetric",
            lambda: AffinityDisplay.from_predictions([np.triu(K)], [Y]),
            "affinities need to be symmetric; entries of view 0 differ",
        ),
        case(
            "affinities, partition",
            lambda: AffinityDisplay.from_predictions([K], [Y[:-1]]),
            r"7 tracks need one label each; got a partition of shape \(6,\)",
        ),
        case(
            "affinities, nothing to sort by",
            lambda: AffinityDisplay.from_predictions([K], []),
            "there must be labels or a partition",
        ),
        case(
            "affinities, axes",
            lambda: AffinityDisplay.from_predictions([K], [Y], axes=[None] * 3),
            "1 views and 1 partitions need 2 axes; got 3",
        ),
        case(
            "affinities, names",
            lambda: AffinityDisplay.from_predictions([K], [Y], view_names=["a", "b"]),
            "1 views need a name each; got 2 names",
        ),
        case(
            "affinities, other rows",
            lambda: AffinityDisplay.from_estimator(
                MultiModelSpectralClustering().fit(STACKED), X0
            ),
            "the estimator was fitted to 7 rows; got 20",
        ),
        case(
            "affinities, other tracks",
            lambda: AffinityDisplay.from_estimator(
                MotionSegmenter(2, n_hypotheses=50, random_state=0).fit(X0), X0[::-1]
            ),
            "a display needs the tracks that were fitted, in their order",
        ),
        case(
            "affinities, other columns",
            lambda: AffinityDisplay.from_estimator(
                MultiModelSpectralClustering().fit(STACKED), STACKED[:, 1:]
            ),
            r"stacked affinities need shape \(n, n_views \* n\); got \(7, 13\)",
        ),
        case(
            "affinities, no columns",
            lambda: AffinityDisplay.from_estimator(
                MultiModelSpectralClustering().fit(STACKED), STACKED[:, :0]
            ),
            r"stacked affinities need shape \(n, n_views \* n\); got \(7, 0\)",
        ),
        case(
            "affinities, count",
            lambda: AffinityDisplay.from_estimator(
                NCREModelSelector(max_clusters=3).fit(STACKED), STACKED, counts=[2, 9]
            ),
            r"counts must be of those tried, \[1, 2, 3\]; got \[9\]",
        ),
        case(
            "affinities, no counts",
            lambda: AffinityDisplay.from_estimator(
                MultiModelSpectralClustering().fit(STACKED), STACKED, counts=[2]
            ),
            "tried one number of motions",
        ),
        case(
            "counts, no costs",
            lambda: CountDisplay.from_estimator(
                MultiModelSpectralClustering().fit(STACKED)
            ),
            "MultiModelSpectralClustering does not compare numbers of motions",
        ),
        case(
            "counts, shape",
            lambda: CountDisplay([1, 2], np.ones((2, 2)), 1).plot(),
            r"costs of shape \(n_counts, 3\); got \(2, 2\)",
        ),
        case(
            "counts, chosen",
            lambda: CountDisplay([1, 2], np.ones((2, 3)), 4).plot(),
            r"chosen must be one of \[1 2\]; got 4",
        ),
        case(
            "counts, affinities",
            lambda: CountDisplay.from_predictions(STACKED[1:], [Y[1:]]),
            r"stacked affinities need shape \(n, n_views \* n\); got \(6, 14\)",
        ),
        case(
            "counts, negative",
            lambda: CountDisplay.from_predictions(-STACKED, [Y]),
            "affinities must be finite and not negative",
        ),
        case(
            "counts, not numbers",
            lambda: CountDisplay.from_predictions(np.nan * STACKED, [Y]),
            "affinities must be finite and not negative",
        ),
        case(
            "counts, not symmetric",
            lambda: CountDisplay.from_predictions(np.hstack([K, np.triu(K)]), [Y]),
            "affinities need to be symmetric; entries of view 1 differ",
        ),
        case(
            "counts, no affinities",
            lambda: CountDisplay.from_predictions(np.ones((0, 0)), [[]]),
            r"stacked affinities need shape \(n, n_views \* n\); got \(0, 0\)",
        ),
        case(
            "counts, twice",
            lambda: CountDisplay.from_predictions(STACKED, [Y, 1 - Y]),
            r"one partition per number of motions; got some of \[2, 2\]",
        ),
        case(
            "counts, passed over",
            lambda: CountDisplay([1, 2], np.ones((2, 3)), 1, passed_over=[1, 0]).plot(),
            r"2 counts need a bool each in passed_over; got shape \(2,\) and dtype int",
        ),
        case(
            "report, axes",
            lambda: DISPLAYS["ReportDisplay"].plot(axes=[None]),
            "a report needs 2 axes; got 1",
        ),
        case(
            "report, labels",
            lambda: ReportDisplay(DISPLAYS["ReportDisplay"].report, X0, Y0[1:]).plot(),
            r"20 tracks need one label each; got labels of shape \(19,\)",
        ),
        case(
            "report, none",
            lambda: ReportDisplay.from_estimator(
                MultiModelSpectralClustering().fit(STACKED), X0
            ),
            "MultiModelSpectralClustering gives no report; give a MotionSegmenter",
        ),
        case(
            "errors, axes",
            lambda: SequenceErrorDisplay(ERRORS[0]).plot(),
            r"\(n_methods, n_sequences, n_seeds\); got \(2, 2\)",
        ),
        case(
            "errors, percent",
            lambda: SequenceErrorDisplay(100 * ERRORS).plot(),
            "errors must be in 0 to 1",
        ),
        case(
            "errors, lengths",
            lambda: SequenceErrorDisplay.from_predictions([Y0], [Y0, Y0]),
            "got 2 sequences and 1 label arrays",
        ),
        case(
            "records, a gap",
            lambda: SequenceErrorDisplay.from_records(records()[:-1]),
            r"1 are missing, the first \('subset', 'b', 1\)",
        ),
        case(
            "records, field",
            lambda: SequenceErrorDisplay.from_records(records(), value="error"),
            "the records of KT3DMoSeg have no field 'error'",
        ),
        case(
            "records, datasets",
            lambda: SequenceErrorDisplay.from_records(
                [*records(), {**records()[0], "dataset": "FBMS59"}]
            ),
            r"dataset must be one of \['KT3DMoSeg', 'FBMS59'\]; got None",
        ),
        case(
            "records, none",
            lambda: SequenceErrorDisplay.from_records([]),
            "there are no records of errors to draw",
        ),
        case(
            "records, not a list",
            lambda: SequenceErrorDisplay.from_records({"dataset": "FBMS59"}),
            "a record is a dict with dataset, method, seed, sequence; got 'dataset'",
        ),
        case(
            "records, no method",
            lambda: SequenceErrorDisplay.from_records([{"dataset": "FBMS59"}]),
            r"a record is a dict with .*; got \{'dataset': 'FBMS59'\}",
        ),
        case(
            "records, dataset",
            lambda: SequenceErrorDisplay.from_records(records(), dataset="FBMS59"),
            r"dataset must be one of \['KT3DMoSeg'\]; got 'FBMS59'",
        ),
        case(
            "weights, zero",
            lambda: FusionWeightDisplay.from_predictions([0, 1], [0.1, 0.2]),
            "values must be positive",
        ),
        case(
            "weights, infinite",
            lambda: FusionWeightDisplay.from_predictions([np.inf, 1], [0.1, 0.2]),
            "values must be positive and finite",
        ),
        case(
            "weights, percent",
            lambda: FusionWeightDisplay.from_predictions([2, 1], [7.5, 8.2]),
            "errors must be in 0 to 1; got 7.5 to 8.2",
        ),
        case(
            "weights, unknown errors",
            lambda: FusionWeightDisplay.from_predictions([2, 1], [np.nan, 0.1]),
            "errors must be in 0 to 1",
        ),
        case(
            "weights, lengths",
            lambda: FusionWeightDisplay.from_predictions([1, 2], [0.1]),
            r"errors must have shape \(2,\) .* got \(1,\)",
        ),
        case(
            "weights, labels of fewer",
            lambda: FusionWeightDisplay.from_estimator(
                MultiModelSpectralClustering(fusion="coreg"),
                [STACKED, STACKED],
                [Y],
                values=[1],
            ),
            "got 2 stacked affinities and 1 label arrays",
        ),
        case(
            "weights, fusion",
            lambda: FusionWeightDisplay.from_estimator(
                MultiModelSpectralClustering(fusion="kernel_addition"),
                [STACKED],
                [Y],
                values=[1],
            ),
            r"fusion must be one of \['coreg', 'subset'\].* got 'kernel_addition'",
        ),
        case(
            "grid, shape",
            lambda: GridDisplay([[0.1]], [1, 2], [1]).plot(),
            r"need errors of shape \(1, 2\); got \(1, 1\)",
        ),
        case(
            "grid, several metrics",
            lambda: GridDisplay.from_cv_results(
                {"mean_test_a": [0.1], "mean_test_b": [0.2], "params": [{"x": 1}]}
            ),
            "needs a mean_test_score; .* got mean_test_a, mean_test_b",
        ),
        case(
            "grid, not fitted",
            lambda: GridDisplay.from_estimator(GridSearchCV(MotionSegmenter(), {})),
            "not fitted",
            NotFittedError,
        ),
    ],
)
def test_bad_input_is_named_and_draws_nothing(call, words, error):
    with pytest.raises(error, match=words):
        call()
    assert plt.get_fignums() == []


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "two parameters can be drawn; x and y must say which"),
        ({"x": "estimator__delta"}, "x and y must say which"),
        ({"x": "delta"}, "must be of the grid, .*; got 'delta'"),
        ({"x": "estimator__lam", "y": "estimator__lam"}, "x and y must differ"),
        (
            {"x": "estimator__lam", "y": "estimator__delta", "negated": True},
            "scores must be in -1 to 0 for negated=True",
        ),
    ],
)
def test_what_to_draw_of_a_search_must_be_clear(search, options, words):
    with pytest.raises(ValueError, match=words):
        GridDisplay.from_estimator(search, **options)
    assert plt.get_fignums() == []


def test_without_matplotlib_every_display_names_the_extra(monkeypatch):
    """Before any work: an estimator is not even looked at."""
    for name in [*sys.modules]:
        if name.partition(".")[0] == "matplotlib":
            monkeypatch.setitem(sys.modules, name, None)
    message = (
        'this needs matplotlib, which is not installed: pip install "skmotionseg[plot]"'
    )
    K, y = np.ones((3, 3)), [0, 0, 1]
    for draw in (
        lambda: MotionDisplay([[0, 0, 1, 1]] * 3, y).plot(),
        lambda: MotionDisplay.from_estimator(None, None),
        lambda: AffinityDisplay([K], [y]).plot(),
        lambda: AffinityDisplay.from_estimator(None, None),
        lambda: CountDisplay([1], [[0, 0, 0]], 1).plot(),
        lambda: CountDisplay.from_estimator(None),
        lambda: ReportDisplay(None, None, None).plot(),
        lambda: ReportDisplay.from_estimator(None, None),
        lambda: SequenceErrorDisplay([[[0.0]]]).plot(),
        lambda: SequenceErrorDisplay.from_estimator(None, None, None),
        lambda: FusionWeightDisplay([1], [0]).plot(),
        lambda: FusionWeightDisplay.from_estimator(None, None, None, values=None),
        lambda: GridDisplay([[0]], [1], [1]).plot(),
    ):
        with pytest.raises(ImportError) as caught:
            draw()
        assert str(caught.value) == message


@pytest.mark.data
def test_a_real_clip(real_data):
    clip = load_kt3dmoseg(real_data / "KT3DMoSeg")[0]
    segmenter = MotionSegmenter(
        selection="ncre", n_hypotheses=100, max_motions=4, random_state=0
    ).fit(clip.data)
    drawn = MotionDisplay.from_estimator(segmenter, clip.data)
    n_seen = sum(len(points.get_offsets()) for points in drawn.points_.values())
    assert n_seen == np.isfinite(clip.data[:, 2 * drawn.frame_]).sum()
    display = AffinityDisplay.from_estimator(segmenter, clip.data, labels=clip.target)
    n = len(segmenter.landmarks_)
    assert display.images_[0, 0].get_array().shape == (n, n)
