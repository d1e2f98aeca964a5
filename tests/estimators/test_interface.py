"""What trips users up: parameters that disagree, scorers, paths of grids, and -1."""

from __future__ import annotations

import inspect
import json
import warnings

import numpy as np
import pandas as pd
import pytest
from helpers.own_models import SHIFT
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.base import BaseEstimator, ClusterMixin, clone
from sklearn.exceptions import NotFittedError
from sklearn.metrics import adjusted_rand_score, get_scorer, make_scorer
from sklearn.model_selection import (
    GridSearchCV,
    KFold,
    cross_val_score,
    cross_validate,
)
from sklearn.pipeline import make_pipeline

from skmotionseg import (
    EigengapModelSelector,
    HypothesisSampler,
    MotionModel,
    MotionSegmenter,
    MultiModelSpectralClustering,
    NCREModelSelector,
    ORKKernel,
    PerSequence,
    SelfTuningModelSelector,
    make_motion_pipeline,
    unpack_tracks,
)
from skmotionseg.datasets import load_tracks, make_rigid_motions
from skmotionseg.metrics import (
    misclassification_error,
    motion_count_accuracy,
    sequence_scorer,
)
from skmotionseg.pipelines import ModelUnion
from skmotionseg.plotting import CountDisplay

SMALL = {"n_hypotheses": 50, "random_state": 0}
QUICK = {"selection": "ncre", **SMALL}  # where only the scorer matters
SELECTORS = [NCREModelSelector, EigengapModelSelector, SelfTuningModelSelector]


@pytest.fixture(scope="module")
def tracks():
    """An easy scene of two motions: (X, y)."""
    return make_rigid_motions(60, 6, 2, missing=0.1, noise=0.2, random_state=0)


@pytest.fixture(scope="module")
def sequences():
    """Four short sequences of two motions: (list of X, list of y)."""
    scenes = [make_rigid_motions(30, 5, 2, random_state=seed) for seed in range(4)]
    return [X for X, _ in scenes], [y for _, y in scenes]


def whole(X):
    """One split: the search is fitted on the tracks that it is judged on."""
    rows = np.arange(len(X))
    return [(rows, rows)]


# -------------------------------------------------------------------- several views


@pytest.mark.parametrize("make", [MultiModelSpectralClustering, *SELECTORS])
def test_a_grid_over_a_clusterer_of_two_views(make, tracks):
    X, y = tracks
    affinities = make_motion_pipeline(("affine", "homography"), 2, **SMALL)[
        0
    ].fit_transform(X)
    found = GridSearchCV(
        make(random_state=0),
        {"fusion": ["coreg"], "lam": [1e-3, 1e-1]},
        scoring=make_scorer(adjusted_rand_score),
        cv=whole(X),
        error_score="raise",
    ).fit(affinities, y)
    assert np.isfinite(found.cv_results_["mean_test_score"]).all()


@pytest.mark.parametrize("n_rows", [7, 6])  # of 24 columns: blocks of no size, of six
def test_the_rows_of_a_fold_are_no_affinities(n_rows):
    block = np.kron(np.eye(2), np.ones((6, 6)))
    rows = np.hstack([block, block])[3 : 3 + n_rows]
    with pytest.raises(ValueError, match="cross-validate tracks, with make_motion"):
        MultiModelSpectralClustering().fit(rows)


# ------------------------------------------------------------- the number of hypotheses


def test_a_kernel_that_disagrees_with_its_sampler_says_so(tracks):
    sampler = HypothesisSampler(n_hypotheses=100, random_state=0)
    with pytest.raises(ValueError, match="drew 100 hypotheses per frame pair, and the"):
        make_pipeline(sampler, ORKKernel(n_hypotheses=50)).fit(tracks[0])


def test_the_number_travels_with_the_residuals(tracks):
    X, _ = tracks
    residuals = HypothesisSampler(n_hypotheses=30, random_state=0).fit_transform(X)
    told = ORKKernel(n_hypotheses=30).fit_transform(np.asarray(residuals))
    for sent in (residuals, residuals.copy(), residuals[:], residuals[np.arange(60)]):
        kernel = ORKKernel().fit(sent)
        assert kernel.n_hypotheses_ == 30
        assert_array_equal(kernel.transform(sent), told)


def test_the_number_travels_with_data_frames(tracks):
    sampler = HypothesisSampler(n_hypotheses=30, random_state=0)
    frame = sampler.set_output(transform="pandas").fit_transform(tracks[0])
    assert list(frame.columns[[0, 31]]) == ["pair0_hypothesis0", "pair1_hypothesis1"]
    assert ORKKernel().fit(frame).n_hypotheses_ == 30


