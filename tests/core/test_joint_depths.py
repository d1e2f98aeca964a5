"""Whether a common motion places a group at infinity, or behind the camera."""

from __future__ import annotations

import numpy as np
import pytest

from skmotionseg._core.partition.joint_depths import behind, infinitely_far

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
    front, back = np.full((30, 2), 1.0), np.full((20, 2), -1.0)
    sure, unsure = (([front * e, back * e * -1]) for e in (0.1, 1.0))
    assert behind([front, back], sure) == behind([-back, -front], sure[::-1]) == 1
    assert behind([front, back], unsure) == 0  # it may be at infinity
    assert behind([front, -back], sure) == behind([-front, back], sure) == 0


def test_behind_counts_pairs_of_tracks():
    """Two thirds of one group are behind, in one of two windows."""
    one, other = np.ones((30, 2)), np.ones((15, 2))
    other[:10, 0] = -1
    errors = [np.full_like(each, 0.1) for each in (one, other)]
    between, within = 2 / 3, 2 / 3 * 1 / 3
    assert behind([one, other], errors) == pytest.approx((between - within) / 2)
    one[:, 1] = np.nan
    assert behind([one, other], errors) == pytest.approx(between - within)
    assert behind([np.full_like(one, np.nan), other], errors) == 0


def test_a_group_on_both_sides_is_no_evidence():
    """As where depths are told badly: no group is then on one side."""
    mixed = np.where(np.arange(40) % 2, 1.0, -1.0)[:, None]
    errors = [np.full((20, 1), 0.1)] * 2
    assert behind([mixed[:20], mixed[20:]], errors) == 0
