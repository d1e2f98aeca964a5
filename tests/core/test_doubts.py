"""When the last frames of a stream are searched for what moves apart."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from skmotionseg._core.stream.births import FEWEST_MEMBERS
from skmotionseg._core.stream.doubts import (
    FRAMES_PER_SEARCH,
    MOST_FRAMES,
    SETTLED,
    Doubts,
)
from skmotionseg._core.stream.living import LivingMotion


def motion(number, is_apart=True, together=3):
    return LivingMotion(number, None, 0, is_apart=is_apart, together=together)


def test_motions_are_joined_if_a_search_has_left_it_so():
    doubts = Doubts()
    assert doubts.weighed("joined", motion(2), 20, 30) is None
    assert doubts.is_due(30)
    doubts.close(30, found=False)
    assert not doubts.is_due(30)
    assert doubts.weighed("joined", motion(2), 20, 30 + SETTLED) == "joined"
    assert not doubts.is_open
    assert doubts.weighed("joined", motion(2), 20, 31 + SETTLED) is None


def searches(found, asking=range(200)):
    """Frames of searches, of which some find a motion."""
    doubts, frames = Doubts(), []
    for frame in range(200):
        doubts.is_open |= frame in asking
        if doubts.is_due(frame):
            doubts.close(frame, found(len(frames)))
            frames.append(frame)
    return np.array(frames)


def test_searches_are_some_frames_apart():
    assert searches(lambda k: True)[:2].tolist() == [0, FRAMES_PER_SEARCH]
    assert set(np.diff(searches(lambda k: True))) == {FRAMES_PER_SEARCH}


def test_searches_that_find_nothing_are_rarer():
    steps = np.diff(searches(lambda k: False))
    assert steps[:5].tolist() == [6, 6, 12, 24, 24]
    assert steps.max() == MOST_FRAMES
    steps = np.diff(searches(lambda k: k == 5))
    assert steps[:9].tolist() == [6, 6, 12, 24, 24, 6, 6, 6, 12]


def test_a_pause_makes_searches_as_frequent_as_they_were():
    asking = [*range(40), *range(100, 120)]
    assert searches(lambda k: False, asking)[3:9].tolist() == [
        24,
        48,
        100,
        106,
        112,
        124,
    ]


@pytest.mark.parametrize(
    ("candidate", "n_tracks", "asked"),
    [
        (motion(-9), FEWEST_MEMBERS, True),
        (motion(-9), FEWEST_MEMBERS - 1, False),
        (motion(-9, is_apart=False), 20, False),  # nothing speaks for it
        (motion(-9, together=0), 20, False),  # nothing speaks against it
    ],
)
def test_candidates_that_a_joint_motion_explains_are_searched_for(
    candidate, n_tracks, asked
):
    doubts = Doubts()
    assert doubts.weighed("dropped", candidate, n_tracks, 30) == "dropped"
    assert doubts.is_open == asked


@pytest.mark.parametrize("decision", [None, "confirmed", "hidden", "merged"])
def test_other_verdicts_are_left(decision):
    doubts = Doubts()
    assert doubts.weighed(decision, motion(2), 20, 30) == decision
    assert not doubts.is_open


def square(n, x, y):
    """So many places, a pixel apart."""
    return np.stack(np.divmod(np.arange(n), 5), axis=1) + np.array([x, y])


def buffer_of(*groups):
    """Tracks (places, label, frames seen) before those of the scene all around."""
    x, y = np.meshgrid(np.arange(0, 640, 40), np.arange(0, 480, 40))
    groups = [*groups, (np.column_stack([x.ravel(), y.ravel()]), 0, 12)]
    places = np.concatenate([group[0] for group in groups])
    sizes = [len(group[0]) for group in groups]
    times = np.repeat([group[2] for group in groups], sizes)
    return SimpleNamespace(
        points=np.repeat(places[:, None], 12, axis=1).astype(float),
        seen=np.arange(12) >= 12 - times[:, None],
        labels=np.repeat([group[1] for group in groups], sizes),
    )


OLD = square(20, 500, 100), 2, 12


@pytest.mark.parametrize(
    ("new", "asked"),
    [
        ((square(8, 500, 400), 2, 8), True),
        ((square(8, 500.5, 100.5), 2, 8), False),  # among those that were there
        ((square(8, 500, 400), 2, 5), False),  # too young to tell
        ((square(8, 500, 400), 2, 11), False),  # has been there for long
        ((square(FEWEST_MEMBERS - 1, 500, 400), 2, 8), False),
        ((square(8, 500, 400), 0, 8), False),  # of the scene
    ],
)
def test_what_follows_a_motion_in_another_place_may_be_none_of_it(new, asked):
    doubts = Doubts()
    doubts.ask_of_entered(buffer_of(OLD, new), [motion(0), motion(2), motion(-9)])
    assert doubts.is_open == asked


def test_some_new_tracks_of_the_old_thing_do_not_hide_what_has_entered():
    doubts, among = Doubts(), (square(10, 500.5, 100.5), 2, 8)
    new = square(8, 500, 400), 2, 8
    doubts.ask_of_entered(buffer_of(OLD, among, new), [motion(0), motion(2)])
    assert doubts.is_open


def test_a_motion_that_is_all_new_is_none_of_another():
    doubts = Doubts()
    doubts.ask_of_entered(buffer_of((square(20, 500, 100), 2, 8)), [motion(2)])
    assert not doubts.is_open