def test_residuals_that_do_not_say_come_in_groups_of_500():
    with pytest.raises(ValueError, match="groups of n_hypotheses=500, one per frame"):
        ORKKernel().fit(np.ones((4, 510)))
    assert ORKKernel().fit(np.ones((4, 1000))).n_hypotheses_ == 500


@pytest.mark.parametrize("cached", [False, True])
def test_a_sweep_of_the_samplers_hypotheses(tracks, cached, tmp_path):
    X, y = tracks
    memory = str(tmp_path) if cached else None
    pipeline = make_motion_pipeline("homography", 2, memory=memory, **SMALL)
    key = "affinity__homography__sampler__n_hypotheses"
    search = GridSearchCV(
        pipeline,
        {key: [20, 40]},
        scoring=make_scorer(misclassification_error),
        cv=whole(X),
        error_score="raise",
        refit=False,
    ).fit(X, y)
    for n, error in zip((20, 40), search.cv_results_["mean_test_score"], strict=True):
        labels = pipeline.set_params(**{key: n}).fit_predict(X)
        assert misclassification_error(y, labels) == error


# ----------------------------------------------------------------------- paths of grids

PATHS = {
    "cluster__fusion": "coreg",
    "cluster__lam": 0.1,
    "cluster__gamma": 0.1,
    "cluster__delta": 0.5,
    "cluster__n_clusters": 2,
    "affinity__models": ("affine", "homography"),
}


@pytest.mark.parametrize("n_clusters", [3, "auto"])
@pytest.mark.parametrize("path", PATHS)
def test_paths_are_the_same_whether_or_not_the_number_is_known(
    path, n_clusters, tracks
):
    X, y = tracks
    pipeline = make_motion_pipeline(n_clusters=n_clusters, max_clusters=3, **SMALL)
    found = GridSearchCV(
        pipeline,
        {path: [PATHS[path]]},
        scoring=make_scorer(misclassification_error),
        cv=whole(X),
        error_score="raise",
    ).fit(X, y)
    direct = {path.removeprefix("cluster__"): PATHS[path]}
    if path == "affinity__models":
        direct = {"models": PATHS[path]}
    again = make_motion_pipeline(
        **{"n_clusters": n_clusters, "max_clusters": 3, **SMALL, **direct}
    )
    assert_array_equal(found.best_estimator_["cluster"].labels_, again.fit_predict(X))


def test_subsets_of_the_models_are_one_key_of_a_grid(tracks):
    X, y = tracks
    subsets = [("affine", "homography"), ("homography", "fundamental"), "affine"]
    found = GridSearchCV(
        make_motion_pipeline(n_clusters=2, **SMALL),
        {"affinity__models": subsets, "cluster__lam": [0.01, 0.1]},
        scoring=make_scorer(misclassification_error, greater_is_better=False),
        cv=whole(X),
        error_score="raise",
    ).fit(X, y)
    assert len(found.cv_results_["params"]) == 6
    for models in subsets:
        union = make_motion_pipeline(n_clusters=2, **SMALL)[0].set_params(models=models)
        n_models = 1 if isinstance(models, str) else len(models)
        affinities = union.fit_transform(X)
        assert affinities.shape == (60, 60 * n_models)
        assert_array_equal(union.transform(X), affinities)
        assert len(union.get_feature_names_out()) == 60 * n_models
        assert union.n_features_in_ == X.shape[1]


@pytest.mark.parametrize(
    "models, words",
    [
        (("rigid",), r"models must be some of \['affine', .*got \['rigid'\]"),
        (SHIFT, r"models must be some of .*; got \['shift'\]"),
        (("affine", 3), r"models must be some of .*; got \['affine', 3\]"),
        ((), r"models must be some of .*; got \[\]"),
        (("affine", "affine"), r"models must differ; got \['affine', 'affine'\]"),
        (
            3,
            r"'models' parameter of ModelUnion must be an array-like, .* Got 3 instead",
        ),
    ],
)
def test_models_of_a_union_must_be_there(models, words, tracks):
    union = make_motion_pipeline(**SMALL)[0].set_params(models=models)
    with pytest.raises((TypeError, ValueError), match=words):
        union.fit(tracks[0])


def test_models_of_a_union_may_be_objects(tracks):
    X, _ = tracks
    pipeline = make_motion_pipeline((SHIFT, "affine", "homography"), 2, **SMALL)
    affine = MotionModel.built_in("affine")
    for given, names in [
        (SHIFT, ["shift"]),
        ((SHIFT, affine), ["shift", "affine"]),
        (["homography", affine], ["affine", "homography"]),
    ]:
        by_object = pipeline.set_params(affinity__models=given).fit_predict(X)
        by_name = pipeline.set_params(affinity__models=names).fit_predict(X)
        assert_array_equal(by_object, by_name)


