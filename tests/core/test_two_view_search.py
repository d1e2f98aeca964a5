"""Motions of two images are found, and what each number of them costs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.two_images import two_images
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg._core.geometry.two_views import fit_two_view_motions, two_views
from skmotionseg._core.partition.two_view_energy import assign, settle, two_view_scene
from skmotionseg._core.partition.two_view_search import (
    MARGIN,
    MOST_MOTIONS,
    N_GROWN,
    _different,
    _grown,
    _Search,
    search_two_views,
)
from skmotionseg.metrics import misclassification_error


def test_different_sets_are_taken_in_order():
    sets = np.array([[1, 1, 1, 0], [1, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1]], bool)
    assert _different(sets, 4) == [0, 2]
    assert _different(sets, 1) == [0]
    assert _different(sets[1:], 3) == [0, 1]


def test_a_search_knows_the_costs_of_several_numbers():
    X, true = two_images([40, 30, 20], 60)
    x, y = ((X.reshape(-1, 2, 2) - 300) / 100).swapaxes(0, 1)
    rng = np.random.RandomState(0)
    search = search_two_views(two_views(x, y), np.arange(1, 11), rng)
    costs = {count: found.cost for count, found in search.best.items()}
    assert min(costs, key=costs.get) == 3
    assert {1, 2, 3, 4} <= set(costs) <= set(range(1, MOST_MOTIONS + 1))
    labels = np.where(search.best[3].labels == 3, -1, search.best[3].labels)
    assert misclassification_error(true, labels) < 0.1
    for count, found in search.best.items():
        assert len(found.motions) == count
        assert_allclose(found.shares.sum(axis=0), 1)
    few = two_views(x[:10], y[:10])
    assert search_two_views(few, np.arange(1, 3), rng) is None


def test_motions_are_found_as_long_as_they_pay():
    X, _ = two_images([60, 50, 40, 30], 20)
    x, to = ((X.reshape(-1, 2, 2) - 300) / 100).swapaxes(0, 1)
    search = _Search(two_view_scene(two_views(x, to), 60), np.random.RandomState(0))
    search.find_one_by_one(MOST_MOTIONS, 1)
    costs = {count: found.cost for count, found in search.best.items()}
    assert min(costs, key=costs.get) == 4


@pytest.fixture(scope="module")
def begun():
    """A search in two things and mismatches, and the motions of the things."""
    X, y = two_images([40, 30], 20)
    x, to = ((X.reshape(-1, 2, 2) - 300) / 100).swapaxes(0, 1)
    search = _Search(two_view_scene(two_views(x, to), 60), np.random.RandomState(0))
    views = search.scene.views
    shares = (y == np.arange(2)[:, None]).astype(float)
    motions = fit_two_view_motions(views, shares)
    return search, y, shares, fit_two_view_motions(views, shares, motions)


def test_what_is_grown_gains_what_it_explains_less_what_it_costs(begun):
    search, _, shares, _ = begun
    views, among = search.scene.views, np.arange(90) < 70
    known = np.full(90, views.log_density_of_mismatches) + MARGIN
    motions, gains = _grown(views, shares[::-1], known, among)
    expected = [
        sum(max(nats - old, 0) for nats, old in zip(own, known[:70], strict=True))
        - cost
        for own, cost in zip(
            motions.log_densities(views)[:, :70], motions.costs(views), strict=True
        )
    ]
    assert_allclose(gains, expected)
    assert gains[0] > gains[1] > 0


def test_a_motion_is_proposed_of_what_the_others_do_not_explain(begun):
    search, y, _, motions = begun
    for known in range(2):
        found, gains = search.propose(motions[[known]])
        assert gains[0] > 0
        nats = found[:1].with_mismatches(search.scene.views)
        own = nats[0] > nats[1]
        assert own[y == 1 - known].mean() > 0.9
        assert own[y == known].mean() < 0.2
    _, gains = search.propose(motions)
    assert gains[0] < 0  # there is no third
    among = y == 0
    found, _ = search.propose(None, among, 3)
    assert 1 <= len(found) <= 3
    nats = found[:1].with_mismatches(search.scene.views)
    assert (nats[0] > nats[1])[among].mean() > 0.9


def test_each_motion_is_looked_at_for_two_others_in_it(begun, monkeypatch):
    search, _, _, motions = begun
    search.best = {}
    search.keep(settle(search.scene, motions))
    asked, propose = [], search.propose

    def noted(others, among=None, n_grown=N_GROWN):
        asked.append((len(others), among, n_grown))
        return propose(others, among, n_grown)

    monkeypatch.setattr(search, "propose", noted)
    labels = search.best[2].labels
    search.add_to(2)
    assert [(n, n_grown) for n, _, n_grown in asked] == [
        (2, N_GROWN),
        (1, N_GROWN // 3),
        (2, N_GROWN // 3),
        (1, N_GROWN // 3),
        (2, N_GROWN // 3),
    ]
    assert asked[0][1] is None
    for k, (_, among, _) in enumerate(asked[1:]):
        assert_array_equal(among, labels == k // 2)


def test_motions_that_nothing_follows_are_not_kept(begun):
    search, _, _, motions = begun
    away = replace(motions, affine=motions.affine + 100)
    shares, _ = assign(search.scene, away)
    assert (shares.argmax(axis=0) == 2).all()
    search.best = {}
    assert search.keep(settle(search.scene, motions, np.zeros_like(shares))) is False
    assert search.best == {}
    found = settle(search.scene, motions)
    assert search.keep(found)
    assert not search.keep(found)  # it is there
    assert search.best == {2: found}
    assert not search.take_away(1)
    assert not search.take_away(7)
    assert search.take_away(2)  # there was none of one
    assert set(search.best) == {1, 2}


def test_without_a_motion_nothing_is_found(monkeypatch):
    X, _ = two_images([30])
    x, y = ((X.reshape(-1, 2, 2) - 300) / 100).swapaxes(0, 1)
    module = "skmotionseg._core.partition.two_view_search."
    monkeypatch.setattr(module + "settle", lambda *_: None)
    views, rng = two_views(x, y), np.random.RandomState(0)
    assert search_two_views(views, np.arange(1, 3), rng) is None
