"""Partitions are searched, and one of them is chosen."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from skmotionseg._core.geometry.description_length import clip_geometry
from skmotionseg._core.geometry.tracks import unpack_tracks
from skmotionseg._core.graph.clustering import cluster_graph
from skmotionseg._core.graph.fusion import kernel_addition
from skmotionseg._core.labels import canonical_labels
from skmotionseg._core.partition.cost import Cost, Judge
from skmotionseg._core.partition.rigid_search import Step
from skmotionseg._core.partition.search import _choose, _Clip, _distinct, _refine
from skmotionseg.datasets import make_rigid_motions
from skmotionseg.metrics import misclassification_error


@pytest.fixture
def judged():
    """A scene, its judge on a graph with few links between motions, and the truth."""
    X, y = make_rigid_motions(random_state=0)
    graph = np.where(y[:, None] == y, 1, 0.02)
    return Judge(clip_geometry(*unpack_tracks(X)), graph[None]), y


def test_a_partition_is_chosen_only_if_its_motions_gain(judged):
    judge, y = judged
    halves = np.random.default_rng(0).integers(0, 2, len(y))
    torn = np.where(y == 0, 3 * halves, y)  # the background torn in two
    one = np.zeros_like(y)
    assert judge.each_gains(y)
    assert not judge.each_gains(torn)
    assert judge.each_gains(one)  # there is no pair
    assert judge.gainless_pair(torn) == (0, 3)  # the halves of the background
    best = {1: one, 3: y, 4: torn}
    best = {n: (Cost(0, 5 - n, 5 - n), labels) for n, labels in best.items()}
    assert _choose(best, judge) == (3, {4: (0, 3)})
    assert _choose({4: best[4]}, judge) == (4, {})  # there is no other
    none_gains = {4: best[4], 5: best[4]}
    assert _choose(none_gains, judge) == (4, {4: (0, 3), 5: (0, 3)})


def scene_with(outliers, seed=0, n_frames=12, **scene):
    X, y = make_rigid_motions(
        240, n_frames, outliers=outliers, random_state=seed, **scene
    )
    return X, y, unpack_tracks(X)


def linked(y, within=1.0, across=0.02):
    """An affinity that knows the motions; rubbish is linked to all alike."""
    affinity = np.where(y[:, None] == y, within, across)
    affinity[y < 0] = affinity[:, y < 0] = 0.2
    return affinity


# ------------------------------------------------------------------- refinement


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("counts", [[3], range(1, 6)])
def test_refinement_never_raises_the_cost(counts, seed):
    _, y, (points, visibility) = scene_with(0, seed)
    rng = np.random.default_rng(seed)
    clip = _Clip(points, visibility, linked(y)[None] * rng.uniform(0.5, 1), (4.0,))

    def cluster(graph, n_clusters):
        state = np.random.RandomState(seed)
        return cluster_graph(graph, n_clusters, kernel_addition, 20, state)

    start = canonical_labels(np.where(rng.random(len(y)) < 0.1, (y + 1) % 3, y))
    end = _refine(start, clip, np.array(list(counts)), cluster)
    assert clip.judge.cost(end).total <= clip.judge.cost(start).total
    assert misclassification_error(y, end) < misclassification_error(y, start)


@pytest.mark.parametrize("larger, smaller", [(0, 2), (2, 0)])
def test_of_two_similar_motions_the_smaller_may_be_a_part(larger, smaller):
    sizes = np.full(3, 6)
    sizes[[larger, smaller]] = 9, 7
    step = Step(0.0, np.repeat(range(3), sizes), [], (0, 2), np.log(4))
    expected = np.ones(3)
    expected[smaller] = 0.8
    assert_allclose(_distinct(step), expected)
    assert_allclose(_distinct(Step(0.0, np.zeros(5, dtype=int), [])), [1])
