"""Outliers are unexplained by rigid motion, and unlike their neighbours."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from skmotionseg import unpack_tracks
from skmotionseg._core.geometry.windows import Windows
from skmotionseg._core.partition.outliers import (
    FEWEST_DEVIATIONS,
    REMOTE,
    STRANGE,
    RigidOutliers,
    least_residuals,
    outlier_limit,
)
from skmotionseg.datasets import make_rigid_motions


@pytest.fixture(scope="module")
def clip():
    """150 tracks of two motions, a fifth of them outliers: points, visibility, y."""
    X, y = make_rigid_motions(150, 10, 2, outliers=0.2, random_state=0)
    return *unpack_tracks(X), y


@pytest.fixture(scope="module")
def found(clip):
    points, visibility, y = clip
    windows = Windows(points, visibility)
    motions = windows.fit([np.flatnonzero(y == label) for label in (0, 1)])
    return windows, motions, RigidOutliers.of(windows, motions)


def test_outliers_are_told_from_tracks_of_rigid_motions(clip, found):
    points, visibility, y = clip
    outside = found[-1].outside(points, visibility)
    assert not outside[y >= 0].any()
    assert outside[y < 0].mean() > 0.5


def test_tracks_are_judged_alike_alone_and_with_others(clip, found):
    points, visibility, _ = clip
    outside = found[-1].outside(points, visibility)
    alone = [
        found[-1].outside(points[[k]], visibility[[k]])[0] for k in range(len(points))
    ]
    assert_array_equal(alone, outside)


def test_unexplained_tracks_that_go_together_are_no_outliers(clip, found):
    """A third motion that was not found is one: its tracks go with each other."""
    points, visibility, y = clip
    others = np.flatnonzero(y == 0)[:12]
    steps = 30.0 * np.arange(points.shape[1])[:, None] * [1, -1]
    together = points.copy()
    together[others] += steps
    outliers = RigidOutliers.of(found[0].of(together, visibility), found[1])
    residuals = least_residuals(
        outliers.windows, found[0].of(together, visibility).motions_again(found[1])
    )
    assert (residuals[others] > outliers.limit).mean() > 0.5
    assert outliers.outside(together, visibility)[others].mean() < 0.2
    # Each of them alone, among the others as they were, is.
    apart = np.array(
        [found[-1].outside(together[[k]], visibility[[k]])[0] for k in others]
    )
    assert apart.mean() > 0.5


@pytest.mark.parametrize("remoteness", [REMOTE - 0.1, REMOTE + 0.1, 3.0, np.inf])
def test_outliers_are_far_from_motions_and_from_neighbours(clip, found, remoteness):
    points, visibility, _ = clip
    alike = SimpleNamespace(remoteness=lambda p, _: np.full(len(p), remoteness))
    windows, motions, outliers = found
    residuals = least_residuals(windows, motions) / windows.least_noise
    limit = max(outliers.limit / windows.least_noise, STRANGE / remoteness)
    assert_array_equal(
        replace(outliers, neighbours=alike).outside(points, visibility),
        np.isfinite(residuals) & (residuals > limit) & (remoteness > REMOTE),
    )


def test_tracks_seen_in_no_window_are_not_judged(clip, found):
    points, visibility, _ = clip
    hidden = np.zeros_like(visibility)
    assert not found[-1].outside(points, hidden).any()


def test_residuals_of_one_kind_have_no_outliers():
    residuals = np.random.default_rng(0).lognormal(0, 1.2, 400)
    assert (residuals > outlier_limit(residuals, 1000.0)).mean() < 0.005


def test_residuals_far_from_all_others_are_of_outliers():
    rng = np.random.default_rng(0)
    residuals = np.r_[rng.lognormal(0, 0.5, 300), rng.uniform(30, 500, 60)]
    limit = outlier_limit(residuals, 1000.0)
    assert limit >= FEWEST_DEVIATIONS
    assert_array_equal(residuals > limit, np.arange(360) >= 300)


@pytest.mark.parametrize("residuals", [[], [0.0], [0.0] * 50, [1.0] * 50])
def test_there_need_be_no_outliers(residuals):
    assert not (np.array(residuals) > outlier_limit(np.array(residuals), 100.0)).any()
