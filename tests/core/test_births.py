"""Motions that nobody follows yet."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.windows import two_windows

from skmotionseg._core.geometry.camera import Camera
from skmotionseg._core.stream.assignment import measure
from skmotionseg._core.stream.births import (
    JOINTLY,
    _spread,
    apartness,
    are_mixed,
    find_candidate,
    is_at_infinity,
    joint_motions,
)
from skmotionseg._core.stream.window import LENGTH, Window


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
    ((_, saved, worse),) = joint_motions(first, scale, [((static, moving), groups)])
    assert saved > 1000
    assert worse > 1


def test_halves_of_a_motion_are_explained_jointly(windows):
    (first, _), groups = windows
    halves = groups[0][::2], groups[0][1::2]
    fits = first.fit(halves)
    ((_, saved, worse),) = joint_motions(first, first.camera.noise, [(fits, halves)])
    assert saved < 0
    assert worse < 0.3


def test_pairs_of_motions_are_each_as_alone(windows):
    (first, _), groups = windows
    scale, halves = first.camera.noise, (groups[0][::2], groups[0][1::2])
    pairs = [(first.fit(each), each) for each in (groups, halves)]
    together = joint_motions(first, scale, pairs)
    for pair, (fit, saved, worse) in zip(pairs, together, strict=True):
        ((alone, *others),) = joint_motions(first, scale, [pair])
        assert [saved, worse] == pytest.approx(others, rel=1e-6)
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


def test_what_is_placed_at_infinity_is_not_explained(windows, monkeypatch):
    """The motion of what moves past a still camera fits the scene, infinitely far."""
    rng = np.random.default_rng(0)
    places = rng.uniform(-0.4, 0.4, (60, 1, 2))
    depths = rng.uniform(1, 1.2, 30)
    frames = np.arange(LENGTH)
    steps = np.stack([0.02 * frames, 0.1 * np.sin(frames / 4)], axis=1)
    x = np.repeat(places, LENGTH, axis=1)
    x[30:] += steps / depths[:, None, None]
    x += rng.normal(0, 1e-4, x.shape)
    window = Window(x, np.ones(x.shape[:2], dtype=bool), Camera(np.zeros(2), 1.0, 2e-4))
    groups = np.arange(30), np.arange(30, 60)
    fits = window.fit(groups)
    assert np.median(measure(window, fits, 2e-4).deviations()[:30, 1]) < 2
    assert is_at_infinity(window, 2e-4, fits[1], groups)
    monkeypatch.setattr(
        window, "fit", lambda groups, starts=(): [fits[1]] * len(groups)
    )
    found = joint_motions(window, 2e-4, [(fits[::-1], groups[::-1])])
    assert found == [(fits[1], np.inf, np.inf)]
    monkeypatch.undo()
    # Halves of a scene that the camera moves through are not.
    (first, _), (scene, _) = windows
    (fit,) = first.fit([scene])
    assert not is_at_infinity(first, 2e-4, fit, (scene[::2], scene[1::2]))


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
    assert found == [(None, np.inf, np.inf)]


def test_parts_by_chance_are_mixed_and_things_beside_each_other_are_not():
    points = np.random.default_rng(0).uniform(0, 100, (200, 2))
    rows = np.arange(200)
    left = points[:, 0] < 50
    assert are_mixed(points, (rows[rows % 5 == 0], rows[rows % 5 > 0]))
    assert not are_mixed(points, (rows[left], rows[~left]))
    assert not are_mixed(points[:3], (rows[:0], rows[:2]))
