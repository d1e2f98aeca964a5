"""Drawn tracks cover all places, displacements and frames."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from skmotionseg import unpack_tracks
from skmotionseg._core.geometry import coverage
from skmotionseg._core.geometry.coverage import (
    NEVER_MET,
    _channels,
    _distance_to,
    draw_covering,
    draw_stratified,
)
from skmotionseg.datasets import make_rigid_motions


def choose(X, n_landmarks, seed=0):
    return draw_covering(*unpack_tracks(X), n_landmarks, np.random.RandomState(seed))


@pytest.fixture(scope="module")
def scene():
    """1,500 tracks: a background and two motions."""
    return make_rigid_motions(1500, 8, 3, missing=0.1, random_state=0)


# ------------------------------------------------------------------------ the choice


def test_one_observation_astray_changes_hardly_a_landmark(scene):
    X = scene[0].copy()
    X[7, 4:6] = 1e8
    assert np.isin(choose(X, 200), choose(scene[0], 200)).mean() > 0.9


@pytest.mark.parametrize("n_landmarks", [1, 2, 15, 16, 17, 333, 1499, 1500])
def test_as_many_landmarks_as_asked_for(scene, n_landmarks):
    chosen = choose(scene[0], n_landmarks)
    assert_array_equal(chosen, np.unique(chosen))
    assert len(chosen) == n_landmarks


def test_the_choice_depends_on_the_seed_alone(scene):
    assert_array_equal(choose(scene[0], 100), choose(scene[0], 100))
    assert (choose(scene[0], 100) != choose(scene[0], 100, seed=1)).any()


def test_the_choice_does_not_depend_on_the_batch(scene, monkeypatch):
    whole = choose(scene[0], 200)
    monkeypatch.setattr(coverage, "TRACKS_PER_BATCH", 100)
    assert np.isin(choose(scene[0], 200), whole).mean() > 0.99  # but for rounding


def test_a_small_motion_gets_more_landmarks_than_by_chance():
    X, y = make_rigid_motions(4000, 8, 2, missing=0, random_state=1)
    small = np.r_[np.flatnonzero(y == 0)[:1960], np.flatnonzero(y == 1)[:40]]
    shares = [np.isin(choose(X[small], 200, s), np.arange(1960, 2000)) for s in (0, 1)]
    assert np.mean(shares) > 1.5 * 40 / 2000


def test_landmarks_cover_all_frames():
    """Half of the tracks live in the first frames, a fiftieth in the last."""
    X, _ = make_rigid_motions(1000, 20, 1, missing=0, random_state=0)
    points = X.reshape(1000, 20, 2)
    points[:980, 10:] = np.nan
    points[980:, :10] = np.nan
    chosen = choose(points.reshape(1000, -1), 100)
    assert np.isin(chosen, np.arange(980, 1000)).sum() >= 8


def test_tracks_seen_in_no_two_frames_in_a_row_come_last(scene):
    X = scene[0][:100].copy()
    X[:50, 2:] = np.nan
    assert choose(X, 50).min() == 50
    assert len(choose(X, 70)) == 70


def test_equal_tracks_can_be_chosen_among(scene):
    X = np.repeat(scene[0][:1], 50, axis=0)
    assert len(choose(X, 20)) == 20


def test_groups_give_as_many_or_all_they_have():
    labels = np.repeat([0, 1, 2, -1], [100, 50, 3, 30])
    drawn = draw_stratified(labels[None], 60, np.random.RandomState(0))
    assert_array_equal(drawn, np.unique(drawn))
    counts = [np.sum(labels[drawn] == group) for group in (0, 1, 2, -1)]
    assert counts == [19, 19, 3, 19]


def test_groups_within_a_group_share_what_it_gives():
    groups = np.repeat([0, 1], [900, 100])
    parts = np.repeat([0, 1, 2, 3, 2], [500, 390, 10, 40, 60])
    labels = np.stack([groups, parts])
    drawn = draw_stratified(labels, 120, np.random.RandomState(0))
    assert_array_equal(drawn, np.unique(drawn))
    assert np.bincount(groups[drawn]).tolist() == [60, 60]
    among = [np.bincount(parts[drawn[groups[drawn] == k]]).tolist() for k in (0, 1)]
    assert among == [[25, 25, 10], [0, 0, 30, 30]]


@pytest.mark.parametrize("seed", range(3))
def test_distances_are_those_of_a_loop(seed):
    """Mean squares over common frames, of places and of steps, in median spreads."""
    X, _ = make_rigid_motions(30, 6, 2, missing=0.3, random_state=seed)
    points, visibility = unpack_tracks(X)
    visibility[0, np.flatnonzero(visibility[0])[1:]] = False  # never moves
    drawn = np.array([3, 9, 20])
    found = _distance_to(_channels(points, visibility), drawn)
    steps, moving = np.diff(points, axis=1), visibility[:, 1:] & visibility[:, :-1]
    total = np.zeros((30, 3))
    for values, seen in ((points, visibility), (steps, moving)):
        centred = np.full(values.shape, np.nan)
        for f in range(values.shape[1]):
            inside = seen[:, f]
            centred[inside, f] = values[inside, f] - values[inside, f].mean(axis=0)
        centred /= np.median(np.abs(centred[seen]))
        for i, (k, j) in product(range(30), enumerate(drawn)):
            common = [f for f in range(values.shape[1]) if seen[i, f] and seen[j, f]]
            squares = [np.sum((centred[i, f] - centred[j, f]) ** 2) for f in common]
            total[i, k] += np.mean(squares) if common else np.inf
    expected = total.min(axis=1)
    met = np.isfinite(expected)
    assert not met[0]
    most = np.quantile(expected[met], 0.9)
    expected = np.where(met, np.minimum(expected, most), NEVER_MET)
    assert_allclose(found, expected, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("n_frames", [1, 2])
def test_still_tracks_are_at_no_distance(n_frames):
    points = np.full((5, n_frames, 2), 3.0)
    visibility = np.ones((5, n_frames), dtype=bool)
    found = _distance_to(_channels(points, visibility), np.array([0]))
    assert_array_equal(found, 0 if n_frames > 1 else NEVER_MET)


def test_spreads_below_one_count():
    """Tracks in millimetres or in metres are as far from one another."""
    X, _ = make_rigid_motions(30, 6, 2, random_state=0)
    points, visibility = unpack_tracks(X)
    distances = [
        _distance_to(_channels(scale * points, visibility), np.array([0, 5]))
        for scale in (1, 1e-3)
    ]
    assert_allclose(*distances, rtol=1e-3, atol=1e-4)
    assert all(
        part.dtype == np.float32 for c in _channels(points, visibility) for part in c
    )
