"""Grids over parameters and models, caches, clones, seeds and workers."""

from __future__ import annotations

import pickle
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from helpers import fourth_model
from helpers.own_models import SHIFT
from helpers.scripts import run_limited
from joblib import Memory, parallel_config
from numpy.testing import assert_array_equal
from sklearn.base import clone
from sklearn.cluster import AgglomerativeClustering
from sklearn.exceptions import NotFittedError
from sklearn.metrics import make_scorer
from sklearn.model_selection import GridSearchCV, KFold, ParameterGrid

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
)
from skmotionseg._segmenter.views import view_seeds
from skmotionseg.datasets import make_rigid_motions
from skmotionseg.metrics import misclassification_error

A, H, F = ALL = ("affine", "homography", "fundamental")
SUBSETS = [(A, H), (H, F), (A, H, F)]
SMALL = {"n_hypotheses": 200, "random_state": 0}
PAPER = {"selection": "ncre", **SMALL}  # of a segmenter

every_selection = pytest.mark.parametrize(
    "selection", ["description_length", "ncre", "eigengap", "self_tuning"]
)
right = make_scorer(misclassification_error, greater_is_better=False)

# joblib warns when a loaded machine takes long to hash its arguments.
pytestmark = pytest.mark.filterwarnings("ignore:Persisting input arguments")


@pytest.fixture(scope="module")
def scene():
    """A small and easy scene of three motions: (X, y)."""
    return make_rigid_motions(60, 6, missing=0.1, noise=0.3, random_state=0)


def whole(X):
    """One split: the search is fitted on the sequence that it is judged on."""
    rows = np.arange(len(X))
    return [(rows, rows)]


def search(estimator, grid, X, y):
    found = GridSearchCV(
        estimator, grid, scoring=right, cv=whole(X), error_score="raise"
    ).fit(X, y)
    assert len(found.cv_results_["params"]) == len(ParameterGrid(grid))
    assert np.isfinite(found.cv_results_["mean_test_score"]).all()
    return found


@pytest.fixture
def fits(monkeypatch):
    """How often each sampler and kernel is fitted."""
    counts = Counter()
    for cls, name in ((HypothesisSampler, "_fit"), (ORKKernel, "_fit_affinity")):
        fit = getattr(cls, name)

        def counted(self, *arguments, cls=cls, fit=fit):
            counts[cls.__name__] += 1
            return fit(self, *arguments)

        monkeypatch.setattr(cls, name, counted)
    return counts


# ------------------------------------------------------------------------- one scene


def test_a_grid_over_the_segmenter(scene):
    grid = [
        {"fusion": ["coreg"], "lam": [1e-3, 1e-1], "models": SUBSETS},
        {"fusion": ["subset"], "gamma": [1e-3, 1e-1], "models": SUBSETS},
    ]
    found = search(MotionSegmenter(3, **PAPER), grid, *scene)
    assert found.best_score_ > -0.05
    assert set(found.best_params_["models"]) <= set(ALL)


def test_a_grid_over_the_count_of_the_segmenter(scene):
    grid = [
        {"delta": [0, 0.2], "max_motions": [2, 4], "models": SUBSETS[1:]},
        {"selection": ["description_length"], "max_motions": [4], "models": [ALL]},
    ]
    X, y = scene
    found = search(MotionSegmenter(**PAPER), grid, X[:, :6], y)
    assert found.best_estimator_.n_motions_ <= found.best_params_["max_motions"]


def test_a_grid_that_drops_branches(scene):
    grid = [
        {"affinity__affine": ["drop"], "cluster__lam": [1e-3, 1e-1]},
        {"affinity__fundamental": ["drop"], "cluster__lam": [1e-3, 1e-1]},
        {"cluster__fusion": ["subset"], "cluster__gamma": [1e-3, 1e-1]},
    ]
    pipeline = make_motion_pipeline(n_clusters=3, fusion="coreg", **SMALL)
    assert search(pipeline, grid, *scene).best_score_ > -0.05


