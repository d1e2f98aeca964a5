"""Partitions by frame pairs: which is chosen, and how it is refined."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.affinities import linked
from numpy.testing import assert_array_equal

from skmotionseg._core.geometry.description_length import clip_geometry
from skmotionseg._core.geometry.tracks import unpack_tracks
from skmotionseg._core.graph.clustering import cluster_graph
from skmotionseg._core.graph.fusion import kernel_addition
from skmotionseg._core.labels import canonical_labels
from skmotionseg._core.partition.clip import Clip
from skmotionseg._core.partition.cost import Cost, Judge
from skmotionseg._core.partition.frame_pair_partitions import (
    _choose,
    _refine,
    frame_pair_partitions,
)
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


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("counts", [[3], range(1, 6)])
def test_refinement_never_raises_the_cost(counts, seed):
    X, y = make_rigid_motions(240, 12, random_state=seed)
    points, visibility = unpack_tracks(X)
    rng = np.random.default_rng(seed)

    def cluster(graph, n_clusters):
        state = np.random.RandomState(seed)
        return cluster_graph(graph, n_clusters, kernel_addition, 20, state)

    views = linked(y)[None] * rng.uniform(0.5, 1)
    clip = Clip(points, visibility, views, (4.0,), cluster)
    start = canonical_labels(np.where(rng.random(len(y)) < 0.1, (y + 1) % 3, y))
    end = _refine(start, clip, np.array(list(counts)))
    assert clip.judge.cost(end).total <= clip.judge.cost(start).total
    assert misclassification_error(y, end) < misclassification_error(y, start)


def in_one(graph, count):
    return np.zeros(graph.n_samples, dtype=int)


def torn_scene():
    """A clip whose background is torn in two, and its labels."""
    X, y = make_rigid_motions(240, 12, random_state=0)
    points, visibility = unpack_tracks(X)
    clip = Clip(points, visibility, linked(y)[None], (4.0,), in_one)
    x = np.nanmean(points[..., 0], axis=1)
    half = (y == 0) & (x > np.median(x[y == 0]))
    return clip, y, canonical_labels(np.where(half, 3, y))


def test_refinement_merges_what_does_not_gain_from_being_apart(monkeypatch):
    clip, y, torn = torn_scene()
    assert torn.max() == 3
    end = _refine(torn, clip, np.arange(1, 5))
    assert misclassification_error(y, end) < 0.05
    assert end.max() == 2
    # No fewer than must be.
    assert _refine(torn, clip, np.array([4])).max() == 3
    # What gains stays apart, though one motion would cost less.
    monkeypatch.setattr(clip.judge, "each_gains", lambda labels: True)
    by_number = {k: Cost(0, 0, float(k)) for k in range(4)}
    monkeypatch.setattr(clip.judge, "cost", lambda labels: by_number[labels.max()])
    assert _refine(torn, clip, np.arange(1, 5)).max() == 3


@pytest.mark.parametrize("changes", [False, True])
def test_what_is_known_of_a_partition_is_not_said_of_another(monkeypatch, changes):
    first, other = np.array([0, 0, 1, 1]), np.array([0, 1, 1, 1])
    best = {2: (Cost(0, 1, 1), first)}
    module = "skmotionseg._core.partition.frame_pair_partitions."
    monkeypatch.setattr(module + "_best_by_count", lambda *_: dict(best))
    monkeypatch.setattr(module + "_choose", lambda *_: (2, {2: (0, 1)}))
    refined = other if changes else first.copy()
    monkeypatch.setattr(module + "_refine", lambda *_: refined)
    clip = SimpleNamespace(judge=SimpleNamespace(cost=lambda _: Cost(0, 0.5, 0.5)))
    found = frame_pair_partitions(clip, np.arange(1, 3))
    assert found.chosen == 2
    assert found.gainless == ({} if changes else {2: (0, 1)})
    assert found.best[2][0].total == (0.5 if changes else 1)
    assert_array_equal(found.best[2][1], refined)
