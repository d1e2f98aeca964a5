"""What a partition costs, and which of its motions gain from being apart."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import plain_geometry as plain
from helpers import textbook
from numpy.testing import assert_allclose

from skmotionseg._core.geometry.description_length import (
    DescriptionLength,
    clip_geometry,
)
from skmotionseg._core.geometry.tracks import unpack_tracks
from skmotionseg._core.graph.cuts import cuts_between
from skmotionseg._core.labels import groups_of
from skmotionseg._core.partition import cost as cost_module
from skmotionseg._core.partition.cost import CUT_WEIGHT, GroupLengths, Judge
from skmotionseg.datasets import make_rigid_motions


def geometry_of(**scene):
    X, y = make_rigid_motions(**scene)
    return clip_geometry(*unpack_tracks(X)), y


def test_lengths_are_computed_once(monkeypatch):
    geometry, y = geometry_of(n_tracks=60, n_frames=4, random_state=0)
    calls, nothing = [], DescriptionLength(np.zeros(1), 0.0, np.zeros(1, dtype=bool))
    monkeypatch.setattr(
        "skmotionseg._core.partition.cost.description_lengths",
        lambda geometry, groups, _: calls.extend(groups) or [nothing] * len(groups),
    )
    lengths = GroupLengths(geometry)
    lengths.know(groups_of(y)[:1] * 2)
    lengths.of_partition(y)
    lengths.of_partition(y)
    assert len(calls) == len(groups_of(y))


@pytest.fixture(params=range(3))
def scene(request):
    """Two motions with gaps: (points, visibility, labels)."""
    X, y = make_rigid_motions(60, 7, 2, missing=0.3, random_state=request.param)
    return *unpack_tracks(X), y


def plain_length(geometry, members):
    """The nats of a group, tracks in each pair and models, in loops."""
    errors = []
    for k in range(len(geometry.seen)):
        rows = np.flatnonzero((geometry.pair == k) & np.isin(geometry.track, members))
        errors.append(plain.robust_fundamental(geometry.x[rows], geometry.y[rows])[1])
    return plain.description_length(errors, geometry.log_range, geometry.model_share)


def test_gains_are_of_pairs_in_which_both_have_a_model(scene):
    points, visibility, labels = scene
    visibility = visibility.copy()
    visibility[np.flatnonzero(labels == 1)[7:], 3:5] = False
    geometry = clip_geometry(points, visibility)
    first, second = (np.flatnonzero(labels == motion) for motion in (0, 1))
    n_first, n_second = (geometry.seen[:, each].sum(axis=1) for each in (first, second))
    both = (n_first >= 8) & (n_second >= 8)
    assert both.any()
    assert not both.all()
    apart = [plain_length(geometry, each)[0] for each in (first, second)]
    together = plain_length(geometry, np.arange(60))[0]
    saved = sum(together[k] - apart[0][k] - apart[1][k] for k in np.flatnonzero(both))
    smaller = min(n_first[both].sum(), n_second[both].sum())
    lengths = GroupLengths(geometry)
    assert lengths.gain(first, second) == pytest.approx(saved / smaller, rel=1e-3)
    assert lengths.gain(second, first) == pytest.approx(saved / smaller, rel=1e-3)


def test_the_cost_is_the_mean_length_and_the_weighted_cut(scene):
    points, visibility, labels = scene
    geometry = clip_geometry(points, visibility)
    rng = np.random.default_rng(0)
    views = rng.uniform(size=(2, 60, 60)) * (0.2 + (labels[:, None] == labels))
    views = views + views.swapaxes(1, 2)
    judge = Judge(geometry, views)
    cost = judge.cost(labels)
    cut = sum(textbook.normalized_cut(view, labels) for view in views)
    lengths = [
        sum(each(np.flatnonzero(labels == motion)).total for motion in (0, 1))
        for each in judge.lengths
    ]
    nats = np.mean(lengths) / geometry.seen.sum()
    assert_allclose(cost, [cut, nats, CUT_WEIGHT * cut + nats])


@pytest.mark.parametrize("stratified", [False, True])
def test_motions_gain_so_many_times_their_cut(scene, stratified, monkeypatch):
    points, visibility, labels = scene
    rng = np.random.default_rng(0)
    views = rng.uniform(size=(2, 60, 60)) * (0.2 + (labels[:, None] == labels))
    views = views + views.swapaxes(1, 2)
    judge = Judge(clip_geometry(points, visibility), views, stratified)
    groups = [np.flatnonzero(labels == motion) for motion in (0, 1)]
    gain = max(each.gain(*groups) for each in judge.lengths)
    cut = sum(cuts_between(view, labels)[0, 1] for view in judge.views)
    names = ["GAIN_OF_CUT", "GAIN_OF_CUT_DRAWN"]
    mine, other = names[::-1] if stratified else names
    monkeypatch.setattr(cost_module, other, np.nan)
    for share, pair in ((0.999, None), (1.001, (0, 1))):
        monkeypatch.setattr(cost_module, mine, share * gain / cut)
        assert judge.gainless_pair(labels) == pair
        assert judge.each_gains(labels) == (pair is None)


def test_a_gain_is_that_of_the_pairs_in_which_both_have_a_model():
    X, y = make_rigid_motions(n_tracks=100, n_motions=2, missing=0, random_state=0)
    first, second = np.flatnonzero(y == 0), np.flatnonzero(y == 1)
    few = second[:7]
    assert gain_of(X, first, second) > 1
    assert gain_of(X, first, few) == 0  # no pair in which seven have a model
    apart = X.copy()
    apart[first, 20:] = np.nan
    apart[second, :20] = np.nan
    assert gain_of(apart, first, second) == np.inf
    # Where the second is seen eight times or more it is judged, and only there.
    rare = X.copy()
    rare[second[7:], 20:] = np.nan
    early = np.where(np.arange(40) < 20, X, np.nan)
    late = gain_of(rare, first, second), gain_of(early, first, second)
    assert late[0] == pytest.approx(late[1], rel=0.5)


def gain_of(X, first, second):
    return GroupLengths(clip_geometry(*unpack_tracks(X))).gain(first, second)
