"""Tracks of the last frames."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_array_equal

from skmotionseg._core.stream.buffer import TrackBuffer


def pushed(buffer, ids):
    ids = np.array(ids, dtype=int)
    return buffer.push(np.column_stack([ids, ids]) * 1.0, ids)


def test_tracks_are_kept_for_as_long_as_they_are_in_the_window():
    buffer = TrackBuffer(3)
    rows, new, _ = pushed(buffer, [7, 2])
    assert_array_equal(buffer.ids, [2, 7])
    assert_array_equal(rows, [1, 0])
    assert_array_equal(new, [0, 1])
    buffer.labels[:] = [4, 5]
    for ids in ([7], [7]):
        _, new, gone = pushed(buffer, ids)
        assert len(new) == len(gone[0]) == 0
    assert_array_equal(buffer.seen, [[True, False, False], [True, True, True]])
    _, _, (ids, labels) = pushed(buffer, [3])
    assert_array_equal([ids, labels], [[2], [4]])
    assert_array_equal(buffer.labels, [-1, 5])
    assert_array_equal(buffer.points[0, -1], [3, 3])


def test_nothing_is_known_of_a_new_track():
    """Whatever is known of those that are there."""
    buffer = TrackBuffer(3)
    pushed(buffer, [1, 5])
    buffer.add_motion()
    buffer.memory[:], buffer.labels[:], buffer.before[:], buffer.former[:] = 2, 3, 4, 5
    buffer.outlying[:] = buffer.doubtful[:] = True
    rows, new, _ = pushed(buffer, [5, 3, 1])
    assert_array_equal(rows, [2, 1, 0])
    assert_array_equal(new, [1])
    assert_array_equal(buffer.memory, [[2], [0], [2]])
    for values in (buffer.labels, buffer.before, buffer.former):
        assert values[1] == -1 and (values[[0, 2]] >= 3).all()
    for values in (buffer.outlying, buffer.doubtful):
        assert_array_equal(values, [True, False, True])
    assert not buffer.seen[1, :-1].any() and (buffer.points[1, :-1] == 0).all()


def test_tracks_of_a_candidate_show_the_label_of_before():
    buffer = TrackBuffer(3)
    pushed(buffer, [0, 1, 2])
    buffer.follow(np.array([0, 1, -1]))
    buffer.follow(np.array([0, -5, -5]))
    assert_array_equal(buffer.shown(), [0, 1, -1])
    buffer.release(-5)
    assert_array_equal(buffer.labels, [0, 1, -1])


def test_frames_count_for_which_tracks_have_followed_their_motion():
    buffer = TrackBuffer(3)
    pushed(buffer, [0, 1, 2])
    buffer.follow(np.array([4, 4, 5]))
    for _ in range(2):
        pushed(buffer, [0, 1, 2])
        buffer.follow(np.array([4, 5, 5]))
    pushed(buffer, [0, 1, 2, 3])
    assert_array_equal(buffer.followed, [3, 2, 3, 0])
    buffer.add_motion()
    buffer.settle(np.array([0, 1]), 4, 0)
    assert_array_equal(buffer.followed, [3, 0, 3, 0])


def test_nothing_speaks_against_a_label_that_is_settled():
    buffer = TrackBuffer(3)
    pushed(buffer, [0, 1, 2])
    buffer.memory = np.array([[0.0, 5.0], [7.0, 2.0], [1.0, 4.0]])
    buffer.outlying[:] = True
    buffer.add_motion()
    assert_array_equal(buffer.memory[:, 2], [0, 0, 0])
    buffer.settle(np.array([0, 1]), 8, 1)
    assert_array_equal(buffer.memory, [[0, 0, 0], [5, 0, 0], [1, 4, 0]])
    assert_array_equal(buffer.labels, [8, 8, -1])
    assert_array_equal(buffer.outlying, [False, False, True])


def test_the_taker_of_a_motion_has_most_tracks_that_it_had():
    buffer = TrackBuffer(3)
    pushed(buffer, range(14))
    buffer.follow(np.array([1] * 12 + [0, -1]))
    assert buffer.taker(1) == -1
    buffer.follow(np.array([1] * 8 + [2] * 4 + [0, 2]))
    assert buffer.taker(1) == -1  # most have stayed
    buffer.follow(np.array([1] * 4 + [-7] * 4 + [2] * 4 + [0, 2]))
    assert buffer.taker(1) == -1  # those of a candidate are shown as before
    assert_array_equal(buffer.former, [-1] * 8 + [1] * 4 + [-1, -1])
    buffer.confirm(-7, 3)
    assert_array_equal(buffer.labels, [1] * 4 + [3] * 4 + [2] * 4 + [0, 2])
    assert buffer.taker(1) == -1  # nobody has six of them
    buffer.follow(np.array([1] * 4 + [3] * 8 + [0, 2]))
    assert buffer.taker(1) == -1  # some of which were with 2 in between
    buffer.labels[:8] = 3
    buffer.former[:8] = 1
    assert buffer.taker(1) == 3
    assert buffer.taker(0) == -1
    pushed(buffer, range(20, 30))  # they are remembered for as long as they are here
    assert buffer.taker(1) == 3


def test_a_buffer_begins_empty():
    buffer = TrackBuffer(3)
    assert buffer.memory.shape == (0, 0)
    assert buffer.points.shape == (0, 3, 2)
    buffer.add_motion()
    assert buffer.memory.shape == (0, 1)
