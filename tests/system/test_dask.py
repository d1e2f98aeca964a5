"""A dask cluster of two processes gives the labels of one process, whoever dies."""

from __future__ import annotations

import os
from dataclasses import replace
from threading import Lock

import numpy as np
import pytest
from helpers.films import film
from helpers.mortal import (
    Dies,
    ReportsPoolSizes,
    StaysHere,
    pool_sizes,
    set_pool_sizes,
)
from helpers.own_models import SHIFT, local_shift
from joblib import parallel_config
from numpy.testing import assert_array_equal
from sklearn.model_selection import GridSearchCV, KFold

from skmotionseg import (
    MotionSegmenter,
    ORKKernel,
    PerSequence,
    make_motion_pipeline,
    pack_tracks,
)
from skmotionseg._segmenter import views
from skmotionseg.datasets import make_rigid_motions

distributed = pytest.importorskip(
    "distributed", reason="dask's distributed is not installed"
)
dask_config = pytest.importorskip("dask.config")

pytestmark = pytest.mark.xdist_group("dask")  # one cluster is enough

SMALL = {"n_hypotheses": 50, "random_state": 0}
QUICK = {"selection": "ncre", **SMALL}  # where the rule is beside the point
DOOMED = 31  # tracks of the sequence that kills


@pytest.fixture(scope="module")
def cluster():
    # On a busy machine a worker that was killed takes longer to come back than a
    # cluster waits before it gives it up for good.
    patience = {"distributed.deploy.lost-worker-timeout": "10 minutes"}
    with (
        dask_config.set(patience),
        distributed.LocalCluster(
            n_workers=2,
            threads_per_worker=1,
            processes=True,
            dashboard_address=":0",
        ) as cluster,
        distributed.Client(cluster),
    ):
        yield cluster


@pytest.fixture
def dask(cluster):
    """The engine of joblib, both workers being there."""
    distributed.default_client().wait_for_workers(2, timeout=60)
    with parallel_config(backend="dask"):
        yield distributed.default_client()


@pytest.fixture
def doomed_dask(dask, cluster, monkeypatch):
    """As ``dask``, for a task that kills each worker that it gets, and is given up.

    One a test: when its error is there, none is left that kills workers of the next.
    """
    monkeypatch.setattr(cluster.scheduler, "allowed_failures", 1)
    return dask


@pytest.fixture(scope="module")
def sequences():
    """Short sequences, the third of ``DOOMED`` tracks: (list of X, list of y)."""
    scenes = [
        make_rigid_motions(DOOMED + (seed != 2), 5, 2, random_state=seed)
        for seed in range(5)
    ]
    return [X for X, _ in scenes], [y for _, y in scenes]


def run_here(function):
    with parallel_config(backend="sequential"):
        return function()


def was_run(cluster, name):
    """Whether tasks of that name have been on the cluster."""
    return any(f"of_{name}" in prefix for prefix in cluster.scheduler.task_prefixes)


def assert_same(first, second):
    assert len(first) == len(second)
    for one, other in zip(first, second, strict=True):
        assert_array_equal(one, other)


def test_models_are_fitted_on_the_cluster(scene, dask, cluster, monkeypatch):
    monkeypatch.setattr(views, "TRACKS_PER_BATCH", 20)
    X, _ = scene

    def fit():
        segmenter = MotionSegmenter(max_motions=3, n_jobs=2, **QUICK)
        segmenter.fit(X[::2, :6])
        return segmenter.labels_, segmenter.costs_, segmenter.predict(X[1::2, :6])

    assert_same(fit(), run_here(fit))
    assert was_run(cluster, "fitting the homography model")
    assert was_run(cluster, "placing tracks 0 to 19")


