"""Windows of a video, and what joins them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from skmotionseg._core.stream.joining import OVERLAP, WINDOW, Joiner, Part, parts_of


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


def joined(windows, n_tracks, most=None, points=None):
    """Labels after windows of ten frames, given as {track: label}."""
    joiner = Joiner(n_tracks, most, 1.0)
    for k, labels in enumerate(windows):
        tracks = np.array(sorted(labels))
        where = np.zeros((len(tracks), 10, 2)) if points is None else points[k][tracks]
        seen = np.ones(where.shape[:2], dtype=bool)
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


def test_no_more_numbers_than_motions():
    first = dict.fromkeys(range(10), 0) | dict.fromkeys(range(10, 20), 1)
    second = first | dict.fromkeys(range(15, 20), 2)
    assert set(joined([first, second], 20, most=2)) == {0, 1}
    assert set(joined([first, second], 20)) == {0, 1}  # by the frames of the first
