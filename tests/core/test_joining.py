"""Windows of a video, and what joins them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from skmotionseg._core.stream.identities import SHARED_TRACKS
from skmotionseg._core.stream.joining import (
    OVERLAP,
    WINDOW,
    Joiner,
    Part,
    parts_of,
)


@pytest.mark.parametrize("n_frames", [1, 29, 30, 31, 50, 51, 104, 2000])
def test_windows_cover_a_clip(n_frames):
    visibility = np.random.default_rng(0).uniform(size=(20, n_frames)) < 0.2
    visibility[0] = False
    parts = parts_of(visibility)
    assert (parts[0].start, parts[-1].stop) == (0, n_frames)
    for one, other in pairwise(parts):
        assert one.stop - other.start >= min(OVERLAP, n_frames) - 1
    assert all(part.stop - part.start <= WINDOW for part in parts)
    tracks = np.unique(np.concatenate([part.tracks for part in parts]))
    assert_array_equal(tracks, np.flatnonzero(visibility.any(axis=1)))


def joined(windows, n_tracks, most=None, points=None, frames=None, cuts=()):
    """Labels after windows of ten frames, given as {track: label}.

    Tracks are seen in all frames of a window, or in those of ``{track: frames}``.
    """
    joiner = Joiner(n_tracks, most, np.array([640.0, 480.0]), cuts)
    for k, labels in enumerate(windows):
        tracks = np.array(sorted(labels))
        where = np.zeros((len(tracks), 10, 2)) if points is None else points[k][tracks]
        seen = np.ones(where.shape[:2], dtype=bool)
        for row, track in enumerate(tracks if frames else ()):
            seen[row] = np.isin(np.arange(10), frames.get(int(track), np.arange(10)))
        part = Part(10 * k, 10 * k + 10, tracks)
        joiner.add(part, where, seen, np.array([labels[t] for t in tracks]))
    return joiner.labels()[0]


def test_motions_go_on_with_their_tracks():
    first = dict.fromkeys(range(10), 0) | dict.fromkeys(range(10, 20), 1)
    second = dict.fromkeys(range(5, 10), 1) | dict.fromkeys(range(14, 20), 0)
    second |= {20: 1, 21: 0}
    labels = joined([first, second], 23)
    assert_array_equal(labels[:20], np.repeat([0, 1], 10))
    assert_array_equal(labels[20:], [0, 1, -1])


def test_motion_that_nobody_saw_comes_back_by_its_place():
    points = np.zeros((3, 60, 10, 2)) + np.arange(60)[:, None, None] % 10
    points[:, 20:] += 400  # the second thing is elsewhere
    first = dict.fromkeys(range(10), 0) | dict.fromkeys(range(20, 30), 1)
    second = dict.fromkeys(range(5, 15), 0)
    third = dict.fromkeys(range(8, 15), 0) | dict.fromkeys(range(40, 50), 1)
    labels = joined([first, second, third], 60, points=points)
    assert set(labels[20:30]) == {1}
    assert set(labels[40:50]) == {1}


@pytest.mark.parametrize(
    "cuts, most, again", [((20,), None, False), ((10,), None, True), ((20,), 2, True)]
)
def test_what_a_cut_parts_is_not_the_same_by_its_place(cuts, most, again):
    points = np.zeros((3, 60, 10, 2)) + np.arange(60)[:, None, None] % 10
    first = dict.fromkeys(range(10), 0)
    second = dict.fromkeys(range(20, 30), 0)
    third = dict.fromkeys(range(40, 50), 0)
    windows = [first, second, third]
    labels = joined(windows, 60, most=most, points=points, cuts=cuts)
    assert (labels[40] == labels[20]) == again
    if most is None:
        assert (labels[20] == labels[0]) == (cuts != (10,))


def test_no_more_numbers_than_motions():
    first = dict.fromkeys(range(10), 0) | dict.fromkeys(range(10, 20), 1)
    second = first | dict.fromkeys(range(15, 20), 2)
    assert set(joined([first, second], 20, most=2)) == {0, 1}
    assert set(joined([first, second], 20)) == {0, 1}  # by the frames of the first


def three_places(n_tracks):
    """Where the scene, a thing, and another thing are, by tens of tracks."""
    points = np.zeros((2, n_tracks, 10, 2)) + np.arange(n_tracks)[:, None, None] % 10
    points[:, 10:20] += [400, 0]
    points[:, 20:30] += [0, 300]
    return points


def test_what_comes_back_within_a_window_is_what_left_and_not_what_is_hidden():
    points = three_places(50)
    points[:, 30:40] += [400, 0]  # where the first thing was
    first = {t: t // 10 for t in range(30)}
    # The second thing is gone; of the first, other tracks are seen later.
    second = dict.fromkeys(range(10), 0) | dict.fromkeys(range(10, 20), 1)
    second |= dict.fromkeys(range(30, 40), 2)
    frames = dict.fromkeys(range(10, 20), np.arange(5))
    frames |= dict.fromkeys(range(30, 40), np.arange(5, 10))
    labels = joined([first, second], 50, 3, points, frames)
    assert set(labels[30:40]) == {labels[10]}
    assert labels[10] != labels[20]
    # At one time with the other tracks, it is another thing.
    labels = joined([first, second], 50, 3, points)
    assert set(labels[30:40]) == {labels[20]}


def test_part_of_a_motion_is_no_hidden_one_that_was_elsewhere():
    points = three_places(30)
    first = {t: t // 10 for t in range(30)}
    second = dict.fromkeys(range(10), 0) | dict.fromkeys(range(10, 16), 1)
    second |= dict.fromkeys(range(16, 20), 2)
    assert len(set(joined([first, second], 30, 3, points)[10:20])) == 1
    # Without a limit it may be a thing that begins to move.
    points = [*points, points[0]]
    labels = joined([first, second, second], 30, None, points)
    assert len(set(labels[10:20])) == 2


def test_motion_that_one_window_is_unsure_of_is_part_of_another():
    points = three_places(40)
    points = [points[0][:30]] * 3
    whole = {t: min(t // 10, 1) for t in range(30)}
    split = {t: t // 10 for t in range(30)}

    def joined_with(surely):
        joiner = Joiner(30, None, np.array([640.0, 480.0]))
        for k, (labels, sure) in enumerate(
            zip([whole, split, whole], surely, strict=True)
        ):
            part = Part(10 * k, 10 * k + 10, np.arange(30))
            seen = np.ones((30, 10), dtype=bool)
            seen[20:25] = seen[20:25] & (k == 1)  # some are seen in this window only
            joiner.add(part, points[k], seen, np.array(list(labels.values())), sure)
        return joiner.labels()[0]

    assert_array_equal(joined_with([1, 0.7, 1]), np.repeat([0, 1, 1], 10))
    assert_array_equal(
        joined_with([1, 0.99, 1]), np.repeat([0, 1, 2, 1], [10, 10, 5, 5])
    )


@pytest.mark.parametrize(("n_shared", "joined"), [(SHARED_TRACKS, 1), (2, 2)])
def test_motion_that_may_be_none_is_part_of_one_that_has_enough_of_its_tracks(
    n_shared, joined
):
    points = three_places(40)[0][:30]
    names = np.repeat([0, 1, 2], 10)
    joiner = Joiner(30, None, np.array([640.0, 480.0]))
    for k, surely in enumerate([1, 0.7, 1]):
        # The third motion is seen in one window, and some of its tracks in all three.
        tracks = np.arange(30 if k == 1 else 20 + n_shared)
        labels = names[tracks] if k == 1 else names[tracks].clip(max=1)
        part = Part(10 * k, 10 * k + 10, tracks)
        seen = np.ones((len(tracks), 10), dtype=bool)
        joiner.add(part, points[tracks], seen, labels, surely)
    assert set(joiner.labels()[0][20 + n_shared :]) == {joined}


def test_groups_that_come_at_once_have_a_number_each():
    first = dict.fromkeys(range(10), 0)
    second = {t: t // 10 for t in range(30)}
    assert_array_equal(joined([first, second], 30), np.repeat([0, 1, 2], 10))
    # Where there may be no more, the second is of none.
    labels = joined([first, second], 30, most=2)
    assert_array_equal(labels, np.repeat([0, 1, -1], 10))


def test_of_what_was_one_motion_one_group_keeps_its_number():
    whole, apart = dict.fromkeys(range(30), 0), {t: t // 10 for t in range(30)}
    labels = joined([whole, apart, apart], 30)
    assert_array_equal(labels, np.repeat([0, 1, 2], 10))


@pytest.mark.parametrize("order", [[1, 2], [2, 1]])
def test_of_two_groups_that_come_at_once_one_is_what_was_away(order):
    points = np.zeros((3, 50, 10, 2)) + np.arange(50)[:, None, None] % 10
    points[:, 10:20] += 400  # what goes away
    points[:, 30:40] += 400  # where it was
    points[:, 40:50] *= 40  # all over the picture
    first = {t: t // 10 for t in range(20)}
    second = dict.fromkeys(range(10), 0)
    third = second | dict.fromkeys(range(30, 40), order[0])
    third |= dict.fromkeys(range(40, 50), order[1])
    labels = joined([first, second, third], 50, points=points)
    expected = np.repeat([0, 1, -1, 1, 2], 10)
    assert_array_equal(labels, expected)


def test_motion_that_a_window_is_unsure_of_stays_if_it_shares_no_tracks():
    joiner = Joiner(20, None, np.array([640.0, 480.0]))
    labels, points = np.repeat([0, 1], 10), three_places(20)[0]
    seen = np.ones((20, 10), dtype=bool)
    joiner.add(Part(0, 10, np.arange(20)), points, seen, labels, 0.6)
    found, shares = joiner.labels()
    assert_array_equal(found, labels)
    assert_array_equal(shares, 1)
