"""Motions carried from frame to frame, the first ones being told."""

from __future__ import annotations

import numpy as np
from helpers.films import film

from skmotionseg._core.stream.stream import FIRST_FRAMES, MotionStream


def test_motions_that_are_told_go_on():
    movie = film(n_frames=FIRST_FRAMES + 8, life=60, n_static=150, n_moving=60)
    stream = MotionStream(None, np.random.RandomState(0))

    def partition(points, seen):
        rows = stream.buffer.seen.sum(axis=1) >= 4
        return movie.things[stream.buffer.ids[rows]]

    for frame in range(movie.n_frames):
        points, ids = movie.frame(frame)
        labels, _ = stream.step(points, ids, partition)
        if frame < FIRST_FRAMES - 1:
            assert (labels == -1).all()
    assert (labels == movie.things[ids]).mean() > 0.97
    ids, labels = stream.result()
    assert (np.diff(ids) > 0).all()


def test_nothing_begins_without_a_partition():
    movie = film(n_frames=FIRST_FRAMES + 2)
    stream = MotionStream(None, np.random.RandomState(0))
    for frame in range(movie.n_frames):
        labels, events = stream.step(
            *movie.frame(frame), lambda points, seen: np.full(len(points), -1)
        )
        assert not events
    assert (labels == -1).all()
