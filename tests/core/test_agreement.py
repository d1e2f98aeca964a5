"""Windows that contradict those beside them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from skmotionseg._core.stream.agreement import ATTEMPTS, SURE, WindowMotions, agreeing
from skmotionseg._core.stream.joining import Part

TWO, ONE = np.repeat([0, 1], 10), np.zeros(20, dtype=int)
HALVES = np.repeat([0, 1, 2], [10, 5, 5])


def agreed(labels, surely, again, tracks=None, most=10):
    """What becomes of windows, and which were segmented again into how many.

    ``again`` has the labels of each attempt.
    """
    tracks = [np.arange(len(own)) for own in labels] if tracks is None else tracks
    parts = [Part(10 * k, 10 * k + 10, own) for k, own in enumerate(tracks)]
    found, asked = list(map(WindowMotions, labels, surely)), []

    def recorded(k, n_motions, attempt):
        asked.append((k, n_motions))
        return again[attempt]

    return agreeing(parts, found, recorded, 1, most), asked


@pytest.mark.parametrize("surely", [0.5, 1.0])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_window_that_takes_two_motions_for_one_is_segmented_again(place, surely):
    labels, sure = [TWO] * 3, [1.0] * 3
    labels[place], sure[place] = ONE, surely
    found, asked = agreed(labels, sure, [TWO])
    assert asked == [(place, 2)]
    assert_array_equal(found[place].labels, TWO)
    assert found[place].surely == max(surely, SURE)


def test_motion_that_an_unsure_window_has_parted_is_segmented_again():
    found, asked = agreed([TWO, HALVES, TWO], [1.0, 0.7, 1.0], [TWO])
    assert asked == [(1, 2)]
    assert_array_equal(found[1].labels, TWO)


def test_motions_that_a_window_is_sure_of_are_looked_for_in_others():
    found, asked = agreed([TWO, HALVES, TWO], [1.0, 0.99, 1.0], [TWO] * ATTEMPTS)
    assert asked == [(0, 3)] * ATTEMPTS + [(2, 3)] * ATTEMPTS
    for window, labels in zip(found, [TWO, HALVES, TWO], strict=True):
        assert_array_equal(window.labels, labels)


@pytest.mark.parametrize("surely", [[0.9, 1.0, 0.9], [np.nan, 1.0, np.nan]])
def test_windows_that_are_unsure_change_no_other(surely):
    found, asked = agreed([TWO, ONE, TWO], surely, [TWO] * ATTEMPTS)
    assert (1, 2) not in asked
    assert_array_equal(found[1].labels, ONE)


@pytest.mark.parametrize("again", [[ONE] * ATTEMPTS, [HALVES, ONE, HALVES]])
def test_window_that_still_contradicts_stays(again):
    found, asked = agreed([TWO, ONE, TWO], [1.0, 0.8, 1.0], again)
    assert asked == [(1, 2)] * ATTEMPTS
    assert_array_equal(found[1].labels, ONE)
    assert found[1].surely == 0.8


def test_first_attempt_that_agrees_is_kept():
    found, asked = agreed([TWO, ONE, TWO], [1.0, 0.8, 1.0], [ONE, TWO])
    assert asked == [(1, 2)] * 2
    assert_array_equal(found[1].labels, TWO)


def test_what_was_segmented_again_is_what_the_next_is_compared_with():
    found, asked = agreed([TWO, ONE, ONE], [1.0, 0.5, 0.5], [TWO])
    assert asked == [(1, 2), (2, 2)]
    assert_array_equal(found[2].labels, TWO)


def test_few_tracks_in_common_say_nothing():
    before = np.r_[np.arange(10), 20, 21]  # two of the second motion
    tracks = [before, np.arange(20)]
    labels = [np.repeat([0, 1], [10, 2]), ONE]
    _, asked = agreed(labels, [1.0, 0.5], [TWO], tracks)
    assert not asked
    tracks[0] = np.r_[np.arange(10), 17, 18, 19]
    labels[0] = np.repeat([0, 1], [10, 3])
    _, asked = agreed(labels, [1.0, 0.5], [TWO], tracks)
    assert asked == [(1, 2)]


def test_tracks_of_no_motion_say_nothing():
    _, asked = agreed([np.full(20, -1), ONE, TWO - 1], [1.0, 0.5, 1.0], [TWO])
    assert not asked


def test_windows_have_no_more_motions_than_there_may_be():
    _, asked = agreed([TWO, ONE, TWO], [1.0, 0.5, 1.0], [TWO], most=1)
    assert not asked
