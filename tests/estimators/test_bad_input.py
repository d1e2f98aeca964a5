"""What bad input raises, and in which words; always before any work is done."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.io
from scipy.sparse import csr_array
from sklearn.exceptions import NotFittedError

from skmotionseg import (
    HypothesisSampler,
    MotionSegmenter,
    MultiModelSpectralClustering,
    NCREModelSelector,
    ORKKernel,
    PerSequence,
    datasets,
    make_motion_pipeline,
    pack_tracks,
    save_motions,
    static_mask,
    unpack_tracks,
)
from skmotionseg._core.graph import spectral
from skmotionseg.datasets import load_tracks, make_rigid_motions
from skmotionseg.metrics import (
    boundary_f_measure,
    fbms_mean,
    fbms_objects,
    fbms_scores,
    misclassification_error,
    motion_count_accuracy,
    region_similarity,
    sequence_scorer,
)
from skmotionseg.plotting import SequenceErrorDisplay, plot_motions
from skmotionseg.preprocessing import select_balanced_tracks
from skmotionseg.video import track_video

X, Y = make_rigid_motions(n_tracks=20, n_frames=4, missing=0, random_state=0)
K = np.kron(np.eye(2), np.ones((3, 3)))  # affinities of two groups of three
MASK = np.ones((4, 4), dtype=bool)
PER_SEQUENCE = PerSequence(MotionSegmenter(2))
POINTS = np.zeros((5, 3, 2))


def changed(array, value, at=(0, 0)):
    array = array.copy()
    array[at] = value
    return array


@pytest.fixture
def no_work(monkeypatch):
    """No hypotheses, no ranking and no eigenvectors."""

    def work(*args, **kwargs):
        pytest.fail("bad input got as far as the work")

    monkeypatch.setattr("skmotionseg.sampling.draw_hypotheses", work)
    monkeypatch.setattr("skmotionseg.kernels.blocks_of_matrix", work)
    monkeypatch.setattr(spectral, "leading_eigenvectors", work)


def case(name, call, words, error=ValueError):
    return pytest.param(call, error, words, id=name)


# ------------------------------------------------------------------------- tracks

BAD_TRACKS = {
    "odd width": (X[:, :7], ValueError, "two columns per frame .* got 7 columns"),
    "one frame": (X[:, :2], ValueError, "got 2 columns, which is one frame"),
    "too few tracks": (X[:2], ValueError, "needs 3 tracks .* best frame pair has 2"),
    "no tracks": (X[:0], ValueError, r"no tracks: X has 0 samples, .*\(0, 8\)"),
    "nothing seen": (np.full_like(X, np.nan), ValueError, "best frame pair has 0"),
    "infinity": (changed(X, np.inf), ValueError, "infinity"),
    "minus infinity": (changed(X, -np.inf), ValueError, "infinity"),
    "infinities": (changed(X, [-np.inf, np.inf], (0, [0, 1])), ValueError, "infinity"),
    "text": ([["a", "b", "c", "d"]] * 9, ValueError, "could not convert string"),
    "complex": (X * 1j, ValueError, "Complex data not supported"),
    "sparse": (csr_array(X), TypeError, "[Ss]parse"),
    "points": (X.reshape(20, 4, 2), ValueError, r"pack_tracks\(points, visibility\)"),
    "a batch": (X.reshape(1, 20, 4, 2), ValueError, r"pack_tracks\(.*, layout="),
    "one row": (X[0], ValueError, "1D array"),
}


@pytest.mark.parametrize("reader", ["sampler", "segmenter", "pipeline"])
@pytest.mark.parametrize("name", BAD_TRACKS)
def test_bad_tracks(reader, name, no_work):
    tracks, error, words = BAD_TRACKS[name]
    estimator = {
        "sampler": HypothesisSampler("affine"),
        "segmenter": MotionSegmenter(models=["affine"]),
        "pipeline": make_motion_pipeline(models=["affine"]),
    }[reader]
    with pytest.raises(error, match=words):
        estimator.fit(tracks)


# ---------------------------------------------------------------------- parameters

PARAMETERS = [
    case(
        "sampler, unknown model",
        lambda: HypothesisSampler("rigid").fit(X),
        "unknown motion model 'rigid'; expected a MotionModel or one of",
    ),
    case(
        "sampler, model that is no text",
        lambda: HypothesisSampler(3).fit(X),
        "'model' parameter of HypothesisSampler must be",
    ),
    case(
        "sampler, no hypotheses",
        lambda: HypothesisSampler(n_hypotheses=0).fit(X),
        "'n_hypotheses' parameter .* in the range \\[1, inf\\)",
    ),
    case(
        "sampler, half a hypothesis",
        lambda: HypothesisSampler(n_hypotheses=0.5).fit(X),
        "'n_hypotheses' parameter .* must be an int",
    ),
    case(
        "sampler, frame_gap too large",
        lambda: HypothesisSampler(frame_gap=4).fit(X),
        "frame_gap=4 needs at least 5 frames; got 4",
    ),
    case(
        "sampler, frame_gap 0",
        lambda: HypothesisSampler(frame_gap=0).fit(X),
        "'frame_gap' parameter",
    ),
    case(
        "segmenter, no motions",
        lambda: MotionSegmenter(0).fit(X),
        "'n_motions' parameter of MotionSegmenter",
    ),
    case(
        "segmenter, more motions than tracks",
        lambda: MotionSegmenter(21).fit(X),
        "21 motions are more than the tracks .*20",
    ),
    case(
        "segmenter, unknown count",
        lambda: MotionSegmenter("some").fit(X),
        "'n_motions' parameter .*'auto'",
    ),
    case(
        "segmenter, unknown model",
        lambda: MotionSegmenter(models=("affine", "rigid")).fit(X),
        "unknown motion model 'rigid'",
    ),
    case(
        "segmenter, model that is no text",
        lambda: MotionSegmenter(models=("affine", 3)).fit(X),
        "unknown motion model 3",
    ),
    case(
        "segmenter, models twice",
        lambda: MotionSegmenter(models=("affine", "affine")).fit(X),
        r"models must differ; got \['affine', 'affine'\]",
    ),
    case(
        "segmenter, no models",
        lambda: MotionSegmenter(models=()).fit(X),
        "models must name at least one motion model; got none",
    ),
    case(
        "segmenter, models that are no list",
        lambda: MotionSegmenter(models=None).fit(X),
        "'models' parameter of MotionSegmenter",
    ),
    case(
        "segmenter, unknown fusion",
        lambda: MotionSegmenter(2, fusion="mean").fit(X),
        r"unknown fusion 'mean'; expected a callable or one of \['coreg', 'kernel_",
    ),
    case(
        "segmenter, unknown fusion, count unknown",
        lambda: MotionSegmenter(fusion="mean").fit(X),
        "unknown fusion 'mean'",
    ),
    case(
        "segmenter, min_motions above max_motions",
        lambda: MotionSegmenter(min_motions=3, max_motions=2).fit(X),
        "must not exceed .* 3 and 2",
    ),
    case(
        "segmenter, min_motions above the tracks",
        lambda: MotionSegmenter(min_motions=21, max_motions=30).fit(X),
        "21 motions are more than the tracks .*20",
    ),
    case(
        "segmenter, unknown selection",
        lambda: MotionSegmenter(selection="aic").fit(X),
        "'selection' parameter .*'ncre'",
    ),
    case(
        "segmenter, frame_gap too large",
        lambda: MotionSegmenter(frame_gap=4).fit(X),
        "frame_gap=4 needs at least 5 frames; got 4",
    ),
    case(
        "segmenter, negative delta",
        lambda: MotionSegmenter(delta=-1).fit(X),
        "'delta' parameter",
    ),
    case(
        "segmenter, top above 1",
        lambda: MotionSegmenter(kernel=ORKKernel(top=1.5)).fit(X),
        r"'top' parameter .* in the range \(0.*, 1",
    ),
    case(
        "segmenter, top 0",
        lambda: MotionSegmenter(kernel=ORKKernel(top=0)).fit(X),
        "'top' parameter",
    ),
    case(
        "segmenter, sparsity 0",
        lambda: MotionSegmenter(kernel=ORKKernel(sparsity=0)).fit(X),
        "'sparsity' parameter",
    ),
    case(
        "segmenter, memory that is none",
        lambda: MotionSegmenter(memory=3).fit(X),
        "'memory' parameter",
    ),
    case(
        "pipeline, unknown model",
        lambda: make_motion_pipeline(models=("rigid",)),
        "unknown motion model 'rigid'",
    ),
    case(
        "pipeline, models twice",
        lambda: make_motion_pipeline(models=("affine", "affine")),
        "models must differ",
    ),
    case(
        "pipeline, no models",
        lambda: make_motion_pipeline(models=()),
        "models must name at least one",
    ),
    case(
        "clustering, no clusters",
        lambda: MultiModelSpectralClustering(0).fit(K),
        "'n_clusters' parameter",
    ),
    case(
        "clustering, more clusters than tracks",
        lambda: MultiModelSpectralClustering(7).fit(K),
        "n_clusters=7 is more than the 6 tracks",
    ),
    case(
        "clustering, unknown fusion",
        lambda: MultiModelSpectralClustering(fusion="mean").fit(K),
        "unknown fusion 'mean'; expected a callable or one of",
    ),
    case(
        "clustering, negative lam",
        lambda: MultiModelSpectralClustering(lam=-1e-2).fit(K),
        "'lam' parameter",
    ),
    case(
        "selector, min_clusters above max_clusters",
        lambda: NCREModelSelector(min_clusters=3, max_clusters=2).fit(K),
        "min_clusters must not exceed max_clusters; got 3 and 2",
    ),
    case(
        "selector, min_clusters above the tracks",
        lambda: NCREModelSelector(min_clusters=7).fit(K),
        "min_clusters=7 is more than the 6 tracks",
    ),
    case(
        "selector, clusterer that is none",
        lambda: NCREModelSelector("coreg").fit(K),
        "'clusterer' parameter of NCREModelSelector",
    ),
    case(
        "selector, clusterer with an unknown fusion",
        lambda: NCREModelSelector(MultiModelSpectralClustering(fusion="mean")).fit(K),
        "unknown fusion 'mean'",
    ),
    case(
        "selector, clusterer with a bad parameter",
        lambda: NCREModelSelector(MultiModelSpectralClustering(gamma=-1)).fit(K),
        "'gamma' parameter",
    ),
    case(
        "segmenter, the class of a selector",
        lambda: MotionSegmenter(selection=NCREModelSelector).fit(X),
        r"such as NCREModelSelector\(\); got its class",
        TypeError,
    ),
    case(
        "selector, the class of a clusterer",
        lambda: NCREModelSelector(MultiModelSpectralClustering).fit(K),
        r"such as MultiModelSpectralClustering\(\); got its class",
        TypeError,
    ),
    case(
        "PerSequence, the class of a segmenter",
        lambda: PerSequence(MotionSegmenter).fit([X]),
        r"such as MotionSegmenter\(\); got its class",
        TypeError,
    ),
    case(
        "kernel, columns that do not split",
        lambda: ORKKernel(n_hypotheses=7).fit(np.ones((5, 20))),
        "in groups of n_hypotheses=7, one per frame pair; got 20 columns",
    ),
    case(
        "kernel, infinity",
        lambda: ORKKernel(n_hypotheses=2).fit([[1, np.inf]] * 3),
        "infinity",
    ),
    case(
        "kernel, infinities of both signs",
        lambda: ORKKernel(n_hypotheses=2).fit([[np.inf, -np.inf], [0, 0]]),
        "infinity",
    ),
    case(
        "kernel, top 0",
        lambda: ORKKernel(n_hypotheses=2, top=0).fit(np.ones((5, 20))),
        "'top' parameter",
    ),
    case(
        "kernel, negative covisibility_prior",
        lambda: ORKKernel(n_hypotheses=2, covisibility_prior=-1).fit(np.ones((5, 20))),
        "'covisibility_prior' parameter",
    ),
]


@pytest.mark.parametrize("call, error, words", PARAMETERS)
def test_bad_parameters(call, error, words, no_work):
    with pytest.raises(error, match=words):
        call()


# ---------------------------------------------------------------------- affinities


@pytest.mark.parametrize(
    "affinities, words",
    [
        pytest.param(K[:, :5], r"square blocks .* got \(6, 5\)", id="not square"),
        pytest.param(np.hstack([K, K[:, :5]]), r"got \(6, 11\)", id="not blocks"),
        pytest.param(changed(K, 0.5, (0, 1)), "view 0 differ .* 0.5", id="asymmetric"),
        pytest.param(
            np.hstack([K, changed(K, 0, (0, 1))]), "view 1 differ", id="asymmetric view"
        ),
        pytest.param(K - 0.1, "Negative values", id="negative"),
        pytest.param(changed(K, np.nan), "contains NaN", id="NaN"),
        pytest.param(np.ma.masked_less(K, 1), "contains NaN", id="masked"),
        pytest.param(changed(K, np.inf), "infinity", id="infinity"),
        pytest.param(
            changed(K, [-np.inf, np.inf], (0, [0, 1])), "infinity", id="infinities"
        ),
        pytest.param(np.zeros((6, 6)), "than the 0 tracks that have", id="no edges"),
    ],
)
@pytest.mark.parametrize(
    "estimator",
    [MultiModelSpectralClustering(2), NCREModelSelector(min_clusters=2)],
    ids=lambda e: type(e).__name__,
)
def test_bad_affinities(estimator, affinities, words, no_work):
    with pytest.raises(ValueError, match=words):
        estimator.fit(affinities)


# --------------------------------------------------------------- predict, transform


@pytest.mark.parametrize(
    "call",
    [
        lambda: HypothesisSampler().transform(X),
        lambda: ORKKernel().transform(X),
        lambda: MotionSegmenter().predict(X),
        lambda: MultiModelSpectralClustering().predict(K),
        lambda: NCREModelSelector().predict(K),
        lambda: PerSequence(MotionSegmenter()).predict([X]),
        lambda: PerSequence(MotionSegmenter()).score([X], [Y]),
    ],
)
def test_what_is_not_fitted_says_so(call):
    with pytest.raises(NotFittedError):
        call()


FITTED = {
    "sampler": HypothesisSampler("affine", n_hypotheses=5, random_state=0).fit(X),
    "segmenter": MotionSegmenter(2, n_hypotheses=9, random_state=0).fit(X),
    "kernel": ORKKernel(n_hypotheses=2).fit(np.arange(8.0).reshape(4, 2)),
    "clustering": MultiModelSpectralClustering(2, random_state=0).fit(K),
    "selector": NCREModelSelector(max_clusters=2, random_state=0).fit(K),
}


@pytest.mark.parametrize("name", FITTED)
def test_rows_of_another_width_are_refused(name):
    estimator = FITTED[name]
    apply = getattr(estimator, "transform", None) or estimator.predict
    width = estimator.n_features_in_
    words = f"X has {width + 2} features, but .* is expecting {width} features"
    with pytest.raises(ValueError, match=words):
        apply(np.ones((3, width + 2)))


@pytest.mark.parametrize("name", ["sampler", "segmenter"])
def test_infinite_tracks_are_refused_after_fit_too(name):
    apply = getattr(FITTED[name], "transform", None) or FITTED[name].predict
    with pytest.raises(ValueError, match="infinity"):
        apply(changed(X, np.inf))


@pytest.mark.parametrize("name", ["clustering", "selector"])
def test_negative_rows_are_refused_after_fit_too(name):
    with pytest.raises(ValueError, match="Negative values"):
        FITTED[name].predict(K - 0.1)


# ------------------------------------------------------------------------ functions

FUNCTIONS = [
    case(
        "pack_tracks, two axes",
        lambda: pack_tracks(X),
        r"shape \(n_tracks, n_frames, 2\); got \(20, 8\)",
    ),
    case(
        "pack_tracks, three coordinates",
        lambda: pack_tracks(np.zeros((5, 4, 3))),
        r"shape \(n_tracks, n_frames, 2\); got \(5, 4, 3\)",
    ),
    case(
        "pack_tracks, visibility of other frames",
        lambda: pack_tracks(POINTS, np.ones((5, 4), dtype=bool)),
        r"visibility must have shape .* = \(5, 3\); got \(5, 4\)",
    ),
    case(
        "pack_tracks, visibility between 0 and 1",
        lambda: pack_tracks(POINTS, np.full((5, 3), 0.5)),
        "visibility must be boolean, or numbers that are 0 or 1",
    ),
    case(
        "pack_tracks, visibility of text",
        lambda: pack_tracks(POINTS, np.full((5, 3), "yes")),
        "visibility must be boolean",
    ),
    case(
        "pack_tracks, infinity",
        lambda: pack_tracks(changed(POINTS, np.inf)),
        "must be finite .* got 1 infinite points",
    ),
    case(
        "pack_tracks, text",
        lambda: pack_tracks(np.full((5, 3, 2), "a")),
        "points must be real numbers; got dtype <U1",
        TypeError,
    ),
    case(
        "pack_tracks, complex",
        lambda: pack_tracks(POINTS * 1j),
        "points must be real numbers; got dtype complex",
        TypeError,
    ),
    case(
        "unpack_tracks, odd width",
        lambda: unpack_tracks(X[:, :7]),
        "two columns per frame; got 7 columns",
    ),
    case(
        "unpack_tracks, three axes",
        lambda: unpack_tracks(POINTS),
        "two columns per frame; got an array of 3 axes",
    ),
    case(
        "misclassification_error, lengths",
        lambda: misclassification_error([0, 1, 1], [0, 1]),
        "one label per track; got 3 and 2",
    ),
    case(
        "misclassification_error, nothing to judge",
        lambda: misclassification_error([-1, -1], [0, 1]),
        "none of the 2 tracks has a true label",
    ),
    case(
        "misclassification_error, no tracks",
        lambda: misclassification_error([], []),
        "none of the 0 tracks",
    ),
    case(
        "misclassification_error, halves",
        lambda: misclassification_error([0, 1], [0, 0.5]),
        "y_pred must be whole numbers",
    ),
    case(
        "misclassification_error, NaN",
        lambda: misclassification_error([0, 1], [0, np.nan]),
        "y_pred must be whole numbers",
    ),
    case(
        "misclassification_error, infinity",
        lambda: misclassification_error([0, np.inf], [0, 1]),
        "y_true must be whole numbers",
    ),
    case(
        "misclassification_error, text",
        lambda: misclassification_error(["car", "road"], [0, 1]),
        "y_true must be a list of whole numbers",
    ),
    case(
        "misclassification_error, masked true labels",
        lambda: misclassification_error(np.ma.MaskedArray([0, 1], [0, 1]), [0, 1]),
        "y_true must be known throughout; some are masked",
    ),
    case(
        "static_mask, masked labels",
        lambda: static_mask(X, np.ma.masked_equal(np.arange(len(X)) % 2, 0)),
        "labels must be known throughout",
    ),
    case(
        "motion_count_accuracy, counts of one sequence",
        lambda: motion_count_accuracy(2, 3),
        "need a list with an entry per sequence; got int and int",
    ),
    case(
        "motion_count_accuracy, masked counts",
        lambda: motion_count_accuracy(np.ma.MaskedArray([2, 3], [0, 1]), [2, 0]),
        "the number of motions of a sequence must be known throughout",
    ),
    case(
        "region_similarity, masked",
        lambda: region_similarity(np.ma.MaskedArray([[1, 1]], [[1, 0]]), [[0, 1]]),
        "y_true must be known throughout",
    ),
    case(
        "fbms_scores, masked weights",
        lambda: fbms_scores(
            [0, 1], [0, 1], sample_weight=np.ma.MaskedArray([1.0, 9], [0, 1])
        ),
        "sample_weight must be known throughout",
    ),
    case(
        "fbms_scores, weights that hide all",
        lambda: fbms_scores([0, 1], [0, 1], sample_weight=[1e-5, 1e-5]),
        "no region is visible: all have a size or weight of 0.0001 or less",
    ),
    case(
        "fbms_scores, a negative weight",
        lambda: fbms_scores([0, 1], [0, 1], sample_weight=[-2.5, 1]),
        "sample_weight must be a list of numbers of 0 or more; got -2.5",
    ),
    case(
        "fbms_objects, a threshold in words",
        lambda: fbms_objects([0, 1], [0, 1], threshold="half"),
        "threshold must be a number; got 'half'",
    ),
    case(
        "fbms_mean, of one sequence",
        lambda: fbms_mean(fbms_scores([0, 1], [0, 1])),
        "needs a list of scores, one per sequence; got one",
    ),
    case(
        "boundary_f_measure, a tolerance in words",
        lambda: boundary_f_measure(MASK, MASK, tolerance="1"),
        "tolerance must be a share of 0 or more; got '1'",
    ),
    case(
        "sequence_scorer, no labels",
        lambda: sequence_scorer("rand_score")(PER_SEQUENCE, [X], None),
        "each sequence needs true labels; got none for 1 sequences",
    ),
    case(
        "sequence_scorer, labels of more sequences",
        lambda: sequence_scorer("rand_score")(PER_SEQUENCE, [X], [Y, Y]),
        "each sequence needs true labels; got 2 for 1 sequences",
    ),
    case(
        "PerSequence, a number for labels",
        lambda: PER_SEQUENCE.fit([X], 5),
        "a label array per sequence; got int",
    ),
    case(
        "PerSequence, labels that are shares",
        lambda: PER_SEQUENCE.fit([X], [Y + 0.5]),
        "labels of sequence 0 must be whole numbers; got dtype float64",
    ),
    case(
        "save_motions, one id for all",
        lambda: save_motions("folder", X, Y, track_ids=np.full(len(X), 7)),
        "track_ids must each come once; got 7 more often",
    ),
    case(
        "save_motions, ids that are yes",
        lambda: save_motions("folder", X, Y, track_ids=[True] * len(X)),
        "track_ids must be whole numbers that fit in 64 bits; got True",
    ),
    case(
        "select_balanced_tracks, share in words",
        lambda: select_balanced_tracks([0, 1], "half"),
        r"share must be a number in \(0, 1\]; got 'half'",
    ),
    case(
        "SequenceErrorDisplay, tracks of one sequence",
        lambda: SequenceErrorDisplay.from_estimator(MotionSegmenter(2), X, Y),
        r"X must be a list of tracks, .*; got one array of shape \(20, 8\)",
    ),
    case(
        "track_video, no function",
        lambda: track_video(np.zeros((3, 40, 40, 3), np.uint8), progress=3),
        "progress must be a function .*; got 3",
        TypeError,
    ),
    case(
        "select_balanced_tracks, masked labels",
        lambda: select_balanced_tracks(np.ma.MaskedArray([0, 1], [0, 1])),
        "labels must be known throughout",
    ),
    case(
        "save_motions, masked ids",
        lambda: save_motions(
            "folder",
            X,
            np.zeros(len(X), int),
            track_ids=np.ma.masked_equal(np.arange(len(X)), 0),
        ),
        "track_ids must be known throughout",
    ),
    case(
        "PerSequence, masked labels",
        lambda: PerSequence(MotionSegmenter()).fit(
            [X], [np.ma.masked_equal(np.arange(len(X)) % 2, 0)]
        ),
        "labels of a sequence must be known throughout",
    ),
    case(
        "misclassification_error, two axes",
        lambda: misclassification_error([[0, 1]], [0, 1]),
        r"y_true must be a list .* shape \(1, 2\)",
    ),
    case(
        "motion_count_accuracy, lengths",
        lambda: motion_count_accuracy([2, 3], [2]),
        "as many found as true sequences, and at least one; got 1 and 2",
    ),
    case(
        "motion_count_accuracy, no sequence",
        lambda: motion_count_accuracy([], []),
        "at least one; got 0 and 0",
    ),
    case(
        "misclassification_error, out of range",
        lambda: misclassification_error([0, 1], [1e30, 2]),
        "y_pred must be whole numbers of 64 bits; got dtype float64",
    ),
    case(
        "misclassification_error, out of range without a sign",
        lambda: misclassification_error(np.array([2**63, 0], dtype=np.uint64), [0, 1]),
        "y_true must be whole numbers of 64 bits; got dtype uint64",
    ),
    case(
        "motion_count_accuracy, a negative count",
        lambda: motion_count_accuracy([-3], [-3]),
        "whole number of 0 or more; got -3",
    ),
    case(
        "motion_count_accuracy, an infinite count",
        lambda: motion_count_accuracy([np.inf], [2]),
        "whole number of 0 or more; got inf",
    ),
    case(
        "motion_count_accuracy, NaN",
        lambda: motion_count_accuracy([[0, np.nan]], [[0, 1]]),
        "labels of a sequence must be whole numbers",
    ),
    case(
        "motion_count_accuracy, two axes",
        lambda: motion_count_accuracy([[[0, 1]]], [[0, 1]]),
        r"labels of a sequence must be a list .* shape \(1, 2\)",
    ),
    case(
        "motion_count_accuracy, text",
        lambda: motion_count_accuracy([["car", "road"]], [[0, 1]]),
        "labels of a sequence must be a list of whole numbers",
    ),
    case(
        "boundary_f_measure, a negative tolerance",
        lambda: boundary_f_measure(MASK, MASK, tolerance=-1),
        "tolerance must be a share of 0 or more; got -1",
    ),
    case(
        "boundary_f_measure, no tolerance",
        lambda: boundary_f_measure(MASK, MASK, tolerance=np.nan),
        "tolerance must be a share of 0 or more; got nan",
    ),
    case(
        "fbms_scores, lengths",
        lambda: fbms_scores([0, 1, 1], [0, 1]),
        "one label per track; got 3 and 2",
    ),
    case(
        "fbms_scores, nothing annotated",
        lambda: fbms_scores([-1, -1], [0, 1]),
        "none of the 2 tracks",
    ),
    case(
        "plot_motions, lengths",
        lambda: plot_motions(X, Y[:-1]),
        "20 tracks .*19",
    ),
    case(
        "make_motion_pipeline, a count in words",
        lambda: make_motion_pipeline(n_clusters="many"),
        r"'n_clusters' parameter .* an int .*{'auto'}. Got 'many' instead",
    ),
    case(
        "make_motion_pipeline, no clusters",
        lambda: make_motion_pipeline(n_clusters=0),
        r"'n_clusters' parameter .* in the range \[1, inf\) .* Got 0 instead",
    ),
    case(
        "make_motion_pipeline, more than all",
        lambda: make_motion_pipeline(top=2),
        r"'top' parameter of ORKKernel .* Got 2 instead",
    ),
    case(
        "make_motion_pipeline, no hypotheses",
        lambda: make_motion_pipeline(n_hypotheses=0),
        "'n_hypotheses' parameter of HypothesisSampler",
    ),
    case(
        "make_motion_pipeline, unknown fusion",
        lambda: make_motion_pipeline(fusion="both"),
        "unknown fusion 'both'",
    ),
    case(
        "make_motion_pipeline, no range",
        lambda: make_motion_pipeline(min_clusters=3, max_clusters=2),
        "min_clusters must not exceed max_clusters; got 3 and 2",
    ),
    case(
        "make_motion_pipeline, no models",
        lambda: make_motion_pipeline(models=3),
        "models must be names of motion models or MotionModel objects; got 3",
        TypeError,
    ),
    case(
        "plot_motions, halves",
        lambda: plot_motions(X, Y / 2),
        "labels must be whole numbers; got dtype float64",
    ),
    case(
        "PerSequence, one array",
        lambda: PerSequence(MotionSegmenter()).fit(X),
        r"sequence 0 has shape \(8,\)",
    ),
    case(
        "PerSequence, no sequences",
        lambda: PerSequence(MotionSegmenter()).fit([]),
        "list of track arrays, one per sequence; got list without any",
    ),
    case(
        "PerSequence, no list",
        lambda: PerSequence(MotionSegmenter()).fit(None),
        "list of track arrays, one per sequence; got NoneType",
    ),
    case(
        "PerSequence, sparse",
        lambda: PerSequence(MotionSegmenter()).fit(csr_array(X)),
        "sparse data is not supported",
        TypeError,
    ),
    case(
        "PerSequence, a sparse sequence",
        lambda: PerSequence(MotionSegmenter()).fit([X, csr_array(X)]),
        "sparse data is not supported",
        TypeError,
    ),
    case(
        "PerSequence, labels of fewer sequences",
        lambda: PerSequence(MotionSegmenter()).fit([X, X], [Y]),
        "2 sequences and 1 label arrays",
    ),
    case(
        "PerSequence, labels of fewer tracks",
        lambda: PerSequence(MotionSegmenter()).fit([X, X], [Y, Y[:-1]]),
        r"sequence 1 has 20 tracks and labels of shape \(19,\)",
    ),
    case(
        "PerSequence, score without labels",
        lambda: (
            PerSequence(MotionSegmenter(2, n_hypotheses=10)).fit([X]).score([X], None)
        ),
        "true labels are needed: a label array per sequence",
    ),
    case(
        "PerSequence, no estimator",
        lambda: PerSequence("segmenter").fit([X]),
        "'estimator' parameter of PerSequence",
    ),
]


NO_JOBS = {
    "MotionSegmenter": lambda: MotionSegmenter(n_jobs=0).fit(X),
    "PerSequence": lambda: PerSequence(MotionSegmenter(), n_jobs=0).fit([X]),
    "MultiModelSpectralClustering": lambda: MultiModelSpectralClustering(n_jobs=0).fit(
        K
    ),
    "a clusterer": lambda: NCREModelSelector(
        MultiModelSpectralClustering(n_jobs=0)
    ).fit(K),
    "make_motion_pipeline": lambda: make_motion_pipeline(n_jobs=0),
    "a step": lambda: make_motion_pipeline().set_params(affinity__n_jobs=0).fit(X),
}


@pytest.mark.parametrize("place", NO_JOBS)
def test_no_jobs(place, no_work):
    words = r"'n_jobs' parameter of \w+ must be an int in .* or None. Got 0 instead"
    with pytest.raises(ValueError, match=words):
        NO_JOBS[place]()


@pytest.mark.parametrize("call, error, words", FUNCTIONS)
def test_bad_arguments_of_functions(call, error, words):
    with pytest.raises(error, match=words):
        call()


@pytest.mark.parametrize(
    "scene, words",
    [
        ({"n_frames": 1}, "at least 2 frames and 1 motion; got n_frames=1"),
        ({"n_motions": 0}, "at least 2 frames and 1 motion; .*n_motions=0"),
        ({"n_tracks": 2}, "3 motions need a track each; got n_tracks=2"),
        ({"n_tracks": 10, "outliers": 0.9}, "3 motions need a track each"),
        ({"missing": 0.95}, "missing must be in .* got 0.95"),
        ({"missing": -0.1}, "missing must be in"),
        ({"missing": np.nan}, "missing must be in"),
        ({"outliers": 1.0}, "outliers in .* 1.0"),
        ({"noise": -0.5}, "noise .*-0.5"),
        ({"noise": np.nan}, "noise .*nan"),
        ({"shapes": "round"}, "shapes must be of .*'round'"),
        ({"shapes": ("planar", "round")}, "shapes must be of .*'round'"),
        ({"shapes": ()}, "shapes must be of"),
        ({"camera": "drone"}, "camera of .* got .* 'drone'"),
        ({"random_state": "zero"}, "'zero' cannot be used to seed"),
        ({"n_tracks": 60.5}, "n_tracks must be a whole number; got 60.5"),
        ({"n_frames": 6.5}, "n_frames must be a whole number; got 6.5"),
        ({"n_motions": "2"}, "n_motions must be a whole number; got '2'"),
        ({"missing": "x"}, "missing must be a number; got 'x'"),
        ({"noise": "a"}, "noise must be a number; got 'a'"),
        ({"outliers": None}, "outliers must be a number; got None"),
        ({"shapes": 3}, "shapes must be of .*3"),
        ({"shapes": ([],)}, "shapes must be of"),
    ],
    ids=str,
)
def test_bad_scenes(scene, words):
    with pytest.raises((TypeError, ValueError), match=words):
        make_rigid_motions(**scene)


# ---------------------------------------------------------------------------- files


def struct(**changes):
    """The struct of a benchmark's file; a change to None leaves the field out."""
    y = np.ones((3, 5, 4))
    fields = {"ySparse": y, "visibleSparse": np.ones((5, 4)), "GtLabel": np.ones(5)}
    fields |= changes
    return {"Data": {name: f for name, f in fields.items() if f is not None}}


