"""Outliers are unexplained by rigid motion, and unlike their neighbours."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.mixture import GaussianMixture

from benchmarks.wrong_tracks import with_walks
from skmotionseg import MotionSegmenter, unpack_tracks
from skmotionseg._core.geometry.coverage import Neighbours
from skmotionseg._core.geometry.windows import Windows
from skmotionseg._core.partition.outliers import (
    FEWEST_DEVIATIONS,
    FEWEST_FITTED,
    LEAST_SPREAD,
    MOST_TIMES,
    REMOTE,
    STRANGE,
    RigidOutliers,
    _Normals,
    least_residuals,
    outlier_limits,
)
from skmotionseg.datasets import make_rigid_motions
from skmotionseg.metrics import misclassification_error


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
    assert (residuals[others] > outliers.limits.sure).mean() > 0.5
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
    limit = max(outliers.limits.sure / windows.least_noise, STRANGE / remoteness)
    assert_array_equal(
        replace(outliers, neighbours=alike).outside(points, visibility),
        np.isfinite(residuals) & (residuals > limit) & (remoteness > REMOTE),
    )


def _with_steps(points, some, frames, steps):
    """Points where some of the tracks are elsewhere by so much in some frames."""
    moved = points.copy()
    moved[np.ix_(some, frames)] += steps
    return moved


def test_a_track_that_slips_is_of_the_motion_that_it_follows_otherwise(clip, found):
    """It goes astray in the first frames or the last; one that wanders, in all."""
    points, visibility, y = clip
    some = np.flatnonzero(y == 0)[:10]
    rng = np.random.default_rng(0)
    slips = 60 * rng.standard_normal((10, 3, 2)).cumsum(axis=1)
    wanders = 20 * rng.standard_normal((10, 10, 2)).cumsum(axis=1)
    for frames in [7, 8, 9], [0, 1, 2]:
        slipped = _with_steps(points, some, frames, slips)
        assert found[-1].outside(slipped, visibility)[some].mean() < 0.3
        assert found[-1].doubtful(slipped, visibility)[some].mean() > 0.3
    wandering = _with_steps(points, some, np.arange(10), wanders)
    assert found[-1].outside(wandering, visibility)[some].all()


@pytest.mark.parametrize(
    ("of_two_motions", "followed"),
    [
        ([[1, 1, 9, 9, 9, 9, 9, 9], [9, 9, 9, 9, 9, 9, 9, 9]], True),
        ([[1, 9, 9, 9, 9, 9, 9, 9], [9, 9, 9, 9, 9, 9, 9, 9]], False),
        ([[1, 9, 9, 9, 9, 9, 9, 9], [9, 9, 9, 9, 9, 9, 9, 1]], False),
        ([[1, 9, 9, 9, None, None, None, None], [9, 9, 9, 9] + 4 * [None]], True),
        ([[9, 9, 9, 9, 9, 9, 9, 9], [1] + 7 * [None]], False),
        ([8 * [None], 8 * [None]], False),
    ],
)
def test_slipping_tracks_follow_one_motion_in_a_quarter_of_their_stretches(
    found, of_two_motions, followed
):
    """Those that any motion judges count, not those of the motion alone."""
    deviations = np.array(of_two_motions, dtype=float)[:, None]
    windows = SimpleNamespace(least_noise=1.0)
    windows.of = lambda *_: windows
    windows.motions_again = lambda motions: motions
    windows.deviations_in_stretches = lambda motion, _: deviations[motion]
    outliers = replace(found[-1], windows=windows, motions=[0, 1])
    one = np.zeros((1, 10, 2)), np.ones((1, 10), dtype=bool)
    assert_array_equal(outliers._followed(*one), [followed])


def test_tracks_seen_in_no_window_are_not_judged(clip, found):
    points, visibility, _ = clip
    hidden = np.zeros_like(visibility)
    assert not found[-1].outside(points, hidden).any()


def test_residuals_of_one_kind_have_no_outliers():
    residuals = np.random.default_rng(0).lognormal(0, 1.2, 400)
    assert (residuals > outlier_limits(residuals, 1000.0).doubtful).mean() < 0.005


def test_residuals_far_from_all_others_are_of_outliers():
    rng = np.random.default_rng(0)
    residuals = np.r_[rng.lognormal(0, 0.5, 300), rng.uniform(30, 500, 60)]
    limit = outlier_limits(residuals, 1000.0).sure
    assert limit >= FEWEST_DEVIATIONS
    assert_array_equal(residuals > limit, np.arange(360) >= 300)


@pytest.mark.parametrize("share", [0.1, 0.3, 0.45, 0.6])
def test_outliers_may_be_many(share):
    """The spread of all residuals is then wide, and says that none of them is far."""
    rng = np.random.default_rng(0)
    n = int(400 * share)
    residuals = np.r_[rng.lognormal(-0.7, 0.8, 400 - n), rng.lognormal(3.3, 0.6, n)]
    is_outlier = np.arange(400) >= 400 - n
    found = residuals > outlier_limits(residuals, 1000.0).sure
    assert found[is_outlier].mean() > 0.9
    assert not found[~is_outlier].any()


@pytest.mark.parametrize("n_parts", [1, 2])
def test_normal_distributions_are_those_of_scikit_learn(n_parts):
    rng = np.random.default_rng(0)
    x = np.r_[rng.normal(0, 0.7, 150), rng.normal(2, 0.9, 80)]
    parts = [x] if n_parts == 1 else [x[x < 1], x[x >= 1]]
    ours = _Normals.fitted(x, parts)
    spreads = np.array([part.var() for part in parts]) + LEAST_SPREAD**2
    theirs = GaussianMixture(
        n_parts,
        reg_covar=LEAST_SPREAD**2,
        weights_init=[len(part) / len(x) for part in parts],
        means_init=[[part.mean()] for part in parts],
        precisions_init=1 / spreads[:, None, None],
        random_state=0,
    ).fit(x[:, None])
    assert_allclose(ours.shares, theirs.weights_)
    assert_allclose(ours.means, theirs.means_[:, 0])
    assert_allclose(ours.variances, theirs.covariances_[:, 0, 0])
    assert_allclose(ours.criterion(x), theirs.bic(x[:, None]))


def test_most_tracks_are_no_outliers():
    """A tenth is explained far better than the others: they are the exceptions."""
    rng = np.random.default_rng(0)
    residuals = np.r_[rng.lognormal(-0.9, 0.2, 40), rng.lognormal(2.5, 0.2, 360)]
    assert (residuals > outlier_limits(residuals, 1000.0).sure).mean() < 0.01


def test_a_few_tracks_tell_of_no_outliers():
    residuals = np.r_[np.linspace(0.3, 0.4, FEWEST_FITTED - 1), 500.0]
    assert outlier_limits(residuals[1:], 1000.0) == (np.inf, np.inf)
    assert outlier_limits(residuals, 1000.0).sure < 500.0


def test_inliers_may_be_of_two_kinds():
    """Half of the tracks are a little worse: none is an outlier, some are doubtful."""
    rng = np.random.default_rng(0)
    residuals = np.r_[rng.lognormal(-1.2, 0.3, 100), rng.lognormal(0.8, 1.0, 100)]
    limits = outlier_limits(residuals, 1000.0)
    assert limits.doubtful < residuals.max() < limits.sure


def test_outliers_are_no_usual_neighbours():
    """Tracks that go anywhere are remote however many of them there are."""
    rng = np.random.default_rng(0)
    steps = np.where(np.arange(200)[:, None, None] < 100, 0.02, 3.0)
    moves = 2 + steps * rng.standard_normal((200, 12, 2))
    points = rng.uniform(0, 300, (200, 1, 2)) + moves.cumsum(axis=1)
    visibility = np.ones((200, 12), dtype=bool)
    remoteness = Neighbours(points, visibility, MOST_TIMES).remoteness(
        points, visibility
    )
    assert np.mean(remoteness[100:] > REMOTE) > 0.9
    assert np.mean(remoteness[:100] > REMOTE) < 0.1


def test_limit_is_that_of_all_tracks(clip, found):
    """Where outliers were left out, those that are left say nothing of them."""
    points, visibility, y = clip
    inliers = found[0].of(points[y >= 0], visibility[y >= 0])
    outliers = RigidOutliers.of(inliers, inliers.motions_again(found[1]))
    again = outliers.among(points, visibility)
    assert again.limits.sure < outliers.limits.sure
    outside = again.outside(points, visibility)
    assert outside[y < 0].mean() > 0.5 and not outside[y >= 0].any()


def test_more_are_doubtful_than_are_outliers(clip, found):
    points, visibility, y = clip
    outside = found[-1].outside(points, visibility)
    doubtful = found[-1].doubtful(points, visibility)
    assert doubtful[outside].all()
    assert doubtful.sum() > outside.sum()
    assert doubtful[y >= 0].mean() < 0.05


@pytest.mark.parametrize("seed", [0, 1])
def test_motions_are_found_among_many_walks(seed):
    """Two fifths of the tracks go anywhere: they make no motion, and belong to none."""
    clip = make_rigid_motions(140, 12, 3, random_state=seed)
    X, y = with_walks(*clip, 0.42, seed)
    segmenter = MotionSegmenter(random_state=seed).fit(X)
    assert segmenter.n_motions_ == 3
    assert misclassification_error(y[:140], segmenter.labels_[:140]) < 0.05
    assert np.mean(segmenter.labels_[140:] < 0) > 0.9


@pytest.mark.parametrize("residuals", [[], [0.0], [0.0] * 50, [1.0] * 50])
def test_there_need_be_no_outliers(residuals):
    residuals = np.array(residuals)
    assert not (residuals > outlier_limits(residuals, 100.0).doubtful).any()
