"""Partitions by rigid motion: assignment, what is apart, and the search."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg import MotionSegmenter, unpack_tracks
from skmotionseg._core.geometry.windows import FEWEST_TRACKS, FOCAL_STEPS, Windows
from skmotionseg._core.labels import canonical_labels, groups_of
from skmotionseg._core.partition import rigid_search as module
from skmotionseg._core.partition.rigid_search import (
    FEWEST_LINKS,
    HOPELESS,
    MOST_CROSS,
    NATS_OF_LABELS,
    NATS_OF_ODDS,
    SURE,
    RigidSearch,
    Step,
    _energy,
    _fine_enough,
    _judged_by_longer_windows,
    _n_apart,
    _Pair,
    calibrated_paths,
    evidence,
    rank,
    rigid_partitions,
    with_odds,
)
from skmotionseg.datasets import make_rigid_motions, make_scene
from skmotionseg.metrics import misclassification_error

ANY_NUMBER = np.arange(1, 9)


@pytest.fixture(scope="module")
def scene():
    """Tracks, true labels, and a graph of neighbours in place and displacement."""
    X, y = make_rigid_motions(n_tracks=160, n_frames=12, random_state=1)
    points, visibility = unpack_tracks(X)
    place = np.nanmean(points, axis=1)
    moved = 20 * np.nanmean(np.diff(points, axis=1), axis=1)
    features = np.column_stack([place, np.nan_to_num(moved)])
    distance = np.linalg.norm(features[:, None] - features, axis=2)
    affinity = np.exp(-((distance / np.partition(distance, 8, axis=1)[:, 8:9]) ** 2))
    affinity[affinity < 0.1] = 0
    return points, visibility, affinity + affinity.T, canonical_labels(y)


def done(search, what):
    """What one search returns."""
    (found,) = search.run(what)
    return found


def search_of(scene):
    points, visibility, affinity, _ = scene
    return RigidSearch(Windows(points, visibility), affinity)


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


def test_halves_of_a_motion_are_one_and_motions_are_apart(scene):
    points, y, search = scene[0], scene[-1], search_of(scene)
    search.calibrate(y)
    background = np.flatnonzero(y == 0)
    x = np.nanmean(points[background], axis=1)[:, 0]
    torn = y.copy()
    torn[background[x > np.median(x)]] = y.max() + 1
    motions = done(search, search.motions(torn))
    pair, least = done(search, search.least_apart(torn, motions))
    assert set(pair) == {0, y.max() + 1}
    assert max(least.log_odds, least.distance) < 0
    motions = done(search, search.motions(y))
    _, whole = done(search, search.least_apart(y, motions))
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
    pair, found = done(search, search.least_apart(y, done(search, search.motions(y))))
    groups = [np.flatnonzero(y == k) for k in pair]
    assert found.links < 0.2 * search._links(*groups)
    assert found.log_odds > 0


def test_evidence_grows_with_all_that_tells_motions_apart():
    nothing = 0.0, 1.0, 0.0, 0.0
    least = evidence(20, *nothing)
    assert_allclose(evidence(20, -1.0, *nothing[1:]), least)
    for k, value in enumerate([2, 0, 1, 1]):
        more = evidence(20, *nothing[:k], value, *nothing[k + 1 :]) - least
        assert more[k] > 0
        assert_allclose(np.delete(more, k), 0, atol=1e-12)
    known = 1.0, 1 - FEWEST_LINKS, 0.25, 2.0
    assert_allclose(evidence(20, *known), [np.log(20) * np.log(2), 0, 0.5, 2.0])


def test_more_links_than_by_chance_say_no_more():
    by_chance, many = (evidence(20, 1.0, links, 0, 0) for links in (1.0, 30.0))
    assert_allclose(many, by_chance)


def test_a_gain_says_more_of_two_large_groups_than_of_small_ones():
    few, many = (evidence(size, 1.0, 1.0, 0, 0) for size in (10, 100))
    assert_allclose(many[0], 2 * few[0])
    assert_allclose(evidence(100, 0.0, 1.0, 0, 0), evidence(10, 0.0, 1.0, 0, 0))


def test_motions_are_apart_by_how_badly_either_explains_the_other(scene):
    """Of two halves of a motion, each explains the other; of two motions, neither."""
    y, search = scene[-1], search_of(scene)
    search.calibrate(y)
    halves = y.copy()
    halves[np.flatnonzero(y == 0)[::2]] = y.max() + 1
    motions, groups = done(search, search.motions(halves)), groups_of(halves)

    def cross(i, j):
        pair = _Pair(i, j, (groups[i], groups[j]), (motions[i], motions[j]))
        swapped = _Pair(j, i, pair.groups[::-1], pair.motions[::-1])
        assert search._cross(pair) == search._cross(swapped)
        return search._cross(pair)

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
    pair = _Pair(1, 0, (first, second), (motions[0], motions[-1]))
    (found,) = done(search, search._apartnesses([pair]))
    assert log_odds * found.log_odds > 0
    assert (found.log_odds == found.distance) == (common < FEWEST_TRACKS)


def before_a_still_camera(rng, n_tracks=120, n_frames=8):
    """What stands still, and something that moves past along a straight line."""
    points = rng.uniform(0, 640, size=(n_tracks, 1, 2)) + np.zeros((n_frames, 2))
    y = (np.arange(n_tracks) < n_tracks // 4).astype(int)
    depth = rng.uniform(0.9, 1.1, size=(n_tracks, 1))
    points[y == 1, :, 0] += 3 * np.arange(n_frames) * depth[y == 1]
    points += 0.1 * rng.standard_normal(points.shape)
    visibility = np.ones((n_tracks, n_frames), dtype=bool)
    affinity = np.where(y[:, None] == y, 1.0, 0.05)
    return points, visibility, affinity, y


def test_what_moves_before_a_still_camera_is_apart():
    """One rigid motion explains both: the one at infinity, and the other near."""
    scene = before_a_still_camera(np.random.RandomState(5))
    y, search = scene[-1], search_of(scene)
    search.calibrate(y)
    _, found = done(search, search.least_apart(y, done(search, search.motions(y))))
    assert found.gain < 0.5
    assert found.far > 0.5
    assert found.log_odds > 0


def before_a_camera_that_drives(rng, n_tracks=120, n_frames=8):
    """What stands still, and something that drives away faster, straight ahead."""
    y = (np.arange(n_tracks) < n_tracks // 4).astype(int)
    depth = np.where(y == 1, rng.uniform(2, 2.5, n_tracks), rng.uniform(3, 9, n_tracks))
    way = 0.2 * np.arange(n_frames) * np.where(y == 1, 1, -1)[:, None]
    middle = np.where(y == 1, 0.15, 0.5)[:, None] * rng.uniform(-1, 1, (n_tracks, 2))
    points = middle[:, None] * (depth[:, None] / (depth[:, None] + way))[..., None]
    points = 640 * points + 320 + 0.1 * rng.standard_normal(points.shape)
    visibility = np.ones((n_tracks, n_frames), dtype=bool)
    return points, visibility, np.where(y[:, None] == y, 1.0, 0.02), y


def test_what_drives_away_from_a_moving_camera_is_apart():
    """One rigid motion would explain both, were not one of them behind the camera."""
    scene = before_a_camera_that_drives(np.random.RandomState(7))
    y, search = scene[-1], search_of(scene)
    search.calibrate(y)
    _, found = done(search, search.least_apart(y, done(search, search.motions(y))))
    assert found.gain > 3
    assert found.log_odds > 0


def turned_slowly(rng, n_tracks=120, n_frames=30):
    """What turns about an axis, and something inside of it that turns faster."""
    y = (np.arange(n_tracks) < n_tracks // 3).astype(int)
    world = rng.uniform(-1, 1, (n_tracks, 3)) * np.where(y == 1, 0.3, 1)[:, None]
    angles = np.arange(n_frames)[:, None] * np.where(y == 1, 0.05, 0.01)
    x, height, z = world.T
    sine, cosine = np.sin(angles), np.cos(angles)
    x, z = cosine * x + sine * z, cosine * z - sine * x + 4
    points = 320 + 640 * np.stack([x / z, height / z], axis=-1).swapaxes(0, 1)
    points += 0.1 * rng.standard_normal(points.shape)
    visibility = np.ones((n_tracks, n_frames), dtype=bool)
    return points, visibility, np.where(y[:, None] == y, 1.0, 0.05), y


def judged(search, labels):
    """A partition with log odds by the search's windows, and by longer ones."""
    search.calibrate(labels)
    motions = done(search, search.motions(labels))
    step = done(search, with_odds(search, Step(0.0, labels, motions)))
    return step, _judged_by_longer_windows(search, step)