def npz(**arrays):
    return "tracks.npz", lambda path: np.savez(path, **arrays)


def mat(content):
    return "tracks.mat", lambda path: scipy.io.savemat(path, content)


def csv(*lines):
    return "tracks.csv", lambda path: path.write_text("\n".join(lines))


def raw(name, content):
    return name, lambda path: path.write_bytes(content)


def first_half(name, write):
    def write_half(path):
        write(path)
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])

    return name, write_half


BAD_FILES = {
    "npz, no tracks": (npz(a=X, b=Y), r"'points' or 'X'; got \['a', 'b'\]"),
    "npz, points of two axes": (npz(points=X[:, :7]), "tracks need two columns per fr"),
    "npz, visibility of others": (
        npz(points=POINTS, visibility=np.ones((4, 3))),
        r"visibility must have shape .* got \(4, 3\)",
    ),
    "npz, odd width": (npz(X=X[:, :7]), "7 columns"),
    "npz, X of three axes": (npz(X=POINTS), "3 axes"),
    "npz, complex": (npz(X=1j * X), "'X' must be real numbers; got dtype complex128"),
    "npz, occluded in words": (
        npz(points=POINTS, occluded=np.full((5, 3), "no")),
        "'occluded' must be real numbers; got dtype <U2",
    ),
    "npz, logits in words": (
        npz(tracks=POINTS, occlusion=np.full((5, 3), "no")),
        "'occlusion' must be real numbers; got dtype <U2",
    ),
    "npz, a video of one channel": (
        npz(points=POINTS, occluded=POINTS[..., 0] > 0, video=np.zeros((3, 9, 9))),
        r"'video' must have shape \(n_frames, height, width, 3\); got \(3, 9, 9\)",
    ),
    "npz, labels of others": (npz(X=X, labels=Y[:-1]), "20 .*19|19 .*20"),
    "npz, pickled objects": (npz(X=np.array([{}, None])), "allow_pickle=False"),
    "npz, no archive": (raw("tracks.npz", b"nothing of the kind"), None),
    "npz, empty": (raw("tracks.npz", b""), None),
    "npz, cut off": (first_half(*npz(X=X)), None),
    "mat, other arrays": (mat({"a": X}), r"'Data' or the arrays 'y' and 's'.* \['a'\]"),
    "mat, y without s": (mat({"y": np.ones((3, 5, 4))}), r"got \['y'\]"),
    "mat, Data is no struct": (mat({"Data": X}), r"no field \['ySparse', 'GtLabel'\]"),
    "mat, no labels": (mat(struct(GtLabel=None)), r"no field \['GtLabel'\]; got \['yS"),
    "mat, two coordinates": (
        mat(struct(ySparse=np.ones((2, 5, 4)))),
        r"'ySparse' must have shape \(3, n_tracks, n_frames\); got \(2, 5, 4\)",
    ),
    "mat, labels of others": (mat(struct(GtLabel=np.ones(6))), "5 .*6|6 .*5"),
    "mat, dense without index": (
        mat(struct(yAll=np.ones((3, 9, 4)), visibleAll=np.ones((9, 4)))),
        "SparseIndex",
    ),
    "mat, no mat file": (raw("tracks.mat", b"nothing of the kind" * 20), None),
    "mat, empty": (raw("tracks.mat", b""), None),
    "mat, cut off": (first_half(*mat(struct())), None),
    "csv, empty": (csv(), "it is empty"),
    "csv, ragged": (csv("0,0,1,1", "0,0,1"), r"rows differ in length: \[3, 4\]"),
    "csv, odd width": (csv("0,0,1", "0,0,1"), "3 columns"),
    "csv, words": (csv("0,0,here,1"), "could not convert string to float: 'here'"),
    "csv, no text": (raw("tracks.csv", b"\xff\xfe\x00\x00\xff"), None),
    "csv, observations cut short": (csv("track,frame,x,y", "0,0,1,1", "0,1"), "length"),
    "csv, header alone": (csv("track,frame,x,y"), "no observations|empty"),
    "csv, observation without frame": (csv("track,frame,x,y", "0,,1,1"), "frame"),
    "csv, observation without track": (
        csv("track,frame,x,y", "0,0,1,1", ",1,1,1"),
        "the column 'track' must be a number in each row",
    ),
    "csv, a point twice": (csv("track,frame,x,y", "0,0,1,1", "0,0,2,2"), "twice"),
    "csv, half a frame": (csv("track,frame,x,y", "0,0,1,1", "0,0.5,1,1"), "frame"),
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_bad_files(name, tmp_path):
    (file, write), words = BAD_FILES[name]
    path = tmp_path / file
    write(path)
    with pytest.raises(ValueError, match=words) as error:
        load_tracks(path)
    assert str(error.value).startswith(f"{path} is not a track file: ")
    assert "\n" not in str(error.value)


def test_a_file_for_which_there_is_no_memory(tmp_path, monkeypatch):
    def too_large(path):
        raise MemoryError

    monkeypatch.setattr(datasets._files, "read_moseg_tracks", too_large)
    (tmp_path / "tracks.dat").write_text("2 1 0 2 1 1 0 1 1 1")
    with pytest.raises(ValueError, match="there is not enough memory for it "):
        load_tracks(tmp_path / "tracks.dat")


@pytest.mark.parametrize("name", ["tracks.txt", "tracks", "tracks.tsv"])
def test_an_unknown_ending_is_named(name, tmp_path):
    (tmp_path / name).write_text("0,0,1,1")
    words = f"end in .npz, .npy, .mat or .csv; got '{name}'"
    with pytest.raises(ValueError, match=words):
        load_tracks(tmp_path / name)


@pytest.mark.parametrize("name", ["nowhere.npz", "nowhere.txt", "."])
def test_a_missing_file_is_named(name, tmp_path):
    with pytest.raises(FileNotFoundError, match="no track file at ") as error:
        load_tracks(tmp_path / name)
    assert str(tmp_path / name) in str(error.value)


@pytest.mark.parametrize(
    "load, pattern",
    [
        (datasets.load_kt3dmoseg, r"\*_Tracks.mat"),
        (datasets.load_mtpv62, r"\*_Tracks.mat"),
        (datasets.load_hopkins12, r"\*_Tracks.mat"),
        (datasets.load_hopkins155, r"\*/\*_truth.mat"),
        (datasets.load_adelaide, r"\*.mat"),
        (datasets.load_arrigoni, r"\*.npz"),
    ],
)
def test_a_folder_without_sequences_is_named(load, pattern, tmp_path):
    with pytest.raises(FileNotFoundError, match=f"no file {pattern} in ") as error:
        load(tmp_path)
    assert str(tmp_path) in str(error.value)
    with pytest.raises(FileNotFoundError, match=r"no folder .*nowhere"):
        load(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ([f"{axis}{k}" for axis in "xy" for k in range(4)], "x and y of the first"),
        (["y0", "x0", "y1", "x1", "y2", "x2", "y3", "x3"], "x and y of the first"),
        (["x1", "y1", "x0", "y0", "x2", "y2", "x3", "y3"], "in the order of their fra"),
        (["Track", "Label", "x0", "y0", "x1", "y1", "x2", "y2"], "'track', 'label'"),
        (["a", "b", "c", "d", "e", "f", "g", "label"], "'label' among them"),
    ],
)
def test_data_frames_are_not_read_in_another_order_than_their_names_tell(
    names, words, no_work
):
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(X, columns=names)
    for estimator in (MotionSegmenter(2), HypothesisSampler()):
        with pytest.raises(ValueError, match=words):
            estimator.fit(frame)


@pytest.mark.parametrize(
    "names",
    [
        [f"{axis}{k}" for k in range(4) for axis in "xy"],
        [f"{axis}_{k}" for k in range(8, 12) for axis in "XY"],
        [f"x{k}" for k in range(8)],  # as scikit-learn names what has no names
        list("abcdefgh"),
        range(8),
    ],
)
def test_data_frames_may_have_other_names(names):
    pandas = pytest.importorskip("pandas")
    sampler = HypothesisSampler(n_hypotheses=5, random_state=0)
    frame = pandas.DataFrame(X, columns=names)
    np.testing.assert_array_equal(
        sampler.fit_transform(frame), sampler.fit_transform(X)
    )
