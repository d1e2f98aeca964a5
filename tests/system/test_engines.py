"""Every engine that joblib brings gives the labels of a plain loop."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from helpers.mortal import ReportsPoolSizes
from helpers.own_models import SHIFT, local_shift
from joblib import parallel_config
from numpy.testing import assert_array_equal
from sklearn.model_selection import GridSearchCV, KFold

from skmotionseg import (
    MotionSegmenter,
    ORKKernel,
    PerSequence,
    make_motion_pipeline,
)
from skmotionseg._parallel.engine import run_tasks
from skmotionseg._parallel.tasks import Task
from skmotionseg.datasets import make_rigid_motions

SMALL = {"n_hypotheses": 50, "random_state": 0}
QUICK = {"selection": "ncre", **SMALL}  # where the rule is beside the point

every_engine = pytest.mark.parametrize(
    "engine", ["loky", "multiprocessing", "threading"]
)
# Python 3.12 and later warn of a fork of a process with threads: joblib's
# multiprocessing does that.
pytestmark = pytest.mark.filterwarnings(r"ignore:.*use of fork\(\):DeprecationWarning")


@pytest.fixture(scope="module")
def sequences():
    """Three short sequences: (list of X, list of y)."""
    scenes = [make_rigid_motions(32, 5, 2, random_state=seed) for seed in range(3)]
    return [X for X, _ in scenes], [y for _, y in scenes]


def with_engine(engine, function):
    with parallel_config(backend=engine, n_jobs=2):
        return function()


def assert_same(first, second):
    assert len(first) == len(second)
    for one, other in zip(first, second, strict=True):
        assert_array_equal(one, other)


def fit_half(X):
    segmenter = MotionSegmenter(max_motions=3, **SMALL).fit(X[::2, :8])
    return segmenter.labels_, segmenter.costs_, segmenter.predict(X[1::2, :8])


@pytest.fixture(scope="module")
def half_here(scene):
    return fit_half(scene[0])


@every_engine
def test_models(engine, scene, half_here):
    assert_same(with_engine(engine, lambda: fit_half(scene[0])), half_here)


@pytest.fixture(scope="module")
def sequences_here(sequences):
    """Labels and score of a plain loop."""
    X, y = sequences
    estimator = PerSequence(MotionSegmenter(max_motions=3, **QUICK)).fit(X, y)
    return estimator.predict(X), estimator.score(X, y)


@every_engine
@pytest.mark.parametrize("n_jobs", [None, 2])
def test_sequences(engine, n_jobs, sequences, sequences_here):
    X, y = sequences
    segmenter = MotionSegmenter(max_motions=3, n_jobs=n_jobs, **QUICK)
    estimator = PerSequence(segmenter).fit(X, y)
    labels, score = sequences_here
    assert_same(with_engine(engine, lambda: estimator.predict(X)), labels)
    assert with_engine(engine, lambda: estimator.score(X, y)) == score


@every_engine
def test_searches(engine, sequences):
    def fit():
        found = GridSearchCV(
            PerSequence(MotionSegmenter(2, **QUICK)),
            {"estimator__kernel": [ORKKernel(sparsity=2), ORKKernel(sparsity=6)]},
            cv=KFold(2),
            error_score="raise",
        ).fit(*sequences)
        return [found.cv_results_["mean_test_score"], *found.predict(sequences[0])]

    assert_same(with_engine(engine, fit), fit())


@every_engine
def test_native_pools_are_at_one_thread(engine, sequences):
    X, _ = sequences
    estimator = PerSequence(ReportsPoolSizes()).fit(X)
    reports = with_engine(engine, lambda: estimator.predict(X))
    assert {size for _, *sizes in reports for size in sizes} == {1}


def test_results_come_in_the_order_of_the_tasks():
    tasks = [Task("squaring", pow, number, 2) for number in range(20)]
    assert run_tasks(iter(tasks), n_jobs=2) == [number**2 for number in range(20)]


# -------------------------------------------------------------- models of one's own

MODELS = [SHIFT, "homography"]


@every_engine
@pytest.mark.parametrize("make", [MotionSegmenter, make_motion_pipeline])
def test_models_of_ones_own_are_sent_to_other_processes(engine, make, sequences):
    X, _ = sequences
    params = QUICK if make is MotionSegmenter else SMALL
    estimator = PerSequence(make(models=MODELS, **params)).fit(X)
    assert_same(with_engine(engine, lambda: estimator.predict(X)), estimator.predict(X))


def test_models_of_a_script_are_sent_by_the_default_engine(sequences):
    X, _ = sequences
    models = [local_shift(), "homography"]
    estimator = PerSequence(MotionSegmenter(models=models, **QUICK)).fit(X)
    assert_same(with_engine("loky", lambda: estimator.predict(X)), estimator.predict(X))


def test_a_grid_over_models_of_ones_own_in_two_processes(sequences):
    def fit():
        found = GridSearchCV(
            PerSequence(MotionSegmenter(2, **QUICK)),
            {"estimator__models": [MODELS, ["homography"]]},
            cv=KFold(2),
            error_score="raise",
            n_jobs=2,
        ).fit(*sequences)
        return [found.cv_results_["mean_test_score"], *found.predict(sequences[0])]

    assert_same(with_engine("loky", fit), fit())


def test_the_seed_of_a_model_does_not_depend_on_which_others_there_are(scene):
    X, _ = scene
    other = replace(SHIFT, name="another")
    alone, beside = (
        MotionSegmenter(3, models=models, **QUICK).fit(X).views_["shift"][0].hypotheses_
        for models in ([SHIFT], [other, SHIFT, "affine"])
    )
    assert_array_equal(alone, beside)


def test_a_pickle_brings_models_along(scene, tmp_path):
    X = scene[0][::2, :8]
    segmenter = MotionSegmenter(3, models=MODELS, **SMALL).fit(X)
    restored = pickle.loads(pickle.dumps(segmenter))
    assert restored.models[0] == SHIFT
    assert_array_equal(restored.predict(X[1::2]), segmenter.predict(X[1::2]))


# The last one, after which joblib has to start its workers anew.
@every_engine
def test_a_sequence_that_fails_is_named(engine, sequences):
    X = [*sequences[0], np.ones((30, 9))]
    estimator = PerSequence(MotionSegmenter(2, **QUICK)).fit(X)
    with pytest.raises(ValueError, match="got 9 columns") as caught:
        with_engine(engine, lambda: estimator.predict(X))
    assert "while segmenting sequence 3" in caught.value.__notes__