def test_a_grid_over_delta_and_the_fusion_inside_the_selector(scene):
    grid = {
        "cluster__delta": [0, 0.2, 1],
        "cluster__fusion": ["coreg", "subset"],
        "cluster__lam": [1e-3, 1e-1],
        "affinity__affine": ["drop"],
    }
    found = search(make_motion_pipeline(max_clusters=4, **SMALL), grid, *scene)
    n_clusters = found.best_estimator_["cluster"].n_clusters_
    assert found.best_estimator_["cluster"].labels_.max() + 1 == n_clusters


def test_delta_sets_the_price_of_a_motion(scene):
    X, _ = scene
    few, many = (
        MotionSegmenter(delta=delta, **PAPER).fit(X).n_motions_ for delta in (0, 100)
    )
    assert few == 1 < many


@pytest.mark.parametrize("models", SUBSETS, ids=" ".join)
@pytest.mark.parametrize("fusion", ["kernel_addition", "coreg", "subset"])
def test_dropping_a_branch_is_leaving_out_its_model(scene, models, fusion):
    X, _ = scene
    params = {"fusion": fusion, **SMALL}
    dropped = make_motion_pipeline(n_clusters=3, **params).set_params(
        **{f"affinity__{model}": "drop" for model in ALL if model not in models}
    )
    expected = make_motion_pipeline(models, n_clusters=3, **params).fit_predict(X)
    assert_array_equal(dropped.fit_predict(X), expected)


@pytest.mark.parametrize("models", SUBSETS, ids=" ".join)
@pytest.mark.parametrize("count", [3, "auto"])
def test_the_pipeline_is_the_papers_segmenter_taken_apart(scene, models, count):
    X, _ = scene
    params = {"models": models, "fusion": "coreg", "delta": 0.5}
    labels = MotionSegmenter(count, **params, **PAPER).fit_predict(X)
    pipeline = make_motion_pipeline(n_clusters=count, sparsity=6, **params, **SMALL)
    assert_array_equal(pipeline.fit_predict(X), labels)


def test_models_of_ones_own_have_hypotheses_of_their_own(scene):
    X, _ = scene
    twin = replace(SHIFT, name="twin")
    both, alone = (
        MotionSegmenter(3, models=models, **PAPER).fit(X).views_
        for models in ((SHIFT, twin, A), (twin,))
    )
    drawn = {name: sampler.hypotheses_ for name, (sampler, _) in both.items()}
    assert not np.array_equal(drawn["shift"], drawn["twin"])
    # Whichever others there are, and in every process.
    assert_array_equal(alone["twin"][0].hypotheses_, drawn["twin"])
    seeds = view_seeds(np.random.RandomState(0), [SHIFT, twin])
    assert (seeds["shift"], seeds["twin"]) == (1264577200, 1445088919)
    built_in = view_seeds(np.random.RandomState(0), [])
    assert seeds.items() >= built_in.items()
    assert built_in.keys() == {*ALL, "clustering"}


def test_another_built_in_model_changes_no_result_of_the_default(capsys):
    fourth_model.main("as it is")
    printed, errors = capsys.readouterr()
    assert errors.strip() == "unknown"
    # The table must have it before anything that reads it is imported.
    after = run_limited("fourth_model.py", "more", seconds=120)
    assert after.returncode == 0, after.stderr
    assert after.stderr.strip() == "other affine"
    assert after.stdout == printed


# --------------------------------------------------------------------- many sequences


@pytest.fixture(scope="module")
def sequences():
    """Four short sequences of two motions: (list of X, list of y)."""
    scenes = [
        make_rigid_motions(n_tracks=50, n_frames=6, n_motions=2, random_state=seed)
        for seed in range(4)
    ]
    return [X for X, _ in scenes], [y for _, y in scenes]


def test_one_setting_for_many_sequences(sequences):
    grid = {
        "estimator__models": SUBSETS[1:],
        "estimator__lam": [1e-3, 1e-1],
        "estimator__kernel__sparsity": [3, 6],
    }
    estimator = PerSequence(
        MotionSegmenter(2, fusion="coreg", kernel=ORKKernel(), **PAPER)
    )
    found = GridSearchCV(estimator, grid, cv=KFold(2), error_score="raise")
    found.fit(*sequences)
    scores = found.cv_results_["mean_test_score"]
    assert len(scores) == 8
    assert scores.max() > 0.9
    assert found.best_score_ == scores.max()
    assert [len(labels) for labels in found.predict(sequences[0])] == [50] * 4