@pytest.mark.parametrize("dropped", [["affine", "homography"], ["affine"]])
def test_a_union_needs_a_view(dropped, tracks):
    models = ("affine", "homography")
    union = make_motion_pipeline(models, **SMALL)[0].set_params(
        models=dropped, **dict.fromkeys(dropped, "drop")
    )
    for fit in (union.fit, union.fit_transform):
        with pytest.raises(
            ValueError, match=r"at least one view; of .*all are dropped"
        ):
            fit(tracks[0])


def union_of_two():
    return ModelUnion(
        [
            (name, make_pipeline(HypothesisSampler(name, **SMALL), ORKKernel()))
            for name in ("affine", "homography")
        ]
    )


def test_a_union_forgets_views_that_did_not_take_part(tracks):
    X, _ = tracks
    union = union_of_two().fit(X).set_params(models=("affine",)).fit(X[:30])
    assert union.transform(X).shape == (60, 30)
    with pytest.raises(NotFittedError):
        union.set_params(models=None).transform(X)


def test_a_union_has_the_names_of_the_columns_of_its_last_fit(tracks):
    X, _ = tracks
    first = pd.DataFrame(X).add_prefix("first ")
    union = union_of_two().fit(first)
    assert_array_equal(union.feature_names_in_, first.columns)
    second = pd.DataFrame(X).add_prefix("second ")
    union.set_params(models=("homography",)).fit(second)
    assert_array_equal(union.feature_names_in_, second.columns)
    assert not hasattr(union.fit(X), "feature_names_in_")


@pytest.mark.parametrize(
    "wrong", [{"affine": "drop", "homography": "drop"}, {"models": ("foo",)}], ids=str
)
def test_a_union_without_a_view_can_be_shown(wrong):
    union = union_of_two().set_params(**wrong)
    assert not hasattr(union, "n_features_in_")
    assert "homography" in union._repr_html_()


def test_a_pipeline_with_memory_takes_masked_tracks(tracks, tmp_path):
    X, _ = tracks
    masked = np.ma.masked_invalid(X)
    pipeline = make_motion_pipeline(n_clusters=2, **SMALL, memory=str(tmp_path))
    assert_array_equal(pipeline.fit_predict(masked), pipeline.fit_predict(X))


# ----------------------------------------------------------------------- fits that fail


@pytest.mark.parametrize(
    "estimator",
    [
        HypothesisSampler("fundamental", **SMALL),
        MotionSegmenter(2, **QUICK),
    ],
    ids=lambda estimator: type(estimator).__name__,
)
def test_a_fit_that_fails_leaves_nothing_of_it_nor_of_another(estimator, tracks):
    X, _ = tracks
    more, _ = make_rigid_motions(60, 16, 2, random_state=1)
    apply = "transform" if hasattr(estimator, "transform") else "predict"
    for fitted in (clone(estimator), clone(estimator).fit(X)):
        for bad in (more[:5], more[:, :7], np.full_like(more, np.inf)):
            with pytest.raises(ValueError):
                fitted.fit(bad)
            with pytest.raises(NotFittedError):
                getattr(fitted, apply)(X)


def test_a_sampler_whose_fit_transform_fails_is_not_fitted(tracks):
    """Hypotheses of the clip before are none of one that has more frames."""
    X, _ = tracks
    longer, _ = make_rigid_motions(60, 8, 2, random_state=1)
    sampler = HypothesisSampler("fundamental", **SMALL).fit(X)
    with pytest.raises(ValueError, match="needs 8 tracks"):
        sampler.fit_transform(longer[:5])
    with pytest.raises(NotFittedError):
        sampler.transform(longer)


def test_a_kernel_whose_fit_fails_names_no_columns():
    kernel = ORKKernel(n_hypotheses=50).fit(np.ones((20, 50)))
    with pytest.raises(ValueError, match="got 49 columns"):
        kernel.fit(np.ones((30, 49)))
    with pytest.raises(NotFittedError):
        kernel.get_feature_names_out()


@pytest.mark.parametrize(
    "estimator",
    [MultiModelSpectralClustering(2), NCREModelSelector(), ORKKernel(n_hypotheses=50)],
)
def test_a_step_whose_fit_fails_is_not_fitted(estimator):
    good = np.kron(np.eye(2), np.ones((25, 25)))
    apply = "transform" if hasattr(estimator, "transform") else "predict"
    fitted = clone(estimator).fit(good)
    for bad in (good[:, :49], -good + np.inf):
        with pytest.raises(ValueError):
            fitted.fit(bad)
        with pytest.raises(NotFittedError):
            getattr(fitted, apply)(good)


