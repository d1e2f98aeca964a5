"""Motions that nobody follows yet."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.windows import two_windows

from skmotionseg._core.stream.assignment import measure
from skmotionseg._core.stream.births import (
    JOINTLY,
    _spread,
    apartness,
    find_candidate,
    joint_motions,
)


@pytest.fixture(scope="module")
def windows():
    return two_windows()


def test_tracks_that_nothing_explains_make_a_motion(windows):
    (first, _), groups = windows
    static, moving = first.fit(groups)
    scale = first.camera.noise
    residuals = measure(first, [static], scale)
    chosen = np.zeros(len(first.x), dtype=int)
    now = first.seen[:, -1]
    rng = np.random.RandomState(0)
    fit, members = find_candidate(first, residuals, chosen, first.x[:, -1], now, rng)
    assert fit is not None
    assert set(members) <= set(groups[1])
    assert len(members) > 0.8 * now[groups[1]].sum()
    both = measure(first, [static, moving], scale)
    assert apartness(first, both, 1, groups[1])[0] > 3
    ((_, saved),) = joint_motions(first, scale, [((static, moving), groups)])
    assert saved > 1000


def test_halves_of_a_motion_are_explained_jointly(windows):
    (first, _), groups = windows
    halves = groups[0][::2], groups[0][1::2]
    fits = first.fit(halves)
    ((_, saved),) = joint_motions(first, first.camera.noise, [(fits, halves)])
    assert saved < 0


def test_pairs_of_motions_are_each_as_alone(windows):
    (first, _), groups = windows
    scale, halves = first.camera.noise, (groups[0][::2], groups[0][1::2])
    pairs = [(first.fit(each), each) for each in (groups, halves)]
    together = joint_motions(first, scale, pairs)
    for pair, (fit, saved) in zip(pairs, together, strict=True):
        ((alone, saved_alone),) = joint_motions(first, scale, [pair])
        assert saved == pytest.approx(saved_alone, rel=1e-6)
        np.testing.assert_allclose(
            fit.poses.translations, alone.poses.translations, atol=1e-6
        )
    assert joint_motions(first, scale, []) == []


def test_a_motion_is_apart_from_others_and_not_from_itself(windows):
    (first, _), groups = windows
    fits = first.fit(groups)
    residuals = measure(first, [*fits, fits[0]], first.camera.noise)
    itself, other, same = apartness(first, residuals, 0, groups[0])
    assert itself == np.inf
    assert other > 1
    assert same == 0


def test_tracks_of_a_joint_motion_are_spread_over_the_group():
    few, many = np.arange(JOINTLY - 1) + 7, np.arange(3 * JOINTLY) + 7
    np.testing.assert_array_equal(_spread(few), few)
    some = _spread(many)
    assert (len(some), some[0], some[-1]) == (JOINTLY, many[0], many[-1])
    assert set(np.diff(some)) <= {3, 4}


def test_two_groups_without_a_fit_have_no_joint_motion(windows):
    (first, _), groups = windows
    nothing = SimpleNamespace(fit=lambda groups, starts=None: [None] * len(groups))
    found = joint_motions(nothing, 1.0, [(first.fit(groups), groups)])
    assert found == [(None, np.inf)]