def test_one_count_rule_for_many_sequences(sequences):
    grid = [
        {"estimator__delta": [0, 0.2], "estimator__gamma": [1e-3, 1e-1]},
        {"estimator__selection": ["description_length"]},
    ]
    estimator = PerSequence(MotionSegmenter(fusion="subset", max_motions=3, **PAPER))
    found = GridSearchCV(estimator, grid, cv=KFold(2), error_score="raise")
    X, y = sequences
    X, y = [x[::2, :6] for x in X[:2]], [each[::2] for each in y[:2]]
    assert 0 < found.fit(X, y).best_score_ <= 1


def test_one_setting_for_pipelines_that_drop_a_branch(sequences):
    pipeline = make_motion_pipeline(n_clusters=2, fusion="coreg", **SMALL)
    grid = {
        "estimator__affinity__affine": ["drop", pipeline["affinity"][A]],
        "estimator__cluster__lam": [1e-3, 1e-1],
    }
    found = GridSearchCV(PerSequence(pipeline), grid, cv=KFold(2), error_score="raise")
    assert found.fit(*sequences).best_score_ > 0.9


def test_the_score_is_one_minus_the_mean_error(sequences):
    X, y = sequences
    estimator = PerSequence(MotionSegmenter(2, **PAPER)).fit(X, y)
    errors = [
        misclassification_error(labels, MotionSegmenter(2, **PAPER).fit_predict(x))
        for x, labels in zip(X, y, strict=True)
    ]
    assert estimator.score(X, y) == 1 - np.mean(errors)


def test_sequences_may_differ_in_tracks_and_frames(sequences):
    X, y = sequences
    X, y = [X[0], X[1][:40, :8]], [y[0], y[1][:40]]
    estimator = PerSequence(MotionSegmenter(2, **PAPER)).fit(X, y)
    for labels, x in zip(estimator.predict(X), X, strict=True):
        assert_array_equal(labels, MotionSegmenter(2, **PAPER).fit_predict(x))


# ------------------------------------------------------------------------------ cache

SWEEPS = {
    "lam": ({"fusion": "coreg", "n": 3}, {"lam": [1e-3, 1e-2, 1e-1]}),
    "gamma": ({"fusion": "subset", "n": 3}, {"gamma": [1e-3, 1e-2, 1e-1]}),
    "delta": ({"fusion": "kernel_addition", "n": "auto"}, {"delta": [0, 0.2, 1]}),
}


def pipeline_to_sweep(swept, **options):
    params, grid = SWEEPS[swept]
    pipeline = make_motion_pipeline(
        n_clusters=params["n"], fusion=params["fusion"], **options, **SMALL
    )
    return pipeline, {f"cluster__{name}": values for name, values in grid.items()}


@pytest.mark.parametrize("swept", SWEEPS)
def test_a_sweep_fits_each_branch_once_with_memory_in_the_branches(
    swept, scene, fits, tmp_path
):
    pipeline, grid = pipeline_to_sweep(swept, memory=str(tmp_path))
    search(pipeline, grid, *scene)
    assert fits == {"HypothesisSampler": 3, "ORKKernel": 3}


@pytest.mark.parametrize("swept", SWEEPS)
def test_a_sweep_fits_each_branch_once_with_memory_outside(
    swept, scene, fits, tmp_path
):
    pipeline, grid = pipeline_to_sweep(swept)
    search(pipeline.set_params(memory=str(tmp_path)), grid, *scene)
    assert fits == {"HypothesisSampler": 3, "ORKKernel": 3}


@pytest.mark.parametrize("swept", SWEEPS)
@pytest.mark.parametrize("as_memory", [str, lambda path: Memory(path, verbose=0)])
def test_a_sweep_fits_each_branch_once_with_a_segmenter(
    swept, as_memory, scene, fits, tmp_path
):
    params, grid = SWEEPS[swept]
    segmenter = MotionSegmenter(
        params["n"], fusion=params["fusion"], memory=as_memory(tmp_path), **PAPER
    )
    search(segmenter, grid, *scene)
    assert fits == {"HypothesisSampler": 3, "ORKKernel": 3}