# ------------------------------------------------------------------------------ scorers


USE = r"use scoring=sequence_scorer\('adjusted_rand_score'\)"


def test_a_sequence_scorer_is_not_for_one_matrix(sequences):
    X, y = sequences[0][0], sequences[1][0]
    with pytest.raises(ValueError, match="a list of labels per sequence, for PerSequ"):
        sequence_scorer("adjusted_rand_score")(None, X, y)


@pytest.mark.parametrize("error_score", [np.nan, "raise"])
def test_scorers_of_scikit_learn_say_what_to_use(sequences, error_score):
    """No score is NaN: nothing is fitted, and an error says why."""
    X, y = sequences
    estimator = PerSequence(MotionSegmenter(2, **QUICK))
    params = {"scoring": "adjusted_rand_score", "cv": 2, "error_score": error_score}
    with pytest.raises(ValueError, match=USE):
        cross_val_score(estimator, X, y, **params)
    with pytest.raises(ValueError, match=USE):
        GridSearchCV(estimator, {"estimator__lam": [0.1]}, **params).fit(X, y)
    several = params | {"scoring": ["adjusted_rand_score", "rand_score"]}
    with pytest.raises(ValueError, match=USE):
        cross_validate(make_pipeline("passthrough", estimator), X, y, **several)


def test_a_scorer_of_scikit_learn_says_what_to_use(sequences):
    X, y = sequences
    estimator = PerSequence(MotionSegmenter(2, **QUICK)).fit(X, y)
    with pytest.raises(ValueError, match=USE):
        get_scorer("adjusted_rand_score")(estimator, X, y)


class CountOfSequences(BaseEstimator):
    """An estimator of others: says of each sequence how many motions it has."""

    def fit(self, X, y=None):
        self.segmenter_ = PerSequence(MotionSegmenter(2, **QUICK)).fit(X)
        return self

    def predict(self, X):
        return [labels.max() + 1 for labels in self.segmenter_.predict(X)]


def test_what_is_made_of_labels_may_be_scored_by_scikit_learn(sequences):
    X, y = sequences
    counts = [len(set(labels)) for labels in y]
    params = {"scoring": "neg_mean_absolute_error", "cv": 2, "error_score": "raise"}
    assert_array_equal(cross_val_score(CountOfSequences(), X, counts, **params), 0)


@pytest.mark.parametrize("scoring", ["adjusted_rand_score", adjusted_rand_score])
def test_a_sequence_scorer_is_the_mean_over_sequences(scoring, sequences):
    X, y = sequences
    estimator = PerSequence(MotionSegmenter(2, **QUICK)).fit(X, y)
    y = [np.where(np.arange(len(each)) < 3, -1, each) for each in y]
    expected = np.mean(
        [
            adjusted_rand_score(true[3:], found[3:])
            for true, found in zip(y, estimator.predict(X), strict=True)
        ]
    )
    assert sequence_scorer(scoring)(estimator, X, y) == pytest.approx(expected)
    search = GridSearchCV(
        estimator,
        {"estimator__fusion": ["coreg", "subset"]},
        scoring=sequence_scorer(scoring),
        cv=KFold(2),
        error_score="raise",
    ).fit(X, y)
    assert np.isfinite(search.cv_results_["mean_test_score"]).all()


def test_a_scorer_of_ones_own_gets_the_lists(sequences):
    X, y = sequences

    def score(y_true, y_pred):
        return float(len(y_true) == len(y_pred))

    estimator = PerSequence(MotionSegmenter(2, **QUICK))
    assert set(cross_val_score(estimator, X, y, scoring=make_scorer(score), cv=2)) == {
        1
    }


def test_an_unknown_scorer_is_refused_before_any_work():
    with pytest.raises(ValueError, match="rand_skore"):
        sequence_scorer("rand_skore")


def test_more_folds_than_sequences_say_how_many_there_are(sequences):
    estimator = PerSequence(MotionSegmenter(2, **QUICK))
    with pytest.raises(ValueError, match="n_samples=4"):
        cross_val_score(estimator, *sequences, cv=5)


# ------------------------------------------------------------------- defaults and seeds


def test_defaults_of_one_name_are_the_same_everywhere():
    places = (
        MotionSegmenter,
        MultiModelSpectralClustering,
        NCREModelSelector,
        make_motion_pipeline,
    )
    for name in ("fusion", "lam", "gamma", "delta"):
        defaults = {
            inspect.signature(place).parameters[name].default
            for place in places
            if name in inspect.signature(place).parameters
        }
        assert len(defaults - {None}) == 1, name