@pytest.mark.parametrize("n_jobs", [None, 2])
def test_sequences_are_segmented_on_the_cluster(n_jobs, sequences, dask, cluster):
    X, y = sequences
    segmenter = MotionSegmenter(max_motions=3, n_jobs=n_jobs, **QUICK)
    estimator = PerSequence(segmenter, n_jobs=n_jobs).fit(X, y)
    assert_same(estimator.predict(X), run_here(lambda: estimator.predict(X)))
    assert estimator.score(X, y) == run_here(lambda: estimator.score(X, y))
    assert was_run(cluster, "segmenting sequence 4")


@pytest.mark.parametrize("backend", ["dask", "skmotionseg-dask"])
def test_settings_are_searched_on_the_cluster(backend, sequences, dask, cluster):
    def fit():
        found = GridSearchCV(
            PerSequence(MotionSegmenter(2, **QUICK)),
            {"estimator__kernel": [ORKKernel(sparsity=2), ORKKernel(sparsity=6)]},
            cv=KFold(2),
            error_score="raise",
        ).fit(*sequences)
        scores = [found.cv_results_[f"split{i}_test_score"] for i in range(2)]
        return [*scores, *found.predict(sequences[0])]

    with parallel_config(backend=backend):
        there = fit()
    assert_same(there, run_here(fit))
    assert was_run(cluster, "_fit_and_score")


def test_caches_are_shared_with_the_workers(sequences, dask, tmp_path):
    X, _ = sequences
    segmenter = MotionSegmenter(2, memory=str(tmp_path), **QUICK)
    estimator = PerSequence(segmenter).fit(X)

    def n_cached():
        return len(list(tmp_path.rglob("output.pkl")))

    there = estimator.predict(X)
    assert n_cached() == 3 * len(X)
    assert_same(there, estimator.predict(X))
    assert_same(there, run_here(lambda: estimator.predict(X)))
    assert n_cached() == 3 * len(X)


def test_workers_have_one_thread_each_while_they_work(sequences, dask):
    dask.run(set_pool_sizes, 2)
    before = dask.run(pool_sizes)
    assert max(max(sizes) for sizes in before.values()) == 2
    reports = PerSequence(ReportsPoolSizes()).fit(sequences[0]).predict(sequences[0])
    assert os.getpid() not in [pid for pid, *_ in reports]
    assert {size for _, *sizes in reports for size in sizes} == {1}
    assert dask.run(pool_sizes) == before


# -------------------------------------------------------------- models of one's own


@pytest.mark.parametrize(
    "make",
    [
        lambda models: PerSequence(MotionSegmenter(2, models=models, **QUICK)),
        lambda models: PerSequence(make_motion_pipeline(models, 2, **SMALL)),
        lambda models: GridSearchCV(
            PerSequence(MotionSegmenter(2, **QUICK)),
            {"estimator__models": [models, models[:1]]},
            cv=KFold(2),
            error_score="raise",
        ),
    ],
    ids=["segmenter", "pipeline", "search"],
)
def test_models_of_ones_own_are_sent_to_workers(make, sequences, dask):
    X, y = (each[:3] for each in sequences)
    there, here = [], []
    for by in (0, 0.5):
        models = [local_shift(by), "homography"]
        there.append(make(models).fit(X, y).predict(X))
        here.append(run_here(lambda models=models: make(models).fit(X, y).predict(X)))
    for one, other in zip(there, here, strict=True):
        assert_same(one, other)
    assert any((a != b).any() for a, b in zip(*here, strict=True))


# ---------------------------------------------------------------------- what goes wrong


def test_a_worker_that_is_killed_costs_no_result(sequences, dask, tmp_path):
    X, _ = sequences
    segmenter = MotionSegmenter(2, **QUICK)
    died = tmp_path / "died"
    estimator = PerSequence(Dies(segmenter, DOOMED, once=died)).fit(X)
    labels = estimator.predict(X)
    assert died.exists()
    assert_same(labels, run_here(lambda: PerSequence(segmenter).fit(X).predict(X)))