@pytest.mark.parametrize("seed", range(3))
def test_longer_windows_tell_what_moves_slowly(seed):
    scene = turned_slowly(np.random.RandomState(seed))
    short, longer = judged(search_of(scene), scene[-1])
    assert short.log_odds < -1
    assert longer.log_odds > 1
    assert longer.motions is short.motions


def test_longer_windows_say_what_a_search_by_them_alone_says():
    points, visibility, affinity, y = turned_slowly(np.random.RandomState(0))
    search = RigidSearch(Windows(points, visibility), affinity, focal_length=1.0)
    _, step = judged(search, y)
    frames = search.windows.longer().frames
    plain = RigidSearch(Windows(points, visibility, 1.0, frames), affinity)
    plain.scale = search.scale
    motions = done(plain, plain.motions(y))
    pair, least = done(plain, plain.least_apart(y, motions))
    assert step.log_odds == pytest.approx(least.log_odds, abs=1e-6)
    assert step.pair == pair[::-1]


@pytest.mark.parametrize("n_long", [0, FEWEST_TRACKS - 1])
def test_what_lives_too_briefly_for_longer_windows_is_judged_by_shorter_ones(n_long):
    points, visibility, affinity, y = turned_slowly(np.random.RandomState(0))
    (turned,) = np.nonzero(y == 1)
    visibility[turned[n_long:], 9:] = False
    kept = np.setdiff1d(np.arange(len(y)), turned[7:]) if n_long else np.arange(len(y))
    points, visibility, y = points[kept], visibility[kept], y[kept]
    search = search_of((points, visibility, affinity[np.ix_(kept, kept)], y))
    short, longer = judged(search, y)
    assert longer is short


