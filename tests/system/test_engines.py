"""Every engine that joblib brings gives the labels of a plain loop."""

from __future__ import annotations

import pickle
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from helpers.mortal import ReportsPoolSizes
from joblib import parallel_config
from numpy.testing import assert_array_equal
from sklearn.model_selection import GridSearchCV, KFold

from skmotionseg import MotionSegmenter, PerSequence, make_motion_pipeline
from skmotionseg._core.geometry.motion_models import (
    MOTION_MODELS,
    added_motion_models,
    receive_motion_models,
    translation_map,
)
from skmotionseg._parallel.engine import run_tasks
from skmotionseg._parallel.tasks import Task
from skmotionseg.datasets import make_rigid_motions

SMALL = {"n_hypotheses": 50, "random_state": 0}

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


@every_engine
def test_models(engine, scene):
    X, _ = scene

    def fit():
        segmenter = MotionSegmenter(max_motions=4, **SMALL).fit(X[::2])
        return segmenter.labels_, segmenter.costs_, segmenter.predict(X[1::2])

    assert_same(with_engine(engine, fit), fit())


@every_engine
@pytest.mark.parametrize("n_jobs", [None, 2])
def test_sequences(engine, n_jobs, sequences):
    X, y = sequences
    segmenter = MotionSegmenter(max_motions=3, n_jobs=n_jobs, **SMALL)
    estimator = PerSequence(segmenter).fit(X, y)
    assert_same(with_engine(engine, lambda: estimator.predict(X)), estimator.predict(X))
    there = with_engine(engine, lambda: estimator.score(X, y))
    assert there == estimator.score(X, y)


@every_engine
def test_searches(engine, sequences):
    def fit():
        found = GridSearchCV(
            PerSequence(MotionSegmenter(2, selection="ncre", **SMALL)),
            {"estimator__sparsity": [2, 6]},
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


@every_engine
def test_a_sequence_that_fails_is_named(engine, sequences):
    X = [*sequences[0], np.ones((30, 9))]
    estimator = PerSequence(MotionSegmenter(2, **SMALL)).fit(X)
    with pytest.raises(ValueError, match="got 9 columns") as caught:
        with_engine(engine, lambda: estimator.predict(X))
    assert "while segmenting sequence 3" in caught.value.__notes__


def test_results_come_in_the_order_of_the_tasks():
    tasks = [Task("squaring", pow, number, 2) for number in range(20)]
    assert run_tasks(iter(tasks), n_jobs=2) == [number**2 for number in range(20)]


# -------------------------------------------------------------- models of one's own

MODELS = ["translation", "homography"]


def translation(shift=0):
    """A model that no other process can import."""

    def fit(x, y):
        return translation_map((y - x)[..., 0, :] + shift)

    return replace(MOTION_MODELS["affine"], name="translation", minimal_size=1, fit=fit)


@every_engine
@pytest.mark.parametrize("make", [MotionSegmenter, make_motion_pipeline])
def test_models_of_ones_own_are_known_in_other_processes(
    engine, make, sequences, monkeypatch
):
    X, _ = sequences
    monkeypatch.setitem(MOTION_MODELS, "translation", translation())
    estimator = make(models=MODELS, **SMALL)
    estimator = PerSequence(estimator).fit(X)
    assert_same(with_engine(engine, lambda: estimator.predict(X)), estimator.predict(X))


def test_models_of_this_process_stay_and_those_received_are_replaced(monkeypatch):
    mine, first, second = (translation(shift) for shift in range(3))
    monkeypatch.setitem(MOTION_MODELS, "mine", mine)
    monkeypatch.setitem(MOTION_MODELS, "theirs", mine)  # to be undone
    del MOTION_MODELS["theirs"]
    for model in (first, second):
        receive_motion_models({"mine": model, "theirs": model})
        assert MOTION_MODELS["mine"] is mine
        assert MOTION_MODELS["theirs"] is model
    assert added_motion_models() == {"mine": mine, "theirs": second}


def test_seeds_of_ones_own_models_depend_on_their_names_alone(scene, monkeypatch):
    X, _ = scene
    labels = []
    for before in ([], ["another"]):
        with monkeypatch.context() as patch:
            for name in [*before, "translation"]:
                model = replace(translation(), name=name)
                patch.setitem(MOTION_MODELS, name, model)
            segmenter = MotionSegmenter(3, models="translation", **SMALL).fit(X)
            labels.append(segmenter.branches_["translation"][0].hypotheses_)
    assert_array_equal(*labels)


def test_a_pickle_brings_models_along(scene, tmp_path, monkeypatch):
    X, _ = scene
    monkeypatch.setitem(MOTION_MODELS, "translation", translation())
    segmenter = MotionSegmenter(3, models=MODELS, **SMALL).fit(X)
    np.save(tmp_path / "X.npy", X)
    (tmp_path / "segmenter").write_bytes(pickle.dumps(segmenter))
    code = (
        "import pickle, sys, numpy as np\n"
        "segmenter = pickle.load(open('segmenter', 'rb'))\n"
        "print(*segmenter.predict(np.load('X.npy')))"
    )
    command = [sys.executable, "-c", code]
    printed = subprocess.run(
        command, capture_output=True, text=True, check=True, cwd=tmp_path
    ).stdout
    assert_array_equal(np.array(printed.split(), dtype=int), segmenter.predict(X))
