"""Description lengths tell right groups from wrong ones, and agree with loops."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers import plain_geometry as plain
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg._core.geometry import description_length as module
from skmotionseg._core.geometry.description_length import (
    MAX_PAIRS,
    NOISE_LEVELS,
    clip_geometry,
    description_lengths,
    shortest_length,
    track_medians,
)
from skmotionseg._core.geometry.tracks import unpack_tracks
from skmotionseg._core.partition.cost import GroupLengths
from skmotionseg.datasets import make_rigid_motions


def description_length(geometry, members):
    return description_lengths(geometry, [members])[0]


def geometry_of(**scene):
    X, y = make_rigid_motions(**scene)
    return clip_geometry(*unpack_tracks(X)), y


def test_frame_pairs_are_limited_and_spread_over_the_clip():
    geometry, _ = geometry_of(n_tracks=30, n_frames=60, random_state=0)
    assert len(geometry.seen) == MAX_PAIRS
    short, _ = geometry_of(n_tracks=30, n_frames=3, random_state=0)
    assert len(short.seen) == 2  # no pair four frames apart


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


def test_noise_levels_ascend():
    assert (np.diff(NOISE_LEVELS) > 0).all()


@pytest.fixture(params=range(3))
def scene(request):
    """Two motions with gaps: (points, visibility, labels)."""
    X, y = make_rigid_motions(60, 7, 2, missing=0.3, random_state=request.param)
    return *unpack_tracks(X), y


# ------------------------------------------------------------------- description length


def test_coordinates_and_ranges_of_a_clip(scene):
    points, visibility, _ = scene
    geometry = clip_geometry(points, visibility)
    pairs = [(f, f + 1) for f in range(6)] + [(f, f + 4) for f in range(3)]
    assert_array_equal(geometry.frames.pairs, pairs)
    assert geometry.model_share == pytest.approx(6 / 9)
    centres = [points[visibility[:, f], f].mean(axis=0) for f in range(7)]
    scale = np.mean(
        [np.abs(points[i, f] - centres[f]) for i, f in np.argwhere(visibility)]
    )
    assert geometry.frames.scale == pytest.approx(scale)
    place = 0
    for k, (f, g) in enumerate(pairs):
        moves = []
        for i in range(len(points)):
            assert geometry.seen[k, i] == (visibility[i, f] and visibility[i, g])
            if not geometry.seen[k, i]:
                continue
            start = (points[i, f] - centres[f]) / scale
            end = (points[i, g] - centres[g]) / scale
            assert (geometry.pair[place], geometry.track[place]) == (k, i)
            assert_allclose(geometry.x[place], start)
            assert_allclose(geometry.y[place], end)
            moves.append(end - start)
            place += 1
        ranges = [
            max(np.percentile(m, 90) - np.percentile(m, 10), 4e-3)
            for m in np.transpose(moves)
        ]
        assert_allclose(geometry.log_range[k], np.mean(np.log(ranges)))
    assert place == geometry.n_observations


def test_observations_of_a_group(scene):
    points, visibility, _ = scene
    geometry = clip_geometry(points, visibility)
    members = np.array([3, 4, 10, 59])
    x, y, seen = geometry.of_group(members)
    for k, which in enumerate(geometry.seen):
        rows = [
            np.flatnonzero((geometry.pair == k) & (geometry.track == i))
            for i in members
            if which[i]
        ]
        rows = np.concatenate([*rows, np.zeros(0, dtype=int)])
        assert seen[k].sum() == len(rows)
        assert seen[k, : len(rows)].all()
        assert_array_equal(x[k, : len(rows)], geometry.x[rows])
        assert_array_equal(y[k, : len(rows)], geometry.y[rows])
        assert (x[k, len(rows) :] == 0).all()
        assert (y[k, len(rows) :] == 0).all()
    assert seen.shape[1] == seen.sum(axis=1).max()


def plain_length(geometry, members):
    """The nats of a group, tracks in each pair and models, in loops."""
    errors = []
    for k in range(len(geometry.seen)):
        rows = np.flatnonzero((geometry.pair == k) & np.isin(geometry.track, members))
        errors.append(plain.robust_fundamental(geometry.x[rows], geometry.y[rows])[1])
    return plain.description_length(errors, geometry.log_range, geometry.model_share)


def test_lengths_of_groups(scene):
    points, visibility, labels = scene
    geometry = clip_geometry(points, visibility)
    groups = (labels == 0, labels == 1, np.arange(60) < 9, np.arange(60) < 7)
    groups = [np.flatnonzero(members) for members in groups]
    lengths = description_lengths(geometry, groups)  # of other sizes, in one batch
    for members, found in zip(groups, lengths, strict=True):
        tracks, models = plain_length(geometry, members)
        assert_allclose(found.tracks, tracks, rtol=1e-4)
        assert found.models == pytest.approx(models)
        assert found.total == pytest.approx(sum(tracks) + models, rel=1e-4)
        n_seen = geometry.seen[:, members].sum(axis=1)
        assert_array_equal(found.modelled, n_seen >= 8)


@pytest.mark.parametrize("batch", [1, 500, 10**9])
def test_lengths_do_not_depend_on_the_size_of_batches(scene, batch, monkeypatch):
    geometry = clip_geometry(*scene[:2])
    rng = np.random.default_rng(0)
    groups = [rng.choice(60, size=n, replace=False) for n in (0, 30, 3, 60, 12, 9)]
    monkeypatch.setattr(module, "BATCH", batch)
    found = description_lengths(geometry, groups)
    alone = [description_length(geometry, members) for members in groups]
    for together, each in zip(found, alone, strict=True):
        assert together.total == pytest.approx(each.total, rel=1e-9)
        assert_array_equal(together.modelled, each.modelled)
    assert description_lengths(geometry, []) == []


@pytest.mark.parametrize(("n_constraints", "n_parameters"), [(1, 7), (2, 8), (2, 6)])
def test_lengths_by_any_model(scene, n_constraints, n_parameters):
    geometry = clip_geometry(*scene[:2])
    rng = np.random.default_rng(0)
    errors = [rng.exponential(1e-6, size=n) for n in geometry.seen.sum(axis=1)]
    errors[2][:] = np.inf
    dense = np.zeros(geometry.seen.shape)
    dense[geometry.seen] = np.concatenate(errors)
    found = shortest_length(geometry, dense, geometry.seen, n_constraints, n_parameters)
    tracks, models = plain.description_length(
        errors, geometry.log_range, geometry.model_share, n_constraints, n_parameters
    )
    assert_allclose(found.tracks, tracks)
    assert found.models == pytest.approx(models)


def test_medians_of_tracks_are_the_lower_ones_or_not():
    rng = np.random.default_rng(0)
    seen = rng.random((7, 20)) < 0.6
    seen[:, 0] = False
    distances = rng.uniform(size=seen.sum())
    distances[rng.random(len(distances)) < 0.2] = np.inf
    dense = np.full(seen.shape, np.nan)
    dense[seen] = distances
    expected = [plain.lower_median(column[~np.isnan(column)]) for column in dense.T]
    assert math.isnan(expected[0])
    assert_array_equal(track_medians(seen, distances), expected)
    finite = [column[np.isfinite(column)] for column in dense.T[1:]]
    plain_ones = [np.median(column) for column in finite]
    assert_allclose(track_medians(seen, distances, lower=False)[1:], plain_ones)
    assert np.any(np.array(plain_ones) > expected[1:])


# ------------------------------------------------------------------------- frame pairs


def pairs_of(n_frames, seen):
    """Pairs of a clip of 20 tracks that are seen in some of its frames."""
    points = np.random.default_rng(0).uniform(0, 100, size=(20, n_frames, 2))
    visibility = np.zeros((20, n_frames), dtype=bool)
    visibility[:, seen] = True
    return clip_geometry(points, visibility).frames.pairs


def test_a_clip_begins_and_ends_where_something_is_seen():
    inside = [(f, f + 1) for f in range(2, 8)] + [(f, f + 4) for f in range(2, 5)]
    assert_array_equal(pairs_of(12, slice(2, 9)), inside)
    assert_array_equal(pairs_of(12, [2, 8]), inside)  # empty ones in its midst stay
    assert_array_equal(pairs_of(12, [3, 4]), [(3, 4)])


@pytest.mark.parametrize("seen", [[], [2]])
def test_a_clip_without_a_pair_keeps_its_frames(seen):
    assert_array_equal(pairs_of(4, seen), [(0, 1), (1, 2), (2, 3)])


@pytest.mark.parametrize("gone", [0, 1, 2])
def test_pairs_are_as_many_as_tracks_of_usual_life_have(gone):
    """24, from the first to the last, and as many more as lives fit in the clip."""
    n_frames = 40
    visibility = np.ones((20, n_frames), dtype=bool)
    for i in range(20):
        if gone and i % (gone + 1):
            visibility[i, i % 7 + 10 :] = False
            visibility[i, : i % 7] = False  # ten frames each
    points = np.random.default_rng(0).uniform(0, 100, size=(20, n_frames, 2))
    pairs = clip_geometry(points, visibility).frames.pairs
    every = [(f, f + 1) for f in range(39)] + [(f, f + 4) for f in range(36)]
    most = {0: 24, 1: 24, 2: 24 * 4}[gone]
    if most >= len(every):
        assert_array_equal(pairs, every)
    else:
        places = [int(k * (len(every) - 1) / (most - 1)) for k in range(most)]
        assert_array_equal(pairs, np.array(every)[places])


def test_a_still_clip_has_a_range_to_describe():
    points = np.random.default_rng(0).uniform(0, 100, size=(20, 1, 2))
    points = np.repeat(points, 3, axis=1)
    geometry = clip_geometry(points, np.ones((20, 3), dtype=bool))
    assert_allclose(geometry.log_range, np.log(20 * plain.NOISE_LEVELS[0]))
    # A free coordinate costs a nat at least, however noisy the level.
    cost = shortest_length(geometry, np.full((2, 20), np.inf), geometry.seen, 1, 0)
    tracks, _ = plain.description_length(
        [[np.inf] * 20] * 2, geometry.log_range, geometry.model_share, 1, 0
    )
    assert_allclose(cost.tracks, tracks)


def test_a_motion_a_pair_is_paid_for_once_at_most():
    points = np.random.default_rng(0).uniform(0, 100, size=(20, 5, 2))
    visibility = np.ones((20, 5), dtype=bool)
    share = clip_geometry(points, visibility).model_share
    assert share == pytest.approx(4 / 5)  # four steps, and one pair four apart
    assert clip_geometry(points[:, :3], visibility[:, :3]).model_share == 1
    long = np.random.default_rng(0).uniform(0, 100, size=(20, 200, 2))
    assert clip_geometry(long, np.ones((20, 200), dtype=bool)).model_share == 1