def test_what_moves_in_the_last_frames_alone_is_apart():
    rng = np.random.RandomState(0)
    points, visibility, affinity, y = before_a_still_camera(rng, n_frames=34)
    way = 3 * np.arange(34)
    points[y == 1, :, 0] += 5 * np.maximum(np.arange(34) - 26, 0) - way
    short, longer = judged(search_of((points, visibility, affinity, y)), y)
    assert short.log_odds > 1
    assert longer.log_odds > 1


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
    assert judge._at_other_times(first, second)
    visibility[second[:FEWEST_TRACKS], :14] = True
    judge = search_of((points, visibility, affinity, y)).over_longer_windows()
    assert not judge._at_other_times(first, second)


def test_a_number_that_is_given_is_not_judged(scene, monkeypatch):
    monkeypatch.setattr(RigidSearch, "over_longer_windows", None)
    assert found_in(scene, np.array([2])).chosen == 2


@pytest.mark.parametrize("seed", [20, 32])
def test_what_turns_is_not_torn_by_short_windows(seed):
    """By short windows alone, it was in some of these scenes: four motions of three."""
    scene = make_scene(
        "table",
        random_state=seed,
        n_tracks=120,
        n_frames=40,
        n_motions=3,
        life=80,
        outliers=0.0,
        gaps=0.0,
    )
    segmenter = MotionSegmenter(random_state=0).fit(scene.data)
    assert segmenter.n_motions_ == 3


@pytest.fixture(scope="module")
def exact_street():
    """Tracks of a scene without much noise, their labels, and its focal length."""
    exact = {"outliers": 0.0, "noise": 0.1, "drift": 0.0, "distortion": 0.0}
    exact |= {"motion_noise": 0.0, "texture": 1, "focal": 0.7}
    simulated = make_scene(
        "street", n_tracks=300, n_frames=12, life=100, random_state=1, **exact
    )
    points, visibility = unpack_tracks(simulated.data)
    true = simulated.focal / np.nanmax(np.ptp(points[visibility], axis=0))
    return points, visibility, canonical_labels(simulated.target), true


def test_a_focal_length_is_found_from_motions_by_another(exact_street):
    points, visibility, y, true = exact_street
    search = RigidSearch(Windows(points, visibility, 2.0), np.ones((len(y), len(y))))
    motions = done(search, search.motions(y))
    assert search.calibrate(y, FOCAL_STEPS, motions)
    assert abs(np.log(search.windows.focal_length / true)) < 0.05


def test_the_focal_length_is_looked_at_again_in_larger_groups(exact_street):
    """Small pieces of a scene hardly tell it, the whole of it does."""
    points, visibility, y, true = exact_street
    affinity = np.where(y[:, None] == y, 1.0, 0.01)
    search, first = (
        RigidSearch(Windows(points, visibility), affinity) for _ in range(2)
    )
    middle = np.nanmean(points, axis=1)
    pieces = canonical_labels((middle > np.median(middle, axis=0)) @ [2, 1] + 4 * y)
    for each in (first, search):
        each.calibrate(pieces)
    calibrated_paths(search, [pieces])
    before, after = (
        abs(np.log(each.windows.focal_length / true)) for each in (first, search)
    )
    assert after < 0.05 < before


