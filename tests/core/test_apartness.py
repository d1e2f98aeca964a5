"""Which groups are different motions."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.rigid_scenes import (
    before_a_camera_that_drives,
    before_a_still_camera,
    done,
    linked_scene,
    search_of,
)
from numpy.testing import assert_allclose

from skmotionseg._core.geometry.windows import FEWEST_TRACKS, Windows
from skmotionseg._core.labels import groups_of
from skmotionseg._core.partition.apartness import (
    FEW_TRACKS,
    FEWEST_LINKS,
    MOST_CROSS,
    Pair,
    evidence,
)
from skmotionseg._core.partition.rigid_partitions import (
    with_odds,
)
from skmotionseg._core.partition.rigid_search import (
    RigidSearch,
)


@pytest.fixture(scope="module")
def scene():
    return linked_scene()


def least_apart(search, labels):
    """The two groups of labels that are least apart, and how they compare."""
    motions = done(search, search.motions(labels))
    return done(search, search.comparisons.least_apart(labels, motions))


def test_halves_of_a_motion_are_one_and_motions_are_apart(scene):
    points, y, search = scene[0], scene[-1], search_of(scene)
    search.calibrate(y)
    background = np.flatnonzero(y == 0)
    x = np.nanmean(points[background], axis=1)[:, 0]
    torn = y.copy()
    torn[background[x > np.median(x)]] = y.max() + 1
    pair, least = least_apart(search, torn)
    assert set(pair) == {0, y.max() + 1}
    assert max(least.log_odds, least.distance) < 0
    _, whole = least_apart(search, y)
    assert whole.log_odds > 1
    assert whole.distance > 2


def test_halves_of_a_motion_without_links_are_likely_one(scene):
    """By their links, their distance says that they are two; their odds do not."""
    points, visibility, affinity, y = scene
    background = np.flatnonzero(y == 0)
    x = np.nanmean(points[background], axis=1)[:, 0]
    labels = (x > np.median(x)).astype(int)
    links = affinity[np.ix_(background, background)] * (labels[:, None] == labels)
    search = RigidSearch(Windows(points[background], visibility[background]), links)
    search.calibrate(labels)
    step = done(search, with_odds(search, done(search, search.settled(labels))))
    assert step.distance > 0 > step.log_odds


def test_outliers_in_groups_do_not_link_them(scene):
    """They may be linked to anything, and belong to no motion."""
    points, visibility, affinity, y = scene
    rng = np.random.RandomState(2)
    wild = np.flatnonzero(rng.random(len(y)) < 0.15)
    points, affinity = points.copy(), affinity.copy()
    points[wild] += 15 * rng.standard_normal(points[wild].shape).cumsum(axis=1)
    affinity[wild] = affinity[:, wild] = 0.5
    search = RigidSearch(Windows(points, visibility), affinity)
    search.calibrate(y)
    pair, found = least_apart(search, y)
    groups = [np.flatnonzero(y == k) for k in pair]
    assert found.links < 0.2 * search.links.between(*groups)
    assert found.log_odds > 0


def test_evidence_grows_with_all_that_tells_motions_apart():
    nothing = 0.0, 1.0, 0.0, 0.0, FEW_TRACKS
    least = evidence(20, *nothing)
    assert_allclose(evidence(20, -1.0, *nothing[1:]), least)
    assert_allclose(evidence(20, *nothing[:-1], 10 * FEW_TRACKS), least)
    for k, value in enumerate([2, 0, 1, 1, FEW_TRACKS // 2]):
        more = evidence(20, *nothing[:k], value, *nothing[k + 1 :]) - least
        assert more[k] > 0
        assert_allclose(np.delete(more, k), 0, atol=1e-12)
    known = 1.0, 1 - FEWEST_LINKS, 0.25, 2.0, FEW_TRACKS / 3
    told = [np.log(20) * np.log(2), 0, 0.5, 2.0, np.log(3)]
    assert_allclose(evidence(20, *known), told)


def test_more_links_than_by_chance_say_no_more():
    by_chance, many = (evidence(20, 1.0, links, 0, 0, 50) for links in (1.0, 30.0))
    assert_allclose(many, by_chance)


def test_a_gain_says_more_of_two_large_groups_than_of_small_ones():
    few, many = (evidence(size, 1.0, 1.0, 0, 0, 50) for size in (10, 100))
    assert_allclose(many[0], 2 * few[0])
    none, of_none = (evidence(size, 0.0, 1.0, 0, 0, 50) for size in (10, 100))
    assert_allclose(of_none, none)


def test_motions_are_apart_by_how_badly_either_explains_the_other(scene):
    """Of two halves of a motion, each explains the other; of two motions, neither."""
    y, search = scene[-1], search_of(scene)
    search.calibrate(y)
    halves = y.copy()
    halves[np.flatnonzero(y == 0)[::2]] = y.max() + 1
    motions, groups = done(search, search.motions(halves)), groups_of(halves)

    def cross(i, j):
        pair = Pair(i, j, (groups[i], groups[j]), (motions[i], motions[j]))
        swapped = Pair(j, i, pair.groups[::-1], pair.motions[::-1])
        assert search.comparisons._cross(pair) == search.comparisons._cross(swapped)
        return search.comparisons._cross(pair)

    half = y.max() + 1
    assert cross(half, 0) < 0.3
    assert 1 < cross(half, 1) <= MOST_CROSS
    assert 1 < cross(1, 0) <= MOST_CROSS

    def nats(track, motion):
        squares = motion.squares[track] / search.windows.variances[track]
        freedom = search.windows.freedom[track][~np.isnan(squares)].sum()
        mean = np.nansum(squares) / freedom if freedom else np.nan
        return np.log(1 + mean / search.scale**2)

    def plainly(group, own, other):
        worse = [nats(track, other) - nats(track, own) for track in group]
        worse = [min(max(each, 0), MOST_CROSS) for each in worse if not np.isnan(each)]
        return sum(worse) / len(worse)

    both = plainly(groups[0], *motions[:2]), plainly(groups[1], *motions[1::-1])
    assert_allclose(cross(1, 0), min(both))


@pytest.mark.parametrize("common, log_odds", [(FEWEST_TRACKS - 1, 1), (20, -1)])
def test_groups_are_compared_where_enough_of_both_are_seen(scene, common, log_odds):
    """Of two halves of a motion that is seen at other times, links alone tell."""
    points, visibility, affinity, y = scene
    one = np.flatnonzero(y == 0)
    first, second = one[::2], one[1::2]
    visibility = visibility.copy()
    visibility[first, 6:] = visibility[second, :6] = False
    visibility[first[:common]] = visibility[second[:common]] = True
    affinity = affinity.copy()
    affinity[np.ix_(first, second)] = affinity[np.ix_(second, first)] = 0
    search = RigidSearch(Windows(points, visibility), affinity)
    halves = y.copy()
    halves[second] = y.max() + 1
    search.calibrate(y)
    motions = done(search, search.motions(halves))
    pair = Pair(1, 0, (first, second), (motions[0], motions[-1]))
    (found,) = done(search, search.comparisons._apartnesses([pair]))
    assert log_odds * found.log_odds > 0
    assert (found.log_odds == found.distance) == (common < FEWEST_TRACKS)


def test_what_moves_before_a_still_camera_is_apart():
    """One rigid motion explains both: the one at infinity, and the other near."""
    scene = before_a_still_camera(np.random.RandomState(5))
    y, search = scene[-1], search_of(scene)
    search.calibrate(y)
    _, found = least_apart(search, y)
    assert found.gain < 0.5
    assert found.far > 0.5
    assert found.log_odds > 0


def test_what_drives_away_from_a_moving_camera_is_apart():
    """One rigid motion would explain both, were not one of them behind the camera."""
    scene = before_a_camera_that_drives(np.random.RandomState(7))
    y, search = scene[-1], search_of(scene)
    search.calibrate(y)
    _, found = least_apart(search, y)
    assert found.gain > 3
    assert found.log_odds > 0


def test_the_gain_is_of_deviations_that_are_not_relative_to_speed(scene):
    """And those of a motion's own tracks are made larger by the parameters' part."""
    y, search = scene[-1], search_of(scene)
    search.calibrate(y)
    groups = [np.flatnonzero(y == k) for k in (0, 1)]
    own = search.windows.fit(groups)
    windows, alike = search.windows, (0.1 / search.windows.pixels) ** 2
    totals = []
    for joint in own:
        total = 0.0
        for group, motion in zip(groups, own, strict=True):
            apart, known = windows.deviations(motion, group, relative=False)
            together, also = windows.deviations(joint, group, relative=False)
            apart = (apart * windows.shrinkage(motion, group)) ** 2 + alike
            both = (known > 0) & (also > 0)
            total += np.log((together**2 + alike) / apart)[both].sum()
        totals.append(total)
    gain, joint = search.comparisons._gain(groups, own, own)
    assert_allclose(gain, min(totals) / min(map(len, groups)))
    assert joint is own[int(np.argmin(totals))]
    assert (windows.variances[np.concatenate(groups)] > 1.01).any()


def test_links_are_compared_with_chance(scene):
    points, visibility, affinity, _ = scene
    search = RigidSearch(Windows(points, visibility), np.ones_like(affinity))
    first, second = np.arange(30), np.arange(30, 100)
    assert search.links.between(first, second) == pytest.approx(1, rel=0.02)


def test_what_one_window_but_no_frame_shows_together_is_told_by_links():
    points, visibility, affinity, y = before_a_still_camera(
        np.random.RandomState(0), n_frames=30
    )
    first, second = (np.flatnonzero(y == 0)[side:30:2] for side in (0, 1))
    visibility[first, 14:] = visibility[second, :14] = False
    search = search_of((points, visibility, affinity, y))
    judge = search.over_longer_windows()
    both = (judge.windows.freedom[group].all(axis=0) for group in (first, second))
    assert np.logical_and(*both).any()  # in one window of the judge
    assert judge.comparisons._at_other_times(first, second)
    visibility[second[:FEWEST_TRACKS], :14] = True
    judge = search_of((points, visibility, affinity, y)).over_longer_windows()
    assert not judge.comparisons._at_other_times(first, second)


def test_longer_windows_decide_for_those_of_the_search():
    scene = before_a_still_camera(np.random.RandomState(0), n_frames=30)
    search = search_of(scene)
    assert not search.decides  # and it remembers that
    assert search.over_longer_windows().decides


@pytest.mark.parametrize("begins", [0, 10, 20])
def test_what_drives_off_late_is_apart(begins):
    scene = before_a_still_camera(np.random.RandomState(0), n_frames=30, begins=begins)
    y, search = scene[-1], search_of(scene)
    search.calibrate(y)
    _, found = least_apart(search, y)
    assert found.far > 0.3
    assert found.log_odds > 1


def test_halves_of_what_rests_are_one():
    points, _, _, y = before_a_still_camera(np.random.RandomState(0), n_frames=30)
    points, halves = points[y == 0], np.arange(np.count_nonzero(y == 0)) % 2
    seen = np.ones(points.shape[:2], dtype=bool)
    search = search_of((points, seen, np.ones((len(halves),) * 2), halves))
    search.calibrate(halves)
    _, found = least_apart(search, halves)
    assert found.log_odds < -3
