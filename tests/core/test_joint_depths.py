"""Whether a common motion places a group at infinity."""

from __future__ import annotations

import numpy as np
import pytest

from skmotionseg._core.geometry.joint_depths import infinitely_far

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


def test_what_is_at_one_depth_may_be_at_infinity_by_another_focal_length():
    """Of a scene before a camera that turns; one of parts that are spread is none."""
    rng = np.random.RandomState(0)
    near, far = rng.normal(5.4, 0.3, (30, 1)), rng.normal(0.68, 0.007, (100, 1))
    spread = rng.normal(0.68, 0.1, (100, 1))
    errors = [np.full_like(each, 0.015) for each in (near, far)]
    assert infinitely_far([near, far], errors) > 1
    assert infinitely_far([far, near], errors[::-1]) > 1
    assert infinitely_far([near, spread], errors) < 0.1
    assert infinitely_far([far[:50], far[50:]], [errors[1][:50]] * 2) == 0


def test_windows_in_which_both_are_at_infinity_tell_nothing():
    rng = np.random.RandomState(0)
    depths = [rng.normal(mean, 0.1, (50, 1)) for mean in (1.0, 0.0)]
    still = [np.hstack([side, rng.normal(0.0, 0.1, (50, 4))]) for side in depths]
    once, often = (
        infinitely_far(sides, [np.full_like(side, 0.1) for side in sides])
        for sides in (depths, still)
    )
    assert once > 0.5
    assert often == once