def test_there_are_fewer_parameters_than_there_were():
    assert len(inspect.signature(MotionSegmenter).parameters) < 20


def test_the_search_says_how_often_it_restarts():
    assert "8 initialisations of k-means" in MotionSegmenter.__doc__


@pytest.mark.parametrize("make", SELECTORS)
def test_a_nested_seed_holds(make):
    block = np.kron(np.eye(2), np.ones((4, 4))) + 0.1
    nested = MultiModelSpectralClustering(random_state=3)
    fitted = make(nested, max_clusters=3, random_state=1).fit(block)
    assert fitted.clusterer_.random_state == 3
    free = make(MultiModelSpectralClustering(), max_clusters=3, random_state=1)
    assert isinstance(free.fit(block).clusterer_.random_state, int | np.integer)


def test_nothing_public_takes_a_private_type():
    assert not hasattr(MultiModelSpectralClustering, "cluster_graph")


@pytest.mark.parametrize("seed", [None, "instance"])
def test_memory_without_a_seed_is_warned_of(seed, tracks, tmp_path):
    X, _ = tracks
    seed = np.random.RandomState(0) if seed else None
    segmenter = MotionSegmenter(
        2,
        selection="ncre",
        n_hypotheses=20,
        memory=str(tmp_path),
        random_state=seed,
    )
    with pytest.warns(UserWarning, match="memory has no effect without an integer ran"):
        segmenter.fit(X)
    with pytest.warns(UserWarning, match="random_state of the estimator"):
        PerSequence(segmenter, memory=str(tmp_path)).fit([X])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "Persisting input arguments")
        segmenter.set_params(random_state=0).fit(X)
        PerSequence(segmenter, memory=str(tmp_path)).fit([X])


def test_warnings_point_at_the_code_of_the_user(tracks, tmp_path):
    X, y = tracks
    shares, table = X / 1280, tmp_path / "shares.npz"
    np.savez(table, tracks=shares)
    fast = {"n_hypotheses": 20, "selection": "ncre"}
    segmenter = MotionSegmenter(2, **fast, random_state=0)
    forgetful = MotionSegmenter(2, memory=str(tmp_path), **fast)
    search = GridSearchCV(segmenter, {"lam": [0.1]}, scoring=lambda *_: 0, cv=whole(X))
    calls = {
        "fit": lambda: segmenter.fit(shares),
        "fit_predict": lambda: segmenter.fit_predict(shares),
        "pipeline": lambda: make_pipeline("passthrough", segmenter).fit(shares),
        "search": lambda: search.fit(shares, y),
        "memory": lambda: forgetful.fit(X),
        "memory in a pipeline": lambda: make_motion_pipeline(memory=str(tmp_path)),
        "sequences": lambda: PerSequence(forgetful, memory=str(tmp_path)).fit([X]),
        "file": lambda: load_tracks(table),
    }
    for name, call in calls.items():
        with pytest.warns(UserWarning) as caught:
            call()
        assert {each.filename for each in caught} == {__file__}, name


@pytest.mark.parametrize("outliers", [0, 0.2])
def test_predict_gives_fitted_tracks_their_label(outliers):
    X, _ = make_rigid_motions(150, 4, 2, outliers=outliers, random_state=0)
    segmenter = MotionSegmenter(
        n_hypotheses=100, max_motions=3, n_landmarks=60, random_state=0
    ).fit(X)
    assert_array_equal(segmenter.predict(X), segmenter.labels_)
    order = np.random.default_rng(0).permutation(len(X))[:70]
    assert_array_equal(segmenter.predict(X[order]), segmenter.labels_[order])


@pytest.mark.parametrize(
    "cls",
    [MotionSegmenter, MultiModelSpectralClustering, PerSequence, make_motion_pipeline],
)
def test_n_jobs_is_documented_in_scikit_learns_words(cls):
    words = " ".join(cls.__doc__.split())
    assert "``None`` means 1 unless in a :obj:`joblib.parallel_backend`" in words
    assert "``-1`` means using all processors" in words


# ----------------------------------------------------------------------------------- -1


def scene_of_every_kind():
    """Tracks 0 and 1 are seen once, and never with another; some are outliers."""
    X, y = make_rigid_motions(
        80, 6, 2, missing=0, noise=0.1, outliers=0.1, random_state=0
    )
    X = np.hstack([X, np.full((len(X), 6), np.nan)])
    X[0, 2:] = np.nan
    X[1] = np.nan
    X[1, 12:] = [5, 5, 6, 6, 7, 7]  # the only one in the last three frames
    return X, y