def test_each_over_segmentation_is_merged_from_its_own_groups(scene):
    """In their order, whether the camera is looked at again in the first or not."""
    points, visibility, affinity, y = scene
    side = np.nanmean(points, axis=1)
    segmentations = [canonical_labels(2 * y + (x > np.median(x))) for x in side.T]
    for focal_length in (None, 1.0):
        search = RigidSearch(Windows(points, visibility), affinity, None, focal_length)
        search.calibrate(segmentations[0])
        paths = calibrated_paths(search, segmentations)
        starts = [path[0].labels for path in paths]
        for start, labels in zip(starts, segmentations, strict=True):
            assert misclassification_error(labels, start) < 0.05
        assert {path[-1].n_motions for path in paths} == {1}
        assert focal_length in (None, search.windows.focal_length)
        for path, labels in zip(paths, segmentations, strict=True):
            again = done(search, search.descent(labels, 1))
            energies = [[step.energy for step in each] for each in (path, again)]
            assert_allclose(*energies, rtol=1e-3)


def found_in(scene, counts):
    """Partitions by rigid motion, from pieces of the true motions."""
    points, y = scene[0], scene[-1]
    side = np.nanmean(points, axis=1)[:, 0]
    pieces = canonical_labels(2 * y + (side > np.median(side)))
    return rigid_partitions(
        search_of(scene),
        [pieces],
        counts,
        candidates=lambda n_motions: [],
        bisect=lambda group: None,
    )


@pytest.fixture(scope="module")
def any_number(scene):
    """What is found where the number of motions is open."""
    return found_in(scene, ANY_NUMBER)


def test_the_number_of_motions_is_found(scene, any_number):
    y, found = scene[-1], any_number
    assert found.chosen == y.max() + 1
    assert misclassification_error(y, found.steps[found.chosen].labels) < 0.03
    assert found.steps[found.chosen].log_odds > 0
    for n_motions, step in found.steps.items():
        assert step.n_motions == n_motions
        if n_motions > found.chosen:
            assert step.log_odds < 0


def test_a_number_that_does_not_hold_is_passed_over(scene, any_number, monkeypatch):
    """What was met on the way says one motion too many; none of its partitions does."""
    right = any_number.chosen
    monkeypatch.setattr(module, "_n_apart", lambda *_: right + 1)
    found = found_in(scene, ANY_NUMBER)
    assert found.chosen == right
    assert found.steps[right + 1].log_odds <= 0
    assert_array_equal(found.steps[right].labels, any_number.steps[right].labels)


def test_a_number_that_a_bad_partition_confirms_does_not_hold(
    scene, any_number, monkeypatch
):
    """Of one motion more, what a split gives is surely apart, but costs too much."""
    right = any_number.chosen
    more = any_number.steps[right + 1]
    bad = more._replace(energy=more.energy + 1e6, log_odds=5.0)

    def split_best(*_):
        yield []
        return bad

    monkeypatch.setattr(module, "_split_best", split_best)
    found = found_in(scene, np.arange(1, right + 2))
    assert found.chosen == right
    assert found.steps[right + 1].log_odds <= 0


@pytest.mark.parametrize(("odds", "expected"), [(-1.0, 3), (HOPELESS - 0.1, 1)])
def test_a_number_is_sought_behind_one_that_hardly_holds(
    scene, any_number, monkeypatch, odds, expected
):
    """Unless it is sure that there are not as many as that one."""
    assert any_number.chosen == 3
    improved = module._best_improved

    def doubted(*args):
        best = yield from improved(*args)
        return best._replace(log_odds=odds) if best.n_motions == 2 else best

    monkeypatch.setattr(module, "_best_improved", doubted)
    monkeypatch.setattr(module, "_n_apart", lambda *_: 1)
    assert found_in(scene, ANY_NUMBER).chosen == expected


def test_the_number_that_is_asked_for_is_kept(scene):
    for count in (2, scene[-1].max() + 1):
        found = found_in(scene, np.array([count]))
        assert found.chosen == count
        assert set(np.unique(found.steps[count].labels)) == set(range(count))


