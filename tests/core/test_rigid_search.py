"""Rigid motions of groups: fits, assignment, and what partitions cost."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.rigid_scenes import (
    done,
    exact_street,
    linked_scene,
    search_of,
)
from numpy.testing import assert_array_equal

from skmotionseg._core.geometry.windows import FOCAL_STEPS, Windows
from skmotionseg._core.partition.rigid_partitions import rank
from skmotionseg._core.partition.rigid_search import (
    NATS_OF_LABELS,
    SCALE_OF_NOISE,
    RigidSearch,
    Step,
    _energy,
)
from skmotionseg._core.partition.side_by_side import run, side_by_side
from skmotionseg.metrics import misclassification_error


@pytest.fixture(scope="module")
def scene():
    return linked_scene()


@pytest.fixture(scope="module")
def street():
    return exact_street()


def test_the_truth_costs_less_than_the_truth_disturbed(scene):
    y, search = scene[-1], search_of(scene)
    search.calibrate(y)
    motions = done(search, search.motions(y))
    truth = search.energy(y, motions)
    rng = np.random.RandomState(0)
    for share in (0.05, 0.2):
        wrong = y.copy()
        some = rng.random(len(y)) < share
        wrong[some] = rng.randint(y.max() + 1, size=some.sum())
        assert search.energy(wrong, motions) > truth


def test_settling_mends_labels_and_never_costs_more(scene):
    y, search = scene[-1], search_of(scene)
    search.calibrate(y)
    rng = np.random.RandomState(1)
    wrong = y.copy()
    some = rng.random(len(y)) < 0.1
    wrong[some] = rng.randint(y.max() + 1, size=some.sum())
    before = search.energy(wrong, done(search, search.motions(wrong)))
    settled = done(search, search.settled(wrong))
    labels, motions = settled.labels, settled.motions
    assert settled.energy <= before
    assert settled.energy == pytest.approx(search.energy(labels, motions))
    assert misclassification_error(y, labels) < 0.03


@pytest.mark.parametrize(("share", "bounded"), [(0.3, False), (0.6, True)])
def test_many_outliers_do_not_count_as_noise(scene, share, bounded):
    """What they leave is told, but is no scale where most of a group are outliers."""
    points, visibility, affinity, y = scene
    rng = np.random.RandomState(0)
    wrong = rng.random(len(y)) < share
    steps = 5 * rng.standard_normal((wrong.sum(), *points.shape[1:]))
    walks = points.copy()
    walks[wrong] = np.nanmean(points[wrong], axis=1)[:, None] + steps.cumsum(axis=1)
    search = search_of((walks, visibility, affinity, y))
    search.calibrate(y)
    assert (search.noise > 1.0) == bounded
    scale = search.scale * search.windows.pixels
    if bounded:
        assert scale < 1.5 * search.noise
    else:
        assert scale == pytest.approx(SCALE_OF_NOISE * search.noise)


def test_what_no_motion_explains_becomes_a_group(scene):
    """Tracks that a partition gave to the background, whose motion is not theirs."""
    y, search = scene[-1], search_of(scene)
    search.calibrate(y)
    without = np.where(y == y.max(), 0, y)
    motions = done(search, search.motions(y))
    tried = list(search.unexplained(without, motions[:-1]))
    shares = [np.mean(y[each == each.max()] == y.max()) for each in tried]
    assert max(shares) > 0.8


def test_a_group_gets_its_motion_from_that_of_another(scene):
    """Of one motion, and a few of another, whose motion they begin with."""
    y, search = scene[-1], search_of(scene)
    search.calibrate(y)
    motions = done(search, search.motions(y))
    labels = np.where((y == 1) & (np.cumsum(y == 1) < 6), 0, y)
    wrong = [motions[1], *motions[1:]]
    energy = search.energy(labels, done(search, search._refitted(labels, motions)))
    again = search.energy(labels, done(search, search._refitted(labels, wrong)))
    assert again == pytest.approx(energy, rel=0.02)


def test_a_focal_length_that_is_given_is_kept(scene):
    points, visibility, affinity, y = scene
    search = RigidSearch(Windows(points, visibility), affinity, focal_length=0.77)
    assert search.calibrate(y)
    assert not search.calibrate(y)
    assert search.windows.focal_length == 0.77


def test_a_focal_length_is_found_from_motions_by_another(street):
    points, visibility, y, true = street
    search = RigidSearch(Windows(points, visibility, 2.0), np.ones((len(y), len(y))))
    motions = done(search, search.motions(y))
    assert search.calibrate(y, FOCAL_STEPS, motions)
    assert abs(np.log(search.windows.focal_length / true)) < 0.05


def test_partitions_cost_more_if_labels_tell_much():
    """Of the same energy, the one that takes a few tracks from many is the best."""
    few, half = (np.repeat([0, 1], sizes) for sizes in ([7, 1], [4, 4]))
    cost = rank(Step(_energy(few, 0.0, 1.0), few, [], log_odds=0.0), decided=False)
    shares = np.array([7, 1]) / 8
    assert cost == pytest.approx(1 - NATS_OF_LABELS * (shares @ np.log(shares)))
    torn = rank(Step(_energy(half, 0.0, 1.0), half, [], log_odds=0.0), decided=False)
    assert torn == pytest.approx(1 + NATS_OF_LABELS * np.log(2))


def test_what_fits_two_motions_alike_is_of_the_larger(scene):
    search, n_tracks = search_of(scene), len(scene[0])
    labels = np.where(np.arange(n_tracks) < 10, 1, 0)
    nothing = np.zeros((n_tracks, 2))
    assigned, _ = search._assigned(nothing, labels, nothing, sweeps=1)
    assert_array_equal(assigned, 0)
    by_label = 1.01 * NATS_OF_LABELS * np.log((n_tracks - 10) / 10)
    costs = by_label * (labels[:, None] != [0, 1])
    assigned, _ = search._assigned(costs, labels, nothing, sweeps=1)
    assert_array_equal(assigned, labels)


def test_searches_side_by_side_find_what_they_find_alone(scene):
    """Their fits share batches, which are padded to the largest of their groups.

    Motions that are known are left out: of these, there are more side by side.
    """
    y = scene[-1]
    rng = np.random.RandomState(2)
    wrong = np.stack([y, y, y])
    for labels, share in zip(wrong, (0.05, 0.1, 0.2), strict=True):
        some = rng.random(len(y)) < share
        labels[some] = rng.randint(y.max() + 1, size=some.sum())
    search = search_of(scene)
    search.calibrate(y)
    together = side_by_side(map(search.settled, wrong))
    together = run(together, search.windows.found)
    for labels, settled in zip(wrong, together, strict=True):
        other = search_of(scene)
        other.calibrate(y)
        alone = run(other.settled(labels), other.windows.found)
        np.testing.assert_array_equal(settled.labels, alone.labels)
        assert settled.energy == pytest.approx(alone.energy, rel=1e-9)
        for one, again in zip(settled.motions, alone.motions, strict=True):
            np.testing.assert_allclose(one.squares, again.squares, rtol=1e-6)


def test_a_fit_is_made_once(scene, monkeypatch):
    y, search = scene[-1], search_of(scene)
    made = []
    found = search.windows.found
    monkeypatch.setattr(
        search.windows, "found", lambda fits: made.extend(fits) or found(fits)
    )
    one, other = search.run(search.motions(y), search.motions(y))
    (third,) = search.run(search.motions(y))
    assert len(made) == y.max() + 1
    assert all(a is b is c for a, b, c in zip(one, other, third, strict=True))