@every_selection
def test_models_are_swept_from_the_same_three_branches(
    selection, scene, fits, tmp_path
):
    segmenter = MotionSegmenter(3, memory=str(tmp_path), selection=selection, **SMALL)
    grid = [{"models": SUBSETS[:2]}, {"n_motions": [2]}, {"fusion": ["coreg"]}]
    X, y = scene
    search(segmenter, grid, X[:, :6], y)
    assert fits == {"HypothesisSampler": 3, "ORKKernel": 3}


def test_branches_are_dropped_from_the_same_three(scene, fits, tmp_path):
    pipeline = make_motion_pipeline(n_clusters=3, memory=str(tmp_path), **SMALL)
    grid = [{f"affinity__{model}": ["drop"]} for model in ALL]
    search(pipeline, [{"cluster__clusterer__n_init": [20]}, *grid], *scene)
    assert fits == {"HypothesisSampler": 3, "ORKKernel": 3}


def test_without_memory_every_setting_fits_every_branch(scene, fits):
    pipeline, grid = pipeline_to_sweep("lam")
    search(pipeline, grid, *scene)
    assert fits["HypothesisSampler"] == fits["ORKKernel"] == 3 * (3 + 1)  # and refit


def test_a_sweep_over_the_kernel_draws_the_hypotheses_once(scene, fits, tmp_path):
    pipeline, _ = pipeline_to_sweep("lam", memory=str(tmp_path))
    search(pipeline, {"affinity__affine__kernel__top": [0.05, 0.1, 0.2]}, *scene)
    assert fits == {"HypothesisSampler": 3, "ORKKernel": 3 + 2}


@pytest.mark.parametrize("other", [{"random_state": 1}, {"n_hypotheses": 100}])
def test_another_setting_is_not_taken_from_the_cache(scene, fits, tmp_path, other):
    for params in (PAPER, PAPER | other):
        MotionSegmenter(3, memory=str(tmp_path), **params).fit(scene[0][:, :6])
    assert fits == {"HypothesisSampler": 6, "ORKKernel": 6}


def test_views_of_other_code_are_not_taken_from_the_cache(
    scene, fits, tmp_path, monkeypatch
):
    segmenter = MotionSegmenter(3, memory=str(tmp_path), **PAPER)
    segmenter.fit(scene[0][:, :6])
    monkeypatch.setattr("skmotionseg._utils.caching.__version__", "another")
    segmenter.fit(scene[0][:, :6])
    assert fits == {"HypothesisSampler": 6, "ORKKernel": 6}


def test_workers_find_again_what_this_process_has_kept(scene, tmp_path):
    segmenter = MotionSegmenter(3, memory=str(tmp_path), **PAPER).fit(scene[0])
    kept = {*tmp_path.rglob("output.pkl")}
    with parallel_config("loky", n_jobs=2, max_nbytes=100):  # maps all larger arrays
        segmenter.fit(scene[0])
    assert len(kept) == 3 and {*tmp_path.rglob("output.pkl")} == kept


def test_the_cache_changes_no_label(scene, tmp_path):
    X = scene[0][:, :6]
    plain = MotionSegmenter(3, **SMALL).fit(X)
    for _ in range(2):  # computed, then read
        cached = MotionSegmenter(3, memory=str(tmp_path), **SMALL).fit(X)
        assert_array_equal(cached.labels_, plain.labels_)
        assert_array_equal(cached.predict(X), plain.predict(X))


# --------------------------------------------------- clone, set_params, pickle, repr

ESTIMATORS = [
    HypothesisSampler(F, n_hypotheses=7, frame_gap=2, random_state=1),
    ORKKernel(n_hypotheses=7, top=0.3, sparsity=None, covisibility_prior=1),
    MultiModelSpectralClustering(3, fusion="subset", gamma=0.5, random_state=1),
    NCREModelSelector(MultiModelSpectralClustering(lam=0.5), delta=0.7),
    EigengapModelSelector(MultiModelSpectralClustering(lam=0.5), min_clusters=2),
    SelfTuningModelSelector(max_clusters=7, random_state=1),
    MotionSegmenter(3, models=(A, F), n_hypotheses=7, selection="ncre"),
    PerSequence(MotionSegmenter(2), n_jobs=2),
]
every_estimator = pytest.mark.parametrize(
    "estimator", ESTIMATORS, ids=lambda e: type(e).__name__
)