@pytest.mark.parametrize(
    ("n_groups", "noise", "tried", "taken"),
    [(3, 0.2, [6], 6), (6, 0.2, [], 6), (6, 1.0, [12], 6)],
)
def test_more_over_segments_where_few_mix_motions(n_groups, noise, tried, taken):
    """Three groups of six bodies leave noise that six do not; twelve leave as much."""
    bodies = [
        make_rigid_motions(20, 8, 1, noise=noise, missing=0, random_state=seed)[0]
        for seed in range(6)
    ]
    points, visibility = unpack_tracks(np.concatenate(bodies))
    body, half = np.repeat(np.arange(6), 20), np.tile([0, 1], 60)
    of_number = {3: body // 2, 6: body, 12: 2 * body + half}
    search, asked = RigidSearch(Windows(points, visibility), np.ones((120, 120))), []

    def finer(number):
        asked.append(number)
        return [of_number[number]]

    for most, expected in ((n_groups, n_groups), (20, taken)):
        search.restart(of_number[n_groups])
        before = search.noise
        (found,) = _fine_enough(search, [of_number[n_groups]], most, finer)
        assert_array_equal(found, of_number[expected])
        assert (search.noise < 0.6 * before) == (expected > n_groups)
    assert asked == tried


def test_nothing_is_found_where_nothing_can_be_parted(scene):
    search = search_of(scene)
    whole = np.zeros(len(scene[0]), dtype=int)
    found = rigid_partitions(
        search, [whole], np.array([3]), lambda n_motions: [], lambda group: None
    )
    assert found is None or found.steps[3].n_motions == 3


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


@pytest.mark.parametrize(
    ("odds", "fewest", "most", "expected"),
    [
        ({5: -1, 4: 2, 3: 3}, 1, 10, 4),
        ({5: -1, 4: 2, 3: 3}, 1, 4, 4),  # at most
        ({5: -1, 4: 2, 3: 3}, 1, 3, 3),
        ({5: 1, 4: -2, 3: 0}, 3, 4, 3),  # none is: the fewest
        ({2: 1, 1: 5}, 2, 4, 2),
    ],
)
def test_the_largest_number_that_is_apart_is_taken(odds, fewest, most, expected):
    path = [SimpleNamespace(n_motions=n, log_odds=odds[n]) for n in odds]
    assert _n_apart(path, fewest, most) == expected


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
    gain, joint = search._gain(groups, own, own)
    assert_allclose(gain, min(totals) / min(map(len, groups)))
    assert joint is own[int(np.argmin(totals))]
    assert (windows.variances[np.concatenate(groups)] > 1.01).any()


def test_partitions_cost_less_the_surer_it_is_that_their_motions_are_different():
    def cost(log_odds):
        return rank(Step(8.0, np.zeros(4, dtype=int), [], log_odds=log_odds))

    assert cost(0.0) == 2
    assert cost(-1.0) == 2 + NATS_OF_ODDS
    assert cost(2.0) == 2 - 2 * NATS_OF_ODDS
    assert cost(np.inf) == cost(SURE) < cost(2.0)
    assert cost(-30.0) == cost(-SURE) > cost(-1.0)


def test_partitions_cost_more_if_labels_tell_much():
    """Of the same energy, the one that takes a few tracks from many is the best."""
    few, half = (np.repeat([0, 1], sizes) for sizes in ([7, 1], [4, 4]))
    cost = rank(Step(_energy(few, 0.0, 1.0), few, [], log_odds=0.0))
    shares = np.array([7, 1]) / 8
    assert cost == pytest.approx(1 - NATS_OF_LABELS * (shares @ np.log(shares)))
    torn = rank(Step(_energy(half, 0.0, 1.0), half, [], log_odds=0.0))
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


def test_links_are_compared_with_chance(scene):
    points, visibility, affinity, _ = scene
    search = RigidSearch(Windows(points, visibility), np.ones_like(affinity))
    first, second = np.arange(30), np.arange(30, 100)
    assert search._links(first, second) == pytest.approx(1, rel=0.02)


def test_searches_side_by_side_find_what_they_find_alone(scene):
    """Their fits share batches, which are padded to the largest of their groups."""
    y = scene[-1]
    rng = np.random.RandomState(2)
    wrong = np.stack([y, y, y])
    for labels, share in zip(wrong, (0.05, 0.1, 0.2), strict=True):
        some = rng.random(len(y)) < share
        labels[some] = rng.randint(y.max() + 1, size=some.sum())
    search = search_of(scene)
    search.calibrate(y)
    together = search.run(*map(search.settled, wrong))
    for labels, settled in zip(wrong, together, strict=True):
        other = search_of(scene)
        other.calibrate(y)
        alone = done(other, other.settled(labels))
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
