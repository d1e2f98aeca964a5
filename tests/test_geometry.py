"""Description length of groups of tracks under one epipolar geometry a frame pair."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from skmotionseg._core.epipolar import (
    cheapest_rank_two,
    nearest_rank_two,
    robust_fits,
)
from skmotionseg._core.geometry import (
    MAX_PAIRS,
    NOISE_LEVELS,
    DescriptionLength,
    clip_geometry,
    description_length,
)
from skmotionseg._core.judging import GroupLengths
from skmotionseg._core.merging import merge_path
from skmotionseg._core.selection import groups_of
from skmotionseg._core.tracks import unpack_tracks
from skmotionseg.datasets import make_rigid_motions
from skmotionseg.metrics import misclassification_error


def geometry_of(**scene):
    X, y = make_rigid_motions(**scene)
    return clip_geometry(*unpack_tracks(X)), y


def test_frame_pairs_are_limited_and_spread_over_the_clip():
    geometry, _ = geometry_of(n_tracks=30, n_frames=60, random_state=0)
    assert len(geometry.seen) == MAX_PAIRS
    short, _ = geometry_of(n_tracks=30, n_frames=3, random_state=0)
    assert len(short.seen) == 2  # no pair four frames apart


@pytest.mark.parametrize("noise", [0.1, 0.5])
def test_residuals_of_one_motion_are_its_noise(noise):
    X, _ = make_rigid_motions(
        n_tracks=200, n_frames=6, n_motions=1, noise=noise, missing=0, random_state=0
    )
    points = unpack_tracks(X)[0].swapaxes(0, 1)
    x, y = points[:1], points[1:2]
    _, errors = robust_fits(x, y, np.ones((1, 200), dtype=bool))
    assert np.sqrt(np.mean(errors)) == pytest.approx(noise, rel=0.15)


def test_a_fit_is_robust_to_a_few_tracks_of_another_motion():
    X, y = make_rigid_motions(
        n_tracks=150, n_frames=6, n_motions=2, noise=0.1, missing=0, random_state=0
    )
    few = np.sort(np.r_[np.flatnonzero(y == 0), np.flatnonzero(y == 1)[:3]])
    y = y[few]
    geometry = clip_geometry(*unpack_tracks(X[few]))
    _, errors = robust_fits(*geometry.of_group(np.arange(len(few))))
    noise = 0.1 / 250  # a working unit is about so many pixels
    assert np.median(errors[:, y == 0]) < noise**2
    assert np.median(errors[:, y == 1]) > 100 * noise**2


def test_pairs_that_see_fewer_than_eight_are_not_fitted():
    seen = np.ones((2, 20), dtype=bool)
    seen[1, 7:] = False
    points = np.random.default_rng(0).standard_normal((2, 2, 20, 2))
    _, errors = robust_fits(*points, seen)
    assert np.isfinite(errors[0]).all()
    assert np.isinf(errors[1]).all()


def random_moments(rank, n=100):
    """Moments (n, 9, 9) of epipolar equations that leave some directions open."""
    rng = np.random.default_rng(0)
    rows = rng.standard_normal((n, 40, rank)) @ rng.standard_normal((n, rank, 9))
    rows += 1e-3 * rng.standard_normal(rows.shape)
    return rows.swapaxes(1, 2) @ rows


@pytest.mark.parametrize("rank", [6, 7, 8])
@pytest.mark.parametrize("lower_rank", [nearest_rank_two, cheapest_rank_two])
def test_both_corrections_give_rank_two(lower_rank, rank):
    F = lower_rank(np.linalg.inv(random_moments(rank)))
    np.testing.assert_allclose(np.linalg.det(F), 0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(F, axis=(1, 2)), 1)


@pytest.mark.parametrize("rank", [6, 7])
def test_the_cheapest_correction_is_cheaper_where_entries_are_open(rank):
    moments = random_moments(rank)
    nearest, cheapest = (
        np.einsum("pi,pij,pj->p", f, moments, f)
        for lower_rank in (nearest_rank_two, cheapest_rank_two)
        for f in [lower_rank(np.linalg.inv(moments)).reshape(-1, 9)]
    )
    assert np.mean(cheapest < nearest) > 0.85  # some steps lead to no root
    assert np.median(nearest / cheapest) > 1e3


def test_the_two_corrections_agree_where_all_entries_are_determined():
    F = np.linalg.svd(np.random.default_rng(0).standard_normal((5, 3, 3)))
    F = (F[0] * [1, 0.5, 1e-4]) @ F[2]  # all but rank two
    f = F.reshape(5, 9) / np.linalg.norm(F, axis=(1, 2))[:, None]
    inverse = 1e6 * f[:, :, None] * f[:, None, :] + np.eye(9)
    np.testing.assert_allclose(
        nearest_rank_two(inverse), cheapest_rank_two(inverse), atol=1e-6
    )


@pytest.mark.parametrize("other", [-20, 0, 1e-300, 20])
def test_a_correction_never_steps_beyond_all_numbers(other):
    """Rounding may leave inverse moments that are negative in a direction."""
    f = np.diag([1.0, 0.5, 0.4]).reshape(-1) / np.linalg.norm([1, 0.5, 0.4])
    inverse = 100 * np.outer(f, f) + other * (np.eye(9) - np.outer(f, f))
    F = cheapest_rank_two(inverse[None])
    assert np.linalg.norm(F) == pytest.approx(1)


def test_fits_are_those_of_the_residuals_and_of_trusted_tracks_only():
    X, y = make_rigid_motions(
        n_tracks=150, n_frames=3, n_motions=2, noise=0.1, missing=0, random_state=0
    )
    geometry = clip_geometry(*unpack_tracks(X))
    first, second, seen = geometry.of_group(np.arange(150))
    trusted = np.broadcast_to(y == 0, seen.shape)
    F, errors = robust_fits(first, second, seen, trusted=trusted)
    _, background = robust_fits(first[:, y == 0], second[:, y == 0], seen[:, y == 0])
    alone = np.median(background)  # in other normalised coordinates
    assert np.median(errors[:, y == 0]) == pytest.approx(alone, rel=0.05)
    assert np.median(errors[:, y == 1]) > 1e4 * alone
    first, second = (np.dstack([side, np.ones(seen.shape)]) for side in (first, second))
    lines, back = first @ F.swapaxes(1, 2), second @ F
    gradient = (lines[..., :2] ** 2 + back[..., :2] ** 2).sum(axis=-1)
    sampson = (second * lines).sum(axis=-1) ** 2 / gradient
    np.testing.assert_allclose(sampson, errors, rtol=1e-6, atol=1e-15)


def test_true_motions_are_shorter_than_wrong_ones():
    geometry, y = geometry_of(random_state=0)
    lengths = GroupLengths(geometry)
    true = lengths.of_partition(y)
    merged = lengths.of_partition(np.minimum(y, 1))
    shuffled = lengths.of_partition(np.random.default_rng(0).permutation(y))
    assert true < merged < shuffled


def test_length_does_not_depend_on_order_and_hardly_on_image_scale():
    X, y = make_rigid_motions(random_state=0)
    points, visibility = unpack_tracks(X)
    members = np.flatnonzero(y == 1)
    geometry = clip_geometry(points, visibility)
    length = description_length(geometry, members).total
    reverse = description_length(geometry, members[::-1])
    assert reverse.total == pytest.approx(length)
    scaled = clip_geometry(7.5 * points + 1000, visibility)
    scaled = description_length(scaled, members)
    assert scaled.total == pytest.approx(length, rel=1e-6)


def test_a_model_costs_seven_free_tracks_where_there_is_one():
    geometry, _ = geometry_of(
        n_tracks=40, n_motions=1, n_frames=9, missing=0, random_state=0
    )
    assert description_length(geometry, np.arange(7)).models == 0
    models = description_length(geometry, np.arange(40)).models
    free = geometry.log_range[:, None] - np.log(NOISE_LEVELS * np.sqrt(2 * np.pi))
    independent = 8 / len(geometry.seen)  # 8 motions from frame to frame, 13 pairs
    assert np.isclose(models, 7 * independent * free.sum(axis=0)).any()


def test_noisier_tracks_take_more_to_describe():
    lengths = [
        description_length(
            geometry_of(n_motions=1, noise=noise, random_state=0)[0], np.arange(400)
        ).total
        for noise in (0.1, 0.3, 1.0)
    ]
    assert lengths == sorted(lengths)


def test_a_group_too_small_to_fit_costs_its_place_in_the_plane():
    geometry, _ = geometry_of(n_motions=1, missing=0, random_state=0)
    few = description_length(geometry, np.arange(7)).tracks.sum()
    # Two free coordinates an observation, whatever the noise level.
    assert few == pytest.approx(2 * 7 * geometry.log_range.sum())


@pytest.mark.parametrize("n_tracks", [1, 8, 30])
def test_still_tracks_have_a_finite_length(n_tracks):
    points = np.random.default_rng(0).uniform(0, 500, size=(n_tracks, 1, 2))
    points = np.repeat(points, 4, axis=1)
    geometry = clip_geometry(points, np.ones((n_tracks, 4), dtype=bool))
    assert np.isfinite(description_length(geometry, np.arange(n_tracks)).total)


def test_coincident_tracks_have_a_finite_length():
    points = np.full((12, 3, 2), 5.0)
    geometry = clip_geometry(points, np.ones((12, 3), dtype=bool))
    assert np.isfinite(description_length(geometry, np.arange(12)).total)


def test_merging_an_oversegmentation_finds_the_motions():
    X, y = make_rigid_motions(random_state=2)
    geometry = clip_geometry(*unpack_tracks(X))
    rng = np.random.default_rng(0)
    pieces = np.unique(2 * y + rng.integers(0, 2, len(y)), return_inverse=True)[1]
    affinity = 0.2 + 0.8 * (y[:, None] == y)
    path = list(merge_path(pieces, affinity, GroupLengths(geometry), n_last=3))
    assert [labels.max() + 1 for labels in path] == [6, 5, 4, 3]
    assert misclassification_error(y, path[-1]) == 0


def test_every_step_of_a_merge_joins_two_groups():
    geometry, _ = geometry_of(n_tracks=120, n_frames=6, random_state=0)
    pieces = np.arange(120) % 5
    path = list(merge_path(pieces, np.ones((120, 120)), GroupLengths(geometry), 1))
    for before, after in pairwise(path):
        joined = {(b, a) for b, a in zip(before, after, strict=True)}
        assert len(joined) == before.max() + 1  # no group is torn apart
        assert after.max() == before.max() - 1


def test_tracks_of_no_group_stay_so_in_every_merge():
    geometry, _ = geometry_of(n_tracks=60, n_frames=6, random_state=0)
    pieces = np.arange(60) % 5 - 1
    alone = pieces == -1
    for labels in merge_path(pieces, np.ones((60, 60)), GroupLengths(geometry), 1):
        assert set(labels[alone]) == {-1}
        assert set(labels[~alone]) == set(range(labels.max() + 1))


def test_lengths_are_computed_once(monkeypatch):
    geometry, y = geometry_of(n_tracks=60, n_frames=4, random_state=0)
    calls, nothing = [], DescriptionLength(np.zeros(1), 0.0, np.zeros(1, dtype=bool))
    monkeypatch.setattr(
        "skmotionseg._core.judging.description_length",
        lambda geometry, members, _: calls.append(len(members)) or nothing,
    )
    lengths = GroupLengths(geometry)
    lengths.of_partition(y)
    lengths.of_partition(y)
    assert len(calls) == len(groups_of(y))


def test_noise_levels_ascend():
    assert (np.diff(NOISE_LEVELS) > 0).all()
