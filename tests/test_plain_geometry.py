"""What judges partitions agrees with the same in loops (plain_geometry.py)."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
import plain_geometry as plain
import pytest
import textbook
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg._core import judging
from skmotionseg._core.epipolar import mean_sampson_errors, normalize_pairs, robust_fits
from skmotionseg._core.explaining import choose_model, robust_errors
from skmotionseg._core.geometry import (
    clip_geometry,
    description_length,
    shortest_length,
    track_medians,
)
from skmotionseg._core.judging import CUT_WEIGHT, GroupLengths, Judge
from skmotionseg._core.merging import merge_path
from skmotionseg._core.selection import cuts_between
from skmotionseg._core.tracks import unpack_tracks
from skmotionseg.datasets import make_rigid_motions


def noisy_pairs(n_pairs=4, n_tracks=30, seed=0):
    """Points of a rigid scene in pairs of frames, some unseen and some wrong."""
    X, _ = make_rigid_motions(n_tracks, 2 * n_pairs, 1, missing=0, random_state=seed)
    points = unpack_tracks(X)[0].swapaxes(0, 1) / 250 - 1
    x, y = points[::2], points[1::2]
    rng = np.random.default_rng(seed)
    y[:, :3] += 0.1 * rng.standard_normal((n_pairs, 3, 2))
    seen = rng.random((n_pairs, n_tracks)) < 0.7
    x[~seen], y[~seen] = 0, 0
    return x, y, seen


@pytest.fixture(params=range(3))
def scene(request):
    """Two motions with gaps: (points, visibility, labels)."""
    X, y = make_rigid_motions(60, 7, 2, missing=0.3, random_state=request.param)
    return *unpack_tracks(X), y


# ------------------------------------------------------------------------- robust fits


@pytest.mark.parametrize("n_trusted", [None, 20, 8, 7])
@pytest.mark.parametrize("seed", range(3))
def test_robust_fundamental_matrices(seed, n_trusted):
    x, y, seen = noisy_pairs(seed=seed)
    trusted = None
    if n_trusted is not None:
        trusted = np.cumsum(seen, axis=1) <= n_trusted
    F, errors = robust_fits(x, y, seen, trusted=trusted)
    for pair, which in enumerate(seen):
        chosen = None if trusted is None else trusted[pair][which]
        G, expected = plain.robust_fundamental(x[pair, which], y[pair, which], chosen)
        assert_allclose(errors[pair, which], expected, rtol=1e-4, atol=1e-12)
        sign = np.sign(np.sum(F[pair] * G))
        assert_allclose(sign * F[pair], G, rtol=1e-4, atol=1e-5 * np.abs(G).max())


def test_eight_tracks_are_fitted_and_seven_are_not():
    x, y, _ = noisy_pairs(2)
    seen = np.arange(30) < np.array([[8], [7]])
    F, errors = robust_fits(x, y, seen)
    assert np.isfinite(errors[0, :8]).all()
    assert np.linalg.matrix_rank(F[0]) == 2
    assert np.isinf(errors[1]).all()
    assert (F[1] == 0).all()
    for name in ("affine", "homography"):
        errors = robust_errors(name, x, y, seen)
        assert np.isfinite(errors[0, :8]).all()
        assert np.isinf(errors[1]).all()


@pytest.mark.parametrize("scale", [1, 1e-3])
def test_tracks_of_a_pair_are_centred_and_scaled_alike(scale):
    x, y, seen = noisy_pairs()
    x, y = scale * x, scale * y
    starts, ends, frames, spread = normalize_pairs(x, y, seen)
    for pair, which in enumerate(seen):
        first, second, maps, size = plain.normalized(x[pair, which], y[pair, which])
        assert_allclose(starts[pair, which], first, atol=1e-12)
        assert_allclose(ends[pair, which], second, atol=1e-12)
        assert_allclose(frames[:, pair], maps, rtol=1e-10, atol=1e-12)
        assert_allclose(spread[pair], size)
    assert_array_equal(starts[~seen], np.tile([0, 0, 1], (np.sum(~seen), 1)))


def test_tracks_that_coincide_are_not_scaled_up_to_rounding():
    _, _, _, spread = normalize_pairs(
        *np.full((2, 1, 9, 2), 0.3), np.ones((1, 9), bool)
    )
    assert_allclose(spread, 1e-6)


@pytest.mark.parametrize("name", ["affine", "homography"])
@pytest.mark.parametrize("seed", range(3))
def test_robust_maps(name, seed):
    x, y, seen = noisy_pairs(seed=seed)
    errors = robust_errors(name, x, y, seen)
    for pair, which in enumerate(seen):
        expected = plain.robust_map(
            name, x[pair, which], y[pair, which], textbook.SAMPSON[name]
        )
        assert_allclose(errors[pair, which], expected, rtol=1e-4, atol=1e-12)


@pytest.mark.parametrize("name", ["affine", "homography"])
def test_tracks_on_a_line_have_a_map_that_explains_them(name):
    """They leave open what happens beside the line."""
    x = np.linspace(-1, 1, 12)[:, None] * [1.0, 0.5]
    y = 1.1 * x + [0.1, -0.2]
    seen = np.ones((1, 12), dtype=bool)
    assert robust_errors(name, x[None], y[None], seen).max() < 1e-12


@pytest.mark.parametrize("seed", range(3))
def test_mean_errors_of_tracks(seed):
    X, _ = make_rigid_motions(30, 6, 1, missing=0, random_state=seed)
    points, _ = unpack_tracks(X)
    visibility = np.random.default_rng(seed).random((30, 6)) < 0.8
    visibility[0] = np.arange(6) == 2  # no pair sees it
    visibility[:, 5] = np.arange(30) < 9
    visibility[1:9, 4] = np.arange(1, 9) < 8  # the last pair sees seven tracks
    found = mean_sampson_errors(points, visibility)
    n_frames = visibility.shape[1]
    centres = [points[visibility[:, f], f].mean(axis=0) for f in range(n_frames)]
    scale = np.mean(
        [np.abs(points[i, f] - centres[f]) for i, f in np.argwhere(visibility)]
    )
    errors = [[] for _ in points]
    for f in range(n_frames - 1):
        seen = np.flatnonzero(visibility[:, f] & visibility[:, f + 1])
        x, y = ((points[seen, g] - centres[g]) / scale for g in (f, f + 1))
        if len(seen) >= 8:
            for i, error in zip(seen, plain.robust_fundamental(x, y)[1], strict=True):
                errors[i].append(error)
    expected = [np.mean(each) if each else np.nan for each in errors]
    assert np.isnan(expected[0])
    assert_allclose(found, expected, rtol=1e-3, atol=1e-12)


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
    for members in (labels == 0, labels == 1, np.arange(60) < 9, np.arange(60) < 7):
        members = np.flatnonzero(members)
        found = description_length(geometry, members)
        tracks, models = plain_length(geometry, members)
        assert_allclose(found.tracks, tracks, rtol=1e-4)
        assert found.models == pytest.approx(models)
        assert found.total == pytest.approx(sum(tracks) + models, rel=1e-4)
        n_seen = geometry.seen[:, members].sum(axis=1)
        assert_array_equal(found.modelled, n_seen >= 8)


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


def test_gains_are_of_pairs_in_which_both_have_a_model(scene):
    points, visibility, labels = scene
    visibility = visibility.copy()
    visibility[np.flatnonzero(labels == 1)[7:], 3:5] = False
    geometry = clip_geometry(points, visibility)
    first, second = (np.flatnonzero(labels == motion) for motion in (0, 1))
    n_first, n_second = (geometry.seen[:, each].sum(axis=1) for each in (first, second))
    both = (n_first >= 8) & (n_second >= 8)
    assert both.any()
    assert not both.all()
    apart = [plain_length(geometry, each)[0] for each in (first, second)]
    together = plain_length(geometry, np.arange(60))[0]
    saved = sum(together[k] - apart[0][k] - apart[1][k] for k in np.flatnonzero(both))
    smaller = min(n_first[both].sum(), n_second[both].sum())
    lengths = GroupLengths(geometry)
    assert lengths.gain(first, second) == pytest.approx(saved / smaller, rel=1e-3)
    assert lengths.gain(second, first) == pytest.approx(saved / smaller, rel=1e-3)


def test_the_cost_is_the_mean_length_and_the_weighted_cut(scene):
    points, visibility, labels = scene
    geometry = clip_geometry(points, visibility)
    rng = np.random.default_rng(0)
    views = rng.uniform(size=(2, 60, 60)) * (0.2 + (labels[:, None] == labels))
    views = views + views.swapaxes(1, 2)
    judge = Judge(geometry, views)
    cost = judge.cost(labels)
    cut = sum(textbook.normalized_cut(view, labels) for view in views)
    lengths = [
        sum(each(np.flatnonzero(labels == motion)).total for motion in (0, 1))
        for each in judge.lengths
    ]
    nats = np.mean(lengths) / geometry.seen.sum()
    assert_allclose(cost, [cut, nats, CUT_WEIGHT * cut + nats])


@pytest.mark.parametrize("evenly_drawn", [False, True])
def test_motions_gain_so_many_times_their_cut(scene, evenly_drawn, monkeypatch):
    points, visibility, labels = scene
    rng = np.random.default_rng(0)
    views = rng.uniform(size=(2, 60, 60)) * (0.2 + (labels[:, None] == labels))
    views = views + views.swapaxes(1, 2)
    judge = Judge(clip_geometry(points, visibility), views, evenly_drawn)
    groups = [np.flatnonzero(labels == motion) for motion in (0, 1)]
    gain = max(each.gain(*groups) for each in judge.lengths)
    cut = sum(cuts_between(view, labels)[0, 1] for view in judge.views)
    names = ["GAIN_OF_CUT", "GAIN_OF_CUT_DRAWN"]
    mine, other = names[::-1] if evenly_drawn else names
    monkeypatch.setattr(judging, other, np.nan)
    for share, pair in ((0.999, None), (1.001, (0, 1))):
        monkeypatch.setattr(judging, mine, share * gain / cut)
        assert judge.gainless_pair(labels) == pair
        assert judge.each_gains(labels) == (pair is None)


@pytest.mark.parametrize("seed", range(3))
def test_the_cut_between_two_groups_is_what_merging_them_saves(seed):
    rng = np.random.default_rng(seed)
    K = rng.uniform(size=(12, 12))
    K = K + K.T
    labels = np.arange(12) % 4
    found = cuts_between(K, labels)
    assert (np.diagonal(found) == 0).all()
    for i in range(4):
        for j in range(i):
            merged = np.where(labels == i, j, labels)
            merged = np.unique(merged, return_inverse=True)[1]
            fall = textbook.normalized_cut(K, labels)
            fall -= textbook.normalized_cut(K, merged)
            assert found[i, j] == pytest.approx(fall)
            assert found[j, i] == pytest.approx(fall)


@pytest.mark.parametrize("across", [0.05, 1])  # with 1, the graph knows nothing
@pytest.mark.parametrize("seed", range(3))
def test_groups_are_merged_in_the_order_of_their_costs(seed, across):
    """The most linked are tried first, until a link alone costs more than the best."""
    X, y = make_rigid_motions(80, 6, 2, random_state=seed)
    rng = np.random.default_rng(seed)
    pieces = np.unique(3 * y + rng.integers(0, 3, 80), return_inverse=True)[1]
    pieces[:2] = -1
    K = rng.uniform(size=(80, 80)) ** 4 * np.where(y[:, None] == y, 1, across)
    K = K + K.T
    K[np.ix_(pieces == 0, pieces == 5)] = K[np.ix_(pieces == 5, pieces == 0)] = 0
    lengths = GroupLengths(clip_geometry(*unpack_tracks(X)))
    groups = [list(np.flatnonzero(pieces == piece)) for piece in range(6)]
    for found in merge_path(pieces, K, lengths, 1):
        assert (found[:2] == -1).all()
        assert {frozenset(np.flatnonzero(found == g)) for g in set(found) - {-1}} == {
            frozenset(group) for group in groups
        }
        if len(groups) == 1:
            break
        costs = {}
        for i, j in combinations(range(len(groups)), 2):
            first, second = (np.array(sorted(groups[k])) for k in (i, j))
            nats = [
                lengths(each).tracks.sum()
                for each in (np.union1d(first, second), first, second)
            ]
            seen = lengths.geometry.seen
            fewer = min(seen[:, first].sum(), seen[:, second].sum())
            link = K[np.ix_(first, second)].mean() / np.sqrt(
                K[np.ix_(first, first)].mean() * K[np.ix_(second, second)].mean()
            )
            rise = (nats[0] - nats[1] - nats[2]) / fewer
            costs[i, j] = -np.log(max(link, 1e-3)), rise
        least = np.inf
        for pair in sorted(costs, key=costs.get):
            if costs[pair][0] >= least:
                break
            if sum(costs[pair]) < least:
                least, (i, j) = sum(costs[pair]), pair
        joined = groups[i] + groups[j]
        groups = [g for k, g in enumerate(groups) if k not in (i, j)] + [joined]


def test_medians_of_tracks_are_the_lower_ones():
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


@pytest.mark.parametrize("n_seen", [7, 8])
def test_pairs_that_see_seven_are_not_asked_for_a_model(n_seen):
    """Of twenty tracks, one is seen in the last two frames only."""
    X, _ = make_rigid_motions(20, 6, 1, missing=0, random_state=0)
    points, visibility = unpack_tracks(X)
    visibility[0, :4] = False
    visibility[n_seen:, 4:] = False
    found = choose_model(clip_geometry(points, visibility), np.arange(20))
    assert len(found.residuals) == (20 if n_seen == 8 else 19)
    assert np.isfinite(found.residuals).all()


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
