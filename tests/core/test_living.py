"""What becomes of motions."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.windows import two_windows

from skmotionseg._core.stream.assignment import measure
from skmotionseg._core.stream.living import (
    LivingMotion,
    advance,
    compare,
    refit,
    verdict,
)


@pytest.mark.parametrize(
    ("known", "n_tracks", "expected"),
    [
        ({"number": -9, "age": 2}, 9, None),
        ({"number": -9, "age": 5, "is_apart": True}, 9, "confirmed"),
        ({"number": -9, "age": 5, "is_apart": True}, 5, None),
        ({"number": -9, "age": 10}, 9, "dropped"),
        ({"number": -9, "age": 1}, 3, "dropped"),
        ({"number": 1, "unseen": 9}, 0, "hidden"),
        ({"number": 3, "alike": 11, "apart": 3}, 9, "merged"),
        ({"number": 3, "alike": 10, "apart": 3}, 9, None),
        ({"number": 3, "alike": 11, "apart": 30}, 9, None),
        ({"number": 1, "alike": 11, "apart": 30}, 9, "continued"),
        ({"number": 0, "alike": 11}, 9, "continued"),
        ({"number": 3, "together": 3}, 9, "joined"),
        ({"number": 0, "together": 3}, 9, None),
    ],
)
def test_what_becomes_of_motions(known, n_tracks, expected):
    motion = LivingMotion(fit=None, refitted=0, **known)
    alike = LivingMotion(2, fit=None, refitted=0) if motion.alike else None
    assert verdict(motion, n_tracks, alike) == expected


def test_what_is_one_of_its_own_is_no_part_that_came_later():
    motion = LivingMotion(1, fit=None, refitted=0, alike=11, apart=30)
    alike = LivingMotion(2, fit=None, refitted=0, apart=30)
    assert verdict(motion, 9, alike) is None


@pytest.fixture(scope="module")
def windows():
    return two_windows()


def living(window, groups, **known):
    fits = window.fit(groups)
    return [LivingMotion(k, fit, 0, **known) for k, fit in enumerate(fits)]


def deviation(window, motion, rows):
    found = measure(window, [motion.fit], window.camera.noise, rows).deviations()
    return np.nanmedian(found)


def test_motions_are_brought_to_the_newest_frame(windows):
    (first, second), groups = windows
    motions = living(first, groups, age=4, unseen=2)
    few = np.flatnonzero(second.seen[:, -1])[:3]
    advance(second, [*motions, unseen := living(first, groups)[0]], [*groups, few])
    assert [(motion.age, motion.unseen) for motion in motions] == [(5, 0)] * 2
    assert (unseen.age, unseen.unseen) == (1, 1)
    for motion, rows in zip(motions, groups, strict=True):
        assert motion.fit.valid[-1]
        assert deviation(second, motion, rows) < 0.6


def test_what_fits_badly_is_fitted_anew_after_some_frames(windows):
    (first, _), groups = windows
    scale = first.camera.noise
    motions = living(first, groups)
    good = motions[0].fit
    motions[0].fit = motions[1].fit
    refit(first, motions, groups, scale, frame=2)
    assert [motion.refitted for motion in motions] == [0, 0]
    assert deviation(first, motions[0], groups[0]) > 1
    refit(first, motions, groups, scale, frame=3)
    assert [motion.refitted for motion in motions] == [3, 0]
    assert deviation(first, motions[0], groups[0]) < 0.6
    assert motions[0].fit is not good


def test_what_fits_well_is_fitted_anew_one_after_another(windows):
    (first, _), groups = windows
    scale = first.camera.noise
    motions = living(first, groups)
    motions[0].refitted = 1
    for frame, expected in ((7, [1, 0]), (8, [1, 8]), (9, [9, 8]), (10, [9, 8])):
        refit(first, motions, groups, scale, frame)
        assert [motion.refitted for motion in motions] == expected
        before = [deviation(first, *each) for each in zip(motions, groups, strict=True)]
        assert max(before) < 0.6
    refit(first, motions, groups, scale, frame=30, anyway=False)
    assert [motion.refitted for motion in motions] == [9, 8]
    refit(first, [], [], scale, frame=30)


def test_a_worse_fit_is_not_taken(windows, monkeypatch):
    (first, _), groups = windows
    motions = living(first, groups)
    good, other = motions[0].fit, motions[1].fit
    monkeypatch.setattr(first, "fit", lambda groups: [other])
    refit(first, motions[:1], groups[:1], first.camera.noise, frame=8)
    assert motions[0].refitted == 8
    assert motions[0].fit is good


def test_motions_are_compared_with_all_others(windows):
    (first, _), groups = windows
    scale, rows = first.camera.noise, groups[1]
    static, moving = living(first, groups)
    half = LivingMotion(2, first.fit([rows[::2]])[0], 0)
    motions = [static, moving, half]
    residuals = measure(first, [motion.fit for motion in motions], scale)

    def compared(column, rows, sizes):
        own = [groups[0], groups[1], groups[1][::2]]
        own[column] = rows
        return compare(first, residuals, motions, column, own, np.array(sizes))

    # Half of a thing is alike to all of it, which is larger.
    assert compared(2, rows[::2], [70, 24, 12]) == (moving, moving)
    assert (half.alike, half.is_apart) == (1, False)
    compared(2, rows[::2], [70, 24, 12])
    assert half.alike == 2
    # The larger one is not alike to the smaller.
    assert compared(1, rows, [70, 24, 12]) == (None, half)
    assert (moving.alike, moving.is_apart) == (0, False)
    assert compared(2, rows[::2], [70, 12, 12]) == (None, moving)
    assert half.alike == 0
    # A candidate is nobody's closest.
    half.number = -5
    assert compared(1, rows, [70, 24, 30]) == (None, static)
    assert compared(0, groups[0], [70, 24, 12]) == (None, moving)
    assert static.is_apart
    compared(0, groups[0][:0], [70, 24, 12])
    assert not static.is_apart
