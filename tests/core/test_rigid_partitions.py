"""Partitions by rigid motion, and their number."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.rigid_scenes import (
    before_a_still_camera,
    done,
    exact_street,
    linked_scene,
    search_of,
    turned_slowly,
)
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg import MotionSegmenter, unpack_tracks
from skmotionseg._core.geometry.windows import FEWEST_TRACKS, Windows
from skmotionseg._core.labels import canonical_labels
from skmotionseg._core.partition import rigid_partitions as module
from skmotionseg._core.partition.apartness import (
    Comparisons,
)
from skmotionseg._core.partition.rigid_partitions import (
    HOPELESS,
    NATS_OF_ODDS,
    SURE,
    _fine_enough,
    _judged_by_longer_windows,
    _n_apart,
    calibrated_path,
    rank,
    rank_in,
    rigid_partitions,
    with_odds,
)
from skmotionseg._core.partition.rigid_search import (
    RigidSearch,
    Step,
)
from skmotionseg.datasets import make_rigid_motions, make_scene
from skmotionseg.metrics import misclassification_error

ANY_NUMBER = np.arange(1, 9)


@pytest.fixture(scope="module")
def scene():
    return linked_scene()


@pytest.fixture(scope="module")
def street():
    return exact_street()


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
    plain.comparisons = Comparisons(plain.windows, plain.links, search.scale)
    motions = done(plain, plain.motions(y))
    pair, least = done(plain, plain.comparisons.least_apart(y, motions))
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


def test_the_focal_length_is_looked_at_again_in_larger_groups(street):
    """Small pieces of a scene hardly tell it, the whole of it does."""
    points, visibility, y, true = street
    affinity = np.where(y[:, None] == y, 1.0, 0.01)
    search, first = (
        RigidSearch(Windows(points, visibility), affinity) for _ in range(2)
    )
    middle = np.nanmean(points, axis=1)
    pieces = canonical_labels((middle > np.median(middle, axis=0)) @ [2, 1] + 4 * y)
    for each in (first, search):
        each.calibrate(pieces)
    calibrated_path(search, pieces)
    before, after = (
        abs(np.log(each.windows.focal_length / true)) for each in (first, search)
    )
    assert after < 0.05 < before


def test_over_segments_are_merged_by_the_camera_that_was_found(scene):
    """From their own groups, whether the camera is looked at again or not.

    Motions that are known are left out: the second time, there are more.
    """
    points, visibility, affinity, y = scene
    side = np.nanmean(points, axis=1)
    for focal_length in (None, 1.0):
        for x in side.T:
            pieces = canonical_labels(2 * y + (x > np.median(x)))
            search = RigidSearch(
                Windows(points, visibility), affinity, None, focal_length
            )
            search.calibrate(pieces)
            search._found = search.windows.found
            path = calibrated_path(search, pieces)
            assert misclassification_error(pieces, path[0].labels) < 0.05
            counts = [step.n_motions for step in path]
            assert counts == list(range(pieces.max() + 1, 0, -1))
            assert focal_length in (None, search.windows.focal_length)
            again = done(search, search.descent(pieces, 1))
            energies = [[step.energy for step in each] for each in (path, again)]
            assert_allclose(*energies, rtol=1e-3)


def found_in(scene, counts):
    """Partitions by rigid motion, from pieces of the true motions."""
    points, y = scene[0], scene[-1]
    side = np.nanmean(points, axis=1)[:, 0]
    pieces = canonical_labels(2 * y + (side > np.median(side)))
    return rigid_partitions(
        search_of(scene),
        pieces,
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


@pytest.mark.parametrize(
    ("odds", "of_split", "expected"),
    [(-1.0, 0.1, 3), (-1.0, -0.1, 1), (HOPELESS - 0.1, 0.1, 1)],
)
def test_a_number_is_sought_behind_one_that_hardly_holds(
    scene, any_number, monkeypatch, odds, of_split, expected
):
    """If a split is apart, and it is not sure that there are not as many as that."""
    assert any_number.chosen == 3
    improved, split_best = module._best_improved, module._split_best

    def doubted(*args):
        best = yield from improved(*args)
        return best._replace(log_odds=odds) if best.n_motions == 2 else best

    def split(*args):
        best = yield from split_best(*args)
        into_three = best is not None and best.n_motions == 3
        return best._replace(log_odds=of_split) if into_three else best

    monkeypatch.setattr(module, "_best_improved", doubted)
    monkeypatch.setattr(module, "_split_best", split)
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
        return of_number[number]

    for most, expected in ((n_groups, n_groups), (20, taken)):
        search.restart(of_number[n_groups])
        before = search.noise
        found = _fine_enough(search, of_number[n_groups], most, finer)
        assert_array_equal(found, of_number[expected])
        assert (search.noise < 0.6 * before) == (expected > n_groups)
    assert asked == tried


def test_nothing_is_found_where_nothing_can_be_parted(scene):
    search = search_of(scene)
    whole = np.zeros(len(scene[0]), dtype=int)
    found = rigid_partitions(
        search, whole, np.array([3]), lambda n_motions: [], lambda group: None
    )
    assert found is None or found.steps[3].n_motions == 3


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


def test_partitions_cost_less_the_surer_it_is_that_their_motions_are_different():
    def cost(log_odds):
        return rank(Step(8.0, np.zeros(4, dtype=int), [], log_odds=log_odds))

    assert cost(1.0) == 2 - NATS_OF_ODDS
    assert cost(2.0) == 2 - 2 * NATS_OF_ODDS
    assert cost(np.inf) == cost(SURE) < cost(2.0)
    assert cost(-1.0) - cost(0.0) == pytest.approx(NATS_OF_ODDS)
    assert cost(-30.0) == cost(-SURE) > cost(-1.0)


def test_partitions_of_motions_that_are_likelier_one_come_last():
    labels = np.zeros(4, dtype=int)
    torn = Step(-100.0, labels, [], log_odds=0.0)
    whole = Step(100.0, labels, [], log_odds=1e-3)
    assert rank(torn) > rank(whole)
    assert rank(torn, decided=False) < rank(whole, decided=False)


@pytest.mark.parametrize(("n_frames", "decides"), [(20, True), (40, False)])
def test_log_odds_decide_unless_longer_windows_judge(n_frames, decides):
    X, _ = make_rigid_motions(n_tracks=40, n_frames=n_frames, random_state=0)
    search = RigidSearch(Windows(*unpack_tracks(X)), np.ones((40, 40)))
    assert search.decides is decides
    torn = Step(-100.0, np.zeros(40, dtype=int), [], log_odds=0.0)
    whole = torn._replace(energy=100.0, log_odds=1e-3)
    assert (rank_in(search)(torn) > rank_in(search)(whole)) is decides
