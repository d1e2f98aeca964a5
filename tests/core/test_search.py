"""Partitions are searched, and one of them is chosen."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.affinities import linked
from helpers.two_images import two_images
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg._core.geometry.tracks import unpack_tracks
from skmotionseg._core.graph.clustering import cluster_graph
from skmotionseg._core.graph.cuts import own_shares
from skmotionseg._core.graph.fusion import kernel_addition
from skmotionseg._core.partition import search
from skmotionseg._core.partition.clip import sparse_views
from skmotionseg._core.partition.cost import Cost
from skmotionseg._core.partition.rigid_partitions import RigidPartitions
from skmotionseg._core.partition.rigid_search import NATS_OF_LINKS, Step
from skmotionseg._core.partition.search import (
    _distinct,
    _Found,
    _rigid_costs,
    _segments_of,
    _with_nearest,
    search_partitions,
)
from skmotionseg.datasets import make_rigid_motions
from skmotionseg.metrics import misclassification_error


def test_over_segments_are_those_that_consist_of_some_tracks_mostly():
    labels = np.repeat([0, 1, 2], [6, 5, 4])
    clip = SimpleNamespace(
        points=np.zeros((15, 2, 2)),
        sparse=[np.equal.outer(labels, labels).astype(float)[None]],
        over_segments=lambda graph: labels.copy(),
    )
    some = np.isin(np.arange(15), [0, 1, 2, 6, 7, 8, 11, 12, 13, 14])
    found = _segments_of(clip, some)
    assert_array_equal(found, np.repeat([-1, 0, 1], [6, 5, 4]))
    none = _segments_of(clip, np.zeros(15, dtype=bool))
    assert_array_equal(none, np.full(15, -1))


def test_tracks_that_were_left_out_are_in_the_motion_of_their_nearest():
    tracks, labels = np.array([0, 2, 3, 5, 6]), np.array([1, 1, 0, 0, 0])
    affinity = np.eye(8)
    affinity[1, [0, 2]] = affinity[4, [2, 3]] = 0.2, 0.5
    affinity[7, 1] = affinity[1, 7] = 1  # only to one that was left out
    one = np.zeros(5, dtype=int)
    found = _Found({1: (Cost(0, 1, 1), one), 2: (Cost(0, 2, 2), labels)}, 2, {}, {})
    best = _with_nearest(found, tracks, affinity).best
    assert_array_equal(best[1][1], np.zeros(8))
    assert_array_equal(best[2][1], [1, 1, 1, 0, 0, 0, 0, 0])
    assert [cost for cost, _ in best.values()] == [Cost(0, 1, 1), Cost(0, 2, 2)]


class _Doubts:
    """Explains a clip by which of its tracks, 0 to n, are doubtful: those named."""

    def __init__(self, names, doubtful, of=None):
        self.names, self.doubted, self.of = names, doubtful, of

    def doubtful(self, points, visibility, labels):
        return np.isin(self.names, self.doubted)

    def among(self, points, visibility):
        return _Doubts(self.names, self.doubted, of=len(points))


@pytest.mark.parametrize(
    ("doubted", "nothing_after", "searched", "left"),
    [
        ([[]], None, [100], 100),
        ([[5, 6, 7]], None, [100], 100),  # 3 % are few
        ([range(10), range(10, 13), range(10, 12)], None, [100, 90, 87], 87),
        ([range(9), range(10, 20), range(20, 30), range(30, 40)], None,
         [100, 91, 81, 71], 71),
        ([range(10), range(10, 20)], 1, [100], 100),
        ([range(10), range(10, 20)], 2, [100, 90], 90),
    ],
)  # fmt: skip
def test_motions_are_searched_again_without_doubtful_tracks(
    monkeypatch, doubted, nothing_after, searched, left
):
    """Until few are doubtful, or the rest tells little; three times at most."""
    sizes = []

    def clip_of(names):
        n = len(names)
        return SimpleNamespace(
            names=names,
            points=np.zeros((n, 4, 2)),
            visibility=np.ones((n, 4), dtype=bool),
            views=np.ones((1, n, n)),
            affinity=np.ones((n, n)),
            of=lambda kept: clip_of(names[kept]),
        )

    def by_rigid_motion(clip, counts, focal_length, starts=()):
        if len(sizes) == nothing_after:
            return None
        if sizes:  # what was found before is where the search begins again
            (start,) = starts
            assert_array_equal(start, clip.names < 50)
        sizes.append(len(clip.names))
        labels = (clip.names < 50).astype(int)
        return _Found({2: (Cost(0, 1, 1), labels)}, 2, {}, {})

    def explain(clip, found):
        return _Doubts(clip.names, list(doubted[min(len(sizes), len(doubted)) - 1]))

    monkeypatch.setattr(search, "_by_rigid_motion", by_rigid_motion)
    monkeypatch.setattr(search, "_explain", explain)
    found, explanation = search._by_motions(clip_of(np.arange(100)), [2], None)
    assert sizes == searched
    assert len(explanation.names) == left
    # What is an outlier is decided for all tracks, and each has a label.
    assert explanation.of == (None if left == 100 else 100)
    labels = found.best[2][1]
    kept = explanation.names
    assert_array_equal(labels[kept], kept < 50)
    assert len(labels) == 100 and (labels >= 0).all()


@pytest.mark.parametrize("larger, smaller", [(0, 2), (2, 0)])
def test_of_two_similar_motions_the_smaller_may_be_a_part(larger, smaller):
    sizes = np.full(3, 6)
    sizes[[larger, smaller]] = 9, 7
    step = Step(0.0, np.repeat(range(3), sizes), [], (0, 2), np.log(4))
    expected = np.ones(3)
    expected[smaller] = 0.8
    assert_allclose(_distinct(step), expected)
    assert_allclose(_distinct(Step(0.0, np.zeros(5, dtype=int), [])), [1])


def alone_in(n_tracks, alone, y):
    """Two views in which some tracks have no affinity to another."""
    rng = np.random.default_rng(0)
    views = np.stack([linked(y), linked(y, 0.6, 0.1)]) * rng.uniform(
        0.5, 1, (2, n_tracks, n_tracks)
    )
    views = (views + views.swapaxes(1, 2)) / 2
    views[:, alone], views[:, :, alone] = 0, 0
    views[:, alone, alone] = 1  # but to themselves
    return views


def by_kernels(graph, n_clusters):
    state = np.random.RandomState(0)
    return cluster_graph(graph, n_clusters, kernel_addition, 20, state)


def test_tracks_without_affinity_to_another_have_no_label():
    """Too few tracks for rigid motion: frame pairs are asked."""
    X, y = make_rigid_motions(36, 6, random_state=0)
    alone = np.array([0, 17, 35])
    views = alone_in(36, alone, y)
    found = search_partitions(
        *unpack_tracks(X), views, np.arange(1, 4), (2.0, 4.0), by_kernels
    )
    assert found.labels.shape == (len(found.counts), 36)
    others = np.setdiff1d(np.arange(36), alone)
    assert (found.labels[:, alone] == -1).all()
    assert (found.labels[:, others] >= 0).all()
    assert (found.shares[alone] == 0).all()
    # The shares are those in the sparsest graph.
    small = views[:, others[:, None], others]
    expected = own_shares(sparse_views(small, 4.0), found.labels[found.best, others])
    assert_allclose(found.shares[others], expected)
    assert not np.allclose(
        expected,
        own_shares(sparse_views(small, 2.0), found.labels[found.best, others]),
    )
    # Nor do they change what is found in the others.
    points, visibility = (each[others] for each in unpack_tracks(X))
    without = search_partitions(
        points, visibility, small, np.arange(1, 4), (2.0, 4.0), by_kernels
    )
    assert_array_equal(without.labels, found.labels[:, others])
    assert_allclose(without.costs, found.costs)


def test_tracks_of_two_images_without_affinity_have_no_label():
    X, y = two_images([30, 25], 15)
    alone = np.array([3, 69])
    views = alone_in(70, alone, np.maximum(y, 0))
    points, seen = X.reshape(-1, 2, 2), np.ones((70, 2), dtype=bool)
    found = search_partitions(points, seen, views, np.arange(1, 4), (2.0,), None)
    others = np.setdiff1d(np.arange(70), alone)
    assert (found.labels[:, alone] == -1).all()
    assert (found.labels[:, others] >= 0).all()
    assert (found.shares[alone] == 0).all() and (found.shares[others] > 0).all()
    assert not found.outliers[alone].any()
    labels = np.where(found.outliers, -1, found.labels[found.best])
    assert misclassification_error(y[others], labels[others]) < 0.1


def windows_in_which(left):
    """Windows in which tracks are so far from their motion, in a 1280 pixel video."""
    return SimpleNamespace(
        own_deviations=lambda motions, groups, relative: np.full(len(groups), left),
        pixels=640.0,
        size=1280.0,
    )


def test_costs_of_rigid_motions_and_which_are_distinct():
    labels = np.repeat([0, 1, 2], [7, 3, 2])
    steps = {
        1: Step(0.0, np.zeros(12, dtype=int), ["a"]),
        2: Step(0.0, np.minimum(labels, 1), ["a", "b"], (0, 1), np.log(3)),
        3: Step(0.0, labels, ["a", "b", "c"], (1, 2), -np.log(4)),
    }
    terms = {1: (0.0, 5.0), 2: (0.1, 2.0), 3: (0.25, 1.5)}
    windows = windows_in_which(0.0)
    search = SimpleNamespace(
        windows=windows, terms=lambda labels, motions: terms[len(motions)]
    )
    found = _rigid_costs(search, RigidPartitions(steps, 2))
    for count, (cut, nats) in terms.items():
        cost, own = found.best[count]
        assert cost == (cut, nats, NATS_OF_LINKS * cut + nats)
        assert own is steps[count].labels
    assert found.log_odds == {2: np.log(3), 3: -np.log(4)}
    assert found.gainless == {3: (1, 2)}  # the number that was passed over
    assert found.rigid == (windows, ["a", "b"])
    assert_allclose(found.distinct, [1, 0.75])
    # Where the number is given, nobody asks.
    alone = _rigid_costs(search, RigidPartitions({2: steps[2]}, 2))
    assert alone.distinct is None


@pytest.mark.parametrize("left, pixels", [(1.0, 0.0), (2.0, 4.0)])
def test_what_motions_do_not_explain_is_in_pixels_of_the_video(left, pixels):
    step = Step(0.0, np.repeat([0, 1], 6), ["a", "b"], (0, 1), np.log(3))
    search = SimpleNamespace(
        windows=windows_in_which(left / 640), terms=lambda *_: (0.0, 5.0)
    )
    found = _rigid_costs(search, RigidPartitions({2: step}, 2))
    assert found.unexplained == pytest.approx(pixels)
