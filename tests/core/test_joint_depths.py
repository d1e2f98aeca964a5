"""Whether a common motion places a group at infinity, or behind the camera."""

from __future__ import annotations

import numpy as np
import pytest

from skmotionseg._core.geometry.joint_depths import behind, infinitely_far

# Median of the absolute value of a normal variable.
OF_A_NORMAL = 0.6745


def test_what_is_at_infinity_is_told_from_what_is_near():
    rng = np.random.RandomState(6)
    near, far = rng.normal(1.0, 0.1, (50, 2)), rng.normal(0.0, 0.1, (80, 2))
    near[rng.uniform(size=near.shape) < 0.3] = np.nan
    errors = [np.full_like(each, 0.1) for each in (near, far)]
    whole = np.log(5) / (1 + OF_A_NORMAL)
    assert infinitely_far([near, far], errors) == pytest.approx(whole, abs=0.2)
    assert infinitely_far([far, near], errors[::-1]) == pytest.approx(whole, abs=0.2)
    # Neither is at infinity, the depths overlap, or nothing is known.
    assert infinitely_far([near + 3, far + 3], errors) < 0.1
    assert infinitely_far([far[:40], far[40:]], [errors[1][:40]] * 2) == 0
    unseen = np.full_like(near, np.nan)
    assert infinitely_far([unseen, far], errors) == 0
    same = [np.zeros((9, 2))] * 2
    assert infinitely_far(same, [np.ones((9, 2))] * 2) == 0


def test_what_is_behind_the_camera_is_told_from_what_is_in_front():
    rng = np.random.RandomState(3)
    front, back = rng.uniform(1.0, 1.4, (30, 2)), rng.uniform(-0.7, -0.3, (20, 2))
    errors = [np.full_like(each, 0.1) for each in (front, back)]
    assert behind([front, back], errors) == 1  # a gap wider than both
    assert behind([-back, -front], errors[::-1]) == 1
    assert behind([front, -back], errors) == behind([-front, back], errors) == 0


def test_behind_is_the_gap_over_the_ranges():
    """Of two windows, one places the other group in front, too, or sees nothing."""
    one, other = (np.linspace(*ends, 101)[:, None] for ends in ((4, 14), (-24, -4)))
    one, other = np.hstack([one, one]), np.hstack([other, -other])
    errors = [np.full_like(each, 0.1) for each in (one, other)]
    gap = (5 - -6) / (8 + 16) - 0.25
    assert behind([one, other], errors) == pytest.approx(gap / 2)
    one[:, 1] = np.nan
    assert behind([one, other], errors) == pytest.approx(gap)
    assert behind([np.full_like(one, np.nan), other], errors) == 0


def test_a_scene_that_reaches_behind_without_a_gap_is_no_evidence():
    """As where its depths are known up to a number that is added to all."""
    depths = np.linspace(-1, 1, 40)[:, None]
    errors = [np.full((20, 1), 0.001)] * 2
    assert behind([depths[:20], depths[20:]], errors) == 0
    mixed = np.where(np.arange(40) % 2, 1.0, -1.0)[:, None]
    assert behind([mixed[:20], mixed[20:]], errors) == 0
