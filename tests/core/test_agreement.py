"""Windows that contradict those beside them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from skmotionseg._core.stream.agreement import ATTEMPTS, WindowMotions, agreeing

ONE, TWO = np.zeros(20, dtype=int), np.repeat([0, 1], 10)
HALVES = np.repeat([0, 1, 2], [10, 5, 5])
MIXED = np.arange(20) % 2


def agreed(labels, surely, *again, tracks=None, fewest=1, most=10):
    """What becomes of windows, and which were segmented again into how many motions.

    ``again`` has the labels that each attempt gives.
    """
    tracks = [np.arange(len(own)) for own in labels] if tracks is None else tracks
    found, asked = list(map(WindowMotions, tracks, labels, surely)), []

    def recorded(places, numbers, attempt):
        asked.append(dict(zip(places, numbers, strict=True)))
        return [WindowMotions(tracks[k], again[attempt], np.nan) for k in places]

    changed = agreeing(found, recorded, fewest, most)
    for own, before in zip(changed, found, strict=True):
        assert own.tracks is before.tracks
    return [own.labels for own in changed], [own.surely for own in changed], asked


@pytest.mark.parametrize("surely", [0.5, 1.0])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_window_that_takes_two_motions_for_one_is_segmented_again(place, surely):
    labels, sure = [TWO] * 3, [0.98, 0.97, 0.96]
    labels[place], sure[place] = ONE, surely
    found, sure, asked = agreed(labels, sure, TWO)
    assert asked == [{place: 2}]
    assert_array_equal(found, [TWO] * 3)
    assert sure[place] == [0.97, 0.96, 0.97][place]  # as the less sure beside it


def test_motion_that_an_unsure_window_alone_has_parted_is_segmented_again():
    found, _, asked = agreed([TWO, HALVES, TWO], [1.0, 0.7, 1.0], TWO)
    assert asked == [{1: 2}]
    assert_array_equal(found[1], TWO)


@pytest.mark.parametrize("reverse", [False, True])
def test_what_stops_is_not_one_with_the_scene_before(reverse):
    """A window that is not quite sure of a motion sees its end; the next, none."""
    labels, surely = [TWO, TWO, ONE, ONE], [1.0, 0.9, 1.0, 1.0]
    order = slice(None, None, -1 if reverse else 1)
    found, _, asked = agreed(labels[order], surely[order], *[ONE] * ATTEMPTS)
    # Where it stands, it is looked for in vain.
    assert not asked
    for own, before in zip(found, labels[order], strict=True):
        assert own is before


def test_what_stops_is_looked_for_where_it_stands():
    found, _, asked = agreed([TWO, ONE, ONE], [1.0, 1.0, 1.0], *[MIXED] * ATTEMPTS)
    assert asked == [{1: 2}] * ATTEMPTS
    assert_array_equal(found[1], ONE)


@pytest.mark.parametrize("surely", [0.9, np.nan])
def test_windows_that_are_unsure_contradict_none(surely):
    assert not agreed([TWO, ONE, TWO], [surely] * 3)[2]
    assert not agreed([TWO, HALVES, TWO], [surely] * 3)[2]


def test_windows_that_are_sure_keep_their_motions():
    """But those beside them may lack one."""
    labels, surely = [TWO, HALVES, TWO], [1.0, 0.99, 1.0]
    found, _, asked = agreed(labels, surely, *[HALVES] * ATTEMPTS)
    assert asked == [{0: 3, 2: 3}]
    assert_array_equal(found, [HALVES] * 3)


@pytest.mark.parametrize(
    "again",
    [
        ONE,
        MIXED,
        np.full(20, -1),
        np.repeat([0, -1], 10),
        np.repeat([0, 1, -1], [10, 1, 9]),  # one more goes with its own
    ],
)
def test_partition_that_agrees_no_more_is_not_kept(again):
    labels = [TWO, ONE, TWO]
    found, surely, asked = agreed(labels, [1.0, 0.8, 1.0], *[again] * ATTEMPTS)
    assert asked == [{1: 2}] * ATTEMPTS
    assert found[1] is ONE
    assert surely[1] == 0.8


def test_attempts_go_on_until_one_agrees():
    mended = np.repeat([0, 1, -1], [10, 5, 5])
    found, _, asked = agreed([TWO, ONE, TWO], [1.0, 0.8, 1.0], ONE, mended)
    assert len(asked) == 2
    assert found[1] is mended
    bent = np.repeat([0, 1], [18, 2])
    found, _, asked = agreed([TWO, ONE, TWO], [1.0, 0.8, 1.0], bent, TWO)
    assert len(asked) == 2
    assert found[1] is TWO
    # Else what agrees most is kept, though not all of it does.
    found, _, asked = agreed([TWO, ONE, TWO], [1.0, 0.8, 1.0], MIXED, bent, ONE)
    assert len(asked) == 3
    assert found[1] is bent


def test_motions_that_windows_hold_in_other_ways_are_sought_once_more():
    """One is parted and two are one: there are as many as there should be."""
    three = np.repeat([0, 1, 2], 10)
    wrong = np.repeat([0, 1, 2], [5, 5, 20])
    found, _, asked = agreed([three, wrong, three], [1.0, 0.5, 1.0], three)
    assert asked == [{1: 3}]
    assert_array_equal(found[1], three)


def test_those_beside_need_not_agree():
    found, _, asked = agreed([TWO, ONE, HALVES], [1.0, 0.6, 1.0], *[HALVES] * 3)
    assert asked[0] == {1: 3}
    assert_array_equal(found[1], HALVES)


@pytest.mark.parametrize(("n_before", "lacks"), [(2, False), (3, True)])
def test_few_tracks_in_common_say_nothing(n_before, lacks):
    tracks = [np.r_[np.arange(10), 17 + np.arange(n_before)], np.arange(20)]
    labels = [np.repeat([0, 1], [10, n_before]), ONE]
    asked = agreed(labels, [1.0, 0.5], TWO, tracks=tracks)[2]
    assert asked == ([{1: 2}] if lacks else [])


@pytest.mark.parametrize(("n_within", "lacks"), [(7, False), (8, True)])
def test_three_quarters_of_a_motion_must_be_in_another(n_within, lacks):
    own = np.repeat([0, 1], [10 + n_within, 10 - n_within])
    asked = agreed([TWO, own], [1.0, 0.5], *[TWO] * ATTEMPTS)[2]
    assert bool(asked) == lacks


def test_tracks_of_no_motion_say_nothing():
    assert not agreed([np.full(20, -1), ONE, TWO - 1], [1.0, 0.5, 1.0])[2]


def test_windows_have_as_many_motions_as_there_may_be():
    assert not agreed([TWO, ONE, TWO], [1.0, 0.5, 1.0], most=1)[2]
    assert not agreed([TWO, HALVES, TWO], [1.0, 0.5, 1.0], fewest=3)[2]