@every_estimator
def test_a_clone_has_the_parameters_and_nothing_else(estimator):
    copy = clone(estimator)
    assert copy is not estimator
    assert repr(copy.get_params()) == repr(estimator.get_params())
    assert not [name for name in vars(copy) if name.endswith("_")]


@every_estimator
def test_parameters_are_set_by_name(estimator):
    for name, value in estimator.get_params(deep=False).items():
        assert getattr(clone(estimator).set_params(**{name: value}), name) is value
    with pytest.raises(ValueError, match="Invalid parameter 'colour'"):
        clone(estimator).set_params(colour="red")


@every_estimator
def test_the_repr_makes_the_estimator(estimator):
    assert repr(eval(repr(estimator))) == repr(estimator)


@pytest.mark.parametrize(
    "estimator",
    [
        MotionSegmenter(2, **SMALL),
        MotionSegmenter(max_motions=3, **PAPER),
        make_motion_pipeline(n_clusters=2, **SMALL),
    ],
    ids=["segmenter", "count unknown", "pipeline"],
)
def test_a_fitted_estimator_survives_pickling(estimator, scene):
    X = scene[0][:, :6]
    estimator = clone(estimator).fit(X)
    restored = pickle.loads(pickle.dumps(estimator))
    assert_array_equal(restored.predict(X), estimator.predict(X))
    with pytest.raises(NotFittedError):
        clone(restored).predict(X)


# ------------------------------------------------------------------- seeds and workers


@every_selection
@pytest.mark.parametrize("n_motions", [3, "auto"])
def test_a_seed_gives_its_labels_with_any_number_of_workers(
    scene, n_motions, selection
):
    X = scene[0][:, :6]
    params = {"selection": selection, "max_motions": 4, **SMALL}
    alone, shared = (
        MotionSegmenter(n_motions, n_jobs=n_jobs, **params).fit_predict(X)
        for n_jobs in (1, 2)
    )
    assert_array_equal(alone, shared)


def test_another_seed_draws_other_hypotheses(scene):
    X, _ = scene
    first, second = (
        MotionSegmenter(
            3, models=[H], selection="ncre", n_hypotheses=50, random_state=seed
        )
        .fit(X)
        .views_[H][0]
        .hypotheses_
        for seed in (0, 1)
    )
    assert (first != second).any()


def test_workers_change_no_label_of_the_pipeline(scene):
    X = scene[0][:, :6]
    alone, shared = (
        make_motion_pipeline(n_clusters=3, n_jobs=n_jobs, **SMALL).fit_predict(X)
        for n_jobs in (1, 2)
    )
    assert_array_equal(alone, shared)


def test_workers_change_no_label_of_a_sequence(sequences):
    X, _ = sequences
    alone, shared = (
        PerSequence(MotionSegmenter(2, **PAPER), n_jobs=n_jobs).fit(X).predict(X)
        for n_jobs in (1, 2)
    )
    assert_array_equal(np.stack(alone), np.stack(shared))


@pytest.mark.parametrize("model", ALL)
def test_hypotheses_of_a_model_do_not_depend_on_the_others(scene, model):
    X, _ = scene
    alone, together, backwards = (
        MotionSegmenter(3, models=models, **PAPER).fit(X).views_[model]
        for models in ([model], ALL, ALL[::-1])
    )
    for other in (together, backwards):
        assert_array_equal(alone[0].hypotheses_, other[0].hypotheses_)
        assert_array_equal(alone[1].thresholds_, other[1].thresholds_)


# ---------------------------------------------------------------------- held-out tracks


