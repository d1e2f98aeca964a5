"""Motions that are known are where fits start, and what they are not worse than."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.rigid_scenes import linked_scene
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg._core.geometry.windows import FitRequest, Windows
from skmotionseg._core.partition import known_motions
from skmotionseg._core.partition.known_motions import KnownMotions, nats_in_windows


@pytest.fixture(scope="module")
def scene():
    points, visibility, _, y = linked_scene()
    windows = Windows(points, visibility)
    return windows, 2 * windows.least_noise, y


def nats_of(windows, motion, group, scale):
    return nats_in_windows(windows, motion, scale)[group].sum(axis=0)


def test_a_fit_is_nowhere_worse_than_what_was_known(scene):
    windows, scale, y = scene
    rng = np.random.RandomState(0)
    known, before = KnownMotions(windows, scale), []
    for _ in range(4):
        groups = [
            np.flatnonzero(rng.random(len(y)) < 0.3 + 0.6 * (y == k)) for k in y[:3]
        ]
        found = known.found(list(map(FitRequest, groups)))
        for group, motion in zip(groups, found, strict=True):
            assert_array_equal(motion.tracks, group)
            own = nats_of(windows, motion, group, scale)
            for other in before:
                assert np.all(own <= 1.0001 * nats_of(windows, other, group, scale))
        before += found


def test_a_motion_is_not_worse_than_itself(scene):
    """Sums of what is known are rounded, which is no reason for another motion."""
    windows, scale, y = scene
    groups = [np.flatnonzero(y == k) for k in np.unique(y)]
    known = KnownMotions(windows, scale)
    found = known.found(list(map(FitRequest, groups)))
    for motion, group in zip(found, groups, strict=True):
        assert known.improved(motion, group) is motion


def test_what_no_known_motion_explains_is_fitted_from_several_starts(scene):
    windows, scale, y = scene
    one, other = (np.flatnonzero(y == k) for k in (0, 1))
    known = KnownMotions(windows, scale, windows.fit([one]))
    most = known_motions.NATS_OF_EXPLAINED * windows.freedom[other].sum()
    assert nats_of(windows, known._motions[0], other, scale).sum() > most
    (motion,), (anew,) = known.found([FitRequest(other)]), windows.fit([other])
    assert_array_equal(motion.squares, anew.squares)


def test_what_a_known_motion_explains_starts_with_it(scene, monkeypatch):
    """Where several starts have led elsewhere, as they may."""
    windows, scale, y = scene
    group, scale = np.flatnonzero(y == 0), 2 * scale
    known = KnownMotions(windows, scale, windows.fit([group]))
    monkeypatch.setattr(
        windows, "_poses_anew", lambda jobs, n: [[None] * len(windows.frames)] * n
    )
    (motion,) = known.found([FitRequest(group[::2])])
    most = known_motions.NATS_OF_EXPLAINED * windows.freedom[group].sum()
    assert nats_of(windows, motion, group, scale).sum() < most


def test_starts_are_known(scene):
    """Those that were found by others, too, and each once."""
    windows, scale, y = scene
    group = np.flatnonzero(y == 0)
    (start,) = windows.fit([group])
    known = KnownMotions(windows, scale)
    known.found([FitRequest(group[::2], (start,)), FitRequest(group[1::2], (start,))])
    assert known._motions[0] is start
    assert len(known._motions) == 3


def test_there_is_room_for_all_that_is_found(scene, monkeypatch):
    windows, scale, y = scene
    monkeypatch.setattr(known_motions, "FIRST_ROOM", 1)
    motions = windows.fit([np.flatnonzero(y == k) for k in np.unique(y)])
    known = KnownMotions(windows, scale, motions)
    for k, motion in enumerate(motions):
        nats = nats_in_windows(windows, motion, scale)
        assert_allclose(known._nats[:, k], nats, rtol=1e-6)


def test_nats_are_the_same_of_motions_that_are_known_and_others(scene):
    windows, scale, y = scene
    one, other = windows.fit([np.flatnonzero(y == k) for k in (0, 1)])
    known = KnownMotions(windows, scale, [one])
    for motion in (one, other):
        nats = nats_in_windows(windows, motion, scale).sum(axis=1)
        assert_array_equal(known.nats(motion), nats)


def test_a_motion_is_composed_of_others(scene):
    """Its residuals are those of its poses."""
    windows, _, y = scene
    motions = windows.fit([np.flatnonzero(y == k) for k in (0, 1)])
    chosen = [motions[k % 2] for k in range(len(windows.frames))]
    one = windows.composed(np.arange(9), chosen)
    (again,) = windows.motions_again([one])
    assert_array_equal(one.tracks, np.arange(9))
    assert_allclose(one.squares, again.squares, rtol=1e-9)
    assert_allclose(one.deviations, again.deviations, rtol=1e-9)
    assert_array_equal(one.known, again.known)