def test_a_model_whose_worker_is_killed_is_fitted_again(scene, dask, tmp_path):
    X, _ = scene
    died = tmp_path / "died"
    here = os.getpid()

    def fit(x, y):
        if os.getpid() != here and not died.exists():
            died.touch()
            os.kill(os.getpid(), 9)
        return SHIFT.fit(x, y)

    models = [replace(SHIFT, fit=fit), "homography"]
    segmenter = MotionSegmenter(3, models=models, **QUICK)
    labels = segmenter.fit_predict(X)
    assert died.exists()
    assert_array_equal(labels, run_here(lambda: segmenter.fit_predict(X)))


def test_windows_of_a_worker_that_is_killed_are_segmented_again(
    dask, cluster, tmp_path
):
    movie = film(n_frames=104, n_static=30, n_moving=15)
    X = pack_tracks(movie.points, movie.seen)[movie.seen.sum(axis=1) > 4]
    died = tmp_path / "died"
    here = os.getpid()

    def fit(x, y):
        if os.getpid() != here and not died.exists():
            died.touch()
            os.kill(os.getpid(), 9)
        return SHIFT.fit(x, y)

    models = [replace(SHIFT, fit=fit), "homography"]
    segmenter = MotionSegmenter(2, models=models, n_jobs=2, **QUICK)
    labels = segmenter.fit_predict(X)
    assert died.exists()
    assert was_run(cluster, "segmenting frames 0 to 29")
    assert_array_equal(labels, run_here(lambda: segmenter.fit_predict(X)))


def test_a_task_that_workers_cannot_read_is_named(sequences, dask):
    X, _ = sequences
    with pytest.raises(LookupError, match="stays where it is") as caught:
        PerSequence(StaysHere()).fit(X).predict(X)
    (note,) = caught.value.__notes__
    assert note.startswith("while segmenting sequence ")


def test_a_task_that_cannot_be_sent_is_named(sequences, dask):
    X, _ = sequences
    estimator = PerSequence(Dies(MotionSegmenter(2), DOOMED, once=Lock())).fit(X)
    with pytest.raises(TypeError, match="cannot pickle") as caught:
        estimator.predict(X)
    assert "while sending off for segmenting sequence 0" in caught.value.__notes__


def test_a_sequence_that_fails_is_named(sequences, dask):
    X, _ = sequences
    X = [*X, np.ones((30, 9))]
    estimator = PerSequence(MotionSegmenter(2, **QUICK)).fit(X)
    with pytest.raises(ValueError, match="got 9 columns") as caught:
        estimator.predict(X)
    assert "while segmenting sequence 5" in caught.value.__notes__


# The last two, for they leave a cluster without workers, whose nannies bring new ones.
@pytest.mark.parametrize("as_list", [True, False])
def test_a_search_that_kills_every_worker_ends(as_list, sequences, doomed_dask):
    X, y = sequences
    if not as_list:  # which joblib puts on a worker beforehand
        of_objects = np.empty(len(X), dtype=object)
        of_objects[:] = X
        X = of_objects
    search = GridSearchCV(
        PerSequence(Dies(MotionSegmenter(2, **QUICK), DOOMED)),
        {"estimator__estimator__n_motions": [2]},
        cv=KFold(2),
        error_score="raise",
    )
    with (
        parallel_config(backend="skmotionseg-dask"),
        pytest.raises(distributed.KilledWorker) as caught,
    ):
        search.fit(X, y)
    assert "while running _fit_and_score" in caught.value.__notes__


def test_a_sequence_that_kills_every_worker_is_named(sequences, doomed_dask):
    X, _ = sequences
    estimator = PerSequence(Dies(MotionSegmenter(2, **QUICK), DOOMED)).fit(X)
    with pytest.raises(distributed.KilledWorker) as caught:
        estimator.predict(X)
    # Another one may have been on the same worker each time.
    (note,) = caught.value.__notes__
    tasks = note.removeprefix("while ").split(" or ")
    assert "segmenting sequence 2" in tasks
    assert len(tasks) <= 2