def test_reasons_of_minus_one_are_told_apart():
    X, y = scene_of_every_kind()
    segmenter = MotionSegmenter(2, n_hypotheses=200, random_state=0).fit(X)
    reasons = segmenter.label_reasons_
    assert segmenter.labels_[:2].tolist() == [-1, -1]
    assert reasons[:2].tolist() == ["too short", "isolated"]
    assert np.mean(reasons[2:][y[2:] < 0] == "outlier") > 0.5
    assert_array_equal(segmenter.label_reasons_ == "assigned", segmenter.labels_ >= 0)
    report = segmenter.report(X)
    assert report.unassigned["too short"] == report.unassigned["isolated"] == 1
    assert sum(report.unassigned.values()) == report.n_outliers
    assert "1 too short, 1 isolated)" in str(report)


@pytest.mark.parametrize("selection", ["ncre", "eigengap", "self_tuning"])
def test_rules_that_keep_outliers_have_other_reasons(selection):
    X, _ = scene_of_every_kind()
    segmenter = MotionSegmenter(2, selection=selection, **SMALL).fit(X)
    reasons = segmenter.label_reasons_
    assert reasons[:2].tolist() == ["too short", "isolated"]
    assert "outlier" not in reasons


# --------------------------------------------------------------------- fitted geometry


@pytest.mark.parametrize("selection", ["description_length", "ncre"])
@pytest.mark.parametrize("n_landmarks", ["auto", 60])
def test_matrices_residuals_and_inliers_agree(selection, n_landmarks, tracks):
    X, _ = make_rigid_motions(90, 5, 2, missing=0.1, outliers=0.05, random_state=1)
    X = np.insert(X, 4, np.nan, axis=1)
    X = np.insert(X, 5, np.nan, axis=1)  # a frame that sees nothing
    segmenter = MotionSegmenter(
        2, selection=selection, n_landmarks=n_landmarks, **SMALL
    ).fit(X)
    points, visibility = unpack_tracks(X)
    n_pairs = len(segmenter.frame_pairs_)
    assert 2 not in segmenter.frame_pairs_
    assert segmenter.matrices_.shape == (2, n_pairs, 3, 3)
    assert segmenter.residuals_.shape == segmenter.inliers_.shape == (n_pairs, 90)
    for pair, (f, g) in enumerate(segmenter.frame_pairs_):
        for track, label in enumerate(segmenter.labels_):
            found = segmenter.residuals_[pair, track]
            F = segmenter.matrices_[label, pair]
            seen = visibility[track, f] and visibility[track, g]
            if label < 0 or not seen or np.isnan(F).any():
                assert np.isnan(found)
                assert not segmenter.inliers_[pair, track]
                continue
            x, y = (np.append(points[track, i], 1) for i in (f, g))
            line, back = F @ x, F.T @ y
            gradient = np.hypot(np.hypot(*line[:2]), np.hypot(*back[:2]))
            assert_allclose(found, abs(y @ line) / gradient, rtol=1e-3, atol=1e-4)
            within = found <= segmenter.inlier_thresholds_[label]
            assert segmenter.inliers_[pair, track] == within
    assert_allclose(np.linalg.norm(segmenter.matrices_[0, 0]), 1)
    assert segmenter.inliers_[:, segmenter.labels_ == 0].mean() > 0.7


# ------------------------------------------------------------------------------ reports


def test_a_report_gives_numbers_beside_its_text(tracks):
    X, _ = tracks
    segmenter = MotionSegmenter(max_motions=3, **SMALL).fit(X)
    report = segmenter.report(X)
    numbers = json.loads(json.dumps(report.to_dict()))
    assert numbers["motions"][0]["n_tracks"] == report.motions[0].n_tracks
    assert numbers["unassigned"] == report.unassigned
    motions = pd.DataFrame(report.motion_rows()).set_index("label")
    assert motions.n_tracks.sum() + report.n_outliers == len(X)
    assert motions.loc[0, "residual"] == report.motions[0].residual
    counts = pd.DataFrame(report.count_rows()).set_index("n_motions")
    assert_array_equal(counts[list(segmenter.cost_names_)], segmenter.costs_[:, :2])
    assert counts.chosen.sum() == 1


# ------------------------------------------------------------ selection as an estimator


class Halves(ClusterMixin, BaseEstimator):
    """A rule of one's own with nothing but labels: a track and every second other."""

    def fit(self, X, y=None):
        self.labels_ = np.arange(len(X)) % 2
        return self