@pytest.mark.parametrize("fusion", ["kernel_addition", "coreg", "subset"])
@pytest.mark.parametrize("make", [MotionSegmenter, make_motion_pipeline])
def test_held_out_tracks_get_their_motion(make, fusion):
    X, y = make_rigid_motions(n_tracks=120, n_frames=6, random_state=0)
    held_out = np.arange(len(X)) % 3 == 0
    count = {"n_motions" if make is MotionSegmenter else "n_clusters": 3}
    estimator = make(fusion=fusion, **count, **SMALL)
    placed = np.empty_like(y)
    placed[~held_out] = estimator.fit_predict(X[~held_out])
    assert misclassification_error(y[~held_out], placed[~held_out]) < 0.05
    placed[held_out] = estimator.predict(X[held_out])
    assert misclassification_error(y, placed) < 0.05
    assert misclassification_error(y[held_out], placed[held_out]) < 0.05


@every_selection
@pytest.mark.parametrize("n_motions", [3, "auto"])
def test_fitted_tracks_are_placed_where_they_were(scene, n_motions, selection):
    X = scene[0][:, :6]
    segmenter = MotionSegmenter(
        n_motions, max_motions=4, selection=selection, **SMALL
    ).fit(X)
    assert (segmenter.predict(X) == segmenter.labels_).all()


# ------------------------------------------------- clusterers and models of others


def test_ncre_with_another_clusterer_keeps_the_contract_on_labels(scene):
    affinity = make_motion_pipeline(["homography"], 3, **SMALL)[0].fit_transform(
        scene[0]
    )
    affinity[:2], affinity[:, :2] = 0, 0  # two tracks that meet no other
    clusterer = AgglomerativeClustering(metric="precomputed", linkage="average")
    selector = NCREModelSelector(clusterer, min_clusters=2, max_clusters=5)
    labels = selector.fit_predict(affinity)
    assert set(labels[:2]) == {-1}
    sizes = np.bincount(labels[2:])
    assert (np.diff(sizes) <= 0).all()
    assert selector.n_clusters_ == len(sizes)
    assert not hasattr(selector, "predict")


def test_the_order_of_models_does_not_matter(scene):
    X = scene[0][:, :6]
    first = MotionSegmenter(3, models=ALL, fusion="subset", **SMALL).fit(X)
    other = MotionSegmenter(3, models=ALL[::-1], fusion="subset", **SMALL).fit(X)
    assert list(first.views_) == list(other.views_) == list(ALL)
    assert_array_equal(first.costs_, other.costs_)


def test_a_model_of_ones_own_is_handed_over(scene):
    X, y = scene
    before = MotionSegmenter(3, models=[H], **PAPER).fit_predict(X)
    segmenter = MotionSegmenter(3, models=[SHIFT, H], **SMALL).fit(X)
    assert list(segmenter.views_) == ["shift", H]
    assert misclassification_error(y, segmenter.labels_) < 0.1
    pipeline = make_motion_pipeline([SHIFT, H], 3, **SMALL)
    assert misclassification_error(y, pipeline.fit_predict(X)) < 0.1
    # It changes nobody else's seeds.
    assert_array_equal(MotionSegmenter(3, models=[H], **PAPER).fit_predict(X), before)


def test_a_grid_over_models_of_ones_own(scene, tmp_path):
    grid = {"models": [[SHIFT, H], [H], [SHIFT]]}
    search(MotionSegmenter(3, memory=str(tmp_path), **PAPER), grid, *scene)


def test_a_model_in_the_place_of_a_known_one_has_its_seed(scene):
    X, _ = scene
    homography = MotionModel.built_in(H)
    named, given, replaced = (
        MotionSegmenter(3, models=[model], **PAPER).fit(X).views_[H][0].hypotheses_
        for model in (H, homography, replace(homography))
    )
    assert_array_equal(named, given)
    assert_array_equal(named, replaced)


def test_one_model_may_be_named_by_itself(scene):
    alone = MotionSegmenter(3, models=H, **PAPER).fit_predict(scene[0])
    listed = MotionSegmenter(3, models=[H], **PAPER).fit_predict(scene[0])
    assert_array_equal(alone, listed)


def test_limits_of_a_search_do_not_bind_a_known_count(scene):
    segmenter = MotionSegmenter(3, min_motions=11, **PAPER)
    assert segmenter.fit(scene[0][:, :6]).n_motions_ == 3


def test_memory_may_be_a_path(scene, tmp_path):
    MotionSegmenter(2, memory=tmp_path / "cache", **PAPER).fit(scene[0])
    assert (tmp_path / "cache").is_dir()
