"""Groups are merged in the order of their costs."""

from __future__ import annotations

from itertools import combinations, pairwise

import numpy as np
import pytest

from skmotionseg._core.geometry.description_length import (
    clip_geometry,
)
from skmotionseg._core.geometry.tracks import unpack_tracks
from skmotionseg._core.partition.agglomeration import merge_path
from skmotionseg._core.partition.cost import GroupLengths
from skmotionseg.datasets import make_rigid_motions
from skmotionseg.metrics import misclassification_error


def geometry_of(**scene):
    X, y = make_rigid_motions(**scene)
    return clip_geometry(*unpack_tracks(X)), y


def test_merging_an_oversegmentation_finds_the_motions():
    X, y = make_rigid_motions(random_state=2)
    geometry = clip_geometry(*unpack_tracks(X))
    rng = np.random.default_rng(0)
    pieces = np.unique(2 * y + rng.integers(0, 2, len(y)), return_inverse=True)[1]
    affinity = 0.2 + 0.8 * (y[:, None] == y)
    path = list(merge_path(pieces, affinity, GroupLengths(geometry), n_last=3))
    assert [labels.max() + 1 for labels in path] == [6, 5, 4, 3]
    assert misclassification_error(y, path[-1]) == 0


def test_every_step_of_a_merge_joins_two_groups():
    geometry, _ = geometry_of(n_tracks=120, n_frames=6, random_state=0)
    pieces = np.arange(120) % 5
    path = list(merge_path(pieces, np.ones((120, 120)), GroupLengths(geometry), 1))
    for before, after in pairwise(path):
        joined = {(b, a) for b, a in zip(before, after, strict=True)}
        assert len(joined) == before.max() + 1  # no group is torn apart
        assert after.max() == before.max() - 1


def test_tracks_of_no_group_stay_so_in_every_merge():
    geometry, _ = geometry_of(n_tracks=60, n_frames=6, random_state=0)
    pieces = np.arange(60) % 5 - 1
    alone = pieces == -1
    for labels in merge_path(pieces, np.ones((60, 60)), GroupLengths(geometry), 1):
        assert set(labels[alone]) == {-1}
        assert set(labels[~alone]) == set(range(labels.max() + 1))


@pytest.mark.parametrize("across", [0.05, 1])  # with 1, the graph knows nothing
@pytest.mark.parametrize("seed", range(3))
def test_groups_are_merged_in_the_order_of_their_costs(seed, across):
    """The most linked are tried first, until a link alone costs more than the best."""
    X, y = make_rigid_motions(80, 6, 2, random_state=seed)
    rng = np.random.default_rng(seed)
    pieces = np.unique(3 * y + rng.integers(0, 3, 80), return_inverse=True)[1]
    pieces[:2] = -1
    K = rng.uniform(size=(80, 80)) ** 4 * np.where(y[:, None] == y, 1, across)
    K = K + K.T
    K[np.ix_(pieces == 0, pieces == 5)] = K[np.ix_(pieces == 5, pieces == 0)] = 0
    lengths = GroupLengths(clip_geometry(*unpack_tracks(X)))
    groups = [list(np.flatnonzero(pieces == piece)) for piece in range(6)]
    for found in merge_path(pieces, K, lengths, 1):
        assert (found[:2] == -1).all()
        assert {frozenset(np.flatnonzero(found == g)) for g in set(found) - {-1}} == {
            frozenset(group) for group in groups
        }
        if len(groups) == 1:
            break
        costs = {}
        for i, j in combinations(range(len(groups)), 2):
            first, second = (np.array(sorted(groups[k])) for k in (i, j))
            nats = [
                lengths(each).tracks.sum()
                for each in (np.union1d(first, second), first, second)
            ]
            seen = lengths.geometry.seen
            fewer = min(seen[:, first].sum(), seen[:, second].sum())
            link = K[np.ix_(first, second)].mean() / np.sqrt(
                K[np.ix_(first, first)].mean() * K[np.ix_(second, second)].mean()
            )
            rise = (nats[0] - nats[1] - nats[2]) / fewer
            costs[i, j] = -np.log(max(link, 1e-3)), rise
        least = np.inf
        for pair in sorted(costs, key=costs.get):
            if costs[pair][0] >= least:
                break
            if sum(costs[pair]) < least:
                least, (i, j) = sum(costs[pair]), pair
        joined = groups[i] + groups[j]
        groups = [g for k, g in enumerate(groups) if k not in (i, j)] + [joined]