def test_selection_takes_an_estimator(tracks):
    X, _ = tracks
    named = MotionSegmenter(selection="ncre", fusion="coreg", delta=0.5, **SMALL)
    given = MotionSegmenter(
        selection=NCREModelSelector(fusion="coreg", delta=0.5), **SMALL
    )
    assert_array_equal(named.fit_predict(X), given.fit_predict(X))
    assert isinstance(given.selector_, NCREModelSelector)
    assert given.cost_weights_ == (1, 0.5)
    assert not hasattr(given.selection, "labels_")  # a clone is fitted
    known = given.set_params(n_motions=2, selection__fusion="subset").fit(X)
    assert known.n_motions_ == 2
    clusterer = MotionSegmenter(3, selection=MultiModelSpectralClustering(), **SMALL)
    assert clusterer.fit(X).n_motions_ == 3


def test_a_rule_with_nothing_but_labels_will_do(tracks):
    X, _ = tracks
    segmenter = MotionSegmenter(selection=Halves(), **SMALL).fit(X)
    assert_array_equal(segmenter.labels_, np.arange(60) % 2)
    assert segmenter.report(X).counts[0].chosen
    display = CountDisplay.from_estimator(segmenter)
    assert display.chosen == 2


@pytest.mark.parametrize("make", SELECTORS)
def test_selectors_say_what_their_costs_are(make):
    block = np.kron(np.eye(3), np.ones((4, 4))) + 0.1
    selector = make(max_clusters=4, random_state=0).fit(block)
    assert all(isinstance(name, str) for name in selector.cost_names_)
    weighted = selector.costs_[:, :2] @ selector.cost_weights_
    assert_allclose(weighted, selector.costs_[:, 2], atol=1e-12)
    assert selector.cost_tolerance_ > 0


# ----------------------------------------------------------------- fusions of one's own


def mean_of_views(views, n_clusters):
    """Kernel addition, as a function of one's own."""
    _, vectors = np.linalg.eigh(views.sum(axis=0))
    return np.stack([vectors[:, ::-1][:, :n_clusters]] * len(views))


def test_a_fusion_may_be_a_function(tracks):
    X, y = tracks
    own = MotionSegmenter(2, fusion=mean_of_views, selection="ncre", **SMALL).fit(X)
    assert misclassification_error(y, own.labels_) < 0.05
    by_length = MotionSegmenter(2, fusion=mean_of_views, **SMALL).fit(X)
    assert misclassification_error(y, by_length.labels_) < 0.05
    pipeline = make_motion_pipeline(n_clusters=2, fusion=mean_of_views, **SMALL).fit(X)
    assert_array_equal(pipeline["cluster"].labels_, own.labels_)
    assert_array_equal(pipeline.predict(X) >= 0, own.labels_ >= 0)


def test_a_fusion_may_work_in_place(tracks):
    def in_place(views, n_clusters):
        views **= 2
        return mean_of_views(views, n_clusters)

    def on_a_copy(views, n_clusters):
        return in_place(views.copy(), n_clusters)

    fitted = [
        make_motion_pipeline(fusion=f, max_clusters=4, **SMALL).fit(tracks[0])
        for f in (in_place, on_a_copy)
    ]
    one, other = (each["cluster"].candidate_labels_ for each in fitted)
    assert_array_equal(one, other)


def test_residuals_of_another_number_are_refused_after_fit_too():
    """They would be split otherwise where there are as many columns."""
    fitted, other = (
        HypothesisSampler(n_hypotheses=n, random_state=0).fit_transform(
            make_rigid_motions(60, n_frames, 2, random_state=0)[0]
        )
        for n, n_frames in ((60, 4), (30, 7))
    )
    kernel = ORKKernel().fit(fitted)
    assert other.shape == fitted.shape
    with pytest.raises(ValueError, match=r"fitted to 60 .* residuals of 30"):
        kernel.transform(other)


@pytest.mark.parametrize(
    "fusion, words",
    [
        (lambda views, n: views[:, :, :1], r"got shape \(1, 4, 1\)"),
        (lambda views, n: views[:, :, :n] + 0j, "got dtype complex128"),
        (lambda views, n: views[:, :, :n] * np.nan, "got 8 that are NaN or infinite"),
    ],
)
def test_a_fusion_that_gives_no_embeddings_is_refused(fusion, words):
    clustering = MultiModelSpectralClustering(fusion=fusion)
    with pytest.raises(ValueError, match=rf"a fusion must .*\(1, 4, 2\); {words}"):
        clustering.fit(np.ones((4, 4)))


@pytest.mark.parametrize("scoring", ["accuracy", "f1_macro", "neg_mean_squared_error"])
def test_scorers_that_depend_on_numbers_of_labels_are_refused(scoring):
    with pytest.raises(ValueError, match=f"{scoring!r} depends on the numbers"):
        sequence_scorer(scoring)


def test_what_scores_no_labels_is_refused():
    with pytest.raises(ValueError, match="'roc_auc' is no scorer of labels"):
        sequence_scorer("roc_auc")
    for scoring in (3, None, make_scorer(adjusted_rand_score)):
        with pytest.raises(TypeError, match="the name of a scorer, or a function"):
            sequence_scorer(scoring)


def test_functions_that_are_no_scores_of_a_sequence_are_refused():
    with pytest.raises(ValueError, match=r"more must be better, .* gives 0 for"):
        sequence_scorer(misclassification_error)
    with pytest.raises(ValueError, match=r"make_scorer\(motion_count_accuracy\)"):
        sequence_scorer(motion_count_accuracy)
    with pytest.raises(TypeError, match="a score must be a number; got tuple"):
        sequence_scorer(lambda true, found: (1.0, 0.5))


def test_the_error_of_tracks_is_no_score_of_sequences(sequences):
    scoring = make_scorer(misclassification_error, greater_is_better=False)
    with pytest.raises(ValueError, match="use no scoring"):
        cross_val_score(
            PerSequence(MotionSegmenter(2, **QUICK)),
            *sequences,
            scoring=scoring,
            cv=2,
            error_score="raise",
        )


def test_sequences_may_be_masked_and_of_any_frame(tracks):
    X, _ = tracks
    hidden = np.isnan(X)
    masked = np.ma.MaskedArray(np.where(hidden, 7.0, X), mask=hidden)
    nullable = pd.DataFrame(X).convert_dtypes()
    estimator = PerSequence(MotionSegmenter(2, **QUICK))
    expected, *others = estimator.fit([X]).predict([X, masked, nullable])
    for labels in others:
        assert_array_equal(labels, expected)
    assert_array_equal(unpack_tracks(nullable)[0], unpack_tracks(X)[0])
    assert_array_equal(unpack_tracks(X.astype(object))[0], unpack_tracks(X)[0])


def test_memory_keeps_no_labels_of_seeds_that_are_not_known(tracks, tmp_path):
    X, _ = tracks
    unknown = MotionSegmenter(2, selection="ncre", n_hypotheses=20)
    estimator = PerSequence(unknown, memory=tmp_path)
    with pytest.warns(UserWarning, match="memory has no effect"):
        estimator.fit([X]).predict([X])
    assert not [*tmp_path.rglob("*.pkl")]
    known = make_motion_pipeline(n_clusters=2, n_hypotheses=20, random_state=0)
    sampler = "affinity__affine__sampler__random_state"
    half_known = clone(known).set_params(**{sampler: None})
    with pytest.warns(UserWarning, match=f"memory has no effect .* {sampler} of the"):
        PerSequence(half_known, memory=tmp_path).fit([X]).predict([X])
    assert not [*tmp_path.rglob("*.pkl")]
    PerSequence(known, memory=tmp_path).fit([X]).predict([X])
    assert [*tmp_path.rglob("*.pkl")]


def test_a_pipeline_without_a_seed_draws_anew_in_each_fit(tracks, tmp_path):
    X, _ = tracks

    def drawn(pipeline):
        return pipeline.fit(X)["affinity"]["affine"]["sampler"].hypotheses_

    pipeline = make_motion_pipeline(n_clusters=2, n_hypotheses=20)
    assert not np.array_equal(drawn(pipeline), drawn(pipeline))
    pipeline = make_motion_pipeline(n_clusters=2, n_hypotheses=20, random_state=0)
    assert_array_equal(drawn(pipeline), drawn(pipeline))
    with pytest.warns(UserWarning, match="memory has no effect"):
        make_motion_pipeline(n_clusters=2, memory=tmp_path)


def test_residuals_are_of_the_model_that_was_fitted(tracks):
    X, _ = tracks
    sampler = HypothesisSampler("homography", **SMALL).fit(X)
    expected = sampler.transform(X)
    sampler.set_params(model="fundamental")
    assert_array_equal(sampler.transform(X), expected)


@pytest.mark.parametrize(
    "change", [{"top": 0.5}, {"sparsity": None}, {"covisibility_prior": 0}]
)
def test_affinities_are_by_the_parameters_of_the_fit(change, tracks):
    residuals = HypothesisSampler(**SMALL).fit_transform(tracks[0])
    kernel = ORKKernel()
    expected = kernel.fit_transform(residuals)
    kernel.set_params(**change)
    assert_array_equal(kernel.transform(residuals), expected)
    assert not np.array_equal(kernel.fit_transform(residuals), expected)
